"""Backlash: free play, impacts and contact, against closed forms and an integrator with events."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from zwidth.controllers.none import none
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.backlash import backlash_force
from zwidth.sim.run import Start, simulate

M1, M2, K, GAP = 2e-4, 9e-4, 217.0, 2e-3
REDUCED = M1 * M2 / (M1 + M2)
OMEGA = math.sqrt(K / REDUCED)


def two_masses(damper: float, gap: float = GAP) -> Device:
    """Return two free masses whose link has a gap."""
    chain = make_chain([M1, M2], [0.0, 0.0], 0.0, [K], [damper])
    device = Device("two masses", "", True, chain)
    return device.with_physics(make_physics("backlash", "link12", gap=gap))


def events_truth(damper: float, gap: float, x: list[float], t: np.ndarray) -> np.ndarray:
    """Positions and velocities at times t of the pin model, each phase integrated to its event.

    State q1 q2 v1 v2 and the link's deformation s; phase -1, 0, 1: pin at the lower side, free, at
    the upper side.
    """
    half = 0.5 * gap

    def torque(y: np.ndarray, phase: int) -> float:
        return phase and K * (y[0] - y[1] - phase * half) + damper * (y[2] - y[3])

    def slope(_: float, y: np.ndarray, phase: int) -> list[float]:
        force = torque(y, phase)
        back = y[2] - y[3] if phase or damper == 0.0 else -K / damper * y[4]
        return [y[2], y[3], -force / M1, force / M2, back if phase else (damper and back)]

    def reaches(side: int):
        def event(_: float, y: np.ndarray, phase: int) -> float:
            return side * (y[0] - y[1] - y[4]) - half

        event.terminal, event.direction = True, 1  # pyright: ignore[reportFunctionMemberAccess]
        return event

    def lets_go(_: float, y: np.ndarray, phase: int) -> float:
        return phase * torque(y, phase)

    lets_go.terminal, lets_go.direction = True, -1  # pyright: ignore[reportFunctionMemberAccess]
    y, phase, now = np.array([*x, 0.0]), 0, 0.0
    rows = np.zeros((t.size, 4))
    while now < t[-1]:
        events: Any = [lets_go] if phase else [reaches(1), reaches(-1)]
        part = solve_ivp(
            slope, (now, t[-1] + 1e-9), y, args=(phase,), events=events, dense_output=True,
            method="DOP853", rtol=1e-10, atol=1e-13, max_step=2e-3,
        )  # fmt: skip
        inside = (t >= now) & (t <= part.t[-1])
        rows[inside] = part.sol(t[inside])[:4].T
        y, now = part.y[:, -1].copy(), float(part.t[-1])
        if phase:
            y[4] = y[0] - y[1] - phase * half if damper else 0.0
            phase = 0
        else:
            phase = 1 if part.t_events[0].size else -1
    return rows


def _simulated(
    damper: float, x: list[float], ticks: int, substeps: int, gap: float = GAP
) -> np.ndarray:
    run = simulate(
        two_masses(damper, gap), none(), duration=ticks * 1e-3, start=Start(x[:2], x[2:]),
        substeps=substeps,
    )  # fmt: skip
    names = ("position_m1", "position_m2", "velocity_m1", "velocity_m2")
    return np.array([run.trace[name] for name in names]).T


def test_elastic_play_has_the_period_of_flight_and_contact() -> None:
    """T = 2 (gap / v + pi / omega), 1e-4; energy kept to 1e-4. Mutation: gap for half the gap."""
    v = 0.3
    start = [0.0, 0.0, v * M2 / (M1 + M2), -v * M1 / (M1 + M2)]
    x = _simulated(0.0, start, 400, 200)
    play = x[:, 0] - x[:, 1]
    up = np.flatnonzero((play[:-1] < 0.0) & (play[1:] >= 0.0))
    crossings = up - play[up] / (play[up + 1] - play[up])
    period = np.diff(crossings).mean() * 1e-3
    assert period == pytest.approx(2.0 * (GAP / v + math.pi / OMEGA), rel=1e-4)
    flying = np.abs(play) < 0.4 * GAP
    speed = np.abs(x[flying, 2] - x[flying, 3])
    np.testing.assert_allclose(speed, v, rtol=1e-4)


@pytest.mark.parametrize("ratio", [0.05, 0.3, 0.7])
def test_an_impact_restores_what_spring_and_damper_leave(ratio: float) -> None:
    """Speed after over speed before, 1 %: x'' + 2 d w x' + w^2 x = 0 until k x + c x' = 0.

    Mutation: the damper left out of `next_pin` and of the contact (p[2] v): nothing is lost.
    """
    damper = 2.0 * ratio * OMEGA * REDUCED
    slow = OMEGA * math.sqrt(1.0 - ratio * ratio)

    def x(t: float) -> float:
        return math.exp(-ratio * OMEGA * t) * math.sin(slow * t) / slow

    def speed(t: float) -> float:
        return math.exp(-ratio * OMEGA * t) * math.cos(slow * t) - ratio * OMEGA * x(t)

    end = float(brentq(lambda t: K * x(t) + damper * speed(t), 1e-3 / slow, math.pi / slow))
    v = 0.3
    start = [0.0, 0.0, v * M2 / (M1 + M2), -v * M1 / (M1 + M2)]
    found = _simulated(damper, start, 8, 200)
    after = found[-1, 2] - found[-1, 3]
    assert after == pytest.approx(speed(end) * v, rel=0.01)


def _errors(damper: float, gap: float, counts: list[int]) -> np.ndarray:
    """Error of all positions and velocities, rms, mean over the starts."""
    rng = np.random.default_rng(1)
    total = np.zeros(len(counts))
    for _ in range(8):
        start = [0.0, 0.0, float(rng.uniform(0.2, 0.5)), float(rng.uniform(-0.5, -0.2))]
        truth = events_truth(damper, gap, start, np.arange(40) * 1e-3)
        total += [np.std(_simulated(damper, start, 40, n, gap) - truth) for n in counts]
    return total / 8.0


@pytest.mark.parametrize(
    ("damper", "gap", "order"),
    [
        *((damper, GAP, 3.0) for damper in (0.0, 1e-5, 2e-4, 0.02, 0.06)),
        (0.3, 1e-4, 2.7),
    ],
)
def test_it_converges_to_the_pin_model(damper: float, gap: float, order: float) -> None:
    """Of third order, against events found to 1e-10, over 8 starts.

    A light damper lets the link spring back within a small part of a substep; the last crosses its
    gap before its link has sprung back. Mutations: a pin that leaves its side with T / c for all of
    a substep (a light link then crosses its gap at once: errors of 0.4); `late` of `is_hit` 0 (the
    mass stays where a push held throughout puts it); its parabola a line (`bend` 0); a link without
    memory (`springs_back` 0); `rest * t1` of `lets_go` left out: each takes off an order or more.
    """
    counts = [8, 16, 32, 64, 128]
    errors = _errors(damper, gap, counts)
    slope = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert slope > order - 0.1
    assert errors[0] < 3e-4


def test_a_side_pushes_and_never_pulls() -> None:
    """At any (q, v) with the pin at a side. Mutation: `min` and `max` left out."""
    p, rng = np.array([GAP, K, 0.06]), np.random.default_rng(3)
    for q, v in rng.normal(size=(500, 2)) * [GAP, 1.0]:
        whole = K * q + 0.06 * v
        half = 0.5 * GAP
        upper, lower = (whole - backlash_force(q, v, z, p) for z in (half, -half))
        assert upper == pytest.approx(max(0.0, whole - K * half), abs=1e-15)
        assert lower == pytest.approx(min(0.0, whole + K * half), abs=1e-15)
        assert backlash_force(q, v, 0.3 * half, p) == whole


def test_a_load_at_rest_bends_the_link_beyond_half_its_gap() -> None:
    """q1 - q2 = F / k + gap / 2 to 1e-9, both signs. Mutation: the whole gap."""
    chain = make_chain([M1, M2, 1e-4], [0.02] * 3, 0.0, [K, 15.0], [0.05, 1e-3])
    device = Device("held at its end", "", True, chain).with_physics(
        make_physics("backlash", "link12", gap=GAP),
        make_physics("backlash", "link23", gap=3.0 * GAP),
        make_physics("ground_spring", "m3", stiffness=5.0),
    )
    for force in (0.05, -0.03):
        run = simulate(device, none(), duration=3.0, disturbance=np.full(3000, force), substeps=4)
        q1, q2, q3 = (run.trace[f"position_m{i}"][-1] for i in (1, 2, 3))
        side = math.copysign(1.0, force)
        assert q3 == pytest.approx(force / 5.0, rel=1e-9)
        assert q1 - q2 == pytest.approx(force / K + side * 0.5 * GAP, rel=1e-9)
        assert q2 - q3 == pytest.approx(force / 15.0 + side * 1.5 * GAP, rel=1e-9)


def test_a_start_with_a_bent_link_has_its_pin_at_the_side() -> None:
    """Released from F / k + gap / 2 the elastic link is in contact at once; 1e-6 of the truth.

    Mutation: internal states that start at zero.
    """
    bend = 0.5 * GAP + 1e-3
    run = simulate(two_masses(0.05), none(), duration=2e-3, start=Start([bend, 0.0]), substeps=200)
    x = solve_ivp(
        lambda _, y: [y[1], -(K * (y[0] - 0.5 * GAP) + 0.05 * y[1]) / REDUCED],
        (0.0, 1e-3), [bend, 0.0], rtol=1e-11, atol=1e-14,
    )  # fmt: skip
    play = run.trace["position_m1"] - run.trace["position_m2"]
    assert play[1] == pytest.approx(x.y[0, -1], rel=1e-6)
