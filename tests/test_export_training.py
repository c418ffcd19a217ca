"""Devices for reinforcement learning: Isaac Lab, Newton, BAM, by their own code where it is here.

Newton, and BAM on Python 3.12: pip install 'zwidth[simulators]'. Isaac Lab is not in it: 3.0
pins torch and Newton 1.6, and 2.3 needs numpy 1. Its package needs Isaac Sim to run, but its
sources say which fields a configuration has: pip install --no-deps isaaclab.
"""

import ast
import json
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from zwidth import cli
from zwidth.export.bam import bam, device_of_bam, has_bam, run_bam
from zwidth.export.isaac_lab import isaac_lab
from zwidth.export.model import Floats, command_for, free_run, loss
from zwidth.export.newton import newton
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device, save_device
from zwidth.sim.drive import Drive
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.uncertainty import Uncertainty

ROTOR = Device("rotor", "-", True, make_chain([1.2e-3], [3e-3]), Interface(period=0.002))
RUB = make_physics("stribeck_friction", "m1", level=0.02, static_level=0.035, velocity=0.6)
LATE = ROTOR.with_interface(delay=0.004, command_limit=0.05, command_gain=2.0)
SERVO = Drive("position", stiffness=2.0, damping=0.02, limit=0.3).on(ROTOR)
XL330 = {  # the numbers of an XL330 as Isaac Lab has them, rounded
    "actuator": "xl330", "model": "m6", "kt": 0.366, "R": 2.81, "armature": 0.0018,
    "q_offset": 0.03, "error_gain": 0.00288, "max_pwm": 1.0, "max_current": 1.75, "kp": 400.0,
    "vin": 7.5,
    "friction_base": 0.0048, "friction_stribeck": 0.0047, "friction_viscous": 0.0054,
    "dtheta_stribeck": 2.9, "alpha": 8.68, "load_friction_motor": 0.267,
    "load_friction_external": 0.0, "load_friction_motor_stribeck": 0.0,
    "load_friction_external_stribeck": 0.08, "load_friction_motor_quad": 0.01,
    "load_friction_external_quad": 0.005,
}  # fmt: skip


def given(text: str, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What a module for Isaac Lab gives to its configuration."""
    stub = ModuleType("isaaclab.actuators")
    stub.__dict__["DelayedPDActuatorCfg"] = dict
    monkeypatch.setitem(sys.modules, "isaaclab", ModuleType("isaaclab"))
    monkeypatch.setitem(sys.modules, "isaaclab.actuators", stub)
    space: dict[str, Any] = {}
    exec(text, space)
    return space["DEV_CFG"]


def test_an_actuator_of_isaac_lab_has_the_device_s_numbers(monkeypatch: pytest.MonkeyPatch):
    """Mutations: the two levels of friction exchanged; the delay in seconds."""
    late = given(isaac_lab(LATE.with_physics(RUB), "dev").text("cost"), monkeypatch)
    assert late["joint_names_expr"] == ["m1"]
    assert (late["min_delay"], late["max_delay"], late["effort_limit"]) == (2, 2, 0.05)
    assert (late["stiffness"], late["damping"], late["armature"]) == (0.0, 0.0, 1.2e-3)
    friction = [late[k] for k in ("friction", "dynamic_friction", "viscous_friction")]
    assert friction == pytest.approx([0.035, 0.02, 3e-3])
    servo = given(isaac_lab(SERVO, "dev").text(), monkeypatch)
    assert (servo["stiffness"], servo["damping"], servo["effort_limit"]) == (2.0, 0.02, 0.3)
    assert servo["max_delay"] == 0


def test_its_fields_are_those_of_isaac_lab_s_sources(monkeypatch: pytest.MonkeyPatch):
    """By the package that is installed, whichever release. Mutation: a field misspelt."""
    spec = find_spec("isaaclab")
    if spec is None or not spec.submodule_search_locations:
        pytest.skip("isaaclab is not installed (pip install --no-deps isaaclab)")
    found: dict[str, set[str]] = {}
    for folder in spec.submodule_search_locations:
        for file in Path(folder).rglob("actuator*_cfg.py"):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef):
                    own = [n.target for n in node.body if isinstance(n, ast.AnnAssign)]
                    names = {target.id for target in own if isinstance(target, ast.Name)}
                    found.setdefault(node.name, set()).update(names)
    family = ("ActuatorBaseCfg", "IdealPDActuatorCfg", "DelayedPDActuatorCfg")
    fields = set().union(*(found[name] for name in family))
    config = given(isaac_lab(LATE.with_physics(RUB), "dev").text(), monkeypatch)
    assert config.keys() <= fields


def run_newton(
    path: Path, commands: Floats, period: float, give: Callable[[Any, float], None], steps: int
) -> Floats:
    """The joint under commands in Newton, MuJoCo's equations on the CPU; steps of the actuator."""
    warp, module = import_module("warp"), import_module("newton")
    warp.config.quiet = True
    builder = module.ModelBuilder()
    builder.add_usd(str(path))
    model = builder.finalize(device="cpu")
    solver = module.solvers.SolverMuJoCo(model, use_mujoco_cpu=True, integrator="implicitfast")
    state, after, control = model.state(), model.state(), model.control()
    (actuator,) = model.actuators
    now, then = (actuator.state(), actuator.state()) if actuator.is_stateful else (None, None)
    # Newton gives a first command at once; here there is none before it.
    for _ in range(0 if actuator.delay is None else actuator.delay.delay_steps.numpy()[0]):
        actuator.step(state, control, now, then, dt=period)
        now, then = then, now
    found: list[float] = []
    for command in commands:
        found.append(float(state.joint_q.numpy()[0]))
        give(control, float(command))
        for _ in range(steps):
            control.joint_f.zero_()
            actuator.step(state, control, now, then, dt=period / steps)
            now, then = then, now
            for _ in range(20 // steps):
                solver.step(state, after, control, None, period / 20)
                state, after = after, state
    return np.array(found)


@pytest.mark.filterwarnings("ignore")
def test_newton_moves_a_device_alike(tmp_path: Path):
    """Effort through gain, limit and delay, and a goal. Mutations: damping per radian; no delay."""
    pytest.importorskip("newton", reason="newton is not installed")
    pytest.importorskip("pxr", reason="usd-core is not installed")
    for name, device, steps in (("late", LATE, 1), ("servo", SERVO, 20)):
        path = tmp_path / f"{name}.usda"
        path.write_bytes(newton(device, "dev").content("cost"))
        commands = command_for(device, 0.4)
        looped = name == "servo"
        share = device.interface.command_gain / (2.0 if looped else 1.0)

        def give(control: Any, u: float, looped: bool = looped, share: float = share) -> None:
            (control.joint_target_q if looped else control.joint_act).assign([share * u])

        theirs = run_newton(path, commands, 0.002, give, steps)
        assert loss(free_run(device, commands), theirs) < 0.01, name


def test_a_stage_for_newton_says_what_it_does_not_hold():
    """Mutation: friction of joints in degrees."""
    made = newton(LATE.with_physics(RUB), "dev")
    text = made.text("cost")
    assert text.startswith("#usda 1.0\n")
    assert "float newton:friction = 0.02\n" in text
    assert "  - dry friction is a soft constraint there" in text
    assert "int newton:delaySteps = 2\n" in text
    assert "newton:maxEffort = 0.05\n" in text


def written(folder: Path, **changed: object) -> Path:
    file = folder / "m6.json"
    told = {k: v for k, v in (XL330 | changed).items() if v is not None}
    file.write_text(json.dumps(told))
    return file


def test_a_servo_of_bam_is_a_device(tmp_path: Path):
    """kt / R of the voltage, kt^2 / R of the back-EMF. Mutations: duty for volts; R in A."""
    device, left_out = device_of_bam(written(tmp_path))
    servo = {p.effect.name: dict(p.values) for p in device.physics}
    gain = 0.366 / 2.81
    assert servo["position_servo"]["stiffness"] == pytest.approx(400.0 * 0.00288 * 7.5 * gain)
    assert servo["position_servo"]["back_emf"] == pytest.approx(0.366 * gain)
    assert servo["servo_limit"] == {"limit": pytest.approx(7.5 * gain)}
    assert servo["load_friction"] == {"ratio": 0.267}
    area = 2.9 * math.gamma(1.0 + 1.0 / 8.68)  # of the fall with speed, which stays
    assert servo["stribeck_friction"]["velocity"] * math.gamma(1.5) == pytest.approx(area)
    assert servo["stribeck_friction"]["static_level"] == pytest.approx(0.0095)
    assert any("load_friction_external_stribeck, 0.08" in line for line in left_out)
    volts, _ = device_of_bam(written(tmp_path, model="m1", kp=None, command_delay=0.004))
    assert volts.interface.command_gain == pytest.approx(gain)
    assert volts.chain.ground_dampers[0] == pytest.approx(0.0054 + 0.366 * gain)
    assert volts.interface.delay == 0.004
    assert dict(volts.physics[0].values) == {"level": 0.0048}
    amps, _ = device_of_bam(written(tmp_path, model="m1", actuator="erob80_100", R=None))
    assert amps.interface.command_gain == pytest.approx(0.366)
    assert amps.chain.ground_dampers[0] == pytest.approx(0.0054)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"model": "m7"}, "model of m6.json is 'm7'"),
        ({"model": None}, 'm6.json has no "model"'),
        ({"kt": None}, "m6.json has no number 'kt', which m6 needs"),
        ({"kt": 0.0}, "kt of m6.json is 0; it must be a finite number above 0"),
        ({"friction_base": -1.0}, "friction_base of m6.json is -1; it must be >= 0 and finite"),
    ],
)
def test_a_servo_that_cannot_be_is_refused_in_a_sentence(
    changed: dict[str, object], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):  # fmt: skip
    written(tmp_path, **changed)
    monkeypatch.chdir(tmp_path)
    assert cli.run(["devices", "--from", "m6.json"]) == 2
    assert said in " ".join(capsys.readouterr().err.split())


def test_bam_there_and_back(tmp_path: Path):
    """Mutations: viscous friction counted twice; the delay left out."""
    load = make_physics("load_friction", "m1", ratio=0.1)
    winding = make_physics("open_winding", "m1", damping=1e-3)
    device = LATE.with_interface(command_limit=math.inf).with_physics(RUB, load, winding)
    (tmp_path / "m5.json").write_bytes(bam(device, "dev").content("cost"))
    told = json.loads((tmp_path / "m5.json").read_text())
    assert (told["model"], told["actuator"], told["zwidth"]["cost"]) == ("m5", "dev", "cost")
    back, left_out = device_of_bam(tmp_path / "m5.json", period=0.002)
    assert left_out == []
    assert back.interface == device.interface
    assert back.chain.ground_dampers[0] == pytest.approx(3e-3)
    for name in ("stribeck_friction", "load_friction"):
        own, other = (
            next(dict(p.values) for p in d.physics if p.effect.name == name) for d in (device, back)
        )
        assert own == pytest.approx(other)


@pytest.mark.parametrize(
    ("device", "said"),
    [
        (replace(ROTOR, rotary=False), "rotor is not rotary"),
        (SERVO, "rotor has position_servo"),
        (ROTOR.with_chain(make_chain([1e-3], [0.0])), "rotor has no damping"),
    ],
)
def test_what_bam_cannot_have_is_refused(device: Device, said: str):
    with pytest.raises(ValueError, match=said):
        bam(device, "dev")


@pytest.mark.skipif(not has_bam(), reason="better-actuator-models is not installed")
@pytest.mark.parametrize(
    "effects", [(), (RUB,), (make_physics("coulomb_friction", "m1", level=0.02),)]
)
def test_bam_s_own_simulator_moves_a_device_alike(effects: tuple[Any, ...]):
    """Mutations: R the inverse of what it is; the rise at rest left out."""
    device = LATE.with_interface(command_limit=math.inf).with_physics(*effects)
    commands = command_for(device, 2.0)
    theirs = run_bam(bam(device, "dev").text(), commands, 0.002)
    assert loss(free_run(device, commands), theirs) < 0.002


def test_the_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """BAM to a device to each simulator, and draws as every file. Mutation: rows and columns."""
    monkeypatch.chdir(tmp_path)
    written(tmp_path, model="m2", kp=None)
    assert cli.run(["devices", "--from", "m6.json", "--out", "servo.toml"]) == 0
    assert load_device("servo.toml").chain.masses[0] == pytest.approx(0.0018)
    save_device(replace(LATE, uncertainty=Uncertainty(masses=0.1, dampers=0.2)), Path("d.toml"))
    for to, field in (("isaaclab", "armature"), ("newton", "newton:damping"), ("bam", "kt")):
        line = ["export", "d.toml", "--to", to, "--out", f"o.{to}", "--randomise", "7", "--force"]
        for suffix in ("json", "npz", "csv"):
            assert cli.run([*line, "--draws", f"d.{suffix}"]) == 0
        told = json.loads(Path("d.json").read_text())["fields"][field]["draws"]
        assert len(set(told)) == 7
        with np.load("d.npz", allow_pickle=False) as kept:
            assert kept[field].tolist() == told
        rows = np.genfromtxt("d.csv", delimiter=",", names=True, deletechars="")
        assert rows[field].tolist() == told
    assert cli.run(["export", "d.toml", "--to", "bam", "--out", "o", "--draws", "d.csv"]) == 2
    line = ["export", "d.toml", "--to", "bam", "--out", "o", "--randomise", "3"]
    assert cli.run([*line, "--draws", "d.xls"]) == 2
