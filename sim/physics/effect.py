"""The declaration of an effect: parameters, places, hook in the tick, how it is sought.

Hooks, in the order of the tick (`sim/kernel.py`):

    sensor     what the encoder reads of the true position
    command    what the amplifier makes of the controller's command
    clock      when the command arrives
    structure  a change of the linear equations themselves (solved exactly)
    force      a smooth force between two places, second order in the substep
    friction   a dry force with bounds, implicit in the substep

How the diagnosis seeks an effect:

    fit          from its starts
    waves        the same, and at the periods over position that a residual shows
    resonances   the same, and at the frequencies that a residual shows
    lattice      no slope leads there: by what its steps or losses repeat
    folding      before all else: the recording is unfolded
    given        not at all: what a device file says of the drive
    learned      not by name: where no name explains a recording (`diagnosis/learning`)

The effect's own file declares all of that. Values that depend on the recording are functions of
`Sizes` and a place.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Literal

import numpy as np

from zwidth.shown import Valued
from zwidth.sim.chain import Matrices
from zwidth.sim.following import Following
from zwidth.sim.physics.sizes import Sizes
from zwidth.sim.place import Place, place_at

Hook = Literal["sensor", "command", "clock", "structure", "force", "friction"]
Borrowed = Literal["link_spring", "link_damper", "seed", "servo"]
Sought = Literal["fit", "waves", "resonances", "lattice", "folding", "given", "learned"]
Role = Literal["magnitude", "strength", "turning", "shape"]
Values = dict[str, float]
Numbers = Mapping[str, float] | Mapping[str, np.ndarray]
"""Values of the parameters of one device, or of many (...)."""
Scaled = tuple[Values, Values]
"""Values of the parameters, and scales that make them of order one; 0 fixes a parameter."""
Starts = Callable[[Sizes, Place], Iterable[Scaled]]
Bounds = Mapping[str, tuple[float, float]]
AtShare = Callable[[np.random.Generator, Sizes, Place, float], Values]


@dataclass(frozen=True)
class Parameter(Valued):
    """One parameter of an effect.

    unit is written for a rotary device ("N m", "rad", "N m/rad", "s", ""); `unit_for` gives the
    linear one, which is linear_unit if it is more than N for N m and m for rad. neutral is the
    value at which the effect changes nothing, None if this parameter has no such value.

    role: a magnitude multiplies everything that the effect does, to first order and counted from
    its neutral value; a strength says how strong the effect is, without being such a factor;
    turning is a phase or an angle; all others are shape. least, most: factors of its start between
    which a fit may move it. open_ended: above its upper bound the law hardly changes, and a fit
    that ends there is valid. valleys: the errors over it have a local minimum every few percent, so
    that a fit ends in the minimum where it began. inverse: a strength that counts by its
    reciprocal, with 0 for no effect, so that half of it is twice as strong: a limit (of a rate, or
    over speed) that the largest command does not scale. meaning: a description, for people.
    """

    name: str
    symbol: str
    unit: str
    lower: float
    upper: float
    neutral: float | None
    linear_unit: str | None = None
    role: Role = "shape"
    least: float = 0.0
    most: float = math.inf
    open_ended: bool = False
    valleys: bool = False
    inverse: bool = False
    meaning: str = ""

    def unit_for(self, rotary: bool) -> str:
        """Return the unit on a rotary or a linear device."""
        if rotary:
            return self.unit
        if self.linear_unit is not None:
            return self.linear_unit
        return self.unit.replace("N m", "N").replace("rad", "m")

    def none_of_it(self, peak: float = math.inf) -> float:
        """Return the value at zero strength: for a limit, the largest command."""
        if self.neutral is None:
            return 0.0
        return self.neutral if math.isfinite(self.neutral) else peak


def unaltered(matrices: Matrices, _: int, __: Numbers) -> Matrices:
    """Return M, C, K as they are."""
    return matrices


def no_starts(_: Sizes, __: Place) -> Iterator[Scaled]:
    """Yield no start."""
    yield from ()


def no_bounds(_: Sizes, __: Place) -> Bounds:
    """Return no bounds besides those of the declaration."""
    return {}


def rms_command(sizes: Sizes, _: Place) -> float:
    """Return the rms of the command of a recording."""
    return sizes.force


def one_percent(_: np.random.Generator, __: Sizes, ___: Place) -> Values:
    """Return no values, for an effect without parameters."""
    return {}


def allowed(_: Values) -> str:
    """Return "": these values are physical."""
    return ""


@dataclass(frozen=True, kw_only=True)
class Effect(Valued):
    """A piece of physics that a device may have.

    In the simulation. places: where it may enter. formula: its law in the names of its parameters,
    with q and v where it enters, u the command. code: its number in the kernel's dispatch of that
    hook (unused for effects whose hook needs none). in_interface: the `Interface` field that stores
    it, if any; adds: whether it adds to the value there, instead of replacing it. reference: the
    source of the law. borrows: values of the device or the run that the law reads after its own
    parameters (`sim/equations.py`). rotary_only: the law needs an angle. varies_with_speed: a dry
    force whose bounds vary with speed, so they are computed at both ends of a substep. over_first:
    in a link the law depends on the first mass's own position and not on the deflection. alters:
    returns M, C and K as a structural effect at a mass (index) changes them, (..., n, n) with
    values (...); adds_mass: it also adds a mass, unless its strength is neutral, which it then is
    for all. follows: for a filter of readings, the equations by which they follow the motion
    (`sim/reading.py`). lags: its only parameter is the amplifier's lag. in_chain: the `Chain` field
    that stores it at m1, if any, to which it adds. needs: an effect without which it has no
    meaning. of_drive: its numbers belong to the drive and are relative to the command.
    mistaken_for: effects that a short or narrow recording does not distinguish from it.

    In the diagnosis. prior: how likely a device has it at one place, before anything is recorded;
    elsewhere: the same at all places but the first, if it differs. contains: simpler effects of
    which it is a richer form, where it acts (`Place.acts_on`): it never explains less, and at some
    values it is the simpler one. family: effects of one family are alternative laws, of which a
    place has one.
    holds_constant: two parameters of which the first minus the second is twice a constant force.
    creased: its prediction is not a smooth function of its parameters. sought: how. in_recording:
    subtracted from the recording and not simulated. absorbed: a refit of linear parameters absorbs
    a little of it; known_if_sprung: at m1 of a device with a spring to ground, the refit already
    has it (the spring, or the origin of the position; "straight": only of a linear spring).
    weakens: a device with it seems driven by a smaller command.

    starts: values that a fit may begin from, over the magnitudes a recording could show. sweep: the
    same from almost zero to the largest plausible values, for a search that starts far away.
    bounds: physical bounds given the recording, if narrower than those of `Parameter`. natural: the
    magnitude that would explain the whole motion. drawn: the effect at about a percent of that,
    with other numbers drawn at random. forbidden: the parameter that makes values unphysical.

    In the exam, which draws machines with effects. odds: how frequent it is, all its places
    together, relative to the odds of the others; 0 if it is never drawn. excludes: effects that no
    machine has in addition to it, anywhere. at_share: its values if it is a given share of the
    driving force, with other numbers random; None: as `drawn`, scaled up.
    """

    name: str
    summary: str
    places: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    hook: Hook
    code: int
    reference: str
    formula: str = ""
    in_interface: str | None = None
    adds: bool = False
    borrows: tuple[Borrowed, ...] = ()
    rotary_only: bool = False
    varies_with_speed: bool = False
    over_first: bool = False
    alters: Callable[[Matrices, int, Numbers], Matrices] = unaltered
    adds_mass: bool = False
    follows: Callable[[Numbers], Following] | None = None
    lags: bool = False
    in_chain: str | None = None
    needs: str = ""
    mistaken_for: tuple[str, ...] = ()
    of_drive: bool = False

    prior: float = 0.0
    elsewhere: float | None = None
    contains: tuple[str, ...] = ()
    family: str = ""
    holds_constant: tuple[str, str] | None = None
    creased: bool = False
    sought: Sought = "fit"
    in_recording: bool = False
    absorbed: bool = False
    known_if_sprung: Literal["no", "straight", "yes"] = "no"
    weakens: bool = False

    starts: Starts = no_starts
    sweep: Starts = no_starts
    bounds: Callable[[Sizes, Place], Bounds] = no_bounds
    natural: Callable[[Sizes, Place], float] = rms_command
    drawn: Callable[[np.random.Generator, Sizes, Place], Values] = one_percent
    forbidden: Callable[[Values], str] = allowed

    odds: float = 0.0
    excludes: tuple[str, ...] = ()
    at_share: AtShare | None = None

    @cached_property
    def of_command(self) -> bool:
        """Whether it has no influence on a motion without a command."""
        return self.hook in ("command", "clock") or "servo" in self.borrows

    def parameter(self, name: str) -> Parameter:
        """Return the parameter with a name; raises KeyError."""
        found = next((p for p in self.parameters if p.name == name), None)
        if found is None:
            raise KeyError(name)
        return found

    @cached_property
    def magnitudes(self) -> tuple[str, ...]:
        """The parameters that scale its whole effect."""
        return tuple(p.name for p in self.parameters if p.role == "magnitude")

    @cached_property
    def turning(self) -> tuple[str, ...]:
        """Its phases and angles."""
        return tuple(p.name for p in self.parameters if p.role == "turning")

    @cached_property
    def strength(self) -> str | None:
        """The parameter that says how strong it is, None if there is none."""
        strong = (p for p in self.parameters if p.role in ("magnitude", "strength"))
        return next((p.name for p in strong if p.neutral is not None), None)

    def acts(self, values: Numbers) -> bool:
        """Whether its strength is not neutral, for any of the devices."""
        none = self.parameter(self.strength).neutral if self.strength else None
        return none is None or bool(np.any(np.not_equal(values[self.strength or ""], none)))

    def prior_at(self, place: Place) -> float:
        """Return the prior probability that a device has this effect at a place."""
        first = self.places[0] == str(place)
        return self.prior if first or self.elsewhere is None else self.elsewhere

    def within(self, sizes: Sizes, place: Place) -> Bounds:
        """Return lower and upper bound of every parameter, given a recording."""
        narrower = self.bounds(sizes, place)
        found: dict[str, tuple[float, float]] = {}
        for p in self.parameters:
            low, high = narrower.get(p.name, (p.lower, p.upper))
            found[p.name] = max(p.lower, low), min(p.upper, high)
        return found


@dataclass(frozen=True)
class Physics(Valued):
    """An effect of a device: which, where, and with which parameters (SI).

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
                f"{name}.at is {self.at!r}; it must be {' or '.join(self.effect.places)}"
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
                    f"{name}.{p.name} is {value:g}; it must be from {p.lower:g} to {p.upper:g}"
                )
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))

    def __reduce__(self) -> tuple[type["Physics"], tuple[Effect, str, dict[str, float]]]:
        """A view that cannot be changed cannot be pickled either: pickle the values."""
        return Physics, (self.effect, self.at, dict(self.values))

    @cached_property
    def place(self) -> Place:
        """Where it is."""
        return place_at(self.at)

    def vector(self) -> np.ndarray:
        """Return the values in the order of their declaration, shape (parameters,)."""
        return np.array([self.values[p.name] for p in self.effect.parameters])
