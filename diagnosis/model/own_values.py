"""Values that recordings have of their own, as their files say: `[free]` of a recording TOML.

Three springs that were hung in turn are three numbers, and all else of the carts is one device's.
Where a word stands for a parameter, recordings with that word share its value; those without share
another. It is a change of the parameter (`Model.varying`), from what it is in the recordings
without a word, or in those with the first one: x + d holds where the word does. A linear parameter
so changed has the uncertainty of the device file in d, too, and like all linear ones is in every
hypothesis, so that nothing is paid for it; a number of an effect pays what every change pays.

Where a spring to ground is at rest no two recordings need agree: an encoder counts from where it
was switched on, and friction lets go of a mass anywhere within level / stiffness of the rest. So of
several recordings each has an origin of its own (`origin` in `model.parameters`).
"""

from collections.abc import Sequence

from zwidth.diagnosis.model.parameters import Varying, linear_parameters
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError
from zwidth.sim.device import Device


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
    if any(p.name == "origin" for p in linear_parameters(device)):
        names = list(dict.fromkeys(e.name for e in experiments))
        found += [Varying(f"origin in {name}", "origin", declared=True) for name in names[1:]]
    return tuple(found)


def refuse_unknown_words(fit_on: Sequence[Experiment], judge_by: Sequence[Experiment]) -> None:
    """Raise ExperimentError where a recording to judge by has a value that none fitted has."""
    known = {own for e in fit_on for own in e.own}
    for e in judge_by:
        for target, word in e.own:
            if (target, word) not in known:
                raise ExperimentError(
                    f"{e.name} is to judge, and its [free] gives {target} as {word!r}, which no"
                    " recording that is fitted has: nothing says what it is there; fit one too"
                )
