"""From slow to fast: a recording at a slower rate, in which what moves a machine shows.

Friction, gravity, play and limits move a machine over times in which a lag, a delay, a filter or a
late clock are nothing, and a sample at a fifth of the rate costs a fifth. So a search begins slow,
and what it finds is gone on with at the rate that was recorded (`search.search`, `begun`).

At n times the period a command is what it was in the mean of n ticks, since a force that is held
for a tick moves a mass by its impulse, and so are forces that were recorded; readings are those at
the beginnings of these ticks, so that nothing has to be known of them. What a command does within n
ticks is lost: what clips or steps it is judged at the recorded rate only.

Limits: readings are not filtered, so motion beyond half of the slow rate is folded. A model of the
right masses and springs folds it likewise, since it is sampled as they are; what it lacks there
looks slow, and is refused at the recorded rate.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.settings import SCALES
from zwidth.sim.device import Device

Floats = NDArray[np.float64]


def slower(device: Device, experiments: Sequence[Experiment]) -> tuple[Device, list[Experiment]]:
    """Return device and recordings at the slow rate; as they are where none is slow enough.

    Recordings keep `least_ticks` together, and the fastest mode of the device half a period a tick.
    What goes by single ticks stays at its rate: loops of a drive, values that are given by tick.
    """
    period = experiments[0].period
    ticks = sum(e.ticks for e in experiments)
    most = min(SCALES.slower, ticks // SCALES.least_ticks)
    fastest = _fastest(device)
    if fastest > 0.0:
        most = min(most, math.floor(0.5 / (fastest * period)))
    if most < 2 or not all(_may(device, e) for e in experiments):
        return device, list(experiments)
    slow = device.with_interface(period=most * period, command_hold="zero_order")
    smooth = device.interface.command_hold == "smooth"
    return slow, [at_rate(e, most, smooth) for e in experiments]


def at_rate(e: Experiment, n: int, smooth: bool = False) -> Experiment:
    """Return a recording at n times its period. smooth: whether its command is no staircase."""
    ticks = e.ticks // n * n
    command = e.command
    if smooth:
        command = 0.5 * (command + np.append(command[1:], command[-1]))

    def mean(values: Floats | None) -> Floats | None:
        if values is None:
            return None
        return values[:ticks].reshape(ticks // n, n, *values.shape[1:]).mean(axis=1)

    averaged = mean(command)
    assert averaged is not None
    before = e.before
    if before is not None:  # so that it ends where this begins
        before = at_rate(before.part(before.ticks % n, before.ticks), n, smooth)
    return replace(
        e,
        period=n * e.period,
        command=averaged,
        measured=np.ascontiguousarray(e.measured[:ticks:n]),
        sensor_error=None if e.sensor_error is None else e.sensor_error[:ticks:n].copy(),
        force=mean(e.force),
        base=mean(e.base),
        pushes=mean(e.pushes),
        strengths=mean(e.strengths),
        covariates=tuple(replace(c, values=c.values[:ticks:n].copy()) for c in e.covariates),
        before=before,
        start=None,
    )


def _may(device: Device, e: Experiment) -> bool:
    """Whether nothing of device and recording goes by single ticks."""
    interface = device.interface
    by_tick = (
        e.dropped is not None
        or e.pushed is not None
        or bool(e.differenced)
        or interface.velocity_ticks != 1
        or interface.position_ticks != 1
        or bool(interface.force_sensor)
        or math.isfinite(interface.velocity_cutoff_hz)
        or any(p.effect.of_drive or p.effect.hook == "clock" for p in device.physics)
    )
    return not by_tick


def _fastest(device: Device) -> float:
    """The frequency [Hz] of the fastest mode of a device."""
    return float(np.abs(np.linalg.eigvals(device.bare().plant().a).imag).max()) / (2.0 * math.pi)
