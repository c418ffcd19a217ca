"""Truths 1 and 9 in the time domain, and what a bracket says where the loop is not linear."""

import ast
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engine_examples import coulomb, one_mass, phantom
from scipy.optimize import brentq

import zwidth.stability.bisection as bisection
import zwidth.stability.frequency
from zwidth.sim.ensemble import walls
from zwidth.sim.fate import Conditions, Fate, fates_of
from zwidth.sim.growth import DECAYS, GROWS, LIMIT_CYCLE, UNDECIDED, Verdict
from zwidth.sim.loop import open_loop
from zwidth.sim.perception import Perception
from zwidth.sim.physics import make_physics
from zwidth.stability.bisection import Bracket, Search, find_brackets
from zwidth.stability.judging import Trial, judge, usual_trial
from zwidth.stability.linear import boundary, critical_stiffness, last_stable_damping
from zwidth.stability.plane import with_friction

MASS = 1.2e-3


def middle(bracket: Bracket) -> float:
    assert bracket.stable is not None
    assert bracket.unstable is not None
    return math.sqrt(bracket.stable * bracket.unstable)


@pytest.mark.parametrize("delay", [0.002, 0.004, 0.008])
def test_time_domain_and_linear_theory_agree(delay: float) -> None:
    """Truth 9 at 100 dampings: K within 0.1 %, near the end 0.005 N m/rad, frequency 0.2 Hz.

    Mutation: the fast energy left out of `assess` (beyond B_t).
    """
    device = phantom().with_interface(delay=delay)
    last = last_stable_damping(device)
    assert last is not None
    dampings = np.linspace(0.0, 0.999 * last, 100)
    (brackets,) = find_brackets([device], [dampings])
    for bracket, point in zip(brackets, boundary(device, dampings), strict=True):
        assert point.stiffness is not None
        assert point.frequency_hz is not None
        allowed = 1e-3 * point.stiffness if point.damping <= 0.98 * last else 5e-3
        assert middle(bracket) == pytest.approx(point.stiffness, abs=allowed)
        assert bracket.frequency == pytest.approx(point.frequency_hz, abs=0.2)
        assert bracket.stable_verdict is Verdict.DECAYS
        assert bracket.unstable_verdict is Verdict.GROWS


@pytest.mark.parametrize(("damping", "delay"), [(2e-3, 0.0), (5e-3, 0.002), (2e-3, 0.0047)])
def test_one_mass_obeys_the_law_of_small_damping(damping: float, delay: float) -> None:
    """Truth 1: K = (b + B) / tau, f = sqrt((b + B) / m tau) / 2 pi, 0.4 % for b tau / m <= 0.02.

    tau = T/2 + t_d (Gil et al., J. Comput. Inf. Sci. Eng. 9, 011005, 2009). Mutation: the delay
    line one tick longer.
    """
    tau = 0.5e-3 + delay
    device = one_mass(MASS, damping, delay=delay)
    virtual = np.array([0.0, damping])
    (brackets,) = find_brackets([device], [virtual])
    for bracket, b in zip(brackets, damping + virtual, strict=True):
        assert middle(bracket) == pytest.approx(b / tau, rel=4.1e-3)
        frequency = math.sqrt(b / (MASS * tau)) / (2.0 * math.pi)
        assert bracket.frequency == pytest.approx(frequency, rel=4e-3)


def test_a_lag_counts_as_delay() -> None:
    """Truth 1: tau = T/2 + t_d + t_a within 0.8 %. Mutation: the lag doubled in `assemble`."""
    lag = make_physics("actuator_lag", "command", time_constant=1e-3)
    device = one_mass(MASS, 2e-3, delay=0.001).with_physics(lag)
    ((bracket,),) = find_brackets([device], [np.zeros(1)])
    assert middle(bracket) == pytest.approx(2e-3 / 2.5e-3, rel=8e-3)


@pytest.mark.parametrize(
    ("stiffness", "damping"), [(2.4, 0.0), (2.5035, 0.0), (15.2, 0.03), (22.0, 0.05), (20.0, 0.09)]
)
def test_the_growth_rate_is_that_of_the_largest_eigenvalue(
    stiffness: float, damping: float
) -> None:
    """Within 5e-4 of itself and 2e-5 /s. Mutation: the half of `0.5 * np.log` in `assess`."""
    growth = judge(phantom(), walls(np.array([stiffness]), damping))
    radius = np.abs(np.linalg.eigvals(open_loop(phantom()).closed(stiffness, damping))).max()
    assert growth.rate[0] == pytest.approx(math.log(radius) / 1e-3, rel=5e-4, abs=2e-5)
    assert growth.verdict[0] == (GROWS if radius > 1.0 else DECAYS)


def test_the_linear_result_seeds_no_bracket() -> None:
    """Neither module of the time domain imports anything of the linear theory."""
    for module in (bisection, zwidth.stability.frequency):
        assert module.__file__ is not None
        tree = ast.parse(Path(module.__file__).read_text())
        imported = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
        imported |= {a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
        ours = {name for name in imported if name and name.startswith(("stability", "identif"))}
        assert ours <= {"zwidth.stability.frequency"}


@pytest.mark.parametrize("far", [False, True])
def test_a_damping_finds_alone_what_it_finds_beside_others_that_lead(
    far: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Out of order, past the last damping with a stable K, and where those that follow begin far.

    Mutation: an unstable first K above the lowest taken as the end.
    """
    device = phantom().with_interface(delay=0.008)
    last = last_stable_damping(device)
    assert last is not None
    dampings = np.linspace(0.0, 1.02 * last, 53)[np.random.default_rng(5).permutation(53)]
    if far:

        def follow(hunt: Any) -> None:
            hunt.first[hunt.waiting] = hunt.highest
            hunt.waiting[:] = False

        monkeypatch.setattr(bisection._Hunt, "follow", follow)
    (together,) = find_brackets([device], [dampings])
    for damping, bracket in list(zip(dampings, together, strict=True))[::4]:
        ((alone,),) = find_brackets([device], [np.array([damping])])
        assert bracket.damping == damping
        assert (bracket.stable is None) == (alone.stable is None)
        if alone.stable is None:
            assert bracket.unstable == alone.unstable  # near zero in the end
        else:
            assert middle(bracket) == pytest.approx(middle(alone), rel=1e-3, abs=5e-3)


def test_where_no_stiffness_is_stable_the_bracket_says_so() -> None:
    """Past the last B with a stable K: stable is None, at the lowest K tried."""
    device = phantom()
    last = last_stable_damping(device)
    assert last is not None
    ((bracket,),) = find_brackets([device], [np.array([1.05 * last])])
    assert bracket.stable is None
    assert bracket.stable_verdict is None
    assert bracket.unstable == Search().limits(device)[0]


def test_where_all_stiffness_is_stable_the_bracket_says_so() -> None:
    ((bracket,),) = find_brackets([phantom()], [np.array([0.03])], search=Search(highest=10.0))
    assert (bracket.stable, bracket.unstable, bracket.frequency) == (10.0, None, None)


def test_a_boundary_closer_than_time_can_tell_stays_undecided() -> None:
    """3 s, never prolonged: the K that had no clear sign are kept, and bracketed."""
    search = Search(tolerance=1e-7)
    ((bracket,),) = find_brackets(
        [phantom()], [np.zeros(1)], Trial(seconds=3.0, limit_s=3.0), search
    )
    assert bracket.undecided is not None
    assert bracket.stable is not None
    assert bracket.unstable is not None
    low, high = bracket.undecided
    truth = critical_stiffness(phantom(), 0.0).stiffness
    assert truth is not None
    assert bracket.stable < low <= truth <= high < bracket.unstable
    assert low / bracket.stable - 1.0 < 1e-7
    assert bracket.unstable / high - 1.0 < 1e-7
    growth = judge(phantom(), walls(np.array([truth]), 0.0), Trial(seconds=3.0, limit_s=3.0))
    assert growth.verdict[0] == UNDECIDED


def test_a_device_that_never_comes_to_rest_has_brackets_all_the_same() -> None:
    """A mode without any damping decays by no wall, however weak: undecided, and not for ever.

    Mutation: begin from the lowest K again as often as the first sure verdict is a bad one (hangs).
    """
    ring = make_physics("extra_mode", "m1", mass=4e-4, stiffness=0.18, damping=0.0)
    device = one_mass(1.7, 0.9, 780.0, ring)
    dampings = np.array([0.0, 600.0])
    (brackets,) = find_brackets(
        [device], [dampings], Trial(start=1e-4, seconds=3.0, limit_s=6.0), Search(tolerance=0.02)
    )
    assert [b.damping for b in brackets] == dampings.tolist()


@pytest.mark.parametrize("start", [5e-4, 2e-3, 1e-2])
def test_with_friction_the_boundary_depends_on_the_start(start: float) -> None:
    """Amplitude A* = 4 f_c / (pi omega (K tau - b)) within 2 %: larger starts, lower walls.

    Mutation: the start of the trial not passed on to the runs.
    """
    level, damping, tau = 1e-3, 2e-3, 1.5e-3
    device = one_mass(MASS, damping, 0.0, coulomb(level), delay=0.001)
    ((bracket,),) = find_brackets(
        [device], [np.zeros(1)], Trial(start=start, substeps=4, limit_s=16.0),
        Search(tolerance=2e-3),
    )  # fmt: skip
    k = middle(bracket)
    amplitude = 4.0 * level / (math.pi * math.sqrt(k / MASS) * (k * tau - damping))
    assert amplitude == pytest.approx(start, rel=0.02)
    assert k > 1.5 * damping / tau
    assert bracket.stable_verdict is Verdict.DECAYS


def test_friction_brings_a_stable_run_to_rest() -> None:
    growth = judge(
        phantom().with_physics(coulomb(2e-3)), walls(np.array([2.0, 3.0]), 0.0), Trial(substeps=2)
    )
    assert growth.verdict.tolist() == [DECAYS, DECAYS]
    assert growth.amplitude.tolist() == [0.0, 0.0]


def saturated(gain: float) -> float:
    """Amplitude over the limit at which a saturation passes 1 / gain (describing function)."""

    def passed(a: float) -> float:
        return 2.0 / math.pi * (math.asin(1.0 / a) + math.sqrt(1.0 - 1.0 / a**2) / a)

    return brentq(lambda a: passed(a) - 1.0 / gain, 1.0 + 1e-9, 1e3)


@pytest.mark.parametrize("gain", [1.1, 1.2])
def test_the_cycle_at_the_amplifiers_limit(gain: float) -> None:
    """Amplitude within 1.5 % and frequency within 1 % of the describing function.

    K above the linear boundary, started above it too: the limit lets the oscillation only decay to
    where the saturation passes K_CR / K. Mutation: `limit_command` at twice the limit.
    """
    point = critical_stiffness(phantom(), 0.0)
    assert point.stiffness is not None
    limit = 2e-3
    stiffness = gain * point.stiffness
    expected = saturated(gain) * limit / stiffness
    growth = judge(
        phantom().with_interface(command_limit=limit), walls(np.array([stiffness]), 0.0),
        Trial(start=1.3 * expected),
    )  # fmt: skip
    assert growth.verdict[0] == LIMIT_CYCLE
    assert growth.amplitude[0] == pytest.approx(expected, rel=0.015)
    assert growth.force[0] == limit
    assert growth.frequency[0] == pytest.approx(point.frequency_hz, rel=0.01)


def test_the_cycle_of_an_encoder_step() -> None:
    """Inside the linear boundary an encoder without friction cycles; within 8 % of its describing
    function N = 4 / (pi a) (sqrt(1 - 1/4a^2) + sqrt(1 - 9/4a^2)), a = A / step from 1.5 to 2.5.

    The start, five steps or two, does not matter, and no run on the way down is taken for stable.
    Mutation: `if not final: verdict[:] = UNDECIDED` dropped from `assess` (decays).
    """
    point = critical_stiffness(phantom(), 0.0)
    assert point.stiffness is not None
    step, stiffness = 2e-4, 2.4
    needed = point.stiffness / stiffness

    def excess(a: float) -> float:
        roots = math.sqrt(1.0 - 0.25 / a**2) + math.sqrt(1.0 - 2.25 / a**2)
        return 4.0 / (math.pi * a) * roots - needed

    expected = step * brentq(excess, 1.75, 2.5)  # of two cycles the outer, stable one
    device = phantom().with_interface(encoder_step=step)
    for start in (2.0 * step, 5.0 * step):
        growth = judge(device, walls(np.array([stiffness]), 0.0), Trial(start=start))
        assert growth.verdict[0] == LIMIT_CYCLE
        assert growth.amplitude[0] == pytest.approx(expected, rel=0.08)
        assert growth.frequency[0] == pytest.approx(point.frequency_hz, rel=0.02)
        wall = np.array([stiffness]), np.zeros(1)
        start_rest = np.array([start]), np.array([0.02 * step])
        conditions = Conditions([device], np.zeros(1, np.int64), *wall, *start_rest)
        assert fates_of(growth, conditions, 64.0, Perception())[0] == Fate.DITHERS


@pytest.mark.parametrize("level", [0.0, 0.002])
def test_steps_and_friction_leave_the_frequency_of_what_grows(level: float) -> None:
    """At each unstable end f is that of the linear loop's pole that grows most there, 0.5 %.

    What grows leaves steps and friction behind. Mutations: the run not followed to its verdict and
    `ultimate_frequencies` in place of `largest_frequencies`, both at once (179 to 456 Hz for 7 to
    24 Hz under the steps; on this device either alone is enough); the growth left in the velocity
    (no frequency with friction).
    """
    device = with_friction(phantom().with_interface(encoder_step=1e-4), level)
    (brackets,) = find_brackets([device], [np.linspace(0.0, 0.1, 11)], usual_trial(device))
    for bracket in brackets:
        assert bracket.unstable is not None
        poles = np.linalg.eigvals(open_loop(device).closed(bracket.unstable, bracket.damping))
        growing = poles[np.argmax(np.abs(poles) * (np.imag(poles) > 0.0))]
        truth = float(np.angle(growing)) / (2.0 * math.pi * device.interface.period)
        assert bracket.frequency == pytest.approx(truth, rel=5e-3)


def test_nearly_neutral_is_no_cycle() -> None:
    """With a limit that is never reached, runs just beside the boundary keep their linear verdict.

    |rate| is 2.5e-3 /s: 0.5 % in the last half of 4 s. Mutation: `moving` dropped from `_cycling`.
    """
    device = phantom().with_interface(command_limit=1.0)
    point = critical_stiffness(phantom(), 0.0)
    assert point.stiffness is not None
    stiffness = point.stiffness * np.array([0.999, 1.001])
    assert judge(device, walls(stiffness, 0.0)).verdict.tolist() == [DECAYS, GROWS]


def test_a_lag_alone_makes_nothing_nonlinear() -> None:
    """The verdict is the linear one at once."""
    lag = make_physics("actuator_lag", "command", time_constant=1e-4)
    growth = judge(
        phantom().with_physics(lag), walls(np.array([2.40, 2.46]), 0.0),
        Trial(seconds=4.0, limit_s=4.0),
    )  # fmt: skip
    assert growth.verdict.tolist() == [GROWS, GROWS]


def test_a_mass_that_rests_beside_a_one_sided_wall_is_at_rest() -> None:
    growth = judge(phantom(), walls(np.array([2.0]), 0.0, one_sided=True), Trial(start=-1e-3))
    assert growth.verdict.tolist() == [DECAYS]


def test_progress_goes_to_one() -> None:
    seen: list[float] = []
    find_brackets(
        [phantom()], [np.array([0.0, 0.03])], search=Search(tolerance=0.05), progress=seen.append
    )
    assert seen[-1] == 1.0
    assert seen == sorted(seen)


def test_bad_trials_and_searches_are_refused() -> None:
    for make, said in (
        (lambda: Trial(start=0.0), "start is 0.0"),
        (lambda: Trial(seconds=2.0), "seconds is 2.0"),
        (lambda: Trial(seconds=8.0, limit_s=4.0), "seconds is 8.0"),
        (lambda: Search(tolerance=0.0), "tolerance is 0.0"),
        (lambda: Search(ratio=1.0), "ratio is 1.0"),
        (lambda: Search(lowest=5.0, highest=1.0).limits(phantom()), "K goes from 5 to 1"),
        (lambda: find_brackets([phantom()], [np.array([np.nan])]), "damping contains"),
    ):
        with pytest.raises(ValueError, match=said):
            make()
