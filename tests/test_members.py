"""Many devices as arrays are the same devices one by one, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
from engine_examples import one_mass
from numpy.typing import NDArray
from physics_examples import EVERYWHERE, EXAMPLES, example, five, phantom

from zwidth.diagnosis.fitting.many import Many
from zwidth.diagnosis.model.parameters import Model, leads
from zwidth.diagnosis.noise.predictor import Fineness, observer_memory, padded, substeps_of
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.equations import enough_substeps, frame
from zwidth.sim.lane_type import WIDTH
from zwidth.sim.members import alike
from zwidth.sim.physics import PROBES
from zwidth.sim.physics.effect import Physics
from zwidth.sim.place import place_at
from zwidth.sim.population import Population, Readings, Recorded
from zwidth.sim.uncertainty import Uncertainty

Floats = NDArray[np.float64]
FINENESS = Fineness(2, 4)
TICKS, SKIPPED = 150, 20
STEPPED = {"encoder_step": 1e-5, "command_step": 1e-3, "command_limit": 0.05, "command_gain": 1.3,
           "position_origin": 2e-3}  # fmt: skip


def two_masses() -> Device:
    chain = make_chain([2e-4, 3e-4], [1e-3, 2e-3], 0.0, [20.0], [0.01])
    return Device("two masses", "", True, chain, phantom().interface)


def grounded() -> Device:
    chain = phantom().chain._replace(ground_spring=0.3)
    return unsure(phantom().with_chain(chain).with_interface(delay=0.0, **STEPPED))


def unsure(device: Device) -> Device:
    """Return a device whose command's scale is no more known than its masses, so that it moves."""
    return replace(device, uncertainty=Uncertainty(command_scale=0.05))


NOMINALS = {
    "one mass": one_mass(1.2e-3, 6e-3, delay=0.0013),
    "two masses, no delay": two_masses().with_interface(delay=0.0),
    "three masses": unsure(phantom().with_interface(delay=0.0024, encoder_rounding="floor")),
    "spring to ground, steps": grounded(),
    "lag and a further mass": phantom().with_physics(
        example("actuator_lag"), example("extra_mode", "m2"), example("coulomb_friction", "m3")
    ),
}


def recording(device: Device, ticks: int = TICKS) -> Experiment:
    """Return noise as position and velocity of m1 and position of the last mass."""
    random, n = np.random.default_rng(3), device.chain.masses.size
    outputs = [Output("position", 0), Output("velocity", 0)]
    outputs += [Output("position", n - 1)] * (n > 1)
    walk = 1e-4 * np.cumsum(random.normal(size=(ticks, len(outputs))), axis=0)
    command = 0.02 * random.normal(size=ticks)
    dropped = random.uniform(size=ticks) < 0.1
    error = 1e-6 * random.normal(size=ticks)
    return Experiment(
        device.interface.period, command, walk, tuple(outputs), swing=float(np.std(walk[:, 0])),
        dropped=dropped, sensor_error=error,
    )  # fmt: skip


def gain_of(device: Device, experiment: Experiment) -> Floats:
    n = device.chain.masses.size
    found = np.zeros((2 * n, len(experiment.outputs)))
    found[0, 0], found[n, 0], found[n, 1] = 0.3, 20.0, 0.05
    return found


def drawn(model: Model, count: int, none_at: tuple[int, ...] = ()) -> list[Floats]:
    """Return x of many members; some have hardly anything of the effects."""
    random, parameters = np.random.default_rng(9), model.parameters
    xs = [0.4 * random.standard_normal(len(parameters)) for _ in range(count)]
    for i in none_at:
        for j, p in enumerate(parameters):
            limited = p.kind == "effect" and model.effects[p.index].effect.in_interface
            if p.kind == "effect" and limited != "command_limit":
                xs[i][j] = -50.0
    return xs


def one_by_one(
    model: Model, xs: list[Floats], e: Experiment, gain: Floats, filters: Floats
) -> tuple[Floats, Floats]:
    """Return innovations and moments of devices built one by one."""
    o = len(e.outputs)
    innovations, moments = (
        np.full((len(xs), *e.measured.shape), np.inf),
        np.full((len(xs), o, o), np.inf),
    )
    plain = model.plain(e)
    for i, x in enumerate(xs):
        device, reads = model.acting(x), model.reads(x)
        try:
            steps = substeps_of(device, FINENESS)
        except NoObserver:
            continue
        eq, _ = frame(device, steps[0])
        led = leads(e.outputs, np.array(reads.jitter), np.array(reads.late), np.array(reads.push))
        readings = Readings(
            padded(gain, device, eq, e), np.array([reads.gain]),
            reads.offsets(e)[None], led[None], np.full((1, o), reads.late),
        )  # fmt: skip
        recorded = Recorded(
            plain.command, plain.measured, e.places(eq), None, model.arriving_change(plain),
        )  # fmt: skip
        start = observer_memory(eq, model.seen(e.part(0, 32), x))
        found = Population([device], *steps).follow(
            recorded, [start], readings, filters, SKIPPED, keep=True
        )
        innovations[i], moments[i] = found.innovations[0], found.moments[0]
    return innovations, moments


def compared(model: Model, xs: list[Floats]) -> None:
    e = recording(model.nominal)
    gain = gain_of(model.nominal, e)
    filters = np.random.default_rng(6).normal(size=(len(e.outputs), len(e.outputs), 4))
    innovations, moments = one_by_one(model, xs, e, gain, filters)
    many = Many(model, xs, FINENESS)
    assert np.array_equal(many.innovations(e, gain), innovations, equal_nan=True)
    assert np.array_equal(many.moments(e, gain, filters, SKIPPED), moments, equal_nan=True)
    assert np.isfinite(innovations).all(axis=(1, 2)).sum() > len(xs) // 2


def modelled(nominal: Device, *effects: Physics) -> Model:
    scales = tuple({k: 0.5 * abs(v) for k, v in p.values.items()} for p in effects)
    return Model(nominal, effects, scales)


@pytest.mark.parametrize("nominal", NOMINALS)
@pytest.mark.parametrize("name", EXAMPLES)
def test_members_of_a_model_are_the_devices_at_x(name: str, nominal: str) -> None:
    """Every effect at every place of one to three masses; two groups; of some nothing is left.

    Mutations: kinds by effects alone; links of the nominal device for what effects read of them.
    """
    device = NOMINALS[nominal]
    for effect, place in EVERYWHERE:
        if effect == name and place_at(place).masses_needed <= device.chain.masses.size:
            model = modelled(device, example(name, place))
            compared(model, drawn(model, 5, none_at=(1, 4)))


def test_members_of_several_effects_fill_more_than_a_group() -> None:
    """Of any structure: masses, lag, whole ticks of delay. Mutation: one kind for all."""
    effects = [("extra_mode", "m1"), ("loop_delay", "clock"), ("actuator_lag", "command"),
               ("coulomb_friction", "m2"), ("backlash", "link12"), ("ground_spring", "m1"),
               ("ground_spring", "m2"), ("encoder_step", "sensor"),
               ("dropped_samples", "clock")]  # fmt: skip
    model = modelled(phantom(), *(example(*one) for one in effects))
    compared(model, drawn(model, WIDTH + 5, none_at=(3, 4, 17)))


def test_a_known_sensor_error_is_taken_off_for_all() -> None:
    model = modelled(phantom(), example("encoder_step"))
    known = Model(model.nominal, model.effects, model.scales, sensor_error_known=True)
    compared(known, drawn(known, 3))


def test_dry_friction_beside_fast_modes_takes_each_member_its_own_substeps() -> None:
    """A mode of some kHz. Mutation: the substeps of the first for all."""
    chain = make_chain([2e-4, 9e-4, 7e-5], [0.0, 0.01, 0.004], 0.0, [2e5, 1.5e4], [0.06, 1e-3])
    friction = example("coulomb_friction", "m1"), example("coulomb_friction", "m2")
    model = modelled(phantom().with_chain(chain), *friction)
    xs = [2.0 * x for x in drawn(model, 25)]
    needed = {enough_substeps(model.acting(x)) for x in xs}
    assert len(needed) > 2
    compared(model, xs)
    everyone = model.members(np.stack(xs))
    assert set(everyone.enough_substeps().tolist()) == needed


@pytest.mark.parametrize("name", PROBES)
def test_laws_of_no_library_are_members_too(name: str) -> None:
    effect = PROBES[name]
    values = {p.name: 1e-3 if p.name == effect.strength else 1.0 for p in effect.parameters}
    model = modelled(phantom(), Physics(effect, effect.places[0], values))
    compared(model, drawn(model, 3))


def test_a_member_that_can_be_no_device_is_refused_as_alone() -> None:
    model = modelled(phantom(), example("saturation"))
    xs = drawn(model, 3)
    xs[1][[p.name for p in model.parameters].index("b2")] = np.inf
    with pytest.raises(ValueError, match="ground_dampers contains inf") as one:
        model.acting(xs[1])
    with pytest.raises(ValueError, match="ground_dampers contains inf") as many:
        Many(model, xs, FINENESS)
    assert str(one.value) == str(many.value)
    with pytest.raises(ValueError, match="cannot differ in interface"):
        alike(phantom(), 2).with_interface(period=0.1)


def test_members_alike_are_the_device() -> None:
    """Five masses, all that a device may have. Mutation: physics left out."""
    device = five().with_physics(example("backlash", "link34"), example("extra_mode", "m5"))
    assert alike(device, 3).device(2) == device
    assert (
        Many(modelled(device), [], FINENESS)
        .innovations(recording(device), np.zeros((10, 3)))
        .shape[0]
        == 0
    )
