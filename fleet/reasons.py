"""Why a recording is unlike the others: which fault explains it at the lowest cost.

A sound recording of the fleet has parameters about mu (for its own columns) with covariance S. For
a recording read in one way (as it is, with a sign reversed, ...), a fit gives y with covariance C,
and

    cost = -2 ln p(recording | y) + price
         + (y - mu)' (C + S)^-1 (y - mu) + ln det (C + S) - ln det C

is the cost of that reading (the evidence with a normal prior N(mu, S) on the device, by Laplace).
For a device that differs in one parameter, the deviation of that parameter is `WIDE` times its mu.
The price has terms for the rarity of the fault, as in `diagnosis.intake`, and for the number of
faults that were tried. The cheapest reading is reported, or "as recorded" if no other is cheaper by
2 ln (1 / ALPHA).

These faults are tried: signs and units of command and output (also those that the gate of a
diagnosis suspects), a late command or reading, a reading that jumps (a clamp or a coupling that
slipped), a parameter that changes within the recording, parameters of its own, and, if the
recording fits badly with every correction, physics that the others do not have. If free runs
diverge, it is first tested whether the drive was off for a while (`switched_off`), since the
prediction one sample ahead, which shows all other faults, does not show this one.
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.words import effect_in_words
from zwidth.diagnosis.intake.gate import COMMAND, Fault, corrected, misread, suspicion
from zwidth.diagnosis.intake.late import in_time
from zwidth.diagnosis.intake.swapped import in_place
from zwidth.diagnosis.intake.units import ALONG, TURNING
from zwidth.diagnosis.learning.changing import STEP, varied
from zwidth.diagnosis.learning.changing import suspected as changing
from zwidth.diagnosis.model.parameters import Model, effect_labels
from zwidth.diagnosis.noise.predictor import FREE_RUN_S, SETTLING, innovations
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.evidence import ALPHA
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.diagnosis.selection.search import search
from zwidth.diagnosis.settings import INTAKE
from zwidth.fleet.odd import STILL, Odd
from zwidth.fleet.quick import NUISANCE, estimates, names_of, physical
from zwidth.fleet.reading import experiment_of
from zwidth.fleet.structure import Structure
from zwidth.fleet.switched_off import free_error, switched_off
from zwidth.shown import Valued
from zwidth.sim.readable import with_unit

Floats = NDArray[np.float64]
RARE = -2.0 * math.log(INTAKE.unit_odds)
WIDE = 10.0  # deviation of another device's parameter, over its expected value
LATEST = 30  # samples by which a reading may be late
BADLY = 3.0  # times the fleet's noise: a larger residual is not explained
FITTED = 4  # number of readings that are fitted: the cheapest ones before a fit
SURELY = 2.0 * math.log(1.0 / ALPHA)
FAULTS = {
    "inverted_sign": "a sign is inverted",
    "other_unit": "another unit",
    "swapped": "columns exchanged",
    "switched_off": "its drive is off for a while",
    "late": "command and reading have different delays",
    "slipped": "a reading jumps",
    "stale_sensor": "a sensor that does not give new readings",
    "unreadable": "it cannot be used",
    "changed_within": "a parameter changes while it is recorded",
    "other_device": "a parameter has another value",
    "other_physics": "physics that the others do not have",
    "unexplained": "nothing that was tried explains it",
}


@dataclass(frozen=True)
class Reason(Valued):
    """Why a recording is odd. kind: a key of `FAULTS`; gained: -2 ln, over reading it as it is.

    parameters: those that differ, for the kind `other_device`. recording: whether the fault is in
    the recording, not in the device.
    """

    kind: str
    sentence: str
    gained: float
    parameters: tuple[str, ...] = ()

    @property
    def recording(self) -> bool:
        """Whether the recording is at fault and shows nothing about the present device."""
        return self.kind not in ("changed_within", "other_device", "other_physics")


@dataclass(frozen=True)
class Question:
    """An odd recording to be explained.

    expected, spread (q,): expected values and deviations of the reported parameters; noise: typical
    for the fleet. odd: how the recording is unlike the others.
    """

    name: str
    path: Path
    structure: Structure
    expected: Floats
    spread: Floats
    noise: float
    odd: Odd


@dataclass(frozen=True)
class _Way:
    kind: str
    sentence: str
    experiment: Experiment
    price: float


def unusable(problem: str) -> Reason:
    """Return the reason for a recording without a fit; problem: why it has none."""
    stale = "repeats every reading" in problem or "is constant at" in problem
    return Reason("stale_sensor" if stale else "unreadable", problem, math.inf)


def explained(question: Question) -> Reason:
    """Return the reason that costs least."""
    model = question.structure.model
    try:
        e = experiment_of(question.path, question.structure.device, question.name)
    except (ValueError, OSError) as error:
        return unusable(str(error))
    if any(kind == STILL for kind, _, _ in question.odd.signs):
        still = f"the reading of {e.name} stands still while the others move"
        return Reason("stale_sensor", still, math.inf)
    start = _x_of(model, question.expected)
    every = list(_ways(e, question, model, start))
    if question.odd.fits_badly and (off := _without_drive(e, model, start, every)) is not None:
        return off
    as_is = _fit(e, model, start)
    plain = math.inf if as_is is None else _cost(question, as_is, e.ticks)
    found: list[tuple[float, Reason, Hypothesis | None]] = []
    asked = 2.0 * math.log(max(1, len(every)))
    # A recording read in the right way fits at the fleet's values, so most ways need no fit.
    ranked = sorted(every, key=lambda way: _unfitted(way, model, start, e.ticks))
    for way in ranked[:FITTED]:
        h = _fit(way.experiment, model, start)
        if h is not None:
            cost = _cost(question, h, e.ticks) + way.price + asked
            found.append((cost, Reason(way.kind, way.sentence, plain - cost), h))
    if as_is is not None:
        found += [
            (cost, replace(r, gained=plain - cost), as_is) for cost, r in _own(question, as_is, e)
        ]
        if question.odd.fits_badly:
            gained, reason = _within(as_is)
            found.append((plain - gained, replace(reason, gained=gained), None))
    best = min(found, key=lambda f: f[0], default=None)
    if best is None:
        return unusable(f"no observer predicts {e.name}, whatever fault is assumed")
    cost, reason, h = best
    noise = question.noise if h is None else float(h.noise.observer.deviation[0])
    if noise > BADLY * question.noise:
        other = _other_physics(e, question)
        return other or replace(
            reason, kind="unexplained", sentence=_unexplained(e, noise, question)
        )
    if cost > plain - SURELY:
        return Reason("unexplained", _unexplained(e, noise, question), 0.0)
    return reason


def _without_drive(
    e: Experiment, model: Model, start: Floats, ways: Sequence[_Way]
) -> Reason | None:
    """The reason that the drive was off, unless another way to read has smaller free-run errors."""
    try:
        off = switched_off(e, model, start)
    except (NoObserver, ValueError):
        return None
    if off is None or any(free_error(w.experiment, model, start) < off.off for w in ways):
        return None
    sentence = (
        f"the drive of {e.name} gives no force from {off.from_s:.3g} s to {off.to_s:.3g} s, as"
        f" where it is switched off: the error of free runs is {off.on:.2g} times the motion where"
        f" it is taken as on, and {off.off:.2g} times where it is not; describe it by [enable] in"
        " its TOML"
    )
    seconds = e.ticks * e.period
    return Reason("switched_off", sentence, 2.0 * seconds / FREE_RUN_S * math.log(off.on / off.off))


def in_words(parameter: str) -> str:
    """Return a readable name of a parameter: "Coulomb friction at m1, level"."""
    effect, _, key = parameter.partition(".")
    name = effect_in_words(effect).replace("@", " at ")
    return f"{name}, {key.replace('_', ' ')}," if key else name


def _unexplained(e: Experiment, noise: float, question: Question) -> str:
    signs = ", ".join(
        f"{name or kind} by {sigma:.3g} sigma" for kind, name, sigma in question.odd.signs[:4]
    )
    times = noise / question.noise if question.noise > 0.0 else math.inf
    return (
        f"{e.name} is unlike the others ({signs}; noise {times:.3g} times theirs), and no fault"
        " that was tried explains it"
    )


def _unfitted(way: _Way, model: Model, start: Floats, ticks: int) -> float:
    """The cost of a reading with the expected parameters, without a fit."""
    with suppress(NoObserver, ValueError), np.errstate(all="ignore"):
        h = judged([way.experiment], model, start)
        rows = max(1, way.experiment.ticks - SETTLING)
        return h.cost.misfit * (ticks - SETTLING) / rows + way.price
    return math.inf


def _fit(e: Experiment, model: Model, start: Floats) -> Hypothesis | None:
    with suppress(NoObserver, ValueError), np.errstate(all="ignore"):
        return settled(judged([e], model, model.within(start)))
    return None


def _x_of(model: Model, values: Floats) -> Floats:
    """The x at which the reported parameters have these values."""
    x, place = np.zeros(len(model.parameters)), 0
    at_zero, _ = physical(model, x)
    for i, p in enumerate(model.parameters):
        if p.kind in NUISANCE:
            continue
        x[i] = p.x_of(float(at_zero[place]), float(values[place]))
        place += 1
    return model.within(x)


def _cost(question: Question, h: Hypothesis, ticks: int, wide: Sequence[int] = ()) -> float:
    """The cost of a fit under the fleet's prior; wide: indices of parameters that are free.

    A shortened recording is weighted as if it were complete.
    """
    values, errors, spread = estimates(h)
    prior = np.array([p.prior for p in h.model.parameters])
    own = h.cost.misfit - float(np.sum(h.x[prior] ** 2))
    rows = max(1, sum(e.ticks for e in h.experiments) - SETTLING)
    own *= (ticks - SETTLING) / rows
    deviation = question.spread.copy()
    places = list(wide)
    deviation[places] = WIDE * np.maximum(
        np.abs(question.expected[places]), question.spread[places]
    )
    told = np.isfinite(errors) & (errors > 0.0)
    if not told.any():
        return own
    c = spread[np.ix_(told, told)] + np.diag(1e-12 * errors[told] ** 2)
    both = c + np.diag(deviation[told] ** 2)
    off = (values - question.expected)[told]
    far = float(off @ np.linalg.solve(both, off))
    return own + far + float(np.linalg.slogdet(both)[1]) - float(np.linalg.slogdet(c)[1])


def _own(question: Question, h: Hypothesis, e: Experiment) -> Iterator[tuple[float, Reason]]:
    """Reasons with other parameter values: each alone, the odd ones together, and all."""
    units = names_of(question.structure)
    names = list(units)
    values, _, _ = estimates(h)
    standing = [names.index(name) for name in question.odd.parameters if name in names]
    choices = [(i,) for i in range(len(names))]
    choices += [tuple(standing[:2])] if len(standing) > 1 else []
    for places in dict.fromkeys(tuple(sorted(c)) for c in choices):
        cost = _cost(question, h, e.ticks, places) + RARE * len(places)
        said = " and ".join(
            f"{in_words(names[i])} is {with_unit(float(values[i]), units[names[i]])}"
            f" and not {with_unit(float(question.expected[i]), units[names[i]])}"
            for i in places
        )
        yield (
            cost,
            Reason("other_device", f"in {e.name} {said}", 0.0, tuple(names[i] for i in places)),
        )


def _within(h: Hypothesis) -> tuple[float, Reason]:
    """The reason that a parameter changes within the recording, and the gain of it."""
    nothing = -math.inf, Reason("changed_within", "", 0.0)
    try:
        suspect = changing(h)
        found = None if suspect is None else varied(h, suspect)
    except (NoObserver, ValueError):
        return nothing
    if found is None:
        return nothing
    e, own = h.experiments[0], found.suspect
    at = f" at {own.at * e.period:.3g} s" if own.shape == STEP else ""
    name = own.of.replace("_", " ").replace("@", " at ")
    sentence = f"{name} changes within {e.name}: a {own.shape}{at}"
    return found.gained - RARE, Reason("changed_within", sentence, 0.0, (own.of,))


def _ways(e: Experiment, question: Question, model: Model, start: Floats) -> Iterator[_Way]:
    """Other ways to read a recording."""
    device = model.build(start)
    names = tuple(o.name for o in e.outputs)
    seen = set[tuple[tuple[tuple[str, ...], float], ...]]()
    units = TURNING if device.rotary else ALONG
    factors = [-1.0, *units, *(1.0 / u for u in units)]
    faults = [(misread(e, channels, f),) for channels in (COMMAND, names) for f in factors]
    with suppress(NoObserver, ExperimentError), np.errstate(all="ignore"):
        faults += list(suspicion(device, e).ways)
    for fault in faults:
        key = tuple((f.channels, round(f.value, 6)) for f in fault)
        if key in seen:
            continue
        seen.add(key)
        yield _read_as(e, fault)
    with suppress(NoObserver, ExperimentError), np.errstate(all="ignore"):
        other, found = in_place(device, e)
        if found and other is not e:
            yield _Way("swapped", found[0].sentence, other, RARE)
        other, found = in_time(device, e)
        if any(fault.wrong for fault in found):  # a late command may be physics
            yield _Way("late", found[0].sentence, other, RARE)
    if not question.odd.fits_badly:
        return
    late = _reading_late(e, model, start)
    if late is not None:
        yield late
    jump = _jump(e, model, start)
    if jump is not None:
        yield jump


def _read_as(e: Experiment, faults: Sequence[Fault]) -> _Way:
    price = RARE
    for fault in faults:
        if fault.channels != COMMAND:
            samples = (e.ticks - SETTLING) * len(fault.channels)
            price -= 2.0 * samples * math.log(abs(fault.value))
    size = max(abs(math.log(abs(f.value))) for f in faults)
    kind = "inverted_sign" if size < 1e-9 else "other_unit"
    return _Way(kind, "; ".join(f.sentence for f in faults), corrected(e, list(faults)), price)


def _reading_late(e: Experiment, model: Model, start: Floats) -> _Way | None:
    """The reading moved some samples earlier, by the number that costs least."""
    best: tuple[float, int, Experiment] | None = None
    for n in range(1, min(LATEST, e.ticks // 10)):
        later = e.part(n, e.ticks)
        other = replace(
            e.part(0, e.ticks - n), measured=later.measured,
            bridged=later.bridged, uncounted=later.uncounted,
        )  # fmt: skip
        try:
            h = judged([other], model, start)
        except (NoObserver, ValueError):
            continue
        each = h.cost.misfit / (other.ticks - SETTLING)
        if best is None or each < best[0]:
            best = each, n, other
    if best is None:
        return None
    _, n, other = best
    said = f"the readings of {e.name} come {n} samples ({1e3 * n * e.period:.3g} ms) late"
    return _Way("late", said, other, RARE + 2.0 * math.log(LATEST))


def _jump(e: Experiment, model: Model, start: Floats) -> _Way | None:
    """The reading without its largest jump, whose size is fitted."""
    position = next((k for k, o in enumerate(e.outputs) if o.tells_position), None)
    if position is None:
        return None
    y = e.measured[:, position]
    steps = np.diff(y)
    about = np.convolve(steps, np.array([1, 1, 1, 0, 1, 1, 1]) / 6.0, "same")
    at = int(np.argmax(np.abs(steps - about)[3:-3])) + 3
    size = float(steps[at] - about[at])
    if at < SETTLING // 2 or size == 0.0:
        return None
    after = np.zeros_like(e.measured)
    after[at + 1 :, position] = 1.0
    without = e
    for _ in range(3):
        without = replace(e, measured=e.measured - size * after)
        try:
            h = settled(judged([without], model, start), turns=1, rounds=3)
            size -= _more(h, after)
        except (NoObserver, ValueError):
            return None
    without = replace(e, measured=e.measured - size * after)
    unit = "rad" if model.nominal.rotary else "m"
    said = (
        f"{e.outputs[position].name} of {e.name} jumps by {with_unit(size, unit)} at"
        f" {e.begins + (at + 1) * e.period:.3g} s, as when a clamp, a coupling or a sensor slips"
    )
    return _Way("slipped", said, without, RARE + 2.0 * math.log(e.ticks))


def _more(h: Hypothesis, after: Floats) -> float:
    """Excess of the jump that was subtracted, to first order."""
    model, x, observer = h.model, h.x, h.noise.observer
    (e,) = h.problem.experiments
    seen = model.seen(e, x)
    size = max(float(h.noise.observer.deviation[0]), 1e-300)
    device = model.acting(x)
    own = observer.weigh(innovations(device, seen, observer.gain), seen.uncounted)
    moved = replace(seen, measured=seen.measured + size * after)
    slope = (observer.weigh(innovations(device, moved, observer.gain), seen.uncounted) - own) / size
    r, c = own[SETTLING:].ravel(), slope[SETTLING:].ravel()
    return -float(c @ r) / max(float(c @ c), 1e-300)


def _other_physics(e: Experiment, question: Question) -> Reason | None:
    """Further effects, besides the fleet's, that explain a recording."""
    typical = question.structure.typical
    try:
        tried = search(typical, [e], QUICK)
    except (NoObserver, ValueError):
        return None
    if tried.interrupted:
        raise KeyboardInterrupt
    known = set(question.structure.labels)
    new = [label for label in effect_labels(tried.best.model.effects) if label not in known]
    quiet = float(tried.best.noise.observer.deviation[0]) < BADLY * question.noise
    if not new or not quiet:
        return None
    said = " and ".join(label.replace("_", " ").replace("@", " at ") for label in new)
    gained = tried.plain.cost.total - tried.best.cost.total
    return Reason("other_physics", f"{e.name} has {said}, which the others do not have", gained)
