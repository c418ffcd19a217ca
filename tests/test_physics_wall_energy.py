"""Truths 3 to 5: what a sampled wall gives, what friction takes, and what a quantiser adds."""

import math

import numpy as np
import pytest
from engine_examples import coulomb, one_mass
from scipy.optimize import brentq

from zwidth.controllers.wall import wall
from zwidth.sim.device import Device
from zwidth.sim.fate import Fate
from zwidth.sim.run import Start, simulate
from zwidth.stability.fates import evaluate
from zwidth.stability.judging import Trial
from zwidth.stability.plane import Axis, Plane

T = 1e-3
STEP = 1e-4
HEAVY = 1e6  # a mass that no force here slows down within two ticks


def cycle_energy(stiffness: float, damper: float, level: float, depth: float, step: float) -> float:
    """Energy that a wall gives over Abbott & Okamura's worst cycle, less what is dissipated.

    In by `depth` within one tick, and out within the next; with a step, across its edge.
    """
    device = one_mass(HEAVY, damper, 0.0, coulomb(level), encoder_step=step)
    edge = 0.5 * step - 0.5 * depth if step > 0.0 else 0.0
    taken = 0.0
    for start, speed in ((edge, depth / T), (edge + depth, -depth / T)):
        run = simulate(
            device, wall(stiffness, 0.0), duration=T, start=Start(start, speed), ledger=True
        )
        taken += run.ledger["motor"] - run.ledger["b1"] - run.ledger["coulomb_friction_m1"]
    return taken


@pytest.mark.parametrize("step", [0.0, STEP])
@pytest.mark.parametrize("depth", [0.1 * STEP, 0.5 * STEP, 0.99 * STEP])
def test_energy_of_the_worst_cycle(step: float, depth: float) -> None:
    """Truth 3: E = K (step or depth) d - 2 f_c d - 2 b d^2 / T, to 1e-7 of its largest term.

    Mutations: 2e-7 of the motor's work left out in `add_work`; the command of the tick before used.
    """
    stiffness, damper, level = 50.0, 0.01, 1e-3
    jump = step if step > 0.0 else depth
    given = stiffness * jump * depth
    expected = given - 2.0 * level * depth - 2.0 * damper * depth**2 / T
    # Reading 0 on the way in commands nothing; a start off the edge has a reading of its own.
    found = cycle_energy(stiffness, damper, level, depth, step)
    assert found == pytest.approx(expected, abs=1e-7 * given)


def test_passive_up_to_the_bound_of_abbott_and_okamura() -> None:
    """Truth 3: with K below min(2 b / T, 2 f_c / Delta) no cycle gives energy, beyond some do.

    Mutation: the friction's share left out of `cycle_energy`.
    """
    damper, level = 0.02, 1.5e-3
    bound = min(2.0 * damper / T, 2.0 * level / STEP)
    depths = np.geomspace(1e-3, 1.0, 12) * STEP
    below = [cycle_energy(0.999 * bound, damper, level, d, STEP) for d in depths]
    above = [cycle_energy(1.01 * bound, damper, level, d, STEP) for d in depths]
    assert max(below) <= 0.0 < max(above)


@pytest.mark.parametrize("part", [0.0, 0.25, 0.4, 0.5])
def test_a_quantised_wall_holds_a_load_that_friction_completes(part: float) -> None:
    """Truth 5: rest under F0 = (3 + part) K Delta iff f_c >= part K Delta, to 1e-6 of K Delta.

    Thresholds 0, 0.5 and 1 times K Delta / 2 for part = 0, 1/4, 1/2. At rest: not one bit moves. It
    starts at 2.6 steps, which the encoder reads as 3.
    Mutation: the encoder rounds down (`encoder_floor`).
    """
    stiffness = 20.0
    unit = stiffness * STEP
    load, distance = np.full(50, (3.0 + part) * unit), part * unit
    for level, rests in ((distance + 1e-6 * unit, True), (distance - 1e-6 * unit, False)):
        if level < 0.0:
            continue
        device = one_mass(1e-3, 0.0, 0.0, coulomb(level), encoder_step=STEP)
        start = 2.6 * STEP
        run = simulate(
            device, wall(stiffness, 0.0), duration=0.05, start=Start(start), disturbance=load,
            substeps=4,
        )  # fmt: skip
        moved = bool(np.any(run.trace["position_m1"] != start))
        assert moved != rests


def quantised(share: float) -> Device:
    """Return a mass whose damper is a share of K tau at K = 10, behind an encoder."""
    return one_mass(1e-3, share * 10.0 * T / 2.0, encoder_step=STEP)


@pytest.mark.parametrize(
    ("share", "fates"),
    [
        (4.0, {Fate.RESTS}),
        (1.3, {Fate.DITHERS, Fate.FELT}),
        (0.02, {Fate.GROWS}),
    ],
)
def test_without_friction_a_quantised_wall_rests_cycles_or_diverges(
    share: float, fates: set[Fate]
) -> None:
    """Truth 5: rest at b = 4 K tau, divergence at b << K tau, limit cycles between.

    Mutation: cycles of up to a step taken for rest (both `REST_OF` made 1): none between.
    """
    plane = Plane(
        quantised(share), Axis("K", 1.0, 20.0), Axis("amplitude", 1e-4, 1e-2), trial=Trial()
    )
    starts = np.array([7.3, 12.9, 20.4]) * STEP
    found = evaluate(plane, np.full(3, 10.0), starts)
    assert {Fate(f) for f in found.fate} <= fates


def test_a_one_sided_wall_has_a_basin_that_varies_with_the_phase_of_impact() -> None:
    """Truth 4, one-sided: critical speed over V* between 1.00 and 1.12, by the phase of impact.

    b = K tau / 2. The spread over ten phases is (1.002, 1.013) at omega tau = 0.01, (1.022, 1.035)
    at 0.03 and (1.058, 1.117) at 0.08: outside the wall nothing is sampled, so V* is a lower bound.
    Mutation: the wall made two-sided, whose return at the far side is another one.
    """
    for angle, low, high in ((0.01, 1.0, 1.015), (0.03, 1.02, 1.04), (0.08, 1.05, 1.12)):
        ratios = [
            float(brentq(gain, 0.8, 1.4, args=(angle, phase), xtol=1e-3))  # pyright: ignore[reportArgumentType]
            for phase in np.linspace(0.1, 0.9, 5)
        ]
        assert low <= min(ratios) <= max(ratios) <= high
        assert max(ratios) - min(ratios) > 0.005


def gain(ratio: float, angle: float, phase: float) -> float:
    """Speed out of a wall over speed into it, less one, at `ratio` of V*, K = 1."""
    tau, level, share = T / 2.0, 1e-3, 0.5
    speed = ratio * 4.0 * level / (math.pi * (1.0 - share) * tau)
    omega = angle / tau
    device = one_mass(1.0 / omega**2, share * tau, 0.0, coulomb(level))
    run = simulate(
        device, wall(1.0, 0.0, one_sided=True), duration=1.3 * math.pi / omega,
        start=Start(-phase * speed * T, speed), substeps=10, fine=True,
    )  # fmt: skip
    assert run.fine is not None
    x, v = run.fine["position_m1"], run.fine["velocity_m1"]
    into = int(np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))[0])
    out = np.flatnonzero((x[:-1] >= 0.0) & (x[1:] < 0.0))
    if out.size == 0:
        return -1.0
    i = int(out[0])
    at = v[i] + x[i] / (x[i] - x[i + 1]) * (v[i + 1] - v[i])
    return abs(float(at)) / float(v[into]) - 1.0
