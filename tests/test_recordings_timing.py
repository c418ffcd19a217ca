"""Stamps are examined: each fault of a clock is found, counted and placed."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from zwidth.logs.resampling import axis, forward_only, held, interpolated
from zwidth.logs.source import Floats
from zwidth.logs.steps import step_seen
from zwidth.logs.timing import EPOCH, Stamps, common_origin, examine
from zwidth.logs.units import UNITS, find_unit


def regular(samples: int = 1000, period: float = 0.001) -> Floats:
    return period * np.arange(samples, dtype=np.float64)


def test_a_good_clock() -> None:
    timing = examine(regular())
    assert timing.period == 0.001
    assert (timing.jitter, timing.resolution, timing.gap_count) == (0.0, 0.0, 0)
    assert timing.faults() == []


def test_gaps_repeats_and_going_back() -> None:
    t = np.delete(regular(), [500, 501, 502, 700])
    t[300] = t[299]
    t[900] = t[890]
    timing = examine(t)
    assert timing.period == pytest.approx(0.001, rel=1e-9)
    assert (timing.repeats, timing.repeats_at) == (1, t[299])
    assert (timing.backwards, timing.backwards_at) == (1, t[900])
    # The stamp after the repeat, and the one after going back, come late and lack nothing.
    assert [g.samples for g in timing.gaps] == [3, 1]
    assert [g.t for g in timing.gaps] == pytest.approx([0.499, 0.699])
    assert timing.missing == 4
    assert timing.jitter == 0.0
    said = " ".join(timing.faults())
    assert "goes back once" in said
    assert "repeats the one before once" in said
    assert "4 samples are missing in 2 gaps" in said


def test_stamps_that_come_late_and_catch_up_are_jitter_and_no_lost_samples() -> None:
    """Mutation: every interval above 1.5 periods a gap."""
    t = regular()
    t[100:900:50] += 0.0008
    timing = examine(t)
    assert (timing.gap_count, timing.missing) == (0, 0)
    assert timing.jitter > 0.0001
    assert any("intervals scatter" in fault for fault in timing.faults())


def test_jitter_is_measured() -> None:
    """Independent errors of s in the stamps spread intervals by s sqrt(2).

    Mutation that breaks it: the spread over all intervals, gaps included.
    """
    rng = np.random.default_rng(1)
    t = np.delete(regular(20_000) + rng.normal(scale=3e-5, size=20_000), slice(500, 600))
    timing = examine(t)
    assert timing.jitter == pytest.approx(3e-5 * np.sqrt(2.0), rel=0.03)
    assert timing.period == pytest.approx(0.001, rel=1e-3)
    assert "scatter" in timing.faults()[-1]


@pytest.mark.parametrize(("rate", "digits"), [(610.35, 4), (3000.0, 4), (1024.0, 5)])
def test_rounded_stamps_still_tell_the_rate(rate: float, digits: int) -> None:
    """Their rounding is seen as such, and no jitter is claimed.

    Mutation that breaks it: the median interval as the period (1.6 ms or 1.7 ms at 610.35 Hz).
    """
    timing = examine(np.round(np.arange(20_000) / rate, digits))
    assert timing.rate == pytest.approx(rate, rel=2e-4)
    assert timing.resolution == pytest.approx(10.0**-digits, rel=1e-6)
    assert timing.faults() == []


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=30))
def test_any_stamps_are_examined(stamps: list[float]) -> None:
    timing = examine(np.array(stamps))
    assert timing.samples == len(stamps)
    assert timing.backwards + timing.repeats <= len(stamps) - 1
    assert all(timing.faults())
    assert timing.facts()["start_s"] == stamps[0]


def test_an_epoch_keeps_its_nanoseconds() -> None:
    raw = np.array([1_700_000_000_000_000_001, 1_700_000_000_000_001_003])
    stamps = Stamps(raw, 1e-9)
    np.testing.assert_array_equal(stamps.seconds(common_origin({"": stamps})), [0.0, 1.002e-6])
    near = Stamps(np.array([0.25, 0.5]), 1.0, shift=EPOCH / 4.0)
    assert common_origin({"": near}) == 0
    np.testing.assert_array_equal(near.seconds(common_origin({"": near})), 0.25e6 + near.raw)


def test_resampling_neither_shifts_nor_invents() -> None:
    t, fine = regular(100), regular(401, 0.00025)[:397]
    np.testing.assert_array_equal(held(t, t, t**2, 0.001), t**2)
    np.testing.assert_array_equal(interpolated(t, fine, 3.0 * fine), 3.0 * fine[::4])
    np.testing.assert_array_equal(held(fine, t, t, 0.00025), np.repeat(t, 4)[:397])
    grid = axis([0.0, 0.0101], [1.0, 0.5], 0.01)
    assert grid[0] == 0.0101
    assert grid[-1] <= 0.5 < grid[-1] + 0.01
    with pytest.raises(ValueError, match="do not overlap"):
        axis([0.0, 2.0], [1.0, 3.0], 0.01)
    with pytest.raises(ValueError, match="at most"):
        axis([0.0], [1e9], 1e-6)


@given(
    values=st.lists(st.floats(-1.0, 1.0), min_size=40, max_size=40),
    ratio=st.sampled_from([2, 4, 5, 10]),
)
def test_a_coarser_axis_keeps_the_impulse_of_the_command(values: list[float], ratio: int) -> None:
    """Mutation that breaks it: the first command of each tick instead of the mean."""
    t, u = regular(40), np.array(values)
    coarse = held(t[::ratio], t, u, 0.001 * ratio)
    np.testing.assert_allclose(coarse, u.reshape(-1, ratio).mean(axis=1), atol=1e-12)


def test_stamps_that_do_not_advance_are_passed_over() -> None:
    t = np.array([0.0, 1.0, 1.0, 0.5, 0.9, 2.0])
    assert forward_only(t).tolist() == [True, True, False, False, False, True]


@given(
    step=st.floats(1e-9, 10.0),
    offset=st.floats(-5.0, 5.0),
    seed=st.integers(0, 1000),
    span=st.sampled_from([20, 300, 5000]),
)
def test_the_step_of_an_encoder_is_seen(step: float, offset: float, seed: int, span: int) -> None:
    """Mutation that breaks it: the smallest gap taken as it is (off where text rounds it)."""
    counts = np.cumsum(np.random.default_rng(seed).integers(-3, 4, size=span))
    values = counts.astype(np.float64) * step + round(offset) * step
    levels = np.unique(values).size
    seen = step_seen(values)
    if levels >= 8:
        assert seen == pytest.approx(step, rel=1e-6)
    printed = np.array([float(f"{v:.6e}") for v in values])
    if levels >= 8 and np.abs(printed).max() < 1e3 * step:
        assert step_seen(printed) == pytest.approx(step, rel=1e-3)


def test_where_there_is_no_step_none_is_seen() -> None:
    rng = np.random.default_rng(0)
    assert step_seen(rng.normal(size=5000)) is None
    assert step_seen(np.full(100, np.nan)) is None
    assert step_seen(np.array([0.0, 1.0] * 50)) is None
    assert step_seen(np.array([-1e308, 1e308, 0.0, 5e-324] * 4)) is None


def test_units_in_other_spellings() -> None:
    for spelled, unit in {
        "N·m": "Nm", "[N m]": "Nm", "N*m": "Nm", "deg/s^2": "deg/s2", "m/s²": "m/s2", "°": "deg",
        "μm": "um", "µm": "um", "RPM": "rpm", "Degrees": "deg", "rad / s": "rad/s", "oz-in": "ozfin"
    }.items():  # fmt: skip
        assert find_unit(spelled) == UNITS[unit], spelled
    assert find_unit("Nm") != find_unit("nm")
    assert find_unit("furlong") is None
    assert find_unit("") is None


@pytest.mark.parametrize("share", [0.05, 0.3, 0.45, 0.578, 0.62, 0.7, 0.8, 0.9, 0.97])
@pytest.mark.parametrize("up", [0.0, 0.5])
def test_stamps_rounded_to_a_part_of_the_period_are_those_of_even_samples(
    share: float, up: float
) -> None:
    """As at 833 Hz in ms. Mutation: the median interval is the period, and the others are gaps."""
    period = 1.25e-3
    t = np.floor((np.arange(3000) + 0.3) / share + up) * share * period
    seen = examine(t)
    assert seen.period == pytest.approx(period, rel=1e-4)
    assert seen.gap_count == seen.missing == 0


def test_samples_lost_by_chance_are_no_slower_clock() -> None:
    """One of a hundred is missing. Mutation: whatever has a step is evenly sampled."""
    kept = np.random.default_rng(1).random(5000) > 0.01
    seen = examine(np.asarray(1e-3 * np.flatnonzero(kept), dtype=np.float64))
    assert seen.period == pytest.approx(1e-3)
    assert seen.missing == np.count_nonzero(~kept[np.flatnonzero(kept)[0] :])
