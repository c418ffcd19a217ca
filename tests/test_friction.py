"""Truths 4 and 6: sticking is exact, free decay, and the basin of a wall with dry friction."""

import numpy as np
import pytest
from engine_examples import Floats, coulomb, one_mass, phantom

from zwidth.controllers.none import none
from zwidth.controllers.wall import wall
from zwidth.sim.device import Device
from zwidth.sim.run import Run, Start, simulate

MASS = 1e-3


def pushed(device: Device, stiffness: float, velocity: float, duration: float) -> Run:
    """Push one mass against a two-sided wall."""
    return simulate(
        device, wall(stiffness, 0.0), duration=duration, start=Start(0.0, velocity), substeps=8,
        bound=100.0 * velocity * np.sqrt(MASS / stiffness),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("device", "share"), [(one_mass(MASS, 1e-3), 1.0), (phantom(), 1.0 - 1e-9)]
)
def test_a_force_within_the_level_moves_nothing_at_all(device: Device, share: float) -> None:
    """|F| <= f_s on m1: not one bit changes in 1 s; for a single mass the bound itself included.

    Mutation: the level of `coulomb_bounds` lowered by 1e-6 of itself.
    """
    level = 0.02
    bound = share * level
    forces = np.clip(np.random.default_rng(3).normal(0.0, level, 1000), -bound, bound)
    assert np.count_nonzero(np.abs(forces) == bound) > 100
    run = simulate(
        device.with_physics(coulomb(level)), none(), duration=1.0, start=Start(0.123),
        disturbance=forces, substeps=3,
    )  # fmt: skip
    assert np.all(run.trace["position_m1"] == 0.123)
    assert not run.trace["velocity_m1"].any()


def test_a_stuck_mass_does_not_creep_while_its_neighbours_swing() -> None:
    """m1 stuck under links that pull with up to half its level: exactly where it was, for 2 s.

    Mutation: the propagator of the free chain used for stuck masses (`mask` left 0).
    """
    k = phantom().chain.link_springs[0]
    run = simulate(
        phantom().with_physics(coulomb(0.02)), none(), duration=2.0,
        start=Start([1e-3, 1e-3 + 0.01 / k, 1e-3]), substeps=4,
    )  # fmt: skip
    assert np.all(run.trace["position_m1"] == 1e-3)
    assert np.ptp(run.trace["position_m2"][:200]) > 0.009 / k


def test_equilibria_fill_a_band_of_two_levels_over_the_stiffness() -> None:
    """Width 2 f_s / K in a wall K, its ends to 1e-9: within they stay to the bit, beyond they move.

    Mutation: the level of `coulomb_bounds` at rest multiplied by 1.000001.
    """
    level, stiffness = 0.015, 25.0
    device = phantom().with_physics(coulomb(level))
    for share in (-1.0 + 1e-9, -0.6, 0.0, 0.3, 1.0 - 1e-9, -1.0 - 1e-9, 1.0 + 1e-9, 1.4):
        x = share * level / stiffness
        run = simulate(device, wall(stiffness, 0.05, 0.0), duration=0.05, start=Start(x))
        stays = bool(np.all(run.trace["position_m1"] == x))
        assert stays == (abs(share) < 1.0)


def test_free_decay_loses_four_levels_over_the_stiffness_each_cycle() -> None:
    """1e-3 of the loss; at the end it sticks within the band, for good.

    Turning points lie 2 f_c / k lower each half cycle. Mutation: 0.5 of the level in
    `coulomb_bounds` while sliding.
    """
    level, spring = 0.01, 40.0
    device = one_mass(MASS, 0.0, spring, coulomb(level))
    run = simulate(device, none(), duration=1.0, start=Start(0.011), substeps=50, fine=True)
    assert run.fine is not None
    x, v = run.fine["position_m1"], run.fine["velocity_m1"]
    turns = np.abs(x[np.flatnonzero(np.diff(np.sign(v)) != 0)])
    turns = turns[np.concatenate([[True], np.abs(np.diff(turns)) > level / spring])]
    losses = -np.diff(turns[:20])
    assert losses == pytest.approx(2.0 * level / spring, rel=1e-3)
    assert v[-1] == 0.0
    assert abs(x[-1]) <= level / spring
    assert np.all(x[v == 0.0][-1000:] == x[-1])


def test_viscous_decay_is_geometric() -> None:
    """x(t + T_d) = x(t) exp(-b T_d / 2 m) with T_d of 64 ticks, 1e-11 of the start.

    Mutation: the ground damper left out of `sim.chain.matrices`.
    """
    damper, period = 8e-3, 0.064
    rate = damper / (2.0 * MASS)
    device = one_mass(MASS, damper, MASS * ((2.0 * np.pi / period) ** 2 + rate**2))
    x = simulate(device, none(), duration=0.5, start=Start(0.01, 0.3)).trace["position_m1"]
    assert x[64:] == pytest.approx(x[:-64] * np.exp(-rate * period), rel=0.0, abs=1e-13)


def stops(level: float, spring: float, x: float, v: float) -> Floats:
    """Exact positions at each tick of 0.05 s, from stop to stop of one mass on a spring."""
    omega, ticks = np.sqrt(spring / MASS), np.arange(51) * 1e-3
    found, began = np.full(51, np.nan), 0.0
    while began < ticks[-1]:
        side = np.sign(v) if v != 0.0 else -np.sign(x)
        if v == 0.0 and abs(x) <= level / spring:
            found[ticks >= began] = x
            break
        rest = -side * level / spring
        stop = began + (np.arctan2(v / omega, x - rest) % np.pi or np.pi) / omega
        inside = (ticks >= began) & (ticks < stop)
        phase = omega * (ticks[inside] - began)
        found[inside] = rest + (x - rest) * np.cos(phase) + v / omega * np.sin(phase)
        phase = omega * (stop - began)
        x = rest + (x - rest) * np.cos(phase) + v / omega * np.sin(phase)
        v, began = 0.0, stop
    return found


def test_friction_is_of_first_order_whatever_the_phase_of_its_stops() -> None:
    """Slope >= 0.9 over 40 seeds, against the closed form from stop to stop.

    Mutation: `slide` without the force that stops a mass (only the bounds): no convergence.
    """
    level, spring, counts = 0.02, 60.0, np.array([1, 2, 4, 8, 16, 32])
    device = one_mass(MASS, 0.0, spring, coulomb(level))
    rng, errors = np.random.default_rng(5), np.zeros(counts.size)
    for _ in range(40):
        x, v = rng.uniform(-2e-3, 2e-3), rng.uniform(-0.3, 0.3)
        truth = stops(level, spring, x, v)
        for i, n in enumerate(counts):
            run = simulate(device, none(), duration=0.051, start=Start(x, v), substeps=int(n))
            errors[i] += np.abs(run.trace["position_m1"] - truth).max()
    assert -np.polyfit(np.log(counts), np.log(errors), 1)[0] >= 0.9
    assert errors[-1] / 40 < 1e-6


@pytest.mark.parametrize("share", [0.0, 0.5])
@pytest.mark.parametrize("angle", [0.01, 0.03, 0.08])
def test_the_basin_of_a_wall_with_dry_friction(angle: float, share: float) -> None:
    """V* = 4 f_c / (pi (K tau - b)) within 1 %: 0.99 V* comes to rest, 1.01 V* grows.

    tau = T/2 (no further delay), omega tau = angle, b = share K tau. Describing function of dry
    friction, Diolaiti et al., IEEE T. Robotics 22(2), 2006. Mutation: the wall's command delayed
    by one more tick (V* a third).
    """
    tau = 0.5e-3
    stiffness = MASS * (angle / tau) ** 2
    level, damping = 0.02, share * stiffness * tau
    device = one_mass(MASS, damping, 0.0, coulomb(level))
    limit = 4.0 * level / (np.pi * (stiffness * tau - damping))
    patience = 8.0 * 2.0 * MASS / (stiffness * tau - damping)  # e-folds of the distance from V*
    below = pushed(device, stiffness, 0.99 * limit, patience)
    above = pushed(device, stiffness, 1.01 * limit, patience)
    assert below.trace["velocity_m1"][-1] == 0.0
    assert np.abs(above.trace["velocity_m1"]).max() > 1.5 * limit


def test_amplitude_and_level_scale_out_to_the_bit() -> None:
    """Start and level times 2^10: every state times 2^10, exactly.

    Mutation: any absolute threshold in the friction, such as `abs(v) < 1e-9` for rest.
    """
    runs: list[Run] = []
    for scale in (1.0, 1024.0):
        device = phantom().with_physics(coulomb(scale * 1e-3), coulomb(scale * 5e-4, "m2"))
        start = Start(scale * 1e-3)
        runs.append(simulate(device, wall(20.0, 0.03), duration=0.5, start=start, substeps=4))
    one, other = runs
    assert np.count_nonzero(one.trace["at_rest"]) > 10
    for name in ("position_m1", "velocity_m2", "command"):
        assert np.array_equal(1024.0 * one.trace[name], other.trace[name])
    assert np.array_equal(one.trace["at_rest"], other.trace["at_rest"])
