"""Samples beside a curve: a frame that contains most of them, and where the others are."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.figures.style import FILE, MEASURED
from zwidth.sim.readable import percent

Floats = NDArray[np.float64]
OUTER = (0.01, 0.99)  # quantiles of the samples that a frame contains
MARGIN = 0.06  # of a frame, left free at its sides
ON_IT = 0.015  # of a frame: samples nearer to a curve are hidden by it
MOSTLY = 0.9  # share of hidden samples above which the legend mentions them


def framed(samples: Floats, low: float, high: float) -> tuple[tuple[float, float], str]:
    """Return the limits of an axis that contains low to high and most samples, and a label.

    The label says how many samples are outside the frame; "" if none are.
    """
    if samples.size:
        ends = np.quantile(samples, OUTER)
        low, high = min(low, float(ends[0])), max(high, float(ends[1]))
    room = MARGIN * (high - low)
    low, high = low - room, high + room
    outside = float(np.mean((samples < low) | (samples > high))) if samples.size else 0.0
    return (low, high), f", {percent(outside)} of them beyond the frame" if outside else ""


def samples_on(far: Floats, frame: tuple[float, float]) -> tuple[dict[str, Any], str]:
    """Return the style of samples at distances from their curve, and an addition to their label.

    If the curve hides most of them, they are larger, and the label says that they are on it.
    """
    near = np.abs(far) < ON_IT * (frame[1] - frame[0])
    hidden = bool(near.size) and float(np.mean(near)) > MOSTLY
    look = {"markersize": 6.0 if hidden else 3.2, "color": FILE if hidden else MEASURED}
    return look, " (on the curve)" if hidden else ""
