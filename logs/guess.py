"""A summary of a file for a person: each signal in one line, and a draft TOML.

The draft is only proposed. It is based first on units, in brackets or at the end of a name, then on
the words of a name. Unknown entries (a scale, counts per revolution) are left open, so the draft is
refused until someone has filled them in.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import tomli_w

from zwidth.logs.foreign_mcap import CLOCKS
from zwidth.logs.mended_stamps import mended
from zwidth.logs.names import DRIVES, MOTIONS, Naming, is_role, read_name, told_by, words_of
from zwidth.logs.source import Floats, Signal, Source
from zwidth.logs.steps import step_seen
from zwidth.logs.timing import NOTABLE_JITTER, Stamps, Timing, common_origin, examine
from zwidth.logs.units import SI, UNITS, Unit, find_unit

LEAST_SAMPLES = 3
OF_A_MOTOR = ("v", "u", "i")  # V_m is not a length
YEAR_2001, YEAR_2100 = 978_307_200.0, 4_102_444_800.0  # seconds since 1970
CALENDARS = (
    ("s", 1.0, 0.0),
    ("ms", 1e3, 0.0),
    ("us", 1e6, 0.0),
    ("ns", 1e9, 0.0),
    ("100ns", 1e7, 62_135_596_800.0),  # .NET: since the year 1
    ("100ns", 1e7, 11_644_473_600.0),  # Windows: since 1601
)
"""Unit, its number per second, and seconds from the calendar's beginning to 1970."""
PERIODS = ("ts", "dt", "sampletime", "samplingtime", "sampleperiod", "samplingperiod", "timestep",
           "deltat", "deltax", "steptime", "wfincrement")  # fmt: skip
RATES = ("fs", "hz", "samplerate", "samplingrate", "samplefrequency", "samplingfrequency", "fps")
MOST_BACK = 0.05  # largest share of a time's steps that go back
COUNTED = 0.9  # share of equal steps, above which a counter that restarts counts rows
MOST_SENTENCES = 8
TICKS = {"ticks", "tick", "filetime"}  # units of a Windows clock, as well as of an encoder
SCATTER = 0.2  # over the mean: largest scatter of a period that is written in each row
QUANTITY_OF = {si: quantity for quantity, units in SI.items() for si in units} | {
    "V": "command",
    "A": "command",
    "counts": "position",
    "counts/s": "velocity",
    "counts/s2": "acceleration",
}
OF_UNIT = {"N m": "torque", "N": "torque", "V": "voltage", "A": "current", "s": "time"}
"""What the unit of a signal that is not a motion says about it."""
CLOCK_ORDER = ("header.stamp", "stamp", "timestamp", "log_time", "publish_time")
assert set(CLOCK_ORDER) == set(CLOCKS)


@dataclass(frozen=True)
class Seen:
    """A summary of one signal. step: see `step_seen`; rate [Hz]: 0 without a clock of its own."""

    name: str
    unit: str
    samples: int
    missing: int
    least: float
    most: float
    step: float | None
    rate: float
    seems: str


def look(source: Source) -> list[Seen]:
    """Return a summary of each signal of a file, in the order of the file."""
    rows = row_count(source)
    time = time_signal(source)
    timing = None if time is None else _timing(time)
    return [_seen(signal, rows, time, timing) for signal in source.signals.values()]


def _seen(signal: Signal, rows: int, time: Signal | None, timing: Timing | None) -> Seen:
    values = signal.floats()
    finite = values[np.isfinite(values)]
    if signal.stamps:
        timing = _stamped(signal)
    elif time is None or time.values.size != signal.values.size:
        timing = None
    return Seen(
        name=signal.name,
        unit=signal.unit,
        samples=values.size,
        missing=values.size - finite.size,
        least=float(finite.min()) if finite.size else np.nan,
        most=float(finite.max()) if finite.size else np.nan,
        step=step_seen(values),
        rate=0.0 if timing is None else timing.rate,
        seems="time" if signal is time else _seems(signal, rows),
    )


def _seems(signal: Signal, rows: int) -> str:
    """Return "command", "position" ..., "goal", "constant", or "" if nothing tells."""
    values = signal.floats()
    if values.size != rows and not signal.stamps:
        return "constant" if values.size == 1 else ""
    values = values[np.isfinite(values)]
    if values.size and values.min() == values.max():
        return "constant"
    said = naming(signal)
    if said.role in ("goal", "error") and said.quantity not in DRIVES:
        return said.role
    return "command" if said.quantity in DRIVES else said.quantity


def naming(signal: Signal) -> Naming:
    """Return the quantity of a signal by its name and unit; if they disagree, the unit decides.

    Two exceptions: for counts the name decides, and a signal named as a motion may be in volts.
    """
    core, unit = _core(signal), unit_seen(signal)
    said = read_name(core)
    if said.quantity == "counter":
        steps = np.diff(signal.floats()[signal.known])
        counts = np.all(steps >= 0.0) or np.mean(steps == np.median(steps)) > COUNTED
        return said if counts else told_by(said, "position")
    if unit is None or not unit.si or said.quantity == "other":
        return said
    quantity = OF_UNIT.get(unit.si) or QUANTITY_OF[unit.si]
    drives = said.quantity in DRIVES and unit.si.startswith("counts")
    volts = said.quantity in MOTIONS and not said.weak and quantity in ("voltage", "current")
    return said if drives or volts or said.quantity == quantity else told_by(said, quantity)


def _core(signal: Signal) -> str:
    """Return the name of a signal without the unit at its end."""
    spelled = unit_spelled(signal)
    if signal.unit or spelled is None:
        return signal.name
    short = _tails(signal.name)
    return next((core for core, tail in short if _of_torque(tail, core) == spelled), signal.name)


def unit_seen(signal: Signal) -> Unit | None:
    """Return the unit in brackets, or at the end of the name ("angle_deg", "speed_rad_s")."""
    spelled = unit_spelled(signal)
    return None if spelled is None else find_unit(spelled)


def unit_spelled(signal: Signal) -> str | None:
    """Return the unit as written in a TOML, or None.

    At the end of a name it follows an underscore, a blank, a comma or a slash, or begins with a
    capital ("posDeg"). "in" means input more often than inch.
    """
    if signal.unit:
        return _of_torque(signal.unit, signal.name) if find_unit(signal.unit) else None
    return next((_of_torque(tail, core) for core, tail in _tails(signal.name)), None)


def _of_torque(spelled: str, core: str) -> str:
    """Return a unit as it stands, but "nm" of a torque as Nm: no torque is in nanometres."""
    return "Nm" if spelled == "nm" and read_name(core).quantity == "torque" else spelled


def _tails(name: str) -> list[tuple[str, str]]:
    """Return what may be a unit at the end of a name, with the rest: the longest one first.

    A name that is nothing but a unit ("rpm", "axis.deg") is one, too.
    """
    last = name.rsplit(".", 1)[-1]
    before_role = re.fullmatch(r"(.+)_([a-z]+)", last)
    if before_role and is_role(before_role[2]):  # "rpm_sp", "angle_deg_cmd"
        inner, role = name[: -len(before_role[2]) - 1], before_role[2]
        return [(core if core == inner else f"{core}_{role}", t) for core, t in _tails(inner)]
    spaced = re.sub("([a-z0-9])([A-Z])", r"\1_\2", last)
    before = name[: len(name) - len(last)]
    found = [
        (before + n[: m.start()], m.group(1).strip("_ ,/"))
        for n in (last, spaced)
        for m in re.finditer("(?=[_ ,/](.+))", n)
    ]
    tails = [
        (core, spelled) for core, tail in found for spelled in (tail, re.sub("(_per)?_", "/", tail))
    ]
    whole = [(name, last)] if len(last) > 1 else []
    return [
        (core, t)
        for core, t in [*tails, *whole]
        if t != "in" and _is_unit(t) and not (t == "m" and core.strip("_ ").lower() in OF_A_MOTOR)
    ]


def _is_unit(tail: str) -> bool:
    return tail in UNITS or (len(tail) > 2 and find_unit(tail) is not None) or tail == "°"


def row_count(source: Source) -> int:
    """Return the number of samples that most signals have."""
    sizes = [signal.values.size for signal in source.signals.values()]
    long = [size for size in sizes if size >= LEAST_SAMPLES]
    return max(set(long), key=lambda size: (long.count(size), size)) if long else 0


def time_signal(source: Source) -> Signal | None:
    """Return the signal that seems to be the time: it rises, evenly or with a name of a time."""
    return time_seen(source)[0]


def time_seen(source: Source) -> tuple[Signal | None, list[str]]:
    """Return the signal that seems to be time, and why other signals with such names are not."""
    rows = row_count(source)
    refused: list[str] = []
    for signal in source.signals.values():
        if not is_named_time(signal):
            continue
        reason = _no_time(signal, rows)
        if reason is None:
            return signal, []
        refused.append(f"{signal.name} {reason}")
    for name, reason in source.unreadable.items():
        if read_name(name).quantity == "time":
            refused.append(f"{name} {reason}")
    rising = [s for s in source.signals.values() if s.values.size == rows and _rises(s.floats())]
    unnamed = [s for s in rising if naming(s).quantity == "" and not s.stamps]
    even = [s for s in unnamed if not _timing(s).backwards and _even(_timing(s))]
    return (even[0] if len(even) == 1 else None), refused


def since_1970(stamp: float) -> str | None:
    """Return the unit of a stamp since the beginning of a calendar, found by its year, or None."""
    for unit, each, before in CALENDARS:
        if YEAR_2001 <= stamp / each - before <= YEAR_2100:
            return unit
    return None


def period_told(source: Source) -> tuple[float, str] | None:
    """Return the sampling period [s] given by a single number beside the signals, and its name.

    It is called Ts, dt, fs, sampling rate or the like; or it is the step of a time of another
    length.
    """
    for signal in source.signals.values():
        joined, value = "".join(words_of(signal.name)[::-1]), _steady(signal)
        if value is None:
            continue
        unit = unit_seen(signal)
        if joined.endswith(PERIODS):
            own = unit.factor if unit is not None and unit.si == "s" else None
            return float(f"{value * (own or _likely(value, signal)):.9g}"), signal.name
        if joined.endswith(RATES):
            return 1.0 / value, signal.name
    for signal in source.signals.values():
        if is_named_time(signal) and signal.values.size >= LEAST_SAMPLES and not signal.stamps:
            unit = unit_seen(signal)
            factor = unit.factor if unit is not None and unit.si == "s" else 1.0
            timing = examine(seconds_of(signal, factor)[signal.known])
            if timing.period > 0.0 and _even(timing) and not timing.backwards:
                return float(f"{timing.period:.9g}"), f"the steps of {signal.name}"
    return None


def _steady(signal: Signal) -> float | None:
    """Return the number that a signal holds, also one repeated in each row with little scatter.

    None for anything but a single number above 0.
    """
    values = signal.floats()[signal.known]
    if not values.size or not values.min() > 0.0 or (values.size == 1 < signal.values.size):
        return None
    mean = float(np.mean(values))
    return mean if mean < np.inf and float(np.std(values)) <= SCATTER * mean else None


def _likely(value: float, signal: Signal) -> float:
    """Return of what unit [s] a period without one is: a column of 10 is hardly of seconds."""
    if signal.values.size == 1:
        return 1.0
    return 1.0 if value < 0.5 else 1e-3 if value < 200.0 else 1e-6


def is_named_time(signal: Signal) -> bool:
    """Whether a signal is time by its name or unit."""
    unit = unit_seen(signal)
    said = read_name(_core(signal)).quantity
    if TICKS & {*words_of(signal.name)} and signal.known.any():
        return since_1970(float(signal.floats()[signal.known][0])) == "100ns"
    return said != "other" and (said == "time" or (unit is not None and unit.si == "s"))


def _no_time(signal: Signal, rows: int) -> str | None:
    """Return why a signal that is called time cannot be one, or None."""
    values = signal.floats()
    if signal.stamps:
        return "is a field of messages, which have a clock"
    if values.size != rows:
        return f"has {values.size} samples, but the others have {rows}"
    known = values[np.isfinite(values)]
    if 2 * known.size <= values.size:
        return f"is missing in {values.size - known.size} of {values.size} samples"
    if known.min() == known.max():
        return "does not move"
    back = int(np.count_nonzero(np.diff(mended(known)[0]) < 0.0))
    if back > MOST_BACK * known.size or known[-1] == known[0]:
        return f"goes back in {back} of {known.size - 1} steps"
    return None


def _rises(values: Floats) -> bool:
    """Return True for a signal that rises all the time but for a few faults."""
    finite = np.isfinite(values)
    values = values[finite]
    if values.size < LEAST_SAMPLES or 2 * values.size <= finite.size:
        return False
    with np.errstate(over="ignore"):
        return float((np.diff(values) > 0.0).mean()) > 0.5 and bool(values[-1] > values[0])


def _even(timing: Timing) -> bool:
    return timing.jitter <= NOTABLE_JITTER * timing.period and not timing.gap_count


def _timing(time: Signal) -> Timing:
    unit = unit_seen(time)
    factor = unit.factor if unit is not None and unit.si == "s" else 1.0
    return _examined(Stamps(time.values[time.known], factor))


def seconds_of(time: Signal, factor: float) -> Floats:
    """Return the stamps of a signal [s] from its first, corrected; NaN where one is missing."""
    found, known = np.full(time.values.size, np.nan), time.known
    stamps = Stamps(time.values[known], factor)
    found[known] = mended(stamps.seconds(common_origin({"": stamps})))[0]
    return found


def _stamped(signal: Signal) -> Timing:
    return _examined(Stamps(signal.stamps[_clock(signal)], 1e-9))


def _examined(stamps: Stamps) -> Timing:
    return examine(mended(stamps.seconds(common_origin({"": stamps})))[0])


def _clock(signal: Signal) -> str:
    return next(clock for clock in CLOCK_ORDER if clock in signal.stamps)


def gaps_seen(source: Source) -> list[str]:
    """Return a sentence for each signal with samples that are not finite."""
    found: list[str] = []
    for signal in source.signals.values():
        known = signal.known
        missing = int(known.size - known.sum())
        if signal.note:
            found.append(signal.note)
        elif 0 < missing < known.size:
            gaps = "a gap" if missing == 1 else "gaps"
            found.append(
                f"{signal.name} is not finite in {missing} of {known.size} samples, first in sample"
                f" {int(np.argmin(known))}; taken as {gaps}"
            )
    if len(found) > MOST_SENTENCES:
        more = len(found) - MOST_SENTENCES
        found[MOST_SENTENCES:] = [f"{more} more signals have samples that are not finite"]
    return found


def clock_faults(source: Source) -> list[str]:
    """Return sentences on the faults of the clock that the draft proposes."""
    time = time_signal(source)
    if time is not None and not time.stamps:
        return [f"{time.name}: {fault}" for fault in _timing(time).faults()]
    clocks = {s.name.rsplit(".", 1)[0]: s for s in source.signals.values() if s.stamps}
    return [f"{name}: {fault}" for name, s in clocks.items() for fault in _stamped(s).faults()]


def draft(source: Source, seen: Sequence[Seen]) -> str:
    """Return a recording TOML to start from, with everything that the file shows."""
    chosen = {quantity: _first(seen, quantity) for quantity in SI}
    lines = [
        "# A guess by zwidth: check every line against what you know of the device.",
        _line("file", source.path.name),
        *clock_lines(source, [name for name in chosen.values() if name is not None]),
        *_rotary_lines(source, [name for name in chosen.values() if name is not None]),
    ]
    command = chosen.pop("command")
    lines += ["", "[input]", *_signal_lines(source, seen, command, "command")]
    outputs = {q: name for q, name in chosen.items() if name is not None} or {"position": None}
    for quantity, name in outputs.items():
        lines += ["", "[[output]]", *_signal_lines(source, seen, name, quantity)]
        lines += [_line("quantity", quantity), _line("at", "m1")]
    return "\n".join(lines) + "\n"


def _first(seen: Iterable[Seen], quantity: str) -> str | None:
    return next((s.name for s in seen if s.seems == quantity), None)


def _line(key: str, value: str) -> str:
    return tomli_w.dumps({key: value}).strip()


def clock_lines(source: Source, chosen: list[str]) -> list[str]:
    """Return the lines of a TOML for the time of the chosen signals."""
    stamped = [source.signals[name] for name in chosen if source.signals[name].stamps]
    if stamped or any(signal.stamps for signal in source.signals.values()):
        signal = (stamped or [s for s in source.signals.values() if s.stamps])[0]
        others = " ".join(clock for clock in CLOCK_ORDER if clock in signal.stamps)
        lines = [f"{_line('time', _clock(signal))} # clocks of this topic: {others}"]
        topics = {source.signals[name].name.split(".")[0] for name in chosen}
        stamps = [one.stamps[_clock(one)] for one in stamped]
        apart = any(not np.array_equal(stamps[0], other) for other in stamps[1:])
        return (
            [*lines, "resample = true # topics have clocks of their own"]
            if len(topics) > 1 or apart
            else lines
        )
    time = time_signal(source)
    if time is None:
        return ["# period_s = 0.001 # no signal seems to be time stamps: give the sampling period"]
    spelled = unit_spelled(time)
    unit = find_unit(spelled) if spelled else None
    if spelled is None or unit is None or unit.si != "s":
        return [_line("time", time.name) + " # in seconds, or add time_unit"]
    named = [] if unit.factor == 1.0 else [_line("time_unit", spelled)]
    return [_line("time", time.name), *named]


def _rotary_lines(source: Source, chosen: list[str]) -> list[str]:
    for name in chosen:
        unit = unit_seen(source.signals[name])
        if unit is not None and unit.si in QUANTITY_OF and unit.si not in ("V", "A"):
            return []
    return ["# rotary = true # N m and rad; false: N and m"]


def _signal_lines(
    source: Source, seen: Sequence[Seen], name: str | None, quantity: str
) -> list[str]:
    if name is None:
        open_ones = [s.name for s in seen if s.seems not in ("time", "constant")]
        return ['signal = "" # choose: ' + ", ".join(plain(n) for n in open_ones[:12])]
    others = [s.name for s in seen if s.seems == quantity and s.name != name]
    note = f" # or: {', '.join(plain(n) for n in others[:12])}" if others else ""
    lines = [_line("signal", name) + note]
    signal = source.signals[name]
    unit, spelled = unit_seen(signal), unit_spelled(signal)
    if unit is not None and spelled is not None:
        lines.append(_line("unit", spelled))
    if unit is not None and unit.si.startswith("counts"):
        lines.append("# counts_per_rev = # edges per revolution; or counts_per_m")
    elif unit is not None and unit.si not in SI[quantity]:
        wanted = " or ".join(SI[quantity])
        lines.append(f"# scale = # {wanted} per {unit.si}, and offset in {wanted}")
    elif unit is None:
        lines.append(f"# scale = 1.0 # SI per raw: {' or '.join(SI[quantity])} is assumed")
    return lines


def plain(name: str) -> str:
    """Return a name that can stand in a comment."""
    return name if name.isprintable() else ascii(name)
