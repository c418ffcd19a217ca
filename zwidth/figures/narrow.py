"""A picture for a phone: the same figure, 4.2 in wide, with its panels below each other."""

from textwrap import fill
from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.gridspec import GridSpec

from zwidth.figures.style import headed, picture_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH = 4.2  # in: about the width of a phone, so that text keeps its size
LETTERS = 58  # most letters in a line of a title
LETTERS_LEGEND = 52
LETTERS_UP = 20  # most letters along the height of a panel
SMALL = 8.0  # points: text of a legend
LINE = 0.17  # in: height of a line of a legend


def narrow_bytes(figure: "Figure") -> bytes:
    """Return a figure as an SVG for a phone; changes the figure."""
    wide, high = figure.get_size_inches()
    scale = WIDTH / wide
    if figure.subfigs:  # their panels have their own layout
        figure.set_size_inches(WIDTH, high)
        return picture_bytes(figure)
    rows, columns = _shape(figure)
    entries = _one_column_legends(figure)
    _wrap_titles(figure)
    if columns > 1:
        _under_one_another(figure, rows, columns)
    # A panel over the full width keeps its shape; several in a row are now below each other.
    tall = high * (0.5 + 0.5 * scale if columns == 1 else 0.75 * columns)
    figure.set_layout_engine("constrained")
    figure.set_size_inches(WIDTH, max(tall, 2.6) + LINE * entries)
    return picture_bytes(figure)


def _shape(figure: "Figure") -> tuple[int, int]:
    """Rows and columns of the panels, 1 and 1 without a grid."""
    for axes in figure.axes:
        if (spec := axes.get_subplotspec()) is not None:
            rows, columns, *_ = spec.get_geometry()
            return rows, columns
    return 1, 1


def _under_one_another(figure: "Figure", rows: int, columns: int) -> None:
    """Put the panels of a grid into one column, those of its first column first."""
    panels: list[tuple[int, int, Axes]] = []
    for axes in figure.axes:
        spec = axes.get_subplotspec()
        if spec is not None:
            row, column = divmod(spec.num1, columns)
            panels.append((column, row, axes))
    panels.sort(key=lambda p: p[:2])
    grid = GridSpec(len(panels), 1, figure=figure)
    named = {row: axes.get_ylabel() for column, row, axes in panels if column == 0}
    for place, (column, row, axes) in enumerate(panels):
        axes.set_subplotspec(grid[place])
        axes.tick_params(labelleft=True)
        if column > 0 and not axes.get_ylabel():
            axes.set_ylabel(named.get(row, ""))
        axes.set_ylabel(fill(axes.get_ylabel(), LETTERS_UP))


def _one_column_legends(figure: "Figure") -> int:
    """Put each legend below the figure, one entry a line; returns how many lines these are."""
    lines = 0
    for legend in (*figure.legends, *(a.get_legend() for a in figure.axes)):
        if legend is None:
            continue
        texts = [fill(t.get_text(), LETTERS_LEGEND) for t in legend.get_texts()]
        handles = [handle for handle in legend.legend_handles if handle is not None]
        legend.remove()
        figure.legend(
            handles, texts, loc="outside lower center", ncols=1, fontsize=SMALL, frameon=False
        )
        lines += sum(1 + text.count("\n") for text in texts)
    return lines


def _wrap_titles(figure: "Figure") -> None:
    if title := figure.get_suptitle():
        headed(figure, fill(title, LETTERS), fontsize=SMALL)
    for axes in figure.axes:
        if title := axes.get_title(loc="left"):
            axes.set_title(fill(title, LETTERS), loc="left", fontsize=9)
