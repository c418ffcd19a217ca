"""The controls of the page: sliders, buttons, numbers, and the area for dropping a recording."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Protocol

from bokeh.models import (
    Button,
    Checkbox,
    FileInput,
    NumericInput,
    RadioButtonGroup,
    Row,
    UIElement,
)

from zwidth.explore.bench import Bench
from zwidth.explore.sliders import Sliders
from zwidth.explore.view import LAYERS, Span, View
from zwidth.stability.fate_map import units_of

LAYER_NAMES = {"fate": "Outcome", "amplitude": "Amplitude", "frequency": "Frequency"}
OF_SLIDERS = ("delay", "encoder_step", "command_limit", "friction", "start")
LONG_LABELS = ".bk-btn { white-space: normal; padding: 4px 8px; }"
DROP = "input { border: 1px dashed #777; padding: 6px; width: 100%; }"


class User(Protocol):
    """The actions of the user, as the page reports them."""

    def change(self, **changes: Any) -> None:
        """Change parts of the view."""
        ...

    def refuse(self, sentence: str) -> None:
        """Say why an entry is refused, and show the present value."""
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


class Controls:
    """All widgets that change the view; `show` sets them to a view without reporting a change."""

    def __init__(self, bench: Bench, view: View, user: User) -> None:
        plane = bench.plane(view)
        self.sliders = Sliders(plane, lambda name, value: user.change(**{name: value}))
        self.layers = _buttons([LAYER_NAMES[n] for n in LAYERS], "What the colours show")
        self.devices = _buttons(bench.names, "Device")
        self.devices.update(
            orientation="vertical", visible=len(bench.devices) > 1, stylesheets=[LONG_LABELS]
        )
        self.reset = Button(label="Reset the sliders to the device", sizing_mode="stretch_width")
        self.one_sided = Checkbox(label="The wall only pushes")
        self.stiffness, self.damping = (_number(f"{q} [{units_of(plane, q)}]") for q in "KB")
        self.files = FileInput(
            title="Recording to draw beside the run:", multiple=True, name="recording",
            sizing_mode="stretch_width", stylesheets=[DROP],
        )  # fmt: skip
        self.recording_from = _number("Recording from [s]")
        self.recording_from.visible = bench.recording is not None
        self._showing = False
        self._connect(user)

    def _connect(self, user: User) -> None:
        self._on(self.layers, "active", lambda i: user.change(layer=LAYERS[i]))
        self._on(self.devices, "active", lambda i: user.change(device=i))
        self._on(self.one_sided, "active", lambda on: user.change(one_sided=on))
        first = {name: getattr(View(), name) for name in OF_SLIDERS}
        self.reset.on_click(lambda: user.change(**first))
        for widget, name, above in (
            (self.stiffness, "stiffness", True),
            (self.damping, "damping", False),
            (self.recording_from, "recording_from", False),
        ):
            self._on(widget, "value", _number_taker(user, name, str(widget.title), above))
        self._on(self.files, "value", lambda _: self._take(user))

    def _on(self, widget: Any, name: str, call: Callable[[Any], object]) -> None:
        """Call when the user, not the program, changes a property."""

        def changed(attr: str, old: Any, new: Any) -> None:
            if not self._showing:
                call(new)

        widget.on_change(name, changed)

    def _take(self, user: User) -> None:
        def take() -> None:  # also after the names of the files have arrived
            if names := self.files.filename:
                user.take(list(names), list(self.files.value))

        if self.files.document is not None:
            self.files.document.add_next_tick_callback(take)

    def column(self) -> list[UIElement]:
        """Return the column beside the plane, from the top."""
        walls = Row(children=[self.stiffness, self.damping], sizing_mode="stretch_width")
        return [
            self.devices, *self.sliders.widgets.values(), self.reset, self.one_sided, walls,
        ]  # fmt: skip

    def nameless(self) -> dict[str, UIElement]:
        """Return the widgets without an accessible name from Bokeh, each by the name it needs."""
        names: dict[str, UIElement] = {str(s.title): s for s in self.sliders.widgets.values()}
        return names | {str(self.one_sided.label): self.one_sided}

    def show(self, bench: Bench, view: View) -> None:
        """Set every widget to a view."""
        self._showing = True
        try:
            self.layers.active, self.devices.active = LAYERS.index(view.layer), view.device
            self.one_sided.active = view.one_sided
            self.stiffness.value, self.damping.value = view.stiffness, view.damping
            self.recording_from.value = view.recording_from
            own = replace(view, **{name: getattr(View(), name) for name in OF_SLIDERS})
            self.sliders.show(bench.plane(own), bench.plane(view), view)
        finally:
            self._showing = False


def _number_taker(user: User, name: str, title: str, above: bool) -> Callable[[Any], None]:
    least = "above 0" if above else "0 or more"

    def take(value: float | None) -> None:
        if value is not None and (value > 0.0 if above else value >= 0.0):
            user.change(**{name: float(value)})
        else:
            said = "no number" if value is None else f"{value:g}"
            user.refuse(f"{title} is {said}; give a number {least}")

    return take


def _buttons(labels: Sequence[str], what: str) -> RadioButtonGroup:
    return RadioButtonGroup(
        labels=list(labels), active=0, sizing_mode="stretch_width",
        html_attributes={"role": "group", "aria-label": what},
    )  # fmt: skip


def _number(title: str) -> NumericInput:
    return NumericInput(title=title, mode="float", sizing_mode="stretch_width", width=90)
