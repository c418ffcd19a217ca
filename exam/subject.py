"""A subject of the exam: one device with its recordings, its file, and the truth."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from zwidth.diagnosis.recording.experiment import Experiment, experiment
from zwidth.exam.grammar import Law
from zwidth.exam.hidden import Hidden
from zwidth.sim.device import Device
from zwidth.sim.trace import Trace


@dataclass(frozen=True)
class Present:
    """An effect that a rig has.

    share: its size over the driving force, or over the travel. magnitude: as in
    `seeking.magnitude`. sigma: how much worse the recordings are predicted by the true device
    without this effect, after its linear parameters are refitted.
    """

    effect: str
    at: str
    values: Mapping[str, float]
    magnitude: float | None
    share: float
    sigma: float


@dataclass(frozen=True)
class Subject:
    """One device under examination.

    traces: recordings to fit. judged: recordings to judge the fit, none or one. hidden: effects of
    the library that the device has. law: its law that is not in the library. outside: its effect
    from another library, as JSON. device_file: "guessed", "fitted" or "exact". about: all other
    settings that made it, as JSON. floor: rms error of the true device in free runs, if it is not
    one that zwidth can describe; else None.
    """

    stratum: str
    traces: tuple[Trace, ...]
    judged: tuple[Trace, ...]
    nominal: Device
    truth: Device
    hidden: tuple[Hidden | Present, ...]
    device_file: str
    about: Mapping[str, Any]
    outside: dict[str, Any] | None = None
    law: Law | None = None
    law_sigma: float = 0.0
    floor: float | None = None

    @property
    def experiments(self) -> list[Experiment]:
        """The recordings to fit, as a diagnosis takes them."""
        return [experiment(t, self.nominal, f"r{i + 1}") for i, t in enumerate(self.traces)]

    @property
    def validation(self) -> list[Experiment] | None:
        """The recordings to judge by, None if there are none."""
        found = [experiment(t, self.nominal, f"v{i + 1}") for i, t in enumerate(self.judged)]
        return found or None
