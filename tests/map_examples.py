"""A small plane of walls, and two maps of it compared."""

from dataclasses import fields

import numpy as np
from engine_examples import phantom

from zwidth.stability.fate_map import FateMap
from zwidth.stability.fates import Fates
from zwidth.stability.judging import Trial
from zwidth.stability.plane import Axis, Plane

COARSE, LEVELS = 9, 2


def plane() -> Plane:
    """Return a plane of short runs."""
    device = phantom().with_interface(encoder_step=1e-4)
    return Plane(
        device, Axis("B", 0.0, 0.12), Axis("K", 1.0, 50.0), trial=Trial(1e-3, 1.0, 1.0, 0.125)
    )


def same(one: FateMap, other: FateMap) -> bool:
    """Whether two maps are equal to the bit."""
    arrays = [f.name for f in fields(Fates)]
    return np.array_equal(one.run, other.run) and all(
        getattr(one.fates, a).tobytes() == getattr(other.fates, a).tobytes() for a in arrays
    )
