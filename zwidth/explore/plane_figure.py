"""The K-B plane on the page: the picture, with boundaries, measured points and the choice."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from bokeh.events import RangesUpdate, Reset, Tap
from bokeh.models import (
    BoxZoomTool,
    ColorBar,
    ColumnDataSource,
    CustomJSHover,
    HoverTool,
    LogColorMapper,
    PanTool,
    Range1d,
    ResetTool,
)
from bokeh.palettes import Cividis256
from bokeh.plotting import figure

from zwidth.explore.bench import Line
from zwidth.explore.measured import MeasuredPoint
from zwidth.explore.picture import picture
from zwidth.explore.tooltips import sized
from zwidth.explore.view import Layer, Span
from zwidth.figures.map import NAMES
from zwidth.figures.style import PREDICTED
from zwidth.sim.fate import Fate
from zwidth.stability.fate_map import FateMap, units_of
from zwidth.stability.plane import Floats, Plane

SAME_DELAY = 1e-9
FATE_WORDS = f"return {[{**NAMES, Fate.GROWS: 'grows'}[f] for f in Fate]}[value]"

HERTZ = 'return Number.isFinite(value) && value > 0 ? value.toPrecision(3) + " Hz" : "-"'


class PlaneFigure:
    """The figure and what it shows; calls `chosen(B, K)` on a click, `zoomed(B, K)` on a zoom."""

    def __init__(
        self,
        plane: Plane,
        chosen: Callable[[float, float], None],
        zoomed: Callable[[Span, Span], None],
        refit: Callable[[], None],
    ) -> None:
        self.units = {q: units_of(plane, q) for q in ("B", "K", "amplitude")}
        tools = [BoxZoomTool(), PanTool(), reset := ResetTool()]
        self.figure = figure(
            x_range=Range1d(start=plane.x.start, end=plane.x.stop),
            y_range=Range1d(start=0.0, end=plane.y.stop),
            tools=tools, active_drag=None, toolbar_location="above", sizing_mode="stretch_both",
            min_width=400, min_height=380, name="plane",
            x_axis_label=f"virtual damping B [{self.units['B']}]",
            y_axis_label=f"virtual stiffness K [{self.units['K']}]",
            html_attributes={"aria-label": "K-B plane; its wall is also set by the numbers K, B"},
        )  # fmt: skip
        self.figure.toolbar.logo = None
        self.figure.grid.visible = False
        reset.description = "Fit the axes to the boundary"
        self._image()
        self._lines()
        self._scale()
        self.figure.on_event(Tap, lambda event: _inside(event, chosen))
        self.figure.on_event(RangesUpdate, lambda event: _ranges(event, zoomed))
        self.figure.on_event(Reset, lambda _: refit())

    def _image(self) -> None:
        self.image = ColumnDataSource(_no_image(), name="map")
        drawn = self.figure.image_rgba(
            image="colours", x="x", y="y", dw="dw", dh="dh", source=self.image, level="image"
        )
        unit = self.units["amplitude"]
        words = [
            ("B, K", "$x{0.0000}, $y{0.00}"), ("", "@fate{custom}"),
            ("amplitude", "@amplitude{custom}"), ("frequency", "@frequency{custom}"),
        ]  # fmt: skip
        said: dict[str, Any] = {
            "@fate": CustomJSHover(code=FATE_WORDS),
            "@amplitude": sized(unit),
            "@frequency": CustomJSHover(code=HERTZ),
        }
        self.figure.add_tools(HoverTool(renderers=[drawn], tooltips=words, formatters=said))

    def _lines(self) -> None:
        self.line, self.other = (_source("B", "K", "frequency") for _ in range(2))
        self.here, self.elsewhere = (_source("B", "K", "delay", "frequency") for _ in range(2))
        self.choice = _source("B", "K")
        draw = self.figure
        draw.line("B", "K", source=self.other, color="white", line_width=5)
        draw.line("B", "K", source=self.other, color="black", line_width=2.5, line_dash="dashed")
        draw.line("B", "K", source=self.line, color="white", line_width=5)
        linear = draw.line("B", "K", source=self.line, color="black", line_width=2.5)
        draw.scatter("B", "K", source=self.elsewhere, size=5, color="white", line_color="#555555")
        points = draw.scatter(
            "B", "K", source=self.here, size=10, fill_color="#ffffff", line_color="black",
            line_width=2.5,
        )  # fmt: skip
        draw.scatter(
            "B", "K", source=self.choice, marker="circle_x", size=18, fill_alpha=0.0,
            line_color=PREDICTED, line_width=3,
        )  # fmt: skip
        words = [("measured: B, K", "@B, @K"), ("delay", "@delay{0.0} ms"), ("at", "@frequency")]
        draw.add_tools(HoverTool(renderers=[points], tooltips=words))
        words = [("linear boundary: B, K", "@B, @K"), ("then", "@frequency{0.0} Hz")]
        draw.add_tools(HoverTool(renderers=[linear], tooltips=words, line_policy="nearest"))

    def _scale(self) -> None:
        self.mapper = LogColorMapper(palette=Cividis256, low=1e-3, high=1.0)
        self.bar = ColorBar(color_mapper=self.mapper, visible=False, width=12, title=" ")
        self.figure.add_layout(self.bar, "right")

    def show_map(self, result: FateMap, layer: Layer) -> None:
        """Draw a map, which may be unfinished."""
        drawn = picture(result, layer)
        half_x = 0.5 * float(result.x[1] - result.x[0])
        half_y = 0.5 * float(result.y[1] - result.y[0])
        self.bar.visible = drawn.scale is not None
        if drawn.scale is not None:
            self.mapper.update(low=drawn.scale[0], high=drawn.scale[1])
            unit = "Hz" if layer == "frequency" else self.units["amplitude"]
            self.bar.title = f"[{unit}]"
        self.image.data = {
            "colours": [drawn.colours],
            "fate": [result.fates.fate.astype(np.uint8)],
            "amplitude": [bounded(result).astype(np.float32)],
            "frequency": [result.fates.frequency.astype(np.float32)],
            "x": [result.x[0] - half_x], "y": [result.y[0] - half_y],
            "dw": [result.x[-1] - result.x[0] + 2.0 * half_x],
            "dh": [result.y[-1] - result.y[0] + 2.0 * half_y],
        }  # fmt: skip

    def show_lines(self, line: Line, other: Line | None) -> None:
        """Draw the linear boundary, and that of the device for comparison."""
        for source, shown in ((self.line, line), (self.other, other)):
            source.data = {
                "B": [] if shown is None else shown.damping,
                "K": [] if shown is None else shown.stiffness,
                "frequency": [] if shown is None else shown.frequency,
            }

    def show_measured(self, points: Sequence[MeasuredPoint], delay: float) -> None:
        """Draw the points measured at this delay large, those at others small."""
        here = [p for p in points if abs(p.delay - delay) < SAME_DELAY]
        elsewhere = [p for p in points if abs(p.delay - delay) >= SAME_DELAY]
        for source, some in ((self.here, here), (self.elsewhere, elsewhere)):
            source.data = {
                "B": [p.damping for p in some], "K": [p.stiffness for p in some],
                "delay": [1e3 * p.delay for p in some],
                "frequency": ["?" if p.frequency is None else f"{p.frequency} Hz" for p in some],
            }  # fmt: skip

    def show_choice(self, damping: float | None, stiffness: float | None) -> None:
        """Mark the chosen wall."""
        known = damping is not None and stiffness is not None
        self.choice.data = {"B": [damping], "K": [stiffness]} if known else {"B": [], "K": []}

    def show_axes(self, dampings: Span, stiffnesses: Span) -> None:
        """Set both axes."""
        self.figure.x_range.update(start=dampings[0], end=dampings[1])
        self.figure.y_range.update(start=stiffnesses[0], end=stiffnesses[1])


def bounded(result: FateMap) -> Floats:
    """Return the amplitudes (y, x), infinite for runs that grow without a limit.

    Infinite instead of NaN, since Bokeh writes NaN itself whatever the formatter is.
    """
    held = "command_limit" in (result.plane.x.quantity, result.plane.y.quantity)
    if held or np.isfinite(result.plane.device.interface.command_limit):
        return result.fates.amplitude
    return np.where(result.fates.fate == Fate.GROWS, np.inf, result.fates.amplitude)


def _inside(event: Any, chosen: Callable[[float, float], None]) -> None:
    if event.x is not None and event.y is not None:
        chosen(float(event.x), float(event.y))


def _ranges(event: Any, zoomed: Callable[[Span, Span], None]) -> None:
    zoomed((event.x0, event.x1), (event.y0, event.y1))


def _source(*names: str) -> ColumnDataSource:
    return ColumnDataSource({name: [] for name in names})


def _no_image() -> dict[str, Any]:
    names = ("colours", "fate", "amplitude", "frequency", "x", "y", "dw", "dh")
    return {name: [] for name in names}
