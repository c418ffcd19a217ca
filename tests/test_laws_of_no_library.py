"""Laws of no library: their motion."""

import numpy as np
import pytest

from zwidth.controllers.none import none
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.periodic_force import HARMONICS, periodic_force
from zwidth.sim.physics.power_drag import power_drag
from zwidth.sim.run import Start, simulate

MASS, T = 2e-4, 1e-3


def single(damper: float = 1e-3) -> Device:
    """Return a device of one mass."""
    return Device("mass", "", True, make_chain([MASS], [damper]), Interface(period=T))


@pytest.mark.parametrize("power", [1.5, 3.0])
def test_a_mass_slows_down_by_the_power(power: float):
    """It coasts as v^(1 - p) = v_0^(1 - p) + (p - 1) c t / m, to 1e-6 at 64 substeps.

    Mutation that breaks it: the speed left out of the ratio; the sign by the position.
    """
    level, speed, v0 = 3e-3, 5.0, -20.0
    drag = Physics(power_drag, "m1", {"level": level, "power": power, "speed": speed})
    run = simulate(
        single(0.0).with_physics(drag), none(), duration=0.3, start=Start(0.0, v0), substeps=64,
        bound=1e9,
    )  # fmt: skip
    t = T * np.arange(run.trace["velocity_m1"].size)
    c = level / speed**power
    expected = -((abs(v0) ** (1.0 - power) + (power - 1.0) * c * t / MASS) ** (1.0 / (1.0 - power)))
    np.testing.assert_allclose(run.trace["velocity_m1"], expected, rtol=1e-6)


def test_a_force_that_repeats_is_its_fourier_series():
    """Speed gained on the way is what the potential of four harmonics says, to 1e-6.

    Mutation that breaks it: harmonics turned the other way round; the last one left out.
    """
    random = np.random.default_rng(3)
    waves = {f"{wave}{k}": float(random.uniform(-1e-3, 1e-3))
             for k in range(1, HARMONICS + 1) for wave in ("cosine", "sine")}  # fmt: skip
    force = Physics(periodic_force, "m1", {"period": 0.3, **waves})
    run = simulate(
        single(0.0).with_physics(force), none(), duration=0.2, start=Start(0.0, 9.0), substeps=64,
        bound=1e9,
    )  # fmt: skip
    q, v = run.trace["position_m1"], run.trace["velocity_m1"]
    work = np.zeros(q.size)
    for k in range(1, HARMONICS + 1):
        turn = 2.0 * np.pi * k / 0.3
        work += waves[f"cosine{k}"] * np.sin(turn * q) / turn
        work += waves[f"sine{k}"] * (1.0 - np.cos(turn * q)) / turn
    np.testing.assert_allclose(v**2, 81.0 + 2.0 * work / MASS, rtol=1e-6)


@pytest.mark.parametrize("at", ["m2", "link12"])
def test_of_one_harmonic_it_is_a_ripple_where_that_is(at: str):
    """To 1e-12 of the motion. Mutation: the force in a link over its deflection."""
    chain = make_chain([MASS, 4e-4], [1e-3, 1e-3], 0.0, [20.0], [5e-3])
    device = Device("gear", "", True, chain, Interface(period=T))
    ripple = make_physics("force_ripple", at, amplitude=2e-3, period=0.2, phase=0.5)
    waves = dict.fromkeys((f"{w}{k}" for k in range(1, 5) for w in ("cosine", "sine")), 0.0)
    waves |= {"cosine1": 2e-3 * np.sin(0.5), "sine1": 2e-3 * np.cos(0.5)}
    same = Physics(periodic_force, at, {"period": 0.2, **waves})
    start = Start([0.0, 0.01], [5.0, 5.0])
    one, other, none_of_it = (
        simulate(d, none(), duration=0.2, start=start, substeps=8).trace["velocity_m2"]
        for d in (device.with_physics(ripple), device.with_physics(same), device)
    )
    np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-12 * np.abs(one).max())
    assert np.abs(one - none_of_it).max() > 1e-3
