"""A force without a formula: a grid over two states, or a table over one; time may be one.

    f = sum over i, j of  r_i(a) c_j(b) F_ij

a and b are two of position, velocity, command and time: of a mass, its own position and velocity;
in a link, its deflection and the rate of this, with the force on the first mass and its opposite on
the second. The command is the one that is held, and time is that of the run, or of the recording,
from its beginning on. F_ij is the force at row i, a state of the first, and column j, one of the
second. r_i and c_j say how much each row and column counts: along either axis the force is the
curve of `free_law.py` through its points, cubic in each interval and at its ends beyond them. That
curve is linear in the values, f_1 + sum of e_j (f_(j+1) - f_j), with shares e_j of the steps that
depend on the state and the points alone, so that r_i = e_(i-1) - e_i is found once for an axis and
not once for each row.

    [[physics]]
    effect = "free_force"
    at = "m1"
    over = ["position", "velocity"]
    rows = [0.0, 0.1, 0.2]            # positions
    columns = [-1.0, 0.0, 1.0]        # velocities
    table = [[0.2, 0.0, -0.2], [0.4, 0.0, -0.4], [0.4, 0.0, -0.6]]

or, for a force from outside the device,

    effect = "free_force"
    at = "m1"
    over = ["time"]
    rows = [0.0, 1.0, 1.5, 4.0]
    table = [0.0, 0.0, 0.03, 0.0]

A force over two states has up to 8 rows and 8 columns (`SIZE`), one over a single state up to 32
points (`MOST`), whose values lie in the places of a grid, row by row. A single column is a force
that does not depend on the second state.

Limits: as `free_law.py`; the surface may swing between points that are far apart, and a force that
is steep against the substep is a stiff spring or damper. It is second order in the substep in all
four: a force over time is taken at the substep's own beginning and end. It may generate energy,
which the ledger shows as its work.
"""

import itertools
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline

from zwidth.sim.jit import part
from zwidth.sim.lane_type import any_lane, greatest, least, negated, select
from zwidth.sim.nearest import nearest
from zwidth.sim.physics.effect import Effect, Parameter
from zwidth.sim.physics.free_law import (
    check_rising,
    curve_through,
    numbered,
    per,
    rising,
    row_values,
)
from zwidth.sim.place import LINKS, MASSES

Floats = NDArray[np.float64]
STATES = ("position", "velocity", "command", "time")  # their codes are their places here, from 1 on
STATE_UNITS = ("rad", "rad/s", "N m", "s")
SIZE, MOST = 8, 32
OVER = ("over_1", "over_2")
ROW = tuple(f"row_{i + 1}" for i in range(MOST))
COLUMN = tuple(f"column_{j + 1}" for j in range(SIZE))
VALUE = tuple(f"force_{i + 1}_{j + 1}" for i in range(SIZE) for j in range(SIZE))
ROWS, COLUMNS, VALUES = len(OVER), len(OVER) + MOST, len(OVER) + MOST + SIZE  # where they begin


class Grid(NamedTuple):
    """A force of no formula as people write it.

    over: one or two of `STATES`. rows, columns: states of the first and of the second, () where
    there is none. table: the force at each row, of a force over two states at its columns.
    """

    over: tuple[str, ...]
    rows: tuple[float, ...]
    columns: tuple[float, ...]
    table: tuple[tuple[float, ...], ...]

    @property
    def values(self) -> Floats:
        """The forces (rows, columns), of one state (rows, 1)."""
        return np.array(self.table)

    @property
    def names(self) -> list[list[str]]:
        """The parameter that holds each force: rows of columns, of one state of one each."""
        if len(self.over) == 1:
            return [[name] for name in VALUE[: len(self.rows)]]
        width = len(self.columns)
        return [list(VALUE[SIZE * i : SIZE * i + width]) for i in range(len(self.rows))]


def over_parameters(first: str, second: str, alone: bool) -> tuple[Parameter, Parameter]:
    """Return the states of a law, from its values; alone: a second one is optional."""
    last = len(STATES)
    codes = ", ".join(f"{i + 1} {name}" for i, name in enumerate(STATES))
    none, least_of = ("0 none, ", 0.0) if alone else ("", 1.0)
    return (
        Parameter("over_1", "a", "", 1.0, last, None, meaning=f"state of the {first}: {codes}"),
        Parameter("over_2", "b", "", least_of, last, None,
                  meaning=f"of the {second}: {none}{codes}"),
    )  # fmt: skip


def _parameters() -> tuple[Parameter, ...]:
    return (
        *over_parameters("rows", "columns", alone=True),
        *numbered(ROW, "a", "", "state of row"),
        *numbered(COLUMN, "b", "", "state of column"),
        *(
            Parameter(
                name, f"F_{i + 1}_{j + 1}", "N m", -1e9, 1e9, 0.0, role="magnitude",
                meaning=f"force at row {i + 1}, column {j + 1}",
            )
            for name, (i, j) in zip(
                VALUE, itertools.product(range(SIZE), range(SIZE)), strict=True
            )
        ),
    )  # fmt: skip


free_force = Effect(
    name="free_force",
    summary="a force over two of position, velocity, command and time, or over one, as a table",
    formula="f = f(a, b), a smooth surface through the points of the table",
    places=(*MASSES, *LINKS),
    parameters=_parameters(),
    hook="force",
    code=19,
    reference="a table of what was measured; along each axis the curve of Catmull & Rom, 1974",
    sought="learned",
)


def grid_values(
    over: Sequence[str],
    rows: Sequence[float] | Floats,
    columns: Sequence[float] | Floats,
    table: ArrayLike,
) -> dict[str, float]:
    """Return the parameters of a force over one or two states.

    over: names among `STATES`; rows, columns: states of the first and of the second, which rise,
    no columns for a force over one. table (rows, columns): the force there, of one state (rows,)
    or (rows, 1). Raises ValueError with one sentence for anything else.
    """
    over, rows, columns = tuple(over), [float(r) for r in rows], [float(c) for c in columns]
    check_states(over, (1, 2))
    alone = len(over) == 1
    if alone and columns:
        raise ValueError(
            f"columns has {len(columns)} states, but over has only {over[0]!r}, the state of the"
            " rows; add the state of the columns to over, or leave columns out"
        )
    _check_axis("rows", rows, 2, MOST if alone else SIZE, over[0])
    if not alone:
        _check_axis("columns", columns, 1, SIZE, over[1])
    width = 1 if alone else len(columns)
    forces = _forces(table, len(rows), width, alone)
    places = np.zeros(SIZE * SIZE)
    if alone:
        places[: len(rows)] = forces[:, 0]
        places[len(rows) :] = forces[-1, 0]
    else:
        filled = np.pad(forces, ((0, SIZE - len(rows)), (0, SIZE - width)), mode="edge")
        places[:] = filled.ravel()
    return (
        over_values(over)
        | row_values(ROW, rows)
        | row_values(COLUMN, columns or [0.0])
        | dict(zip(VALUE, places.tolist(), strict=True))
    )


def over_values(over: Sequence[str]) -> dict[str, float]:
    """Return the parameters that say which states a law is over."""
    codes = [float(STATES.index(state) + 1) for state in over]
    return dict(zip(OVER, (*codes, 0.0)[:2], strict=True))


def states_over(values: Mapping[str, float]) -> tuple[str, ...]:
    """Return what `over_values` was given; () for the parameters of another kind of effect."""
    codes = [round(float(values[name])) for name in OVER if name in values]
    return tuple(STATES[code - 1] for code in codes if code > 0)


def check_states(over: tuple[str, ...], allowed: tuple[int, ...]) -> None:
    """Raise ValueError unless a law has the right number of different, known states."""
    if len(over) not in allowed:
        many = " or ".join(("one", "two")[n - 1] for n in allowed)
        raise ValueError(f"over has {len(over)} names; it must have {many} of {', '.join(STATES)}")
    for state in over:
        if state not in STATES:
            raise ValueError(f"over has {state!r}; {nearest(state, STATES)}")
    if len(set(over)) < len(over):
        alone = ", or give it once and leave columns out" if 1 in allowed else " for one of them"
        raise ValueError(f"over has {over[0]!r} twice; give another state{alone}")


def _check_axis(name: str, states: list[float], least_of: int, most: int, over: str) -> None:
    if not least_of <= len(states) <= most:
        raise ValueError(
            f"{name} has {len(states)} values of the {over}; it must have {least_of} to {most}"
        )
    check_rising(name, over, states, "one to the next")


def _forces(table: ArrayLike, rows: int, width: int, alone: bool) -> Floats:
    """The forces (rows, width) of a table."""
    lines = [np.atleast_1d(np.asarray(line, dtype=np.float64)) for line in list(table)]  # pyright: ignore[reportArgumentType,reportUnknownVariableType]
    if len(lines) != rows:
        raise ValueError(
            f"table has {len(lines)} rows; it needs {rows}, one for each state listed in `rows`"
        )
    for i, line in enumerate(lines):
        if line.shape != (width,):
            what = (
                "1, since `over` lists one state"
                if alone
                else f"{width}, one for each state listed in `columns`"
            )
            raise ValueError(f"table[{i}] has {line.size} forces; it needs {what}")
    return np.stack(lines)


def grid_of(values: Mapping[str, float]) -> Grid:
    """Return the arguments of `grid_values` from the parameters of such a force."""
    over = states_over(values)
    alone = len(over) == 1
    rows, columns = (
        tuple(float(values[names[i]]) for i in rising(values, names))
        for names in (ROW if alone else ROW[:SIZE], COLUMN)
    )
    columns = () if alone else columns
    grid = Grid(over, rows, columns, ())
    table = tuple(tuple(float(values[name]) for name in line) for line in grid.names)
    return grid._replace(table=table)


def is_grid(parameters: Sequence[Parameter]) -> bool:
    """Whether an effect is a law of this kind."""
    return any(p.name == ROW[0] for p in parameters)


def state_unit(state: str, rotary: bool) -> str:
    """Return the unit of one of `STATES` on a rotary or a linear device."""
    unit = STATE_UNITS[STATES.index(state)]
    return unit if rotary else unit.replace("N m", "N").replace("rad", "m")


def counts_at(points: Sequence[float] | Floats, states: ArrayLike) -> Floats:
    """Return how much each point of an axis counts at states (...): (..., points), of sum 1.

    The force at states a, b of a grid F is sum of counts_at(rows, a)_i counts_at(columns, b)_j
    F_ij, so that these are also the slopes of a force over its values.
    """
    s, x = np.asarray(points, dtype=np.float64), np.asarray(states, dtype=np.float64)
    if s.size == 1:
        return np.ones((*x.shape, 1))
    units = np.eye(s.size)
    slopes = np.gradient(units, s, axis=0, edge_order=1 if s.size == 2 else 2)
    return np.asarray(CubicHermiteSpline(s, units, slopes, axis=0)(np.clip(x, s[0], s[-1])))


def force_at(grid: Grid, first: ArrayLike, second: ArrayLike = 0.0) -> Floats:
    """Return the force [N m | N] at states of a grid, which broadcast together.

    first, second: in the order of `Grid.over`; of one state the second does not count.
    """
    a, b = np.broadcast_arrays(np.asarray(first, np.float64), np.asarray(second, np.float64))
    rows, columns = counts_at(grid.rows, a), counts_at(grid.columns or (0.0,), b)
    return np.einsum("...i,...j,ij->...", rows, columns, grid.values)


@part
def grid_law(q, v, u, t, p):
    """The force at position q, velocity v, under the held command u, at time t."""
    first, second = state_of(p[0], q, v, u, t), state_of(p[1], q, v, u, t)
    alone = p[1] < 0.5
    force = 0.0 * p[0]
    if any_lane(alone):
        force = select(alone, curve(first, p, ROWS, VALUES, MOST), force)
    both = negated(alone)
    if any_lane(both):
        force = select(both, _across(first, second, p), force)
    return force


@part
def state_of(code, q, v, u, t):
    """The state of a code: its place in `STATES`, from 1 on."""
    return select(code < 1.5, q, select(code < 2.5, v, select(code < 3.5, u, t)))


@part
def curve(s, p, at, laws, most):
    """The curve at s through so many points, states from p[at] on and laws from p[laws] on.

    That of `free_law.table_law` where it is neither odd nor repeats.
    """
    return curve_through(s, p, at, laws, most - 1, False, 0.0, 0.0)


@part
def _across(a, b, p):
    """The surface through up to `SIZE` rows and columns."""
    r0, r1, r2, r3, r4, r5, r6, r7 = _counts(a, p, ROWS)
    columns = _counts(b, p, COLUMNS)
    total = r0 * _row(columns, p, 0) + r1 * _row(columns, p, 1)
    total += r2 * _row(columns, p, 2) + r3 * _row(columns, p, 3)
    total += r4 * _row(columns, p, 4) + r5 * _row(columns, p, 5)
    total += r6 * _row(columns, p, 6) + r7 * _row(columns, p, 7)
    return total


@part
def _row(c, p, i):
    """The force along a row, of what each column counts."""
    k = VALUES + SIZE * i
    total = c[0] * p[k] + c[1] * p[k + 1] + c[2] * p[k + 2] + c[3] * p[k + 3]
    return total + c[4] * p[k + 4] + c[5] * p[k + 5] + c[6] * p[k + 6] + c[7] * p[k + 7]


@part
def _counts(s, p, k):
    """The weight of each of the `SIZE` points of an axis at s; they begin at p[k].

    The share of a step is whole when the interval after it has been looked at. Each count comes in
    from the right, so that after all of them the first one stands first.
    """
    none = 0.0 * p[k]
    c0 = c1 = c2 = c3 = c4 = c5 = c6 = none + 0.0 * s
    width, after = p[k + 1] - p[k], p[k + 2] - p[k + 1]
    own, _, on = _bend(s - p[k], none, width, after)
    behind, share = 0.0 * own, 1.0 + 0.0 * own
    for j in range(1, SIZE):
        beyond = none if j >= SIZE - 2 else p[k + j + 2] - p[k + j + 1]
        next_own, back, next_on = _bend(s - p[k + j], width, after, beyond)
        before, share = share, per(behind + own + back, width)
        c0, c1, c2, c3, c4, c5, c6 = c1, c2, c3, c4, c5, c6, before - share
        behind, own, on = on, next_own, next_on
        width, after = after, beyond
    return c0, c1, c2, c3, c4, c5, c6, share


@part
def _bend(x, before, width, after):
    """What an interval's part of the curve at x from its beginning has of three slopes.

    Its own slope, that of the interval before and that of the one after. Of `free_law._bend`,
    whose tangents are the parabola's: inside, a share of both neighbours' slopes; at an end, its
    own slope and by how much the neighbour's differs from it. Widths are 0 where there is none.
    """
    none = 0.0 * x
    if not any_lane((x > 0.0) & (x < width)):
        return select(x >= width, width, 0.0) + none, none, none
    t = least(greatest(per(x, width), 0.0), 1.0)
    rest = 1.0 - t
    left, right = width * (t * rest * rest), width * (t * t * rest)
    behind, ahead = _share(width, before), _share(width, after)
    back = behind * (left + select(after > 0.0, 0.0, right))
    on = -ahead * (right + select(before > 0.0, 0.0, left))
    return width * (t * t * (3.0 - 2.0 * t)) + left - right - back - on, back, on


@part
def _share(width, beside):
    """The weight of the neighbouring slope in the tangent between two intervals."""
    there = (width > 0.0) & (beside > 0.0)
    return select(there, width / select(there, width + beside, 1.0), 0.0)
