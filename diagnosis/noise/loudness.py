"""Where the noise is louder: a clock that jitters errs by as much as the command changes.

A command u that acts late by tau of a tick T is a force error of (u_k - u_(k-1)) tau / T for that
tick. If tau is random, its variance follows the squared change of the command, and that of the
whitened innovations w follows a mean of it over the last ticks, s_k (of mean one):

    E w_k^2 = a + b s_k.

a and b are fitted by least squares with weights 1 / (a + b s_k)^2, since the variance of w^2 is
twice its squared mean. The observer keeps one gain: this is for tests that compare stretches of a
recording (an event, errors on held-out data), in which noise of the same size everywhere would be
too quiet in lively stretches and too loud in quiet ones.

Limits: physics that is missing while the command changes raises b too, so that an event beside it
must stand out from it.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.settings import ADEQUACY

Floats = NDArray[np.float64]
LAST = 8  # ticks over which a changing command counts: delays and observers spread it
TURNS = 5  # alternations of weights and coefficients
QUIETEST = 0.02  # least share of the variance that does not follow the command


def loudness(white: Sequence[Floats], commands: Sequence[Floats]) -> list[Floats]:
    """Return the relative deviation (ticks,) of the noise of each recording, 1 on average.

    white: whitened innovations (ticks, o) of recordings, zero where they do not count; commands:
    (ticks,). All ones if the noise does not clearly follow the command, or is not finite.
    """
    changed = [np.diff(u, prepend=u[0]) ** 2 for u in commands]
    recent = [np.convolve(c, np.full(LAST, 1.0 / LAST))[: c.size] for c in changed]
    squares = np.concatenate([np.mean(w**2, axis=1) for w in white])
    at = np.concatenate(recent)
    counts = squares > 0.0
    still = [np.ones(w.shape[0]) for w in white]
    if not np.all(np.isfinite(squares)) or counts.sum() <= 2 or not np.ptp(at[counts]) > 0.0:
        return still
    usual = float(at[counts].mean())
    a, b, sure = _following(squares[counts] / float(squares[counts].mean()), at[counts] / usual)
    if sure < ADEQUACY.follows:
        return still
    return [np.sqrt((a + b * r / usual) / (a + b)) for r in recent]


def _following(y: Floats, s: Floats) -> tuple[float, float, float]:
    """Return a and b of E y = a + b s, and by how many sigma b is above zero."""
    columns = np.column_stack([np.ones(s.size), s])
    a, b, expected = 1.0, 0.0, np.ones(s.size)
    inverse = np.eye(2)
    for _ in range(TURNS):
        inverse = np.linalg.inv(columns.T @ (columns / expected[:, None] ** 2))
        one, other = inverse @ (columns.T @ (y / expected**2))
        a, b = max(float(one), QUIETEST), max(float(other), 0.0)
        expected = a + b * s
    scatter = float(np.mean((y / expected - 1.0) ** 2))
    return a, b, b / math.sqrt(scatter * float(inverse[1, 1]))
