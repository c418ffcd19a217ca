"""The recording TOML: which signal of a file is which channel, and in what units.

    schema = 1                  # optional
    file = "DATA_EMPS.mat"      # relative to this TOML
    source = "..."              # optional, free text: where the recording comes from
    rotary = false              # optional where a unit shows it: N m and rad, or N and m
    period_s = 0.001            # the samples are counted; or
    time = "t"                  # their stamps are a signal, or a clock of MCAP messages:
                                # log_time, publish_time, header.stamp, stamp, timestamp
    time_unit = "ms"            # optional, s by default; MCAP clocks know theirs
    resample = true             # optional: onto one axis with the longest period of the streams,
                                # or resample = 0.001, onto one with that period [s]
    [input]                     # channel `command`
    signal = "vir"              # variable, column, or topic.field
    file = "torque.txt"         # optional: its file, if not the one above, whose time it shares
    unit = "V"                  # optional: the unit of the raw numbers, SI by default
    scale = 35.150652           # optional
    offset = 0.0                # optional
    [[output]]                  # channel QUANTITY_AT, such as `position_m1`
    signal = "qm"
    quantity = "position"       # position | velocity | acceleration
    at = "m1"                   # m1 to m5
    wraps_at = 65536            # optional, raw: a counter of 16 bits starts again at 0
    [base]                      # optional, if the base of the device moves: base_QUANTITY
    signal = "floor"
    quantity = "acceleration"   # position | velocity | acceleration
    [[known_force]]             # optional: a recorded force that acts besides the command
    signal = "gravity"          # channel `known_force_m1`
    at = "m1"                   # m1 to m5
    [[joint]]                   # optional: the position of another joint of the same robot
    signal = "q2"               # channel `joint_elbow`
    name = "elbow"              # its name in the robot's model
    [[covariate]]               # optional: a temperature that parameters may follow
    signal = "temp"             # channel `covariate_temp`, in its own unit
    unit = "degC"               # optional, free text
    [enable]                    # optional: when the drive was on, channel `enable`
    signal = "torque_enable"    # on where it is at least a half
    [supply]                    # optional: its supply voltage, channel `supply`, over nominal
    signal = "input_volts"
    unit = "V"
    nominal = 12.0              # voltage at which the device file's numbers hold [V]
    [use]                       # optional
    from_s = 0.0
    to_s = 20.0
    [device]                    # optional: differences of the device from its file
    masses = [1.248]            # as in its [chain] and [interface]: see `sim.changes`
    [free]                      # optional: parameters with their own value in this run; recordings
    ground_spring = "stiff"     # with the same word share it: see `diagnosis.recording.own`
    [csv]                       # optional: what cannot be detected in a text table
    delimiter = ";"
    decimal = ","
    header_line = 3             # 0: no line names the columns

value = scale * raw + offset, in SI. If `unit` is given, raw numbers are first converted to the SI
unit of their kind (degrees to rad, mV to V), so scale is in SI per SI, "N per V". `unit = "counts"`
needs counts_per_rev (edges, that is lines times four in quadrature) or counts_per_m.

Each of these tables may have its own period_s, time and time_unit, if streams have their own
clocks, and shift_s, which is added to the stamps (with period_s: the time of the first).
"""

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from zwidth.logs.csv_form import CsvOptions
from zwidth.logs.drive_state import ENABLE, SUPPLY, nominal_of
from zwidth.logs.opening import opened
from zwidth.logs.source import RecordingError
from zwidth.logs.units import SI, UNITS, known_unit
from zwidth.sim.changes import known_changes
from zwidth.sim.device_file import other_kind
from zwidth.sim.nearest import nearest
from zwidth.sim.table import Table, TableError

SCHEMA = 1
CLOCK_KEYS = ("period_s", "time", "time_unit")
TOP_KEYS = (
    *("schema", "file", "source", "rotary", *CLOCK_KEYS, "resample"),
    *("input", "output", "base", "known_force", "joint", "covariate", "enable", "supply"),
    *("use", "csv", "device", "free"),
)
INPUT_KEYS = (
    *("signal", "file", "unit", "scale", "offset", "counts_per_rev", "counts_per_m", "wraps_at"),
    *(*CLOCK_KEYS, "shift_s"),
)
COMMAND_KEYS = (*INPUT_KEYS, "integral_time_s")
OUTPUT_KEYS = (*INPUT_KEYS, "quantity", "at")
BASE_KEYS = (*INPUT_KEYS, "quantity")
KNOWN_FORCE_KEYS = (*INPUT_KEYS, "at")
JOINT_KEYS = (*INPUT_KEYS, "name")
MOTIONS = ("position", "velocity", "acceleration")
COVARIATE_KEYS = ("signal", "file", "unit", "scale", "offset", *CLOCK_KEYS, "shift_s")
COVARIATE = "covariate"  # a quantity that a parameter may follow; prefix of its channel
KNOWN_FORCE, JOINT = "known_force_", "joint_"  # prefixes of these channels
QUANTITIES = tuple(quantity for quantity in SI if quantity != "command")
MASSES = ("m1", "m2", "m3", "m4", "m5")
PLACES = (*MASSES, "link12", "link23", "link34", "link45")


@dataclass(frozen=True)
class Clock:
    """Sample times of a signal: every period [s], or by a signal or an MCAP clock in unit [s].

    shift [s] is added.
    """

    period: float | None
    signal: str | None
    unit: float
    shift: float


@dataclass(frozen=True)
class Entry:
    """One channel. scale is None if the TOML gives none (then it is 1).

    file: where its signal is, "" for the recording's own file, whose time it shares. wraps_at: raw
    number at which a counter starts again at 0, None if it does not. over: divisor of its SI value.
    integral_time [s]: of the speed loop whose goal the signal is; None for any other command.
    """

    quantity: str
    channel: str
    signal: str
    unit: str | None
    scale: float | None
    offset: float
    counts_per_rev: float | None
    counts_per_m: float | None
    clock: Clock
    wraps_at: float | None = None
    over: float = 1.0
    file: str = ""
    integral_time: float | None = None


@dataclass(frozen=True)
class Description:
    """A recording TOML, checked.

    resample: None, 0 for the streams' longest period, or [s]. device, free: the tables of these
    names.
    """

    path: Path
    file: str
    source: str
    rotary: bool | None
    entries: tuple[Entry, ...]
    resample: float | None
    from_s: float
    to_s: float
    csv: CsvOptions
    device: Mapping[str, object] = field(default_factory=dict[str, object])
    free: Mapping[str, str] = field(default_factory=dict[str, str])


def load_description(path: Path) -> Description:
    """Read a recording TOML.

    Raises RecordingError with one sentence: not TOML (with the line), an unknown key (with the
    nearest known one), a wrong type, a value that is not allowed.
    """
    with opened(path) as file:
        return description_of(file.read(), path)


def description_of(data: bytes, path: Path) -> Description:
    """Return the description in the bytes of a recording TOML; raises as `load_description`."""
    try:
        values = tomllib.loads(data.decode("utf-8-sig"))
        if other := other_kind(values, "recording"):
            raise TableError(other)
        return _description(path, Table(values).only(TOP_KEYS))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise RecordingError(f"{path.name}: this is not TOML: {error}") from None
    except RecordingError:
        raise
    except ValueError as error:
        raise RecordingError(f"{path.name}: {error}") from None


def _description(path: Path, top: Table) -> Description:
    if "schema" in top and top.number("schema") != SCHEMA:
        raise TableError(f"schema is {top.number('schema'):g}; this version reads {SCHEMA}")
    entries = [_command(top.table("input").only(COMMAND_KEYS), top)] if "input" in top else []
    for table in top.tables("output"):
        table.only(OUTPUT_KEYS)
        quantity = _one_of(table, "quantity", QUANTITIES)
        if quantity == "acceleration" and _one_of(table, "at", PLACES).startswith("link"):
            raise TableError(f"{table.path}.at is a link, which has no acceleration; give a mass")
        entries.append(_entry(table, quantity, f"{quantity}_{_one_of(table, 'at', PLACES)}", top))
    if "base" in top:
        base = top.table("base").only(BASE_KEYS)
        quantity = _one_of(base, "quantity", MOTIONS)
        entries.append(_entry(base, quantity, f"base_{quantity}", top))
    for table in top.tables("known_force"):
        at = _one_of(table.only(KNOWN_FORCE_KEYS), "at", MASSES)
        entries.append(_entry(table, "force", f"{KNOWN_FORCE}{at}", top))
    for table in top.tables("joint"):
        name = table.only(JOINT_KEYS).text("name")
        if not name.strip():
            raise TableError(
                f"{table.path}.name is {name!r}; give the name of a joint of the model"
            )
        entries.append(_entry(table, "position", joint_channel(name), top))
    entries += _of_drive(top)
    if all(e.channel.startswith(("base_", KNOWN_FORCE, JOINT, ENABLE, SUPPLY)) for e in entries):
        raise TableError("the file describes no signal; add [input] or [[output]]")
    entries += [_covariate(table, top) for table in top.tables("covariate")]
    channels = [entry.channel for entry in entries]
    for channel in channels:
        if channels.count(channel) > 1:
            raise TableError(f"{channel} is described twice; keep one of the two tables")
    use = top.table("use").only(("from_s", "to_s"))
    from_s, to_s = use.number("from_s", -math.inf), use.number("to_s", math.inf)
    if not from_s < to_s:
        raise TableError(
            f"use.from_s is {from_s:g} and use.to_s {to_s:g}; from_s must be below to_s"
        )
    return Description(
        path,
        top.text("file"),
        top.text("source", ""),
        top.boolean("rotary") if "rotary" in top else None,
        tuple(entries),
        _resample(top),
        from_s,
        to_s,
        _csv(top.table("csv")),
        known_changes(top.table("device")).values,
        _words(top.table("free")),
    )


def _command(table: Table, top: Table) -> Entry:
    """Return what drives; a goal of a speed loop that integrates has no scale."""
    entry = _entry(table, "command", "command", top)
    if "integral_time_s" not in table:
        return entry
    unit = known_unit(entry.unit or "", f"{table.path}.unit").si
    if entry.scale is not None or unit not in (*SI["velocity"], "counts/s"):
        raise TableError(
            f"{table.path}.integral_time_s is allowed only if the command is the goal of a speed"
            " loop; give the unit of a speed, and no scale"
        )
    return replace(entry, integral_time=_positive(table, "integral_time_s"))


def _words(table: Table) -> dict[str, str]:
    """Return the words of `[free]`; what they stand for is checked with the device."""
    return {key: table.text(key) for key in table.values}


def joint_channel(name: str) -> str:
    """Return the channel name of a joint: "arm/elbow" is joint_arm_elbow."""
    return JOINT + re.sub(r"\W", "_", name)


def _of_drive(top: Table) -> list[Entry]:
    """The recorded state of the drive."""
    keys = tuple(key for key in INPUT_KEYS if not key.startswith(("counts_", "wraps_")))
    found: list[Entry] = []
    if ENABLE in top:
        found.append(_entry(top.table(ENABLE).only(keys), ENABLE, ENABLE, top))
    if SUPPLY in top:
        table = top.table(SUPPLY).only((*keys, "nominal"))
        found.append(replace(_entry(table, SUPPLY, SUPPLY, top), over=nominal_of(table)))
    return found


def _entry(table: Table, quantity: str, channel: str, top: Table) -> Entry:
    unit = table.text("unit") if "unit" in table else None
    entry = Entry(
        quantity,
        channel,
        table.text("signal"),
        unit,
        _scale(table),
        _finite(table, "offset", 0.0),
        _positive(table, "counts_per_rev") if "counts_per_rev" in table else None,
        _positive(table, "counts_per_m") if "counts_per_m" in table else None,
        _clock(table, top),
        _wraps_at(table, quantity),
        file=table.text("file", ""),
    )
    counted = unit is not None and known_unit(unit, f"{table.path}.unit").si.startswith("counts")
    known = sum(count is not None for count in (entry.counts_per_rev, entry.counts_per_m))
    if counted and known != 1 and entry.scale is None:
        raise TableError(
            f"{table.path}.unit is {unit!r}; give counts_per_rev, counts_per_m or scale"
        )
    if known and not counted:
        raise TableError(f'{table.path} has counts_per_...; that needs unit = "counts"')
    if known > 1:
        raise TableError(f"{table.path} has counts_per_rev and counts_per_m; keep one of them")
    return entry


def _scale(table: Table) -> float | None:
    scale = _finite(table, "scale") if "scale" in table else None
    if scale == 0.0:
        raise TableError(f"{table.path}.scale is 0; it must be a number other than 0")
    return scale


def _wraps_at(table: Table, quantity: str) -> float | None:
    """Return after how many raw numbers a position starts anew, None if it goes on."""
    if "wraps_at" not in table:
        return None
    if quantity not in ("position", "command"):
        raise TableError(
            f"{table.path}.wraps_at is given for a {quantity}; only a position may have it"
        )
    return _positive(table, "wraps_at")


def _covariate(table: Table, top: Table) -> Entry:
    """A covariate that parameters may depend on; its unit is only a label, without conversion."""
    signal = table.only(COVARIATE_KEYS).text("signal")
    name = re.sub(r"\W+", "_", signal).strip("_")
    return Entry(
        COVARIATE,
        f"{COVARIATE}_{name}",
        signal,
        table.text("unit") if "unit" in table else None,
        _scale(table),
        _finite(table, "offset", 0.0),
        None,
        None,
        _clock(table, top),
        file=table.text("file", ""),
    )


def _clock(table: Table, top: Table) -> Clock:
    own = any(key in table for key in ("period_s", "time"))
    home = table if own else top
    if ("period_s" in home) == ("time" in home):
        given = (
            "both period_s and time are given" if "time" in home else "period_s or time is missing"
        )
        place = f" in {home.path}" if own else ""
        raise TableError(
            f"{given}{place}; give one: the sampling period, or the signal of time stamps"
        )
    place = table if "time_unit" in table else top
    unit = 1.0
    if "time_unit" in place:
        named = known_unit(place.text("time_unit"), "time_unit")
        if named.si != "s":
            raise TableError(
                f"time_unit is {place.text('time_unit')!r}; it must be one of {_time_units()}"
            )
        unit = named.factor
    return Clock(
        _positive(home, "period_s") if "period_s" in home else None,
        home.text("time") if "time" in home else None,
        unit,
        _finite(table, "shift_s", 0.0),
    )


def _time_units() -> str:
    return ", ".join(name for name, unit in UNITS.items() if unit.si == "s")


def _resample(top: Table) -> float | None:
    if "resample" not in top:
        return None
    try:
        return 0.0 if top.boolean("resample") else None
    except TableError:
        pass
    try:
        return _positive(top, "resample")
    except TableError as error:
        allowed = "it must be true, false or a period above 0 [s]"
        raise TableError(f"{str(error).split(';')[0]}; {allowed}") from None


def _csv(table: Table) -> CsvOptions:
    table.only(("delimiter", "decimal", "header_line"))
    delimiter = table.text("delimiter") if "delimiter" in table else None
    if delimiter is not None and (len(delimiter) != 1 or delimiter in '"\n\r' or delimiter > "~"):
        raise TableError(f"csv.delimiter is {delimiter!r}; it must be one character, such as ';'")
    decimal = _one_of(table, "decimal", (".", ",")) if "decimal" in table else None
    line = table.number("header_line") if "header_line" in table else None
    if line is not None and (line < 0 or line != int(min(line, 1e9))):
        raise TableError(f"csv.header_line is {line:g}; it must be a whole number of 0 or more")
    return CsvOptions(delimiter, decimal, None if line is None else int(line))


def _one_of(table: Table, key: str, allowed: tuple[str, ...]) -> str:
    value = table.text(key)
    if value not in allowed:
        raise TableError(f"{table.path}.{key} is {value!r}; {nearest(value, allowed)}")
    return value


def _finite(table: Table, key: str, default: float | None = None) -> float:
    value = table.number(key, default)
    if not math.isfinite(value):
        raise TableError(f"{table.path}.{key} is {value}; it must be a finite number")
    return value


def _positive(table: Table, key: str) -> float:
    value = table.number(key)
    if not 0.0 < value < math.inf:
        where = f"{table.path}.{key}" if table.path else key
        raise TableError(f"{where} is {value:g}; it must be a number above 0")
    return value
