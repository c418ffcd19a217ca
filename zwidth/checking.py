"""Whether a device file still describes its machine: its free runs against the band in its file.

Each recording is judged by itself (`diagnosis.answer.band`). If one is outside, the parameters of
the device, including its delay, are fitted again to the recordings outside (no effects are searched
for), and the fewest changes that explain the fit are reported. Near the fitted x the cost is (x -
x_fit)' H (x - x_fit), where H is the inverse of the covariance of x, so the share that any subset
explains, with the others as in the file, follows by algebra. A simulation then shows whether these
changes alone bring the free runs back within the band.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from zwidth.diagnosis.answer.band import Windows, most, of_windows, windows_of
from zwidth.diagnosis.answer.findings import UNITS
from zwidth.diagnosis.answer.words import effect_in_words, listed, parameter_in_words
from zwidth.diagnosis.fitting.uncertainty import Z95, covariance
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.intake.take_in import readings
from zwidth.diagnosis.model.own_values import first_x
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.fleet.quick import physical, reported
from zwidth.fleet.structure import known_structure
from zwidth.shown import Shown
from zwidth.sim.band import Band, OutputBand
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.sim.place import place_at
from zwidth.sim.readable import percent, with_unit

Floats = NDArray[np.float64]
Simulate = Callable[[Experiment, Band], Windows]
"""What runs another simulator freely over the windows of a recording."""
FITTED = 10_000  # ticks that parameters are fitted to, at most: a check ends within ten seconds
MOST = 3  # changes that a sentence names
CLEAR = 9.0  # cost that one must explain
ENOUGH = 0.05  # share of the error that may be left unexplained
TELLING = 3.0  # times its noise, that an output must move by to say anything
STEP, TURNS = 1e-3, 12  # in x, of slopes; of the fit of what changed
DELAY = "loop_delay"
NO_BAND = (
    "{} has no [band], which gives the allowed error; take the NAME.augmented.toml that"
    " 'zwidth diagnose' writes"
)


@dataclass(frozen=True)
class Output:
    """An output of a recording [its unit], rms: free-run error, the most that is within the band.

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
class Recording:
    """What the check says of one recording. news: faults of it that the diagnosis had not seen."""

    name: str
    outputs: tuple[Output, ...]
    news: tuple[Fault, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def within(self) -> bool:
        """Whether every output is within the band, and the recording as it should be."""
        return all(o.within for o in self.outputs) and not self.news

    @property
    def sentence(self) -> str:
        """Say what is outside, or that nothing is."""
        return "; ".join([*(f.sentence for f in self.news), *(o.sentence for o in self.outputs)])


@dataclass(frozen=True)
class Changed:
    """A parameter of the device that has another value now. half_width: of the 95 % interval."""

    name: str
    words: str
    was: float
    now: float
    half_width: float
    unit: str
    relative: bool

    @property
    def sentence(self) -> str:
        """Say it: "Coulomb friction +12 %"."""
        by = self.now - self.was
        sign = "+" if by > 0.0 else "-"
        much = percent(abs(by / self.was)) if self.relative else with_unit(abs(by), self.unit, 3)
        return f"{self.words} {sign}{much}"

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "parameter": self.name, "was": self.was, "now": self.now, "unit": self.unit,
            "ci95": [self.now - self.half_width, self.now + self.half_width],
        }  # fmt: skip


@dataclass(frozen=True, repr=False)
class Check(Shown):
    """Whether a simulation still predicts its machine. simulator: its name, "" for the device.

    changed: the refitted parameters that bring recordings outside the band closer to it; explains:
    whether they bring them within it.
    """

    device: str
    recordings: tuple[Recording, ...]
    changed: tuple[Changed, ...] = ()
    explains: bool = False
    simulator: str = ""
    device_within: bool | None = None

    @property
    def within(self) -> bool:
        """Whether all recordings are within the band."""
        return all(r.within for r in self.recordings)

    @property
    def sentence(self) -> str:
        """The answer in one sentence, without a full stop."""
        what = self.simulator or f"'{self.device}'"
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
                f"{head}, but '{self.device}' still does: the machine is as it was, but the model"
                " or its simulator changed"
            )
        if not self.changed:
            return f"{head}: no change of its own parameters explains it; --diagnose searches"
        names = listed([c.sentence for c in self.changed])
        if self.explains:
            return f"{head}: {names}"
        return f"{head}: {names}, which does not explain it all; --diagnose searches"

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
) -> Check:
    """Return whether a device still describes recordings, each with its stretches.

    simulate: runs another simulator over a stretch, and simulator names it. Raises ValueError if
    the device has no band, if its outputs are not those of a recording, or if a recording has no
    motion; ExperimentError if no recording can be used.
    """
    if device.band is None:
        raise ValueError(NO_BAND.format(device.name))
    run = _own_runs(device)
    pairs = [_read(device, name, stretches, run) for name, stretches in recordings]
    own = found = [said for _, said in pairs]
    if simulate is not None:
        found = [_judged(device, one, simulate) for one, _ in pairs]
    outside = [one for one, said in pairs if not said.within]
    changed: tuple[Changed, ...] = ()
    explains = False
    if outside and not any(said.news for said in own):
        changed, explains = _changes(device, outside, run)
    told = None if simulate is None else all(said.within for said in own)
    return Check(device.name, tuple(found), changed, explains, simulator, told)


def rebased(
    device: Device,
    recordings: Sequence[tuple[str, Sequence[Experiment]]],
    simulate: Simulate | None = None,
) -> Device:
    """Return a device whose band is taken from the errors of free runs on these recordings.

    simulate: as `check` takes it. Raises as `check`, and ValueError for fewer than two windows.
    """
    band = device.band
    if band is None:
        raise ValueError(NO_BAND.format(device.name))
    run = _own_runs(device)
    pairs = [_read(device, name, stretches, run) for name, stretches in recordings]
    every = [e for one, _ in pairs for e in one.stretches]
    found = _joined([(simulate or run)(e, band) for e in every], pairs[0][0].name)
    kinds = [f.kind for one, _ in pairs for f in one.faults if f.wrong]
    new = of_windows(found, band.window, band.ratio, kinds)
    if new is None:
        raise ValueError(
            f"the recordings give {found.error.shape[0]} free run(s) of {band.window:g} s without"
            " overflow, and a band needs two; give longer recordings"
        )
    return replace(device, band=new)


class _Taken(NamedTuple):
    """A recording, corrected for one suspected fault or none: its stretches, and the fault."""

    name: str
    stretches: tuple[Experiment, ...]
    faults: tuple[Fault, ...]


def _read(
    device: Device, name: str, stretches: Sequence[Experiment], run: Simulate
) -> tuple[_Taken, Recording]:
    """A recording as it is, or corrected for a suspected fault if it is then within the band."""
    every = [_Taken(name, r.whole, r.faults) for r in readings(device, stretches, None)]
    first, *others = ((one, _judged(device, one, run)) for one in every)
    if all(o.within for o in first[1].outputs):
        return first
    return next((pair for pair in others if all(o.within for o in pair[1].outputs)), first)


def _own_runs(device: Device) -> Simulate:
    """The device itself. Origins and zeros, which each recording has of its own, are fitted."""
    model = Model(device)
    free = [i for i, p in enumerate(model.parameters) if p.kind in ("origin", "zero")]

    def run(e: Experiment, band: Band) -> Windows:
        x = np.zeros(len(model.parameters))
        try:
            if free:
                h = settled(judged([_short(e, FITTED)], model, first_x(model, [e])), turns=1)
                x[free] = _beside(h.x, covariance(h.fitted), free, x)[free]
            return windows_of(model, x, [e], band.ratio, band.window)
        except NoObserver as error:
            raise ExperimentError(f"{e.name}: {error}") from error

    return run


def _short(e: Experiment, ticks: int) -> Experiment:
    return e if e.ticks <= ticks else e.part(0, ticks)


def _judged(device: Device, one: _Taken, simulate: Simulate) -> Recording:
    band = device.band
    assert band is not None
    found = _joined([simulate(e, band) for e in one.stretches], one.name)
    outputs = tuple(_output(device, band, o, found, one.name) for o in band.outputs
                    if o.name in found.names)  # fmt: skip
    if not outputs:
        raise ValueError(
            f"{one.name} has {', '.join(found.names)}, but the band of {device.name} is for"
            f" {', '.join(o.name for o in band.outputs)}; give a recording with one of these"
        )
    news = tuple(f for f in one.faults if f.wrong and f.kind not in band.corrected)
    remarks = tuple(f.sentence for f in one.faults if f not in news)
    return Recording(one.name, outputs, news, remarks)


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
            f" {with_unit(own.noise, unit, 3)}, which says nothing; give a recording in which the"
            " device moves"
        )
    error = float(found.rms[place])
    return Output(own.name, unit, error, most(band, own, found), own.error, motion)


def _changes(
    device: Device, outside: Sequence[_Taken], own: Simulate
) -> tuple[tuple[Changed, ...], bool]:
    """What changed, most telling first, and whether that alone is within the band."""
    band = device.band
    assert band is not None
    every = [e for one in outside for e in one.stretches]
    fit_on = [_short(e, max(1000, FITTED // len(every))) for e in every]
    structure = known_structure(device.with_interface(delay=0.0))
    late, period = device.interface.delay, device.interface.period
    model = Model(
        structure.device,
        (*structure.effects, make_physics(DELAY, "clock", delay=late)),
        (*structure.scales, {"delay": period}),
        bounds=(*structure.bounds, {}),
    )
    try:
        h = settled(judged(fit_on, model, model.within(first_x(model, fit_on))))
    except NoObserver:
        return (), False
    if not any(p.name == f"{DELAY}@clock.delay" for p in h.model.parameters):
        return (), False
    nominal = _nominal(h, model)
    before = _joined([own(e, band) for e in every], outside[0].name).rms
    changed: tuple[Changed, ...] = ()
    explains = False
    for told in _fewest(h, nominal):
        x = _fitted(h, nominal, told)
        try:
            runs = [windows_of(h.model, x, [e], band.ratio, band.window) for e in every]
        except NoObserver:
            continue
        changed = tuple(_changed(h, way, x, nominal) for way in told)
        explains = _explained(band, _joined(runs, outside[0].name), before)
        if explains:
            break
    return changed, explains


def _explained(band: Band, found: Windows, before: Floats) -> bool:
    """Whether free runs are within the band, or their errors are a twentieth of those before."""
    for output in band.outputs:
        if output.name in found.names:
            place = found.names.index(output.name)
            enough = max(most(band, output, found), ENOUGH * float(before[place]))
            if not found.rms[place] <= enough:
                return False
    return True


def _nominal(h: Hypothesis, model: Model) -> Floats:
    """The x of a fit for the device file, whose effects may have started elsewhere since."""
    x = np.zeros(h.x.size)
    for i, (p, first) in enumerate(zip(h.model.parameters, model.parameters, strict=True)):
        if p.kind == "effect":
            was = model.effects[first.index].values[first.key]
            x[i] = (was - h.model.effects[p.index].values[p.key]) / p.scale
    return x


def _beside(x: Floats, spread: Floats, free: Sequence[int], others: Floats) -> Floats:
    """Return x whose free places are the best beside others that are given for all the rest."""
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


def _fewest(h: Hypothesis, nominal: Floats) -> Iterator[list[_Way]]:
    """Yield ways that explain a fit: the one that explains most, with a second, with a third."""
    spread = covariance(h.fitted)
    own = [i for i in reported(h.model) if np.isfinite(spread[i, i])]
    weight = np.linalg.pinv(spread[np.ix_(own, own)], hermitian=True)
    off = h.x[own] - nominal[own]

    def left(ways: Sequence[_Way]) -> float:
        """By how much the cost exceeds that of the fit if only those ways are free."""
        cost = float(off @ weight @ off)
        if not ways:
            return cost
        free = np.stack([way.slope[own] for way in ways], axis=1)
        told = free.T @ weight @ off
        return cost - float(told @ np.linalg.pinv(free.T @ weight @ free, hermitian=True) @ told)

    told: list[_Way] = []
    cost = left([])
    possible = _ways(h, nominal, own)
    while possible and len(told) < MOST:
        best = min(possible, key=lambda way: left([*told, way]))
        less = left([*told, best])
        if cost - less < CLEAR:
            return
        told.append(best)
        cost = less
        possible = [way for way in possible if not set(way.places) & set(best.places)]
        yield list(told)


def _fitted(h: Hypothesis, nominal: Floats, ways: Sequence[_Way]) -> Floats:
    """The x at which a device changed in these ways alone follows the recordings best."""
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
    return at(found.x)


def _changed(h: Hypothesis, way: _Way, x: Floats, nominal: Floats) -> Changed:
    """A way in words, with what it was in the device file and what it is at x."""
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
