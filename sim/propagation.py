"""What lies differently in memory, alone and in lanes: propagators, and which of them is at work.

Alone, a propagator lies in blocks of eight rows, (blocks, columns, 8), so that the rows of a state
fill a vector register. In lanes every member has propagators of its own, (rows, columns) of lanes.
The sums run over the columns in the same order, so both have the same bits.

Each set of locked masses and of links that carry nothing has its propagator. Alone all are made
beforehand. In lanes one is made, for all members at once, when it first occurs; and since members
may have different sets, the ones at work are kept together and changed, lane by lane, where a set
changes, which is rare.
"""

# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray

from zwidth.sim.exponential import SPACES, held_motion
from zwidth.sim.jit import INLINED, part
from zwidth.sim.lane_type import WIDTH, any_lane, lanes, select

Floats = NDArray[np.float64]


class Choice(NamedTuple):
    """What the propagators of lanes are made and chosen from; empty for a run alone.

    every (2 segments, sets, rows, columns): each, where made; made (2, sets): whether; sets (2,):
    the locked set whose propagator each lane has at work, -1 for none yet. a, b: the plant;
    locked_a, locked_b, scale, work: working space.
    """

    every: Floats
    made: NDArray[np.int64]
    sets: Floats
    a: Floats
    b: Floats
    locked_a: Floats
    locked_b: Floats
    scale: Floats
    work: Floats


def choice() -> Choice:
    """Return what a run alone has: nothing to choose."""
    one, two, three, four = (np.zeros((0,) * axes) for axes in (1, 2, 3, 4))
    made = np.zeros((0, 0), dtype=np.int64)
    return Choice(four, made, one, two, two, two, two, one, three)


def lane_choice(a: Floats, b: Floats, sets: int) -> tuple[Choice, Floats]:
    """Return room for the propagators of a group, and for those at work.

    a (N, N, WIDTH), b (N, inputs, WIDTH): the plants; those at work (2, 1, rows, columns, WIDTH)
    are the propagators of the group's `Equations`.
    """
    size, inputs = b.shape[:2]
    rows, columns = size + size % 2, size + inputs
    room = Choice(
        np.zeros((2, sets, rows, columns, WIDTH)), np.zeros((2, sets), dtype=np.int64),
        np.full((2, WIDTH), -1.0), a, b, np.zeros_like(a), np.zeros_like(b),
        np.zeros((size, WIDTH)), np.zeros((SPACES, size, size, WIDTH)),
    )  # fmt: skip
    return room, np.zeros((2, 1, rows, columns, WIDTH))


def propagate(p: Any, w: Any, columns: int, x: Any) -> None:
    """Set x = P w, the sums running over the columns in order.

    Where `at_once`, x may be w: all of it is read before any of it is written.
    """
    _eight_rows(p, w, columns, x)


def at_once(p: Any) -> bool:
    """Whether a propagator is one block of rows."""
    return p.shape[0] == 1


@part
def _eight_rows(p, w, columns, x):
    for block in range(p.shape[0]):
        a0 = a1 = a2 = a3 = a4 = a5 = a6 = a7 = 0.0
        for j in range(columns):
            wj = w[j]
            a0 += p[block, j, 0] * wj
            a1 += p[block, j, 1] * wj
            a2 += p[block, j, 2] * wj
            a3 += p[block, j, 3] * wj
            a4 += p[block, j, 4] * wj
            a5 += p[block, j, 5] * wj
            a6 += p[block, j, 6] * wj
            a7 += p[block, j, 7] * wj
        o = 8 * block
        x[o] = a0
        x[o + 1] = a1
        x[o + 2] = a2
        x[o + 3] = a3
        x[o + 4] = a4
        x[o + 5] = a5
        x[o + 6] = a6
        x[o + 7] = a7


@part
def _in_blocks(p, w, columns, x):
    """Six rows at a time: so many sums of lanes, and what they add, fit the vector registers."""
    rows = p.shape[0]
    for i in range(0, rows - rows % 6, 6):
        a0 = a1 = a2 = a3 = a4 = a5 = 0.0
        for j in range(columns):
            wj = w[j]
            a0 += p[i, j] * wj
            a1 += p[i + 1, j] * wj
            a2 += p[i + 2, j] * wj
            a3 += p[i + 3, j] * wj
            a4 += p[i + 4, j] * wj
            a5 += p[i + 5, j] * wj
        x[i], x[i + 1], x[i + 2] = a0, a1, a2
        x[i + 3], x[i + 4], x[i + 5] = a3, a4, a5
    i = rows - rows % 6
    if rows - i == 4:
        a0 = a1 = a2 = a3 = 0.0
        for j in range(columns):
            wj = w[j]
            a0 += p[i, j] * wj
            a1 += p[i + 1, j] * wj
            a2 += p[i + 2, j] * wj
            a3 += p[i + 3, j] * wj
        x[i], x[i + 1], x[i + 2], x[i + 3] = a0, a1, a2, a3
    elif rows - i == 2:
        a0 = a1 = 0.0
        for j in range(columns):
            wj = w[j]
            a0 += p[i, j] * wj
            a1 += p[i + 1, j] * wj
        x[i], x[i + 1] = a0, a1


def entry(p: Any, row: int, column: int) -> Any:
    """Return one entry of a propagator."""
    return p[row // 8, column, row % 8]


def add_column(p: Any, column: int, f: Any, x: Any) -> None:
    """Add what a held force f adds to the state."""
    _add_eight(p, column, f, x)


@part
def _add_eight(p, column, f, x):
    for block in range(p.shape[0]):
        for r in range(8):
            x[8 * block + r] += p[block, column, r] * f


@part
def _add_each(p, column, f, x):
    for i in range(p.shape[0]):
        x[i] += p[i, column] * f


def chosen(eq: Any, segment: int, members: Any, choice: Any) -> int:
    """Return which propagator of a segment belongs to a set of masses and links."""
    return int(members)


@part
def _bring_each(eq, segment, members, choice):
    """Bring every lane the propagator of its own set; there is one place for those at work."""
    different = members != choice.sets[segment]
    if any_lane(different):
        now = eq.propagators[segment, 0]
        for s in range(choice.made.shape[1]):
            changing = different & (members == 1.0 * s)
            if any_lane(changing):
                p = choice.every[segment, s]
                if choice.made[segment, s] == 0:
                    _make(eq, segment, s, choice, p)
                    choice.made[segment, s] = 1
                for i in range(p.shape[0]):
                    for j in range(p.shape[1]):
                        now[i, j] = select(changing, p[i, j], now[i, j])
        choice.sets[segment] = members
    return 0


@part
def _open(eq, members, a):
    """Take from a plant, in place, what some links with play carry."""
    n = eq.dof
    for g in range(eq.gaps.size):
        if members >> g & 1 == 1:
            e = eq.gaps[g]
            spring, damper = eq.forces.parameters[e, 1], eq.forces.parameters[e, 2]
            for side in range(2):
                i = eq.forces.first[e] if side == 0 else eq.forces.second[e]
                j = eq.forces.second[e] if side == 0 else eq.forces.first[e]
                a[n + i, i] += spring / eq.masses[i]
                a[n + i, j] -= spring / eq.masses[i]
                a[n + i, n + i] += damper / eq.masses[i]
                a[n + i, n + j] -= damper / eq.masses[i]


@part
def _make(eq, segment, members, choice, p):
    a, b = choice.locked_a, choice.locked_b
    n = eq.dof
    for i in range(eq.states):
        for j in range(eq.states):
            a[i, j] = choice.a[i, j]
    _open(eq, members, a)
    masses = members >> eq.gaps.size
    for i in range(eq.states):
        mass = i if i < n else i - n
        locked = i < 2 * n and masses >> mass & 1 == 1
        for j in range(eq.states):
            a[i, j] = 0.0 if locked else a[i, j]
        for u in range(b.shape[1]):
            b[i, u] = 0.0 if locked else choice.b[i, u]
    held_motion(a, b, eq.durations[segment], n, eq.states, choice.scale, choice.work, p)


def _in_lanes(array: Any) -> bool:
    return isinstance(array, types.Array) and array.dtype == lanes


@overload(propagate, strict=False, jit_options=INLINED)
def _propagate_of(p: Any, w: Any, columns: Any, x: Any) -> Any:
    if _in_lanes(p):
        return lambda p, w, columns, x: _in_blocks(p, w, columns, x)
    return lambda p, w, columns, x: _eight_rows(p, w, columns, x)


@overload(at_once, strict=False, jit_options=INLINED)
def _at_once_of(p: Any) -> Any:
    if _in_lanes(p):
        return lambda p: p.shape[0] <= 6
    return lambda p: p.shape[0] == 1


@overload(entry, strict=False, jit_options=INLINED)
def _entry_of(p: Any, row: Any, column: Any) -> Any:
    if _in_lanes(p):
        return lambda p, row, column: p[row, column]
    return lambda p, row, column: p[row // 8, column, row % 8]


@overload(add_column, strict=False, jit_options=INLINED)
def _add_column_of(p: Any, column: Any, f: Any, x: Any) -> Any:
    if _in_lanes(p):
        return lambda p, column, f, x: _add_each(p, column, f, x)
    return lambda p, column, f, x: _add_eight(p, column, f, x)


@overload(chosen, strict=False, jit_options=INLINED)
def _chosen_of(eq: Any, segment: Any, members: Any, choice: Any) -> Any:
    if _in_lanes(choice.types[0]):
        return lambda eq, segment, members, choice: _bring_each(eq, segment, members, choice)
    return lambda eq, segment, members, choice: int(members)
