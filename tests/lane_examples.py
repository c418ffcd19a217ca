"""Devices side by side in lanes, held against each alone."""

from dataclasses import replace

import numpy as np
import pytest

from zwidth.controllers.of_law import controller_of
from zwidth.sim.device import Device
from zwidth.sim.ensemble import Runs, Walls, advance_runs, start_runs
from zwidth.sim.group import member
from zwidth.sim.growth import window_weights
from zwidth.sim.kernel import SCALARS
from zwidth.sim.lane_type import WIDTH
from zwidth.sim.law import Law
from zwidth.sim.physics.effect import Physics
from zwidth.sim.run import Run, Start, simulate
from zwidth.sim.windows import FAST_ENERGY, REVERSALS, SLOW_ENERGY

RUNS = WIDTH + 5
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


def varied(device: Device, physics: Physics | None, members: int) -> list[Device]:
    """Return devices of one structure whose masses, springs and effects differ."""
    rng = np.random.default_rng(13)
    found: list[Device] = []
    for _ in range(members):
        chain = device.chain
        n = chain.masses.size
        size = 1.0 + 0.1 * rng.uniform(-1.0, 1.0, 2 * n - 1)
        own = device.with_chain(
            chain._replace(
                masses=chain.masses * size[:n], link_springs=chain.link_springs * size[n:]
            )
        )
        if physics is not None:
            same = physics.effect.name == "loop_delay"  # which changes the substeps, too
            scale = 1.0 if same else 1.0 + 0.1 * rng.uniform(-1.0, 1.0)
            values = {name: scale * value for name, value in physics.values.items()}
            kept = {"odd", "over_1", "over_2"} & set(values)  # which say what the others are
            values |= {name: physics.values[name] for name in kept}
            own = own.with_physics(replace(physics, values=values))
        found.append(own)
    return found


def started(devices: list[Device], substeps: int, ensemble: Walls, starts: list[Start]) -> Runs:
    each = [member(device, substeps) for device in devices]
    return start_runs(each, np.arange(RUNS) % len(devices), ensemble, starts)


def alone(device: Device, substeps: int, ensemble: Walls, i: int, start: Start) -> Run:
    """Return the run that the scalar kernel makes of one member."""
    stiffness, damping, position, one_sided = ensemble.parameters()[i, :4].tolist()
    law = controller_of(ensemble.law, stiffness, damping, position, bool(one_sided))
    return simulate(
        device,
        law,
        duration=TICKS * device.interface.period,
        start=start,
        substeps=substeps,
        bound=1e300,
    )


def assert_equal_runs(
    devices: list[Device], substeps: int, runs: range, law: Law | None = None
) -> None:
    """State, reading, command and extremes to the bit; energies, summed otherwise, to 1e-12."""
    ensemble, starts = (
        some_walls(),
        some_starts(devices[0].chain.masses.size + len(devices[0].hung())),
    )
    ensemble = replace(ensemble, law=law or Law())
    weights = window_weights(TICKS)
    found, after = advance_runs(started(devices, substeps, ensemble, starts), weights, 1)
    for i in runs:
        device = devices[i % len(devices)]
        one = alone(device, substeps, ensemble, i, starts[i])
        n = device.plant().size
        assert np.array_equal(after.bank.x[:n, i], one.memory.x[:n])
        assert np.array_equal(after.bank.internal[:, i], one.memory.internal)
        assert np.array_equal(after.bank.scalars[:3, i], one.memory.scalars[:3])
        assert np.array_equal(after.bank.scalars[SCALARS:, i], one.memory.scalars[SCALARS:])
        assert np.array_equal(after.bank.counters, one.memory.counters)
        trace = one.trace
        x, v, u = trace["position_m1"], trace["velocity_m1"], trace["command"]
        assert found[0, 2:6, i].tolist() == [x.min(), x.max(), u.min(), u.max()]
        masses = np.diag(device.plant().matrices.mass)
        names = [c for c in trace.channels if c.startswith("velocity_") and c[-1].isdigit()]
        speeds = np.array([trace[name] for name in names])
        kinetic = 0.5 * masses @ speeds**2
        third = np.diff(np.concatenate([np.full(3, v[0]), v]), 3)
        assert found[0, SLOW_ENERGY, i] == pytest.approx(weights @ kinetic, rel=1e-12)
        assert found[0, FAST_ENERGY, i] == pytest.approx(weights @ third**2, rel=1e-6)
        assert found[0, REVERSALS, i] == np.count_nonzero(v[1:] * v[:-1] < 0.0)
