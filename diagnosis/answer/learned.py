"""A law of no name, as an answer says it: its curve, its formula, and what it is worth."""

import itertools
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.adequacy import beyond_noise, oftener_freer
from zwidth.diagnosis.answer.friction_curve import asked_beyond, read_beyond
from zwidth.diagnosis.answer.held_out import free_share, held_out
from zwidth.diagnosis.answer.learned_surface import LearnedSurface, factors
from zwidth.diagnosis.answer.result import HeldOut
from zwidth.diagnosis.answer.words import place_in_words
from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.learning.curves import Learned, laws, replacing
from zwidth.diagnosis.learning.energy import makes_energy
from zwidth.diagnosis.learning.formulas import Formula, formulas
from zwidth.diagnosis.learning.surfaces import Surface, surfaces
from zwidth.diagnosis.learning.tables import law_at
from zwidth.diagnosis.mishaps import Say
from zwidth.diagnosis.noise.family import as_far_as
from zwidth.diagnosis.noise.predictor import Observer
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import Hypothesis, independent, judged, settled
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.selection.searched import FAR_S, Searched, as_found, judge_of
from zwidth.sim.device import Device
from zwidth.sim.readable import with_unit

Floats = NDArray[np.float64]
# Of the error of the names' free runs, below which a law is worth having: nobody would act on less,
# and slow chance forces can make as much (of 13 recordings without a law one got a law that left
# 0.94, `benchmarks.learned_laws`).
BETTER = 0.8
LETTERS = {"free_spring": "q", "free_damper": "v", "free_amplifier": "u", "free_sensor": "q"}
# A spring, a damper, a scale, a constant force or an origin, which are parameters or have names.
STRAIGHT = ("straight line", "line", "offset")
LAWS = 3  # of each horizon, that are held against held-out data
ALIKE = 2  # forms that are not told apart, that a headline says
QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)


@dataclass(frozen=True)
class LearnedLaw:
    """A law, the formulas it looks like (cheapest first, none: of no form), and held-out fits.

    formulas: of the law with the names that follow the same state at its place, where such are
    (`whole`), else of the law. names, law: errors over the motion of free runs on held-out data,
    with the names that are believed alone, and with the law. found: the fit with it.
    """

    curve: Learned
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

    def headline(self, masses: int) -> str:
        """Say it as the first line of an answer: where, over what, of which form, its worth."""
        curve, rotary = self.curve, self.found.final.model.nominal.rotary
        sensor, at = curve.physics.effect.name == "free_sensor", curve.physics.place
        what = {
            "free_amplifier": "something is added to the command",
            "free_sensor": "the reading errs",
        }.get(curve.physics.effect.name, f"a force acts {place_in_words(at, masses)}")
        unit = _length(rotary) if sensor else ("N m" if rotary else "N")
        most = with_unit(float(np.abs(curve.forces).max()), unit, 2)
        alike = " or ".join(_a(f.form.name) for f in self.formulas[:ALIKE])
        looks = f", {self._looks(alike)}" if self.formulas else ""
        own, other = 100.0 * self.law.after, 100.0 * self.names.after
        over = self.over.rstrip(",")
        return (
            f"{what} that has no name in the library: up to {most} over {over}{looks};"
            f" error of free runs on held-out data {own:.2g} % of the motion with it, {other:.2g} %"
            " without"
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
            "free_sensor": "the error of the reading",
        }.get(curve.physics.effect.name, f"a force at {curve.physics.at}")
        looks = f", {self._looks(self.formula)}," if self.formula else ""
        own, other = 100.0 * self.law.after, 100.0 * self.names.after
        return (
            f"learned from it: {what} over {self.over}{looks}; error of free runs on held-out"
            f" data {own:.2g} % of the motion with it, {other:.2g} % without"
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
        return makes_energy(self.curve, self.found.final.model.nominal.rotary)

    def samples(self) -> tuple[Floats, Floats]:
        """Return states and forces (samples,): what the recording says of the law at each sample.

        The law at the state that is predicted, and what its innovations ask for beyond it
        (`friction_curve.asked_beyond`), of the recordings that it was fitted to.
        """
        curve, final, problem = self.curve, self.found.final, self.found.problem
        if curve.physics.effect.name == "free_sensor":
            return curve.seen, law_at(curve.physics, curve.seen) + read_beyond(problem, final)
        at = curve.physics.at if curve.physics.place.kind in ("mass", "link") else "m1"
        states = curve.seen
        return states, law_at(curve.physics, states) + asked_beyond(problem, final, at)

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
            "seen": dict(
                zip(map(str, QUANTILES), np.quantile(curve.seen, QUANTILES).tolist(), strict=True)
            ),
            "formula": self.formula or None,
            "formula_of": "together" if self.whole else "curve",
            "formulas": [
                {"form": f.form.name, "text": f.text(self.letter), "numbers": f.numbers,
                 "chance": f.chance, "cost": f.cost}
                for f in self.formulas
            ],
            "beside": list(curve.names),
            "absorbed": list(curve.absorbed),
            "replaced": list(curve.replaced),
            "together": together
            and {
                "names": list(together.names),
                "points": _points(
                    together.states, together.forces, together.lower, together.upper
                ),
            },
            "energy": self.energy,
            "gained": curve.gained,
            "free_run": {"names": self.names.after, "law": self.law.after},
        }  # fmt: skip


Law = LearnedLaw | LearnedSurface


def _points(*columns: Floats) -> list[dict[str, float]]:
    rows = np.column_stack(columns).tolist()
    return [dict(zip(("state", "force", "lower", "upper"), row, strict=True)) for row in rows]


def _a(form: str) -> str:
    """The name of a form with its article."""
    first = form.split(" ")[0]
    article = {"friction": "", "sum": "the "}.get(first, "an " if first[0] in "aeiou" else "a ")
    return f"{article}{form}"


def _length(rotary: bool) -> str:
    return "rad" if rotary else "m"


def like_what(curve: Learned) -> tuple[tuple[Formula, ...], bool]:
    """Return what a law looks like, and whether it is with the names that follow its state."""
    whole = curve.together
    if whole is not None:
        rubs = any("friction" in name for name in whole.names)
        found = formulas(whole.states, whole.forces, whole.covariance, False, rubs=rubs)
        if found:
            return tuple(found), True
    own = formulas(curve.states, curve.forces, curve.covariance, curve.odd, curve.period)
    return tuple(own), False


def learned(
    device: Device,
    found: Searched,
    judge_by: Sequence[Experiment],
    names: HeldOut,
    say: Say,
    turns: bool = False,
) -> LearnedLaw | None:
    """Learn a law where names do not explain a recording; None where none holds on other data.

    By what the next sample shows, and by what shows over a longer horizon: where noise of slow
    forces is what a hypothesis believes in, the next sample tells little of a law, and a motion of
    half a second tells much. The likeliest of each first; of those that hold on held-out data that
    which errs less there, and where neither does the next of each, as of names. names: free runs on
    held-out data of what is named. turns: only what repeats, in the place of a ripple that is
    named.
    """
    say("learning what repeats" if turns else "no known effect explains it: learning a law")
    hopeful = partial(_hopeful, judge_by, names)
    horizons = [(search, laws(search, say, turns, hopeful)) for search in _horizons(found)]
    for _ in range(LAWS):
        told = [
            one
            for search, each in horizons
            if (curve := next(each, None)) is not None
            and (one := _judged(device, search, curve, found, judge_by, names, say)) is not None
        ]
        # What a horizon taught may hold on what it was taught by alone.
        if told:
            return min(told, key=lambda law: law.law.after)
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
    if not found.tried.effort.surfaces:
        return None
    left = names if one is None else one.law
    if not beyond_noise(left.after, left.noise_floor):
        return None
    say("checking whether what is left depends on two quantities together")
    hopeful = partial(_hopeful, judge_by, left)
    told: list[LearnedSurface] = []
    for search in _horizons(found):
        than = [search.best, search.plain]
        if one is not None and (h := _alike(search, one.curve.hypothesis)) is not None:
            than.append(h)
        for forms in surfaces(search, than, say, hopeful):
            held = False
            for surface in forms:
                law = _judged_surface(device, search, surface, found, judge_by, left, say)
                if law is not None and law.law.after < law.law.noise_floor:
                    return law  # nothing is left to be said
                held = held or law is not None
                told += [] if law is None else [law]
            if held:
                break
    return min(told, key=lambda law: law.law.after, default=None)


def _judged_surface(
    device: Device,
    search: Search,
    surface: Surface,
    found: Searched,
    judge_by: Sequence[Experiment],
    left: HeldOut,
    say: Say,
) -> LearnedSurface | None:
    """A surface as held-out data judge it; None where they speak against it."""
    h = surface.hypothesis
    fit = _held_out_fit(device, search, h, found, judge_by, left, say)
    return None if fit is None else LearnedSurface(surface, factors(surface), left, *fit)


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
) -> LearnedLaw | None:
    """Return a law in the place of names that explain a recording; None where these stand.

    What is named may be a sum of names near a law that is in no library. As `learned`.
    """
    if len(found.tried.best.model.effects) < 2:
        return None
    say("checking whether one learned law explains as much as these effects together")
    hopeful = partial(_hopeful, judge_by, names)
    for curve in itertools.islice(replacing(found.tried, say, hopeful), LAWS):
        law = _judged(device, found.tried, curve, found, judge_by, names, say)
        if law is not None:
            return law
    return None


def _hopeful(judge_by: Sequence[Experiment], names: HeldOut, h: Hypothesis) -> bool:
    """Whether free runs of a table of all its points err as little as those of a law must."""
    return free_share(h.model, h.x, judge_of(h), judge_by) < BETTER * names.after


def _judged(
    device: Device,
    search: Search,
    curve: Learned,
    found: Searched,
    judge_by: Sequence[Experiment],
    names: HeldOut,
    say: Say,
) -> LearnedLaw | None:
    """A law as held-out data judge it; None where they speak against it, or it is a line."""
    fit = _held_out_fit(device, search, curve.hypothesis, found, judge_by, names, say)
    if fit is None:
        return None
    looks, both = like_what(curve)
    if looks and looks[0].form.name in STRAIGHT:  # within a band that holds anything
        say("the learned law is a straight line, which is a linear parameter: dropped")
        return None
    return LearnedLaw(curve, looks, both, names, *fit)


def _held_out_fit(
    device: Device,
    search: Search,
    h: Hypothesis,
    found: Searched,
    judge_by: Sequence[Experiment],
    names: HeldOut,
    say: Say,
) -> tuple[HeldOut, Searched] | None:
    """Free runs on held-out data with a law, and the fit; None where they are no better by it."""
    with_law = as_found(device, replace(search, best=h))
    free = held_out(device, with_law, judge_by)[1]
    if _better(h, with_law, found, judge_by, names, free):
        return free, with_law
    say("the learned law does not predict the held-out data: dropped")
    return None


def _better(
    h: Hypothesis,
    with_law: Searched,
    found: Searched,
    judge_by: Sequence[Experiment],
    names: HeldOut,
    free: HeldOut,
) -> bool:
    """Whether free runs on held-out data are better with a law than without."""
    near = h.family.whitening
    ratio = free.after / names.after if names.after > 0.0 else 1.0
    if ratio >= BETTER:
        return False
    return near or oftener_freer(_pair(with_law), _pair(found), judge_by)


def _pair(found: Searched) -> tuple[Fitted, Observer]:
    return found.final, found.judge


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
