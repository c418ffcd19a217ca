"""The linear equations of a device: x' = A x + B u, and their exact solution under held inputs.

State x = [q_1..q_n, v_1..v_n] and, if the amplifier lags, the actuator force a after them. Inputs u
= [held command, f_1..f_n]: the command reaches m1 directly or through the lag tau a' = u - a; the
forces act on the masses.
"""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from zwidth.sim.chain import Matrices
from zwidth.sim.following import Following

Floats = NDArray[np.float64]


Link = tuple[int, int, float, float]  # two masses, spring and damper


class Plant(NamedTuple):
    """a (N, N), b (N, 1 + n), matrices (n, n each), lag [s]; n = dof, N = 2n or 2n + 1.

    For many devices the arrays have a first axis over devices, and lag is the longest.
    """

    a: Floats
    b: Floats
    matrices: Matrices
    lag: float

    @property
    def dof(self) -> int:
        """Number of masses, extra modes included."""
        return self.matrices.mass.shape[-1]

    @property
    def size(self) -> int:
        """Number of states."""
        return self.a.shape[-1]


def assemble(matrices: Matrices, lag: float | Floats = 0.0) -> Plant:
    """Write M q'' + C q' + K q = f, and the actuator's lag [s] if any, in first order.

    For one device, or for many with lags (...); either all of them lag or none.
    """
    n, lead = matrices.mass.shape[-1], matrices.mass.shape[:-2]
    longest = float(np.max(lag))
    size = 2 * n + (longest > 0.0)
    inverse = np.linalg.inv(matrices.mass)
    a = np.zeros((*lead, size, size))
    b = np.zeros((*lead, size, 1 + n))
    a[..., :n, n : 2 * n] = np.eye(n)
    a[..., n : 2 * n, :n] = -inverse @ matrices.stiffness
    a[..., n : 2 * n, n : 2 * n] = -inverse @ matrices.damping
    b[..., n : 2 * n, 1:] = inverse
    if longest > 0.0:
        a[..., n : 2 * n, 2 * n] = inverse[..., 0]
        a[..., 2 * n, 2 * n] = -1.0 / lag
        b[..., 2 * n, 0] = 1.0 / lag
    else:
        b[..., 0] = b[..., 1]
    return Plant(a, b, matrices, longest)


def follow(plant: Plant, followers: Sequence[tuple[int, int]], by: Following) -> None:
    """Make the states of places follow others, (place, followed place), by these equations.

    In place. The replaced entries belonged to masses so small that they have no effect.
    """
    a, b, n = plant.a, plant.b, plant.dof
    for follower, source in followers:
        s, g = follower, n + follower
        a[..., [s, g], :], b[..., g, :] = 0.0, 0.0
        a[..., s, source], a[..., s, s], a[..., s, g] = by.rate, np.negative(by.rate), by.straight
        a[..., g, source], a[..., g, s] = by.square, np.negative(by.square)
        a[..., g, n + source], a[..., g, g] = by.rate, np.negative(by.rate + by.damping)


def behind(plant: Plant, followers: NDArray[np.int64]) -> Floats:
    """Return the delay [s] of each follower at a steady speed, (..., k)."""
    a, n = plant.a, plant.dof
    found = np.zeros((*a.shape[:-2], followers.shape[0]))
    for i, (s, source) in enumerate(followers.tolist()):
        second = a[..., s, source] == 0.0
        over = np.where(second, a[..., n + s, source], a[..., s, source])
        found[..., i] = np.where(second, -a[..., n + s, n + s], 1.0) / over
    return found


def locked(plant: Plant, masses: tuple[int, ...]) -> Plant:
    """Return the plant with some masses fixed: their velocity stays exactly zero."""
    a, b = plant.a.copy(), plant.b.copy()
    for i in masses:
        a[i, :] = a[plant.dof + i, :] = 0.0
        b[plant.dof + i, :] = 0.0
    return plant._replace(a=a, b=b)


def opened(plant: Plant, links: Iterable[Link]) -> Plant:
    """Return the plant without the forces of some links."""
    a, n = plant.a.copy(), plant.dof
    stiffness, damping = plant.matrices.stiffness.copy(), plant.matrices.damping.copy()
    for first, second, spring, damper in links:
        for i, j in ((first, second), (second, first)):
            mass = plant.matrices.mass[i, i]
            for at, by, matrix in ((0, spring, stiffness), (n, damper, damping)):
                a[n + i, at + i] += by / mass
                a[n + i, at + j] -= by / mass
                matrix[i, i] -= by
                matrix[i, j] += by
    matrices = plant.matrices._replace(stiffness=stiffness, damping=damping)
    return plant._replace(a=a, matrices=matrices)


def hold(plant: Plant, duration: float) -> tuple[Floats, Floats]:
    """Return (Ad, Bd) with x(t + duration) = Ad x(t) + Bd u for inputs held over duration [s]."""
    return hold_matrices(plant.a, plant.b, duration)


def hold_matrices(a: Floats, b: Floats, duration: float) -> tuple[Floats, Floats]:
    """Return (Ad, Bd) of x' = a x + b u, u held over duration [s]."""
    n, m = b.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = a, b
    full = expm(block * duration)
    return full[:n, :n], full[:n, n:]
