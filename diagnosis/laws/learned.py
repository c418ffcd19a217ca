"""What was learned: a curve over one state or a surface over two, with what is known of it.

The band of either is what the fit does not know of its numbers, and what a curve through so few
points cannot be (`points.left_out_of`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.uncertainty import Z95, covariance, covariance_beside
from zwidth.diagnosis.laws.fewer import Begun, numbers_of
from zwidth.diagnosis.laws.forms import (
    TABLES,
    FormOfTwo,
    ShiftForm,
    TableForm,
    form_of,
    form_of_two,
    in_words,
)
from zwidth.diagnosis.laws.points import is_odd, law_at, points_over
from zwidth.diagnosis.laws.start import states_seen
from zwidth.diagnosis.laws.steady import Together, along, follows, named, together
from zwidth.diagnosis.selection.hypothesis import Hypothesis
from zwidth.diagnosis.selection.search import Search
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.free_force import states_over
from zwidth.sim.readable import with_unit

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Law:
    """A law that was learned, and what it is beside the names.

    seen: the states that were visited (samples,), of two (samples, 2). names: that stay beside it;
    replaced: those that are not needed beside it, absorbed: of these, those that were part of it,
    as it turned out. gained: over what it is held against, in -2 ln, all paid.
    """

    physics: Physics
    seen: Floats
    names: tuple[str, ...]
    absorbed: tuple[str, ...]
    replaced: tuple[str, ...]
    gained: float
    hypothesis: Hypothesis


@dataclass(frozen=True)
class Curve(Law):
    """A law over one state.

    states, forces, lower, upper (points,): the curve and its 95 % band, from the point that is held
    where a constant is another origin; covariance (points, points) of the forces. together: the
    curve with the names that follow the same state there, None where none does.
    """

    states: Floats
    forces: Floats
    lower: Floats
    upper: Floats
    covariance: Floats
    together: Together | None

    @property
    def odd(self) -> bool:
        """Whether f(-s) = -f(s): then the table is of |s|."""
        return is_odd(self.physics)

    @property
    def period(self) -> float:
        """Of a law that repeats; 0 for none."""
        return self.physics.values["period"]

    @property
    def one_way(self) -> bool:
        """Whether it only rises, or only falls."""
        steps = np.diff(self.forces)
        return self.period == 0.0 and bool(np.all(steps >= 0.0) or np.all(steps <= 0.0))

    @property
    def over(self) -> str:
        """What the law follows, in words."""
        return in_words((TABLES[self.physics.effect.name],), self.physics.at)[0]

    def named_at(self, states: Floats) -> Floats:
        """Return what the names that follow its state at its place give at states (points,)."""
        h, place = self.hypothesis, self.physics.place.acts_on
        given = [
            along(p, self.physics.effect.name, states)
            for p in h.model.effects_at(h.x)[:-1]
            if p.place.acts_on == place
        ]
        return np.sum([np.zeros(states.size), *(g for g in given if g is not None)], axis=0)

    def powers(self, v: Floats) -> Floats:
        """Return what it, its place's damper and the names beside it feed in at velocities (n,)."""
        damped = damper_at(self) * v
        return (law_at(self.physics, v) + self.named_at(v) - damped) * v

    def energy(self, rotary: bool, little: float = 1e-3) -> str:
        """Say whether it ever makes energy over the states that were seen (`steady`).

        little: of the largest power, below which none is made.
        """
        if self.physics.effect.name == "free_spring":
            return "it follows a position alone, so that round any closed path it makes no energy"
        if self.physics.effect.name != "free_damper":
            return "it enters by the drive, which brings energy of its own"
        low, high = (float(q) for q in np.quantile(self.seen, (0.005, 0.995)))
        v = np.linspace(low, high, 401)
        own, all_of = law_at(self.physics, v) * v, self.powers(v)
        beside = "" if self.together is None else f" and {' and '.join(self.together.names)}"
        if float(own.max()) <= little * float(np.abs(own).max()):
            return "it takes energy at every velocity that was seen, and makes none"
        if float(all_of.max()) <= little * float(np.abs(all_of).max()):
            return (
                "by itself it makes energy at some velocities, together with its damper"
                f"{beside} at none"
            )
        most = int(np.argmax(all_of))
        at = with_unit(float(v[most]), "rad/s" if rotary else "m/s", 2)
        power = with_unit(float(all_of[most]), "W", 2)
        return f"it makes energy, even with its damper{beside}: up to {power} at {at}"


@dataclass(frozen=True)
class Surface(Law):
    """A law over two states: a grid, a product or a shift.

    free (numbers,): the parameters that the recordings tell, with their covariance (numbers,
    numbers).
    """

    free: tuple[str, ...]
    covariance: Floats

    @property
    def form(self) -> FormOfTwo:
        """The form that it has."""
        return form_of_two(self.physics)

    @property
    def shifts(self) -> bool:
        """Whether it is a law of one state that the other shifts."""
        return isinstance(self.form, ShiftForm)

    @property
    def states(self) -> tuple[str, str]:
        """Its two states by their names in a device file."""
        first, second = states_over(self.physics.values)
        return first, second

    @property
    def over(self) -> tuple[str, str]:
        """Its two states in words."""
        first, second = in_words(self.states, self.physics.at)
        return first, second

    def at(self, first: Floats, second: Floats) -> Floats:
        """Return the force at states (...,)."""
        return self.form.at(first, second)

    def half(self, first: Floats, second: Floats) -> Floats:
        """Return the half width of its 95 % band at states (...,)."""
        form = self.form
        slopes = form.slopes(first, second)[..., [form.names.index(name) for name in self.free]]
        variance = np.einsum("...i,ij,...j->...", slopes, self.covariance, slopes)
        return Z95 * np.sqrt(np.maximum(variance, 0.0))

    def of(self, names: Sequence[str]) -> Floats:
        """Return the covariance of some parameters; nothing is known to err of what was held."""
        places = [self.free.index(name) if name in self.free else -1 for name in names]
        padded = np.pad(self.covariance, ((0, 1), (0, 1)))
        return padded[np.ix_(places, places)]


def damper_at(law: Law) -> float:
    """Return the device's own damper at the place of a law."""
    h, place = law.hypothesis, law.physics.place
    chain = h.model.build(h.x).chain
    dampers = chain.link_dampers if place.kind == "link" else chain.ground_dampers
    return float(dampers[place.index])


def _replaced(law: Begun, found: Search) -> tuple[tuple[str, ...], list[Physics]]:
    """Names beside a law, and effects that were named and are not needed beside it."""
    names = tuple(sorted(map(named, law.h.model.effects[:-1])))
    return names, [p for p in found.best.model.effects if named(p) not in names]


def as_curve(law: Begun, without: Hypothesis, found: Search) -> Curve:
    """Return a hypothesis whose last effect is a table, beside what it is held against."""
    h, own = law.h, law.h.model.effects_at(law.h.x)[-1]
    form = TableForm(own)
    states, forces = form.states, form.forces
    seen = states_seen(h, law.site.at, law.site.over)[:, 0]
    names, keys, scales = zip(*numbers_of(h.model, form.names), strict=True)
    points = [form.names.index(key) for key in keys]
    known = np.zeros((states.size, states.size))
    known[np.ix_(points, points)] = _spread(law, list(names), np.array(scales), states[points])
    known += np.diag(form.left_out() ** 2)
    half = Z95 * np.sqrt(np.diag(known))
    if law.site.floats and not form.odd:  # any constant is as good, and a formula may have its own
        known += float(np.ptp(forces)) ** 2
    beside, gone = _replaced(law, found)
    curve, place = own.effect.name, own.place
    at = points_over(seen)
    whole = None
    if at is not None and form.period == 0.0:
        whole = together(h.fitted, curve, place, at[at != 0.0])
    return Curve(
        own, seen, beside, tuple(named(p) for p in gone if follows(p, curve, place)),
        tuple(map(named, gone)), without.cost.total - h.cost.total, h, states, forces,
        forces - half, forces + half, known, whole,
    )  # fmt: skip


def _spread(law: Begun, which: list[int], scales: Floats, s: Floats) -> Floats:
    """Covariance (points, points) of what is free of a table, at states s (points,).

    A law u + f(u) over the command is known but for a scale c, c u + c f(u) = u + g(u): its bends
    are said for the m1 that was fitted, and what c adds to it is a straight line.
    """
    told = covariance(law.h.fitted)[np.ix_(which, which)] * np.outer(scales, scales)
    if law.site.effect != "free_amplifier":
        return told
    own = covariance_beside(law.h.fitted, [0])[np.ix_(which, which)] * np.outer(scales, scales)
    slope = float(s @ told @ s) / float(s @ s) ** 2
    return own + slope * np.outer(s, s)


def as_surface(law: Begun, without: Hypothesis, found: Search) -> Surface:
    """Return a hypothesis whose last effect is over two states, beside what it is held against."""
    h, own = law.h, law.h.model.effects_at(law.h.x)[-1]
    form = form_of(own)
    places, keys, scales = zip(*numbers_of(h.model, form.names), strict=True)
    known = covariance(h.fitted)[np.ix_(places, places)] * np.outer(scales, scales)
    few = dict(zip(form.names, form.left_out().tolist(), strict=True))
    known += np.diag([few[key] ** 2 for key in keys])
    beside, gone = _replaced(law, found)
    return Surface(
        own, states_seen(h, own.at, states_over(own.values)), beside, (), tuple(map(named, gone)),
        without.cost.total - h.cost.total, h, keys, known,
    )  # fmt: skip
