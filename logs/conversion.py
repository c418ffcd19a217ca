"""Convert raw numbers of a signal to the SI values of a channel, with a sentence that says how."""

from dataclasses import dataclass

import numpy as np

from zwidth.logs.recording_file import COVARIATE, Entry
from zwidth.logs.source import Floats, RecordingError, Signal
from zwidth.logs.units import GOAL, OF_DRIVE, SI, TURN, Unit, find_unit, known_unit
from zwidth.logs.wrapped import gone_on

QUANTITIES = {**SI, **OF_DRIVE}
LARGEST_EXACT = 2**53  # integers beyond it are rounded in a double


@dataclass(frozen=True)
class Converted:
    """values (samples,) in SI. rotary: as the unit shows, None if it does not.

    goal: whether they are goals of position, or of speed, which `integrated` converts.
    """

    values: Floats
    rotary: bool | None
    formula: str
    warnings: tuple[str, ...]
    goal: bool = False


def convert(entry: Entry, signal: Signal) -> Converted:
    """Return the channel of a signal; raises RecordingError if its unit does not suit."""
    unit, warnings = (Unit("", 1.0), []) if entry.quantity == COVARIATE else _unit(entry, signal)
    raw = signal.floats()
    if signal.values.dtype.kind in "iu" and np.abs(raw).max() > LARGEST_EXACT:
        warnings.append(f"{signal.name} has integers beyond 2^53, which are rounded")
    scale = 1.0 if entry.scale is None else entry.scale
    values = raw
    if entry.wraps_at is not None:
        _refuse_beyond(entry, raw, entry.wraps_at)
        values, times = gone_on(raw, entry.wraps_at)
        warnings.append(
            f"{entry.channel} starts again after {entry.wraps_at:g} raw numbers, {times} times: it"
            " is taken to go on"
        )
    with np.errstate(over="ignore", invalid="ignore"):
        for factor in (unit.factor, scale):
            values = values if factor == 1.0 else values * factor
        values = values if entry.offset == 0.0 else values + entry.offset
        values = values if entry.over == 1.0 else values / entry.over
    speed = entry.integral_time is not None
    goal = speed or (entry.quantity == "command" and unit.si in GOAL and entry.scale is None)
    own = SI["velocity"] if speed else GOAL if goal else QUANTITIES.get(entry.quantity, ("", ""))
    shows = bool(unit.si) and entry.scale is None and entry.quantity not in OF_DRIVE
    rotary = unit.si == own[0] if shows else None
    formula = _formula(entry, signal, unit, scale)
    notes = [signal.note] if signal.note else []
    remarks = (*notes, *warnings, *_remarks(entry, values))
    return Converted(values, rotary, formula, remarks, goal)


def integrated(goal: Floats, t: Floats, integral_time: float) -> Floats:
    """Return the goal of position of a speed loop: the integral of its goal, plus T times the goal.

    goal (samples,) is held from sample to sample. The result is held too, at the mean of the
    integral over each sample. If a goal is missing, the integral continues with the last one, and
    the result is NaN.
    """
    known = np.isfinite(goal)
    last = np.maximum.accumulate(np.where(known, np.arange(goal.size), 0))
    held = np.where(np.isfinite(goal[last]), goal[last], 0.0)
    steps = np.maximum(np.diff(t, append=2.0 * t[-1] - t[-2] if t.size > 1 else t[-1]), 0.0)
    reached = np.cumsum(held * steps)
    return np.where(known, reached - 0.5 * held * steps + integral_time * held, np.nan)


def _refuse_beyond(entry: Entry, raw: Floats, modulus: float) -> None:
    """Refuse readings that are farther apart than a counter that starts anew there can be."""
    known = raw[np.isfinite(raw)]
    if known.size and known.max() - known.min() > modulus:
        raise RecordingError(
            f"{entry.signal!r} goes from {known.min():g} to {known.max():g}, which is more than"
            f" its wraps_at = {modulus:g} allows; give the count after which it wraps, or leave"
            " wraps_at out"
        )


def _unit(entry: Entry, signal: Signal) -> tuple[Unit, list[str]]:
    """Return the unit of the raw numbers; its si is "" if the unit is unknown."""
    spelled = find_unit(signal.unit) if signal.unit else None
    if entry.unit is None:
        if spelled is None or entry.scale is not None:
            return Unit("", 1.0), []
        if spelled.si in _allowed(entry) and spelled.factor == 1.0:
            return spelled, []
        raise RecordingError(
            f"{signal.name!r} is in {signal.unit!r} by its own header, and {entry.channel} must be"
            f' in SI; add unit = "{signal.unit}" to convert it, or a scale'
        )
    unit = known_unit(entry.unit, f"the unit of {signal.name!r}")
    warnings: list[str] = []
    if spelled is not None and spelled != unit:
        warnings.append(
            f"{signal.name} is in {signal.unit!r} by its own header, and was read in"
            f" {entry.unit!r}, the unit in the TOML"
        )
    if unit.si.startswith("counts"):
        unit = _counts(entry, unit)
    if entry.scale is None and unit.si not in _allowed(entry):
        allowed = " or ".join(dict.fromkeys(QUANTITIES[entry.quantity]))  # a goal needs no scale
        if not allowed:
            raise RecordingError(
                f"{signal.name!r} is in {entry.unit}, and {entry.channel} has no unit; leave unit"
                " out, or give scale"
            )
        raise RecordingError(
            f"{signal.name!r} is in {entry.unit}, and {entry.channel} must be in {allowed}; give"
            f" scale, in {allowed} per {unit.si}"
        )
    return unit, warnings


def _allowed(entry: Entry) -> tuple[str, ...]:
    """Return the SI units that a channel may be in."""
    if entry.integral_time is not None:
        return SI["velocity"]
    return (*QUANTITIES[entry.quantity], *(GOAL if entry.quantity == "command" else ()))


def _counts(entry: Entry, unit: Unit) -> Unit:
    """Return counts, counts/s or counts/s2 as angle or length, or unchanged if there is a scale."""
    if entry.counts_per_rev is not None:
        return Unit(unit.si.replace("counts", "rad"), TURN / entry.counts_per_rev)
    if entry.counts_per_m is not None:
        return Unit(unit.si.replace("counts", "m"), 1.0 / entry.counts_per_m)
    return unit


def _formula(entry: Entry, signal: Signal, unit: Unit, scale: float) -> str:
    raw = (
        f"{signal.name} [{entry.unit or signal.unit}]" if entry.unit or signal.unit else signal.name
    )
    factors = [f"{factor!r} x " for factor in (scale, unit.factor) if factor != 1.0]
    offset = (
        "" if entry.offset == 0.0 else f" {'+' if entry.offset > 0 else '-'} {abs(entry.offset)!r}"
    )
    over = "" if entry.over == 1.0 else f" over {entry.over!r}"
    return f"{entry.channel} = {''.join(factors)}{raw}{offset}{over}"


def _remarks(entry: Entry, values: Floats) -> list[str]:
    """Return sentences on values that no sensor of a moving device gives."""
    finite = np.isfinite(values)
    missing = int(values.size - finite.sum())
    if missing == values.size:
        raise RecordingError(f"{entry.channel} ({entry.signal!r}) has no finite number at all")
    if missing:
        first = int(np.argmin(finite))
        gaps = "a gap" if missing == 1 else "gaps"
        return [
            f"{entry.channel} is not finite in {missing} of {values.size} samples, first in sample"
            f" {first}; taken as {gaps}"
        ]
    if values.size > 1 and values.min() == values.max():
        return [f"{entry.channel} is constant at {values[0]:g}"]
    return []
