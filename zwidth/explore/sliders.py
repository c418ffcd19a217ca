"""The five sliders: their names, their values, and their meaning for the device."""

from collections.abc import Callable
from dataclasses import dataclass

from bokeh.models import CategoricalSlider

from zwidth.explore.stops import Stops, decades, stops
from zwidth.explore.view import View
from zwidth.stability.fate_map import units_of
from zwidth.stability.plane import Plane

TITLES = {
    "encoder_step": "Encoder step",
    "command_limit": "Command limit",
    "delay": "Delay",
    "friction": "Friction at m1",
    "start": "Start amplitude",
}
WRAPPED = ".bk-slider-title { white-space: normal; overflow-wrap: anywhere; }"
MOST_DELAY = 10  # ticks, in tenths


@dataclass(frozen=True)
class Kind:
    """The possible values of a slider, and how its unit is written."""

    values: list[float]
    unit: str
    nothing: float | None


def kinds(plane: Plane) -> dict[str, Kind]:
    """Return the sliders of a device, name -> possible values."""
    rotary, period = plane.device.rotary, plane.device.interface.period
    force = units_of(plane, "command_limit")
    delays = [round(0.1 * k * 1e9 * period) * 1e-9 for k in range(10 * MOST_DELAY + 1)]
    up = 0 if rotary else 2  # forces in N are typically 100 times the torques in N m
    return {
        "encoder_step": Kind(decades(-7, -2), units_of(plane, "encoder_step"), 0.0),
        "command_limit": Kind(decades(-3 + up, 1 + up), force, float("inf")),
        "delay": Kind([float(f"{d:.6g}") for d in delays], "s", 0.0),
        "friction": Kind(decades(-5 + up, -1 + up), force, 0.0),
        "start": Kind(decades(-6, -1), units_of(plane, "amplitude"), None),
    }


class Sliders:
    """The widgets; `moved(name, value)` is called when the user moves one.

    The value is None if the slider is at the device's own value.
    """

    def __init__(self, plane: Plane, moved: Callable[[str, float | None], None]) -> None:
        self.widgets: dict[str, CategoricalSlider] = {}
        self._stops: dict[str, Stops] = {}
        self._own: dict[str, float | None] = {}
        self._moved = moved
        self._showing = False
        for name, title in TITLES.items():
            slider = CategoricalSlider(
                categories=["none", "-"], value="none", title=title, name=name,
                sizing_mode="stretch_width", tooltips=False, stylesheets=[WRAPPED],
            )  # fmt: skip
            slider.on_change("value", lambda _a, _o, text, n=name: self._on_value(n, text))
            self.widgets[name] = slider
        self.show(plane, plane, View())

    def show(self, own: Plane, present: Plane, view: View) -> None:
        """Set all sliders. own, present: planes of the device itself and of the changed device."""
        self._showing = True
        try:
            for name, kind in kinds(own).items():
                if name == "start":
                    mine, value = None, view.start
                else:
                    mine, value = own.setting(name), present.setting(name)  # pyright: ignore[reportArgumentType]
                found = stops(kind.values, kind.unit, mine, value, kind.nothing)
                self._stops[name], self._own[name] = found, mine
                slider = self.widgets[name]
                if slider.categories != list(found.labels):
                    slider.categories = list(found.labels)
                if slider.value != (label := found.label(value)):
                    slider.value = label
        finally:
            self._showing = False

    def _on_value(self, name: str, text: str) -> None:
        if self._showing or text not in self._stops[name].labels:
            return
        value = self._stops[name].value(text)
        self._moved(name, None if value == self._own[name] else value)
