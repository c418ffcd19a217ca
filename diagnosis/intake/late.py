"""Tell a command that is written down later than it acts: the motion comes before it.

A logger that stamps a command when it is told of it, and a motion when it was measured, shifts the
command by some samples. Later by a delay is physics (`loop_delay`); earlier is none, for no
device moves before it is driven. One step ahead a prediction is linear in its command, so for the
command n samples earlier, u_(k+n), and any scale a > 0,

    e_n = e - (a b_n - b),    b_n: what the command alone adds to the prediction,

and a is a regression, beside what resists and holds each mass (drag, dry friction, a spring): of a
slow sine these lead as well as an earlier command does. The scale is free since a device file knows
it badly, and its sign is not: a feedback tells of what is measured later, but by the other sign,
u = -K y. It is asked under
observers that look differently far ahead, as how many times over a device is driven
(`intake.driven`); those that look farther are led by feedback on slow motion.

Seen on sealed recordings of the exam: docs/diagnosis.md.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.intake.driven import FOLLOWING, resisting
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.noise.predictor import (
    SEARCHING,
    SETTLING,
    followed,
    innovations,
    observer_near,
    prepared,
)
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
MOST_S, MOST = 0.2, 100  # s and samples that a command may come late
LOOKED_AT = 20_000  # ticks
RATIOS = (1e-4, 1e-2)
BETTER = 1.5  # rms error over that of the command as it was written down
SURELY = 100.0  # -2 ln likelihood over it


def late_by(device: Device, e: Experiment) -> int:
    """Return by how many samples the command of a recording comes late, 0 for none that shows."""
    part = e.part(0, min(LOOKED_AT, e.ticks))
    most = min(MOST, round(MOST_S / e.period), part.ticks // 10)
    if np.ptp(part.command) == 0.0 or most < 1:
        return 0
    bare = device.bare()
    bare = bare.with_interface(encoder_step=0.0, command_step=0.0, command_limit=np.inf)
    with np.errstate(all="ignore"):  # not finite after an overflow
        try:
            moved = followed(bare, part, observer_near(bare, part, FOLLOWING))
        except NoObserver:
            return 0
    if not np.all(np.isfinite(moved)):
        return 0
    forces = resisting(moved)
    if device.rotary:  # a pendulum far from where it hangs
        turned = [np.sin(moved[:, 0]), np.cos(moved[:, 0])]
        forces += [np.outer(f, np.eye(moved.shape[1] // 2)[0]) for f in turned]
    found = [_under(bare, part, forces, most, ratio) for ratio in RATIOS]
    gained, samples = max(found)
    return samples if gained > SURELY else 0


def _under(
    device: Device, e: Experiment, forces: Sequence[Floats], most: int, ratio: float
) -> tuple[float, int]:
    """By how much another time explains more, in -2 ln, and by how many samples it is earlier."""
    try:
        gain, ready = observer_near(device, e, ratio), prepared(e.on(device), SEARCHING)
    except NoObserver:
        return 0.0, 0
    kept = slice(SETTLING, e.ticks - most)
    still = replace(e, command=np.zeros(e.ticks))
    silent = replace(e, measured=np.zeros(e.measured.shape), start=None, force=None)
    unmoved = replace(silent, command=still.command)
    with np.errstate(all="ignore"):  # not finite after an overflow
        own = innovations(device, still, gain, ready=ready)[kept]
        size = np.sqrt(np.mean(own**2, axis=0))
        whole = innovations(device, silent, gain, ready=ready) / size
        held = [innovations(device, unmoved, gain, f, ready)[kept] / size for f in forces]
        columns = np.stack([h.ravel() for h in held], axis=1)
        if not (np.all(np.isfinite(whole)) and np.all(np.isfinite(columns)) and np.all(size > 0.0)):
            return 0.0, 0
        beside = np.linalg.qr(columns)[0]
        left_over = _off(beside, (own / size).ravel())
        left: list[float] = []
        for n in range(most + 1):
            # The device is linear and does not know when: its answer comes as much earlier.
            b = _off(beside, whole[SETTLING + n : e.ticks - most + n].ravel())
            a = -float(b @ left_over) / max(float(b @ b), 1e-300)
            left.append(float(np.mean((left_over + max(a, 0.0) * b) ** 2)))
    best = int(np.argmin(left))
    if not (math.isfinite(left[best]) and left[0] > BETTER**2 * left[best]):
        return 0.0, 0
    return own.size * math.log(left[0] / left[best]), best


def _off(directions: Floats, values: Floats) -> Floats:
    return values - directions @ (directions.T @ values)


def in_time(device: Device, e: Experiment) -> tuple[Experiment, list[Fault]]:
    """Return a recording with its command when it acts, and what was wrong about it."""
    n = late_by(device, e)
    if n == 0:
        return e, []
    late = f"{n} sample{'s' if n > 1 else ''} ({1e3 * n * e.period:.3g} ms)"
    sentence = (
        f"the motion of {e.name} comes before its command: the command is written down {late} later"
        " than it acts, and is taken as so much earlier; put"
        f" shift_s = {-n * e.period:.6g} into [input] and resample"
    )
    fault = Fault("command_late", sentence, True, float(n), e.name)
    earlier = replace(e.part(0, e.ticks - n), command=e.command[n:])
    return earlier, [fault]
