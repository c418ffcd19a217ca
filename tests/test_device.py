import math
from pathlib import Path

import numpy as np
import pytest

from zwidth.sim import device_file
from zwidth.sim.device import Device, DeviceError
from zwidth.sim.device_file import load_device
from zwidth.sim.modal import ModalModel, from_chain, to_chain
from zwidth.sim.physics import EFFECTS, PROBES, make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.plant import hold

PHANTOM = load_device("phantom_1_0")
GROUND_SPRING = EFFECTS["ground_spring"]


def friction(level: float = 0.02, at: str = "m1") -> Physics:
    return make_physics("coulomb_friction", at, level=level)


def test_with_interface_names_the_nearest_field() -> None:
    assert PHANTOM.with_interface(delay=0.004).interface.delay == 0.004
    with pytest.raises(DeviceError, match="interface has no field 'dely'; did you mean 'delay'"):
        PHANTOM.with_interface(dely=0.004)


def test_an_effect_replaces_itself_and_goes_again() -> None:
    device = PHANTOM.with_physics(friction(0.01), friction(0.02), friction(0.03, "m3"))
    assert device.physics == (friction(0.02), friction(0.03, "m3"))
    assert device.without_physics("coulomb_friction@m3").physics == (friction(0.02),)
    assert device.without_physics("coulomb_friction").physics == ()
    assert device.without_physics().physics == ()
    with pytest.raises(DeviceError, match="no effect 'backlash'; "):
        device.without_physics("backlash")


def test_a_ground_spring_at_m1_goes_to_the_chain() -> None:
    spring = Physics(GROUND_SPRING, "m1", {"stiffness": 3.0})
    device = PHANTOM.with_physics(spring).with_physics(spring)
    assert device.chain.ground_spring == 6.0
    assert device.modal is None
    far = Physics(GROUND_SPRING, "m3", {"stiffness": 3.0})
    assert PHANTOM.with_physics(far).physics == (far,)


def test_a_device_is_checked() -> None:
    delay = make_physics("loop_delay", "clock", delay=0.001)
    with pytest.raises(DeviceError, match=r"loop_delay@clock is set in \[interface\]"):
        Device("a", "", True, PHANTOM.chain, physics=(delay,))
    with pytest.raises(DeviceError, match="coulomb_friction@m1 occurs twice"):
        Device("a", "", True, PHANTOM.chain, physics=(friction(), friction(0.1)))
    with pytest.raises(DeviceError, match="modal and chain describe different mechanisms"):
        Device("a", "", True, PHANTOM.rigid().chain, modal=PHANTOM.modal)
    with pytest.raises(ValueError, match="masses contains -1"):
        Device("a", "", True, PHANTOM.chain._replace(masses=np.array([1.0, -1.0, 1.0])))


def test_equality_is_by_value() -> None:
    assert load_device("phantom_1_0") == PHANTOM
    assert hash(PHANTOM) == hash(load_device("phantom_1_0"))
    heavier = PHANTOM.with_chain(PHANTOM.chain._replace(masses=2.0 * PHANTOM.chain.masses))
    assert heavier != PHANTOM.with_chain(PHANTOM.chain)
    assert PHANTOM.with_physics(friction()) != PHANTOM
    assert PHANTOM != "PHANToM"


def test_the_rigid_body_keeps_interface_inertia_damping_and_what_acts_on_masses() -> None:
    device = PHANTOM.with_physics(
        friction(0.02, "m3"), make_physics("cubic_stiffness", "link12", coefficient=1e4)
    )
    rigid = device.rigid()
    assert rigid.interface == device.interface
    assert rigid.physics == (friction(0.02, "m1"),)
    assert rigid.chain.masses == pytest.approx([1.1697025721e-3], rel=1e-9)
    assert rigid.chain.ground_dampers == pytest.approx([0.00584], rel=1e-9)
    assert from_chain(rigid.chain).modes == ()
    assert rigid.rigid() == rigid


def test_mechanism_by_chain_or_by_modes() -> None:
    chain = to_chain(ModalModel(2.0, 0.1))
    assert PHANTOM.with_chain(chain).modal is None
    assert PHANTOM.with_modal(ModalModel(2.0, 0.1)).chain.masses.tolist() == chain.masses.tolist()


def test_the_plant_lags_as_its_amplifier() -> None:
    """Truth: at rest and under a held command, the force after one tick is 1 - exp(-T/tau)."""
    assert PHANTOM.plant().size == 6
    lagging = PHANTOM.with_physics(make_physics("actuator_lag", "command", time_constant=2e-3))
    plant = lagging.plant()
    assert plant.size == 7
    _, held = hold(plant, 1e-3)
    assert held[6, 0] == pytest.approx(1.0 - math.exp(-0.5), rel=1e-12)


@pytest.mark.parametrize("name", [n for n, e in EFFECTS.items() if e.hook == "structure"])
def test_every_structural_effect_reaches_the_plant(name: str) -> None:
    effect = EFFECTS[name]
    values = {p.name: 1e-3 for p in effect.parameters}
    changed = PHANTOM.with_physics(Physics(effect, effect.places[0], values)).plant()
    assert changed.a.tobytes() != PHANTOM.plant().a.tobytes()


def test_effects_are_found_by_name() -> None:
    assert all(effect.name == name for name, effect in EFFECTS.items())
    with pytest.raises(ValueError, match="no effect 'saturaton'; did you mean 'saturation'"):
        make_physics("saturaton", "command", limit=1.0)


def test_every_effect_file_is_registered() -> None:
    folder = Path(device_file.__file__).parent / "physics"
    declaring = {f.stem for f in folder.glob("*.py") if f"{f.stem} = Effect(" in f.read_text()}
    assert declaring == {*EFFECTS, *PROBES}
