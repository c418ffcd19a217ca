"""The states of the plant that sensors read, if readings are filtered.

A reading that lags behind the motion of a mass is two more states of the plant, its position and
its rate (`sim/following.py`), and is therefore solved exactly. These states are placed like those
of a further mass, after all masses. Several filters of one device are in series, in the order of
its physics.

    sensor      every reading: positions and velocities alike
    velocity    readings of velocities alone
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.place import Place

Ints = NDArray[np.int64]


class Places(NamedTuple):
    """The index of the first velocity in a state, and the places where each mass is read."""

    dof: int
    reads: Ints


class Reading(NamedTuple):
    """Indices in a plant: of n masses of the chain, and of k filtered readings.

    reads (2, n): indices of the position and of the velocity that are read for each mass. followers
    (k, 2): index of each follower, and of the state that it follows. filters: how many followers
    each filter has, in order.
    """

    reads: Ints
    followers: Ints
    filters: tuple[int, ...]


def reading(masses: int, moving: int, filters: Iterable[Place]) -> Reading:
    """Return the reading for a chain of n masses, `moving` masses in total, and filters."""
    reads = np.tile(np.arange(masses), (2, 1))
    followers: list[tuple[int, int]] = []
    counts: list[int] = []
    for place in filters:
        rows = (1,) if place.kind == "velocity" else (0, 1)
        sources = np.unique(reads[list(rows)])
        made = {source: moving + len(followers) + i for i, source in enumerate(sources.tolist())}
        followers += [(follower, source) for source, follower in made.items()]
        counts.append(len(made))
        for row in rows:
            reads[row] = [made[source] for source in reads[row].tolist()]
    return Reading(reads, np.array(followers, dtype=np.int64).reshape(-1, 2), tuple(counts))
