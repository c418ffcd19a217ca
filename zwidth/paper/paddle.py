"""A measured boundary on another device: a haptic paddle, by theory and in the time domain."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from zwidth.figures.paddle import Simulated, paddle_figure
from zwidth.paper.content import Picture, Section, Table
from zwidth.scenarios.paddle import DEVICE, paddle_boundary
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.stability.bisection import Search, find_brackets
from zwidth.stability.judging import Trial
from zwidth.stability.linear import boundary, last_stable_damping

Floats = NDArray[np.float64]
STARTS = (0.005, 0.01, 0.1)
START = 0.01
FILTER_HZ = 5.0
SENSOR_STEP = 1e-3
GRID = 41
SUBSTEPS = 10
COMMAND = (
    "zwidth boundary ethz_haptic_paddle --start 0.01 --damping 0 0.013 0.026 0.039 0.052 0.065 0.08"
)
OWN = "zwidth paper --section paddle"


def section() -> Section:
    """Return measurement, linear theory and time domain, and their differences."""
    device = load_device(DEVICE)
    measured = paddle_boundary()
    at = np.array([p.damping for p in measured])
    stiffness = np.array([p.stiffness for p in measured])
    fine = np.linspace(0.0, 1.1 * float(at[-1]), GRID)
    delay = implied_delay(device, float(at[-1]))
    late = device.with_interface(delay=delay)
    simulated = [
        Simulated(f"with friction, start {1e3 * start:g} mrad", fine, _middles(device, fine, start))
        for start in STARTS
    ]
    tried = [
        _middles(other, at, START)
        for other in (
            device,
            late,
            device.with_interface(velocity_cutoff_hz=FILTER_HZ),
            device.with_interface(encoder_step=SENSOR_STEP),
        )
    ]
    columns = [at, stiffness, _linear(device, at), *tried]
    figure = paddle_figure(
        at,
        stiffness,
        fine,
        [
            ("linear, delay 5 ms", _linear(device, fine)),
            (f"linear, delay {1e3 * delay:.1f} ms", _linear(late, fine)),
        ],
        simulated,
    )
    return Section(
        "A measured boundary on another device: a haptic paddle",
        (
            "One rigid lever, sampled at 200 Hz, with dry friction: the paper's question on"
            " another device, with nothing fitted to it. Inertia, weight and stiction are its"
            " builders'; the motor's viscous friction (2.4e-4 N m s/rad; twice as much moves K by"
            " 0.03) is yet to be verified, and the delay of one period is an assumption.",
            Picture(
                "paddle", figure,
                "Boundary of the paddle: measured (points), linear theory without friction (grey),"
                " and the time domain with friction, weight and sensor step from starts of"
                " different size (solid).", COMMAND,
            ),
            Table(
                "K at the measured dampings [N m/rad]. Time domain from 10 mrad: the device as it"
                f" is, then with {1e3 * delay:.1f} ms of delay, with its velocity filtered at"
                f" {FILTER_HZ:g} Hz, with a sensor step of {1e3 * SENSOR_STEP:g} mrad.",
                ["B", "measured", "linear", "time domain", "later", "filtered", "coarser"],
                [[f"{value:.3g}" for value in row] for row in zip(*columns, strict=True)],
                OWN, (),
            ),
            _verdict(device, columns, delay),
        ),
    )  # fmt: skip


def _linear(device: Device, dampings: Floats) -> Floats:
    """K of linear theory, 0 where no K is stable."""
    return np.array([point.stiffness or 0.0 for point in boundary(device, dampings)])


def _middles(device: Device, dampings: Floats, start: float) -> Floats:
    """Middle of each bracket of K in the time domain, nan where no K is stable."""
    trial = Trial(start=start, substeps=SUBSTEPS, limit_s=16.0)
    (brackets,) = find_brackets([device], [dampings], trial, Search(tolerance=5e-3))
    return np.array(
        [
            np.nan if b.stable is None or b.unstable is None else 0.5 * (b.stable + b.unstable)
            for b in brackets
        ]
    )


def implied_delay(device: Device, last: float) -> float:
    """Return the delay [s] at which the linear loop ends at a last stable damping."""

    def excess(delay: float) -> float:
        return (last_stable_damping(device.with_interface(delay=delay)) or 0.0) - last

    period = device.interface.period
    return float(brentq(excess, period, 4.0 * period, xtol=1e-6))  # pyright: ignore[reportArgumentType]


def _verdict(device: Device, columns: list[Floats], delay: float) -> str:
    at, measured, linear, plain, late, filtered, coarse = columns
    beyond = [float(values[-2]) for values in (plain, late, filtered, coarse)]
    jump = float(at[-1]) / device.interface.period * SENSOR_STEP
    return (
        "Dry friction explains the left end: at B = 0 linear theory allows"
        f" {linear[0]:.2f} N m/rad, the time domain with the builders' stiction {plain[0]:.2f}"
        " from a start of 10 mrad,"
        f" {measured[0]:g} are measured; a smaller start allows more. It does not explain the right"
        " end: measured K falls from B = 0.013 on and is zero at 0.08, while every variant of the"
        f" loop that was tried ({1e3 * (delay - device.interface.delay):.1f} ms later, a filtered"
        f" velocity, a coarser sensor) still allows {min(beyond):.1f} to {max(beyond):.1f} at"
        " 0.065. These runs do not count the sensor's noise, which a hand feels through the damper:"
        f" at"
        f" B = 0.08 a jump of {1e3 * SENSOR_STEP:g} mrad between two samples commands"
        f" {1e3 * jump:.0f} mN m, as much as the friction that would hold the lever still. Which"
        " criterion the builders used is not on record."
    )
