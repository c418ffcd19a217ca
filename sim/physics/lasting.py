"""Starts, sweep and bounds of an effect that is a time, in ticks: a delay, a lag, a mean."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from zwidth.sim.physics.effect import Bounds, Scaled
from zwidth.sim.physics.sizes import Sizes, up_to
from zwidth.sim.place import Place

LONGEST_TICKS = 50.0  # a longer one is another mechanism, and without end it cuts the command off


@dataclass(frozen=True)
class Lasting:
    """How a time is sought.

    name: of the parameter. begun: first value, in ticks. longest: in ticks. most: largest step of a
    fit, in ticks. reads: whether it filters readings, which is only distinguished for velocities if
    they are recorded beside positions.
    """

    name: str
    begun: tuple[float, ...]
    longest: float = LONGEST_TICKS
    most: float = math.inf
    reads: bool = False

    def asked(self, z: Sizes, place: Place) -> bool:
        """Whether it can be seen at a place."""
        return not self.reads or place.kind != "velocity" or z.rates_beside

    def starts(self, z: Sizes, place: Place) -> Iterator[Scaled]:
        """Yield the starting values and step sizes of a fit."""
        if self.asked(z, place):
            for ticks in self.begun:
                yield self._scaled(ticks * z.period, z)

    def sweep(self, z: Sizes, place: Place) -> Iterator[Scaled]:
        """Yield values and steps in equal ratios up to the longest."""
        if self.asked(z, place):
            for time in up_to(self.longest * z.period):
                yield self._scaled(time, z)

    def _scaled(self, time: float, z: Sizes) -> Scaled:
        return {self.name: time}, {self.name: min(time, self.most * z.period)}

    def bounds(self, z: Sizes, _: Place) -> Bounds:
        """Return the bounds of its parameter."""
        return {self.name: (0.0, self.longest * z.period)}


def one_tick(z: Sizes, _: Place) -> float:
    """Return the natural size of a time."""
    return z.period
