"""How well a device file knows its numbers: read and written, and what a fit makes of it."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import NonlinearConstraint, minimize
from scipy.signal import lfilter

from tests.diagnosis_examples import phantom, record
from zwidth.cli import run
from zwidth.controllers.none import none
from zwidth.diagnosis.answer import findings as findings_of
from zwidth.diagnosis.answer.augmented import augmented
from zwidth.diagnosis.answer.consequence import may_be_nothing
from zwidth.diagnosis.answer.findings import linear
from zwidth.diagnosis.answer.result import Estimate, Finding
from zwidth.diagnosis.fitting import uncertainty
from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.fitting.uncertainty import covariance, shared, spans, standard_errors
from zwidth.diagnosis.model.parameters import Model, linear_parameters
from zwidth.diagnosis.noise.settle import settle
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.scenarios.scenario import Scenario
from zwidth.scenarios.scenario_file import scenario_from_text, scenario_to_text
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device, DeviceError
from zwidth.sim.device_file import (
    device_from_text,
    device_to_text,
    load_device,
    model_hash,
    save_device,
)
from zwidth.sim.members import alike
from zwidth.sim.physics import make_physics
from zwidth.sim.uncertainty import UNCERTAINTY_FIELDS, Uncertainty

LEVEL = 0.02
FRICTION = make_physics("coulomb_friction", "m1", level=LEVEL)
DEVIATION = "this standard deviation (relative to the value) must be"
ODD = Uncertainty(0.1 + 0.2, 1.0 / 3.0, 0.7 / 9.0, 5.0 / 7.0)


def unsure(device: Device, **known: float) -> Device:
    return replace(device, uncertainty=Uncertainty(**known))


# The device file


@pytest.mark.parametrize("known", [ODD, *(Uncertainty(**{k: 0.11}) for k in UNCERTAINTY_FIELDS)])
def test_text_reads_back_to_the_bit(known: Uncertainty) -> None:
    """All of it, and each key alone. Mutation: a key left out, or two of them exchanged."""
    device = replace(phantom(), uncertainty=known)
    text = device_to_text(device)
    assert device_from_text(text).uncertainty == known
    assert device_from_text(text) == device
    assert device_to_text(device_from_text(text)) == text


def test_only_what_differs_is_written() -> None:
    """A device that says nothing keeps its text and hash. Mutation: all keys written always."""
    assert load_device("phantom_1_0").uncertainty == Uncertainty(0.0, 0.3, 0.3, 0.5)
    assert "uncertainty" not in device_to_text(phantom())
    text = device_to_text(unsure(phantom(), command_scale=0.05, masses=0.3))
    assert "\n[uncertainty]\ncommand_scale = 0.05\n" in text
    assert "masses = 0.3" not in text
    assert model_hash(unsure(phantom(), springs=0.1)) != model_hash(phantom())


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (
            "comand_scale = 1",
            "unknown key 'uncertainty.comand_scale'; did you mean 'command_scale'",
        ),
        ("damper = 1", "unknown key 'uncertainty.damper'; did you mean 'dampers'?"),
        ("masses = true", "uncertainty.masses is True; it must be a number"),
        (
            "masses = 0",
            f"uncertainty.masses is 0.0; {DEVIATION} from 1e-06 to 2",
        ),
        ("springs = -0.1", f"uncertainty.springs is -0.1; {DEVIATION} from 1e-06 to 2"),
        ("dampers = 101", f"uncertainty.dampers is 101.0; {DEVIATION} from 1e-06 to 100"),
        ("command_scale = nan", f"uncertainty.command_scale is nan; {DEVIATION} from 0 to 2"),
    ],
)
def test_a_bad_file_says_what_to_change(line: str, sentence: str) -> None:
    text = device_to_text(phantom()) + f"\n[uncertainty]\n{line}\n"
    with pytest.raises(DeviceError) as error:
        device_from_text(text, "my.toml")
    assert str(error.value).startswith(f"my.toml: {sentence}")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", UNCERTAINTY_FIELDS)
def test_what_is_not_allowed_is_refused(name: str) -> None:
    """Mutation: a field not checked, or open at one end."""
    none_is_allowed = name in ("command_scale", "zeros")
    lowest = 0.0 if none_is_allowed else 1e-6
    highest = {"dampers": 100.0, "zeros": 1000.0}.get(name, 2.0)
    for value in (-1e-9, -math.inf, math.inf, math.nan, math.nextafter(highest, math.inf)):
        with pytest.raises(ValueError, match=rf"^uncertainty\.{name} is .* must be from "):
            Uncertainty(**{name: value})
    for value in (lowest, highest):
        assert getattr(Uncertainty(**{name: value}), name) == value
    if not none_is_allowed:
        with pytest.raises(ValueError, match=rf"uncertainty\.{name} is 0\.0"):
            Uncertainty(**{name: 0.0})


def test_a_changed_device_is_known_as_well() -> None:
    """Mutation: a device made anew without it."""
    device = replace(load_device("phantom_1_0"), uncertainty=ODD)
    assert device.modal is not None
    for changed in (
        device.with_interface(delay=0.001),
        device.with_physics(FRICTION),
        device.with_physics(FRICTION).without_physics(),
        device.with_physics(make_physics("ground_spring", "m1", stiffness=1.0)),
        device.with_chain(device.chain),
        device.with_modal(device.modal),
        device.rigid(),
        alike(device, 2).device(1),
        augmented(Model(device), np.zeros(len(linear_parameters(device))), 1.0),
        scenario_from_text(scenario_to_text(Scenario(device, none(), 0.1))).device,
    ):
        assert changed.uncertainty == ODD


def test_equality_and_hash_count_it() -> None:
    """Mutations: left out of either."""
    one, other = unsure(phantom(), masses=0.1), unsure(phantom(), masses=0.2)
    assert one == unsure(phantom(), masses=0.1) != other
    assert len({one, other, unsure(phantom(), masses=0.1)}) == 2
    assert hash(one) != hash(other)


# What a fit may change


def test_scales_are_those_of_the_device_file() -> None:
    """Mutations: one for another; the spring to ground by the masses' or a constant."""
    device = phantom().with_chain(phantom().chain._replace(ground_spring=1.0))
    device = unsure(device, command_scale=0.07, masses=0.11, springs=0.13, dampers=0.17)
    found = {p.name: p for p in linear_parameters(device)}
    for name, scale in (("m1", 0.11), ("m3", 0.11), ("k12", 0.13), ("k0", 0.13), ("gain", 0.07)):
        assert (found[name].scale, found[name].lower, found[name].upper) == (scale, -5.0, 5.0)
    for name, value in (
        ("b1", device.chain.ground_dampers[0]),
        ("b12", device.chain.link_dampers[0]),
    ):
        assert found[name].scale == pytest.approx(0.17 * abs(value))
    x = np.array([3.0 if p.name == "m1" else 0.0 for p in found.values()])
    mass = Model(device).build(x).chain.masses[0]
    assert mass == pytest.approx(math.exp(0.33) * device.chain.masses[0], rel=1e-12)


def test_the_commands_scale_is_known_unless_the_file_says_otherwise() -> None:
    """Mutation: a gain of no width, which would stand in every refit and do nothing."""
    sure, open_ = phantom(), unsure(phantom(), command_scale=0.05)
    names = [p.name for p in linear_parameters(sure)]
    assert "gain" not in names
    assert {p.name for p in linear_parameters(open_)} == {*names, "gain"}
    model = Model(open_)
    x = np.array([2.0 if p.name == "gain" else 0.0 for p in model.parameters])
    assert model.reads(x).gain == pytest.approx(math.exp(0.1), rel=1e-12)
    assert Model(sure).reads(np.zeros(len(names))).gain == 1.0


# Intervals


@pytest.fixture(scope="module")
def rubbed() -> Experiment:
    """1.5 s of noise on the PHANToM with friction."""
    return record(phantom().with_physics(FRICTION), 1.5, seed=4)


def fitted(device: Device, e: Experiment) -> Fitted:
    model = Model(device, (FRICTION,), ({"level": LEVEL},))
    return settle([e], model, np.zeros(len(model.parameters)))[1]


def widths(device: Device, e: Experiment) -> tuple[dict[str, float], dict[str, float]]:
    """Relative half widths (one sigma) by name: as they are stated, and with all of it free."""
    final = fitted(device, e)
    stated, free = standard_errors(final), np.sqrt(np.diag(covariance(final)))
    found: tuple[dict[str, float], dict[str, float]] = {}, {}
    for j, p in enumerate(final.model.parameters):
        level = final.model.effects_at(final.x)[0].values["level"] if p.kind == "effect" else 1.0
        for kept, errors in zip(found, (stated, free), strict=True):
            kept[p.name] = p.scale * float(errors[j]) / level
    return found


def test_an_uncertain_scale_widens_its_own_interval_and_no_other(rubbed: Experiment) -> None:
    """A friction of many sigma, and masses and springs, beside a scale known to 10 %.

    Mutation: the full covariance in `standard_errors`, by which the level is known to 8 % and not
    to a tenth of that.
    """
    sure, _ = widths(phantom(), rubbed)
    stated, free = widths(unsure(phantom(), command_scale=0.1), rubbed)
    level = "coulomb_friction@m1.level"
    assert "gain" not in sure
    for name in (level, "m1", "m2", "m3", "k12", "k23"):
        assert stated[name] == pytest.approx(sure[name], rel=0.1)
    assert free[level] > 3.0 * stated[level]
    assert stated["gain"] == free["gain"]


@pytest.mark.parametrize("seed", range(6))
def test_an_interval_ends_where_no_other_parameter_leaves_its_bounds(seed: int) -> None:
    """Truth: the same convex problem, solved by another method.

    Mutations: another parameter may leave its bounds; what its bound uses up is not taken off; the
    rest is not known better once a parameter is held.
    """
    random = np.random.default_rng(seed)
    root = random.standard_normal((4, 4)) * np.array([1.0, 1.0, 3.0, 10.0])
    spread = root @ root.T
    x = random.uniform(0.0, 1.0, 4)
    inverse = np.linalg.inv(spread)
    for sign in (-1.0, 1.0):
        told = uncertainty._farthest(x, spread, 0, sign, np.zeros(4))  # pyright: ignore[reportPrivateUsage]
        free = [(None, None), *[(0.0, None)] * 3]
        within = NonlinearConstraint(
            lambda y: (y - x) @ inverse @ (y - x), -np.inf, uncertainty.Z95**2
        )
        best = minimize(
            lambda y, way=sign: -way * y[0], x, method="SLSQP", bounds=free, constraints=[within],
            options={"ftol": 1e-12, "maxiter": 500},
        )  # fmt: skip
        assert told == pytest.approx(best.x[0], rel=1e-3, abs=1e-3)


@pytest.fixture(scope="module")
def two_levels() -> Fitted:
    """A device on a spring, fitted with friction by direction: both levels 0.02 N m."""
    chain = make_chain([2e-4], [2e-3], ground_spring=2.0)
    device = phantom().with_chain(chain)
    friction = make_physics(
        "directional_friction", "m1", level_plus=LEVEL, level_minus=LEVEL,
        viscous_plus=0.0, viscous_minus=0.0,
    )  # fmt: skip
    e = record(device.with_physics(FRICTION), 1.5, seed=4)
    model = Model(device, (friction,), ({"level_plus": LEVEL, "level_minus": LEVEL},))
    return settle([e], model, np.zeros(len(model.parameters)))[1]


def test_of_two_levels_whose_sum_alone_is_known_neither_is_above_it(two_levels: Fitted) -> None:
    """Where a spring rests is not known: either level may be zero, and both together may not.

    Mutations: no bounds in `spans`; each magnitude asked alone in `_together_clear`.
    """
    places = [j for j, p in enumerate(two_levels.model.parameters) if p.kind == "effect"]
    levels = two_levels.model.effects_at(two_levels.x)[0].values
    both = levels["level_plus"] + levels["level_minus"]
    assert both == pytest.approx(2.0 * LEVEL, rel=0.1)
    wide = standard_errors(two_levels)[places] * LEVEL
    ends = two_levels.x[places] * LEVEL + LEVEL + spans(two_levels)[places, 1] * LEVEL
    assert np.all(wide > 2.0 * both)
    assert ends == pytest.approx(np.full(2, both), rel=0.1)
    assert findings_of._together_clear(two_levels, 0)  # pyright: ignore[reportPrivateUsage]
    sizes = {name: Estimate(LEVEL, 0.0, both, "N m") for name in levels}
    seen = Finding("directional_friction", "m1", sizes, 9.0, ())
    assert may_be_nothing(seen)
    assert not may_be_nothing(replace(seen, clear=True))


def test_the_scale_is_known_by_priors_alone(rubbed: Experiment) -> None:
    """Along the way on which command, masses, springs, dampers and forces all grow, nothing moves.

    So its variance is one over the sum of the priors' weights along it. Mutation: the gain's
    column left out for itself, too.
    """
    device = unsure(phantom(), command_scale=0.1)
    final = fitted(device, rubbed)
    there = final.model.build(final.x).chain
    dampers = {f"b{i + 1}": b for i, b in enumerate(there.ground_dampers)}
    dampers |= {f"b{i + 1}{i + 2}": b for i, b in enumerate(there.link_dampers)}
    weight = sum(
        (dampers.get(p.name, 1.0) / p.scale) ** 2
        for p in final.model.parameters
        if p.prior and p.kind not in ("jitter", "skew")
    )
    j = [p.name for p in final.model.parameters].index("gain")
    found = final.model.parameters[j].scale * float(standard_errors(final)[j])
    assert found == pytest.approx(1.0 / math.sqrt(weight), rel=0.02)


def test_a_refit_names_the_scale_where_it_is_free_alone(rubbed: Experiment) -> None:
    """With its own interval. Mutation: the interval at the known scale, which has no width."""
    assert "gain" not in linear(phantom(), fitted(phantom(), rubbed), [rubbed])
    device = unsure(phantom(), command_scale=0.1)
    nominal, gain = linear(device, fitted(device, rubbed), [rubbed])["gain"]
    assert nominal == 1.0
    assert gain.lower < 1.0 < gain.upper
    assert 0.2 < gain.upper - gain.lower < 0.4


def test_no_interval_goes_below_a_damper_of_zero(rubbed: Experiment) -> None:
    """A damper that is hardly known. Mutation: the interval as wide below as above."""
    device = phantom()
    own = next(p for p in linear_parameters(device) if p.kind == "damper" and p.lower > -5.0)
    final = fitted(device, rubbed)
    j = [p.name for p in final.model.parameters].index(own.name)
    still = replace(final, x=np.where(np.arange(final.x.size) == j, 0.9 * own.lower, final.x))
    _, known = linear(device, still, [rubbed], {own.name: 1.0})[own.name]
    assert known.lower == pytest.approx(0.0, abs=1e-9)
    assert known.upper > known.value + 1.9
    assert known.value > 0.0


def test_a_device_shows_what_it_says_of_itself(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`zwidth devices`. Mutation: masses under the name of springs."""
    save_device(unsure(phantom(), command_scale=0.05, springs=0.2), tmp_path / "rig.toml")
    assert run(["devices", str(tmp_path / "rig.toml")]) == 0
    said = capsys.readouterr().out
    assert "command scale known to 5 % (one sigma)\nsprings known to 20 % (one sigma)\n" in said
    assert "masses known" not in said


def test_so_many_samples_tell_as_much_as_one():
    """A sum of n neighbours that follow x_t = a x_(t-1) + e_t scatters as n (1 - a) / (1 + a) do.

    Mutation: the mean of each segment taken off, so that what is slowest does not count.
    """
    e = np.random.default_rng(0).standard_normal((20_000, 2))
    each = lfilter([1.0], [1.0, -0.9], e, axis=0)
    assert shared(each, 400) == pytest.approx(19.0, rel=0.1)
    assert shared(e, 400) == pytest.approx(1.0, abs=0.1)
