"""Parameters fitted for each recording separately: `[free]` of a recording TOML.

For example, three springs that were mounted in turn have three values, while everything else is
common. Recordings with the same word for a parameter share its value; recordings without a word
share another. Each word is a change d of the parameter (`Model.varying`) from its value in the
recordings without a word, or with the first word. For a linear parameter the uncertainty in the
device file also applies to d, and like all linear parameters d is in every hypothesis, without a
penalty. For a parameter of an effect, d has the penalty of any change.

The rest position of a spring to ground may differ between recordings: an encoder counts from where
it was switched on, and friction stops a mass anywhere within level / stiffness of the rest. So each
of several recordings has its own origin (`origin` in `model.parameters`) and, if they are free, its
own zeros of the sensors of further masses (`zero_m2`).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.model.parameters import Model, Varying, linear_parameters
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError
from zwidth.sim.device import Device

Floats = NDArray[np.float64]


def varying(device: Device, experiments: Sequence[Experiment]) -> tuple[Varying, ...]:
    """Return the parameters that recordings declare as their own, with origins and free zeros."""
    targets = dict.fromkeys(target for e in experiments for target, _ in e.own)
    found: list[Varying] = []
    for target in targets:
        words = dict.fromkeys(dict(e.own).get(target) for e in experiments)
        base = None if None in words else next(iter(words))
        found += [
            Varying(f"{target} in {word}", target, declared=True)
            for word in words
            if word not in (None, base)
        ]
    own = [p.name for p in linear_parameters(device) if p.kind in ("origin", "zero")]
    names = list(dict.fromkeys(e.name for e in experiments))
    found += [Varying(f"{p} in {name}", p, declared=True) for p in own for name in names[1:]]
    return tuple(found)


def first_x(model: Model, experiments: Sequence[Experiment]) -> Floats:
    """Return the start x of a fit: zero, except for free zeros of sensors.

    Over a recording of length t, the forces that move m2 deflect the link by

        mean(q2 - q1) = zero + (m2 (v2(t) - v2(0)) + b2 (q2(t) - q2(0))) / (k t),

    of which the second part is small against the motion. A fit from zero would not find the zero:
    with a link that is always stretched, the most likely noise drifts, and then a zero gains
    nothing. Limits: one link between the sensors, or equally stiff ones; dry friction that acts
    equally often in both directions.
    """
    x = np.zeros(len(model.parameters))
    zeros = {p.name: i for i, p in enumerate(model.parameters) if p.kind == "zero"}
    places = {p.name: i for i, p in enumerate(model.parameters) if p.kind == "change"}
    for e in experiments:
        positions = {o.mass: k for k, o in enumerate(e.outputs) if o.tells_position}
        for name, i in zeros.items():
            p = model.parameters[i]
            if 0 not in positions or p.index not in positions:
                continue
            apart = e.measured[:, positions[p.index]] - e.measured[:, positions[0]]
            told = float(np.mean(apart)) / p.scale
            own = places.get(f"{name} in {e.name}")
            if own is not None:
                x[own] = told - x[i]
            elif x[i] == 0.0:
                x[i] = told
    return x


def refuse_unknown_words(fit_on: Sequence[Experiment], judge_by: Sequence[Experiment]) -> None:
    """Raise ExperimentError if a validation recording has a word that no fitted recording has."""
    known = {own for e in fit_on for own in e.own}
    for e in judge_by:
        for target, word in e.own:
            if (target, word) not in known:
                raise ExperimentError(
                    f"{e.name} is kept out of the fit, and its [free] gives {target} the word"
                    f" {word!r}; no fitted recording has this word, so the value is unknown:"
                    " also fit"
                    " a recording with this word"
                )
