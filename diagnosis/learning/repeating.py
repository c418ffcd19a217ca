"""Finds whether a learned law is periodic in its state, and its period.

A table of about thirty points covers few periods of a periodic law; a table of one period covers
all. So for a fitted law with forces f at points s, of precision P, the period L is sought for which

    g(s) = c + d s + a sin(2 pi s / L) + b cos(2 pi s / L)

is nearest to f in (f - g)' P (f - g), over all L of which the range contains at least `WAVES`
periods, down to twice the smallest distance of points. If g explains half of the part of f that is
not straight, tables of one period start there (without the straight part, which is a damper, spring
or scale), with a free period, and are priced like every hypothesis.

Limit: points further apart than half a period leave several equivalent L; the best few are fitted.
"""

import math

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.learning.knots import known
from zwidth.diagnosis.learning.tables import is_odd, table
from zwidth.diagnosis.selection.hypothesis import Hypothesis
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_law import points_of
from zwidth.sim.physics.sizes import WAVES

Floats = NDArray[np.float64]
MOST = 60.0  # most periods over the range of the points
FINE = 8  # trials for each further period
OF_A_TURN = 12  # points of a period: six harmonics
BEGUN = 2  # periods that are fitted
HALF = 0.5  # share of the part of a law that is not straight that a sine must explain
QUARTER = 0.25  # change in the number of periods over the range by one scale of a period


def turns_of(h: Hypothesis) -> list[tuple[Physics, float]]:
    """Return laws of one period near a fit's last table, each with its scale, the nearest first."""
    law = h.model.effects_at(h.x)[-1]
    if is_odd(law) or law.values["period"] > 0.0:
        return []
    s, there = np.array(points_of(law.values))[:, 0], known(h)
    span, least = float(s[-1] - s[0]), float(np.diff(s).min())
    own, ways = np.linalg.eigh(there.precision)
    root = np.sqrt(np.maximum(own, 0.0))[:, None] * ways.T
    turns = np.arange(WAVES, max(WAVES, min(MOST, 0.5 * span / least)) + 1.0 / FINE, 1.0 / FINE)
    fits = [_sine(root, s, there.forces, span / n) for n in turns]
    off = np.array([distance for distance, _ in fits])
    padded = np.concatenate([[np.inf], off, [np.inf]])
    lowest = np.flatnonzero((off <= padded[:-2]) & (off <= padded[2:]))
    found: list[tuple[Physics, float]] = []
    straight = _sine(root, s, there.forces, math.inf)[0]
    likely = lowest[off[lowest] < (1.0 - HALF) * straight]
    for k in likely[np.argsort(off[likely])][:BEGUN]:
        period, (c, _, a, b) = span / float(turns[k]), fits[k][1]
        angle = 2.0 * np.pi * np.arange(OF_A_TURN) / OF_A_TURN
        at, c = period * angle / (2.0 * np.pi), 0.0 if there.held else c
        turn = table(law.effect.name, law.at, at, c + a * np.sin(angle) + b * np.cos(angle), False,
                     period)  # fmt: skip
        found.append((turn, QUARTER * period**2 / span))
    return found


def _sine(root: Floats, s: Floats, f: Floats, period: float) -> tuple[float, Floats]:
    """Distance of a law from the nearest sine of a period plus a line, and its numbers."""
    angle = 2.0 * np.pi * s / period
    columns = root @ np.column_stack([np.ones_like(s), s, np.sin(angle), np.cos(angle)])
    numbers = np.asarray(np.linalg.lstsq(columns, root @ f, rcond=1e-12)[0], dtype=np.float64)
    return float(np.sum((root @ f - columns @ numbers) ** 2)), numbers
