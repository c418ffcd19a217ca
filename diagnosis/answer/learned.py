"""A law of no name, as an answer says it: its curve or surface, its formula, and what it is worth.

Of two tables each law is known with the covariance of the fit, and looks like a formula of its own:
"a sine of the position times a parabola of the velocity", or "shifted by" it. A grid is of no form.
"""

import itertools
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.adequacy import oftener_freer
from zwidth.diagnosis.answer.friction_curve import asked_beyond, read_beyond
from zwidth.diagnosis.answer.headline import place_in_words
from zwidth.diagnosis.answer.held_out import free_share, held_out
from zwidth.diagnosis.answer.result import HeldOut
from zwidth.diagnosis.fitting.uncertainty import Z95
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.laws.forms import GridForm, TablesForm, told
from zwidth.diagnosis.laws.formula import Formula, formulas
from zwidth.diagnosis.laws.learn import laws, replacing, surfaces
from zwidth.diagnosis.laws.learned import Curve, Surface, damper_at
from zwidth.diagnosis.laws.points import law_at
from zwidth.diagnosis.laws.start import states_seen
from zwidth.diagnosis.mishaps import Say
from zwidth.diagnosis.noise.family import as_far_as
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import Hypothesis, independent, judged, settled
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.selection.searched import FAR_S, Searched, as_found, judge_of
from zwidth.diagnosis.settings import LAWS
from zwidth.sim.device import Device
from zwidth.sim.readable import with_unit

Floats = NDArray[np.float64]
LETTERS = {
    "free_spring": "q", "free_damper": "v", "free_amplifier": "u", "free_sensor": "q",
    "position": "q", "velocity": "v", "command": "u",
}  # fmt: skip
# A spring, a damper, a scale, a constant force or an origin, which are parameters or have names.
STRAIGHT = ("straight line", "line", "offset")


@dataclass(frozen=True)
class LearnedLaw:
    """A law over one state, the formulas it looks like, and held-out fits.

    formulas: the cheapest first, none for no form: of the law with the names that follow the same
    state at its place, where such are (`whole`), else of the law. names, law: errors over the
    motion of free runs on held-out data, with the names that are believed alone, and with the law.
    found: the fit with it.
    """

    curve: Curve
    formulas: tuple[Formula, ...]
    whole: bool
    names: HeldOut
    law: HeldOut
    found: Searched

    @property
    def letter(self) -> str:
        """What the formulas call the state."""
        return LETTERS[self.curve.physics.effect.name]

    @property
    def formula(self) -> str:
        """What it looks like, "" for no form."""
        return self.formulas[0].text(self.letter) if self.formulas else ""

    @property
    def over(self) -> str:
        """What it follows, and what it repeats by."""
        curve, rotary = self.curve, self.found.final.model.nominal.rotary
        if curve.period == 0.0:
            return curve.over
        return f"{curve.over}, repeating every {with_unit(curve.period, _length(rotary), 4)},"

    def headline(self, masses: int, rotary: bool) -> str:
        """Say it as the first line of an answer: where, over what, of which form, its worth."""
        curve = self.curve
        sensor, at = curve.physics.effect.name == "free_sensor", curve.physics.place
        what = {
            "free_amplifier": "something is added to the command",
            "free_sensor": "the reading errs",
        }.get(curve.physics.effect.name, f"a force acts {place_in_words(at, masses)}")
        unit = _length(rotary) if sensor else ("N m" if rotary else "N")
        most = with_unit(float(np.abs(curve.forces).max()), unit, 2)
        alike = " or ".join(_a(f.form.name) for f in self.formulas[:2])
        looks = f", {self._looks(alike)}" if self.formulas else ""
        return (
            f"{what} that has no name in the library: up to {most} over {self.over.rstrip(',')}"
            f"{looks}; with it free runs on held-out data err {_errs(self.law)} of the motion,"
            f" and {_errs(self.names)} without"
        )

    def _looks(self, like: str) -> str:
        together = self.curve.together
        if not self.whole or together is None:
            return f"which looks like {like}"
        return f"which together with {' and '.join(together.names)} looks like {like}"

    @property
    def sentence(self) -> str:
        """Say what was learned, and what it is worth."""
        curve = self.curve
        what = {
            "free_amplifier": "what is added to the command",
            "free_sensor": "what the reading errs by",
        }.get(curve.physics.effect.name, f"a force at {curve.physics.at}")
        looks = f", {self._looks(self.formula)}," if self.formula else ""
        return (
            f"learned from it: {what} over {self.over}{looks} with which free runs on held-out"
            f" data err {_errs(self.law)} of the motion ({_errs(self.names)} without)"
        )

    @property
    def absorbed(self) -> str:
        """Say which names were part of the curve, "" for none."""
        gone = self.curve.absorbed
        if not gone:
            return ""
        was = "was" if len(gone) == 1 else "were"
        return f"{' and '.join(gone)} {was} part of this curve, and not needed beside it"

    @property
    def size(self) -> str:
        """How it stands in a device file."""
        return f"a table of {self.curve.states.size} points"

    @property
    def caption(self) -> str:
        """What its picture shows."""
        whole = self.curve.together
        both = "" if whole is None else (
            " The second curve is all that follows the same state there: the table and"
            f" {' and '.join(whole.names)}."
        )  # fmt: skip
        return (
            "The curve through its points with the 95 % band of each, and behind it what each"
            " sample of the recording asks for beyond it; below, how often the recording was there."
            " The band also covers what a damper, a spring or another position of rest could take"
            f" over from the curve.{both}"
        )

    @property
    def others(self) -> list[str]:
        """Formulas that its band does not tell from the first."""
        return [f"{f.form.name} ({f.text(self.letter)})" for f in self.formulas[1:4]]

    @property
    def energy(self) -> str:
        """Say whether it ever makes energy."""
        return self.curve.energy(self.found.final.model.nominal.rotary)

    def samples(self) -> tuple[Floats, Floats]:
        """Return states and forces (samples,): what the recording says of the law at each sample.

        The law at the state that is predicted, and what its innovations ask for beyond it
        (`friction_curve.asked_beyond`), of the recordings that it was fitted to.
        """
        curve, final, problem = self.curve, self.found.final, self.found.problem
        given = law_at(curve.physics, curve.seen)
        if curve.physics.effect.name == "free_sensor":
            return curve.seen, given + read_beyond(problem, final)
        at = curve.physics.at if curve.physics.place.kind in ("mass", "link") else "m1"
        return curve.seen, given + asked_beyond(problem, final, at)

    def as_json(self) -> dict[str, Any]:
        """Return the JSON of `zwidth diagnose`."""
        curve, together = self.curve, self.curve.together
        return {
            "effect": curve.physics.effect.name,
            "at": curve.physics.at,
            "over": curve.over,
            "odd": curve.odd,
            "period": curve.period or None,
            "one_way": curve.one_way,
            "points": _points(curve.states, curve.forces, curve.lower, curve.upper),
            "seen": _quantiles(curve.seen),
            "formula": self.formula or None,
            "formula_of": "together" if self.whole else "curve",
            "formulas": _formulas_json(self.formulas, self.letter),
            "together": together
            and {
                "names": list(together.names),
                "points": _points(together.states, together.forces, together.lower, together.upper),
            },
            **_common_json(self),
        }


@dataclass(frozen=True)
class LearnedSurface:
    """A law over two states, what the laws of its tables look like, and held-out fits.

    forms: of the first and of the second state, the cheapest first; () for a grid, and empty for a
    law of no form. names, law: errors over the motion of free runs on held-out data, with the names
    and the law of one state that are believed, and with the surface. found: the fit with it.
    """

    curve: Surface
    forms: tuple[tuple[Formula, ...], ...]
    names: HeldOut
    law: HeldOut
    found: Searched

    @property
    def over(self) -> str:
        """What it follows, in words."""
        return " and ".join(self.curve.over)

    @property
    def formula(self) -> str:
        """What it looks like, "" for no form."""
        if not self.forms or not all(self.forms):
            return ""
        first, second = (LETTERS[state] for state in self.curve.states)
        law, other = self.forms[0][0], self.forms[1][0].text(second)
        if self.curve.shifts:
            return f"{law.text('s')}, s = {first} + {other}".replace("+ -", "- ")
        return f"({law.text(first)}) ({other})"

    def formula_at(self, first: Floats, second: Floats) -> Floats:
        """Return what the formula makes of states (...,), where there is one."""
        law, other = (form[0] for form in self.forms)
        if self.curve.shifts:
            return law.at(first + other.at(second))
        return law.at(first) * other.at(second)

    @property
    def form(self) -> str:
        """Its form in words: of which laws it is made, "" for a grid."""
        each = [f"a {form[0].form.name}" if form else "a law" for form in self.forms]
        does = " shifted by " if self.curve.shifts else " times "
        return does.join(
            f"{law} of {state}" for law, state in zip(each, self.curve.over, strict=False)
        )

    @property
    def absorbed(self) -> str:
        """Which names were part of it: of a surface, those are said to be replaced."""
        return ""

    def headline(self, masses: int, rotary: bool) -> str:
        """Say it as the first line of an answer: where, over what, of which form, its worth."""
        curve = self.curve
        most = with_unit(float(np.abs(curve.at(*curve.seen.T)).max()), "N m" if rotary else "N", 2)
        looks = f", which looks like {self.form}" if self.forms else ""
        return (
            f"a force acts {place_in_words(curve.physics.place, masses)} that has no name in the"
            f" library: up to {most} over {self.over} together{looks}; {self._worth}"
        )

    @property
    def sentence(self) -> str:
        """Say what was learned, and what it is worth."""
        looks = f", which looks like {self.formula}" if self.formula else ""
        return (
            f"learned from it: a force at {self.curve.physics.at} over {self.over} together"
            f"{looks}; {self._worth}"
        )

    @property
    def _worth(self) -> str:
        return (
            f"with it free runs on held-out data err {_errs(self.law)} of the motion, and"
            f" {_errs(self.names)} without"
        )

    @property
    def size(self) -> str:
        """How it stands in a device file."""
        first, second = (axis.size for axis in self.curve.form.axes)
        if isinstance(self.curve.form, TablesForm):
            return f"two tables of {first} and {second} points"
        return f"a table of {first} rows and {second} columns"

    @property
    def caption(self) -> str:
        """What its picture shows."""
        first, second = self.curve.over
        return (
            "Above the force over both states where the recording was, with its samples; below"
            f" over {first} at some of {second}, and over {second} at some of {first}, with the"
            " 95 % band, in which a damper, a spring and a scale of the command are too."
        )

    @property
    def others(self) -> list[str]:
        """Formulas that its band does not tell from the first, of either law."""
        return [
            f"{f.form.name} ({f.text(LETTERS[state])}) of {state}"
            for form, state in zip(self.forms, self.curve.states, strict=False)
            for f in form[1:3]
        ]

    @property
    def energy(self) -> str:
        """Say whether it ever makes energy along what was recorded, with its place's damper."""
        final, problem, at = self.found.final, self.found.problem, self.curve.physics.at
        h = replace(self.curve.hypothesis, experiments=problem.experiments)
        v = states_seen(h, at, ("velocity",), predicted_states(problem, final))[:, 0]
        own = self.curve.at(*self.curve.seen.T) * v
        whole = own - damper_at(self.curve) * v * v
        mean = with_unit(abs(float(own.mean())), "W", 2)
        does = "takes" if own.mean() <= 0.0 else "feeds in"
        said = f"by itself it {does} {mean} on the average of what was recorded"
        if float(whole.max()) <= 1e-3 * float(np.abs(whole).max()):
            return f"{said}, and with its damper makes energy at no time"
        return f"{said}, and with its damper feeds in up to {with_unit(float(whole.max()), 'W', 2)}"

    def as_json(self) -> dict[str, Any]:
        """Return the JSON of `zwidth diagnose`."""
        curve = self.curve
        seen = dict(zip(curve.states, map(_quantiles, curve.seen.T), strict=True))
        return {
            "effect": curve.physics.effect.name,
            "at": curve.physics.at,
            "over": self.over,
            "states": list(curve.states),
            **(_grid_json(curve) if isinstance(curve.form, GridForm) else _tables_json(self)),
            "seen": seen,
            "formula": self.formula or None,
            "formulas": [self._formula_json()] if self.formula else [],
            **_common_json(self),
        }

    def _formula_json(self) -> dict[str, Any]:
        """The likeliest formula of two tables, of its two parts."""
        return {
            "form": "shift" if self.curve.shifts else "product",
            "text": self.formula,
            "factors": [
                {"state": state, "form": form[0].form.name, "numbers": form[0].numbers}
                for state, form in zip(self.curve.states, self.forms, strict=True)
            ],
        }


def _errs(free: HeldOut) -> str:
    return f"{100.0 * free.after:.2g} %"


def _a(form: str) -> str:
    """The name of a form with its article."""
    first = form.split(" ")[0]
    article = {"friction": "", "sum": "the "}.get(first, "an " if first[0] in "aeiou" else "a ")
    return f"{article}{form}"


def _length(rotary: bool) -> str:
    return "rad" if rotary else "m"


def _common_json(law: LearnedLaw | LearnedSurface) -> dict[str, Any]:
    """What is said of a law whatever it is over."""
    return {
        "beside": list(law.curve.names),
        "absorbed": list(law.curve.absorbed),
        "replaced": list(law.curve.replaced),
        "energy": law.energy,
        "gained": law.curve.gained,
        "free_run": {"names": law.names.after, "law": law.law.after},
    }


def _points(*columns: Floats, made: str = "force") -> list[dict[str, float]]:
    rows = np.column_stack(columns).tolist()
    return [dict(zip(("state", made, "lower", "upper"), row, strict=True)) for row in rows]


def _quantiles(states: Floats) -> dict[str, float]:
    shares = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)
    return dict(zip(map(str, shares), np.quantile(states, shares).tolist(), strict=True))


def _formulas_json(found: Sequence[Formula], letter: str) -> list[dict[str, Any]]:
    return [
        {"form": f.form.name, "text": f.text(letter), "numbers": f.numbers, "chance": f.chance,
         "cost": f.cost}
        for f in found
    ]  # fmt: skip


def _tables_json(law: LearnedSurface) -> dict[str, Any]:
    """Both tables with their bands, and what they look like."""
    form, found = law.curve.form, dict[str, Any]()
    assert isinstance(form, TablesForm)
    both = zip(("first", "second"), form.axes, form.laws, form.both, law.forms, law.curve.states,
               strict=True)  # fmt: skip
    for key, at, made, names, looks, state in both:
        half = Z95 * np.sqrt(np.maximum(np.diag(law.curve.of(names)), 0.0))
        found[key] = {
            "points": _points(at, made, made - half, made + half, made="law"),
            "formulas": _formulas_json(looks, LETTERS[state]),
        }
    return found


def _grid_json(curve: Surface) -> dict[str, Any]:
    """The grid with the band of what was seen of it, null where nothing was."""
    form = curve.form
    assert isinstance(form, GridForm)
    half = curve.half(*np.meshgrid(*form.axes, indexing="ij"))
    seen, forces = told(curve.seen, form.rows, form.columns), form.grid.values

    def of_what_is_told(values: Floats) -> list[list[float | None]]:
        return np.where(seen, values, None).tolist()  # pyright: ignore[reportArgumentType,reportCallIssue]

    return {
        "rows": form.rows.tolist(),
        "columns": form.columns.tolist(),
        "table": forces.tolist(),
        "lower": of_what_is_told(forces - half),
        "upper": of_what_is_told(forces + half),
    }


def like_what(curve: Curve) -> tuple[tuple[Formula, ...], bool]:
    """Return what a law looks like, and whether it is with the names that follow its state."""
    whole = curve.together
    if whole is not None:
        rubs = any("friction" in name for name in whole.names)
        found = formulas(whole.states, whole.forces, whole.covariance, False, rubs=rubs)
        if found:
            return tuple(found), True
    own = formulas(curve.states, curve.forces, curve.covariance, curve.odd, curve.period)
    return tuple(own), False


def factors(curve: Surface) -> tuple[tuple[Formula, ...], ...]:
    """Return what either law of two tables looks like, () for a grid.

    A shift may have another constant, since nothing tells from where it is counted.
    """
    form = curve.form
    if not isinstance(form, TablesForm):
        return ()
    first, second = (curve.of(names) for names in form.both)
    if curve.shifts:
        second = second + (10.0 * np.ptp(form.others)) ** 2
    return (
        tuple(formulas(form.states, form.forces, first, odd=False)),
        tuple(formulas(form.beside, form.others, second, odd=False)),
    )


@dataclass(frozen=True)
class _Judge:
    """What laws are held against: the answer by names, and what its free runs err by.

    names: errors over the motion of free runs on held-out data, of what is believed without a law.
    """

    device: Device
    found: Searched
    judge_by: Sequence[Experiment]
    names: HeldOut
    say: Say

    def hopeful(self, h: Hypothesis) -> bool:
        """Whether free runs of a law before its points were refined err as little as they must."""
        share = free_share(h.model, h.x, judge_of(h), self.judge_by)
        return share < LAWS.better * self.names.after

    def fit(self, search: Search, h: Hypothesis) -> tuple[HeldOut, Searched] | None:
        """Free runs on held-out data with a law, and the fit; None where they are no better.

        Where noise of slow forces is what a hypothesis believes in, they must be freer oftener too.
        """
        with_law = as_found(self.device, replace(search, best=h))
        free = held_out(self.device, with_law, self.judge_by)[1]
        better = free.after < LAWS.better * self.names.after
        if better and not h.family.whitening:
            own, other = ((one.final, one.judge) for one in (with_law, self.found))
            better = oftener_freer(own, other, self.judge_by)
        if better:
            return free, with_law
        self.say("the law that was learned does not hold on held-out data")
        return None

    def law(self, search: Search, curve: Curve) -> LearnedLaw | None:
        """A law as held-out data judge it; None where they speak against it, or it is a line."""
        fit = self.fit(search, curve.hypothesis)
        if fit is None:
            return None
        looks, both = like_what(curve)
        if looks and looks[0].form.name in STRAIGHT:  # within a band that holds anything
            self.say("what was learned looks like a straight line: that is no law")
            return None
        return LearnedLaw(curve, looks, both, self.names, *fit)

    def surface(self, search: Search, surface: Surface) -> LearnedSurface | None:
        """A surface as held-out data judge it; None where they speak against it."""
        fit = self.fit(search, surface.hypothesis)
        return None if fit is None else LearnedSurface(surface, factors(surface), self.names, *fit)


def learned(
    device: Device,
    found: Searched,
    judge_by: Sequence[Experiment],
    names: HeldOut,
    say: Say,
    turns: bool = False,
    most: int = 3,
) -> LearnedLaw | None:
    """Learn a law where names do not explain a recording; None where none holds on other data.

    By what the next sample shows, and by what shows over a longer horizon: where noise of slow
    forces is what a hypothesis believes in, the next sample tells little of a law, and a motion of
    half a second tells much. The likeliest of each first; of those that hold on held-out data that
    which errs less there, and where neither does the next of each, as of names. names: free runs on
    held-out data of what is named. turns: only what repeats, in the place of a ripple that is
    named. most: laws of each horizon that are held against held-out data.
    """
    say("learning what repeats" if turns else "no name explains it: learning a law")
    judge = _Judge(device, found, judge_by, names, say)
    horizons = [(search, laws(search, say, turns, judge.hopeful)) for search in _horizons(found)]
    for _ in range(most):
        asked = [(search, next(each, None)) for search, each in horizons]
        laws_told = [judge.law(search, curve) for search, curve in asked if curve is not None]
        # What a horizon taught may hold on what it was taught by alone.
        if kept := [law for law in laws_told if law is not None]:
            return min(kept, key=lambda law: law.law.after)
    return None


def learned_over_two(
    device: Device,
    found: Searched,
    judge_by: Sequence[Experiment],
    names: HeldOut,
    one: LearnedLaw | None,
    say: Say,
) -> LearnedSurface | None:
    """Learn a law over two states; None where none holds on other data, or `Effort` asks for none.

    Where free runs err more by what is missing than by noise still, with a law of one state where
    one was learned. As `learned`, and held against that law as well.
    """
    left = names if one is None else one.law
    if not found.tried.effort.surfaces or not left.after**2 > LAWS.left * left.noise_floor**2:
        return None
    say("asking whether what is left follows two states together")
    judge = _Judge(device, found, judge_by, left, say)
    kept: list[LearnedSurface] = []
    for search in _horizons(found):
        than = [search.best, search.plain]
        if one is not None and (h := _alike(search, one.curve.hypothesis)) is not None:
            than.append(h)
        each = surfaces(search, than, say, judge.hopeful)
        for _, forms in itertools.groupby(each, lambda s: (s.physics.at, frozenset(s.states))):
            own: list[LearnedSurface] = []
            for law in (judge.surface(search, surface) for surface in forms):
                if law is not None and law.law.after < law.law.noise_floor:
                    return law  # nothing is left to be said
                own += [] if law is None else [law]
            kept += own
            if own:
                break
    return min(kept, key=lambda law: law.law.after, default=None)


def _alike(search: Search, h: Hypothesis) -> Hypothesis | None:
    """A hypothesis under the noise of another search's family, fitted; None where none follows."""
    family = search.best.family
    if h.family == family:
        return h
    with suppress(NoObserver):
        return settled(judged(h.experiments, h.model, h.x, family))
    return None


def replacement(
    device: Device,
    found: Searched,
    judge_by: Sequence[Experiment],
    names: HeldOut,
    say: Say,
    most: int = 3,
) -> LearnedLaw | None:
    """Return a law in the place of names that explain a recording; None where these stand.

    What is named may be near a law that is in no library. As `learned`.
    """
    say("asking whether one law of no name explains it better than these names")
    judge = _Judge(device, found, judge_by, names, say)
    for curve in itertools.islice(replacing(found.tried, say, judge.hopeful), most):
        if (law := judge.law(found.tried, curve)) is not None:
            return law
    return None


def _horizons(found: Searched) -> Iterator[Search]:
    """The search as it was judged, and what it found judged over a longer horizon."""
    tried = found.tried
    yield tried
    if not tried.best.family.whitening:
        return
    ahead = as_far_as(FAR_S, tried.best.experiments)
    with suppress(NoObserver):
        best = tried.best
        family = independent(judged(best.experiments, best.model, best.x, ahead), FAR_S).family
        plain, best = (
            settled(judged(h.experiments, h.model, h.x, family)) for h in (tried.plain, tried.best)
        )
        yield replace(tried, plain=plain, best=best, tried={})
