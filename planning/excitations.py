"""A library of excitations, as strong as the device allows, saved as scenario files to play.

`zwidth simulate` plays such a file; a rig plays the commands beside it (NAME.npy, one per tick).
The strength is limited by the largest command (level) and by the largest travel of the simulated
device, whichever is reached first. Slow signals on a device without a spring are limited by the
travel; with friction that is not in the device file a real device travels less.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zwidth.controllers.excitation import chirp, multisine, noise, random_steps, triangle
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.files.whole import write_bytes, write_text
from zwidth.scenarios.scenario import Scenario, usual_substeps
from zwidth.scenarios.scenario_file import scenario_to_text
from zwidth.sim.device import Device
from zwidth.sim.nearest import nearest
from zwidth.sim.run import simulate

Floats = NDArray[np.float64]
Signal = Callable[[float, float, int], Floats]  # duration [s], period [s], seed

FROM_HZ, TO = 0.7, 0.3  # lowest frequency; highest, over the sampling frequency
SMALL = 0.1  # strength of a small signal over that of a large one
MARGIN = 0.9  # share of the command limit that is used
ROTARY_TRAVEL, LINEAR_TRAVEL = 1.0, 0.1  # [rad], [m], if nothing else is known
CYCLE_S, HOLD_S, CHIRP_FROM_HZ = 4.0, 0.05, 4.0
HALVINGS = 12
WIDER = 1.5  # allowed travel over the recorded travel


@dataclass(frozen=True)
class Scale:
    """How strong an excitation may be: largest |command| [N m | N], |position of m1| [rad | m]."""

    level: float
    travel: float

    def __post_init__(self) -> None:
        for name, value in (("level", self.level), ("travel", self.travel)):
            if not 0.0 < value < np.inf:
                raise ValueError(f"{name} is {value:g}; it must be finite and > 0")


class NoExcitation(ValueError):
    """The time is too short for the frequency band of an excitation."""


def scale_for(
    device: Device,
    experiments: Sequence[Experiment] = (),
    level: float | None = None,
    travel: float | None = None,
) -> Scale:
    """Return how strong excitations may be: as given, else by recordings, else by the device.

    Without a recording the travel is 1 rad or 0.1 m. Without a driven recording the level is 90 %
    of the command limit or, if there is no limit, the level at which white noise has this travel.
    """
    if travel is None:
        recordings = [
            0.5 * WIDER * float(np.ptp(e.measured[:, 0]))
            for e in experiments
            if e.outputs[0].quantity == "position"
        ]
        usual = ROTARY_TRAVEL if device.rotary else LINEAR_TRAVEL
        travel = max(recordings, default=usual)
    if level is None:
        limit = device.interface.command_limit
        driven = [float(np.abs(e.command).max()) for e in experiments if np.ptp(e.command) > 0.0]
        level = min(max(driven, default=MARGIN * limit), MARGIN * limit)
    if not np.isfinite(level):
        unit = _unit(white_noise(10.0, device.interface.period, 0))
        level = travel / travelled(device.bare(), unit)
    return Scale(level, travel)


def excitation(name: str, device: Device, seconds: float, scale: Scale, seed: int = 0) -> Floats:
    """Return the command (ticks,) of an excitation of the library on a device.

    Raises ValueError for an unknown name (with the nearest one), NoExcitation for too short a time.
    """
    if name not in LIBRARY:
        raise ValueError(f"there is no excitation {name!r}; {nearest(name, LIBRARY)}")
    parts = LIBRARY[name]
    commands: list[Floats] = []
    period = device.interface.period
    for place, (share, part) in enumerate(parts):
        duration = seconds / len(parts)
        try:
            unit = _unit(part(duration, period, seed + place))
        except ValueError as error:
            raise NoExcitation(f"{name} cannot be played in {seconds:g} s: {error}") from error
        commands.append(share * bearable(device, unit, scale) * unit)
    return np.concatenate(commands)


def bearable(device: Device, unit: Floats, scale: Scale) -> float:
    """Return the largest strength of a signal within the level and the travel of the scale.

    Computed by scaling for a linear device, by bisection for one with friction, play, stops or
    other effects.
    """
    if not device.physics:
        return min(scale.level, scale.travel / travelled(device, unit))
    low, high = 0.0, scale.level
    if travelled(device, high * unit) <= scale.travel:
        return high
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if travelled(device, middle * unit) <= scale.travel:
            low = middle
        else:
            high = middle
    return low if low > 0.0 else high


def travelled(device: Device, command: Floats) -> float:
    """Return the largest |position of m1| under a command, from rest, without limit or steps."""
    free = device.with_interface(command_limit=np.inf, command_step=0.0, encoder_step=0.0)
    run = simulate(
        free,
        recorded(command),
        duration=command.size * device.interface.period,
        substeps=usual_substeps(device),
    )
    return float(np.abs(run.trace["position_m1"]).max())


def _unit(signal: Floats) -> Floats:
    return signal / float(np.abs(signal).max())


def white_noise(duration: float, period: float, seed: int) -> Floats:
    """Return Gaussian noise, white from 0.7 Hz to 0.3 of the sampling frequency."""
    return noise(1.0, _lowest(duration), TO / period, duration, period, seed)


def full_multisine(duration: float, period: float, seed: int) -> Floats:
    """Return a multisine of random phases over the same band."""
    return multisine(1.0, _lowest(duration), TO / period, duration, period, seed)


def rising_chirp(duration: float, period: float, seed: int) -> Floats:
    """Return one sweep up to the same frequency, from 4 Hz, so that a free mass travels little."""
    return chirp(1.0, max(CHIRP_FROM_HZ, _lowest(duration)), TO / period, duration, period)


def slow_triangle(duration: float, period: float, seed: int) -> Floats:
    """Return triangles of four seconds each, or two if the time is shorter than two of these."""
    return triangle(1.0, min(CYCLE_S, 0.5 * duration), duration, period)


def steps(duration: float, period: float, seed: int) -> Floats:
    """Return steps of random size, each as + - - + of equal lengths: a free mass returns."""
    hold = max(1, round(HOLD_S / period))
    sizes = random_steps(1.0, 4 * hold * period, duration, period, seed)
    turns = np.tile(np.repeat([1.0, -1.0, -1.0, 1.0], hold), -(-sizes.size // (4 * hold)))
    return sizes * turns[: sizes.size]


def _lowest(duration: float) -> float:
    return max(FROM_HZ, 2.0 / duration)


# Each twice, so that both the fitted and the judged part of a recording contain every kind of
# motion.
SESSION: tuple[tuple[float, Signal], ...] = (
    (SMALL, full_multisine),
    (1.0, full_multisine),
    (1.0, slow_triangle),
    (1.0, steps),
)
# name -> consecutive parts of equal length: (share of the strength, signal)
LIBRARY: Mapping[str, tuple[tuple[float, Signal], ...]] = {
    "small_multisine": ((SMALL, full_multisine),),
    "large_multisine": ((1.0, full_multisine),),
    "two_level_multisine": ((2.0 * SMALL, full_multisine), (1.0, full_multisine)) * 2,
    "slow_triangle": ((1.0, slow_triangle),),
    "random_steps": ((1.0, steps),),
    "white_noise": ((1.0, white_noise),),
    "chirp": ((1.0, rising_chirp),),
    "standard_session": SESSION * 2,
}


def save_scenario(device: Device, command: Floats, path: Path) -> Path:
    """Write an excitation as PATH (a scenario TOML) and the commands beside it; returns PATH."""
    array = path.with_suffix(".npy").name
    duration = command.size * device.interface.period
    scenario = Scenario(device, recorded(command), duration, energy="none")
    buffer = BytesIO()
    np.save(buffer, command)
    write_bytes(path.with_name(array), buffer.getvalue())
    return write_text(path, scenario_to_text(scenario, array=array))
