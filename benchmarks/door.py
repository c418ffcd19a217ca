"""What the door takes files for: time, command, motion, units and rate, held against the truth.

    python -m benchmarks.door [FOLDER]

FOLDER holds one folder for each kind of file (by default ../shared/cases). Nothing is diagnosed: a
file is read as `zwidth diagnose FILE` reads it, up to the recording, and a model of a robot as
`zwidth devices --from` does. What is right stands in `EXPECTED`, from the READMEs beside the files.
Exit status 1 where something is wrong or a file is missing.
"""

import argparse
import math
import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from zwidth.export.read_joint import device_of_joint
from zwidth.logs.assumed import assumed
from zwidth.logs.open_source import own_log
from zwidth.logs.recording import read_described, read_recording
from zwidth.logs.recording_file import description_of
from zwidth.logs.source import Source
from zwidth.logs.timing import examine
from zwidth.logs.units import find_unit

RATE_ERROR = 0.01  # of the rate, that a file whose stamps are uneven may differ by
SERVO = ("position_servo", "servo_limit")  # the effects that a position drive is in a device
CLOCK = "clock"  # the time is that of the messages or of each variable, and no signal


@dataclass(frozen=True)
class Taken:
    """What a file is taken for: outputs are channel -> (signal, unit), rate [Hz].

    time is None if samples are counted.
    """

    time: str | None
    rate: float
    command: tuple[str, str] | None
    outputs: Mapping[str, tuple[str, str]]


@dataclass(frozen=True)
class Refused:
    """One sentence in which all of these words stand."""

    words: tuple[str, ...]


@dataclass(frozen=True)
class Driven:
    """A joint of a robot's model: the numbers of its position drive."""

    joint: str
    numbers: Mapping[str, float]


def _rig(time: str, command: str, output: str, rate: float = 1000.0) -> Taken:
    return Taken(time, rate, (command, "N m"), {"position_m1": (output, "rad")})


def _moves(
    time: str | None, command: tuple[str, str] | None, rate: float = 100.0, **outputs: str
) -> Taken:
    """outputs: channel without its mass (m1) = "signal|unit"."""
    told = {f"{key}_m1": _pair(value) for key, value in outputs.items()}
    return Taken(time, rate, command, told)


def _pair(value: str) -> tuple[str, str]:
    name, _, unit = value.rpartition("|")
    return name, unit


EXPECTED: dict[str, Taken | Refused | Driven] = {
    "rigs/13_sign.csv": _rig("time", "torque_cmd_Nm", "angle_rad"),
    "rigs/15_iso_time.csv": _rig("timestamp", "torque_cmd_Nm", "angle_rad"),
    "rigs/2_swapped.csv": _rig("time", "torque_cmd_Nm", "angle_rad"),
    "rigs/6_excel.xlsx": _rig("time", "torque_cmd_Nm", "angle_rad"),
    "rigs/7_duplicate_time.csv": _rig("time", "torque_cmd_Nm", "angle_rad"),
    "rigs/8_nans.csv": _rig("time", "torque_cmd_Nm", "angle_rad"),
    "rigs/c_rk4.csv": _rig("time", "motor_torque_Nm", "motor_angle_rad"),
    "rigs/e_rk4.csv": _rig("t", "tau_Nm", "theta_rad"),
    "rigs/f_jitter30us.csv": _rig("time", "torque_Nm", "angle_rad"),
    "rigs/f_read_25us_late.csv": _rig("time", "torque_Nm", "angle_rad"),
    "rigs/j_current.csv": _moves(
        "timestamp_ms", ("current_A", "A"), 1000.0, position="encoder_counts|counts"
    ),
    "rigs/k_push.csv": _rig("time", "torque_Nm", "angle_rad"),
    "rigs/l_rk4.csv": _rig("time", "torque_Nm", "angle_rad", 500.0),
    "codesys_trace/codesys.trace.csv": _moves(
        CLOCK, ("GVL.fTorque", "N m"), position="GVL.fActPos|rad"
    ),
    "counts_named_steps/steps.csv": _moves(
        "time", ("pwm", "N m"), position="encoder|counts"
    ),
    "counts_named_steps/ticks.csv": _moves(
        "time_ms", ("pwm", "N m"), position="encoder_ticks|counts"
    ),
    "current_iq/speed_loop.txt": _moves(
        "Time", ("Iq", "A"), position="Position|rad", velocity="Velocity|rad/s"
    ),
    "eccentricity_of_one_count/p_control.csv": _moves(
        "Time", ("Motor Voltage", "V"), 500.0, position="Angle|rad"
    ),
    "eccentricity_of_one_count/p_control.recording.toml": _moves(
        "Time", ("Motor Voltage", "V"), 500.0, position="Angle|rad"
    ),
    "goal_and_actual/commanded_feedback.csv": _moves(
        "time_s", ("commanded_deg", "deg"), position="feedback_deg|deg"
    ),
    "goal_and_actual/dxl_latency.csv": _moves(
        "time_s", ("goal_position_deg", "deg"), 50.0, position="present_position_deg|deg"
    ),
    "goal_and_actual/dxl.recording.toml": _moves(
        "time_s", ("goal_position_deg", "deg"), 50.0, position="present_position_deg|deg"
    ),
    "goal_and_actual/ur_servoj.csv": _moves(
        "timestamp", ("target_q_0", "rad"), 500.0, position="actual_q_0|rad"
    ),
    "json_forms/arrays.json": _moves(
        None, ("data[0].actions", "N m"), position="data[0].states|rad"
    ),
    "json_forms/records.json": _moves("t", ("u", "N m"), position="q|rad"),
    "labview_lvm/labview.lvm": _moves(
        "X_Value", ("Torque", "Newton-Meter"), position="Angle|Degrees"
    ),
    "lerobot_parquet/lerobot.parquet": _moves(
        "timestamp", ("action[0]", "rad"), position="observation.state[0]|rad"
    ),
    "matlab_objects/iddata.mat": _moves(
        None, ("data.InputData", "N m"), position="data.OutputData|deg"
    ),
    "matlab_objects/iddata_full.mat": _moves(
        None, ("data.InputData", "N m"), position="data.OutputData|deg"
    ),
    "matlab_objects/swt.mat": Refused(("shows which of", "values(:,1)", "values(:,2)")),
    "matlab_objects/timeseries73.mat": Refused(("timeseries", ".Time", ".Data", "save")),
    "mjcf_position_actuator/servo.xml": Driven(
        "elbow", {"stiffness": 998.0, "damping": 2.73, "limit": 2.9}
    ),
    "mjcf_position_actuator/mesh_missing.xml": Driven(
        "elbow", {"stiffness": 998.0, "damping": 2.73, "limit": 2.9}
    ),
    "ripple_in_time/coast.txt": _moves(
        "Time", ("Iq", "A"), 1000.0, position="Position|rad", velocity="Velocity|rad/s"
    ),
    "robot_arrays/robot7.npz": _moves(
        "time", ("tau_command[6]", "N m"), position="q[6]|rad", velocity="qd[6]|rad/s"
    ),
    "robot_arrays/target.csv": _moves("time", ("current (1)", "A"), position="pos (1)|counts"),
    "rostopic/rostopic.csv": _moves(
        "time", ("field.effort0", "N m"),
        position="field.position0|rad", velocity="field.velocity0|rad/s",
    ),
    "separate_files/three.toml": _moves("column1", ("column1", "N m"), position="column1|rad"),
    "separate_files/sep_pos.txt": Refused(("one column",)),
    "separate_files/sep_tau.txt": Refused(("one column",)),
    "separate_files/sep_time.txt": Refused(("one column",)),
    "text_timestamps/clock_hms.csv": _moves("Time", ("torque_Nm", "N m"), position="angle_deg|deg"),
    "text_timestamps/iso_z.csv": _moves(
        "timestamp", ("torque_Nm", "N m"), position="angle_deg|deg"
    ),
    "time_of_other_length/time_shorter.mat": _moves(None, ("u", "N"), position="x1|m"),
    "union_rows/plotjuggler.csv": _moves(
        "__time", ("/effort_controller/command/data", "N m"),
        position="/joint_states/joint1/position|rad",
        velocity="/joint_states/joint1/velocity|rad/s",
    ),
    "v_is_speed/speed_response.mat": _moves("t", ("u", "N m"), velocity="v|rad/s"),
    "v_is_speed/v_only.csv": _moves("t", ("u", "N m"), velocity="v|rad/s"),
    "v_is_speed/y_rpm.csv": _moves("t", ("u", "N m"), velocity="rpm|rpm"),
    "wrong_counts_per_turn/cpr.csv": _moves("time", ("voltage", "V"), position="encoder|counts"),
    "wrong_counts_per_turn/cpr.recording.toml": _moves(
        "time", ("voltage", "V"), position="encoder|counts"
    ),
}  # fmt: skip


@dataclass
class Answer:
    """What the door made of a file; doubts and error are its own sentences."""

    taken: Taken | None = None
    numbers: Mapping[str, float] = field(default_factory=dict[str, float])
    doubts: list[str] = field(default_factory=list[str])
    error: str = ""


def answer(path: Path, expected: Taken | Refused | Driven) -> Answer:
    """Return what the door makes of a file, and no exception but a mistake of ours."""
    try:
        if isinstance(expected, Driven):
            device, _ = device_of_joint(path, expected.joint)
            found = {
                k: v for p in device.physics if p.effect.name in SERVO for k, v in p.values.items()
            }
            return Answer(numbers=found)
        return _recorded(path)
    except ValueError as error:
        return Answer(error=str(error))
    except Exception as error:  # a mistake of ours, which is a wrong answer to this file alone
        return Answer(error=f"{type(error).__name__} is no sentence: {error}")


def _recorded(path: Path) -> Answer:
    if path.suffix == ".toml":
        return Answer(_described(path.read_text(encoding="utf-8"), path))
    found = own_log(path)
    assert isinstance(found, Source), "a log of zwidth is no case of a door"
    guess = assumed(found, path.name)
    toml = path.with_suffix(".recording.toml")
    return Answer(_described(guess.text, toml), doubts=guess.doubts)


def _described(text: str, toml: Path) -> Taken:
    said = tomllib.loads(text)
    if toml.exists():
        trace = read_recording(toml)
    else:
        trace = read_described(description_of(text.encode(), toml), toml.parent)
    files = trace.facts["signals"]
    assert isinstance(files, dict)
    timing = examine(trace.t)
    time = said.get("time")
    if time in ("stamp", "log_time", "publish_time", "header.stamp", "timestamp"):
        time = time if any(time in c for c in _columns(trace.facts, toml)) else CLOCK
    tables = {"command": said["input"]} if "input" in said else {}
    tables |= {f"{t['quantity']}_{t['at']}": t for t in said["output"]}
    units = {key: t.get("unit") or trace.units[key] for key, t in tables.items()}
    pairs = {key: (str(t["signal"]), units[key]) for key, t in tables.items()}
    return Taken(time, timing.rate, pairs.pop("command", None), pairs)


def _columns(facts: Mapping[str, object], toml: Path) -> list[str]:
    found = own_log(toml.parent / str(facts["file"]))
    return list(found.signals) if isinstance(found, Source) else []


def faults(got: Answer, expected: Taken | Refused | Driven) -> list[str]:
    """Return what is wrong, in words."""
    if isinstance(expected, Refused):
        missing = [word for word in expected.words if word not in got.error]
        return [f"refused with the word {word!r} is right" for word in missing]
    if got.error:
        return [f"refused: {got.error}"]
    if isinstance(expected, Driven):
        return [
            f"{name} is {got.numbers.get(name, math.nan):g}, not {value:g}"
            for name, value in expected.numbers.items()
            if not math.isclose(got.numbers.get(name, math.nan), value, rel_tol=1e-9)
        ]
    assert got.taken is not None
    found: list[str] = []
    for name in ("time", "command"):
        one, right = getattr(got.taken, name), getattr(expected, name)
        if not _same(one, right):
            found.append(f"{name} is {one}, not {right}")
    for key in sorted({*got.taken.outputs, *expected.outputs}):
        one, right = got.taken.outputs.get(key), expected.outputs.get(key)
        if not _same(one, right):
            found.append(f"{key} is {one}, not {right}")
    if not math.isclose(got.taken.rate, expected.rate, rel_tol=RATE_ERROR):
        found.append(f"rate is {got.taken.rate:.6g} Hz, not {expected.rate:g}")
    return found


def _same(one: object, right: object) -> bool:
    """Whether two are equal; units are however they are spelled."""
    if isinstance(one, tuple) and isinstance(right, tuple):
        spelled, wanted = (find_unit(str(pair[1])) for pair in (one, right))
        return one[0] == right[0] and spelled is not None and spelled == wanted
    return one == right


def _shown(got: Answer) -> str:
    if got.error:
        return f"refused: {got.error}"
    if got.taken is None:
        return ", ".join(f"{name} {value:g}" for name, value in got.numbers.items())
    command = "nothing" if got.taken.command is None else "{} [{}]".format(*got.taken.command)
    motion = ", ".join(f"{k}: {n} [{u}]" for k, (n, u) in got.taken.outputs.items())
    time = got.taken.time or "counted"
    return f"time {time}, {got.taken.rate:.6g} Hz; driven by {command}; {motion}"


def main() -> int:
    """Print what every case is taken for, and whether that is right."""
    parser = argparse.ArgumentParser(description="Hold the door against files of known content.")
    parser.add_argument("folder", nargs="?", type=Path, default=Path("../shared/cases"))
    parser.add_argument("--doubts", action="store_true", help="print what the door doubts, too")
    options = parser.parse_args()
    if not options.folder.is_dir():
        parser.error(f"there is no folder {options.folder}; give the one that holds the cases")
    wrong = 0
    for name, expected in EXPECTED.items():
        path = options.folder / name
        if not path.exists():
            print(f"MISSING  {name}")
            wrong += 1
            continue
        got = answer(path, expected)
        said = faults(got, expected)
        wrong += bool(said)
        print(f"{'WRONG' if said else 'right':7}  {name}\n         {_shown(got)}")
        for fault in said:
            print(f"         ! {fault}")
        for doubt in got.doubts if options.doubts else ():
            print(f"         ? {doubt}")
    print(f"\n{len(EXPECTED) - wrong} of {len(EXPECTED)} right")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
