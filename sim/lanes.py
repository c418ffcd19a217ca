# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
"""Many runs of one device at once: the same tick, runs in the lanes of the vector registers.

The innermost loop runs over 32 runs that lie side by side in memory, each with its own
wall, start and state. Every lane does the operations of `sim/kernel.py` in the same order, so it
equals the scalar run bit for bit. It serves linear mechanisms with the interface's own
nonlinearities (encoder step, command step, limit) and with Coulomb friction at m1, under the
built-in wall; anything else runs in the scalar kernel.

With friction every lane moves freely first; where lanes are stuck, all lanes are also moved as if
locked, and the stuck ones take that. Choosing costs less than parting the lanes.

Per window of ticks a lane keeps, instead of its trace: two energies weighted over the window
(kinetic energy, and the square of the third difference of m1's velocity, which shows fast modes a
thousand times below slow ones), the extremes of m1's position and of the command, and how often
m1's velocity changed its sign.

What the compiler needs to put runs into vector registers: sizes that are constants, slices of a
lane's length instead of computed indices (which may be negative, hence scattered), and memory
that begins on a cache line.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.equations import Equations
from zwidth.sim.jit import jit, part
from zwidth.sim.physics.command_step import quantise_command
from zwidth.sim.physics.encoder_step import read_encoder
from zwidth.sim.physics.saturation import limit_command

Floats = NDArray[np.float64]
LANES = 32  # runs in a group: a tick and run costs half as much again with 16, 3 % less with 64
SLOW_ENERGY, FAST_ENERGY, LOWEST, HIGHEST = 0, 1, 2, 3
LOWEST_COMMAND, HIGHEST_COMMAND, REVERSALS = 4, 5, 6
MEASURES = 7
CACHE_LINE = 64  # bytes
# Rows of the bank after the states, the held command and the fresh states.
READING, ESTIMATE, PAST1, PAST2, PAST3 = 0, 1, 2, 3, 4
STIFFNESS, DAMPING, POSITION, SIDED, STUCK, SIGNALS = 5, 6, 7, 8, 9, 10


class LaneMemory(NamedTuple):
    """All that survives a tick, for a group of lanes.

    bank (rows x lanes,): states, held command, working space, signals, wall and whether m1 is
    stuck, a row of lanes each, in one array with rows at constant offsets, so that the compiler
    can see that they do not overlap. line ((d + 2) x lanes,) the delay lines.
    """

    bank: Floats
    line: Floats


@part
def signal_row(states: int, signal: int) -> int:
    """Return the bank's row of a signal."""
    return 2 * states + 1 + signal


def lane_memory(eq: Equations, lanes: int = LANES) -> LaneMemory:
    """Return zeroed memory for a number of lanes of a device."""
    rows = signal_row(eq.states, SIGNALS)
    return LaneMemory(np.zeros(rows * lanes), np.zeros((eq.whole_delay + 2) * lanes))


def dense(eq: Equations) -> Floats:
    """Return the propagators as rows on [x; held; force on m1], flat.

    Of each segment, and with friction of m1 free and m1 locked.
    """
    sets = eq.propagators.shape[1]
    unpacked = eq.propagators.transpose(0, 1, 2, 4, 3).reshape(2, sets, -1, eq.columns)
    return np.ascontiguousarray(unpacked[:, :, : eq.states, : eq.states + 2]).ravel()


def aligned(values: Floats) -> Floats:
    """Return a copy, flat, that begins on a cache line."""
    room = np.empty(values.size + CACHE_LINE // 8)
    first = -room.ctypes.data % CACHE_LINE // 8
    room[first : first + values.size] = values.ravel()
    return room[first : first + values.size]


@part
def pushed(depth, push, one_sided):
    """Command of a wall (`controllers/wall.py`) at a depth, `push` being what it would push."""
    inside = 0.0 if depth <= 0.0 else max(0.0, push)
    return -(inside if one_sided != 0.0 else push)


# Parts of the lane kernel. Absorbed by it, they see `states` and `dof` as the constants they are
# there. (Inside it they would be different functions in every process, and never found cached.)


@part
def move_freely(p, bank, states):
    """Set the fresh states to P [x; held]."""
    columns, fresh = states + 2, states + 1
    for lane in range(LANES):
        for i in range(states):
            total = p[i * columns] * bank[lane]
            for j in range(1, states + 1):
                total += p[i * columns + j] * bank[j * LANES + lane]
            bank[(fresh + i) * LANES + lane] = total


@part
def find_stuck(reaction, level, bank, states, dof):
    """Mark the lanes whose m1 is at rest under a load within the level; return how many."""
    mark = signal_row(states, STUCK)
    count = 0
    for lane in range(LANES):
        force = 0.0
        for j in range(states + 1):
            force += reaction[j] * bank[j * LANES + lane]
        stuck = bank[dof * LANES + lane] == 0.0 and abs(force) <= level and level > 0.0
        bank[mark * LANES + lane] = 1.0 if stuck else 0.0
        count += 1 if stuck else 0
    return count


@part
def rub(p, level, bank, states, dof):
    """Add to the fresh states the force that stops m1, or the level if that is less.

    Then, where m1 turned or stopped, what its old friction did until then (`turn` of the kernel).
    """
    columns, fresh = states + 2, states + 1
    for lane in range(LANES):
        f = -bank[(fresh + dof) * LANES + lane] / p[dof * columns + states + 1]
        f = max(-level, min(level, f))
        for i in range(states):
            bank[(fresh + i) * LANES + lane] += p[i * columns + states + 1] * f
        v = bank[(fresh + dof) * LANES + lane]
        bank[(fresh + dof) * LANES + lane] = 0.0 if -level < f < level else v
        start = bank[dof * LANES + lane]
        before = -level if start > 0.0 else level
        v = bank[(fresh + dof) * LANES + lane]
        end = v + p[dof * columns + states + 1] * (before - f)
        turned = start != 0.0 and f != before and end * start < 0.0
        share = start / (start - end) if turned else 0.0
        lower = share * before + (1.0 - share) * -level - f
        upper = share * before + (1.0 - share) * level - f
        more = -v / p[dof * columns + states + 1]
        more = max(lower, min(upper, more))
        for i in range(states):
            x = bank[(fresh + i) * LANES + lane]
            bank[(fresh + i) * LANES + lane] = (
                x + p[i * columns + states + 1] * more if turned and more != 0.0 else x
            )
        v = bank[(fresh + dof) * LANES + lane]
        still = turned and lower < more < upper
        bank[(fresh + dof) * LANES + lane] = 0.0 if still else v


@part
def hold_stuck(p, bank, states):
    """Replace the fresh states of stuck lanes by P [x; held] with m1 locked."""
    columns, fresh, mark = states + 2, states + 1, signal_row(states, STUCK)
    for lane in range(LANES):
        stuck = bank[mark * LANES + lane] != 0.0
        for i in range(states):
            total = p[i * columns] * bank[lane]
            for j in range(1, states + 1):
                total += p[i * columns + j] * bank[j * LANES + lane]
            free = bank[(fresh + i) * LANES + lane]
            bank[(fresh + i) * LANES + lane] = total if stuck else free


@cache
def lane_kernel(states: int, dof: int, dry: bool) -> Any:
    """Return the kernel for a number of states; with fixed sizes the sums unroll.

    dry: the device has Coulomb friction at m1.
    """
    DRY = dry
    HELD = states
    FRESH = states + 1
    Y = 2 * states + 1 + READING
    V = 2 * states + 1 + ESTIMATE
    D1 = 2 * states + 1 + PAST1
    D2 = 2 * states + 1 + PAST2
    D3 = 2 * states + 1 + PAST3
    K = 2 * states + 1 + STIFFNESS
    B = 2 * states + 1 + DAMPING
    W = 2 * states + 1 + POSITION
    S = 2 * states + 1 + SIDED
    SET = states * (states + 2)
    SETS = 2 if dry else 1

    def advance_lanes(eq, p, memory, head, weights, windows, measures):
        """Run `windows` windows of weights.size ticks each; return the delay line's head.

        p: from `dense`. measures (windows x 7 x lanes,) is filled.
        """
        bank, line = memory
        last = line.size // LANES - 1
        stepped = eq.encoder_step != 0.0 or eq.command_step != 0.0
        level = eq.frictions.parameters[0, 0] if DRY else 0.0
        reaction = eq.reaction[0]
        for window in range(windows):
            m = measures[MEASURES * LANES * window : MEASURES * LANES * (window + 1)]
            for lane in range(LANES):
                m[SLOW_ENERGY * LANES + lane] = 0.0
                m[FAST_ENERGY * LANES + lane] = 0.0
                m[LOWEST * LANES + lane] = bank[lane]
                m[HIGHEST * LANES + lane] = bank[lane]
                m[LOWEST_COMMAND * LANES + lane] = np.inf
                m[HIGHEST_COMMAND * LANES + lane] = -np.inf
                m[REVERSALS * LANES + lane] = 0.0
            for k in range(weights.size):
                weight = weights[k]
                for lane in range(LANES):
                    q = bank[lane]
                    m[LOWEST * LANES + lane] = min(m[LOWEST * LANES + lane], q)
                    m[HIGHEST * LANES + lane] = max(m[HIGHEST * LANES + lane], q)
                    v = bank[dof * LANES + lane]
                    past1, past2 = bank[D1 * LANES + lane], bank[D2 * LANES + lane]
                    third = v - 3.0 * (past1 - past2) - bank[D3 * LANES + lane]
                    bank[D3 * LANES + lane] = past2
                    bank[D2 * LANES + lane] = past1
                    bank[D1 * LANES + lane] = v
                    m[FAST_ENERGY * LANES + lane] += weight * (third * third)
                    m[REVERSALS * LANES + lane] += 1.0 if v * past1 < 0.0 else 0.0
                    energy = 0.5 * eq.masses[0] * (v * v)
                    for i in range(1, dof):
                        v = bank[(dof + i) * LANES + lane]
                        energy += 0.5 * eq.masses[i] * (v * v)
                    m[SLOW_ENERGY * LANES + lane] += weight * energy
                now = line[head * LANES : (head + 1) * LANES]
                if stepped:
                    for lane in range(LANES):
                        y = read_encoder(bank[lane], eq.encoder_step, eq.encoder_floor)
                        v = bank[V * LANES + lane]
                        v += eq.smoothing * ((y - bank[Y * LANES + lane]) * eq.rate - v)
                        bank[V * LANES + lane] = v
                        bank[Y * LANES + lane] = y
                        depth = y - bank[W * LANES + lane]
                        push = bank[K * LANES + lane] * depth + bank[B * LANES + lane] * v
                        u = pushed(depth, push, bank[S * LANES + lane])
                        now[lane] = quantise_command(u, eq.command_step)
                else:
                    for lane in range(LANES):
                        y = bank[lane]
                        v = bank[V * LANES + lane]
                        v += eq.smoothing * ((y - bank[Y * LANES + lane]) * eq.rate - v)
                        bank[V * LANES + lane] = v
                        bank[Y * LANES + lane] = y
                        depth = y - bank[W * LANES + lane]
                        push = bank[K * LANES + lane] * depth + bank[B * LANES + lane] * v
                        now[lane] = pushed(depth, push, bank[S * LANES + lane])
                for lane in range(LANES):
                    u = limit_command(now[lane], eq.command_limit)
                    now[lane] = u
                    m[LOWEST_COMMAND * LANES + lane] = min(m[LOWEST_COMMAND * LANES + lane], u)
                    m[HIGHEST_COMMAND * LANES + lane] = max(m[HIGHEST_COMMAND * LANES + lane], u)
                head = 0 if head == last else head + 1
                for segment in range(2):
                    if eq.substeps[segment] > 0:
                        source = head + segment if head + segment <= last else 0
                        due = line[source * LANES : (source + 1) * LANES]
                        for lane in range(LANES):
                            bank[HELD * LANES + lane] = due[lane]
                    o = segment * SETS * SET
                    for _ in range(eq.substeps[segment]):
                        stuck = find_stuck(reaction, level, bank, states, dof) if DRY else 0
                        move_freely(p[o : o + SET], bank, states)
                        if DRY:
                            rub(p[o : o + SET], level, bank, states, dof)
                            if stuck > 0:
                                hold_stuck(p[o + SET : o + 2 * SET], bank, states)
                        for lane in range(LANES):
                            for i in range(states):
                                bank[i * LANES + lane] = bank[(FRESH + i) * LANES + lane]
        return head

    return jit(advance_lanes)
