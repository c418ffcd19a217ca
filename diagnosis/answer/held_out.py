"""Errors of the model on held-out data: one step ahead, and in free runs over windows."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.result import HeldOut
from zwidth.diagnosis.answer.straying import rms, strayed
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import followed_by
from zwidth.diagnosis.noise.predictor import (
    Observer,
    deviation,
    innovations,
    settling,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.searched import Searched
from zwidth.sim.device import Device

Floats = NDArray[np.float64]


def models_of(device: Device, found: Searched) -> dict[str, tuple[Model, Floats]]:
    """Return (model, x) "before" (the device file), "refit", and "after" (the answer)."""
    nominal = Model(device)
    return {
        "before": (nominal, np.zeros(nominal.linear_count)),
        "refit": (found.refit.model, found.refit.x),
        "after": (found.final.model, found.final.x),
    }


def told_of(
    fitted: Sequence[Experiment], judge_by: Sequence[Experiment]
) -> list[tuple[Experiment, bool]]:
    """Return the recordings to report on (the rest of split ones), and whether held out."""
    firsts = {(e.before.name, e.before.begins) for e in judge_by if e.before is not None}
    whole = [e for e in fitted if (e.name, e.begins) not in firsts]
    return [*((e, True) for e in judge_by), *((e, False) for e in whole)]


def held_out(
    device: Device, found: Searched, judge_by: Sequence[Experiment]
) -> tuple[HeldOut, HeldOut]:
    """Return (one step, free run) of the device before, refitted and augmented; opens the data.

    Errors of the first output, relative to its own rms variation.
    """
    gain = found.judge.gain
    step = [e.measured[settling(e) :, 0] for e in judge_by]
    windows = swing = rms([y - y.mean() for y in step])
    typical = math.nan
    one: list[float] = []
    free: list[float] = []
    for model, x in models_of(device, found).values():
        built = model.acting(x)
        # Each begins in the state that fits best: a slow observer forgets its start slowly.
        scaled = [followed_by(built, model.seen(e, x), found.judge) for e in judge_by]
        ahead = [(innovations(built, e, gain)[settling(e) :, 0], e) for e in scaled]
        one.append(rms([own[e.known[settling(e) :]] for own, e in ahead]) / swing)
        error, typical, windows = strayed(built, scaled, gain)
        free.append(error / windows)
    model, x = found.final.model, found.final.x
    fitted_on = [model.seen(e, x) for e in found.problem.experiments]
    noise = float(deviation(model.acting(x), fitted_on, gain)[0])
    return (
        HeldOut(one[0], one[1], one[2], noise / swing),
        HeldOut(free[0], free[1], free[2], noise / windows, typical / windows),  # of the answer
    )


def free_share(
    model: Model, x: Floats, observer: Observer, judge_by: Sequence[Experiment]
) -> float:
    """Return the error of free runs of a model over the motion, computed as in `held_out`."""
    built = model.acting(x)
    seen = [followed_by(built, model.seen(e, x), observer) for e in judge_by]
    error, _, motion = strayed(built, seen, observer.gain)
    return error / motion
