"""The devices of the page, and the results that a view needs from them, without the browser."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from zwidth.controllers.wall import wall
from zwidth.diagnosis.answer.words import effect_in_words
from zwidth.explore.measured import MeasuredPoint, measured_on
from zwidth.explore.view import Span, View
from zwidth.scenarios.scenario import Scenario, usual_substeps
from zwidth.sim.device import Device, place_label
from zwidth.sim.interface import INTERFACE_FIELDS
from zwidth.sim.run import Start
from zwidth.sim.trace import Trace
from zwidth.stability.judging import Trial
from zwidth.stability.linear import boundary, has_theory, last_stable_damping, stand_in
from zwidth.stability.plane import Axis, Plane, with_friction

Floats = NDArray[np.float64]
SECONDS, LIMIT_S, WINDOW_S = 4.0, 16.0, 0.5
LINE_POINTS = 61
WITHOUT_BOUNDARY = (0.1, 50.0)  # ends of the axes for B and K if no wall is stable
ONE_BRANCH = 0.2  # of a frequency: neighbouring dampings within it have the same oscillation
LOST = 100.0  # times the start, or ten encoder steps, at which an unlimited run is cut off


@dataclass(frozen=True, eq=False)
class Line:
    """The linear boundary: B, K_CR and ultimate frequency [Hz], each (n,); NaN where none.

    without: the estimator of velocity that linear theory does not support, "" if it does.
    """

    damping: Floats
    stiffness: Floats
    frequency: Floats
    without: str = ""

    @property
    def top(self) -> float | None:
        """The highest K of the line."""
        return float(np.nanmax(self.stiffness)) if np.isfinite(self.stiffness).any() else None

    def at(self, damping: float) -> tuple[float, float] | None:
        """Return (K_CR, frequency) at a damping between its ends, None if no K is stable."""
        k = float(np.interp(damping, self.damping, self.stiffness, right=math.nan))
        if not k > 0.0:
            return None
        beside = np.argsort(np.abs(self.damping - damping))[:2]
        a, b = self.frequency[beside]
        if not abs(b - a) <= ONE_BRANCH * a:  # another oscillation limits K there
            return k, float(a)
        beside = np.sort(beside)
        return k, float(np.interp(damping, self.damping[beside], self.frequency[beside]))


@dataclass(frozen=True, eq=False)
class Bench:
    """The devices of the page, the nominal one first, and a recording to draw beside every run.

    Raises ValueError for a device that a map cannot use.
    """

    devices: Sequence[Device]
    recording: Trace | None = None

    def __post_init__(self) -> None:
        if len({d.rotary for d in self.devices}) > 1:
            raise ValueError("one device is rotary and another is not; compare devices of one kind")
        for number in range(len(self.devices)):
            self.plane(View(device=number, damping_range=(0.0, 1.0), stiffness_range=(0.0, 1.0)))

    @cached_property
    def names(self) -> list[str]:
        """The devices' names, all different: if two are equal, the added effects are named."""
        first = self.devices[0]
        found = [first.name]
        for device in self.devices[1:]:
            name = device.name
            if name in found:
                name = f"with {added(first, device) or 'other parameters'}"
            found.append(name if name not in found else f"{name} ({len(found) + 1})")
        return found

    def device(self, view: View) -> Device:
        """Return the device of a view, with the settings of its sliders."""
        own = self.devices[view.device]
        changes = {
            name: value
            for name in ("delay", "encoder_step", "command_limit")
            if (value := getattr(view, name)) is not None
        }
        device = own.with_interface(**changes) if changes else own
        return device if view.friction is None else with_friction(device, view.friction)

    def plane(self, view: View) -> Plane:
        """Return the plane of a view that has ranges for both axes; raises ValueError."""
        assert view.damping_range is not None
        assert view.stiffness_range is not None
        device = self.device(view)
        low, high = view.stiffness_range
        trial = Trial(
            view.start, SECONDS, LIMIT_S, WINDOW_S,
            substeps=usual_substeps(device),
        )  # fmt: skip
        return Plane(
            device, Axis("B", *view.damping_range), Axis("K", max(low, 0.004 * high), high),
            trial=trial, one_sided=view.one_sided,
        )  # fmt: skip

    def scenario(self, view: View) -> Scenario:
        """Return the experiment of the chosen wall, as it is run, logged and saved."""
        assert view.stiffness is not None
        assert view.damping is not None
        device = self.device(view)
        unlimited = math.isinf(device.interface.command_limit)
        bound = LOST * max(view.start, 10.0 * device.interface.encoder_step)
        law = wall(view.stiffness, view.damping, 0.0, view.one_sided)
        return Scenario(device, law, SECONDS, Start(view.start), bound=bound if unlimited else 1e6)

    def line(self, view: View) -> Line:
        """Return the linear boundary of the device of a view."""
        device = self.device(view)
        if not has_theory(device):
            nothing = np.full(2, math.nan)
            estimator = device.interface.velocity_estimator
            return Line(np.array([0.0, 1.0]), nothing, nothing, estimator)
        return self._guide(view)

    def _guide(self, view: View) -> Line:
        """The line that says where the axes go: of what stands in where there is no theory."""
        linear = with_friction(stand_in(self.device(view)), 0.0)
        return _line(linear.with_interface(encoder_step=0.0, command_limit=math.inf))

    def measured(self, view: View) -> list[MeasuredPoint]:
        """Return the points measured on the real device, or on that of the first device."""
        return measured_on({self.devices[view.device].name, self.devices[0].name})

    def fitted(self, view: View) -> View:
        """Return the view with axes around the boundary and the points measured at its delay."""
        dampings, stiffnesses = self._extent(view)
        return replace(
            view,
            damping_range=(0.0, _rounded(1.15 * dampings)),
            stiffness_range=(0.0, _rounded(1.25 * stiffnesses)),
        )

    def still_fits(self, view: View) -> bool:
        """Whether the boundary is neither cut off by the axes of a view nor too small in them."""
        if view.damping_range is None or view.stiffness_range is None:
            return False
        pairs = zip(self._extent(view), (view.damping_range, view.stiffness_range), strict=True)
        return all(_fits(extent, span) for extent, span in pairs)

    def _extent(self, view: View) -> tuple[float, float]:
        line, delay = self._guide(view), self.device(view).interface.delay
        here = [p for p in self.measured(view) if abs(p.delay - delay) < 1e-9]
        if line.top is None:
            return WITHOUT_BOUNDARY
        return (
            max([float(line.damping[-1]), *(p.damping for p in here)]),
            max([line.top, *(p.stiffness for p in here)]),
        )


def added(before: Device, after: Device) -> str:
    """Return in words what a device has that another lacks or has with other values."""
    effects = {place_label(p): p for p in before.physics}
    words = [place_label(p) for p in after.physics if effects.get(place_label(p)) != p]
    words += [
        f for f in INTERFACE_FIELDS if getattr(before.interface, f) != getattr(after.interface, f)
    ]
    return ", ".join(effect_in_words(w).replace("@", " at ") for w in words)


def _rounded(value: float) -> float:
    return float(f"{value:.2g}")


def _fits(extent: float, span: Span) -> bool:
    return 0.3 * span[1] <= extent <= 0.97 * span[1]


@lru_cache(maxsize=256)
def _line(device: Device) -> Line:
    last = last_stable_damping(device)
    if last is None:
        nothing = np.full(2, math.nan)
        return Line(np.array([0.0, 1.0]), nothing, nothing)
    points = boundary(device, np.linspace(0.0, last, LINE_POINTS)[:-1])
    k = [math.nan if p.stiffness is None else p.stiffness for p in points]
    f = [math.nan if p.frequency_hz is None else p.frequency_hz for p in points]
    dampings = [*(p.damping for p in points), last]
    return Line(np.array(dampings), np.array([*k, 0.0]), np.array([*f, f[-1]]))
