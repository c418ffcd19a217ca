"""A parameter that steps, drifts or settles is found, dated and measured; what stays is left alone.

The recordings are of an integrator of its own: a mass under Coulomb friction, fifty times a sample.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray
from scipy.stats import chi2

from zwidth.diagnosis.answer.changes import (
    Change,
    _as_it_goes_on,
    change_of,
    changing,
    outlived,
)
from zwidth.diagnosis.answer.result import Verdict
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.learning.changing import (
    DRIFT,
    EACH,
    FOLLOWS,
    RUN,
    SETTLES,
    STEP,
    WITH_LEVEL,
    course,
    cut,
    level_of,
    share_at,
    suspected,
    varied,
)
from zwidth.diagnosis.mishaps import silent
from zwidth.diagnosis.model.parameters import Model, Varying
from zwidth.diagnosis.noise.predictor import innovations
from zwidth.diagnosis.recording.experiment import Covariate, Experiment, Output
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.diagnosis.selection.moves import shown
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.selection.searched import as_found
from zwidth.figures.changes import changes_figure
from zwidth.sim.chain import make_chain
from zwidth.sim.changes import beside, changes_of, difference
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics

Floats = NDArray[np.float64]
T = 0.004
FINE = 50
DEVICE = Device("mass", "", True, make_chain([1e-3], [2e-3], 0.0), Interface(period=T))


@njit
def moved(command: Floats, mass: Floats, damper: Floats, friction: Floats) -> Floats:
    """Positions (ticks,) of a mass whose numbers (ticks,) differ from sample to sample."""
    found = np.zeros(command.size)
    x, v, h = 0.0, 0.0, T / FINE
    for k in range(command.size):
        found[k] = x
        for _ in range(FINE):
            w = v + h * (command[k] - damper[k] * v) / mass[k]
            stops = h * friction[k] / mass[k]
            w = w - stops if w > stops else (w + stops if w < -stops else 0.0)
            x += 0.5 * h * (v + w)
            v = w
    return found


Factors = dict[str, Floats]


def recording(seconds: float, seed: int, factors: Factors, name: str = "swing") -> Experiment:
    random = np.random.default_rng(seed)
    ticks = round(seconds / T)
    t = T * np.arange(ticks)
    waves = zip(random.uniform(0.4, 4.0, 3), random.uniform(0.0, 6.0, 3), strict=True)
    command = np.sum([0.06 * np.sin(2.0 * np.pi * f * t + p) for f, p in waves], axis=0)
    own = {"mass": 1e-3, "damper": 2e-3, "friction": 0.02}
    numbers = [value * factors.get(key, 1.0) * np.ones(ticks) for key, value in own.items()]
    y = moved(command, *numbers) + 2e-4 * random.standard_normal(ticks)
    return Experiment(T, command, y[:, None], (Output("position", 0),), name, float(y.std()))


def fitted(*experiments: Experiment) -> Hypothesis:
    """Friction, fitted as if nothing changed."""
    friction = make_physics("coulomb_friction", "m1", level=0.02)
    model = Model(DEVICE).with_effect(friction, {"level": 0.02})
    return settled(judged(experiments, model, np.zeros(len(model.parameters))))


def at_time(seconds: float, after: float, tau: float) -> Floats:
    return np.where(T * np.arange(round(seconds / T)) < tau, 1.0, after)


@cache
def step() -> tuple[Hypothesis, Hypothesis]:
    h = fitted(recording(12.0, 5, {"friction": at_time(12.0, 1.05, 7.0)}))
    suspect = suspected(h)
    assert suspect is not None
    assert (suspect.of, suspect.shape) == ("coulomb_friction@m1.level", STEP)
    new = varied(h, suspect)
    assert new is not None
    low, high = (T * t for t in new.suspect.between)
    assert low <= T * new.suspect.at <= high
    assert T * new.suspect.at == pytest.approx(7.0, abs=0.03)
    assert high - low < 0.6  # 5 % of the length
    return h, new.hypothesis


def test_a_step_of_five_percent_is_found_dated_and_measured():
    """Mutations that break it: slopes not taken off the other parameters' span; shares the other
    way round; the change put on all parts; the date read off the slopes alone, which are late.
    """
    _, h = step()
    (own,) = (p for p in h.model.parameters if p.kind == "change")
    last = h.model.effects_at(h.x)[0].values["level"]
    first = h.model.effects_at(h.model.there(h.x, h.experiments[0]))[0].values["level"]
    assert last == pytest.approx(0.021, rel=2e-3)
    assert first == pytest.approx(0.020, rel=2e-3)
    assert own.name == "change 1"
    assert [e.shares for e in h.experiments] == [(("change 1", 1.0),), ()]
    assert suspected(h) is None  # nothing changes besides


def test_effects_are_tried_beside_a_change():
    """Their numbers come before the change, which is last.

    Mutation that breaks it: `Model.beside` puts them at the end.
    """
    _, h = step()
    change = h.x[[p.name for p in h.model.parameters].index("change 1")]
    tried = list(shown(h, QUICK))
    assert tried
    for one in tried:
        x = {p.name: value for p, value in zip(one.model.parameters, one.x, strict=True)}
        own = [x[p.name] for p in one.model.parameters[h.model.lasting : one.model.lasting]]
        assert own == [0.0] * len(own)  # as the start is
        assert x["change 1"] == pytest.approx(change, abs=0.2 * abs(change))


def test_the_course_shows_what_each_window_says():
    """Mutation that breaks it: a window's own slopes left out of what it shares with the others."""
    h, _ = step()
    index = [p.name for p in h.model.parameters].index("coulomb_friction@m1.level")
    told = course(h, index, None)
    p = h.model.parameters[index]
    levels = h.model.effects[0].values["level"] + p.scale * told.x
    early, late = told.times < 6.5, told.times > 7.5
    errors = p.scale * told.errors
    for which, truth in ((early, 0.020), (late, 0.021)):
        off = (levels[which] - truth) / errors[which]
        assert np.abs(off).max() < 4.0
    assert (levels[late].mean() - levels[early].mean()) == pytest.approx(1e-3, rel=0.2)


@pytest.mark.parametrize("which", ["mass", "damper"])
def test_what_changes_is_told_from_what_stays(which: str):
    """Friction stays; mutation that breaks it: gains that are not held against their spread."""
    size = {"mass": 1.05, "damper": 1.5}[which]
    h = fitted(recording(12.0, 6, {which: at_time(12.0, size, 4.0)}))
    suspect = suspected(h)
    assert suspect is not None
    assert suspect.of == {"mass": "m1", "damper": "b1"}[which]
    new = varied(h, suspect)
    assert new is not None
    low, high = (T * t for t in new.suspect.between)
    assert low <= 4.0 <= high
    ends = [new.hypothesis.model.build(new.hypothesis.model.there(new.hypothesis.x, e)).chain
            for e in new.hypothesis.experiments]  # fmt: skip
    before, after = ((c.masses if which == "mass" else c.ground_dampers)[0] for c in ends)
    assert after / before == pytest.approx(size, rel=0.01)


@njit
def dragged(command: Floats, drag: float) -> Floats:
    """Positions (ticks,) of the mass with a drag by the square of its speed [N m s^2/rad^2]."""
    found = np.zeros(command.size)
    x, v, h = 0.0, 0.0, T / FINE
    for k in range(command.size):
        found[k] = x
        for _ in range(FINE):
            w = v + h * (command[k] - 2e-3 * v - drag * v * abs(v)) / 1e-3
            stops = h * 0.02 / 1e-3
            w = w - stops if w > stops else (w + stops if w < -stops else 0.0)
            x += 0.5 * h * (v + w)
            v = w
    return found


def louder(seed: int, law: bool) -> Experiment:
    """A command 1.6 times as large from 4 s on, on a drag, or on a damper that rises then."""
    e = recording(12.0, seed, {})
    command = e.command * at_time(12.0, 1.6, 4.0)
    own = 1e-3, 2e-3 * at_time(12.0, 1.5, 4.0), 0.02
    numbers = [value * np.ones(e.ticks) for value in own]
    y = dragged(command, 1e-4) if law else moved(command, *numbers)
    noise = 2e-4 * np.random.default_rng(1).standard_normal(e.ticks)
    return replace(e, command=command, measured=(y + noise)[:, None])


@pytest.mark.parametrize("seed", [7, 8])
@pytest.mark.parametrize("law", [True, False])
def test_a_change_that_goes_with_the_level_of_the_command_is_marked(seed: int, law: bool):
    """A drag by the square of the speed is a damper that rises where the command does.

    A damper that rises by itself is not marked, though the command rises at the same time: its
    level also varies before and after. Mutations that break it: the level of the whole recording;
    the mean for the rms; every change marked.
    """
    suspect = suspected(fitted(louder(seed, law)))
    assert suspect is not None
    assert suspect.of == "b1"
    assert (WITH_LEVEL in suspect.as_well) == law


@pytest.mark.parametrize("louder_by", [1.05, 1.2])
def test_levels_that_hardly_differ_explain_no_change(louder_by: float):
    """Constant commands of nearly one level: any step between them would go with their level."""
    e = recording(12.0, 6, {})
    held = replace(e, command=np.where(np.arange(e.ticks) < 900, -1.0, -louder_by))
    level = level_of([held])
    assert (level is None) == (louder_by < 1.1)
    if level is not None:
        assert level[[0, -1]] == pytest.approx([1.0 / louder_by, 1.0])


@pytest.mark.parametrize("seed", range(6))
def test_a_command_that_falls_to_zero_has_levels(seed: int):
    """Rounding may leave a running mean of squares below zero. Mutation: its root as it is."""
    e = recording(12.0, 6, {})
    command = np.random.default_rng(seed).normal(size=e.ticks)
    level = level_of([replace(e, command=np.where(np.arange(e.ticks) < 900, command, 0.0))])
    assert level is not None
    assert level.max() == 1.0
    assert level[-1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("shape", [DRIFT, SETTLES])
def test_what_moves_slowly_is_no_step(shape: str):
    """Mutation that breaks it: all shapes but the step left out, or the drift turned round."""
    share = np.arange(3000) / 3000
    course = 1.0 + 0.1 * share if shape == DRIFT else 1.0 - 0.15 * np.exp(-share / 0.1)
    h = fitted(recording(12.0, 7, {"friction": course}))
    suspect = suspected(h)
    assert suspect is not None
    assert (suspect.of, suspect.shape) == ("coulomb_friction@m1.level", shape)
    new = varied(h, suspect)
    assert new is not None
    own = new.hypothesis
    first = own.model.effects_at(own.model.there(own.x, own.experiments[0]))[0].values["level"]
    last = own.model.effects_at(own.x)[0].values["level"]
    mean = float((0.02 * course)[100 : own.experiments[0].ticks].mean())
    assert last == pytest.approx(0.022 if shape == DRIFT else 0.02, rel=5e-3)
    assert first == pytest.approx(mean, rel=0.01)  # parts are taken as constant
    if shape == SETTLES:
        assert suspect.rates[0] <= 300.0 <= suspect.rates[1]
        assert suspect.rate == pytest.approx(300.0, rel=0.25)


def pushed() -> Experiment:
    """A recording in which an offset that nobody knows drifts from -1 to 1 mN m."""
    e = recording(12.0, 8, {})
    return replace(e, command=e.command - 1e-3 * np.linspace(-1.0, 1.0, e.ticks))


def by_direction(e: Experiment) -> Hypothesis:
    """Friction by direction, fitted as if nothing changed."""
    levels = {"level_plus": 0.02, "level_minus": 0.02}
    friction = make_physics(
        "directional_friction", "m1", **levels, viscous_plus=0.0, viscous_minus=0.0
    )
    model = Model(DEVICE).with_effect(friction, levels)
    return settled(judged([e], model, np.zeros(len(model.parameters))))


def test_an_offset_drifts_that_two_levels_hold_between_them():
    """A constant force beside friction by direction is none of its own.

    Mutations that break it: ways of single parameters alone; the second level not moved; the sign
    of either; the course not turned.
    """
    e = pushed()
    h = by_direction(e)
    suspect = suspected(h)
    assert suspect is not None
    assert (suspect.of, suspect.against, suspect.shape) == (
        "directional_friction@m1.level_minus", "directional_friction@m1.level_plus", DRIFT,
    )  # fmt: skip
    new = varied(h, suspect)
    assert new is not None
    ends = new.hypothesis.model.effects_at(new.hypothesis.x)[0].values
    assert ends["level_minus"] == pytest.approx(0.021, rel=5e-3)
    assert ends["level_plus"] == pytest.approx(0.019, rel=5e-3)
    change = change_of(new, h.experiments)
    assert change.sentence.startswith("the constant force at the motor drifted from -1.0")
    assert change.after.lower < 1e-3 < change.after.upper
    assert change.by.value == pytest.approx(2e-3, rel=0.05)
    shown = change.windows
    truth = np.interp(shown.times, (0.0, 12.0), (-1e-3, 1e-3))
    assert np.mean((shown.lower < truth) & (truth < shown.upper)) > 0.8
    assert np.abs(shown.values - truth).mean() < 4e-4


@pytest.mark.parametrize("seed", range(6))
def test_nothing_changes_where_nothing_does(seed: int):
    """Mutation that breaks it: what was asked for so often is not paid."""
    h = fitted(recording(8.0, 20 + seed, {}))
    suspect = suspected(h)
    assert suspect is None or varied(h, suspect) is None


def test_a_change_competes_with_names_that_were_refused():
    """A damper that rose, in an answer that does without the friction that explains more.

    Mutations that break it: a change believed over the answer without it alone; the names that were
    refused fitted anew with the change, and the cheapest taken.
    """
    device = DEVICE
    e = recording(12.0, 5, {"damper": at_time(12.0, 3.0, 5.0)})
    first, rest = e.split()
    bare = Model(device)
    rubs = bare.with_effect(make_physics("coulomb_friction", "m1", level=0.02), {"level": 0.02})
    named = settled(judged([first], rubs, np.zeros(len(rubs.parameters))))
    plain = settled(judged([first], bare, np.zeros(len(bare.parameters))))
    search = Search(plain, plain, QUICK, silent)
    for h in (plain, named):
        search.keep(h)
    suspect = suspected(plain)
    assert suspect is not None  # something seems to change
    assert varied(plain, suspect) is not None
    taken = Taken(device, (e,), (first,), (rest,), (), 1.0, False, ())
    found, _, changes = changing(device, as_found(device, search), taken, silent)
    assert changes == ()
    assert found.tried.best is plain


@pytest.mark.parametrize(
    ("shape", "lower", "none"), [(STEP, -5e-3, True), (STEP, 1e-4, False), (EACH, -5e-3, False)]
)
def test_a_change_that_may_be_none_is_none(shape: str, lower: float, none: bool):
    """Several values of their own are no difference of two. Mutation: of these too, or of none."""
    h, _ = step()
    suspect = suspected(h)
    assert suspect is not None
    new = varied(h, suspect)
    assert new is not None
    change = change_of(new, h.experiments)
    assert not change.may_be_none
    wide = replace(change.by, value=1e-3, lower=lower, upper=1e-2)
    assert replace(change, shape=shape, by=wide).may_be_none is none


def test_a_change_goes_with_the_name_that_it_is_of():
    """Mutation that breaks it: changes kept whatever the answer lost."""
    h, _ = step()
    suspect = suspected(h)
    assert suspect is not None
    new = varied(h, suspect)
    assert new is not None
    change = change_of(new, h.experiments, (1.0, 0.5))
    later = change_of(new, h.experiments, None)

    model, x = h.model.less(h.x, 0)
    bare = settled(judged(h.experiments, model, x))

    def left(h: Hypothesis) -> tuple[Change, ...]:
        return outlived((change, later), as_found(DEVICE, Search(bare, h, QUICK, silent)))

    assert left(new.hypothesis) == (change, later)
    assert left(h) == (later,)  # the same everywhere, but for what comes after
    assert left(bare) == ()


def test_one_run_is_unlike_the_others():
    """Mutation that breaks it: runs not asked for; then it is two steps."""
    runs = [recording(4.0, 30 + i, {"friction": np.full(1000, 1.1 if i == 1 else 1.0)}, f"r{i}")
            for i in range(4)]  # fmt: skip
    h = fitted(*runs)
    suspect = suspected(h)
    assert suspect is not None
    assert (suspect.of, suspect.shape) == ("coulomb_friction@m1.level", RUN)
    parts = cut(h.experiments, suspect, ("change 1",))
    assert [bool(e.shares) for e in parts] == [False, True, False, False]
    assert len(parts) == 4  # nothing is cut


def test_every_recording_has_its_own():
    """Their squares over the stated deviations are a chi-square of five, below its 99.9 %.

    Mutation that breaks it: shares of the recordings that overlap.
    """
    levels = (1.2, 0.9, 1.3, 1.0, 0.8)
    runs = [recording(4.0, 60 + i, {"friction": np.full(1000, level)}, f"r{i}")
            for i, level in enumerate(levels)]  # fmt: skip
    h = fitted(*runs)
    suspect = suspected(h)
    assert suspect is not None
    assert (suspect.of, suspect.shape) == ("coulomb_friction@m1.level", EACH)
    new = varied(h, suspect)
    assert new is not None
    own = new.hypothesis
    found = [own.model.effects_at(own.model.there(own.x, e))[0].values["level"]
             for e in own.experiments]  # fmt: skip
    assert found == pytest.approx([0.02 * level for level in levels], rel=0.01)
    change = change_of(new, runs)
    assert [name for name, _ in change.each] == ["r0", "r1", "r2", "r3", "r4"]
    off = [(e.value - 0.02 * level) / ((e.upper - e.lower) / (2.0 * 1.96))
           for (_, e), level in zip(change.each, levels, strict=True)]  # fmt: skip
    assert np.sum(np.square(off)) < chi2.isf(1e-3, 5)
    assert "differs from recording to recording" in change.sentence
    assert set(change.as_json()["recordings"]) == {"r0", "r1", "r2", "r3", "r4"}


@pytest.mark.parametrize(
    ("levels", "shape", "when"),
    [
        ((1.1, 1.0), STEP, "from r1 on"),
        ((1.0, 1.0, 0.9, 0.9), STEP, "from r2 on"),
        ((1.0, 1.1, 1.0, 1.0), RUN, "in r1"),
        ((1.2, 0.9, 1.3, 1.0, 0.8), EACH, "from recording to recording"),
    ],
)
def test_the_rest_of_a_recording_is_judged_by_what_it_was_then(
    levels: tuple[float, ...], shape: str, when: str
):
    """Mutations: all are judged as the last one was; the observer begins as at last; a step that
    is dated a little before an end is from the recording on that ends there.
    """
    runs = [recording(6.0, 70 + i, {"friction": np.full(1500, level)}, f"r{i}")
            for i, level in enumerate(levels)]  # fmt: skip
    parts = [e.split() for e in runs]
    h = fitted(*(first for first, _ in parts))
    suspect = suspected(h)
    assert suspect is not None
    assert suspect.shape == shape
    if shape == STEP:  # blocks do not end where recordings do
        suspect = replace(suspect, at=suspect.at - 20.0)
    new = varied(h, suspect)
    assert new is not None
    own = new.hypothesis
    for (first, rest), level in zip(parts, levels, strict=True):
        (judge,) = _as_it_goes_on(rest, own.experiments, new)
        assert judge.before is not None
        for e in (judge, judge.before):
            there = own.model.effects_at(own.model.there(own.x, e))[0].values["level"]
            assert there == pytest.approx(0.02 * level, rel=0.02)
        (apart,) = _as_it_goes_on(first, own.experiments, new)
        assert apart is first  # has nothing before it: as the device was at last
    assert when in change_of(new, [first for first, _ in parts]).sentence


def test_a_parameter_follows_what_was_recorded_beside():
    """Mutation that breaks it: the quantity taken at the middle of all that was recorded."""
    t = np.arange(4000) / 4000
    temperature = 20.0 + 15.0 * np.sin(7.0 * t)  # up and down again, which no drift does
    e = recording(16.0, 8, {"friction": 1.0 - 0.01 * (temperature - 20.0)})
    e = replace(e, covariates=(Covariate("temp", "degC", temperature),))
    h = fitted(e)
    suspect = suspected(h)
    assert suspect is not None
    assert (suspect.of, suspect.shape) == ("coulomb_friction@m1.level", FOLLOWS)
    assert suspect.as_well == ()
    new = varied(h, suspect)
    assert new is not None
    change = change_of(new, [e])
    assert change.covariate_ends == pytest.approx((temperature.min(), temperature.max()))
    assert change.before.value == pytest.approx(0.02 * 1.15, rel=0.01)
    assert change.after.value == pytest.approx(0.02 * 0.85, rel=0.01)
    assert change.by.lower < -0.006 < change.by.upper
    assert "depends on temp: it fell from" in change.sentence
    assert "degC" in change.sentence
    assert change.as_json()["follows"] == "temp"


def test_from_one_recording_to_the_next_it_is_not_known_when():
    runs = [recording(4.0, 40 + i, {"friction": np.full(1000, 1.0 + 0.1 * i)}, f"r{i}")
            for i in range(2)]  # fmt: skip
    h = fitted(*runs)
    suspect = suspected(h)
    assert suspect is not None
    new = varied(h, suspect)
    assert new is not None
    assert [e.ticks for e in new.hypothesis.experiments] == [1000, 1000]
    assert [bool(e.shares) for e in new.hypothesis.experiments] == [True, False]


@cache
def answer(tau: float) -> tuple[Verdict, tuple[Change, ...], str, float]:
    e = recording(14.0, 9, {"friction": at_time(14.0, 1.2, tau)})
    found = diagnose(DEVICE, [e], effort=QUICK)
    return found.verdict, found.changes, found.headline, found.free_run.after


@pytest.mark.truth
@pytest.mark.parametrize("tau", [4.0, 12.0])
def test_a_diagnosis_says_when(tau: float):
    """4 s is fitted, 12 s is held out. Mutation that breaks it: the whole recording not asked; what
    comes after a change still judging what was before it; a force until the last sample an event.
    """
    verdict, changes, headline, after = answer(tau)
    assert verdict is Verdict.IDENTIFIED
    (change,) = changes
    assert (change.effect, change.parameter, change.place) == ("coulomb_friction", "level", "m1")
    assert change.at == pytest.approx(tau, abs=0.05)
    assert change.before.lower < 0.02 < change.before.upper
    assert change.after.lower < 0.024 < change.after.upper
    assert change.by.lower < 0.004 < change.by.upper
    assert change.by.value == pytest.approx(change.after.value - change.before.value)
    assert "level of Coulomb friction at the motor rose from" in headline
    # Values that are hardly known, and a difference that is: then the difference is said.
    vague = replace(change, before=replace(change.before, lower=0.0, upper=1.0))
    assert "motor rose by" in vague.sentence
    assert (change.free_run is None) == (tau == 12.0)
    assert after < 0.01
    said = change.as_json()
    assert said["at_s_ci95"][0] <= tau <= said["at_s_ci95"][1]
    assert said["shape"] == "step"
    figure = changes_figure(change)
    assert figure.axes[0].get_ylabel() == "level [mN m]"


def test_members_of_a_model_that_varies_are_those_built_one_by_one():
    """Mutation that breaks it: lanes that do not see the shares of a recording."""
    _, h = step()
    problem, model = h.problem, h.model
    xs = [h.x, h.x + 0.01]
    lanes = problem.weighted_each(model, xs)
    for x, own in zip(xs, lanes, strict=True):
        assert own == pytest.approx(problem.weighted(model, x), abs=1e-6)


def test_shares_of_a_parameter_that_a_model_lacks_change_nothing():
    model = Model(DEVICE, varying=(Varying("change 1", "coulomb_friction@m1.level"),))
    e = replace(recording(4.0, 1, {}), shares=(("change 1", 1.0),))
    x = np.zeros(len(model.parameters))
    assert model.parameters == Model(DEVICE).parameters
    assert model.there(x, e) is x
    friction = make_physics("coulomb_friction", "m1", level=0.02)
    more = model.with_effect(friction, {"level": 0.02})
    # An effect that is tried again is constant, and x has no place for its earlier change.
    assert [p.kind for p in more.parameters][-1] == "effect"
    more = replace(more, varying=model.varying)
    less, kept = more.less(np.arange(6.0), 0)
    assert [p.kind for p in more.parameters][-2:] == ["effect", "change"]
    assert kept.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert less.parameters == model.parameters


def test_a_difference_makes_one_device_of_another_beside_what_was_known():
    friction = make_physics("coulomb_friction", "m1", level=0.02)
    before = DEVICE.with_physics(friction)
    after = replace(before, chain=make_chain([1.1e-3], [2e-3], 0.0)).with_physics(
        make_physics("coulomb_friction", "m1", level=0.03)
    )
    known = changes_of({"masses": [1.5e-3]}, before)
    both = beside(known, difference(before, after)).of(before)
    assert both.chain.masses[0] == pytest.approx(1.6e-3)
    assert both.physics[0].values["level"] == pytest.approx(0.03)
    same = beside(None, difference(before, after)).of(before)
    e = recording(2.0, 1, {})
    gain = np.full((2, 1), 0.1)
    assert innovations(same, e, gain) == pytest.approx(innovations(after, e, gain), abs=1e-12)


def test_shares_over_time():
    h = fitted(recording(4.0, 30, {}))
    suspect = suspected(fitted(recording(8.0, 5, {"friction": at_time(8.0, 1.2, 4.0)})))
    assert suspect is not None
    assert h.experiments[0].shares == ()
    drift = replace(suspect, shape=DRIFT)
    assert [share_at(drift, t, 1000.0) for t in (0.0, 500.0, 1500.0)] == [1.0, 0.5, -0.5]
