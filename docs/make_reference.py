"""Write docs/reference from what the code declares: device file, recording file, effects.

    python docs/make_reference.py [--pictures]

The text of every page is checked by the tests (tests/test_reference.py); pictures are drawn only
where they are asked for. A picture shows an effect of the size given under it on one mass of
1.5e-3 kg m2 (in a link: with a second of 0.8e-3 kg m2 on 12 N m/rad), simulated by the kernel.
"""

import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zwidth.commands.effects import law, places, units
from zwidth.controllers.recorded import recorded
from zwidth.files.protection import writing_as
from zwidth.files.whole import write_text, write_with
from zwidth.logs.recording_keys import RECORDING_KEYS
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_keys import DEVICE_KEYS
from zwidth.sim.equations import equations
from zwidth.sim.interface import Interface
from zwidth.sim.keys import Key
from zwidth.sim.physics import EFFECTS, make_physics
from zwidth.sim.physics.effect import Effect
from zwidth.sim.physics.free_law import AT, FORCE, KNOTS, is_table, points_of, table_values
from zwidth.sim.predict import GROUND, Outputs, alone
from zwidth.sim.run import Outcome, Run, Start, simulate, start_memory
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
FOLDER = Path(__file__).parent / "reference"
MADE = "<!-- made by docs/make_reference.py -->\n"
PERIOD, SECONDS, SUBSTEPS = 0.001, 2.0, 10
MASSES, DAMPERS, LINK = (1.5e-3, 0.8e-3), (4e-3, 2e-3), (12.0, 0.01)


@dataclass(frozen=True)
class Shown:
    """An effect as its picture has it: where, of which size, and over what its law is drawn."""

    at: str
    values: Mapping[str, float]
    over: str = "position"
    top: float = 0.1  # of the command [N m]
    start: float = 0.0  # of m1 [rad]


SHOWN: dict[str, Shown] = {
    "coulomb_friction": Shown("m1", {"level": 0.03}, "velocity"),
    "stribeck_friction": Shown(
        "m1", {"level": 0.02, "static_level": 0.05, "velocity": 1.0}, "velocity"),
    "presliding_friction": Shown("m1", {"level": 0.03, "stiffness": 0.3}, "position", 0.06),
    "directional_friction": Shown("m1", {"level_plus": 0.04, "level_minus": 0.01,
                                  "viscous_plus": 0.004, "viscous_minus": 0.001}, "velocity"),
    "load_friction": Shown("m1", {"ratio": 0.5}, "command"),
    "quadratic_drag": Shown("m1", {"coefficient": 1e-3}, "velocity"),
    "constant_force": Shown("m1", {"level": 0.02}, "velocity"),
    "ground_spring": Shown("m1", {"stiffness": 0.3}),
    "gravity_pendulum": Shown("m1", {"level": 0.08, "angle": 0.0}, start=2.5),
    "force_ripple": Shown("m1", {"amplitude": 0.03, "period": 1.0, "phase": 0.0}),
    "backlash": Shown("link12", {"gap": 0.1}, "deflection"),
    "cubic_stiffness": Shown("ground", {"coefficient": 0.3}),
    "hysteresis": Shown("ground", {"stiffness": 0.5, "level": 0.05, "shape": 2.0}),
    "extra_mode": Shown("m1", {"mass": 5e-4, "stiffness": 1.0, "damping": 5e-4}),
    "position_servo": Shown("m1", {"stiffness": 1.0, "damping": 0.01, "back_emf": 0.0}, "goal",
                            0.3),
    "servo_limit": Shown("m1", {"limit": 0.04}, "goal", 0.3),
    "servo_dead_zone": Shown("m1", {"half": 0.1}, "goal", 0.3),
    "servo_integral": Shown("m1", {"rate": 3.0, "limit": 0.05}, "goal", 0.3),
    "goal_rate_limit": Shown("command", {"rate": 1.0}, "goal", 0.3),
    "falling_limit": Shown("m1", {"limit": 0.08, "slope": 0.01}, "velocity"),
    "open_winding": Shown("m1", {"damping": 0.8 * DAMPERS[0]}, "velocity", 0.05),
    "saturation": Shown("command", {"limit": 0.06}, "command"),
    "rate_limit": Shown("command", {"rate": 0.4}, "command"),
    "dead_band": Shown("command", {"width": 0.06}, "command"),
    "command_step": Shown("command", {"step": 0.02}, "command"),
    "actuator_lag": Shown("command", {"time_constant": 0.03}, "command"),
    "gain_asymmetry": Shown("command", {"ratio": 2.0}, "command"),
    "loop_delay": Shown("clock", {"delay": 0.03}, "command"),
    "dropped_samples": Shown("clock", {"rate": 0.5}, "command"),
    "encoder_step": Shown("sensor", {"step": 0.3}, "reading"),
    "encoder_eccentricity": Shown(
        "sensor", {"amplitude": 0.2, "period": 2.0, "phase": 0.0}, "reading"),
    "rectified_sensor": Shown("sensor", {}, "reading", start=-0.6),
    "free_spring": Shown("m1", table_values([(-2.0, 0.02), (-1.0, 0.04), (1.0, -0.04),
                                             (2.0, -0.02)])),
    "free_damper": Shown("m1", table_values([(0.0, 0.0), (2.0, -0.03), (10.0, -0.05)], odd=True),
                         "velocity"),
    "free_amplifier": Shown("command", table_values([(-0.1, 0.02), (0.0, 0.0), (0.05, 0.0),
                                                     (0.1, -0.05)]), "command"),
    "free_sensor": Shown("sensor", table_values([(-1.0, 0.1), (0.0, -0.1), (1.0, 0.2)]),
                         "reading"),
}  # fmt: skip


def pages() -> dict[str, str]:
    """Return the text of every page by its path in docs/reference."""
    found = {
        "device_file.md": _keys_page(
            "The device file, key by key",
            "What a simulation or a diagnosis knows of a device. `zwidth devices --template 2`"
            " prints one of two masses to start from. How drives are described, and what differs in"
            " one run: [the device file](../device_file.md). An unknown key is an error that names"
            " the nearest known one.",
            DEVICE_KEYS,
        )
        + "\nThe parameters of an effect stand beside `effect` and `at`:"
        " [effects](effects/README.md).\n",
        "recording_file.md": _keys_page(
            "The recording TOML, key by key",
            "Which column of a file is what, in which unit. `zwidth diagnose FILE` writes one for a"
            " file that has none, `zwidth convert FILE FILE.toml` drafts one. What formats are"
            " read, gaps, clocks and known changes: [recordings](../recordings.md).",
            RECORDING_KEYS,
        ),
        "effects/README.md": _index(),
    }
    return found | {f"effects/{e.name}.md": _effect_page(e) for e in EFFECTS.values()}


def _keys_page(title: str, about: str, keys: Iterable[Key]) -> str:
    tables: dict[str, list[Key]] = {}
    for key in keys:
        tables.setdefault(key.table, []).append(key)
    parts = [f"{MADE}# {title}\n\n{about}\n"]
    for table, own in tables.items():
        parts.append(f"\n## {_header(table)}\n\n| key | unit | default | what it is | example |")
        parts[-1] += "\n|---|---|---|---|---|\n"
        parts[-1] += "".join(_row(key) for key in own)
    return "".join(parts)


def _header(table: str) -> str:
    if not table:
        return "At the top"
    return f"[[{table}]]" if table in ("modal.mode", "physics", "output") else f"[{table}]"


def _row(key: Key) -> str:
    default = _code(key.default) if key.default else "must stand"
    example = _code(key.example) if key.example else ""
    cells = (f"`{key.name}`", _cell(key.units), default, _cell(key.meaning), example)
    return f"| {' | '.join(cells)} |\n"


def _code(text: str) -> str:
    return text if " " in text and not text.startswith(('"', "[")) else f"`{text}`"


def _cell(text: str) -> str:
    return text.replace(" | ", " or ")


def _index() -> str:
    lines = [
        f"{MADE}# Effects\n",
        "Physics that a device may have besides its masses, springs and dampers. `zwidth effects`"
        " prints this list, `zwidth effects NAME` one of them. How the diagnosis seeks each, and"
        " how likely it is beforehand: [effects in a diagnosis](../../effects.md).\n",
        "| effect | at | what it is |",
        "|---|---|---|",
        *(f"| [{e.name}]({e.name}.md) | {places(e)} | {e.summary} |" for e in EFFECTS.values()),
    ]
    return "\n".join(lines) + "\n"


def _effect_page(effect: Effect) -> str:
    shown = SHOWN[effect.name]
    table = is_table(effect.parameters)
    values = ", ".join(
        f"{name} {value:g} {effect.parameter(name).unit}".rstrip()
        for name, value in shown.values.items()
    )
    if table:
        values = f"a table of {len(points_of(shown.values))} points"
    parts = [
        f"{MADE}# {effect.name}\n\n{_sentence(effect.summary)}\n",
        f"![{effect.name}]({effect.name}.png)\n",
        f"*At {shown.at}: {values or 'nothing to set'}. Left what it does, right the motion with it"
        " and without it.*\n",
        f"## Law\n\n{law(effect)}\n",
        "## Parameters\n",
    ]
    if table:
        state, made = (_cell(units(effect, name)) for name in (AT[0], FORCE[0]))
        parts.append(
            "| key | unit | what it is |\n|---|---|---|\n"
            f"| `table` | rows of [{state}], [{made}] | 2 to {KNOTS} points, the states rising |\n"
            "| `odd` | true or false | whether f(-s) = -f(s): the table is of the absolute value,"
            " from [0, 0] on |\n"
        )
    elif effect.parameters:
        rows = "\n".join(
            f"| `{p.name}` | {p.symbol} | {_cell(units(effect, p.name))} | {p.meaning} |"
            f" {p.lower:g} to {p.upper:g} | {_neutral(p.neutral)} |"
            for p in effect.parameters
        )
        head = "| parameter | symbol | unit | what it is | allowed | does nothing at |"
        parts.append(f"{head}\n|---|---|---|---|---|---|\n{rows}\n")
    else:
        parts.append("None.\n")
    parts.append(f"**Where**: {places(effect)}.\n")
    if effect.mistaken_for:
        alike = ", ".join(f"[{name}]({name}.md)" for name in effect.mistaken_for)
        parts.append(f"**Mistaken for**: {alike}, where a recording is short, weak or one-sided.\n")
    parts.append(f"**Source**: {effect.reference}.\n" if effect.reference != "-" else "")
    entry = [f'effect = "{effect.name}"', f'at = "{shown.at}"']
    if table:
        rows = [list(point) for point in points_of(shown.values)]
        entry += [f"odd = {str(shown.values['odd'] > 0.5).lower()}", f"table = {rows}"]
    else:
        entry += [f"{name} = {value!r}" for name, value in shown.values.items()]
    parts.append("```toml\n[[physics]]\n" + "\n".join(entry) + "\n```\n")
    return "\n".join(part for part in parts if part)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


def _neutral(value: float | None) -> str:
    return "" if value is None else f"{value:g}"


# --- pictures


def draw(effect: Effect, path: Path) -> None:
    """Draw what an effect does, and the motion with it and without it."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    from zwidth.figures.style import STYLE

    shown = SHOWN[effect.name]
    with_it, without = _runs(effect, shown)
    x, y, labels = _law(effect, shown, with_it)
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 2.6), layout="constrained")
        left, right = figure.subplots(1, 2)
        left.plot(x, y, color="C3", linewidth=1.2)
        if np.ptp(y) < 0.2 * float(np.abs(y).max()):  # a constant is seen as one
            left.set_ylim(0.0, 1.3 * float(y.max()))
        left.set(xlabel=labels[0], ylabel=labels[1])
        for run, label, color in ((without, "without", "0.6"), (with_it, "with it", "C0")):
            key = "encoder" if effect.hook == "sensor" else "position_m1"
            right.plot(run.trace.t, run.trace[key], color=color, label=label)
        reads = "reading" if effect.hook == "sensor" else "position of m1"
        right.set(xlabel="time [s]", ylabel=f"{reads} [rad]")
        right.legend(frameon=False, fontsize=8)
        figure.suptitle(effect.name.replace("_", " "), fontsize=10)
        write_with(path, lambda stream: figure.savefig(stream, format="png", dpi=100))


def _device(shown: Shown) -> Device:
    two = shown.at == "link12"
    n = 2 if two else 1
    links = ([LINK[0]], [LINK[1]]) if two else ([], [])
    chain = make_chain(list(MASSES[:n]), list(DAMPERS[:n]), 0.0, *links)
    return Device("shown", "", True, chain, Interface(period=PERIOD))


def _runs(effect: Effect, shown: Shown) -> tuple[Run, Run]:
    command, device = _asked(shown), _device(shown)
    if effect.needs == "position_servo":
        device = device.with_physics(
            make_physics("position_servo", "m1", stiffness=1.0, damping=0.01, back_emf=0.0)
        )
    changed = device.with_physics(make_physics(effect.name, shown.at, **shown.values))
    if effect.name == "open_winding":
        return _switched_off(changed, command), _switched_off(device, command)
    with_it, without = (
        simulate(
            d,
            recorded(command),
            duration=SECONDS,
            substeps=SUBSTEPS,
            seed=1,
            start=Start(shown.start),
        )
        for d in (changed, device)
    )
    return with_it, without


def _switched_off(device: Device, command: Floats) -> Run:
    """Return a run whose drive is switched off halfway."""
    seen = Outputs(np.array([0, 1]), np.zeros(2, dtype=np.bool_), np.full(2, GROUND))
    eq, on = equations(device, SUBSTEPS), command.size // 2
    strengths = (np.arange(command.size) < on).astype(float)
    silent, blind = np.zeros((command.size, 2)), np.zeros((eq.states, 2))
    memory = start_memory(eq, Start())
    found = -alone(eq, eq, seen, command, silent, blind, np.zeros((0, 1)), memory, strengths)
    channels = {
        "position_m1": found[:, 0], "velocity_m1": found[:, 1], "applied": strengths * command,
    }  # fmt: skip
    units = {"position_m1": "rad", "velocity_m1": "rad/s", "applied": "N m"}
    trace = Trace(PERIOD * np.arange(command.size, dtype=np.float64), channels, units, "simulated")
    return Run(trace, Outcome.COMPLETED, memory, {})


def _asked(shown: Shown) -> Floats:
    """Return the command: a sine of 2 Hz that grows."""
    t = np.arange(round(SECONDS / PERIOD)) * PERIOD
    return shown.top * np.sin(2 * np.pi * 2.0 * t) * (0.4 + 0.6 * t / SECONDS)


def _law(effect: Effect, shown: Shown, run: Run) -> tuple[Floats, Floats, tuple[str, str]]:
    trace = run.trace
    if shown.over == "reading":
        return trace["position_m1"], trace["encoder"], ("position [rad]", "reading [rad]")
    if shown.over == "command" and effect.hook in ("command", "clock", "structure"):
        names = ("command [N m]", "force of the amplifier [N m]")
        part = slice(-500, None)  # the last wave
        return _asked(shown)[part], trace["applied"][part], names
    if shown.over == "deflection":
        force = _inertia(trace, 1)
        q = trace["position_m1"] - trace["position_m2"]
        return q, force, ("deflection of the link [rad]", "force of the link [N m]")
    if shown.over == "goal":
        force = _inertia(trace, 0)[50:]  # once the jerk of the beginning is over
        goal = _asked(shown) / 1.0 - trace["position_m1"]
        return goal[50:], force, ("goal - position [rad]", "force of the servo [N m]")
    force = _inertia(trace, 0) - trace["applied"]
    x = trace["command"] if shown.over == "command" else trace[f"{shown.over}_m1"]
    unit = {"position": "rad", "velocity": "rad/s", "command": "N m"}[shown.over]
    return x, force, (f"{shown.over} [{unit}]", "its force [N m]")


def _inertia(trace: Trace, mass: int) -> Floats:
    """Return the force that moves a mass, of its speed alone."""
    v = trace[f"velocity_m{mass + 1}"]
    return MASSES[mass] * np.gradient(v, PERIOD) + DAMPERS[mass] * v


def main(arguments: list[str]) -> None:
    """Write the pages, and the pictures where they are asked for."""
    with writing_as("make_reference", overwrite=True):
        for name, text in pages().items():
            write_text(FOLDER / name, text)
        if "--pictures" in arguments:
            for effect in EFFECTS.values():
                draw(effect, FOLDER / "effects" / f"{effect.name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
