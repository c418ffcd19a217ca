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

    share: of what drives the rig, or of its travel; magnitude as in `seeking.magnitude`; sigma:
    by how much the rest of the truth, linear parameters refitted, predicts the recordings worse.
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

    traces: recordings to fit; judged: recordings to judge by, none or one. hidden: the library's
    effects that it has, law: what it has of no name, outside: what it has of another library, in
    JSON's types. device_file: "guessed", "fitted" or "exact".
    about: all else that made it, in JSON's types. floor: rms error of the truth itself over free
    runs where no device of ours is the truth, None elsewhere.
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
