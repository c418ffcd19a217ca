"""Uneven stamps: told from the motion, and brought onto even ticks."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from zwidth.diagnosis.recording.experiment import stretches
from zwidth.logs.uneven import evened, scatter
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
PERIOD = 0.01
MASS, DAMPER, SPRING = 0.5, 0.8, 60.0
COUNTS = 2e-5  # noise of a reading [m]


def driven(intervals: Floats, seed: int) -> tuple[Floats, Floats, Floats]:
    """Instants, positions and the force held after each, of a mass on a spring: each interval
    by its own exact propagator."""
    random = np.random.default_rng(seed)
    a = np.array([[0.0, 1.0, 0.0], [-SPRING / MASS, -DAMPER / MASS, 1.0 / MASS], [0.0, 0.0, 0.0]])
    t = np.concatenate([[0.0], np.cumsum(intervals)])
    force = np.repeat(random.normal(0.0, 3.0, t.size // 7 + 1), 7)[: t.size]
    x, position = np.zeros(2), []
    for k in range(t.size):
        position.append(x[0])
        if k < intervals.size:
            x = (expm(a * intervals[k]) @ np.append(x, force[k]))[:2]
    return t, np.array(position) + COUNTS * random.standard_normal(t.size), force


def trace(t: Floats, position: Floats, force: Floats) -> Trace:
    return Trace(t, {"command": force, "position_m1": position},
                 {"command": "N", "position_m1": "m"}, "recorded")  # fmt: skip


def late_loop(size: int, seed: int) -> Floats:
    """Intervals of a loop that is late now and then, as a host's are."""
    return PERIOD * (1.0 + 0.15 * np.random.default_rng(seed).gamma(1.0, 1.0, size) - 0.15)


def test_samples_of_a_late_loop_are_told_from_stamps_that_a_logger_wrote_late() -> None:
    """Mutation that breaks it: the slope left out of what a stamp would show."""
    t, position, force = driven(late_loop(1500, 1), 2)
    real = scatter(trace(t, position, force), ["position_m1"])
    assert real is not None
    assert real.real
    assert real.share == pytest.approx(1.0, abs=max(0.05, 4.0 * real.error))
    even_t, position, force = driven(np.full(1500, PERIOD), 2)
    written = even_t + PERIOD * 0.15 * np.random.default_rng(3).gamma(1.0, 1.0, even_t.size)
    logged = scatter(trace(written, position, force), ["position_m1"])
    assert logged is not None
    assert not logged.real
    assert logged.share == pytest.approx(0.0, abs=max(0.05, 4.0 * logged.error))
    kept, said = evened(trace(written, position, force), PERIOD, ["position_m1"], "log")
    assert kept.t is written
    assert "does not show it: samples are taken as even" in said


def test_even_stamps_are_left_alone() -> None:
    t, position, force = driven(np.full(400, PERIOD), 4)
    whole = trace(t, position, force)
    assert scatter(whole, ["position_m1"]) is None
    kept, said = evened(whole, PERIOD, ["position_m1"], "even")
    assert kept is whole
    assert said == ""


def test_a_late_loop_is_brought_onto_even_ticks_to_the_encoder() -> None:
    """Beside the motion at even ticks, of the same force held as long: the spline's error alone.

    Mutations that break it: linear interpolation; the command's last value for its mean.
    """
    t, position, force = driven(late_loop(1500, 5), 6)
    brought, said = evened(trace(t, position, force), PERIOD, ["position_m1"], "host")
    assert "even ticks of 0.01 s" in said
    assert np.diff(brought.t) == pytest.approx(PERIOD)
    truth = _at(brought.t, t, force)
    rough = float(np.sqrt(np.mean((brought["position_m1"] - truth) ** 2)))
    assert rough < 4.0 * COUNTS
    taken_as_even = position[: truth.size] - truth
    assert rough < 0.02 * float(np.sqrt(np.mean(taken_as_even**2)))
    impulse = float(np.sum(force[:-1] * np.diff(t)))
    until = brought.t < t[-1] - PERIOD
    assert PERIOD * float(np.sum(brought["command"][until])) == pytest.approx(impulse, abs=0.1)


def test_what_the_spline_errs_by_is_known_and_said() -> None:
    """Of a sine of 12 samples a period at a late loop's stamps, without noise: to a factor of 2.5.

    Mutation: the error of every other sample not divided by 16.
    """
    t = np.cumsum(late_loop(1500, 5))
    w = 2.0 * np.pi / (12.0 * PERIOD)
    brought, said = evened(trace(t, np.sin(w * t), np.cos(w * t)), PERIOD, ["position_m1"], "host")
    rms = float(np.sqrt(np.mean((brought["position_m1"] - np.sin(w * brought.t))[5:-5] ** 2)))
    told = float(said.split("errs in position_m1 by ")[1].split(" ")[0])
    assert rms / 2.5 < told < 2.5 * rms


def _at(at: Floats, t: Floats, force: Floats) -> Floats:
    """The motion at instants, without noise."""
    a = np.array([[0.0, 1.0, 0.0], [-SPRING / MASS, -DAMPER / MASS, 1.0 / MASS], [0.0, 0.0, 0.0]])
    states = [np.zeros(2)]
    for k in range(t.size - 1):
        states.append((expm(a * (t[k + 1] - t[k])) @ np.append(states[-1], force[k]))[:2])
    which = np.searchsorted(t, at + 1e-12, "right") - 1
    return np.array([
        (expm(a * (s - t[k])) @ np.append(states[k], force[k]))[0]
        for s, k in zip(at, which, strict=True)
    ])  # fmt: skip


def test_a_recording_of_a_late_loop_is_an_experiment_on_even_ticks_that_says_so() -> None:
    device = Device(
        "mass", "", False, make_chain([MASS], [DAMPER], SPRING), Interface(period=PERIOD)
    )
    t, position, force = driven(late_loop(1500, 7), 8)
    (e,) = stretches(trace(t, position, force), device, "host")
    assert e.period == pytest.approx(PERIOD)
    assert any("even ticks" in note for note in e.notes)
    assert math.isclose(e.ticks, (t[-1] - t[0]) / PERIOD, abs_tol=2.0)


def test_a_gap_of_a_late_loop_stays_a_gap() -> None:
    """Mutation that breaks it: a spline across whatever lacks."""
    device = Device(
        "mass", "", False, make_chain([MASS], [DAMPER], SPRING), Interface(period=PERIOD)
    )
    t, position, force = driven(late_loop(1500, 9), 10)
    keep = np.r_[0:700, 730 : t.size]
    parts = stretches(trace(t[keep], position[keep], force[keep]), device, "host")
    assert len(parts) == 2
    assert parts[0].ticks == pytest.approx((t[699] - t[0]) / PERIOD, abs=2.0)
