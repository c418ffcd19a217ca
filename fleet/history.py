"""Changes over time: steps and drifts of parameters over the dates, and on which device.

Recordings of one device at dates t_j give values y_j of one parameter with deviations s_j (their
errors, and the scatter of repeats). A constant value is compared with

    step:  y = a + b [t >= t_k],            drift:  y = a + b max(0, t - t_0) / (t_end - t_0),

each fitted by weighted least squares; the gain is the decrease of chi-square. The penalty has a
term for the amount of the change (2 ln of its range over its error - ln 2 pi) and one for all
parameters, devices, shapes and dates that were tried; the gain must exceed the penalty by 2 ln (1 /
ALPHA). The 95 % interval of a step contains the dates that cost at most 7.35 more than the best
(Hansen, Econometrica 68, 2000); for the beginning of a drift the limit is 3.84. A change of all
devices together is sought in the same way, with each device's own mean subtracted.

A single outlier also looks like a step or a drift. So a change must cost less than a model in which
one recording has its own value and the others are constant: without that recording the weighted
squares about the mean are smaller by w_i (y_i - mean)^2 / (1 - w_i / sum w), and the penalty is for
the amount and for the choice of the recording.

Limits: one change per parameter and device; a step needs two recordings on either side, since one
alone would be an outlier. If there are more than 200 dates, only every second, third, ... is tried.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.selection.evidence import ALPHA
from zwidth.fleet.grouping import places_by
from zwidth.shown import Valued

Floats = NDArray[np.float64]
STEP, DRIFT = "step", "drift"
FEWEST = 4  # least number of dated recordings
SIDE = 2  # recordings on either side of a step
DATED, BEGUN = -2.0 * math.log(1.0 - math.sqrt(0.95)), 3.84
DATES = 200  # most dates that are tried as the beginning of a change
BELIEVED = 2.0 * math.log(1.0 / ALPHA)
ALL = "all devices"


@dataclass(frozen=True)
class Change(Valued):
    """A change of a parameter of a device, in the parameter's unit.

    at: days since 1970 of a step, or of the beginning of a drift; between: its 95 % interval.
    before, after: values before the change and at the last date; error: of their difference;
    gained: gain in chi-square less all penalties.
    """

    device: str
    parameter: str
    shape: str
    at: float
    between: tuple[float, float]
    before: float
    after: float
    error: float
    gained: float

    def share(self, day: Floats, end: float) -> Floats:
        """Return the share of the change that had happened by each day; end: the last day."""
        if self.shape == STEP:
            return (day >= self.at).astype(np.float64)
        return np.clip((day - self.at) / max(end - self.at, 1e-9), 0.0, 1.0)


def date_of(day: float) -> str:
    """Return a day since 1970 as a date."""
    return datetime.fromtimestamp(86400.0 * day, UTC).date().isoformat()


def changes(
    parameter: str,
    days: Floats,
    values: Floats,
    errors: Floats,
    devices: Sequence[str],
    scatter: float,
    asked: int,
) -> list[Change]:
    """Return the changes of a parameter: on single devices, and on all together.

    days, values, errors (n,); scatter: of repeats beyond their errors; asked: how many parameters
    and devices are tried in total.
    """
    told = np.isfinite(days) & np.isfinite(errors)
    s = np.sqrt(errors**2 + scatter**2)
    every = places_by(devices)
    found: list[Change] = []
    off = values.copy()
    for name, own in every.items():
        mine = own[told[own]]
        one = _changed(name, parameter, days[mine], values[mine], s[mine], asked)
        found += [] if one is None else [one]
        if mine.size:
            off[own] -= float(np.average(values[mine], weights=1.0 / s[mine] ** 2))
    if len(every) > 1:
        others = told.copy()
        for one in found:
            others[every[one.device]] = False
        if others.any():
            middle = float(np.median(values[others]))
            one = _changed(ALL, parameter, days[others], off[others] + middle, s[others], asked)
            found += [] if one is None else [one]
    return found


def _changed(
    device: str, parameter: str, day: Floats, y: Floats, s: Floats, asked: int
) -> Change | None:
    if y.size < FEWEST or np.ptp(day) == 0.0:
        return None
    order = np.argsort(day, kind="stable")
    day, y, s = day[order], y[order], s[order]
    every = np.unique(day)
    size = max(float(np.ptp(y)), abs(float(np.median(y))))
    before = np.searchsorted(day, every[1:])  # number of recordings before each possible step
    steps = every[1:][(before >= SIDE) & (before <= y.size - SIDE)]
    if steps.size > DATES:
        steps = steps[np.linspace(0, steps.size - 1, DATES).round().astype(int)]
    begins = np.linspace(day[0], day[-1], DATES, endpoint=False)
    begins = begins[begins <= every[-2]] if every.size > 2 else begins[:0]
    best: Change | None = None
    for shape, times in ((STEP, steps), (DRIFT, begins)):
        if times.size == 0:
            continue
        flat, costs, a, b, errors = _fits(y, s, _columns(shape, day, times))
        i = int(np.argmin(costs))
        error = float(errors[i])
        choices = times.size if shape == STEP else every.size
        price = 2.0 * math.log(2.0 * size / max(error, 1e-300)) - math.log(2.0 * math.pi)
        price += 2.0 * math.log(2.0 * max(1, asked) * choices)
        gained = min(flat, _one_off(y, s, size, asked)) - float(costs[i]) - price
        near = np.flatnonzero(costs <= costs[i] + (DATED if shape == STEP else BEGUN))
        between = float(times[near[0]]), float(times[near[-1]])
        if shape == STEP:  # the step was between two recordings
            between = float(day[day < between[0]].max()), between[1]
        else:
            apart = float(day[-1] - day[0]) / DATES
            between = max(float(day[0]), between[0] - apart), between[1] + apart
        if gained > BELIEVED and (best is None or gained > best.gained):
            own = float(a[i]), float(a[i] + b[i])
            best = Change(device, parameter, shape, float(times[i]), between, *own, error, gained)
    return best


def _one_off(y: Floats, s: Floats, size: float, asked: int) -> float:
    """The cost of a model in which one recording is off and all others have one value."""
    w = 1.0 / s**2
    left = 1.0 - w / w.sum()
    off = y - float(w @ y) / w.sum()
    without = float(w @ off**2) - w * off**2 / left
    error = s / np.sqrt(left)
    price = 2.0 * np.log(2.0 * size / error) - math.log(2.0 * math.pi)
    return float(np.min(without + price)) + 2.0 * math.log(2.0 * max(1, asked) * y.size)


def _columns(shape: str, day: Floats, at: Floats) -> Floats:
    """Share of a change that has happened by each day, for each possible beginning."""
    if shape == STEP:
        return (day >= at[:, None]).astype(np.float64)
    return np.maximum(0.0, day - at[:, None]) / (day[-1] - at[:, None])


def _fits(y: Floats, s: Floats, columns: Floats) -> tuple[float, Floats, Floats, Floats, Floats]:
    """Weighted straight lines over each column (times, n).

    Returns chi-square of a constant, then, each (times,): chi-square, value before, amount of
    change and error of the amount.
    """
    w = 1.0 / s**2
    mean, means = float(w @ y) / w.sum(), columns @ w / w.sum()
    off, about = columns - means[:, None], y - mean
    square, mixed = off**2 @ w, off @ (w * about)
    b = mixed / square
    flat = float(w @ about**2)
    return flat, flat - mixed * b, mean - b * means, b, 1.0 / np.sqrt(square)
