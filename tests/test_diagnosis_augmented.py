"""What a fit used, the file of its device says: it runs freely as the fit does, to rounding."""

from dataclasses import replace

import numpy as np
import pytest
from physics_examples import example

from tests.diagnosis_examples import OUTPUTS, phantom, record
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.augmented import augmented
from zwidth.diagnosis.intake.hold import smooth
from zwidth.diagnosis.model.parameters import Model, delivered
from zwidth.diagnosis.noise.predictor import free_run_errors, observer_memory, observer_near
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.seeking.places import ELSEWHERE
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.exam.perfect import as_seen
from zwidth.scenarios.scenario import Scenario
from zwidth.scenarios.scenario_file import scenario_from_text, scenario_to_text
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_from_text, device_to_text, model_hash
from zwidth.sim.equations import equations
from zwidth.sim.interface import Interface
from zwidth.sim.physics import EFFECTS as ALL_EFFECTS
from zwidth.sim.physics import effect_named, make_physics
from zwidth.sim.place import label_of, of_label, place_at
from zwidth.sim.predict import alone
from zwidth.sim.run import Start
from zwidth.sim.uncertainty import Uncertainty

SUBSTEPS = 4
EFFECTS = {
    "nothing": (),
    "friction": (("coulomb_friction", "m1", {"level": 3e-2}),),
    "play": (("backlash", "link12", {"gap": 2e-4}),),
    "limit": (("saturation", "command", {"limit": 0.2}),),
    "dead band": (("dead_band", "command", {"width": 0.05}),),
    "step": (("command_step", "command", {"step": 0.05}),),
    "lag": (("actuator_lag", "command", {"time_constant": 2e-3}),),
    "asymmetry": (("gain_asymmetry", "command", {"ratio": 1.2}),),
    "delay": (("loop_delay", "clock", {"delay": 1.5e-3}),),
    "spring": (("ground_spring", "m1", {"stiffness": 0.5}),),
    "mode": (("extra_mode", "m1", {"mass": 1e-4, "stiffness": 50.0, "damping": 1e-3}),),
    "force and drag": (
        ("constant_force", "m1", {"level": 1e-2}),
        ("quadratic_drag", "m1", {"coefficient": 1e-3}),
    ),
}
# What a sensor adds is read and no motion, and which commands are lost is of the recording. A
# recording whose drive is off in parts is no scenario, and what a winding does then shows nowhere
# else.
LIBRARY = [
    label_of(effect.name, place_at(place))
    for effect in ALL_EFFECTS.values()
    for place in effect.places
    if effect.sought not in (*ELSEWHERE, "given", "learned")
    if place != "sensor" and effect is not ALL_EFFECTS["open_winding"]
    if place_at(place).masses_needed <= phantom().chain.masses.size
]


def sprung() -> Device:
    """The PHANToM on a spring to ground, with a command whose scale is free in a fit."""
    device = replace(phantom(), uncertainty=Uncertainty(command_scale=0.05))
    return device.with_chain(device.chain._replace(ground_spring=1.0))


def model_of(device: Device, name: str = "nothing") -> tuple[Model, np.ndarray]:
    """A model at an x at which every linear parameter differs from the file's, see `apart`."""
    effects = tuple(make_physics(e, at, **values) for e, at, values in EFFECTS[name])
    model = Model(device, effects, tuple({} for _ in effects))
    assert {"gain", "origin"} <= {p.name for p in model.parameters}
    return model, apart(model)


def apart(model: Model) -> np.ndarray:
    """An x off the file in all but the skew, which is of the readings and no device's."""
    each = zip(model.linear, np.linspace(0.5, 1.5, model.linear_count), strict=True)
    return np.array([0.0 if p.kind == "skew" else off for p, off in each])


def free_run(model: Model, x: np.ndarray, taken: Experiment, substeps: int) -> np.ndarray:
    """Return what a fit predicts of a recording from its first sample on, never corrected.

    (ticks, outputs), positions as they were recorded. taken: the recording as the diagnosis takes
    it, with where it begins; substeps per tick.
    """
    device, seen = taken.on(model.acting(x)), model.seen(taken, x)
    eq = equations(device, substeps)
    none = np.zeros((eq.states, len(seen.outputs)))
    silent = np.zeros(seen.measured.shape)
    outputs = seen.places(eq)
    errors = alone(
        eq, eq, outputs, seen.command, silent, none, seen.external(eq.dof),
        observer_memory(eq, seen), seen.strengths,
    )  # fmt: skip
    positions = np.array([o.tells_position for o in seen.outputs])
    known = model.nominal.interface.position_origin
    return -errors + known * positions + model.reads(model.there(x, taken)).offsets(taken)


def scenario_of(
    device: Device,
    model: Model,
    x: np.ndarray,
    recording: Experiment,
    taken: Experiment,
    substeps: int,
) -> Scenario:
    """Return the scenario in which a saved device does what the fit does freely.

    recording: with the command as it was recorded, in SI; taken: as the diagnosis takes it.
    """
    eq = equations(taken.on(model.acting(x)), substeps)
    state = observer_memory(eq, model.seen(taken, x)).x
    own = eq.dof - eq.followers.shape[0]
    positions = state[:own] + _origin(model, x, taken.swing)
    start = Start(positions.tolist(), state[eq.dof : eq.dof + own].tolist())
    command = recording.command
    if taken.dropped is not None and model.has("dropped_samples"):
        command = delivered(command, taken.dropped)
        device = device.without_physics("dropped_samples")
    return Scenario(
        taken.on(device),
        recorded(command),
        recording.ticks * recording.period,
        start,
        substeps=substeps,
    )


def _origin(model: Model, x: np.ndarray, swing: float) -> float:
    known = model.nominal.interface.position_origin
    return known + model.reads(x).origin * swing


def runs_alike(
    model: Model, x: np.ndarray, e: Experiment, taken: Experiment, device: Device
) -> None:
    saved = device_from_text(device_to_text(device))
    assert saved == device
    scenario = scenario_of(saved, model, x, e, taken, SUBSTEPS)
    scenario = scenario_from_text(scenario_to_text(scenario))
    own = free_run(model, x, taken, SUBSTEPS)
    (trace, _, _), *_ = scenario.prepare().blocks(scenario.ticks)
    swing = np.ptp(own, axis=0)
    np.testing.assert_allclose(trace["position_m1"], own[:, 0], rtol=0, atol=1e-9 * swing[0])
    if len(taken.outputs) > 1:
        read = trace["velocity_filtered_m1"]
        np.testing.assert_allclose(read, own[:, 1], rtol=0, atol=1e-9 * swing[1])


@pytest.mark.parametrize("name", EFFECTS)
def test_the_saved_device_runs_as_the_fit_does(name: str):
    """Gain and origin of the fit beside every kind of effect.

    Mutations that break it: command_gain after the limit; an origin that the start is not less;
    a gain before the command's step.
    """
    e = record(sprung(), 1.0, seed=2)
    model, x = model_of(sprung(), name)
    runs_alike(model, x, e, e, augmented(model, x, e.swing))


@pytest.mark.parametrize("label", LIBRARY)
def test_every_law_of_the_library_runs_as_the_fit_does(label: str):
    """At every place, at the first size that a search begins with.

    The command begins at zero, as a simulation's does: what limits a rate goes on from there.
    Velocities are recorded beside positions where they are what is filtered.

    Mutation that breaks it: any law that the file, the scenario and the predictor take otherwise.
    """
    device, (name, place) = sprung(), of_label(label)
    if needed := effect_named(name).needs:
        device = device.with_physics(example(needed))
    e = record(device, 1.0, seed=6)
    e = replace(e, command=np.concatenate([[0.0], e.command[1:]]))
    if place.kind == "velocity":
        q = e.measured[:, 0]
        both = np.column_stack([q, np.gradient(q, e.period)])
        e = replace(e, measured=both, outputs=(*OUTPUTS, Output("velocity", 0)))
    sizes = sizes_of(device, [e])
    values, scales = next(iter(effect_named(name).starts(sizes, place)))
    model = Model(device, (make_physics(name, str(place), **values),), (scales,))
    x = np.zeros(len(model.parameters))
    x[: model.linear_count] = apart(model)
    runs_alike(model, x, e, e, augmented(model, x, e.swing))


def test_a_smooth_command_runs_as_the_fit_took_it():
    """Mutation that breaks it: command_hold left out."""
    t = 1e-3 * np.arange(1000)
    u = 0.1 * np.sin(40.0 * t) + 0.05 * np.cos(133.0 * t)
    e = Experiment(1e-3, u, record(sprung(), 1.0).measured, OUTPUTS)
    model, x = model_of(sprung())
    runs_alike(model, x, e, smooth(e), augmented(model, x, e.swing, smooth=True))


def test_lost_commands_are_those_of_the_recording():
    """Mutation that breaks it: the device's rate loses others besides."""
    e = record(sprung(), 1.0, seed=3)
    random = np.random.default_rng(1)
    taken = replace(e, dropped=random.random(e.ticks) < 0.05)
    lost = make_physics("dropped_samples", "clock", rate=0.05)
    model = Model(sprung(), (lost,), ({},))
    x = apart(model)
    device = augmented(model, x, e.swing)
    assert "dropped_samples" in [p.effect.name for p in device.physics]
    runs_alike(model, x, e, taken, device)


def test_a_folded_sensor_and_steps_leave_the_motion():
    """The encoder reads absolute values in steps; what moves is what the fit says.

    Mutation that breaks it: folded out, and not said.
    """
    e = record(sprung(), 1.0, seed=4)
    model, x = model_of(sprung())
    device = augmented(model, x, e.swing, folded=True, encoder_step=1e-3)
    assert [p.effect.name for p in device.physics] == ["rectified_sensor"]
    assert device.interface.encoder_step == 1e-3
    runs_alike(model, x, e, e, device)


def test_the_fit_of_an_augmented_device_begins_where_the_last_one_ended():
    """Its gain and origin count in a prediction, too. Mutation: an origin not taken off."""
    e = record(sprung(), 1.0, seed=5)
    model, x = model_of(sprung())
    again = Model(augmented(model, x, e.swing))
    none = np.zeros(again.linear_count)
    one, other = free_run(model, x, e, SUBSTEPS), free_run(again, none, e, SUBSTEPS)
    np.testing.assert_allclose(other, one, rtol=0, atol=1e-9 * np.ptp(one))


def test_an_exam_counts_the_gain_of_an_augmented_device_once():
    """Its free run over what was held out is the fit's own, from where the fitted part ends.

    Mutations: the recording counted up, too; the origin left in what came before.
    """
    _, e = record(sprung(), 2.0, seed=2).split(0.5)
    model, x = model_of(sprung())
    observer = observer_near(sprung(), e, 1e-2)
    own, _ = free_run_errors(model.acting(x), model.seen(e, x), observer, 200)
    seen = as_seen(e, model.reads(x).origin)
    found, _ = free_run_errors(augmented(model, x, e.swing), seen, observer, 200)
    np.testing.assert_allclose(found, own, rtol=0, atol=1e-9 * np.ptp(own))


def test_a_run_reads_from_the_origin_of_the_recording():
    """Positions, start and encoder count from there. Mutation: an origin of the encoder alone."""
    e = record(sprung(), 0.5, seed=6)
    model, x = model_of(sprung())
    device = augmented(model, x, e.swing, smooth=True)
    scenario = scenario_of(device, model, x, e, smooth(e), SUBSTEPS)
    run = scenario.prepare()
    (trace, _, _), *_ = run.blocks(scenario.ticks)
    np.testing.assert_allclose(trace["encoder"], trace["position_m1"], atol=1e-15)
    assert trace["position_m1"][0] == pytest.approx(float(e.measured[0, 0]), abs=1e-12)


def test_a_device_that_needs_none_of_it_is_written_as_before():
    """Its hash stays, so that logs of it replay. Mutation: keys written always."""
    text = device_to_text(phantom())
    for key in ("command_gain", "position_origin", "command_hold"):
        assert key not in text
    changed = phantom().with_interface(command_gain=1.5, command_hold="smooth")
    assert model_hash(changed) != model_hash(phantom())


@pytest.mark.parametrize(
    ("field", "value", "allowed"),
    [
        ("command_gain", 0.0, "> 0 and finite"),
        ("command_gain", np.inf, "> 0 and finite"),
        ("position_origin", np.nan, "a finite number"),
        ("command_hold", "first_order", "'zero_order' or 'smooth'"),
    ],
)
def test_what_is_not_allowed_is_named(field: str, value: object, allowed: str):
    """Mutation: a check left out."""
    with pytest.raises(ValueError, match=f"interface.{field} is {value}; it must be") as error:
        Interface(**{field: value})  # pyright: ignore[reportArgumentType]
    assert allowed in str(error.value)
