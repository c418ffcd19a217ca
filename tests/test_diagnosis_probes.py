"""Laws of no library: their motion, and that they are not taken for what comes near them."""

from typing import Any

import numpy as np
import pytest

from tests.diagnosis_examples import record
from zwidth.controllers.none import none
from zwidth.diagnosis.fitting.descend import fit
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.forces import probes
from zwidth.diagnosis.forces.leftover import leftover
from zwidth.diagnosis.forces.probes import instead_by_law, repeating
from zwidth.diagnosis.forces.unknown import Instead
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.settle import refit, settle
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.one_sided_spring import one_sided_spring
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


def test_every_ripple_is_asked_whether_it_is_one_of_more_where_it_is():
    """Mutations: the first ripple's values for all; all of them at m1."""
    chain = make_chain([MASS, 4e-4], [1e-3, 1e-3], 0.0, [20.0], [5e-3])
    device = Device("gear", "", True, chain, Interface(period=T))
    problem, linear = refit(device, [record(device, 1.0, seed=22)])
    places = {"m1": 0.1, "link12": 0.3}
    ripples = tuple(
        make_physics("force_ripple", at, amplitude=1e-4, period=period, phase=0.0)
        for at, period in places.items()
    )
    scales = ({"amplitude": 1e-4, "period": 1e-3, "phase": 0.5},) * 2
    x = np.append(linear.x, np.zeros(6))
    fitted = fit(problem, Model(device, ripples, scales), x, 1)
    built = {p.at: p.values["period"] for p in fitted.model.build(fitted.x).physics}
    for at in places:
        asked = [p.physics for p in repeating(fitted) if len(p.gone) == 1 and p.physics.at == at]
        periods = [p.values["period"] / built[at] for p in asked]
        assert periods == pytest.approx([1.0, 2.0, 3.0, 4.0], rel=1e-12)


def square_found(truth: Device) -> tuple[Problem, Fitted]:
    """A quadratic drag fitted to what a device does."""
    e = record(truth, 5.0, seed=21)
    problem, linear = refit(single(), [e])
    square = make_physics("quadratic_drag", "m1", coefficient=2e-5)
    start = np.append(linear.x, 0.0)
    return problem, fit(problem, Model(single(), (square,), ({"coefficient": 2e-5},)), start, 30)


def cubed(level: float) -> Instead | None:
    """What is in place of the square that was fitted to a cubic drag."""
    values: dict[str, Any] = {"level": level, "power": 3.0, "speed": 20.0}
    return instead_by_law(*square_found(single().with_physics(Physics(power_drag, "m1", values))))


def test_a_cube_is_told_from_a_square():
    """By its power; and a square stays one.

    Mutations that break it: the power held at 2; the threshold left out.
    """
    v, other = 20.0, cubed(8e-3)
    assert other is not None
    assert other.sure
    assert other.place == "m1"
    assert float(other.follows.split()[2]) == pytest.approx(3.0, abs=0.3)
    assert "likelier than quadratic_drag at m1" in other.sentence
    square = make_physics("quadratic_drag", "m1", coefficient=8e-3 / v**2)
    assert instead_by_law(*square_found(single().with_physics(square))) is None


def test_a_cube_that_hardly_shows_is_a_rival():
    """Three to five sigma. Mutation that breaks it: nothing is said below five."""
    other = cubed(5e-3)
    assert other is not None
    assert not other.sure
    assert float(other.follows.split()[2]) == pytest.approx(3.0, abs=0.3)


def test_a_cube_is_told_from_a_square_and_a_friction_that_rises():
    """Together they come near it, with one number more than it has.

    Mutation that breaks it: a first look at the cube with the noise of these two alone, under which
    it costs hundreds more than in the end.
    """
    values: dict[str, Any] = {"level": 2e-2, "power": 3.0, "speed": 20.0}
    truth = single().with_physics(Physics(power_drag, "m1", values))
    problem, linear = refit(single(), [record(truth, 5.0, seed=21)])
    square = make_physics("quadratic_drag", "m1", coefficient=2e-5)
    slow = {"level": 1e-3, "static_level": 1e-3, "velocity": 5.0}
    model = Model(
        single(),
        (square, make_physics("rising_friction", "m1", **slow)),
        ({"coefficient": 2e-5}, {"level": 1e-3, "static_level": 1e-3, "velocity": 1e-3}),
    )
    other = instead_by_law(*settle(problem.experiments, model, np.append(linear.x, np.zeros(4))))
    assert other is not None
    assert float(other.follows.split()[2]) == pytest.approx(3.0, abs=0.3)
    assert other.name == "quadratic_drag at m1 and rising_friction at m1"


def test_a_stop_is_told_from_a_spring_that_stiffens():
    """A spring met on one side; and a cubic spring stays one.

    Mutations that break it: the side left out of the force; stops sought on one side only.
    """
    held = Device("held", "", True, make_chain([MASS], [1e-3], 0.2), Interface(period=T))
    cubic = make_physics("cubic_stiffness", "ground", coefficient=0.1)
    for side in (-1.0, 0.0, 1.0):
        values = {"place": 0.12 * side, "stiffness": 1.0, "side": side}
        met = cubic if side == 0.0 else Physics(one_sided_spring, "m1", values)
        e = record(held.with_physics(met), 5.0, seed=22)
        problem, linear = refit(held, [e])
        model = Model(held, (cubic,), ({"coefficient": 0.1},))
        found = settle(problem.experiments, model, np.append(linear.x, 0.0))
        other = instead_by_law(*found)
        assert (other is not None) is (side != 0.0)
        if other is not None:
            assert other.follows.startswith(f"position only {'above' if side > 0.0 else 'below'}")
            place = float(other.follows.split()[3].strip(","))
            assert place == pytest.approx(values["place"], abs=5e-3)


def test_where_a_device_rests_is_no_stop(monkeypatch: pytest.MonkeyPatch):
    """At rest at its end a quarter of the time: no spring of a stiffness that no law allows.

    Mutation that breaks it: any depth above nothing, which rounding makes.
    """
    held = Device("held", "", True, make_chain([MASS], [1e-3], 0.2), Interface(period=T))
    cubic = make_physics("cubic_stiffness", "ground", coefficient=0.1)
    problem, linear = refit(held, [record(held, 1.0, seed=22)])
    model = Model(held, (cubic,), ({"coefficient": 0.1},))
    fitted = fit(problem, model, np.append(linear.x, 0.0), 1)
    rests = np.concatenate([np.linspace(0.0, 1.0, 2000), 1.0 + 1e-16 * np.arange(1000)])
    monkeypatch.setattr(probes, "predicted_states", lambda *_: [rests[:, None]])
    found = list(probes._stops(problem, fitted))  # pyright: ignore[reportPrivateUsage]
    most = one_sided_spring.parameter("stiffness").upper
    assert found
    assert all(p.physics.values["stiffness"] < most for p in found)


def test_a_detent_is_told_from_a_ripple():
    """By its harmonics, though the ripple that was found is the third of them; a ripple stays one.

    Mutations that break it: only the first harmonic tried as what the ripple is; no forces over
    position sought beside a ripple.
    """
    period, amplitude = 0.12, 4e-3
    third = make_physics("force_ripple", "m1", amplitude=1e-3, period=period / 3.0, phase=0.0)
    scales = {"amplitude": 1e-3, "period": 1e-4, "phase": 0.5}
    waves = dict.fromkeys((f"{w}{k}" for k in range(1, 5) for w in ("cosine", "sine")), 0.0)
    waves |= {"sine1": amplitude, "sine2": 0.8 * amplitude, "sine3": amplitude}
    detent = Physics(periodic_force, "m1", {"period": period, **waves})
    for truth in (detent, third):
        e = record(single().with_physics(truth), 5.0, seed=23)
        problem, linear = refit(single(), [e])
        start = np.append(linear.x, np.zeros(3))
        found = settle(problem.experiments, Model(single(), (third,), (scales,)), start)
        line = leftover(*found)
        assert line.significant is (truth is detent)
        assert truth is third or (line.follows, line.over) == ("1", "position")
        other = instead_by_law(*found)
        assert (other is not None) is (truth is detent)
        if other is not None:
            assert float(other.follows.split()[4].strip(",")) == pytest.approx(period, rel=1e-3)
