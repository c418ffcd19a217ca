"""Whether a device file still describes the machine of its recordings."""

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from zwidth import checking
from zwidth.api.given import AnyDevice, AnyRecording, device_of, experiments_of, named_traces
from zwidth.api.notebook import telling
from zwidth.checking import Check


def check(
    device: AnyDevice,
    recordings: AnyRecording | Sequence[AnyRecording],
    *,
    model: str | PathLike[str] | None = None,
    joint: str | None = None,
) -> Check:
    """Say whether a device still predicts its machine, and if not, what changed.

    device: a Device with a band, such as the improved device `diagnose(...).device`, or its file
    (NAME.augmented.toml). recordings: as for `diagnose`. model: an MJCF or URDF model of the robot;
    MuJoCo then simulates this model instead of the device, and its errors are compared with the
    device's band. joint: the joint of the model or, without a model, the joint to use from
    recordings with several.

    The result's `within` is the answer, its `sentence` the answer in words. If a recording is
    outside the band, the device's parameters are refitted; no new effects are searched for. This
    takes seconds. Raises ValueError with one sentence for a device without a band, for recordings
    that cannot be used with it, and for a model without a joint.
    """
    known = device_of(device)
    of_recordings = joint if model is None else None
    traces = named_traces(recordings, joint=of_recordings)
    each = [(name, experiments_of([(name, trace)], known)) for name, trace in traces]
    if model is None:
        with telling(None, "checking the device") as tell:
            return checking.check(known, each, say=tell)
    if joint is None:
        raise ValueError(
            "model is given without joint; give the name of the joint that the device describes"
        )
    from zwidth.model_runs import ModelRuns, simulator_here

    path = Path(model)
    runs, named = ModelRuns(known, path, joint), f"{path.name} in {simulator_here()}"
    with telling(None, "checking the model") as tell:
        return checking.check(known, each, runs, named, say=tell)
