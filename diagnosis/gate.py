"""Is the recording itself sound? Faults of the recording are findings of their own.

Looked at: repeated samples, the encoder step actually seen, a clipped command, and whether another
sign, scale or time offset of the command explains the motion much better. The last is judged by the
one-step prediction of the nominal device, whose error falls by the factor that is reported.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagnosis.experiment import Experiment
from diagnosis.predictor import SETTLING, innovations, observer_for
from sim.device import Device

Floats = NDArray[np.float64]
BETTER = 1.5  # factor of the rms error that makes another sign or scale a fault
SCALES = tuple(float(s) for s in np.geomspace(1e-3, 1e3, 49))
OFFSETS = range(-5, 6)
REPEATS = 0.02
CLIPPED = 0.005


@dataclass(frozen=True)
class Fault:
    """Something about the recording. kind: a word; blocking: the diagnosis stops at it."""

    kind: str
    sentence: str
    blocking: bool
    value: float


def examine(device: Device, experiments: Sequence[Experiment]) -> list[Fault]:
    """Return what is odd about recordings, blocking faults first."""
    faults: list[Fault] = []
    for e in experiments:
        faults += _command_faults(device, e) + _output_faults(e)
    return sorted(faults, key=lambda f: not f.blocking)


def _command_faults(device: Device, e: Experiment) -> list[Fault]:
    found: list[Fault] = []
    peak = np.abs(e.command).max()
    share = float(np.mean(np.abs(e.command) > (1.0 - 1e-9) * peak))
    if share > CLIPPED and np.unique(np.abs(e.command)).size > 20:
        found.append(
            Fault(
                "clipped_command",
                f"{100.0 * share:.1f} % of the command of {e.name} stands at +-{peak:.4g}: it was"
                " clipped before it was recorded",
                False,
                peak,
            )
        )
    scaled = _best_scale(device, e)
    if scaled is not None:
        found.append(scaled)
    return found


def _best_scale(device: Device, e: Experiment) -> Fault | None:
    """Compare prediction errors over signs and scales of the command, and over shifts in time.

    To first order the prediction is linear in the command: e = a - s b, with a the error without
    any command and b the command's own part, so the best s is a regression.
    """
    gain = observer_for(device.without_physics() if device.physics else device, e, 1e-2)

    def error(command: Floats) -> Floats:
        moved = Experiment(e.period, command, e.measured, e.outputs, e.name)
        return innovations(device, moved, gain)[SETTLING:-SETTLING].ravel()

    with np.errstate(all="ignore"):
        none, own = error(np.zeros_like(e.command)), error(e.command)
    part = none - own
    if not np.all(np.isfinite(part)) or not part @ part > 0.0:
        return None
    scale = float(none @ part / (part @ part))
    before = float(np.sqrt(np.mean(own**2)))
    after = float(np.sqrt(np.mean((none - scale * part) ** 2)))
    explained = 1.0 - (after / float(np.sqrt(np.mean(none**2)))) ** 2
    if explained > 0.2 and before > BETTER * after and not 0.67 < scale < 1.5:
        return Fault(
            "command_sign" if scale < 0.0 else "command_scale",
            f"the command of {e.name} explains the motion {before / after:.3g} times better scaled"
            f" by {scale:.3g}: check its sign and unit",
            True,
            scale,
        )
    return None


def _output_faults(e: Experiment) -> list[Fault]:
    found: list[Fault] = []
    for o, output in enumerate(e.outputs):
        y = e.measured[:, o]
        step = encoder_step_seen(y)
        repeats = float(np.mean(np.diff(y) == 0.0))
        if step is not None:
            found.append(
                Fault(
                    "encoder_step",
                    f"{output.name} of {e.name} comes in steps of {step:.4g}",
                    False,
                    step,
                )
            )
        elif repeats > REPEATS:
            found.append(
                Fault(
                    "repeated_samples",
                    f"{100.0 * repeats:.1f} % of the samples of {output.name} of {e.name} repeat"
                    " the one before",
                    False,
                    repeats,
                )
            )
    return found


def encoder_step_seen(y: Floats) -> float | None:
    """Return the step of which all values are multiples (up to an offset), None for none.

    The smallest difference between distinct values is a multiple of the step; it is the step if all
    differences are whole multiples of it.
    """
    levels = np.unique(y)
    if levels.size > 0.5 * y.size or levels.size < 3:
        return None
    gaps = np.diff(levels)
    smallest = gaps.min()
    near = gaps[gaps < 1.5 * smallest]
    step = float(near.mean())
    counts = (levels - levels[0]) / step
    wrong = np.abs(counts - np.round(counts)).max()
    return step if wrong < 0.1 else None
