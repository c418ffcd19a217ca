"""How much of what is left could each effect explain? One prediction a start, no fit.

With r the weighted residual at the linear refit, J its Jacobian and s = r_c - r the signature of an
effect switched on at a start, the best that effect and refit can do together at that magnitude is,
to first order, |(I - P)(r + s)|^2, P the projector on the span of J. The gain over |(I - P) r|^2 is
the start's score, a chi-square. What the refit absorbs is thereby gone before anything is named.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.candidates import Start
from diagnosis.fit import Fitted, Problem
from sim.ensemble import in_parallel, threads

Floats = NDArray[np.float64]
COLUMNS_KEPT = 1e-10


@dataclass(frozen=True)
class Screened:
    """A start with its score, and its signature off the refit's span."""

    start: Start
    score: float
    signature: Floats


class Complement:
    """Projection off the span of a Jacobian."""

    def __init__(self, jacobian: Floats) -> None:
        left, singular, _ = np.linalg.svd(jacobian, full_matrices=False)
        self.basis = left[:, singular > COLUMNS_KEPT * singular[0]]

    def __call__(self, vector: Floats) -> Floats:
        """Return the part of a vector (samples,) that the refit cannot absorb."""
        return vector - self.basis @ (self.basis.T @ vector)


def screen(problem: Problem, fitted: Fitted, starts: Sequence[Start]) -> list[Screened]:
    """Return all starts with their scores, best first, at most one per effect and place."""
    off = Complement(fitted.jacobian)
    base = off(fitted.residual)
    energy = float(base @ base)
    prior = fitted.residual[fitted.samples :]

    def score(start: Start) -> Screened:
        model = fitted.model.with_effect(start.physics, {})
        moved = np.concatenate([problem.weighted(model, fitted.x), prior])
        signature = off(moved - fitted.residual)
        after = base + signature
        return Screened(start, energy - float(after @ after), signature)

    def better(one: Screened) -> Screened:
        """Try again at the strength that would fit best were the signature linear in it."""
        size = float(one.signature @ one.signature)
        factor = -float(base @ one.signature) / size if size > 0.0 else 0.0
        other = one.start.scaled(factor) if 1e-3 < factor < 30.0 else None
        if other is None or abs(factor - 1.0) < 0.3:
            return one
        again = score(other)
        return again if again.score > one.score else one

    scored = in_parallel([lambda s=s: better(score(s)) for s in starts], threads())
    best: dict[str, Screened] = {}
    for one in scored:
        label = one.start.label
        if label not in best or one.score > best[label].score:
            best[label] = one
    return sorted(best.values(), key=lambda one: one.score, reverse=True)
