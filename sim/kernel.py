# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
"""The tick.

At t = kT, before anything moves:
(1) the encoder reads m1's position (sensor effects, then its step);
(2) the velocity is estimated, by default (y_k - y_{k-1})/T, else by another of `sim/estimators`,
    every so many ticks where the interface says so, and held in between;
(3) the controller computes the command (a one-sided wall pulls never) from the position, which a
    slower outer loop renews every so many ticks only, and that velocity; where a force is measured,
    its feedback is added;
(4) amplifier effects: step, gain, dead band, limit, how fast a command is followed;
(5) the command enters the delay line and takes effect at kT + delay, held until the next one does
    (a delay that is no multiple of T changes the held value inside the tick, exactly);
(6) over [kT, (k+1)T) the chain moves in substeps.

A substep is exact for the linear part (propagator P, see `sim/equations.py`). Smooth forces are
held over the substep at the mean of their values at its start and at its predicted end, which is
second order. Dry friction is held too, at the force that stops the mass or at its bound, whichever
is less (a bound that varies with speed is taken as the mean of both ends), and where the mass turns
inside the substep at the mean of before and after, which is third order (`turn`); a mass at rest
whose load stays within the sticking bounds is locked, with a propagator of its own, and does not
move at all. A link with play that carries nothing has a propagator without it, and where it opens
or shuts inside the substep, it is held at a mean of third order too (`open_and_shut`). All forces
being held, the work of each is force times displacement, and the ledger closes to rounding.

Every part is written once, for one run and for many side by side (`sim/lane_type.py`): numbers are
floats, or lanes of a population whose members have the same structure and numbers of their own.
Twice stands only what lays numbers out for vector registers: alone, the rows of a propagator lie
side by side, in lanes the members (`sim/propagation.py`).

No fastmath, no `**`, no numpy reductions: the compiled loop equals this source bit for bit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.estimators.difference import DIFFERENCE
from zwidth.sim.estimators.dispatch import slope_of
from zwidth.sim.jit import jit, part
from zwidth.sim.lane_type import any_lane, greatest, least, root, select
from zwidth.sim.physics.backlash import is_hit, lets_go, pushed_side
from zwidth.sim.physics.command_step import quantise_command
from zwidth.sim.physics.dispatch import (
    INTEGRAL,
    amplified,
    delivered,
    force_over_states,
    friction_bounds,
    is_over_states,
    next_internal,
    sensed,
    smooth_force,
)
from zwidth.sim.physics.encoder_step import read_encoder
from zwidth.sim.physics.rate_limit import followed_at
from zwidth.sim.physics.saturation import limit_command
from zwidth.sim.propagation import Choice, add_column, at_once, choice, chosen, entry, propagate

Floats = NDArray[np.float64]

DONE, ESCAPED, NOT_FINITE = 0, 1, 2
MOTOR, WALL, DISTURBANCE, LAG, DAMPERS = 0, 1, 2, 3, 4
MAX_COLUMNS, MAX_MASSES = 32, 10
MAX_SWEEPS = 200
# Of scalars; EARLIER to GIVEN only where the interface has several rates or a second-order filter.
READ, VELOCITY, COMMAND, APPLIED, EARLIER, SLOPE, GIVEN, BEGAN, SCALARS = 0, 1, 2, 3, 4, 5, 6, 7, 8
LOWER, UPPER, LOWER_AT_REST, UPPER_AT_REST, LOCKED = 0, 1, 2, 3, 4  # rows of limits
# Rows of `turn`'s own: by how much a mass is off where it is, s f_0, and work left to be booked;
# then by how much it is off after play (`open_and_shut`).
OFF, SOONER, LEFT, PLAYED = 2, 3, 3, 5
SIDE, PIN = 0, 1  # of play: side that the link pushes on as a substep begins, pin as it ends


class Memory(NamedTuple):
    """All that survives a tick, changed in place; copy it to resume from here.

    x (32,): states, then held command and forces on the masses, which every substep writes anew;
    line (d + 2,) delay line; controller (its memory,); internal (force effects,); scalars (8 + m,):
    last reading, velocity estimate, last command, last applied, reading of the last estimate, slope
    of the filter, position that the law was given, time [s] of tick 0 since the run or the
    recording began, and what the velocity estimator remembers; counters (2,): tick, head of the
    line; totals (entries,) of the ledger.
    """

    x: Floats
    line: Floats
    controller: Floats
    internal: Floats
    scalars: Floats
    counters: NDArray[np.int64]
    totals: Floats


class Scratch(NamedTuple):
    """Working space of a run: what a substep keeps for those who ask after it.

    before (32,): states and inputs at its start; values, ahead (force effects,): smooth forces at
    its start (afterwards those held over it) and at its predicted end; after: internal states
    there; friction (10,) dry forces held; limits, own (5, 10), (6, 10): rows LOWER to LOCKED, of
    the masses and of what `turn` may add; more (10,) what it adds; shares (dry forces, 2): what
    each adds to lower and upper; play (gaps, 2): SIDE and PIN; choice: the propagators at work
    (`sim/propagation.py`).
    """

    before: Floats
    values: Floats
    ahead: Floats
    after: Floats
    friction: Floats
    limits: Floats
    own: Floats
    more: Floats
    shares: Floats
    play: Floats
    choice: Choice


@part
def across(x, offset, first, second):
    """Position (offset 0) or velocity (offset n) between two places; -1 is the ground."""
    if second < 0:
        return x[offset + first]
    return x[offset + first] - x[offset + second]


@part
def with_integral(eq, held, internal):
    """Return the held command plus the force of a loop's integral action."""
    table = eq.forces
    for e in range(table.codes.size):
        if table.codes[e] == INTEGRAL:
            held = held + internal[e]
    return held


@part
def time_at(eq, began, tick, segment, step):
    """Time at the beginning of a substep of a segment, where tick 0 was at `began`."""
    t = began + tick * eq.period
    if segment == 1:
        t += eq.substeps[0] * eq.durations[0]
    return t + step * eq.durations[segment]


@part
def held_forces(eq, x, held, whole, strength, tick, segment, step, memory, inside, values):
    """Value of each smooth force at state x under the held command; whole: `with_integral`.

    At the beginning of a substep; inside: internal states there.
    """
    table = eq.forces
    for e in range(table.codes.size):
        i, j = table.first[e], table.origin[e]
        q = across(x, 0, i, j)
        v = across(x, eq.dof, i, j)
        p = table.parameters[e]
        values[e] = smooth_force(table.codes[e], q, v, inside[e], held, whole, strength, p)
    forces_over_states(eq, x, held, tick, segment, step, memory, values)


@part
def forces_over_states(eq, x, held, tick, segment, step, memory, values):
    """Values of those that are laws over states, time among them.

    Separate from the others, and counted first: otherwise a run without any would be a tenth
    slower.
    """
    table = eq.forces
    count = 0
    for e in range(table.codes.size):
        count += is_over_states(table.codes[e])
    if count == 0:
        return
    for e in range(table.codes.size):
        if is_over_states(table.codes[e]):
            i, j = table.first[e], table.origin[e]
            q = across(x, 0, i, j)
            v = across(x, eq.dof, i, j)
            t = time_at(eq, memory.scalars[BEGAN], tick, segment, step)
            values[e] = force_over_states(table.codes[e], q, v, held, t, table.parameters[e])


@part
def load(eq, values, external, w):
    """Sum smooth and external forces into the force entries of w.

    Where the base moves (an acceleration a after the external forces), positions are counted from
    it, and every mass feels - m a.
    """
    start = eq.states + 1
    for i in range(eq.dof):
        w[start + i] = external[i] if external.size > 0 else 0.0
        if external.size > eq.dof:
            w[start + i] -= eq.masses[i] * external[eq.dof]
    table = eq.forces
    for e in range(table.codes.size):
        w[start + table.first[e]] += values[e]
        if table.second[e] >= 0:
            w[start + table.second[e]] -= values[e]


@part
def advance_internal(eq, x0, x1, internal, h, held, strength, after):
    """Internal states of the smooth forces after a substep from x0 to x1."""
    table = eq.forces
    n = eq.dof
    for e in range(table.codes.size):
        i, j = table.first[e], table.origin[e]
        after[e] = next_internal(
            table.codes[e], internal[e], across(x0, 0, i, j), across(x1, 0, i, j),
            across(x0, n, i, j), across(x1, n, i, j), h, held, strength, table.parameters[e],
        )  # fmt: skip


@part
def friction_limits(eq, x, held, strength, limits, shares):
    """Sum the bounds of all dry forces at each mass: rows lower, upper, sticking lower, upper."""
    table = eq.frictions
    for i in range(eq.dof):
        for row in range(LOCKED + 1):
            limits[row, i] = 0.0
    for e in range(table.codes.size):
        i = table.first[e]
        p = table.parameters[e]
        bounds = friction_bounds(table.codes[e], x[i], x[eq.dof + i], held, strength, p)
        limits[LOWER, i] += bounds[0]
        limits[UPPER, i] += bounds[1]
        limits[LOWER_AT_REST, i] += bounds[2]
        limits[UPPER_AT_REST, i] += bounds[3]
        shares[e, 0] = bounds[0]
        shares[e, 1] = bounds[1]


@part
def mean_friction_limits(eq, x, held, strength, limits, shares):
    """Replace the sliding bounds by the mean of those of `friction_limits` and those at state x."""
    for i in range(eq.dof):
        limits[LOWER, i] = 0.0
        limits[UPPER, i] = 0.0
    table = eq.frictions
    for e in range(table.codes.size):
        i = table.first[e]
        p = table.parameters[e]
        bounds = friction_bounds(table.codes[e], x[i], x[eq.dof + i], held, strength, p)
        shares[e, 0] = 0.5 * (shares[e, 0] + bounds[0])
        shares[e, 1] = 0.5 * (shares[e, 1] + bounds[1])
        limits[LOWER, i] += shares[e, 0]
        limits[UPPER, i] += shares[e, 1]


@part
def lock(eq, w, limits):
    """Mark the masses at rest whose load stays within their sticking bounds; return their set.

    A set is the sum of 2^i over its masses.
    """
    members = 0.0
    bit = 1.0
    for i in range(eq.dof):
        rests = (limits[UPPER_AT_REST, i] > limits[LOWER_AT_REST, i]) & (w[eq.dof + i] == 0.0)
        if any_lane(rests):
            force = 0.0
            for j in range(eq.columns):
                force += eq.reaction[i, j] * w[j]
            held = (limits[LOWER_AT_REST, i] <= -force) & (-force <= limits[UPPER_AT_REST, i])
            limits[LOCKED, i] = select(rests & held, 1.0, 0.0)
            members += bit * limits[LOCKED, i]
        bit *= 2.0
    return members


@part
def slides(limits, i):
    """Whether a mass has dry friction and is not locked."""
    return (limits[UPPER, i] > limits[LOWER, i]) & (limits[LOCKED, i] == 0.0)


@part
def slide(p, dof, states, limits, friction, x):
    """Dry forces on the masses that are not locked, and the state with them, in place.

    Velocities at the end are v = v_free + W f with W the response of end velocity to held force.
    Find f with v_i = 0 and f_i inside its bounds, or f_i at its bound and against v_i: a mixed
    complementarity problem, solved by projected Gauss-Seidel. W is symmetric (reciprocity) and, for
    h below half the period of the fastest mode, positive definite (`sim/equations.py` sees to it):
    f is the only minimum of f'Wf/2 + f'v_free over the bounds, and every step of a sweep is the
    exact minimum in one force, so the sweeps converge from anywhere. One mass needs a single sweep
    and is exact. A lane that has converged does not change while others continue.
    """
    column = states + 1
    sliding = 0.0
    for i in range(dof):
        friction[i] = 0.0
        sliding += select(slides(limits, i), 1.0, 0.0)
    moving = sliding > 0.0
    if not any_lane(moving):
        return
    for _ in range(MAX_SWEEPS):
        change = 0.0
        for i in range(dof):
            free = slides(limits, i) & moving
            if any_lane(free):
                row = dof + i
                v = x[row]
                for j in range(dof):
                    if j != i:
                        v += entry(p, row, column + j) * friction[j]
                f = -v / entry(p, row, column + i)
                f = greatest(limits[LOWER, i], least(limits[UPPER, i], f))
                f = select(free, f, friction[i])
                wide = select(free, limits[UPPER, i] - limits[LOWER, i], 1.0)
                change = greatest(change, select(free, abs(f - friction[i]) / wide, 0.0))
                friction[i] = f
        moving = moving & (sliding > 1.0) & (change >= 1e-14)
        if not any_lane(moving):
            break
    for j in range(dof):
        if any_lane(friction[j] != 0.0):
            add_column(p, column + j, friction[j], x)
    for i in range(dof):
        stopped = (limits[LOWER, i] < friction[i]) & (friction[i] < limits[UPPER, i])
        x[dof + i] = select(stopped, 0.0, x[dof + i])


@part
def turn(p, h, dof, states, limits, friction, x0, x, own, more):
    """Give each mass that turned or stopped inside the substep its old friction until then.

    Of a substep that begins with v_0 under the bound f_0 against it and would end with v_1 on the
    other side, s passes before v = 0. With v a parabola in time that moves the mass as far as f_0
    would, by d,

        v_0 + s (v_1 - v_0) + c s (1 - s) = 0,    c = 6 (d / h - (v_0 + v_1) / 2),

    of whose roots one lies between: s = 2 v_0 / (b +- sqrt(b^2 + 4 c v_0)), b = v_0 - v_1 - c, with
    the sign of v_0. Held over the substep, the mean s f_0 + (1 - s) f, f within its bounds, does
    what f_0 and then f would: the bounds shrink towards f_0, and the same complementarity problem
    is solved again for what is to be added. Without this a turn is late by half a substep on
    average; with v a line (c = 0) four substeps are six times as far off on a light chain. What
    acts early is in part forgotten by the end, in a fluid or on a spring: where an impulse leaves
    1 - a t / h of its speed after t, a held force moves the mass by Q and changes its speed by V,

        Q / (h V) = (1 / 2 - a / 6) / (1 - a / 2),    a = 12 (Q / (h V) - 1 / 2) to first order,

    and f_0 counts s - a s (1 - s) / 2 of the substep.

    What the mean does not do is to put the mass where it would be, since f_0 came first. From the
    impulses of either, x_1 = int_0^h (h - t) f(t) dt / m, it is off by

        h^2 / (2 m) [s (2 - s) f_0 + (1 - s)^2 f_1 - f] = h^2 / (2 m) s (f_0 - f),

    f = s f_0 + (1 - s) f_1 the mean, and f_1 what acts after the turn: the bound, or what holds a
    mass that stops. h^2 / (2 m) is the response of a position to a held force. It stands in `own`
    for `placed`, since the ledger books the work of what was held over what was moved by it.
    """
    turned = False
    for i in range(dof):
        row = dof + i
        free = slides(limits, i)
        own[LOCKED, i] = limits[LOCKED, i]
        own[LOWER, i] = 0.0
        own[UPPER, i] = 0.0
        own[OFF, i] = 0.0
        own[SOONER, i] = 0.0
        if any_lane(free):
            f, v = friction[i], x0[row]
            low, high = limits[LOWER, i], limits[UPPER, i]
            before = select(v > 0.0, low, high)
            speeds = entry(p, row, states + 1 + i)
            end = x[row] + speeds * (before - f)
            turns = free & (v != 0.0) & (f != before) & (end * v < 0.0)
            if any_lane(turns):
                moves = entry(p, i, states + 1 + i)
                went = x[i] + moves * (before - f) - x0[i]
                bend = 6.0 * (went / h - 0.5 * (v + end))
                falls = v - end - bend
                wide = root(greatest(0.0, falls * falls + 4.0 * bend * v))
                share = 2.0 * v / select(turns, falls + select(v > 0.0, wide, -wide), 1.0)
                own[OFF, i] = select(turns, share, 0.0)
                own[SOONER, i] = select(turns, share * before, 0.0)
                share -= (6.0 * moves / (h * speeds) - 3.0) * share * (1.0 - share)
                then = share * before
                low = select(turns, then + (1.0 - share) * low, low)
                high = select(turns, then + (1.0 - share) * high, high)
                turned = turned | turns
            own[LOWER, i] = select(free, low - f, 0.0)
            own[UPPER, i] = select(free, high - f, 0.0)
    if any_lane(turned):
        for i in range(dof):
            own[LOWER, i] = select(turned, own[LOWER, i], 0.0)
            own[UPPER, i] = select(turned, own[UPPER, i], 0.0)
        slide(p, dof, states, own, more, x)
        for i in range(dof):
            friction[i] += more[i]
            off = own[SOONER, i] - own[OFF, i] * friction[i]
            own[OFF, i] = entry(p, i, states + 1 + i) * off


@part
def let_go(eq, h, values, w, play):
    """Open the links with play that carry nothing as a substep begins: their set, and the next bit.

    What is taken from them is no force then, but a propagator without them.
    """
    links = 0.0
    bit = 1.0
    for g in range(eq.gaps.size):
        e = eq.gaps[g]
        i, j = eq.forces.first[e], eq.forces.second[e]
        q, v = across(w, 0, i, j), across(w, eq.dof, i, j)
        side = pushed_side(q, v, play[g, PIN], h, eq.forces.parameters[e])
        shut = side != 0.0
        values[e] = select(shut, values[e], 0.0)
        play[g, SIDE] = side
        links += select(shut, 0.0, bit)
        bit *= 2.0
    return links, bit


@part
def open_and_shut(eq, p, h, x0, x1, pins, values, own, play):
    """Hold what links with play take at its mean, where one opens or shuts in the substep.

    From x_0 to x_1, where it would be if none did (`lets_go`, `is_hit`); a push that began late
    moved the masses less than the same held throughout, by which they are off afterwards.
    """
    for i in range(eq.dof):
        own[PLAYED, i] = 0.0
    for g in range(eq.gaps.size):
        e = eq.gaps[g]
        i, j = eq.forces.first[e], eq.forces.second[e]
        q0, v0 = across(x0, 0, i, j), across(x0, eq.dof, i, j)
        q1, v1 = across(x1, 0, i, j), across(x1, eq.dof, i, j)
        numbers = eq.forces.parameters[e]
        side = play[g, SIDE]
        shut = side != 0.0
        first, second = eq.states + 1 + i, eq.states + 1 + j
        yields = (entry(p, eq.dof + i, first) + entry(p, eq.dof + j, second)) / h
        taken, pin = lets_go(q0, v0, q1, v1, h, side, numbers)
        pushed, late, end = is_hit(q0, v0, pins[e], q1, v1, h, yields, numbers)
        values[e] = select(shut, taken, pushed)
        play[g, PIN] = select(shut, pin, end)
        late = select(shut, 0.0, late)
        own[PLAYED, i] += entry(p, i, first) * late
        own[PLAYED, j] -= entry(p, j, second) * late


@part
def placed(eq, x, own):
    """Put masses where they are that turned, or were hit, inside the last substep, in place."""
    for row in (OFF, PLAYED):
        if (eq.frictions.codes.size if row == OFF else eq.gaps.size) > 0:
            for i in range(eq.dof):
                if any_lane(own[row, i] != 0.0):
                    x[i] = x[i] + own[row, i]
                    own[row, i] = 0.0 * own[row, i]


@part
def place_booked(eq, members, w, x, own, row):
    """Do the same of one row, and return what of the springs' energy no held force w brought.

    It is of third order. Of each mass that turned it stands in `own` too, for `share_friction`.
    """
    start = eq.states + 1
    left = 0.0
    for i in range(eq.dof):
        by = own[row, i]
        if row == OFF:
            own[LEFT, i] = 0.0
        if by != 0.0:
            push = w[start + i]
            if i == 0 and not eq.lagging:
                push += w[eq.states]
            before = stored_energy(eq, x) - open_energy(eq, members, x)
            x[i] += by
            gained = stored_energy(eq, x) - open_energy(eq, members, x) - before - push * by
            left += gained
            if row == OFF:
                own[LEFT, i] = gained
            own[row, i] = 0.0
    return left


@part
def open_energy(eq, members, x):
    """Energy [J] that the springs of links with no load would have."""
    energy = 0.0
    for g in range(eq.gaps.size):
        if int(members) >> g & 1 == 1:
            e = eq.gaps[g]
            q = across(x, 0, eq.forces.first[e], eq.forces.second[e])
            energy += 0.5 * eq.forces.parameters[e, 1] * q * q
    return energy


@part
def substep(eq, tick, segment, step, held, strength, external, memory, scratch):
    """Advance the chain by a substep of a segment under a held command; return the locked set.

    strength: how much of the drive's force counts in this tick. A loop on the position is linear
    at full strength and its `servo_limit` takes off what is less; else it scales what is held.

    A first look goes with the forces at the start; where they depend on the state, a second one
    with the mean of those and the ones at the end of the first.
    """
    before, values, ahead, after = scratch.before, scratch.values, scratch.ahead, scratch.after
    limits, shares, friction = scratch.limits, scratch.shares, scratch.friction
    x, internal = memory.x, memory.internal
    h = eq.durations[segment]
    dry = eq.frictions.codes.size > 0
    columns = eq.columns if values.size + external.size > 0 else eq.states + 1
    members = 0.0
    which = 0
    for g in range(eq.gaps.size):
        scratch.play[g, PIN] = internal[eq.gaps[g]]
    x[eq.states] = held if eq.looped else strength * held
    for j in range(eq.states + 1):
        before[j] = x[j]
    for look in range(2 if values.size > 0 or eq.bounds_vary else 1):
        inside = internal if look == 0 else after
        whole = with_integral(eq, held, inside)
        there = step + look
        held_forces(eq, x, held, whole, strength, tick, segment, there, memory, inside, ahead)
        for e in range(values.size):
            values[e] = ahead[e] if look == 0 else 0.5 * (values[e] + ahead[e])
        if look == 1 and eq.gaps.size > 0:
            p = eq.propagators[segment, which]
            open_and_shut(eq, p, h, before, x, internal, values, scratch.own, scratch.play)
        load(eq, values, external, before)
        if look == 0:
            if dry:
                friction_limits(eq, before, whole, strength, limits, shares)
                members = lock(eq, before, limits)
            if eq.gaps.size > 0:
                links, bit = let_go(eq, h, values, before, scratch.play)
                load(eq, values, external, before)
                members = links + bit * members
            which = chosen(eq, segment, members, scratch.choice)
        elif eq.bounds_vary:
            mean_friction_limits(eq, x, whole, strength, limits, shares)
        p = eq.propagators[segment, which]
        propagate(p, before, columns, x)
        if dry:
            slide(p, eq.dof, eq.states, limits, friction, x)
            turn(p, h, eq.dof, eq.states, limits, friction, before, x, scratch.own, scratch.more)
        advance_internal(eq, before, x, internal, h, held, strength, after)
    for g in range(eq.gaps.size):
        after[eq.gaps[g]] = scratch.play[g, PIN]
    for e in range(values.size):
        internal[e] = after[e]
    return members


@part
def add_work(eq, segment, members, external, x1, scratch, totals):
    """Add the last substep, to x1: motor, lag and dampers by their forms, the rest f dq.

    Masses that turned are put where they are first (`place_booked`), in place.
    """
    w, values, friction = scratch.before, scratch.values, scratch.friction
    n = eq.columns
    start = eq.states + 1
    for i in range(eq.dof):
        w[start + i] += friction[i]
    if eq.frictions.codes.size > 0:
        place_booked(eq, members, w, x1, scratch.own, OFF)
    left = 0.0
    if eq.gaps.size > 0:
        left = place_booked(eq, members, w, x1, scratch.own, PLAYED)
    forms = eq.quadratics[segment, int(members)]
    for e in range(forms.shape[0]):
        if e == 0 and not eq.lagging:
            totals[MOTOR] += w[eq.states] * (x1[0] - w[0])
            continue
        total = 0.0
        for i in range(n):
            row = 0.0
            for j in range(n):
                row += forms[e, i, j] * w[j]
            total += w[i] * row
        if e == 0:
            totals[MOTOR] += total
        elif e == 1:
            totals[LAG] += total
        else:
            totals[DAMPERS + e - 2] += total
    slot = DAMPERS + forms.shape[0] - 2
    for i in range(eq.dof if external.size > 0 else 0):
        force = external[i]
        if external.size > eq.dof:
            force -= eq.masses[i] * external[eq.dof]
        totals[DISTURBANCE] += force * (x1[i] - w[i])
    table = eq.forces
    for e in range(table.codes.size):
        i, j = table.first[e], table.second[e]
        totals[slot + e] -= values[e] * (across(x1, 0, i, j) - across(w, 0, i, j))
    if eq.gaps.size > 0:
        totals[slot + eq.gaps[0]] -= left
    for g in range(eq.gaps.size):
        e, bit = eq.gaps[g], 1 << g
        one = int(members) & bit
        totals[slot + e] -= open_energy(eq, one, x1) - open_energy(eq, one, w)
    slot += table.codes.size
    share_friction(eq, w, x1, friction, scratch, totals, slot)


@part
def share_friction(eq, x0, x1, friction, scratch, totals, slot):
    """Dissipation of each dry force; several at one mass share it by their bounds."""
    table, limits, shares = eq.frictions, scratch.limits, scratch.shares
    for e in range(table.codes.size):
        i = table.first[e]
        f = friction[i]
        if f != 0.0:
            side = 1 if f > 0.0 else 0
            work = f * (x1[i] - x0[i]) + scratch.own[LEFT, i]
            totals[slot + e] -= work * shares[e, side] / limits[side, i]


@part
def stored_energy(eq, x):
    """Kinetic energy of the masses plus energy of the springs [J]."""
    energy = 0.0
    for i in range(eq.dof):
        v = x[eq.dof + i]
        energy += 0.5 * eq.masses[i] * v * v
    for s in range(eq.spring_stiffness.size):
        q = across(x, 0, eq.springs[s, 0], eq.springs[s, 1])
        energy += 0.5 * eq.spring_stiffness[s] * q * q
    return energy


@part
def at_rest(eq, x):
    """Bit mask of the masses whose velocity is exactly zero."""
    mask = 0
    for i in range(eq.dof):
        if x[eq.dof + i] == 0.0:
            mask |= 1 << i
    return mask


@part
def read_sensor(eq, position):
    """Step (1): what the encoder reports of a position."""
    for e in range(eq.sensors.codes.size):
        position = sensed(eq.sensors.codes[e], position, eq.sensors.parameters[e])
    return read_encoder(position, eq.encoder_step, eq.encoder_floor)


@part
def read_position(eq, position):
    """Return what the encoder reports, counted from its own origin."""
    return read_sensor(eq, position) + eq.position_origin


@part
def estimate(eq, tick, y, y_before, v, scalars):
    """Step (2): the velocity estimate at this tick, from the one before (`Interface`)."""
    if eq.velocity_ticks == 1 or tick % eq.velocity_ticks == 0:
        if eq.velocity_ticks > 1:
            y_before = scalars[EARLIER]
            scalars[EARLIER] = y
        if eq.estimator == DIFFERENCE:
            slope = y - y_before
        else:
            slope = slope_of(
                eq.estimator, eq.window, eq.estimating, tick // eq.velocity_ticks, y, scalars,
                SCALARS,
            )  # fmt: skip
        e = slope * eq.rate - v
        if eq.second_order:
            turn = scalars[SLOPE]
            v += eq.smoothing * e + eq.filter[0] * turn
            scalars[SLOPE] = eq.filter[1] * e + eq.filter[2] * turn
        else:
            v += eq.smoothing * e
    return v


@part
def told(eq, v):
    """Step (3): the velocity that the law is given, in the steps of the register that holds it."""
    return quantise_command(v, eq.velocity_step)


@part
def given(eq, tick, y, scalars):
    """Step (3): the position that the law is given at this tick."""
    if eq.position_ticks == 1:
        return y
    if tick % eq.position_ticks == 0:
        scalars[GIVEN] = y
    return scalars[GIVEN]


@part
def fed_back(eq, x, command):
    """Add the feedback of the measured force to what the law commands (`sim/force_sensor.py`)."""
    if eq.force_row.shape[0] == 0:
        return command
    force = 0.0
    for i in range(eq.force_row.shape[0]):
        force += eq.force_row[i] * x[i]
    return command + eq.force_gain * (command - force)


@part
def amplify(eq, command, last, begins):
    """Step (4): step, gain, further amplifier effects in the order of their declaration, limit.

    Then how fast the last command is left; begins: there is none.
    """
    command = quantise_command(command, eq.command_step) * eq.command_gain
    for e in range(eq.amplifiers.codes.size):
        command = amplified(eq.amplifiers.codes[e], command, eq.amplifiers.parameters[e])
    command = limit_command(command, eq.command_limit)
    return command if begins else followed_at(command, last, eq.command_rate)


@part
def arrives(eq, tick):
    """Whether the command of this tick is delivered (clock effects)."""
    there = True
    for e in range(eq.clocks.codes.size):
        there = there & delivered(eq.clocks.codes[e], tick, eq.clocks.parameters[e])
    return there


@jit
def advance(
    eq, controller, parameters, memory, scratch, ticks, external, bound, record, fine, energy
):
    """Run up to `ticks` ticks from memory; return (ticks done, status).

    external (ticks, n) held forces, (ticks, n + 1) with the acceleration of the base after them, or
    (0, n); bound: stop when |x_1| exceeds it. record
    (ticks, channels) or (0, ...): states, encoder, velocity estimate, command, applied force,
    contact, masses at rest, stored energy (with `energy`), ledger totals; each row at t = kT, after
    steps (1) to (5). fine: states after every substep, (ticks x substeps, states) or (0, ...).
    """
    x = memory.x
    line = memory.line
    scalars = memory.scalars
    no_force = scratch.before[:0]
    last = line.size - 1
    # With nothing but the linear part, a substep is P alone.
    linear = (
        eq.forces.codes.size == 0 and eq.frictions.codes.size == 0 and external.shape[0] == 0
        and memory.totals.size == 0 and at_once(eq.propagators[0, 0])
    )  # fmt: skip
    y_before, v, u = scalars[0], scalars[1], scalars[2]
    head = memory.counters[1]
    tick = memory.counters[0]
    row = 0
    status = DONE
    done = 0
    while done < ticks:
        y = read_position(eq, x[eq.read])
        v = estimate(eq, tick, y, y_before, v, scalars)
        if memory.totals.size > 0:
            memory.totals[WALL] += u * (y - y_before)
        y_before = y
        at = given(eq, tick, y, scalars)
        speed = told(eq, v)
        wanted = controller(tick, tick * eq.period, at, speed, parameters, memory.controller)
        wanted = fed_back(eq, x, wanted)
        u = select(arrives(eq, tick), amplify(eq, wanted, u, False), u)
        line[head] = u
        head = 0 if head == last else head + 1
        earlier = line[head]
        current = line[0 if head == last else head + 1]
        if record.shape[0] > 0:
            scalars[0], scalars[1], scalars[2] = y, v, u
            if eq.lagging:
                scalars[3] = x[eq.states - 1]
            else:
                scalars[3] = earlier if eq.substeps[0] > 0 else current
            write(eq, memory, energy, record[done])
        for segment in range(2):
            held = earlier if segment == 0 else current
            for step in range(eq.substeps[segment]):
                if linear:
                    x[eq.states] = held
                    propagate(eq.propagators[segment, 0], x, eq.states + 1, x)
                else:
                    force = external[done] if external.shape[0] > 0 else no_force
                    members = substep(eq, tick, segment, step, held, 1.0, force, memory, scratch)
                    if memory.totals.size > 0:
                        add_work(eq, segment, members, force, x, scratch, memory.totals)
                    placed(eq, x, scratch.own)
                if fine.shape[0] > 0:
                    for i in range(eq.states):
                        fine[row, i] = x[i]
                    row += 1
        tick += 1
        done += 1
        if not abs(x[0]) <= bound:
            status = NOT_FINITE if x[0] != x[0] else ESCAPED
            break
    scalars[0], scalars[1], scalars[2] = y_before, v, u
    memory.counters[0] = tick
    memory.counters[1] = head
    return done, status


@part
def write(eq, memory, energy, row):
    """Write one row of the record: everything known at t = kT."""
    n = eq.states
    for i in range(n):
        row[i] = memory.x[i]
    row[n] = memory.scalars[0]
    row[n + 1] = told(eq, memory.scalars[1])
    row[n + 2] = memory.scalars[2]
    row[n + 3] = memory.scalars[3]
    row[n + 4] = memory.controller[0]
    row[n + 5] = at_rest(eq, memory.x)
    if energy:
        row[n + 6] = stored_energy(eq, memory.x)
        for e in range(memory.totals.size):
            row[n + 7 + e] = memory.totals[e]


def scratch(eq):
    """Working space of one run."""
    n = eq.forces.codes.size
    return Scratch(
        np.zeros(MAX_COLUMNS), np.zeros(n), np.zeros(n), np.zeros(n),
        np.zeros(MAX_MASSES), np.zeros((LOCKED + 1, MAX_MASSES)),
        np.zeros((PLAYED + 1, MAX_MASSES)), np.zeros(MAX_MASSES),
        np.zeros((eq.frictions.codes.size, 2)), np.zeros((eq.gaps.size, 2)), choice(),
    )  # fmt: skip
