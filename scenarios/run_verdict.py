"""The verdict on a run after its last disturbance: decay, cycle or growth; its fate at a wall."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.scenarios.scenario import Scenario
from zwidth.sim.fate import Conditions, Fate, fates_of, rest_amplitude
from zwidth.sim.growth import VERDICTS, Verdict, assess, window_weights
from zwidth.sim.perception import Perception
from zwidth.sim.run import Outcome
from zwidth.sim.trace import Trace
from zwidth.sim.windows import (
    FAST_ENERGY,
    HIGHEST,
    HIGHEST_COMMAND,
    LOWEST,
    LOWEST_COMMAND,
    MEASURES,
    REVERSALS,
    SLOW_ENERGY,
)

Floats = NDArray[np.float64]
DRIVEN = "recorded"  # a controller whose command does not come to rest with the device
WALLS = ("wall", "texture", "region", "guarded", "none")  # controllers of runs that have a fate
WINDOW_S = 0.5
FEWEST_WINDOWS = 8
FEWEST_TICKS = 16


class Ending(NamedTuple):
    """The end of a run: its trend, and its fate, None if the controller is not a wall."""

    verdict: Verdict
    fate: Fate | None


def run_verdict(
    scenario: Scenario, trace: Trace, outcome: Outcome, perception: Perception = Perception()
) -> Ending | None:
    """Return the end of a finished run, None if it shows nothing about stability.

    The part after the last change of a disturbance is judged, in windows of 0.5 s, or shorter ones
    if the run is short; a run that escaped grows. None for a driven device and for too short a run.
    """
    law, device = scenario.controller, scenario.device
    if law.kind == DRIVEN or len(trace) == 0 or trace.t[-1] < scenario.free_from:
        return None
    of_wall = law.kind in WALLS
    if outcome is not Outcome.COMPLETED:
        return Ending(Verdict.GROWS, Fate.GROWS if of_wall else None)
    free = trace.between(scenario.free_from, math.inf)
    period = device.interface.period
    ticks = min(round(WINDOW_S / period), len(free) // FEWEST_WINDOWS)
    if ticks < FEWEST_TICKS:
        return None
    masses = np.diag(device.plant().matrices.mass)[: scenario.masses]
    measures = _measures(free, masses, ticks)
    start = float(np.abs(free["position_m1"][:ticks]).max())
    if start == 0.0:
        return Ending(Verdict.DECAYS, Fate.RESTS if of_wall else None)
    rest = rest_amplitude(device, start)
    growth = assess(measures, ticks * period, start, rest, not is_linear(scenario))
    fate = None
    if of_wall:
        given = (law.facts.get(name, 0.0) for name in ("stiffness", "damping"))
        stiffness, damping = (np.array([x if isinstance(x, float) else 0.0]) for x in given)
        conditions = Conditions(
            [device], np.zeros(1, np.int64), stiffness, damping, np.array([start]),
            np.array([rest]), bool(law.facts.get("one_sided", False)),
        )  # fmt: skip
        fate = Fate(int(fates_of(growth, conditions, len(free) * period, perception)[0]))
    return Ending(VERDICTS[int(growth.verdict[0])], fate)


def is_linear(scenario: Scenario) -> bool:
    """Whether nothing in the loop is nonlinear, so that it has no limit cycles."""
    law, device = scenario.controller, scenario.device
    linear_law = (
        law.kind == "none"
        or (law.kind == "wall" and not law.facts["one_sided"])
        or (law.kind == "region" and law.facts["width"] == 0.0)
    )
    return linear_law and device.interface.linear and not device.physics


def _measures(trace: Trace, masses: Floats, ticks: int) -> Floats:
    """Measures of each window, as `sim.growth.assess` takes them, shape (windows, MEASURES, 1)."""
    windows = len(trace) // ticks
    speeds = np.array([trace[f"velocity_m{i + 1}"] for i in range(masses.size)])
    padded = np.concatenate([np.full(3, speeds[0, 0]), speeds[0]])
    reversed_ = padded[3:] * padded[2:-1] < 0.0
    weights, found = window_weights(ticks), np.zeros((windows, MEASURES, 1))

    def by_window(series: Floats) -> Floats:
        return series[len(trace) - windows * ticks :].reshape(windows, ticks)

    found[:, SLOW_ENERGY, 0] = by_window(0.5 * masses @ (speeds * speeds)) @ weights
    found[:, FAST_ENERGY, 0] = by_window(np.diff(padded, 3) ** 2) @ weights
    found[:, REVERSALS, 0] = by_window(reversed_.astype(np.float64)).sum(axis=1)
    for name, lowest, highest in (
        ("position_m1", LOWEST, HIGHEST),
        ("command", LOWEST_COMMAND, HIGHEST_COMMAND),
    ):
        found[:, lowest, 0] = by_window(trace[name]).min(axis=1)
        found[:, highest, 0] = by_window(trace[name]).max(axis=1)
    return found
