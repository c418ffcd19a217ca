"""The integrator behind concealed recordings and the engine are witnesses of each other."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.physics_examples import EVERYWHERE, example, phantom
from zwidth.controllers.excitation import noise
from zwidth.controllers.recorded import recorded
from zwidth.scenarios.concealed.integrator import integrate
from zwidth.scenarios.concealed.outside import OUTSIDE, Outside
from zwidth.scenarios.concealed.truth import lost_rate, truth_of
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.physics import EFFECTS, make_physics
from zwidth.sim.plant import hold
from zwidth.sim.run import simulate

T, TICKS, STEPS = 1e-3, 600, 160
EXAMPLES_OUTSIDE: dict[str, dict[str, float]] = {
    "swaying_stiffness": {"share": 0.2, "frequency_hz": 3.0},
    "swinging_inertia": {"share": 0.2, "period": 0.1},
    "cubic_drag": {"coefficient": 1e-3},
    "warming_dampers": {"share": 0.5, "time_constant": 1.0},
    "hum": {"amplitude": 0.01, "frequency_hz": 50.0, "phase": 0.0},
    "hard_stop": {"position": 0.02, "stiffness": 50.0, "damping": 0.01},
    "detent": {"amplitude": 0.01, "period": 0.05, "sharpness": 3.0},
    "sagging_drive": {"loss": 20.0, "time_constant": 0.1},
}


def command(seed: int = 3) -> NDArray[np.float64]:
    return noise(0.1, 2.0, 100.0, duration=TICKS * T, seed=seed)


def moved(
    device: Device, u: NDArray[np.float64], outside: Outside | None = None, **changes: Any
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return (readings, states) without noise."""
    truth = truth_of(device, STEPS, outside)._replace(**changes)
    still = np.zeros(u.size)
    states = np.zeros((u.size, 2 * truth.masses.size))
    lost = np.zeros(u.size, dtype=np.bool_)
    _, y, done = integrate(truth, T, STEPS, u, np.zeros(2), still, lost, still, still, states)
    assert done == u.size
    return y, states


@pytest.mark.parametrize(("name", "at"), EVERYWHERE)
def test_every_effect_is_that_of_the_engine(name: str, at: str) -> None:
    """They differ by less than 1 % of what the effect does (3 % in free play).

    Seen with 160 steps a tick against 50: 1e-11 for what is linear or acts on samples, 1e-3 to 7e-3
    for dry friction, which falls with the steps as 1/steps: bristles so stiff are its limit.
    Breaks with `dry_level` 2 % higher, with the pin's rate left out, with drag's |v| as v, with a
    limit that falls where the drive brakes. A winding that opens with its drive has no part here: a
    simulation's drive is on at all times; its equations are those of test_drive_states.py.
    """
    if name == "dropped_samples":
        pytest.skip("which commands are lost is drawn by each side on its own")
    if name == "position_servo" or EFFECTS[name].needs == "position_servo":
        pytest.skip("the exam draws no servos; their own equations are those of test_servo.py")
    if name == "open_winding":
        pytest.skip("a simulation's drive is never off; that is compared in test_drive_states.py")
    if EFFECTS[name].sought == "learned":
        pytest.skip("the exam draws no tables; an integrator of their own is in test_free_law.py")
    if at == "velocity":
        pytest.skip("an encoder reads no velocity; those are compared in test_sensor_filters.py")
    u = command()
    device = phantom().with_physics(example(name, at))
    ours, _ = moved(device, u)
    theirs = simulate(device, recorded(u), duration=TICKS * T, substeps=50).trace["encoder"]
    without = simulate(phantom(), recorded(u), duration=TICKS * T).trace["encoder"]
    effect = float(np.linalg.norm(theirs - without))
    assert effect > 0.0
    assert np.linalg.norm(ours - theirs) < (0.03 if name == "backlash" else 0.01) * effect


def test_linear_part_is_the_matrix_exponential() -> None:
    """Runge-Kutta and exact propagation agree to 1e-8 of the motion (seen: 1e-11).

    Breaks with a weight of 2.1 for one of the four stages.
    """
    chain = make_chain([1e-3, 2e-4, 1e-4, 5e-5], [2e-3] * 4, 3.0, [90.0, 60.0, 20.0], [1e-2] * 3)
    device = Device("four masses", "", True, chain)
    u = command()
    ad, bd = hold(device.plant(), T)
    x, exact = np.zeros(8), np.zeros((TICKS, 8))
    for k in range(TICKS):
        exact[k] = x
        x = ad @ x + bd[:, 0] * u[k]
    _, states = moved(device, u)
    assert np.abs(states - exact).max(axis=0) == pytest.approx(
        np.zeros(8), abs=1e-8 * float(np.abs(exact[:, 4:]).max())
    )


def test_a_bristle_holds_a_mass_that_coulomb_holds() -> None:
    """Under 90 % of its level a mass moves by a bristle's bend and no further; above, it slides."""
    chain = make_chain([1e-3], [1e-3])
    friction = make_physics("coulomb_friction", "m1", level=0.01)
    device = Device("one mass", "", True, chain).with_physics(friction)
    below, _ = moved(device, np.full(TICKS, 0.009))
    above, _ = moved(device, np.full(TICKS, 0.011))
    assert 0.0 < np.abs(below).max() < 3e-7
    assert np.abs(below[-200:] - below[-1]).max() < 1e-12  # no creep
    assert above[-1] > 0.05


def test_a_jittered_command_acts_later_by_its_jitter() -> None:
    """A constant jitter is a delay; breaks where the mean over a step forgets what was held."""
    u = command()
    late, _ = moved(phantom().with_interface(delay=0.00037), u)
    truth = truth_of(phantom().with_interface(delay=0.0), STEPS)
    still, states = np.zeros(TICKS), np.zeros((TICKS, 6))
    lost = np.zeros(TICKS, dtype=np.bool_)
    jitter = np.full(TICKS, 0.00037)
    _, y, _ = integrate(truth, T, STEPS, u, np.zeros(2), jitter, lost, still, still, states)
    assert y == pytest.approx(late, abs=1e-15)
    theirs = simulate(phantom().with_interface(delay=0.00037), recorded(u), duration=TICKS * T)
    assert y == pytest.approx(theirs.trace["encoder"], abs=1e-7)


def test_lost_commands_are_held_over() -> None:
    """A loss at tick k equals a command repeated there."""
    u = command()
    truth = truth_of(phantom(), STEPS)
    still, states = np.zeros(TICKS), np.zeros((TICKS, 6))
    lost = np.zeros(TICKS, dtype=np.bool_)
    lost[[50, 51, 300]] = True
    _, y, _ = integrate(truth, T, STEPS, u, np.zeros(2), still, lost, still, still, states)
    held = u.copy()
    held[[50, 51]], held[300] = u[49], u[299]
    assert np.array_equal(y, moved(phantom(), held)[0])
    losing = phantom().with_physics(make_physics("dropped_samples", "clock", rate=0.01))
    assert lost_rate(losing) == 0.01
    assert lost_rate(phantom()) == 0.0


def test_feedback_is_part_of_the_recorded_command() -> None:
    """Played back as it was recorded, the command of a closed loop gives the same motion."""
    u = command()
    truth = truth_of(phantom(), STEPS)
    still, states = np.zeros(TICKS), np.zeros((TICKS, 6))
    lost = np.zeros(TICKS, dtype=np.bool_)
    feedback = np.array([2.0, 0.01])
    closed, y, _ = integrate(truth, T, STEPS, u, feedback, still, lost, still, still, states)
    assert np.abs(closed - u).max() > 0.01
    assert np.array_equal(moved(phantom(), closed)[0], y)


@pytest.mark.parametrize("name", OUTSIDE)
def test_what_is_in_no_library_moves_the_device(name: str) -> None:
    u = command()
    plain, _ = moved(phantom(), u)
    other, _ = moved(phantom(), u, Outside(name, EXAMPLES_OUTSIDE[name]))
    assert np.std(other - plain) > 1e-6 * np.std(plain)


def test_hum_is_the_force_it_says() -> None:
    """On one free mass, x = (A / (m w^2)) (w t - sin w t) for a force A sin(w t)."""
    device = Device("one mass", "", True, make_chain([1e-3], [0.0]))
    hum = Outside("hum", {"amplitude": 0.01, "frequency_hz": 5.0, "phase": 0.0})
    y, _ = moved(device, np.zeros(TICKS), hum)
    w, t = 2.0 * math.pi * 5.0, np.arange(TICKS) * T
    assert y == pytest.approx(0.01 / (1e-3 * w * w) * (w * t - np.sin(w * t)), rel=1e-6, abs=1e-12)


def test_a_swinging_inertia_keeps_its_energy() -> None:
    """m(q) v^2 / 2 gains what the command works; breaks without the term in m'(q)."""
    device = Device("one mass", "", True, make_chain([1e-3], [0.0]))
    swing = Outside("swinging_inertia", {"share": 0.4, "period": 0.05})
    u = np.zeros(TICKS)
    u[:20] = 0.01
    _, states = moved(device, u, swing)
    q, v = states[20:, 0], states[20:, 1]
    energy = 0.5e-3 * (1.0 + 0.4 * np.cos(2.0 * math.pi * q / 0.05)) * v * v
    assert np.ptp(q) > 0.05  # all of a swing was seen
    assert energy == pytest.approx(np.full(q.size, energy[0]), rel=1e-7)


def test_a_drive_sags_by_what_it_lately_gave() -> None:
    """On one free mass a = u / (m (1 + loss u^2 (1 - exp(-t / tau)))) under a constant command.

    Mutations: what was spent counted from the sagging force, or before it is asked.
    """
    device = Device("one mass", "", True, make_chain([1e-3], [0.0])).with_interface(delay=0.0)
    sag = Outside("sagging_drive", {"loss": 3e4, "time_constant": 0.1})
    u, t = 0.01, np.arange(TICKS) * T
    y, _ = moved(device, np.full(TICKS, u), sag)
    pushes = u / 1e-3 / (1.0 + 3e4 * u * u * (1.0 - np.exp(-t / 0.1)))
    speed = np.concatenate([[0.0], np.cumsum(pushes * T)[:-1]])
    place = np.concatenate([[0.0], np.cumsum(speed * T + 0.5 * pushes * T * T)[:-1]])
    assert y == pytest.approx(place, rel=1e-9, abs=1e-12)


def test_outside_says_what_it_needs() -> None:
    with pytest.raises(ValueError, match="there is no effect 'humm'"):
        Outside("humm", {})
    with pytest.raises(ValueError, match="it needs, in this order, amplitude, frequency_hz, phase"):
        Outside("hum", {"amplitude": 1.0})
