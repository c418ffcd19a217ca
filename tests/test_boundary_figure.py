"""The boundary figure shows what the result says, and covers none of it."""

import io
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from msgspec import UNSET
from page_checks import chromium, faults_of_figure

from zwidth.figures.boundary import boundary_figure
from zwidth.figures.style import save_figure
from zwidth.results import (
    BoundaryResult,
    Bracketed,
    Critical,
    DelayBoundary,
    Measured,
    Point,
    as_json,
)

STIFFNESS = (1.0, 4.0, 9.0, 3.0, None)
FREQUENCY = (5.0, 12.0, 20.0, 170.0, None)


def example(delays: int = 3) -> BoundaryResult:
    """Boundaries with a jump of branch after the third point and no stable K at the last."""
    boundaries: list[DelayBoundary] = []
    for i in range(delays):
        points = [
            Point(
                0.01 * j,
                None if k is None or f is None else Critical(k + i, f),
                None if k is None else Bracketed(k + i - 0.01, k + i + 0.01, f),
                Measured(k + i + 0.5, f, 0.5 if j else UNSET) if k and f and j < 2 else UNSET,
            )
            for j, (k, f) in enumerate(zip(STIFFNESS, FREQUENCY, strict=True))
        ]
        boundaries.append(DelayBoundary(0.002 * (i + 1), points))
    return BoundaryResult("a device", boundaries)


def curves(figure: Figure, panel: int, markers: str) -> list[np.ndarray]:
    return [
        np.asarray(line.get_xydata())
        for line in figure.axes[panel].lines
        if line.get_marker() == markers
    ]


def test_what_was_not_measured_is_absent():
    point = as_json(example())["boundaries"][0]["points"][2]
    assert set(point) == {"damping", "linear", "simulated"}
    assert as_json(example())["boundaries"][0]["points"][4]["linear"] is None


def test_theory_is_a_line_that_ends_where_no_stiffness_is_stable():
    line = curves(boundary_figure(example(1)), 0, "None")[0]
    assert line[:, 0] == pytest.approx([0.0, 0.01, 0.02, 0.03, 0.04])
    assert line[:4, 1] == pytest.approx([1.0, 4.0, 9.0, 3.0])
    assert np.isnan(line[4, 1])


def test_a_change_of_branch_is_no_slope_of_the_frequency():
    """Mutation: JUMP = 10 draws the jump of 20 to 170 Hz as part of the curve."""
    jump, curve = curves(boundary_figure(example(1)), 1, "None")
    assert jump[:, 1] == pytest.approx([20.0, 170.0])
    assert np.isnan(curve[3, 1])


def test_dots_are_the_brackets_and_open_shapes_the_measurements():
    figure = boundary_figure(example(1))
    (dots,) = curves(figure, 0, ".")
    assert dots[:4, 1] == pytest.approx([1.0, 4.0, 9.0, 3.0])
    measured = curves(figure, 0, "o")
    assert [tuple(point[0]) for point in measured] == [(0.0, 1.5), (0.01, 4.5)]
    assert [tuple(point[0]) for point in curves(figure, 0, "x")] == [(0.01, 4.5)]


@pytest.mark.parametrize("delays", [1, 3, 6])
def test_legend_names_everything_and_covers_nothing(delays: int):
    figure = boundary_figure(example(delays), "measured (Table II)")
    figure.savefig(io.BytesIO(), format="png", dpi=50)  # lays out
    (legend,) = figure.legends
    words = [text.get_text() for text in legend.get_texts()]
    assert [f"delay {2 * (i + 1)} ms" in words for i in range(delays)] == [True] * delays
    assert {"linear theory", "time domain", "measured (Table II)"} <= set(words)
    box = legend.get_window_extent()
    assert all(box.y0 >= axes.get_window_extent().y1 for axes in figure.axes)
    titles = [text for text in figure.axes[0].findobj(Text) if "Stability" in text.get_text()]
    assert [box.y0 >= title.get_window_extent().y1 for title in titles] == [True]
    assert figure.bbox.x0 <= box.x0 < box.x1 <= figure.bbox.x1


def test_units_follow_the_device():
    linear = BoundaryResult("a linear device", example().boundaries, rotary=False)
    stiffness, frequency = boundary_figure(linear).axes
    assert stiffness.get_ylabel().endswith("[N/m]")
    assert frequency.get_xlabel().endswith("[N s/m]")


def test_the_same_result_is_the_same_picture(tmp_path: Path):
    """Mutation: leave the salt out of STYLE, and names in the SVG change."""
    first = save_figure(boundary_figure(example()), tmp_path / "first" / "8.5ms")
    second = save_figure(boundary_figure(example()), tmp_path / "second" / "8.5ms")
    assert [path.name for path in first] == ["8.5ms.png", "8.5ms.svg"]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]
    assert "linear theory" in first[1].read_text(encoding="utf-8")


def test_no_text_of_the_picture_lies_on_another() -> None:
    """Mutation: the legend in one row, beyond the picture's edge and over its title."""
    with chromium() as browser:
        figure = boundary_figure(example(3), "measured (Table II)")
        assert faults_of_figure(browser.new_page(), figure) == []
