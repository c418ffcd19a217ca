"""Parameters fitted for each recording separately: `[free]` of a recording TOML.

Three springs that were hung in turn are three numbers, and all else of the carts is one device's.
Where a word stands for a parameter, recordings with that word share its value; those without share
another. It is a change of the parameter (`Model.varying`), from what it is in the recordings
without a word, or in those with the first one: x + d holds where the word does. A linear parameter
so changed has the uncertainty of the device file in d, too, and like all linear ones is in every
hypothesis, so that nothing is paid for it; a number of an effect pays what every change pays.

Where a spring to ground is at rest no two recordings need agree: an encoder counts from where it
was switched on, and friction lets go of a mass anywhere within level / stiffness of the rest. So of
several recordings each has an origin of its own (`origin` in `model.parameters`), and where their
zeros are open so have the sensors of further masses (`zero_m2`).
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.model.parameters import Model, Varying, linear_parameters
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError
from zwidth.sim.device import Device

Floats = NDArray[np.float64]


def varying(device: Device, experiments: Sequence[Experiment]) -> tuple[Varying, ...]:
    """Return what is not the same in all of these recordings because they say so."""
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
    """Return the x that a fit of recordings begins with: all zero, but for open zeros of sensors.

    Over a recording of length t what moves m2 lets the link give way by

        mean(q2 - q1) = zero + (m2 (v2(t) - v2(0)) + b2 (q2(t) - q2(0))) / (k t),

    whose second part is little of the motion. From zero a fit would not get there: the noise
    that belongs to a link which is always stretched wanders, and a zero is no gain under it.
    Limits: one link between the sensors, or all but as stiff; dry friction that is as often forth.
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
    """Raise ExperimentError where a recording to judge by has a value that none fitted has."""
    known = {own for e in fit_on for own in e.own}
    for e in judge_by:
        for target, word in e.own:
            if (target, word) not in known:
                raise ExperimentError(
                    f"{e.name} judges the answer, and its [free] gives {target} the word {word!r},"
                    " which no fitted recording has, so its value is unknown; fit a recording with"
                    " that word, too"
                )
