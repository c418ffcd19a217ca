"""Events that happened once during a recording, in the form of the answer.

`knowing_events` decides when to look for events, and how they change an answer.

Over a tick, force times travel is energy: W = sum f_k (q_(k+1) - q_k), exact for a force that is
held.

A contact pushes one way. A short force that clearly pushes both ways (`_opposes`) is not a contact,
but readings that nothing known explains, such as disturbed readings or missing physics at a
reversal; its impulse and energy mean nothing. With S_k = sum over i < k of f_i, the largest rise
and fall of S over any span are the largest impulses each way; the variance of the impulse over a
span is the sum of the span's block of the covariance. Limit: the span is chosen, so noise alone
gives a sum of two or three sigma.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.result import Estimate
from zwidth.diagnosis.answer.words import place_in_words, said, short, times_in_words
from zwidth.diagnosis.fitting.uncertainty import Z95
from zwidth.diagnosis.learning.event_edges import edges
from zwidth.diagnosis.learning.event_force import Happened
from zwidth.diagnosis.learning.events import FitOn, happenings, with_events
from zwidth.diagnosis.noise.predictor import followed
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.diagnosis.settings import EVENTS, VERDICT
from zwidth.shown import Valued
from zwidth.sim.place import place_at
from zwidth.sim.readable import with_unit

Floats = NDArray[np.float64]
SHORT_S, LONG_S = 0.05, 0.1  # a hit is shorter, a hand lasts longer
STILL = 0.1  # of the usual speed (at a stop: of the speed before it), below which it is at rest
AT_AN_END = 0.03  # of the travel: how far from its end a stop may be
MEAN_S = 0.02  # the largest force, and the speed beside it, are means over this time
PICTURE_S = 0.3  # about an event, in a picture
HIT, STOP, JAM, TOUCH, PUSH, SLIP = "hit", "stop", "jam", "touch", "push", "slip"
UNEXPLAINED = "unexplained"
CONTACTS = HIT, TOUCH, PUSH, UNEXPLAINED  # by somebody who knows of it; or physics is missing


@dataclass(frozen=True)
class Course(Valued):
    """An event over time [s] of its recording: force (ticks,) with its 95 % band, and the motion.

    For a slip of a sensor, `force` is the error of the reading. motion: of the place, as measured
    or as estimated by the observer.
    """

    times: Floats
    force: Floats
    lower: Floats
    upper: Floats
    motion: Floats
    unit: str
    length: str


@dataclass(frozen=True)
class Event(Valued):
    """One event.

    kind: "hit", "stop" (a hit on a stop), "jam", "touch" (a hand or another contact), "push" (a
    force longer than a hit and shorter than a touch), "slip" (of a sensor, a coupling or a clamp),
    "unexplained" (readings as under a short force that pushes both ways, which no contact does).
    place: mass, link or output. at [s] of the recording with the 95 % interval between: the middle
    of a short event, the beginning of a long one; until, until_between: the same for its end, None
    for a short event or a slip. force: the largest mean over 20 ms; impulse, energy: given to the
    device, negative if taken from it. slip: its size; stop: the position of a stop [rad | m].
    elsewhere: places that explain the event equally well. gained: chi-square.
    """

    kind: str
    place: str
    recording: str
    at: float
    between: tuple[float, float]
    until: float | None
    until_between: tuple[float, float] | None
    force: Estimate | None
    impulse: Estimate | None
    energy: Estimate | None
    slip: Estimate | None
    stop: float | None
    elsewhere: tuple[str, ...]
    gained: float
    masses: int
    course: Course

    @property
    def where(self) -> str:
        """The place in words."""
        if self.kind == SLIP and "_" in self.place:
            return f"of the sensor {self.place}"
        if self.kind == SLIP:
            link = place_at(self.place).kind == "link"
            return f"of the {'coupling ' if link else 'clamp '}{self._at}"
        return self._at

    @property
    def _at(self) -> str:
        every = [place_in_words(place_at(p), self.masses) for p in (self.place, *self.elsewhere)]
        return " or ".join(every)

    @property
    def _end(self) -> str:
        return "" if self.stop is None else f" at {with_unit(self.stop, self.course.length, 3)},"

    @property
    def _when(self) -> str:
        when = f"at {times_in_words(self.at, self.between)[0]} s"
        if self.until is not None and self.until_between is not None:
            first, last = (
                times_in_words(*at)[0]
                for at in ((self.at, self.between), (self.until, self.until_between))
            )
            when = f"from {first} to {last} s"
        return when

    @property
    def _most(self) -> str:
        assert self.force is not None
        return with_unit(abs(self.force.value), self.force.unit, 2)

    @property
    def short(self) -> str:
        """Say what happened and when: "a hit of 12 mN m s at the motor at 3.2 s"."""
        if self.kind == UNEXPLAINED:
            return f"readings {self._when} that no contact explains"
        if self.kind == SLIP:
            assert self.slip is not None
            return f"a slip {self.where} by {short(self.slip)} {self._when}"
        assert self.impulse is not None
        size = with_unit(self.impulse.value, self.impulse.unit, 2).removeprefix("-")
        what = {
            HIT: f"a hit of {size} {self.where}",
            STOP: f"a hit of {size} on a stop{self._end} {self.where}",
            JAM: f"a jam {self.where} with a force of up to {self._most},",
            TOUCH: f"a hand or another contact {self.where} with a force of up to {self._most},",
            PUSH: f"a push of {size} {self.where}",
        }[self.kind]
        return f"{what} {self._when}"

    @property
    def sentence(self) -> str:
        """Say what happened, when, and with which impulse and energy."""
        if self.kind == SLIP:
            assert self.slip is not None
            return f"a slip {self.where} by {said(self.slip)} {self._when}"
        if self.kind == UNEXPLAINED:
            return (
                f"{self.short}: as under a force of up to {self._most} {self.where} that pushes one"
                " way and then the other"
            )
        assert self.energy is not None
        work = with_unit(abs(self.energy.value), "J", 2)
        did = (
            f"gave the device {work}" if self.energy.value > 0.0 else f"took {work} from the device"
        )
        if self.energy.lower < 0.0 < self.energy.upper:
            most_work = max(-self.energy.lower, self.energy.upper)
            did = f"changed the device's energy by less than {with_unit(most_work, 'J', 2)}"
        return f"{self.short} {did}"

    def as_json(self) -> dict[str, Any]:
        """Return the JSON of `zwidth diagnose`."""
        c = self.course
        sizes = {"force": self.force, "impulse": self.impulse, "energy": self.energy,
                 "slip": self.slip}  # fmt: skip
        return {
            "kind": self.kind,
            "at": self.place,
            "elsewhere": list(self.elsewhere),
            "recording": self.recording,
            "at_s": self.at,
            "at_s_ci95": list(self.between),
            "until_s": self.until,
            "until_s_ci95": self.until_between and list(self.until_between),
            **{name: e and e.as_json() for name, e in sizes.items()},
            "stop": self.stop,
            "gained": self.gained,
            "course": {name: getattr(c, name).tolist()
                       for name in ("times", "force", "lower", "upper", "motion")},
        }  # fmt: skip


def events_in(recordings: Sequence[Experiment], h: Hypothesis, fit_on: FitOn) -> tuple[Event, ...]:
    """Return the events in whole recordings by one fitted hypothesis; may raise NoObserver."""
    known = happenings(recordings, h, fit_on)
    h = settled(judged(fit_on(known), h.model, h.x, h.family))
    return all_said(recordings, h, known)


def all_said(
    every: Sequence[Experiment], best: Hypothesis, known: Sequence[Happened]
) -> tuple[Event, ...]:
    """Return known events of whole recordings in the form of the answer; best: fitted with them."""
    if not known:
        return ()
    h = judged(with_events(every, known), best.model, best.x)
    events: list[Event] = []
    for i, one in enumerate(known):
        others = with_events(every, [*known[:i], *known[i + 1 :]])
        events.append(_said(one, every[one.recording], h, replace(h, experiments=others)))
    return tuple(sorted(events, key=lambda event: (event.recording, event.at)))


def _said(one: Happened, e: Experiment, h: Hypothesis, without: Hypothesis) -> Event:
    """An event for the answer. without: the hypothesis on recordings without this event."""
    rotary = h.model.nominal.rotary
    force, length = ("N m", "rad") if rotary else ("N", "m")
    masses = h.model.nominal.chain.masses.size
    if one.source.lasting:
        return _slipped(one, e, h)
    begins, ends, one = edges(without, one)
    q, noise = _motion(one, h)
    f, c, period = one.force, one.covariance, e.period
    first, last = one.first, one.last
    way = np.diff(q[first : last + 1])
    steps = np.diff(np.concatenate([[0.0], f, [0.0]]))
    means = _means(f.size, max(1, round(MEAN_S / period)))
    largest = int(np.argmax(np.abs(means @ f)))
    impulse = _estimate(period * f.sum(), period * np.sqrt(c.sum()), f"{force} s")
    energy = _estimate(f @ way, np.sqrt(way @ c @ way + (noise * np.linalg.norm(steps)) ** 2), "J")
    row = means[largest]
    most = _estimate(row @ f, np.sqrt(row @ c @ row), force)
    kind = _kind(one, q, period, begins[1], ends[1], impulse.value)
    if kind in (HIT, STOP, PUSH) and _opposes(f, c):
        kind = UNEXPLAINED
    short = kind in (HIT, STOP, PUSH, UNEXPLAINED)
    start = e.begins + period * first
    middle, spread = _middle(f, c)
    wide = Z95 * spread + 0.5
    if short:
        at, between = middle, (middle - wide, middle + wide)
        until, until_between = None, None
    else:
        at, between = begins[1], (begins[0], begins[2])
        until, until_between = ends[1], (ends[0], ends[2])

    def seconds(pair: tuple[float, float]) -> tuple[float, float]:
        return start + period * pair[0], start + period * pair[1]

    return Event(
        kind, one.source.place, e.name, start + period * at, seconds(between),
        None if until is None else start + period * until,
        None if until_between is None else seconds(until_between),
        most, impulse, energy, None,
        float(q[first + int(middle)]) if kind == STOP and 0 <= middle < last - first else None,
        one.elsewhere, one.gain, masses, _course(one, e, q, force, length),
    )  # fmt: skip


def _slipped(one: Happened, e: Experiment, h: Hypothesis) -> Event:
    rotary = h.model.nominal.rotary
    force, length = ("N m", "rad") if rotary else ("N", "m")
    device = h.model.build(h.x)
    spread = float(np.sqrt(one.covariance[0, 0]))
    pushed: Estimate | None = None
    scale = 1.0
    if one.source.sensor is None:
        place = place_at(one.source.place)
        springs = device.chain.link_springs
        spring = springs[place.index] if place.kind == "link" else device.chain.ground_spring
        pushed = _estimate(float(one.force[0]), spread, force)
        scale = 1.0 / float(spring)
    slip = _estimate(scale * float(one.force[0]), scale * spread, length)
    q, _ = _motion(one, h)
    low, high = one.between
    at = one.first if one.source.sensor is None else 0.5 * (low + high)
    return Event(
        SLIP, one.source.place, e.name, e.begins + e.period * at,
        (e.begins + e.period * low, e.begins + e.period * high), None, None, pushed, None, None,
        slip, None, one.elsewhere, one.gain, device.chain.masses.size,
        _course(one, e, q, force, length),
    )  # fmt: skip


def _estimate(value: float | Floats, error: float | Floats, unit: str) -> Estimate:
    return Estimate(float(value), float(value - Z95 * error), float(value + Z95 * error), unit)


def _motion(one: Happened, h: Hypothesis) -> tuple[Floats, float]:
    """Position (ticks + 1,) at an event's place, measured or from the observer, and its noise."""
    e, model = h.problem.experiments[one.recording], h.model
    if (o := one.source.sensor) is not None:
        return np.append(e.measured[:, o], e.measured[-1, o]), float(h.noise.observer.deviation[o])
    ends = place_at(one.source.place).ends
    total, noise = np.zeros(e.ticks), 0.0
    states: Floats | None = None
    for sign, mass in zip((1.0, -1.0), ends, strict=True):
        if mass < 0:
            continue
        own = [o for o, out in enumerate(e.outputs) if out.tells_position and out.mass == mass]
        if own:
            total = total + sign * e.measured[:, own[0]]
            noise += float(h.noise.observer.deviation[own[0]])
            continue
        if states is None:
            device = model.acting(h.x)
            states = followed(device, model.seen(e, h.x), h.noise.observer.gain)
        total = total + sign * states[:, mass]
    return np.append(total, 2.0 * total[-1] - total[-2]), noise


def _means(ticks: int, over: int) -> Floats:
    """Rows (means, ticks) that average a force over so many ticks, one for each start."""
    over = min(over, ticks)
    return np.array([np.roll(np.arange(ticks) < over, k) for k in range(ticks - over + 1)]) / over


def _middle(f: Floats, c: Floats) -> tuple[float, float]:
    """Return the middle of a force, in ticks from its first, and the middle's standard error."""
    ticks = np.arange(f.size) + 0.5
    total = float(f.sum())
    middle = float(f @ ticks) / total if total else 0.0
    if not 0.0 <= middle <= f.size:  # it pushes both ways
        size = np.abs(f)
        return float(size @ ticks / size.sum()), 0.5 * f.size / Z95
    slopes = (ticks - middle) / total
    return middle, float(np.sqrt(max(slopes @ c @ slopes, 0.0)))


def _opposes(f: Floats, c: Floats) -> bool:
    """Whether a force (ticks,) with covariance c clearly pushes both ways."""
    total = np.concatenate([[0.0], np.cumsum(f)])
    spans = np.subtract.outer(total, total)  # [b, a]: the impulse from tick a to tick b
    spans[np.triu_indices(total.size)] = 0.0
    each: list[float] = []
    for sign in (1.0, -1.0):
        last, first = np.unravel_index(np.argmax(sign * spans), spans.shape)
        size, error = sign * spans[last, first], np.sqrt(c[first:last, first:last].sum())
        if size <= VERDICT.apart * error:
            return False
        each.append(float(size))
    return min(each) > EVENTS.opposed * max(each)


def _kind(
    one: Happened, q: Floats, period: float, begins: float, ends: float, impulse: float
) -> str:
    """Classify the event of a force by the motion."""
    a = min(one.first + round(begins), q.size - 2)
    b = min(max(one.first + round(ends), a + 1), q.size - 1)
    usual = float(np.std(np.diff(q))) / period
    lasts = (b - a) * period
    if lasts > SHORT_S and b - a >= 8:
        margin = max(2, (b - a) // 8)
        inner = q[a + margin : b - margin + 1]
        if np.ptp(inner) < STILL * usual * inner.size * period:
            return JAM
    if lasts <= SHORT_S:
        beside = max(2, round(MEAN_S / period))
        before = (q[a] - q[max(0, a - beside)]) / (period * min(a, beside))
        after = (q[min(q.size - 1, b + beside)] - q[b]) / (period * beside)
        way = np.sign(before)
        far = float(np.max(way * q)) - float(np.max(way * q[a : b + 1]))
        at_end = far < AT_AN_END * float(np.ptp(q))
        if impulse * before < 0.0 and way * after < STILL * abs(before) and at_end:
            return STOP
        return HIT
    return TOUCH if lasts >= LONG_S else PUSH


def _course(one: Happened, e: Experiment, q: Floats, force: str, length: str) -> Course:
    beside = round(PICTURE_S / e.period)
    a, b = max(0, one.first - beside), min(e.ticks, one.last + beside)
    ticks = np.arange(a, b, dtype=np.float64)
    f, error = np.zeros(ticks.size), np.zeros(ticks.size)
    end = e.ticks if one.source.lasting else one.last
    on = (ticks >= one.first) & (ticks < end)
    f[on] = one.force if not one.source.lasting else one.force[0]
    own = np.sqrt(np.diag(one.covariance))
    error[on] = own if not one.source.lasting else own[0]
    unit = length if one.source.sensor is not None else force
    return Course(
        e.begins + e.period * ticks, f, f - Z95 * error, f + Z95 * error, q[a:b], unit, length
    )
