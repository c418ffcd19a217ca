"""Short gaps are bridged: the observer goes on uncorrected, and what was not measured counts for
nothing."""

from dataclasses import replace

import numpy as np
import pytest
from fitting_examples import drive, recording
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.fitting.landscape import Landscape
from zwidth.diagnosis.noise.predictor import (
    SEARCHING,
    SETTLING,
    innovations,
    prepared,
    told,
)
from zwidth.diagnosis.noise.settle import refit
from zwidth.diagnosis.recording.experiment import Experiment, stretches, uncounted
from zwidth.logs.stretches import LONGEST_BRIDGED, longest_stretch
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
MASS = Device("mass", "", True, make_chain([0.5], [0.0]), Interface(period=0.001))
SAMPLES = 2000


def with_gaps(e: Experiment, length: int, every: int) -> Experiment:
    """Return a recording of which so many samples are lost now and then."""
    lost = np.zeros(e.ticks, dtype=np.bool_)
    for k in range(SETTLING + 50, e.ticks - 20, every):
        lost[k : k + length] = True
    measured = e.measured.copy()
    known = np.flatnonzero(~lost)
    measured[lost, 0] = np.interp(np.flatnonzero(lost), known, e.measured[known, 0])
    return replace(e, measured=measured, bridged=lost, uncounted=uncounted(lost))


def trace_of(u: Floats, position: Floats, t: Floats | None = None) -> Trace:
    stamps = 0.001 * np.arange(u.size, dtype=np.float64) if t is None else t
    units = {"command": "N m", "position_m1": "rad"}
    return Trace(stamps, {"command": u, "position_m1": position}, units, "recorded")


def motion() -> tuple[Floats, Floats]:
    t = 0.001 * np.arange(SAMPLES)
    return 0.2 * np.sin(40.0 * t), 0.01 * np.cos(40.0 * t) + 0.002 * np.sin(25.0 * t)


def test_samples_that_were_lost_are_not_counted_and_what_they_are_filled_with_is_not_read() -> None:
    """Of one of ten samples gone, the deviation is that of the others, and so is their number.

    Mutations: `told` taken as 1 (the deviation is smaller by 1 - sqrt(told)); the observer
    corrected by what a gap is filled with (`readings`).
    """
    e = recording(drive(), 4000, 3)
    whole, _ = refit(drive(), [e])
    holes = with_gaps(e, 2, 20)
    share = told([holes])
    assert share == np.mean(holes.known[SETTLING:])
    assert 0.75 < share < 0.85
    problem, fitted = refit(drive(), [holes])
    assert problem.observer.told == share
    assert problem.observer.deviation[0] == pytest.approx(whole.observer.deviation[0], rel=0.03)
    counted = fitted.white.reshape(-1, 1)[holes.known[SETTLING:]]
    assert np.count_nonzero(fitted.white) == counted.size
    moment = float(counted.ravel() @ counted.ravel())
    n, (s,) = counted.shape[0], np.linalg.slogdet(problem.observer.filters()[:, :, 0])[1:]
    assert problem.observer.cost(fitted.white) == pytest.approx(
        n * (-2.0 * s + np.log(moment / n)), rel=1e-12
    )
    spoiled = holes.measured.copy()
    spoiled[holes.bridged] = 1e3
    again = replace(problem.experiments[0], measured=spoiled)
    gain, device = problem.observer.gain, fitted.model.acting(fitted.x)
    ready = prepared(device, SEARCHING)
    one, other = (
        innovations(device, each, gain, ready=ready) for each in (problem.experiments[0], again)
    )
    np.testing.assert_array_equal(one, other)


def test_a_population_and_a_single_device_agree_on_what_counts() -> None:
    """The kernel's sums, its lanes and the residual of a fit are of the same samples.

    Mutations: rows that do not count kept in the kernel's sums; `uncounted` not given to it.
    """
    holes = with_gaps(recording(drive(), 1500, 3), 3, 60)
    problem, fitted = refit(drive(), [holes])
    ground = Landscape(problem.experiments, problem.observer, fitted.model)
    xs = [fitted.x, fitted.x + 0.01]
    single = Problem(problem.experiments, problem.observer, ground.problem.fineness)
    for cost, x in zip(ground.costs(xs), xs, strict=True):
        alone = single.residual(fitted.model, x)
        assert cost == pytest.approx(ground.cost(alone), rel=1e-9)
    for lanes, x in zip(single.weighted_each(fitted.model, xs), xs, strict=True):
        np.testing.assert_allclose(lanes, single.weighted(fitted.model, x), rtol=0, atol=1e-9)


def test_the_deviation_after_gaps_under_an_unknown_force_is_that_without_them() -> None:
    """Mutation: what follows a gap counted (the deviation is 10 % larger)."""
    random = np.random.default_rng(5)
    e = recording(drive(), 6000, 3, push=0.02 * random.standard_normal(6000))
    whole, _ = refit(drive(), [e])
    problem, _ = refit(drive(), [with_gaps(e, 10, 60)])
    assert problem.observer.deviation[0] == pytest.approx(whole.observer.deviation[0], rel=0.05)


def test_a_lost_reading_costs_itself_and_keeps_the_command_that_was_recorded() -> None:
    """Mutations: the command interpolated where its row is there; bridged ticks not told apart."""
    _, x = motion()
    u = np.sign(np.random.default_rng(1).standard_normal(SAMPLES))  # no line foretells it
    gone = [500, 501, 502, 900]
    x[gone] = np.nan
    (e,) = stretches(trace_of(u, x), MASS, "rig")
    assert e.ticks == SAMPLES
    np.testing.assert_array_equal(e.command, u)
    assert e.bridged is not None
    assert np.flatnonzero(e.bridged).tolist() == gone
    assert np.flatnonzero(~e.known).size == 2 * len(gone)
    np.testing.assert_allclose(e.measured[gone, 0], motion()[1][gone], atol=2e-5)
    assert any("2 gaps of at most 3 samples, 4 together, are bridged" in note for note in e.notes)


def test_a_command_that_nothing_tells_leaves_its_gap() -> None:
    """Mutation: any command interpolated."""
    u, x = motion()
    rows = np.r_[0:500, 503:SAMPLES]
    t = 0.001 * rows
    (smooth,) = stretches(trace_of(u[rows], x[rows], t), MASS, "rig")
    assert smooth.ticks == SAMPLES
    np.testing.assert_allclose(smooth.command, u, atol=1e-3)
    rough = np.sign(np.random.default_rng(1).standard_normal(SAMPLES))
    assert [e.ticks for e in stretches(trace_of(rough[rows], x[rows], t), MASS, "rig")] == [
        500, 1497,
    ]  # fmt: skip


def test_a_longer_gap_and_one_of_broken_samples_stay_gaps() -> None:
    """Mutations: no longest gap; a gap rounded to whole samples whatever it is."""
    u, x = motion()
    for lost, parts in ((LONGEST_BRIDGED, 1), (LONGEST_BRIDGED + 1, 2)):
        rows = np.r_[0:500, 500 + lost : SAMPLES]
        found = stretches(trace_of(u[rows], x[rows], 0.001 * rows), MASS, "rig")
        assert len(found) == parts
    rows = np.r_[0:500, 503:SAMPLES]
    t = 0.001 * rows + np.where(rows > 500, 0.0004, 0.0)
    assert len(stretches(trace_of(u[rows], x[rows], t), MASS, "rig")) == 2


def test_identify_uses_a_recording_with_short_gaps_whole() -> None:
    """What fills a position of an encoder is a step of it.

    Mutation: `longest_stretch` without bridges.
    """
    u, x = motion()
    x = 1e-4 * np.round(x / 1e-4)
    x[[300, 700, 701]] = np.nan
    used, note = longest_stretch(trace_of(u, x), ("command", "position_m1"), "rig")
    assert len(used) == SAMPLES
    filled = used["position_m1"][[300, 700, 701]] / 1e-4
    np.testing.assert_allclose(filled, np.round(filled), atol=1e-6)
    assert "2 gaps of at most 2 samples, 3 together, are bridged" in note
