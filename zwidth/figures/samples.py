"""Samples beside a curve: a frame that holds most of them, and where the others are."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.figures.style import FILE, MEASURED
from zwidth.sim.readable import percent

Floats = NDArray[np.float64]
OUTER = (0.01, 0.99)  # quantiles of samples that a frame holds
MARGIN = 0.06  # of a frame, free beyond what it holds
ON_IT = 0.015  # of a frame: samples so near to a curve are hidden by it
MOSTLY = 0.9  # of the samples, hidden: the legend says where they are


def framed(samples: Floats, low: float, high: float) -> tuple[tuple[float, float], str]:
    """Return the limits of an axis that holds low to high and most samples, and what to add.

    That is how many of the samples lie beyond the frame, as a part of a label; "" if none does.
    """
    if samples.size:
        ends = np.quantile(samples, OUTER)
        low, high = min(low, float(ends[0])), max(high, float(ends[1]))
    room = MARGIN * (high - low)
    low, high = low - room, high + room
    outside = float(np.mean((samples < low) | (samples > high))) if samples.size else 0.0
    return (low, high), f", {percent(outside)} of them beyond the frame" if outside else ""


def samples_on(far: Floats, frame: tuple[float, float]) -> tuple[dict[str, Any], str]:
    """Return the look of samples so far from their curve, and what their label adds.

    Where the curve hides most of them they are larger, and the label says that they lie on it.
    """
    near = np.abs(far) < ON_IT * (frame[1] - frame[0])
    hidden = bool(near.size) and float(np.mean(near)) > MOSTLY
    look = {"markersize": 6.0 if hidden else 3.2, "color": FILE if hidden else MEASURED}
    return look, " (on the curve)" if hidden else ""
