"""The run on the page: over time, in the phase plane, as a spectrum; all show the same span."""

from collections.abc import Callable

import numpy as np
from bokeh.events import RangesUpdate
from bokeh.models import (
    ColumnDataSource,
    HoverTool,
    PanTool,
    Range1d,
    ResetTool,
    Span,
    WheelZoomTool,
)
from bokeh.plotting import figure
from numpy.typing import NDArray

from zwidth.explore.look import spectrum, within
from zwidth.explore.view import Span as Times

Floats = NDArray[np.float64]
Drawn = dict[str, Floats]
# What lies on each other: name, colour, dash. The run itself is drawn last, on top.
RUN, BESIDE, RECORDED = "run", "beside", "recorded"
LOOKS = {RECORDED: ("#DDAA33", "solid"), BESIDE: ("#BB5566", "dashed"), RUN: ("#004488", "solid")}
NOTHING: Drawn = {
    name: np.zeros(0)
    for name in ("t", "position", "velocity", "command", "contact", "stored", "motor", "spent")
}


class RunFigures:
    """Four figures over time with one axis, a phase plane and a spectrum.

    zoomed: called with the time span that is shown when the user changes it, None for all.
    """

    def __init__(
        self, angle: str, force: str, seconds: float, zoomed: Callable[[Times | None], None]
    ) -> None:
        self.seconds = seconds
        self.full: dict[str, Drawn] = dict.fromkeys(LOOKS, NOTHING)
        self.time = {name: ColumnDataSource(NOTHING) for name in LOOKS}
        self.phase = {name: ColumnDataSource({"position": [], "velocity": []}) for name in LOOKS}
        self.spectra = {
            name: ColumnDataSource({"frequency": [], "amplitude": []}) for name in LOOKS
        }
        self.axis = Range1d(0.0, seconds)
        labels = {"position": f"position [{angle}]", "command": f"command [{force}]"}
        labels |= {"contact": "contact", "energy": "energy [J]"}
        shares = {"position": 5, "command": 5, "contact": 2, "energy": 6}
        self.over_time = [self._over_time(n, text, shares[n]) for n, text in labels.items()]
        self.over_time[-1].xaxis.axis_label = "time [s]"
        self.over_time[-1].xaxis.visible = True
        self.phase_plane = self._phase_plane(angle)
        self.spectrum = self._spectrum(angle)
        self.over_time[0].on_event(RangesUpdate, lambda e: zoomed((e.x0, e.x1)))
        self.over_time[0].on_event("reset", lambda _: zoomed(None))

    def _over_time(self, name: str, label: str, share: int) -> figure:
        tools = [WheelZoomTool(dimensions="width"), PanTool(dimensions="width"), ResetTool()]
        drawn = figure(
            x_range=self.axis, tools=tools, sizing_mode="stretch_both", y_axis_label=label,
            min_height=22 * share, toolbar_location=None, name=name, styles={"flex": f"{share}"},
            html_attributes={"aria-label": f"{name} over time"}, active_scroll=tools[0],
        )  # fmt: skip
        drawn.xaxis.visible = False
        drawn.yaxis.axis_label_text_font_size = "11px"
        lines = {"energy": ("stored", "motor", "spent")}.get(name, (name,))
        for which, (colour, dash) in LOOKS.items():
            for line, also in zip(lines, ("solid", "dotted", "dashed"), strict=False):
                if which != RUN and line in ("motor", "spent"):
                    continue
                drawn.line(
                    "t", line, source=self.time[which], color=colour, width=1.2,
                    line_dash=also if name == "energy" and which == RUN else dash,
                    **({"legend_label": WORDS[line]} if which == RUN and name == "energy" else {}),
                )  # fmt: skip
        if name == "energy":
            drawn.legend.update(
                orientation="horizontal", location="top_right", label_text_font_size="10px",
                padding=1, margin=2, spacing=4, background_fill_alpha=0.6,
            )  # fmt: skip
        if name == "contact":
            drawn.y_range = Range1d(-0.2, 1.2)
            drawn.yaxis.ticker = [0, 1]
        return drawn

    def _phase_plane(self, angle: str) -> figure:
        drawn = figure(
            sizing_mode="stretch_both", min_width=240, min_height=200, toolbar_location=None,
            tools="", x_axis_label=f"position [{angle}]", y_axis_label=f"velocity [{angle}/s]",
            html_attributes={"aria-label": "phase plane of m1"},
        )  # fmt: skip
        for which, (colour, dash) in LOOKS.items():
            drawn.line(
                "position", "velocity", source=self.phase[which], color=colour, line_dash=dash,
                alpha=0.7,
            )  # fmt: skip
        return drawn

    def _spectrum(self, angle: str) -> figure:
        drawn = figure(
            sizing_mode="stretch_both", min_width=240, min_height=200, toolbar_location=None,
            tools="", x_axis_type="log", y_axis_type="log", x_axis_label="frequency [Hz]",
            y_axis_label=f"amplitude [{angle}]", html_attributes={"aria-label": "spectrum of m1"},
        )  # fmt: skip
        for which, (colour, dash) in LOOKS.items():
            drawn.line(
                "frequency", "amplitude", source=self.spectra[which], color=colour,
                line_dash=dash,
            )  # fmt: skip
        self.ultimate = Span(
            dimension="height", line_color="black", line_dash="dashed", line_width=1.5,
            visible=False, location=1.0,
        )  # fmt: skip
        drawn.add_layout(self.ultimate)
        drawn.add_tools(HoverTool(tooltips=[("", "@frequency{0.0} Hz: @amplitude{0.00e+0}")]))
        return drawn

    def show(self, which: str, drawn: Drawn | None, span: Times | None) -> None:
        """Draw one of the runs that lie on each other, or take it away."""
        self.full[which] = NOTHING if drawn is None else drawn
        self.time[which].data = dict(self.full[which])
        self._show_part(which, span)

    def show_span(self, span: Times | None) -> None:
        """Show a part of the time, and the phase plane and spectrum of that part."""
        start, stop = span or (0.0, self.seconds)
        self.axis.update(start=start, end=stop)
        for which in LOOKS:
            self._show_part(which, span)

    def show_ultimate(self, frequency: float | None) -> None:
        """Mark the frequency that linear theory has on the boundary at this B."""
        self.ultimate.visible = frequency is not None
        self.ultimate.location = frequency or 1.0

    def _show_part(self, which: str, span: Times | None) -> None:
        part = within(self.full[which], span)
        self.phase[which].data = {n: part[n] for n in ("position", "velocity")}
        self.spectra[which].data = dict(spectrum(part))


WORDS = {"stored": "stored", "motor": "from the motor", "spent": "dissipated"}
