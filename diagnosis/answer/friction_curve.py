"""The friction that was found as a curve over velocity, with its band and the samples behind it.

What a name and its numbers say is read best as the curve that they are: all that acts at the place
over its velocity, in steady sliding, beside what the recording asks for at each sample, which is
the curve at the velocity that is predicted and the force that the innovations ask for beyond it
(`diagnosis_log.missing_force`), under an observer a hundred times slower than the likeliest, which
takes less of it for disturbance. Where the samples lie apart from the curve, the law is another.

A straight part is the damper of the device as well, and a constant the origin of its spring, so the
band is that of the curve beside both as they were fitted.
"""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.diagnosis_log import missing_force
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.learning.steady import along
from zwidth.diagnosis.learning.together import Together, follows, together
from zwidth.diagnosis.noise.predictor import SETTLING, innovations
from zwidth.diagnosis.noise.settle import prepared_for
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.residual.remainder import predicted_states
from zwidth.diagnosis.selection.searched import Searched
from zwidth.diagnosis.settings import RESIDUAL
from zwidth.sim.place import Place

Floats = NDArray[np.float64]
OVER, FRICTION = "free_damper", "dry friction"
POINTS = 200  # velocities of the curve
FASTEST = (0.001, 0.999)  # of the samples, between which it is drawn


@dataclass(frozen=True)
class FrictionCurve:
    """The curve, its place, and what the recording says: velocities and forces (samples,)."""

    whole: Together
    at: Place
    velocities: Floats
    forces: Floats


def friction_curve(found: Searched) -> FrictionCurve | None:
    """Return the friction of an answer as a curve; None where it names none."""
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
        ratio = RESIDUAL.slower * problem.observer.ratio
        return prepared_for(problem.experiments, fitted.model, fitted.x, ratio)
    return problem
