"""Effects of the user's own: a law written as a formula in a file, compiled like all others.

    name = "my_drag"
    summary = "drag with the cube of speed"
    enters = "force"                    # or "command", "sensor"
    at = ["m1", "m2"]                   # may be left out: every place where it can enter
    formula = "-c * v**3"
    reference = "found on rig 7, March"
    prior = 0.02                        # how likely a device has it at one place
    [parameters.c]
    unit = "N m s3/rad3"                # on a rotary device; linear_unit where N and m are not all
    upper = 1.0                         # lower = 0, neutral = 0 where it says nothing else
    meaning = "torque over the cube of the speed"

The formula is an expression of q (position, or what a link gives way), v (velocity, or its rate),
u (the command as held) and the parameters; a force is on the first place, a command or a sensor's
formula is what is added to it, over u or q alone. It may use + - * / **, comparisons in
`a if q > m else b`, pi, and abs, sign, min, max, clip, sqrt, exp, log, sin, cos, tan, tanh, atan.

A parameter over which the law is a straight line is a magnitude: it is sought over all sizes that a
recording could show, and where all are 0 there is no law. Others say where they are sought from,
`start = 0.5` or a list.

Limits: no memory (an effect with an internal state is a file of the library). A law that is steep
against the substep is of second order in it, as every smooth force. Files are read when zwidth is
imported (`sim/own_files.py`); the first run with them compiles the kernels anew.
"""

import ast
import itertools
import math
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numba
import numpy as np

from zwidth.files.formulas import MOST_POWER, refuse_endless
from zwidth.sim import elementary
from zwidth.sim.jit import INLINED
from zwidth.sim.lane_type import greatest, least, root, select
from zwidth.sim.own_files import VARIABLE, own_texts, source_hash
from zwidth.sim.physics.effect import Effect, Parameter, Scaled, Values
from zwidth.sim.physics.sizes import SMALLEST, Sizes, up_to
from zwidth.sim.place import LINKS, MASSES, Place
from zwidth.sim.table import Table, TableError

FIRST_CODE = 100  # of effects that are not the library's
HOOKS: dict[str, Literal["force", "command", "sensor"]] = {
    "force": "force", "command": "command", "sensor": "sensor",
}  # fmt: skip
PLACES = {"force": (*MASSES, *LINKS), "command": ("command",), "sensor": ("sensor",)}
STATES = {"force": ("q", "v", "u"), "command": ("u",), "sensor": ("q",)}
KEYS = ("name", "summary", "enters", "at", "formula", "reference", "prior", "odds", "rotary_only",
        "mistaken_for", "family", "parameters")  # fmt: skip
PARAMETER_KEYS = ("unit", "linear_unit", "lower", "upper", "neutral", "start", "scale", "role",
                  "symbol", "meaning")  # fmt: skip
ROLES = ("magnitude", "strength", "turning", "shape")
IDENTIFIER = re.compile(r"[a-z][a-z0-9_]*$")
WIDEST = 1e9
SHARES = (0.004, 0.06)  # of what a recording moves by: magnitudes that a fit begins from
STRAIGHT = 1e-9  # relative error of a law that is a straight line over a magnitude
UNREADABLE = "cannot be read; correct the path or take it out of the environment variable"


@dataclass(frozen=True)
class OwnEffect:
    """An effect of the user's own, the file it is from, and the hash of its text."""

    effect: Effect
    file: Path
    source: str
    formula: str


def _functions() -> dict[str, Callable[..., Any]]:
    """The functions of a formula; each is one for numbers and for lanes."""
    inline = numba.njit(**INLINED)

    @inline
    def sign(x: Any) -> Any:
        return select(x > 0.0, 1.0, select(x < 0.0, -1.0, 0.0 * x))

    @inline
    def clip(x: Any, low: Any, high: Any) -> Any:
        return least(greatest(x, low), high)

    @inline
    def tan(x: Any) -> Any:
        return elementary.sin(x) / elementary.cos(x)

    return {
        "sign": sign, "clip": clip, "tan": tan, "min": least, "max": greatest, "sqrt": root,
        "abs": abs, "exp": elementary.exp, "log": elementary.log, "sin": elementary.sin,
        "cos": elementary.cos, "tanh": elementary.tanh, "atan": elementary.atan,
        "_power": elementary.power, "_select": select,
    }  # fmt: skip


FUNCTIONS = _functions()


# The same for one number at a time, while a file is read: nothing is compiled for it.
def _clip(x: float, low: float, high: float) -> float:
    return min(max(x, low), high)


def _power(x: float, y: float) -> float:
    return x**y if x > 0.0 else 0.0


def _chosen(asked: bool, yes: float, no: float) -> float:
    return yes if asked else no


def _sign(x: float) -> float:
    return math.copysign(1.0, x) if x else 0.0


PLAIN: dict[str, Callable[..., Any]] = {
    "sign": _sign, "min": min, "max": max, "abs": abs, "clip": _clip, "sqrt": math.sqrt,
    "exp": math.exp, "log": math.log, "sin": math.sin, "cos": math.cos, "tan": math.tan,
    "tanh": math.tanh, "atan": math.atan, "_power": _power, "_select": _chosen,
}  # fmt: skip
ARGUMENTS = {"min": 2, "max": 2, "clip": 3}
OPERATORS: dict[type, str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
COMPARES: dict[type, str] = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}


def translated(formula: str, states: Sequence[str], parameters: Sequence[str]) -> str:
    """Return a formula as source that numbers and lanes both run; p[i] for parameters.

    Raises TableError that says what is not allowed.
    """
    known = {name: f"p[{i}]" for i, name in enumerate(parameters)}
    known |= {name: name for name in states} | {"pi": repr(math.pi)}
    try:
        refuse_endless(formula)
        tree = ast.parse(formula.strip(), mode="eval")
    except SyntaxError as error:
        raise TableError(f"formula {formula[:40]!r} is not an expression: {error.msg}") from None
    except ValueError as error:
        raise TableError(str(error)) from None

    def written(node: ast.expr) -> str:
        match node:
            case ast.Constant(value=bool()):
                pass
            case ast.Constant(value=int() | float() as value):
                return repr(float(value))
            case ast.Name(id=name) if name in known:
                return known[name]
            case ast.Name(id=name):
                names = ", ".join([*states, *parameters])
                raise TableError(f"formula has {name!r}; it may use {names}, pi")
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return f"(-{written(operand)})"
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return written(operand)
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                return power(left, right)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in OPERATORS:
                return f"({written(left)} {OPERATORS[type(op)]} {written(right)})"
            case ast.IfExp(test=ast.Compare(left=left, ops=[op], comparators=[right])) if (
                type(op) in COMPARES
            ):
                asked = f"{written(left)} {COMPARES[type(op)]} {written(right)}"
                return f"_select({asked}, {written(node.body)}, {written(node.orelse)})"
            case ast.Call(func=ast.Name(id=name), args=args, keywords=[]) if (
                name in FUNCTIONS and not name.startswith("_")
            ):
                if len(args) != (count := ARGUMENTS.get(name, 1)):
                    raise TableError(
                        f"formula calls {name} with {len(args)} argument(s); it takes {count}"
                    )
                return f"{name}({', '.join(written(a) for a in args)})"
            case _:
                pass
        said = ast.unparse(node)
        allowed = ", ".join(n for n in FUNCTIONS if not n.startswith("_"))
        raise TableError(
            f"formula has {said!r}; it may use + - * / **, a if q > m else b, and {allowed}"
        )

    def power(left: ast.expr, right: ast.expr) -> str:
        base = written(left)
        if isinstance(right, ast.Constant) and right.value in range(1, MOST_POWER + 1):
            return "(" + " * ".join([base] * int(right.value)) + ")"  # pyright: ignore[reportArgumentType]
        return f"_power({base}, {written(right)})"

    return written(tree.body)


def compiled(arguments: str, laws: Mapping[int, str], otherwise: str) -> Callable[..., Any]:
    """Return a part of a kernel that runs the law of a code."""
    lines = [f"def own({arguments}):"]
    for code, law in laws.items():
        lines += [f"    if code == {code}:", f"        return {law}"]
    lines.append(f"    return {otherwise}")
    names = dict(FUNCTIONS)
    exec("\n".join(lines), names)  # of an expression that `translated` has written itself
    return numba.njit(**INLINED)(names["own"])


def read_own(file: Path, text: bytes, code: int) -> tuple[OwnEffect, str]:
    """Return an effect that a file declares, and its law as source. Raises TableError."""
    try:
        table = Table(tomllib.loads(text.decode("utf-8")), "")
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise TableError(f"is not TOML: {error}") from None
    table.only(KEYS)
    name, enters = table.text("name"), table.text("enters") if "enters" in table else "force"
    if not IDENTIFIER.match(name):
        raise TableError(f"name is {name!r}; give small letters, digits and _, and a letter first")
    if enters not in HOOKS:
        raise TableError(
            f"enters is {enters!r}; give what the formula is added to: {', '.join(HOOKS)}"
        )
    places = PLACES[enters]
    at = table.texts("at") if "at" in table else list(places)
    for place in at:
        if place not in places:
            raise TableError(
                f"at has {place!r}; with enters = {enters!r}, it may have {', '.join(places)}"
            )
    own = table.table("parameters")
    keys = list(own.values)
    for key in keys:
        if not IDENTIFIER.match(key):
            raise TableError(
                f"parameters has {key!r}; give small letters, digits and _, and a letter first"
            )
        if key in ("q", "v", "u", "pi") or key in FUNCTIONS:
            raise TableError(
                f"parameters has {key!r}, which means something else in a formula; choose another"
                " name"
            )
    if not keys:
        raise TableError("parameters is empty; a law needs at least one parameter")
    formula = table.text("formula")
    law = translated(formula, STATES[enters], keys)
    run = eval(f"lambda q, v, u, p: {law}", dict(PLAIN))  # of what `translated` has written itself

    def value(q: float, v: float, u: float, p: Sequence[float]) -> float:
        try:
            return float(run(q, v, u, p))
        except (ArithmeticError, ValueError):
            return math.nan

    starts = {key: _numbers(own.table(key), "start") for key in keys}
    scales = {key: _numbers(own.table(key), "scale") for key in keys}
    parameters = tuple(_parameter(own.table(key), key, keys, starts, value) for key in keys)
    if not any(p.role in ("magnitude", "strength") and p.neutral is not None for p in parameters):
        raise TableError(
            "the law is linear in none of its parameters; give the parameter that sets its strength"
            " role = 'strength', and as neutral the value at which the law is 0"
        )
    _nothing_at_nothing(parameters, starts, value)
    effect = Effect(
        name=name,
        summary=table.text("summary") if "summary" in table else formula,
        places=tuple(at),
        parameters=parameters,
        hook=HOOKS[enters],
        code=code,
        formula=formula,
        reference=table.text("reference") if "reference" in table else str(file),
        rotary_only=table.boolean("rotary_only") if "rotary_only" in table else False,
        mistaken_for=tuple(table.texts("mistaken_for")) if "mistaken_for" in table else (),
        family=table.text("family") if "family" in table else "",
        prior=table.number("prior") if "prior" in table else 0.02,
        odds=table.number("odds") if "odds" in table else 0.0,
        **_sought(enters, parameters, starts, scales, value),
    )
    return OwnEffect(effect, file, source_hash(text), formula), law


def _numbers(table: Table, key: str) -> list[float]:
    """One number or a list of them; none where the key is missing."""
    if key not in table:
        return []
    return list(table.numbers(key)) if isinstance(table.values[key], list) else [table.number(key)]


Law = Callable[[float, float, float, Sequence[float]], float]


def _parameter(
    table: Table, key: str, keys: Sequence[str], starts: Mapping[str, list[float]], value: Law
) -> Parameter:
    table.only(PARAMETER_KEYS)
    lower = table.number("lower") if "lower" in table else 0.0
    upper = table.number("upper") if "upper" in table else WIDEST
    if not lower < upper:
        raise TableError(
            f"{table.path}.lower is {lower:g} and upper {upper:g}; lower must be below upper"
        )
    scales = not starts[key] and _scales(keys.index(key), keys, starts, value)
    role = table.text("role") if "role" in table else "magnitude" if scales else "shape"
    if role not in ROLES:
        raise TableError(f"{table.path}.role is {role!r}; it must be one of {', '.join(ROLES)}")
    if role == "magnitude" and not scales:
        raise TableError(
            f"{table.path}.role is 'magnitude', but the law is not linear in this parameter, or the"
            " parameter has a start; give role = 'strength'"
        )
    if role != "magnitude" and not starts[key]:
        raise TableError(f"{table.path}.start is missing; give the value at which a search begins")
    neutral = table.number("neutral") if "neutral" in table else 0.0 if scales else None
    unit = table.text("unit") if "unit" in table else ""
    linear = table.text("linear_unit") if "linear_unit" in table else None
    return Parameter(
        key, table.text("symbol") if "symbol" in table else key, unit, lower, upper, neutral,
        linear, role,  # pyright: ignore[reportArgumentType]
        meaning=table.text("meaning") if "meaning" in table else "",
    )  # fmt: skip


def _nothing_at_nothing(
    parameters: Sequence[Parameter], starts: Mapping[str, list[float]], value: Law
) -> None:
    """Raise TableError where the law is something though all magnitudes are 0."""
    if any(p.role == "strength" for p in parameters):
        return
    numbers = [0.0 if p.role == "magnitude" else starts[p.name][0] for p in parameters]
    for q, v, u in itertools.product((-1.0, 0.3), repeat=3):
        if value(q, v, u, numbers) != 0.0:
            named = " and ".join(p.name for p in parameters if p.role == "magnitude")
            raise TableError(
                f"formula is {value(q, v, u, numbers):.3g} at q = {q:g}, v = {v:g}, u = {u:g}"
                f" with {named} at 0; it must then be 0 everywhere"
            )


def _scales(index: int, keys: Sequence[str], starts: Mapping[str, list[float]], value: Law) -> bool:
    """Whether a law is a straight line over a parameter, at states by chance."""
    random = np.random.default_rng(0)
    seen = 0
    for _ in range(20):
        q, v, u = random.normal(0.0, 1.0, 3).tolist()
        p = [starts[k][0] if starts[k] else float(random.uniform(0.1, 1.0)) for k in keys]
        found: list[float] = []
        for factor in (0.0, 1.0, 2.0):
            found.append(value(q, v, u, [x * factor if i == index else x for i, x in enumerate(p)]))
        none, once, twice = found
        if not all(map(math.isfinite, found)):
            return False
        if abs(twice - 2.0 * once + none) > STRAIGHT * (abs(once) + abs(twice) + abs(none)):
            return False
        seen += once != none
    return seen > 0


def _sought(
    enters: str,
    parameters: Sequence[Parameter],
    starts: Mapping[str, list[float]],
    scales: Mapping[str, list[float]],
    value: Law,
) -> dict[str, Any]:
    """How it is sought: magnitudes by what a recording moves by, the rest from where it is said."""
    shapes = [p for p in parameters if p.role != "magnitude"]
    magnitudes = [p for p in parameters if p.role == "magnitude"]

    def all_of(z: Sizes, place: Place) -> float:
        """The reference for its size: the force or, for a sensor, the motion."""
        return z.position if enters == "sensor" else z.force

    def unit_size(z: Sizes, place: Place, p: Parameter, others: Values) -> float:
        """The magnitude that is all of what the recording moves by, at states it is often in."""
        reach, index = z.reach(place), min(place.index, len(z.speeds) - 1)
        speed = z.speeds[index]
        made = 0.0
        for q, v, u in itertools.product((-reach, 0.5 * reach, reach), (-speed, speed),
                                         (-z.force, z.force)):  # fmt: skip
            numbers = [
                1.0 if own is p else 0.0 if own in magnitudes else others[own.name]
                for own in parameters
            ]
            one = value(q, v, u, numbers)
            made = max(made, abs(one)) if math.isfinite(one) else made
        return all_of(z, place) / made if made > 0.0 else 1.0

    def scaled(z: Sizes, place: Place, shares: Sequence[float]) -> Iterator[Scaled]:
        for numbers in itertools.product(*(starts[p.name] for p in shapes)):
            others = {p.name: v for p, v in zip(shapes, numbers, strict=True)}
            widths = {
                p.name: (scales[p.name][0] if scales[p.name] else abs(v) or 1.0)
                for p, v in zip(shapes, numbers, strict=True)
            }
            for share in shares:
                sizes = {p.name: share * unit_size(z, place, p, others) for p in magnitudes}
                values = {p.name: min(max(sizes[p.name], p.lower), p.upper) for p in magnitudes}
                yield others | values, widths | sizes

    def begin(z: Sizes, place: Place) -> Iterator[Scaled]:
        yield from scaled(z, place, SHARES)

    def swept(z: Sizes, place: Place) -> Iterator[Scaled]:
        yield from scaled(z, place, list(up_to(1.0, SMALLEST)))

    def natural(z: Sizes, place: Place) -> float:
        strength = next(p for p in parameters if p.role in ("magnitude", "strength"))
        others = {p.name: starts[p.name][0] for p in shapes}
        if strength in shapes:
            return abs(others[strength.name]) or 1.0
        return unit_size(z, place, strength, others)

    def drawn(_: np.random.Generator, z: Sizes, place: Place) -> Values:
        values, __ = next(scaled(z, place, (0.01,)))
        return values

    return {"starts": begin, "sweep": swept, "natural": natural, "drawn": drawn}


def _declared() -> tuple[dict[str, OwnEffect], dict[str, dict[int, str]], tuple[str, ...]]:
    """The effects by name, their laws by hook and code, and what is wrong with files."""
    found: dict[str, OwnEffect] = {}
    laws: dict[str, dict[int, str]] = {hook: {} for hook in HOOKS}
    wrong: list[str] = []
    for code, (file, text) in enumerate(own_texts(), FIRST_CODE):
        if text is None:
            wrong.append(f"{VARIABLE} lists {file}, which {UNREADABLE}")
            continue
        try:
            own, law = read_own(file, text, code)
            if own.effect.name in found:
                raise TableError(
                    f"name is {own.effect.name!r}, which {found[own.effect.name].file} also uses"
                )
        except ValueError as error:
            wrong.append(f"{file}: {error}")
            continue
        found[own.effect.name] = own
        laws[own.effect.hook][code] = law
    return found, laws, tuple(wrong)


OWN, _LAWS, WRONG = _declared()
own_force = compiled("code, q, v, u, p", _LAWS["force"], "0.0")
own_command = compiled("code, u, p", _LAWS["command"], "0.0")
own_sensor = compiled("code, q, p", _LAWS["sensor"], "0.0")
