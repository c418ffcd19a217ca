"""Verdicts and frequencies of made-up oscillations, whose truth is known exactly."""

import numpy as np
import pytest
from engine_examples import Floats, phantom

from zwidth.sim.ensemble import walls
from zwidth.sim.growth import (
    DECAYS,
    GROWS,
    LIMIT_CYCLE,
    UNDECIDED,
    Growth,
    assess,
    growth_rate,
    window_weights,
)
from zwidth.sim.windows import MEASURES
from zwidth.stability.frequency import ultimate_frequencies
from zwidth.stability.judging import judge

T, WINDOW = 1e-3, 500
TIME: Floats = np.arange(8 * WINDOW, dtype=np.float64) * T


def wave(amplitude: float, frequency: float, rate: float, time: Floats = TIME) -> Floats:
    return amplitude * np.exp(rate * time) * np.sin(2.0 * np.pi * frequency * time)


def verdict_of(
    position: Floats, nonlinear: bool = False, final: bool = True, threshold: float = 1e-6
) -> Growth:
    """Judge one run of unit mass, as the kernels measure it."""
    velocity = np.gradient(position, T)
    third = np.diff(np.concatenate([np.full(3, velocity[0]), velocity]), 3)
    crossed = np.concatenate([[False], velocity[1:] * velocity[:-1] < 0.0])
    weights = window_weights(WINDOW)
    measures = np.zeros((position.size // WINDOW, MEASURES, 1))
    for i, row in enumerate(measures[:, :, 0]):
        at = slice(i * WINDOW, (i + 1) * WINDOW)
        row[:] = (
            weights @ (0.5 * velocity[at] ** 2), weights @ third[at] ** 2,
            position[at].min(), position[at].max(), -position[at].max(), -position[at].min(),
            np.count_nonzero(crossed[at]),
        )  # fmt: skip
    return assess(measures, WINDOW * T, 1e-3, threshold, nonlinear, final)


@pytest.mark.parametrize("rate", [-3.0, -0.1, -1e-3, 1e-3, 0.1, 3.0])
def test_the_sign_of_a_single_oscillation(rate: float) -> None:
    """Rate to 1e-4 /s. Mutation: `SIGNIFICANCE` 1000 (undecided)."""
    growth = verdict_of(wave(1e-3, 9.3, rate))
    assert growth.verdict[0] == (GROWS if rate > 0.0 else DECAYS)
    assert growth.rate[0] == pytest.approx(rate, abs=1e-4)
    assert growth.frequency[0] == pytest.approx(9.3, abs=0.3)


def test_a_fast_mode_that_has_just_begun_to_grow_is_seen() -> None:
    """170 Hz, 1e-3 of a decaying 28 Hz. Mutation: the fast energy not watched (`up[1]`)."""
    position = wave(1e-3, 28.0, -0.5) + wave(1e-6, 170.0, 0.3)
    growth = verdict_of(position)
    assert growth.verdict[0] == GROWS
    assert growth.rate[0] == pytest.approx(0.3, abs=0.03)


def test_a_slow_mode_that_has_just_begun_to_grow_leaves_it_open() -> None:
    """The energy still falls, on a line that bends: undecided, so that the run is prolonged."""
    short = wave(1e-3, 20.0, -2.0) + wave(2e-5, 8.0, 0.4)
    assert verdict_of(short).verdict[0] == UNDECIDED
    time = np.arange(32 * WINDOW, dtype=np.float64) * T
    longer = wave(1e-3, 20.0, -2.0, time) + wave(2e-5, 8.0, 0.4, time)
    assert verdict_of(longer).verdict[0] == GROWS


def test_a_cycle_that_growth_runs_into() -> None:
    """Growth to a constant amplitude: waits while time is left, is a cycle once it has lasted."""
    time = np.arange(32 * WINDOW, dtype=np.float64) * T
    grown = 1e-3 * np.tanh(np.exp(0.5 * (time - 6.0))) * np.sin(2.0 * np.pi * 9.3 * time)
    early = grown[: 8 * WINDOW]
    assert verdict_of(early, nonlinear=True).verdict[0] == GROWS
    assert verdict_of(early, nonlinear=True, final=False).verdict[0] == UNDECIDED
    assert verdict_of(grown, nonlinear=True, final=False).verdict[0] == LIMIT_CYCLE
    assert verdict_of(grown, nonlinear=True).amplitude[0] == pytest.approx(1e-3, rel=2e-3)


def test_a_cycle_that_beats_is_one_in_the_end() -> None:
    """10 % of beat."""
    beating = wave(1e-3, 9.3, 0.0) * (1.0 + 0.1 * np.sin(2.0 * np.pi * 2.7 * TIME))
    assert verdict_of(beating, nonlinear=True).verdict[0] == LIMIT_CYCLE
    assert verdict_of(beating, nonlinear=True, final=False).verdict[0] == UNDECIDED


def test_decay_is_final_only_when_time_is_up_or_rest_is_reached() -> None:
    slow, fast = wave(1e-3, 9.3, -0.3), wave(1e-3, 9.3, -6.0)
    assert verdict_of(slow, nonlinear=True, final=False).verdict[0] == UNDECIDED
    assert verdict_of(slow, nonlinear=True).verdict[0] == DECAYS
    assert verdict_of(fast, nonlinear=True, final=False).verdict[0] == DECAYS


def test_slow_growth_is_no_cycle() -> None:
    """1e-3 /s changes 0.2 % in the last half. Mutation: `moving` dropped from `_cycling`."""
    for rate, verdict in ((1e-3, GROWS), (-1e-3, DECAYS), (0.0, LIMIT_CYCLE)):
        assert verdict_of(wave(1e-3, 10.0, rate), nonlinear=True).verdict[0] == verdict


def test_an_oscillation_slower_than_its_windows_is_judged_by_whole_cycles() -> None:
    """0.3 Hz in windows of 0.5 s: right sign and amplitude in 64 s, no verdict in 16.

    Mutation: `_joined` always 1 (undecided in both, and the amplitude of a slice).
    """
    time = np.arange(128 * WINDOW, dtype=np.float64) * T
    for rate, verdict in ((0.02, GROWS), (-0.02, DECAYS)):
        whole = wave(1e-3, 0.3, rate, time)
        growth = verdict_of(whole, nonlinear=True)
        assert growth.verdict[0] == verdict
        assert growth.rate[0] == pytest.approx(rate, rel=0.1)
        assert growth.amplitude[0] == pytest.approx(1e-3 * np.exp(rate * 64.0), rel=0.05)
        assert verdict_of(whole[: 32 * WINDOW], nonlinear=True).verdict[0] == UNDECIDED


def test_rest_escape_and_silence() -> None:
    still = np.zeros(TIME.size)
    still[:700] = wave(1e-3, 9.3, 0.0)[:700]
    assert verdict_of(still).verdict[0] == DECAYS
    assert verdict_of(still).rate[0] == -np.inf
    assert verdict_of(np.zeros(TIME.size)).verdict[0] == DECAYS
    with np.errstate(all="ignore"):
        lost = wave(1e-3, 9.3, 20.0)
        lost[3000:] = np.inf
        assert verdict_of(lost, nonlinear=True, final=False).verdict[0] == GROWS
    buzz = wave(5e-7, 40.0, 0.0)
    assert verdict_of(buzz, nonlinear=True).verdict[0] == DECAYS
    assert verdict_of(buzz, nonlinear=True, threshold=1e-7).verdict[0] == LIMIT_CYCLE


def test_the_slopes_error_is_that_of_least_squares() -> None:
    """White noise on 200 lines: slope within its standard error as often as it should be, +-15 %.

    Mutation: `count - 2` as `count`, or the autocorrelation's factor squared.
    """
    rng = np.random.default_rng(4)
    lines = 0.3 * (np.arange(40) * 0.5)[:, None] + 0.01 * rng.normal(size=(40, 200))
    slope, error = growth_rate(lines, 0.5)
    assert slope.mean() == pytest.approx(0.3, abs=1e-3)
    assert np.sqrt(np.mean(((slope - 0.3) / error) ** 2)) == pytest.approx(1.0, abs=0.15)


def test_the_frequency_of_the_peak_that_has_grown_most() -> None:
    """171.3 Hz that grows under 28 Hz that decays, a hundredth of a bin (1/4 Hz).

    Mutation: the largest peak taken.
    """
    velocity = wave(1.0, 28.1, -0.4) + wave(0.02, 171.3, 0.1)
    assert ultimate_frequencies(velocity[None], T)[0] == pytest.approx(171.3, abs=0.01)


def test_the_frequency_of_a_cycle_is_that_of_its_fundamental() -> None:
    """Harmonics that have grown alike are no candidates. Mutation: `ALIKE` = 1."""
    rng = np.random.default_rng(1)
    velocity = wave(1.0, 12.2, 0.0) + wave(0.2, 36.6, 1e-4) + wave(0.05, 61.0, 5e-4)
    velocity += 1e-6 * rng.normal(size=velocity.size)
    assert ultimate_frequencies(velocity[None], T)[0] == pytest.approx(12.2, abs=0.01)


def test_runs_of_any_length_keep_their_own_frequency() -> None:
    """Together as alone, also where one has ended early; none where nothing oscillates."""
    rows = np.stack([wave(1.0, f, r) for f, r in ((12.2, 0.1), (171.3, -0.2), (55.5, 0.0), (9, 0))])
    rows[2, 3100:] = np.nan
    rows[3] = 0.0
    found = ultimate_frequencies(rows, T)
    assert found[:3] == pytest.approx([12.2, 171.3, 55.5], abs=0.01)
    assert np.isnan(found[3])
    assert found[2] == ultimate_frequencies(rows[2:3, :3100], T)[0]
    assert np.isnan(ultimate_frequencies(np.ones((1, 10)), T)[0])


def test_rounding_that_seems_to_grow_is_no_growth() -> None:
    """A slow decay whose fast energy has fallen to rounding decays, whatever the rounding's slope.

    A wall a thousandth of what the device bears, with a damper that leaves 0.02 /s of decay.
    Mutation: `ROUNDED` of 0, with which one of these walls grows.
    """
    device = phantom().with_interface(velocity_order=2, velocity_cutoff_hz=97.86708907438302)
    stiffness = np.geomspace(0.008, 0.02, 64)
    growth = judge(device, walls(stiffness, 0.37947834782032713))
    assert np.all(growth.verdict == DECAYS)
