"""The common style of pictures, and their files: PNG and SVG with reproducible bytes."""

from io import BytesIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from zwidth.files.whole import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KINDS = ("png", "svg")
MEASURED, BEFORE, AFTER = "#b8b8b8", "#bb5566", "#004488"
FILE, LAW, INTERVAL, HELD_OUT = "0.55", "#117733", "0.85", "#fff3d6"
"""Colours with one meaning in every picture: measurement; a model before and after, as in its file,
and with a learned law; an interval of 95 % over a whole axis; the background of held-out data."""
ON_DARK = {BEFORE: "#ff8f9e", AFTER: "#7fb6ff", FILE: "#9a9da2", LAW: "#5fce87",
           MEASURED: "#777b81", HELD_OUT: "#2d2716"}  # fmt: skip
"""The same for a dark background."""
# For lines without such a meaning, in this order. They differ in lightness, for grey print and all
# kinds of colour blindness (P. Tol, "high contrast", "medium contrast"); dashes and shapes differ
# too.
COLOURS = (AFTER, BEFORE, "#ddaa33", "#000000", "#6699cc", "#997700")
DARK = (COLOURS[0], COLOURS[1], COLOURS[5])
"""Those of them that are dark enough for a thin line on white."""
DASHES = (
    "-",
    (0, (7, 2)),
    (0, (2.5, 1.2)),
    (0, (6, 2, 1.5, 2)),
    (0, (9, 3)),
    (0, (4, 1, 1, 1, 1, 1)),
)
SHAPES = ("o", "s", "^", "D", "v", "P")
# For the fates of runs, from light to dark; the last for undecided ones. `PREDICTED`: for lines of
# theory over them.
FATES = ("#f2f2f2", "#b3d3ec", "#4a90c4", "#7f2704", "#ffd92f")
PREDICTED = "#d01c8b"
# From alike to apart.
SHADES = ("#7f0000", BEFORE, "#ddaa99", "#e6e6e6", "#ffffff")
UNDER = 3.6  # points: width of a measured line, visible under another line
STYLE: dict[Any, Any] = {
    "font.size": 10,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "figure.titlesize": 10,
    "legend.fontsize": 8,
    "legend.title_fontsize": 8,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "0.9",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.6,
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "zwidth",  # the same names in the file in every run
}
DOTS_PER_INCH = 150


def headed(figure: "Figure", text: str, **look: Any) -> None:
    """Write the title of a whole figure at its left, like the titles of its panels."""
    figure.suptitle(text, x=0.01, ha="left", **look)


def pushing(rotary: bool) -> tuple[str, str]:
    """Return the name of a force on an axis, and its unit."""
    return ("torque", "N m") if rotary else ("force", "N")


def picture_files(stem: Path) -> list[Path]:
    """Return STEM.png and STEM.svg; a dot in STEM begins no suffix. Loads no matplotlib."""
    return [stem.with_name(f"{stem.name}.{kind}") for kind in KINDS]


def save_figure(figure: "Figure", stem: Path) -> list[Path]:
    """Write STEM.png and STEM.svg, each whole or not at all; returns the paths, raises OSError."""
    files = picture_files(stem)
    for path, kind in zip(files, KINDS, strict=True):
        with replacing(path) as stream:
            draw(figure, stream, kind)
    return files


def draw(figure: "Figure", stream: IO[bytes], kind: str) -> None:
    """Draw a figure once, as one of `KINDS`, into a stream.

    `Figure.savefig` draws a figure with a layout twice, the first time to compute the layout; the
    canvas itself computes it while drawing. A file does not contain its date, so that the same
    numbers give the same bytes.
    """
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    with rc_context(STYLE):
        figure.set_dpi(DOTS_PER_INCH)
        if kind == "svg":
            FigureCanvasSVG(figure).print_svg(stream, metadata={"Date": None})
        else:
            FigureCanvasAgg(figure).print_png(stream)


def picture_bytes(figure: "Figure", kind: str = "svg") -> bytes:
    """Return a figure as the content of a file of one of `KINDS`."""
    stream = BytesIO()
    draw(figure, stream, kind)
    return stream.getvalue()
