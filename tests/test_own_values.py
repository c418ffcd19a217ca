"""Values that recordings have of their own: `[free]` of a recording TOML."""

from dataclasses import replace

import numpy as np
import pytest

from zwidth.controllers.excitation import noise
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.findings import linear
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.model.own_values import varying
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError, Output
from zwidth.diagnosis.recording.own import own_of
from zwidth.diagnosis.seeking.screening import view
from zwidth.diagnosis.seeking.waves import wave_starts
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device, DeviceError
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate

CART = Device("cart", "", False, make_chain([0.8], [2.0], 300.0), Interface(period=0.005))
SPRINGS = {"stiff": 500.0, "soft": 220.0}
RIPPLE, PERIOD, LONG = 0.3, 0.004, 0.009


def run(word: str, seed: int, zero: float = 0.0, phase: float | None = None) -> Experiment:
    """A cart on one of two springs, whose encoder counts from `zero`; a ripple of its own phase."""
    own = CART.with_chain(CART.chain._replace(ground_spring=SPRINGS[word]))
    if phase is not None:
        ripple = make_physics("force_ripple", "m1", amplitude=RIPPLE, period=PERIOD, phase=phase)
        own = own.with_physics(ripple)
    free = own_of({"ground_spring": word, "position": word}, CART)
    e = recorded_on(own, seed, zero)
    return replace(e, name=f"{word}{seed}", own=free)


def recorded_on(own: Device, seed: int, zero: float = 0.0) -> Experiment:
    """A recording of a device, whose encoder counts from `zero`."""
    command = 3.0 * noise(duration=6.0, to_hz=12.0, period=0.005, seed=seed)
    there = simulate(own, recorded(command), duration=6.0, substeps=10)
    q = there.trace["position_m1"] + zero
    q = q + 1e-3 * q.std() * np.random.default_rng(seed).standard_normal(q.size)
    return Experiment(
        0.005, command, q[:, None], (Output("position", 0),), f"run{seed}", float(q.std())
    )


def test_springs_that_were_hung_in_turn_are_found_each_with_its_own_origin() -> None:
    """Fails where shares are cached by recordings' changes alone, or one origin holds in all."""
    es = [run("stiff", 1), run("soft", 2, zero=2e-3), run("soft", 3, zero=-1e-3)]
    es = [replace(e, swing=es[0].swing) for e in es]
    model = Model(CART, varying=varying(CART, es))
    names = [p.name for p in model.parameters]
    assert "k0 in soft" in names
    assert "k0 in stiff" not in names
    h = settled(judged(es, model, np.zeros(len(names))))
    told = linear(CART, h.fitted, es)
    assert told["k0"][1].value == pytest.approx(SPRINGS["stiff"], rel=0.01)
    assert told["k0 in soft"][1].value == pytest.approx(SPRINGS["soft"], rel=0.01)
    assert told["m1"][1].value == pytest.approx(0.8, rel=0.01)
    shift = [told[f"origin in soft{seed}"][1].value * es[0].swing for seed in (2, 3)]
    assert shift == pytest.approx([2e-3, -1e-3], abs=1e-4)


def test_a_ripple_has_a_phase_of_its_own_with_each_spring() -> None:
    """Fails where a start has one phase in all, or an angle stands still beyond its bounds."""
    es = [run("stiff", 1, phase=0.4), run("soft", 2, phase=3.1), run("soft", 3, phase=3.1)]
    model = Model(CART, varying=varying(CART, es))
    plain = settled(judged(es, model, np.zeros(len(model.parameters))))
    seen = view(plain.problem, plain.model, plain.x, own=True)
    shown = wave_starts(seen.problem, seen.fitted)
    start = next(s for s in shown if s.label == "force_ripple@m1")
    assert start.physics.values["period"] == pytest.approx(PERIOD, rel=0.05)
    ((_, turned),) = start.own.values()
    assert np.cos(turned - 2.7) > 0.9
    there = plain.model.with_effect(
        replace(start.physics, values={**start.physics.values, "phase": 0.6, "amplitude": 0.2}),
        start.scales,
    )
    own = [p.name for p in there.parameters[plain.x.size :]]
    x = np.concatenate([plain.x, start.beyond(own, start.scales)])
    found = settled(judged(es, there, x))
    (ripple,) = found.model.effects_at(found.x)
    assert ripple.values["amplitude"] == pytest.approx(RIPPLE, rel=0.02)
    soft = found.model.effects_at(found.model.there(found.x, es[1]))[0]
    assert np.cos(soft.values["phase"] - 3.1) > 0.99
    assert -np.pi <= soft.values["phase"] <= np.pi


def test_a_fit_that_ends_as_far_from_its_start_as_it_may_go_goes_on_from_there() -> None:
    """Fails with FURTHER = 0: what ends there counts as against physics.

    A period may move by 20 % of where it began, and this one lies by 27 % further.
    """
    start = make_physics("force_ripple", "m1", amplitude=RIPPLE, period=0.79 * LONG, phase=0.4)
    stiff = CART.with_chain(CART.chain._replace(ground_spring=SPRINGS["stiff"]))
    own = stiff.with_physics(
        make_physics("force_ripple", "m1", amplitude=RIPPLE, period=LONG, phase=0.4)
    )
    e = recorded_on(own, 1)
    model = Model(stiff).with_effect(start, {"amplitude": 0.1, "period": 0.02 * LONG, "phase": 0.5})
    found = settled(judged([e], model, np.zeros(len(model.parameters))))
    assert not found.against_physics
    assert found.model.effects_at(found.x)[0].values["period"] == pytest.approx(LONG, rel=0.02)


def test_a_word_that_no_fitted_recording_has_is_refused_where_it_judges() -> None:
    es = [run("stiff", 1)]
    with pytest.raises(ExperimentError, match="gives k0 the word 'soft'; no fitted recording"):
        diagnose(CART, es, [run("soft", 2)], effort=QUICK)


@pytest.mark.parametrize(
    ("key", "says"),
    [
        ("masess", "did you mean 'masses'"),
        ("link_springs", "the device has no link_springs"),
        ("coulomb_friktion@m1.level", "did you mean 'coulomb_friction'"),
        ("coulomb_friction@m1.levle", "did you mean 'level'"),
        ("coulomb_friction@n1.level", "n1"),
    ],
)
def test_a_key_that_no_fit_has_is_said(key: str, says: str) -> None:
    with pytest.raises(DeviceError, match=says):
        own_of({key: "word"}, CART)
