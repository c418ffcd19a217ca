"""Learned laws: fitted if no library effect explains a recording, judged on held-out data."""

import itertools
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from zwidth.diagnosis.answer.adequacy import oftener_freer
from zwidth.diagnosis.answer.held_out import free_share, held_out
from zwidth.diagnosis.answer.laws import Law, LearnedLaw, LearnedSurface, factors, like_what
from zwidth.diagnosis.answer.result import HeldOut
from zwidth.diagnosis.answer.straying import beyond_noise, rms
from zwidth.diagnosis.answer.whole_run import finite_rms, free_run
from zwidth.diagnosis.learning.curves import Learned, laws, promising, replacing
from zwidth.diagnosis.learning.surfaces import surfaces
from zwidth.diagnosis.mishaps import Say
from zwidth.diagnosis.noise.family import as_far_as
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import Hypothesis, independent, judged, settled
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.selection.searched import FAR_S, Searched, as_found, judge_of
from zwidth.diagnosis.settings import VERDICT
from zwidth.sim.device import Device

# Forms of a spring, damper, scale, constant force or origin: parameters or library effects.
STRAIGHT = ("straight line", "line", "offset")
LAWS = 3  # laws of each horizon that are tested on held-out data


@dataclass(frozen=True)
class Asked:
    """The inputs of learning: an answer, recordings that judge, and a function for progress."""

    device: Device
    found: Searched
    judge_by: Sequence[Experiment]
    say: Say

    def hopeful(self, names: HeldOut, h: Hypothesis) -> bool:
        """Whether free runs with a full table err little enough for a law."""
        share = free_share(h.model, h.x, judge_of(h), self.judge_by)
        return share < VERDICT.worth_a_law * names.after

    def held_out(
        self, search: Search, h: Hypothesis, names: HeldOut
    ) -> tuple[HeldOut, Searched] | None:
        """Free runs on held-out data with a law, and the fit; None if they are no better."""
        law, found = as_found(self.device, replace(search, best=h)), self.found
        free = held_out(self.device, law, self.judge_by)[1]
        ratio = free.after / names.after if names.after > 0.0 else 1.0
        if (
            ratio < VERDICT.worth_a_law
            and (
                h.family.whitening
                or oftener_freer((law.final, law.judge), (found.final, found.judge), self.judge_by)
            )
            and not self.runs_away(law)
        ):
            return free, law
        self.say("the learned law does not predict the held-out data: dropped")
        return None

    def runs_away(self, law: Searched) -> bool:
        """Whether a law fails in a single free run over all held-out data.

        It fails if its error exceeds both the motion and the error without the law: a table may be
        right over short runs and wrong beyond its last point.
        """
        read = [e.measured[e.known, 0] for e in self.judge_by]
        motion = rms([y - y.mean() for y in read])
        return self._off(law) > max(self._off(self.found), motion)

    def _off(self, of: Searched) -> float:
        """Rms error of a free run over all held-out data, infinite after an overflow."""
        model, x = of.final.model, of.final.x
        runs = [(free_run(model, x, e, of.judge) - e.measured)[e.known, 0] for e in self.judge_by]
        return finite_rms(np.concatenate(runs))

    def judged(self, search: Search, curve: Learned, names: HeldOut) -> LearnedLaw | None:
        """A law with its errors on held-out data; None if these reject it, or it is a line."""
        fit = self.held_out(search, curve.hypothesis, names)
        if fit is None:
            return None
        looks, both = like_what(curve)
        if looks and looks[0].form.name in STRAIGHT:
            self.say("the learned law is a straight line, which is a linear parameter: dropped")
            return None
        return LearnedLaw(curve, names, *fit, looks, both)

    def horizons(self) -> Iterator[Search]:
        """The search, and the same judged over a longer horizon."""
        tried = self.found.tried
        yield tried
        if not tried.best.family.whitening:
            return
        best = tried.best
        with suppress(NoObserver):
            ahead = as_far_as(FAR_S, best.experiments)
            family = independent(judged(best.experiments, best.model, best.x, ahead), FAR_S).family
            plain, best = (
                settled(judged(h.experiments, h.model, h.x, family)) for h in (tried.plain, best)
            )
            yield replace(tried, plain=plain, best=best, tried={}, on_bounds={})


def learned(asked: Asked, names: HeldOut) -> LearnedLaw | None:
    """Learn a law if effects do not explain a recording; None if no law improves held-out data.

    Laws are sought by one-step errors, and by errors over a longer horizon: if a hypothesis assumes
    noise of slow forces, one-step errors show little of a law, and a motion of half a second shows
    much. First the most likely law of each horizon is tested. Of those that improve held-out data,
    the one with the smaller error there is returned; if neither does, the next of each horizon is
    tested. names: free runs on held-out data with the named effects.
    """
    asked.say("the effects of the library do not explain the recording: learning a law")
    hopeful = partial(asked.hopeful, names)
    horizons = [(search, laws(search, asked.say, hopeful)) for search in asked.horizons()]
    for _ in range(LAWS):
        told = [
            one
            for search, each in horizons
            if (curve := next(each, None)) is not None
            and (one := asked.judged(search, curve, names)) is not None
        ]
        # A law learned over one horizon may hold only on the data that it was learned from.
        if told:
            return min(told, key=lambda law: law.law.after)
    return None


def learned_over_two(asked: Asked, names: HeldOut, one: Law | None) -> LearnedSurface | None:
    """Learn a law over two states; None if none improves held-out data, or `Effort` excludes them.

    Tried if free runs still err more than noise predicts, also with the law `one` of one state, if
    any. Works as `learned`, and also compares with that law.
    """
    if not asked.found.tried.effort.surfaces:
        return None
    left = names if one is None else one.law
    if not beyond_noise(left.after, left.noise_floor):
        return None
    asked.say("checking whether the remaining error depends on two quantities together")
    told: list[LearnedSurface] = []
    for search in asked.horizons():
        than = [search.best, search.plain]
        if isinstance(one, LearnedLaw) and (h := _alike(search, one.curve.hypothesis)) is not None:
            than.append(h)
        for forms in surfaces(search, than, asked.say, partial(asked.hopeful, left)):
            held = False
            for surface in forms:
                fit = asked.held_out(search, surface.hypothesis, left)
                if fit is None:
                    continue
                held, law = True, LearnedSurface(surface, left, *fit, factors(surface))
                if law.law.after < law.law.noise_floor:
                    return law  # nothing is left to explain
                told.append(law)
            if held:
                break
    return min(told, key=lambda law: law.law.after, default=None)


def _alike(search: Search, h: Hypothesis) -> Hypothesis | None:
    """A hypothesis fitted with a search's noise family; None if no observer is possible."""
    family = search.best.family
    if h.family == family:
        return h
    with suppress(NoObserver):
        return settled(judged(h.experiments, h.model, h.x, family))
    return None


def beside_names(asked: Asked, names: HeldOut) -> tuple[LearnedLaw | None, bool]:
    """Return a law if effects explain a recording, and whether it replaces several of them.

    Several named effects may together approximate one law that is in no library, or lack a part
    over one state. This is tried only if a few rounds of fitting promise a law beside the named
    effects, because a law that is better in their place also improves the fit beside them. None if
    the named effects are better.
    """
    tried, hopeful = asked.found.tried, partial(asked.hopeful, names)
    tables = promising(tried.best, asked.say, hopeful)
    if not tables:
        return None, False
    asked.say("checking whether one learned law explains as much as the named effects together")
    for curve in itertools.islice(replacing(tried, asked.say, hopeful), LAWS):
        law = asked.judged(tried, curve, names)
        if law is not None:
            return law, True
    for curve in itertools.islice(laws(tried, asked.say, hopeful, tables), LAWS):
        law = asked.judged(tried, curve, names)
        if law is not None:
            return law, False
    return None, False
