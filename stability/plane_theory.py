"""Theory over a plane: the linear boundary, and the boundaries of describing functions."""

import math
from dataclasses import dataclass

import numpy as np

from zwidth.sim.interface import Interface
from zwidth.sim.loop import Loop
from zwidth.stability.describing import (
    PredictedCycle,
    friction_boundary,
    quantiser_boundaries,
    saturation_cycle,
)
from zwidth.stability.linear import any_loop, has_theory
from zwidth.stability.periodic import PeriodicLoop
from zwidth.stability.plane import Axis, Floats, Plane, Quantity, with_friction

LINE_POINTS = 49


def linear_radius(plane: Plane, x: Floats, y: Floats) -> Floats:
    """Return the spectral radius of the linear loop less one at lattice values, (y, x).

    Its zero line is the linear boundary; friction, steps, limits and amplitude do not change it.
    NaN where the velocity's estimator has no linear theory.
    """
    if not has_theory(plane.device):
        return np.full((y.size, x.size), math.nan)
    loops: dict[tuple[float, float], Loop | PeriodicLoop] = {}
    face = plane.device.interface

    def closed(xi: float, yj: float) -> Floats:
        values = {plane.x.quantity: xi, plane.y.quantity: yj}
        key = values.get("delay", face.delay), values.get("cutoff", face.velocity_cutoff_hz)
        if key not in loops:
            loops[key] = any_loop(
                plane.device.with_interface(delay=key[0], velocity_cutoff_hz=key[1])
            )
        return loops[key].closed(values.get("K", plane.stiffness), values.get("B", plane.damping))

    if not {"delay", "cutoff"} & {plane.x.quantity, plane.y.quantity}:
        matrices = np.array([[closed(float(xi), float(yj)) for xi in x] for yj in y])
        return np.abs(np.linalg.eigvals(matrices)).max(axis=-1) - 1.0
    radii = [[_radius(closed(float(xi), float(yj))) for xi in x] for yj in y]
    return np.array(radii) - 1.0


def _radius(matrix: Floats) -> float:
    return float(np.abs(np.linalg.eigvals(matrix)).max())


@dataclass(frozen=True)
class Line:
    """A boundary in a plane: x, y (n,) in drawing order; NaN separates pieces."""

    name: str
    x: Floats
    y: Floats


def describing_lines(plane: Plane, points: int = LINE_POINTS) -> list[Line]:
    """Return the boundaries that describing functions predict in a plane with K on an axis.

    friction: walls above the line grow, walls below it come to rest. quantiser: above the line an
    oscillation can sustain itself. A line is returned only if its nonlinearity is the only one:
    neither theory covers an encoder step together with friction, a command limit that is reached,
    or a one-sided wall.
    """
    axes = (plane.x, plane.y)
    plain = plane.trial.law.linear and not plane.one_sided and has_theory(plane.device)
    if "K" not in (plane.x.quantity, plane.y.quantity) or not plain:
        return []
    k_axis, other = axes if plane.x.quantity == "K" else axes[::-1]
    values = other.values(points)
    name = _only_nonlinearity(plane, other)
    if name is None:
        return []
    stiffness = _stiffness(plane, name, other.quantity, values)
    outside = ~((stiffness >= k_axis.start) & (stiffness <= k_axis.stop))
    stiffness[outside] = math.nan
    if np.isnan(stiffness).all():
        return []
    label = f"describing function: {name}"
    along = (stiffness, values) if plane.x.quantity == "K" else (values, stiffness)
    return [Line(label, *along)]


def _only_nonlinearity(plane: Plane, other: Axis) -> str | None:
    most = plane.at({other.quantity: other.stop})
    rest = plane.device_at({other.quantity: other.stop})
    effects = with_friction(rest, 0.0).physics
    interface: Interface = rest.interface
    if effects or interface.command_step > 0.0 or math.isfinite(most["command_limit"]):
        return None
    friction, stepped = most["friction"] > 0.0, most["encoder_step"] > 0.0
    if friction == stepped:
        return None
    return "friction" if friction else "quantiser"


def _stiffness(plane: Plane, name: str, quantity: Quantity, values: Floats) -> Floats:
    if name == "quantiser" and quantity == "B":
        return quantiser_boundaries(plane.device, values)
    return np.array([_critical(plane, name, quantity, float(value)) for value in values])


def _critical(plane: Plane, name: str, quantity: Quantity, value: float) -> float:
    at = plane.at({quantity: value})
    device = with_friction(plane.device_at({quantity: value}), 0.0)
    if name == "quantiser":
        stepped = at["encoder_step"] > 0.0
        return float(quantiser_boundaries(device, np.array([at["B"]]))[0]) if stepped else math.nan
    if at["amplitude"] <= 0.0:
        return math.nan
    point = friction_boundary(device, at["friction"], at["B"], at["amplitude"])
    return math.nan if point is None or point.stiffness is None else point.stiffness


def cycle_at_the_limit(plane: Plane, x: float, y: float) -> PredictedCycle | None:
    """Return the cycle that the command limit alone causes at a point, by describing function."""
    values = {plane.x.quantity: x, plane.y.quantity: y}
    at, device = plane.at(values), plane.device_at(values)
    alone = not device.physics and not device.interface.command_step and not at["encoder_step"]
    if (
        plane.one_sided
        or not has_theory(plane.device)
        or not plane.trial.law.linear
        or not alone
        or not math.isfinite(at["command_limit"])
    ):
        return None
    return saturation_cycle(device, at["K"], at["B"])
