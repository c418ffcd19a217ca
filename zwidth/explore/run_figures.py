"""The run on the page: over time, in the phase plane, as a spectrum, all for the same span."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from bokeh.events import RangesUpdate
from bokeh.models import (
    BasicTicker,
    ColumnDataSource,
    HoverTool,
    PanTool,
    PrintfTickFormatter,
    Range1d,
    Span,
    WheelZoomTool,
)
from bokeh.plotting import figure
from numpy.typing import NDArray

from zwidth.explore.look import ROOM, fitting, reach, spectrum, within
from zwidth.explore.tooltips import sized
from zwidth.explore.view import Span as Times
from zwidth.figures.style import AFTER, BEFORE, COLOURS, MEASURED, UNDER
from zwidth.sim.readable import prefix

Floats = NDArray[np.float64]
Drawn = dict[str, Floats]
# Curves drawn over each other; the run itself is drawn last, on top.
RUN, BESIDE, RECORDED = "run", "beside", "recorded"
LOOKS = {RECORDED: (MEASURED, "solid"), BESIDE: (BEFORE, "dashed"), RUN: (AFTER, "solid")}
WIDTHS = {RECORDED: UNDER, BESIDE: 1.3, RUN: 1.3}
ENERGIES = {  # colour, label, dashes; the last is on top
    "stored": (AFTER, "stored", "solid"), "spent": ("#777777", "dissipated", "solid"),
    "motor": (COLOURS[5], "from the motor", "dashed"),
}  # fmt: skip
LOOK = ("color", "legend_label", "line_dash")
HEIGHTS = {"position": 5, "command": 5, "contact": 2, "energy": 6}  # shares of the page's
QUANTITIES = {"position": ("position",), "velocity": ("velocity",), "command": ("command",),
              "contact": ("contact",), "energy": tuple(ENERGIES)}  # fmt: skip
NOTHING: Drawn = {name: np.zeros(0) for name in ("t", *(c for q in QUANTITIES.values() for c in q))}
LOWEST_HZ = 1.0
FEW_TICKS = 3


class RunFigures:
    """Four figures over time with one axis, a phase plane and a spectrum.

    zoomed: called with the new time span when the user changes it, None for all.
    """

    def __init__(
        self, angle: str, force: str, seconds: float, zoomed: Callable[[Times | None], None]
    ) -> None:
        self.seconds = seconds
        self.units = {"position": angle, "velocity": f"{angle}/s", "command": force, "energy": "J"}
        self.runs: dict[str, Drawn] = dict.fromkeys(LOOKS, NOTHING)
        self.scales = dict.fromkeys(QUANTITIES, 1.0)
        self.time = {name: ColumnDataSource(dict[str, Any](NOTHING), name=name) for name in LOOKS}
        self.phase = {name: ColumnDataSource({"position": [], "velocity": []}) for name in LOOKS}
        self.spectra = {
            name: ColumnDataSource({"frequency": [], "amplitude": []}) for name in LOOKS
        }
        self.frequencies = Range1d(start=LOWEST_HZ, end=500.0)
        self.axis = Range1d(start=0.0, end=seconds)
        heights = {name: Range1d(start=0.0, end=1.0) for name in ("position", "command", "energy")}
        across = {name: Range1d(start=0.0, end=1.0) for name in ("position", "velocity")}
        self.axes = {
            name: [group[name] for group in (heights, across) if name in group]
            for name in (*heights, "velocity")
        }
        self.over_time = {name: self._over_time(name, heights.get(name)) for name in HEIGHTS}
        self._explain_time()
        self.phase_plane = self._phase_plane(across["position"], across["velocity"])
        self.spectrum = self._spectrum()
        first = self.over_time["position"]
        first.on_event(RangesUpdate, lambda event: _range(event, zoomed))

    def _over_time(self, name: str, height: Range1d | None) -> figure:
        wheel = WheelZoomTool(dimensions="width")
        tools = [wheel, PanTool(dimensions="width")]
        drawn = figure(
            x_range=self.axis, y_range=height or Range1d(start=-0.2, end=1.2),
            tools=tools, active_scroll=wheel, toolbar_location=None,
            sizing_mode="stretch_both", min_height=22 * HEIGHTS[name],
            styles={"flex": str(HEIGHTS[name])}, name=name, y_axis_label=name,
            html_attributes={"aria-label": f"{name} over time"},
        )  # fmt: skip
        drawn.xaxis.visible = False
        for which, (colour, dash) in LOOKS.items():
            several = name == "energy" and which == RUN
            for line in ENERGIES if several else QUANTITIES[name][:1]:
                look: dict[str, Any] = {"color": colour, "line_dash": dash}
                if several:
                    look = dict(zip(LOOK, ENERGIES[line], strict=True))
                drawn.line(
                    "t", line, source=self.time[which], line_width=WIDTHS[which], **look
                )  # fmt: skip
        return drawn

    def _explain_time(self) -> None:
        last, contact = self.over_time["energy"], self.over_time["contact"]
        last.xaxis.update(visible=True, axis_label="time [s], wheel to zoom")
        last.add_layout(last.legend[0], "above")
        last.legend.update(
            orientation="horizontal", label_text_font_size="11px", padding=0, margin=0, spacing=8,
            border_line_alpha=0.0, glyph_height=10, label_height=10,
        )  # fmt: skip
        contact.yaxis.ticker = [0, 1]
        self.limits = [
            Span(dimension="width", line_color="#777777", line_dash="dashed", visible=False)
            for _ in range(2)
        ]
        for limit in self.limits:
            self.over_time["command"].add_layout(limit)

    def _phase_plane(self, positions: Range1d, velocities: Range1d) -> figure:
        drawn = figure(
            sizing_mode="stretch_both", min_width=240, min_height=200, toolbar_location=None,
            tools="", name="phase", x_range=positions, y_range=velocities,
            html_attributes={"aria-label": "phase plane of m1"},
        )  # fmt: skip
        for which, (colour, dash) in LOOKS.items():
            drawn.line(
                "position", "velocity", source=self.phase[which], color=colour, line_dash=dash,
                alpha=0.7, line_width=WIDTHS[which],
            )  # fmt: skip
        # Beside a recording the plane is narrow: few ticks, short labels, no overlaps.
        drawn.xaxis.ticker = BasicTicker(desired_num_ticks=FEW_TICKS)
        drawn.xaxis.formatter = PrintfTickFormatter(format="%.4g")
        drawn.yaxis.formatter = PrintfTickFormatter(format="%.4g")
        return drawn

    def _spectrum(self) -> figure:
        drawn = figure(
            sizing_mode="stretch_both", min_width=240, min_height=200, toolbar_location=None,
            tools="", x_axis_type="log", y_axis_type="log", name="spectrum",
            x_range=self.frequencies, x_axis_label="frequency [Hz]",
            y_axis_label=f"amplitude [{self.units['position']}]",
            html_attributes={"aria-label": "spectrum of the position of m1"},
        )  # fmt: skip
        for which, (colour, dash) in LOOKS.items():
            drawn.line(
                "frequency",
                "amplitude",
                source=self.spectra[which],
                color=colour,
                line_dash=dash,
                line_width=WIDTHS[which],
            )
        self.ultimate = Span(
            dimension="height", line_color="black", line_dash="dashed", visible=False, location=1.0
        )
        drawn.add_layout(self.ultimate)
        drawn.add_tools(
            HoverTool(
                tooltips=[("", "@frequency{0.0} Hz: @amplitude{custom}")],
                formatters={"@amplitude": sized(self.units["position"])},
            )
        )
        return drawn

    def show(self, runs: dict[str, Drawn | None], span: Times | None) -> None:
        """Draw some of the superimposed runs (None removes one) in a time span."""
        for which, drawn in runs.items():
            self.runs[which] = NOTHING if drawn is None else drawn
        self.scales = {name: self._scale(name) for name in QUANTITIES}
        for which, drawn in self.runs.items():
            scaled = {
                n: self.scales[q] * drawn[n] for q, names in QUANTITIES.items() for n in names
            }
            self.time[which].data = {"t": drawn["t"], **scaled}
        self.show_span(span)

    def show_span(self, span: Times | None) -> None:
        """Show a part of the time, and the phase plane and spectrum of that part."""
        start, stop = span or (0.0, self.ends)
        self.axis.update(start=start, end=stop)
        for which, drawn in self.runs.items():
            part = within(drawn, span)
            self.phase[which].data = {n: self.scales[n] * part[n] for n in ("position", "velocity")}
            self.spectra[which].data = dict(spectrum(part))
        self._fit(span)

    @property
    def beyond(self) -> float:
        """Size of the recording over that of the run; 0 if the axis contains both."""
        run, recorded = (reach(self.runs[which]["position"]) for which in (RUN, RECORDED))
        return recorded / run if recorded > ROOM * run > 0.0 else 0.0

    @property
    def ends(self) -> float:
        """The end of the time axis: that of the runs, which may be cut off early."""
        last = [float(d["t"][-1]) for n, d in self.runs.items() if n != RECORDED and d["t"].size]
        return min(self.seconds, max(last, default=self.seconds)) or self.seconds

    def _fit(self, span: Times | None) -> None:
        """Fit the axes to the run, and to the others where they are not much larger."""
        parts = {which: within(drawn, span) for which, drawn in self.runs.items()}
        for name, axes in self.axes.items():
            values = {
                which: self.scales[name] * np.concatenate([part[n] for n in QUANTITIES[name]])
                for which, part in parts.items()
            }
            low, high = fitting(values.pop(RUN), list(values.values()))
            for axis in axes:
                axis.update(start=low, end=high)

    def show_theory(self, ultimate: float | None, limit: float, nyquist: float) -> None:
        """Mark the frequency on the linear boundary at this B, and the amplifier's limit."""
        self.ultimate.update(visible=ultimate is not None, location=ultimate or LOWEST_HZ)
        self.frequencies.end = nyquist
        for sign, line in zip((-1.0, 1.0), self.limits, strict=True):
            shown = math.isfinite(limit)
            line.update(
                visible=shown, location=sign * self.scales["command"] * limit if shown else 0
            )

    def _scale(self, name: str) -> float:
        """Return the factor to a unit in which all runs read well, and write it at the axes."""
        if name == "contact":
            return 1.0
        names = QUANTITIES[name]
        parts = {which: np.concatenate([r[n] for n in names]) for which, r in self.runs.items()}
        shown = fitting(parts.pop(RUN), list(parts.values()))  # in the unit of the axis
        power, letter = prefix(max(map(abs, shown)))
        label = f"{name} [{letter}{self.units[name]}]"
        if name in self.over_time:
            self.over_time[name].yaxis.axis_label = label
        if name == "position":
            self.phase_plane.xaxis.axis_label = label
        if name == "velocity":
            self.phase_plane.yaxis.axis_label = label
        return 10.0**-power


def _range(event: Any, zoomed: Callable[[Times | None], None]) -> None:
    zoomed((event.x0, event.x1))
