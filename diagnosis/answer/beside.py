"""What stands beside an answer: how sure it is, and what else was fitted in its place."""

import math

import numpy as np

from zwidth.diagnosis.answer.result import Rival
from zwidth.diagnosis.selection.evidence import ALPHA, probabilities
from zwidth.diagnosis.selection.hypothesis import Hypothesis, against
from zwidth.diagnosis.selection.search import Search
from zwidth.sim.device import place_label
from zwidth.sim.physics import EFFECTS, contains
from zwidth.sim.place import of_label


def without(found: Search, label: str) -> float:
    """At how many sigma the best hypothesis stands above the best that lacks an effect."""
    best = found.best
    lacking = [h for h in found.tried.values() if label not in h.labels]
    nearest = min(lacking, key=lambda h: h.cost.total)
    bare = found.tried.get(best.labels - {label}, nearest)
    return max(0.0, against(best, bare).sigma)


def shares(found: Search) -> dict[frozenset[str], float]:
    """Return the probability of every structure that was fitted to its end.

    An effect more than the best has is one of all that was looked through, and pays for it what a
    search asks of it (`evidence.believed`).
    """
    best = found.best
    kept = list(found.tried.values())
    relative = [_behind(h, best) + _looked_through(h, best) for h in kept]
    return dict(zip((h.labels for h in kept), probabilities(relative).tolist(), strict=True))


def probability(found: Search, label: str) -> float:
    """Return the probability that a device has an effect: of all structures with it."""
    return math.fsum(p for labels, p in shares(found).items() if label in labels)


def with_richer(found: Search, label: str) -> float:
    """Return the probability that a device has an effect or a richer form of it.

    Who is told of a limit is told no less where that limit falls with speed: what contains an
    effect takes nothing from its name, as it does not by its sigma (`Finding.confusable_with`).
    """

    def has(labels: frozenset[str]) -> bool:
        return any(other == label or _contains(other, label) for other in labels)

    return math.fsum(p for labels, p in shares(found).items() if has(labels))


def elsewhere(found: Search, label: str) -> dict[str, float]:
    """Return by how much the values of an effect scatter over the structures that have it.

    Variances about those of the best, weighed by probability: which other effects a device has is
    not known either, and what they are moves the values.
    """
    best = found.best
    own = _values(best, label)
    odds = {h: p for h, p in shares(found).items() if label in h and p > 0.0}
    total = math.fsum(odds.values())
    scatter = dict.fromkeys(own, 0.0)
    if not total > 0.0:
        return scatter
    for labels, share in odds.items():
        for name, value in _values(found.tried[labels], label).items():
            parameter = EFFECTS[of_label(label)[0]].parameter(name)
            off = value - own[name]
            if parameter.role == "turning" and parameter.unit == "rad":
                off = math.remainder(off, 2.0 * math.pi)
            scatter[name] += share / total * off**2
    return scatter


def _values(h: Hypothesis, label: str) -> dict[str, float]:
    return next(dict(p.values) for p in h.model.effects_at(h.x) if place_label(p) == label)


def rivals(found: Search, label: str) -> tuple[Rival, ...]:
    """Return what was fitted in the place of an effect of the best hypothesis, nearest first."""
    best = found.best
    behind: dict[str, float] = {}
    for h in found.tried.values():
        new, gone = h.labels - best.labels, best.labels - h.labels
        # What costs without bound has a parameter of which the recordings say nothing.
        if label not in gone or len(new) != 1 or not math.isfinite(h.cost.total):
            continue
        (other,) = new
        # One law in the place of several is their rival where it contains them all.
        if len(gone) == 1 or all(_contains(other, one) for one in gone):
            sigma = math.sqrt(max(0.0, _behind(h, best)))
            behind[other] = min(sigma, behind.get(other, math.inf))
    ordered = sorted(behind.items(), key=lambda pair: pair[1])
    return tuple(_rival(found, other, sigma) for other, sigma in ordered)


def _contains(richer: str, simple: str) -> bool:
    return contains(*of_label(richer), *of_label(simple))


def _rival(found: Search, label: str, sigma: float) -> Rival:
    effect, place = of_label(label)
    return Rival(effect, str(place), sigma, probability(found, label))


def _looked_through(h: Hypothesis, best: Hypothesis) -> float:
    more = len(h.model.effects) - len(best.model.effects)
    return 2.0 * math.log(1.0 / ALPHA) * max(0, more)


def _behind(h: Hypothesis, best: Hypothesis) -> float:
    """By how much a hypothesis costs more than the best, in units of the pair's overdispersion."""
    if h is best:
        return 0.0
    phi = against(best, h).phi
    return float(np.nan_to_num((h.cost.total - best.cost.total) / phi, posinf=1e300))
