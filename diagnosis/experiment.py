"""A recording as the diagnosis sees it: one command in, one or more measured motions out."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sim.device import Device
from sim.predict import Outputs
from sim.trace import Trace

Floats = NDArray[np.float64]
OUTPUT = re.compile(r"(position|velocity)_m([1-4])$")
SHORTEST = 200


class ExperimentError(ValueError):
    """A recording that cannot be diagnosed; the sentence says what to record instead."""


@dataclass(frozen=True)
class Output:
    """A measured channel: quantity ("position" or "velocity") of a mass, counted from 0."""

    quantity: str
    mass: int

    @property
    def name(self) -> str:
        """Channel name in a trace."""
        return f"{self.quantity}_m{self.mass + 1}"


@dataclass(frozen=True)
class Experiment:
    """command (ticks,) and measured (ticks, o) at one period [s], SI; outputs say what o are.

    swing: rms of the first output about its mean, in the whole recording. What was found out about
    the recording itself: sensor_error (ticks,) is what its steps add to the first output, dropped
    (ticks,) are the commands that were not delivered; both count where a model has that effect.
    start: what to add to positions and velocities (2n,) that the observer begins with. force
    (ticks, n): a force of unknown cause on the masses, to see what it would explain.
    """

    period: float
    command: Floats
    measured: Floats
    outputs: tuple[Output, ...]
    name: str = "recording"
    swing: float = 1.0
    sensor_error: Floats | None = None
    dropped: NDArray[np.bool_] | None = None
    start: Floats | None = None
    force: Floats | None = None

    @property
    def ticks(self) -> int:
        """Number of samples."""
        return self.command.size

    def places(self, dof: int) -> Outputs:
        """Return where the outputs stand in a state of that many masses."""
        state = [o.mass + (dof if o.quantity == "velocity" else 0) for o in self.outputs]
        sensed = [o.quantity == "position" and o.mass == 0 for o in self.outputs]
        return Outputs(np.array(state, dtype=np.int64), np.array(sensed))

    def part(self, start: int, stop: int) -> "Experiment":
        """Return the samples start <= k < stop."""
        cut = slice(start, stop)
        return replace(
            self,
            command=self.command[cut],
            measured=self.measured[cut],
            sensor_error=None if self.sensor_error is None else self.sensor_error[cut],
            dropped=None if self.dropped is None else self.dropped[cut],
            start=self.start if start == 0 else None,
            force=None if self.force is None else self.force[cut],
        )

    def split(self, share: float = 0.7) -> "tuple[Experiment, Experiment]":
        """Return the first share to fit on, and the rest to judge by."""
        cut = round(share * self.ticks)
        return self.part(0, cut), self.part(cut, self.ticks)


def experiment(trace: Trace, device: Device, name: str = "recording") -> Experiment:
    """Take command and measured motions from a trace.

    Raises ExperimentError where there is no command, no position or velocity of a mass of the
    device, too little of it, or a constant or non-finite channel; periods that differ by more than
    one percent, and motions along a line of a device that turns or the other way round, are refused
    with what to change.
    """
    period, masses = device.interface.period, device.chain.masses.size
    if "command" not in trace.channels:
        raise ExperimentError(
            f"the recording has no channel 'command' (it has {', '.join(trace.channels)}); name the"
            " input in the recording's TOML"
        )
    found: list[Output] = []
    for channel in trace.channels:
        match = OUTPUT.match(channel)
        if match and int(match[2]) <= masses:
            found.append(Output(match[1], int(match[2]) - 1))
    if trace.origin == "simulated":  # a log holds every state; a device is seen at its encoder
        found = [o for o in found if o.name == "position_m1"]
    if not found:
        raise ExperimentError(
            f"the recording has no position or velocity of a mass of the device (it has"
            f" {', '.join(trace.channels)}); name the outputs in the recording's TOML"
        )
    kind, unit = ("rotary", "rad") if device.rotary else ("linear", "m")
    for o in found:
        if trace.units[o.name].split("/")[0] not in (unit, ""):
            raise ExperimentError(
                f"channel {o.name!r} is in {trace.units[o.name]!r}, but the device is {kind} and"
                f" moves by {unit!r}; correct the unit in the recording's TOML or 'rotary' in the"
                " device file"
            )
    if len(trace) < SHORTEST:
        raise ExperimentError(
            f"the recording has {len(trace)} samples; at least {SHORTEST} are needed, 10 s are good"
        )
    own = float(np.median(np.diff(trace.t)))
    if not math.isclose(own, period, rel_tol=0.01):
        raise ExperimentError(
            f"the recording's period is {own:g} s, the device's {period:g} s; set period_s in the"
            " device's [interface] to the recording's, or resample the recording"
        )
    measured = np.column_stack([trace[o.name] for o in found])
    channels = [("command", trace["command"])]
    channels += [(o.name, trace[o.name]) for o in found]
    _refuse(channels)
    command = np.ascontiguousarray(trace["command"])
    swing = float(np.std(measured[:, 0]))
    return Experiment(own, command, measured, tuple(found), name, swing)


def _refuse(channels: Sequence[tuple[str, Floats]]) -> None:
    for name, values in channels:
        bad = int(np.count_nonzero(~np.isfinite(values)))
        if bad:
            raise ExperimentError(
                f"channel {name!r} has {bad} values that are not finite; cut them out with [use]"
            )
        if np.ptp(values) == 0.0:
            raise ExperimentError(
                f"channel {name!r} is constant at {values[0]:g}; record while the device is driven"
            )
