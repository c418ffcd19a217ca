"""A diagnosis as a trace in the recording's own time: residuals, missing force, predictions.

The missing force is the Wiener estimate from the refit's weighted innovations e = -R f + noise, R
the response of observer and device to a force at the place: with E and R their transforms,

    F = - sum_o conj(R_o) E_o S / (1 + sum_o |R_o|^2 S),    S the force's assumed spectrum,

of a force of first-order colour whose size and corner are those of the highest likelihood. Limits:
the device counts as linear there, and a force that a refit absorbed is not in it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.forces.spatial import response
from zwidth.diagnosis.noise.predictor import (
    free_run_errors,
    free_run_starts,
    innovations,
    settling,
    window,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.place import place_at
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
CORNERS_HZ = (2.0, 10.0, 50.0, np.inf)
SIZES = np.geomspace(1e-3, 1e4, 29)  # of the force that one sample's noise hides


@dataclass(frozen=True)
class Explained:
    """A fitted model on one recording: innovations and free-run errors (ticks, o).

    What is not predicted (the observer settles, a free run's state is sought) is not a number.
    """

    innovation: Floats
    free_error: Floats


def diagnosis_trace(
    problem: Problem,
    refit: Fitted,
    final: Fitted,
    experiment: Experiment,
    *,
    place: str = "m1",
    start_s: float = 0.0,
    rotary: bool = True,
    facts: Mapping[str, object] = MappingProxyType({}),
) -> Trace:
    """Return the trace of one recording, whole; `logs.write_log` writes it as an MCAP.

    refit: without what was found, final: with it. place: where the missing force is sought, a mass
    ("m2") or a link ("link12"); a force in command or sensor counts as one at m1. start_s: time of
    the first sample. Channels: `command`, `missing_force_PLACE`, and for every output `NAME` as it
    was taken, `refit_NAME` and `found_NAME` predicted one step ahead, `refit_free_NAME` and
    `found_free_NAME` as free runs, `refit_residual_NAME`, `found_residual_NAME`.
    """
    force, length = ("N m", "rad") if rotary else ("N", "m")
    entry = place if place_at(place).kind in ("mass", "link") else "m1"
    channels: dict[str, Floats] = {"command": experiment.command}
    channels[f"missing_force_{entry}"] = missing_force(problem, refit, experiment, entry)
    units = dict.fromkeys(channels, force)
    each = {
        word: _explained(problem, fitted, experiment)
        for word, fitted in (("refit", refit), ("found", final))
    }
    for o, output in enumerate(experiment.outputs):
        unit = length if output.quantity == "position" else f"{length}/s"
        name, measured = output.name, experiment.measured[:, o]
        channels[name] = measured
        for word, explained in each.items():
            channels[f"{word}_{name}"] = measured - explained.innovation[:, o]
            channels[f"{word}_free_{name}"] = measured - explained.free_error[:, o]
            channels[f"{word}_residual_{name}"] = explained.innovation[:, o]
        units |= {key: unit for key in channels if key not in units}
    t = start_s + experiment.period * np.arange(experiment.ticks, dtype=np.float64)
    return Trace(t, channels, units, "recorded", MappingProxyType(dict(facts)))


def _explained(problem: Problem, fitted: Fitted, experiment: Experiment) -> Explained:
    gain, device = problem.observer.gain, fitted.model.acting(fitted.x)
    seen = fitted.model.seen(experiment, fitted.x)
    with np.errstate(all="ignore"):
        ahead = innovations(device, seen, gain)
        runs, _ = free_run_errors(device, seen, gain, window(seen))
    ahead[: settling(seen)] = np.nan
    if seen.uncounted is not None:
        ahead[seen.uncounted] = np.nan
    free = np.full(ahead.shape, np.nan)
    length = window(seen)
    for place, first in enumerate(free_run_starts(seen, length)):
        free[first : first + length] = runs[place * length : (place + 1) * length]
    return Explained(ahead, free)


def missing_force(problem: Problem, fitted: Fitted, experiment: Experiment, place: str) -> Floats:
    """Return the force (ticks,) at a mass or in a link that the innovations ask for [N m | N].

    In a link it acts on the first mass, and its contrary on the second.
    """
    seen = fitted.model.seen(experiment, fitted.x)
    weighted = innovations(fitted.model.acting(fitted.x), seen, problem.observer.gain)
    weighted = np.nan_to_num(problem.observer.weigh(weighted, seen.uncounted))
    weighted[: settling(seen)] = 0.0
    answer = response(problem, fitted, place)
    size = next_fast_len(experiment.ticks + answer.shape[0], real=True)
    gain = -np.fft.rfft(answer, size, axis=0)
    data = np.fft.rfft(weighted, size, axis=0)
    pull = np.sum(np.conj(gain) * data, axis=1)
    reach = np.sum(np.abs(gain) ** 2, axis=1)
    colour = _likeliest(pull, reach, experiment, size)
    return np.fft.irfft(pull * colour / (1.0 + reach * colour), size)[: experiment.ticks]


def _likeliest(pull: Complexes, reach: Floats, experiment: Experiment, size: int) -> Floats:
    """The spectrum S of the highest likelihood: -ln L = sum ln(1 + |R|^2 S) - |P|^2 S / (1 + ...).

    The transform of white noise of unit variance has as much power as samples not padded.
    """
    frequency = np.fft.rfftfreq(size, experiment.period)
    power = np.abs(pull) ** 2 / experiment.ticks
    unit = 1.0 / max(float(reach.max()), 1e-300)
    best: tuple[float, Floats] | None = None
    for relative, corner_hz in product(SIZES, CORNERS_HZ):
        colour = relative * unit / (1.0 + (frequency / corner_hz) ** 2)
        cost = np.log1p(reach * colour) - power * colour / (1.0 + reach * colour)
        total = float(np.sum(cost))
        if best is None or total < best[0]:
            best = (total, colour)
    assert best is not None
    return best[1]
