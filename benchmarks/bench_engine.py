"""The engine and its peers: time a tick, a substep, a run in lanes, all of Fig. 6.

    python -m pytest benchmarks/bench_engine.py --benchmark-only --benchmark-columns=median -s

Every figure is the median of many rounds over one call of many ticks, divided by the ticks; -s
prints it in its own unit, --benchmark-json FILE keeps it as extra info. Run on an idle machine.
The peers do the same work on the same device in the same process.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from scipy.integrate import solve_ivp

from zwidth.controllers.wall import wall
from zwidth.jobs.parallel import in_parallel
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.ensemble import advance_runs, start_runs, walls
from zwidth.sim.group import member
from zwidth.sim.growth import window_weights
from zwidth.sim.kernel import advance, scratch
from zwidth.sim.modal import to_chain
from zwidth.sim.physics import make_physics
from zwidth.sim.plant import hold
from zwidth.sim.run import Start, prepare
from zwidth.stability.bisection import find_brackets
from zwidth.stability.linear import boundary, critical_stiffness, last_stable_damping

LAW = wall(14.0, 0.03)
TICKS = 20_000
DELAYS = (0.002, 0.004, 0.008)


@pytest.fixture(scope="module")
def phantom() -> Device:
    """Return the device of Table I: three masses, 2 ms."""
    return load_device("phantom_1_0")


def report(
    benchmark: BenchmarkFixture, action: Callable[[], Any], count: int, unit: str, rounds: int = 30
) -> None:
    """Time an action of `count` units and say what one costs, in ns, us, ms or s."""
    benchmark.pedantic(action, rounds=rounds, warmup_rounds=2)
    if benchmark.stats is None:
        return
    scale = {"ns": 1e9, "us": 1e6, "ms": 1e3, "s": 1.0}[unit.split()[0]]
    stats: Any = benchmark.stats.stats
    cost, best = stats.median * scale / count, stats.min * scale / count
    benchmark.extra_info |= {"cost": cost, "best": best, "unit": unit}
    print(f"\n{benchmark.name}: median {cost:.3g} {unit}, best {best:.3g}")


def run_of(
    device: Device, substeps: int = 1, energy: bool = False, ledger: bool = False
) -> Callable[[], None]:
    """Return an action that runs TICKS substeps in one call of the scalar kernel."""
    ticks = TICKS // substeps
    setup = prepare(
        device, LAW, duration=ticks * 1e-3, start=Start(1e-3), substeps=substeps, energy=energy,
        ledger=ledger,
    )  # fmt: skip
    record = np.zeros((ticks if energy else 0, len(setup.channel_units)))
    space, fine = scratch(setup.eq), np.zeros((0, setup.eq.states))
    start = setup.memory.x.copy()

    def run() -> None:
        setup.memory.x[:] = start
        advance(
            setup.eq, LAW.step, LAW.parameters, setup.memory, space, ticks, setup.external, 1e6,
            record, fine, setup.energy,
        )  # fmt: skip

    return run


def test_linear_tick(benchmark: BenchmarkFixture, phantom: Device) -> None:
    report(benchmark, run_of(phantom), TICKS, "ns per tick")


def test_linear_tick_recorded_with_energy(benchmark: BenchmarkFixture, phantom: Device) -> None:
    report(benchmark, run_of(phantom, energy=True), TICKS, "ns per tick")


@pytest.mark.parametrize("level", [0.02, 1e-6], ids=["sticks and slips", "slips"])
def test_friction_substep(benchmark: BenchmarkFixture, phantom: Device, level: float) -> None:
    device = phantom.with_physics(make_physics("coulomb_friction", "m1", level=level))
    report(benchmark, run_of(device, 10), TICKS, "ns per substep")


def test_smooth_substep(benchmark: BenchmarkFixture, phantom: Device) -> None:
    cubic = make_physics("cubic_stiffness", "link12", coefficient=1e4)
    report(benchmark, run_of(phantom.with_physics(cubic), 10), TICKS, "ns per substep")


def test_ledger_substep(benchmark: BenchmarkFixture, phantom: Device) -> None:
    report(benchmark, run_of(phantom, 10, ledger=True), TICKS, "ns per substep")


@pytest.mark.parametrize("workers", [1, 2])
def test_lanes_over_stiffness_and_damping(
    benchmark: BenchmarkFixture, phantom: Device, workers: int
) -> None:
    """1024 runs of 4 s, from far below the boundary to just above it."""
    stiffness, damping = np.meshgrid(np.linspace(0.5, 15.0, 32), np.linspace(0.0, 0.08, 32))
    some = walls(stiffness.ravel(), damping.ravel())
    runs = start_runs([member(phantom, 1)], np.zeros(1, np.int64), some, [Start(1e-3)])
    weights = window_weights(500)
    together = partial(in_parallel, workers=workers)
    report(
        benchmark, lambda: advance_runs(runs, weights, 8, together, workers), 1024 * 4000,
        "ns per tick and run", 10,
    )  # fmt: skip


def test_figure_6_in_the_time_domain(benchmark: BenchmarkFixture, phantom: Device) -> None:
    """300 bisections to 0.05 %, on all cores."""
    devices = [phantom.with_interface(delay=delay) for delay in DELAYS]
    lasts = [last_stable_damping(device) for device in devices]
    grids = [np.linspace(0.0, 0.999 * last, 100) for last in lasts if last is not None]
    assert len(grids) == 3
    report(benchmark, lambda: find_brackets(devices, grids), 1, "s", 10)


def test_linear_boundary_per_damping(benchmark: BenchmarkFixture, phantom: Device) -> None:
    dampings = np.linspace(0.0, 0.099, 20)
    report(benchmark, lambda: boundary(phantom, dampings), 20, "ms per damping", 10)


def test_modal_to_chain(benchmark: BenchmarkFixture, phantom: Device) -> None:
    """Table I into three masses."""
    modal = phantom.modal
    assert modal is not None
    report(benchmark, lambda: to_chain(modal), 1, "ms", 10)


@pytest.mark.filterwarnings("ignore:stability_margins:UserWarning")
def test_peer_control_margin(benchmark: BenchmarkFixture, phantom: Device) -> None:
    """python-control's gain margin of the loop with the damper closed, B = 0.03."""
    control = pytest.importorskip("control")
    plant, period = phantom.plant(), phantom.interface.period
    position = np.eye(plant.size)[:1]
    held = control.c2d(control.ss(plant.a, plant.b[:, :1], position, 0.0), period, "zoh")
    delay = control.tf([1.0], [1.0, 0.0, 0.0], period)

    def margin() -> float:
        damper = control.tf([0.03, -0.03], [period, 0.0], period)
        return control.margin(control.feedback(delay * control.tf(held), damper))[0]

    expected = critical_stiffness(phantom, 0.03).stiffness
    assert margin() == pytest.approx(expected, rel=1e-3)
    report(benchmark, margin, 1, "ms per damping", 10)


def test_peer_solve_ivp(benchmark: BenchmarkFixture, phantom: Device) -> None:
    """scipy, one tick of the linear chain under a held command, rtol 1e-9."""
    plant = phantom.plant()
    start = np.concatenate([[1e-3, 1.1e-3, 0.9e-3], np.zeros(3)])
    force = plant.b[:, 0] * 0.01

    def tick() -> Any:
        return solve_ivp(
            lambda t, x: plant.a @ x + force, (0.0, 1e-3), start, rtol=1e-9, atol=1e-12
        )

    report(benchmark, tick, 1, "us per tick", 100)


def test_peer_mujoco(benchmark: BenchmarkFixture, phantom: Device) -> None:
    """MuJoCo, the same chain as sliders joined by tendons, steps of 50 us."""
    mujoco = pytest.importorskip("mujoco")
    mass, damper, _, spring, link = phantom.chain
    bodies = "".join(
        f'<body><joint name="q{i}" type="slide" axis="1 0 0" damping="{float(damper[i])!r}"/>'
        f'<geom type="sphere" size="0.01" mass="{float(mass[i])!r}" contype="0"/></body>'
        for i in range(3)
    )
    tendons = "".join(
        f'<fixed stiffness="{float(spring[i])!r}" damping="{float(link[i])!r}" springlength="0">'
        f'<joint joint="q{i}" coef="1"/><joint joint="q{i + 1}" coef="-1"/></fixed>'
        for i in range(2)
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="5e-5" gravity="0 0 0" integrator="implicitfast"/>'
        f"<worldbody>{bodies}</worldbody><tendon>{tendons}</tendon></mujoco>"
    )
    data = mujoco.MjData(model)
    data.qpos[:] = [1e-3, 1.1e-3, 0.9e-3]
    exact = hold(phantom.plant(), 0.01)[0] @ np.concatenate([data.qpos, np.zeros(3)])
    mujoco.mj_step(model, data, 200)
    assert data.qpos == pytest.approx(exact[:3], rel=1e-2)
    report(benchmark, lambda: mujoco.mj_step(model, data, 2000), 2000, "us per step of 50 us")
