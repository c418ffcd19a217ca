"""Steps of a fit that are straight in the coefficients of the chain's transfer function.

The motion of m1 under its force obeys D(s) q1 = N(s) F, with

    D = det(M s^2 + C s + K) / det M,    N = the same without the first row and column / det M,

so that an error of this equation is linear in the coefficients of N and D, but not in masses,
springs and dampers. There are as many of them (4 n - 2 for n masses, one more with a spring to
ground) as parameters of the chain, and each chain has its own. So a step d in x, computed with the
slopes J of the coefficients y(x), follows the curve

    y(x(s)) = y(x) + s J d,

which starts in the direction d and is followed by Newton's method on y alone, without a simulation.
On a chain of three masses of which one is seen, with masses known to 3 % and their combinations to
1e-4, the whole step of Gauss and Newton cost 3450 more in -2 ln along the straight line, where the
quadratic form promised 2.9 less; along this curve it gained 3.4.

Limits: effects and readings go along the straight line, and so does the chain where none has the
coefficients of a far step.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.model.parameters import Model
from zwidth.sim.chain import Chains

Floats = NDArray[np.float64]
WIDTH = 1e-6  # width of differences in x
TURNS = 8  # most iterations of Newton's method
FOUND = 1e-6  # change of x below which a point of the curve is found
FARTHEST = 0.5  # in x: the longest step of an iteration
CHAIN = ("mass", "damper", "spring", "link", "k0")


def along(model: Model, x: Floats, steps: Sequence[Floats], parts: Sequence[float]) -> Floats:
    """Return x after parts of steps (steps, parts, x), along their curves; parts ascend."""
    ways = np.stack(steps)
    straight = x + np.array(parts)[None, :, None] * ways[:, None, :]
    chain = np.array([i for i, p in enumerate(model.parameters) if p.kind in CHAIN])
    if model.nominal.chain.masses.size == 1 or not np.isfinite(ways).all():
        return straight
    begins, slopes = _slopes(model, x[None], chain)
    found = straight.copy()
    z, sound = np.repeat(x[None], len(steps), axis=0), np.ones(len(steps), dtype=np.bool_)
    for k, part in enumerate(parts):
        aim = begins + part * ways[:, chain] @ slopes[0].T
        z[:, :] = np.where(np.isin(np.arange(x.size), chain), z, straight[:, k])
        last = _solved(model, z, chain, aim)
        sound &= last < FOUND
        found[sound, k] = z[sound]
    return found


def _solved(model: Model, z: Floats, chain: NDArray[np.int64], aim: Floats) -> Floats:
    """Move the chain's x in z (steps, x) to where the coefficients are `aim`; the last change."""
    last = np.full(z.shape[0], np.inf)
    with np.errstate(all="ignore"):
        for _ in range(TURNS):
            at, slopes = _slopes(model, z, chain)
            size = np.abs(slopes).sum(axis=2, keepdims=True)
            left = (aim - at)[:, :, None] / size
            sound = np.isfinite(left).all(axis=(1, 2)) & np.isfinite(slopes).all(axis=(1, 2))
            square = np.where(sound[:, None, None], slopes / size, np.eye(chain.size))
            try:
                move = np.linalg.solve(square, np.where(sound[:, None, None], left, 0.0))[:, :, 0]
            except np.linalg.LinAlgError:
                return np.full(z.shape[0], np.inf)
            last = np.where(sound, np.abs(move).max(axis=1), np.inf)
            if np.all((last < FOUND) | ~sound):
                break
            far = np.minimum(1.0, FARTHEST / np.maximum(np.abs(move).max(axis=1), 1e-300))
            z[:, chain] += far[:, None] * move
    return last


def _slopes(model: Model, z: Floats, chain: NDArray[np.int64]) -> tuple[Floats, Floats]:
    """Coefficients (members, c) at z (members, x), and slopes (members, c, c) by the chain's x."""
    moves = np.zeros((2 * chain.size + 1, z.shape[1]))
    moves[1 + np.arange(chain.size), chain] = WIDTH
    moves[1 + chain.size + np.arange(chain.size), chain] = -WIDTH
    every = (z[:, None, :] + moves).reshape(-1, z.shape[1])
    each = coefficients(model.chains(every)).reshape(z.shape[0], moves.shape[0], -1)
    ahead, behind = each[:, 1 : 1 + chain.size], each[:, 1 + chain.size :]
    return each[:, 0], ((ahead - behind) / (2.0 * WIDTH)).swapaxes(1, 2)


def coefficients(chains: Chains) -> Floats:
    """Return the coefficients (chains, c) of N and of D without those that are the same for all."""
    masses, count = chains.masses, chains.masses.shape[1]
    after, own = np.zeros((masses.shape[0], 1)), np.ones((masses.shape[0], 1))
    for i in reversed(range(count)):
        last = i == count - 1
        spring = chains.ground_spring if i == 0 else chains.link_springs[:, i - 1]
        damper = chains.ground_dampers[:, i] + (0.0 if i == 0 else chains.link_dampers[:, i - 1])
        if not last:
            spring = spring + chains.link_springs[:, i]
            damper = damper + chains.link_dampers[:, i]
        new = _times(np.stack([masses[:, i], damper, spring], axis=1), own)
        if not last:
            link = np.stack([chains.link_dampers[:, i], chains.link_springs[:, i]], axis=1)
            less = _times(_times(link, link), after)
            new[:, new.shape[1] - less.shape[1] :] -= less
        after, own = own, new
    whole = own[:, :1]
    tied = chains.ground_spring.any()
    return np.concatenate([after, own[:, 1 : own.shape[1] - (0 if tied else 1)]], axis=1) / whole


def _times(a: Floats, b: Floats) -> Floats:
    """Products (members, terms) of polynomials."""
    found = np.zeros((a.shape[0], a.shape[1] + b.shape[1] - 1))
    for i in range(a.shape[1]):
        found[:, i : i + b.shape[1]] += a[:, i : i + 1] * b
    return found
