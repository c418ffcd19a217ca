"""The scale of the command, estimated from the motion that it causes.

The scale comes from a regression (`intake.answering`) that allows drag, friction and device
parameters that are wrong by up to a half or a factor of two, which would otherwise change the
scale: drag on a mass is a force in phase with the motion, and so with the command. A fault is only
reported if no such device could move as recorded under the command.

Observers with several horizons are tried, and the one with which the command explains most decides,
unless another shows more clearly that the command is too large. With a very short horizon there is
little but noise; if a feedback has put that noise into the command, the scale comes out tens of
times too large. So a clear scale within the tolerance of a device file has precedence over a larger
one.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.intake.answering import Answering, looked_at, motion, resisting
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.settings import INTAKE
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
RATIOS = (1e-6, 1e-4, 1e-2, 1.0)
SMALLEST = 1e-3  # scale of a command that is known to drive forward


@dataclass(frozen=True)
class Driven:
    """The scale of the command that explains a motion best.

    gained: gain of -2 ln likelihood over the recorded command; better: this gain as a factor of the
    rms error. told: gain of -2 ln likelihood over no command at all.
    """

    scale: float
    gained: float
    better: float
    told: float


def driven(device: Device, e: Experiment, forward: bool = False) -> Driven | None:
    """Return how a device seems driven, or None; forward: whether the command's sign is right."""
    bare = device.bare().with_interface(encoder_step=0.0, command_step=0.0)
    e = looked_at(e)
    moved = motion(bare, e)
    if moved is None:
        return None
    forces = resisting(moved)
    with np.errstate(all="ignore"):
        each = [_under(bare, e, forces, ratio, forward) for ratio in RATIOS]
    found = [d for d in each if d is not None]
    if not found:
        return None
    clearest = max(found, key=lambda d: d.told)
    if clearest.scale > INTAKE.off:
        clear = [d for d in found if d.scale > 0.0 and d.told > INTAKE.clear]
        lowest = min(clear, key=lambda d: d.scale, default=clearest)
        clearest = lowest if lowest.scale < INTAKE.off else clearest
    # A command that is too large predicts motion that is not there; friction that holds a device
    # which hardly moves also looks like a weak command, and leaves as small an error.
    weaker = [
        d
        for d in found
        if d.scale < INTAKE.weak and d.told > INTAKE.clear and d.better > INTAKE.better
    ]
    least = max(weaker, key=lambda d: d.gained, default=clearest)
    return least if least.gained > clearest.gained else clearest


def _under(
    device: Device, e: Experiment, forces: Sequence[Floats], ratio: float, forward: bool
) -> Driven | None:
    """The same for one observer; None if it gives no result."""
    try:
        asked = Answering(device, e, ratio, forces)
        if not asked.usable:
            return None
        free = asked.left(None, lowest=SMALLEST if forward else -np.inf)
        as_is, nothing = asked.left(1.0).square, asked.left(0.0).square
    except (NoObserver, np.linalg.LinAlgError, ValueError):  # also after an overflow
        return None
    if not free.square > 0.0:
        return None
    return Driven(
        free.scale,
        asked.samples * float(np.log(as_is / free.square)),
        float(np.sqrt(as_is / free.square)),
        asked.samples * float(np.log(nothing / free.square)),
    )
