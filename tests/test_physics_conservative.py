"""Forces with a potential: pendulum and ripple, by frequency, period and energy."""

import math

import numpy as np
import pytest
from scipy.special import ellipk

from zwidth.controllers.none import none
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Start, simulate

MASS = 1e-3
FREE = Device("free mass", "", True, make_chain([MASS], [0.0]))


def _period(t: np.ndarray, q: np.ndarray) -> float:
    """Mean time between upward zero crossings."""
    up = np.flatnonzero((q[:-1] < 0.0) & (q[1:] >= 0.0))
    crossings = t[up] - q[up] / (q[up + 1] - q[up]) * (t[1] - t[0])
    return float(np.diff(crossings).mean())


@pytest.mark.parametrize(("swing", "substeps"), [(1e-3, 10), (1.0, 10), (3.0, 10)])
def test_a_pendulum_swings_with_the_period_of_the_elliptic_integral(
    swing: float, substeps: int
) -> None:
    """T = 4 sqrt(m / level) K(sin^2(swing / 2)), 1e-5. Mutation: the force without its sine."""
    level, angle = 0.05, 0.7
    device = FREE.with_physics(make_physics("gravity_pendulum", "m1", level=level, angle=angle))
    start = Start(swing - angle)
    run = simulate(device, none(), duration=6.0, start=start, substeps=substeps)
    expected = 4.0 * math.sqrt(MASS / level) * ellipk(math.sin(0.5 * swing) ** 2)
    q = run.trace["position_m1"] + angle
    assert _period(run.trace.t, q) == pytest.approx(expected, rel=1e-5 if swing < 3.0 else 1e-4)
    energy = 0.5 * MASS * run.trace["velocity_m1"] ** 2 - level * np.cos(q)
    assert np.ptp(energy) < 1e-5 * level


def test_ripple_takes_and_gives_by_its_potential() -> None:
    """V = a p / (2 pi) cos(2 pi q / p + phi), 1e-5 of its range; the ledger books the same.

    Mutation: 2 pi left out, or the phase.
    """
    a, period, phase = 3e-3, 0.02, 0.4
    values = {"amplitude": a, "period": period, "phase": phase}
    device = FREE.with_physics(make_physics("force_ripple", "m1", **values))
    run = simulate(device, none(), duration=0.3, start=Start(0.0, 0.5), substeps=40, ledger=True)
    q, v = run.trace["position_m1"], run.trace["velocity_m1"]
    assert q[-1] > 5.0 * period
    potential = a * period / (2.0 * math.pi) * np.cos(2.0 * math.pi * q / period + phase)
    energy = 0.5 * MASS * v * v + potential
    assert np.ptp(energy) < 1e-5 * np.ptp(potential)
    booked = run.trace["work_force_ripple_m1"]
    assert np.ptp(booked - potential) < 1e-5 * np.ptp(potential)


def test_ripple_traps_with_the_frequency_of_its_valley() -> None:
    """sqrt(2 pi a / (p m)) at the minimum of V, 2 pi q / p + phi = pi; 1e-5."""
    a, period, phase = 3e-3, 0.02, 0.4
    valley = (math.pi - phase) * period / (2.0 * math.pi)
    values = {"amplitude": a, "period": period, "phase": phase}
    device = FREE.with_physics(make_physics("force_ripple", "m1", **values))
    run = simulate(device, none(), duration=3.0, start=Start(valley + 1e-5), substeps=10)
    expected = 2.0 * math.pi / math.sqrt(2.0 * math.pi * a / (period * MASS))
    q = run.trace["position_m1"] - valley
    assert _period(run.trace.t, q) == pytest.approx(expected, rel=1e-5)


def test_a_gear_mesh_rings_as_a_driven_oscillator() -> None:
    """Two masses, the first so heavy that it turns on at v: with y = q_2 - q_1 and w = 2 pi v / p,

        m_2 y'' + c y' + k y = -a sin(w t + phi),

    from rest; 1e-4 of its range at 40 substeps. Mutations: the force taken over the deflection, or
    on the first mass alone.
    """
    a, period, phase, v = 3e-3, 0.05, 0.4, 1.1
    m, c, k = 2e-4, 5e-3, 20.0
    chain = make_chain([1e6, m], [0.0, 0.0], 0.0, [k], [c])
    values = {"amplitude": a, "period": period, "phase": phase}
    mesh = make_physics("force_ripple", "link12", **values)
    device = Device("gear", "", True, chain).with_physics(mesh)
    run = simulate(device, none(), duration=0.3, start=Start(0.0, v), substeps=40, ledger=True)
    y, t = run.trace["position_m2"] - run.trace["position_m1"], run.trace.t
    w = 2.0 * math.pi * v / period
    steady = -a / complex(k - m * w * w, c * w) * np.exp(1j * phase)  # imaginary part of it
    decay = complex(-c / (2.0 * m), math.sqrt(k / m - (c / (2.0 * m)) ** 2))
    # y = Im(steady exp(iwt)) + Re(free exp(decay t)), at rest at t = 0
    real = -steady.imag
    free = complex(real, ((1j * w * steady).imag + real * decay.real) / decay.imag)
    expected = (steady * np.exp(1j * w * t)).imag + (free * np.exp(decay * t)).real
    assert np.abs(y - expected).max() < 1e-4 * np.ptp(expected)
    # What the pair does on the stretch it does once: the ledger books f dy.
    force = a * np.sin(2.0 * math.pi * run.trace["position_m1"] / period + phase)
    spent = np.concatenate([[0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(y))])
    booked = run.trace["work_force_ripple_link12"]
    assert np.abs(booked - spent).max() < 0.1 * np.ptp(spent)


@pytest.mark.parametrize("place", [1, 2, 3, 4])
def test_a_pendulum_at_any_mass_of_a_stiff_chain_is_one_of_all_masses(place: int) -> None:
    """T = 4 sqrt(sum m / level) K(sin^2(swing / 2)) to 1e-4. Mutation: m1's position in the law."""
    level, swing, masses = 0.05, 1.0, [1e-3, 4e-4, 3e-4, 2e-4]
    chain = make_chain(masses, [0.0] * 4, 0.0, [3e3] * 3, [0.3] * 3)
    weight = make_physics("gravity_pendulum", f"m{place}", level=level, angle=0.0)
    device = Device("stiff", "", True, chain).with_physics(weight)
    run = simulate(device, none(), duration=4.0, start=Start(swing), substeps=10)
    expected = 4.0 * math.sqrt(sum(masses) / level) * ellipk(math.sin(0.5 * swing) ** 2)
    found = _period(run.trace.t, run.trace[f"position_m{place}"])
    assert found == pytest.approx(expected, rel=1e-4)
