"""Whether there is play, by a scan of its width: no fit, a fraction of a second per link.

An effect whose fit ends in the valley where it begins (`Parameter.valleys`: play) has no useful
slope: a gap that is a tenth too wide meets its sides at other times. So a hypothesis is held
against itself with gaps of every width, closer than the valley is wide, as lanes of one call. Each
time under observers that trust it more and more, and at two places in x: its own, which a fit
without play has bent (a softer link), and that of the device file.

What each observer shows is no answer yet: on two masses of a CSV alone (1 kHz, 8 s, 20 mrad) best
gaps were 2 to 4 mrad, at a k of 14 for 60 N m/rad, and gained 125 to 309 in -2 ln; on others they
lay within 30 % of the truth and gained up to 7800. No fit follows from there, since play's valley
is as narrow as its gap is well known: fits from such gaps had ended at costs of -131 100, and
a cubic spring at -132 500. A population reached -135 100 in a second, and the fit that follows
-138 100, where the truth is. Under which observer they arrive differs (1e-4 there, 1e-2 or 1e-5 on
others), and gains under different observers do not compare. So each that shows play has a
population, from its own gap, and what arrives is held against the rest under its own noise.

Limits: what is left is not whitened, so that a gain counts errors as independent that are not; it
asks for populations and decides nothing.
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
SPREAD = 0.5  # of a population's first generation, in x
APART = 1.2  # times as wide is the next gap
BEYOND = 2.0  # times, that gaps go beyond the starts at both ends


class Played(NamedTuple):
    """A model with play at x, what it gains over the model without, and under which observer."""

    model: Model
    x: Floats
    gained: float
    ratio: float


def scanned(
    experiments: Sequence[Experiment], model: Model, x: Floats, starts: Sequence[Start]
) -> list[Played]:
    """Return the likeliest gap by each observer that shows one, the one that gains most first.

    experiments: as far as is looked at; starts: of one effect with one number, at one place. A gap
    gains what it costs less than no play at the best of the places in x, and at least
    `PURSUIT.clear_sign`: at a place that is wrong it softens the link, and gains 2000 to 3600 where
    there is none; held against the better place, nothing.
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
    """Yield where populations arrive from what a scan shows, each under the observer that does.

    experiments: as far as they grow in; members, generations: of a population that looks for the
    valley of a fit. From farther off it is twice as many for half as long: 16 arrived nowhere on
    the two masses above; 40 generations arrive as near as 80, for a fit to end.
    """
    plan = Generations(2 * members, max(generations // 2, 1), SPREAD)
    asked = [partial(evolve, experiments, s.model, [s.x], s.ratio, plan) for s in shown]
    with reason("populations of play"):
        arrived = in_parallel(asked, threads())
    for one, found in zip(shown, arrived, strict=True):
        for there in found:
            yield one.model, there


def _places(model: Model, x: Floats) -> Iterator[Floats]:
    """X as it is, and as it is in the device file."""
    yield x
    prior = np.array([p.prior for p in model.parameters])
    if np.any(x[prior] != 0.0):
        yield np.where(prior, 0.0, x)


class _Tried(NamedTuple):
    """The likeliest gap at one place in x, what it costs, and what no play costs there."""

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
    (j,) = (i for i, p in enumerate(wide.parameters) if i >= x.size and p.key == key)
    asked: list[Floats] = []
    for gap in (0.0, *gaps):
        own = np.zeros(len(wide.parameters))
        own[: x.size] = x
        own[j] = (gap - first.physics.values[key]) / wide.parameters[j].scale
        asked.append(wide.within(own))
    there, device = prepared_for(experiments, model, x, blind(ratio)), wide.acting(asked[1])
    contact = steadily(there.observer.gain)[:, : len(experiments[0].outputs)]
    links, seen = links_with_play(device), model.seen(experiments[0], x)
    gain = with_apart(device.bare(), links, seen, contact)  # as `noises` has them
    observer = replace(there.observer, gain=with_steady(there.observer.gain, gain))
    without, *found = Landscape(there.experiments, observer, wide).costs(asked)
    costs = np.nan_to_num(np.array(found), nan=np.inf)
    best = int(np.argmin(costs))
    gap = float(gaps[best])
    # A fit moves by its scale: by that of the least gap it would not move at all.
    physics = replace(first.physics, values={key: gap})
    played = model.with_effect(physics, {key: gap}, first.bounds)
    begin = played.within(np.append(x, 0.0))
    return _Tried(played, begin, float(costs[best]), float(np.nan_to_num(without, nan=np.inf)))
