"""Readings that are filtered: closed forms, in a run, in a prediction, in a loop."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from zwidth.controllers.recorded import recorded
from zwidth.controllers.wall import wall
from zwidth.diagnosis.fitting.many import Many
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import FINAL, innovations, prepared
from zwidth.diagnosis.noise.steady import steady, steady_gains
from zwidth.diagnosis.recording.experiment import Experiment, Output, experiment
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.logs.recording import read_recording
from zwidth.scenarios.concealed.integrator import integrate, width
from zwidth.scenarios.concealed.truth import truth_of
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.plant import hold
from zwidth.sim.population import Population, Readings, Recorded
from zwidth.sim.run import Start, simulate
from zwidth.stability.linear import critical_stiffness

Floats = NDArray[np.float64]
T = 1e-3
ONE = Device("one", "", False, make_chain([2.0], [3.0]), Interface(T))
TWO = Device(
    "two", "", False, make_chain([0.7, 0.3], [4.0, 1.0], 0.0, [200.0], [0.5]), Interface(T, 0.0013)
)
LAG = make_physics("sensor_lag", "sensor", time_constant=0.02)
FILTER = make_physics("sensor_filter", "sensor", time_constant=0.005, damping=0.7)
MEAN = make_physics("moving_average", "sensor", window=0.03)
RATE_LAG = make_physics("sensor_lag", "velocity", time_constant=0.01)


def read(device: Device, quantity: str = "position", mass: int = 1) -> Floats:
    """A reading under a command of noise that is held, of a free device from a speed."""
    u = np.random.default_rng(3).standard_normal(400)
    run = simulate(device, recorded(u), duration=0.4, start=Start(0.1, 0.5))
    return run.trace[f"{quantity}_filtered_m{mass}"]


def test_a_reading_lags_as_the_closed_form_says() -> None:
    """A mass at steady speed v: s = v (t - T) + (s_0 + v T) e^(-t/T), here settled; then a stop.

    Mutation: `let_follow` without the lag (starts v T off), or rate 1 / T^2.
    """
    free = Device("free", "", False, make_chain([2.0], [0.0]), Interface(T)).with_physics(LAG)
    run = simulate(free, recorded(np.zeros(100)), duration=0.1, start=Start(0.1, 0.5))
    t = run.trace.t
    assert np.allclose(run.trace["position_filtered_m1"], 0.1 + 0.5 * (t - 0.02), atol=1e-13)
    assert np.allclose(run.trace["velocity_filtered_m1"], 0.5, atol=1e-13)
    assert np.allclose(run.trace["encoder"], run.trace["position_filtered_m1"], atol=0)
    # m v' = u from rest: q = u t^2 / 2 m, and s' = (q - s) / T has s = a (t^2/2 - T t + T^2 (1-e))
    pushed = simulate(free, recorded(np.ones(100)), duration=0.1)
    grows = 0.5 * (t**2 / 2 - 0.02 * t + 0.02**2 * (1.0 - np.exp(-t / 0.02)))
    assert np.allclose(pushed.trace["position_filtered_m1"], grows, rtol=0, atol=1e-12)


@pytest.mark.parametrize("physics", [LAG, FILTER, MEAN])
def test_a_filter_is_its_transfer_function(physics: Physics) -> None:
    """The plant's response in frequency from force to reading over that to motion.

    Mutation: damping without its 2, or square without its square.
    """
    plant = TWO.with_physics(physics).plant()
    n = plant.dof
    for hertz in (0.5, 5.0, 40.0):
        s = 2j * np.pi * hertz
        x = np.linalg.solve(s * np.eye(plant.size) - plant.a, plant.b[:, 1])
        values = dict(physics.values)
        match physics.effect.name:
            case "sensor_lag":
                wanted = 1.0 / (1.0 + 0.02 * s)
            case "sensor_filter":
                tau = values["time_constant"]
                wanted = 1.0 / (1.0 + 2.0 * values["damping"] * tau * s + (tau * s) ** 2)
            case _:
                w = values["window"]
                wanted = 1.0 / (1.0 + s * w / 2.0 + (s * w) ** 2 / 12.0)
        for i in range(2):
            assert x[2 + i] / x[i] == pytest.approx(wanted, rel=1e-9)
            assert x[n + 2 + i] == pytest.approx(s * x[2 + i], rel=1e-9)


def test_a_mean_is_one_to_the_fourth_power_of_its_window() -> None:
    """Of a sine, against (sin(w t) mean over [t - W, t]); error (w W)^4 / 720, slope 4 +- 0.1.

    Mutation: zeta 0.8 or sqrt(13): the slope is 1 or 2.
    """
    errors = []
    for x in (0.2, 0.4, 0.8):
        s = 1j * x
        errors.append(abs((1.0 - np.exp(-s)) / s - 1.0 / (1.0 + s / 2.0 + s * s / 12.0)))
        assert errors[-1] == pytest.approx(x**4 / 720.0, rel=0.1)
    assert np.diff(np.log2(errors)) == pytest.approx([4.0, 4.0], abs=0.1)
    tau = MEAN.effect.follows
    assert tau is not None
    law = tau(MEAN.values)
    assert law.square == pytest.approx(12.0 / 0.03**2)
    assert law.damping / law.square == pytest.approx(0.03 / 2.0)  # half the window late


def test_a_differenced_velocity_is_a_mean_over_a_sample() -> None:
    """(q_k - q_(k-1)) / T against the filter of window T, under a command of 10 Hz: to 1e-5."""
    mean = make_physics("moving_average", "velocity", window=T)
    t = np.arange(1000) * T
    u = np.sin(2.0 * np.pi * 10.0 * t)
    run = simulate(ONE.with_physics(mean), recorded(u), duration=1.0)
    differenced = np.diff(run.trace["position_m1"]) / T
    shown = run.trace["velocity_filtered_m1"][1:]
    late = run.trace["velocity_m1"][1:]
    after = slice(100, None)
    assert np.abs(differenced - shown)[after].max() < 3e-3 * np.abs(differenced - late)[after].max()


def still_first(ticks: int) -> Floats:
    """A command of noise after twenty ticks of none, in which an observer finds the rest."""
    u = np.random.default_rng(1).standard_normal(ticks)
    u[:20] = 0.0
    return u


def experiment_of(device: Device, outputs: tuple[Output, ...]) -> tuple[Experiment, Floats]:
    """A recording without noise of filtered readings."""
    u = still_first(500)
    run = simulate(device, recorded(u), duration=0.5)
    names = [
        f"{o.quantity}_{'filtered_' if f'{o.quantity}_filtered_m1' in run.trace.channels else ''}"
        f"m{o.mass + 1}"
        for o in outputs
    ]
    measured = np.column_stack([run.trace[name] for name in names])
    return Experiment(T, u, measured, outputs), measured


EVERY = tuple(Output(q, i) for q in ("position", "velocity") for i in range(2))


@pytest.mark.parametrize("physics", [(LAG,), (FILTER,), (LAG, FILTER)])
def test_the_predictor_sees_what_the_run_reads(physics: tuple[Physics, ...]) -> None:
    """All four readings of two masses, without noise: no innovations, alone and in lanes.

    Mutation: `places` of the true states: innovations as large as the lag.
    """
    device = TWO.with_physics(*physics)
    e, measured = experiment_of(device, EVERY)
    if len(physics) == 2:
        u = still_first(500)
        run = simulate(device, recorded(u), duration=0.5)
        twice = [f"{o.quantity}_filtered_filtered_m{o.mass + 1}" for o in EVERY]
        measured = np.column_stack([run.trace[name] for name in twice])
        e = Experiment(T, u, measured, EVERY)
    gain = steady(device, e, 1e-2).gain
    found = innovations(device, e, gain)
    assert np.abs(found).max() < 1e-9 * np.abs(measured).max()
    population = Population([device] * 3, 1, 1)
    starts = population.start(np.zeros((3, 2)), np.zeros((3, 2)))
    followed = population.follow(
        Recorded(e.command, e.measured, e.places(population)), starts, Readings(gain), keep=True
    )
    assert np.array_equal(followed.innovations[0], followed.innovations[2])
    assert np.abs(followed.innovations[0] - found).max() < 1e-12
    assert np.allclose(steady_gains([device] * 2, e, 1e-2)[1], gain, rtol=1e-6, atol=1e-9)
    raw = innovations(TWO, e, steady(TWO, e, 1e-2).gain, ready=prepared(TWO, FINAL))
    assert np.abs(raw).max() > 1e-2 * np.abs(measured).max()


def test_a_filter_of_velocities_leaves_positions_as_they_are() -> None:
    device = TWO.with_physics(RATE_LAG)
    eq = device.reading()
    assert eq.reads.tolist() == [[0, 1], [2, 3]]
    u = still_first(500)
    run = simulate(device, recorded(u), duration=0.5)
    names = ["position_m1", "position_m2", "velocity_filtered_m1", "velocity_filtered_m2"]
    e = Experiment(T, u, np.column_stack([run.trace[n] for n in names]), EVERY)
    found = innovations(device, e, steady(device, e, 1e-2).gain)
    assert np.abs(found).max() < 1e-9 * np.abs(e.measured).max()


def test_an_observer_of_what_stands_unseen_knows_the_lag() -> None:
    """Velocities alone, nothing tied to ground: the gain is that of the same device tied by hardly
    anything, but for where it stands. Mutation: followers left out of what moves with m1.
    """
    outputs = (Output("velocity", 0), Output("velocity", 1))
    device = TWO.with_physics(LAG)
    e, _ = experiment_of(device, outputs)
    free = steady(device, e, 1e-2).gain
    tied = device.with_chain(device.chain._replace(ground_spring=1e-6))
    near = steady(tied, e, 1e-2).gain
    assert np.allclose(free[4:], near[4:], rtol=1e-3, atol=1e-3 * np.abs(near[4:]).max())


def test_the_loop_of_a_wall_sees_the_lag() -> None:
    """A lag of the reading counts as delay at low frequency: K_CR of one mass within 3 %.

    K < (b + B) / (T/2 + delay + lag), and the time domain decides alike (the run decays below and
    grows above). Mutation: the linear loop or the run reads the true position.
    """
    device = ONE.with_physics(make_physics("sensor_lag", "sensor", time_constant=0.004))
    most = critical_stiffness(device, 0.0).stiffness
    assert most is not None
    assert most == pytest.approx(3.0 / (0.0005 + 0.004), rel=0.03)
    for factor, grows in ((0.97, False), (1.03, True)):
        law = wall(factor * most, 0.0, one_sided=False)
        run = simulate(device, law, duration=20.0, start=Start(0.01))
        q = np.abs(run.trace["position_m1"])
        assert (q[-2000:].max() > q[5000:7000].max()) == grows


def test_hold_is_exact_with_followers() -> None:
    """The kernel's propagator against scipy's expm, alone: 1e-12 of the largest."""
    device = TWO.with_physics(LAG, FILTER)
    ad, bd = hold(device.plant(), T)
    eq = prepared(device).coarse
    packed = eq.propagators[1, 0]
    rows = packed.transpose(0, 2, 1).reshape(-1, packed.shape[1])[: eq.states]
    whole = hold(device.plant(), float(eq.durations[1]))[0]
    assert np.abs(rows[:, : eq.states] - whole).max() < 1e-12 * np.abs(whole).max()
    assert ad.shape == (12, 12)
    assert not bd[4:6].any() or np.abs(bd[4:6]).max() < np.abs(bd[6:8]).max()


def test_friction_tells_a_lag_of_the_reading_from_one_of_the_amplifier() -> None:
    """Both beside Coulomb friction, from a mass 10 % off: each recording is its own lag's.

    Without friction they are one. Mutation: the population reads the motion itself (`places`).
    """
    random = np.random.default_rng(5)
    command = np.repeat(random.normal(0.0, 1.0, 200), 10)
    friction = make_physics("coulomb_friction", "m1", level=0.4)
    lags = {
        "sensor_lag": make_physics("sensor_lag", "sensor", time_constant=0.008),
        "actuator_lag": make_physics("actuator_lag", "command", time_constant=0.008),
    }
    guessed = ONE.with_chain(make_chain([2.2], [3.0]))
    for true, physics in lags.items():
        run = simulate(
            ONE.with_physics(friction, physics), recorded(command), duration=2.0, substeps=16
        )
        read = "position_filtered_m1" if true == "sensor_lag" else "position_m1"
        noisy = run.trace[read] + 1e-7 * random.standard_normal(2000)
        e = Experiment(T, command, noisy[:, None], (Output("position", 0),))
        costs = {}
        for name, start in lags.items():
            model = Model(guessed)
            model = model.with_effect(friction, {"level": 0.2})
            model = model.with_effect(start, {"time_constant": 0.004})
            x = np.zeros(len(model.parameters))
            x[-1] = -0.8
            found = settled(judged([e], model, x))
            costs[name] = found.cost.total
            if name == true:
                values = model.effects_at(found.x)
                assert values[0].values["level"] == pytest.approx(0.4, rel=0.02)
                assert values[1].values["time_constant"] == pytest.approx(0.008, rel=0.03)
        other = next(name for name in lags if name != true)
        assert costs[true] < costs[other] - 20.0


def test_the_truth_of_a_concealed_recording_reads_alike() -> None:
    """Another integrator (Runge-Kutta, 20 steps per tick): a row of two filters, 1e-5 of the lag.

    Mutation: the rate fed by the reading's position, or `reads` of the first filter.
    """
    device = TWO.with_physics(FILTER, RATE_LAG)
    u = still_first(200)
    truth = truth_of(device, 20)
    states = np.zeros((200, width(truth)))
    still = np.zeros(200)
    _, y, done = integrate(
        truth, T, 20, u, np.zeros(2), still, still.astype(np.bool_), still, still, states
    )
    assert done == 200
    run = simulate(device, recorded(u), duration=0.2)
    for ours, theirs, raw in (
        (run.trace["encoder"], y, run.trace["position_m1"]),
        (run.trace["position_filtered_m2"], states[:, truth.reads[0, 1]], run.trace["position_m2"]),
        (
            run.trace["velocity_filtered_filtered_m2"], states[:, truth.reads[2, 1]],
            run.trace["velocity_m2"],
        ),
    ):  # fmt: skip
        assert np.abs(ours - theirs).max() < 1e-5 * np.abs(ours - raw).max()


def test_a_log_of_a_simulation_is_seen_as_it_was_read() -> None:
    """Of two filters in a row the second's reading. Mutation: `_as_read` left out."""
    device = ONE.with_physics(LAG, FILTER)
    run = simulate(device, recorded(still_first(300)), duration=0.3)
    e = experiment(run.trace, device)
    assert [o.name for o in e.outputs] == ["position_m1"]
    read = run.trace["position_filtered_filtered_m1"]
    apart = np.abs(read - run.trace["position_m1"]).max()
    assert np.abs(e.measured[:, 0] - read).max() < 1e-3 * apart
    assert np.array_equal(read, run.trace["encoder"])


RACK = Path(__file__).parents[1].parent / "shared" / "recordings" / "rack_and_pinion" / "rp4.mat"


@pytest.mark.skipif(not RACK.exists(), reason="the rack's recordings are not ours to pass on")
def test_the_low_pass_of_a_real_rack_is_seen_beside_its_friction(tmp_path: Path) -> None:
    """It was low-passed at 30 Hz: a lag of 5.3 ms is in its readings, and not in its amplifier.

    One fit of each beside Coulomb friction, from 5 ms and 12 N. Mutation: the reading not filtered.
    """
    toml = tmp_path / "rp4.toml"
    toml.write_text(
        f"file = {str(RACK)!r}\nrotary = false\ntime = 't'\n[input]\nsignal = 'F'\nunit = 'N'\n"
        "[[output]]\nsignal = 'v'\nquantity = 'velocity'\nat = 'm1'\nunit = 'm/s'\n"
    )
    rack = Device("rack", "", False, make_chain([24.7], [50.0]), Interface(period=1.0 / 1500.0))
    e, _ = experiment(read_recording(toml), rack).split()
    costs = {}
    for name, at in (("sensor_lag", "sensor"), ("actuator_lag", "command")):
        model = Model(rack)
        friction = make_physics("coulomb_friction", "m1", level=12.0)
        model = model.with_effect(friction, {"level": 6.0})
        lag = make_physics(name, at, time_constant=5e-3)
        model = model.with_effect(lag, {"time_constant": 3e-3})
        found = settled(judged([e], model, np.zeros(len(model.parameters))))
        costs[name] = found.cost.total
        if name == "sensor_lag":
            dry, late = model.effects_at(found.x)
            assert 1.0 / (2.0 * np.pi * late.values["time_constant"]) == pytest.approx(
                30.0, rel=0.2
            )
            assert 9.0 < dry.values["level"] < 18.0
    assert costs["sensor_lag"] < costs["actuator_lag"] - 100.0


def test_an_observer_of_readings_that_lag_drives_no_device_without_the_lag_away() -> None:
    """It makes up for the lag, by differences: without it those would grow from tick to tick.

    Alone and in lanes. Mutation: `padded` without a look at whether the observer settles.
    """
    slow = make_physics("sensor_lag", "sensor", time_constant=0.005)
    e, _ = experiment_of(ONE.with_physics(slow), (Output("velocity", 0),))
    for ratio in (1e-2, 1.0, 1e2, 1e4):
        gain = steady(ONE.with_physics(slow), e, ratio).gain
        alone = innovations(ONE, e, gain)
        assert np.abs(alone).max() < 3.0 * np.abs(e.measured).max()
        each = Many(Model(ONE), list(np.zeros((2, len(Model(ONE).parameters)))), FINAL)
        assert np.abs(each.innovations(e, gain)[1] - alone).max() < 1e-9
