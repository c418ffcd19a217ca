"""Runs side by side equal the runs one by one, bit for bit, however they are grouped."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from engine_examples import Floats, coulomb, one_mass, phantom
from estimator_examples import SET
from lane_examples import RUNS, TICKS, assert_equal_runs, some_starts, some_walls, started, varied
from physics_examples import EVERYWHERE, example

from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.device import Device
from zwidth.sim.ensemble import advance_runs
from zwidth.sim.growth import window_weights
from zwidth.sim.law import Law
from zwidth.sim.physics import make_physics
from zwidth.sim.windows import SLOW_ENERGY
from zwidth.stability.bisection import Search, find_brackets
from zwidth.stability.judging import Trial

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
    "second-order filter": (
        phantom().with_interface(velocity_cutoff_hz=90.0, velocity_order=2, encoder_step=3e-6),
        1,
    ),
    "several rates": (
        phantom().with_interface(
            period=2.5e-4,
            velocity_ticks=4,
            position_ticks=3,
            velocity_cutoff_hz=150.0,
            velocity_order=2,
            delay=4e-4,
        ),
        1,
    ),
    "velocity in steps": (
        phantom().with_interface(velocity_step=0.02, velocity_cutoff_hz=60.0),
        1,
    ),
    **{f"estimator {n}": (phantom().with_interface(**s), 1) for n, s in SET.items()},
    "force sensor": (
        phantom().with_interface(force_sensor="link12", force_gain=0.4, delay=5e-4),
        1,
    ),
    "one mass": (one_mass(1.2e-3, 6e-3, delay=0.002), 1),
    "friction": (phantom().with_physics(coulomb(2e-3)), 3),
    "friction, steps, fraction": (
        phantom().with_interface(**STEPPED).with_physics(coulomb(1e-3)),
        2,
    ),
    "no friction left": (phantom().with_physics(coulomb(0.0)), 1),
    "friction everywhere": (
        phantom().with_physics(coulomb(4e-3), coulomb(2e-3, "m2"), coulomb(1e-3, "m3")),
        2,
    ),
}


@pytest.mark.parametrize("name", DEVICES)
def test_lanes_equal_the_scalar_kernel(name: str) -> None:
    """Mutations: the sum over the columns from the last to the first; the delay line one place on;
    the propagators at work not changed where a lane's locked set changes.
    """
    device, substeps = DEVICES[name]
    assert_equal_runs([device], substeps, range(RUNS))


@pytest.mark.parametrize("name", ["linear", "steps and limit", "several rates", "friction"])
@pytest.mark.parametrize(
    "law",
    [Law("texture", 4e-4, 0.7), Law("region", width=6e-4), Law("guarded", most_damping=0.05)],
    ids=lambda law: law.kind,
)
def test_every_law_in_lanes_equals_its_controller(name: str, law: Law) -> None:
    """Mutations: the account of a guarded wall not handed on; the grating without its share."""
    device, substeps = DEVICES[name]
    assert_equal_runs([device], substeps, range(RUNS), law)


@pytest.mark.parametrize(("name", "place"), EVERYWHERE)
def test_every_effect_at_every_place_in_lanes_equals_the_scalar_kernel(
    name: str, place: str
) -> None:
    """Members differ in masses, springs and the effect's numbers.

    Mutations: a bare `if` of Python in the law in place of `select`; the plant of the first member
    for all in `lane_choice`.
    """
    devices = varied(phantom(), example(name, place), RUNS)
    assert_equal_runs(devices, 2, range(0, RUNS, 4))


def test_prolonging_some_runs_is_running_them_on() -> None:
    """Two windows, a choice of runs, two windows more: as four windows at once, to the bit."""
    device, substeps = DEVICES["friction, steps, fraction"]
    weights = window_weights(50)
    runs = started([device], substeps, some_walls(), some_starts(3))
    whole, _ = advance_runs(runs, weights, 4)
    first, half = advance_runs(runs, weights, 2)
    chosen = np.array([3, 4, 17, RUNS - 1])
    second, _ = advance_runs(half.select(chosen), weights, 2)
    assert np.array_equal(first, whole[:2])
    assert np.array_equal(second, whole[2:][:, :, chosen])


def test_devices_of_several_structures_make_no_ensemble() -> None:
    """Mutation: `stack` without its look at the structures."""
    devices = [phantom(), phantom().with_physics(coulomb(1e-3))]
    with pytest.raises(ValueError, match="differ in structure"):
        started(devices, 1, some_walls(), some_starts(3))


def brackets(monkeypatch: pytest.MonkeyPatch, workers: int) -> list[object]:
    monkeypatch.setenv("ZWIDTH_THREADS", str(workers))
    assert threads() == workers
    devices = [phantom(), one_mass(1.2e-3, 6e-3, delay=0.004)]
    grids: list[Floats] = [np.linspace(0.0, 0.09, 3), np.linspace(0.0, 0.02, 2)]
    found = find_brackets(devices, grids, Trial(limit_s=8.0), Search(tolerance=1e-2))
    return [bracket for group in found for bracket in group]


def test_results_do_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """1, 2 and 5 threads: equal brackets, verdicts and frequencies to the bit.

    Mutation: a memory shared by the tasks of `Runs.tasks`.
    """
    one, two, five = (brackets(monkeypatch, n) for n in (1, 2, 5))
    assert one == two == five
    device, substeps = DEVICES["friction"]
    runs = started([device], substeps, some_walls(), some_starts(3))
    weights = window_weights(40)
    assert np.array_equal(
        advance_runs(runs, weights, 2)[0],
        advance_runs(runs, weights, 2, partial(in_parallel, workers=4), 4)[0],
    )


@pytest.mark.parametrize("wanted", ["0", "-1", "two", "1.5"])
def test_a_number_of_threads_that_is_none_is_refused(
    wanted: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ZWIDTH_THREADS", wanted)
    with pytest.raises(ValueError, match="it must be a whole number of 1 or more"):
        threads()


def test_an_error_in_a_task_is_raised() -> None:
    def broken() -> int:
        raise RuntimeError("broken")

    with pytest.raises(RuntimeError, match="broken"):
        in_parallel([broken, lambda: 1, lambda: 2], 2)
    assert in_parallel([lambda i=i: i for i in range(7)], 3) == list(range(7))


def test_tasks_that_ask_for_tasks_end_on_few_threads() -> None:
    """Five deep, each of three. Mutation: a caller that waits for threads instead of working."""

    def deep(left: int) -> int:
        if left == 0:
            return 1
        return sum(in_parallel([partial(deep, left - 1)] * 3, 2))

    assert deep(5) == 3**5


@pytest.mark.parametrize("name", ["linear", "friction everywhere"])
def test_a_run_that_overflows_leaves_its_neighbours_alone(name: str) -> None:
    """One wall blows up, the others end as they do without it, to the bit."""
    device, _ = DEVICES[name]
    ensemble, starts = replace(some_walls(), one_sided=np.zeros(RUNS, np.bool_)), some_starts(3)
    stiff = ensemble.stiffness.copy()
    stiff[3] = 1e5
    weights = window_weights(TICKS)
    plain, _ = advance_runs(started([device], 2, ensemble, starts), weights, 4)
    blown, _ = advance_runs(
        started([device], 2, replace(ensemble, stiffness=stiff), starts), weights, 4
    )
    assert not np.isfinite(blown[-1, SLOW_ENERGY, 3])
    others = np.arange(RUNS) != 3
    assert np.array_equal(plain[:, :, others], blown[:, :, others])
