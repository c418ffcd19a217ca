"""Starts for effects that repeat over position, at the periods that the residual itself shows."""

import math

from zwidth.diagnosis.candidates import QUARTER, Start, magnitudes
from zwidth.diagnosis.fit import Fitted, Problem
from zwidth.diagnosis.lattice import predicted
from zwidth.diagnosis.spatial import peaks, pulls
from zwidth.sim.physics import make_physics

WAVES = {"force_ripple": ("m1", "m1"), "encoder_eccentricity": ("sensor", "sensor")}
FINEST = 1e-3  # of the travel
PHASES = (0.0, QUARTER)  # between them lies every other (`diagnosis.screen`)


def wave_starts(problem: Problem, fitted: Fitted) -> tuple[list[Start], dict[str, float]]:
    """Return starts, and what the search over periods costs each effect in chi-square."""
    if problem.experiments[0].outputs[0].quantity != "position":
        return [], {}
    device = fitted.model.acting(fitted.x)
    size = magnitudes(device, problem.experiments)
    positions = predicted(problem, fitted)
    span = max(float(q.max() - q.min()) for q in positions)
    amplitudes = {"force_ripple": 0.02 * size.force, "encoder_eccentricity": 1e-3 * span}
    starts: list[Start] = []
    prices: dict[str, float] = {}
    for name, (at, place) in WAVES.items():
        if fitted.model.has(name) or any(p.effect.name == name for p in device.physics):
            continue
        finest = max(FINEST * span, 6.0 * float(problem.observer.deviation[0]))
        found, lines = peaks(pulls(problem, fitted, place), positions, finest)
        prices[name] = 2.0 * math.log(max(lines, 1))
        a = amplitudes[name]
        for peak in found:
            if peak.gained < prices[name]:
                continue
            scales = {"amplitude": a, "period": 0.1 * peak.period**2 / span, "phase": 0.5}
            starts += [
                Start(make_physics(name, at, amplitude=a, period=peak.period, phase=phase), scales)
                for phase in PHASES
            ]
    return starts, prices
