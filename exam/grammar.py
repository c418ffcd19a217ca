"""Random laws from a grammar, which no effect of the library describes.

    law      A f(u) | A f(u) g(w) | A f(u + depth g(w))
    f, g     odd, even and one-sided powers, tanh, sine, bump, straight pieces between random knots
    u, w     position, velocity, a link's stretch and its rate, command, time; centred and scaled
    at       a mass, a link, the command, the sensor

Powers, ranges, knots and phases are random too. The force of a law is computed along a recorded
motion. If a refit and the library's laws together come near it (`novelty`), another law is drawn.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.exam.machines import log_uniform
from zwidth.scenarios.concealed.integrator import (
    AMPLITUDE,
    DEPTH,
    FACTOR,
    FORM,
    KNOTS,
    LAW,
    LINK,
    MASS,
    ON_COMMAND,
    ON_LINK,
    ON_MASS,
    ON_SENSOR,
    PLACE,
    WIDTH,
)  # fmt: skip
from zwidth.sim.device import Device
from zwidth.sim.place import Place, place_at

Floats = NDArray[np.float64]
ARGUMENTS = ("", "position", "velocity", "stretch", "rate", "command", "time")  # by their code
SHAPES = ("", "odd power", "even power", "tanh", "sine", "bump", "one-sided", "pieces")
OF_FORCES = {"position": 3.0, "velocity": 3.0, "stretch": 1.5, "rate": 1.0, "command": 1.0,
             "time": 1.0}  # fmt: skip
OF_COMMANDS = {"command": 4.0, "position": 1.0, "velocity": 1.5, "time": 1.0}
OF_SENSORS = {"position": 4.0, "velocity": 1.5, "time": 1.0}
PLACES = {"mass": 0.6, "link": 0.15, "command": 0.15, "sensor": 0.1}
TWO_SHARE = 0.65  # of laws with two factors
NOVEL = 0.4  # of a law's rms that the library must leave
SAMPLES = 1000  # along a motion, on which novelty is judged
HARMONICS, BENDS = 24, 9  # periods and places at which the library's laws are tried


@dataclass(frozen=True)
class Factor:
    """A shape of one argument, (value - centre) / scale; numbers a, b, or heights at the knots."""

    argument: str
    shape: str
    centre: float
    scale: float
    a: float = 0.0
    b: float = 0.0
    knots: tuple[float, ...] = (0.0,) * KNOTS

    def row(self) -> list[float]:
        """Return the factor as the integrator takes it."""
        codes = ARGUMENTS.index(self.argument), SHAPES.index(self.shape)
        return [*map(float, codes), self.centre, self.scale, self.a, self.b, *self.knots]

    def of(self, motion: Mapping[str, Floats], more: Floats | float = 0.0) -> Floats:
        """Return the factor along a motion; more is added to its argument."""
        u = (motion[self.argument] - self.centre) / self.scale + more
        match self.shape:
            case "odd power":
                return np.sign(u) * np.abs(u) ** self.a
            case "even power":
                return np.abs(u) ** self.a
            case "tanh":
                return np.tanh(self.a * u)
            case "sine":
                return np.sin(self.a * u + self.b)
            case "bump":
                return np.exp(-0.5 * (self.a * u) ** 2)
            case "one-sided":
                return np.maximum(u, 0.0) ** self.a
            case _:
                return np.interp(u, np.arange(KNOTS) - 2.0, self.knots)

    def text(self, inside: str = "") -> str:
        """Return the factor as a formula."""
        u = f"({self.argument} - {self.centre:.3g}) / {self.scale:.3g}{inside}"
        match self.shape:
            case "odd power":
                return f"sign(u) |u|^{self.a:.2f}, u = {u}"
            case "even power" | "one-sided":
                return f"{self.shape} {self.a:.2f} of {u}"
            case "pieces":
                return f"pieces {', '.join(f'{k:.2f}' for k in self.knots)} of {u}"
            case _:
                return f"{self.shape} ({self.a:.2f}, {self.b:.2f}) of {u}"


@dataclass(frozen=True)
class Law:
    """A law at a place: "m2", "link12", "command" or "sensor"; inner: whether g stands inside f."""

    at: str
    amplitude: float
    first: Factor
    second: Factor | None = None
    inner: bool = False
    depth: float = 0.0

    def row(self, masses: int) -> Floats:
        """Return the law as the integrator takes it, on a chain of so many masses."""
        row = np.zeros(LAW)
        place, mass, link = _where(self.at, masses)
        row[[PLACE, MASS, LINK, AMPLITUDE]] = place, mass, link, self.amplitude
        row[FORM], row[DEPTH] = float(self.inner), self.depth
        row[FACTOR : FACTOR + WIDTH] = self.first.row()
        if self.second is not None:
            row[FACTOR + WIDTH :] = self.second.row()
        return row

    def along(self, motion: Mapping[str, Floats]) -> Floats:
        """Return the value of the law along a motion."""
        if self.second is None:
            return self.amplitude * self.first.of(motion)
        if self.inner:
            return self.amplitude * self.first.of(motion, self.depth * self.second.of(motion))
        return self.amplitude * self.first.of(motion) * self.second.of(motion)

    @property
    def text(self) -> str:
        """The law as a formula."""
        if self.second is None:
            return f"{self.amplitude:.3g} x [{self.first.text()}]"
        if self.inner:
            inside = f" + {self.depth:.3g} [{self.second.text()}]"
            return f"{self.amplitude:.3g} x [{self.first.text(inside)}]"
        return f"{self.amplitude:.3g} x [{self.first.text()}] x [{self.second.text()}]"


def _where(at: str, masses: int) -> tuple[int, int, int]:
    """Place, mass, and the link whose stretch the law may know; -1 for none."""
    there = place_at(at)
    match there.kind:
        case "command":
            return ON_COMMAND, 0, -1
        case "sensor":
            return ON_SENSOR, 0, -1
        case "link":
            return ON_LINK, there.index, there.index
        case _:
            return ON_MASS, there.index, min(there.index, masses - 2)


def motion_at(at: str, t: Floats, states: Floats, command: Floats) -> dict[str, Floats]:
    """Return the arguments of a law at a place; states (ticks, 2n) of the chain."""
    n = states.shape[1] // 2
    place, mass, link = _where(at, n)
    found = {
        "position": states[:, mass],
        "velocity": states[:, n + mass],
        "command": command,
        "time": t,
    }
    if link >= 0 and place in (ON_MASS, ON_LINK):
        found["stretch"] = states[:, link] - states[:, link + 1]
        found["rate"] = states[:, n + link] - states[:, n + link + 1]
    return found


def draw_law(
    random: np.random.Generator, device: Device, t: Floats, states: Floats, command: Floats
) -> Law:
    """Return a law of unit rms along a motion, at a place of a device."""
    n = device.chain.masses.size
    kinds = {k: p for k, p in PLACES.items() if k != "link" or n > 1}
    kind = _pick(random, kinds)
    match kind:
        case "mass":
            at = str(Place("mass", int(random.integers(n))))
        case "link":
            at = str(Place("link", int(random.integers(n - 1))))
        case _:
            at = kind
    motion = motion_at(at, t, states, command)
    odds = {"command": OF_COMMANDS, "sensor": OF_SENSORS}.get(kind, OF_FORCES)
    odds = {k: p for k, p in odds.items() if k in motion}
    one = _pick(random, odds)
    first, second = _factor(random, one, motion[one]), None
    if random.random() < TWO_SHARE:
        two = _pick(random, {k: p for k, p in odds.items() if k != one} or odds)
        second = _factor(random, two, motion[two])
    inner = bool(random.random() < 0.35)
    depth = float(random.choice((-1.0, 1.0))) * log_uniform(random, 0.5, 2.0)
    law = Law(at, 1.0, first, second, inner, depth)
    size = float(np.sqrt(np.mean(law.along(motion) ** 2)))
    return scaled(law, float(random.choice((-1.0, 1.0))) / size if size > 1e-6 else 0.0)


def scaled(law: Law, factor: float) -> Law:
    """Return the law with its strength times a factor."""
    return Law(law.at, factor * law.amplitude, law.first, law.second, law.inner, law.depth)


def _pick(random: np.random.Generator, odds: Mapping[str, float]) -> str:
    weights = np.array(list(odds.values()))
    return str(random.choice(list(odds), p=weights / weights.sum()))


def _factor(random: np.random.Generator, argument: str, values: Floats) -> Factor:
    """A shape drawn over the range in which its argument moves: two scales are its rms, or half."""
    size = float(np.std(values)) or 1.0
    middle = float(values.mean())
    # What depends on command or velocity begins at zero; else the law has a place of its own.
    centre = 0.0
    if argument in ("position", "stretch", "time"):
        centre = middle + size * float(random.uniform(-1.2, 1.2))
    shape = SHAPES[1 + int(random.integers(len(SHAPES) - 1))]
    scale = size * log_uniform(random, 0.5, 1.5)
    a = b = 0.0
    knots = (0.0,) * KNOTS
    match shape:
        case "odd power" | "even power" | "one-sided":
            a = float(random.uniform(1.2, 3.5))
        case "tanh" | "bump":
            a = log_uniform(random, 0.7, 4.0)
        case "sine":
            a, b = log_uniform(random, 1.0, 8.0), float(random.uniform(-math.pi, math.pi))
        case _:
            knots = tuple(random.uniform(-1.0, 1.0, KNOTS).tolist())
    return Factor(argument, shape, centre, scale, a, b, knots)


def novelty(law: Law, t: Floats, states: Floats, command: Floats) -> float:
    """Return the share of a law's rms that neither a refit nor two laws of the library explain.

    Along the motion alone: least squares on everything linear, then on the two of many library laws
    at many shapes that take most of what is left, one after the other.
    """
    every = max(1, t.size // SAMPLES)
    t, states, command = t[::every], states[::every], command[::every]
    target = law.along(motion_at(law.at, t, states, command))
    linear = [np.ones(t.size), command, *states.T]
    q = states[:, 0]
    if law.at not in ("sensor", "command"):
        q = motion_at(law.at, t, states, command)["position"]
    if law.at == "sensor":
        linear = [np.ones(t.size), q]
    pool = np.column_stack([target, *_library(law.at, t, states, command)])
    pool = _off(pool, np.column_stack(linear))
    size = float(np.linalg.norm(target))
    for _ in range(2):
        left, others = pool[:, 0], pool[:, 1:]
        norms = np.linalg.norm(others, axis=0)
        gains = np.abs(left @ others) / np.where(norms > 0.0, norms, np.inf)
        pool = _off(pool, others[:, [int(np.argmax(gains))]])
    return float(np.linalg.norm(pool[:, 0])) / size if size > 0.0 else 0.0


def _off(values: Floats, columns: Floats) -> Floats:
    """Values (samples, k) less their part in the span of columns."""
    left, singular, _ = np.linalg.svd(columns / _sizes(columns), full_matrices=False)
    basis = left[:, singular > 1e-9 * singular[0]]
    return values - basis @ (basis.T @ values)


def _sizes(columns: Floats) -> Floats:
    return np.maximum(np.linalg.norm(columns, axis=0), 1e-300)


def _library(at: str, t: Floats, states: Floats, command: Floats) -> list[Floats]:
    """What the library and its probes could give at a place, over periods, bends and speeds."""
    n = states.shape[1] // 2
    motion = motion_at(at if at not in ("command", "sensor") else "m1", t, states, command)
    q, v = motion["position"], motion["velocity"]
    if place_at(at).kind == "link":
        q, v = motion["stretch"], motion["rate"]
    span = float(np.ptp(q)) or 1.0
    found = [q**3, q * np.abs(q), np.sin(q), np.cos(q), np.abs(q)]
    for period in np.geomspace(0.03 * span, 4.0 * span, HARMONICS):
        found += [np.sin(2.0 * np.pi * q / period), np.cos(2.0 * np.pi * q / period)]
    for bend in np.linspace(q.min(), q.max(), BENDS + 2)[1:-1]:
        found += [np.maximum(0.0, q - bend)]
    if at == "sensor":
        return found
    if at == "command":
        peak = float(np.abs(command).max()) or 1.0
        for share in np.linspace(0.1, 0.9, BENDS):
            band = np.abs(command) - share * peak
            found.append(np.sign(command) * np.maximum(0.0, band))
        found += [np.abs(command)]
    speeds = [v] if at not in ("command", "sensor") else [states[:, n + i] for i in range(n)]
    for speed in speeds:
        rms = float(np.std(speed)) or 1.0
        found += [np.sign(speed), speed * np.abs(speed), speed**3]
        found += [np.maximum(0.0, speed), np.tanh(speed / (0.1 * rms)), np.tanh(speed / rms)]
        found += [np.sign(speed) * np.exp(-((speed / (s * rms)) ** 2)) for s in (0.1, 0.3, 1.0)]
    return found
