"""The share of the possible improvement that a diagnosis reached: free runs on held-out data.

The last 30 % of each recording, or the validation recording, are predicted in windows of half a
second (a third of it, if that is less) by four devices: the device file's, the refitted one, the
augmented one, and the true one. Each has its own observer for the same noise, which is chosen with
the true device. From the rms errors,

    share = (before - after) / (before - perfect).

With a law outside the library no device is the true one; the perfect error is then the error of the
truth itself, simulated without noise from its true states.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import likeliest
from zwidth.diagnosis.noise.predictor import beginning_near, free_run_errors
from zwidth.diagnosis.noise.settle import refit
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.exam.sitting import recordings
from zwidth.exam.windows import window_of
from zwidth.scenarios.concealed.handout import recording_files
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_from_text, load_device

WORTH = 0.02  # the true device must improve the fit by this share to compare with it


@dataclass(frozen=True)
class HeldOut:
    """Rms errors of free runs [rad | m], or in the first output's own unit."""

    before: float
    refit: float
    after: float
    perfect: float

    @property
    def share(self) -> float | None:
        """Share of the true device's improvement on the device file; None if that is small."""
        return self._share(self.before)

    @property
    def share_beyond_refit(self) -> float | None:
        """The same share of the improvement on the refitted device: the part due to the physics."""
        return self._share(self.refit)

    def _share(self, start: float) -> float | None:
        most = start - self.perfect
        return (start - self.after) / most if most > WORTH * start else None


def held_out(
    folder: Path, name: str, key: Mapping[str, Any], answer: Mapping[str, Any]
) -> HeldOut | None:
    """Return the errors; None without a diagnosis, or if the error of the true model is unknown.

    Also None if no observer can be computed for one of the devices, so that nothing can be
    compared.
    """
    floor = key.get("floor")
    if answer["diagnosis"] is None or (key["outside"] is not None and floor is None):
        return None
    nominal = load_device(recording_files(folder, name)["device"])
    truth = device_from_text(key["device"])
    fit_on, judge_by = recordings(folder, name, nominal).parts()
    linear = answer["diagnosis"]["linear_refit"]
    origin = linear["origin"]["value"] if "origin" in linear else None
    augmented = device_from_text(answer["device"])
    try:
        truly = Model(truth)
        ratio = likeliest(fit_on, truly, np.zeros(truly.linear_count)).observer.ratio
        _, best = refit(nominal, fit_on)
        return HeldOut(
            _error(nominal, judge_by, ratio),
            _error(best.model.build(best.x), [best.model.seen(e, best.x) for e in judge_by], ratio),
            _error(augmented, [as_seen(e, origin) for e in judge_by], ratio),
            _error(truth, judge_by, ratio) if floor is None else floor,
        )
    except NoObserver:
        return None


def as_seen(e: Experiment, origin: float | None) -> Experiment:
    """Return a recording prepared for an augmented device, which has its own command scale.

    origin: in units of the rms motion, None for none. JSON has None, too, for what is not finite.
    """
    still = np.array([o.tells_position for o in e.outputs])
    before = None if e.before is None else as_seen(e.before, origin)
    return replace(e, measured=e.measured - (origin or 0.0) * e.swing * still, before=before)


def _error(device: Device, experiments: Sequence[Experiment], ratio: float) -> float:
    errors: list[np.ndarray] = []
    for e in experiments:
        gain = beginning_near(device, [e], ratio)
        found, _ = free_run_errors(device, e, gain, window_of(e.ticks, e.period))
        errors.append(found[:, 0])
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
