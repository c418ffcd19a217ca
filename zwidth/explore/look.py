"""The run of one wall: how it ends, its samples, and its spectrum over a part of them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import periodogram

from zwidth.explore.bench import Bench
from zwidth.explore.view import View
from zwidth.sim.run import Outcome
from zwidth.sim.trace import Trace
from zwidth.stability.fates import Fates, evaluate

Floats = NDArray[np.float64]
HIGHEST = 1e100  # largest value that is drawn
ROOM = 3.0  # times a run's size: room of an axis for other curves
FAINT = 1e-15  # in SI: smaller curves are rounding of a device at rest
FEWEST_SAMPLES = 16  # least samples of a spectrum
NOT_SPENT = ("work_motor", "work_disturbance", "work_wall", "work_actuator_lag")


@dataclass(frozen=True, eq=False)
class Look:
    """A run of the chosen wall of a view, with its fate (one point) as in the plane."""

    view: View
    trace: Trace
    outcome: Outcome
    fates: Fates


def look(bench: Bench, view: View) -> Look:
    """Run the wall of a view that has a wall and axes; raises ValueError."""
    scenario = bench.scenario(view)
    setup = scenario.prepare()
    (trace, _, outcome), *_ = setup.blocks(setup.ticks)
    point = np.array([view.damping]), np.array([view.stiffness])
    with np.errstate(over="ignore"):  # unlimited growth
        fates = evaluate(bench.plane(view), *point, workers=1)
    return Look(view, trace, outcome, fates)


def columns(trace: Trace, shift: float = 0.0, until: float = np.inf) -> dict[str, Floats]:
    """Return the curves over time as columns, NaN if a trace lacks one.

    t counts from `shift` on, and ends at `until` if that comes first.
    """
    part = trace.between(shift, shift + until)
    t = part.t - shift
    nothing = np.full(t.size, np.nan)
    channels = {n: np.where(np.abs(v) < HIGHEST, v, np.nan) for n, v in part.channels.items()}
    position = channels.get("position_m1", nothing)
    velocity = channels.get("velocity_m1")
    if velocity is None:
        velocity = np.gradient(position, t) if t.size > 2 else nothing
    spent = [v for n, v in channels.items() if n.startswith("work_") and n not in NOT_SPENT]
    return {
        "t": t,
        "position": position,
        "velocity": velocity,
        "command": channels.get("command", nothing),
        "contact": channels.get("contact", nothing),
        "stored": channels.get("stored_energy", nothing),
        "motor": channels.get("work_motor", nothing),
        "spent": np.sum(spent, axis=0) if spent else nothing,
    }


def within(drawn: dict[str, Floats], span: tuple[float, float] | None) -> dict[str, Floats]:
    """Return the samples of a time span."""
    if span is None:
        return drawn
    kept = (drawn["t"] >= span[0]) & (drawn["t"] <= span[1])
    return {name: values[kept] for name, values in drawn.items()}


def spectrum(drawn: dict[str, Floats]) -> dict[str, Floats]:
    """Return the amplitude spectrum of the position: frequency [Hz], amplitude.

    A sine of amplitude a has a line of height a (Hann window, mean removed). Samples that are not
    evenly spaced are interpolated first. Empty if there are too few.
    """
    known = np.isfinite(drawn["position"])
    t, position = drawn["t"][known], drawn["position"][known]
    if t.size < FEWEST_SAMPLES or not t[-1] > t[0]:
        return {"frequency": np.zeros(0), "amplitude": np.zeros(0)}
    even = np.linspace(t[0], t[-1], t.size)
    rate = (t.size - 1) / (t[-1] - t[0])
    frequency, power = periodogram(
        np.interp(even, t, position), rate, window="hann", scaling="spectrum"
    )
    height = np.sqrt(2.0 * power[1:])
    return {"frequency": frequency[1:], "amplitude": np.where(height > FAINT, height, np.nan)}


def reach(values: Floats) -> float:
    """Return the largest absolute value; 0 for none."""
    return float(np.nanmax(np.abs(values), initial=0.0))


def fitting(run: Floats, others: Sequence[Floats]) -> tuple[float, float]:
    """Return an axis for a run; other curves count up to three times its size."""
    most = ROOM * reach(run)
    seen = [np.clip(v, -most, most) if most > 0.0 else v for v in (run, *others)]
    known = np.concatenate([v[np.isfinite(v)] for v in seen])
    if known.size == 0:
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    if max(-low, high) < FAINT:
        return -1.0, 1.0
    margin = 0.05 * (high - low) or 0.1 * abs(high) or 1.0
    return low - margin, high + margin
