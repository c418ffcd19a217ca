"""Every key of a recording TOML: unit, default and what it means (`logs/recording_file.py`)."""

from zwidth.sim.keys import Key

_CLOCK = (
    ("period_s", "sampling period, if there are no time stamps", "s", ""),
    ("time", "the signal of the time stamps; for MCAP a clock of the messages: log_time,"
     " publish_time, header.stamp, stamp, timestamp", "", ""),
    ("time_unit", "unit of the stamps: s, ms, us, ns or min", "", '"s"'),
)  # fmt: skip
_SIGNAL = (
    ("signal", "a column, a variable, or topic.field", "", "", '"torque"'),
    ("file", "file of this signal, if it is not in the recording's file; its samples have the same"
     " times", "", "the recording's", '"torque.txt"'),
    ("unit", "unit of the raw numbers, such as deg, mm, V or counts", "", "SI", '"deg"'),
    ("scale", "factor to SI; if unit is given, raw numbers are first converted by it", "", "1",
     "35.15"),
    ("offset", "added after the scale", "SI", "0", "0.0"),
    ("counts_per_rev", "edges of an encoder per turn (lines times four), for unit counts", "",
     "none", "4000"),
    ("counts_per_m", "edges of an encoder per metre, for unit counts", "", "none", "1e6"),
    ("wraps_at", "count after which a position starts again at 0, such as 65536 for a counter of"
     " 16 bits", "raw", "none", "65536"),
    ("shift_s", "added to the stamps of this signal", "s", "0", "0.002"),
)  # fmt: skip
_EXAMPLES = {
    ("enable", "signal"): '"torque_enable"',
    ("enable", "unit"): "",
    ("enable", "scale"): "-1.0",
    ("enable", "offset"): "1.0",
    ("supply", "signal"): '"vbat"',
    ("supply", "unit"): '"V"',
    ("supply", "scale"): "11.0",
}


_COVARIATE = (
    ("signal", "a column, a variable, or topic.field: a temperature, a supply, a load that"
     " parameters may follow linearly", "", "", '"temp"'),
    _SIGNAL[1],
    ("unit", "unit to be shown; values are not converted", "", "none", '"degC"'),
    ("scale", "factor of the raw numbers", "", "1", ""),
    ("offset", "added after the scale", "", "0", ""),
    _SIGNAL[-1],
)  # fmt: skip


_OWN_PHYSICS = (
    ("effect", "an effect of the device file, with its parameters as there, or one that is still to"
     " be found", "", '"gravity_pendulum"'),
    ("at", "its place", "", '"m1"'),
    ("more", "by how much a parameter was larger in this run than in others", "none",
     "{ level = 0.93 }"),
    ("times", "or by which factor it was larger", "none", "{ level = 2.18 }"),
)  # fmt: skip
_FREE = (
    ("ground_spring", "a word: runs with the same word share a fitted value;"
     " likewise masses, ground_dampers, link_springs, link_dampers",
     '"stiff"'),
    ("position", "origin of positions", '"stiff"'),
    ("EFFECT@PLACE.PARAMETER", "a parameter of any effect, in the device file or to be found; the"
     " key is in quotes, such as \"coulomb_friction@m1.level\"", '"dry"'),
)  # fmt: skip


def _signals(table: str) -> tuple[Key, ...]:
    of_drive = table in ("enable", "supply")
    own = tuple(
        Key(
            table,
            name,
            meaning,
            unit,
            default=default,
            example=_EXAMPLES.get((table, name), example),
        )
        for name, meaning, unit, default, example in (
            _COVARIATE if table == "covariate" else _SIGNAL
        )
        if not (of_drive and name.startswith(("counts_", "wraps_")))
    )
    clocks = tuple(
        Key(table, name, f"as at the top, for a stream with its own clock: {meaning}",
            unit, default="that at the top")
        for name, meaning, unit, _ in _CLOCK
    )  # fmt: skip
    return (*own, *clocks)


RECORDING_KEYS: tuple[Key, ...] = (
    Key("", "schema", "version of this format", default="1", example="1"),
    Key("", "file", "path of the data, relative to this TOML", example='"data.csv"'),
    Key("", "source", "where the recording comes from", default='""'),
    Key("", "rotary", "true: N m and rad; false: N and m", default="as a unit shows",
        example="true"),
    *(Key("", name, meaning, unit, default=default or "period_s or time is required",
          example='"t"' if name == "time" else "")
      for name, meaning, unit, default in _CLOCK),
    Key("", "resample", "true: resample all streams to the longest of their periods; a number: to"
        " this period", "s", default="false"),
    *_signals("input"),
    Key("input", "integral_time_s", "integral time (proportional over integral gain) of a speed"
        " loop whose goal is the signal; the command is then a goal of position: the integral"
        " of this goal plus this time times the goal", "s", default="none",
        example="0.13"),
    *_signals("output"),
    Key("output", "quantity", "position, velocity, acceleration, or force (of a drive)",
        example='"position"'),
    *_signals("enable"),
    *_signals("supply"),
    Key("supply", "nominal", "voltage at which the device file's numbers hold", "V",
        example="12.0"),
    Key("output", "at", "the mass: m1 to m5", example='"m1"'),
    *_signals("base"),
    Key("base", "quantity", "position, velocity or acceleration of the base of the device; outputs"
        " are measured relative to the base", example='"acceleration"'),
    *_signals("known_force"),
    Key("known_force", "at", "the mass on which it acts besides the command: m1 to m5",
        example='"m1"'),
    *_signals("joint"),
    Key("joint", "name", "name of the joint in the robot's model whose position this is"
        " (--known-torque)", example='"elbow"'),
    *_signals("covariate"),
    Key("use", "from_s", "the first time that is used", "s", default="-inf"),
    Key("use", "to_s", "the last time that is used", "s", default="inf"),
    Key("csv", "delimiter", "character between the cells of a text table", default="detected"),
    Key("csv", "decimal", "the decimal point or comma", default="detected"),
    Key("csv", "header_line", "the line with the names of the columns; 0: none",
        default="detected"),
    Key("device", "masses", "value in this run, as in a device file; also"
        " ground_dampers, ground_spring, link_springs, link_dampers, delay_s, command_limit,"
        " command_gain and [[device.physics]]", "kg m2", "kg", default="the device file's"),
    *(Key("device.physics", name, meaning, default=default, example=example)
      for name, meaning, default, example in _OWN_PHYSICS),
    *(Key("free", name, meaning, default="one for all", example=example)
      for name, meaning, example in _FREE),
)  # fmt: skip
"""`sim/changes.py` explains [device], `diagnosis/recording/own.py` explains [free]."""
