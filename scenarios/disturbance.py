"""External forces on a mass, held for one tick each at their value in the tick's middle.

A force acts on the ticks k with from_s <= k T < to_s; with tau the time since from_s:

    constant   amplitude
    pulse      amplitude sin(pi tau / (to_s - from_s)), half a sine: a tap
    sine       amplitude sin(2 pi frequency_hz tau + phase_rad)
    noise      Gaussian, white up to half the sampling rate, amplitude its standard deviation
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.shown import Valued
from zwidth.sim.nearest import nearest

Floats = NDArray[np.float64]

BASE = "base"  # the base of the device, relative to which its positions are counted
COMMON = ("kind", "at", "amplitude", "from_s", "to_s")
KEYS = {
    "constant": COMMON,
    "pulse": COMMON,
    "sine": (*COMMON, "frequency_hz", "phase_rad"),
    "noise": COMMON,
}


@dataclass(frozen=True)
class Disturbance(Valued):
    """One force: kind, amplitude [N m | N], mass "m1", "m2", ..., time from_s to to_s [s].

    At the "base" it is the acceleration of the ground on which the device stands, amplitude [rad/s2
    | m/s2].

    frequency_hz and phase_rad are a sine's. Raises ValueError (field, value, what is allowed).
    """

    kind: str
    amplitude: float
    at: str = "m1"
    from_s: float = 0.0
    to_s: float = math.inf
    frequency_hz: float = 0.0
    phase_rad: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in KEYS:
            raise ValueError(f"disturbance.kind is {self.kind!r}; {nearest(self.kind, KEYS)}")
        sine = self.kind == "sine"
        for field, allowed, holds in (
            ("amplitude", "a finite number", math.isfinite(self.amplitude)),
            ("from_s", "0 or more, and finite", 0.0 <= self.from_s < math.inf),
            ("to_s", "a time after from_s", self.to_s > self.from_s),
            ("to_s", "finite for a pulse", self.kind != "pulse" or math.isfinite(self.to_s)),
            ("frequency_hz", "above 0 for a sine", not sine or self.frequency_hz > 0.0),
            ("frequency_hz", "0, except for a sine", sine or self.frequency_hz == 0.0),
            ("phase_rad", "a finite number", math.isfinite(self.phase_rad)),
            ("phase_rad", "0, except for a sine", sine or self.phase_rad == 0.0),
        ):
            if not holds:
                value = getattr(self, field)
                raise ValueError(f"disturbance.{field} is {value}; it must be {allowed}")

    def mass(self, dof: int) -> int:
        """Return the index of the mass; for the base, the number of masses.

        Raises ValueError if the chain has no such mass.
        """
        places = [*(f"m{i + 1}" for i in range(dof)), BASE]
        if self.at not in places:
            raise ValueError(f"disturbance.at is {self.at!r}; it must be {' or '.join(places)}")
        return places.index(self.at)

    def force(self, ticks: int, period: float, seed: tuple[int, int]) -> Floats:
        """Return the force in every tick [N m | N], shape (ticks,).

        Raises ValueError for a force that begins after the run, or a sine that a force held for
        a tick cannot follow (half the sampling rate and above).
        """
        if self.from_s >= ticks * period:
            raise ValueError(
                f"disturbance.from_s is {self.from_s}; it must be less than the run's duration"
            )
        if not self.frequency_hz < 0.5 / period:
            raise ValueError(
                f"disturbance.frequency_hz is {self.frequency_hz}; it must be less than"
                f" {0.5 / period:g}, half the sampling rate"
            )
        first, last = (_first_tick(s, ticks, period) for s in (self.from_s, self.to_s))
        tau = (np.arange(last - first, dtype=np.float64) + 0.5) * period
        force = np.zeros(ticks)
        force[first:last] = self.amplitude * self._shape(tau, seed)
        return force

    def _shape(self, tau: Floats, seed: tuple[int, int]) -> Floats:
        if self.kind == "pulse":
            return np.sin(np.pi * tau / (self.to_s - self.from_s))
        if self.kind == "sine":
            return np.sin(2.0 * np.pi * self.frequency_hz * tau + self.phase_rad)
        if self.kind == "noise":
            return np.random.default_rng(seed).standard_normal(tau.size)
        return np.ones(tau.size)


def _first_tick(seconds: float, ticks: int, period: float) -> int:
    """First k with k T >= seconds; 1e-9 T of it is rounding of decimal input."""
    return ticks if seconds >= ticks * period else math.ceil(seconds / period - 1e-9)
