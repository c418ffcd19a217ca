"""The share of the drive's force that acted in a recording: supply voltage, on or off."""

import numpy as np
from numpy.typing import NDArray

from zwidth.logs.drive_state import ENABLE, SUPPLY
from zwidth.sim.device import Device
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
ON = 0.5


def strengths_of(trace: Trace, device: Device, name: str) -> tuple[Floats | None, tuple[str, ...]]:
    """Return the strength (ticks,) of the drive, None if it is not recorded, and a note.

    It is the supply over its nominal voltage, and zero while the drive was off. Raises ValueError
    if the drive was never on, a supply is not positive, or a position servo has no limit to scale.
    """
    known = [c for c in (ENABLE, SUPPLY) if c in trace.channels]
    if not known:
        return None, ()
    on = trace[ENABLE] >= ON if ENABLE in known else np.ones(len(trace), dtype=np.bool_)
    supply = trace[SUPPLY] if SUPPLY in known else np.ones(len(trace))
    if not on.any():
        raise ValueError(
            f"[enable] of {name} is never {ON:g} or more, so its drive was never on; correct"
            " the signal or its scale, or leave [input] out for a free motion"
        )
    if not np.all(supply[on] > 0.0):
        raise ValueError(
            f"[supply] of {name} is {supply[on].min():g} of its nominal voltage at least once while"
            " the drive is on; it must be above 0 there"
        )
    strengths = np.where(on, supply, 0.0)
    if np.all(strengths == 1.0):
        return None, ()
    looped = {p.effect.name for p in device.physics}
    if "position_servo" in looped and "servo_limit" not in looped:
        raise ValueError(
            f"{name} has [enable] or [supply], but the drive of the device file has no limit that"
            " they could scale; give [drive] a limit"
        )
    off = int(np.count_nonzero(~on))
    said = f"the drive of {name} is off in {off} of {len(trace)} samples, and gives no force there"
    return strengths, (said,) if off else ()
