"""The numbers that a fit may change: the device's linear parameters, and those of effects.

Every parameter is value = nominal + scale x (effects, dampers of links), nominal exp(scale x)
(masses, springs, gain) or nominal + scale sinh(x) (dampers to ground), so that x is of order one.
The linear ones carry a Gaussian prior of one scale, which the device file states (`Uncertainty`):
what the recording does not tell stays near the nominal device instead of running away. A damper to
the ground may be zero, and is guessed more often than measured, since bearings and back-EMF are in
it: near the file's value sinh(x) is x, and far from it another factor of ten costs no more than the
first did. Were it linear there too, twenty times the damper would cost 1400, and any drag of the
library less. One of a link stays linear: far larger ones are what play and friction in the link
look like, and a refit bent so far leads no search back. The gain of the command is free only where
the file says how uncertain that is, since motion alone cannot tell it from masses, springs, dampers
and forces all at once.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.chain import Chain, make_chain
from zwidth.sim.changes import beside, difference
from zwidth.sim.device import Device, place_label
from zwidth.sim.members import Members, alike, chains_of
from zwidth.sim.physics.effect import Bounds, Physics
from zwidth.sim.physics.effect import Parameter as Declared

Floats = NDArray[np.float64]
JITTER_SCALE = 0.01  # of the period: by how much commands arrive early or late
ORIGIN_SCALE = 0.1  # of the rms motion: where a spring to ground is at rest
# Scales that a mass, spring or gain may move: with 0.3 by exp(1.5) = 4.5 either way. The prior says
# how unlikely that is; a bound that is met says nothing. Carts of which their builders' file has
# 2/5 of the mass met one at three scales, and the rest of the mass was named a mode, with a delay
# and a ripple beside it; at five, friction on both carts is.
FARTHEST = 5.0
FARTHEST_DAMPER = 9.0  # asinh of how many scales a damper to ground may move: 4000
DAMPER_FLOOR = 0.1  # of the mean damper: what a damper of nearly zero may change by

FACTORED = ("mass", "spring", "k0", "gain")
BENT = ("damper",)
MARGIN = 1e-9  # of x, by which a start keeps off a bound


@dataclass(frozen=True)
class Parameter:
    """One number; index in its array.

    kind: "mass", "spring", "damper", "link", "k0", "origin", "zero", "gain", "jitter", "effect",
    or "change": of the parameter at `index` of all, in its x.

    scale: of x. lower, upper: bounds of x. prior: whether x has a unit Gaussian prior. key: of an
    effect's parameter its name; ends: at which of its bounds a fit is no physics, "lower", "upper".
    walks: which of them are only how far a fit may go from its start.
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

    def at_end(self, x: float, which: Sequence[str], margin: float) -> bool:
        """Whether x stands on one of some of its bounds, "lower" and "upper"."""
        low = "lower" in which and x < self.lower + margin
        return low or ("upper" in which and x > self.upper - margin * max(1.0, abs(self.upper)))

    def value(self, nominal: float, x: float) -> float:
        """Return the value at its x of what is `nominal` at zero: of a chain's or an effect's."""
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
        """Return the x of a value; of a factor that is none, of one of 1e-12."""
        if self.kind in FACTORED:
            return math.log(max(value / nominal, 1e-12)) / self.scale
        moved = (value - nominal) / self.scale
        return math.asinh(moved) if self.kind in BENT else moved


@dataclass(frozen=True)
class Varying:
    """A change of one parameter (`Parameter.name`): in a recording counts what share of it holds.

    name: of the change, by which recordings say their share (`Experiment.shares`). smooth: over
    time, so that parts of a recording have all its values between. price: of how rare it is, and of
    having asked for so many, in -2 ln. declared: recordings say that it is their own
    (`model.own_values`); it was not found.
    """

    name: str
    of: str
    smooth: bool = False
    price: float = 0.0
    declared: bool = False


class Reads(NamedTuple):
    """How a model reads a recording.

    The command counts times gain; origin, in units of the rms motion, is taken from positions, and
    jitter times the change of the arriving command from the velocity of m1. zeros (n,): what the
    positions of each mass are read by more than that of m1.
    """

    gain: float
    origin: float
    jitter: float
    zeros: tuple[float, ...]

    def offsets(self, experiment: Experiment) -> Floats:
        """Return what the outputs (o,) of a recording read where the device is at rest."""
        positions = np.array([o.tells_position for o in experiment.outputs])
        own = np.array([self.zeros[o.mass] for o in experiment.outputs])
        origin = self.origin * experiment.swing if self.origin else 0.0  # a swing may be infinite
        return (origin + own) * positions


@dataclass(frozen=True)
class Model:
    """A device with its free parameters; `build(x)` is the device at x, `seen` a recording at x.

    effects: the physics under trial, at the values where x of their parameters is zero. scales: of
    their free parameters; bounds: of them, given the recordings, where that is less than the effect
    allows.
    sensor_error_known: the recordings say what an encoder_step under trial adds to the sensor, so
    that it is taken off there and not simulated. varying: what is not the same in all recordings;
    those whose parameter the model lacks change nothing. `build` gives the device of no share.
    """

    nominal: Device
    effects: tuple[Physics, ...] = ()
    scales: tuple[Mapping[str, float], ...] = ()
    sensor_error_known: bool = False
    bounds: tuple[Bounds, ...] = ()
    varying: tuple[Varying, ...] = ()

    @cached_property
    def parameters(self) -> list[Parameter]:
        """All free parameters, linear ones first; asked for in every prediction, so kept."""
        found = self._with_own(linear_parameters(self.nominal), 0)
        for one in self._effect_parameters():  # each with its own, so that a further effect is last
            found += self._with_own(one, len(found))
        places = {p.name: i for i, p in enumerate(found)}
        return found + [
            Parameter(v.name, "change", places[v.of], 1.0, prior=False)
            for v in self.varying
            if v.of in places and not v.declared
        ]

    def _with_own(self, lasting: Sequence[Parameter], first: int) -> list[Parameter]:
        """Parameters, then the values that recordings have of them; first: the place of these."""
        places = {p.name: first + i for i, p in enumerate(lasting)}
        priors = {p.name: p.prior for p in lasting}
        own = [v for v in self.varying if v.declared and v.of in places]
        return [
            *lasting,
            *(Parameter(v.name, "change", places[v.of], 1.0, prior=priors[v.of]) for v in own),
        ]

    @property
    def varies(self) -> tuple[str, ...]:
        """The parameters that were found to change (`Parameter.name`), each as often as it does."""
        own = self.parameters
        return tuple(own[p.index].name for p in own if self.is_found(p))

    def constant(self, x: Floats) -> tuple["Model", Floats]:
        """Return the model in which nothing was found to change, and its x."""
        keep = np.array([not self.is_found(p) for p in self.parameters])
        return replace(self, varying=tuple(v for v in self.varying if v.declared)), x[keep]

    def there(self, x: Floats, experiment: Experiment) -> Floats:
        """Return x (..., parameters) as it was in a recording: its shares of all changes added."""
        found = x
        for i, share in self.shares(experiment):
            found = found.copy() if found is x else found
            own = self.parameters[i].index
            found[..., own] = self._turned(own, found[..., own] + share * x[..., i])
        return x if found is x else self.within(found)

    def _turned(self, index: int, x: Floats) -> Floats:
        """Return x of an angle within half a turn: past its bounds it would stand still."""
        p = self.parameters[index]
        if p.kind != "effect" or p.key not in self.effects[p.index].effect.turning:
            return x
        value = self.effects[p.index].values[p.key]
        angle = value + p.scale * x
        return (np.mod(angle + np.pi, 2.0 * np.pi) - np.pi - value) / p.scale

    def shares(self, experiment: Experiment) -> tuple[tuple[int, float], ...]:
        """Return how much of each change (its place in `parameters`) holds in a recording."""
        shares = dict(experiment.shares) | dict.fromkeys(experiment.own_names, 1.0)
        changes = ((i, shares.get(p.name, 0.0)) for i, p in enumerate(self.parameters)
                   if p.kind == "change")  # fmt: skip
        return tuple((i, share) for i, share in changes if share != 0.0)

    @property
    def linear_count(self) -> int:
        """How many of the parameters are linear ones."""
        return len(linear_parameters(self.nominal))

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

    def size_of(self, index: int, x: Floats) -> float:
        """Return by how much of its own x a parameter is nothing, or e times as much."""
        p, own = self.parameters[index], float(x[index])
        if p.kind == "effect":
            return abs(self.effects[p.index].values[p.key] / p.scale + own)
        if p.kind in ("damper", "link"):
            chain = self.nominal.chain
            of = (chain.ground_dampers if p.kind == "damper" else chain.link_dampers)[p.index]
            return abs(p.value(of, own) / p.slope(of, own))
        return 1.0 / p.scale if p.kind != "origin" else 1.0

    def less(self, x: Floats, *gone: int) -> tuple["Model", Floats]:
        """Return the model without some of its effects (their places in it), and its x."""
        own = self.parameters
        lost = {i for i, p in enumerate(own) if p.kind == "effect" and p.index in gone}
        lost |= {i for i, p in enumerate(own) if p.kind == "change" and p.index in lost}
        keep = np.array([i not in lost for i in range(len(own))])
        model = self
        for index in sorted(gone, reverse=True):
            model = model.without_effect(index)
        return model, x[keep]

    def begun_at(self, x: Floats) -> tuple["Model", Floats]:
        """Return the model whose effects begin where they are at x, and its x there."""
        effects = [p.kind == "effect" for p in self.parameters]
        return replace(self, effects=self.effects_at(x)), np.where(effects, 0.0, x)

    def within(self, x: Floats) -> Floats:
        """Return the nearest x inside the bounds, off them by a margin."""
        lower = np.array([p.lower for p in self.parameters])
        upper = np.array([p.upper for p in self.parameters])
        margin = MARGIN * np.maximum(1.0, np.abs(x))
        return np.clip(x, np.where(np.isfinite(lower), lower + margin, lower),
                       np.where(np.isfinite(upper), upper - margin, upper))  # fmt: skip

    def effects_at(self, x: Floats) -> tuple[Physics, ...]:
        """Return the effects under trial with their values at x."""
        values = [dict(p.values) for p in self.effects]
        for p, xi in zip(self.parameters, x, strict=True):
            if p.kind == "effect":
                values[p.index][p.key] += p.scale * float(xi)
        return tuple(
            replace(physics, values=_inside(physics, changed))
            for physics, changed in zip(self.effects, values, strict=True)
        )

    def build(self, x: Floats) -> Device:
        """Return the device at x."""
        chain = self.nominal.chain
        masses, dampers = chain.masses.copy(), chain.ground_dampers.copy()
        springs, links = chain.link_springs.copy(), chain.link_dampers.copy()
        k0 = chain.ground_spring
        scale = 1.0
        for p, xi in zip(self.parameters, x, strict=True):
            if p.kind == "mass":
                masses[p.index] *= np.exp(p.scale * xi)
            elif p.kind == "spring":
                springs[p.index] *= np.exp(p.scale * xi)
            elif p.kind == "damper":
                dampers[p.index] += p.scale * np.sinh(xi)
            elif p.kind == "link":
                links[p.index] += p.scale * xi
            elif p.kind == "k0":
                k0 *= float(np.exp(p.scale * xi))
            elif p.kind == "gain":
                scale = float(np.exp(p.scale * xi))
        device = self.nominal.with_chain(make_chain(masses, dampers, k0, springs, links))
        if scale != 1.0:
            drive = (p for p in device.physics if p.effect.of_drive)
            device = device.with_physics(*(_scaled(p, scale) for p in drive))
        for physics in self.effects_at(x):
            device = device.with_physics(physics)
        return device

    def acting(self, x: Floats) -> Device:
        """Return the device at x less what `seen` takes off the recording: steps, lost commands."""
        device = self.build(x).with_interface(command_step=0.0)
        if self.sensor_error_known or not self.has("encoder_step"):
            device = device.with_interface(encoder_step=0.0)
        gone = {p.effect.name for p in device.physics if p.effect.in_recording}
        return device.without_physics(*gone) if gone else device

    def members(self, xs: Floats) -> Members:
        """Return the devices that are `acting` at many x (members, parameters), all at once.

        Their numbers are those of `acting` bit for bit; `Members.check` raises what it raises.
        """
        count = xs.shape[0]
        chains = chains_of(self.nominal.chain, count)
        values = [np.tile(p.vector(), (count, 1)) for p in self.effects]
        factored = {"mass": chains.masses, "spring": chains.link_springs,
                    "k0": chains.ground_spring[:, None]}  # fmt: skip
        shifted = {"damper": chains.ground_dampers, "link": chains.link_dampers}
        scale: Floats | None = None
        for p, x in zip(self.parameters, np.ascontiguousarray(xs.T), strict=True):
            if p.kind == "gain":
                scale = np.exp(p.scale * x)
            if p.kind in factored:
                factored[p.kind][:, p.index] *= np.exp(p.scale * x)
            elif p.kind in shifted:
                shifted[p.kind][:, p.index] += p.scale * (np.sinh(x) if p.kind in BENT else x)
            elif p.kind == "effect":
                names = [q.name for q in self.effects[p.index].effect.parameters]
                values[p.index][:, names.index(p.key)] += p.scale * x
        found = replace(alike(self.nominal, count), chains=chains)
        if scale is not None:
            own = zip(found.physics, found.values, strict=True)
            scaled = tuple(v * scale[:, None] if p.effect.of_drive else v for p, v in own)
            found = replace(found, values=scaled)
        for physics, own in zip(self.effects, values, strict=True):
            lower = np.array([p.lower for p in physics.effect.parameters])
            upper = np.array([p.upper for p in physics.effect.parameters])
            above = np.where(lower > own, lower, own)
            found = found.with_physics(physics, np.where(upper < above, upper, above))
        found = found.with_interface(command_step=0.0)
        if self.sensor_error_known or not self.has("encoder_step"):
            found = found.with_interface(encoder_step=0.0)
        return found.without_physics(lambda p: p.effect.in_recording)

    def is_found(self, parameter: Parameter) -> bool:
        """Whether it is a change that no recording said of itself."""
        return parameter.kind == "change" and not any(
            v.name == parameter.name and v.declared for v in self.varying
        )

    def is_linear(self, parameter: Parameter) -> bool:
        """Whether it is in every hypothesis: a linear one, or what recordings have of one."""
        if parameter.kind == "effect":
            return False
        if parameter.kind != "change":
            return True
        own = not self.is_found(parameter)
        return own and self.parameters[parameter.index].kind != "effect"

    def has(self, name: str) -> bool:
        """Whether an effect of that name is under trial."""
        return any(p.effect.name == name for p in self.effects)

    def reads(self, x: Floats) -> "Reads":
        """Return how the model at x reads a recording."""
        gain, origin, jitter = 1.0, 0.0, 0.0
        zeros = [0.0] * self.nominal.chain.masses.size
        for p, xi in zip(self.parameters, x, strict=True):
            if p.kind == "gain":
                gain = float(np.exp(p.scale * xi))
            elif p.kind == "origin":
                origin = p.scale * float(xi)
            elif p.kind == "jitter":
                jitter = p.scale * float(xi)
            elif p.kind == "zero":
                zeros[p.index] = p.scale * float(xi)
        counts = gain * self.nominal.interface.command_gain
        jitter = 0.5 * jitter * counts / self.nominal.chain.masses[0]
        return Reads(gain, origin, jitter, tuple(zeros))

    def reads_each(self, xs: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return gain, origin, jitter and zeros of `reads` at many x (members, parameters).

        Zeros are (members, n), the others (members,).
        """
        gain, origin, jitter = np.ones(xs.shape[0]), np.zeros(xs.shape[0]), np.zeros(xs.shape[0])
        zeros = np.zeros((xs.shape[0], self.nominal.chain.masses.size))
        for p, x in zip(self.parameters, np.ascontiguousarray(xs.T), strict=True):
            if p.kind == "gain":
                gain = np.exp(p.scale * x)
            elif p.kind == "origin":
                origin = p.scale * x
            elif p.kind == "jitter":
                jitter = p.scale * x
            elif p.kind == "zero":
                zeros[:, p.index] = p.scale * x
        counts = gain * self.nominal.interface.command_gain
        return gain, origin, 0.5 * jitter * counts / self.nominal.chain.masses[0], zeros

    def plain(self, experiment: Experiment) -> Experiment:
        """Return a recording as the model sees it at every x alike.

        Lost commands left out, the command in its steps, errors of the sensor's steps and the
        device's own origin taken off.
        Steps are taken here and not in the device: inside a fit they would turn every slope into
        noise.
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
        """Return a recording as the model at x sees it: `plain`, then gain, origin and jitter.

        Commands that arrive early or late by j in the mean of |j|, as often one as the other: the
        velocity of m1 is read at the nominal instant, when an early one has acted for j already and
        a late one not at all, which in the mean adds j / 2 m1 of each command's change to that
        reading; later readings see both alike.
        """
        own, x = x, self.there(x, experiment)
        plain, reads = self.plain(experiment), self.reads(x)
        measured = plain.measured
        if (offsets := reads.offsets(experiment)).any():
            measured = measured - offsets
        if reads.jitter != 0.0 and (place := first_velocity(experiment)) is not None:
            measured = measured.copy()
            measured[:, place] -= reads.jitter * self.arriving_change(plain)
        before = None if experiment.before is None else self.seen(experiment.before, own)
        command = reads.gain * plain.command
        changes = experiment.changes
        if x is not own:
            changes = beside(changes, difference(self.acting(own), self.acting(x)))
        return replace(plain, command=command, measured=measured, before=before, changes=changes)

    def arriving_change(self, plain: Experiment) -> Floats:
        """Return by how much the command that begins to act changes at each reading (ticks,)."""
        return np.diff(arriving(plain.on(self.nominal), plain.command), prepend=0.0)

    def _command_steps(self) -> list[float]:
        known = [self.nominal.interface.command_step]
        found = [p.values["step"] for p in self.effects if p.effect.name == "command_step"]
        return [step for step in found or known if step > 0.0]

    def with_effect(
        self, physics: Physics, scales: Mapping[str, float], bounds: Bounds | None = None
    ) -> "Model":
        """Return the model with one more effect."""
        before = self.bounds or ({},) * len(self.effects)
        return replace(
            self,
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
        """The effects by name, or "linear"."""
        return " + ".join(place_label(p) for p in self.effects) or "linear"


def _scaled(physics: Physics, scale: float) -> Physics:
    return replace(physics, values={k: v * scale for k, v in physics.values.items()})


def first_velocity(experiment: Experiment) -> int | None:
    """Return which output is the velocity of m1, None for none."""
    named = [o.name for o in experiment.outputs]
    return named.index("velocity_m1") if "velocity_m1" in named else None


def is_read(parameter: Parameter, experiments: Sequence[Experiment]) -> bool:
    """Whether any output turns on a parameter; all do on those of what acts."""
    if parameter.kind == "jitter":
        return any(first_velocity(e) is not None for e in experiments)
    if parameter.kind == "zero":
        outputs = (o for e in experiments for o in e.outputs)
        return any(o.tells_position and o.mass == parameter.index for o in outputs)
    return True


def arriving(device: Device, command: Floats) -> Floats:
    """Return the command (ticks,) that begins to act at each reading."""
    whole, _ = device.interface.delay_ticks
    return np.concatenate([np.zeros(whole), command])[: command.size]


def delivered(command: Floats, dropped: NDArray[np.bool_]) -> Floats:
    """Return the commands that arrived: in place of a lost one, the one before."""
    last = np.where(dropped, -1, np.arange(command.size))
    last[0] = 0
    return command[np.maximum.accumulate(last)]


def _inside(physics: Physics, values: dict[str, float]) -> dict[str, float]:
    """Rounding may leave a value a hair outside its bounds."""
    bounds = {p.name: (p.lower, p.upper) for p in physics.effect.parameters}
    return {k: min(max(v, bounds[k][0]), bounds[k][1]) for k, v in values.items()}


def _of_effect(
    name: str, index: int, p: Declared, value: float, scale: float, limits: tuple[float, float]
) -> Parameter:
    """A parameter of an effect that a fit starts at a value.

    Within the bounds that physics sets given the recording, which hold the start, and as far from
    it as the effect says.
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
    """Return the refit's own parameters of a device; a gain only where its file leaves it open."""
    chain, known = device.chain, device.uncertainty
    n = chain.masses.size
    every = np.concatenate([np.abs(chain.ground_dampers), np.abs(chain.link_dampers)])
    floor = DAMPER_FLOOR * float(every.mean()) or 1e-3 * float(chain.masses.sum())

    def damper(name: str, kind: str, i: int, value: float) -> Parameter:
        # One that pushes is no damper; a file that has one (a modal fit) says that it is no chain.
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
    if device.interface.delay_ticks[1] == 0.0:  # else no command arrives while one reads
        scale = JITTER_SCALE * device.interface.period
        found.append(Parameter("jitter", "jitter", 0, scale))
    return found


def chain_values(chain: Chain) -> dict[str, float]:
    """Return the numbers of a chain by the names that its parameters have."""
    found = {f"m{i + 1}": float(m) for i, m in enumerate(chain.masses)}
    found |= {f"b{i + 1}": float(b) for i, b in enumerate(chain.ground_dampers)}
    found |= {f"k{i + 1}{i + 2}": float(k) for i, k in enumerate(chain.link_springs)}
    found |= {f"b{i + 1}{i + 2}": float(b) for i, b in enumerate(chain.link_dampers)}
    return found | {"k0": float(chain.ground_spring)}


def values_of(model: Model, x: Floats) -> dict[str, float]:
    """Return the physical value of each linear parameter by name."""
    device = model.build(x)
    chain = device.chain
    values: dict[str, float] = {}
    arrays = {"mass": chain.masses, "damper": chain.ground_dampers, "spring": chain.link_springs,
              "link": chain.link_dampers}  # fmt: skip
    for j, p in enumerate(linear_parameters(model.nominal)):
        if p.kind == "gain":
            values[p.name] = float(np.exp(p.scale * x[j]))
        elif p.kind == "k0":
            values[p.name] = chain.ground_spring
        elif p.kind in ("origin", "jitter", "zero"):  # an origin in units of the rms motion
            values[p.name] = p.scale * float(x[j])
        else:
            values[p.name] = float(arrays[p.kind][p.index])
    return values


def effect_labels(effects: Sequence[Physics]) -> list[str]:
    """Return effect@place of each."""
    return [place_label(p) for p in effects]
