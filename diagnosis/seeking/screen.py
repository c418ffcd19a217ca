"""Scores how much of the residual each effect could explain, by one prediction per start.

Let r be the weighted residual at the linear refit, J its Jacobian and s = r_c - r the signature of
an effect switched on at a start. To first order, the best residual of effect and refit together at
that magnitude is |(I - P)(r + s)|^2, where P is the projector on the span of J. The reduction from
|(I - P) r|^2 is the start's score, a chi-square, which excludes what a refit could absorb.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.mishaps import attempt
from zwidth.diagnosis.noise.predictor import SCREENING
from zwidth.diagnosis.seeking.candidates import Start
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.physics.sizes import QUARTER

Floats = NDArray[np.float64]
COLUMNS_KEPT = 1e-10
PROMISING = 5.0  # first-order chi-square that justifies trying another strength
HOPEFUL = 0.02  # the same as a share of the best start's


@dataclass(frozen=True)
class Screened:
    """A start with its score, its signature orthogonal to the refit, and the refit's shift of x."""

    start: Start
    score: float
    signature: Floats
    shift: Floats


class Complement:
    """Projection orthogonal to the span of a Jacobian."""

    def __init__(self, jacobian: Floats) -> None:
        left, singular, right = np.linalg.svd(jacobian, full_matrices=False)
        kept = singular > COLUMNS_KEPT * singular[0]
        self.basis = left[:, kept]
        self.inverse = right[kept].T / singular[kept]

    def __call__(self, vector: Floats) -> Floats:
        """Return the part of a vector (samples,) that the refit cannot absorb."""
        return vector - self.basis @ (self.basis.T @ vector)

    def absorbing(self, vector: Floats) -> Floats:
        """Return the change of x (p,) by which the refit absorbs its part of a vector."""
        return -self.inverse @ (self.basis.T @ vector)


def screen(
    problem: Problem, fitted: Fitted, starts: Sequence[Start], stage: str = "candidates"
) -> list[Screened]:
    """Return all starts with their scores, best first, at most one per effect and place.

    stage: where an error of a start is reported (`zwidth.diagnosis.mishaps`).
    """
    off = Complement(fitted.jacobian)
    base = off(fitted.residual)
    energy = float(base @ base)
    prior = np.zeros(fitted.residual.size - fitted.samples)
    rough = Problem(problem.experiments, problem.observer, SCREENING)
    still = rough.weighted(fitted.model, fitted.x)

    def score(start: Start) -> Screened:
        model = fitted.model.with_effect(start.physics, {})
        moved = rough.weighted(model, fitted.x) - still
        whole = np.concatenate([moved, prior])
        signature = off(whole)
        after = base + signature
        return Screened(start, energy - float(after @ after), signature, off.absorbing(whole))

    def scores(starts: Sequence[Start]) -> list[Screened]:
        tasks = [partial(attempt, stage, s.label, partial(score, s)) for s in starts]
        return [one for one in in_parallel(tasks, threads()) if one is not None]

    groups: dict[str, list[Start]] = {}
    for start in starts:
        groups.setdefault(start.label, []).append(start)
    best: list[Screened] = []
    most = 0.0
    for group in groups.values():  # one by one: signatures of a long recording fill memory
        scored = scores(group)
        most = max([most, *(one.score for one in scored)])
        scored += scores(second_looks(scored, base, max(PROMISING, HOPEFUL * most)))
        best += sorted(scored, key=lambda one: one.score, reverse=True)[:1]
    return sorted(best, key=lambda one: one.score, reverse=True)


def second_looks(scored: Sequence[Screened], base: Floats, least: float) -> list[Start]:
    """Return starts at the best strength or phase for linear signatures, if they gain `least`."""
    found = turned_starts(scored, base, least)
    for one in scored:
        size = float(one.signature @ one.signature)
        along = -float(base @ one.signature)
        factor = along / size if size > 0.0 else 0.0
        near, turning = abs(factor - 1.0) < 0.3, one.start.physics.effect.turning
        if near or turning or not 1e-3 < factor < 30.0 or along * factor < least:
            continue
        other = one.start.scaled(factor)
        if other is not None:
            found.append(other)
    return found


def turned_starts(scored: Sequence[Screened], base: Floats, least: float = 0.0) -> list[Start]:
    """Return the best phase and size between two starts a quarter turn apart.

    least: chi-square that they must gain to first order.

    A cos(x + phase) is linear in A cos(phase) and A sin(phase), so two signatures determine both;
    from a phase on the wrong side a fit would have to pass through zero.
    """
    quarters: dict[tuple[object, ...], dict[float, Screened]] = {}
    for one in scored:
        physics = one.start.physics
        for name in physics.effect.turning:
            own = (name, physics.effect.strength)
            rest = [v for k, v in physics.values.items() if k not in own]
            quarters.setdefault((one.start.label, *rest), {})[physics.values[name]] = one
    found: list[Start] = []
    for pair in quarters.values():
        if 0.0 in pair and QUARTER in pair:
            start = _between(pair[0.0], pair[QUARTER], base, least)
            if start is not None:
                found.append(start)
    return found


def _between(first: Screened, second: Screened, base: Floats, least: float) -> Start | None:
    matrix = np.column_stack([first.signature, second.signature])
    a, b = np.linalg.lstsq(matrix, -base)[0]
    left = base + matrix @ np.array([a, b])
    if base @ base - left @ left < least:
        return None
    physics = first.start.physics
    (name,), (key,) = physics.effect.turning, physics.effect.magnitudes
    along = float(a) * physics.values[key]
    across = float(b) * second.start.physics.values[key]
    size = math.hypot(along, across)
    most = physics.effect.parameter(key).upper
    if not 0.0 < size <= most:  # not a possible size of this effect
        return None
    values = {**physics.values, key: size, name: math.atan2(across, along)}
    scales = {**first.start.scales, key: size}
    return replace(first.start, physics=replace(physics, values=values), scales=scales)
