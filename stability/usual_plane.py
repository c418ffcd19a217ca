"""The default plane and axes of a map."""

from zwidth.sim.device import Device
from zwidth.sim.equations import enough_substeps
from zwidth.stability.judging import Trial
from zwidth.stability.linear import corner, last_stable_damping, stand_in
from zwidth.stability.plane import Axis, Plane, Quantity

CUSTOMARY = {
    "delay": (0.0, 0.01), "encoder_step": (0.0, 1e-3), "command_limit": (0.05, 1.0),
    "friction": (0.0, 0.02), "amplitude": (1e-4, 1e-1), "cutoff": (5.0, 500.0),
}  # fmt: skip
RISING_BY_RATIOS = ("amplitude", "cutoff")  # quantities with logarithmic axes by default
SUBSTEPS = 10  # per tick, with friction or other physics
LIMIT_S = 16.0  # of the longest run


def usual_axis(device: Device, quantity: Quantity, ratios: bool = False) -> Axis:
    """Return an axis around the linear boundary, or over the customary range of its quantity.

    ratios: space the values by equal ratios even if they are evenly spaced by default.
    """
    if quantity == "B":
        low, high = 0.0, 1.2 * (last_stable_damping(stand_in(device)) or 0.1)
    elif quantity == "K":
        top = corner(stand_in(device))
        high = 1.4 * top.stiffness if top is not None else 50.0
        low = 0.01 * high
    else:
        low, high = CUSTOMARY[quantity]
    if ratios and low == 0.0:
        low = 1e-3 * high
    return Axis(quantity, low, high, "log" if ratios or quantity in RISING_BY_RATIOS else "linear")


def usual_plane(device: Device) -> Plane:
    """Return the plane of stiffness over damping around the linear boundary of a device."""
    substeps = enough_substeps(device, SUBSTEPS if device.physics else 1)
    trial = Trial(limit_s=LIMIT_S, substeps=substeps)
    return Plane(device, usual_axis(device, "B"), usual_axis(device, "K"), trial=trial)
