"""Whether a device is still true of the machine that recordings are of."""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from zwidth import checking
from zwidth.api.given import AnyDevice, AnyRecording, device_of, experiments_of, named_traces
from zwidth.checking import Check


def check(
    device: AnyDevice,
    recordings: AnyRecording | Sequence[AnyRecording],
    *,
    model: str | PathLike[str] | None = None,
    joint: str | None = None,
) -> Check:
    """Say whether a device is still true of its machine, and what changed where it is not.

    device: a Device with a band, as `diagnose(...).device`, or the file of one
    (NAME.augmented.toml). recordings: as `diagnose` takes them. model: an MJCF or URDF model of the
    robot, which MuJoCo runs instead of the device, against the device's band; joint: the one in it.
    Without a model joint is the one to take of recordings with several.

    `found.within` is the answer and `found.sentence` says it; parameters of the device are refitted
    where a recording is outside, and nothing is searched. Takes seconds. Raises ValueError with one
    sentence for a device without a band, for recordings that are no use with it, and for a model
    without its joint.
    """
    known = device_of(device)
    of_recordings = joint if model is None else None
    traces = named_traces(recordings, joint=of_recordings)
    each = [(name, experiments_of([(name, trace)], known)) for name, trace in traces]
    if model is None:
        return checking.check(known, each)
    if joint is None:
        raise ValueError("model needs joint, the name of the joint that the device is; give it")
    from zwidth.model_runs import ModelRuns, named_simulator

    path = Path(model)
    return checking.check(known, each, ModelRuns(known, path, joint), named_simulator(path))
