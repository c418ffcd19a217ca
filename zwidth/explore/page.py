"""The page: where everything stands, and what it is called for those who cannot see it."""

from collections.abc import Callable, Sequence
from html import escape
from typing import Any, Protocol

from bokeh.core.properties import String
from bokeh.document import Document
from bokeh.events import DocumentReady
from bokeh.model import DataModel
from bokeh.models import (
    Button,
    Checkbox,
    Column,
    CustomJS,
    Div,
    FileInput,
    InlineStyleSheet,
    NumericInput,
    RadioButtonGroup,
    Row,
    UIElement,
)

from sim.trace import Trace
from stability.fate_map import units_of
from zwidth.explore import words
from zwidth.explore.bench import SECONDS, Bench
from zwidth.explore.plane_figure import PlaneFigure
from zwidth.explore.run_figures import RunFigures
from zwidth.explore.sliders import Sliders
from zwidth.explore.stops import with_unit
from zwidth.explore.view import LAYERS, Span, View

LAYER_NAMES = {"fate": "Verdict", "amplitude": "Amplitude", "frequency": "Frequency"}
NARROW = InlineStyleSheet(css=":host { font-size: 13px; line-height: 1.3; margin: 2px 4px; }")
DROP = InlineStyleSheet(css="input { border: 1px dashed #777; padding: 6px; width: 100%; }")


class User(Protocol):
    """What the page tells of its user."""

    def change(self, **changes: Any) -> None:
        """Change parts of the view."""
        ...

    def choose(self, damping: float, stiffness: float) -> None:
        """Run a wall."""
        ...

    def zoom(self, dampings: Span, stiffnesses: Span) -> None:
        """Show a part of the plane."""
        ...

    def zoom_time(self, span: Span | None) -> None:
        """Show a part of the run."""
        ...

    def refit(self) -> None:
        """Fit the axes of the plane to the boundary."""
        ...

    def take(self, names: list[str], contents: list[str]) -> None:
        """Take files that were dropped."""
        ...


class Address(DataModel):
    """The query of the page's address; a change of it is written there."""

    query = String()


class Page:
    """All widgets and figures of a page."""

    def __init__(self, bench: Bench, view: View, user: User) -> None:
        plane = bench.plane(view)
        force = units_of(plane, "command_limit")
        self.plane = PlaneFigure(plane, user.choose, user.zoom, user.refit)
        self.runs = RunFigures(units_of(plane, "amplitude"), force, SECONDS, user.zoom_time)
        self.sliders = Sliders(plane, lambda name, value: user.change(**{name: value}))
        self.address = Address(query=view.query())
        self.address.js_on_change(
            "query", CustomJS(code="history.replaceState(null, '', '?' + cb_obj.query)")
        )
        self.title, self.trouble, self.of_plane, self.of_wall, self.saves, self.besides = (
            _said() for _ in range(6)
        )
        self.trouble.html_attributes = {"role": "alert"}
        self.of_wall.html_attributes = {"role": "status", "aria-live": "polite"}
        self.legend = _said(words.legend(with_unit(plane.perceptible, force)))
        self._showing = False
        self._choices(bench, user)

    def _choices(self, bench: Bench, user: User) -> None:
        self.layers = _buttons([LAYER_NAMES[n] for n in LAYERS], "What the colours show")
        self._on(self.layers, "active", lambda i: user.change(layer=LAYERS[i]))
        self.devices = _buttons([d.name for d in bench.devices], "Device")
        self.devices.orientation = "vertical"
        self._on(self.devices, "active", lambda i: user.change(device=i))
        self.reset = Button(label="Sliders back to the device's own", sizing_mode="stretch_width")
        own = dict.fromkeys(("delay", "encoder_step", "command_limit", "friction"))
        self.reset.on_click(lambda: user.change(**own, start=View().start))
        self.one_sided = Checkbox(label="The wall only pushes")
        self._on(self.one_sided, "active", lambda on: user.change(one_sided=on))
        self.stiffness, self.damping = _number("K"), _number("B")
        self._on(self.stiffness, "value", lambda k: k and k > 0.0 and user.change(stiffness=k))
        self._on(
            self.damping, "value", lambda b: b is not None and b >= 0.0 and user.change(damping=b)
        )
        self.files = FileInput(
            title="Lay a recording beside the run: drop it here", multiple=True, name="recording",
            sizing_mode="stretch_width", stylesheets=[DROP],
        )  # fmt: skip
        self.recording_from = _number("Recording from [s]")
        self.recording_from.visible = bench.recording is not None
        self._on(
            self.recording_from, "value",
            lambda t: t is not None and t >= 0.0 and user.change(recording_from=t),
        )  # fmt: skip
        self.files.on_change("value", lambda *_: self._take(user))

    def _take(self, user: User) -> None:
        def take() -> None:  # after the other properties have arrived, too
            names, contents = self.files.filename, self.files.value
            if names:
                user.take(list(names), list(contents))

        if self.files.document is not None:
            self.files.document.add_next_tick_callback(take)

    def _on(self, widget: Any, name: str, call: Callable[[Any], object]) -> None:
        """Call when the user, not the program, changes a property."""
        widget.on_change(name, lambda _a, _o, new: None if self._showing else call(new))

    def layout(self, bench: Bench) -> Column:
        """Return the one root of the page."""
        devices = [self.devices] if len(bench.devices) > 1 else []
        controls = Column(
            *devices, *self.sliders.widgets.values(), self.reset, self.one_sided,
            Row(self.stiffness, self.damping, sizing_mode="stretch_width"), self.besides,
            self.saves, self.files, self.recording_from,
            width=228, sizing_mode="stretch_height", spacing=1,
        )  # fmt: skip
        plane = _column(1.45, self.layers, self.plane.figure, self.legend, self.of_plane)
        run = _column(1.1, self.of_wall, *self.runs.over_time)
        more = _column(0.8, self.runs.phase_plane, self.runs.spectrum)
        body = Row(controls, plane, run, more, sizing_mode="stretch_both", spacing=4)
        return Column(self.title, self.trouble, body, sizing_mode="stretch_both", min_height=560)

    def put_on(self, document: Document, bench: Bench) -> None:
        """Make this the content of a document."""
        document.title = f"{bench.devices[0].name} \u2013 zwidth explore"
        document.add_root(self.layout(bench))
        document.add_root(self.address)
        handles = {name: slider for name, slider in self.sliders.widgets.items()}
        document.js_on_event(DocumentReady, CustomJS(args={"sliders": handles}, code=NAME_HANDLES))

    def show_view(self, bench: Bench, view: View) -> None:
        """Set every widget to a view, and the links and the address."""
        self._showing = True
        try:
            plane = bench.plane(view)
            self.title.text = _heading(bench, view)
            self.layers.active, self.devices.active = LAYERS.index(view.layer), view.device
            self.one_sided.active = view.one_sided
            self.stiffness.value, self.damping.value = view.stiffness, view.damping
            self.recording_from.value = view.recording_from
            own = View(
                device=view.device, damping_range=view.damping_range,
                stiffness_range=view.stiffness_range,
            )  # fmt: skip
            self.sliders.show(bench.plane(own), plane, view)
        finally:
            self._showing = False
        self.besides.text = words.of_the_device(plane.device)
        assert view.damping_range is not None
        assert view.stiffness_range is not None
        self.plane.show_axes(view.damping_range, view.stiffness_range)
        others = [bench.line(_of(view, i)) for i in range(len(bench.devices)) if i != view.device]
        self.plane.show_lines(bench.line(view), others[0] if others else None)
        self.plane.show_measured(bench.measured(view), plane.device.interface.delay)
        self.plane.show_choice(view.damping, view.stiffness)
        self.address.query = view.query()
        self.saves.text = SAVES.format(query=escape(view.query()))

    def say_wall(self, html: str) -> None:
        """Say what becomes of the wall that is chosen."""
        self.of_wall.text = html

    def say_plane(self, text: str) -> None:
        """Say what the plane shows and how far it is."""
        self.of_plane.text = f'<span style="color:#444">{escape(text)}</span>'

    def say_recording(self, names: Sequence[str], trace: Trace) -> None:
        """Say which recording lies beside the run."""
        self.files.title = f"Beside the run: {', '.join(names)}, {trace.t[-1] - trace.t[0]:.3g} s"
        self.recording_from.visible = True

    def complain(self, text: str) -> None:
        """Say what went wrong, or with no text that nothing does any more."""
        self.trouble.text = f'<b style="color:#8b0000">{escape(text)}</b>' if text else ""
        self.trouble.visible = bool(text)


SAVES = (
    'Save this run: <a href="run.mcap?{query}" download>log (MCAP)</a>,'
    ' <a href="run.toml?{query}" download>scenario</a>'
)
NAME_HANDLES = """
for (const [name, slider] of Object.entries(sliders)) {
  const view = Bokeh.index.find_one(slider)
  const handle = view?.el.shadowRoot?.querySelector(".noUi-handle")
  handle?.setAttribute("aria-label", slider.title)
}
"""


def _heading(bench: Bench, view: View) -> str:
    name = escape(bench.devices[view.device].name)
    return (
        f'<h1 style="font-size:17px;margin:0;display:inline">{name}</h1>&emsp;'
        "Every point of the plane is a virtual wall, its colour what a run that starts inside it"
        " does in the end. <b>Click a wall</b> to see its run; <b>move a slider</b> to change the"
        " device: with an encoder step, stable walls begin to buzz."
    )


def _of(view: View, device: int) -> View:
    from dataclasses import replace

    return replace(view, device=device)


def _said(text: str = "") -> Div:
    return Div(text=text, sizing_mode="stretch_width", stylesheets=[NARROW])


def _buttons(labels: Sequence[str], what: str) -> RadioButtonGroup:
    return RadioButtonGroup(
        labels=list(labels), active=0, sizing_mode="stretch_width",
        html_attributes={"aria-label": what},
    )  # fmt: skip


def _number(title: str) -> NumericInput:
    return NumericInput(title=title, mode="float", sizing_mode="stretch_width", width=90)


def _column(share: float, *children: UIElement) -> Column:
    return Column(*children, sizing_mode="stretch_both", spacing=2, styles={"flex": f"{share} 1 0"})
