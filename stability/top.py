"""What limits a boundary at its top, and how friction and steps change its height there.

The force of a wall is late: its spring by the delay and half a sample of the hold, its damper also
by half a sample of the backward difference and by the filter. As phase lags at the frequency of the
oscillation in which the boundary ends,

    spring  360 f (T/2 + t_d)        damper  360 f (T + t_d) - arg(filter and estimator)

in degrees; with two rates, T is the interval between new positions for the spring and between new
velocities for the damper. A spring that lags by phi removes the damping K sin(phi) / w; a damper
that lags by more than 90 degrees drives the motion. `branches.py` identifies the mode by following
it from the device without a wall.

The contribution of friction or of steps is the difference from the boundary of the same device
without them, at the same B and from the same starts.

Limits: modes are those of linear theory, of one rate and without force feedback; friction, play and
limits may end a boundary elsewhere, in another oscillation, which has no mode's name. An estimator
that is not linear has no phase lag and is tuned to the encoder's step, so no comparison without the
step is made.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zwidth.sim.device import Device, place_label
from zwidth.sim.interface import Interface
from zwidth.stability.bisection import Search, find_brackets
from zwidth.stability.boundary import Boundary
from zwidth.stability.branches import critical_mode
from zwidth.stability.judging import Trial
from zwidth.stability.linear import corner, critical_stiffness, has_theory
from zwidth.stability.velocity import filter_response

BESIDE = 0.03  # distance of the two sides of the top from its B, over that B
CLOSE = 1e-3  # of the linear corner's B: within this distance the corner is the top


@dataclass(frozen=True)
class Ending:
    """The oscillation in which a boundary ends at a damping: mode, frequency [Hz], angles [deg].

    spring_lag_deg, damper_lag_deg: the phase lags of the wall's two forces there.
    """

    damping: float
    mode: str
    frequency_hz: float
    spring_lag_deg: float
    damper_lag_deg: float


def ending(device: Device, damping: float) -> Ending | None:
    """Return the oscillation in which the linear boundary ends at B; None if it is unknown."""
    face = device.interface
    if not has_theory(device) or face.multirate or face.force_gain > 0.0:
        return None
    point = critical_stiffness(device, damping)
    mode = critical_mode(device, point)
    if mode is None or point.frequency_hz is None:
        return None
    spring, damper = lags(face, point.frequency_hz)
    assert damper is not None  # linear theory applies
    return Ending(float(damping), mode, float(point.frequency_hz), spring, damper)


def lags(face: Interface, frequency_hz: float) -> tuple[float, float | None]:
    """Return the phase lags [deg] of a wall's spring and damper at a frequency [Hz].

    The damper's lag is None if the velocity estimator is not linear.
    """
    turn, held = 360.0 * frequency_hz, face.period * face.position_ticks
    spring = turn * (0.5 * held + face.delay)
    if face.estimator.linear is None:
        return spring, None
    z = np.exp(2j * np.pi * frequency_hz * face.velocity_period * np.ones(1))
    filtered = math.degrees(float(np.angle(filter_response(face, z))[0]))
    return spring, turn * (face.velocity_period + face.delay) - filtered


def endings(boundary: Boundary) -> list[Ending]:
    """Return the oscillation at the top, or those on either side of it if they differ."""
    top = boundary.top
    if top is None:
        return []
    sides = [ending(boundary.device, (1.0 + s * BESIDE) * top.damping) for s in (-1.0, 1.0)]
    known = [side for side in sides if side is not None]
    if len(known) == 2 and known[0].mode == known[1].mode:
        at = ending(boundary.device, top.damping)
        return known[:1] if at is None else [at]
    very = corner(boundary.device) if len(known) == 2 else None
    if very is None or abs(very.damping - top.damping) > BESIDE * top.damping:
        return known
    # The two branches meet at the corner: their frequencies are computed beside it.
    near = [ending(boundary.device, (1.0 + s * CLOSE) * very.damping) for s in (-1.0, 1.0)]
    return [one or far for one, far in zip(near, known, strict=True)]


def _without_friction(device: Device) -> Device:
    rubbing = [place_label(p) for p in device.physics if p.effect.hook == "friction"]
    for label in rubbing:
        device = device.without_physics(label)
    return device


def _without_play(device: Device) -> Device:
    for label in [place_label(p) for p in device.physics if p.effect.name == "backlash"]:
        device = device.without_physics(label)
    return device


def _without(**changes: float) -> Callable[[Device], Device]:
    return lambda device: device.with_interface(**changes)


PARTS: dict[str, Callable[[Device], Device]] = {
    "friction": _without_friction,
    "play": _without_play,
    "encoder_step": _without(encoder_step=0.0),
    "velocity_step": _without(velocity_step=0.0),
    "command_step": _without(command_step=0.0),
    "command_limit": _without(command_limit=math.inf),
}


def without_parts(boundary: Boundary, trial: Trial, search: Search) -> dict[str, float | None]:
    """Return, for each part that the device has, the stable K at the top's B without that part.

    None if no K is stable without it.
    """
    top, device = boundary.top, boundary.device
    if top is None:
        return {}
    variants = {name: change(device) for name, change in PARTS.items()}
    if device.interface.estimator.linear is None:
        del variants["encoder_step"]
    variants = {name: other for name, other in variants.items() if other != device}
    at = [np.array([top.damping])] * len(variants)
    found = find_brackets(list(variants.values()), at, trial, search)
    stiffest = [None if one[0].stable is None else float(one[0].stable) for one in found]
    return dict(zip(variants, stiffest, strict=True))
