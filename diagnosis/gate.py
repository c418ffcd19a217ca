"""Is the recording itself sound? Faults of the recording are findings of their own.

A passive device takes energy from its command: where the command takes energy from the device,
its sign is wrong. Also looked at: repeated samples, the encoder step actually seen, a clipped
command, and whether another scale of the command explains the motion much better, by the one-step
prediction of the nominal device, whose error falls by the factor that is reported. A smaller scale
must also explain more than what weakens a command by itself, or a saturated amplifier would be
taken for another unit. A fault belongs to its recording: what corrects one is not applied to
another.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import savgol_filter

from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.predictor import SETTLING, innovations, observer_near
from zwidth.diagnosis.steady import NoObserver
from zwidth.sim.device import Device
from zwidth.sim.physics import EFFECTS
from zwidth.sim.physics.effect import Effect, Physics

Floats = NDArray[np.float64]
COMMAND = ("command",)
BETTER = 1.5  # factor of the rms error that makes another sign or scale a fault
POWER = 0.1
SHARES = np.geomspace(0.01, 0.9, 16)  # of the largest command (a spring: held at an end), tried
FORCE = "N m"  # unit of what holds a command back; all else that does is a spring
REPEATS = 0.02
CLIPPED = 0.005
ON_LATTICE = 0.1  # of a step, by which a value may lie beside it
FEW = 10  # neighbouring values that are one step apart


@dataclass(frozen=True)
class Fault:
    """Something about a recording. kind: a word; wrong: it makes the recording false as it is.

    value: what was seen, by kind; the factor that corrects the command where channels name it.
    recording: the name of the one that it is of, "" for all.
    """

    kind: str
    sentence: str
    wrong: bool
    value: float
    recording: str = ""
    channels: tuple[str, ...] = ()


def examine(device: Device, experiments: Sequence[Experiment]) -> list[Fault]:
    """Return what is odd about recordings, those that make it wrong first.

    Steps and repeats are those of the recordings once corrected by their own faults.
    """
    faults: list[Fault] = []
    for e in experiments:
        wrong = _misread(device, e)
        found = [Fault("recording", note, False, e.begins) for note in e.notes]
        found += _clipped(e) + wrong + _output_faults(device, corrected(e, wrong))
        faults += [replace(fault, recording=e.name) for fault in found]
    return sorted(faults, key=lambda f: not f.wrong)


def corrected(experiment: Experiment, faults: Sequence[Fault]) -> Experiment:
    """Return a recording with its channels as its own faults say."""
    for fault in faults:
        if fault.channels == COMMAND:
            experiment = replace(experiment, command=fault.value * experiment.command)
    return experiment


def _clipped(e: Experiment) -> list[Fault]:
    peak = float(np.abs(e.command).max())
    share = float(np.mean(np.abs(e.command) > (1.0 - 1e-9) * peak))
    if share <= CLIPPED or np.unique(np.abs(e.command)).size <= 20:
        return []
    sentence = (
        f"{100.0 * share:.1f} % of the command of {e.name} stands at +-{peak:.4g}: it was clipped"
        " before it was recorded"
    )
    return [Fault("clipped_command", sentence, False, peak)]


def _misread(device: Device, e: Experiment) -> list[Fault]:
    """The sign or scale of the command, if it is wrong."""
    found = _against_power(device, e) or _best_scale(device, e)
    return [] if found is None else [found]


def _against_power(device: Device, e: Experiment) -> Fault | None:
    """Mean of command times velocity, over both rms: negative for no passive device.

    Position is differenced over seven samples; the command is taken as late as the device's delay.
    """
    late = round(device.interface.delay / e.period)
    y = e.measured[:, 0]
    velocity = y
    if e.outputs[0].quantity == "position":
        velocity = np.asarray(savgol_filter(y, 7, 2, deriv=1, delta=e.period), dtype=np.float64)
    u = e.command[: e.ticks - late] if late else e.command
    v = velocity[late:]
    size = float(np.sqrt(np.mean(u**2) * np.mean(v**2)))
    share = float(np.mean(u * v)) / size if size > 0.0 else 0.0
    if share > -POWER:
        return None
    return Fault(
        "command_sign",
        f"the command of {e.name} takes energy out of the device on average (correlation"
        f" {share:.2f} with its velocity), which no passive device has to give: its sign is"
        " inverted; turn the sign of the scale of [input]",
        True,
        -1.0,
        e.name,
        COMMAND,
    )


def _best_scale(device: Device, e: Experiment) -> Fault | None:
    """Compare prediction errors over signs and scales of the command, and over shifts in time.

    To first order the prediction is linear in the command: e = a - s b, with a the error without
    any command and b the command's own part, so the best s is a regression.
    """
    try:
        gain = observer_near(device.without_physics() if device.physics else device, e, 1e-2)
    except NoObserver:  # then nothing can be compared
        return None

    def error(command: Floats) -> Floats:
        moved = replace(e, command=command)
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
        if scale > 0.0 and _weakened(device, e, gain) < after:
            return None
        return Fault(
            "command_sign" if scale < 0.0 else "command_scale",
            f"the command of {e.name} explains the motion {before / after:.3g} times better scaled"
            f" by {scale:.3g}: check its sign and unit",
            True,
            scale,
            e.name,
            COMMAND,
        )
    return None


def _weakened(device: Device, e: Experiment, gain: Floats) -> float:
    """Least rms prediction error with physics that lets a device seem driven less than it is."""
    peak = float(np.abs(e.command).max())
    travel = float(np.ptp(e.measured[:, 0])) if e.outputs[0].quantity == "position" else 0.0

    def error(share: float, effect: Effect) -> float:
        (parameter,) = effect.parameters
        size = peak if parameter.unit == FORCE else 2.0 * peak / travel
        physics = Physics(effect, effect.places[0], {parameter.name: float(share) * size})
        with np.errstate(all="ignore"), suppress(NoObserver):
            errors = innovations(device.with_physics(physics), e, gain)[SETTLING:-SETTLING]
            found = float(np.sqrt(np.mean(errors**2)))
            return found if np.isfinite(found) else np.inf
        return np.inf

    least = np.inf
    for effect in EFFECTS.values():
        known = any(p.effect.name == effect.name for p in device.physics)
        still = travel == 0.0 and any(p.unit != FORCE for p in effect.parameters)
        if not effect.weakens or known or still:
            continue
        errors = [error(share, effect) for share in SHARES]
        best = int(np.argmin(errors))
        around = SHARES[max(0, best - 1)], SHARES[min(best + 1, SHARES.size - 1)]
        finer = minimize_scalar(
            error, bounds=around, args=(effect,), method="bounded",
            options={"xatol": 0.01 * SHARES[best]},
        )  # fmt: skip
        least = min(least, errors[best], float(finer.fun))
    return least


def _output_faults(device: Device, e: Experiment) -> list[Fault]:
    found: list[Fault] = []
    length = "rad" if device.rotary else "m"
    for o, output in enumerate(e.outputs):
        y = e.measured[:, o]
        step = encoder_step_seen(y)
        repeats = float(np.mean(np.diff(y) == 0.0))
        if step is not None:
            unit = length if output.quantity == "position" else f"{length}/s"
            found.append(
                Fault(
                    "encoder_step",
                    f"{output.name} of {e.name} comes in steps of {step:.4g} {unit}",
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
    differences are whole multiples of it, and enough of them are the step itself.
    """
    levels = np.unique(y)
    if levels.size < 3:
        return None
    gaps = np.diff(levels)
    smallest = gaps.min()
    near = gaps[gaps < 1.5 * smallest]
    step = float(near.mean())
    span = float(levels[-1] - levels[0])
    step = span / max(1.0, np.round(span / step))
    counts = (levels - levels[0]) / step
    wrong = np.abs(counts - np.round(counts)).max()
    often = near.size >= min(FEW, levels.size // 2)
    return step if wrong < ON_LATTICE and often else None
