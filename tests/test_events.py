"""What happens once is found, dated, named and weighed; where nothing happens nothing is said.

The recordings are of an integrator of its own: a mass under Coulomb friction, fifty times a sample.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

import zwidth.diagnosis.answer.knowing_events as answers
from benchmarks.events import HIT, JAM, KINDS, NOTHING, SLIP, STOP, TOUCH, T, moved
from zwidth.diagnosis.answer.events import Event, _opposes, events_in
from zwidth.diagnosis.answer.knowing_events import _peak
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.learning.event_edges import Polylines
from zwidth.diagnosis.learning.event_force import Happened, Source
from zwidth.diagnosis.learning.events import Peak, _chance, happenings, with_events
from zwidth.diagnosis.mishaps import silent
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import free_run_errors, innovations
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.selection.searched import as_found
from zwidth.figures.events import events_figure
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics

Floats = NDArray[np.float64]
NUMBERS = np.array([1e-3, 2e-3, 0.02, 0.0])  # mass, damper, friction, spring
DEVICE = Device("mass", "", True, make_chain([1.1e-3], [2e-3], 0.0), Interface(period=T))
SECONDS = 12.0
# Begins [s], lasts [s], and its numbers, as `benchmarks.events.moved` takes them.
EVENTS = {
    NOTHING: np.zeros(5),
    HIT: np.array([5.002, 0.006, 0.4, 0.0, 0.0]),
    JAM: np.array([7.3, 0.3, 1.0, 0.0, 0.0]),
    TOUCH: np.array([4.0, 0.8, 0.05, 0.01, 0.5]),
    SLIP: np.zeros(5),
}


@cache
def recording(kind: int, seed: int = 5) -> tuple[Experiment, Floats]:
    random = np.random.default_rng(seed)
    ticks = round(SECONDS / T)
    t = T * np.arange(ticks)
    waves = zip(random.uniform(0.4, 4.0, 3), random.uniform(0.0, 6.0, 3), strict=True)
    command = np.sum([0.06 * np.sin(2.0 * np.pi * f * t + p) for f, p in waves], axis=0)
    if kind == STOP:  # where the motion is farthest
        far = moved(command, NUMBERS, NOTHING, np.zeros(5))[0]
        place = far[np.argmax(np.abs(far))] - 0.05 * np.sign(far[np.argmax(np.abs(far))])
        event = np.array([0.0, 0.0, place, 1e-3 * 300.0**2, 1e-3 * 100.0])
    else:
        event = EVENTS[kind]
    motion, told = moved(command, NUMBERS, kind, event)
    y = motion + 0.1 * (t >= 6.002) * (kind == SLIP)
    y = y + 5e-4 * random.standard_normal(ticks)
    e = Experiment(T, command, y[:, None], (Output("position", 0),), "swing", float(y.std()))
    return e, told


@cache
def fitted(kind: int, seed: int = 5) -> Hypothesis:
    """Friction, fitted as if nothing happened."""
    friction = make_physics("coulomb_friction", "m1", level=0.02)
    model = Model(DEVICE).with_effect(friction, {"level": 0.02})
    return settled(judged([recording(kind, seed)[0]], model, np.zeros(len(model.parameters))))


def happenings_in(e: Experiment, h: Hypothesis) -> tuple[Happened, ...]:
    return happenings([e], h, lambda known: with_events([e], known))


@cache
def happened(kind: int, seed: int = 5) -> tuple[Happened, ...]:
    return happenings_in(recording(kind, seed)[0], fitted(kind, seed))


@pytest.mark.parametrize("kind", [HIT, STOP, JAM, TOUCH, SLIP], ids=lambda k: KINDS[k])
def test_what_happens_is_found_where_it_is(kind: int):
    """Mutations that break it: the sign of the response turned round; durations that end a tick
    late; the force fitted to the device without its friction (the jam).
    """
    (one,) = happened(kind)
    _, (impulse, _, begins, ends) = recording(kind)
    if kind == SLIP:
        assert one.source == Source("position_m1", sensor=0, lasting=True)
        assert one.between[0] * T <= 6.002 <= one.between[1] * T
        assert one.force[0] == pytest.approx(0.1, rel=0.05)
        return
    assert one.source == Source("m1")
    assert one.first * T - 0.1 < begins < one.last * T
    assert begins < one.last * T < ends + 0.15
    if kind != JAM:  # what holds at rest beside friction is not known
        error = T * float(np.sqrt(one.covariance.sum()))
        assert abs(T * one.force.sum() - impulse) < 4.0 * error + 0.05 * abs(impulse)


@pytest.mark.parametrize("seed", range(20, 28))
def test_nothing_is_said_where_nothing_happens(seed: int):
    """Mutations that break it: chance by one stretch alone; z not in its own median."""
    assert happened(NOTHING, seed) == ()


@pytest.mark.parametrize("excluded", [0, 4])
def test_peaks_that_may_be_events_leave_chance_as_it_is(excluded: int):
    """The mean excess of chance, over 400 draws. Mutation: the excluded ones not counted."""
    random = np.random.default_rng(3)
    drawn = np.sort(9.0 + random.exponential(3.0, (400, 60)))[:, : 60 - excluded]
    found = [_chance(one, excluded).excess for one in drawn]
    assert 3.0 < np.median(found) < 4.0  # the highest of three estimates is above the mean


def test_what_often_happens_is_no_event():
    """Nine hits are physics that is missing, and raise what chance does for each of them.

    Mutation that breaks it: m always that of Gaussian noise.
    """
    force = np.zeros((3000, 1))
    force[400:2900:300] = 0.1
    friction = make_physics("coulomb_friction", "m1", level=0.02)
    h = fitted(NOTHING)
    device = h.model.build(h.x)
    assert device.physics[0].effect is friction.effect
    hit = simulated(device, (Output("position", 0),), force)
    assert happenings_in(hit, h) == ()
    force[600:] = 0.0
    (one,) = happenings_in(simulated(device, (Output("position", 0),), force), h)
    assert one.first <= 400 < one.last


def simulated(device: Device, outputs: tuple[Output, ...], force: Floats) -> Experiment:
    """What a device gives under a force, by a predictor that corrects nothing."""
    e, _ = recording(NOTHING)
    still = replace(e, outputs=outputs, measured=np.zeros((e.ticks, len(outputs))), force=force)
    y = -innovations(device, still, np.zeros((2 * device.chain.masses.size, len(outputs))))
    y += 2e-4 * np.random.default_rng(3).standard_normal(y.shape)
    return replace(still, measured=y, force=None, swing=float(y[:, 0].std()))


@pytest.mark.parametrize("place", ["m1", "m2", "link12", "slip"])
def test_where_it_acts_is_told(place: str):
    """Of two masses, both measured. Mutation that breaks it: the row of a link of one sign."""
    device = Device("two", "", True, make_chain([1e-3, 8e-4], [2e-3, 1e-3], 0.0, [1.5], [1e-3]),
                    Interface(period=T))  # fmt: skip
    force = np.zeros((3000, 2))
    at = slice(1500, 3000 if place == "slip" else 1506)
    row = {"m1": (1.0, 0.0), "m2": (0.0, 1.0)}.get(place, (1.0, -1.0))
    force[at] = 0.15 * np.array(row)
    e = simulated(device, (Output("position", 0), Output("position", 1)), force)
    model = Model(device)
    h = settled(judged([e], model, np.zeros(len(model.parameters))))
    (one,) = happenings_in(e, h)
    assert one.source == Source("link12" if place == "slip" else place, lasting=place == "slip")
    assert one.first <= 1500 < one.last or one.between[0] <= 1500 <= one.between[1]
    if place == "slip":
        assert one.force[0] == pytest.approx(0.15, rel=0.1)
    else:
        assert one.force.sum() == pytest.approx(0.9, rel=0.1)
    assert one.elsewhere == ()


def test_a_recording_that_knows_of_an_event_is_as_if_it_had_not_been():
    """Mutation that breaks it: the force left out of free runs."""
    e, _ = recording(HIT)
    h = fitted(NOTHING)
    (knowing,) = with_events([e], happened(HIT))
    device, gain = h.model.acting(h.x), h.noise.observer.gain
    errors = {}
    for name, one in (("as it is", e), ("knowing", knowing), ("clean", recording(NOTHING)[0])):
        errors[name] = float(np.sqrt(np.mean(free_run_errors(device, one, gain, 125)[0] ** 2)))
    assert errors["knowing"] < 1.3 * errors["clean"]
    assert errors["as it is"] > 2.0 * errors["knowing"]


def test_forces_of_two_events_add_up():
    one = Happened(0, Source("m1"), 10, 12, np.array([1.0, 2.0]), np.eye(2), 50.0, (10, 12))
    lasting = replace(one, source=Source("m1", lasting=True), first=11, last=12,
                      force=np.array([4.0]), covariance=np.eye(1))  # fmt: skip
    e, _ = recording(NOTHING)
    (both,) = with_events([e], (one, lasting))
    assert both.force is not None
    assert both.force[9:14, 0].tolist() == [0.0, 1.0, 6.0, 4.0, 4.0]
    assert both.part(11, 13).force is not None


def said(kind: int) -> Event:
    (event,) = events_in(
        [recording(kind)[0]], fitted(kind), lambda known: with_events([recording(kind)[0]], known)
    )
    return event


@pytest.mark.truth
@pytest.mark.parametrize("kind", [HIT, STOP, JAM, TOUCH, SLIP], ids=lambda k: KINDS[k])
def test_what_happened_is_named_and_weighed(kind: int):
    """Mutations that break it: kinds told by duration alone; energy as force times speed before."""
    event, (_, (impulse, energy, begins, ends)) = said(kind), recording(kind)
    assert event.kind == KINDS[kind]
    assert event.as_json()["kind"] == KINDS[kind]
    figure = events_figure(event)
    assert figure.axes[1].get_xlabel() == "time in swing [s]"
    if kind == SLIP:
        assert event.slip is not None
        assert event.slip.lower < 0.1 < event.slip.upper
        assert event.sentence.startswith("a slip of the sensor position_m1 by")
        return
    assert event.energy is not None
    assert event.impulse is not None
    if kind == STOP:
        assert "on a stop at" in event.sentence
    if event.until is None:
        assert event.at == pytest.approx(0.5 * (begins + ends), abs=T)
        assert event.impulse.value == pytest.approx(impulse, rel=0.05)
    else:
        assert event.at == pytest.approx(begins, abs=0.05)
        assert event.until == pytest.approx(ends, abs=0.05)
    if kind != JAM:
        assert event.energy.value == pytest.approx(energy, rel=0.05)


@pytest.mark.truth
@pytest.mark.parametrize("kind", [JAM, TOUCH], ids=lambda k: KINDS[k])
def test_when_it_began_and_ended_is_within_what_is_said(kind: int):
    """Mutation that breaks it: at most three knots (the hand, whose beginning is then late)."""
    event, (_, (_, _, begins, ends)) = said(kind), recording(kind)
    assert event.until_between is not None
    for (low, high), true in ((event.between, begins), (event.until_between, ends)):
        assert low <= true <= high
        assert high - low < 0.15


@pytest.mark.truth
@pytest.mark.parametrize("rises", [0, 20], ids=["at once", "from nothing"])
def test_intervals_of_when_a_force_begins_hold_it(rises: int):
    """Of a force that is read itself, under white noise, 19 of 20 times; and they are short.

    Mutations that break it: `DATED` of 0.5; `MOST` of no knot (from nothing); knots that cost
    nothing (too long).
    """
    held, long = list[bool](), list[float]()
    ticks, begins, ends = 90, 30, 70
    at = np.arange(ticks) + 0.5
    shape = np.minimum((at - begins) / rises, 1.0) if rises else np.ones(ticks)
    force = np.where((at > begins) & (at < ends), shape, 0.0)
    for seed in range(20):
        y = force + 0.1 * np.random.default_rng([seed, rises]).standard_normal(ticks)
        squares = 100.0 * np.eye(ticks)
        lines = Polylines(squares, squares @ y, float(y @ squares @ y), ticks, 1.0)
        (low, _, high), (first, _, last) = lines.edges(40, 60)
        held.append(low <= begins <= high and first <= ends <= last)
        long.append(high - low)
    assert sum(held) >= 18
    assert np.median(long) < (25.0 if rises else 4.5)


def test_a_force_that_sets_in_at_once_does_not_overshoot():
    """And in bins of several ticks its edges are those of the ticks, to a bin.

    Hats at fixed places said 108 mN m of a hand of 80. Mutations that break it: centres of bins a
    bin late; knots in bins instead of ticks.
    """
    ticks, begins, ends = 120, 30, 93
    force = np.zeros(ticks)
    force[begins:ends] = 1.0
    y = force + 0.02 * np.random.default_rng(7).standard_normal(ticks)
    for at in (np.arange(ticks + 1.0), np.append(np.arange(0.0, ticks, 3.0), ticks)):
        unit = (np.digitize(np.arange(ticks), at)[None] == np.arange(1, at.size)[:, None]) / 0.02
        rest = float(y @ y) / 0.02**2
        lines = Polylines(unit @ unit.T, unit @ y / 0.02, rest, ticks, 1.0, at)
        (low, first, high), (_, last, _) = lines.edges(10, 20)
        assert low <= begins <= high
        assert (first, last) == (begins, ends)
        np.testing.assert_allclose(lines.best().values, 1.0, atol=0.03)


def test_of_a_force_that_does_not_show_no_time_is_said():
    """What sticks moves nothing. Mutation that breaks it: values solved for as if all were told."""
    lines = Polylines(np.zeros((30, 30)), np.zeros(30), 40.0, 40, 1.0)
    (low, _, _), (_, _, high) = lines.edges(10, 20)
    assert low <= 0.0
    assert high >= 30.0


def test_a_diagnosis_says_what_happened_and_bends_no_parameter():
    """Mutation that breaks it: no search after an event is known."""
    e, _ = recording(HIT)
    brief = replace(QUICK, effects=1, near=2, far=1, rivals=1)
    found = diagnose(DEVICE, [e], effort=brief)
    (event,) = found.events
    assert event.kind == KINDS[HIT]
    assert event.short in found.headline
    assert event.sentence.startswith(event.short)
    (friction,) = found.findings
    assert friction.parameters["level"].value == pytest.approx(0.02, rel=0.03)


def test_what_either_answer_names_does_not_happen(monkeypatch: pytest.MonkeyPatch):
    """Of an answer chosen for its free runs, what the next sample's names leave is asked as well.

    Three "hits on a stop" of a real drive were how its friction sets in. Mutation: `near` unasked.
    """
    sees, blind = fitted(HIT), fitted(NOTHING)
    peak = Peak(0, Source("m1"), 2500, 3, 300.0)
    monkeypatch.setattr(answers, "highest", lambda _, h: peak if h is sees else None)
    found = as_found(DEVICE, Search(sees, sees, QUICK, silent))
    for near, happens in ((None, True), (sees, True), (blind, False)):
        assert bool(_peak(sees.experiments, replace(found, near=near))) is happens


def test_a_force_that_pushes_both_ways_is_no_contact():
    """A contact pushes one way. Mutations that break it: one span alone is asked; no covariance."""
    own = np.diag(np.full(6, 0.01))
    assert not _opposes(np.array([0.0, 1.0, 3.0, 2.0, 0.0, 0.0]), own)
    assert not _opposes(np.array([0.0, 3.0, 4.0, -1.5, 0.0, 0.0]), own)  # a fit's last tick
    assert _opposes(np.array([0.0, 3.0, 1.0, -2.0, -1.5, 0.0]), own)
    assert _opposes(np.array([-3.0, 0.0, 0.0, 0.0, 0.0, 2.0]), own)
    assert not _opposes(np.array([0.0, 3.0, 1.0, -2.0, -1.5, 0.0]), 100.0 * own)
    # Two ticks that are determined together only: 3 in one of them is 3 in the other, less.
    pair = np.array([[4.0, -3.99], [-3.99, 4.0]])
    assert not _opposes(np.array([5.0, -4.0]), pair)
