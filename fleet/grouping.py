"""Grouping of recordings by device in one pass, since fleets have thousands of both."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Places = NDArray[np.intp]


def places_by(names: Sequence[str]) -> dict[str, Places]:
    """Return the indices of each name, in the order of first occurrence."""
    found: dict[str, list[int]] = {}
    for place, name in enumerate(names):
        found.setdefault(name, []).append(place)
    return {name: np.array(places, dtype=np.intp) for name, places in found.items()}
