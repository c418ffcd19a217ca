"""The stiffest wall of the device found so far, at one damping, which takes a second."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from zwidth.diagnose_files import may_render
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.scenarios.scenario import usual_substeps
from zwidth.sim.device import Device
from zwidth.sim.readable import plain
from zwidth.stability.augmented_boundary import (
    LIMIT_S,
    LINEAR_START,
    RATIO,
    ROTARY_START,
    SECONDS,
    SUBSTEPS,
    TOLERANCE,
    critical,
)
from zwidth.stability.bisection import Search, find_brackets
from zwidth.stability.judging import Trial


@dataclass(frozen=True)
class Wall:
    """K_CR at a damping, None if no tried K is stable; start: displacement of the runs."""

    damping: float
    stiffness: float | None
    start: float
    rotary: bool

    @property
    def sentence(self) -> str:
        """Say the stiffest wall."""
        force, length = ("N m", "rad") if self.rotary else ("N", "m")
        damping = f"B = {plain(self.damping)} {force} s/{length}"
        if self.stiffness is None:
            return f"no wall of {damping} is stable"
        if self.stiffness == np.inf:
            return f"every wall of {damping} that was tried is stable"
        return f"a wall of {damping} is stable up to K = {self.stiffness:.3g} {force}/{length}"

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form; stiffness is null if no wall, or every wall, is stable."""
        known = self.stiffness is not None and np.isfinite(self.stiffness)
        return {
            "damping": self.damping,
            "stable_up_to": self.stiffness if known else None,
            "start": self.start,
            "sentence": self.sentence,
        }


def renders(device: Device, experiments: Sequence[Experiment], asked: bool | None) -> bool:
    """Whether to compute the wall of a device; asked: None: if it may render one."""
    return may_render(device, experiments) if asked is None else asked


def wall(device: Device, damping: float) -> Wall:
    """Return the stiffest stable wall at a damping, by runs as in `augmented_boundary`."""
    start = ROTARY_START if device.rotary else LINEAR_START
    window = max(0.25, 16.0 * device.interface.period)
    seconds = max(SECONDS, 8.0 * window)
    substeps = usual_substeps(device, SUBSTEPS)
    trial = Trial(start, seconds, max(LIMIT_S, seconds), window, substeps=substeps)
    grid = np.array([damping])
    ((bracket,),) = find_brackets([device], [grid], trial, Search(TOLERANCE, ratio=RATIO))
    return Wall(damping, critical(bracket), start, device.rotary)
