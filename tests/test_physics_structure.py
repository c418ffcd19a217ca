"""Effects that change the linear equations: exact against chains and matrices made apart."""

from dataclasses import replace

import numpy as np
import pytest
from physics_examples import example, phantom
from scipy.linalg import expm

from zwidth.controllers.none import none
from zwidth.controllers.wall import wall
from zwidth.sim.chain import make_chain, matrices
from zwidth.sim.device import Device, DeviceError
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Start, simulate
from zwidth.stability.linear import critical_stiffness

MASSES, DAMPERS = [2e-4, 9e-4, 7e-5], [1e-3, 1e-2, 4e-3]
SPRINGS, LINKS = [217.0, 14.5], [0.06, 1.3e-3]
EXTRA = {"mass": 3e-4, "stiffness": 40.0, "damping": 5e-3}


def _device(n: int, **physics: dict[str, float]) -> Device:
    chain = make_chain(MASSES[:n], DAMPERS[:n], 0.0, SPRINGS[: n - 1], LINKS[: n - 1])
    return Device("chain", "", True, chain)


@pytest.mark.parametrize("n", [1, 3])
def test_an_extra_mode_at_the_end_is_a_chain_of_one_more(n: int) -> None:
    """To rounding, run and boundary. Mutation: the damper of `with_extra_mass` left out."""
    extended = _device(n).with_physics(make_physics("extra_mode", f"m{n}", **EXTRA))
    chain = make_chain(
        [*MASSES[:n], EXTRA["mass"]], [*DAMPERS[:n], 0.0], 0.0,
        [*SPRINGS[: n - 1], EXTRA["stiffness"]], [*LINKS[: n - 1], EXTRA["damping"]],
    )  # fmt: skip
    longer = replace(_device(n), chain=chain)
    runs = [
        simulate(d, wall(10.0, 0.01), duration=0.2, start=Start(1e-3, 0.1), ledger=True)
        for d in (extended, longer)
    ]
    for channel in runs[1].trace.channels:
        if not channel.startswith("work"):
            mine, theirs = (run.trace[channel] for run in runs)
            np.testing.assert_allclose(mine, theirs, rtol=0.0, atol=1e-12 * np.abs(theirs).max())
    assert runs[0].ledger.keys() == runs[1].ledger.keys()
    linear = [critical_stiffness(d, 0.01).stiffness for d in (extended, longer)]
    assert linear[0] == pytest.approx(linear[1], rel=1e-9)


def test_two_extra_modes_and_a_ground_spring_equal_their_matrices() -> None:
    """expm of matrices written out here, 1e-12 over 100 ticks. Mutation: host m1 for m3."""
    device = _device(3).with_physics(
        make_physics("extra_mode", "m1", mass=3e-4, stiffness=40.0, damping=5e-3),
        make_physics("extra_mode", "m3", mass=1e-4, stiffness=6.0, damping=1e-3),
        make_physics("ground_spring", "m3", stiffness=2.5),
        make_physics("ground_spring", "m1", stiffness=1.5),
    )
    assert device.chain.ground_spring == 1.5
    k, c = np.zeros((5, 5)), np.diag([*DAMPERS, 0.0, 0.0])
    links = [(0, 1, 217.0, 0.06), (1, 2, 14.5, 1.3e-3), (0, 3, 40.0, 5e-3), (2, 4, 6.0, 1e-3)]
    for i, j, stiffness, damping in links:
        e = np.eye(5)[i] - np.eye(5)[j]
        k += stiffness * np.outer(e, e)
        c += damping * np.outer(e, e)
    k += np.diag([1.5, 0.0, 2.5, 0.0, 0.0])
    inverse = np.diag(1.0 / np.array([*MASSES, 3e-4, 1e-4]))
    step = expm(1e-3 * np.block([[np.zeros((5, 5)), np.eye(5)], [-inverse @ k, -inverse @ c]]))
    x = np.concatenate([np.linspace(1e-3, -1e-3, 5), np.linspace(-0.1, 0.2, 5)])
    run = simulate(device, wall(0.0, 0.0), duration=0.1, start=Start(list(x[:5]), list(x[5:])))
    names = [f"{q}_m{i + 1}" for q in ("position", "velocity") for i in range(5)]
    found = np.array([run.trace[name] for name in names]).T
    truth = np.array([np.linalg.matrix_power(step, i) @ x for i in range(100)])
    np.testing.assert_allclose(found, truth, rtol=0.0, atol=1e-12 * np.abs(truth).max())


def test_an_extra_mode_stores_and_dissipates_under_its_own_name() -> None:
    device = _device(3).with_physics(make_physics("extra_mode", "m1", **EXTRA))
    run = simulate(device, wall(10.0, 0.01), duration=0.1, start=Start(0.0, 0.1), ledger=True)
    assert run.ledger["b14"] > 0.0


def test_friction_and_extra_modes_live_together() -> None:
    """Three dry masses and two extra ones: five masses, eight locked sets, and all three stop."""
    levels = {"m1": 2e-3, "m2": 3e-3, "m3": 2e-3}
    dry = (make_physics("coulomb_friction", at, level=f) for at, f in levels.items())
    device = phantom().with_physics(*dry, example("extra_mode", "m1"), example("extra_mode", "m3"))
    run = simulate(device, wall(0.0, 0.0), duration=1.0, start=Start(0.0, 0.2), substeps=4)
    assert int(run.trace["at_rest"][-1]) & 0b111 == 0b111


def test_a_rigid_body_takes_what_hangs_on_it_and_ties_it_down() -> None:
    """A spring from m3 to ground holds the rigid body as its k0; an extra mode moves to m1."""
    device = phantom().with_physics(
        make_physics("ground_spring", "m3", stiffness=2.0), example("extra_mode", "m3")
    )
    body = device.rigid()
    assert body.chain.ground_spring == 2.0
    assert [p.at for p in body.physics] == ["m1"]
    assert body.plant().dof == 2


FIVE = make_chain(
    [2e-4, 9e-4, 7e-5, 3e-4, 2e-4], [1e-3, 1e-2, 4e-3, 2e-3, 1e-3], 0.5,
    [217.0, 14.5, 60.0, 30.0], [0.06, 1.3e-3, 5e-3, 4e-3],
)  # fmt: skip


def _states(device: Device, x: np.ndarray, ticks: int, substeps: int = 1) -> np.ndarray:
    n = x.size // 2
    start = Start(list(x[:n]), list(x[n:]))
    run = simulate(device, none(), duration=1e-3 * ticks, start=start, substeps=substeps)
    names = [f"{q}_m{i + 1}" for q in ("position", "velocity") for i in range(n)]
    return np.array([run.trace[name] for name in names]).T


def _exact(
    mass: np.ndarray, c: np.ndarray, k: np.ndarray, f: np.ndarray, x: np.ndarray, ticks: int
):
    """States of M q'' + C q' + K q = f under a constant f, by one expm a tick."""
    n, inverse = f.size, np.linalg.inv(mass)
    whole = np.zeros((2 * n + 1, 2 * n + 1))
    whole[:n, n : 2 * n] = np.eye(n)
    whole[n : 2 * n, :n], whole[n : 2 * n, n : 2 * n] = -inverse @ k, -inverse @ c
    whole[n : 2 * n, -1] = inverse @ f
    step = expm(1e-3 * whole)
    found = [np.append(x, 1.0)]
    for _ in range(ticks - 1):
        found.append(step @ found[-1])
    return np.array(found)[:, : 2 * n]


@pytest.mark.parametrize("i", range(5))
def test_springs_forces_and_further_masses_at_any_mass_are_their_matrices(i: int) -> None:
    """expm of matrices written out here, 1e-11 over 100 ticks.

    Mutations: `Place.index` one off; a spring of m2 brought to the chain's own k0.
    """
    mass, c, k = matrices(FIVE)
    x = np.concatenate([np.linspace(1e-3, -1e-3, 5), np.linspace(-0.1, 0.2, 5)])
    at, host = f"m{i + 1}", np.eye(5)[i]
    device = Device("five", "", True, FIVE)
    spring = make_physics("ground_spring", at, stiffness=2.5)
    force = make_physics("constant_force", at, level=0.03)
    found = _states(device.with_physics(spring, force), x, 100)
    truth = _exact(mass, c, k + 2.5 * np.outer(host, host), 0.03 * host, x, 100)
    np.testing.assert_allclose(found, truth, rtol=0.0, atol=1e-11 * np.abs(truth).max())
    extra = make_physics("extra_mode", at, **EXTRA)
    end = np.append(host, -1.0)
    mass, c, k = (np.pad(matrix, (0, 1)) for matrix in (mass, c, k))
    mass[5, 5] = EXTRA["mass"]
    c += EXTRA["damping"] * np.outer(end, end)
    k += EXTRA["stiffness"] * np.outer(end, end)
    x = np.concatenate([x[:5], [5e-4], x[5:], [0.1]])
    found = _states(device.with_physics(extra), x, 100)
    truth = _exact(mass, c, k, np.zeros(6), x, 100)
    np.testing.assert_allclose(found, truth, rtol=0.0, atol=1e-11 * np.abs(truth).max())
    assert device.with_physics(extra).hosts() == (i,)


@pytest.mark.parametrize("i", range(5))
def test_directional_friction_at_any_mass_is_a_damper_and_a_force_one_way(i: int) -> None:
    """While the mass moves forwards; 1e-6 of the motion at 256 substeps (expm of the same).

    Mutation: `friction_limits` by m1's velocity.
    """
    mass, c, k = matrices(FIVE)
    x = np.concatenate([np.zeros(5), np.full(5, 2.0)])
    values = {"level_plus": 0.02, "level_minus": 0.5, "viscous_plus": 0.03, "viscous_minus": 1.0}
    friction = make_physics("directional_friction", f"m{i + 1}", **values)
    found = _states(Device("five", "", True, FIVE).with_physics(friction), x, 40, 256)
    host = np.eye(5)[i]
    truth = _exact(mass, c + 0.03 * np.outer(host, host), k, -0.02 * host, x, 40)
    assert truth[:, 5 + i].min() > 0.0
    assert np.abs(found - truth).max() < 1e-6 * np.abs(truth).max()


def test_more_masses_than_the_kernel_has_room_for_are_refused() -> None:
    device = Device("five", "", True, FIVE)
    extras = [make_physics("extra_mode", f"m{i}", **EXTRA) for i in range(1, 6)]
    full = device.with_physics(*extras)
    assert full.plant().dof == 10
    lag = make_physics("sensor_lag", "sensor", time_constant=1e-3)
    with pytest.raises(DeviceError, match="5 masses in its chain and 10 added masses or filtered"):
        full.with_physics(lag)
