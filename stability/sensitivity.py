"""How far the top of a boundary moves with each parameter of eq. (1).

Relative sensitivity of a quantity q to a parameter p: d ln q / d ln p, by a central difference over
`STEP` of the parameter, each top found to rounding precision. Limit: the top is a corner where two
branches cross. It moves smoothly as long as the same two cross; if a third takes over within the
step, the result is a jump, not a slope.
"""

from dataclasses import replace
from typing import NamedTuple

from zwidth.sim.device import Device
from zwidth.sim.modal import ModalModel, Mode
from zwidth.stability.linear import corner

STEP = 1e-3


class Sensitivity(NamedTuple):
    """d ln B_t / d ln p and d ln K_max / d ln p for a parameter."""

    parameter: str
    damping: float
    stiffness: float


def corner_sensitivities(device: Device) -> list[Sensitivity]:
    """Return the sensitivities of B_t and K_max to m, b and each mode's omega, c, v, d.

    Raises ValueError for a device without modal form or without a stable wall.
    """
    if device.modal is None:
        raise ValueError(
            f"{device.name} has no modal form, whose parameters are varied here: give a device file"
            " with [modal]"
        )
    rows: list[Sensitivity] = []
    for name in parameter_names(device.modal):
        low, high = (_top(device, name, 1.0 + step) for step in (-STEP, STEP))
        damping, stiffness = (
            (after - before) / (0.5 * (after + before)) / (2.0 * STEP)
            for before, after in zip(low, high, strict=True)
        )
        rows.append(Sensitivity(name, damping, stiffness))
    return rows


def parameter_names(model: ModalModel) -> list[str]:
    """Return m, b, omega_1, c_1, v_1, d_1, omega_2, ..."""
    each = [f"{field}_{i + 1}" for i in range(len(model.modes)) for field in Mode._fields]
    return ["m", "b", *each]


def scaled(model: ModalModel, name: str, factor: float) -> ModalModel:
    """Return the model with one parameter times a factor; raises ValueError for another name."""
    if name not in parameter_names(model):
        raise ValueError(f"no parameter {name!r}; there are {', '.join(parameter_names(model))}")
    if name == "m":
        return replace(model, inertia=model.inertia * factor)
    if name == "b":
        return replace(model, damping=model.damping * factor)
    field, _, place = name.rpartition("_")
    modes = list(model.modes)
    mode = modes[int(place) - 1]
    modes[int(place) - 1] = mode._replace(**{field: getattr(mode, field) * factor})
    return replace(model, modes=tuple(modes))


def _top(device: Device, name: str, factor: float) -> tuple[float, float]:
    assert device.modal is not None
    top = corner(device.with_modal(scaled(device.modal, name, factor)))
    if top is None:
        raise ValueError(f"{device.name} has no stable wall near these parameters; shorten delay_s")
    return top.damping, top.stiffness
