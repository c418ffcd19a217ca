"""A texture: a force that is a sine of the position, alone or on a wall (`sim/wall_law.py`)."""

import math
from functools import cache
from types import MappingProxyType
from typing import Any

import numpy as np

from zwidth.sim.controller import Controller, compile_step
from zwidth.sim.wall_law import texture_push


def texture_step(k, t, y, v, p, m):  # pyright: ignore
    """Push back by the grating, the spring under it and the damper."""
    m[0] = 1.0 if p[3] == 0.0 or y > p[2] else 0.0
    return -texture_push(p, y, v)


@cache
def _compiled() -> Any:
    return compile_step(texture_step)


def texture(
    stiffness: float,
    wavelength: float,
    damping: float = 0.0,
    position: float = 0.0,
    share: float = 1.0,
    one_sided: bool = False,
) -> Controller:
    """Return a grating whose steepest slope is K [N m/rad | N/m], of a wavelength [rad | m].

    share: part of the steepest slope that belongs to the grating; the rest is a plain spring. 1 is
    the grating alone, whose force has the amplitude K wavelength / (2 pi). damping B [N m s/rad | N
    s/m].

    Raises ValueError for a wavelength that is not > 0, a share outside 0 to 1, or values that are
    not finite.
    """
    if not 0.0 < wavelength < math.inf:
        raise ValueError(f"controller.wavelength is {wavelength}; it must be finite and > 0")
    if not 0.0 <= share <= 1.0:
        raise ValueError(f"controller.share is {share}; it must be from 0 to 1")
    for name, value in (("stiffness", stiffness), ("damping", damping), ("position", position)):
        if not np.isfinite(value):
            raise ValueError(f"controller.{name} is {value}; only finite numbers are allowed")
    facts = {
        "stiffness": float(stiffness), "wavelength": float(wavelength), "damping": float(damping),
        "position": float(position), "share": float(share), "one_sided": bool(one_sided),
    }  # fmt: skip
    number = 2.0 * math.pi / wavelength
    parameters = np.array([stiffness, damping, position, float(one_sided), number, share])
    return Controller("texture", _compiled(), parameters, 1, MappingProxyType(facts))
