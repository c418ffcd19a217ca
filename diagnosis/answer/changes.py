"""Changes of the device during a recording, in the form of the answer.

Every answer is asked for changes (`learning.changing`) before its held-out data are finally opened.
A change in a fitted parameter is named if it is believed over every constant model that was tried,
not only over the answer without it (a damper that settles may stand for friction that was
rejected), and if later free runs on held-out data err no more with it than without. A change within
the held-out data is dated from the whole recording; data after it then no longer judge the answer.
The augmented device is the device at the end of the recording, with which later recordings are
compared.
"""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.findings import UNITS, half_width
from zwidth.diagnosis.answer.held_out import held_out
from zwidth.diagnosis.answer.result import Estimate
from zwidth.diagnosis.answer.words import (
    listed,
    own_parameter,
    parameter_in_words,
    place_in_words,
    said,
    short,
    the_effect,
    times_in_words,
)
from zwidth.diagnosis.fitting.uncertainty import Z95, covariance
from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.learning.changing import (
    CUT,
    DRIFT,
    EACH,
    FOLLOWS,
    RUN,
    SETTLES,
    SHORTEST,
    STEP,
    Suspect,
    Varied,
    course,
    groups,
    share_at,
    share_of,
    suspected,
    varied,
    with_varying,
)
from zwidth.diagnosis.mishaps import Say, attempt
from zwidth.diagnosis.model.parameters import Model, Parameter, values_of
from zwidth.diagnosis.noise.predictor import SETTLING, window
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.evidence import ALPHA
from zwidth.diagnosis.selection.hypothesis import Hypothesis, against, judged, priced
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.selection.searched import Searched, as_found
from zwidth.diagnosis.settings import CHANGES
from zwidth.shown import Valued
from zwidth.sim.device import Device
from zwidth.sim.place import place_at
from zwidth.sim.readable import plain

Floats = NDArray[np.float64]
RIVALS = 8  # hypotheses of the search that are fitted anew with a change
FINE = 400  # points of a line
PARTS = 8  # into which held-out data are cut during a drift
RUNS = 2  # free runs before a change in held-out data, with which these still judge
# Courses whose names are not plain words -> their words.
AS_WELL = {RUN: "one recording unlike the others", EACH: "another value in each recording"}


@dataclass(frozen=True)
class Windows(Valued):
    """A parameter in each window of the recordings: middle [s], value, 95 % interval.

    Recordings follow one another; times (windows,) count from the first sample of the first.
    changed: the values of the fitted change at `line` (points,) [s]; dated: 95 % interval of the
    time of a step [s], None if it is not within a recording.
    """

    times: Floats
    values: Floats
    lower: Floats
    upper: Floats
    line: Floats
    changed: Floats
    dated: tuple[float, float] | None


@dataclass(frozen=True)
class Change(Valued):
    """One parameter that changes.

    parameter: its name in `linear_refit`, or in an effect at a place. shape: "step", at `at` [s] of
    a recording with the 95 % interval `between`; "drift", from the first sample to the last;
    "settling", with the time constant `rate` [s] and its interval `rate_between`; "run", in one
    recording only; "follows", linearly with the quantity `covariate` in `covariate_unit`, which
    goes from one of `covariate_ends` to the other; "each recording", with the values `each` by the
    names of the recordings. before, after: the parameter's values; by: their difference, which may
    be known far better than either if another parameter does nearly the same. as_well: other
    courses that explain it equally well. gained: decrease of -2 ln likelihood, less all penalties.
    free_run: errors of free runs on held-out data, over the motion, without the change and with it;
    None if the change itself is held out. windows: the value in each part of the recording by
    itself. against: if a constant force changes, it is half of `parameter` minus this parameter;
    else None.
    """

    parameter: str
    effect: str | None
    place: str | None
    shape: str
    recording: str
    at: float | None
    between: tuple[float, float] | None
    rate: float | None
    before: Estimate
    after: Estimate
    by: Estimate
    gained: float
    free_run: tuple[float, float] | None
    masses: int
    windows: Windows
    rate_between: tuple[float, float] | None = None
    covariate: str | None = None
    covariate_unit: str = ""
    covariate_ends: tuple[float, float] | None = None
    each: tuple[tuple[str, Estimate], ...] = ()
    as_well: tuple[str, ...] = ()
    against: str | None = None

    @property
    def of(self) -> str:
        """The parameter's name in a model (`model.parameters.Parameter.name`)."""
        own = self.parameter
        return own if self.effect is None else f"{self.effect}@{self.place}.{own}"

    @property
    def what(self) -> str:
        """The parameter in words."""
        if self.effect is None or self.place is None:
            return parameter_in_words(self.parameter, self.after.unit)
        where = place_in_words(place_at(self.place), self.masses)
        if self.against is not None:
            return f"the constant force {where}"
        return f"the {own_parameter(self.parameter)} of {the_effect(self.effect)} {where}"

    @property
    def sentence(self) -> str:
        """Say what changed, by how much, and when."""
        if not self.as_well:
            return self._told(said)
        others = [AS_WELL.get(one, one) for one in self.as_well]
        named = listed(others, "or", len(others))
        return f"{self._told(said)}; {named} would explain it equally well"

    @property
    def short(self) -> str:
        """Say what changed, without intervals, and without the time if that is uncertain."""
        if not self.as_well:
            return self._told(short)
        if self.shape not in (STEP, DRIFT, SETTLES):
            return f"{self.what} is not constant"
        return f"{self.what} {self._rose} by {short(_size(self.by))}"

    @property
    def _rose(self) -> str:
        return "rose" if self.by.value > 0.0 else "fell"

    def _told(self, say: Callable[[Estimate], str]) -> str:
        """Say what changed, by how much, and when; say: of a value, with or without intervals."""
        how, ends, briefly = self._rose, "", say is short
        by, first, last = say(_size(self.by)), say(self.before), say(self.after)
        if self.shape == RUN:
            if self._apart:
                return f"{self.what} was {first} in {self.recording}, and {last} in all others"
            more = "more" if self.by.value < 0.0 else "less"
            where = "" if briefly else f", where it was {last}"
            return f"{self.what} was {by} {more} in {self.recording} than in all others{where}"
        if self.each:
            values = listed([f"{say(value)} in {name}" for name, value in self.each])
            return f"{self.what} differs from recording to recording: {values}"
        if self.covariate is not None and self.covariate_ends is not None:
            how = f"depends on {self.covariate}: it {how}"
            low, high = (f"{plain(v, 3)} {self.covariate_unit}" for v in self.covariate_ends)
            when = f"between {low.rstrip()} and {high.rstrip()}"
        elif self.shape == SETTLES:
            how, when = "settled", f"with a time constant of {plain(self.rate or 0.0, 2)} s"
            if self.rate_between is not None:
                low, high = (plain(v, 2) for v in self.rate_between)
                ends = f" ({low} to {high} s)"
        elif self.shape == DRIFT:
            how, when = "drifted", "over the whole time"
        elif self.at is None or self.between is None:
            when = f"from {self.recording} on"
        else:
            at, low, high = times_in_words(self.at, self.between)
            when, ends = f"at {at} s", f" ({low} to {high} s)"
        when += "" if briefly else ends
        if self._apart:
            return f"{self.what} {how} from {first} to {last} {when}"
        before = "" if briefly else f"; at first, it was {first}"
        return f"{self.what} {how} by {by} {when}{before}"

    @property
    def _apart(self) -> bool:
        """Whether the intervals of both values do not overlap."""
        return self.before.upper < self.after.lower or self.after.upper < self.before.lower

    @property
    def may_be_none(self) -> bool:
        """Whether the interval of the change contains zero, though the fit is better with it.

        A parameter that has little influence after a change (friction at rest in a short part) may
        seem to have any value: it "rose by 100 mN m (-500 to 100)" where friction was constant.
        """
        return self.shape != EACH and self.by.lower <= 0.0 <= self.by.upper

    def as_json(self) -> dict[str, Any]:
        """Return the JSON of `zwidth diagnose`."""
        names = "constant", "changing"
        free = self.free_run and dict(zip(names, self.free_run, strict=True))
        return {
            "parameter": self.parameter,
            "effect": self.effect,
            "at": self.place,
            "against": self.against,
            "shape": self.shape,
            "recording": self.recording,
            "at_s": self.at,
            "at_s_ci95": self.between and list(self.between),
            "time_constant_s": self.rate,
            "time_constant_s_ci95": self.rate_between and list(self.rate_between),
            "follows": self.covariate,
            "follows_unit": self.covariate_unit or None,
            "follows_from_to": self.covariate_ends and list(self.covariate_ends),
            "recordings": {name: value.as_json() for name, value in self.each},
            "as_well": list(self.as_well),
            "before": self.before.as_json(),
            "after": self.after.as_json(),
            "by": self.by.as_json(),
            "gained": self.gained,
            "free_run": free,
            "windows": {
                name: getattr(self.windows, name).tolist()
                for name in ("times", "values", "lower", "upper")
            },
        }


def _size(by: Estimate) -> Estimate:
    """The absolute value of a difference."""
    if by.value > 0.0:
        return by
    return Estimate(-by.value, -by.upper, -by.lower, by.unit)


def changing(
    device: Device, found: Searched, taken: Taken, say: Say
) -> tuple[Searched, Taken, tuple[Change, ...]]:
    """Return the search with its changes, the recordings that judge it, and the changes."""
    changes: list[Change] = []
    for _ in range(CHANGES.most):
        step = attempt("changes", "", partial(_one_more, device, found, taken, say))
        if step is None:
            break
        found, taken, change = step
        changes.append(change)
    if not changes:
        later = attempt("changes", "in held-out data", partial(_held_out, device, found, taken))
        if later is not None:
            taken, change = later
            changes.append(change)
    for change in changes:
        say(change.sentence)
    return found, taken, tuple(changes)


def _one_more(
    device: Device, found: Searched, taken: Taken, say: Say
) -> tuple[Searched, Taken, Change] | None:
    """A change within the fitted data that held-out data confirm, or None."""
    best = found.tried.best
    suspect = suspected(best)
    if suspect is None:
        return None
    where, _, name = suspect.of.replace("@", " at ").rpartition(".")
    what = f"the {name.replace('_', ' ')} of {where}" if where else name
    if suspect.against:
        what = f"the constant force at {where.partition(' at ')[2]}"
    say(f"checking whether {what} stays constant")
    new = varied(best, suspect)
    if new is None or not _over_all_that_stays(found.tried, new, new.hypothesis):
        return None
    judge_by = tuple(p for e in taken.judge_by for p in _as_it_goes_on(e, best.experiments, new))
    other = as_found(device, replace(found.tried, best=new.hypothesis))
    (_, without), (_, with_it) = (
        held_out(device, found, taken.judge_by), held_out(device, other, judge_by)
    )  # fmt: skip
    if not with_it.after <= without.after:
        say("a change would improve the fit but not the prediction of held-out data: dropped")
        return None
    tried = _rivals_anew(found.tried, new)
    if not _over_all_that_stays(found.tried, new, tried.best):
        say("a changing parameter explains no more than a constant one: dropped")
        return None
    change = change_of(new, best.experiments, (without.after, with_it.after))
    if change.may_be_none:
        say("a change whose interval contains zero: dropped")
        return None
    with_rivals = as_found(device, tried)
    again = replace(with_rivals, held=found.held, far=found.far, beside=found.beside)
    return again, replace(taken, judge_by=judge_by), change


def _over_all_that_stays(tried: Search, new: Varied, h: Hypothesis) -> bool:
    """Whether a hypothesis with a change costs less than all constant ones that were tried.

    It must be believed over the hypotheses all of whose effects it has, and cost less than all
    others. These were fitted to whole recordings, and the change to their parts; the costs of one
    constant answer on both show by how much the two kinds of cost differ.
    """
    best = tried.best
    cost = h.cost.total + best.cost.total - new.without.cost.total
    odds = 2.0 * against(h, new.without).phi * math.log(1.0 / ALPHA)
    return all(
        other.cost.total - cost > (odds if other.labels <= h.labels else 0.0)
        for other in (best, *tried.tried.values())
        if not other.against_physics
    )


def outlived(changes: Sequence[Change], found: Searched) -> tuple[Change, ...]:
    """Return the changes of parameters that an answer still has and still needs.

    Held-out data may have rejected the effect whose parameter changes, and a learned law may not
    need it. A change within held-out data (which has no free runs) stays if the answer has its
    parameter.
    """
    own = {p.name for p in found.final.model.parameters}
    varies = found.final.model.varies
    return tuple(c for c in changes if c.of in (own if c.free_run is None else varies))


def _as_it_goes_on(e: Experiment, fitted: Sequence[Experiment], new: Varied) -> list[Experiment]:
    """A validation recording, cut into parts if a change goes on in it, each with its share."""
    if new.suspect.shape in CUT:
        return [_as_its_first_part(e, new)]
    follows = new.suspect.shape == FOLLOWS
    followed = new.suspect.covariate
    if followed is not None and not any(c.name == followed.name for c in e.covariates):
        return [e]
    goes_on = e.before is not None and len(fitted) == 1 and new.suspect.shape in (DRIFT, SETTLES)
    if not (follows or goes_on):
        return [e]
    end, before = fitted[0].ticks, e.before
    count = max(1, min(PARTS, e.ticks // SHORTEST))
    edges = np.linspace(0, e.ticks, count + 1).round().astype(np.int64).tolist()
    found: list[Experiment] = []
    for a, b in itertools.pairwise(edges):
        part = replace(e.part(a, b), before=before)
        share = share_at(new.suspect, end + 0.5 * (a + b), end)
        if follows:
            share = share_of(new.suspect, part, end + a, end)
        part = replace(part, shares=(*e.shares, (new.names[0], share)))
        found.append(part)
        before = part
    return found


def _as_its_first_part(e: Experiment, new: Varied) -> Experiment:
    """The rest of a recording, with the share of a change that its first part had at its end.

    A step from one recording to the next, or a difference of one recording from the others, also
    applies to their held-out ends. A separate validation recording is judged by the final device.
    """
    if (first := e.before) is None:
        return e
    end = first.begins + (first.ticks - 0.5) * first.period
    alike = [p for p in new.hypothesis.experiments if p.name == first.name and p.begins < end]
    last = max(alike, key=lambda p: p.begins, default=None)
    own = () if last is None else tuple(s for s in last.shares if s[0] in new.names)
    if not own:
        return e
    return replace(e, shares=(*e.shares, *own), before=replace(first, shares=(*first.shares, *own)))


def _rivals_anew(tried: Search, new: Varied) -> Search:
    """The hypotheses of the search, refitted with the change on the same parts; cheapest first."""
    model, parts = new.hypothesis.model, new.hypothesis.experiments

    def again(h: Hypothesis) -> Hypothesis | None:
        return attempt("changes", h.model.label, partial(with_varying, h, model, parts))

    # The refit has no changes.
    constant = partial(with_varying, tried.plain, tried.plain.model, parts)
    bare = new.without if tried.plain is tried.best else attempt("changes", "refit", constant)
    found = replace(
        tried, plain=bare or new.without, best=new.hypothesis, tried={},
        on_bounds=dict(tried.on_bounds), grown=set(), looked=set(), exchanged=set(),
    )  # fmt: skip
    labels = tried.best.labels
    beside = [h for h in tried.tried.values() if h.labels not in (labels, tried.plain.labels)]
    nearest = sorted(beside, key=lambda h: h.cost.total)[:RIVALS]
    less = [h for h in beside if h.labels < labels and len(h.labels) == len(labels) - 1]
    for h in (found.plain, new.hypothesis):
        found.keep(h)
    for h in {id(h): h for h in (*nearest, *less)}.values():
        if (other := again(h)) is not None:
            found.sound([other])
    sound = [h for h in found.tried.values() if not h.against_physics]
    cheapest = min(sound, key=lambda h: h.cost.total, default=found.best)
    # A cheaper one without the changing parameter has no change, and would have to be believed.
    if cheapest.cost.total < found.best.cost.total and _same_changes(cheapest, found.best):
        found.best = cheapest
    return found


def _same_changes(a: Hypothesis, b: Hypothesis) -> bool:
    def own(h: Hypothesis) -> list[str]:
        return [v.name for v in h.model.varying if not v.declared]

    return own(a) == own(b)


def _held_out(device: Device, found: Searched, taken: Taken) -> tuple[Taken, Change] | None:
    """A step in the held-out part of the only recording, dated with all of it."""
    if not taken.whole_unopened or len(taken.whole) != 1 or len(taken.judge_by) != 1:
        return None
    best, (held,) = found.tried.best, taken.judge_by
    if held.before is None:
        return None
    first = held.before.ticks
    h = priced(judged(taken.whole, best.model, best.x, best.family, best.family.near(best.ratio)))
    suspect = suspected(h)
    if suspect is None or suspect.shape != STEP or suspect.at < first - SETTLING:
        return None
    new = varied(h, suspect)
    if new is None:
        return None
    change = change_of(new, taken.whole, None)
    if change.may_be_none:
        return None
    until = round(new.suspect.at) - first
    if until >= RUNS * window(held):
        kept = replace(held.part(0, until), before=held.before)
        taken = replace(taken, judge_by=(kept,))
    return taken, change


def change_of(
    new: Varied, experiments: Sequence[Experiment], free_run: tuple[float, float] | None = None
) -> Change:
    """Return a fitted change in the form of the answer."""
    h, suspect = new.hypothesis, new.suspect
    model, x = h.model, h.x
    own = next(p for p in model.parameters if p.name == new.names[0])
    index = model.parameters.index(own)
    spread = covariance(h.fitted)
    begins, ends_at = 1.0, 0.0  # the share of the change before and after
    if suspect.covariate is not None:
        every = np.concatenate([suspect.covariate.share(e) for e in experiments])
        begins, ends_at = float(every.min()), float(every.max())
    last = _way(own, x.size)
    first = last.copy()
    first[index], last[index] = begins, ends_at

    unit = _unit(model, own.index)
    value = partial(_value, model, x, own)

    def estimate(way: Floats) -> Estimate:
        at, half = float(way @ x), half_width(way, spread)
        ends = value(at - half), value(at + half)
        return Estimate(value(at), min(ends), max(ends), unit)

    def difference() -> Estimate:
        """The change from before to after, the other parameters unchanged."""
        before, last_x = value(float(first @ x)), float(last @ x)
        half, way = Z95 * float(np.sqrt(max(spread[index, index], 0.0))), begins - ends_at
        least, most = (value(last_x + way * (x[index] + k * half)) for k in (-1.0, 1.0))
        now = value(last_x)
        ends = now - least, now - most
        return Estimate(now - before, min(ends), max(ends), unit)

    def one(name: str | None) -> Floats:
        """The parameter in the recording to which a change of that name belongs."""
        there = _way(own, x.size)
        if name is not None:
            there[[p.name for p in model.parameters].index(name)] = 1.0
        return there

    each: tuple[tuple[str, Estimate], ...] = ()
    if suspect.shape == EACH:
        called = [experiments[which[0]].name for which in groups(experiments)]
        each = tuple((name, estimate(one(change)))
                     for name, change in zip(called, (*new.names, None), strict=True))  # fmt: skip
    followed = suspect.covariate
    target = model.parameters[own.index]
    physics = model.effects[target.index] if target.kind == "effect" else None
    period = experiments[0].period
    name, at, between = _when(suspect, experiments)
    settles = suspect.shape == SETTLES
    return Change(
        target.key if physics is not None else target.name,
        None if physics is None else physics.effect.name,
        None if physics is None else physics.at,
        suspect.shape, name, at, between,
        suspect.rate * period if settles else None,
        estimate(first), estimate(last), difference(), new.gained, free_run,
        model.nominal.chain.masses.size,
        _windows(new, experiments, own, at is not None),
        (period * suspect.rates[0], period * suspect.rates[1]) if settles else None,
        None if followed is None else followed.name,
        "" if followed is None else followed.unit,
        None if followed is None else (
            followed.origin + begins * followed.span, followed.origin + ends_at * followed.span,
        ),
        each, suspect.as_well,
        None if own.against is None else model.parameters[own.against].key,
    )  # fmt: skip


def _windows(
    new: Varied, experiments: Sequence[Experiment], own: Parameter, dated: bool
) -> Windows:
    told = course(new.without, own.index, own.against)
    model, x = new.hypothesis.model, new.hypothesis.x
    value = partial(_value, model, x, own)
    half = Z95 * told.errors
    each = [[value(own_x) for own_x in told.x + k * half] for k in (0.0, -1.0, 1.0)]
    end = sum(e.ticks for e in experiments)
    ticks = np.linspace(0.0, end, FINE)
    held = float(_way(own, x.size) @ x) + _moved(new, experiments, ticks, end)
    period, (low, high) = experiments[0].period, new.suspect.between
    return Windows(
        told.times, np.array(each[0]), np.minimum(each[1], each[2]), np.maximum(each[1], each[2]),
        period * ticks, np.array([value(own_x) for own_x in held]),
        (period * low, period * high) if dated else None,
    )  # fmt: skip


def _moved(new: Varied, experiments: Sequence[Experiment], ticks: Floats, end: float) -> Floats:
    """The addition to a changing parameter at ticks of all recordings, in x."""
    h, suspect = new.hypothesis, new.suspect
    places = [[p.name for p in h.model.parameters].index(name) for name in new.names]
    here = np.minimum(ticks.astype(np.int64), int(end) - 1)
    if suspect.covariate is not None:
        return np.concatenate([suspect.covariate.share(e) for e in experiments])[here] * h.x[places]
    if suspect.shape == EACH:
        ends = np.cumsum([e.ticks for e in experiments])
        of = np.searchsorted(ends, here, side="right")
        parts = zip(groups(experiments), places, strict=False)  # the last has no change
        return np.sum([np.isin(of, which) * h.x[place] for which, place in parts], axis=0)
    return np.array([share_at(suspect, tick, end) for tick in ticks.tolist()]) * h.x[places]


def _when(
    suspect: Suspect, experiments: Sequence[Experiment]
) -> tuple[str, float | None, tuple[float, float] | None]:
    """The recording, and the time in it [s]; None for a change between two recordings."""
    near = 2 * SETTLING if suspect.shape == STEP else 0  # a step so near an end is at the end
    place, before = 0, 0
    for e in experiments[:-1]:
        if suspect.shape not in (STEP, RUN) or suspect.at < before + e.ticks - near:
            break
        place, before = place + 1, before + e.ticks
    e = experiments[place]
    if suspect.shape != STEP or not before + near < suspect.at < before + e.ticks - near:
        return e.name, None, None
    at, low, high = (e.begins + (t - before) * e.period for t in (suspect.at, *suspect.between))
    return e.name, at, (low, high)


def _way(change: Parameter, size: int) -> Floats:
    """Row (size,) that reads a changing quantity from x: a parameter, or half a difference."""
    found = np.zeros(size)
    found[change.index] = 1.0
    if change.against is not None:
        found[[change.index, change.against]] = 0.5, -0.5
    return found


def _value(model: Model, x: Floats, change: Parameter, own: float) -> float:
    """The value of a changing quantity if `_way(change) @ x` is `own` and all else is as at x."""
    moved, target = x.copy(), model.parameters[change.index]
    if change.against is None:
        moved[change.index] = own
    else:
        both = [change.index, change.against]
        moved[both] = moved[both].mean() + np.array([own, -own])
    there = model.within(moved)
    if target.kind != "effect":
        return values_of(model, there)[target.name]
    values = model.effects_at(there)[target.index].values
    if change.against is None:
        return values[target.key]
    return 0.5 * (values[target.key] - values[model.parameters[change.against].key])


def _unit(model: Model, index: int) -> str:
    p, rotary = model.parameters[index], model.nominal.rotary
    if p.kind == "effect":
        return model.effects[p.index].effect.parameter(p.key).unit_for(rotary)
    return UNITS[p.kind][0 if rotary else 1]
