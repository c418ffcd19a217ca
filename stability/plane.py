"""A plane of two quantities of a wall and its device: the axes, and the fixed values."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from zwidth.shown import Valued
from zwidth.sim.device import Device, place_label
from zwidth.sim.fate import rest_amplitude
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.stability.judging import Trial

Floats = NDArray[np.float64]
Quantity = Literal[
    "K", "B", "delay", "encoder_step", "command_limit", "friction", "amplitude", "cutoff"
]
QUANTITIES: tuple[Quantity, ...] = (
    "K", "B", "delay", "encoder_step", "command_limit", "friction", "amplitude", "cutoff",
)  # fmt: skip
OF_THE_DEVICE: tuple[Quantity, ...] = (
    "delay", "encoder_step", "command_limit", "friction", "cutoff",
)  # fmt: skip
NEVER_ZERO: tuple[Quantity, ...] = ("K", "command_limit", "amplitude", "cutoff")
FIELDS: dict[str, str] = {"cutoff": "velocity_cutoff_hz"}  # name in the interface, if different
FEWEST_TICKS = 64  # of a run: eight windows of eight ticks
MOST_TICKS = 50  # of delay: linear theory needs the eigenvalues of this many states at every point


@dataclass(frozen=True)
class Axis(Valued):
    """Values of one quantity: from start to stop in steps, evenly or by equal ratios.

    Raises ValueError (axis, value, what is allowed).
    """

    quantity: Quantity
    start: float
    stop: float
    spacing: Literal["linear", "log"] = "linear"

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise ValueError(
                f"axis {self.quantity!r} is not known; it must be one of {', '.join(QUANTITIES)}"
            )
        if self.spacing not in ("linear", "log"):
            raise ValueError(f"spacing is {self.spacing!r}; it must be 'linear' or 'log'")
        if not (math.isfinite(self.start) and math.isfinite(self.stop) and self.start < self.stop):
            raise ValueError(
                f"axis {self.quantity} goes from {self.start:g} to {self.stop:g};"
                " give two finite numbers, the smaller one first"
            )
        positive = self.quantity in NEVER_ZERO or self.spacing == "log"
        if self.start < 0.0 or (positive and self.start == 0.0):
            least = "above 0" if positive else "at 0 or more"
            raise ValueError(
                f"axis {self.quantity} begins at {self.start:g}; it must begin {least}"
            )

    def values(self, steps: int) -> Floats:
        """Return the lattice of the axis, shape (steps,)."""
        if self.spacing == "log":
            return np.geomspace(self.start, self.stop, steps)
        return np.linspace(self.start, self.stop, steps)


@dataclass(frozen=True)
class Plane(Valued):
    """Two quantities on the axes of a map, and the values of all others, here or in the device.

    stiffness, damping: of the wall, whose law is trial.law. On an axis, friction is the level of
    Coulomb friction at m1 [N m | N], and cutoff the velocity filter's [Hz]. one_sided: the wall
    fills y > 0 and the run starts inside it. If trial.threshold is None, a run rests below 1e-3 of
    its start and 0.02 of an encoder step.

    Raises ValueError (field, value, what is allowed).
    """

    device: Device
    x: Axis
    y: Axis
    stiffness: float = 1.0
    damping: float = 0.0
    trial: Trial = field(default_factory=lambda: Trial(limit_s=16.0))
    one_sided: bool = False

    def __post_init__(self) -> None:
        if self.x.quantity == self.y.quantity:
            raise ValueError(f"both axes are {self.x.quantity}; choose two different quantities")
        for name in ("stiffness", "damping"):
            value = getattr(self, name)
            if not 0.0 <= value < math.inf:
                raise ValueError(f"{name} is {value}; it must be finite and >= 0")
        axes = (self.x, self.y)
        longest = max(
            (a.stop for a in axes if a.quantity == "delay"), default=self.setting("delay")
        )
        most = MOST_TICKS * self.device.interface.period
        if longest > most:
            raise ValueError(
                f"the delay reaches {longest:g} s; a map allows at most {MOST_TICKS} ticks"
                f" ({most:g} s)"
            )
        shortest = FEWEST_TICKS * self.device.interface.period
        if self.trial.seconds < shortest:
            raise ValueError(
                f"a run of {self.trial.seconds:g} s is too short to be judged;"
                f" give at least {FEWEST_TICKS} ticks ({shortest:g} s)"
            )

    def setting(self, quantity: Quantity) -> float:
        """Return the value of a quantity that is on no axis."""
        interface = self.device.interface
        levels = (p.values["level"] for p in self.device.physics if is_friction_at_m1(p))
        return {
            "K": self.stiffness,
            "B": self.damping,
            "delay": interface.delay,
            "encoder_step": interface.encoder_step,
            "command_limit": interface.command_limit,
            "friction": next(levels, 0.0),
            "amplitude": abs(self.trial.start),
            "cutoff": interface.velocity_cutoff_hz,
        }[quantity]

    def at(self, values: Mapping[str, float]) -> dict[Quantity, float]:
        """Return all quantities at a point: those in values, and the settings for the rest."""
        return {q: values[q] if q in values else self.setting(q) for q in QUANTITIES}

    def device_at(self, values: Mapping[str, float]) -> Device:
        """Return the device with the quantities that belong to it set to values."""
        changes = {
            FIELDS.get(k, k): v for k, v in values.items() if k in OF_THE_DEVICE and k != "friction"
        }
        device = self.device.with_interface(**changes) if changes else self.device
        return with_friction(device, values["friction"]) if "friction" in values else device

    def rest(self, device: Device, start: float) -> float:
        """Return the amplitude [rad | m] below which a run of this plane counts as at rest."""
        threshold = self.trial.threshold
        return rest_amplitude(device, start) if threshold is None else threshold


def is_friction_at_m1(physics: Physics) -> bool:
    """Whether an effect is the one that the quantity "friction" sets."""
    return place_label(physics) == "coulomb_friction@m1"


def with_friction(device: Device, level: float) -> Device:
    """Return the device with Coulomb friction of this level at m1, in place of its present one."""
    if level > 0.0:
        return device.with_physics(make_physics("coulomb_friction", "m1", level=level))
    present = any(is_friction_at_m1(p) for p in device.physics)
    return device.without_physics("coulomb_friction@m1") if present else device
