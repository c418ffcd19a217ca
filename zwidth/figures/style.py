"""How every picture looks, and how it is written: PNG and SVG, the same bytes each time."""

from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.figure import Figure

from zwidth.figures.names import KINDS, picture_files
from zwidth.files.whole import replacing

STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.6,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "zwidth",  # names in the file do not change from run to run
}
DOTS_PER_INCH = 150
# A file says nothing of when it was made, so that the same numbers give the same bytes.
TIMELESS: dict[str, dict[str, Any]] = {"png": {}, "svg": {"Date": None}}


def save_figure(figure: Figure, stem: Path) -> list[Path]:
    """Write STEM.png and STEM.svg, each whole or not at all; returns the paths, raises OSError."""
    files = picture_files(stem)
    for path, kind in zip(files, KINDS, strict=True):
        with rc_context(STYLE), replacing(path) as stream:
            figure.savefig(stream, format=kind, dpi=DOTS_PER_INCH, metadata=TIMELESS[kind])
    return files
