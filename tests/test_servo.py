"""Servos and prescribed motions: a loop on the position of m1, whose command is the goal."""

import math
from dataclasses import replace

import numpy as np
import pytest
from physics_examples import phantom
from scipy.integrate import solve_ivp

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.seeking.places import open_places
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.sim.chain import make_chain
from zwidth.sim.changes import changes_of
from zwidth.sim.device import Device, DeviceError
from zwidth.sim.device_file import device_from_text, device_to_text
from zwidth.sim.drive import Drive
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.run import simulate
from zwidth.sim.uncertainty import Uncertainty

J, R, KT, KP, KD, U, T = 0.03, 2.1, 1.5, 16.0, 0.4, 12.0, 0.01
PENDULUM = make_physics("gravity_pendulum", "m1", level=0.8, angle=0.0)
ARM = Device("arm", "", True, make_chain([J], [0.02]), Interface(period=T))
SERVO = Drive("servo", KT, R, supply_v=U, proportional=KP, derivative=KD).on(ARM)
K = KT / R * KP


def square(seconds: float) -> np.ndarray:
    return 2.0 * np.sign(np.sin(2.0 * T * np.arange(round(seconds / T))))


def angle(device: Device, goal: np.ndarray, substeps: int) -> np.ndarray:
    run = simulate(device, recorded(goal), duration=goal.size * T, substeps=substeps)
    return run.trace["position_m1"]


def integrated(goal: np.ndarray, zone: float = 0.0) -> np.ndarray:
    """The loop's own equations, tick by tick."""

    def rate(_: float, y: np.ndarray, now: float) -> list[float]:
        e = now - y[0]
        e -= np.clip(e, -zone, zone)
        volts = np.clip(KP * e - KD * y[1], -U, U)
        force = KT / R * (volts - KT * y[1]) - 0.02 * y[1] - 0.8 * math.sin(y[0])
        return [y[1], force / J]

    y, found = np.zeros(2), [0.0]
    for now in goal[:-1]:
        y = solve_ivp(rate, (0.0, T), y, args=(now,), rtol=1e-9, atol=1e-11).y[:, -1]
        found.append(float(y[0]))
    return np.array(found)


@pytest.mark.parametrize("zone", [0.0, 0.05])
def test_a_servo_is_its_loop_on_a_winding_integrated(zone: float):
    """Second order, through its limit and its zone. Mutation: the back-EMF inside the limit."""
    goal = square(3.0)
    extra = (make_physics("servo_dead_zone", "m1", half=zone),) if zone else ()
    # At the limit the zone is not seen, see there: so much of it is left of the limit.
    wide = make_physics("servo_limit", "m1", limit=KT / R * U + K * zone)
    device = SERVO.with_physics(PENDULUM, *extra, *((wide,) if zone else ()))
    truth = integrated(goal, zone)
    errors = [float(np.abs(angle(device, goal, n) - truth).max()) for n in (4, 16, 64)]
    assert errors[0] < 2e-3
    assert errors[2] < 3e-5
    assert errors[2] < 0.1 * errors[1] < 0.02 * errors[0] + 1e-9


def test_a_position_drive_is_a_spring_whose_other_end_is_moved():
    """At rest the spring carries the weight: K (goal - q) = level sin q."""
    device = Drive("position", stiffness=5.0, damping=0.3).on(ARM).with_physics(PENDULUM)
    q = float(angle(device, np.full(2000, 1.0), 4)[-1])
    assert 5.0 * (1.0 - q) == pytest.approx(0.8 * math.sin(q), rel=1e-9)


def test_a_limit_is_what_a_position_drive_gives_at_most():
    """A load of 0.8 N m on a drive of 0.5: it hangs where 0.8 sin q = 0.5."""
    device = Drive("position", stiffness=5.0, damping=0.3, limit=0.5).on(ARM)
    q = float(angle(device.with_physics(PENDULUM), np.full(12000, 2.0), 4)[-1])
    assert math.sin(q) == pytest.approx(0.5 / 0.8, rel=1e-9)


def test_friction_of_the_load_takes_its_share_of_the_drive():
    """A command of u moves m1 as (1 - ratio) u; what it holds still, it holds within its bounds."""
    force, ratio = 0.3, 0.25
    free = Device("mass", "", True, make_chain([J], [0.0]), Interface(period=T))
    rubbed = free.with_physics(make_physics("load_friction", "m1", ratio=ratio))
    t = T * np.arange(100)
    np.testing.assert_allclose(
        angle(rubbed, np.full(100, force), 1), 0.5 * (1.0 - ratio) * force / J * t**2, atol=1e-12
    )
    # Of a weight of 0.8 N m on a servo: what lifts it slowest stops (1 + ratio) K e = 0.8 early.
    device = SERVO.with_physics(make_physics("constant_force", "m1", level=-0.8))
    sticks = device.with_physics(make_physics("load_friction", "m1", ratio=ratio))
    plain, stuck = (float(angle(d, np.full(1500, 1.0), 4)[-1]) for d in (device, sticks))
    assert K * (1.0 - plain) == pytest.approx(0.8, rel=1e-9)
    assert 0.8 / (1.0 + ratio) - 1e-9 <= K * (1.0 - stuck) <= 0.8 / (1.0 - ratio) + 1e-9


def test_what_a_servo_is_stands_in_the_device_file():
    text = device_to_text(SERVO)
    assert device_from_text(text) == SERVO
    head = 'schema = 1\nname = "arm"\nrotary = true\n[chain]\nmasses = [0.03]\n'
    head += "ground_dampers = [0.02]\n[interface]\nperiod_s = 0.01\n[drive]\n"
    drive = f"motor_constant = {KT}\nresistance_ohm = {R}\nsupply_v = {U}\n"
    own = f'kind = "servo"\n{drive}proportional = {KP}\nderivative = {KD}\n'
    assert device_from_text(head + own) == SERVO
    for wrong, says in (
        (f'kind = "servo"\n{drive}', "drive.proportional is missing"),
        ('kind = "position"\nstiffness = 0.0', "drive.stiffness is 0; it must be a finite number"),
        ('kind = "position"\nstiffness = 1.0\nlimit = 0.0', "drive.limit is 0; it must be"),
        ('kind = "position"\nstiffness = 1.0\ngear = 2.0', "unknown key 'drive.gear'"),
    ):
        with pytest.raises(DeviceError, match=says):
            device_from_text(head + wrong)


def test_what_acts_in_a_loop_is_sought_where_there_is_one():
    def sought(device: Device) -> set[str]:
        return {effect.name for effect, _ in open_places(device)}

    without = Drive("position", stiffness=5.0).on(ARM)
    assert {"servo_limit", "servo_dead_zone"} <= sought(without)
    assert "servo_limit" not in sought(SERVO)  # which has one
    assert not sought(phantom()) & {"position_servo", "servo_limit", "servo_dead_zone"}
    assert "load_friction" in sought(phantom())


def recording(device: Device, goal: np.ndarray, seed: int, changes: dict[str, object]):
    """A recording; the run's command counts more, and not the device's (`Changes`)."""
    known = changes_of(changes, SERVO)
    there, counts = (device, 1.0) if known is None else (known.of(device), known.command_gain)
    q = angle(there, counts * goal, 20)
    y = q + 2e-4 * np.random.default_rng(seed).standard_normal(q.size)
    outputs = (Output("position", 0),)
    name = f"run{seed}"
    return Experiment(
        T, counts * goal, y[:, None], outputs, name, float(q.std()), changes=known
    )  # fmt: skip


def test_a_fit_tells_weight_and_friction_of_a_servo_from_runs_at_two_gains():
    """Within 3 %. Mutation: the fourfold gain left out of the servo's own part."""
    truth = SERVO.with_physics(PENDULUM, make_physics("load_friction", "m1", ratio=0.2))
    t = T * np.arange(900)
    goals = [1.2 * np.sin(3.0 * t + p) + 0.3 * np.sin(11.0 * t) for p in (0.0, 1.0)]
    fourfold: dict[str, object] = {
        "command_gain": 4.0 * SERVO.interface.command_gain,
        "physics": [{"effect": "position_servo", "at": "m1", "stiffness": 4.0 * K}],
    }
    runs = [recording(truth, goals[0], 1, {}), recording(truth, goals[1], 2, fourfold)]
    guessed = SERVO.with_chain(make_chain([0.04], [0.02]))
    model = Model(guessed)
    for physics, scales in (
        (
            Physics(PENDULUM.effect, "m1", {"level": 0.4, "angle": 0.0}),
            {"level": 0.4, "angle": 0.3},
        ),
        (make_physics("load_friction", "m1", ratio=0.05), {"ratio": 0.1}),
    ):
        model = model.with_effect(physics, scales)
    found = settled(judged(runs, model, np.zeros(len(model.parameters))))
    weight, rubs = (p.values for p in model.effects_at(found.x))
    assert weight["level"] == pytest.approx(0.8, rel=0.03)
    assert rubs["ratio"] == pytest.approx(0.2, rel=0.05)
    assert model.acting(found.x).chain.masses[0] == pytest.approx(J, rel=0.03)


def test_the_force_of_a_servo_is_what_its_loop_asks_for():
    """Not the goal's, which is many times that. Mutation: `_force` without the position."""
    goal = 1.2 * np.sin(3.0 * T * np.arange(600))
    run = recording(SERVO.with_physics(PENDULUM), goal, 1, {})
    sizes = sizes_of(SERVO, [run])
    asked = K * (goal - run.measured[:, 0])
    assert sizes.force == pytest.approx(float(np.sqrt(np.mean(asked**2))), rel=1e-9)
    assert sizes.force < 0.4 * K * float(np.sqrt(np.mean(goal**2)))


def drive(scale: float, fold: float = 1.0) -> Device:
    """An arm on a position drive whose forces count so much, at a gain so many times."""
    own = Drive("position", stiffness=6.0 * scale * fold, damping=0.3 * scale, limit=4.0 * scale)
    return own.on(ARM).with_physics(PENDULUM)


def test_the_scale_of_a_servo_is_told_by_a_known_payload():
    """Its constants are guessed 20 % low; a run with twice the weight, and mass, tells.

    Mutations: the scale on the goal alone; a fourfold gain added and not multiplied.
    """
    low, heavier = 0.8, replace(PENDULUM, values={"level": 1.6, "angle": 0.0})
    guessed = replace(drive(low), uncertainty=Uncertainty(command_scale=0.3))
    gain = 4.0 * guessed.interface.command_gain
    payload = {"effect": "gravity_pendulum", "at": "m1", "level": 1.6}
    stiffer = {"effect": "position_servo", "at": "m1", "stiffness": gain}
    loaded = drive(1.0).with_chain(make_chain([2.0 * J], [0.02])).with_physics(heavier)
    runs: list[Experiment] = []
    for i, (own, said) in enumerate(
        (
            (drive(1.0), {}),
            (loaded, {"masses": [2.0 * J], "physics": [payload]}),
            (drive(1.0, 4.0), {"command_gain": gain, "physics": [stiffer]}),
        )
    ):
        t, known = T * np.arange(900), changes_of(said, guessed)
        goal = 1.2 * np.sin(3.0 * t + i) + 0.3 * np.sin(11.0 * t)
        y = angle(own, goal, 20) + 2e-4 * np.random.default_rng(i).standard_normal(900)
        counts = 1.0 if known is None else known.command_gain
        outputs = (Output("position", 0),)
        runs.append(
            Experiment(T, counts * goal, y[:, None], outputs, f"run{i}", y.std(), changes=known)
        )
    model = Model(guessed)
    found = settled(judged(runs, model, np.zeros(len(model.parameters))))
    assert model.reads(found.x).gain == pytest.approx(1.0 / low, rel=0.01)
    servo = next(p for p in model.build(found.x).physics if p.effect.name == "position_servo")
    assert servo.values["stiffness"] == pytest.approx(6.0, rel=0.01)
