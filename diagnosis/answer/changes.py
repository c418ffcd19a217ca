"""What does not stay the same while a device is recorded, as an answer says it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.findings import UNITS
from zwidth.diagnosis.answer.headline import (
    effect_in_words,
    parameter_in_words,
    place_in_words,
    said,
)
from zwidth.diagnosis.answer.held_out import free_share
from zwidth.diagnosis.answer.result import Estimate
from zwidth.diagnosis.fitting.uncertainty import Z95, covariance
from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.mishaps import Say, attempt
from zwidth.diagnosis.model.parameters import Model, values_of
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import Hypothesis
from zwidth.diagnosis.selection.searched import Searched, judge_of
from zwidth.diagnosis.time import changes as time_changes
from zwidth.diagnosis.time.changes import Varied
from zwidth.diagnosis.time.score import DRIFT, EACH, RUN, SETTLES, STEP, Suspect, windows
from zwidth.sim.device import Device
from zwidth.sim.place import place_at
from zwidth.sim.readable import plain

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Windows:
    """A parameter as each window of the recordings tells it: middle [s], value, 95 % interval.

    Recordings follow each other; times (windows,) are from the first sample of the first.
    changed: of what was fitted, its values at `line` (points,) [s]; dated: when a step is, the same
    way, None where there is none within a recording.
    """

    times: Floats
    values: Floats
    lower: Floats
    upper: Floats
    line: Floats
    changed: Floats
    dated: tuple[float, float] | None


@dataclass(frozen=True)
class Change:
    """One parameter that does not stay the same.

    parameter: as `linear_refit` names it, or that of an effect at a place. shape: "step", at `at`
    [s] of a recording with the 95 % interval `between`; "drift", from the first sample to the last;
    "settling", with the time constant `rate` [s] and its interval `rate_between`; "run", in one
    recording only; "follows", linearly what was recorded as `covariate` in `covariate_unit`, from
    one of `covariate_ends` to the other; "each recording", with the values `each` by the names of
    the recordings. before, after: its values; by: what lies between, which may be known far better
    than either, where another parameter does nearly the same. as_well: other courses that explain
    it as well. gained: in -2 ln, all paid. free_run: errors over the motion of free runs on
    held-out data without the change and with it, None where the change itself is held out.
    windows: what each part of the recordings says by itself.
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

    @property
    def of(self) -> str:
        """The parameter as a model names it (`model.parameters.Parameter.name`)."""
        own = self.parameter
        return own if self.effect is None else f"{self.effect}@{self.place}.{own}"

    @property
    def what(self) -> str:
        """The parameter in words."""
        if self.effect is None or self.place is None:
            return parameter_in_words(self.parameter, self.after.unit)
        name = self.parameter.replace("_", " ")
        return (
            f"the {name} of {effect_in_words(self.effect)}"
            f" {place_in_words(place_at(self.place), self.masses)}"
        )

    @property
    def sentence(self) -> str:
        """Say what changed, by how much, and when."""
        if not self.as_well:
            return self._alone
        return f"{self._alone} ({' and '.join(self.as_well)} would explain it as well)"

    @property
    def _alone(self) -> str:
        how = "rose" if self.by.value > 0.0 else "fell"
        if self.shape == RUN:
            if self._apart:
                first, last = said(self.before), said(self.after)
                return f"{self.what} was {first} in {self.recording}, and {last} in all others"
            more = "more" if self.by.value < 0.0 else "less"
            return (
                f"{self.what} was {said(_size(self.by))} {more} in {self.recording} than in all"
                f" others, where it was {said(self.after)}"
            )
        if self.each:
            values = [f"{said(value)} in {name}" for name, value in self.each]
            more = f" and so on in {len(values) - 4} more" if len(values) > 4 else ""
            listed = ", ".join(values[:4])
            return f"{self.what} differs from recording to recording: {listed}{more}"
        if self.covariate is not None and self.covariate_ends is not None:
            low, high = (f"{plain(v, 3)} {self.covariate_unit}" for v in self.covariate_ends)
            over = f"from {low.rstrip()} to {high.rstrip()}"
            return f"{self.what} follows {self.covariate}: it {how} {self._course} {over}"
        if self.shape == SETTLES:
            how, when = "settled", f"with a time constant of {plain(self.rate or 0.0, 2)} s"
            if self.rate_between is not None:
                low, high = (plain(v, 2) for v in self.rate_between)
                when += f" ({low} to {high} s)"
        elif self.shape == DRIFT:
            how, when = "drifted", "from the first sample to the last"
        elif self.at is None or self.between is None:
            when = f"from {self.recording} on"
        else:
            low, high = self.between
            digits = max(0, min(4, -int(np.floor(np.log10(max(0.5 * (high - low), 1e-4))))))
            when = f"at {self.at:.{digits}f} s ({low:.{digits}f} to {high:.{digits}f} s)"
        return f"{self.what} {how} {self._course} {when}"

    @property
    def _apart(self) -> bool:
        """Whether the values' own intervals show that they differ."""
        return self.before.upper < self.after.lower or self.after.upper < self.before.lower

    @property
    def _course(self) -> str:
        if self._apart:
            return f"from {said(self.before)} to {said(self.after)}"
        return f"by {said(_size(self.by))} from {said(self.before)}"

    def as_json(self) -> dict[str, Any]:
        """Return the JSON of `zwidth diagnose`."""
        free = None if self.free_run is None else dict(zip(("constant", "changing"), self.free_run,
                                                           strict=True))  # fmt: skip
        return {
            "parameter": self.parameter,
            "effect": self.effect,
            "at": self.place,
            "shape": self.shape,
            "recording": self.recording,
            "at_s": self.at,
            "at_s_ci95": None if self.between is None else list(self.between),
            "time_constant_s": self.rate,
            "time_constant_s_ci95": None if self.rate_between is None else list(self.rate_between),
            "follows": self.covariate,
            "follows_unit": self.covariate_unit or None,
            "follows_from_to": None if self.covariate_ends is None else list(self.covariate_ends),
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
    """A difference without its sign."""
    if by.value > 0.0:
        return by
    return Estimate(-by.value, -by.upper, -by.lower, by.unit)


def changing(
    device: Device, found: Searched, taken: Taken, say: Say
) -> tuple[Searched, Taken, tuple[Change, ...]]:
    """Return what was found with what changes, what is to judge it, and the changes."""
    found, taken, fitted = time_changes.changing(device, found, taken, _errs, say)
    every = [attempt("changes", one.suspect.of, partial(change_of, one)) for one in fitted]
    changes = tuple(change for change in every if change is not None)
    for change in changes:
        say(change.sentence)
    return found, taken, changes


def _errs(h: Hypothesis, judge_by: Sequence[Experiment]) -> float:
    return free_share(h.model, h.x, judge_of(h), judge_by)


def outlived(changes: Sequence[Change], found: Searched) -> tuple[Change, ...]:
    """Return the changes of parameters that an answer still has, and still has as changing.

    Held-out data may have refused the name whose parameter changes, and a law may do without. A
    change in held-out data themselves (no free runs) is of a parameter that the answer has.
    """
    own = {p.name for p in found.final.model.parameters}
    varies = found.final.model.varies
    return tuple(c for c in changes if c.of in (own if c.free_run is None else varies))


def change_of(new: Varied) -> Change:
    """Return a change that was fitted, as it is said."""
    h, suspect, experiments = new.hypothesis, new.suspect, new.experiments
    model, x, spread = h.model, h.x, covariance(h.fitted)
    names = [p.name for p in model.parameters]
    index = names.index(new.names[0])
    own = model.parameters[index].index
    unit, followed = _unit(model, own), suspect.covariate
    begins, ends = 1.0, 0.0  # how much of the change holds
    if followed is not None:
        every = np.concatenate([followed.share(e) for e in experiments])
        begins, ends = float(every.min()), float(every.max())

    def estimate(place: int, share: float) -> Estimate:
        """The parameter with so much of the change of a place."""
        way = np.zeros(x.size)
        way[own], way[place] = 1.0, share
        at, half = float(way @ x), Z95 * float(np.sqrt(max(way @ spread @ way, 0.0)))
        least, most = (_value(h, own, at + k * half) for k in (-1.0, 1.0))
        return _between(_value(h, own, at), least, most, unit)

    def difference() -> Estimate:
        """From before to after, the other parameters as they are."""
        half = Z95 * float(np.sqrt(max(spread[index, index], 0.0)))
        last = float(x[own]) + ends * float(x[index])
        before, least, most = (
            _value(h, own, last + (begins - ends) * float(x[index] + k * half)) for k in (0, -1, 1)
        )
        now = _value(h, own, last)
        return _between(now - before, now - least, now - most, unit)

    each: tuple[tuple[str, Estimate], ...] = ()
    if suspect.shape == EACH:
        values = [estimate(names.index(name), 1.0) for name in new.names] + [estimate(index, 0.0)]
        each = tuple(zip(suspect.recordings, values, strict=True))
    target, period = model.parameters[own], experiments[0].period
    physics = model.effects[target.index] if target.kind == "effect" else None
    name, at, between = _when(suspect, experiments)
    low, high = suspect.rates
    settles = suspect.shape == SETTLES
    return Change(
        target.key if physics is not None else target.name,
        None if physics is None else physics.effect.name,
        None if physics is None else physics.at,
        suspect.shape, name, at, between, suspect.rate * period if settles else None,
        estimate(index, begins), estimate(index, ends), difference(), new.gained, new.free,
        model.nominal.chain.masses.size, _windows(new, own, at is not None),
        (period * low, period * high) if settles else None,
        None if followed is None else followed.name,
        "" if followed is None else followed.unit,
        None if followed is None else (
            followed.origin + begins * followed.span, followed.origin + ends * followed.span,
        ),
        each, suspect.as_well,
    )  # fmt: skip


def _between(value: float, one: float, other: float, unit: str) -> Estimate:
    return Estimate(value, min(one, other), max(one, other), unit)


def _windows(new: Varied, own: int, dated: bool, points: int = 400) -> Windows:
    """A parameter (its place) over time; the fitted line has so many points."""
    h, told, experiments = new.hypothesis, windows(new.without, own), new.experiments

    def values(xs: Floats) -> Floats:
        return np.array([_value(h, own, x) for x in xs.tolist()])

    half = Z95 * told.errors
    ends = values(told.x - half), values(told.x + half)
    ticks = np.linspace(0.0, sum(e.ticks for e in experiments), points)
    names = [p.name for p in h.model.parameters]
    amounts = h.x[[names.index(name) for name in new.names]]
    line = values(h.x[own] + amounts @ new.suspect.shares(experiments, ticks))
    period, (low, high) = experiments[0].period, new.suspect.between
    return Windows(
        period * told.ticks, values(told.x), np.minimum(*ends), np.maximum(*ends),
        period * ticks, line, (period * low, period * high) if dated else None,
    )  # fmt: skip


def _when(
    suspect: Suspect, experiments: Sequence[Experiment]
) -> tuple[str, float | None, tuple[float, float] | None]:
    """The recording, and when in it [s]; no time where a change is from one to the next."""
    near = 2 * SETTLING if suspect.shape == STEP else 0  # to an end, which is that end
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


def _value(h: Hypothesis, index: int, own: float) -> float:
    """A parameter in its unit where it is `own` in x, all others as they were fitted."""
    model, x = h.model, h.x.copy()
    x[index] = own
    x, p = model.within(x), model.parameters[index]
    if p.kind == "effect":
        return model.effects_at(x)[p.index].values[p.key]
    return values_of(model, x)[p.name]


def _unit(model: Model, index: int) -> str:
    p, rotary = model.parameters[index], model.nominal.rotary
    if p.kind == "effect":
        return model.effects[p.index].effect.parameter(p.key).unit_for(rotary)
    return UNITS[p.kind][0 if rotary else 1]
