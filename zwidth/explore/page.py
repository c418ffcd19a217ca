"""The page: its layout and texts."""

from collections.abc import Sequence
from dataclasses import replace
from html import escape

from bokeh.core.properties import String
from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.model import DataModel
from bokeh.models import Column, CustomJS, Div, Row, UIElement
from bokeh.models.dom import HTML
from bokeh.models.ui import Pane

from zwidth.explore import tour, words
from zwidth.explore.bench import SECONDS, Bench
from zwidth.explore.controls import Controls, User
from zwidth.explore.plane_figure import PlaneFigure
from zwidth.explore.run_figures import HEIGHTS, RunFigures
from zwidth.explore.view import View
from zwidth.sim.readable import with_unit
from zwidth.sim.trace import Trace
from zwidth.stability.fate_map import units_of
from zwidth.stability.linear import has_theory

# Style sheets are text, since a Bokeh model can be in one page only.
NARROW = (
    ":host { font-size: 12.5px; line-height: 1.3; margin: 2px 4px; overflow-wrap: anywhere;"
    " box-sizing: border-box; padding-right: 10px; }"
)
# Below these widths the four columns are two by two, and then one under the other.
TABLET = "@media (max-width: 1260px) {{ :host {{ {} }} }}"
PHONE = "@media (max-width: 760px) {{ :host {{ {} }} }}"
FLOWS = TABLET.format("height: auto !important; min-height: 0 !important;")
WRAPS = TABLET.format(
    "flex-wrap: wrap !important; height: auto !important; flex: none !important;"
) + PHONE.format("flex-direction: column !important;")
PART = TABLET.format(
    "flex: 1 1 45% !important; min-width: 0 !important; height: auto !important;"
) + PHONE.format("flex: none !important; width: auto !important;")
INSET = ":host { padding: 0 10px 0 8px; box-sizing: border-box; }"
SAVES = (
    'Save this run: <a href="run.mcap?{query}" download>log (MCAP)</a>,'
    ' <a href="run.toml?{query}" download>scenario</a>'
)
WRITE_ADDRESS = "history.replaceState(null, '', '?' + cb_obj.query)"
# Bokeh gives sliders and checkboxes no name, which screen readers need.
AT_FIRST = """
for (const [name, widget] of Object.entries(widgets)) {
  const inside = Bokeh.index.find_one(widget)?.el.shadowRoot
  inside?.querySelector(".noUi-handle, input")?.setAttribute("aria-label", name)
}
history.replaceState(null, "", "?" + address.query)
// A file dropped anywhere is taken as the chooser takes it; the browser would open it instead.
addEventListener("dragover", (event) => event.preventDefault())
addEventListener("drop", (event) => {
  event.preventDefault()
  const chooser = Bokeh.index.find_one(files)?.el.shadowRoot?.querySelector("input")
  if (!chooser || !event.dataTransfer.files.length) return
  chooser.files = event.dataTransfer.files
  chooser.dispatchEvent(new Event("change", {bubbles: true}))
})
"""


class Address(DataModel):
    """The query of the page's address; changes are written to the address."""

    query = String()


class Page:
    """All widgets and figures of a page. view: with axes."""

    def __init__(self, bench: Bench, view: View, user: User) -> None:
        plane = bench.plane(view)
        angle, force = units_of(plane, "amplitude"), units_of(plane, "command_limit")
        self.bench = bench
        self.plane = PlaneFigure(plane, user.choose, user.zoom, user.refit)
        self.runs = RunFigures(angle, force, SECONDS, user.zoom_time)
        self.controls = Controls(bench, view, user)
        self.address = Address(query=view.query())
        self.address.js_on_change("query", CustomJS(code=WRITE_ADDRESS))
        self.title, self.tour, self.trouble, self.read, self.besides, self.whose = (
            _said(name) for name in ("title", "tour", "trouble", "read", "besides", "whose")
        )
        self.read.visible = False
        self.trouble.html_attributes = {"role": "alert"}
        self.saves, self.progress, self.wall = (
            HTML(name=n, html="") for n in ("saves", "progress", "wall")
        )
        measured = bool(bench.measured(view))
        felt = with_unit(plane.trial.perception.force, force)
        legend = _said("legend", words.legend(felt, measured, any(map(has_theory, bench.devices))))
        self.root = self._layout(legend)

    def _layout(self, legend: Div) -> Column:
        children = [
            *self.controls.column(), self.besides, _pane(self.saves, 2),
            self.controls.files, self.controls.recording_from,
        ]  # fmt: skip
        controls = Column(
            children=children, width=246, sizing_mode="stretch_height", spacing=1,
            stylesheets=[INSET, PART, PHONE.format("order: 2;")],
        )  # fmt: skip
        over_time, more = self.runs.over_time, [self.runs.phase_plane, self.runs.spectrum]
        for figure, height in (
            (self.plane.figure, 400),
            *((one, 40 * HEIGHTS[name]) for name, one in over_time.items()),
            *((one, 240) for one in more),
        ):
            rule = f"min-width: 0 !important; flex: none !important; height: {height}px !important;"
            figure.stylesheets = [TABLET.format(rule)]
        columns: list[UIElement] = [
            controls,
            _column(
                1.45, 430, self.controls.layers, self.plane.figure, legend, _pane(self.progress, 3)
            ),
            _column(1.1, 310, _pane(self.wall, 4, live=True), *over_time.values(), order=1),
            _column(0.8, 250, self.whose, *more, order=3),
        ]
        body = Row(children=columns, sizing_mode="stretch_both", spacing=4, stylesheets=[WRAPS])
        top: list[UIElement] = [self.title, self.tour, self.trouble, self.read, body]
        return Column(children=top, sizing_mode="stretch_both", min_height=560, stylesheets=[FLOWS])

    def put_on(self, document: Document) -> None:
        """Make this the content of a document."""
        document.title = f"{self.bench.names[0]} \u2013 zwidth explore"
        document.add_root(self.root)
        document.add_root(self.address)
        chosen = {"files": self.controls.files}
        given = {"widgets": self.controls.nameless(), "address": self.address, **chosen}
        document.js_on_event(DocumentReady, CustomJS(args=given, code=AT_FIRST))

    def show_view(self, view: View) -> None:
        """Set every widget to a view, and all that is quick: lines, marks, links, address."""
        bench = self.bench
        self.controls.show(bench, view)
        device = bench.device(view)
        self.title.text = words.heading(bench, view)
        said = tour.links(bench, view)
        self.tour.update(text=said, visible=bool(said))
        self.besides.text = words.of_the_device(device)
        assert view.damping_range is not None
        assert view.stiffness_range is not None
        self.plane.show_axes(view.damping_range, view.stiffness_range)
        other = None if len(bench.devices) == 1 else bench.line(beside(view))
        self.plane.show_lines(bench.line(view), other)
        self.plane.show_measured(bench.measured(view), device.interface.delay)
        self.plane.show_choice(view.damping, view.stiffness)
        self.address.update(query=view.query())
        self.saves.html = SAVES.format(query=escape(view.query()))

    def say_wall(self, html: str) -> None:
        """Show how the run at the chosen wall ends."""
        self.wall.html = html

    def say_runs(self, html: str) -> None:
        """Show which line belongs to which run."""
        self.whose.update(text=html, visible=bool(html))

    def say_progress(self, text: str) -> None:
        """Show what the plane contains, and its progress."""
        self.progress.html = f'<span style="color:#444">{escape(text)}</span>'

    def say_recording(self, names: Sequence[str], trace: Trace, read: Sequence[str] = ()) -> None:
        """Show which recording is drawn with the run. read: the meaning and unit of its columns."""
        said = f"{', '.join(names)} is read as {'; '.join(read)}" if read else ""
        self.read.update(text=escape(said), visible=bool(said))
        seconds = float(trace.t[-1] - trace.t[0])
        self.controls.files.title = f"Beside: {', '.join(names)}, {seconds:.3g} s"
        self.controls.recording_from.visible = True

    def complain(self, text: str) -> None:
        """Show an error; without text, remove the message."""
        trouble = self.trouble
        trouble.text = f'<b style="color:#8b0000">{escape(text)}</b>' if text else ""
        trouble.visible = bool(text)


def beside(view: View) -> View:
    """Return the view of the device to compare: the nominal one, or for it the first other."""
    return replace(view, device=0 if view.device else 1)


def _said(name: str, text: str = "") -> Div:
    return Div(name=name, text=text, sizing_mode="stretch_width", stylesheets=[NARROW])


def _pane(content: HTML, lines: int, live: bool = False) -> Pane:
    """Return a place of fixed height for what changes often: a Div would lay out the page anew."""
    style = f":host {{ height: {1.3 * lines + 0.2}em; overflow-y: auto; }}"
    attributes = {"role": "status", "aria-live": "polite"} if live else {}
    return Pane(elements=[content], stylesheets=[NARROW, style], html_attributes=attributes)


def _column(share: float, least: int, *children: UIElement, order: int = 0) -> Column:
    """Return a column that takes a share of the width, and pixels at least.

    order: its place on a phone, where all stand under one another.
    """
    flex = dict[str, str | None](flex=f"{share} 1 0")
    return Column(
        children=list(children), sizing_mode="stretch_both", spacing=2, styles=flex,
        min_width=least, stylesheets=[PART, PHONE.format(f"order: {order};")],
    )  # fmt: skip
