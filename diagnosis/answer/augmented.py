"""The improved device: the device file of the values that the fit used.

A fit reads a recording by a gain of the command, an origin of the position (where a spring to
ground rests) and a command that is held or smooth, takes steps off the recording and lost commands
out of it, and folds a sensor out. All that is the device's, so that `zwidth simulate` of the saved
device, under the command as it was recorded and from where it began, runs as the fit does freely.

Readings that are taken before their commands act (a negative skew) are a delay of the loop, and are
the device's too. Limits: readings that are taken after it have no place in a device, in which a
command follows from its reading; nor has by how much commands arrive early or late on average
(jitter), which is a way to read a velocity and no motion. Which commands were lost is of the
recording: a device has their rate. In several recordings of which some had smooth commands, the
device says so where all did. A simulation's drive is on and at
its nominal supply at all times: a recording in which it was not is no scenario. What limits the
rate of a command lets a recording begin where it is, and a simulation at zero.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.result import Estimate, Finding
from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.selection.searched import Searched
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics

Floats = NDArray[np.float64]


def augmented(
    model: Model,
    x: Floats,
    swing: float,
    smooth: bool = False,
    folded: bool = False,
    encoder_step: float = 0.0,
    early: float = 0.0,
) -> Device:
    """Return the device of a model at x, with how it reads recordings.

    swing: rms motion, in which the origin counts. smooth: whether the commands were; folded:
    whether the sensor was folded out; encoder_step: what the samples themselves show, or 0.
    early [s]: by how much readings are taken before commands act.
    """
    device, reads, known = model.build(x), model.reads(x), model.nominal.interface
    device = device.with_interface(
        command_gain=known.command_gain * reads.gain,
        position_origin=known.position_origin + reads.origin * swing,
        command_hold="smooth" if smooth else known.command_hold,
        delay=device.interface.delay + early,
    )
    if folded:
        device = device.with_physics(make_physics("rectified_sensor", "sensor"))
    if encoder_step > 0.0:
        step = make_physics("encoder_step", "sensor", step=encoder_step)
        device = device.with_physics(step)
    return device


def improved(
    taken: Taken,
    found: Searched,
    refit: Mapping[str, tuple[float, Estimate]],
    findings: Sequence[Finding],
) -> Device:
    """Return the device of an answer, with all that was found and how recordings are read.

    Readings that are taken before commands act delay it, where that is told from nothing.
    """
    model = found.final.model
    _, skew = refit.get("skew", (0.0, Estimate(0.0, 0.0, 0.0)))
    steps = [f for f in findings if f.effect == "encoder_step" and not model.has(f.effect)]
    smooth = [fault for fault in taken.faults if fault.kind == "smooth_command"]
    return augmented(
        model, found.final.x, taken.whole[0].swing,
        smooth=len(smooth) >= len(taken.whole) > 0,
        folded=any(f.effect == "rectified_sensor" for f in findings),
        encoder_step=max((f.parameters["step"].value for f in steps), default=0.0),
        early=-skew.value if skew.upper < 0.0 else 0.0,
    )  # fmt: skip
