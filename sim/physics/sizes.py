"""Typical amplitudes of a recording, for the starts, sweep and bounds of effects."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from zwidth.sim.place import Place

QUARTER = 0.5 * math.pi
SMALLEST = 0.003  # of the command or the travel: beginning of a sweep
SWEPT = 7  # magnitudes in a sweep
WAVES = 2.0  # least waves in the travel; with fewer, any curved force looks like a wave
LONGEST = 1.2  # longest wave, over the travel: of a longer one less than a period is seen


@dataclass(frozen=True)
class Sizes:
    """The sizes of one or several recordings of a device, SI.

    force, peak: rms and largest command, or of the force that moves the device without a command
    (`driven`); speed, position, span: rms speed, rms position and travel of m1 as measured; period:
    of the ticks. By mass: speeds, positions, spans, and fastest, the highest speed recorded. By
    link: springs, and stretches, the rms deflection (far less than the force over the spring if the
    end is light, and more at a resonance). step: of the encoder. rates_beside: whether velocities
    are recorded beside positions. switched: whether the drive is off in a part of it.
    """

    rotary: bool
    period: float
    force: float
    peak: float
    speed: float
    position: float
    span: float
    masses: tuple[float, ...]
    speeds: tuple[float, ...]
    positions: tuple[float, ...]
    spans: tuple[float, ...]
    fastest: tuple[float, ...]
    springs: tuple[float, ...]
    stretches: tuple[float, ...]
    step: float = 0.0
    driven: bool = True
    rates_beside: bool = False
    switched: bool = False

    @property
    def mass(self) -> float:
        """All masses together."""
        return sum(self.masses)

    def reach(self, place: Place) -> float:
        """Rms deflection of a link; rms position of m1 elsewhere."""
        return self.stretches[place.index] if place.kind == "link" else self.position

    def held(self, place: Place) -> float:
        """Rms force of a link's spring; that of the command elsewhere."""
        if place.kind == "link":
            return self.springs[place.index] * self.stretches[place.index]
        return self.force


def up_to(most: float, least: float | None = None) -> Iterator[float]:
    """Yield the magnitudes of a sweep, in equal ratios from `SMALLEST` of the largest on."""
    yield from np.geomspace(SMALLEST * most if least is None else least, most, SWEPT).tolist()


def most_friction(z: Sizes, place: Place) -> float:
    """Return the level that would have held a mass still.

    The command moves m1. Farther on, at a resonance, a link transmits more than that.
    """
    return z.peak if place.index == 0 else math.inf


def spread(random: np.random.Generator, low: float, high: float) -> float:
    """Draw a number that is as likely in every octave."""
    return float(np.exp(random.uniform(math.log(low), math.log(high))))


def sign(random: np.random.Generator) -> float:
    """Draw a sign."""
    return float(random.choice((-1.0, 1.0)))


def turn(random: np.random.Generator) -> float:
    """Draw a phase."""
    return float(random.uniform(-math.pi, math.pi))
