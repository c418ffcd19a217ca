"""The friction of an answer as a curve against velocity, with its band and the samples behind it.

A friction law is best understood as a curve: all forces at the place over velocity in steady
sliding. Beside it are drawn the forces that the recording requires at each sample: the curve at the
predicted velocity, plus the missing force that the innovations show (`missing_force`), with an
observer a hundred times slower than the most likely one, which attributes less of this force to
disturbance. If the samples lie apart from the curve, the true law is another.

A straight part also belongs to the device's damper, and a constant to the origin of its spring. The
band therefore holds for the curve beside both as they were fitted.

The missing force is the Wiener estimate from weighted innovations e = -R f + noise, where R is the
response of observer and device to a force at the place. With the transforms E and R,

    F = - sum_o conj(R_o) E_o S / (1 + sum_o |R_o|^2 S),    S the force's assumed spectrum,

which is of first order, with the size and corner frequency of highest likelihood. Limits: the
device counts as linear there, and a force that a refit absorbed is not included.
"""

from contextlib import suppress
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.forces.spatial import response
from zwidth.diagnosis.learning.steady import along
from zwidth.diagnosis.learning.together import Together, follows, together
from zwidth.diagnosis.noise.family import SLOWER, blind
from zwidth.diagnosis.noise.predictor import SETTLING, innovations, settling
from zwidth.diagnosis.noise.settle import prepared_for
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.searched import Searched
from zwidth.sim.place import Place

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
OVER, FRICTION = "free_damper", "dry friction"
CORNERS_HZ = (2.0, 10.0, 50.0, np.inf)
SIZES = np.geomspace(1e-3, 1e4, 29)  # relative to the force that one sample's noise hides
POINTS = 200  # velocities of the curve
FASTEST = (0.001, 0.999)  # quantiles of the velocity between which the curve is drawn


@dataclass(frozen=True)
class FrictionCurve:
    """The curve, its place, and the samples of the recording: velocities and forces (samples,)."""

    whole: Together
    at: Place
    velocities: Floats
    forces: Floats


def friction_curve(found: Searched) -> FrictionCurve | None:
    """Return an answer's friction as a curve; None without friction or if it is undetermined."""
    problem, final = found.problem, found.final
    laws = final.model.effects_at(final.x)
    rubs = [p for p in laws if p.effect.family == FRICTION and follows(p, OVER, p.place)]
    if not rubs:
        return None
    place = rubs[0].place
    n = final.model.build(final.x).chain.masses.size
    moved = predicted_states(problem, final)
    v = np.concatenate([x[SETTLING:, n + place.index] for x in moved])
    low, high = (float(q) for q in np.quantile(v, FASTEST))
    if not low < high:
        return None
    at = np.linspace(low, high, POINTS)
    whole = together(final, OVER, place, at[at != 0.0], bends=True)
    if whole is None:
        return None
    given = [g for p in laws if follows(p, OVER, place) and (g := along(p, OVER, v)) is not None]
    return FrictionCurve(
        whole, place, v, np.sum(given, axis=0) + asked_beyond(problem, final, str(place))
    )


def asked_beyond(problem: Problem, fitted: Fitted, at: str) -> Floats:
    """Return the forces (settled samples,) at a place that recordings need beyond a fit."""
    slow = _slower(problem, fitted)
    each = [missing_force(slow, fitted, e, at)[SETTLING:] for e in problem.experiments]
    return np.concatenate(each)


def read_beyond(problem: Problem, fitted: Fitted) -> Floats:
    """Return the difference between the first output (samples,) and its prediction by a fit."""
    slow, model = _slower(problem, fitted), fitted.model
    device, gain = model.acting(fitted.x), slow.observer.gain
    seen = [model.seen(e, fitted.x) for e in slow.experiments]
    return np.concatenate([innovations(device, e, gain)[SETTLING:, 0] for e in seen])


def _slower(problem: Problem, fitted: Fitted) -> Problem:
    with suppress(NoObserver):  # too slow to stabilize the device
        ratio = SLOWER * problem.observer.ratio
        return prepared_for(problem.experiments, fitted.model, fitted.x, blind(ratio))
    return problem


def missing_force(problem: Problem, fitted: Fitted, experiment: Experiment, place: str) -> Floats:
    """Return the missing force (ticks,) [N m | N] at a place, estimated from the innovations.

    In a link it acts on the first mass, and with the opposite sign on the second.
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
    """The most likely spectrum S, by -ln L = sum ln(1 + |R|^2 S) - |P|^2 S / (1 + |R|^2 S).

    The power of the transform of unit white noise is the number of samples without padding.
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
