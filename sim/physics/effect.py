"""What an effect is: its parameters, where it may enter, and by which hook of the tick.

Hooks, in the order of the tick (`sim/kernel.py`):

    sensor     what the encoder reads of the true position
    command    what the amplifier makes of the controller's command
    clock      when the command arrives
    structure  a change of the linear equations themselves (exact, by the propagator)
    force      a smooth force between two places, second order in the substep
    friction   a dry force with bounds, implicit in the substep
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np

Hook = Literal["sensor", "command", "clock", "structure", "force", "friction"]
Borrowed = Literal["link_spring", "link_damper", "seed"]


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    unit is written for a rotary device ("N m", "rad", "N m/rad", "s", ""); `unit_for` gives the
    linear one, which is linear_unit where it is no mere matter of N for N m and m for rad. neutral
    is the value at which the effect changes nothing, None where no single value of this parameter
    does.
    """

    name: str
    symbol: str
    unit: str
    lower: float
    upper: float
    neutral: float | None
    linear_unit: str | None = None

    def unit_for(self, rotary: bool) -> str:
        """Return the unit on a rotary or a linear device."""
        if rotary:
            return self.unit
        if self.linear_unit is not None:
            return self.linear_unit
        return self.unit.replace("N m", "N").replace("rad", "m")


@dataclass(frozen=True)
class Effect:
    """A piece of physics that a device may have.

    places: where it may enter. code: its number in the kernel's dispatch of that hook (unused for
    effects whose hook needs none). in_interface: the `Interface` field that is its home, if any.
    reference: where the law comes from. borrows: values of the device or the run that the law reads
    after its own parameters (`sim/equations.py`). rotary_only: the law needs an angle.
    varies_with_speed: a dry force whose bounds do, and are therefore taken at both ends of a
    substep.
    """

    name: str
    summary: str
    places: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    hook: Hook
    code: int
    reference: str
    in_interface: str | None = None
    borrows: tuple[Borrowed, ...] = ()
    rotary_only: bool = False
    varies_with_speed: bool = False

    def parameter(self, name: str) -> Parameter:
        """Return the parameter of that name; raises KeyError."""
        return next(p for p in self.parameters if p.name == name)


@dataclass(frozen=True)
class Physics:
    """One effect as a device has it: which, where, with which parameters (SI).

    Raises ValueError (field, value, what is allowed) for a place the effect cannot have, a missing
    or unknown parameter, or a value outside its bounds.
    """

    effect: Effect
    at: str
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        name = self.effect.name
        if self.at not in self.effect.places:
            raise ValueError(
                f"{name}.at is {self.at!r}; allowed is {' or '.join(self.effect.places)}"
            )
        known = [p.name for p in self.effect.parameters]
        for key in self.values:
            if key not in known:
                raise ValueError(f"{name} has no parameter {key!r}; it has {', '.join(known)}")
        for p in self.effect.parameters:
            if p.name not in self.values:
                raise ValueError(f"{name} needs the parameter {p.name!r} [{p.unit or '-'}]")
            value = self.values[p.name]
            if not p.lower <= value <= p.upper:  # also refuses NaN
                raise ValueError(
                    f"{name}.{p.name} is {value:g}; allowed is {p.lower:g} to {p.upper:g}"
                )
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))

    def __reduce__(self) -> tuple[type["Physics"], tuple[Effect, str, dict[str, float]]]:
        """A view that cannot be changed cannot be pickled either: pickle the values."""
        return Physics, (self.effect, self.at, dict(self.values))

    def vector(self) -> np.ndarray:
        """Return the values in the order of the declaration, shape (parameters,)."""
        return np.array([self.values[p.name] for p in self.effect.parameters])
