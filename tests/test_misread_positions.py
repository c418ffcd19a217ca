"""Positions that wrap, and readings that are late or slow: told from motion, and put right."""

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from zwidth.diagnosis.recording.experiment import ExperimentError, stretches
from zwidth.logs.recording import read_recording
from zwidth.logs.source import RecordingError
from zwidth.logs.stale import renewed, repeated
from zwidth.logs.wrapped import unwrapped
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
T = 0.002
COUNTS = 2.0 * math.pi / 4096.0
DEVICE = Device("rotor", "", True, make_chain([0.01], [0.02]), Interface(period=T))


def motion(seed: int, size: int = 3000) -> Floats:
    """A rotor that turns a few times and back, to a step of an encoder."""
    t = T * np.arange(size)
    phase = np.random.default_rng(seed).uniform(0.0, 6.0, 3)
    q = 9.0 * np.sin(1.1 * t + phase[0]) + 2.0 * np.sin(7.0 * t + phase[1]) + 0.4 * np.sin(31.0 * t)
    return np.rint(q / COUNTS) * COUNTS


def trace(position: Floats, seed: int = 0) -> Trace:
    t = T * np.arange(position.size, dtype=np.float64)
    command = np.random.default_rng(seed).standard_normal(t.size)
    return Trace(t, {"command": command, "position_m1": position},
                 {"command": "N m", "position_m1": "rad"}, "recorded")  # fmt: skip


@pytest.mark.parametrize("least", [0.0, -math.pi])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_angle_that_wraps_goes_on(seed: int, least: float) -> None:
    """Mutation that breaks it: the size taken from the step without the motion's own."""
    q = motion(seed)
    folded = np.mod(q - least, 2.0 * math.pi) + least
    whole, said = unwrapped(trace(folded), ["position_m1"], "rotor")
    back = whole["position_m1"]
    np.testing.assert_allclose(back - back[0], q - q[0], atol=1e-9)
    assert "starts again every 6.28319 rad" in said


def test_a_counter_of_sixteen_bits_goes_on() -> None:
    q = np.rint(motion(4) / COUNTS * 40.0)
    folded = np.mod(q, 65536.0) * 1e-6
    whole, said = unwrapped(trace(folded), ["position_m1"], "counter")
    back = whole["position_m1"]
    np.testing.assert_allclose(back - back[0], (q - q[0]) * 1e-6, atol=1e-9)
    assert "every 0.065536 rad" in said


def test_a_counter_of_known_modulus_goes_on_where_nothing_else_tells(tmp_path: Path) -> None:
    """One that wraps once, near its end, with a gap: too little to tell it by, but `wraps_at` does.

    Mutation that breaks it: a step over the gap counted from the NaN, or the modulus after scale.
    """
    counts = 200.0 * np.arange(400.0) ** 0.9 + 32000.0
    counts[90] = np.nan
    raw = np.mod(counts, 65536.0)
    rows = np.column_stack([T * np.arange(400), np.sin(np.arange(400.0)), raw])
    np.savetxt(tmp_path / "c.csv", rows, "%.17g", ",", header="t,u,q", comments="")
    toml = tmp_path / "c.toml"
    text = (
        'file = "c.csv"\ntime = "t"\n[input]\nsignal = "u"\n[[output]]\nsignal = "q"\n'
        'quantity = "position"\nat = "m1"\nunit = "counts"\ncounts_per_rev = 4096\n'
    )
    toml.write_text(text + "wraps_at = 65536\n")
    found = read_recording(toml)
    known = np.isfinite(counts)
    wanted = (counts * COUNTS)[known]
    np.testing.assert_allclose(found["position_m1"][known], wanted, rtol=1e-12)
    said = str(found.facts["warnings"])
    assert "starts again after 65536 raw numbers, 1 times" in said
    toml.write_text(text)
    assert np.ptp(read_recording(toml)["position_m1"][known]) > 1.2 * np.ptp(wanted)
    toml.write_text(text.replace('"position"', '"velocity"') + "wraps_at = 65536\n")
    with pytest.raises(RecordingError, match=r"wraps_at is given for a velocity; only"):
        read_recording(toml)


def test_what_only_moves_or_reads_wrong_once_does_not_wrap() -> None:
    """Mutation that breaks it: which parts of the range are visited, no longer asked."""
    switches = np.sign(np.sin(3.0 * T * np.arange(3000)))
    for q in (motion(5), switches, np.cumsum(motion(6))):
        assert unwrapped(trace(q), ["position_m1"], "moves")[1] == ""
    spiked = motion(7)
    spiked[1200] += 80.0
    assert unwrapped(trace(spiked), ["position_m1"], "spike")[1] == ""


def test_stale_readings_are_filled_in_from_the_others() -> None:
    """Mutation that breaks it: that a position runs, no longer asked (an encoder that creeps)."""
    q = motion(8)
    late = np.random.default_rng(1).choice(np.arange(20, 2980), 60, replace=False)
    late = np.sort(late)[np.diff(np.sort(late), prepend=-9) > 2]
    seen = q.copy()
    seen[late] = seen[late - 1]
    fast = np.abs(np.gradient(q)) > 8.0 * COUNTS
    assert int(fast[late].sum()) > 20
    whole, said = renewed(trace(seen), ["position_m1"], "bus")
    wrong = np.abs(whole["position_m1"] - q) > 1.5 * COUNTS
    assert not np.any(wrong & fast)
    assert "are taken as stale" in said
    assert renewed(trace(q), ["position_m1"], "bus")[1] == ""


def test_an_uneven_motion_that_stands_for_a_sample_by_chance_is_not_stale() -> None:
    """Its changes scatter about zero, so none is as frequent as one of one step, or of two.

    Mutation: no count of the small changes.
    """
    step, t = 4.75e-6, np.arange(6000)
    noise = np.random.default_rng(1).standard_normal(t.size)
    fast = t % 1000 < 300
    change = np.rint((2e-5 + fast * (5e-4 + lfilter([2.5e-4], [1.0, -0.6], noise))) / step)
    assert np.count_nonzero((change == 0.0) & fast) > 4
    q = step * np.cumsum(change)
    assert renewed(trace(q), ["position_m1"], "swing")[1] == ""


def test_what_stands_while_it_sets_out_is_no_stale_reading() -> None:
    """As fast as four steps per sample around it, and slower where two readings are equal.

    Mutation: the speed around alone.
    """
    t = np.arange(6000)
    thrown = 2.0 * np.maximum(0, t % 600 - 300) ** 2  # stands, then is thrown
    assert renewed(trace(thrown), ["position_m1"], "bus")[1] == ""
    for seed in range(60):
        random = np.random.default_rng(seed)
        size, period, noisy = 10.0 ** random.uniform((1.0, 1.5, -1.0), (4.0, 3.5, 0.5))
        q = size * (np.sin(2 * np.pi * t / period) + 0.3 * np.sin(17.0 * t / period + 1.0))
        counts = np.rint(q + noisy * random.standard_normal(t.size))
        assert renewed(trace(counts), ["position_m1"], "bus")[1] == ""


def test_a_sensor_that_is_read_slowly_is_refused_with_the_period_to_take() -> None:
    q = motion(9)
    held = np.repeat(q[::5], 5)
    assert repeated(held) == 5
    assert repeated(q) == 1
    slow = np.rint(motion(10) / 40.0 / COUNTS) * COUNTS  # an encoder that creeps
    assert repeated(slow) == 1
    with pytest.raises(ExperimentError, match=r"repeats every reading 5 times.*resample = 0\.01 "):
        stretches(trace(held), DEVICE, "bus")


def test_an_experiment_says_what_was_put_right() -> None:
    (e,) = stretches(trace(np.mod(motion(11), 2.0 * math.pi)), DEVICE, "rotor")
    assert any("starts again" in note for note in e.notes)
    q = motion(11)
    np.testing.assert_allclose(np.diff(e.measured[:, 0]), np.diff(q), atol=1e-9)
