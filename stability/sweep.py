"""The Z-width over one setting of the interface, and the value at which it is widest.

The Z-width is the area of stable walls in the plane of damping B and stiffness K: the area under
the boundary K_CR(B), from B = 0 to the last B with a stable wall. Over the cut-off of the velocity
filter it has a maximum: a low cut-off delays the damping force, a high one lets the encoder's steps
and the device's fast modes through (V. Chawda, O. Celik, M. K. O'Malley, A method for selecting
velocity filter cut-off frequency for maximizing impedance width performance in haptic interfaces,
J. Dynamic Systems, Measurement, and Control 137, 024503, 2015, who found this by simulation, as
here, and confirmed it on a device).

Each value has its own grid of dampings, up to a little beyond the last B that is stable by linear
theory; the area is computed by trapezoids, in the time domain and by theory.

Limits: with friction, walls beyond the grid may be stable; the area does not include them.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from zwidth.shown import Shown, Valued
from zwidth.sim.device import Device
from zwidth.sim.nearest import nearest
from zwidth.stability.bisection import Bracket, Search, find_brackets
from zwidth.stability.judging import Trial
from zwidth.stability.linear import has_theory, known_boundary, last_stable_damping, stand_in

Floats = NDArray[np.float64]
Setting = Literal["cutoff", "period", "delay", "encoder_step", "velocity_ticks", "position_ticks"]
DAMPINGS = 21
BEYOND = 1.1  # end of a grid of dampings, over the last stable B
ROUNDS = 2  # of refinement around the best value
TOLERANCE = 5e-3
WHOLE: tuple[Setting, ...] = ("velocity_ticks", "position_ticks")


class Swept(NamedTuple):
    """A setting: its field in the interface, its unit, and the default values of a sweep."""

    field: str
    unit: str
    usual: Callable[[Device], Floats]


def _cutoffs(device: Device) -> Floats:
    """Cut-off frequencies from 5 Hz to half the rate of the estimates."""
    return np.geomspace(5.0, 0.5 / device.interface.velocity_period, 13)


def _periods(device: Device) -> Floats:
    return device.interface.period / np.array([20.0, 10.0, 5.0, 2.0, 1.0])


def _delays(device: Device) -> Floats:
    return device.interface.period * np.array([0.0, 0.5, 1.0, 2.0, 4.0, 8.0])


def _encoder_steps(_: Device) -> Floats:
    return np.geomspace(1e-6, 1e-3, 7)


def _ticks(_: Device) -> Floats:
    return np.array([1.0, 2.0, 3.0, 5.0, 10.0, 20.0])


SWEPT: dict[Setting, Swept] = {
    "cutoff": Swept("velocity_cutoff_hz", "Hz", _cutoffs),
    "period": Swept("period", "s", _periods),
    "delay": Swept("delay", "s", _delays),
    "encoder_step": Swept("encoder_step", "rad | m", _encoder_steps),
    "velocity_ticks": Swept("velocity_ticks", "samples", _ticks),
    "position_ticks": Swept("position_ticks", "samples", _ticks),
}


@dataclass(frozen=True)
class Step(Valued):
    """One value of the setting: the device with it, and the boundary over its dampings.

    linear, simulated (dampings,): K_CR [N m/rad | N/m], 0 where no K is stable; simulated is the
    middle of each bracket; linear is NaN where the velocity's estimator has no linear theory.
    """

    value: float
    device: Device
    dampings: Floats
    linear: Floats
    simulated: Floats

    @property
    def area(self) -> float:
        """The Z-width in the time domain, K B [(N m/rad)^2 s | (N/m)^2 s]."""
        return float(np.trapezoid(self.simulated, self.dampings))

    @property
    def linear_area(self) -> float:
        """The Z-width by linear theory, in the same unit."""
        return float(np.trapezoid(self.linear, self.dampings))

    @property
    def stiffest(self) -> float:
        """The largest K that is stable at some damping, in the time domain."""
        return float(self.simulated.max())


@dataclass(frozen=True, repr=False)
class Sweep(Shown):
    """A device's Z-width as a function of a setting; steps in rising order of the setting."""

    device: Device
    setting: Setting
    steps: tuple[Step, ...]

    @cached_property
    def best(self) -> Step:
        """The step with the widest Z-width in the time domain."""
        return max(self.steps, key=lambda step: step.area)

    @cached_property
    def best_by_theory(self) -> Step | None:
        """The step with the widest Z-width by linear theory, None if that does not apply."""
        if not has_theory(self.device):
            return None
        return max(self.steps, key=lambda step: step.linear_area)

    @property
    def unit(self) -> str:
        """The unit of the setting."""
        unit = SWEPT[self.setting].unit
        return ("rad" if self.device.rotary else "m") if "|" in unit else unit

    @property
    def without(self) -> Step | None:
        """The step with the device's own value of the setting, None if this was not tried."""
        own = getattr(self.device.interface, SWEPT[self.setting].field)
        return next((step for step in self.steps if step.value == own), None)


def sweep(
    device: Device,
    setting: Setting,
    values: Sequence[float] | Floats | None = None,
    *,
    dampings: int = DAMPINGS,
    rounds: int = ROUNDS,
    trial: Trial = Trial(),
    search: Search = Search(tolerance=TOLERANCE),
    progress: Callable[[int, int], None] | None = None,
) -> Sweep:
    """Find the Z-width of a device over one setting of its interface.

    values: of the setting, by default its usual range; the device's own value is always tried too.
    dampings: how many per boundary. rounds: how many times two more values are tried beside the
    best, unless the setting is a whole number. progress: called with boundaries done and planned.

    Raises ValueError for an unknown setting, a value that the interface does not take, or a device
    that has no stable wall at any value.
    """
    if setting not in SWEPT:
        raise ValueError(f"setting is {setting!r}; {nearest(setting, get_args(Setting))}")
    if dampings < 3:
        raise ValueError(f"dampings is {dampings}; a boundary needs at least 3")
    swept = SWEPT[setting]
    given = swept.usual(device) if values is None else np.asarray(values, np.float64)
    if given.size == 0 or np.isnan(given).any():
        raise ValueError(f"values of {setting} are {given.tolist()}; give at least one number")
    own = float(getattr(device.interface, swept.field))
    rounds = 0 if setting in WHOLE else rounds
    planned = np.union1d(given, [own])
    steps: dict[float, Step] = {}
    total = planned.size + 2 * rounds
    for _ in range(rounds + 1):
        for value in planned.tolist():
            steps[value] = _step(device, swept.field, value, dampings, trial, search)
            if progress is not None:
                progress(len(steps), total)
        best = max(steps.values(), key=lambda step: step.area).value
        planned = _beside(best, np.array(sorted(steps)))
        if planned.size == 0:
            break
    found = Sweep(device, setting, tuple(steps[value] for value in sorted(steps)))
    if found.best.area == 0.0:
        raise ValueError(
            f"{device.name} has no stable wall at any of the {len(steps)} values of {setting};"
            " shorten its delay, or try other values"
        )
    return found


def _beside(best: float, known: Floats) -> Floats:
    """Return the values halfway between the best and its neighbours."""
    place = int(np.searchsorted(known, best))
    near = [known[i] for i in (place - 1, place + 1) if 0 <= i < known.size]
    ratios = best > 0.0 and math.isfinite(best)
    return np.array(
        [math.sqrt(best * n) if ratios and n > 0.0 else 0.5 * (best + n) for n in near
         if math.isfinite(n) and math.isfinite(best)]
    )  # fmt: skip


def _step(
    device: Device, field: str, value: float, dampings: int, trial: Trial, search: Search
) -> Step:
    own = device.with_interface(**{field: int(value) if field in WHOLE else value})
    last = last_stable_damping(stand_in(own))
    if not last or last <= 0.0:
        nothing = np.zeros(dampings)
        return Step(value, own, nothing, nothing, nothing)
    grid = np.linspace(0.0, BEYOND * last, dampings)
    nothing = 0.0 if has_theory(own) else math.nan
    theory = np.array([p.stiffness or nothing for p in known_boundary(own, grid.tolist())])
    period = own.interface.period
    judged = replace(trial, window_s=max(trial.window_s, 8.0 * period))
    found = find_brackets([own], [grid], judged, search)[0]
    return Step(value, own, grid, theory, np.array([_middle(bracket) for bracket in found]))


def _middle(bracket: Bracket) -> float:
    if bracket.stable is None:
        return 0.0
    return 0.5 * (bracket.stable + (bracket.unstable or bracket.stable))
