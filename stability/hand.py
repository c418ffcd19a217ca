"""A hand that holds the device: mass, spring and damper to ground at the chain's last mass.

The values are those at the fingertip, so on a rotary device all three are multiplied by the square
of the lever. The ranges are ascribed to the index finger in extension at 2 to 20 N (A. Z. Hajian
and R. D. Howe, Identification of the mechanical impedance at the human finger tip, J. Biomechanical
Engineering 119, 109-114, 1997): finger, forces and model agree with the abstract; the numbers have
not yet been checked in the paper itself. The band of K_CR at a damping is over the corners and the
middle of the ranges; the quantiles are over random hands, each property drawn independently and
log-uniformly from its range. Limits: the grip is rigid, and the hand does not react.
"""

from collections.abc import Iterable
from itertools import product
from typing import NamedTuple

import numpy as np

from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.stability.linear import boundary


class Hand(NamedTuple):
    """Mass [kg], damping [N s/m] and stiffness [N/m] of a hand, at its grip on the device."""

    mass: float
    damping: float
    stiffness: float


class Range(NamedTuple):
    """A range from low to high, in the unit of its quantity."""

    low: float
    high: float


class Quantiles(NamedTuple):
    """K_CR [N m/rad | N/m] that 95, 50 and 5 % of the hands reach or exceed."""

    low: float
    median: float
    high: float


LEVELS = (0.05, 0.5, 0.95)
DRAWN = 200
MASS, DAMPING, STIFFNESS = Range(3.5e-3, 8.7e-3), Range(4.02, 7.40), Range(255.0, 1255.0)
MIDDLE = Hand(*(float(np.mean(r)) for r in (MASS, DAMPING, STIFFNESS)))
HANDS = (MIDDLE, *(Hand(*values) for values in product(MASS, DAMPING, STIFFNESS)))


def with_hand(device: Device, hand: Hand, lever: float = 1.0) -> Device:
    """Return the device held by a hand; lever [m]: of the hand on a rotary device, else unused.

    Raises ValueError for a lever that is not > 0 or a hand with a value < 0.
    """
    if device.rotary and not 0.0 < lever < np.inf:
        raise ValueError(
            f"lever is {lever}; the distance of the hand from the axis must be > 0 [m]"
        )
    for field, value in hand._asdict().items():
        if not 0.0 <= value < np.inf:
            raise ValueError(f"hand.{field} is {value}; it must be >= 0 and finite")
    masses = device.chain.masses.size
    mass, damping, stiffness = (v * (lever**2 if device.rotary else 1.0) for v in hand)
    chain = device.chain
    held = device.with_chain(
        chain._replace(
            masses=_added(chain.masses, mass), ground_dampers=_added(chain.ground_dampers, damping)
        )
    )
    return held.with_physics(make_physics("ground_spring", f"m{masses}", stiffness=stiffness))


def hand_band(device: Device, dampings: Iterable[float], lever: float = 1.0) -> list[Range]:
    """Return the least and the largest K_CR over all `HANDS` at each B, 0 where no K is stable."""
    grid = list(dampings)
    found = np.array(
        [
            [point.stiffness or 0.0 for point in boundary(with_hand(device, hand, lever), grid)]
            for hand in HANDS
        ]
    )
    return [Range(float(k.min()), float(k.max())) for k in found.T]


def draw_hands(count: int, seed: int = 0) -> list[Hand]:
    """Return hands drawn from the ranges, each property log-uniformly and independently.

    Raises ValueError for a count < 1.
    """
    if count < 1:
        raise ValueError(f"count is {count}; at least 1 hand is needed")
    parts = np.random.default_rng(seed).random((count, 3))
    low, high = np.log(np.array([MASS, DAMPING, STIFFNESS])).T
    return [Hand(*row) for row in np.exp(low + parts * (high - low)).tolist()]


def hand_quantiles(
    device: Device, dampings: Iterable[float], lever: float = 1.0, count: int = DRAWN, seed: int = 0
) -> list[Quantiles]:
    """Return the K_CR that 95, 50 and 5 % of drawn hands reach at each B, 0 for no stable K.

    lever [m]: of the hand on a rotary device, else unused. Limit: with n hands the share below a
    quantile is uncertain by about 1/sqrt(n).
    """
    grid = list(dampings)
    found = np.array(
        [
            [point.stiffness or 0.0 for point in boundary(with_hand(device, hand, lever), grid)]
            for hand in draw_hands(count, seed)
        ]
    )
    return [Quantiles(*row) for row in np.quantile(found, LEVELS, axis=0).T.tolist()]


def _added(values: np.ndarray, amount: float) -> np.ndarray:
    """Return the values with an amount added to the last."""
    return np.append(values[:-1], values[-1] + amount)
