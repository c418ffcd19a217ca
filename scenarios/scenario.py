"""An experiment: a device, its controller, start and disturbances, duration, and recording."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from zwidth.scenarios.disturbance import Disturbance
from zwidth.shown import Shown
from zwidth.sim.controller import Controller
from zwidth.sim.device import Device
from zwidth.sim.equations import enough_substeps
from zwidth.sim.nearest import nearest
from zwidth.sim.run import Setup, Start, duration_ticks, prepare

Floats = NDArray[np.float64]
Energy = Literal["none", "stored", "ledger"]

LARGEST_SEED = 2**53  # integers up to here are exact in every reader of TOML and JSON
SUBSTEPS = 10  # per tick, if one is not exact


@dataclass(frozen=True, eq=False, repr=False)
class Scenario(Shown):
    """A device under a controller, from a start, under disturbances, for `duration` seconds.

    seed: of every random number in the run. substeps per tick: with 0, one if that is exact, ten if
    the device has friction or smooth nonlinear forces, and more if friction acts on a very fast
    mode; the field is then the number used. energy: record no energy, the stored energy, or the
    whole ledger. fine: record the states after every substep. bound: the run stops when |position
    of m1| exceeds it [rad | m].

    Raises ValueError with one sentence: the field, its value, what is allowed.
    """

    device: Device
    controller: Controller
    duration: float
    start: Start = field(default_factory=Start)
    disturbances: tuple[Disturbance, ...] = ()
    seed: int = 0
    substeps: int = 0
    energy: Energy = "ledger"
    fine: bool = False
    bound: float = 1e6

    def __post_init__(self) -> None:
        start = Start(_plain(self.start.position), _plain(self.start.velocity))
        object.__setattr__(self, "start", start)
        object.__setattr__(self, "disturbances", tuple(self.disturbances))
        if not 0 <= self.seed <= LARGEST_SEED:
            raise ValueError(f"seed is {self.seed}; it must be a whole number from 0 to 2^53")
        if self.substeps < 0:
            raise ValueError(
                f"substeps is {self.substeps}; it must be 1 or more, or 0 for automatic"
            )
        if self.energy not in get_args(Energy):
            raise ValueError(f"energy is {self.energy!r}; {nearest(self.energy, get_args(Energy))}")
        if self.substeps == 0:
            object.__setattr__(self, "substeps", usual_substeps(self.device))
        if not self.bound > 0.0:
            raise ValueError(f"bound is {self.bound}; it must be above 0")
        start.state(self.masses)
        duration_ticks(self.duration, self.device.interface.period)
        self.forces()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Scenario):
            return NotImplemented
        return self._values() == other._values()

    def __hash__(self) -> int:
        return hash((self.device, self.duration, self.seed, self.disturbances))

    def _values(self) -> tuple[object, ...]:
        law = self.controller
        return (
            self.device, law.kind, dict(law.facts), law.memory, law.parameters.tobytes(),
            self.duration, self.start, self.disturbances, self.seed, self.substeps, self.energy,
            self.fine, self.bound,
        )  # fmt: skip

    @property
    def masses(self) -> int:
        """Number of masses that move: those of the chain, then those of extra modes."""
        return self.device.chain.masses.size + len(self.device.hung())

    @property
    def ticks(self) -> int:
        """Number of ticks in the run."""
        return duration_ticks(self.duration, self.device.interface.period)

    def forces(self) -> Floats | None:
        """Return the disturbances' sum, shape (ticks, masses) [N m | N]; None without any.

        If the base moves, (ticks, masses + 1), with its acceleration after the forces.
        """
        if not self.disturbances:
            return None
        columns = [one.mass(self.masses) for one in self.disturbances]
        total = np.zeros((self.ticks, max(self.masses, 1 + max(columns))))
        for place, (one, column) in enumerate(zip(self.disturbances, columns, strict=True)):
            seed = (self.seed, place)
            total[:, column] += one.force(self.ticks, self.device.interface.period, seed)
        return total

    def prepare(self) -> Setup:
        """Set the run up, ready for `Setup.blocks`."""
        return prepare(
            self.device,
            self.controller,
            duration=self.duration,
            start=self.start,
            disturbance=self.forces(),
            substeps=self.substeps,
            seed=self.seed,
            bound=self.bound,
            energy=self.energy != "none",
            ledger=self.energy == "ledger",
            fine=self.fine,
        )

    @property
    def free_from(self) -> float:
        """Time [s] from which no disturbance changes any more; inf if one changes until the end."""
        return max(
            (d.from_s if d.kind == "constant" and d.to_s >= self.duration else d.to_s)
            for d in (*self.disturbances, Disturbance("constant", 0.0))
        )


def one_is_exact(device: Device) -> bool:
    """Whether one substep per tick is exact: no dry friction, no smooth nonlinear force."""
    return not any(p.effect.hook in ("force", "friction") for p in device.physics)


def usual_substeps(device: Device, usual: int = SUBSTEPS) -> int:
    """Return the substeps per tick of a run: one if that is exact, else as usual or as needed."""
    return 1 if one_is_exact(device) else enough_substeps(device, usual)


def _plain(values: float | Sequence[float]) -> float | tuple[float, ...]:
    plain = np.asarray(values, dtype=np.float64).tolist()
    return tuple(plain) if isinstance(plain, list) else plain
