"""A search on all data so far, in its own process; it finds the structure for quick fits."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.result import Verdict
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.mishaps import silent
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import stretches
from zwidth.diagnosis.selection.effort import EFFORTS
from zwidth.door import FITTED, fitted
from zwidth.logs.recording_file import Description
from zwidth.sim.device import Device
from zwidth.watch.state import read

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Searched:
    """The result of a search on the first `samples`, which last `seconds`.

    device: the given one, or the fitted one; model, x: of the answer; misread: corrections of the
    recording. said: how a device was fitted.
    """

    samples: int
    seconds: float
    device: Device
    model: Model
    x: Floats
    verdict: str
    headline: str
    sentence: str
    misread: tuple[Fault, ...]
    said: tuple[str, ...] = ()


def first_device(spool: Path, description: Description | None, name: str) -> tuple[Device, Any]:
    """Return a device that is fitted to the data so far, and messages about it.

    Raises ValueError if the data do not determine a device.
    """
    trace = read(spool, description).trace
    assert trace is not None
    return fitted([(name, trace)])


def searched(
    spool: Path, description: Description | None, name: str, device: Device | None, effort: str
) -> Searched:
    """Diagnose the data so far; raises ValueError as the pipeline does.

    A device that is not given is fitted, as `zwidth diagnose` does.
    """
    found = read(spool, description)
    trace = found.trace
    assert trace is not None
    said: list[str] = []
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # of numpy, on 1e300
        asked = device
        if asked is None:
            asked, said = fitted([(name, trace)])
        ask: Callable[[Device], Any] = lambda one: diagnose(  # noqa: E731
            one, stretches(trace, one, name), None, silent, EFFORTS[effort]
        )
        answer = ask(asked)
        if device is None and answer.verdict is Verdict.LINEAR_PARAMETERS:
            asked = replace(answer.device, uncertainty=FITTED)
            answer = ask(asked)
    final = answer.searched.final
    misread = tuple(f for f in answer.faults if f.wrong and f.channels)
    return Searched(
        found.samples, found.seconds, asked, final.model, final.x, answer.verdict.value,
        answer.headline, answer.sentence, misread, tuple(said),
    )  # fmt: skip
