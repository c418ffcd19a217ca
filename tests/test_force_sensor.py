"""A force sensor in the loop: what a hand feels, and how much gain a device bears."""

import numpy as np
import pytest
from engine_examples import phantom

from zwidth.controllers.none import none
from zwidth.controllers.wall import wall
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_from_text, device_to_text
from zwidth.sim.interface import Interface
from zwidth.sim.loop import open_loop
from zwidth.sim.run import Start, simulate
from zwidth.stability.bisection import find_brackets
from zwidth.stability.decomposition import curve
from zwidth.stability.linear import critical_stiffness, last_stable_damping
from zwidth.stability.passivity import passive_boundary

T = 1e-3
M, HAND, B = 0.2, 0.05, 2.0


def held(gain: float, hand: float = HAND, hertz: float = 2500.0, **interface: float) -> Device:
    """A device of mass M and damping B that holds a hand's mass on a stiff sensor, well damped."""
    together = M * hand / (M + hand)
    spring = together * (2.0 * np.pi * hertz) ** 2
    chain = make_chain([M, hand], [B, 0.0], 0.0, [spring], [1.4 * np.sqrt(spring * together)])
    face = Interface(**{"delay": 0.0, "force_sensor": "link12", "force_gain": gain} | interface)  # pyright: ignore
    return Device("held", "-", False, chain, face)


@pytest.mark.parametrize("gain", [0.0, 1.0, 3.0])
def test_the_hand_feels_the_device_over_one_plus_the_gain(gain: float) -> None:
    """A force F on the hand: a = F / (M / (1 + G) + m_h) at first, F (1 + G) / B at last; 1 %.

    Mutations: u = w - G F without the damper of the link; the row with the hand's sign.
    """
    force = np.zeros((4000, 2))
    force[:, 1] = 0.1
    run = simulate(held(gain), none(), duration=4.0, disturbance=force)
    speed, t = run.trace["velocity_m2"], run.trace.t
    felt = M / (1.0 + gain) + HAND
    early = (t > 0.02) & (t < 0.03)
    truth = 0.1 * (1.0 + gain) / B * (1.0 - np.exp(-t * B / (1.0 + gain) / felt))
    assert speed[early] == pytest.approx(truth[early], rel=0.05)
    assert speed[-1] == pytest.approx(truth[-1], rel=0.01)


@pytest.mark.parametrize("hand", [0.05, 0.2, 0.8])
def test_the_gain_is_bound_by_the_ratio_of_the_masses(hand: float) -> None:
    """G < 1 + M / m_h: the held command u makes F = u m_h / (M + m_h) of itself. 10 %, simulated.

    Mutation: the feedback a tick late (G < 1 + M/m_h has other roots).
    """
    limit = 1.0 + M / hand

    def calm(gain: float) -> bool:
        run = simulate(held(gain, hand), none(), duration=1.0, start=Start(0.0, [0.01, 0.0]))
        u = np.abs(run.trace["command"])
        return bool(u[-50:].max() < 1e-3 * u[:50].max())

    gains = limit * np.linspace(0.8, 1.2, 41)
    stable = [calm(float(g)) for g in gains]
    last = float(gains[np.flatnonzero(stable)[-1]])
    assert last == pytest.approx(limit, rel=0.1)
    assert all(stable[: stable.index(False)])
    loops = [critical_stiffness(held(float(g), hand), 0.0).stable for g in gains]
    assert float(gains[loops.index(False) - 1]) == pytest.approx(limit, rel=0.03)


@pytest.mark.parametrize("delay", [0.0, 2e-3])
@pytest.mark.parametrize("gain", [0.0, 0.5, 1.0])
def test_the_wall_that_is_stable_shrinks_with_the_gain(gain: float, delay: float) -> None:
    """b = (1 + G) K (t - G m_h t_F / (M + (1 + G) m_h)), t = T/2 + t_d, t_F = T + t_d: 4 %, twice.

    Of (M s2 + b s) x + (1 + G e^{-s t_F}) m_h s2 x + (1 + G) K e^{-s t} x = 0, s = j w, w t small.
    A force is read half a period later than a position, since the acceleration of a held command
    stands for the middle of its period. Mutation: the entry of the command without 1 + G.
    """
    t, late = 0.5 * T + delay, T + delay
    inertia = M + (1.0 + gain) * HAND
    truth = B / ((1.0 + gain) * (t - gain * HAND * late / inertia))
    device = held(gain, delay=delay)
    point = critical_stiffness(device, 0.0)
    assert point.stiffness == pytest.approx(truth, rel=0.04)
    (bracket,) = find_brackets([device], [np.zeros(1)])[0]
    assert bracket.stable == pytest.approx(point.stiffness, rel=2e-3)


def test_the_tick_equals_its_linear_theory() -> None:
    """One cycle of the kernel is the loop's matrix, to 1e-10. Mutation: F of the state after."""
    device = phantom().with_interface(force_sensor="link12", force_gain=0.3, delay=0.0023)
    run = simulate(device, wall(4.0, 0.02), duration=0.05, start=Start(1e-3, 0.0))
    loop = open_loop(device)
    s = np.zeros(loop.entry.size)
    s[:3] = s[-1] = 1e-3
    rows = []
    for _ in range(50):
        rows.append(s[:3])
        s = loop.closed(4.0, 0.02) @ s
    found = np.column_stack([run.trace[f"position_m{i}"] for i in (1, 2, 3)])
    assert np.abs(found - rows).max() < 1e-10 * np.abs(rows).max()


def test_the_file_has_it_and_what_does_not_take_it_says_so() -> None:
    device = phantom().with_interface(force_sensor="link12", force_gain=0.3)
    assert device_from_text(device_to_text(device)).interface == device.interface
    assert last_stable_damping(device) is not None
    for refuse in (lambda d: curve(d, 10.0), lambda d: passive_boundary(d, [0.0])):  # pyright: ignore
        with pytest.raises(ValueError, match="takes no force feedback"):
            refuse(device)
    with pytest.raises(ValueError, match=r"force_gain is 0\.3; it must be 0 without force_sensor"):
        Interface(force_gain=0.3)
    with pytest.raises(ValueError, match="has 3 masses, so give a link between two of them"):
        open_loop(device.with_interface(force_sensor="link34"))
