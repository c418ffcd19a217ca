"""Default length and noise of a plan."""

from zwidth.diagnosis.recording.experiment import SHORTEST
from zwidth.planning.excitations import Scale
from zwidth.planning.rehearsal import Noise
from zwidth.sim.device import Device

PROCESS = 0.002  # default process noise, over the largest command
LONGEST = 120_000  # ticks: a hundred signatures of this length fit into memory


def check_length(device: Device, seconds: float) -> None:
    """Raise ValueError for a recording too short to be read, or too long to be planned."""
    period = device.interface.period
    if not SHORTEST <= seconds / period <= LONGEST:
        raise ValueError(
            f"seconds is {seconds:g}; with this device's period of {period:g} s, it must be from"
            f" {SHORTEST * period:g} to {LONGEST * period:g} s"
        )


def usual_noise(
    device: Device, scale: Scale, measurement: float | None = None, process: float | None = None
) -> Noise:
    """Return the given noise, by default an encoder's rounding and 0.2 % of the largest command.

    Raises ValueError if the measurement noise is not given and the device has no encoder step.
    """
    return Noise(process or PROCESS * scale.level, _measurement(device, measurement, scale.travel))


def _measurement(device: Device, noise: float | None, travel: float) -> float:
    unit, step = "rad" if device.rotary else "m", device.interface.encoder_step
    if noise is None and step == 0.0:
        raise ValueError(
            f"{device.name} has no encoder_step, so its noise is not known; give --noise (noise= in"
            f" Python), the rms of a measured position at rest [{unit}]"
        )
    found = step / 12.0**0.5 if noise is None else noise
    if found >= 0.1 * travel:
        raise ValueError(
            f"noise is {found:g} {unit}, and m1 travels {travel:g} {unit}; give less than a tenth"
            " of the travel"
        )
    return found
