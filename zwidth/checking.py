"""Whether a device file still describes its machine: its free runs against the band in its file.

Each recording is judged by itself (`diagnosis.answer.band`). If it is within the band as recorded,
wrong signs and similar faults are not searched for. If one is outside, the parameters of the
device, including its delay, are fitted again to the recordings outside (no effects are searched
for), and the fewest changes that explain the fit are reported. Near the fitted x the cost is (x -
x_fit)' H (x - x_fit), where H is the inverse of the covariance of x, so the share that any subset
explains, with the others as in the file, follows by algebra. This form holds only near the fitted
x, so if the best subset fails, the next ones are fitted too and the real costs decide. Free runs
then show whether these changes alone bring the recording back within the band; only then are they
named. If no change explains all recordings outside, each is fitted by itself.

The amount of fitted data is limited, so that many or long recordings take no longer: an equal share
of each, from the beginning of its motion. (During motion the initial state is less certain.) Named
changes are verified on all of each recording.

The parameters in the file are themselves uncertain, and another motion may depend on them more than
the held-out data did. So before a recording is called outside, the band is widened by the errors
that the file's posterior implies for this recording (`_widened`).

If a reading has less noise than the band (a simulation, for example), the missing noise is added
for the fit. Without it, -2 log likelihood counts errors far below those that the band allows: the
form is then too narrow to hold over a change of a few percent.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import t as student

from zwidth.diagnosis.answer.band import RARE, Windows, most, of_windows, windows_of
from zwidth.diagnosis.answer.findings import UNITS
from zwidth.diagnosis.answer.words import effect_in_words, listed, parameter_in_words
from zwidth.diagnosis.compiled import compiled
from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.fitting.uncertainty import Z95, covariance
from zwidth.diagnosis.intake.gate import Fault, oddities
from zwidth.diagnosis.intake.take_in import readings, said_once
from zwidth.diagnosis.model.own_values import first_x
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.export.draws import draws_of
from zwidth.fleet.quick import physical, reported
from zwidth.fleet.structure import known_structure
from zwidth.shown import Shown, Valued
from zwidth.sim.band import Band, OutputBand
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.sim.place import place_at
from zwidth.sim.readable import percent, with_unit

Floats = NDArray[np.float64]
Simulate = Callable[[Experiment, Band], Windows]
"""Returns free runs of another simulator over the windows of a recording."""
FITTED = 50_000  # ticks times parameters of a fit, so that a check takes ten seconds
LEAST = 1000  # least ticks fitted of a recording; rather fewer recordings than fewer ticks
LOOKED = 4000  # ticks that are searched for wrong signs and similar faults
ALONE = 4  # most recordings that are fitted by themselves
ORIGINS = 10_000  # ticks to which the origins of a recording are fitted
MOST = 3  # changes listed in a sentence
TRIED = 3  # single changes that are fitted if the best one by the quadratic form fails
DIGITS = 2  # most digits of a change
SEED = 0  # of the noise that is added to a reading without noise
CLEAR = 9.0  # least cost that a change must explain
ENOUGH = 0.05  # share of the error that may be left unexplained
TELLING = 3.0  # least motion of a useful output, over its noise
STEP, TURNS = 1e-3, 12  # in x, for slopes; most turns of the fit of changes
DRAWS = 12  # number of draws from the posterior
FEWEST, FAR = 3, 3.0  # draws that suffice if the error is this many times what they imply
HOPELESS = 3.0  # ratio of errors with all parameters free to explained ones: no two explain them
TURN = 0.3  # rad, one unit of x: a relative unit would vanish for an angle near zero
WIDE = 10.0  # least standard deviations of a parameter in one unit of x
ONSET = 0.01  # of the largest deviation from the first sample: motion has begun
DELAY = "loop_delay"
NO_CHANGE = (
    "no change of the device's parameters explains {}; --diagnose searches for other physics"
)
NO_BAND = (
    "{} has no [band], which gives the allowed error; take the improved device that 'zwidth"
    " diagnose' writes (NAME.augmented.toml)"
)


@dataclass(frozen=True)
class Output(Valued):
    """An output of a recording [its unit], rms: free-run error, and the limit of the band.

    diagnosed: the error when the device was diagnosed; motion: of the recording, in the windows.
    """

    name: str
    unit: str
    error: float
    most: float
    diagnosed: float
    motion: float

    @property
    def within(self) -> bool:
        """Whether the error is within the band."""
        return self.error <= self.most

    @property
    def sentence(self) -> str:
        """Say error and band."""
        is_ = "within" if self.within else "outside"
        return (
            f"{self.name}: free runs have an error of {with_unit(self.error, self.unit, 3)}, {is_}"
            f" the band (up to {with_unit(self.most, self.unit, 3)})"
        )


@dataclass(frozen=True)
class Recording(Valued):
    """The check of one recording. news: its faults that the diagnosis did not report."""

    name: str
    outputs: tuple[Output, ...]
    news: tuple[Fault, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def within(self) -> bool:
        """Whether every output is within the band and the recording has no new faults."""
        return all(o.within for o in self.outputs) and not self.news

    @property
    def sentence(self) -> str:
        """The outputs outside the band, or that there are none, in a sentence."""
        return "; ".join([*(f.sentence for f in self.news), *(o.sentence for o in self.outputs)])


@dataclass(frozen=True)
class Changed(Valued):
    """A parameter of the device whose value has changed. half_width: of its 95 % interval.

    recording: the one in which it changed; "" for the same change in all that are outside.
    """

    name: str
    words: str
    was: float
    now: float
    half_width: float
    unit: str
    relative: bool
    recording: str = ""

    @property
    def sentence(self) -> str:
        """The change in words: "Coulomb friction +12 %"."""
        by = self.now - self.was
        sign, size = "+" if by > 0.0 else "-", _rounded(abs(by), self.half_width)
        if self.relative:
            share = abs(1.0 / self.was)
            much = percent(_rounded(abs(by) * share, self.half_width * share))
        else:
            much = with_unit(size, self.unit, DIGITS)
        return f"{self.words} {sign}{much}"

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "parameter": self.name, "was": self.was, "now": self.now, "unit": self.unit,
            "ci95": [self.now - self.half_width, self.now + self.half_width],
            "recording": self.recording or None,
        }  # fmt: skip


@dataclass(frozen=True, repr=False)
class Check(Shown):
    """Whether a simulation still predicts its machine. simulator: its name, "" for the device.

    changed: the refitted parameters that bring recordings outside the band back; empty if none do;
    explains: whether they bring all back. unexplained: recordings, each fitted by itself, that no
    change brings back; left: further ones that were not fitted by themselves. since: the simulator
    of the band, with its version; "" if the band is the device's own.
    """

    device: str
    recordings: tuple[Recording, ...]
    changed: tuple[Changed, ...] = ()
    explains: bool = False
    simulator: str = ""
    device_within: bool | None = None
    unexplained: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    since: str = ""

    @property
    def within(self) -> bool:
        """Whether all recordings are within the band."""
        return all(r.within for r in self.recordings)

    @property
    def sentence(self) -> str:
        """The answer in one sentence, without a full stop."""
        what = self.simulator or f"device '{self.device}'"
        outside = [r for r in self.recordings if not r.within]
        if not outside:
            count = len(self.recordings)
            those = "the recording" if count == 1 else f"all {count} recordings"
            return f"{what} still describes {those}: errors of free runs are within its band"
        head = f"{what} no longer describes {listed([r.name for r in outside])}"
        faults = [f.sentence for r in outside for f in r.news]
        if faults:
            return f"{head}: {faults[0]}"
        if self.simulator and self.device_within:
            return (
                f"{head}, but device '{self.device}' still does: {self._suspect} has changed, not"
                " the machine"
            )
        if not self.changed:
            return f"{head}: {NO_CHANGE.format('the errors')}"
        return f"{head}: {'; '.join(self._causes())}"

    def _causes(self) -> Iterator[str]:
        """What changed, in words, and which recordings that leaves."""
        of: dict[str, list[str]] = {}
        for name in dict.fromkeys(c.recording for c in self.changed):
            said = listed([c.sentence for c in self.changed if c.recording == name])
            of.setdefault(said, []).append(name)
        for said, names in of.items():
            yield said if names == [""] else f"{said} in {listed(names)}"
        if self.unexplained:
            yield NO_CHANGE.format(listed(self.unexplained))
        if self.left:
            yield f"check {listed(self.left)} alone, too"

    @property
    def _suspect(self) -> str:
        """Say what changed if the machine did not: the simulator only with another version."""
        now = self.simulator.rpartition(" in ")[2]
        if not self.since:
            return "the model or its simulator"
        if self.since == now:
            return f"the model, in the same {now},"
        return f"the model or its simulator ({self.since} -> {now.rpartition(' ')[2]})"

    def as_json(self) -> dict[str, Any]:
        """Return the JSON of `zwidth check`."""
        return {
            "within": self.within,
            "sentence": self.sentence,
            "device": self.device,
            "simulator": self.simulator or None,
            "device_within": self.device_within,
            "recordings": [
                {
                    "recording": r.name,
                    "within": r.within,
                    "outputs": [
                        {
                            "output": o.name, "unit": o.unit,
                            "error": o.error if math.isfinite(o.error) else None,
                            "most": o.most, "diagnosed": o.diagnosed, "motion": o.motion,
                            "within": o.within,
                        }
                        for o in r.outputs
                    ],
                    "faults": [f.sentence for f in r.news],
                    "remarks": list(r.remarks),
                }
                for r in self.recordings
            ],
            "changed": [c.as_json() for c in self.changed],
            "explains": self.explains,
        }  # fmt: skip


def check(
    device: Device,
    recordings: Sequence[tuple[str, Sequence[Experiment]]],
    simulate: Simulate | None = None,
    simulator: str = "",
    say: Callable[[str], None] = lambda _: None,
) -> Check:
    """Return whether a device still describes recordings, each with its stretches.

    simulate: runs another simulator over a stretch; simulator: its name. say: called with the next
    step, in words. Raises ValueError if the device has no band, if its outputs are not those of a
    recording, or if a recording has no motion; ExperimentError if no recording can be used.
    """
    if device.band is None:
        raise ValueError(NO_BAND.format(device.name))
    compiled()
    run = _Runs(device)
    pairs: list[tuple[_Taken, Recording]] = []
    for done, (name, stretches) in enumerate(recordings):
        say(f"{100.0 * done / len(recordings):.0f} %, checking {name}")
        pairs.append(_read(name, stretches, run))
    own = found = [said for _, said in pairs]
    if simulate is not None:
        say(f"simulating the recordings in {simulator}")
        found = [_judged(one, run, simulate) for one, _ in pairs]
    outside = [one for one, said in pairs if not said.within]
    named = _Named()
    if outside and not any(said.news for said in own):
        named = _named(outside, run, say)
    told = None if simulate is None else all(said.within for said in own)
    explains = bool(named.changed) and not (named.unexplained or named.left)
    return Check(device.name, tuple(found), named.changed, explains, simulator, told,
                 named.unexplained, named.left, device.band.simulator)  # fmt: skip


def rebased(
    device: Device,
    recordings: Sequence[tuple[str, Sequence[Experiment]]],
    simulate: Simulate | None = None,
    simulator: str = "",
) -> Device:
    """Return a device whose band is computed from the errors of free runs on these recordings.

    simulate: as in `check`; simulator: its name with its version ("MuJoCo 4.0.0"), stored in the
    band. Raises as `check`, and ValueError for fewer than two windows.
    """
    band = device.band
    if band is None:
        raise ValueError(NO_BAND.format(device.name))
    run = _Runs(device)
    pairs = [_read(name, stretches, run) for name, stretches in recordings]
    every = [e for one, _ in pairs for e in one.stretches]
    found = _joined([(simulate or run)(e, band) for e in every], pairs[0][0].name)
    kinds = [f.kind for one, _ in pairs for f in one.faults if f.wrong]
    new = of_windows(found, band.window, band.ratio, kinds)
    if new is None:
        raise ValueError(
            f"the recordings give {found.error.shape[0]} free run(s) of {band.window:g} s without"
            " overflow, but a band needs at least two; give longer recordings"
        )
    return replace(device, band=replace(new, simulator=simulator))


class _Taken(NamedTuple):
    """A recording, corrected for one suspected fault or none: its stretches, and the fault."""

    name: str
    stretches: tuple[Experiment, ...]
    faults: tuple[Fault, ...]


def _read(name: str, stretches: Sequence[Experiment], run: "_Runs") -> tuple[_Taken, Recording]:
    """A recording as it is, or corrected for a suspected fault if it is then within the band."""
    device = run.device
    odd = said_once([fault for e in stretches for fault in oddities(device, e)])
    as_is = _Taken(name, tuple(stretches), tuple(odd))
    judged_as_is = None
    with suppress(ValueError):  # it may have to be read differently, as counts
        judged_as_is = _judged(as_is, run, run)
        if all(o.within for o in judged_as_is.outputs):
            return as_is, judged_as_is
    parts = [_short(e, LOOKED) for e in stretches]
    every = readings(device, parts, None)
    if judged_as_is is not None and len(every) == 1 and _unread(every[0].whole, parts):
        return as_is, judged_as_is
    if any(a is not b for a, b in zip(parts, stretches, strict=True)):
        every = readings(device, stretches, None)
    taken = [_Taken(name, r.whole, r.faults) for r in every]
    first, *others = ((one, _judged(one, run, run)) for one in taken)
    if all(o.within for o in first[1].outputs):
        return first
    return next((pair for pair in others if all(o.within for o in pair[1].outputs)), first)


def _unread(read: Sequence[Experiment], given: Sequence[Experiment]) -> bool:
    """Whether recordings were read as they are. A change of anything makes a new object."""
    names = [f.name for f in fields(Experiment) if f.name != "swing"]
    return len(read) == len(given) and all(
        getattr(a, name) is getattr(b, name)
        for a, b in zip(read, given, strict=True)
        for name in names
    )


class _Runs:
    """Free runs of the device itself, with the origins and zeros of each recording fitted.

    What was simulated is kept.
    """

    def __init__(self, device: Device) -> None:
        self.device, self.model = device, Model(device)
        kinds = ("origin", "zero")
        self.free = [i for i, p in enumerate(self.model.parameters) if p.kind in kinds]
        self._fits: dict[int, tuple[Experiment, Hypothesis]] = {}
        self._runs: dict[int, tuple[Experiment, Windows]] = {}

    def __call__(self, e: Experiment, band: Band) -> Windows:
        """Return the free runs over a recording; raises ExperimentError without an observer."""
        if id(e) not in self._runs:
            try:
                found = windows_of(self.model, self._own(e), [e], band.ratio, band.window)
            except NoObserver as error:
                raise ExperimentError(f"{e.name}: {error}") from error
            self._runs[id(e)] = e, found
        return self._runs[id(e)][1]

    def near(self, drawn: Device, e: Experiment, part: Experiment, band: Band) -> Windows:
        """Return those of a device near this one over a part of a recording; raises NoObserver.

        Its origins and zeros are those of this device on the recording, corrected by one step.
        """
        if drawn is self.device and part is e and not self.free:
            return self(e, band)
        model, x = Model(drawn), self._own(e)
        if self.free:
            problem = Problem([part], self._fit(e).noise.observer)
            steps = STEP * np.eye(x.size)[self.free]
            here, *ahead = problem.weighted_each(model, [x, *(x + step for step in steps)])
            slopes = np.stack([(one - here) / STEP for one in ahead], axis=1)
            x[self.free] -= np.linalg.lstsq(slopes, here, rcond=None)[0]
        return windows_of(model, x, [part], band.ratio, band.window)

    def _fit(self, e: Experiment) -> Hypothesis:
        if id(e) not in self._fits:
            begun = judged([_short(e, ORIGINS)], self.model, first_x(self.model, [e]))
            self._fits[id(e)] = e, settled(begun, turns=1)
        return self._fits[id(e)][1]

    def _own(self, e: Experiment) -> Floats:
        """The x of the device itself, but with the origins and zeros of a recording."""
        x = np.zeros(len(self.model.parameters))
        if self.free:
            h = self._fit(e)
            x[self.free] = _beside(h.x, covariance(h.fitted), self.free, x)[self.free]
        return x


def _short(e: Experiment, ticks: int) -> Experiment:
    return e if e.ticks <= ticks else e.part(0, ticks)


def _judged(one: _Taken, own: _Runs, simulate: Simulate) -> Recording:
    """The check of a recording by free runs of a simulator."""
    device, band = own.device, own.device.band
    assert band is not None
    each = [simulate(e, band) for e in one.stretches]
    found = _joined(each, one.name)
    outputs = tuple(_output(device, band, o, found, one.name) for o in band.outputs
                    if o.name in found.names)  # fmt: skip
    if not outputs:
        raise ValueError(
            f"{one.name} has {', '.join(found.names)}, but the band of {device.name} is for"
            f" {', '.join(o.name for o in band.outputs)}; give a recording with one of these"
        )
    if device.posterior is not None and not all(o.within for o in outputs):
        outputs = _widened(own, one, outputs)
    news = tuple(f for f in one.faults if f.wrong and f.kind not in band.corrected)
    remarks = tuple(f.sentence for f in one.faults if f not in news)
    return Recording(one.name, outputs, news, remarks)


def _widened(own: _Runs, one: _Taken, outputs: Sequence[Output]) -> tuple[Output, ...]:
    """Outputs with the band wider by the errors that the parameters' uncertainty may well imply.

    For the error e of the file and what a draw adds to it, E |e + d|^2 = |e|^2 + E |d|^2, since d
    scatters about zero. A draw that overflows says nothing. The scatter of so few draws is itself
    uncertain, so the quantile is Student's. A few draws may by chance lie on the side of e where
    they lower the error, so these end it only if their scatter is small, too.
    """
    device, band = own.device, own.device.band
    assert band is not None
    names = [o.name for o in one.stretches[0].outputs]
    at = [names.index(o.name) for o in outputs]

    def squares(of: Device) -> Floats:
        runs = [own.near(of, e, e, band) for e in one.stretches]
        return _joined(runs, one.name).error.mean(axis=0)[at]

    base = squares(device)

    def wider(by: Floats) -> tuple[Output, ...]:
        return tuple(replace(o, most=math.hypot(o.most, more))
                     for o, more in zip(outputs, by.tolist(), strict=True))  # fmt: skip

    wide, told = tuple(outputs), list[Floats]()
    for each in draws_of(device, DRAWS, SEED).devices:
        with suppress(NoObserver):
            found = squares(each)
            told += [found] if np.all(np.isfinite(found)) else []
        if not told:
            continue
        far = float(student.ppf(1.0 - 0.5 * RARE, len(told)))
        added = np.maximum(np.mean(told, axis=0) - base, 0.0)
        wide = wider(far * np.sqrt(added))
        widest = wider(far * np.sqrt(added + np.std(told, axis=0)))
        if len(told) >= FEWEST and any(o.error > FAR * o.most for o in widest):
            break
    return wide


def _joined(parts: Sequence[Windows], name: str) -> Windows:
    found = Windows(
        parts[0].names,
        np.concatenate([p.error for p in parts]),
        np.concatenate([p.motion for p in parts]),
        np.max([p.noise for p in parts], axis=0),
    )
    if found.error.shape[0] == 0:
        raise ValueError(
            f"{name} is too short for one free run of the band; give a longer recording"
        )
    return found


def _output(device: Device, band: Band, own: OutputBand, found: Windows, name: str) -> Output:
    place = found.names.index(own.name)
    length = "rad" if device.rotary else "m"
    unit = {"position": length, "velocity": f"{length}/s"}.get(own.name.split("_")[0], "")
    motion = float(np.sqrt(found.motion[:, place].mean()))
    if motion < TELLING * own.noise:
        raise ValueError(
            f"{name}: {own.name} moves by {with_unit(motion, unit, 3)} rms and its noise is"
            f" {with_unit(own.noise, unit, 3)}: too little motion to check anything; give a"
            " recording in which the device moves"
        )
    error = float(found.rms[place])
    return Output(own.name, unit, error, most(band, own, found), own.error, motion)


class _Named(NamedTuple):
    """What changed; the recordings that this leaves, of which some were not fitted alone."""

    changed: tuple[Changed, ...] = ()
    unexplained: tuple[str, ...] = ()
    left: tuple[str, ...] = ()


def _named(outside: Sequence[_Taken], own: _Runs, say: Callable[[str], None]) -> _Named:
    """What changed in all recordings outside alike or, if nothing did, in each by itself."""
    say("refitting the parameters, to find which of them changed")
    changed = _changes(outside, own, FITTED)
    if changed or len(outside) == 1:
        return _Named(changed)
    unexplained: list[str] = []
    alone = outside[:ALONE]
    for one in alone:
        say(f"refitting the parameters to {one.name} alone")
        found = _changes([one], own, FITTED // len(alone))
        changed += tuple(replace(c, recording=one.name) for c in found)
        unexplained += [] if found else [one.name]
    if not changed:
        return _Named()
    return _Named(changed, tuple(unexplained), tuple(one.name for one in outside[ALONE:]))


def _changes(outside: Sequence[_Taken], own: _Runs, fitted: int) -> tuple[Changed, ...]:
    """The fewest changes that alone bring recordings within the band; none if there are no such.

    fitted: ticks times parameters of the fit.
    """
    band = own.device.band
    assert band is not None
    model, name = _model(own.device), outside[0].name
    every = [e for one in outside for e in one.stretches]
    parts = _parts(every, own, band, fitted // len(model.parameters))
    fit_on = [_coarse(part, band) for _, part in parts]
    try:
        h = settled(judged(fit_on, model, model.within(first_x(model, fit_on))))
    except NoObserver:
        return ()
    if not any(p.name == f"{DELAY}@clock.delay" for p in h.model.parameters):
        return ()
    nominal = _nominal(h, model)

    def off(x: Floats, some: Sequence[Experiment], before: Sequence[Windows]) -> float:
        """The largest error of free runs of the fit over what explains them."""
        try:
            runs = [windows_of(h.model, x, [e], band.ratio, band.window) for e in some]
        except NoObserver:
            return math.inf
        return _excess(band, _joined(runs, name), _joined(before, name).rms)

    on_all = every, [own(e, band) for e in every]
    on_parts = [e for _, e in parts], [own.near(own.device, *both, band) for both in parts]
    parted = len(parts) < len(every) or any(part is not e for e, part in parts)
    told: list[_Way] = []
    most_ways = MOST if off(h.x, *on_parts) < HOPELESS else 1
    while len(told) < most_ways and (ways := _next(h, nominal, told)):
        tried: list[tuple[float, list[_Way], Floats, float]] = []
        for way in ways:
            x, cost = _fitted(h, nominal, [*told, way])
            excess = off(x, *on_parts)
            if parted and excess < HOPELESS:  # the whole recording decides
                excess = off(x, *on_all)
            tried.append((cost, [*told, way], x, excess))
            if excess <= 1.0:
                break
        _, told, x, excess = min(tried, key=lambda one: (one[-1] > 1.0, one[0]))
        if excess <= 1.0:
            return tuple(_changed(h, way, x, nominal) for way in told)
    return ()


def _model(device: Device) -> Model:
    """The device with all its parameters free, and its delay.

    One unit of x is a share of a value, which says nothing of an angle or an offset near zero: a
    fit with such a unit does not end.
    """
    structure = known_structure(device.with_interface(delay=0.0))
    late, period = device.interface.delay, device.interface.period
    known = device.posterior
    sd = {} if known is None else dict(zip(known.names, known.sd, strict=True))
    each = zip(structure.effects, structure.labels, structure.scales, strict=True)
    scales = [
        {
            key: max(scale, TURN * (key in p.effect.turning), WIDE * sd.get(f"{label}.{key}", 0.0))
            for key, scale in own.items()
        }
        for p, label, own in each
    ]
    return Model(
        structure.device,
        (*structure.effects, make_physics(DELAY, "clock", delay=late)),
        (*scales, {"delay": period}),
        bounds=(*structure.bounds, {}),
    )


def _parts(
    every: Sequence[Experiment], own: _Runs, band: Band, ticks: int
) -> list[tuple[Experiment, Experiment]]:
    """Recordings, each with the part to fit, of so many ticks together.

    Of too many for that it is those with the largest errors.
    """
    most = sorted(every, key=lambda e: -_size(own(e, band), band))[: max(1, ticks // LEAST)]
    return [(e, _begun(e, max(LEAST, ticks // len(most)))) for e in most]


def _size(runs: Windows, band: Band) -> float:
    """The largest rms error of free runs over the noise of its output."""
    noise = {o.name: max(o.noise, np.finfo(np.float64).tiny) for o in band.outputs}
    sizes = zip(runs.names, runs.rms.tolist(), strict=True)
    return max((rms / noise[name] for name, rms in sizes if name in noise), default=0.0)


def _begun(e: Experiment, ticks: int) -> Experiment:
    """The part of a recording, of so many ticks, from where its motion begins."""
    if ticks >= e.ticks:
        return e
    away = np.nan_to_num(np.abs(e.measured - e.measured[0]))
    onset = int(np.argmax(np.any(away > ONSET * away.max(axis=0), axis=1)))
    begin = min(max(0, onset - 2 * SETTLING), e.ticks - ticks)
    return e.part(begin, begin + ticks)


def _coarse(e: Experiment, band: Band) -> Experiment:
    """A recording whose readings have at least the noise of the band.

    The own noise of a reading is that of its fourth differences, in which little motion is left:
    their variance is 70 times that of white noise.
    """
    random = np.random.default_rng(SEED)
    known = {o.name: o.noise for o in band.outputs}
    measured = e.measured.copy()
    for place, output in enumerate(e.outputs):
        fourth = np.abs(np.diff(measured[:, place], 4))
        own = 1.4826 * float(np.median(fourth[np.isfinite(fourth)])) / math.sqrt(70.0)
        less = known.get(output.name, 0.0) ** 2 - own**2
        if less > 0.0:
            measured[:, place] += math.sqrt(less) * random.standard_normal(e.ticks)
    return replace(e, measured=measured)


def _excess(band: Band, found: Windows, before: Floats) -> float:
    """The largest error of free runs over what explains them: the band, or a share of before."""
    most_of_all = 0.0
    for output in band.outputs:
        if output.name in found.names:
            place = found.names.index(output.name)
            enough = max(most(band, output, found), ENOUGH * float(before[place]))
            share = float(found.rms[place]) / enough
            most_of_all = max(most_of_all, math.inf if math.isnan(share) else share)
    return most_of_all


def _nominal(h: Hypothesis, model: Model) -> Floats:
    """The x of a fit for the device file, whose effects may have started elsewhere since."""
    x = np.zeros(h.x.size)
    for i, (p, first) in enumerate(zip(h.model.parameters, model.parameters, strict=True)):
        if p.kind == "effect":
            was = model.effects[first.index].values[first.key]
            x[i] = (was - h.model.effects[p.index].values[p.key]) / p.scale
    return x


def _beside(x: Floats, spread: Floats, free: Sequence[int], others: Floats) -> Floats:
    """Return x with the free components optimal for the given other components."""
    told = np.flatnonzero(np.isfinite(np.diag(spread)))
    held = [i for i in told.tolist() if i not in free]
    own = [i for i in told.tolist() if i in free]
    found = others.copy()
    h = np.linalg.pinv(spread[np.ix_(told, told)], hermitian=True)
    at = {i: k for k, i in enumerate(told.tolist())}
    a, b = [at[i] for i in own], [at[i] for i in held]
    found[own] = x[own]
    if held and own:
        found[own] += np.linalg.solve(h[np.ix_(a, a)], h[np.ix_(a, b)] @ (x[held] - others[held]))
    return found


class _Way(NamedTuple):
    """A direction in x: of one parameter, or of all forces of an effect by the same share."""

    places: tuple[int, ...]
    slope: Floats


def _ways(h: Hypothesis, nominal: Floats, own: Sequence[int]) -> list[_Way]:
    """The single changes to try: all forces of an effect by one factor, then each parameter."""
    model = h.model
    values, slopes = physical(model, nominal)
    at = {i: k for k, i in enumerate(reported(model))}
    forces: dict[int, list[int]] = {}
    for i in own:
        p = model.parameters[i]
        if p.kind == "effect" and model.effects[p.index].effect.parameter(p.key).unit == "N m":
            forces.setdefault(p.index, []).append(i)
    groups = [tuple(places) for places in forces.values() if len(places) > 1]
    found: list[_Way] = []
    for places in (*groups, *((i,) for i in own)):
        slope = np.zeros(h.x.size)
        for i in places:
            slope[i] = values[at[i]] / slopes[at[i]] if len(places) > 1 else 1.0
        found.append(_Way(places, slope))
    return found


def _next(h: Hypothesis, nominal: Floats, told: Sequence[_Way]) -> list[_Way]:
    """The ways that, beside those told, explain most of a fit by its quadratic form, best first."""
    spread = covariance(h.fitted)
    own = [i for i in reported(h.model) if np.isfinite(spread[i, i])]
    weight = np.linalg.pinv(spread[np.ix_(own, own)], hermitian=True)
    off = h.x[own] - nominal[own]

    def left(ways: Sequence[_Way]) -> float:
        """Excess of the cost over the full fit's if only those ways are free."""
        cost = float(off @ weight @ off)
        if not ways:
            return cost
        free = np.stack([way.slope[own] for way in ways], axis=1)
        told = free.T @ weight @ off
        return cost - float(told @ np.linalg.pinv(free.T @ weight @ free, hermitian=True) @ told)

    taken = {i for way in told for i in way.places}
    before = left(told)
    costs = [(left([*told, way]), way) for way in _ways(h, nominal, own)
             if not taken & set(way.places)]  # fmt: skip
    clear = [one for one in costs if before - one[0] >= CLEAR]
    return [way for _, way in sorted(clear, key=lambda one: one[0])[:TRIED]]


def _fitted(h: Hypothesis, nominal: Floats, ways: Sequence[_Way]) -> tuple[Floats, float]:
    """The x and the cost of the best fit to the recordings if only these ways are free."""
    problem, model = h.problem, h.model
    nuisance = [i for i in range(h.x.size) if i not in reported(model)]
    free = np.stack([*(way.slope for way in ways), *np.eye(h.x.size)[nuisance]], axis=1)
    size = np.abs(free).max(axis=0)
    free = free / size

    def at(z: Floats) -> Floats:
        return model.within(nominal + free @ z)

    def residual(z: Floats) -> Floats:
        x = at(z)
        prior = [xi for p, xi in zip(model.parameters, x, strict=True) if p.prior]
        return np.concatenate([problem.weighted(model, x), prior])

    def slopes(z: Floats) -> Floats:
        steps = STEP * np.eye(z.size)
        ahead = problem.weighted_each(model, [at(z + one) for one in (*steps, *-steps)])
        rise = np.stack(ahead[: z.size], axis=1) - np.stack(ahead[z.size :], axis=1)
        prior = free[[p.prior for p in model.parameters]]
        return np.concatenate([rise / (2.0 * STEP), prior])

    begun = np.linalg.lstsq(free, h.x - nominal, rcond=None)[0]
    found = least_squares(residual, begun, slopes, method="lm", max_nfev=TURNS)
    return at(found.x), 2.0 * float(found.cost)


def _rounded(size: float, half_width: float) -> float:
    """A size to the digits that its error leaves, two at most: 998 -> 1000, 12.4 +- 3 -> 12."""
    if not (size > 0.0 and math.isfinite(size)):
        return size
    first = math.floor(math.log10(size))
    places = DIGITS - 1 - first
    if half_width > 0.0 and math.isfinite(half_width):
        places = min(places, -math.floor(math.log10(half_width)))
    return round(size, max(places, -first))


def _changed(h: Hypothesis, way: _Way, x: Floats, nominal: Floats) -> Changed:
    """A way in words, with its values in the device file and at x."""
    model, index = h.model, way.places[0]
    p = model.parameters[index]
    place = reported(model).index(index)
    (was, _), (now, slope) = physical(model, nominal), physical(model, x)
    half = Z95 * abs(float(slope[place])) * math.sqrt(float(covariance(h.fitted)[index, index]))
    before, after = float(was[place]), float(now[place])
    name = p.name
    if p.kind == "effect":
        physics = model.effects[p.index]
        unit = physics.effect.parameter(p.key).unit_for(model.nominal.rotary)
        whole = len(physics.values) == 1 or len(way.places) > 1
        name = name if len(way.places) == 1 else name.partition(".")[0]
        words = effect_in_words(physics.effect.name) + ("" if whole else f" {p.key}")
        words = "delay" if physics.effect.name == DELAY else words.replace("_", " ")
        if model.nominal.chain.masses.size > 1 and place_at(physics.at).kind == "mass":
            words += f" at {physics.at}"
        turning = p.key in physics.effect.turning
    else:
        unit, turning = UNITS[p.kind][0 if model.nominal.rotary else 1], False
        words = parameter_in_words(p.name, unit)
    relative = words != "delay" and not turning and before * after > 0.0
    return Changed(name, words, before, after, half, unit, relative)
