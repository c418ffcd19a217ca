"""Every effect in Modelica's words: what it adds to a model of a chain of masses.

Forces are those of `sim/physics`, in continuous time: where a law there is a step of what a force
remembers, here is the differential equation that it solves.
"""

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.export.settable import numbers_of
from zwidth.sim.following import FASTEST
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import Grid, force_at, grid_of
from zwidth.sim.physics.free_law import points_of, table_law
from zwidth.sim.physics.moving_average import BESSEL
from zwidth.sim.physics.points import named_states, of_points
from zwidth.sim.physics.two_tables import table_at, two_tables_of

Floats = NDArray[np.float64]
TABLE = """\
  function table "A law through points: cubic in each interval, and its ends beyond them"
    input Real s "state";
    input Real at[:] "points";
    input Real c[:, 4] "of each interval, from its beginning";
    input Boolean odd "whether the points are of abs(s)";
    output Real f;
  protected
    Real x;
    Real t;
    Integer k;
  algorithm
    x := if odd then abs(s) else s;
    k := 1;
    for i in 2:size(at, 1) - 1 loop
      k := if x > at[i] then i else k;
    end for;
    t := min(max((x - at[k]) / (at[k + 1] - at[k]), 0.0), 1.0);
    f := c[k, 1] + t * (c[k, 2] + t * (c[k, 3] + t * c[k, 4]));
    f := if odd and s < 0.0 then -f else f;
  end table;
"""
SURFACE = """\
  function surface "A force through rows and columns: cubic in either, and at its edges beyond them"
    input Real a "state of the rows";
    input Real b "state of the columns";
    input Real rows[:];
    input Real columns[:];
    input Real c[:, 16] "of each cell, row by row, from its beginning";
    output Real f;
  protected
    Real t;
    Real u;
    Integer i;
    Integer j;
    Integer k;
  algorithm
    i := 1;
    for n in 2:size(rows, 1) - 1 loop
      i := if a > rows[n] then n else i;
    end for;
    j := 1;
    for n in 2:size(columns, 1) - 1 loop
      j := if b > columns[n] then n else j;
    end for;
    t := min(max((a - rows[i]) / (rows[i + 1] - rows[i]), 0.0), 1.0);
    u := min(max((b - columns[j]) / (columns[j + 1] - columns[j]), 0.0), 1.0);
    k := (i - 1) * (size(columns, 1) - 1) + j;
    f := c[k, 1] + u * (c[k, 2] + u * (c[k, 3] + u * c[k, 4]))
      + t * (c[k, 5] + u * (c[k, 6] + u * (c[k, 7] + u * c[k, 8]))
      + t * (c[k, 9] + u * (c[k, 10] + u * (c[k, 11] + u * c[k, 12]))
      + t * (c[k, 13] + u * (c[k, 14] + u * (c[k, 15] + u * c[k, 16])))));
  end surface;
"""
NEAREST = """\
  function nearest "The nearest multiple of a step, ties away from zero"
    input Real s;
    input Real step;
    output Real f;
  algorithm
    f := (if s < 0.0 then -1.0 else 1.0) * step * floor(abs(s) / step + 0.5);
  end nearest;
"""


@dataclass
class Friction:
    """Levels of dry friction at a mass: in motion either way, and at rest against either."""

    plus: list[str] = field(default_factory=list[str])
    minus: list[str] = field(default_factory=list[str])
    rest_plus: list[str] = field(default_factory=list[str])
    rest_minus: list[str] = field(default_factory=list[str])


@dataclass
class Model:
    """What a Modelica model is put together of; indices are masses, from 0.

    start: where the first mass begins. loads: terms of the force on each mass; frictions by mass;
    reading, told: what the encoder makes of "q1" and the amplifier of "command", each from what
    stood there before. rates: by which a command may change a second, as a force.
    """

    masses: int
    rotary: bool
    start: float = 0.0
    parameters: list[str] = field(default_factory=list[str])
    functions: list[str] = field(default_factory=list[str])
    variables: list[str] = field(default_factory=list[str])
    equations: list[str] = field(default_factory=list[str])
    loads: list[list[str]] = field(default_factory=list[list[str]])
    frictions: dict[int, Friction] = field(default_factory=dict[int, Friction])
    reading: str = "q1"
    told: list[str] = field(default_factory=list[str])
    rates: list[str] = field(default_factory=list[str])
    lag: str = ""
    damped: set[str] = field(default_factory=set[str])

    def parameter(self, name: str, value: float, unit: str, meaning: str = "") -> str:
        """Add a parameter; return its name."""
        told = f'(unit="{modelica_unit(unit)}")' if unit else ""
        said = f' "{meaning}"' if meaning else ""
        self.parameters.append(f"parameter Real {name}{told} = {float(value)!r}{said};")
        return name

    def state(self, name: str, start: float = 0.0) -> None:
        """Add a continuous state."""
        self.variables.append(f"Real {name}(start={start!r}, fixed=true);")

    def function(self, text: str) -> None:
        """Add a function once."""
        if text not in self.functions:
            self.functions.append(text)

    def force(self, p: Physics, expression: str) -> None:
        """Add a force on the first mass of a place, and against it on the second."""
        name = f"force_{p.effect.name}_{p.at}"
        self.variables.append(f"Real {name};")
        self.equations.append(f"{name} = {expression};")
        i, j = p.place.ends
        self.loads[i].append(f"+ {name}")
        if j >= 0:
            self.loads[j].append(f"- {name}")

    def friction(self, i: int) -> Friction:
        """Return the levels at a mass, to add to."""
        return self.frictions.setdefault(i, Friction())


def modelica_unit(unit: str) -> str:
    """Return a unit as Modelica writes it: "N m s2/rad2" is N.m.s2/rad2."""
    return unit.replace(" ", ".")


def way(p: Physics) -> tuple[str, str]:
    """Return position and velocity that a law is taken over."""
    i, j = p.place.ends
    if j < 0 or p.effect.over_first:
        return f"q{i + 1}", f"v{i + 1}"
    return f"(q{i + 1} - q{j + 1})", f"(v{i + 1} - v{j + 1})"


def add(model: Model, p: Physics, all_of: Mapping[str, Physics]) -> None:
    """Add an effect; all_of: those of the device by name, of which a servo's are read.

    Raises KeyError for an effect that has no words here.
    """
    write = LAWS[p.effect.name]
    if write is _nothing or p.place.kind == "velocity":
        return  # of velocities, since none is read from a model
    names: dict[str, str] = {}
    if not of_points(p.effect.parameters):
        for one in numbers_of(p, model.rotary):
            name = one.name.replace(".", "_")
            names[one.name.split(".")[1]] = name
            if np.isfinite(one.value):
                model.parameter(name, one.value, one.unit, one.meaning)
    write(model, p, names, all_of)


Names = Mapping[str, str]
All = Mapping[str, Physics]


def _coulomb(model: Model, p: Physics, n: Names, _: All) -> None:
    _levels(model, p, *[n["level"]] * 4)


def _stribeck(model: Model, p: Physics, n: Names, _: All) -> None:
    v = way(p)[1]
    rise = f"({n['static_level']} - {n['level']}) * exp(-({v} / {n['velocity']})^2)"
    moving = f"{n['level']} + {rise}"
    _levels(model, p, moving, moving, n["static_level"], n["static_level"])


def _rising(model: Model, p: Physics, n: Names, _: All) -> None:
    v = way(p)[1]
    fall = f"({n['level']} - {n['static_level']}) * exp(-abs({v}) / {n['velocity']})"
    moving = f"{n['level']} - {fall}"
    _levels(model, p, moving, moving, n["static_level"], n["static_level"])


def _directional(model: Model, p: Physics, n: Names, _: All) -> None:
    v = way(p)[1]
    _levels(
        model, p, f"{n['level_plus']} + {n['viscous_plus']} * {v}",
        f"{n['level_minus']} - {n['viscous_minus']} * {v}", n["level_plus"], n["level_minus"],
    )  # fmt: skip


def _of_load(model: Model, p: Physics, n: Names, all_of: All) -> None:
    asked, back, limit = _servo(all_of)
    driven = f"max(min({asked}, {limit}), -{limit})" if limit else asked
    moving = f"{n['ratio']} * abs({driven}{f' - {back} * v1' if back else ''})"
    name = f"level_{p.effect.name}"
    model.variables.append(f"Real {name};")
    model.equations.append(f"{name} = noEvent({moving});")
    _levels(model, p, *[name] * 4)


def _levels(
    model: Model, p: Physics, plus: str, minus: str, rest_plus: str, rest_minus: str
) -> None:
    at = model.friction(p.place.index)
    at.plus.append(plus)
    at.minus.append(minus)
    at.rest_plus.append(rest_plus)
    at.rest_minus.append(rest_minus)


def _servo(all_of: All) -> tuple[str, str, str]:
    """Return what a servo asks for, its back-EMF's damper, its limit; "" for what there is not."""
    loop = all_of.get("position_servo")
    if loop is None:
        return "drive", "", ""
    name = "position_servo_m1"
    limited = "servo_limit" in all_of and np.isfinite(all_of["servo_limit"].values["limit"])
    limit = "servo_limit_m1_limit" if limited else ""
    drive = "drive + integral_m1" if "servo_integral" in all_of else "drive"
    return f"({drive} - {name}_stiffness * q1 - {name}_damping * v1)", f"{name}_back_emf", limit


def _dahl(model: Model, p: Physics, n: Names, _: All) -> None:
    """The bristle's z' = sigma/f_c (v - z |v|), what `dahl_along` solves for either direction."""
    v = way(p)[1]
    z = f"bristle_{p.at}"
    model.state(z)
    rate = f"{n['stiffness']} / {n['level']} * ({v} - {z} * noEvent(abs({v})))"
    model.equations.append(f"der({z}) = {rate};")
    model.force(p, f"-{n['level']} * {z}")


def _bouc_wen(model: Model, p: Physics, n: Names, _: All) -> None:
    """The yield's z' = k/f (1 - |z|^n) v in loading, k/f v in unloading."""
    v = way(p)[1]
    z = f"yield_{p.at}"
    model.state(z)
    share = f"noEvent(if {z} * {v} > 0.0 then 1.0 - abs({z})^{n['shape']} else 1.0)"
    model.equations.append(f"der({z}) = {n['stiffness']} / {n['level']} * {v} * {share};")
    model.force(p, f"-{n['level']} * {z}")


def _backlash(model: Model, p: Physics, n: Names, _: All) -> None:
    """What the gap takes from the link; the pin, held within it, creeps to the shaft.

    z' = v + k/c (q - z), what `next_pin` solves; without a damper the pin is the shaft, as far as
    the gap goes.
    """
    q, v = way(p)
    spring, damper = f"spring_{p.at}", f"damper_{p.at}"
    half, z = f"0.5 * {n['gap']}", f"pin_{p.at}"
    if damper not in model.damped:
        model.force(p, f"{spring} * max(min({q}, {half}), -{half})")
        return
    rate, whole = f"rate_{z}", f"({spring} * {q} + {damper} * {v})"
    model.state(z)
    model.variables.append(f"Real {rate};")
    model.equations.append(f"{rate} = {v} + {spring} / {damper} * ({q} - {z});")
    stands = f"{z} >= {half} and {rate} > 0.0 or {z} <= -{half} and {rate} < 0.0"
    model.equations.append(f"der({z}) = if {stands} then 0.0 else {rate};")
    beyond = f"if {z} >= {half} then min({spring} * {half}, {whole})"
    below = f"if {z} <= -{half} then max(-{spring} * {half}, {whole})"
    model.force(p, f"{beyond} else {below} else {whole}")


def _pendulum(model: Model, p: Physics, n: Names, _: All) -> None:
    q = way(p)[0]
    model.force(p, f"-{n['level']} * sin({q} + {n['angle']})")


def _ripple(model: Model, p: Physics, n: Names, _: All) -> None:
    q = way(p)[0]
    model.force(p, f"{n['amplitude']} * sin({2.0 * np.pi!r} * {q} / {n['period']} + {n['phase']})")


def _cubic(model: Model, p: Physics, n: Names, _: All) -> None:
    q = way(p)[0]
    model.force(p, f"-{n['coefficient']} * {q}^3")


def _drag(model: Model, p: Physics, n: Names, _: All) -> None:
    v = way(p)[1]
    model.force(p, f"-{n['coefficient']} * {v} * noEvent(abs({v}))")


def _constant(model: Model, p: Physics, n: Names, _: All) -> None:
    model.force(p, n["level"])


def _spring(model: Model, p: Physics, n: Names, _: All) -> None:
    q = way(p)[0]
    model.loads[p.place.index].append(f"- {n['stiffness']} * {q}")


def _mode(model: Model, p: Physics, n: Names, _: All) -> None:
    host, own = p.place.index + 1, model.masses + 1
    model.masses += 1
    model.loads.append([])
    pull = f"pull_m{own}"
    model.variables.append(f"Real {pull};")
    model.equations.append(
        f"{pull} = {n['stiffness']} * (q{own} - q{host}) + {n['damping']} * (v{own} - v{host});"
    )
    model.loads[host - 1].append(f"+ {pull}")
    model.loads[own - 1].append(f"- {pull}")
    model.parameters.append(f"parameter Real mass_m{own} = {n['mass']};")


def _loop(model: Model, _: Physics, n: Names, __: All) -> None:
    model.loads[0].append(f"- {n['stiffness']} * q1 - ({n['damping']} + {n['back_emf']}) * v1")


def _loop_limit(model: Model, p: Physics, n: Names, all_of: All) -> None:
    if np.isfinite(p.values["limit"]):
        asked, limit = _servo(all_of)[0], n["limit"]
        model.force(p, f"min(max({asked}, -{limit}), {limit}) - {asked}")


def _loop_zone(model: Model, p: Physics, n: Names, _: All) -> None:
    k = "position_servo_m1_stiffness"
    most = f"{n['half']} * {k}"
    model.force(p, f"-min(max(drive - {k} * q1, -{most}), {most})")


def _integral(model: Model, p: Physics, n: Names, _: All) -> None:
    """The clamped z' = rate (u - k q) of the held command u: 0 at its limit, if it would go on."""
    z, rate = f"integral_{p.at}", f"rate_integral_{p.at}"
    model.state(z)
    model.variables.append(f"Real {rate};")
    model.equations.append(f"{rate} = {n['rate']} * (drive - position_servo_m1_stiffness * q1);")
    if np.isfinite(p.values["limit"]):
        limit = n["limit"]
        stands = f"{z} >= {limit} and {rate} > 0.0 or {z} <= -{limit} and {rate} < 0.0"
        model.equations.append(f"der({z}) = if {stands} then 0.0 else {rate};")
    else:
        model.equations.append(f"der({z}) = {rate};")
    model.force(p, z)


def _falling(model: Model, p: Physics, n: Names, all_of: All) -> None:
    if np.isfinite(p.values["limit"]):
        asked, _, most = _servo(all_of)
        a = f"max(min({asked}, {most}), -{most})" if most else asked
        limit, falls = n["limit"], f"{n['slope']} * v1"
        model.force(p, f"min(max({a}, -{limit} - {falls}), {limit} - {falls}) - {a}")


def _nothing(_: Model, __: Physics, ___: Names, ____: All) -> None:
    """What has no part in a model: its drive is always on."""


def _lag(model: Model, _: Physics, n: Names, __: All) -> None:
    model.lag = n["time_constant"]


def _band(model: Model, _: Physics, n: Names, __: All) -> None:
    u, half = model.told[-1], f"0.5 * {n['width']}"
    model.told.append(
        f"if abs({u}) <= {half} then 0.0 else if {u} > 0.0 then {u} - {half} else {u} + {half}"
    )


def _gains(model: Model, _: Physics, n: Names, __: All) -> None:
    u, r = model.told[-1], n["ratio"]
    model.told.append(f"2.0 / (1.0 + {r}) * {u} * (if {u} > 0.0 then {r} else 1.0)")


def _rate(model: Model, p: Physics, n: Names, _: All) -> None:
    if np.isfinite(p.values["rate"]):
        model.rates.append(n["rate"])


def _goal_rate(model: Model, p: Physics, n: Names, all_of: All) -> None:
    """A goal counts by the stiffness of its loop."""
    if "position_servo" in all_of and np.isfinite(p.values["rate"]):
        model.rates.append(f"{n['rate']} * position_servo_m1_stiffness")


def _reads_late(model: Model, p: Physics, n: Names, _: All) -> None:
    """The lag's T s' = y - s of the reading y before."""
    if p.values["time_constant"] > FASTEST:
        s, y = f"reading_{p.effect.name}", model.reading
        model.state(s, model.start)
        model.equations.append(f"{n['time_constant']} * der({s}) = {y} - {s};")
        model.reading = s


def _reads_filtered(model: Model, p: Physics, n: Names, _: All) -> None:
    if p.values["time_constant"] > FASTEST:
        _second_order(model, p, n["time_constant"], n["damping"])


def _reads_mean(model: Model, p: Physics, n: Names, _: All) -> None:
    """A mean is Bessel's filter (`moving_average.py`)."""
    if p.values["window"] > FASTEST * np.sqrt(12.0):
        _second_order(model, p, f"({n['window']} / {np.sqrt(12.0).item()!r})", repr(BESSEL))


def _second_order(model: Model, p: Physics, time: str, damping: str) -> None:
    """The filter's s' = g, T^2 g' = y - s - 2 zeta T g of the reading y before."""
    s, g, y = f"reading_{p.effect.name}", f"rate_{p.effect.name}", model.reading
    model.state(s, model.start)
    model.state(g)
    model.equations.append(f"der({s}) = {g};")
    model.equations.append(f"{time}^2 * der({g}) = {y} - {s} - 2.0 * {damping} * {time} * {g};")
    model.reading = s


def _eccentric(model: Model, _: Physics, n: Names, __: All) -> None:
    y = model.reading
    wave = f"sin({2.0 * np.pi!r} * ({y}) / {n['period']} + {n['phase']})"
    model.reading = f"{y} + {n['amplitude']} * {wave}"


def _rectified(model: Model, _: Physics, __: Names, ___: All) -> None:
    model.reading = f"abs({model.reading})"


def _free_spring(model: Model, p: Physics, _: Names, __: All) -> None:
    model.force(p, _table(model, p, way(p)[0]))


def _free_damper(model: Model, p: Physics, _: Names, __: All) -> None:
    model.force(p, _table(model, p, way(p)[1]))


def _free_amplifier(model: Model, p: Physics, _: Names, __: All) -> None:
    u = model.told[-1]
    model.told.append(f"{u} + {_table(model, p, u)}")


def _free_sensor(model: Model, p: Physics, _: Names, __: All) -> None:
    y = model.reading
    model.reading = f"{y} + {_table(model, p, y)}"


def _free_force(model: Model, p: Physics, _: Names, __: All) -> None:
    grid, states = grid_of(p.values), _states(p)
    if len(grid.columns) < 2:  # a single column is a force over the first state alone
        rows, vector = list(grid.rows), grid.values[:, 0]
        alone = Grid(grid.over[:1], grid.rows, (), tuple((f,) for f in vector.tolist()))
        model.force(p, _curve(model, p, states[0], rows, lambda s: force_at(alone, s), "false"))
    else:
        model.force(p, _surface(model, p, grid, *states))


def _free_product(model: Model, p: Physics, _: Names, __: All) -> None:
    product = two_tables_of(p.values)
    laws = [
        _curve(model, p, state, [s for s, _ in table], partial(table_at, table), "false", of)
        for state, table, of in zip(
            _states(p), (product.first, product.second), ("_first", "_second"), strict=True
        )
    ]
    model.force(p, " * ".join(laws))


def _free_shift(model: Model, p: Physics, _: Names, __: All) -> None:
    law, (first, second) = two_tables_of(p.values), _states(p)
    by = _curve(
        model, p, second, [s for s, _ in law.second], partial(table_at, law.second), "false",
        "_second",
    )  # fmt: skip
    along = [s for s, _ in law.first]
    force = _curve(
        model, p, f"({first} + {by})", along, partial(table_at, law.first), "false", "_first"
    )
    model.force(p, force)


def _states(p: Physics) -> list[str]:
    """The states that a law of two states names, as they stand in the model."""
    q, v = way(p)
    words = {"position": q, "velocity": v, "command": "drive", "time": "time"}
    return [words[state] for state in named_states(p)]


def _table(model: Model, p: Physics, state: str) -> str:
    """Return the law of a table at a state."""
    vector, at = p.vector(), [s for s, _ in points_of(p.values)]

    def law(states: Floats) -> Floats:
        return np.array([float(table_law(s, vector)) for s in states.tolist()])

    return _curve(model, p, state, at, law, "true" if p.values["odd"] > 0.5 else "false")


THIRDS = np.array([0.0, 1.0, 2.0, 3.0]) / 3.0
TO_CUBIC = np.linalg.inv(np.vander(THIRDS, increasing=True))


def _curve(
    model: Model,
    p: Physics,
    state: str,
    at: list[float],
    law: Callable[[Floats], Floats],
    odd: str,
    of: str = "",
) -> str:
    """Return a law at a state: its cubics, one an interval, from four values each.

    of: which of an effect's laws it is, by the end of its name.
    """
    model.function(TABLE)
    name = f"{p.effect.name}_{p.at}{of}"
    rows = [TO_CUBIC @ law(low + THIRDS * (high - low)) for low, high in itertools.pairwise(at)]
    _array(model, f"{name}_at[{len(at)}]", _list(at))
    _array(model, f"{name}_c[{len(rows)}, 4]", _matrix(rows))
    return f"table({state}, {name}_at, {name}_c, {odd})"


def _surface(model: Model, p: Physics, grid: Grid, first: str, second: str) -> str:
    """Return a force at two states: its bicubics, one a cell, from sixteen values each."""
    model.function(SURFACE)
    name = f"{p.effect.name}_{p.at}"
    cells = itertools.product(itertools.pairwise(grid.rows), itertools.pairwise(grid.columns))
    rows: list[Floats] = []
    for (low, high), (left, right) in cells:
        a, b = low + THIRDS * (high - low), left + THIRDS * (right - left)
        values = force_at(grid, a[:, None], b[None, :])
        rows.append((TO_CUBIC @ values @ TO_CUBIC.T).ravel())
    _array(model, f"{name}_rows[{len(grid.rows)}]", _list(grid.rows))
    _array(model, f"{name}_columns[{len(grid.columns)}]", _list(grid.columns))
    _array(model, f"{name}_c[{len(rows)}, 16]", _matrix(rows))
    return f"surface({first}, {second}, {name}_rows, {name}_columns, {name}_c)"


def _array(model: Model, declared: str, values: str) -> None:
    model.parameters.append(f"parameter Real {declared} = {values};")


def _list(numbers: Iterable[float]) -> str:
    return "{" + ", ".join(repr(float(n)) for n in numbers) + "}"


def _matrix(rows: Iterable[Floats]) -> str:
    return "{" + ", ".join(_list(row.tolist()) for row in rows) + "}"


LAWS: Mapping[str, Callable[[Model, Physics, Names, All], None]] = {
    "coulomb_friction": _coulomb, "stribeck_friction": _stribeck,
    "rising_friction": _rising,
    "directional_friction": _directional, "load_friction": _of_load, "presliding_friction": _dahl,
    "hysteresis": _bouc_wen, "backlash": _backlash, "gravity_pendulum": _pendulum,
    "force_ripple": _ripple, "cubic_stiffness": _cubic, "quadratic_drag": _drag,
    "constant_force": _constant, "ground_spring": _spring, "extra_mode": _mode,
    "position_servo": _loop, "servo_limit": _loop_limit, "servo_dead_zone": _loop_zone,
    "actuator_lag": _lag, "dead_band": _band, "gain_asymmetry": _gains,
    "encoder_eccentricity": _eccentric, "rectified_sensor": _rectified,
    "free_spring": _free_spring, "free_damper": _free_damper, "free_amplifier": _free_amplifier,
    "free_sensor": _free_sensor, "free_force": _free_force,
    "free_product": _free_product,
    "free_shift": _free_shift,
    "servo_integral": _integral, "falling_limit": _falling,
    "open_winding": _nothing, "rate_limit": _rate, "goal_rate_limit": _goal_rate,
    "sensor_lag": _reads_late, "sensor_filter": _reads_filtered, "moving_average": _reads_mean,
}  # fmt: skip
"""How each effect enters; those of the interface (steps, limit, delay) are its own."""
