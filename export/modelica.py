"""A device as Modelica source: a model of its own, in continuous time, with a sampled interface.

Dry friction is a hybrid automaton at each mass. Masses move each for itself (the mass matrix is
diagonal), so that the load on a mass is known from positions, velocities and the held command, and
what friction does at rest is minus that load, exactly; a mode changes where the load passes what
friction holds, and where the velocity passes zero.
"""

import functools
import math

from zwidth.controllers.none import none
from zwidth.export.model import Exported, label_of
from zwidth.export.modelica_laws import LAWS, NEAREST, Friction, Model, add
from zwidth.export.settable import units
from zwidth.sim.device import Device
from zwidth.sim.physics.effect import Physics
from zwidth.sim.place import place_at
from zwidth.sim.run import prepare

WHY = {
    "dropped_samples": "which samples are lost is drawn in words of 64 bits, and an Integer of"
    " Modelica may have 32",
}


def modelica(device: Device, name: str) -> Exported:
    """Return a device as the text of a Modelica model of this name."""
    kept, lost = _sorted(device)
    if device.interface.command_hold == "smooth":
        lost.append(
            "interface.command_hold = smooth is not held: a command that is not yet known cannot be"
            " interpolated, it is held over each tick"
        )
        kept = kept.with_interface(command_hold="zero_order")
    face, (force, length) = kept.interface, units(kept)
    about = (
        f"{device.name}, exported by zwidth.",
        "",
        f"'command' [{force}] is sampled every {face.period:.9g} s and held; 'measured' [{length}]"
        " is what the encoder reads then.",
    )
    return Exported(_text(kept, name), about, tuple(lost), kept, "/*", "*/")


def _sorted(device: Device) -> tuple[Device, list[str]]:
    """Return the device with the effects that there are words for, and a sentence for each other.

    Effects that have their home in the interface are no longer in `physics`.
    """
    kept: list[Physics] = []
    lost: list[str] = []
    for p in device.physics:
        if p.effect.name in LAWS:
            kept.append(p)
        else:
            why = WHY.get(p.effect.name, "this export has no Modelica text for its law")
            lost.append(f"{label_of(p)} is not held: {why}")
    held = Device(device.name, device.source, device.rotary, device.chain, device.interface)
    return held.with_physics(*kept), lost


def _text(device: Device, name: str) -> str:
    start = prepare(device, none(), duration=device.interface.period).memory.x
    model = Model(device.chain.masses.size, device.rotary, float(start[0]))
    _chain(model, device)
    there = {p.effect.name: p for p in device.physics}
    _sampled(model, device, there)
    for p in device.physics:
        if p.effect.hook not in ("command", "sensor"):
            add(model, p, there)
    _motion(model, start.tolist())
    _reading(model, device, there)
    parts = [
        f'model {name} "{device.name.replace(chr(34), chr(39))}"',
        *(f"  {line}" for line in model.parameters),
        *model.functions,
        f'  input Real command(unit="{units(device)[0].replace(" ", ".")}");',
        *(f"  {line}" for line in model.variables),
        "equation",
        *(f"  {line}" for line in model.equations),
        f"end {name};",
    ]
    return "\n".join(parts) + "\n"


def _chain(model: Model, device: Device) -> None:
    """Add masses, springs and dampers."""
    chain, (force, length) = device.chain, units(device)
    spring, damper = f"{force}/{length}", f"{force} s/{length}"
    for i, mass in enumerate(chain.masses.tolist()):
        model.parameter(f"mass_m{i + 1}", mass, "kg m2" if device.rotary else "kg")
        b = model.parameter(f"damper_m{i + 1}", float(chain.ground_dampers[i]), damper, "to ground")
        model.loads.append([f"- {b} * v{i + 1}"])
    if chain.ground_spring != 0.0:
        k = model.parameter("ground_spring", chain.ground_spring, spring, "of m1")
        model.loads[0].append(f"- {k} * q1")
    for i in range(chain.link_springs.size):
        at = f"link{i + 1}{i + 2}"
        k = model.parameter(f"spring_{at}", float(chain.link_springs[i]), spring)
        b = model.parameter(f"damper_{at}", float(chain.link_dampers[i]), damper)
        if chain.link_dampers[i] != 0.0:
            model.damped.add(b)
        model.variables.append(f"Real force_{at};")
        model.equations.append(
            f"force_{at} = {k} * (q{i + 2} - q{i + 1}) + {b} * (v{i + 2} - v{i + 1});"
        )
        model.loads[i].append(f"+ force_{at}")
        model.loads[i + 1].append(f"- force_{at}")


def _sampled(model: Model, device: Device, there: dict[str, Physics]) -> None:
    """Add what becomes of a command: feedback, step, gain, effects, limit, rate, delay."""
    face, (force, _) = device.interface, units(device)
    model.parameter("period", face.period, "s", "of the sampled interface")
    model.told.append("command")
    if face.force_sensor:
        i = place_at(face.force_sensor).index
        gain = model.parameter("force_gain", face.force_gain, "", "of the measured force")
        model.told.append(f"command + {gain} * (command + force_link{i + 1}{i + 2})")
    lines = ["when sample(0.0, period) then"]

    def hold() -> None:
        """Give what stands last a variable of its own."""
        if model.told[-1].isidentifier():
            return
        name = f"told_{len(lines)}"
        model.variables.append(f"discrete Real {name}(start=0.0, fixed=true);")
        lines.append(f"  {name} = {model.told[-1]};")
        model.told.append(name)

    hold()
    if face.command_step > 0.0:
        model.function(NEAREST)
        step = model.parameter("command_step", face.command_step, force)
        model.told.append(f"nearest({model.told[-1]}, {step})")
        hold()
    gain = model.parameter("command_gain", face.command_gain, "")
    model.told.append(f"{gain} * {model.told[-1]}")
    hold()
    for p in device.physics:
        if p.effect.hook == "command":
            add(model, p, there)
            hold()
    if math.isfinite(face.command_limit):
        limit = model.parameter("command_limit", face.command_limit, force)
        model.told.append(f"min(max({model.told[-1]}, -{limit}), {limit})")
        hold()
    if model.rates:
        _followed(model, functools.reduce(lambda a, b: f"min({a}, {b})", model.rates), lines)
    _delayed(model, device, lines)


def _followed(model: Model, rate: str, lines: list[str]) -> None:
    """Add how the last command is left for the one that is told."""
    most, change = f"period * {rate}", f"{model.told[-1]} - pre(followed)"
    model.variables.append("discrete Real followed(start=0.0, fixed=true);")
    lines.append(f"  followed = pre(followed) + min(max({change}, -{most}), {most});")
    model.told.append("followed")


def _delayed(model: Model, device: Device, lines: list[str]) -> None:
    """Add the delay of d T + r: d variables that hand on, and for r an instant of its own."""
    whole, rest = device.interface.delay_ticks
    last = model.told[-1]
    for k in range(whole):
        name = f"past_{k + 1}"
        model.variables.append(f"discrete Real {name}(start=0.0, fixed=true);")
        lines.append(f"  {name} = pre({last});")
        last = name
    model.variables.append("discrete Real drive(start=0.0, fixed=true);")
    if rest == 0.0:
        lines.append(f"  drive = {last};")
    model.told.append("\n  ".join([*lines, "  measured = @;", "end when;"]))
    if rest > 0.0:
        shift = model.parameter("delay_within", rest, "s", "of the delay, beyond whole periods")
        model.equations.append(
            f"when sample({shift}, period) then\n    drive = pre({last});\n  end when;"
        )


def _reading(model: Model, device: Device, there: dict[str, Physics]) -> None:
    """Add what the encoder reads, at the instants at which the command is taken."""
    face, (_, length) = device.interface, units(device)
    for p in device.physics:
        if p.effect.hook == "sensor":
            add(model, p, there)
    if face.encoder_step > 0.0:
        step = model.parameter("encoder_step", face.encoder_step, length)
        if face.encoder_rounding == "floor":
            model.reading = f"{step} * floor(({model.reading}) / {step})"
        else:
            model.function(NEAREST)
            model.reading = f"nearest({model.reading}, {step})"
    if face.position_origin != 0.0:
        model.reading += f" + {model.parameter('position_origin', face.position_origin, length)}"
    model.variables.append(
        f'discrete output Real measured(start=0.0, fixed=true, unit="{length}");'
    )
    model.equations.append(model.told[-1].replace("@", model.reading))


def _motion(model: Model, start: list[float]) -> None:
    """Add the equations of motion from where the masses start, with the modes of dry friction."""
    if model.lag:
        model.state("amplifier")
        model.equations.append(f"{model.lag} * der(amplifier) = drive - amplifier;")
    model.loads[0].insert(0, "amplifier" if model.lag else "drive")
    for i in range(model.masses):
        k = i + 1
        model.state(f"q{k}", start[i])
        model.state(f"v{k}")
        model.variables.append(f"Real load_{k};")
        model.equations += [f"der(q{k}) = v{k};", f"load_{k} = {' '.join(model.loads[i])};"]
        if i in model.frictions:
            _dry(model, k, model.frictions[i])
            model.equations.append(f"mass_m{k} * der(v{k}) = load_{k} + friction_{k};")
        else:
            model.equations.append(f"mass_m{k} * der(v{k}) = load_{k};")


def _dry(model: Model, k: int, levels: Friction) -> None:
    """Mode 0 at rest, 1 and -1 in motion either way; friction is against it."""
    mode, load, v = f"pre(mode_{k})", f"load_{k}", f"v{k}"
    model.variables += [f"Integer mode_{k}(start=0, fixed=true);", f"Real friction_{k};",
                        f"Real holds_{k}_plus;", f"Real holds_{k}_minus;"]  # fmt: skip
    moving = f"if mode_{k} == 1 then -({' + '.join(levels.plus)}) else {' + '.join(levels.minus)}"
    more, less = f"{load} > holds_{k}_plus", f"{load} < -holds_{k}_minus"
    model.equations += [
        f"holds_{k}_plus = {' + '.join(levels.rest_plus)};",
        f"holds_{k}_minus = {' + '.join(levels.rest_minus)};",
        f"friction_{k} = if mode_{k} == 0 then -{load} else {moving};",
        f"when {{{mode} == 1 and {v} < 0.0, {mode} == -1 and {v} > 0.0,"
        f" {mode} == 0 and {more}, {mode} == 0 and {less}}} then\n"
        f"    mode_{k} = if {more} then 1 else if {less} then -1 else 0;\n"
        f"    reinit({v}, 0.0);\n  end when;",
    ]
