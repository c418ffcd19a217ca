"""Servos of BAM (Better Actuator Models, github.com/Rhoban/bam): its JSON, read and written.

A file has one flat object: the name of the friction model, "m1" to "m6", and its numbers. The motor
is a winding under a voltage u, with tau = kt (u - kt v) / R; friction is at most

    friction_base + |load| + s(v) (friction_stribeck + |load at rest|) + friction_viscous |v|,
    s(v) = exp(-|v / dtheta_stribeck|^alpha),

where the load is a share of the motor's torque (m3 to m6) and of external torques. m6 adds a square
of the torque. A JSON as extended by Isaac Lab also has the firmware: kp, error_gain, vin and
max_pwm. It is then a servo, whose command is the goal of its position. Motors of eRob are driven by
a current, tau = kt i.

In this project s has the exponent 2, and load is the drive's force alone.
"""

import json
import math
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from zwidth.export.actuator import actuator_of
from zwidth.export.model import Exported, Floats
from zwidth.files.protection import reading
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.drive import Drive
from zwidth.sim.interface import Interface
from zwidth.sim.nearest import nearest
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

STRIBECK = ("friction_stribeck", "dtheta_stribeck", "alpha")
LOAD = ("load_friction_base",)
SIDES = ("load_friction_motor", "load_friction_external")
NEEDED: dict[str, tuple[str, ...]] = {
    "m1": (),
    "m2": STRIBECK,
    "m3": LOAD,
    "m4": (*STRIBECK, *LOAD, "load_friction_stribeck"),
    "m5": (*STRIBECK, *SIDES, *(f"{side}_stribeck" for side in SIDES)),
}
NEEDED["m6"] = (*NEEDED["m5"], *(f"{side}_quad" for side in SIDES))
ALWAYS = ("kt", "armature", "friction_base", "friction_viscous")
FIRMWARE = ("kp", "error_gain", "vin")
ABOVE_ZERO = ("kt", "R", "armature", "dtheta_stribeck", "alpha", *FIRMWARE, "max_pwm")
OF_CURRENT = "erob"  # beginning of the names of actuators driven by a current
SUBSTEPS = 20  # steps of BAM's first-order integrator per sample


def device_of_bam(path: Path, period: float = 0.001) -> tuple[Device, list[str]]:
    """Return a servo of BAM as a device of one mass, and sentences on what this device leaves out.

    The mass is the rotor's alone, `armature`. period [s]: of the sampled interface, which the file
    does not contain.

    Raises ValueError, with the field and what is allowed, for a file that is not a JSON of BAM.
    """
    model, numbers, actuator = _read(path)
    left_out: list[str] = []
    kt, resistance = numbers["kt"], numbers.get("R", math.nan)
    if actuator.startswith(OF_CURRENT) or math.isnan(resistance):
        drive = Drive("current", motor_constant=kt)
    elif all(name in numbers for name in FIRMWARE):
        drive = Drive(
            "servo", motor_constant=kt, resistance_ohm=resistance,
            supply_v=numbers["vin"] * numbers.get("max_pwm", 1.0),
            proportional=numbers["kp"] * numbers["error_gain"] * numbers["vin"],
        )  # fmt: skip
        if numbers.get("max_current"):
            left_out.append(f"the limit of its current, {numbers['max_current']:g} A")
    else:
        drive = Drive("voltage", motor_constant=kt, resistance_ohm=resistance)
    plain = Device(
        f"BAM {model} of {path.name}", str(path), True,
        make_chain([numbers["armature"]], [numbers["friction_viscous"]]),
        Interface(period=period, delay=numbers.get("command_delay", 0.0)),
    ).with_physics(*_frictions(model, numbers, left_out))  # fmt: skip
    if numbers.get("q_offset"):
        left_out.append(f"the offset of its test bench, {numbers['q_offset']:g} rad")
    return drive.on(plain), left_out


def _frictions(model: str, numbers: dict[str, float], left_out: list[str]) -> list[Physics]:
    found: list[Physics] = []
    base, more = numbers["friction_base"], numbers.get("friction_stribeck", 0.0)
    if model in ("m1", "m3") or more == 0.0:
        if base > 0.0:
            found.append(make_physics("coulomb_friction", "m1", level=base))
    else:
        alpha, speed = numbers["alpha"], numbers["dtheta_stribeck"]
        # The same area under the fall: exp(-|v / s|^a) has s Gamma(1 + 1 / a) over v > 0.
        alike = speed * math.gamma(1.0 + 1.0 / alpha) / math.gamma(1.5)
        found.append(
            make_physics(
                "stribeck_friction", "m1", level=base, static_level=base + more, velocity=alike
            )
        )
        if alpha != 2.0:
            left_out.append(
                f"the exponent of its fall with speed, alpha {alpha:g}: it is 2, over {alike:.4g}"
                f" in place of {speed:g} rad/s, with the same area"
            )
    ratio = numbers.get("load_friction_base", numbers.get("load_friction_motor", 0.0))
    if ratio > 0.0:
        found.append(make_physics("load_friction", "m1", ratio=ratio))
    outside = numbers.get("load_friction_external", numbers.get("load_friction_base", 0.0))
    if outside > 0.0:
        left_out.append(f"friction by the torque from outside, {outside:g} of it")
    for name in NEEDED[model]:
        if name.endswith(("_stribeck", "_quad")) and name.startswith("load_") and numbers[name]:
            left_out.append(f"{name}, {numbers[name]:g}")
    return found


def _read(path: Path) -> tuple[str, dict[str, float], str]:
    """Return model, numbers and actuator."""
    if not path.is_file():
        raise ValueError(f"{path} is not a file; give the JSON of BAM's parameters")
    try:
        told = json.loads(reading(path).read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path} is not a JSON file of BAM: {error}") from None
    if not isinstance(told, dict) or "model" not in told:
        raise ValueError(
            f'{path} has no "model"; a JSON of BAM is one object with "model" ("m1" to "m6")'
            " and the parameters of the model"
        )
    content = cast("dict[str, Any]", told)
    model = str(content["model"])
    if model not in NEEDED:
        raise ValueError(f"model of {path} is {model!r}; {nearest(model, list(NEEDED))}")
    numbers: dict[str, float] = {}
    for name, value in content.items():
        if isinstance(value, int | float) and not isinstance(value, bool):
            numbers[name] = float(value)
    for name in (*ALWAYS, *NEEDED[model]):
        if name not in numbers:
            raise ValueError(f"{path} has no number {name!r}, which {model} needs; fit it with BAM")
    for name in (*ALWAYS, "R", *NEEDED[model], *FIRMWARE, "max_pwm", "command_delay"):
        value = numbers.get(name, 1.0)
        if not 0.0 <= value < math.inf or (value == 0.0 and name in ABOVE_ZERO):
            allowed = "a finite number above 0" if name in ABOVE_ZERO else ">= 0 and finite"
            raise ValueError(f"{name} of {path} is {value:g}; it must be {allowed}")
    return model, numbers, str(content.get("actuator", ""))


@dataclass(frozen=True)
class BamFile(Exported):
    """A JSON of BAM; the rest of the device is under the key "zwidth", which BAM ignores."""

    def text(self, cost: str = "") -> str:
        """Return the file's text; cost: a sentence on how well it matches the device."""
        about = {"about": list(self.about), "not_held": list(self.lost), "cost": cost}
        return json.dumps(json.loads(self.body) | {"zwidth": about}, indent=4) + "\n"


def bam(device: Device, name: str) -> BamFile:
    """Return a rotary device as a JSON of BAM; name: of the actuator.

    With dry friction the model is "m1", with higher friction at rest "m2", with friction by the
    drive's force "m5". If the device does not state the winding's part of its damping
    (`open_winding`), all of the damping counts as the winding's.

    Raises ValueError for a device that is not rotary, has a loop on its position, or has no
    damping, from which kt and R are computed.
    """
    if not device.rotary:
        raise ValueError(f"{device.name} is not rotary, but actuators of BAM are")
    if any(p.effect.name == "position_servo" for p in device.physics):
        raise ValueError(
            f"{device.name} has position_servo, but BAM keeps the gains of a loop in its code, not"
            " in its files; export the device without it, and give BAM kp and vin"
        )
    kept = {p.effect.name: p for p in device.physics if p.at == "m1"}
    rub, load = kept.get("stribeck_friction"), kept.get("load_friction")
    bare = tuple(
        p for p in device.physics if p.effect.name not in ("load_friction", "open_winding")
    )
    a = actuator_of(replace(device, physics=bare), rises=True)
    lost = [line for line in a.lost if not line.startswith("stribeck_friction@m1: both levels")]
    winding = a.viscous
    if (opened := kept.get("open_winding")) is not None:
        winding = min(winding, opened.values["damping"])
    elif winding > 0.0:
        lost.append(
            "how much of the damping is the winding's is not known: all of it is taken as such, in"
            " kt and R"
        )
    if not winding > 0.0:
        raise ValueError(
            f"{device.name} has no damping, from which BAM's kt and R are computed; give b1 a value"
            " above 0"
        )
    if math.isfinite(a.limit):
        lost.append(
            f"the limit of {a.limit:g} is not held: BAM has the supply's voltage in its logs"
        )
    kt = winding / a.gain
    model = "m5" if load is not None else "m2" if rub is not None else "m1"
    numbers: dict[str, float] = {
        "kt": kt, "R": kt / a.gain, "armature": a.mass, "friction_base": a.sliding,
        "friction_viscous": a.viscous - winding,
    }  # fmt: skip
    if a.held.interface.delay > 0.0:
        numbers["command_delay"] = device.interface.delay
    if model != "m1":
        speed = 1.0 if rub is None else rub.values["velocity"]
        numbers |= {
            "friction_stribeck": a.at_rest - a.sliding, "dtheta_stribeck": speed, "alpha": 2.0,
        }  # fmt: skip
    if load is not None:
        lost.append("load_friction@m1: BAM counts the back-EMF off the force that it goes by")
        numbers |= dict.fromkeys(NEEDED["m5"][len(STRIBECK) :], 0.0)
        numbers["load_friction_motor"] = load.values["ratio"]
    body = json.dumps({**numbers, "model": model, "actuator": name})
    about = (
        f"{device.name}, exported by zwidth.",
        f"The voltage is the command, held for {device.interface.period:.9g} s. BAM has the gains"
        f" of the firmware in its code: give it an actuator {name!r}, or put one of its own here.",
    )
    return BamFile(body, about, tuple(lost), a.held)


def has_bam() -> bool:
    """Whether BAM is installed."""
    try:
        return hasattr(import_module("bam.model"), "load_model_from_dict")
    except ModuleNotFoundError:
        return False


def run_bam(text: str, commands: Floats, period: float) -> Floats:
    """Return positions (ticks,) of BAM's own simulator under voltages (ticks,)."""
    told = json.loads(text)
    actuators: Any = import_module("bam.actuators").actuators
    winding: Any = import_module("bam.actuator").VoltageControlledActuator

    class Bare(winding):
        """A motor on a bench without a pendulum."""

        def initialize(self) -> None:
            super().initialize()
            self.model.armature = import_module("bam.parameter").Parameter(1.0, 0.0, math.inf)

        def get_extra_inertia(self) -> float:
            return self.model.armature.value

    actuators[told["actuator"]] = lambda: Bare(SimpleNamespace, vin=1.0, kp=1.0)
    model = import_module("bam.model").load_model_from_dict(told)
    model.actuator.testbench = SimpleNamespace(compute_bias=_nothing, compute_mass=_nothing)
    simulator = import_module("bam.simulate").Simulator(model)
    step, late = period / SUBSTEPS, told.get("command_delay", 0.0) / period
    found = np.empty(commands.size)
    for k in range(commands.size):
        found[k] = simulator.q
        for i in range(SUBSTEPS):
            at = math.floor(k + (i + 0.5) / SUBSTEPS - late)
            simulator.step(float(commands[at]) if at >= 0 else 0.0, True, step)
    return found


def _nothing(_q: float, _dq: float) -> float:
    return 0.0
