"""The frequency response of a device: encoder reading over command."""

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zwidth.figures.style import AFTER, STYLE
from zwidth.sim.device import Device
from zwidth.sim.loop import open_loop

Floats = NDArray[np.float64]
FROM_HZ, POINTS = 0.5, 1200
LINE = AFTER


def response_figure(device: Device) -> Figure:
    """Return magnitude and phase of the linear device with its delay, up to half its sampling rate.

    As the computer sees it: exact for a command that is held over each tick.
    """
    period = device.interface.period
    frequency = np.geomspace(min(FROM_HZ, 0.01 / period), 0.499 / period, POINTS)
    response = _response(device, frequency)
    force, length = ("N m", "rad") if device.rotary else ("N", "m")
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.4), layout="constrained")
        size, phase = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
        size.loglog(frequency, np.abs(response), color=LINE)
        phase.semilogx(frequency, np.degrees(np.unwrap(np.angle(response))), color=LINE)
        size.set_ylabel(f"position over command [{length}/({force})]")
        phase.set_ylabel("phase [deg]")
        phase.set_xlabel("frequency [Hz]")
        phase.xaxis.set_major_formatter("{x:g}")
        delay = f"delay {1e3 * device.interface.delay:g} ms"
        size.set_title(f"{device.name}, {delay}")
    return figure


def _response(device: Device, frequency: Floats) -> NDArray[np.complex128]:
    """Reading over command at z = exp(j 2 pi f T), (points,)."""
    loop = open_loop(device)
    z = np.exp(2j * np.pi * frequency * loop.period)
    systems = z[:, None, None] * np.eye(loop.entry.size) - loop.transition
    states = np.linalg.solve(systems, np.broadcast_to(loop.entry, systems.shape[:2])[..., None])
    return (states[..., 0] @ loop.reading).astype(np.complex128)
