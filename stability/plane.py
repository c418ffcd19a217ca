"""A plane of two quantities of a wall and its device, and what a run does at a point of it.

Three answers where linear theory knows two: the run comes to rest, oscillates on for ever at a small
amplitude, or grows until the amplifier's limit (or nothing) holds it. A sustained oscillation is
perceptible or not, by the force that its command swings.
"""

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sim.device import Device
from sim.ensemble import Walls, walls
from sim.growth import DECAYS, GROWS, LIMIT_CYCLE, Growth
from sim.physics import make_physics
from stability.bisection import Trial, judge
from stability.loop import open_loop

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Quantity = Literal["K", "B", "delay", "encoder_step", "command_limit", "friction", "amplitude"]
QUANTITIES: tuple[Quantity, ...] = (
    "K", "B", "delay", "encoder_step", "command_limit", "friction", "amplitude",
)  # fmt: skip
OF_THE_DEVICE = ("delay", "encoder_step", "command_limit", "friction")
AT_THE_LIMIT = 0.999


class Fate(enum.IntEnum):
    """What a run does in the end."""

    RESTS = 0
    IMPERCEPTIBLE_CYCLE = 1
    CYCLE = 2
    GROWS = 3
    UNDECIDED = 4


@dataclass(frozen=True)
class Axis:
    """Values of one quantity: from start to stop in steps, evenly or by equal ratios.

    Raises ValueError (axis, value, what is allowed).
    """

    quantity: Quantity
    start: float
    stop: float
    spacing: Literal["linear", "log"] = "linear"

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise ValueError(f"axis {self.quantity!r} is not known; allowed: {', '.join(QUANTITIES)}")
        if not (math.isfinite(self.start) and math.isfinite(self.stop) and self.start < self.stop):
            raise ValueError(
                f"axis {self.quantity} goes from {self.start:g} to {self.stop:g}; it must rise"
            )
        positive = self.quantity in ("K", "command_limit", "amplitude") or self.spacing == "log"
        if self.start < 0.0 or (positive and self.start == 0.0):
            least = "above 0" if positive else "0 or more"
            raise ValueError(f"axis {self.quantity} begins at {self.start:g}; allowed is {least}")

    def values(self, steps: int) -> Floats:
        """Return the lattice of the axis, shape (steps,)."""
        if self.spacing == "log":
            return np.geomspace(self.start, self.stop, steps)
        return np.linspace(self.start, self.stop, steps)


@dataclass(frozen=True)
class Plane:
    """Two axes over a device; what is on no axis has its value in the device, or here.

    stiffness, damping: of the wall. friction level at m1 [N m | N], None: as the device has it.
    perceptible: amplitude of the command [N m | N] from which a sustained oscillation is felt.
    one_sided: the wall fills y > 0 and the run starts inside it.

    Raises ValueError (field, value, what is allowed).
    """

    device: Device
    x: Axis
    y: Axis
    stiffness: float = 1.0
    damping: float = 0.0
    trial: Trial = field(default_factory=lambda: Trial(limit_s=16.0))
    perceptible: float = 0.01
    one_sided: bool = False

    def __post_init__(self) -> None:
        if self.x.quantity == self.y.quantity:
            raise ValueError(f"both axes are {self.x.quantity}; choose two different quantities")
        if not self.perceptible >= 0.0:
            raise ValueError(f"perceptible is {self.perceptible}; it must be >= 0")

    def device_at(self, values: Mapping[str, float]) -> Device:
        """Return the device with the quantities that belong to it set to values."""
        changes = {k: v for k, v in values.items() if k in OF_THE_DEVICE and k != "friction"}
        device = self.device.with_interface(**changes) if changes else self.device
        if "friction" in values:
            device = device.with_physics(
                make_physics("coulomb_friction", "m1", level=values["friction"])
            )
        return device


@dataclass(frozen=True)
class Fates:
    """Results at points (n,): fate, growth rate [1/s], amplitude [rad | m], force, frequency [Hz]."""

    fate: NDArray[np.int8]
    rate: Floats
    amplitude: Floats
    force: Floats
    frequency: Floats

    @staticmethod
    def empty(count: int) -> "Fates":
        """Return room for count results."""
        nothing = np.full((4, count), np.nan)
        return Fates(np.full(count, -1, dtype=np.int8), *nothing)

    def put(self, where: Ints, other: "Fates") -> None:
        """Write other's results at some of the points."""
        for name in (f.name for f in fields(self)):
            getattr(self, name)[where] = getattr(other, name)


def evaluate(plane: Plane, x: Floats, y: Floats, workers: int | None = None) -> Fates:
    """Run the device at points (x, y) of the plane, both (n,).

    Points that share everything of the device go through the kernel together.
    """
    columns = {plane.x.quantity: x, plane.y.quantity: y}
    own = [columns[q] for q in OF_THE_DEVICE if q in columns]
    apart = [*own, columns["amplitude"]] if "amplitude" in columns else own
    keys = np.column_stack(apart) if apart else np.zeros((x.size, 1))
    _, group = np.unique(keys, axis=0, return_inverse=True)
    group = group.ravel()
    result = Fates.empty(x.size)
    for number in range(int(group.max(initial=-1)) + 1):
        points = np.flatnonzero(group == number)
        values = {name: float(column[points[0]]) for name, column in columns.items()}
        device = plane.device_at(values)
        trial = replace(plane.trial, start=values.get("amplitude", plane.trial.start))
        stiffness = columns["K"][points] if "K" in columns else np.full(points.size, plane.stiffness)
        damping = columns["B"][points] if "B" in columns else np.full(points.size, plane.damping)
        some: Walls = walls(stiffness, damping, 0.0, plane.one_sided)
        growth = judge(device, some, trial, workers)
        result.put(points, classify(growth, device.interface.command_limit, plane.perceptible))
    return result


def classify(growth: Growth, limit: float, perceptible: float) -> Fates:
    """Turn verdicts into fates: a cycle at the amplifier's limit is growth that the limit holds."""
    with np.errstate(invalid="ignore"):
        held = (growth.force >= AT_THE_LIMIT * limit) & ~(growth.verdict == DECAYS)
        small = growth.force < perceptible
    fate = np.full(growth.verdict.size, Fate.UNDECIDED, dtype=np.int8)
    cycling = growth.verdict == LIMIT_CYCLE
    fate[growth.verdict == DECAYS] = Fate.RESTS
    fate[cycling & small] = Fate.IMPERCEPTIBLE_CYCLE
    fate[cycling & ~small] = Fate.CYCLE
    fate[(growth.verdict == GROWS) | held] = Fate.GROWS
    return Fates(fate, growth.rate, growth.amplitude, growth.force, growth.frequency)


def linear_radius(plane: Plane, x: Floats, y: Floats) -> Floats:
    """Return the spectral radius of the linear loop less one at lattice values, (y, x).

    Its zero line is the linear boundary; friction, steps, limits and amplitude do not change it.
    """
    out = np.empty((y.size, x.size))
    names = (plane.x.quantity, plane.y.quantity)
    loops: dict[float, object] = {}
    for j, yj in enumerate(y):
        for i, xi in enumerate(x):
            values = dict(zip(names, (float(xi), float(yj)), strict=True))
            delay = values.get("delay", plane.device.interface.delay)
            if delay not in loops:
                loops[delay] = open_loop(plane.device.with_interface(delay=delay))
            loop = loops[delay]
            matrix = loop.closed(  # type: ignore[attr-defined]
                values.get("K", plane.stiffness), values.get("B", plane.damping)
            )
            out[j, i] = np.abs(np.linalg.eigvals(matrix)).max() - 1.0
    return out


