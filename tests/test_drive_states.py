"""Drives that are switched off or on another supply, and goals and forces that are held back."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.inverse import lacks
from zwidth.diagnosis.learning.event_force import LEAD, Window
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import Experiment, Output, stretches
from zwidth.diagnosis.seeking.places import open_places, starts_at
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.logs.recording import read_recording
from zwidth.logs.source import RecordingError
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device, DeviceError
from zwidth.sim.device_file import device_from_text, device_to_text
from zwidth.sim.drive import Drive
from zwidth.sim.equations import equations
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.population import Population, Readings, Recorded
from zwidth.sim.predict import Outputs, alone
from zwidth.sim.run import Start, simulate, start_memory

J, B, R, KT, KP, KD, U, T = 0.03, 0.02, 2.1, 1.5, 16.0, 0.4, 12.0, 0.01
K, BACK = KT / R * KP, KT * KT / R
ARM = Device("arm", "", True, make_chain([J], [B]), Interface(period=T))
SERVO = Drive("servo", KT, R, supply_v=U, proportional=KP, derivative=KD).on(ARM)
PENDULUM = make_physics("gravity_pendulum", "m1", level=0.8, angle=0.0)
PLACES = Outputs(np.array([0]), np.array([False]), np.array([31]), np.zeros(1))


def angle(device: Device, goal: np.ndarray, substeps: int = 8) -> np.ndarray:
    run = simulate(device, recorded(goal), duration=goal.size * T, substeps=substeps)
    return run.trace["position_m1"]


def followed(
    device: Device, goal: np.ndarray, strengths: np.ndarray, start: Start, substeps: int = 8
) -> np.ndarray:
    """Positions of m1 (ticks,) of a free run under a command and the strengths of its drive."""
    eq = equations(device, substeps)
    still, blind = np.zeros((goal.size, 1)), np.zeros((eq.states, 1))
    memory, none = start_memory(eq, start), np.zeros((0, eq.dof))
    return -alone(eq, eq, PLACES, goal, still, blind, none, memory, strengths)[:, 0]


@pytest.mark.parametrize(("way", "damper"), [("shorted", B + BACK), ("open", B)])
def test_what_brakes_a_drive_that_is_off_is_its_winding_where_that_is_shorted(
    way: str, damper: float
):
    """q = v J / c (1 - exp(-c t / J)). Mutations: s clip(a) without s; b v at full
    strength.
    """
    device = device_from_text(
        device_to_text(ARM) + f'[drive]\nkind = "servo"\nmotor_constant = {KT}\nresistance_ohm ='
        f' {R}\nsupply_v = {U}\nproportional = {KP}\nwhen_off = "{way}"\n'
    )
    t = T * np.arange(60)
    off = followed(device, np.full(60, 1.0), np.zeros(60), Start(0.2, 3.0), 32)
    truth = 0.2 + 3.0 * J / damper * (1.0 - np.exp(-damper * t / J))
    np.testing.assert_allclose(off, truth, atol=2e-4)
    coarse = followed(device, np.full(60, 1.0), np.zeros(60), Start(0.2, 3.0), 8)
    assert np.abs(off - truth).max() < 0.1 * np.abs(coarse - truth).max() < 1e-3
    on, whole = (
        followed(device, np.full(60, 1.0), strengths, Start(0.2, 3.0))
        for strengths in (np.ones(60), np.zeros(0))
    )
    np.testing.assert_array_equal(on, whole)
    plain = Drive("servo", KT, R, supply_v=U, proportional=KP).on(ARM)
    same = followed(plain, np.full(60, 1.0), np.ones(60), Start(0.2, 3.0))
    np.testing.assert_allclose(on, same, rtol=0.0, atol=1e-12)


def test_a_duty_counts_by_the_supply_that_was_recorded():
    """q = s u t^2 / 2 J of a drive without back-EMF, through its lag. Mutation: s left out of x."""
    device = Drive("duty", KT, R, supply_v=U, back_emf=0.0).on(
        Device("mass", "", True, make_chain([J], [0.0]), Interface(period=T))
    )
    t, duty = T * np.arange(50), 0.5
    found = followed(device, np.full(50, duty), np.full(50, 0.8), Start(), 1)
    np.testing.assert_allclose(found, 0.8 * duty * U * KT / R / J * 0.5 * t**2, rtol=1e-9)


def test_a_servo_on_a_supply_that_sags_is_its_loop_integrated():
    """Second order, with the supply a sine. Mutation: the strength on the limit alone."""
    goal = 2.0 * np.sign(np.sin(2.0 * T * np.arange(300)))
    sags = 0.8 + 0.2 * np.cos(5.0 * T * np.arange(300))

    def rate(_: float, y: np.ndarray, now: float, s: float) -> list[float]:
        volts = s * np.clip(KP * (now - y[0]) - KD * y[1], -U, U)
        force = KT / R * (volts - KT * y[1]) - B * y[1] - 0.8 * math.sin(y[0])
        return [y[1], force / J]

    y, truth = np.zeros(2), [0.0]
    for now, s in zip(goal[:-1], sags[:-1], strict=True):
        y = solve_ivp(rate, (0.0, T), y, args=(now, s), rtol=1e-9, atol=1e-11).y[:, -1]
        truth.append(float(y[0]))
    device = SERVO.with_physics(PENDULUM)
    errors = [np.abs(followed(device, goal, sags, Start(), n) - truth).max() for n in (4, 16, 64)]
    assert errors[0] < 2e-3
    assert errors[2] < 3e-5
    assert errors[2] < 0.1 * errors[1] < 0.02 * errors[0] + 1e-9


@pytest.mark.parametrize("fold", [1.0, 4.0])
def test_a_goal_that_is_held_back_is_the_ramp_that_it_makes(fold: float):
    """To the bit, at every gain. Mutation: the rate not times the stiffness of the loop."""
    rate = 1.5
    loop = Drive("servo", KT, R, supply_v=U, proportional=fold * KP, goal_rate=rate).on(ARM)
    step = np.concatenate([np.full(50, 2.0), np.full(100, -1.0)])
    ramp = [0.0]
    for goal in step:
        ramp.append(ramp[-1] + float(np.clip(goal - ramp[-1], -rate * T, rate * T)))
    plain = Drive("servo", KT, R, supply_v=U, proportional=fold * KP).on(ARM)
    np.testing.assert_allclose(
        angle(loop, step), angle(plain, np.array(ramp[1:])), rtol=0.0, atol=1e-12
    )


def test_a_force_that_is_held_back_is_the_ramp_that_it_makes():
    """Mutation: the first tick of a recording held back from zero."""
    device = ARM.with_physics(make_physics("rate_limit", "command", rate=20.0))
    step = np.concatenate([np.full(10, 1.0), np.full(40, -1.0)])
    ramp = np.concatenate([np.full(10, 1.0), np.maximum(1.0 - 0.2 * np.arange(1, 41), -1.0)])
    own, plain = (followed(d, u, np.zeros(0), Start()) for d, u in ((device, step), (ARM, ramp)))
    np.testing.assert_allclose(own, plain, rtol=0.0, atol=1e-12)
    from_rest = simulate(device, recorded(step), duration=0.5).trace["applied"]
    assert from_rest[0] == pytest.approx(0.2)  # a law begins with nothing commanded


def integrated(goal: np.ndarray, rate: float, most: float) -> np.ndarray:
    """A PID loop's own equations, tick by tick, its integral clamped."""

    def moves(_: float, y: np.ndarray, now: float) -> list[float]:
        e = now - y[0]
        force = np.clip(K * e - KT / R * KD * y[1] + y[2], -KT / R * U, KT / R * U)
        grows = rate * K * e
        if (y[2] >= most and grows > 0.0) or (y[2] <= -most and grows < 0.0):
            grows = 0.0
        total = force - (BACK + B) * y[1] - 0.8 * math.sin(y[0])
        return [y[1], total / J, grows]

    y, found = np.zeros(3), [0.0]
    for now in goal[:-1]:
        y = solve_ivp(moves, (0.0, T), y, args=(now,), rtol=1e-8, atol=1e-10, max_step=T / 20).y[
            :, -1
        ]
        found.append(float(y[0]))
    return np.array(found)


@pytest.mark.parametrize("clip_v", [20.0, 0.5])
def test_integral_action_is_that_of_the_loop_integrated(clip_v: float):
    """Clamped or not; where it is not, no weight holds the arm off its goal.

    Mutations: the integral's force beyond the servo's limit; a clip that is never reached.
    """
    rate = 2.0
    servo = Drive(
        "servo", KT, R, supply_v=U, proportional=KP, derivative=KD, integral=rate * KP,
        integral_limit_v=clip_v,
    ).on(ARM).with_physics(PENDULUM)  # fmt: skip
    goal = np.where(np.arange(400) < 200, 1.2, -0.6)
    truth = integrated(goal, rate, KT / R * min(clip_v, U))
    errors = [np.abs(angle(servo, goal, n) - truth).max() for n in (4, 32)]
    assert errors[1] < 2e-4
    assert errors[1] < 0.1 * errors[0] + 1e-4
    rests = angle(servo, np.full(1500, 1.2))[-1]
    assert (abs(rests - 1.2) < 1e-6) == (clip_v > 1.0)


def test_a_current_on_a_supply_falls_off_with_speed():
    """v = L / c (1 - exp(-c t / J)) under a current beyond what the supply drives.

    Mutation: the slope on |v|, of which a brake would have too little.
    """
    drive = Drive("current", KT, supply_v=U, resistance_ohm=R)
    device = drive.on(Device("mass", "", True, make_chain([J], [0.0]), Interface(period=T)))
    most, t = KT * U / R, T * np.arange(40)
    run = simulate(device, recorded(np.full(40, 10.0)), duration=0.4, substeps=64)
    truth = most / BACK * (1.0 - np.exp(-BACK * t / J))
    np.testing.assert_allclose(run.trace["velocity_m1"], truth, rtol=2e-4, atol=1e-3)
    brakes = simulate(
        device, recorded(np.full(5, -10.0)), duration=0.05, substeps=64, start=Start(0.0, 4.0)
    )
    slows = (4.0 + most / BACK) * np.exp(-BACK * T * np.arange(5) / J) - most / BACK
    np.testing.assert_allclose(brakes.trace["velocity_m1"], slows, rtol=2e-4, atol=2e-3)
    small = simulate(device, recorded(np.full(5, 0.1)), duration=0.05)
    np.testing.assert_allclose(small.trace["velocity_m1"], 0.1 * KT / J * T * np.arange(5))


def test_every_member_is_followed_as_if_it_were_alone_while_its_drive_is_switched():
    """To the bit. Mutation: a group's strengths of the first tick for all."""
    limits = [
        make_physics("goal_rate_limit", "command", rate=3.0),
        make_physics("servo_integral", "m1", rate=1.0, limit=0.5),
        make_physics("open_winding", "m1", damping=0.9),
        make_physics("load_friction", "m1", ratio=0.1),
    ]
    devices = [
        SERVO.with_physics(PENDULUM, *limits).with_chain(make_chain([J * (1.0 + 0.1 * i)], [B]))
        for i in range(3)
    ]
    goal = np.sin(4.0 * T * np.arange(200))
    strengths = np.where(np.arange(200) < 120, 0.9, 0.0)
    population = Population(devices, 4, 8)
    q = np.zeros((3, 1))
    record = Recorded(goal, np.zeros((200, 1)), PLACES, strengths=strengths)
    found = population.follow(
        record, population.start(q, q), Readings(np.zeros((population.states, 1))), keep=True
    )
    for i, device in enumerate(devices):
        eq, fine = equations(device, 4), equations(device, 8)
        own = alone(
            eq, fine, PLACES, goal, np.zeros((200, 1)), np.zeros((eq.states, 1)),
            np.zeros((0, 1)), start_memory(eq, Start()), strengths,
        )  # fmt: skip
        assert np.array_equal(found.innovations[i], own)


FILE = """\
file = "run.csv"
period_s = 0.01
rotary = true
[input]
signal = "goal"
unit = "rad"
[[output]]
signal = "angle"
quantity = "position"
at = "m1"
unit = "rad"
"""
STATES = '[enable]\nsignal = "on"\n[supply]\nsignal = "volts"\nunit = "mV"\nnominal = 12.0\n'


def written(folder: Path, states: str, on: np.ndarray, volts: np.ndarray) -> Path:
    t = T * np.arange(on.size)
    goal = np.sin(3.0 * t)
    rows = np.column_stack([goal, 0.9 * goal, on, volts])
    lines = ["goal,angle,on,volts", *(",".join(f"{x:.6g}" for x in row) for row in rows)]
    (folder / "run.csv").write_text("\n".join(lines))
    (folder / "run.toml").write_text(FILE + states)
    return folder / "run.toml"


def test_a_recording_says_when_its_drive_was_on_and_what_supplied_it(tmp_path: Path):
    on = (np.arange(300) < 200).astype(float)
    volts = 12000.0 - 5.0 * np.arange(300)
    trace = read_recording(written(tmp_path, STATES, on, volts))
    np.testing.assert_allclose(trace["supply"], volts / 12000.0, rtol=1e-12)
    (run,) = stretches(trace, SERVO)
    assert run.strengths is not None
    np.testing.assert_allclose(run.strengths, on * volts / 12000.0, rtol=1e-12)
    assert run.switched_off
    assert not run.part(0, 200).switched_off
    assert any("is off in 100 of 300 samples" in note for note in run.notes)
    whole = read_recording(written(tmp_path, "", on, volts))
    assert stretches(whole, SERVO)[0].strengths is None


@pytest.mark.parametrize(
    ("states", "says"),
    [
        ('[enable]\nsignal = "on"\nnominal = 1.0\n', "unknown key 'enable.nominal'"),
        ('[supply]\nsignal = "volts"\n', "supply.nominal is missing"),
        ('[supply]\nsignal = "volts"\nnominal = 0.0\n', "supply.nominal is 0; it must be a finite"),
        ('[supply]\nsignal = "volts"\nunit = "deg"\nnominal = 1.0\n', "supply must be in V"),
    ],
)
def test_what_cannot_be_said_of_a_drive_is_refused(tmp_path: Path, states: str, says: str):
    path = written(tmp_path, states, np.ones(300), np.full(300, 12.0))
    with pytest.raises(RecordingError, match=says):
        read_recording(path)


def test_a_drive_that_is_never_on_or_has_no_limit_is_refused(tmp_path: Path):
    path = written(tmp_path, '[enable]\nsignal = "on"\n', np.zeros(300), np.full(300, 12.0))
    with pytest.raises(ValueError, match=r"is never 0\.5 or more"):
        stretches(read_recording(path), SERVO)
    path = written(tmp_path, '[enable]\nsignal = "on"\n', np.arange(300) % 2.0, np.full(300, 12.0))
    spring = Drive("position", stiffness=5.0).on(ARM)
    with pytest.raises(ValueError, match=r"give \[drive\] a limit"):
        stretches(read_recording(path), spring)


def test_keys_of_a_drive_that_cannot_be_are_refused():
    text = device_to_text(ARM) + '[drive]\nkind = "servo"\nmotor_constant = 1.5\n'
    text += "resistance_ohm = 2.0\nsupply_v = 12.0\nproportional = 16.0\n"
    for wrong, says in (
        ('when_off = "opne"', "drive.when_off is 'opne'.*open"),
        ("goal_rate = 0.0", "drive.goal_rate is 0; it must be a number above 0"),
        ("integral = -1.0", "drive.integral is -1; it must be >= 0"),
    ):
        with pytest.raises(DeviceError, match=says):
            device_from_text(text + wrong)
    current = (
        device_to_text(ARM) + '[drive]\nkind = "current"\nmotor_constant = 1.5\nsupply_v = 9.0\n'
    )
    with pytest.raises(DeviceError, match="give both, or neither"):
        device_from_text(current)


def dropped(device: Device, seed: int) -> Experiment:
    """A recording in which the arm is lifted and the drive then switched off."""
    t = T * np.arange(500)
    goal = -0.75 * (1.0 - np.cos(np.pi * np.minimum(t / 2.0, 1.0)))
    strengths = (t < 2.0).astype(float)
    q = followed(device, K * goal, strengths, Start(), 20)
    y = q + 1e-3 * np.random.default_rng(seed).standard_normal(q.size)
    outputs = (Output("position", 0),)
    counted = K * goal / device.interface.command_gain
    return Experiment(
        T, counted, y[:, None], outputs, "drop", float(q.std()), strengths=strengths
    )  # fmt: skip


def test_a_fit_tells_by_how_an_arm_falls_what_the_winding_is():
    """Within 3 %; and it is sought only where a drive is off. Mutation: `Sizes.switched` true."""
    weighed = SERVO.with_physics(PENDULUM)
    counts = replace(weighed, interface=replace(weighed.interface, command_gain=1.0))
    truth = counts.with_physics(make_physics("open_winding", "m1", damping=BACK))
    run = dropped(truth, 1)
    run = replace(run, command=run.command / SERVO.interface.command_gain)
    sought = open_places(weighed)
    assert "open_winding" in {effect.name for effect, _ in sought}
    assert "open_winding@m1" in starts_at(sought, sizes_of(weighed, [run]), far=False)
    on = replace(run, strengths=None)
    assert "open_winding@m1" not in starts_at(sought, sizes_of(weighed, [on]), far=False)
    start = Physics(make_physics("open_winding", "m1", damping=0.1).effect, "m1", {"damping": 0.5})
    model = Model(weighed).with_effect(start, {"damping": 0.3})
    found = settled(judged([run], model, np.zeros(len(model.parameters))))
    (effect,) = (p.values for p in model.effects_at(found.x))
    assert effect["damping"] == pytest.approx(BACK, rel=0.03)


def test_a_drive_that_is_off_pushes_neither_in_an_event_nor_in_what_is_missing():
    """The fall of a known arm. Mutations: the strengths left out in `Window`, in `_forces`."""
    weighed = SERVO.with_physics(PENDULUM)
    counts = replace(weighed, interface=replace(weighed.interface, command_gain=1.0))
    run, model = dropped(counts, 2), Model(counts)
    h = settled(judged([run], model, np.zeros(len(model.parameters))))
    first, last = 190, 260  # it is off from 200 on
    window = Window(h, 0, first, last)
    unjudged = run.ticks - h.samples  # of the first samples
    behind = slice(window.begins + LEAD // 2 - unjudged, window.ends - unjudged)
    np.testing.assert_allclose(window.unknown, h.residual[behind], atol=0.02)
    force = lacks(model, h.x, run, 5.0)[20:-20, 0]
    assert np.sqrt(np.mean(force**2)) < 0.1  # gravity alone is 0.8
