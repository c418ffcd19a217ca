"""A device as a C99 file: the kernel's own tick with the device's numbers in it."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from zwidth.controllers.none import none
from zwidth.export.model import Exported, label_of, substeps_for
from zwidth.export.settable import Number, may_be_set, settable
from zwidth.export.tick import moved, reading, sent
from zwidth.export.translate import Array, Translator, Untranslatable, Value, literal
from zwidth.sim.device import Device
from zwidth.sim.equations import Equations
from zwidth.sim.kernel import LOCKED, MAX_MASSES, PLAYED, SCALARS, Memory
from zwidth.sim.run import prepare

HELPERS = {
    "zwidth_two_to": "static double zwidth_two_to(double n) { return ldexp(1.0, (int)n); }\n",
    "zwidth_exponent": """\
static double zwidth_exponent(double x)
{
    int e = 0;
    (void)frexp(x, &e);
    return (double)(e - 1);
}
""",
}


class _Memory(NamedTuple):
    x: Array
    internal: Array
    scalars: np.ndarray = np.zeros(SCALARS)  # the time starts at zero


class _Scratch(NamedTuple):
    before: Array
    values: Array
    ahead: Array
    after: Array
    friction: Array
    limits: Array
    own: Array
    more: Array
    shares: Array
    play: Array
    choice: Array | None = None


def identifier(name: str) -> str:
    """Return a name as C allows it: "My rig, axis 1" is my_rig_axis_1."""
    found = re.sub(r"[^0-9a-z]+", "_", name.lower()).strip("_") or "device"
    return found if found[0].isalpha() else f"d_{found}"


def c_source(device: Device, name: str, seed: int = 0) -> Exported:
    """Return a device as C99 text; name: the prefix of every name in it.

    It has NAME_reset, NAME_read and NAME_step. seed: of random events.
    """
    refused = {
        label_of(p): reason
        for p in device.physics
        if (reason := _reason(device, p.effect.name, p.at, seed))
    }
    kept = replace(
        device,
        physics=tuple(p for p in device.physics if label_of(p) not in refused),
    )
    lost = [f"{label} is not exported: {reason}" for label, reason in refused.items()]
    if device.interface.command_hold == "smooth":
        lost.append(
            "interface.command_hold = smooth is not exported: a command that is not yet known"
            " cannot be"
            " interpolated, it is held over each tick"
        )
    force, length = ("N m", "rad") if device.rotary else ("N", "m")
    about = (
        f"{device.name}, exported by zwidth.",
        "",
        f"One tick is {device.interface.period:.9g} s. {name}_step takes the command [{force}] of",
        f"this tick and returns what the encoder reads [{length}] before it acts; {name}_read",
        "returns that too, and moves nothing. The velocity filter belongs to the controller and is",
        "not here. With -O2 -ffp-contract=off (and -lm) the bits are those of zwidth.",
    )
    return Exported(_text(kept, name, seed), about, tuple(lost), kept, "/*", "*/")


def _reason(device: Device, effect: str, at: str, seed: int) -> str:
    """Why an effect cannot be translated, "" if it can."""
    alone = tuple(p for p in device.physics if (p.effect.name, p.at) == (effect, at))
    try:
        _text(replace(device, physics=alone), "x", seed)
    except Untranslatable as error:
        return str(error)
    return ""


def _text(device: Device, name: str, seed: int) -> str:
    eq, memory = _prepared(device, seed)
    return _of(eq, memory, name)


def settable_source(device: Device, name: str, seed: int = 0) -> tuple[str, list[Number]]:
    """Return C text as `c_source` with numbers that a run may set, and these numbers.

    They are `state.p[k]`, in this order, and NAME_reset sets them to the device's values. An effect
    whose law needs its numbers at translation keeps them as constants. Raises Untranslatable as
    `c_source`.
    """
    eq, memory = _prepared(device, seed)
    labels = may_be_set(device)

    def text(chosen: list[str]) -> tuple[str, list[Number]]:
        open_eq, numbers = settable(device, eq, chosen)
        return _of(open_eq, memory, name, numbers), numbers

    try:
        return text(labels)
    except Untranslatable:
        return text([label for label in labels if _translates(text, label)])


def _translates(text: Callable[[list[str]], object], label: str) -> bool:
    try:
        text([label])
    except Untranslatable:
        return False
    return True


def _prepared(device: Device, seed: int) -> tuple[Equations, Memory]:
    setup = prepare(
        device, none(), duration=device.interface.period, substeps=substeps_for(device),
        seed=seed,
    )  # fmt: skip
    return setup.eq, setup.memory


def _of(eq: Equations, memory: Memory, name: str, numbers: Sequence[Number] = ()) -> str:
    functions = "\n".join(_functions(eq, name))
    parts = [
        "#include <math.h>\n",
        _struct(eq, memory, name, len(numbers)),
        *(text for helper, text in HELPERS.items() if helper in functions),
        _matrix(eq, name),
        _reset(memory, name, numbers),
        functions,
    ]
    return "\n".join(parts)


def _struct(eq: Equations, memory: Memory, name: str, settings: int) -> str:
    may_be_set = f"    double p[{settings}];         /* what may be set */\n" if settings else ""
    return f"""\
typedef struct {{
    double x[{_room(eq)}];         /* positions, velocities, amplifier's force; then what is held */
    double line[{memory.line.size}];      /* commands on their way */
    double internal[{max(1, memory.internal.size)}];  /* what forces remember */
    double command;      /* the last that arrived at the amplifier */
    int head;
    long long tick;
{may_be_set}}} {name}_state;
"""


def _room(eq: Equations) -> int:
    blocks = eq.propagators.shape[2]
    return max(8 * blocks, eq.columns) + 1


def _matrix(eq: Equations, name: str) -> str:
    p = eq.propagators
    sizes = "".join(f"[{n}]" for n in p.shape)

    def nested(values: np.ndarray, depth: int) -> str:
        if values.ndim == 1:
            return "{" + ", ".join(literal(v) for v in values) + "}"
        inner = (",\n" + " " * (depth + 1)).join(nested(v, depth + 1) for v in values)
        return "{" + inner + "}"

    title = "/* Propagators of a substep: segment, set of masses and links, block, column, row. */"
    return f"{title}\nstatic const double {name}_P{sizes} =\n{nested(p, 0)};\n"


def _reset(memory: Memory, name: str, numbers: Sequence[Number]) -> str:
    lines = [f"    s->x[{i}] = {literal(v)};" for i, v in enumerate(memory.x) if v != 0.0]
    lines += [
        f"    s->internal[{i}] = {literal(v)};" for i, v in enumerate(memory.internal) if v != 0.0
    ]
    lines += [f"    s->p[{k}] = {literal(one.value)};" for k, one in enumerate(numbers)]
    body = "\n".join(lines)
    return f"""\
void {name}_reset({name}_state *s)
{{
    static const {name}_state nothing;
    *s = nothing;
{body}
}}
"""


def _functions(eq: Equations, name: str) -> list[str]:
    x = Array("s->x", (_room(eq),))
    read = Translator()
    y = read.call(reading, eq, x)
    text_of_reading = _function(f"double {name}_read(const {name}_state *s)", read, y.text)
    forces, frictions = max(1, eq.forces.codes.size), max(1, eq.frictions.codes.size)
    arrays = {
        "before": (_room(eq),), "values": (eq.forces.codes.size,),
        "ahead": (eq.forces.codes.size,), "after": (eq.forces.codes.size,),
        "friction": (MAX_MASSES,), "limits": (LOCKED + 1, MAX_MASSES),
        "own": (PLAYED + 1, MAX_MASSES), "more": (MAX_MASSES,),
        "shares": (eq.frictions.codes.size, 2), "play": (eq.gaps.size, 2),
    }  # fmt: skip
    room = {n: Array(n, shape) for n, shape in arrays.items()}
    external = np.zeros(0)
    memory = _Memory(x, Array("s->internal", (eq.forces.codes.size,)))
    step = Translator()
    lengths = {
        "values": (forces,),
        "ahead": (forces,),
        "after": (forces,),
        "shares": (frictions, 2),
        "play": (max(1, eq.gaps.size), 2),
    }
    for one, shape in arrays.items():
        sizes = "".join(f"[{n}]" for n in lengths.get(one, shape))
        zero = "{{0.0}}" if len(shape) > 1 else "{0.0}"
        step.emit(f"double {one}{sizes} = {zero};")
    step.emit("/* The same names belong to the source in sim/kernel.py. */")
    for unused in (
        "values",
        "ahead",
        "after",
        "friction",
        "limits",
        "own",
        "more",
        "shares",
        "play",
    ):
        step.emit(f"(void){unused};")
    step.emit(f"const double measured = {name}_read(s);")
    told = step.call(sent, eq, Value("s->tick", "i"), x, Value("command"), Value("s->command"))
    step.emit(f"s->command = {told.text if isinstance(told, Value) else literal(told)};")
    size = eq.whole_delay + 2
    step.emit("s->line[s->head] = s->command;")
    step.emit(f"s->head = s->head == {size - 1} ? 0 : s->head + 1;")
    step.emit("const double earlier = s->line[s->head];")
    step.emit(f"const double current = s->line[s->head == {size - 1} ? 0 : s->head + 1];")
    step.emit("(void)earlier;")
    for segment, held in enumerate(("earlier", "current")):
        if eq.substeps[segment] > 0:
            tables = eq._replace(propagators=Array(f"{name}_P", eq.propagators.shape))  # pyright: ignore[reportArgumentType]
            step.call(
                moved, tables, Value("s->tick", "i"), segment, Value(held), external, memory,
                _Scratch(*room.values()),
            )  # fmt: skip
    step.emit("s->tick++;")
    return [
        text_of_reading,
        _function(f"double {name}_step({name}_state *s, double command)", step, "measured"),
    ]


def _function(head: str, made: Translator, returned: str) -> str:
    made.emit(f"return {returned};")
    return "\n".join([head, "{", *made.body(), "}", ""])
