"""The tick of `sim/kernel.py` as a predictor: recorded command in, innovations out.

At every tick, before step (1), the state is corrected by what was measured,

    e_k = y_k - h(x_k),    x_k <- x_k + L e_k   (innovation form, fixed gain L),

then the recorded command goes through amplifier and delay line and the chain moves, by the same
parts as in a simulation. An output is a position or a velocity of one mass; m1's position is seen
through the sensor. A sample that is not a number corrects nothing. With L = 0 it is a free run.

Dry friction that keeps its sign is a constant force, for which one substep is exact; only a tick in
which a mass with friction stops, starts or turns needs many. So does one in which the pin of a
backlash leaves its side. So each tick is tried in few substeps (`eq`), and where a velocity did not
keep its sign, or a pin its place, it is taken back and done in many (`fine`).
"""

# Compiled code takes what numba gives it.
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.jit import jit, part
from zwidth.sim.kernel import amplify, arrives, read_sensor, substep
from zwidth.sim.physics.backlash import backlash

Floats = NDArray[np.float64]

BACKLASH = backlash.code


class Outputs(NamedTuple):
    """What was measured: state (o,) index of each output in x, sensed (o,) through m1's sensor."""

    state: NDArray[np.int64]
    sensed: NDArray[np.bool_]


@part
def move(eq, earlier, current, force, memory, scratch):
    """Step (6): the substeps of one tick."""
    for segment in range(2):
        held = earlier if segment == 0 else current
        for _ in range(eq.substeps[segment]):
            substep(eq, segment, held, force, memory, scratch)


@part
def turned(eq, before, after, pins):
    """Whether a mass with dry friction did not keep its velocity's sign, or a pin its side.

    before: state and force effects' internal states before the tick; after, pins: those after it.
    """
    for e in range(eq.frictions.codes.size):
        i = eq.dof + eq.frictions.first[e]
        if not before[i] * after[i] > 0.0:
            return True
    for e in range(eq.forces.codes.size):
        if eq.forces.codes[e] == BACKLASH:
            half = 0.5 * eq.forces.parameters[e, 0]
            if pins[e] != before[after.size + e] or abs(pins[e]) < half:
                return True
    return False


@jit
def predict(
    eq, fine, outputs, commands, measured, gain, external, memory, scratch, saved, innovations
):
    """Fill innovations (ticks, o) from commands (ticks,) and measured (ticks, o).

    eq, fine: the device in few and in many substeps a tick; saved (16 + force effects,) is working
    space. gain (states, o). external (ticks, n) forces to add, or (0, n). memory goes on from
    where it is, so that a recording may be taken in pieces. Returns the ticks done: fewer than
    given where the state overflowed.
    """
    x = memory.x
    line = memory.line
    last = line.size - 1
    none = scratch[1][:0]
    head = memory.counters[1]
    tick = memory.counters[0]
    u = memory.scalars[2]
    finer = fine.substeps[0] + fine.substeps[1] > eq.substeps[0] + eq.substeps[1]
    for k in range(commands.size):
        for o in range(outputs.state.size):
            seen = x[outputs.state[o]]
            if outputs.sensed[o]:
                seen = read_sensor(eq, seen)
            innovations[k, o] = measured[k, o] - seen
        for o in range(outputs.state.size):
            e = innovations[k, o]
            if e == e:
                for i in range(eq.states):
                    x[i] += gain[i, o] * e
        if arrives(eq, tick):
            u = amplify(eq, commands[k])
        line[head] = u
        head = 0 if head == last else head + 1
        earlier = line[head]
        current = line[0 if head == last else head + 1]
        force = external[k] if external.shape[0] > 0 else none
        for i in range(x.size):
            saved[i] = x[i]
        for e in range(memory.internal.size):
            saved[x.size + e] = memory.internal[e]
        move(eq, earlier, current, force, memory, scratch)
        if finer and turned(eq, saved, x, memory.internal):
            for i in range(x.size):
                x[i] = saved[i]
            for e in range(memory.internal.size):
                memory.internal[e] = saved[x.size + e]
            move(fine, earlier, current, force, memory, scratch)
        tick += 1
        if not abs(x[0]) < 1e12:
            return k + 1
    memory.scalars[2] = u
    memory.counters[0] = tick
    memory.counters[1] = head
    return commands.size
