"""Runs side by side equal the runs one by one, bit for bit, however they are grouped."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from engine_examples import Floats, coulomb, one_mass, phantom

from zwidth.controllers.wall import wall
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.device import Device
from zwidth.sim.ensemble import (
    LaneRuns,
    Runs,
    ScalarRuns,
    Walls,
    advance_runs,
    start_runs,
    walls,
)
from zwidth.sim.equations import equations
from zwidth.sim.growth import window_weights
from zwidth.sim.lanes import (
    ESTIMATE,
    FAST_ENERGY,
    HIGHEST,
    LANES,
    LOWEST_COMMAND,
    READING,
    REVERSALS,
    SLOW_ENERGY,
    signal_row,
)
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Start, simulate, start_memory
from zwidth.stability.bisection import Search, Trial, find_brackets

STEPPED = {
    "delay": 0.0013,
    "encoder_step": 3e-6,
    "command_step": 2e-3,
    "command_limit": 0.03,
    "encoder_rounding": "floor",
}
LAG = make_physics("actuator_lag", "command", time_constant=4e-4)
DEVICES: dict[str, tuple[Device, int]] = {
    "linear": (phantom(), 1),
    "no delay": (phantom().with_interface(delay=0.0), 1),
    "fractional delay": (phantom().with_interface(delay=0.0037), 1),
    "steps and limit": (phantom().with_interface(**STEPPED), 1),
    "filter": (phantom().with_interface(velocity_cutoff_hz=120.0), 1),
    "one mass": (one_mass(1.2e-3, 6e-3, delay=0.002), 1),
    "friction": (phantom().with_physics(coulomb(2e-3)), 3),
    "friction, steps, fraction": (
        phantom().with_interface(**STEPPED).with_physics(coulomb(1e-3)),
        2,
    ),
    "no friction left": (phantom().with_physics(coulomb(0.0)), 1),
}
RUNS = LANES + 5
TICKS = 240


def some_walls() -> Walls:
    """Stiff and soft, damped and not, at several places, on one side and on both."""
    rng = np.random.default_rng(11)
    return Walls(
        rng.uniform(0.0, 40.0, RUNS),
        rng.uniform(0.0, 0.1, RUNS),
        rng.choice([0.0, -5e-4, 3e-4], RUNS),
        rng.random(RUNS) < 0.5,
    )


def some_starts(dof: int) -> list[Start]:
    rng = np.random.default_rng(12)
    return [
        Start(list(1e-3 * rng.normal(size=dof)), list(0.05 * rng.normal(size=dof)))
        for _ in range(RUNS)
    ]


def in_scalar(device: Device, substeps: int, ensemble: Walls, starts: list[Start]) -> ScalarRuns:
    eq, law = equations(device, substeps), wall(1.0, 0.0)
    memories = tuple(start_memory(eq, law, start, 0) for start in starts)
    past = np.array([[m.x[eq.dof]] * 3 for m in memories])
    return ScalarRuns(eq, law.step, ensemble.parameters(), memories, past, 1e300)


def in_lanes(device: Device, substeps: int, ensemble: Walls, starts: list[Start]) -> LaneRuns:
    runs = start_runs(equations(device, substeps), wall(1.0, 0.0), ensemble, starts)
    assert isinstance(runs, LaneRuns)
    return runs


@pytest.mark.parametrize("name", DEVICES)
def test_lanes_equal_scalar_runs(name: str) -> None:
    """State, reading, estimate and extremes to the bit; energies, summed otherwise, to 1e-12.

    Mutations: the sum over the columns taken from the last to the first; the delay line read one
    place on.
    """
    device, substeps = DEVICES[name]
    ensemble, starts = some_walls(), some_starts(device.chain.masses.size)
    weights = window_weights(TICKS // 3)
    lanes_found, lanes = advance_runs(in_lanes(device, substeps, ensemble, starts), weights, 3)
    scalar_found, scalar = advance_runs(in_scalar(device, substeps, ensemble, starts), weights, 3)
    assert isinstance(lanes, LaneRuns)
    assert isinstance(scalar, ScalarRuns)
    n = lanes.eq.states
    assert np.array_equal(lanes.bank[:n].T, [m.x[:n] for m in scalar.memories])
    assert np.array_equal(
        lanes.bank[[signal_row(n, READING), signal_row(n, ESTIMATE)]].T,
        [m.scalars[:2] for m in scalar.memories],
    )
    exact = [*range(FAST_ENERGY + 1, HIGHEST + 1), *range(LOWEST_COMMAND, REVERSALS + 1)]
    assert np.array_equal(lanes_found[:, exact], scalar_found[:, exact])
    for energy in (SLOW_ENERGY, FAST_ENERGY):
        np.testing.assert_allclose(lanes_found[:, energy], scalar_found[:, energy], rtol=1e-12)


def test_scalar_runs_are_simulations() -> None:
    """The ensemble's scalar run is `simulate`, measures included: against the trace itself."""
    device, substeps = DEVICES["friction, steps, fraction"]
    ensemble, starts = some_walls(), some_starts(3)
    weights = window_weights(TICKS)
    found, _ = advance_runs(in_scalar(device, substeps, ensemble, starts), weights, 1)
    for i in (0, 7, RUNS - 1):
        law = wall(*(float(column) for column in ensemble.parameters()[i, :3]),
                   one_sided=bool(ensemble.one_sided[i]))  # fmt: skip
        trace = simulate(
            device, law, duration=TICKS * 1e-3, start=starts[i], substeps=substeps
        ).trace
        x, v, u = trace["position_m1"], trace["velocity_m1"], trace["command"]
        speeds = np.array([trace[f"velocity_m{k}"] for k in (1, 2, 3)])
        third = np.diff(np.concatenate([np.full(3, v[0]), v]), 3)
        kinetic = 0.5 * device.chain.masses @ speeds**2
        assert found[0, [2, 3, 4, 5], i] == pytest.approx([x.min(), x.max(), u.min(), u.max()])
        assert found[0, SLOW_ENERGY, i] == pytest.approx(weights @ kinetic, rel=1e-12)
        assert found[0, FAST_ENERGY, i] == pytest.approx(weights @ third**2, rel=1e-6)
        assert found[0, REVERSALS, i] == np.count_nonzero(v[1:] * v[:-1] < 0.0)


@pytest.mark.parametrize("make", [in_lanes, in_scalar])
def test_prolonging_some_runs_is_running_them_on(make: type) -> None:
    """Two windows, a choice of runs, two windows more: as four windows at once, to the bit."""
    device, substeps = DEVICES["friction, steps, fraction"]
    weights = window_weights(50)
    runs: Runs = make(device, substeps, some_walls(), some_starts(3))
    whole, _ = advance_runs(runs, weights, 4)
    first, half = advance_runs(runs, weights, 2)
    chosen = np.array([3, 4, 17, RUNS - 1])
    second, _ = advance_runs(half.select(chosen), weights, 2)
    assert np.array_equal(first, whole[:2])
    assert np.array_equal(second, whole[2:][:, :, chosen])


def test_what_does_not_fit_the_lanes_goes_one_by_one() -> None:
    """More than Coulomb friction at m1, or any other effect but a lag, is the scalar kernel's."""
    fits = {
        "lag": phantom().with_physics(LAG),
        "friction m1": phantom().with_physics(coulomb(1e-3)),
    }
    beyond = {
        "friction m2": phantom().with_physics(coulomb(1e-3, "m2")),
        "friction twice": phantom().with_physics(coulomb(1e-3), coulomb(1e-3, "m3")),
        "dead band": phantom().with_physics(make_physics("dead_band", "command", width=1e-3)),
        "drag": phantom().with_physics(make_physics("quadratic_drag", "m1", coefficient=1e-3)),
    }
    some = walls(np.ones(3), 0.0)
    for expected, devices in ((LaneRuns, fits), (ScalarRuns, beyond)):
        for device in devices.values():
            runs = start_runs(equations(device), wall(1.0, 0.0), some, [Start(1e-3)])
            assert isinstance(runs, expected)


def brackets(monkeypatch: pytest.MonkeyPatch, workers: int) -> list[object]:
    monkeypatch.setenv("ZWIDTH_THREADS", str(workers))
    assert threads() == workers
    devices = [phantom(), one_mass(1.2e-3, 6e-3, delay=0.004)]
    grids: list[Floats] = [np.linspace(0.0, 0.09, 3), np.linspace(0.0, 0.02, 2)]
    found = find_brackets(devices, grids, Trial(limit_s=8.0), Search(tolerance=1e-2))
    return [bracket for group in found for bracket in group]


def test_results_do_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """1, 2 and 5 threads: equal brackets, verdicts and frequencies to the bit.

    Mutation: a memory shared by the tasks of `LaneRuns.tasks`.
    """
    one, two, five = (brackets(monkeypatch, n) for n in (1, 2, 5))
    assert one == two == five
    device, substeps = DEVICES["friction"]
    runs = in_scalar(device, substeps, some_walls(), some_starts(3))
    weights = window_weights(40)
    assert np.array_equal(
        advance_runs(runs, weights, 2)[0],
        advance_runs(runs, weights, 2, partial(in_parallel, workers=4))[0],
    )


@pytest.mark.parametrize("wanted", ["0", "-1", "two", "1.5"])
def test_a_number_of_threads_that_is_none_is_refused(
    wanted: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ZWIDTH_THREADS", wanted)
    with pytest.raises(ValueError, match="a whole number from 1 on is needed"):
        threads()


def test_an_error_in_a_task_is_raised() -> None:
    def broken() -> int:
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        in_parallel([broken, lambda: 1, lambda: 2], 2)
    assert in_parallel([lambda i=i: i for i in range(7)], 3) == list(range(7))


def test_a_run_that_overflows_leaves_its_neighbours_alone() -> None:
    """One wall blows up, the others end as they do without it, to the bit."""
    device, _ = DEVICES["linear"]
    ensemble, starts = some_walls(), some_starts(3)
    stiff = ensemble.stiffness.copy()
    stiff[3] = 1e5
    weights = window_weights(TICKS)
    plain, _ = advance_runs(in_lanes(device, 1, ensemble, starts), weights, 4)
    blown, _ = advance_runs(
        in_lanes(device, 1, replace(ensemble, stiffness=stiff), starts), weights, 4
    )
    assert not np.isfinite(blown[-1, SLOW_ENERGY, 3])
    others = np.arange(RUNS) != 3
    assert np.array_equal(plain[:, :, others], blown[:, :, others])
