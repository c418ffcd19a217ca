"""A base that moves: its inertial force in the kernel, and as a known input of a recording."""

from pathlib import Path

import numpy as np
import pytest

from zwidth.controllers.none import none
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.noise.predictor import innovations
from zwidth.diagnosis.noise.steady import steady
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError, Output, experiment
from zwidth.diagnosis.recording.from_outside import held
from zwidth.logs.recording import read_recording
from zwidth.scenarios.disturbance import Disturbance
from zwidth.scenarios.scenario import Scenario
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.population import Population, Readings, Recorded
from zwidth.sim.run import Start, simulate

T = 1e-3
CHAIN = make_chain([0.7, 0.3], [4.0, 1.0], 300.0, [200.0], [0.5])
TWO = Device("two", "", False, CHAIN, Interface(T))


def test_a_base_that_falls_is_gravity_turned_round() -> None:
    """Free masses under a base of acceleration a: q = -a t^2 / 2 of both, and no stretch between.

    Mutation: the force without the mass, or with its sign.
    """
    free = Device("free", "", False, make_chain([0.7, 0.3], [0, 0], 0.0, [200.0], [0.5]))
    outside = np.column_stack([np.zeros((500, 2)), np.full(500, 3.0)])
    run = simulate(free, none(), duration=0.5, disturbance=outside, ledger=True)
    for i in (1, 2):
        assert np.allclose(run.trace[f"position_m{i}"], -1.5 * run.trace.t**2, atol=1e-12)
    assert run.ledger["disturbance"] == pytest.approx(0.5 * 1.0 * (3.0 * 0.5) ** 2, rel=1e-9)


def test_a_base_is_forces_of_minus_mass_times_its_acceleration() -> None:
    """With friction, an extra mode and a filter beside: what the same forces on all masses do."""
    device = TWO.with_physics(
        make_physics("extra_mode", "m2", mass=0.1, stiffness=50.0, damping=0.3),
        make_physics("coulomb_friction", "m1", level=0.1),
        make_physics("sensor_lag", "sensor", time_constant=0.01),
    )
    a = np.random.default_rng(1).standard_normal(300)
    forces = -a[:, None] * np.array([0.7, 0.3, 0.1])
    shaken = np.column_stack([np.zeros((300, 3)), a])
    found = simulate(device, none(), duration=0.3, disturbance=shaken, substeps=4)
    wanted = simulate(device, none(), duration=0.3, disturbance=forces, substeps=4)
    for channel, values in wanted.trace.channels.items():
        assert np.allclose(found.trace[channel], values, rtol=0, atol=1e-13), channel


@pytest.mark.parametrize("quantity", ["position", "velocity", "acceleration"])
def test_the_acceleration_held_is_that_of_the_base(quantity: str) -> None:
    """Of a sine: the mean of its acceleration over each tick, to second order in the tick.

    Mutation: the acceleration at the tick's beginning: an error of first order.
    """
    w = 2.0 * np.pi * 3.0
    errors = []
    for period in (4e-3, 2e-3, 1e-3):
        t = period * np.arange(round(1.0 / period))
        shown = {
            "position": np.sin(w * t), "velocity": w * np.cos(w * t),
            "acceleration": -w * w * np.sin(w * t),
        }  # fmt: skip
        mean = w * np.diff(np.cos(w * np.append(t, t[-1] + period))) / period
        errors.append(float(np.abs(held(shown[quantity], quantity, period) - mean)[10:-10].max()))
    if quantity == "velocity":
        assert max(errors) < 1e-9
    else:
        assert np.all(np.diff(np.log2(errors)) < -1.9)


def test_a_scenario_shakes_its_base() -> None:
    shake = Disturbance("sine", 2.0, "base", frequency_hz=5.0)
    scenario = Scenario(TWO, none(), 0.2, Start(), (shake,))
    forces = scenario.forces()
    assert forces is not None
    assert forces.shape == (200, 3)
    assert not forces[:, :2].any()
    assert np.ptp(forces[:, 2]) > 3.9


def recording(folder: Path) -> Path:
    """A recording of a chain on a base that moves, with its TOML."""
    t = T * np.arange(2000)
    a = np.sin(2.0 * np.pi * 4.0 * t) + 0.5 * np.sin(2.0 * np.pi * 9.0 * t)
    mean = np.append(0.5 * (a[1:] + a[:-1]), a[-1])
    u = np.random.default_rng(2).standard_normal(2000)
    u[:20] = mean[:20] = a[:20] = 0.0
    shaken = np.column_stack([np.zeros((2000, 2)), mean])
    run = simulate(TWO, recorded(u), duration=2.0, disturbance=shaken)
    columns = np.column_stack([t, u, run.trace["position_m1"], a])
    np.savetxt(folder / "base.csv", columns, "%.17g", ",", header="t,u,q,floor", comments="")
    toml = folder / "base.toml"
    toml.write_text(
        'file = "base.csv"\ntime = "t"\nrotary = false\n[input]\nsignal = "u"\n[[output]]\n'
        'signal = "q"\nquantity = "position"\nat = "m1"\n[base]\nsignal = "floor"\nunit = "m/s2"\n'
        'quantity = "acceleration"\n'
    )
    return toml


def test_a_recorded_base_is_a_known_input(tmp_path: Path) -> None:
    """Nothing is left of a recording whose base moves, alone and in lanes; without [base] much is.

    Mutation: `external` without the base, or a part of a recording that keeps all of it.
    """
    trace = read_recording(recording(tmp_path))
    e = experiment(trace, TWO)
    assert any("base" in note for note in e.notes)
    gain = steady(TWO, e, 1.0).gain
    found = innovations(TWO, e, gain)[100:]
    size = float(np.abs(e.measured).max())
    assert np.abs(found).max() < 1e-4 * size
    part = e.part(500, 1500)
    assert part.base is not None
    assert np.abs(innovations(TWO, part, gain)[300:]).max() < 1e-3 * size
    population = Population([TWO] * 2, 1, 1)
    starts = population.start(np.zeros((2, 2)), np.zeros((2, 2)))
    taken = Recorded(e.command, e.measured, e.places(population), e.external(2))
    kept = population.follow(taken, starts, Readings(gain), keep=True).innovations
    assert np.abs(kept[0][100:] - found).max() < 1e-10 * size
    still = Experiment(T, e.command, e.measured, (Output("position", 0),))
    lost = np.abs(innovations(TWO, still, gain)[500:]).max()
    assert np.abs(found[400:]).max() < 1e-3 * lost


def test_a_measured_force_of_a_hand_is_a_known_input(tmp_path: Path) -> None:
    """On m2, beside a command: nothing is left, and without [[known_force]] much is.

    Mutation: the force on m1, or not halved with the sample after.
    """
    t = T * np.arange(2000)
    hand = np.sin(2.0 * np.pi * 3.0 * t) + 0.5 * np.sin(2.0 * np.pi * 7.0 * t)
    hand[:20] = 0.0
    u = np.random.default_rng(2).standard_normal(2000)
    u[:20] = 0.0
    mean = np.append(0.5 * (hand[1:] + hand[:-1]), hand[-1])
    run = simulate(TWO, recorded(u), duration=2.0, disturbance=np.outer(mean, [0.0, 1.0]))
    columns = np.column_stack([t, u, run.trace["position_m1"], hand])
    np.savetxt(tmp_path / "h.csv", columns, "%.17g", ",", header="t,u,q,hand", comments="")
    text = (
        'file = "h.csv"\ntime = "t"\nrotary = false\n[input]\nsignal = "u"\n[[output]]\n'
        'signal = "q"\nquantity = "position"\nat = "m1"\n'
    )
    toml = tmp_path / "h.toml"
    toml.write_text(text + '[[known_force]]\nsignal = "hand"\nat = "m2"\n')
    e = experiment(read_recording(toml), TWO)
    assert any("has a force" in note and "at m2" in note for note in e.notes)
    gain = steady(TWO, e, 1.0).gain
    left = np.abs(innovations(TWO, e, gain)[500:]).max()
    toml.write_text(text)
    alone = experiment(read_recording(toml), TWO)
    assert left < 1e-3 * np.abs(innovations(TWO, alone, gain)[500:]).max()
    one = Device("one", "", False, make_chain([1.0], [1.0]), Interface(T))
    toml.write_text(text + '[[known_force]]\nsignal = "hand"\nat = "m2"\n')
    with pytest.raises(ExperimentError, match="has known_force_m2, but the device has 1 mass;"):
        experiment(read_recording(toml), one)
