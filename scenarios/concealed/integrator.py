# Compiled code takes what numba gives it.
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
"""The truth behind a concealed recording: other equations, another step, another friction law.

A method that is tested on data from its own simulator is not tested (Colton & Kress call this the
inverse crime). So nothing here is shared with `sim/kernel.py`:

    motion     classical Runge-Kutta of fourth order, `steps` >= 20 steps a tick, instead of matrix
               exponentials
    friction   LuGre (Canudas de Wit et al., IEEE T. Automatic Control 40(3), 1995):
                   z' = v - sigma_0 |v| z / g(v),    f = -(sigma_0 z + sigma_1 z'),
               instead of a set-valued force. Bristles stiffer than anything else in the device
               (omega h = 0.3) are Coulomb's law to some nanoradians; soft ones are presliding. The
               bristle moves half a step, the masses a whole one, the bristle half a step (Strang):
               exact for constant v, stable at any speed, of second order
    free play  the pin of a link by the implicit Euler rule
    commands   arrive at any time, each with its own delay: a step during which one arrives sees
               the mean of what was held

All that is compiled stands in this one file, because numba's cache watches a single file.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
# No reference counts, which cost more than the arithmetic: callers bring every array. A tuple of
# arrays handed to a function that is not absorbed into its caller is copied at every call.
OPTIONS: Any = {"cache": True, "error_model": "numpy", "nogil": True, "_nrt": False}
compiled = njit(**OPTIONS)
jit = njit(**OPTIONS, forceinline=True)


# A law's row: place, mass, link, amplitude, form, depth, then two factors of an argument, a shape,
# centre and scale of the argument, two numbers of the shape, and its height at five knots.
ON_MASS, ON_LINK, ON_COMMAND, ON_SENSOR = 0, 1, 2, 3
PLACE, MASS, LINK, AMPLITUDE, FORM, DEPTH, FACTOR, WIDTH = 0, 1, 2, 3, 4, 5, 6, 11
LAW = FACTOR + 2 * WIDTH
KNOTS = 5  # at -2, -1, 0, 1, 2
NO_LAWS = np.zeros((0, LAW))
NO_FILTERS = np.zeros((0, 6))
NOTHING_SAGS = np.array([0.0, 1.0])


class Truth(NamedTuple):
    """A device with its physics, n masses; a value of zero (limits: inf, ratio: 1) is no effect.

    masses, dampers, springs to ground, drag (v|v|), cubic_drag (v^3): (n,). links (l, 8): from, to
    (-1 is ground), stiffness, damping, cubic stiffness, gap, sway (share, Hz: the stiffness swings
    with time). yields (y, 5), Bouc-Wen: from, to, stiffness, level, shape. bristles (b, 10): mass,
    sigma_0, sigma_1, level and static level for v > 0, both for v < 0, Stribeck velocity, what they
    grow by with the command's magnitude, the power of that curve (1 or 2). viscous (n, 2):
    for v > 0 and v < 0. constant (n,). gravity (g, 3): mass, level, angle. ripples (r, 5):
    mass, mass that feels the contrary (-1: ground), amplitude, period, phase over the position of
    the first. The other forces act on m1: hum: amplitude, Hz, phase; detent: amplitude, period,
    sharpness; stop: position, stiffness, damping. inertia: share by which m1 swings, period in
    position. warming: share by which dampers change, time constant. falling: the most that the
    drive gives at rest, and how much less at each unit of speed. sagging: by what share the drive
    weakens for each unit of the mean square of what it lately gave, and over which time that is.
    amplifier: lag, step, band, ratio, limit, slew a tick. sensor: amplitude, period, phase;
    rectified; step. laws (w, LAW): laws of no name, a row each (`law_value`). filters (f, 6): of
    each filtered reading the columns of position and rate that it follows, then rate, straight,
    square, damping of its equations. reads (3, masses of the chain): columns of a state in which
    each mass's position is read, and its velocity: the position of which that is the rate, and the
    rate.
    """

    masses: Floats
    dampers: Floats
    springs: Floats
    drag: Floats
    cubic_drag: Floats
    links: Floats
    yields: Floats
    bristles: Floats
    viscous: Floats
    constant: Floats
    gravity: Floats
    ripples: Floats
    hum: Floats
    detent: Floats
    stop: Floats
    inertia: Floats
    warming: Floats
    falling: Floats
    amplifier: Floats
    delay: float
    sensor: Floats
    laws: Floats = NO_LAWS
    filters: Floats = NO_FILTERS
    reads: NDArray[np.int64] = np.zeros((3, 1), dtype=np.int64)
    sagging: Floats = NOTHING_SAGS


@jit
def rounded(value, step):
    """Nearest multiple of a step, half away from zero; a step of 0 rounds nothing."""
    if step <= 0.0:
        return value
    sign = 1.0 if value >= 0.0 else -1.0
    return sign * step * math.floor(abs(value) / step + 0.5)


@jit
def read(truth, position, noise):
    """What the encoder says of m1's position."""
    amplitude, period, phase, rectified, step = truth.sensor
    if amplitude != 0.0:
        position = position + amplitude * math.sin(2.0 * math.pi * position / period + phase)
    if rectified != 0.0:
        position = abs(position)
    return rounded(position + noise, step)


@jit
def drive(truth, wanted, before):
    """What the amplifier makes of a command; `before` is what it gave last."""
    step, band, ratio, limit, slew = truth.amplifier[1:]
    level = rounded(wanted, step)
    if abs(level) <= 0.5 * band:
        level = 0.0
    elif level > 0.0:
        level -= 0.5 * band
    else:
        level += 0.5 * band
    level *= (2.0 * ratio if level > 0.0 else 2.0) / (1.0 + ratio)
    level = min(max(level, -limit), limit)
    return min(max(level, before - slew), before + slew)


@jit
def between(x, offset, i, j):
    """Difference of two entries; j < 0 is ground."""
    return x[offset + i] - x[offset + j] if j >= 0 else x[offset + i]


@jit
def dry_level(row, v, held):
    """g(v) of a bristle under the held command [N m | N]."""
    level, static = (row[3], row[4]) if v >= 0.0 else (row[5], row[6])
    if static != level:
        ratio = abs(v / row[7])
        level += (static - level) * math.exp(-ratio if row[9] == 1.0 else -(ratio**2))
    return level + row[8] * abs(held)


@jit
def bend(row, z, v, h, held):
    """Bristle after a time h at constant speed."""
    g = dry_level(row, v, held)
    if g <= 0.0:
        return 0.0
    end = math.copysign(g / row[1], v)
    return end + (z - end) * math.exp(-row[1] * abs(v) / g * h)


@jit
def bristle_force(row, z, v, held):
    """Friction of a bristle."""
    g = dry_level(row, v, held)
    if g <= 0.0:
        return 0.0
    return -(row[1] * z + row[2] * (v - row[1] * abs(v) * z / g))


@jit
def link_force(row, t, q, v, pin):
    """What a link pulls with at stretch q; the pin of its free play stands where it stands."""
    k = row[2]
    if row[6] != 0.0:
        k *= 1.0 + row[6] * math.sin(2.0 * math.pi * row[7] * t)
    half = 0.5 * row[5]
    hard = row[4] * q * q * q
    if half == 0.0:
        return k * q + row[3] * v + hard
    if pin >= half:
        return max(0.0, k * (q - half) + row[3] * v) + hard
    if pin <= -half:
        return min(0.0, k * (q + half) + row[3] * v) + hard
    return hard


@jit
def next_pin(row, pin, before, after, h):
    """Pin after a step: k (q - z) + c (q' - z') = 0 while free, by the implicit Euler rule."""
    half = 0.5 * row[5]
    if row[3] > 0.0:
        rate = h * row[2] / row[3]
        moved = (pin + (after - before) + rate * after) / (1.0 + rate)
    else:
        moved = after
    return min(max(moved, -half), half)


@jit
def on_m1(truth, t, q, v):
    """Forces on m1 alone, of no library, by its own motion or by time."""
    turn = 2.0 * math.pi
    f = 0.0
    if truth.hum[0] != 0.0:
        f += truth.hum[0] * math.sin(turn * truth.hum[1] * t + truth.hum[2])
    if truth.detent[0] != 0.0:
        angle = turn * q / truth.detent[1]
        f -= truth.detent[0] * math.sin(angle) * math.exp(truth.detent[2] * (math.cos(angle) - 1))
    if abs(q) > truth.stop[0]:
        side = 1.0 if q > 0.0 else -1.0
        push = truth.stop[1] * (abs(q) - truth.stop[0]) + truth.stop[2] * side * v
        f -= side * max(0.0, push)
    return f


@jit
def by_position(truth, x, out):
    """Add the forces that follow the position of a mass."""
    n = truth.masses.size
    for e in range(truth.gravity.shape[0]):
        i = int(truth.gravity[e, 0])
        out[n + i] -= truth.gravity[e, 1] * math.sin(x[i] + truth.gravity[e, 2])
    for e in range(truth.ripples.shape[0]):
        i, j = int(truth.ripples[e, 0]), int(truth.ripples[e, 1])
        amplitude, period, phase = truth.ripples[e, 2:]
        f = amplitude * math.sin(2.0 * math.pi * x[i] / period + phase)
        out[n + i] += f
        if j >= 0:
            out[n + j] -= f


@jit
def shape_value(row, at, u):
    """Return the shape of a factor at u, its argument in units of its scale."""
    shape, a, b = row[at + 1], row[at + 4], row[at + 5]
    if shape == 1.0:  # odd power
        return math.copysign(abs(u) ** a, u)
    if shape == 2.0:  # even power
        return abs(u) ** a
    if shape == 3.0:
        return math.tanh(a * u)
    if shape == 4.0:
        return math.sin(a * u + b)
    if shape == 5.0:  # a bump
        return math.exp(-0.5 * (a * u) ** 2)
    if shape == 6.0:  # on one side only
        return max(0.0, u) ** a
    knot = min(max(u + 2.0, 0.0), KNOTS - 1.0)
    left = min(int(knot), KNOTS - 2)
    share = knot - left
    return (1.0 - share) * row[at + 6 + left] + share * row[at + 7 + left]


@jit
def argument(row, at, q, v, stretch, rate, command, t):
    """Return the argument of a factor in units of its scale."""
    kind = row[at]
    value = t
    if kind == 1.0:
        value = q
    elif kind == 2.0:
        value = v
    elif kind == 3.0:
        value = stretch
    elif kind == 4.0:
        value = rate
    elif kind == 5.0:
        value = command
    return (value - row[at + 2]) / row[at + 3]


@jit
def law_value(row, q, v, stretch, rate, command, t):
    """Return what a law of no name gives: the product of two factors, or one inside the other.

    Form 0: A f(u) g(w), form 1: A f(u + depth g(w)); a factor without an argument is one, or none
    inside the other.
    """
    one, two = FACTOR, FACTOR + WIDTH
    u = argument(row, one, q, v, stretch, rate, command, t)
    if row[two] == 0.0:
        return row[AMPLITUDE] * shape_value(row, one, u)
    second = shape_value(row, two, argument(row, two, q, v, stretch, rate, command, t))
    if row[FORM] == 0.0:
        return row[AMPLITUDE] * shape_value(row, one, u) * second
    return row[AMPLITUDE] * shape_value(row, one, u + row[DEPTH] * second)


@compiled
def sampled_laws(laws, n, place, x, command, t):
    """Return what laws add to a command or a reading."""
    total = 0.0
    for e in range(laws.shape[0]):
        if laws[e, PLACE] == place:
            total += law_value(laws[e], x[0], x[n], 0.0, 0.0, command, t)
    return total


@compiled
def forceful_laws(laws, n, x, command, t, out):
    """Add the forces of laws on masses and in links; masses pull apart where a stretch is > 0."""
    for e in range(laws.shape[0]):
        row = laws[e]
        if row[PLACE] > ON_LINK:
            continue
        i, link = int(row[MASS]), int(row[LINK])
        stretch = rate = 0.0
        if link >= 0:
            stretch, rate = x[link] - x[link + 1], x[n + link] - x[n + link + 1]
        f = law_value(row, x[i], x[n + i], stretch, rate, command, t)
        if row[PLACE] == ON_MASS:
            out[n + i] += f
        else:
            out[n + link] += f
            out[n + link + 1] -= f


@jit
def derivative(truth, t, x, held, dry, pins, process, out):
    """Rates of x = [positions, velocities, amplifier's force, Bouc-Wen's z of each, readings]."""
    n = truth.masses.size
    warm = 1.0
    if truth.warming[0] != 0.0:
        warm += truth.warming[0] * (1.0 - math.exp(-t / truth.warming[1]))
    for i in range(n):
        v = x[n + i]
        out[i] = v
        f = dry[i] - warm * truth.dampers[i] * v - truth.springs[i] * x[i] + truth.constant[i]
        f -= (truth.viscous[i, 0] if v > 0.0 else truth.viscous[i, 1]) * v
        out[n + i] = f - truth.drag[i] * v * abs(v) - truth.cubic_drag[i] * v * v * v
    lag = truth.amplifier[0]
    motor = held
    if lag > 0.0:
        motor = x[2 * n]
        out[2 * n] = (held - motor) / lag
    if truth.falling[0] < math.inf:  # what is cut off is not delayed by the lag
        slower = truth.falling[1] * x[n]
        most, least = truth.falling[0] - slower, -truth.falling[0] - slower
        if held > most:
            motor -= held - most
        elif held < least:
            motor += least - held
    out[n] += motor + process + on_m1(truth, t, x[0], x[n])
    by_position(truth, x, out)
    for e in range(truth.links.shape[0]):
        row = truth.links[e]
        i, j = int(row[0]), int(row[1])
        f = link_force(row, t, between(x, 0, i, j), between(x, n, i, j), pins[e])
        out[n + i] -= f
        if j >= 0:
            out[n + j] += f
    if truth.laws.shape[0] > 0:
        forceful_laws(truth.laws, n, x, motor, t, out)
    for e in range(truth.yields.shape[0]):
        row = truth.yields[e]
        i, j = int(row[0]), int(row[1])
        z, v = x[2 * n + 1 + e], between(x, n, i, j)
        loading = 1.0 if z * v > 0.0 else 0.0
        out[2 * n + 1 + e] = row[2] / row[3] * v * (1.0 - loading * abs(z) ** row[4])
        out[n + i] -= row[3] * z
        if j >= 0:
            out[n + j] += row[3] * z
    first = 2 * n + 1 + truth.yields.shape[0]
    for e in range(truth.filters.shape[0]):
        row, s = truth.filters[e], first + 2 * e
        apart, rate = x[int(row[0])] - x[s], x[s + 1]
        out[s] = row[2] * apart + row[3] * rate
        out[s + 1] = row[2] * (x[int(row[1])] - rate) + row[4] * apart - row[5] * rate
    mass = truth.masses[0]
    if truth.inertia[0] != 0.0:  # Lagrange: m(q) q'' + m'(q) q'^2 / 2 = f
        wave = 2.0 * math.pi / truth.inertia[1]
        slope = -mass * truth.inertia[0] * wave * math.sin(wave * x[0])
        mass *= 1.0 + truth.inertia[0] * math.cos(wave * x[0])
        out[n] -= 0.5 * slope * x[n] * x[n]
    out[n] /= mass
    for i in range(1, n):
        out[n + i] /= truth.masses[i]


@jit
def runge_kutta(truth, t, h, x, held, dry, pins, process, k, stage):
    """One classical step of fourth order, in place; k (4, states) and stage are working space."""
    derivative(truth, t, x, held, dry, pins, process, k[0])
    for i in range(x.size):
        stage[i] = x[i] + 0.5 * h * k[0, i]
    derivative(truth, t + 0.5 * h, stage, held, dry, pins, process, k[1])
    for i in range(x.size):
        stage[i] = x[i] + 0.5 * h * k[1, i]
    derivative(truth, t + 0.5 * h, stage, held, dry, pins, process, k[2])
    for i in range(x.size):
        stage[i] = x[i] + h * k[2, i]
    derivative(truth, t + h, stage, held, dry, pins, process, k[3])
    for i in range(x.size):
        x[i] += h / 6.0 * (k[0, i] + 2.0 * k[1, i] + 2.0 * k[2, i] + k[3, i])


@jit
def step(truth, t, h, x, z, pins, held, process, dry, stretch, k, stage):
    """Bristles by half, masses, bristles by half, pins."""
    n = truth.masses.size
    for i in range(n):
        dry[i] = 0.0
    for b in range(z.size):
        row = truth.bristles[b]
        i = int(row[0])
        z[b] = bend(row, z[b], x[n + i], 0.5 * h, held)
        dry[i] += bristle_force(row, z[b], x[n + i], held)
    for e in range(pins.size):
        stretch[e] = between(x, 0, int(truth.links[e, 0]), int(truth.links[e, 1]))
    runge_kutta(truth, t, h, x, held, dry, pins, process, k, stage)
    for b in range(z.size):
        row = truth.bristles[b]
        z[b] = bend(row, z[b], x[n + int(row[0])], 0.5 * h, held)
    for e in range(pins.size):
        row = truth.links[e]
        if row[5] > 0.0:
            after = between(x, 0, int(row[0]), int(row[1]))
            pins[e] = next_pin(row, pins[e], stretch[e], after, h)
    for e in range(truth.yields.shape[0]):
        x[2 * n + 1 + e] = min(max(x[2 * n + 1 + e], -1.0), 1.0)


class Room(NamedTuple):
    """State and working space: x, bristles, pins, and what a step needs; commands under way.

    now: the command held, the one the amplifier gave last, the last reading, the rate fed back,
    the mean square of what the amplifier lately gave.
    following: the next command to arrive.
    """

    x: Floats
    z: Floats
    pins: Floats
    dry: Floats
    stretch: Floats
    k: Floats
    stage: Floats
    level: Floats
    arrival: Floats
    now: Floats
    following: NDArray[np.int64]

    def copy(self) -> "Room":
        """Return another in the same state."""
        return Room(**{name: array.copy() for name, array in self._asdict().items()})


def width(truth: Truth) -> int:
    """Return how many numbers a state has."""
    return 2 * truth.masses.size + 1 + truth.yields.shape[0] + 2 * truth.filters.shape[0]


def room_of(truth: Truth, ticks: int) -> Room:
    """Return the state at rest, with room for so many ticks."""
    n, links = truth.masses.size, truth.links.shape[0]
    rates = width(truth)
    return Room(
        np.zeros(rates), np.zeros(truth.bristles.shape[0]), np.zeros(links), np.zeros(n),
        np.zeros(links), np.zeros((4, rates)), np.zeros(rates), np.zeros(ticks), np.zeros(ticks),
        np.zeros(5), np.zeros(1, dtype=np.int64),
    )  # fmt: skip


def integrate(truth, period, steps, wanted, feedback, jitter, lost, process, noise, states):
    """Move the device from rest; return (commands, readings, ticks done), each (ticks,).

    wanted (ticks,): what is asked for; feedback: stiffness and damping by which the encoder's
    reading is fed back, so that the command is wanted - K y - B (y - y before) / T; a third number
    low-passes that rate: the weight of a new difference in it. jitter (ticks,)
    [s] of each command's arrival. lost (ticks,): commands that never arrive. process (ticks,):
    force on m1 that nobody commanded. noise (ticks,) of the reading. states (ticks, 2n) is filled
    with positions and velocities at the readings, (ticks, `width`) with all of the state. It stops
    where a position passes 1e6.
    """
    ticks = wanted.size
    commands, readings = np.zeros(ticks), np.zeros(ticks)
    gains = np.array([*feedback[:2], feedback[2] if len(feedback) > 2 else 1.0], dtype=np.float64)
    done = advance(
        truth, period, steps, wanted, gains, jitter, lost, process, noise, states, commands,
        readings, room_of(truth, ticks), 0, ticks,
    )  # fmt: skip
    return commands, readings, done


class Run(NamedTuple):
    """A run as it can be repeated: what was moved, by which commands, late by jitter, and process.

    period and steps per tick; the others as `integrate` takes them, (ticks,) each.
    """

    truth: Truth
    period: float
    steps: int
    commands: Floats
    jitter: Floats
    lost: NDArray[np.bool_]
    process: Floats


def undisturbed(run, window, firsts, states):
    """Move the device of a run without noise, from its true state at the first tick of windows.

    window: ticks of each. firsts: rising. states (ticks, 2n) takes the motion in windows; it is
    left as it was elsewhere.
    """
    ticks = run.commands.size
    still, none, room = np.zeros(ticks), np.array([0.0, 0.0, 1.0]), room_of(run.truth, ticks)
    spare, true = np.zeros((2, ticks)), np.zeros_like(states)
    reached = 0

    def go(process, into, room, first, last):
        advance(
            run.truth, run.period, run.steps, run.commands, none, run.jitter, run.lost, process,
            still, into, spare[0], spare[1], room, first, last,
        )  # fmt: skip

    for first in firsts:
        go(run.process, true, room, reached, first)
        go(still, states, room.copy(), first, min(first + window, ticks))
        reached = first


@compiled
def advance(
    truth, period, steps, wanted, feedback, jitter, lost, process, noise, states, commands,
    readings, room, first, last,
):  # fmt: skip
    """Move the device over some ticks as `integrate` says; return the ticks done."""
    n = truth.masses.size
    h = period / steps
    x, level, arrival = room.x, room.level, room.arrival
    held, given, y_before, speed = room.now[0], room.now[1], room.now[2], room.now[3]
    spent, share = room.now[4], 1.0 - math.exp(-period / truth.sagging[1])
    following = room.following[0]
    for tick in range(first, last):
        now = tick * period
        seen = x[truth.reads[0, 0]] + sampled_laws(truth.laws, n, ON_SENSOR, x, 0.0, now)
        y = read(truth, seen, noise[tick])
        rate = (y - y_before) / period if tick > 0 else 0.0
        speed = feedback[2] * rate + (1.0 - feedback[2]) * speed
        y_before = y
        commands[tick] = wanted[tick] - feedback[0] * y - feedback[1] * speed
        readings[tick] = y
        for i in range(states.shape[1]):
            states[tick, i] = x[i]
        if not lost[tick]:
            more = sampled_laws(truth.laws, n, ON_COMMAND, x, commands[tick], now)
            given = drive(truth, commands[tick] + more, given)
        level[tick] = given / (1.0 + truth.sagging[0] * spent)
        spent += share * (given * given - spent)
        arrival[tick] = tick * period + truth.delay + jitter[tick]
        for s in range(steps):
            t = tick * period + s * h
            mean, since = 0.0, t
            while following <= tick and arrival[following] < t + h * (1.0 - 1e-9):
                mean += held * max(0.0, arrival[following] - since)
                since = max(since, arrival[following])
                held = level[following]
                following += 1
            mean = (mean + held * (t + h - since)) / h
            step(
                truth, t, h, x, room.z, room.pins, mean, process[tick], room.dry, room.stretch,
                room.k, room.stage,
            )  # fmt: skip
        if not abs(x[0]) < 1e6:
            return tick + 1
    room.now[0], room.now[1], room.now[2], room.now[3] = held, given, y_before, speed
    room.now[4] = spent
    room.following[0] = following
    return last
