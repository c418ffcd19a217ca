"""A map of fates as an image: one colour per point, for its fate, amplitude or frequency."""

import math
from dataclasses import dataclass

import numpy as np
from bokeh.palettes import Cividis256
from numpy.typing import NDArray

from zwidth.explore.view import Layer
from zwidth.figures.map import COLOURS
from zwidth.sim.fate import Fate
from zwidth.stability.fate_map import FateMap

Floats = NDArray[np.float64]
Colours = NDArray[np.uint32]
LOWEST_SHOWN = 2.0  # percentile of the points: a few that nearly rest would stretch the scale


@dataclass(frozen=True, eq=False)
class Picture:
    """colours (y, x): red, green, blue, alpha as four bytes; scale: (low, high) or None."""

    colours: Colours
    scale: tuple[float, float] | None


def picture(result: FateMap, layer: Layer) -> Picture:
    """Return the image of a layer, with the range of its logarithmic scale, if it has one."""
    by_fate = np.array([_packed(COLOURS[f]) for f in Fate], dtype=np.uint32)
    fate = result.fates.fate
    if layer == "fate":
        return Picture(by_fate[fate], None)
    values = _stays(result, layer)
    known = np.isfinite(values)
    quiet = np.isin(fate, [Fate.DITHERS, Fate.FELT])
    ground = by_fate[np.where(quiet, int(Fate.UNDECIDED), fate)]
    if not known.any():
        return Picture(ground, None)
    low, high = (float(v) for v in np.percentile(values[known], [LOWEST_SHOWN, 100.0]))
    high = max(high, 1.01 * low)
    place = np.log(np.where(known, values, low) / low) / math.log(high / low)
    palette = np.array([_packed(colour) for colour in Cividis256], dtype=np.uint32)
    index = np.clip((place * palette.size).astype(int), 0, palette.size - 1)
    return Picture(np.where(known, palette[index], ground).astype(np.uint32), (low, high))


def _stays(result: FateMap, layer: Layer) -> Floats:
    """Frequency of what does not come to rest; amplitude where something holds it; else NaN."""
    fates, limit = result.fates, result.plane.device.interface.command_limit
    shown = fates.fate != Fate.RESTS
    if layer == "amplitude" and math.isinf(limit):
        shown &= fates.fate != Fate.GROWS
    values = fates.amplitude if layer == "amplitude" else fates.frequency
    return np.where(shown & np.isfinite(values) & (values > 0.0), values, np.nan)


def _packed(colour: str) -> int:
    """Return "#rrggbb" with full alpha as the number whose bytes, lowest first, are r, g, b, a."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red | green << 8 | blue << 16 | 0xFF << 24
