"""Gains of an observer during and after gaps of a recording.

A sample that was not measured corrects nothing, so the uncertainty of the state continues to grow,
and the first samples after a gap correct it by more:

    P_(k+1) = A (P_k - m_k K_k c P_k) A' + Q,    K_k = P_k c' (c P_k c' + R)^-1,

where m_k = 1 if sample k was measured and 0 if it was lost. This is Kalman's filter of the same
linear model and noise as the steady observer (`noise.steady`), from whose P it starts and to which
it returns. (With the steady gain after each gap of 10 samples, under an unknown force as large as
the command, a link's damper was wrong by 5 of its standard errors.)

A recording needs few different P, since gaps of one length are alike: a P is reused for another if
their covariances with as many following readings as there are states agree to `ALIKE`. Effects are
neglected, as in the steady gain.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.noise.steady import Spread, spread
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
Lost = NDArray[np.bool_]
ALIKE = 1e-4  # of the largest of a state's covariances with the next readings
# Most gains along a recording; then the nearest is used. With 3 in 10 of 20 000 samples lost at
# random it is off by 4 % of the gain rms.
MOST = 1000


@dataclass(frozen=True, eq=False)
class Returning:
    """A steady gain (states, o), or (states, 2 o) with play, and the model behind it."""

    steady: Floats
    spread: Spread


Gain = Floats | Returning


def returning(
    device: Device, experiments: Sequence[Experiment], ratio: float, gain: Floats
) -> Gain:
    """Return a gain that accounts for gaps, if recordings have any, else the steady gain.

    device, ratio: of the steady gain. Raises NoObserver like `steady.spread`.
    """
    if all(e.bridged is None for e in experiments):
        return gain
    return Returning(gain, spread(device, experiments[0], ratio))


def steadily(gain: Gain) -> Floats:
    """Return the steady part of a gain."""
    return gain.steady if isinstance(gain, Returning) else gain


def with_steady(gain: Gain, steady: Floats) -> Gain:
    """Return a gain with another steady one, of the same model and noise."""
    return replace(gain, steady=steady) if isinstance(gain, Returning) else steady


def along(gains: Sequence[Gain], lost: Lost | None) -> tuple[list[Floats], NDArray[np.int64]]:
    """Return gains, and the first column that counts at each sample, as in `sim.predict.Gains`.

    lost (ticks,): which samples were not measured. If none are, or a gain is steady, returns the
    steady gains and an empty array.
    """
    made = tuple(g for g in gains if isinstance(g, Returning))
    if lost is None or len(made) < len(gains) or not lost.any():
        return [steadily(g) for g in gains], np.zeros(0, dtype=np.int64)
    return _along(made, lost.tobytes())


@lru_cache(maxsize=8)  # a fit asks for the same again and again
def _along(gains: tuple[Returning, ...], lost: bytes) -> tuple[list[Floats], NDArray[np.int64]]:
    first = gains[0].spread
    together = Spread(
        np.stack([g.spread.p for g in gains]), np.stack([g.spread.motion for g in gains]), first.c,
        np.stack([g.spread.process for g in gains]), first.noise,
    )  # fmt: skip
    which, found = schedule(together, np.frombuffer(lost, dtype=np.bool_))
    o, wide = first.c.shape[0], list[Floats]()
    for i, gain in enumerate(gains):
        own = found[:, i]
        own[0] = gain.steady[:, :o]
        free = own.copy()
        if gain.steady.shape[1] > o:
            free[:, ~gain.steady[:, o:].any(axis=1)] = 0.0
        wide.append(np.hstack([*own, *free]))
    return wide, which * o


def schedule(spread: Spread, lost: Lost) -> tuple[NDArray[np.int64], Floats]:
    """Return which gain counts at each sample (ticks,), and the gains (k, members, states, o).

    Gain 0 is the steady one. spread: of several observers, for which the same gain counts.
    """
    _, motion, c, process, noise = spread
    n = c.shape[1]
    ahead = np.concatenate([c @ np.linalg.matrix_power(motion, k) for k in range(n)], axis=1)
    noises = np.tile(np.diag(noise), n)

    def readings(p: Floats) -> tuple[Floats, Floats]:
        """Covariances (members, n, n o) of the state with the next n readings; their variances."""
        beside = p @ ahead.swapaxes(1, 2)
        return beside, np.einsum("mri,mir->mr", ahead, beside) + noises

    known, gains = [spread.p], [spread.gain()]
    seen, variance = readings(spread.p)
    told, variances = np.empty((MOST, *seen.shape)), np.empty((MOST, *variance.shape))
    told[0], variances[0] = seen, variance
    after: dict[tuple[int, bool], int] = {(0, False): 0}
    which, here, since = np.zeros(lost.size, dtype=np.int64), 0, set[int]()
    for k, gone in enumerate(lost.tolist()):
        which[k] = here
        # P returning to the steady one must not be replaced by a P that it just left.
        since = set[int]() if gone else since | {here} if here else since
        step = (here, gone)
        if step not in after:
            p = known[here]
            p = p if gone else p - gains[here] @ c @ p
            p = motion @ p @ motion.swapaxes(1, 2) + process
            p = 0.5 * (p + p.swapaxes(1, 2))
            seen, variance = readings(p)
            off = np.abs(variances[: len(known)] / variance - 1.0).max(axis=(1, 2))
            rows = ALIKE * np.abs(seen).max(axis=2, keepdims=True)
            close = np.flatnonzero(off <= n * ALIKE).tolist()
            near = np.array([i for i in close if i not in since], dtype=np.int64)
            alike = (np.abs(told[near] - seen) <= rows).all(axis=(1, 2, 3))
            same = int(near[np.argmax(alike)]) if alike.any() else None
            if same is None and len(known) == MOST:
                same = int(np.argmin(off))
            if same is None:
                same = len(known)
                told[same], variances[same] = seen, variance
                known.append(p)
                gains.append(spread._replace(p=p).gain())
            after[step] = same
        here = after[step]
    return which, np.stack(gains)
