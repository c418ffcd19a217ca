"""Why recordings differ from the simulation of a device."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

from zwidth.api.given import (
    AnyDevice,
    AnyRecording,
    Arms,
    device_of,
    experiments_of,
    named_traces,
)
from zwidth.api.notebook import Say, telling
from zwidth.diagnosis import diagnose as pipeline
from zwidth.diagnosis.answer.own_units import in_own_units
from zwidth.diagnosis.answer.result import Diagnosis, Verdict
from zwidth.diagnosis.compiled import compiled
from zwidth.diagnosis.selection.effort import EFFORTS
from zwidth.door import FITTED, fitted
from zwidth.logs.recording import unscaled
from zwidth.sim.device import Device
from zwidth.sim.nearest import nearest
from zwidth.sim.readable import counted_in


def diagnose(
    recordings: AnyRecording | Sequence[AnyRecording],
    device: AnyDevice | None = None,
    *,
    validate: AnyRecording | Sequence[AnyRecording] | None = None,
    effort: Literal["quick", "normal", "thorough"] = "normal",
    known_torque: Arms | None = None,
    time: str | None = None,
    command: str | None = None,
    position: str | None = None,
    velocity: str | None = None,
    joint: str | None = None,
    say: Say | None = None,
) -> Diagnosis:
    """Compare recordings of a device with its simulation, and find the missing physics.

    recordings: one or several. Each is a path (a recording TOML, a log, or a CSV, MAT or other file
    of another tool; a warning says what was assumed), a Trace, a Run, a Log, or a table: a data
    frame of pandas or polars, a dict of arrays (samples,), an array (samples, signals). time,
    command, position, velocity: the columns of a table (for an array "0", "1" ...). Other columns
    are recognised by name and unit, such as "angle_deg", as in a CSV. joint: number or name of the
    joint to diagnose, if a recording has several, such as a robot's; by default the one that moves
    most. `diagnose_joints` diagnoses all. device: a Device, the name of a shipped one, or a device
    file. Without it one is fitted, with one to three masses. validate: recordings to judge by; by
    default the last 30 % of each recording. effort: quick, normal or thorough: how much is tried.
    known_torque: the model of a robot (MJCF or URDF), and the name of the joint that is diagnosed.
    MuJoCo then computes the torque of the robot's arms on that joint in the recorded posture. say:
    called with a sentence on each step, for example `print`; a diagnosis may take minutes. Without
    it, a notebook shows the present step in one line.

    If a command is in A or V, or a position in counts, and no scale is known, the answer is in
    these units and says so. It contains the improved device: `save_device(answer.device,
    "improved.toml")`. Raises ValueError with one sentence if a recording cannot be used with this
    device, and NotDiagnosed if an error leaves nothing to conclude.
    """
    if effort not in EFFORTS:
        raise ValueError(f"effort is {effort!r}; {nearest(effort, EFFORTS)}")
    named = {"time": time, "command": command, "position": position, "velocity": velocity}
    columns = {role: name for role, name in named.items() if name is not None}
    for role, name in columns.items():
        if not isinstance(name, str):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise TypeError(f"{role} is {name!r}; give the name of a column, a str")
        if (
            twice := next((r for r, n in columns.items() if n == name and r != role), None)
        ) is not None:
            raise ValueError(
                f"{role} and {twice} are both {name!r}; give a different column for each"
            )
    traces = named_traces(recordings, columns, joint=joint)
    judged_by = [] if validate is None else named_traces(validate, columns, "validate", joint)

    own = unscaled([trace for _, trace in traces])

    def answer(known: Device, say: Say) -> Diagnosis:
        fit_on = experiments_of(traces, known, known_torque)
        judge_by = experiments_of(judged_by, known, known_torque) if judged_by else None
        with (
            warnings.catch_warnings(action="ignore", category=RuntimeWarning),  # of numpy: 1e300
            counted_in(*own),
        ):
            found = pipeline.diagnose(known, fit_on, judge_by, say, EFFORTS[effort])
            return in_own_units(found)

    with telling(say, "diagnosing") as tell:
        compiled()
        if device is not None:
            return answer(device_of(device), tell)
        found = answer(fitted(traces)[0], tell)
        if found.verdict is Verdict.LINEAR_PARAMETERS and not found.interrupted:
            found = answer(replace(found.device, uncertainty=FITTED), tell)  # as in the command
        return found
