"""How small differences of the state go on along a recording, and Kalman's gains for them.

An observer with one gain is right for one linear model. Play, dry friction and gravity are another
model at each tick: A_k, by which a small difference before it appears after it. Along its own
motion an extended Kalman filter corrects by

    K_k = P_k c' (c P_k c' + R)^-1,    P_(k+1) = A_k (P_k - K_k c P_k) A_k' + Q.

A_k is found by the tick itself, in lanes: one starts from the state, the others from it with a
state moved by `SHARE` of its standard deviation, and all are corrected by the sample (by K, under
which a difference d becomes (I - K c) d), so that what they differ by afterwards is

    F_k = A_k (I - K_k c),    A_k = F_k (I + P_k c' R^-1 c).

c holds what is read, late or early too (`noise.steady.read_of`). Differences of
finite size average over what happens within them, such as contact a little earlier or later. (From
0.03 to 1 standard deviation, -2 ln of a recording with play and two frictions differed by less than
20, where a fixed gain costs 1000 more.)

Limits: at most `WIDTH` - 1 states. Internal states of effects (the bristles of a friction, the pin
of a play) are followed, and neither differ nor are corrected.
"""

# Compiled code takes what numba gives it.
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.account import counted
from zwidth.sim.jit import jit, part
from zwidth.sim.kernel import Memory
from zwidth.sim.lane_type import WIDTH
from zwidth.sim.population import Population, Readings, Recorded, in_lanes, reading_of
from zwidth.sim.predict import judge_of, predict, saved_room

Floats = NDArray[np.float64]
Lost = NDArray[np.bool_]
SHARE = 0.1  # of a standard deviation, by which states are moved
LEAST = 1e-12  # in units squared, of a variance: that of a state that counts as known is zero


class Uncertain(NamedTuple):
    """What a filter knows of n states before the first sample, and of the noise.

    p, process (n, n): P and Q; c (o, n): what is read; noise (o,): variances R of the readings. All
    variances are in units of `unit` squared.
    """

    p: Floats
    process: Floats
    c: Floats
    noise: Floats
    unit: float


class Room(NamedTuple):
    """Working space: gains (n, o); left (n, n), moved (n, n or o); shifts, seen (n,)."""

    gains: Floats
    left: Floats
    moved: Floats
    shifts: Floats
    seen: Floats


def room_for(n: int, o: int) -> Room:
    """Return working space for n states and o outputs."""
    return Room(np.zeros((n, o)), np.zeros((n, n)), np.zeros((n, n)), np.zeros(n), np.zeros(n))


@part
def corrected(p, c, noise, gains, left):
    """Fill gains (n, o) from P (n, n), and left (n, n) with what a sample leaves of it.

    Outputs correct one after the other, since their noise is independent; the gain of all is
    P c' R^-1 with the P that they leave.
    """
    n, outputs = p.shape[0], c.shape[0]
    for i in range(n):
        for j in range(n):
            left[i, j] = p[i, j]
    for o in range(outputs):
        seen = noise[o]
        for i in range(n):
            beside = 0.0
            for j in range(n):
                beside += left[i, j] * c[o, j]
            gains[i, o] = beside
            seen += c[o, i] * beside
        for i in range(n):
            for j in range(n):
                left[i, j] -= gains[i, o] * gains[j, o] / seen
    for o in range(outputs):
        for i in range(n):
            beside = 0.0
            for j in range(n):
                beside += left[i, j] * c[o, j]
            gains[i, o] = beside / noise[o]


@part
def moved_on(p, motion, process, room):
    """Replace P (n, n) by A P A' + Q."""
    n = p.shape[0]
    for i in range(n):
        for j in range(n):
            total = 0.0
            for m in range(n):
                total += motion[i, m] * p[m, j]
            room[i, j] = total
    for i in range(n):
        for j in range(i + 1):
            total = process[i, j]
            for m in range(n):
                total += room[i, m] * motion[j, m]
            p[i, j] = total
            p[j, i] = total


@jit
def gains_along(p, motions, process, c, noise, lost, room, gains):
    """Write Kalman's gains (n, ticks, o); P (n, n) is overwritten by the one after them.

    motions (ticks, n, n): A over each tick, or (1, n, n) for all; process (n, n): Q; c (o, n);
    noise (o,): variances of the readings; lost (ticks,): samples that correct nothing.
    """
    n = p.shape[0]
    for k in range(lost.size):
        corrected(p, c, noise, room.gains, room.left)
        for i in range(n):
            for o in range(c.shape[0]):
                gains[i, k, o] = room.gains[i, o]
            for j in range(n):
                p[i, j] = p[i, j] if lost[k] else room.left[i, j]
        moved_on(p, motions[k if motions.shape[0] > 1 else 0], process, room.moved)


class Filter(NamedTuple):
    """One device whose recording a filter follows, from its memory before the first sample.

    population: of this device alone. into (states, n): by what a difference in each of the n states
    changes those of the device; own (n,): which of these they are. known: before the first sample.
    """

    population: Population
    begins: Memory
    into: Floats
    own: NDArray[np.int64]
    known: Uncertain


def motions_along(by: Filter, recorded: Recorded, lost: Lost) -> Floats:
    """Return A (ticks, n, n) along the motion that a filter finds.

    lost (ticks,): samples that correct nothing. Not finite after an overflow. Raises ValueError for
    more than `WIDTH` - 1 states, or devices of several structures.
    """
    return _along(by, recorded, lost, np.zeros((recorded.ticks, 0)))


def driven_along(by: Filter, recorded: Recorded) -> Floats:
    """Return h(x) (ticks, o) of a device that innovations move as they correct its filter.

    recorded: measured (ticks, 2 o) are innovations e (ticks, o) of outputs that stay zero, then
    zeros of what is read, from which nothing is corrected. The gains are those of the motion that
    results. Raises ValueError like `motions_along`.
    """
    read = np.zeros((recorded.ticks, by.known.c.shape[0]))
    _along(by, recorded, np.zeros(recorded.ticks, np.bool_), read)
    return read


def _along(by: Filter, recorded: Recorded, lost: Lost, read: Floats) -> Floats:
    population, known = by.population, by.known
    n, o = known.p.shape[0], recorded.measured.shape[1]
    if n >= WIDTH or len(population.batches) != 1:
        raise ValueError(
            f"{n} states and {len(population.batches)} structures; at most {WIDTH - 1} states of"
            " one structure are followed in lanes"
        )
    only = np.zeros(1, dtype=np.int64)
    coarse, fine = population.batches[0].groups(only)
    states = coarse.eq.states
    reading = reading_of(Readings(np.zeros((states, o))), only, recorded, states)
    external = recorded.external
    motions = np.zeros((recorded.ticks, n, n))
    with counted(1 + n, recorded.ticks):
        follow_beside(
            coarse.eq, fine.eq, recorded.outputs, recorded.command,
            np.zeros(0) if recorded.strengths is None else recorded.strengths, recorded.measured,
            reading, np.zeros((0, coarse.eq.dof)) if external is None else external,
            in_lanes([by.begins]), (coarse.scratch, fine.scratch),
            saved_room(coarse.eq, (WIDTH,)),
            judge_of(np.repeat(np.eye(o)[:, :, None, None], WIDTH, axis=3), 1, 0, (WIDTH,)),
            by.into, by.own, known.p.copy(), known.process, known.c, known.noise, known.unit, lost,
            room_for(n, known.c.shape[0]), motions, read,
        )  # fmt: skip
    return motions


@jit
def follow_beside(
    eq, fine, outputs, commands, strengths, measured, reading, external, memory, spaces, saved,
    judge, into, own, p, process, c, noise, unit, lost, room, motions, read,
):  # fmt: skip
    """Write A (ticks, n, n), see `motions_along`; P is overwritten by the one after them.

    read: (ticks, 0), or (ticks, o) for what a device that innovations move reads (`driven_along`);
    all lanes are then moved by the same innovation, so that what they differ by becomes A.
    """
    n, o = p.shape[0], c.shape[0]
    apart = o if read.shape[1] == 0 else 0  # outputs by which lanes are corrected differently
    x, observer = memory.x, reading.observer
    for k in range(commands.size):
        corrected(p, c, noise, room.gains, room.left)
        for j in range(n):
            room.shifts[j] = SHARE * unit * np.sqrt(max(p[j, j], LEAST))
        for i in range(observer.shape[0]):
            for a in range(o):
                gain = 0.0
                for j in range(n):
                    gain += into[i, j] * room.gains[j, a]
                for lane in range(x.shape[1]):
                    observer[i, a, lane] = gain
        for lane in range(1, x.shape[1]):
            for own_memory in (memory.line, memory.internal, memory.scalars):
                for i in range(own_memory.shape[0]):
                    own_memory[i, lane] = own_memory[i, 0]
            for i in range(observer.shape[0]):
                x[i, lane] = x[i, 0]
                if lane <= n:
                    x[i, lane] += into[i, lane - 1] * room.shifts[lane - 1]
        predict(
            eq, fine, outputs, commands[k : k + 1],
            strengths[k : k + 1] if strengths.size > 0 else strengths, measured[k : k + 1],
            reading, external[k : k + 1] if external.shape[0] > 0 else external, memory, spaces,
            saved, judge,
        )  # fmt: skip
        for i in range(n):
            for j in range(n):
                motions[k, i, j] = (x[own[i], j + 1] - x[own[i], 0]) / room.shifts[j]
        for a in range(read.shape[1]):
            read[k, a] = -judge.piece[0, o + a, 0]
        if not lost[k]:
            for a in range(
                o if read.shape[1] == 0 else 0
            ):  # F (I + P c' R^-1 c), P still as it was
                for j in range(n):
                    room.seen[j] = 0.0
                    for m in range(n):
                        room.seen[j] += p[j, m] * c[a, m] / noise[a]
                for i in range(n):
                    room.moved[i, a] = 0.0
                    for m in range(n):
                        room.moved[i, a] += motions[k, i, m] * room.seen[m]
            for i in range(n):
                for j in range(n):
                    for a in range(apart):
                        motions[k, i, j] += room.moved[i, a] * c[a, j]
                    p[i, j] = room.left[i, j]
        moved_on(p, motions[k], process, room.moved)
