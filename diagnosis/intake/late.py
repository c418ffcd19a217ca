"""Detects a command whose recorded time is not the time at which it acts.

A logger that stamps a command when it receives it, and a motion when it was measured, shifts the
command by some samples. A regression finds such a shift by n samples (`intake.answering`), with any
scale, drag, friction and a device file that is wrong by half. If the motion comes before its
command (n > 0) the recording is wrong, since no device moves before it is driven. If it comes later
than according to the device file (n < 0), the cause may be physics (`loop_delay`, `actuator_lag`),
and the shift is only reported.

Errors of a device file shift n by a sample or more, the more the longer the horizon of the
observer. So two observers with different horizons must both find a shift, within a third of each
other, and the smaller one counts; only a true shift is the same for both. A shift is accepted if it
makes the errors 1.5 times smaller, or if both observers find more than a sample and one is five
sigma of blocks from zero (`evidence.compared`): a wrong hold (`intake.hold`) is half a sample. If
only sigma is clear, a late command must be late by a whole sample more than the device file's
delay, since this delay may be wrong, and friction has made 0.3 % of the errors look late. The scale
is free, since device files give it inaccurately, but not its sign: a feedback predicts later
measurements, with the opposite sign, u = -K y.

Tests on faults put into recordings of machines: docs/machines/README.md.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.intake.answering import (
    RATIOS,
    Answering,
    Left,
    looked_at,
    motion,
    resisting,
    unstepped,
)
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.evidence import compared
from zwidth.diagnosis.settings import EVIDENCE, INTAKE, VERDICT
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
EARLY = "command_early"
MOST_S, MOST = 0.2, 100  # largest shift of a command, in s and in samples


def shifted_by(device: Device, e: Experiment) -> int:
    """Return by how many samples a command is late, negative for early, 0 if no shift is clear."""
    part = looked_at(e)
    most = min(MOST, round(MOST_S / e.period), part.ticks // 10)
    if np.ptp(part.command) == 0.0 or most < 1:
        return 0
    bare = unstepped(device)
    moved = motion(bare, part)
    if moved is None:
        return 0
    turned = [np.sin(moved[:, 0]), np.cos(moved[:, 0])] if device.rotary else []
    hangs = [np.outer(f, np.eye(moved.shape[1] // 2)[0]) for f in turned]  # gravity of a pendulum
    known: list[Shift] = []
    for ratio in RATIOS:
        try:
            asked = Answering(bare, part, ratio, resisting(moved), hangs, most)
            shift = _under(asked, most) if asked.usable else None
        except (NoObserver, np.linalg.LinAlgError, ValueError):  # also after an overflow
            continue
        known += [shift] if shift is not None and shift.gained > INTAKE.known else []
    if len(known) < len(RATIOS):
        return 0
    least, largest = sorted((shift.samples for shift in known), key=abs)
    if not any(shift.sure(most, abs(least) == 1) for shift in known):
        return 0
    clear = any(shift.better > INTAKE.better for shift in known)
    if not clear and 0 < least < 1.0 + device.interface.delay / e.period:
        return 0
    return least if abs(largest - least) <= max(1.0, abs(least) / 3.0) else 0


@dataclass(frozen=True)
class Shift:
    """The delay of a command in samples, and its evidence.

    gained: decrease of -2 ln likelihood; better: the same as a factor of the rms error; sigma:
    significance by blocks.
    """

    samples: int
    gained: float
    better: float
    sigma: float

    def sure(self, most: int, single: bool) -> bool:
        """Whether the shift is significant; single: whether both observers found one sample."""
        clear = self.better > INTAKE.better or (not single and self.sigma > VERDICT.apart)
        return 0 < abs(self.samples) < most and self.gained > INTAKE.surely and clear


def _under(asked: Answering, most: int) -> Shift | None:
    """The result of one observer; None if the command explains nothing."""

    @cache
    def left(earlier: int) -> Left:
        return asked.left(None, earlier, lowest=0.0)

    squares = _screened(asked, most)
    late, early = squares[most + 1 :], squares[:most]
    begins = (int(np.argmin(late)) + 1, int(np.argmin(early)) - most)
    best = min((_downhill(left, n, most) for n in begins), key=lambda n: left(n).square)
    as_is, other = left(0), left(best)
    if not other.square > 0.0 or not math.isfinite(as_is.square) or not other.scale > 0.0:
        return None
    blocks = np.array_split(np.arange(asked.samples), EVIDENCE.blocks)
    gains = np.array([np.sum(as_is.errors[b] ** 2 - other.errors[b] ** 2) for b in blocks])
    apart = np.array([np.sum((as_is.errors[b] - other.errors[b]) ** 2) for b in blocks])
    sigma = compared(gains / other.square, apart / other.square).sigma
    ratio = as_is.square / other.square
    return Shift(best, asked.samples * math.log(ratio), math.sqrt(ratio), sigma)


def _downhill(left: Callable[[int], Left], begin: int, most: int) -> int:
    """The shift that is better than both its neighbours, downhill from a first one."""
    here = begin
    while True:
        near = [n for n in (here - 1, here + 1) if -most <= n <= most]
        best = min(near, key=lambda n: left(n).square)
        if left(best).square >= left(here).square:
            return here
        here = best


def _screened(asked: Answering, most: int) -> Floats:
    """Remaining mean squares (2 most + 1,) for each shift, with an exact device file."""
    beside = np.linalg.qr(asked.forces)[0]
    own = asked.flat(asked.own)
    own = own - beside @ (beside.T @ own)
    found: list[float] = []
    for n in range(-most, most + 1):
        b = asked.flat(asked.command, n)
        b = b - beside @ (beside.T @ b)
        a = -float(b @ own) / max(float(b @ b), 1e-300)
        found.append(float(np.mean((own + max(a, 0.0) * b) ** 2)))
    return np.nan_to_num(np.array(found), nan=np.inf)


def in_time(device: Device, e: Experiment) -> tuple[Experiment, list[Fault]]:
    """Return a recording with its command at the time when it acts, and the fault if any."""
    n = shifted_by(device, e)
    if n == 0:
        return e, []
    by = f"{abs(n)} sample{'s' if abs(n) > 1 else ''} ({1e3 * abs(n) * e.period:.3g} ms)"
    if n < 0:
        sentence = (
            f"in {e.name}, the motion follows the command {by} later than in the device file:"
            " either the drive has a delay or a lag that the file lacks, or the recorded command is"
            " too early by this time"
        )
        return e, [Fault(EARLY, sentence, False, float(-n), e.name)]
    sentence = (
        f"in {e.name}, the motion comes before the command: the recorded command is {by} too late;"
        " the diagnosis corrects this; to correct the recording's TOML, put"
        f" shift_s = {-n * e.period:.6g} into [input], and resample"
    )
    fault = Fault("command_late", sentence, True, float(n), e.name)
    earlier = replace(e.part(0, e.ticks - n), command=e.command[n:])
    return earlier, [fault]
