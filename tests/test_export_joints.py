"""A device as MJCF, URDF and SDF: what is held moves as ours does, what is not is said."""

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from physics_examples import EXAMPLES

from zwidth import cli
from zwidth.controllers.excitation import multisine
from zwidth.controllers.recorded import recorded
from zwidth.export.mjcf import mjcf
from zwidth.export.model import free_run, loss
from zwidth.export.mujoco_run import engine, run_mjcf, run_urdf
from zwidth.export.read_joint import device_of_joint
from zwidth.export.robots import sdf, urdf
from zwidth.model_runs import ModelRuns
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.drive import Drive
from zwidth.sim.interface import Interface
from zwidth.sim.physics import EFFECTS, make_physics
from zwidth.sim.run import simulate

needs_mujoco = pytest.mark.skipif(engine() is None, reason="MuJoCo is not installed")
COMMANDS = multisine(0.1, 1.0, 50.0, 0.25, 0.001)
WHOLE = (
    "coulomb_friction", "quadratic_drag", "constant_force", "ground_spring", "gravity_pendulum",
    "cubic_stiffness", "extra_mode", "position_servo", "saturation", "actuator_lag", "loop_delay",
)  # fmt: skip


def with_effect(name: str) -> Device:
    place = EFFECTS[name].places[0]
    return load_device("phantom_1_0").with_physics(make_physics(name, place, **EXAMPLES[name]))


@needs_mujoco
@pytest.mark.parametrize("name", WHOLE)
def test_what_mjcf_holds_moves_alike_in_mujoco(name: str):
    """Within 1 % of the motion, and nothing is said to be lost.

    Mutations: the limit as a range of ctrl with a gain; the pendulum's angle of the other sign.
    """
    device = with_effect(name).with_interface(command_gain=1.3)
    made = mjcf(device, "dev")
    assert made.lost == ()
    assert loss(free_run(device, COMMANDS), run_mjcf(made.text(), COMMANDS, 0.001)) < 0.01


@needs_mujoco
def test_two_levels_of_friction_are_one_and_a_constant_force():
    """Exact, at rest too: the mean level about the half of the difference. Mutation: its sign."""
    friction = make_physics(
        "directional_friction", "m1", level_plus=1e-3, level_minus=6e-3, viscous_plus=1e-3,
        viscous_minus=1e-3,
    )  # fmt: skip
    device = load_device("phantom_1_0").with_physics(friction)
    made = mjcf(device, "dev")
    assert made.lost == ()
    assert loss(free_run(device, COMMANDS), run_mjcf(made.text(), COMMANDS, 0.001)) < 0.01


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (make, n) for make in (mjcf, urdf, sdf) for n in EXAMPLES
        if n not in WHOLE and EFFECTS[n].hook != "structure"
        and not (make is mjcf and n in ("presliding_friction", "force_ripple"))
    ],
)  # fmt: skip
def test_what_is_not_held_whole_is_said(make: object, name: str):
    """Every other effect has its sentence, in the file too. Mutation: an effect forgotten."""
    made = make(with_effect(name), "dev")  # pyright: ignore[reportCallIssue]
    words = {"encoder_step": "the encoder's step", "command_step": "the amplifier's step"}
    sentences = [s for s in made.lost if words.get(name, name) in s]
    assert len(sentences) == 1
    assert sentences[0] in made.text().replace("- -", "--")
    ElementTree.fromstring(made.text())


@needs_mujoco
def test_one_body_is_held_by_urdf():
    """Mass, damper, dry friction and limit, within 1 %. Mutation: the limit left out."""
    device = Device("rail", "-", False, make_chain([2.0], [3.0]), Interface(command_limit=2.0))
    device = device.with_physics(make_physics("coulomb_friction", "m1", level=0.4))
    made = urdf(device, "dev")
    assert made.lost == ()
    commands = multisine(2.0, 1.0, 10.0, 1.0, 0.001)
    theirs = run_urdf(made.text(), commands, 0.001, 2.0)
    assert loss(free_run(device, commands), theirs) < 0.01


def test_sdf_has_the_chain():
    """Links are joints with springs and dampers. Mutation: ground dampers left out of the sum."""
    device = load_device("phantom_1_0")
    root = ElementTree.fromstring(sdf(device, "dev").text())
    springs = [float(e.text or "nan") for e in root.iter("spring_stiffness")]
    np.testing.assert_allclose(springs, [0.0, *device.chain.link_springs], rtol=1e-9)
    dampers = [float(e.text or "nan") for e in root.iter("damping")]
    total = device.chain.ground_dampers.sum()
    np.testing.assert_allclose(dampers, [total, *device.chain.link_dampers], rtol=1e-9)
    inertias = [float(e.text or "nan") for e in root.iter("izz")]
    np.testing.assert_allclose(inertias, device.chain.masses, rtol=1e-12)


MODEL = """<mujoco><worldbody><body><joint name="a" type="hinge" axis="0 0 1" damping="0.2"
armature="0.5" frictionloss="0.3" stiffness="4"/><inertial pos="2 0 0" mass="3"
diaginertia="1 1 1"/></body></worldbody>
<actuator><motor joint="a" gear="2" ctrlrange="-1.5 1.5"/></actuator></mujoco>"""
ROBOT = """<robot name="r"><link name="g"/><link name="b"><inertial><origin xyz="2 0 0"/>
<mass value="3"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><mesh filename="package://not_there.stl"/></geometry></visual></link>
<joint name="a" type="continuous"><parent link="g"/><child link="b"/><axis xyz="0 0 1"/>
<dynamics damping="0.2" friction="0.3"/></joint></robot>"""


@needs_mujoco
@pytest.mark.parametrize(("text", "mass", "spring"), [(MODEL, 13.5, 4.0), (ROBOT, 13.0, 0.0)])
def test_a_joint_is_read_as_a_device(text: str, mass: float, spring: float, tmp_path: Path):
    """Steiner's 1 + 3 x 2^2 about the axis, with the armature. Mutation: the body's own inertia."""
    (tmp_path / "m.xml").write_text(text)
    device, _ = device_of_joint(tmp_path / "m.xml", "a")
    assert device.rotary
    assert device.chain.masses[0] == pytest.approx(mass)
    assert device.chain.ground_dampers[0] == pytest.approx(0.2)
    assert device.chain.ground_spring == pytest.approx(spring)
    assert dict(device.physics[0].values) == {"level": pytest.approx(0.3)}
    if spring:
        assert device.interface.command_gain == pytest.approx(2.0)
        assert device.interface.command_limit == pytest.approx(3.0)


@needs_mujoco
def test_there_and_back(tmp_path: Path):
    """What is exported is read again. Mutation: the limit before the gear."""
    device = Device("r", "-", True, make_chain([2e-3], [1e-3], 0.5),
                    Interface(delay=0.003, command_limit=0.2, command_gain=1.5))  # fmt: skip
    device = device.with_physics(make_physics("coulomb_friction", "m1", level=0.01))
    (tmp_path / "m.xml").write_text(mjcf(device, "dev").text())
    found, left_out = device_of_joint(tmp_path / "m.xml", "m1")
    assert left_out == []
    assert found.interface == device.interface
    assert found.chain.ground_spring == pytest.approx(0.5)
    assert found.chain.masses[0] == pytest.approx(2e-3)


@needs_mujoco
def test_devices_from_a_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "m.xml").write_text(MODEL)
    line = ["devices", "--from", str(tmp_path / "m.xml"), "--joint"]
    assert cli.run([*line, "a", "--save", str(tmp_path / "d.toml")]) == 0
    assert load_device(tmp_path / "d.toml").chain.masses[0] == pytest.approx(13.5)
    assert cli.run([*line, "b"]) == 2
    assert "has no joint 'b'" in capsys.readouterr().err
    (tmp_path / "m.xml").write_text("no model")
    assert cli.run([*line, "a"]) == 2
    assert "is not a model" in capsys.readouterr().err
    assert cli.run(["devices", "--joint", "a"]) == 2


@pytest.mark.parametrize("to", ["mjcf", "urdf", "sdf"])
def test_the_command_says_what_is_lost(to: str, tmp_path: Path):
    out, said = tmp_path / f"x.{to}", tmp_path / "x.json"
    line = ["export", "ethz_haptic_paddle", "--to", to, "-o", str(out), "--seconds", "0.5"]
    assert cli.run([*line, "--json", str(said)]) == 0
    result = json.loads(said.read_text())
    assert "encoder's step" in " ".join(result["lost"])
    assert result["cost"] in out.read_text()
    if to == "sdf":
        assert result["error_over_motion"] > 0.01


ACTUATORS = {
    "position": (
        '<position name="drive" joint="m1" kp="3" kv="0.02" gear="1.5" forcerange="-1 1"/>'
    ),
    "velocity": '<velocity name="drive" joint="m1" kv="0.05" gear="2"/>',
    "general": (
        '<general name="drive" joint="m1" gainprm="4" biastype="affine" biasprm="0 -2 -0.01"/>'
    ),
    "motor": '<motor name="drive" joint="m1" gear="0.7"/>',
}  # fmt: skip


@needs_mujoco
@pytest.mark.parametrize("kind", list(ACTUATORS))
def test_loops_of_a_model_are_drives(kind: str, tmp_path: Path):
    """The joint in MuJoCo and the device that it was read as move alike, within 1 %.

    Mutations: the gear once where it counts twice; the damping of a loop left out.
    """
    text = f"""<mujoco><option timestep="1e-4" integrator="RK4" gravity="0 0 0"/><worldbody>
      <body><joint name="m1" damping="0.01" axis="0 1 0"/>
      <inertial pos="0 0 0" mass="0.2" diaginertia="1e-3 1e-3 1e-3"/></body></worldbody>
      <actuator>{ACTUATORS[kind]}</actuator></mujoco>"""
    (tmp_path / "m.xml").write_text(text)
    device, left_out = device_of_joint(tmp_path / "m.xml", "m1")
    assert left_out == []
    assert loss(free_run(device, COMMANDS), run_mjcf(text, COMMANDS, 0.001)) < 0.01
    looped = [p.effect.name for p in device.physics]
    assert ("position_servo" in looped) == (kind in ("position", "general"))


@needs_mujoco
def test_a_mesh_that_is_missing_costs_nothing_where_inertials_are_given(tmp_path: Path):
    """Mutation: the shape taken out of a body whose inertia it gives."""
    text = """<mujoco><asset><mesh name="m" file="nowhere.stl"/></asset><worldbody><body>
      <joint name="m1" axis="0 1 0"/><geom type="mesh" mesh="m"/>{}</body></worldbody></mujoco>"""
    inertial = '<inertial pos="0 0 0" mass="0.2" diaginertia="1e-3 2e-3 1e-3"/>'
    (tmp_path / "m.xml").write_text(text.format(inertial))
    device, _ = device_of_joint(tmp_path / "m.xml", "m1")
    assert device.chain.masses[0] == pytest.approx(2e-3)
    (tmp_path / "m.xml").write_text(text.format(""))
    with pytest.raises(ValueError, match=r"nowhere\.stl"):
        device_of_joint(tmp_path / "m.xml", "m1")


DCMOTOR = """<mujoco><option timestep="0.0001" gravity="0 0 0" integrator="implicitfast"/>
<worldbody><body name="m1"><joint name="q" type="hinge" axis="0 0 1" damping="0.002"/>
<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/></body></worldbody>
<actuator><dcmotor name="drive" joint="q" motorconst="0.05" resistance="2" inductance="0.01"
gear="4" {more}/></actuator></mujoco>"""


@needs_mujoco
def test_a_dc_motor_is_a_drive_under_a_voltage(tmp_path: Path) -> None:
    """Gain g K / R, damper g^2 K^2 / R, lag L / R; the step response is MuJoCo's own.

    Mutations: the gear once in the damper; the lag left out; heat not said.
    """
    mujoco = pytest.importorskip("mujoco")
    if not hasattr(mujoco.mjtGain, "mjGAIN_DCMOTOR"):
        pytest.skip("this MuJoCo has no dcmotor")
    path = tmp_path / "motor.xml"
    text = DCMOTOR.format(more='ctrlrange="-12 12" ctrllimited="true"')
    path.write_text(text)
    device, left_out = device_of_joint(path, "q")
    assert device.interface.command_gain == pytest.approx(4.0 * 0.05 / 2.0)
    assert device.chain.ground_dampers[0] == pytest.approx(0.002 + 16.0 * 0.05**2 / 2.0)
    assert device.interface.command_limit == pytest.approx(12.0 * 4.0 * 0.05 / 2.0)
    (lag,) = [p for p in device.physics if p.effect.name == "actuator_lag"]
    assert lag.values["time_constant"] == pytest.approx(0.005)
    assert left_out == []
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.ctrl[0] = 3.0
    speeds = []
    for _ in range(3000):
        mujoco.mj_step(model, data)
        speeds.append(float(data.qvel[0]))
    ours = simulate(device, recorded(np.full(300, 3.0)), duration=0.3).trace["velocity_m1"]
    np.testing.assert_allclose(ours[1:], speeds[9:-1:10], rtol=0.01, atol=0.01 * max(speeds))
    path.write_text(DCMOTOR.format(more='thermal="2 50 0 0.004 20 20"'))
    assert any("heat" in said for said in device_of_joint(path, "q")[1])


@needs_mujoco
@pytest.mark.parametrize(("inductance", "delay"), [(0.0, 0.0), (0.002, 0.0), (0.0, 0.003)])
def test_a_drive_whose_winding_is_told_is_written_as_a_dc_motor(
    tmp_path: Path, inductance: float, delay: float
) -> None:
    """It moves in MuJoCo as the device does, within its supply and beyond, and is read as it was.

    Mutations: the winding's damping left in the joint as well; the gain's square left out of R.
    """
    mujoco = pytest.importorskip("mujoco")
    if not hasattr(mujoco.mjtGain, "mjGAIN_DCMOTOR"):
        pytest.skip("this MuJoCo has no dcmotor")
    drive = Drive(
        "voltage", motor_constant=0.05, resistance_ohm=2.0, gear=4.0, inductance_h=inductance,
        supply_v=12.0, when_off="open",
    )  # fmt: skip
    bare = Device(
        "rig", "", True, make_chain([0.01], [0.002]), Interface(period=0.001, delay=delay)
    )
    device = drive.on(bare)
    made = mjcf(device, "dev")
    assert "<dcmotor" in made.text()
    assert any("nothing opens it" in said for said in made.lost)
    assert any("back-EMF lag" in said for said in made.lost) == (inductance > 0.0)
    volts = 300.0 * COMMANDS / np.abs(COMMANDS).max() * np.linspace(0.0, 0.1, COMMANDS.size)
    assert np.abs(volts).max() > 12.0
    assert loss(free_run(device, volts), run_mjcf(made.text(), volts, 0.001)) < 0.01
    (tmp_path / "m.xml").write_text(made.text())
    again, _ = device_of_joint(tmp_path / "m.xml", "m1")
    assert again.interface.command_gain == pytest.approx(device.interface.command_gain)
    assert again.interface.command_limit == pytest.approx(device.interface.command_limit)
    assert again.chain.ground_dampers[0] == pytest.approx(device.chain.ground_dampers[0])
    lags = [
        [p.values["time_constant"] for p in d.physics if p.effect.name == "actuator_lag"]
        for d in (device, again)
    ]
    assert lags[0] == pytest.approx(lags[1])


PASSIVE = {
    "stribeck_friction": {"level": 0.02, "static_level": 0.04, "velocity": 0.05},
    "presliding_friction": {"level": 0.03, "stiffness": 3.0},
    "force_ripple": {"amplitude": 0.05, "period": 0.1, "phase": 1.0},
}
NO_MOTOR = "this MuJoCo has no dcmotor without inputs"
SWING = 0.15 * np.sin(2.0 * np.pi * 0.8 * 1e-3 * np.arange(1500))


def needs_passive_motor() -> None:
    mujoco = pytest.importorskip("mujoco")
    if not hasattr(getattr(mujoco, "mjtCtrlInput", None), "mjINPUT_NONE"):
        pytest.skip(NO_MOTOR)


@needs_mujoco
@pytest.mark.parametrize("at", ["m1", "m2"])
@pytest.mark.parametrize("name", list(PASSIVE))
def test_friction_with_a_curve_and_a_ripple_are_passive_motors(
    name: str, at: str, tmp_path: Path
) -> None:
    """Within 0.2 % in a swing that sticks and slips, with limit and delay; read as they were.

    With dry friction of the level alone the errors are 1.6 to 5 %. Mutations: static_level as
    level; bristles of a thousandth; the period as the number of poles; the phase's sign.
    """
    needs_passive_motor()
    chain = make_chain([3e-3, 1e-3], [2e-2, 5e-3], 0.05, [40.0], [4e-3])
    bare = Device("belt", "-", True, chain, Interface(command_limit=0.12, delay=2e-3))
    device = bare.with_physics(make_physics(name, at, **PASSIVE[name]))
    made = mjcf(device, "dev")
    assert len(made.lost) == (name == "stribeck_friction")
    assert all("before it slips it gives by up to" in said for said in made.lost)
    ours = free_run(device, SWING)
    assert loss(ours, run_mjcf(made.text(), SWING, 0.001)) < 0.002
    assert loss(ours, free_run(bare, SWING)) > 0.04
    (tmp_path / "m.xml").write_text(made.text())
    again, _ = device_of_joint(tmp_path / "m.xml", at)
    (found,) = again.physics
    assert found.effect.name == name
    assert dict(found.values) == pytest.approx(PASSIVE[name])
    if at == "m1":
        assert again.interface == device.interface


@needs_mujoco
def test_bristles_stiffer_than_a_step_resolves_are_softened_and_said() -> None:
    """Stable in MuJoCo, within 0.5 %. Mutation: the stiffness of the device (it runs away)."""
    needs_passive_motor()
    stiff = make_physics("presliding_friction", "m1", level=0.03, stiffness=3e8)
    device = Device("r", "-", True, make_chain([3e-3], [2e-3])).with_physics(stiff)
    made = mjcf(device, "dev")
    assert any("(1e-10 in the device)" in said for said in made.lost)
    assert loss(free_run(device, SWING), run_mjcf(made.text(), SWING, 0.001)) < 0.005


MOTOR_WITH_ALL = """<mujoco><compiler angle="radian"/>
<option timestep="2e-5" gravity="0 0 0" integrator="implicitfast"/>
<worldbody><body><joint name="m1" type="hinge" axis="0 0 1" stiffness="0.05" springref="0.3"/>
<inertial pos="0 0 0" mass="1" diaginertia="3e-3 3e-3 3e-3"/></body></worldbody>
<actuator><dcmotor name="drive" joint="m1" motorconst="0.05" resistance="2" gear="{gear}" {own}/>
<dcmotor name="brake" joint="m1" motorconst="0.06" resistance="3" gear="2" input="none"/>
<general joint="m1" gainprm="0" biastype="affine" biasprm="0.02 0 0"/></actuator></mujoco>"""


@needs_mujoco
@pytest.mark.parametrize(
    ("own", "left"),
    [
        ('lugre="2000 0 0.005 0.01 0.2"', "bristles"),
        ('lugre="0.2 0 0.008 0.008 0.2" damping="2e-4"', ""),
        ('cogging="0.004 9 0.7"', ""),
        ('cogging="-0.004 -9 0.7"', ""),
    ],
)
def test_friction_and_cogging_of_a_motor_are_effects(own: str, left: str, tmp_path: Path) -> None:
    """The joint in MuJoCo and the device that it was read as move alike, within 0.5 %.

    Beside the motor there is a shorted one, which brakes, and a constant force. The joint's spring
    rests at 0.3 rad, where the device is at zero. Mutations: the gear once in the stiffness; no
    origin in the phase; a negative number of poles as it is; the shorted winding left out.
    """
    needs_passive_motor()
    text = MOTOR_WITH_ALL.format(gear=4.0, own=own)
    (tmp_path / "m.xml").write_text(text)
    device, left_out = device_of_joint(tmp_path / "m.xml", "m1")
    assert [left in said for said in left_out] == ([True] if left else [])
    assert device.interface.position_origin == pytest.approx(0.3)
    volts = 8.0 * SWING
    assert loss(free_run(device, volts), run_mjcf(text, volts, 0.001)) < 0.005


@needs_mujoco
def test_a_motor_that_turns_the_other_way_brakes_and_rubs_all_the_same(tmp_path: Path) -> None:
    """Its command is left out, and said. Mutations: the sign of a gear in cogging; no braking."""
    needs_passive_motor()
    text = MOTOR_WITH_ALL.format(gear=-4.0, own='cogging="0.004 9 0.7" lugre="0.2 0 8e-3 8e-3 1"')
    (tmp_path / "m.xml").write_text(text)
    device, left_out = device_of_joint(tmp_path / "m.xml", "m1")
    (said,) = left_out
    assert "gear of 'drive' is -4" in said
    still = np.zeros(SWING.size)
    assert loss(free_run(device, still), run_mjcf(text, still, 0.001)) < 0.005


@needs_mujoco
def test_the_drive_is_found_beside_actuators_without_an_input(tmp_path: Path) -> None:
    """Also if it stands after them. Mutation: the number of an actuator as that of its input."""
    needs_passive_motor()
    device = Device("belt", "-", True, make_chain([3e-3], [2e-2])).with_physics(
        make_physics("force_ripple", "m1", **PASSIVE["force_ripple"]),
        make_physics("constant_force", "m1", level=0.01),
    )
    root = ElementTree.fromstring(mjcf(device, "dev").body)
    (block,) = root.findall("actuator")
    block[:] = block[::-1]
    path = tmp_path / "m.xml"
    path.write_text(ElementTree.tostring(root, encoding="unicode"))
    joint = ModelRuns(device, path, "m1").joint
    assert joint.actuator == 1  # after the input of the constant force, which does nothing
    again, left_out = device_of_joint(path, "m1")
    assert left_out == []
    assert {p.effect.name for p in again.physics} == {"force_ripple", "constant_force"}
