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

from zwidth.sim.equations import Equations
from zwidth.sim.jit import jit, part
from zwidth.sim.kernel import amplify, arrives, read_sensor, substep
from zwidth.sim.lane_type import any_lane, negated, select
from zwidth.sim.physics.backlash import backlash

Floats = NDArray[np.float64]

BACKLASH = backlash.code


class Outputs(NamedTuple):
    """What was measured: state (o,) index of each output in x, sensed (o,) through m1's sensor."""

    state: NDArray[np.int64]
    sensed: NDArray[np.bool_]


class Reading(NamedTuple):
    """How the recording is read, which may differ from member to member of a population.

    The command counts times gain (1,); from what was measured origin (o,) is taken, and jitter (o,)
    times arriving (ticks,), or (0,) for none.
    """

    gain: Floats
    origin: Floats
    jitter: Floats
    arriving: Floats


class Saved(NamedTuple):
    """States (states,), internal states (force effects,): before a tick, and after few substeps."""

    x: Floats
    internal: Floats
    coarse_x: Floats
    coarse_internal: Floats


def plain_reading(outputs: int) -> Reading:
    """Return how a recording is read that is taken as it stands."""
    return Reading(np.ones(1), np.zeros(outputs), np.zeros(outputs), np.zeros(0))


def saved_room(eq: Equations) -> Saved:
    """Return room for what a tick keeps."""
    forces = eq.forces.codes.size
    return Saved(np.zeros(eq.states), np.zeros(forces), np.zeros(eq.states), np.zeros(forces))


@part
def move(eq, earlier, current, force, memory, scratch):
    """Step (6): the substeps of one tick."""
    for segment in range(2):
        held = earlier if segment == 0 else current
        for _ in range(eq.substeps[segment]):
            substep(eq, segment, held, force, memory, scratch)


@part
def turned(eq, saved, memory):
    """Whether a mass with dry friction did not keep its velocity's sign, or a pin its side."""
    after, pins = memory.x, memory.internal
    turns = False
    for e in range(eq.frictions.codes.size):
        i = eq.dof + eq.frictions.first[e]
        turns = turns | negated(saved.x[i] * after[i] > 0.0)
    for e in range(eq.forces.codes.size):
        if eq.forces.codes[e] == BACKLASH:
            half = 0.5 * eq.forces.parameters[e, 0]
            turns = turns | (pins[e] != saved.internal[e]) | (abs(pins[e]) < half)
    return turns


@part
def copy(source, target, count):
    """Copy the first numbers of a row onto another."""
    for i in range(count):
        target[i] = source[i]


@part
def predicted(
    eq, fine, outputs, commands, measured, reading, gain, external, memory, scratch,
    fine_scratch, saved, innovations,
):  # fmt: skip
    """Fill innovations (ticks, o) from commands (ticks,) and measured (ticks, o).

    eq, fine: the device in few and in many substeps a tick, each with its working space. gain
    (states, o). external (ticks, n) forces to add, or (0, n). memory goes on from where it is, so
    that a recording may be taken in pieces; scalars[3] is 1 where the state has overflowed, after
    which all is infinite. Returns the ticks done, fewer than given where that is so in every lane.
    """
    x, line, pins = memory.x, memory.line, memory.internal
    last = line.size - 1
    none = commands[:0]
    head = memory.counters[1]
    tick = memory.counters[0]
    u = memory.scalars[2]
    alive = memory.scalars[3] == 0.0
    finer = fine.substeps[0] + fine.substeps[1] > eq.substeps[0] + eq.substeps[1]
    done = 0
    for k in range(commands.size):
        for o in range(outputs.state.size):
            seen = x[outputs.state[o]]
            if outputs.sensed[o]:
                seen = read_sensor(eq, seen)
            y = measured[k, o] - reading.origin[o]
            if reading.arriving.size > 0:
                y -= reading.jitter[o] * reading.arriving[k]
            innovations[k, o] = select(alive, y - seen, np.inf)
        for o in range(outputs.state.size):
            e = innovations[k, o]
            known = alive & (e == e)
            if any_lane(known):
                for i in range(eq.states):
                    x[i] = select(known, x[i] + gain[i, o] * e, x[i])
        u = select(arrives(eq, tick), amplify(eq, reading.gain[0] * commands[k]), u)
        line[head] = u
        head = 0 if head == last else head + 1
        earlier = line[head]
        current = line[0 if head == last else head + 1]
        force = external[k] if external.shape[0] > 0 else none
        if finer:
            copy(x, saved.x, eq.states)
            copy(pins, saved.internal, pins.size)
        move(eq, earlier, current, force, memory, scratch)
        if finer:
            again = alive & turned(eq, saved, memory)
            if any_lane(again):
                copy(x, saved.coarse_x, eq.states)
                copy(pins, saved.coarse_internal, pins.size)
                copy(saved.x, x, eq.states)
                copy(saved.internal, pins, pins.size)
                move(fine, earlier, current, force, memory, fine_scratch)
                for i in range(eq.states):
                    x[i] = select(again, x[i], saved.coarse_x[i])
                for e in range(pins.size):
                    pins[e] = select(again, pins[e], saved.coarse_internal[e])
        tick += 1
        done += 1
        alive = alive & (abs(x[0]) < 1e12)
        if not any_lane(alive):
            break
    memory.scalars[2] = u
    memory.scalars[3] = select(alive, 0.0, 1.0)
    memory.counters[0] = tick
    memory.counters[1] = head
    return done


@jit
def predict(
    eq, fine, outputs, commands, measured, reading, gain, external, memory, scratch,
    fine_scratch, saved, innovations,
):  # fmt: skip
    """Predict one device, see `predicted`."""
    return predicted(
        eq, fine, outputs, commands, measured, reading, gain, external, memory, scratch,
        fine_scratch, saved, innovations,
    )  # fmt: skip
