"""The parameters that a fit may change: linear ones of the device, and those of effects.

Every parameter is value = nominal + scale x (effects, dampers of links), nominal exp(scale x)
(masses, springs, gain) or nominal + scale sinh(x) (dampers to ground), so that x is of order one.
The linear ones have a Gaussian prior of one scale, which the device file states (`Uncertainty`):
parameters that the recording does not determine stay near the nominal device. So has the skew of
the clock, the share of a period by which all outputs are read after (or before) the instant at
which commands act; every laboratory has one, and no file states it. A damper to the ground may be
zero, and is guessed more often than measured, since it includes bearings and back-EMF. Near the
file's value sinh(x) is x; far from it another factor of ten costs no more than the first. If it
were linear there too, twenty times the damper would cost 1400, more than any drag of the library. A
damper of a link stays linear: play and friction in the link look like a much larger one, and a
search does not recover from a refit that has moved so far. The gain of the command is free only if
the file gives its uncertainty, since motion alone does not distinguish it from masses, springs,
dampers and forces together.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.sim.chain import Chain, Chains
from zwidth.sim.changes import beside, difference
from zwidth.sim.device import Device, place_label
from zwidth.sim.members import Members, alike
from zwidth.sim.physics.effect import Bounds, Physics
from zwidth.sim.physics.effect import Parameter as Declared

Floats = NDArray[np.float64]
JITTER_SCALE = 0.01  # of the period: mean time by which commands arrive early or late
SKEW_SCALE = 0.2  # of the period: time by which outputs are read after (or before) commands act
ORIGIN_SCALE = 0.1  # of the rms motion: rest position of a spring to ground
# Scales by which a mass, spring or gain may move: with 0.3 a factor exp(1.5) = 4.5. The prior gives
# its probability; at a bound the fit gives no information. Carts whose builders' file has 2/5 of
# the mass reached one at three scales, and the rest of the mass became a mode, with a delay and a
# ripple beside it; with five, friction is found on both carts.
FARTHEST = 5.0
FARTHEST_DAMPER = 9.0  # asinh of the scales by which a damper to ground may move: 4000
DAMPER_FLOOR = 0.1  # of the mean damper: least uncertainty of a damper of nearly zero

FACTORED = ("mass", "spring", "k0", "gain")
BENT = ("damper",)


@dataclass(frozen=True)
class Parameter:
    """A parameter; index: in its array.

    kind: "mass", "spring", "damper", "link", "k0", "origin", "zero", "gain", "jitter", "skew",
    "effect", or "change" (of the x of the parameter at `index` of all parameters).

    scale: of x. lower, upper: bounds of x. prior: whether x has a unit Gaussian prior. key: name of
    an effect's parameter; ends: bounds ("lower", "upper") at which a fit is not physical. walks:
    bounds that only limit how far a fit may go from its start. against: for a change, the parameter
    that falls by as much as the one at `index` rises.
    """

    name: str
    kind: str
    index: int
    scale: float
    lower: float = -np.inf
    upper: float = np.inf
    prior: bool = True
    key: str = ""
    ends: tuple[str, ...] = ()
    walks: tuple[str, ...] = ()
    against: int | None = None

    def at_end(self, x: float, which: Sequence[str], margin: float) -> bool:
        """Whether x is on one of the bounds `which` ("lower", "upper")."""
        low = "lower" in which and x < self.lower + margin
        return low or ("upper" in which and x > self.upper - margin * max(1.0, abs(self.upper)))

    def value(self, nominal: float, x: float) -> float:
        """Return the value at x; nominal: the value at zero."""
        if self.kind in FACTORED:
            return nominal * float(np.exp(self.scale * x))
        if self.kind in BENT:
            return nominal + self.scale * float(np.sinh(x))
        return nominal + self.scale * x

    def slope(self, nominal: float, x: float) -> float:
        """Return the slope of `value` by x."""
        if self.kind in FACTORED:
            return self.scale * self.value(nominal, x)
        return self.scale * (float(np.cosh(x)) if self.kind in BENT else 1.0)

    def x_of(self, nominal: float, value: float) -> float:
        """Return the x of a value; for a factored value of zero or less, that of a factor 1e-12."""
        if self.kind in FACTORED:
            return math.log(max(value / nominal, 1e-12)) / self.scale
        moved = (value - nominal) / self.scale
        return math.asinh(moved) if self.kind in BENT else moved


@dataclass(frozen=True)
class Varying:
    """A change of a parameter `of` (`Parameter.name`), of which each recording has a share.

    name: of the change, by which recordings give their share (`Experiment.shares`). smooth: whether
    it takes all values in between over time. price: penalty, in -2 ln, for its rarity and for
    having tried so many. declared: whether recordings declare it (`model.own_values`) instead of a
    search finding it. against: a parameter that falls by as much (`Effect.holds_constant`), "" for
    none.
    """

    name: str
    of: str
    smooth: bool = False
    price: float = 0.0
    declared: bool = False
    against: str = ""


class Reads(NamedTuple):
    """How a model reads a recording.

    The command is multiplied by gain; origin, in units of the rms motion, is subtracted from
    positions, and jitter times the change of the arriving command from the velocity of m1. zeros
    (n,): offset of each mass's reading from that of m1. late [s]: time by which outputs are read
    after commands act; push: acceleration of m1 alone per unit of command.
    """

    gain: float
    origin: float
    jitter: float
    zeros: tuple[float, ...]
    late: float
    push: float

    def offsets(self, experiment: Experiment) -> Floats:
        """Return the readings (o,) of the outputs of a recording when the device is at rest."""
        positions = np.array([o.tells_position for o in experiment.outputs])
        own = np.array([self.zeros[o.mass] for o in experiment.outputs])
        origin = self.origin * experiment.swing if self.origin else 0.0  # a swing may be infinite
        return (origin + own) * positions


def leads(
    outputs: Sequence[Output], jitter: Floats | float, late: Floats | float, push: Floats | float
) -> Floats:
    """Return the advance of each output (..., o) per unit change of the arriving command.

    A reading that is s > 0 late contains the effect of the new command for a time s: s push in the
    velocity of m1, s^2 / 2 push in its position. The other consequences of s are in the prediction
    (`sim.predict.ahead_by`). jitter: a further advance of the velocity.
    """
    after = np.maximum(late, 0.0)
    found = np.zeros((*np.shape(late), len(outputs)))
    for i, o in enumerate(outputs):
        if o.mass == 0 and o.less is None and o.quantity == "velocity":
            found[..., i] = jitter + after * push
        elif o.mass == 0 and o.less is None:
            found[..., i] = 0.5 * after**2 * push
    return found


class _Trial(NamedTuple):
    """The values of all effects in order, and which of them are free.

    vector, lower, upper (numbers,): the values, and their declared bounds. own: indices in vector
    of the free ones; x: their indices in x; scale: their scales. each: the slice of each effect.
    """

    vector: Floats
    lower: Floats
    upper: Floats
    own: NDArray[np.int64]
    x: NDArray[np.int64]
    scale: Floats
    each: list[slice]


@dataclass(frozen=True)
class Model:
    """A device with its free parameters; `build(x)` is the device at x, `seen` a recording at x.

    effects: the physics under trial, at the values for x = 0. scales: of their free parameters;
    bounds: of these for the recordings, if narrower than the effect's own. sensor_error_known:
    whether the recordings contain the error of an encoder_step under trial, which is then
    subtracted and not simulated. varying: changes; those of parameters that the model lacks are
    ignored. `build` returns the device without changes.

    A search evaluates a model at thousands of x, so everything that does not depend on x (indices,
    scales and bounds) is computed once and kept as arrays.
    """

    nominal: Device
    effects: tuple[Physics, ...] = ()
    scales: tuple[Mapping[str, float], ...] = ()
    sensor_error_known: bool = False
    bounds: tuple[Bounds, ...] = ()
    varying: tuple[Varying, ...] = ()

    @cached_property
    def linear(self) -> list[Parameter]:
        """The linear parameters, which come first."""
        return linear_parameters(self.nominal)

    @cached_property
    def parameters(self) -> list[Parameter]:
        """All free parameters, linear ones first."""
        found = self._with_own(self.linear, 0)
        for one in self._effect_parameters():  # with its own values, so that a new one is last
            found += self._with_own(one, len(found))
        places = {p.name: i for i, p in enumerate(found)}
        return found + [
            Parameter(
                v.name, "change", places[v.of], 1.0, prior=False, against=places.get(v.against)
            )
            for v in self.varying
            if v.of in places and not v.declared
        ]

    def _with_own(self, lasting: Sequence[Parameter], first: int) -> list[Parameter]:
        """Parameters, followed by the own values of recordings; first: index of the first one."""
        places = {p.name: first + i for i, p in enumerate(lasting)}
        priors = {p.name: p.prior for p in lasting}
        own = [v for v in self.varying if v.declared and v.of in places]
        return [
            *lasting,
            *(Parameter(v.name, "change", places[v.of], 1.0, prior=priors[v.of]) for v in own),
        ]

    def _effect_parameters(self) -> list[list[Parameter]]:
        found: list[list[Parameter]] = []
        bounds = self.bounds or ({},) * len(self.effects)
        all_of = zip(self.effects, self.scales, bounds, strict=True)
        for i, (physics, scales, limits) in enumerate(all_of):
            found.append([
                _of_effect(f"{place_label(physics)}.{p.name}", i, p, physics.values[p.name],
                           scales[p.name], limits.get(p.name, (p.lower, p.upper)))
                for p in physics.effect.parameters
                if scales.get(p.name, 0.0) != 0.0
            ])  # fmt: skip
        return found

    @cached_property
    def _kinds(self) -> dict[str, slice]:
        """Indices in x of the linear parameters of each kind, which are adjacent."""
        places: dict[str, list[int]] = {}
        for i, p in enumerate(self.linear):
            places.setdefault(p.kind, []).append(i)
        return {kind: slice(at[0], at[-1] + 1) for kind, at in places.items()}

    @cached_property
    def _scaled(self) -> tuple[Floats, Floats, NDArray[np.int64], NDArray[np.int64]]:
        """Values of the linear parameters at x = 0, scales, and which are factors or sinh."""
        known = chain_values(self.nominal.chain) | {"gain": 1.0}
        at_zero = np.array([known.get(p.name, 0.0) for p in self.linear])
        factors = np.flatnonzero([p.kind in FACTORED for p in self.linear])
        bent = np.flatnonzero([p.kind in BENT for p in self.linear])
        return at_zero, np.array([p.scale for p in self.linear]), factors, bent

    @cached_property
    def _trial(self) -> _Trial:
        names = [[q.name for q in physics.effect.parameters] for physics in self.effects]
        ends = list(itertools.accumulate(map(len, names), initial=0))
        declared = [q for physics in self.effects for q in physics.effect.parameters]
        free = [(i, p) for i, p in enumerate(self.parameters) if p.kind == "effect"]
        return _Trial(
            np.concatenate([np.zeros(0), *(physics.vector() for physics in self.effects)]),
            np.array([q.lower for q in declared]),
            np.array([q.upper for q in declared]),
            np.array([ends[p.index] + names[p.index].index(p.key) for _, p in free], np.int64),
            np.array([i for i, _ in free], np.int64),
            np.array([p.scale for _, p in free]),
            [slice(a, b) for a, b in itertools.pairwise(ends)],
        )

    @cached_property
    def _limits(self) -> tuple[Floats, Floats]:
        own = self.parameters
        return np.array([p.lower for p in own]), np.array([p.upper for p in own])

    @cached_property
    def _changes(self) -> list[tuple[int, Parameter]]:
        return [(i, p) for i, p in enumerate(self.parameters) if p.kind == "change"]

    @cached_property
    def _declared(self) -> frozenset[str]:
        return frozenset(v.name for v in self.varying if v.declared)

    @cached_property
    def _built(self) -> dict[tuple[bool, bytes], Device]:
        """The last few devices, by whether they are `acting` and by x."""
        return {}

    @cached_property
    def lasting(self) -> int:
        """Number of parameters that are not found changes; these come last."""
        return sum(not self.is_found(p) for p in self.parameters)

    def beside(self, x: Floats, extra: ArrayLike) -> Floats:
        """Return x of the model with more effects, with their x `extra` before the changes."""
        return np.concatenate([x[: self.lasting], np.asarray(extra), x[self.lasting :]])

    @property
    def varies(self) -> tuple[str, ...]:
        """The parameters with found changes (`Parameter.name`), once for each change."""
        own = self.parameters
        return tuple(own[p.index].name for p in own if self.is_found(p))

    def constant(self, x: Floats) -> tuple["Model", Floats]:
        """Return the model without changes, and its x."""
        keep = np.array([not self.is_found(p) for p in self.parameters])
        return replace(self, varying=tuple(v for v in self.varying if v.declared)), x[keep]

    def there(self, x: Floats, experiment: Experiment) -> Floats:
        """Return x (..., parameters) for a recording, with its shares of all changes."""
        shares = self.shares(experiment)
        if not shares:
            return x
        found = x.copy()
        for i, share in shares:
            own = self.parameters[i].index
            by = share * x[..., i]
            found[..., own] = self._turned(own, found[..., own] + by)
            if (other := self.parameters[i].against) is not None:
                found[..., other] -= by
        return self.within(found)

    def _turned(self, index: int, x: Floats) -> Floats:
        """Return x with angles wrapped to within half a turn, since a fit stops at their bounds."""
        p = self.parameters[index]
        if p.kind != "effect" or p.key not in self.effects[p.index].effect.turning:
            return x
        value = self.effects[p.index].values[p.key]
        angle = value + p.scale * x
        return (np.mod(angle + np.pi, 2.0 * np.pi) - np.pi - value) / p.scale

    def shares(self, experiment: Experiment) -> tuple[tuple[int, float], ...]:
        """Return the share of each change (by index in `parameters`) in a recording."""
        if not self._changes:
            return ()
        shares = dict(experiment.shares) | dict.fromkeys(experiment.own_names, 1.0)
        return tuple((i, shares[p.name]) for i, p in self._changes if shares.get(p.name, 0.0))

    @property
    def linear_count(self) -> int:
        """Number of linear parameters."""
        return len(self.linear)

    def size_of(self, index: int, x: Floats) -> float:
        """Return the change of x by which a parameter becomes zero, or e times as large."""
        p, own = self.parameters[index], float(x[index])
        if p.kind == "effect":
            return abs(self.effects[p.index].values[p.key] / p.scale + own)
        if p.kind in ("damper", "link"):
            chain = self.nominal.chain
            of = (chain.ground_dampers if p.kind == "damper" else chain.link_dampers)[p.index]
            return abs(p.value(of, own) / p.slope(of, own))
        return 1.0 / p.scale if p.kind != "origin" else 1.0

    def less(self, x: Floats, *gone: int) -> tuple["Model", Floats]:
        """Return the model without some effects (their indices), and its x."""
        own = self.parameters
        lost = {i for i, p in enumerate(own) if p.kind == "effect" and p.index in gone}
        lost |= {i for i, p in self._changes if p.index in lost}
        keep = np.array([i not in lost for i in range(len(own))])
        model = self
        for index in sorted(gone, reverse=True):
            model = model.without_effect(index)
        return model, x[keep]

    def begun_at(self, x: Floats) -> tuple["Model", Floats]:
        """Return the model with the effects' values at x as their new zero, and its x there."""
        effects = [p.kind == "effect" for p in self.parameters]
        return replace(self, effects=self.effects_at(x)), np.where(effects, 0.0, x)

    def within(self, x: Floats) -> Floats:
        """Return the nearest x (..., parameters) inside the bounds, by a margin."""
        lower, upper = self._limits
        margin = 1e-9 * np.maximum(1.0, np.abs(x))
        return np.clip(x, lower + margin, upper - margin)

    def linear_at(self, x: Floats) -> Floats:
        """Return the values (..., linear) of the linear parameters at x (..., parameters).

        As in `Parameter.value`; parameters that are not in the device file are 0 at x = 0.
        """
        at_zero, scale, factors, bent = self._scaled
        own = x[..., : scale.size].astype(np.float64, order="C")
        moved = own.copy()
        moved[..., bent] = np.sinh(np.take(own, bent, axis=-1))
        found = at_zero + scale * moved
        grown = np.exp(np.take(scale * own, factors, axis=-1))
        found[..., factors] = at_zero[factors] * grown
        return found

    def _chain_at(self, values: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        """The values of the chain's fields for values (..., linear) of the linear parameters."""
        n = self.nominal.chain.masses.size
        ends = (0, n, 2 * n, 3 * n - 1, 4 * n - 2)  # in the order of `linear_parameters`
        fields = [np.ascontiguousarray(values[..., a:b]) for a, b in itertools.pairwise(ends)]
        masses, dampers, springs, links = fields
        k0 = self._one(values, "k0", self.nominal.chain.ground_spring)
        return masses, dampers, k0, springs, links

    def chains(self, xs: Floats) -> Chains:
        """Return the chains at many x (members, parameters)."""
        return Chains(*self._chain_at(self.linear_at(xs)))

    def _one(self, values: Floats, kind: str, absent: float) -> Floats:
        """The value (...,) of the only linear parameter of a kind, or `absent`."""
        if kind in self._kinds:
            return values[..., self._kinds[kind].start]
        return np.full(values.shape[:-1], absent)

    def _values_at(self, x: Floats) -> list[Floats]:
        """The values of each effect at x (..., parameters), clipped to their bounds."""
        t = self._trial
        own = np.broadcast_to(t.vector, (*x.shape[:-1], t.vector.size)).copy()
        own[..., t.own] += t.scale * x[..., t.x]
        above = np.where(t.lower > own, t.lower, own)
        inside = np.where(t.upper < above, t.upper, above)
        return [np.ascontiguousarray(inside[..., cut]) for cut in t.each]

    def effects_at(self, x: Floats) -> tuple[Physics, ...]:
        """Return the effects under trial with their values at x."""
        found: list[Physics] = []
        for physics, own in zip(self.effects, self._values_at(x), strict=True):
            names = [p.name for p in physics.effect.parameters]
            values = dict(zip(names, own.tolist(), strict=True))
            found.append(replace(physics, values={name: values[name] for name in physics.values}))
        return tuple(found)

    def build(self, x: Floats) -> Device:
        """Return the device at x."""
        return self._device(x, acts=False)

    def acting(self, x: Floats) -> Device:
        """Return the device at x without the effects that `seen` subtracts from the recording."""
        return self._device(x, acts=True)

    def _device(self, x: Floats, acts: bool) -> Device:
        """One of the last few devices, or a new one."""
        key = acts, np.asarray(x, dtype=np.float64).tobytes()
        device = self._built.get(key)
        if device is None:
            device = self._acting(self.build(x)) if acts else self._new(x)
            if len(self._built) >= 16:
                self._built.clear()
            self._built[key] = device
        return device

    def _new(self, x: Floats) -> Device:
        values = self.linear_at(x)
        masses, dampers, k0, springs, links = self._chain_at(values)
        device = self.nominal.with_chain(Chain(masses, dampers, float(k0), springs, links))
        gain = float(self._one(values, "gain", 1.0))
        drive = [_times(p, gain) for p in device.physics if p.effect.of_drive and gain != 1.0]
        return device.with_physics(*drive, *self.effects_at(x))

    def _acting(self, device: Device) -> Device:
        device = device.with_interface(**self._ideal)
        gone = {p.effect.name for p in device.physics if p.effect.in_recording}
        return device.without_physics(*gone) if gone else device

    @property
    def _ideal(self) -> dict[str, float]:
        """The interface without the steps that `plain` applies or subtracts."""
        reads = self.sensor_error_known or not self.has("encoder_step")
        return {"command_step": 0.0} | ({"encoder_step": 0.0} if reads else {})

    def members(self, xs: Floats) -> Members:
        """Return the `acting` devices at many x (members, parameters), all at once.

        Their values equal those of `acting` bit for bit; `Members.check` raises the same errors.
        """
        values = self.linear_at(xs)
        found = replace(alike(self.nominal, xs.shape[0]), chains=Chains(*self._chain_at(values)))
        if "gain" in self._kinds:
            gain = self._one(values, "gain", 1.0)[:, None]
            own = zip(found.physics, found.values, strict=True)
            scaled = tuple(v * gain if p.effect.of_drive else v for p, v in own)
            found = replace(found, values=scaled)
        for physics, numbers in zip(self.effects, self._values_at(xs), strict=True):
            found = found.with_physics(physics, numbers)
        found = found.with_interface(**self._ideal)
        return found.without_physics(lambda p: p.effect.in_recording)

    def is_found(self, parameter: Parameter) -> bool:
        """Whether a parameter is a change that no recording declares."""
        return parameter.kind == "change" and parameter.name not in self._declared

    def is_linear(self, parameter: Parameter) -> bool:
        """Whether a parameter is linear, or a recording's own value of a linear one."""
        if parameter.kind == "effect":
            return False
        if parameter.kind != "change":
            return True
        own = not self.is_found(parameter)
        return own and self.parameters[parameter.index].kind != "effect"

    def has(self, name: str) -> bool:
        """Whether an effect of that name is under trial."""
        return any(p.effect.name == name for p in self.effects)

    def reads(self, x: Floats) -> Reads:
        """Return how the model at x reads a recording."""
        gain, origin, jitter, zeros, late, push = self.reads_each(x)
        own = tuple(zeros.tolist())
        return Reads(float(gain), float(origin), float(jitter), own, float(late), float(push))

    def reads_each(self, xs: Floats) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats]:
        """Return the results of `reads` at x (..., parameters): zeros (..., n), the others (...,).

        A delay under trial counts from the reading, so it includes the skew of the clock.
        """
        values = self.linear_at(xs)
        gain, origin, jitter, late = (
            self._one(values, kind, absent)
            for kind, absent in (("gain", 1.0), ("origin", 0.0), ("jitter", 0.0), ("skew", 0.0))
        )
        late = np.zeros_like(late) if self.has("loop_delay") else late
        zeros = np.zeros((*xs.shape[:-1], self.nominal.chain.masses.size))
        if "zero" in self._kinds:
            zeros[..., 1:] = values[..., self._kinds["zero"]]
        counts = gain * self.nominal.interface.command_gain
        push = counts / self.nominal.chain.masses[0]
        return gain, origin, 0.5 * jitter * push, zeros, late, push

    def plain(self, experiment: Experiment) -> Experiment:
        """Return a recording as the model reads it at any x.

        Lost commands are replaced, the command is rounded to its steps, and the sensor's rounding
        errors and the device's own origin are subtracted. Steps are applied here and not in the
        device, since inside a fit they would turn every slope into noise.
        """
        measured, command = experiment.measured, experiment.command
        if self.has("dropped_samples") and experiment.dropped is not None:
            command = delivered(command, experiment.dropped)
        for step in self._command_steps():
            command = step * np.round(command / step)
        if self.sensor_error_known and experiment.sensor_error is not None:
            measured = measured.copy()
            measured[:, 0] -= experiment.sensor_error
        if self.nominal.interface.position_origin != 0.0:
            positions = np.array([o.tells_position for o in experiment.outputs])
            measured = measured - self.nominal.interface.position_origin * positions
        before = None if experiment.before is None else self.plain(experiment.before)
        return replace(experiment, command=command, measured=measured, before=before)

    def seen(self, experiment: Experiment, x: Floats) -> Experiment:
        """Return a recording as the model at x reads it: `plain`, then gain, origin, jitter, skew.

        Commands arrive early or late, equally often, with a mean |error| of j. The velocity of m1
        is read at the nominal instant, when an early command has already acted and a late one has
        not; on average this adds j / (2 m1) of each command's change to that reading. Later
        readings contain both fully.
        """
        own, x = x, self.there(x, experiment)
        plain, reads = self.plain(experiment), self.reads(x)
        measured = plain.measured
        if (offsets := reads.offsets(experiment)).any():
            measured = measured - offsets
        led = leads(plain.outputs, reads.jitter, reads.late, reads.push)
        if led.any():
            measured = measured - led * self.arriving_change(plain)[:, None]
        outputs = plain.outputs
        if reads.late != 0.0:
            outputs = tuple(replace(o, late=o.late + reads.late) for o in outputs)
        before = None if experiment.before is None else self.seen(experiment.before, own)
        command = reads.gain * plain.command
        changes = experiment.changes
        if x is not own:
            changes = beside(changes, difference(self.acting(own), self.acting(x)))
        return replace(
            plain, outputs=outputs, command=command, measured=measured, before=before,
            changes=changes,
        )  # fmt: skip

    def arriving_change(self, plain: Experiment) -> Floats:
        """Return the change of the command that begins to act at each reading (ticks,).

        It continues from the part before. Without one, the first command counts as old: a part may
        begin in the middle of a motion, and a change from 0 would be a kick in its first reading.
        """
        parts = [plain]
        while (before := parts[0].before) is not None:
            parts.insert(0, before)
        arrived = arriving(plain.on(self.nominal), np.concatenate([e.command for e in parts]))
        return np.diff(arrived, prepend=arrived[0])[-plain.ticks :]

    def _command_steps(self) -> list[float]:
        known = [self.nominal.interface.command_step]
        found = [p.values["step"] for p in self.effects if p.effect.name == "command_step"]
        return [step for step in found or known if step > 0.0]

    def with_effect(
        self, physics: Physics, scales: Mapping[str, float], bounds: Bounds | None = None
    ) -> "Model":
        """Return the model with one more effect, which is constant: no change of it was found."""
        before = self.bounds or ({},) * len(self.effects)
        known = {p.name for p in self.parameters}
        return replace(
            self,
            varying=tuple(v for v in self.varying if v.declared or v.of in known),
            effects=(*self.effects, physics),
            scales=(*self.scales, scales),
            bounds=(*before, bounds or {}),
        )

    def without_effect(self, index: int) -> "Model":
        """Return the model without one of its effects."""
        keep = [i for i in range(len(self.effects)) if i != index]
        steps = self.sensor_error_known and self.effects[index].effect.name != "encoder_step"
        return replace(
            self,
            sensor_error_known=steps,
            effects=tuple(self.effects[i] for i in keep),
            scales=tuple(self.scales[i] for i in keep),
            bounds=tuple(self.bounds[i] for i in keep) if self.bounds else (),
        )

    @property
    def label(self) -> str:
        """The effects in words, or "the linear device"."""
        return " + ".join(place_label(p) for p in self.effects) or "the linear device"


def _times(physics: Physics, scale: float) -> Physics:
    return replace(physics, values={k: v * scale for k, v in physics.values.items()})


def is_read(parameter: Parameter, experiments: Sequence[Experiment]) -> bool:
    """Whether any output depends on a parameter; only jitter and zeros may have no output."""
    if parameter.kind == "jitter":
        return any(o.name == "velocity_m1" for e in experiments for o in e.outputs)
    if parameter.kind == "zero":
        outputs = (o for e in experiments for o in e.outputs)
        return any(o.tells_position and o.mass == parameter.index for o in outputs)
    return True


def arriving(device: Device, command: Floats) -> Floats:
    """Return the command (ticks,) that begins to act at each reading; first the first one."""
    whole, _ = device.interface.delay_ticks
    return np.concatenate([np.full(whole, command[0]), command])[: command.size]


def delivered(command: Floats, dropped: NDArray[np.bool_]) -> Floats:
    """Return the commands that arrived: a lost one is replaced by the one before."""
    last = np.where(dropped, -1, np.arange(command.size))
    last[0] = 0
    return command[np.maximum.accumulate(last)]


def _of_effect(
    name: str, index: int, p: Declared, value: float, scale: float, limits: tuple[float, float]
) -> Parameter:
    """A parameter of an effect; value: the start of its fit.

    Its bounds are the physical ones for this recording, extended to the start, and the distance
    from the start that the effect allows.
    """
    lower = max(p.lower, min(limits[0], value))
    upper = min(p.upper, max(limits[1], value))
    reach = (p.least * value if p.least > 0.0 else -np.inf,
             p.most * value if p.most < np.inf else np.inf)  # fmt: skip
    walks = ("lower",) * (reach[0] > lower) + ("upper",) * (reach[1] < upper)
    lower, upper = max(lower, reach[0]), min(upper, reach[1])
    ends = ("lower",) * (lower > p.lower) + ("upper",) * (not p.open_ended)
    return Parameter(
        name, "effect", index, scale, (lower - value) / scale, (upper - value) / scale, False,
        p.name, ends, walks,
    )  # fmt: skip


def linear_parameters(device: Device) -> list[Parameter]:
    """Return the linear parameters of a device; a gain only if its file leaves it free."""
    chain, known = device.chain, device.uncertainty
    n = chain.masses.size
    every = np.concatenate([np.abs(chain.ground_dampers), np.abs(chain.link_dampers)])
    floor = DAMPER_FLOOR * float(every.mean()) or 1e-3 * float(chain.masses.sum())

    def damper(name: str, kind: str, i: int, value: float) -> Parameter:
        # A damper is not negative, unless a file (of a modal fit) has a negative one.
        scale = known.dampers * max(abs(value), floor)
        if kind not in BENT:
            return Parameter(name, kind, i, scale, -value / scale if value >= 0.0 else -np.inf)
        lower = -math.asinh(value / scale) if value >= 0.0 else -FARTHEST_DAMPER
        return Parameter(name, kind, i, scale, lower, FARTHEST_DAMPER)

    found = [Parameter(f"m{i + 1}", "mass", i, known.masses, -FARTHEST, FARTHEST) for i in range(n)]
    found += [damper(f"b{i + 1}", "damper", i, chain.ground_dampers[i]) for i in range(n)]
    found += [
        Parameter(f"k{i + 1}{i + 2}", "spring", i, known.springs, -FARTHEST, FARTHEST)
        for i in range(n - 1)
    ]
    found += [damper(f"b{i + 1}{i + 2}", "link", i, chain.link_dampers[i]) for i in range(n - 1)]
    if chain.ground_spring > 0.0:
        found.append(Parameter("k0", "k0", 0, known.springs, -FARTHEST, FARTHEST))
        found.append(Parameter("origin", "origin", 0, ORIGIN_SCALE, prior=False))
    if known.zeros > 0.0:
        found += [Parameter(f"zero_m{i + 1}", "zero", i, known.zeros) for i in range(1, n)]
    if known.command_scale > 0.0:
        found.append(Parameter("gain", "gain", 0, known.command_scale, -FARTHEST, FARTHEST))
    if device.interface.delay_ticks[1] == 0.0:  # else no command arrives at a reading
        scale = JITTER_SCALE * device.interface.period
        found.append(Parameter("jitter", "jitter", 0, scale))
    skew = SKEW_SCALE * device.interface.period
    found.append(Parameter("skew", "skew", 0, skew, -1.0 / SKEW_SCALE, 1.0 / SKEW_SCALE))
    return found


def chain_values(chain: Chain) -> dict[str, float]:
    """Return the values of a chain by the names of its parameters."""
    found = {f"m{i + 1}": float(m) for i, m in enumerate(chain.masses)}
    found |= {f"b{i + 1}": float(b) for i, b in enumerate(chain.ground_dampers)}
    found |= {f"k{i + 1}{i + 2}": float(k) for i, k in enumerate(chain.link_springs)}
    found |= {f"b{i + 1}{i + 2}": float(b) for i, b in enumerate(chain.link_dampers)}
    return found | {"k0": float(chain.ground_spring)}


def nominal_of(model: Model, p: Parameter) -> float:
    """Return the nominal value of a parameter of the chain, the gain or an effect."""
    if p.kind == "effect":
        return model.effects[p.index].values[p.key]
    if p.kind == "gain":
        return model.nominal.interface.command_gain
    return chain_values(model.nominal.chain)[p.name]


def values_of(model: Model, x: Floats) -> dict[str, float]:
    """Return the physical value of each linear parameter by name; origins in rms motions."""
    told = chain_values(model.build(x).chain)  # including additions by an effect
    own = model.linear_at(x).tolist()
    each = zip(model.linear, own, strict=True)
    return {p.name: told[p.name] if p.name in told else float(v) for p, v in each}


def effect_labels(effects: Sequence[Physics]) -> list[str]:
    """Return effect@place of each."""
    return [place_label(p) for p in effects]
