"""The missing force over time, in a trace of the recording beside residuals, and over velocity.

The missing force is the Wiener estimate from the refit's weighted innovations e = -R f + noise, R
the response of observer and device to a force at the place: with E and R their transforms,

    F = - sum_o conj(R_o) E_o S / (1 + sum_o |R_o|^2 S),    S the force's assumed spectrum,

of a force of first-order colour whose size and corner are those of the highest likelihood. Limits:
the device counts as linear there, and a force that a refit absorbed is not in it.

What a friction's name and its numbers say is read best as the curve that they are: all that acts at
the place over its velocity, in steady sliding, beside what the recording asks for at each sample,
which is the curve at the velocity that is predicted and the force that the innovations ask for
beyond it, under an observer a hundred times slower than the likeliest, which takes less of it for
disturbance. Where the samples lie apart from the curve, the law is another. A straight part is the
damper of the device as well, and a constant the origin of its spring, so the band is that of the
curve beside both as they were fitted.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import product
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.forces.spatial import response
from zwidth.diagnosis.forces.unknown import SLOWER
from zwidth.diagnosis.learning.steady import along
from zwidth.diagnosis.learning.together import Together, follows, together
from zwidth.diagnosis.noise.predictor import (
    SETTLING,
    free_run_errors,
    free_run_starts,
    innovations,
    settling,
    window,
)
from zwidth.diagnosis.noise.settle import prepared_for
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.searched import Searched
from zwidth.sim.place import Place, place_at
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
FRICTION = "dry friction"


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
    weighted = np.nan_to_num(problem.observer.weigh(weighted))
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
    sizes = np.geomspace(1e-3, 1e4, 29)  # of the force that one sample's noise hides
    for relative, corner_hz in product(sizes, (2.0, 10.0, 50.0, np.inf)):
        colour = relative * unit / (1.0 + (frequency / corner_hz) ** 2)
        cost = np.log1p(reach * colour) - power * colour / (1.0 + reach * colour)
        total = float(np.sum(cost))
        if best is None or total < best[0]:
            best = (total, colour)
    assert best is not None
    return best[1]


@dataclass(frozen=True)
class FrictionCurve:
    """The curve, its place, and what the recording says: velocities and forces (samples,)."""

    whole: Together
    at: Place
    velocities: Floats
    forces: Floats


def friction_curve(found: Searched, points: int = 200) -> FrictionCurve | None:
    """Return the friction of an answer as a curve over so many points; None where it names none."""
    over = "free_damper"
    problem, final = found.problem, found.final
    laws = final.model.effects_at(final.x)
    rubs = [p for p in laws if p.effect.family == FRICTION and follows(p, over, p.place)]
    if not rubs:
        return None
    place = rubs[0].place
    n = final.model.build(final.x).chain.masses.size
    moved = predicted_states(problem, final)
    v = np.concatenate([x[SETTLING:, n + place.index] for x in moved])
    low, high = (float(q) for q in np.quantile(v, (0.001, 0.999)))
    if not low < high:
        return None
    at = np.linspace(low, high, points)
    whole = together(final, over, place, at[at != 0.0], bends=True)
    if whole is None:
        return None
    given = [g for p in laws if follows(p, over, place) and (g := along(p, over, v)) is not None]
    return FrictionCurve(
        whole, place, v, np.sum(given, axis=0) + asked_beyond(problem, final, str(place))
    )


def asked_beyond(problem: Problem, fitted: Fitted, at: str) -> Floats:
    """Return the forces (samples,) at a mass or in a link that recordings ask for beyond a fit.

    Those of all recordings one after the other, from where the observer has settled.
    """
    slow = _slower(problem, fitted)
    each = [missing_force(slow, fitted, e, at)[SETTLING:] for e in problem.experiments]
    return np.concatenate(each)


def read_beyond(problem: Problem, fitted: Fitted) -> Floats:
    """Return by how much the first output (samples,) is read otherwise than a fit predicts."""
    slow, model = _slower(problem, fitted), fitted.model
    device, gain = model.acting(fitted.x), slow.observer.gain
    seen = [model.seen(e, fitted.x) for e in slow.experiments]
    return np.concatenate([innovations(device, e, gain)[SETTLING:, 0] for e in seen])


def _slower(problem: Problem, fitted: Fitted) -> Problem:
    with suppress(NoObserver):  # so slow that it does not hold the device
        ratio = SLOWER * problem.observer.ratio
        return prepared_for(problem.experiments, fitted.model, fitted.x, ratio)
    return problem
