"""Many runs under built-in walls, and what is kept of each window of ticks in place of its trace.

For each window a run keeps two energies weighted over the window (kinetic energy, and the square of
the third difference of m1's velocity, which shows fast modes a thousand times smaller than slow
ones), the extremes of m1's position and of the command, and the number of sign changes of m1's
velocity.
"""

# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.group import VIEWS, seen
from zwidth.sim.jit import jit, part
from zwidth.sim.kernel import (
    Memory,
    amplify,
    arrives,
    estimate,
    fed_back,
    given,
    placed,
    read_position,
    substep,
    told,
)
from zwidth.sim.lane_type import any_lane, as_lanes, greatest, least, select
from zwidth.sim.propagation import at_once, chosen, propagate
from zwidth.sim.wall_law import wall_push

Floats = NDArray[np.float64]
SLOW_ENERGY, FAST_ENERGY, LOWEST, HIGHEST = 0, 1, 2, 3
LOWEST_COMMAND, HIGHEST_COMMAND, REVERSALS = 4, 5, 6
MEASURES = 7


class Bank(NamedTuple):
    """States of groups of runs, with the groups as first axis: x (groups, 32), line, and so on.

    As in `Memory`, whose counters (2,) all runs share. walls (groups, 6): their numbers; past
    (groups, 3): m1's three velocities before; bounds (groups,) of |position of m1|; escaped
    (groups,): 1 where a run has left them. controller (groups, 4): memory of the walls' law, which
    is one for all (`sim/wall_law.py`).
    """

    x: Floats
    line: Floats
    internal: Floats
    scalars: Floats
    walls: Floats
    past: Floats
    bounds: Floats
    escaped: Floats
    controller: Floats
    counters: NDArray[np.int64]
    law: int


class Kept(NamedTuple):
    """What is kept: measures (windows, 7, groups), and m1's velocities (ticks or 0, groups)."""

    measures: Floats
    velocities: Floats


@part
def _lane_bank(b):
    """View a bank in lanes."""
    return Bank(
        as_lanes(b.x), as_lanes(b.line), as_lanes(b.internal), as_lanes(b.scalars),
        as_lanes(b.walls), as_lanes(b.past), as_lanes(b.bounds), as_lanes(b.escaped),
        as_lanes(b.controller), b.counters, b.law,
    )  # fmt: skip


@part
def _lane_kept(k):
    """View what is kept in lanes."""
    return Kept(as_lanes(k.measures), as_lanes(k.velocities))


VIEWS[Bank] = ("x", 3, _lane_bank)
VIEWS[Kept] = ("measures", 4, _lane_kept)


@jit
def run_windows(device, space, banks, weights, results):
    """Run groups of one device, or of one member a lane, for whole windows of weights.size ticks.

    All measures of a run that has left its bound are infinite from then on.
    """
    eq, scratch, bank, kept = seen(device), seen(space), seen(banks), seen(results)
    measures = kept.measures
    none = weights[:0]
    last = bank.line.shape[1] - 1
    first_tick, first_head = bank.counters[0], bank.counters[1]
    tick, head = first_tick, first_head
    # With nothing but the linear part, a substep is P alone.
    linear = eq.forces.codes.size == 0 and eq.frictions.codes.size == 0
    for segment in range(2):
        if linear and eq.substeps[segment] > 0:
            chosen(eq, segment, 0.0 * eq.smoothing, scratch.choice)
    linear = linear and at_once(eq.propagators[0, 0])
    for g in range(bank.x.shape[0]):
        tick, head = first_tick, first_head
        x, line, past, wall = bank.x[g], bank.line[g], bank.past[g], bank.walls[g]
        scalars = bank.scalars[g]
        account = bank.controller[g]
        memory = Memory(x, line, account, bank.internal[g], scalars, bank.counters, past[:0])
        alive = bank.escaped[g] == 0.0
        y_before, v, u = scalars[0], scalars[1], scalars[2]
        for window in range(measures.shape[0]):
            if not any_lane(alive):
                for row in range(MEASURES):
                    measures[window, row, g] = np.inf
                for row in range(window * weights.size, kept.velocities.shape[0]):
                    kept.velocities[row, g] = np.nan
                tick += weights.size
                head = (head + weights.size) % line.size
                continue
            slow = fast = reversals = 0.0
            low = high = x[0]
            low_command = np.inf
            high_command = -np.inf
            for k in range(weights.size):
                speed = x[eq.dof]
                low, high = least(low, x[0]), greatest(high, x[0])
                third = speed - 3.0 * (past[0] - past[1]) - past[2]
                reversals += select(speed * past[0] < 0.0, 1.0, 0.0)
                past[2], past[1], past[0] = past[1], past[0], speed
                fast += weights[k] * (third * third)
                energy = 0.5 * eq.masses[0] * (speed * speed)
                for i in range(1, eq.dof):
                    energy += 0.5 * eq.masses[i] * (x[eq.dof + i] * x[eq.dof + i])
                slow += weights[k] * energy
                if kept.velocities.shape[0] > 0:
                    row = window * weights.size + k
                    kept.velocities[row, g] = select(alive, speed, np.nan)
                y = read_position(eq, x[eq.read])
                v = estimate(eq, tick, y, y_before, v, scalars)
                y_before = y
                at = given(eq, tick, y, scalars)
                wanted = -wall_push(
                    bank.law, wall, tick, tick * eq.period, at, told(eq, v), account
                )
                wanted = fed_back(eq, x, wanted)
                u = select(arrives(eq, tick), amplify(eq, wanted, u, False), u)
                low_command, high_command = least(low_command, u), greatest(high_command, u)
                line[head] = u
                head = 0 if head == last else head + 1
                earlier = line[head]
                current = line[0 if head == last else head + 1]
                for segment in range(2):
                    held = earlier if segment == 0 else current
                    for step in range(eq.substeps[segment]):
                        if linear:
                            x[eq.states] = held
                            propagate(eq.propagators[segment, 0], x, eq.states + 1, x)
                            continue
                        substep(eq, tick, segment, step, held, 1.0, none, memory, scratch)
                        placed(eq, x, scratch.own)
                tick += 1
                alive = alive & (abs(x[0]) <= bank.bounds[g])
            measures[window, SLOW_ENERGY, g] = select(alive, slow, np.inf)
            measures[window, FAST_ENERGY, g] = select(alive, fast, np.inf)
            measures[window, LOWEST, g] = select(alive, low, np.inf)
            measures[window, HIGHEST, g] = select(alive, high, np.inf)
            measures[window, LOWEST_COMMAND, g] = select(alive, low_command, np.inf)
            measures[window, HIGHEST_COMMAND, g] = select(alive, high_command, np.inf)
            measures[window, REVERSALS, g] = select(alive, reversals, np.inf)
        scalars[0], scalars[1], scalars[2] = y_before, v, u
        bank.escaped[g] = select(alive, 0.0, 1.0)
    bank.counters[0] = tick
    bank.counters[1] = head
