"""What physics is missing in each joint of a recording with several."""

import warnings
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Literal

from zwidth.api.diagnose import diagnose
from zwidth.api.given import AnyDevice
from zwidth.api.notebook import telling
from zwidth.diagnosis.answer.joints import JointAnswers
from zwidth.diagnosis.answer.result import Diagnosis, NotDiagnosed
from zwidth.logs.assumed import joints_of
from zwidth.logs.in_memory import AnyTable, is_table, source_of
from zwidth.logs.open_source import open_source


def diagnose_joints(
    recording: AnyTable | str | PathLike[str],
    device: AnyDevice | None = None,
    *,
    effort: Literal["quick", "normal", "thorough"] = "normal",
    say: Callable[[str], None] | None = None,
) -> JointAnswers:
    """Say for each joint of a recording what physics its simulation lacks, as `diagnose` for one.

    recording: the path of a file with several joints, such as a robot's; or a table: a data frame,
    a dict of arrays (samples,), an array (samples, signals). Joints that stand still are left out.
    device: of every joint, if all are alike. Without it, a device is fitted to each joint. effort,
    say: see `diagnose`; without say, a notebook shows one line for each joint.

    A joint that cannot be diagnosed is in `left`, with the reason. Raises ValueError if fewer
    than two joints move, and LogError for a file that cannot be read.
    """
    if not isinstance(recording, str | PathLike) and not is_table(recording):
        raise TypeError(
            f"recording is of type {type(recording).__name__}; give the path of a file with several"
            " joints, or a table"
        )
    source = (
        open_source(Path(recording))
        if isinstance(recording, str | PathLike)
        else source_of(recording)
    )
    answers: dict[str, Diagnosis] = {}
    left: dict[str, str] = {}
    for joint in joints_of(source).moving:
        if say is not None:
            say(f"joint {joint}")
        try:
            with (
                warnings.catch_warnings(action="ignore", category=UserWarning),
                telling(say, f"diagnosing joint {joint}") as tell,
            ):
                answers[joint] = diagnose(recording, device, effort=effort, joint=joint, say=tell)
        except NotDiagnosed as error:
            left[joint] = str(error)
        except ValueError as error:
            left[joint] = str(error)
    return JointAnswers(answers, left)
