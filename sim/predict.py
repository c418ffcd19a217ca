"""The tick of `sim/kernel.py` as a predictor: recorded command in, innovations out.

At every tick, before step (1), the state is corrected by what was measured,

    e_k = y_k - h(x_k),    x_k <- x_k + L e_k   (innovation form, fixed gain L, or with play two:
                                                 one while its link carries nothing),
then the recorded command goes through amplifier and delay line and the chain moves, by the same
parts as in a simulation. An output is a position or a velocity of one mass; m1's position is seen
through the sensor. A sample that is not a number corrects nothing. With L = 0 it is a free run.

Dry friction that keeps its sign is a constant force, for which one substep is exact; only a tick in
which a mass with friction stops, starts or turns needs many. So does one in which a link with play
lets go or hits a side, between which it is linear. So each tick is tried in few substeps (`eq`),
and where a velocity did not keep its sign, or a pin its side, it is taken back and done in many
(`fine`).
"""

# Compiled code takes what numba gives it.
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.account import counted
from zwidth.sim.equations import Equations
from zwidth.sim.group import VIEWS, seen
from zwidth.sim.jit import jit, part
from zwidth.sim.kernel import (
    MAX_COLUMNS,
    Memory,
    Scratch,
    amplify,
    arrives,
    placed,
    read_sensor,
    scratch,
    substep,
)
from zwidth.sim.lane_type import any_lane, as_lanes, negated, select
from zwidth.sim.physics.backlash import at_a_side

Floats = NDArray[np.float64]

PIECE = 512  # ticks whose innovations are whitened together, while they are in a near cache
OVERFLOW = 1e12  # of the position of m1


STEADY = np.zeros(0, dtype=np.int64)  # the same gain throughout
GROUND = MAX_COLUMNS - 1  # place in a state that no device fills, and that stays zero


class Outputs(NamedTuple):
    """What was measured: state (o,) index of each output in x, sensed (o,) through m1's sensor.

    less (o,): index of what it is measured from, as the end of a link is from its other end;
    `GROUND` for what stands still. late (o,) [s]: by how much it is read after the instant at which
    the command acts, negative before it; of one device (`alone`), since members have their own.
    """

    state: NDArray[np.int64]
    sensed: NDArray[np.bool_]
    less: NDArray[np.int64]
    late: Floats


class Gains(NamedTuple):
    """Gains of an observer that change along a recording, as they do after samples are lost.

    of (states, 2 k o): k gains beside each other, then as many for while play carries nothing
    (`free_of_contact`). columns (ticks,): the first of each tick's gain, from the memory's tick
    0; after them it is the last.
    """

    of: Floats
    columns: NDArray[np.int64]


class Reading(NamedTuple):
    """How a recording is read, which may differ between members of a population.

    observer (states, o): the gain L; (states, 2 o) where play has another while it carries nothing
    (`free_of_contact`). Of `Gains` it is all of them, and columns (ticks,) says which; else that
    is (0,). The command counts times gain (1,); from what was measured origin (o,) is taken, and
    jitter (o,) times arriving (ticks,), or (0,) for none. late (o,) [s]: by how much
    each output is read after the instant at which commands act (`ahead_by`).
    """

    observer: Floats
    columns: NDArray[np.int64]
    gain: Floats
    origin: Floats
    jitter: Floats
    arriving: Floats
    late: Floats


class Saved(NamedTuple):
    """States (states,), internal states (force effects,): before a tick, and after few substeps."""

    x: Floats
    internal: Floats
    coarse_x: Floats
    coarse_internal: Floats


class Judge(NamedTuple):
    """What is kept of the innovations.

    filters (o, o, order + 1): w_k = sum over j of F_j e_(k-j) is what is left of them when they
    are whitened. moments (o, o): sum of w w' after the first `skipped` ticks, without those in
    which the first output was not measured; white (o,) and piece (order + PIECE, o) are working
    space. kept (ticks, o) takes the innovations, or is (0, o). uncounted (ticks,): which correct
    the state and are not judged, or (0,) for none; their innovations are not numbers.
    """

    filters: Floats
    skipped: int
    moments: Floats
    white: Floats
    piece: Floats
    kept: Floats
    uncounted: NDArray[np.bool_]


def saved_room(eq: Equations, lanes: tuple[int, ...] = ()) -> Saved:
    """Return room for what a tick keeps; lanes: (WIDTH,) for a group."""
    states, forces = (eq.states, *lanes), (eq.forces.codes.size, *lanes)
    return Saved(np.zeros(states), np.zeros(forces), np.zeros(states), np.zeros(forces))


def judge_of(
    filters: Floats,
    skipped: int,
    kept: int = 0,
    lanes: tuple[int, ...] = (),
    uncounted: NDArray[np.bool_] | None = None,
) -> Judge:
    """Return a judge with room; filters (o, o, order + 1, *lanes); kept: ticks kept, 0 for none."""
    o, taps = filters.shape[0], filters.shape[2]
    return Judge(
        filters, skipped, np.zeros((o, o, *lanes)), np.zeros((o, *lanes)),
        np.zeros((taps - 1 + PIECE, o, *lanes)), np.zeros((kept, o, *lanes)),
        np.zeros(0, dtype=np.bool_) if uncounted is None else uncounted,
    )  # fmt: skip


def alone(
    eq: Equations,
    fine: Equations,
    outputs: Outputs,
    commands: Floats,
    measured: Floats,
    observer: Floats | Gains,
    external: Floats,
    memory: Memory,
    strengths: Floats | None = None,
) -> Floats:
    """Return the innovations (ticks, o) of one device, see `predict`; memory goes on."""
    o = measured.shape[1]
    gains = observer if isinstance(observer, Gains) else Gains(observer, STEADY)
    reading = Reading(*gains, np.ones(1), np.zeros(o), np.zeros(o), np.zeros(0), outputs.late)
    judge = judge_of(np.eye(o)[:, :, None], measured.shape[0], measured.shape[0])
    spaces = (scratch(eq), scratch(fine))
    with counted(1, measured.shape[0]):
        predict(
            eq, fine, outputs, commands, np.zeros(0) if strengths is None else strengths, measured,
            reading, external, memory, spaces, saved_room(eq), judge,
        )  # fmt: skip
    return judge.kept


def copied(memory: Memory) -> Memory:
    """Return a copy of a memory, to go on from it twice."""
    m = memory
    return Memory(
        m.x.copy(), m.line.copy(), m.controller.copy(), m.internal.copy(), m.scalars.copy(),
        m.counters.copy(), m.totals.copy(),
    )  # fmt: skip


def freely(
    eq: Equations,
    fine: Equations,
    outputs: tuple[Outputs, Outputs],
    commands: Floats,
    measured: tuple[Floats, Floats],
    observer: Floats | Gains,
    external: Floats,
    memory: Memory,
    runs: NDArray[np.int64],
    strengths: Floats,
) -> Floats:
    """Return the innovations (ticks of all runs, o) of free runs of one device, in one call.

    runs (n, 2): first tick, not before that of the run before, and ticks of each; it begins in the
    state that the observer has there, which follows the recording up to the last of them. outputs,
    measured: those the observer corrects by, then those of a free run. Else as for `alone`.
    """
    own, wide = (y.shape[1] for y in measured)
    gains = observer if isinstance(observer, Gains) else Gains(observer, STEADY)
    none = np.zeros(0)
    readings = tuple(
        Reading(*g, np.ones(1), np.zeros(o), np.zeros(o), none, out.late)
        for g, o, out in zip(
            (gains, Gains(np.zeros((eq.states, wide)), STEADY)), (own, wide), outputs, strict=True
        )
    )
    rows, most = int(runs[:, 1].sum()), measured[0].shape[0]
    judges = tuple(
        judge_of(np.eye(o)[:, :, None], most, kept) for o, kept in ((own, 0), (wide, rows))
    )
    spaces, last = (scratch(eq), scratch(fine)), int(runs[-1, 0]) if runs.size else 0
    with counted(1, last + rows):
        run_freely(
            eq, fine, outputs, commands, strengths, measured, readings, external,
            (memory, copied(memory)), spaces, saved_room(eq), judges, runs,
        )  # fmt: skip
    return judges[1].kept


@part
def _lane_reading(r):
    """View a reading in lanes; which gain counts and what is arriving is of the recording."""
    return Reading(
        as_lanes(r.observer),
        r.columns,
        as_lanes(r.gain),
        as_lanes(r.origin),
        as_lanes(r.jitter),
        r.arriving,
        as_lanes(r.late),
    )


@part
def _lane_saved(s):
    """View what a tick keeps in lanes."""
    return Saved(
        as_lanes(s.x), as_lanes(s.internal), as_lanes(s.coarse_x), as_lanes(s.coarse_internal)
    )


@part
def _lane_judge(j):
    """View a judge in lanes."""
    return Judge(
        as_lanes(j.filters), j.skipped, as_lanes(j.moments), as_lanes(j.white),
        as_lanes(j.piece), as_lanes(j.kept), j.uncounted,
    )  # fmt: skip


VIEWS[Reading] = ("origin", 2, _lane_reading)
VIEWS[Saved] = ("x", 2, _lane_saved)
VIEWS[Judge] = ("moments", 3, _lane_judge)


@part
def free_of_contact(eq, pins):
    """Whether a link with play carries nothing: its pin stands on neither side."""
    free = False
    for g in range(eq.gaps.size):
        free = free | negated(at_a_side(pins[eq.gaps[g]], eq.forces.parameters[eq.gaps[g]]))
    return free


@part
def turned(eq, saved, memory):
    """Whether a mass with dry friction did not keep its velocity's sign, or play opened or shut."""
    after, pins = memory.x, memory.internal
    turns = False
    for e in range(eq.frictions.codes.size):
        i = eq.dof + eq.frictions.first[e]
        turns = turns | negated(saved.x[i] * after[i] > 0.0)
    for g in range(eq.gaps.size):
        pin, was, p = pins[eq.gaps[g]], saved.internal[eq.gaps[g]], eq.forces.parameters[eq.gaps[g]]
        turns = turns | ((pin != was) & (at_a_side(pin, p) | at_a_side(was, p)))
    return turns


@part
def at_work(eq, fine, space, fine_space, look):
    """Return equations and working space of a look, which differ in what substeps are made of.

    The rest is the same for both, and named once, so that it need not be fetched every tick.
    """
    substeps = eq.substeps if look == 0 else fine.substeps
    durations = eq.durations if look == 0 else fine.durations
    propagators = eq.propagators if look == 0 else fine.propagators
    now = Equations(
        eq.dof, eq.states, eq.columns, eq.lagging, substeps, durations, propagators,
        eq.quadratics, eq.reaction, eq.masses, eq.springs, eq.spring_stiffness, eq.forces,
        eq.gaps, eq.frictions, eq.bounds_vary, eq.sensors, eq.amplifiers, eq.clocks, eq.whole_delay,
        eq.period, eq.estimator, eq.window, eq.estimating, eq.rate, eq.smoothing, eq.filter,
        eq.second_order, eq.velocity_ticks, eq.position_ticks, eq.force_row, eq.force_gain,
        eq.encoder_step, eq.encoder_floor, eq.velocity_step, eq.command_step, eq.command_gain,
        eq.command_limit, eq.command_rate, eq.looped,
        eq.position_origin, eq.read, eq.reads, eq.followers, eq.behind,
    )  # fmt: skip
    room = Scratch(
        space.before, space.values, space.ahead, space.after, space.friction, space.limits,
        space.own, space.more, space.shares, space.play,
        space.choice if look == 0 else fine_space.choice,
    )  # fmt: skip
    return now, room


@part
def ahead_by(late, state, x, before, dof, period, known):
    """Return by how much a state (its index) is read ahead of the tick where it is read late.

    q(t + s) = q + s v + s^2 / 2 a, and v(t + s) = v + s a, with s of either sign and a the mean
    acceleration over the tick before; what s^3 and more add is left out. A command that changes at
    t changes a at once: where s > 0 that is added by whoever knows the command (`Model.seen`).
    before: the state a tick ago, which counts where it is `known`.
    """
    moves = state + dof if state < dof else state
    gained = (x[moves] - before[moves]) / period if known else 0.0 * late
    if state < dof:
        return late * (x[moves] + 0.5 * late * gained)
    return late * gained


@part
def copy(source, target, count):
    """Copy the first numbers of a row onto another."""
    for i in range(count):
        target[i] = source[i]


@part
def whiten(judge, row):
    """Fill white (o,) from the innovations up to a row; what is missing counts as zero."""
    outputs, taps = judge.filters.shape[0], judge.filters.shape[2]
    for a in range(outputs):
        total = 0.0
        for b in range(outputs):
            for j in range(taps):
                e = judge.piece[row - j, b]
                total += judge.filters[a, b, j] * select(e == e, e, 0.0)
        judge.white[a] = total


@part
def take(judge, first, count):
    """Take in a piece of innovations that begins with tick `first`, and make room for the next."""
    outputs, earlier = judge.filters.shape[0], judge.filters.shape[2] - 1
    for k in range(count):
        if judge.kept.shape[0] > 0:
            for a in range(outputs):
                judge.kept[first + k, a] = judge.piece[earlier + k, a]
        if first + k >= judge.skipped and judge.moments.shape[0] > 0:
            whiten(judge, earlier + k)
            e = judge.piece[earlier + k, 0]
            for a in range(outputs):
                for b in range(outputs):
                    judge.moments[a, b] += select(e == e, judge.white[a] * judge.white[b], 0.0)
    for k in range(earlier):
        for a in range(outputs):
            judge.piece[k, a] = judge.piece[count + k, a]


@jit
def predict(
    device, finer_device, outputs, commands, strengths, measured, reads, external, state, spaces,
    room, judges,
):  # fmt: skip
    """Follow a recording, commands (ticks,) and measured (ticks, o), by one device or a group.

    device, finer_device: `Equations` in few and in many substeps a tick; spaces: the working space
    of each. strengths (ticks,): how much of the drive's force counts, or (0,) for all of it.
    external (ticks, n) forces to add, (ticks, n + 1) with the acceleration of the base after them,
    or (0, n). state goes on from where it is, so that
    a recording may be taken in parts, and knows the time of its tick 0 (`BEGAN`); its scalars[3] is
    1 where the state has overflowed, after which innovations are infinite. Of a group, arrays of
    its members' numbers have a last axis of lanes; what is of the recording has none.
    """
    eq, fine = seen(device), seen(finer_device)
    memory, coarse_space, fine_space = seen(state), seen(spaces[0]), seen(spaces[1])
    reading, saved, judge = seen(reads), seen(room), seen(judges)
    x, line, pins = memory.x, memory.line, memory.internal
    last = line.size - 1
    none = commands[:0]
    head = memory.counters[1]
    tick = memory.counters[0]
    u = memory.scalars[2]
    alive = memory.scalars[3] == 0.0
    earlier = judge.filters.shape[2] - 1
    finer = fine.substeps[0] + fine.substeps[1] > eq.substeps[0] + eq.substeps[1]
    parted = reading.observer.shape[1] > outputs.state.size
    beyond = reading.observer.shape[1] // 2
    for k in range(commands.size):
        row = earlier + k % PIECE
        for o in range(outputs.state.size):
            late, which, from_which = reading.late[o], outputs.state[o], outputs.less[o]
            there, beside = x[which], x[from_which]
            if any_lane(abs(late) > 0.0):
                there = there + ahead_by(late, which, x, saved.x, eq.dof, eq.period, k > 0)
                if from_which != GROUND:
                    own = ahead_by(late, from_which, x, saved.x, eq.dof, eq.period, k > 0)
                    beside = beside + own
            if outputs.sensed[o]:
                there = read_sensor(eq, there)
            there = there - beside
            y = measured[k, o] - reading.origin[o]
            if reading.arriving.size > 0:
                y -= reading.jitter[o] * reading.arriving[k]
            judge.piece[row, o] = select(alive, y - there, np.inf)
        free = parted & free_of_contact(eq, pins)
        first = 0
        if reading.columns.size > 0:
            first = reading.columns[min(tick, reading.columns.size - 1)]
        for o in range(outputs.state.size):
            e = judge.piece[row, o]
            known = alive & (e == e)
            if any_lane(known):
                for i in range(eq.states):
                    gain = reading.observer[i, first + o]
                    if parted:
                        gain = select(free, reading.observer[i, beyond + first + o], gain)
                    x[i] = select(known, x[i] + gain * e, x[i])
        if judge.uncounted.size > 0 and judge.uncounted[k]:
            for o in range(outputs.state.size):
                judge.piece[row, o] = select(alive, np.nan * x[0], np.inf)
        if row == judge.piece.shape[0] - 1 or k == commands.size - 1:
            take(judge, k - k % PIECE, k % PIECE + 1)
        if not any_lane(alive):
            continue
        u = select(arrives(eq, tick), amplify(eq, reading.gain[0] * commands[k], u, tick == 0), u)
        line[head] = u
        head = 0 if head == last else head + 1
        before = line[head]
        current = line[0 if head == last else head + 1]
        force = external[k] if external.shape[0] > 0 else none
        strength = strengths[k] if strengths.size > 0 else 1.0
        copy(x, saved.x, eq.states)
        copy(pins, saved.internal, pins.size)
        again = alive
        for look in range(2 if finer else 1):  # in few substeps, then in many where that matters
            if look == 1:
                again = alive & turned(eq, saved, memory)
                if not any_lane(again):
                    break
                copy(x, saved.coarse_x, eq.states)
                copy(pins, saved.coarse_internal, pins.size)
                copy(saved.x, x, eq.states)
                copy(saved.internal, pins, pins.size)
            now, space = at_work(eq, fine, coarse_space, fine_space, look)
            for segment in range(2):
                held = before if segment == 0 else current
                for step in range(now.substeps[segment]):
                    substep(now, tick, segment, step, held, strength, force, memory, space)
                    placed(now, x, space.own)
            if look == 1:
                for i in range(eq.states):
                    x[i] = select(again, x[i], saved.coarse_x[i])
                for e in range(pins.size):
                    pins[e] = select(again, pins[e], saved.coarse_internal[e])
        tick += 1
        alive = alive & (abs(x[0]) < OVERFLOW)
    memory.scalars[2] = u
    memory.scalars[3] = select(alive, 0.0, 1.0)
    memory.counters[0] = tick
    memory.counters[1] = head


@part
def begin_as(target, source):
    """Fill a memory with the numbers of another."""
    copy(source.x, target.x, source.x.size)
    copy(source.line, target.line, source.line.size)
    copy(source.controller, target.controller, source.controller.size)
    copy(source.internal, target.internal, source.internal.size)
    copy(source.scalars, target.scalars, source.scalars.size)
    copy(source.counters, target.counters, source.counters.size)
    copy(source.totals, target.totals, source.totals.size)


@jit
def run_freely(
    eq, fine, outputs, commands, strengths, measured, readings, external, memories, spaces, room,
    judges, runs,
):  # fmt: skip
    """Follow a recording, and from the first tick of each run let a copy run free; see `freely`.

    One call of `predict` for both, since each would be compiled anew within this loop.
    """
    here = rows = 0
    for r in range(2 * runs.shape[0]):
        first, ticks, free = runs[r // 2, 0], runs[r // 2, 1], r % 2
        if free == 1:
            begin_as(memories[1], memories[0])
        elif first == here:
            continue
        begins, ends = (first, first + ticks) if free == 1 else (here, first)
        here, j = first, judges[free]
        kept = j.kept[rows : rows + ticks * free]
        judge = Judge(j.filters, j.skipped, j.moments, j.white, j.piece, kept, j.uncounted)
        predict(
            eq, fine, outputs[free], commands[begins:ends], strengths[begins:ends],
            measured[free][begins:ends], readings[free], external[begins:ends], memories[free],
            spaces, room, judge,
        )  # fmt: skip
        rows += ticks * free
