"""Finds play by a scan of its width: no fit, a fraction of a second per link.

An effect whose fit ends in the valley where it begins (`Parameter.valleys`: play) has no useful
slope: a gap that is a tenth too wide closes at other times. So a hypothesis is compared with itself
plus gaps of many widths, spaced closer than the valley is wide, as lanes of one call. This is done
under observers that trust the model more and more, and at two points x: the hypothesis's own, to
which a fit without play has adapted (a softer link), and that of the device file.

One observer's result is not sufficient. On two masses of a CSV alone (1 kHz, 8 s, 20 mrad) the best
gaps were 2 to 4 mrad, with a k of 14 instead of 60 N m/rad, and gained 125 to 309 in -2 ln; on
others they were within 30 % of the truth and gained up to 7800. No fit can start there, since the
valley of play is as narrow as the gap is well known: fits from such gaps ended at costs of -131
100, and a cubic spring at -132 500. A population reached -135 100 in a second, and the fit after it
-138 100, the truth. The observer that succeeds differs (1e-4 there, 1e-2 or 1e-5 on others), and
gains under different observers cannot be compared. So each observer that shows play has its own
population, starting at its gap, and the results are compared with their own noise.

Limits: the residual is not whitened, so a gain counts dependent errors as independent. The gain
only starts populations and decides nothing.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.account import reason
from zwidth.diagnosis.fitting.evolve import Arrived, Generations, evolve
from zwidth.diagnosis.fitting.landscape import Landscape
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import blind
from zwidth.diagnosis.noise.gaps import steadily, with_steady
from zwidth.diagnosis.noise.settle import prepared_for
from zwidth.diagnosis.noise.steady import NoObserver, links_with_play, with_apart
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.candidates import Start
from zwidth.diagnosis.settings import PURSUIT
from zwidth.jobs.parallel import in_parallel, threads

Floats = NDArray[np.float64]
RATIOS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)  # of observers
SPREAD = 0.5  # standard deviation of the first generation, in x
APART = 1.2  # ratio of successive gaps
BEYOND = 2.0  # factor by which gaps go beyond the starts at both ends


class Played(NamedTuple):
    """A model with play at x, its gain over the model without, and the observer used."""

    model: Model
    x: Floats
    gained: float
    ratio: float


def scanned(
    experiments: Sequence[Experiment], model: Model, x: Floats, starts: Sequence[Start]
) -> list[Played]:
    """Return the most likely gap for each observer that shows one, the largest gain first.

    experiments: the part to scan; starts: of one effect with one parameter, at one place. The gain
    is relative to the cost without play at the better of two points x, and more than
    `PURSUIT.clear_sign`. Relative to the same point, a gap in the wrong place softens the link and
    gains 2000 to 3600; relative to the better point it gains nothing.
    """
    if not starts:
        return []
    first = starts[0]
    (key,) = first.physics.values
    widths = np.array([s.physics.values[key] for s in starts])
    least, most = widths.min() / BEYOND, widths.max() * BEYOND
    gaps = np.geomspace(least, most, 1 + round(np.log(most / least) / np.log(APART)))
    found: list[Played] = []
    for ratio in RATIOS:
        here: list[_Tried] = []
        for begin in _places(model, x):
            with suppress(NoObserver), reason("scans of play"):
                here.append(_tried(experiments, model, begin, first, key, gaps, ratio))
        if not here:
            continue
        best = min(here, key=lambda one: one.cost)
        gained = min(one.without for one in here) - best.cost
        if gained > PURSUIT.clear_sign:
            found.append(Played(best.model, best.x, gained, ratio))
    return sorted(found, key=lambda one: -one.gained)


def arrivals(
    experiments: Sequence[Experiment], shown: Sequence[Played], members: int, generations: int
) -> Iterator[tuple[Model, Arrived]]:
    """Yield the results of populations that start from a scan, each with its observer.

    experiments: the part used for populations; members, generations: for a population that starts
    near the truth. These populations start farther away, with twice as many members and half as
    many generations: on the two masses above, 16 members did not reach the truth, and 40
    generations came close enough for a fit, as close as 80.
    """
    plan = Generations(2 * members, max(generations // 2, 1), SPREAD)
    asked = [partial(evolve, experiments, s.model, [s.x], s.ratio, plan) for s in shown]
    with reason("populations of play"):
        arrived = in_parallel(asked, threads())
    for one, found in zip(shown, arrived, strict=True):
        for there in found:
            yield one.model, there


def _places(model: Model, x: Floats) -> Iterator[Floats]:
    """Yield x as it is, and as in the device file."""
    yield x
    prior = np.array([p.prior for p in model.parameters])
    if np.any(x[prior] != 0.0):
        yield np.where(prior, 0.0, x)


class _Tried(NamedTuple):
    """The most likely gap at one point x, its cost, and the cost without play there."""

    model: Model
    x: Floats
    cost: float
    without: float


def _tried(
    experiments: Sequence[Experiment],
    model: Model,
    x: Floats,
    first: Start,
    key: str,
    gaps: Floats,
    ratio: float,
) -> _Tried:
    wide = model.with_effect(first.physics, first.scales, first.bounds)
    (j,) = (i for i, p in enumerate(wide.parameters) if i >= model.lasting and p.key == key)
    asked: list[Floats] = []
    for gap in (0.0, *gaps):
        own = model.beside(x, np.zeros(wide.lasting - model.lasting))
        own[j] = (gap - first.physics.values[key]) / wide.parameters[j].scale
        asked.append(wide.within(own))
    there, device = prepared_for(experiments, model, x, blind(ratio)), wide.acting(asked[1])
    contact = steadily(there.observer.gain)[:, : len(experiments[0].outputs)]
    links, seen = links_with_play(device), model.seen(experiments[0], x)
    gain = with_apart(device.bare(), links, seen, contact)  # as in `noises`
    observer = replace(there.observer, gain=with_steady(there.observer.gain, gain))
    without, *found = Landscape(there.experiments, observer, wide).costs(asked)
    costs = np.nan_to_num(np.array(found), nan=np.inf)
    best = int(np.argmin(costs))
    gap = float(gaps[best])
    # A fit moves in steps of the scale, and that of the least gap would be too small.
    physics = replace(first.physics, values={key: gap})
    played = model.with_effect(physics, {key: gap}, first.bounds)
    begin = played.within(model.beside(x, [0.0]))
    return _Tried(played, begin, float(costs[best]), float(np.nan_to_num(without, nan=np.inf)))
