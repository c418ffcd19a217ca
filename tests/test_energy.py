"""Truth 8: energy stays, the ledger closes, and every entry is what an integral says it is.

A sum that closes can hide two entries that exchanged their values, so each is also held against
an integral over the finely recorded states that shares nothing with the ledger but the definition:
Simpson's rule over the power, or force times displacement where the force is held.
"""

from typing import Any

import numpy as np
import pytest
from engine_examples import Floats, coulomb, phantom
from scipy.integrate import simpson

from zwidth.controllers.none import none
from zwidth.controllers.wall import wall
from zwidth.sim.chain import make_chain, negative_dampers
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Run, Start, simulate

SUBSTEPS, TICKS = 32, 120
CHAIN = make_chain([2e-4, 9e-4, 7e-5], [4e-3, 1e-2, 2e-3], 1.5, [220.0, 15.0], [2e-2, 3e-3])
EFFECTS = {
    "coulomb_friction_m1": coulomb(3e-3),
    "coulomb_friction_m3": coulomb(1e-3, "m3"),
    "quadratic_drag_m2": make_physics("quadratic_drag", "m2", coefficient=5e-3),
    "cubic_stiffness_ground": make_physics("cubic_stiffness", "ground", coefficient=2e5),
    "cubic_stiffness_link12": make_physics("cubic_stiffness", "link12", coefficient=3e6),
    "constant_force_m1": make_physics("constant_force", "m1", level=4e-3),
}
LAG = make_physics("actuator_lag", "command", time_constant=6e-4)
OUTSIDE = ("wall", "actuator_lag")


def device(delay: float = 0.0, *physics: str, lag: bool = False) -> Device:
    named = tuple(EFFECTS[name] for name in physics)
    return Device("-", "-", True, CHAIN, Interface(delay=delay), (*named, *((LAG,) * lag)))


def driven(some: Device) -> Run:
    forces = 0.01 * np.random.default_rng(2).normal(size=(TICKS, 3))
    return simulate(
        some, wall(15.0, 0.02, -1e-4, one_sided=True), duration=TICKS * 1e-3,
        start=Start([1e-3, 1.2e-3, 0.7e-3], [0.1, 0.0, -0.1]), disturbance=forces,
        substeps=SUBSTEPS, ledger=True, fine=True,
    )  # fmt: skip


class Fine:
    """All states at every substep, starts included: rows (substeps + 1, 3) and held values."""

    def __init__(self, run: Run) -> None:
        assert run.fine is not None
        self.h = 1e-3 / SUBSTEPS
        self.q, self.v = (
            np.column_stack(
                [
                    np.concatenate([run.trace[f"{name}_m{i}"][:1], run.fine[f"{name}_m{i}"]])
                    for i in (1, 2, 3)
                ]
            )
            for name in ("position", "velocity")
        )

    def held(self, values: Floats) -> Floats:
        """Values of a tick, for each of its substeps."""
        return np.repeat(values, SUBSTEPS, axis=0)

    def integral(self, power: Floats) -> float:
        """Simpson's rule, whose pairs of substeps never cross a change of the held command."""
        return float(simpson(power, dx=self.h))


def imbalance(run: Run, at_the_end: float) -> float:
    """What is missing between work and stored energy, over the sum of |work|.

    The ledger stands at the end of the last tick, the trace's last row at its start.
    """
    entries = {name: value for name, value in run.ledger.items() if name not in OUTSIDE}
    turned = sum(abs(value) for value in entries.values())
    work = entries.pop("motor") + entries.pop("disturbance")
    gained = at_the_end - run.trace["stored_energy"][0]
    return abs(gained - (work - sum(entries.values()))) / turned


def energy_of(q: Floats, v: Floats) -> Floats:
    """Kinetic energy and energy of the springs, from the chain's definition."""
    m, _, k0, k, _ = CHAIN
    return 0.5 * (v**2 @ m + k0 * q[:, 0] ** 2 + np.diff(q, axis=1) ** 2 @ k)


def test_energy_stays_where_nothing_takes_it() -> None:
    """1e-10 over 10 s, 10 000 ticks. Mutation: a ground damper of 1e-13 N m s/rad in `assemble`."""
    chain = make_chain([2e-4, 9e-4, 7e-5], [0.0] * 3, 0.0, [217.0, 14.6], [0.0] * 2)
    some = Device("-", "-", True, chain, Interface())
    run = simulate(some, none(), duration=10.0, start=Start([1e-3, 0.0, -1e-3], 0.1), energy=True)
    stored = run.trace["stored_energy"]
    assert np.abs(stored / stored[0] - 1.0).max() < 1e-10


def test_the_stored_energy_is_that_of_masses_and_springs() -> None:
    run = driven(device(0.0023, *EFFECTS, lag=True))
    q, v = (
        np.column_stack([run.trace[f"{name}_m{i}"] for i in (1, 2, 3)])
        for name in ("position", "velocity")
    )
    assert run.trace["stored_energy"] == pytest.approx(energy_of(q, v), rel=1e-12)


SINGLE = [
    *((0.002, (name,), False) for name in EFFECTS),
    (0.0, (), False),
    (0.0023, (), False),
    (0.002, (), True),
    (0.0023, (), True),
    (0.0023, tuple(EFFECTS), True),
]


@pytest.mark.parametrize(("delay", "names", "lag"), SINGLE)
def test_the_ledger_closes(delay: float, names: tuple[str, ...], lag: bool) -> None:
    """stored - stored at the start = motor + disturbance - all else, 1e-9 of the sum of |work|.

    Mutations: the held friction left out of `add_work`'s w (1e-3); forms of the free chain used
    for stuck masses (1e-4); work of the disturbance booked before the segment's end (1e-2).
    """
    run = driven(device(delay, *names, lag=lag))
    assert set(run.ledger) == {
        "motor", "wall", "disturbance", "actuator_lag", "b1", "b2", "b3", "b12", "b23", *names,
    }  # fmt: skip
    fine = Fine(run)
    assert imbalance(run, float(energy_of(fine.q[-1:], fine.v[-1:])[0])) < 1e-9


def test_the_ledger_closes_with_a_negative_damper() -> None:
    """The PHANToM's own chain: b1 < 0 gives energy, booked as what it is. 1e-9."""
    assert list(negative_dampers(phantom().chain)) == ["b1"]
    run = simulate(
        phantom(), wall(12.0, 0.03), duration=0.5, start=Start(1e-3), ledger=True, fine=True
    )
    assert run.fine is not None
    q, v = (
        np.array([[run.fine[f"{name}_m{i}"][-1] for i in (1, 2, 3)]])
        for name in ("position", "velocity")
    )
    m, _, _, k, _ = phantom().chain
    end = 0.5 * (v**2 @ m + np.diff(q, axis=1) ** 2 @ k)
    assert run.ledger["b1"] < 0.0
    assert imbalance(run, float(end[0])) < 1e-9


@pytest.mark.parametrize("delay", [0.002, 0.0025])
@pytest.mark.parametrize(("names", "tolerance"), [((), 1e-8), (tuple(EFFECTS), 1e-5)])
def test_motor_disturbance_and_dampers_against_integrals(
    delay: float, names: tuple[str, ...], tolerance: float
) -> None:
    """1e-12 where a force is held, 1e-8 of each damper (1e-5 where forces jump inside a tick).

    Mutations: two dampers exchanged in `_dampers`; motor and disturbance exchanged; the segment's
    earlier command booked for all of the tick.
    """
    run = driven(device(delay, *names))
    fine, ledger = Fine(run), run.ledger
    command = np.concatenate([np.zeros(3), run.trace["command"]])[: TICKS + 3]
    whole = round(delay * 1e3 - 0.25)
    newer, older = command[3 - whole :][:TICKS], command[2 - whole :][:TICKS]
    split = round((delay * 1e3 - whole) * SUBSTEPS)
    held = np.repeat(newer[:, None], SUBSTEPS, axis=1)
    held[:, :split] = older[:, None]
    motor = held.ravel() @ np.diff(fine.q[:, 0])
    assert ledger["motor"] == pytest.approx(motor, rel=1e-12)
    forces = 0.01 * np.random.default_rng(2).normal(size=(TICKS, 3))
    work = np.sum(fine.held(forces) * np.diff(fine.q, axis=0))
    assert ledger["disturbance"] == pytest.approx(work, rel=1e-12)
    for i, b in enumerate(CHAIN.ground_dampers):
        power = b * fine.v[:, i] ** 2
        assert ledger[f"b{i + 1}"] == pytest.approx(fine.integral(power), rel=tolerance)
    for i, b in enumerate(CHAIN.link_dampers):
        power = b * (fine.v[:, i + 1] - fine.v[:, i]) ** 2
        found = ledger[f"b{i + 1}{i + 2}"]
        assert found == pytest.approx(fine.integral(power), rel=tolerance)


def test_effects_against_integrals() -> None:
    """Each effect alone: what its law takes of the recorded motion, to the order of the substep.

    Springs against their potential, drag and friction against Simpson's rule. Mutations: `values`
    of two forces exchanged in `add_work`; friction's share booked on the other friction.
    """
    for name, tolerance in {
        "coulomb_friction_m1": 3e-3,
        "coulomb_friction_m3": 3e-3,
        "quadratic_drag_m2": 1e-4,
        "cubic_stiffness_ground": 1e-3,
        "cubic_stiffness_link12": 1e-3,
        "constant_force_m1": 1e-12,
    }.items():
        run = driven(device(0.002, name))
        fine = Fine(run)
        potential = {
            "cubic_stiffness_ground": 0.25 * 2e5 * fine.q[:, 0] ** 4,
            "cubic_stiffness_link12": 0.25 * 3e6 * (fine.q[:, 0] - fine.q[:, 1]) ** 4,
            "constant_force_m1": -4e-3 * fine.q[:, 0],
        }
        power = {
            "coulomb_friction_m1": 3e-3 * np.abs(fine.v[:, 0]),
            "coulomb_friction_m3": 1e-3 * np.abs(fine.v[:, 2]),
            "quadratic_drag_m2": 5e-3 * np.abs(fine.v[:, 1]) ** 3,
        }
        if name in potential:
            expected = potential[name][-1] - potential[name][0]
            scale = np.ptp(potential[name])
        else:
            expected = scale = fine.integral(power[name])
        assert run.ledger[name] == pytest.approx(expected, rel=0.0, abs=tolerance * scale)


def test_two_effects_at_work_together_keep_their_own_entries() -> None:
    """All effects on: the same integrals as alone, so that none carries another's work."""
    run = driven(device(0.002, *EFFECTS))
    fine, ledger = Fine(run), run.ledger
    assert ledger["coulomb_friction_m1"] == pytest.approx(
        fine.integral(3e-3 * np.abs(fine.v[:, 0])), rel=5e-3
    )
    assert ledger["coulomb_friction_m3"] == pytest.approx(
        fine.integral(1e-3 * np.abs(fine.v[:, 2])), rel=5e-3
    )
    assert ledger["quadratic_drag_m2"] == pytest.approx(
        fine.integral(5e-3 * np.abs(fine.v[:, 1]) ** 3), rel=1e-3
    )
    assert ledger["constant_force_m1"] == pytest.approx(
        -4e-3 * (fine.q[-1, 0] - fine.q[0, 0]), rel=1e-9
    )


def test_lag_splits_the_commands_work() -> None:
    """motor is the work of the force that arrives, actuator_lag what the command had more; 1e-6.

    Neither is the other: their sum is the work of the command. Mutation: `pairs` of motor and lag
    exchanged in `ledger_forms`.
    """
    run = driven(device(0.002, lag=True))
    assert run.fine is not None
    fine = Fine(run)
    arrived = np.concatenate([[0.0], run.fine["actuator_force"]])
    motor = fine.integral(arrived * fine.v[:, 0])
    command = np.concatenate([np.zeros(2), run.trace["command"]])[:TICKS]
    whole = float(fine.held(command) @ np.diff(fine.q[:, 0]))
    assert abs(motor - whole) > 0.01 * abs(motor)
    assert run.ledger["motor"] == pytest.approx(motor, rel=1e-6)
    assert run.ledger["actuator_lag"] == pytest.approx(whole - motor, rel=1e-5)


def test_the_walls_port_is_the_sampled_one() -> None:
    """Sum of u_{k-1} (y_k - y_{k-1}), with an encoder step: what a passivity observer sees."""
    some = device(0.002).with_interface(encoder_step=1e-5)
    run = driven(some)
    y, u = run.trace["encoder"], run.trace["command"]
    assert run.ledger["wall"] == pytest.approx(float(u[:-1] @ np.diff(y)), rel=1e-12)
    assert run.trace["work_wall"] == pytest.approx(
        np.concatenate([[0.0], np.cumsum(u[:-1] * np.diff(y))]), rel=1e-9, abs=1e-15
    )


def test_the_ledger_changes_nothing() -> None:
    """With and without a ledger, the same run to the bit."""
    some = device(0.0023, *EFFECTS, lag=True)
    arguments: dict[str, Any] = {"duration": 0.1, "start": Start(1e-3), "substeps": 4}
    one = simulate(some, wall(15.0, 0.02), **arguments)
    other = simulate(some, wall(15.0, 0.02), ledger=True, **arguments)
    for name in one.trace.channels:
        assert np.array_equal(one.trace[name], other.trace[name])
