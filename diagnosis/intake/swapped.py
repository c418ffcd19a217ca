"""Tell columns that were described for one another: two outputs, or the command and a motion.

Two outputs of one quantity at two masses are read the other way round, and the better prediction
by the device file decides, by much (a device file is off by half in every number). A command that
stands where a motion should jumps where nothing with a mass can, and the motion that stands in its
place drives it: beside drag, friction and a device file that is off (`intake.answering`), with u
and y exchanged and any scale,

    what the command leaves of the squares of e, over what is left without any command,

is less than half of what it is as described. Of a command of one tone nothing tells: each of two
sines is the other, scaled and late. Outputs are exchanged again; a command and a motion
are not, since each was converted by the other's unit.
"""

import itertools
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import periodogram

from zwidth.diagnosis.intake.answering import Answering, resisting
from zwidth.diagnosis.intake.driven import FOLLOWING
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.noise.predictor import SETTLING, followed, innovations, observer_near
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
EXCHANGED = "command_exchanged"
LOOKED_AT = 20_000  # ticks
RATIOS = (1e-4, 1e-2, 1.0)
BETTER = 2.0  # rms error over that of the outputs as they were described
SURELY = 100.0  # -2 ln likelihood over it
ONE_TONE = 0.95  # of the power of a command, in one line
HALF = 0.5  # of what a command leaves as described, that it leaves the other way round
ANSWERED = (1e-4, 1e-2)  # ratios of the observers under which a command is asked for


def in_place(device: Device, e: Experiment) -> tuple[Experiment, list[Fault]]:
    """Return a recording with its outputs in their places, and what was wrong about its columns."""
    bare = device.bare()
    bare = bare.with_interface(encoder_step=0.0, command_step=0.0, command_limit=np.inf)
    part = e.part(0, min(LOOKED_AT, e.ticks))
    with np.errstate(all="ignore"):  # of sizes that no square holds nothing is told
        held = np.sum(part.measured**2), np.sum(part.command**2)
    if not np.all(np.isfinite(held)):
        return e, []
    faults: list[Fault] = []
    for a, b in itertools.combinations(range(len(e.outputs)), 2):
        if e.outputs[a].quantity == e.outputs[b].quantity and _exchanged(bare, part, a, b):
            order = list(range(len(e.outputs)))
            order[a], order[b] = b, a
            names = f"{e.outputs[a].name} and {e.outputs[b].name}"
            sentence = (
                f"{names} of {e.name} are described for one another: exchanged, the device file"
                " predicts them by far better, and they are taken so; exchange their signals in"
                " the recording's TOML"
            )
            faults.append(Fault("outputs_exchanged", sentence, True, 0.0, e.name))
            e = replace(e, measured=np.ascontiguousarray(e.measured[:, order]))
            break
    if not faults and _driven_by_motion(bare, part):
        sentence = (
            f"the command of {e.name} moves like a mass, and {e.outputs[0].name} jumps like a"
            " command: the signals of [input] and [[output]] stand for one another; exchange them"
            " in the recording's TOML"
        )
        faults.append(Fault(EXCHANGED, sentence, True, 0.0, e.name))
    return e, faults


def _exchanged(device: Device, e: Experiment, a: int, b: int) -> bool:
    order = list(range(len(e.outputs)))
    order[a], order[b] = b, a
    other = replace(e, measured=np.ascontiguousarray(e.measured[:, order]))
    as_is, turned = (_errors(device, one, (a, b)) for one in (e, other))
    better = min((t - s for s, t in zip(as_is, turned, strict=True)), default=0.0)
    least = min(turned, default=math.inf) - min(as_is, default=math.inf)
    samples = 2 * (e.ticks - SETTLING)
    return max(better, least) < -math.log(BETTER) and -2.0 * samples * least > SURELY


def _errors(device: Device, e: Experiment, outputs: Sequence[int]) -> list[float]:
    """Mean log rms innovation of two outputs, under each observer."""
    found: list[float] = []
    for ratio in RATIOS:
        try:
            with np.errstate(all="ignore"):  # not finite after an overflow
                out = innovations(device, e, observer_near(device, e, ratio))[SETTLING:]
                size = np.log(np.sqrt(np.mean(out[:, list(outputs)] ** 2, axis=0)))
        except NoObserver:
            continue
        if np.all(np.isfinite(size)):
            found.append(float(size.mean()))
    return found


def _driven_by_motion(device: Device, e: Experiment) -> bool:
    """Whether the first output drives the command rather than the other way round."""
    y, u = e.measured[:, 0], e.command
    if np.ptp(u) == 0.0 or one_tone(u):
        return False
    alone = replace(e, measured=y[:, None].copy(), outputs=e.outputs[:1], start=None)
    size = float(np.std(u)) / max(float(np.std(y)), 1e-300)
    other = replace(alone, command=y * size, measured=(u / size)[:, None])
    as_is, turned = _unanswered(device, alone), _unanswered(device, other)
    if not turned < HALF * as_is:
        return False
    return (e.ticks - SETTLING) * math.log(as_is / max(turned, 1e-300)) > SURELY


def one_tone(u: Floats) -> bool:
    """Whether nearly all of the power of a signal lies in one line."""
    _, power = periodogram(u, window="hann")
    line = slice(max(0, int(np.argmax(power)) - 2), int(np.argmax(power)) + 3)  # the window's own
    return float(power[line].sum()) > ONE_TONE * float(power.sum())


def _unanswered(device: Device, e: Experiment) -> float:
    """The least share of the squares of e that a command leaves, of any scale."""
    found = [1.0]
    for ratio in ANSWERED:
        with suppress(NoObserver, np.linalg.LinAlgError, ValueError), np.errstate(all="ignore"):
            moved = followed(device, e, observer_near(device, e, FOLLOWING))
            if not np.all(np.isfinite(moved)):
                continue
            asked = Answering(device, e, ratio, resisting(moved))
            if asked.usable and (nothing := asked.left(0.0).square) > 0.0:
                found.append(asked.left(None).square / nothing)
    return min(found)
