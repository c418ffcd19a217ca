"""Detects columns described in exchanged order: two outputs, or the command and a motion.

Two outputs of one quantity at two masses are exchanged if the device file then predicts them much
better (a device file may be wrong by half in every number). A command in place of a motion jumps as
no mass can, and seems driven by the motion in place of the command. With drag, friction and errors
of the device file (`intake.answering`), and with u and y exchanged and any scale,

    the share of the squares of e that remains with the command, over the share without any command,

is then less than half of its value as described. A command of one tone (of at least two periods)
shows nothing, since each of two sines is the other, scaled and delayed. Nor does a recording in
which the drive was switched off. Outputs are exchanged automatically; a command and a motion are
not, since each was converted with the other's unit.
"""

import itertools
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import periodogram

from zwidth.diagnosis.intake.answering import (
    RATIOS,
    Answering,
    looked_at,
    motion,
    resisting,
    unstepped,
)
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.noise.predictor import SETTLING, innovations, observer_near
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.settings import INTAKE
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
EXCHANGED = "command_exchanged"


def in_place(device: Device, e: Experiment) -> tuple[Experiment, list[Fault]]:
    """Return a recording with its columns in the right order, and the faults."""
    bare, part = unstepped(device), looked_at(e)
    with np.errstate(all="ignore"):  # squares may overflow
        held = np.sum(part.measured**2), np.sum(part.command**2)
    if not np.all(np.isfinite(held)):
        return e, []
    # This comes first: outputs also look exchanged if the command is exchanged with one of them.
    # Each output that seems to drive the command also moves the others, so the one is chosen that
    # explains it best.
    leaves = [_left_by_motion(bare, part, o) for o in range(len(e.outputs))]
    if min(leaves) < INTAKE.half:
        output = e.outputs[int(np.argmin(leaves))]
        sentence = (
            f"the command of {e.name} moves like a mass, and {output.name} jumps like a command:"
            " the signals of [input] and [[output]] are exchanged; swap them in the"
            " recording's TOML"
        )
        return e, [Fault(EXCHANGED, sentence, True, 0.0, e.name)]
    for a, b in itertools.combinations(range(len(e.outputs)), 2):
        if e.outputs[a].quantity == e.outputs[b].quantity and _exchanged(bare, part, a, b):
            order = list(range(len(e.outputs)))
            order[a], order[b] = b, a
            names = f"{e.outputs[a].name} and {e.outputs[b].name}"
            sentence = (
                f"{names} of {e.name} seem to be exchanged: the device file predicts them far"
                " better the other way round, which is used; swap their signals in the"
                " recording's TOML"
            )
            turned = replace(e, measured=np.ascontiguousarray(e.measured[:, order]))
            return turned, [Fault("outputs_exchanged", sentence, True, 0.0, e.name)]
    return e, []


def _exchanged(device: Device, e: Experiment, a: int, b: int) -> bool:
    order = list(range(len(e.outputs)))
    order[a], order[b] = b, a
    other = replace(e, measured=np.ascontiguousarray(e.measured[:, order]))
    most, best = _gains(device, (e, other), (a, b))
    # A wrong unit of one output also makes the exchange look better, but not with equal sizes.
    alike = min(_gains(device, (_evened(e, a, b), _evened(other, a, b)), (a, b)))
    surely = 2.0 * 2.0 * (e.ticks - SETTLING) * best > INTAKE.surely
    return min(most, best) > math.log(INTAKE.exchanged) and alike > 0.0 and surely


def _gains(
    device: Device, both: tuple[Experiment, Experiment], outputs: Sequence[int]
) -> tuple[float, float]:
    """By how much the second of two recordings errs less, in mean log rms innovation.

    The first value is with the observer that makes it largest, the second with the best observer
    for each recording; 0 if no observer can follow both.
    """
    as_is, turned = (_errors(device, one, outputs) for one in both)
    common = as_is.keys() & turned.keys()
    if not common:
        return 0.0, 0.0
    most = max(as_is[ratio] - turned[ratio] for ratio in common)
    return most, min(as_is.values()) - min(turned.values())


def _evened(e: Experiment, a: int, b: int) -> Experiment:
    """A recording with two outputs scaled to the same motion."""
    size = np.std(e.measured, axis=0)
    measured = e.measured.copy()
    if size[a] > 0.0 and size[b] > 0.0:
        measured[:, [a, b]] *= math.sqrt(float(size[a] * size[b])) / size[[a, b]]
    return replace(e, measured=measured)


def _errors(device: Device, e: Experiment, outputs: Sequence[int]) -> dict[float, float]:
    """Mean log rms innovation of two outputs, by the ratio of each possible observer."""
    found: dict[float, float] = {}
    for ratio in (*RATIOS, 1.0):
        try:
            with np.errstate(all="ignore"):  # not finite after an overflow
                out = innovations(device, e, observer_near(device, e, ratio))[SETTLING:]
                size = np.log(np.sqrt(np.mean(out[:, list(outputs)] ** 2, axis=0)))
        except NoObserver:
            continue
        if np.all(np.isfinite(size)):
            found[ratio] = float(size.mean())
    return found


def _left_by_motion(device: Device, e: Experiment, o: int) -> float:
    """Ratio of the unexplained shares, exchanged over described; 1 if it is unknown."""
    y, u = e.measured[:, o], e.command
    tones = one_tone(u) and (periods(u) >= 2 or one_tone(y, 0.9))
    off = e.strengths is not None and not np.all(e.strengths)
    if np.ptp(u) == 0.0 or tones or off:
        return 1.0
    alone = replace(e, measured=y[:, None].copy(), outputs=(e.outputs[o],))
    size = float(np.std(u)) / max(float(np.std(y)), 1e-300)
    other = replace(alone, command=y * size, measured=(u / size)[:, None])
    as_is, turned = _unanswered(device, alone), _unanswered(device, other)
    if not as_is > 0.0:
        return 1.0
    ratio = turned / as_is
    surely = -(e.ticks - SETTLING) * math.log(max(ratio, 1e-300)) > INTAKE.surely
    return ratio if surely else 1.0


def one_tone(u: Floats, share: float = INTAKE.tone) -> bool:
    """Whether nearly all of the power of a signal lies in one line."""
    _, power = periodogram(u, window="hann")
    most = int(np.argmax(power))
    line = slice(max(0, most - 2), most + 3)  # the width of the window
    return float(power[line].sum()) > share * float(power.sum())


def periods(u: Floats) -> int:
    """Return how many periods of its strongest line a signal has."""
    return int(np.argmax(periodogram(u, window="hann")[1]))


def _unanswered(device: Device, e: Experiment) -> float:
    """The smallest share of the squares of e that remains with a command of any scale."""
    found = [1.0]
    if (moved := motion(device, e)) is None:
        return 1.0
    for ratio in RATIOS:
        with suppress(NoObserver, np.linalg.LinAlgError, ValueError), np.errstate(all="ignore"):
            asked = Answering(device, e, ratio, resisting(moved))
            if asked.usable and (nothing := asked.left(0.0).square) > 0.0:
                found.append(asked.left(None).square / nothing)
    return min(found)
