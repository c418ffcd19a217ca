# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
"""The tick.

At t = kT, before anything moves:
(1) the encoder reads m1's position (sensor effects, then its step);
(2) the velocity is estimated, by default (y_k - y_{k-1})/T;
(3) the controller computes the command (a one-sided wall pulls never);
(4) amplifier effects: step, dead band, gain, limit;
(5) the command enters the delay line and takes effect at kT + delay, held until the next one does
    (a delay that is no multiple of T changes the held value inside the tick, exactly);
(6) over [kT, (k+1)T) the chain moves in substeps.

A substep is exact for the linear part (propagator P, see `sim/equations.py`). Smooth forces are
held over the substep at the mean of their values at its start and at its predicted end, which is
second order. Dry friction is held too, at the force that stops the mass or at its bound, whichever
is less (a bound that varies with speed is taken as the mean of both ends), and where the mass turns
inside the substep at the mean of before and after, which is second order as well; a mass at rest
whose load stays within the sticking bounds is locked, with a propagator of its own, and does not
move at all. All forces being held, the work of each is force times
displacement, and the ledger closes to rounding.

No fastmath, no `**`, no numpy reductions: the compiled loop equals this source bit for bit.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.jit import jit, part
from zwidth.sim.physics.command_step import quantise_command
from zwidth.sim.physics.dispatch import (
    amplified,
    delivered,
    friction_bounds,
    next_internal,
    sensed,
    smooth_force,
)
from zwidth.sim.physics.encoder_step import read_encoder
from zwidth.sim.physics.saturation import limit_command

Floats = NDArray[np.float64]

DONE, ESCAPED, NOT_FINITE = 0, 1, 2
MOTOR, WALL, DISTURBANCE, LAG, DAMPERS = 0, 1, 2, 3, 4
MAX_COLUMNS, MAX_MASSES = 32, 8
MAX_SWEEPS = 200


class Memory(NamedTuple):
    """All that survives a tick, changed in place; copy it to resume from here.

    x (32,): states, then held command and forces on the masses, which every substep writes anew;
    line (d + 2,) delay line; controller (its memory,); internal (force effects,); scalars (4,):
    last reading, velocity estimate, last command, last applied; counters (2,): tick, head of the
    line; totals (entries,) of the ledger.
    """

    x: Floats
    line: Floats
    controller: Floats
    internal: Floats
    scalars: Floats
    counters: NDArray[np.int64]
    totals: Floats


@part
def propagate(p, w, columns, x):
    """Set x = P w, eight rows at a time; the sums run over the columns in order.

    x may be w where P has one block of rows: all of w is read before x is written.
    """
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
def across(x, offset, first, second):
    """Position (offset 0) or velocity (offset n) between two places; -1 is the ground."""
    if second < 0:
        return x[offset + first]
    return x[offset + first] - x[offset + second]


@part
def held_forces(eq, x, internal, values):
    """Value of each smooth force at state x."""
    table = eq.forces
    for e in range(table.codes.size):
        i, j = table.first[e], table.second[e]
        q = across(x, 0, i, j)
        v = across(x, eq.dof, i, j)
        values[e] = smooth_force(table.codes[e], q, v, internal[e], table.parameters[e])


@part
def load(eq, values, external, w):
    """Sum smooth and external forces into the force entries of w."""
    start = eq.states + 1
    for i in range(eq.dof):
        w[start + i] = external[i] if external.size > 0 else 0.0
    table = eq.forces
    for e in range(table.codes.size):
        w[start + table.first[e]] += values[e]
        if table.second[e] >= 0:
            w[start + table.second[e]] -= values[e]


@part
def advance_internal(eq, x0, x1, internal, h, after):
    """Internal states of the smooth forces after a substep from x0 to x1."""
    table = eq.forces
    n = eq.dof
    for e in range(table.codes.size):
        i, j = table.first[e], table.second[e]
        after[e] = next_internal(
            table.codes[e], internal[e], across(x0, 0, i, j), across(x1, 0, i, j),
            across(x0, n, i, j), across(x1, n, i, j), h, table.parameters[e],
        )  # fmt: skip


@part
def friction_limits(eq, x, limits, shares):
    """Sum the bounds of all dry forces at each mass: rows lower, upper, sticking lower, upper.

    shares (dry forces, 2): what each adds to lower and upper.
    """
    table = eq.frictions
    for i in range(eq.dof):
        lower = upper = lower_at_rest = upper_at_rest = 0.0
        for e in range(table.codes.size):
            if table.first[e] == i:
                bounds = friction_bounds(table.codes[e], x[eq.dof + i], table.parameters[e])
                lower += bounds[0]
                upper += bounds[1]
                lower_at_rest += bounds[2]
                upper_at_rest += bounds[3]
                shares[e, 0] = bounds[0]
                shares[e, 1] = bounds[1]
        limits[0, i] = lower
        limits[1, i] = upper
        limits[2, i] = lower_at_rest
        limits[3, i] = upper_at_rest


@part
def mean_friction_limits(eq, x, limits, shares):
    """Replace the sliding bounds by the mean of those of `friction_limits` and those at state x."""
    limits[:2, :] = 0.0
    table = eq.frictions
    for e in range(table.codes.size):
        i = table.first[e]
        bounds = friction_bounds(table.codes[e], x[eq.dof + i], table.parameters[e])
        for row in range(2):
            shares[e, row] = 0.5 * (shares[e, row] + bounds[row])
            limits[row, i] += shares[e, row]


@part
def locked_set(eq, w, limits):
    """Bit mask of the masses at rest whose load stays within their sticking bounds."""
    mask = 0
    for i in range(eq.dof):
        if limits[3, i] > limits[2, i] and w[eq.dof + i] == 0.0:
            force = 0.0
            for j in range(eq.columns):
                force += eq.reaction[i, j] * w[j]
            if limits[2, i] <= -force <= limits[3, i]:
                mask |= 1 << i
    return mask


@part
def slide(p, dof, states, mask, limits, friction, x):
    """Dry forces on the masses that are not locked, and the state with them, in place.

    Velocities at the end are v = v_free + W f with W the response of end velocity to held force.
    Find f with v_i = 0 and f_i inside its bounds, or f_i at its bound and against v_i: a mixed
    complementarity problem, solved by projected Gauss-Seidel. W is symmetric (reciprocity) and, for
    h below half the period of the fastest mode, positive definite (`sim/equations.py` sees to it):
    f is the only minimum of f'Wf/2 + f'v_free over the bounds, and every step of a sweep is the
    exact minimum in one force, so the sweeps converge from anywhere. One mass needs a single sweep
    and is exact.
    """
    column = states + 1
    sliding = 0
    for i in range(dof):
        friction[i] = 0.0
        if limits[1, i] > limits[0, i] and not mask >> i & 1:
            sliding += 1
    if sliding == 0:
        return
    for _ in range(MAX_SWEEPS):
        change = 0.0
        for i in range(dof):
            if limits[1, i] > limits[0, i] and not mask >> i & 1:
                row = dof + i
                v = x[row]
                for j in range(dof):
                    if friction[j] != 0.0 and j != i:
                        v += p[row // 8, column + j, row % 8] * friction[j]
                f = -v / p[row // 8, column + i, row % 8]
                f = max(limits[0, i], min(limits[1, i], f))
                change = max(change, abs(f - friction[i]) / (limits[1, i] - limits[0, i]))
                friction[i] = f
        if sliding == 1 or change < 1e-14:
            break
    for j in range(dof):
        if friction[j] != 0.0:
            for block in range(p.shape[0]):
                for r in range(8):
                    x[8 * block + r] += p[block, column + j, r] * friction[j]
    for i in range(dof):
        if limits[0, i] < friction[i] < limits[1, i]:
            x[dof + i] = 0.0


@part
def turn(p, dof, states, mask, limits, friction, x0, x, own, more):
    """Give each mass that turned or stopped inside the substep its old friction until then.

    Of a substep that begins with v_0 under the bound f_0 against it and would end with v_1 on the
    other side, v_0 / (v_0 - v_1) = s passes before v = 0 (v linear in time). Held over the
    substep, the mean s f_0 + (1 - s) f, f within its bounds, does what f_0 and then f would: the
    bounds shrink towards f_0, and the same complementarity problem is solved again for what is to
    be added. Without this a turn is late by half a substep on average, with it second order.
    """
    turned = False
    for i in range(dof):
        own[0, i] = own[1, i] = more[i] = 0.0
        v = x0[dof + i]
        if limits[1, i] > limits[0, i] and not mask >> i & 1:
            f, row = friction[i], dof + i
            own[0, i] = limits[0, i] - f
            own[1, i] = limits[1, i] - f
            if v != 0.0:
                before = limits[0, i] if v > 0.0 else limits[1, i]
                end = x[row] + p[row // 8, states + 1 + i, row % 8] * (before - f)
                if f != before and end * v < 0.0:
                    share = v / (v - end)
                    own[0, i] = share * before + (1.0 - share) * limits[0, i] - f
                    own[1, i] = share * before + (1.0 - share) * limits[1, i] - f
                    turned = True
    if turned:
        slide(p, dof, states, mask, own, more, x)
        for i in range(dof):
            friction[i] += more[i]


@part
def add_work(eq, segment, mask, w, x1, values, external, friction, limits, shares, totals):
    """Add one substep from w to x1: motor, lag and dampers by their forms, the rest f dq."""
    n = eq.columns
    start = eq.states + 1
    for i in range(eq.dof):
        w[start + i] += friction[i]
    forms = eq.quadratics[segment, mask]
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
    for i in range(external.size):
        totals[DISTURBANCE] += external[i] * (x1[i] - w[i])
    table = eq.forces
    for e in range(table.codes.size):
        i, j = table.first[e], table.second[e]
        totals[slot + e] -= values[e] * (across(x1, 0, i, j) - across(w, 0, i, j))
    slot += table.codes.size
    share_friction(eq, w, x1, friction, limits, shares, totals, slot)


@part
def share_friction(eq, x0, x1, friction, limits, shares, totals, slot):
    """Dissipation of each dry force; several at one mass share it by their bounds."""
    table = eq.frictions
    for e in range(table.codes.size):
        i = table.first[e]
        f = friction[i]
        if f != 0.0:
            side = 1 if f > 0.0 else 0
            totals[slot + e] -= f * shares[e, side] / limits[side, i] * (x1[i] - x0[i])


@part
def substep(eq, segment, held, external, memory, scratch):
    """Advance the chain by one substep of a segment under a held command.

    P is applied where the state lies; the state before is kept only for those who ask for it.
    """
    before, values, ahead, after, friction, limits, shares, own, more = scratch
    x = memory.x
    x[eq.states] = held
    held_forces(eq, x, memory.internal, values)
    load(eq, values, external, x)
    mask = 0
    dry = eq.frictions.codes.size > 0
    if dry:
        friction_limits(eq, x, limits, shares)
        mask = locked_set(eq, x, limits)
    p = eq.propagators[segment, mask]
    columns = eq.columns if values.size + external.size > 0 else eq.states + 1
    again = values.size > 0 or eq.bounds_vary
    if again or dry or memory.totals.size > 0 or p.shape[0] > 1:
        for j in range(eq.columns):
            before[j] = x[j]
        propagate(p, before, columns, x)
    else:
        propagate(p, x, columns, x)
    slide(p, eq.dof, eq.states, mask, limits, friction, x)
    if dry:
        turn(p, eq.dof, eq.states, mask, limits, friction, before, x, own, more)
    if again:
        h = eq.durations[segment]
        advance_internal(eq, before, x, memory.internal, h, after)
        held_forces(eq, x, after, ahead)
        if eq.bounds_vary:
            mean_friction_limits(eq, x, limits, shares)
        for e in range(values.size):
            values[e] = 0.5 * (values[e] + ahead[e])
        load(eq, values, external, before)
        propagate(p, before, columns, x)
        slide(p, eq.dof, eq.states, mask, limits, friction, x)
        if dry:
            turn(p, eq.dof, eq.states, mask, limits, friction, before, x, own, more)
        advance_internal(eq, before, x, memory.internal, h, after)
        for e in range(values.size):
            memory.internal[e] = after[e]
    if memory.totals.size > 0:
        add_work(
            eq, segment, mask, before, x, values, external, friction, limits, shares,
            memory.totals,
        )  # fmt: skip


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
def amplify(eq, command):
    """Step (4): step, further amplifier effects in the order of their declaration, limit."""
    command = quantise_command(command, eq.command_step)
    for e in range(eq.amplifiers.codes.size):
        command = amplified(eq.amplifiers.codes[e], command, eq.amplifiers.parameters[e])
    return limit_command(command, eq.command_limit)


@part
def arrives(eq, tick):
    """Whether the command of this tick is delivered (clock effects)."""
    for e in range(eq.clocks.codes.size):
        if not delivered(eq.clocks.codes[e], tick, eq.clocks.parameters[e]):
            return False
    return True


@jit
def advance(
    eq, controller, parameters, memory, scratch, ticks, external, bound, record, fine, energy
):
    """Run up to `ticks` ticks from memory; return (ticks done, status).

    external (ticks, n) held forces, or (0, n); bound: stop when |x_1| exceeds it. record
    (ticks, channels) or (0, ...): states, encoder, velocity estimate, command, applied force,
    contact, masses at rest, stored energy (with `energy`), ledger totals; each row at t = kT, after
    steps (1) to (5). fine: states after every substep, (ticks x substeps, states) or (0, ...).
    """
    x = memory.x
    line = memory.line
    scalars = memory.scalars
    no_force = scratch[0][:0]
    last = line.size - 1
    # With nothing but the linear part, a substep is P alone.
    linear = (
        eq.forces.codes.size == 0 and eq.frictions.codes.size == 0 and external.shape[0] == 0
        and memory.totals.size == 0 and eq.propagators.shape[2] == 1
    )  # fmt: skip
    y_before, v, u = scalars[0], scalars[1], scalars[2]
    head = memory.counters[1]
    tick = memory.counters[0]
    row = 0
    status = DONE
    done = 0
    while done < ticks:
        y = read_sensor(eq, x[0])
        v += eq.smoothing * ((y - y_before) * eq.rate - v)
        if memory.totals.size > 0:
            memory.totals[WALL] += u * (y - y_before)
        y_before = y
        wanted = controller(tick, tick * eq.period, y, v, parameters, memory.controller)
        if arrives(eq, tick):
            u = amplify(eq, wanted)
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
            for _ in range(eq.substeps[segment]):
                if linear:
                    x[eq.states] = held
                    propagate(eq.propagators[segment, 0], x, eq.states + 1, x)
                else:
                    force = external[done] if external.shape[0] > 0 else no_force
                    substep(eq, segment, held, force, memory, scratch)
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
    row[n + 1] = memory.scalars[1]
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
    return (
        np.zeros(MAX_COLUMNS), np.zeros(n), np.zeros(n), np.zeros(n),
        np.zeros(MAX_MASSES), np.zeros((4, MAX_MASSES)), np.zeros((eq.frictions.codes.size, 2)),
        np.zeros((2, MAX_MASSES)), np.zeros(MAX_MASSES),
    )  # fmt: skip
