"""Truth 8: the energy ledger closes with every effect on, singly and in 50 random sets."""

import numpy as np
import pytest
from physics_examples import EVERYWHERE, example, phantom, with_needed

from zwidth.controllers.wall import wall
from zwidth.sim.physics.effect import Physics
from zwidth.sim.run import Outcome, Run, Start, simulate

# The work of the command where the controller sees it, and how much of it the lag keeps from the
# mechanism: no part of the mechanism's balance.
OUTSIDE = ("wall", "actuator_lag")
BORROWED_ENERGY = (
    "cubic_stiffness", "force_ripple", "gravity_pendulum", "constant_force",
    "servo_limit", "servo_dead_zone", "servo_integral", "falling_limit", "open_winding",
)  # fmt: skip


def _run(*physics: Physics, seed: int = 0) -> Run:
    rng = np.random.default_rng(seed)
    device = phantom().with_interface(delay=0.0013).with_physics(*physics)
    run = simulate(
        device, wall(12.0, 0.02, one_sided=True), duration=0.06, start=Start(-2e-4, 0.3),
        disturbance=0.02 * rng.normal(size=(60, device.chain.masses.size + len(device.hung()))),
        substeps=5, ledger=True, seed=seed,
    )  # fmt: skip
    assert run.outcome is Outcome.COMPLETED
    return run


def _imbalance(run: Run) -> float:
    """What is missing between the work done and the energy found, over the sum of |work|."""
    stored = run.trace["stored_energy"]
    done = {name: run.trace[f"work_{name}"][-1] for name in run.ledger if name not in OUTSIDE}
    turned = sum(abs(value) for value in done.values())
    work = done.pop("motor") + done.pop("disturbance")
    return float(abs(stored[-1] - stored[0] - (work - sum(done.values()))) / turned)


@pytest.mark.parametrize(("name", "place"), EVERYWHERE)
def test_the_ledger_closes_with_each_effect(name: str, place: str) -> None:
    """1e-9. Mutation: `values[e]` booked before the mean of both ends is taken: 1e-4 and more."""
    run = _run(*with_needed(example(name, place)))
    assert _imbalance(run) < 1e-9
    entry = f"{name}_{place}"
    if entry in run.ledger and name not in (*BORROWED_ENERGY, "backlash"):
        assert run.ledger[entry] > 0.0


@pytest.mark.parametrize("seed", range(50))
def test_the_ledger_closes_with_random_sets(seed: int) -> None:
    """1e-9. Mutation: `share_friction` without the division by the whole bound: 1e-2."""
    rng = np.random.default_rng(seed)
    chosen = rng.permutation(len(EVERYWHERE))[: rng.integers(2, 16)]
    drawn = [example(*EVERYWHERE[i]) for i in chosen]
    filters = [p for p in drawn if p.effect.follows]  # there is room for one of all readings
    run = _run(*(p for p in drawn if p not in filters[1:]), seed=seed)
    assert _imbalance(run) < 1e-9


def test_dry_forces_at_one_mass_share_by_their_bounds() -> None:
    """Two Coulomb-like forces of levels 1 : 3 dissipate 1 : 3, and together as one of 4."""
    one = example("coulomb_friction")
    half = {"level_plus": 6e-3, "level_minus": 6e-3, "viscous_plus": 0.0, "viscous_minus": 0.0}
    other = Physics(example("directional_friction").effect, "m1", half)
    run = _run(one, other)
    ratio = run.ledger["directional_friction_m1"] / run.ledger["coulomb_friction_m1"]
    assert ratio == pytest.approx(3.0, rel=1e-12)
    whole = Physics(one.effect, "m1", {"level": 8e-3})
    together = _run(whole).trace["position_m1"]
    np.testing.assert_allclose(run.trace["position_m1"], together, rtol=0.0, atol=1e-15)


def test_a_viscous_bound_that_starts_at_zero_is_booked() -> None:
    """At rest the bound is 0 and after the substep it is not: no share of 0 / 0."""
    values = {"level_plus": 0.0, "level_minus": 0.0, "viscous_plus": 0.05, "viscous_minus": 0.01}
    run = simulate(
        phantom().with_physics(Physics(example("directional_friction").effect, "m1", values)),
        wall(12.0, 0.0), duration=0.05, disturbance=np.full(50, 0.02), ledger=True,
    )  # fmt: skip
    assert _imbalance(run) < 1e-9
    assert run.ledger["directional_friction_m1"] > 0.0
