"""Checks whether a recording itself is sound; its faults are reported like findings.

Clipping, repeated samples and the observed encoder step are facts. A wrong sign or unit is not,
since strong physics may look like one. So the gate only suspects it (`suspicion`), with the channel
and the correction, and a search with each reading decides (`take_in.readings`).

A recording is suspected if its command takes energy out of the device, which no passive device can
supply, or if the device seems driven by several times the command or by a fraction of it
(`driven`). Each output is tested alone. If one output is suspect and another is not, that output is
at fault. If all are suspect, the command is suspected first, and then all outputs at once, unless
steps of the size in the device file confirm an output. A fault belongs to its recording; its
correction is not applied to others.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.intake.driven import Driven, driven
from zwidth.diagnosis.intake.units import far_off, nearest_unit, sentence, unit_of
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.settings import INTAKE
from zwidth.shown import Valued
from zwidth.sim.device import Device
from zwidth.sim.readable import with_unit

Floats = NDArray[np.float64]
COMMAND = ("command",)
ALIKE_OVER = (1, 4, 16, 64, 256)  # ticks, over which a position and a velocity may be compared


@dataclass(frozen=True)
class Fault(Valued):
    """A finding about a recording. kind: a word; wrong: whether the recording needs a correction.

    value: its size, by kind; if channels are listed, the factor that corrects them. recording: the
    name of the recording concerned, "" for all.
    """

    kind: str
    sentence: str
    wrong: bool
    value: float
    recording: str = ""
    channels: tuple[str, ...] = ()


def examine(device: Device, experiments: Sequence[Experiment]) -> list[Fault]:
    """Return suspicions about recordings, then facts about the corrected recordings."""
    faults: list[Fault] = []
    for e in experiments:
        wrong = next(iter(suspicion(device, e).ways), ())
        faults += [*wrong, *oddities(device, corrected(e, wrong))]
    return sorted(faults, key=lambda f: not f.wrong)


def oddities(device: Device, e: Experiment) -> list[Fault]:
    """Return the certain facts about a recording."""
    found = [Fault("recording", note, False, e.begins) for note in e.notes]
    found += _clipped(e) + _output_faults(device, e)
    return [replace(fault, recording=e.name) for fault in found]


def corrected(experiment: Experiment, faults: Sequence[Fault]) -> Experiment:
    """Return a recording with its channels corrected for faults."""
    names = [o.name for o in experiment.outputs]
    for fault in faults:
        if fault.channels == COMMAND:
            experiment = replace(experiment, command=fault.value * experiment.command)
            continue
        factors = np.array([fault.value if name in fault.channels else 1.0 for name in names])
        if np.any(factors != 1.0):
            measured = factors * experiment.measured
            swing = abs(float(factors[0])) * experiment.swing
            experiment = replace(experiment, measured=measured, swing=swing)
    return experiment


def misread(e: Experiment, channels: tuple[str, ...], factor: float) -> Fault:
    """Return the fault of channels whose scale is wrong by a factor."""
    what = "command" if channels == COMMAND else "output"
    kind = f"{what}_sign" if factor < 0.0 else f"{what}_scale"
    return Fault(kind, sentence(e.name, channels, factor), True, factor, e.name, channels)


def _clipped(e: Experiment) -> list[Fault]:
    peak = float(np.abs(e.command).max())
    there = np.abs(e.command) > (1.0 - 1e-9) * peak
    share = float(np.mean(there))
    stretches = np.count_nonzero(np.diff(there, prepend=False) & there)
    few = np.unique(np.abs(e.command)).size <= 20
    if share <= INTAKE.clipped or few or stretches < 2:  # a step holds its last level
        return []
    sentence = (
        f"{100.0 * share:.1f} % of the command of {e.name} is exactly +-{peak:.4g}: either it was"
        " clipped before it was recorded, or it holds this level"
    )
    return [Fault("clipped_command", sentence, False, peak)]


@dataclass(frozen=True)
class _Seen:
    """The factor by which an output seems driven; off: whether it contradicts the device file.

    clear: whether the output shows the command at all; step: the file's step over the observed one,
    or None. better: factor by which the rms error is smaller with the scale than without, or 1.
    """

    scale: float
    off: bool
    clear: bool
    step: float | None
    better: float = 1.0

    @property
    def counts(self) -> float:
        """The factor that corrects the output: from its steps if it has any, which give no sign."""
        return 1.0 / self.scale if self.step is None else math.copysign(self.step, self.scale)

    def certain(self, rotary: bool) -> bool:
        """Whether it is wrong in sign or by a unit that is far off, whatever the physics.

        The correction must make the device file's error smaller by a factor of `certain`, even with
        drag, friction and parameters that are wrong by half; or the steps must confirm it.
        """
        if self.step is not None and unit_of(self.step) is not None:
            return far_off(self.step, rotary) and _within(self.counts * self.scale, INTAKE.off)
        unit = abs(self.scale) == 1.0 or far_off(self.scale, rotary)
        return unit and self.better > INTAKE.certain

    @property
    def vouched(self) -> bool:
        """Whether its steps confirm the device file's step."""
        return self.step is not None and _within(self.step, 1.1)


@dataclass(frozen=True)
class Suspicion:
    """Possible corrections, the most likely first, at most two; none for a sound recording.

    Each is a complete correction of the recording. certain: whether a correction is necessary
    whatever the physics, so that no search needs to decide.
    """

    ways: tuple[tuple[Fault, ...], ...] = ()
    certain: bool = False


def suspicion(device: Device, e: Experiment) -> Suspicion:
    """Return the suspected faults of a recording."""
    seen = [_seen(device, e, o) for o in range(len(e.outputs))]
    for one, other in permutations(range(len(seen)), 2):
        if seen[one].off and not seen[other].off and _tell_the_same(e, one, other):
            seen[one] = replace(seen[one], scale=1.0, off=False)
    off = [s for s in seen if s.off]
    if not off:
        return Suspicion()
    certain = all(s.certain(device.rotary) for s in off)
    return Suspicion(tuple(_ways(device, e, seen)), certain)


def _tell_the_same(e: Experiment, one: int, other: int) -> bool:
    """Whether position and velocity of one mass agree, so that neither is wrong.

    Regressions of the integrated velocity on the travel, and of the travel on it, must both have a
    slope near one, which noise cannot cause, whatever the physics.
    """
    outputs = (e.outputs[one], e.outputs[other])
    if outputs[0].mass != outputs[1].mass or outputs[0].quantity == outputs[1].quantity:
        return False
    known = {o.quantity: e.measured[:, i] for o, i in zip(outputs, (one, other), strict=True)}
    if set(known) != {"position", "velocity"}:
        return False
    v = known["velocity"]
    way = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1])) * e.period])
    for ticks in (t for t in ALIKE_OVER if 2 * t < e.ticks):
        moved, told = (q[ticks:] - q[:-ticks] for q in (known["position"], way))
        both = float(moved @ told)
        if both > 0.0 and max(float(moved @ moved), float(told @ told)) < INTAKE.alike * both:
            return True
    return False


def _ways(device: Device, e: Experiment, seen: Sequence[_Seen]) -> list[tuple[Fault, ...]]:
    off = [s for s in seen if s.off]
    names = [o.name for o in e.outputs]
    sound = [s for s in seen if s.clear and not s.off]
    factor = _common([s.scale for s in off], device.rotary)
    command = (misread(e, COMMAND, factor),)
    each = tuple(
        misread(e, (name,), nearest_unit(s.counts, device.rotary))
        for name, s in zip(names, seen, strict=True)
        if s.off
    )
    every = (misread(e, tuple(names), nearest_unit(1.0 / factor, device.rotary)),)
    outputs = each if sound or len(off) == 1 < len(seen) else every
    if any(math.isclose(f.value, 1.0) for f in outputs):  # the steps are those of the file
        return [command]
    if sound or any(s.step is not None and not s.vouched for s in off):
        return [outputs, command]
    if any(s.vouched for s in off) and factor > 0.0:
        return [command]
    return [command, outputs]


def _common(scales: Sequence[float], rotary: bool) -> float:
    """The factor on which most of several scales agree, as a unit if it is near one."""
    sign = 1.0 if sum(float(np.sign(s)) for s in scales) >= 0.0 else -1.0
    size = float(np.exp(np.median(np.log(np.abs(scales)))))
    return nearest_unit(sign * size, rotary)


def _seen(device: Device, e: Experiment, o: int) -> _Seen:
    """Find the factor by which one output seems driven.

    A large factor only shows clearly from nearby, so corrections are found one after the other.
    """
    alone = replace(e, measured=e.measured[:, [o]].copy(), outputs=(e.outputs[o],))
    taken = _energy_taken(device, alone)
    scale, forward = -1.0 if taken < -INTAKE.power else 1.0, abs(taken) > INTAKE.power

    def tell() -> Driven | None:
        return driven(device, replace(alone, command=scale * alone.command), forward)

    told = tell()
    clear = told is not None and told.told > INTAKE.clear
    for _ in range(4):
        if told is None or not _doubtful(told):
            break
        scale *= told.scale
        told = tell()
    shows = told is not None and told.told > INTAKE.clear
    if told is not None and shows and abs(scale) != 1.0 and 0.0 < told.scale < 1.0:
        scale *= told.scale  # drag and springs had explained a part of it
    unclear = scale != 1.0 and told is not None and told.told < INTAKE.clear
    if unclear or _within(scale, INTAKE.off):  # if no command explains it, no other scale does
        scale = -1.0 if taken < -INTAKE.power else 1.0
    if _within(-scale, INTAKE.sign_off):
        scale = -1.0
    # The device file leaves the scale open, or masses, which is equivalent. This matters for a file
    # that was fitted to this recording, for example with a command of the wrong sign.
    known = device.uncertainty
    open_by = math.exp(INTAKE.left_open * max(known.command_scale, known.masses))
    if 1.0 / open_by <= abs(scale) <= open_by:
        scale = math.copysign(1.0, scale)
    better = 1.0
    if scale != 1.0 and (as_is := driven(device, alone)) is not None:
        better = as_is.better
    return _Seen(scale, scale != 1.0, clear, _step_off(device, alone), better)


def _within(factor: float, most: float) -> bool:
    """Whether two factors agree within a tolerance."""
    return 1.0 / most < factor < most


def _doubtful(told: Driven) -> bool:
    return (
        not _within(told.scale, INTAKE.off)
        and told.scale != 0.0
        and told.gained > max(INTAKE.clear, INTAKE.share * told.told)
        and (told.scale > INTAKE.off or told.scale < 0.0 or told.better > INTAKE.better)
    )


def _energy_taken(device: Device, e: Experiment) -> float:
    """Energy that a command gives to m1, as a share of the most that it could; 0 for other masses.

    A held command gives the energy u_k (x_(k+1) - x_k), so no velocity is needed, whose noise a
    feedback would have put into the command. The command is delayed by the device's delay and one
    tick more, since a feedback also contains the noise of x_k.
    """
    if e.outputs[0].mass != 0:
        return 0.0
    late = round(device.interface.delay / e.period) + 1
    y = e.measured[:, 0]
    moved = np.diff(y) if e.outputs[0].quantity == "position" else y[1:] * e.period
    moved = moved[late:]
    u = e.command[: moved.size]
    size = float(np.sqrt(np.mean(u**2) * np.mean(moved**2)))
    return float(np.mean(u * moved)) / size if size > 0.0 else 0.0


def _step_off(device: Device, e: Experiment) -> float | None:
    """Step of the device file over that of an output, None if either has none."""
    stated, seen = device.interface.encoder_step, encoder_step_seen(e.measured[:, 0])
    if not stated > 0.0 or seen is None or e.outputs[0].mass != 0:
        return None
    if e.outputs[0].quantity == "velocity":  # differenced
        stated /= e.period
    return stated / seen


def _output_faults(device: Device, e: Experiment) -> list[Fault]:
    found: list[Fault] = []
    length = "rad" if device.rotary else "m"
    for o, output in enumerate(e.outputs):
        y, position, name = e.measured[:, o], output.quantity == "position", output.name
        step, repeats = encoder_step_seen(y), float(np.mean(np.diff(y) == 0.0))
        if step is not None:
            kind = "encoder_step" if position else "velocity_step"
            size = with_unit(step, length if position else f"{length}/s")
            said = f"{name} of {e.name} comes in steps of {size}"
            found.append(Fault(kind, said, False, step))
        elif repeats > INTAKE.repeats:
            share = f"{100.0 * repeats:.1f} %"
            said = f"{share} of the samples of {name} of {e.name} repeat the one before"
            found.append(Fault("repeated_samples", said, False, repeats))
    return found


def merged(values: Floats, share: float) -> Floats:
    """Return levels in order; levels closer than a share of the range count as one."""
    levels = np.unique(values)
    digits = 4.0 * np.finfo(np.float64).eps * float(np.abs(levels).max(initial=0.0))
    apart = np.diff(levels) > share * float(np.ptp(levels)) + digits
    begins = np.concatenate([[0], np.flatnonzero(apart) + 1])
    return np.add.reduceat(levels, begins) / np.diff(begins, append=levels.size)


def encoder_step_seen(y: Floats) -> float | None:
    """Return the step of which all values are multiples up to an offset, None for none.

    The smallest difference of distinct values is the step if all differences are whole multiples of
    it, and enough of them are one step.
    """
    levels = merged(y, 1e-9)  # equal values differ by rounding
    if levels.size < 3:
        return None
    gaps = np.diff(levels)
    smallest = gaps.min()
    near = gaps[gaps < 1.5 * smallest]
    step = float(near.mean())
    span = float(levels[-1] - levels[0])
    step = span / max(1.0, np.round(span / step))
    counts = (levels - levels[0]) / step
    wrong = np.abs(counts - np.round(counts)).max()
    often = near.size >= min(10, levels.size // 2)
    return step if wrong < INTAKE.whole and often else None
