"""The improved device, as a device file, from the values of the fit.

A fit reads a recording with a gain of the command, an origin of the position (where a spring to
ground is at rest) and a command that is held or smooth. It removes the steps of the recording and
lost commands, and unfolds a rectifying sensor. All of these become part of the device, so that
`zwidth simulate` of the saved device, under the recorded command and from the recorded start, runs
as the free run of the fit.

Readings that are taken before their commands act (a negative skew) are a delay of the loop, and are
also stored in the device. Limits: a device cannot store readings that are taken after the command,
since it computes a command from its reading; nor jitter, the mean error of the times of commands,
which affects the reading of a velocity but no motion. It stores the rate of lost commands, not
which were lost. It has smooth commands only if all recordings had. A simulation has its drive on
and at its nominal supply at all times, so a recording with other supplies cannot be repeated as a
scenario. A limit of the command's rate starts at the recorded command in a fit, and at zero in a
simulation.
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
    """Return the device of a model at x, including how the model reads recordings.

    swing: rms motion, the unit of the origin. smooth: whether the commands were smooth; folded:
    whether the sensor was unfolded; encoder_step: the step that the samples themselves show, or 0.
    early [s]: by how much readings precede their commands.
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
    """Return the device of an answer, with its findings and how it reads recordings.

    Readings that are taken before commands act become a delay, if the recordings show it clearly.
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
