"""Every effect by its declaration: names, places, parameters, neutral values, device files."""

import copy
import itertools
import pickle
from dataclasses import replace

import numpy as np
import pytest
from physics_examples import EVERYWHERE, EXAMPLES, entry_of, example, neutral, phantom, with_needed

from zwidth.controllers.wall import wall
from zwidth.scenarios.scenario import usual_substeps
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device, DeviceError
from zwidth.sim.device_file import device_from_text, device_to_text
from zwidth.sim.equations import enough_substeps
from zwidth.sim.physics import EFFECTS, PROBES
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import COLUMN, OVER, ROW, VALUE
from zwidth.sim.physics.free_law import AT, FORCE
from zwidth.sim.physics.two_tables import AT_FIRST, AT_SECOND, LAW_FIRST, LAW_SECOND
from zwidth.sim.run import Run, Start, simulate

MASSES = ("m1", "m2", "m3", "m4", "m5")
LINKS = ("link12", "link23", "link34", "link45")
POINTS = " ".join(["odd", *AT, *FORCE, "period"])
TABLE = {
    "coulomb_friction": (MASSES, "level"),
    "stribeck_friction": (MASSES, "level static_level velocity"),
    "rising_friction": (MASSES, "level static_level velocity"),
    "presliding_friction": (MASSES, "level stiffness"),
    "directional_friction": (MASSES, "level_plus level_minus viscous_plus viscous_minus"),
    "load_friction": (("m1",), "ratio"),
    "quadratic_drag": (MASSES, "coefficient"),
    "constant_force": (MASSES, "level"),
    "ground_spring": (MASSES, "stiffness"),
    "gravity_pendulum": (MASSES, "level angle"),
    "force_ripple": ((*MASSES, *LINKS), "amplitude period phase"),
    "backlash": (LINKS, "gap"),
    "cubic_stiffness": (("ground", *LINKS), "coefficient"),
    "hysteresis": (("ground", "link12"), "stiffness level shape"),
    "extra_mode": (MASSES, "mass stiffness damping"),
    "position_servo": (("m1",), "stiffness damping back_emf"),
    "servo_limit": (("m1",), "limit"),
    "servo_dead_zone": (("m1",), "half"),
    "servo_integral": (("m1",), "rate limit"),
    "goal_rate_limit": (("command",), "rate"),
    "falling_limit": (("m1",), "limit slope"),
    "open_winding": (("m1",), "damping"),
    "saturation": (("command",), "limit"),
    "rate_limit": (("command",), "rate"),
    "dead_band": (("command",), "width"),
    "command_step": (("command",), "step"),
    "actuator_lag": (("command",), "time_constant"),
    "gain_asymmetry": (("command",), "ratio"),
    "loop_delay": (("clock",), "delay"),
    "dropped_samples": (("clock",), "rate"),
    "encoder_step": (("sensor",), "step"),
    "encoder_eccentricity": (("sensor",), "amplitude period phase"),
    "rectified_sensor": (("sensor",), ""),
    "sensor_lag": (("sensor", "velocity"), "time_constant"),
    "sensor_filter": (("sensor", "velocity"), "time_constant damping"),
    "moving_average": (("sensor", "velocity"), "window"),
    "free_spring": ((*MASSES, *LINKS), POINTS),
    "free_damper": ((*MASSES, *LINKS), POINTS),
    "free_amplifier": (("command",), POINTS),
    "free_sensor": (("sensor",), POINTS),
    "free_force": ((*MASSES, *LINKS), " ".join([*OVER, *ROW, *COLUMN, *VALUE])),
    "free_product": (
        (*MASSES, *LINKS),
        " ".join([*OVER, *AT_FIRST, *LAW_FIRST, *AT_SECOND, *LAW_SECOND]),
    ),
    "free_shift": (
        (*MASSES, *LINKS),
        " ".join([*OVER, *AT_FIRST, *LAW_FIRST, *AT_SECOND, *LAW_SECOND]),
    ),
}
SEVERAL = ("coulomb_friction", "cubic_stiffness", "backlash", "actuator_lag", "dead_band")


def test_the_registry_is_the_table_of_the_design() -> None:
    found = {
        name: (effect.places, " ".join(p.name for p in effect.parameters))
        for name, effect in EFFECTS.items()
    }
    assert found == TABLE
    assert all(name == effect.name for name, effect in EFFECTS.items())


def test_codes_are_unique_under_each_hook() -> None:
    declared = [*EFFECTS.values(), *PROBES.values()]
    dispatched = [(e.hook, e.code) for e in declared if e.code != 0]
    assert len(set(dispatched)) == len(dispatched)


def test_linear_units_have_no_angles_but_phases() -> None:
    for effect in EFFECTS.values():
        for p in effect.parameters:
            unit = p.unit_for(rotary=False)
            phase = p.name == "phase"
            assert phase or effect.rotary_only or not ("rad" in unit or "N m" in unit), effect.name
            assert "kg m2" not in unit
            assert p.unit_for(rotary=True) == p.unit


def _run(device: Device) -> Run:
    return simulate(
        device, wall(12.0, 0.02, one_sided=True), duration=0.06, start=Start(-2e-4, 0.3),
        disturbance=0.02 * np.sin(np.arange(60) * 0.4), substeps=2, fine=True, seed=3,
    )  # fmt: skip


@pytest.mark.parametrize("several", [False, True])
def test_neutral_parameters_change_nothing_bit_for_bit(several: bool) -> None:
    """Mutation: `backlash_force` without its return at gap 0 (damper pulls), or gain 1 + r."""
    device = phantom()
    if several:
        device = device.with_physics(*(example(name) for name in SEVERAL))
    without = _run(device)
    assert without.fine is not None
    for name, place in EVERYWHERE:
        if not EFFECTS[name].parameters or (several and name in SEVERAL):
            continue
        run = _run(device.with_physics(neutral(EFFECTS[name], place)))
        assert run.fine is not None
        for channel, values in without.trace.channels.items():
            assert np.array_equal(run.trace.channels[channel], values), (name, place, channel)
        for channel, values in without.fine.channels.items():
            assert np.array_equal(run.fine.channels[channel], values), (name, place, channel)


@pytest.mark.parametrize(
    ("name", "place"), [entry for entry in EVERYWHERE if entry[1] != "velocity"]
)
def test_every_example_changes_something(name: str, place: str) -> None:
    """A filter of velocities does not: a law makes its own of positions (test_sensor_filters).

    Of a drive that is on: what an `open_winding` does is in `test_drive_states.py`.
    """
    if name == "open_winding":
        return
    *needed, physics = with_needed(example(name, place))
    device = phantom().with_physics(*needed)
    changed = _run(device.with_physics(physics))
    assert not np.array_equal(
        changed.trace.channels["position_m1"], _run(device).trace.channels["position_m1"]
    )


@pytest.mark.parametrize(("name", "place"), EVERYWHERE)
def test_every_effect_goes_through_a_device_file(name: str, place: str) -> None:
    device = phantom().with_physics(example(name, place))
    assert device_from_text(device_to_text(device)) == device
    plain = device_to_text(phantom())
    entry = entry_of(name, place)
    written = device_from_text("\n".join([plain, "[[physics]]", *entry]))
    assert written == device


@pytest.mark.parametrize(("name", "place"), EVERYWHERE)
def test_values_outside_their_bounds_are_refused_by_name(name: str, place: str) -> None:
    for p in EFFECTS[name].parameters:
        for value in (np.nan, p.lower - 1.0, np.nextafter(p.upper, np.inf)):
            if value == p.upper:
                continue
            with pytest.raises(ValueError, match=rf"{name}\.{p.name} is .*it must be"):
                Physics(EFFECTS[name], place, EXAMPLES[name] | {p.name: value})


def test_all_effects_at_once_in_one_device_file() -> None:
    """All but filters of readings, of which there is room for one of all three masses."""
    filters = [entry for entry in EVERYWHERE if EFFECTS[entry[0]].follows]
    every = [entry for entry in EVERYWHERE if entry not in filters[1:]]
    device = phantom().with_physics(*itertools.starmap(example, every))
    assert device_from_text(device_to_text(device)) == device
    assert device.plant().dof == 9
    with pytest.raises(DeviceError, match="filtered readings; together they must be at most 10"):
        device.with_physics(example(*filters[-1]))


def test_a_pendulum_needs_an_angle() -> None:
    linear = replace(phantom(), rotary=False)
    with pytest.raises(DeviceError, match="gravity_pendulum@m1 needs an angle"):
        linear.with_physics(example("gravity_pendulum"))


def test_a_seed_out_of_range_is_refused() -> None:
    for seed in (-1, 2**64):
        with pytest.raises(ValueError, match=f"seed is {seed}"):
            simulate(phantom(), wall(1.0, 0.0), duration=0.01, seed=seed)


def test_too_few_substeps_for_friction_are_refused() -> None:
    """Mutation: `_check_substeps` skipped: the fast chain then runs with forces of wrong sign."""
    links = ([2e5, 1.5e4], [0.06, 1e-3])
    chain = make_chain([2e-4, 9e-4, 7e-5], [0.0, 0.01, 0.004], 0.0, *links)
    device = replace(phantom(), chain=chain, modal=None)
    simulate(device, wall(1.0, 0.0), duration=0.01)
    dry = device.with_physics(example("coulomb_friction", "m1"), example("coulomb_friction", "m2"))
    with pytest.raises(ValueError, match=r"substeps is 1; .* needs at least 12 substeps per tick"):
        simulate(dry, wall(1.0, 0.0), duration=0.01)
    simulate(dry, wall(1.0, 0.0), duration=0.01, substeps=12)


def test_a_run_takes_the_substeps_that_friction_needs_and_no_more() -> None:
    """Of the chain above: those that are surely enough, one without friction, more where asked.

    Mutation: `usual_substeps` ten for every device of which one is not exact.
    """
    links = ([2e5, 1.5e4], [0.06, 1e-3])
    chain = make_chain([2e-4, 9e-4, 7e-5], [0.0, 0.01, 0.004], 0.0, *links)
    device = replace(phantom(), chain=chain, modal=None)
    dry = device.with_physics(example("coulomb_friction", "m1"), example("coulomb_friction", "m2"))
    assert (enough_substeps(device), enough_substeps(dry), enough_substeps(dry, 20)) == (1, 12, 20)
    assert (usual_substeps(device), usual_substeps(dry)) == (1, 12)
    simulate(dry, wall(1.0, 0.0), duration=0.01, substeps=usual_substeps(dry))


@pytest.mark.parametrize("name", [*EFFECTS, *PROBES])
def test_a_law_that_was_read_back_from_a_file_is_the_same_law(name: str):
    """Laws are compared by identity: a diagnosis with play, read back, could not be judged again.

    Mutation that breaks it: effects pickled by their fields.
    """
    effect = EFFECTS.get(name) or PROBES[name]
    assert pickle.loads(pickle.dumps(effect)) is effect
    assert copy.deepcopy(effect) is effect


def test_a_law_that_nothing_declares_is_read_back_too():
    made = replace(EFFECTS["quadratic_drag"], name="made_in_a_program")
    again = pickle.loads(pickle.dumps(made))
    assert again == made
    assert again is not made
