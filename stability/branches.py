"""Root loci with names, to tell which mode of the device goes unstable in the wall.

Each branch is named after its start. At K = B = 0 the eigenvalues of the one-tick loop are e^{pT}
for the poles p of the device, the eigenvalues of the velocity's estimator and filter, and 0 for
every stored command and reading. From there each eigenvalue is followed to (0, B) and on to (K, B),
in steps that are short compared with its distance to the others. If two real eigenvalues meet and
leave the axis as a pair, no step is short enough; the pair is then named after the mechanical one.
Names depend on the path: a path round a point where two branches meet exchanges their names.

The viscous force of a delayed damper turns with frequency: over the force of a true damper it is
w(z) G_h(jw) e^{-jw t_d}/(jw), G_h = (1 - e^{-jwT})/(jwT), whose angle is about -w (T + t_d). The
damper drives a mode at whose frequency this angle is near half a turn, and damps one at which it is
near a full turn: `damper_effect`.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment

from zwidth.sim.device import Device
from zwidth.sim.loop import Loop, linear_estimator, open_loop
from zwidth.stability.types import LinearPoint
from zwidth.stability.velocity import refuse_force, velocity_response

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
RIGID, DELAY, FILTER, AMPLIFIER = "rigid body", "delay", "velocity filter", "amplifier"
FIRST_STEP, SHORTEST_STEP, LONGEST_STEP = 1e-3, 1e-7, 0.05
SHORT = 0.25


@dataclass(frozen=True)
class Branches:
    """Eigenvalues z over a gain (steps,), one column per branch: z (steps, M), names (M,).

    frequency_hz and decay [1/s] (positive: it decays) are those of exp(k ln z).
    """

    names: tuple[str, ...]
    gains: Floats
    z: Complexes
    period: float

    @property
    def frequency_hz(self) -> Floats:
        """Frequency of each branch, shape (steps, M)."""
        return np.abs(np.angle(self.z)) / (2.0 * np.pi * self.period)

    @property
    def decay(self) -> Floats:
        """Rate of decay of each branch [1/s], shape (steps, M); inf at z = 0."""
        with np.errstate(divide="ignore"):
            return -np.log(np.abs(self.z)) / self.period

    def name_at(self, z: complex) -> str:
        """Return the name of the eigenvalue nearest z at the last gain; a pair shares one name."""
        last = self.z[-1]
        own = self.names[int(np.argmin(np.abs(last - z)))]
        other = self.names[int(np.argmin(np.abs(last - np.conj(z))))]
        return min(own, other, key=_rank)


def damping_locus(device: Device, dampings: Iterable[float]) -> Branches:
    """Follow all eigenvalues from B = 0 over dampings B, rising or falling, at K = 0."""
    loop = open_loop(device)
    return _locus(loop, *_start(device), _values(dampings, "damping"), lambda b: (0.0, b))


def stiffness_locus(device: Device, damping: float, stiffnesses: Iterable[float]) -> Branches:
    """Follow all eigenvalues from B = 0 to (0, B) and on over stiffnesses K."""
    loop = open_loop(device)
    names, z = _start(device)
    (b,) = _values([damping], "damping")
    z = _follow(loop, names, z, (0.0, 0.0), (0.0, b))
    return _locus(loop, names, z, _values(stiffnesses, "stiffness"), lambda k: (k, b), (0.0, b))


def critical_mode(device: Device, point: LinearPoint) -> str | None:
    """Return the name of the mode that leaves the unit circle at a boundary point, or None."""
    if point.stiffness is None or point.frequency_hz is None:
        return None
    branches = stiffness_locus(device, point.damping, [point.stiffness])
    return branches.name_at(np.exp(2j * np.pi * device.interface.period * point.frequency_hz))


def damper_effect(device: Device, frequency_hz: ArrayLike) -> Complexes:
    """Return the force of the virtual damper over that of a true one, at f > 0 [Hz].

    Real part: 1 for a true damper, negative if it drives the motion. Imaginary part: negative if it
    acts as a spring, positive if it acts as a mass.

    Raises ValueError for a frequency <= 0.
    """
    interface = device.interface
    period = interface.period
    rate = 2.0 * np.pi * np.asarray(frequency_hz, dtype=np.float64)
    if not np.all(rate > 0.0):
        raise ValueError("frequency_hz holds a value that is not > 0; give frequencies > 0 Hz")
    step = np.exp(-1j * rate * period)
    estimate = velocity_response(interface, np.exp(1j * rate * period))
    held = (1.0 - step) / (1j * rate * period)
    return estimate * held * np.exp(-1j * rate * interface.delay) / (1j * rate)


def _start(device: Device) -> tuple[tuple[str, ...], Complexes]:
    """Names and eigenvalues at K = B = 0: modes in rising |p|, first the rigid body's two."""
    refuse_force(device, "a naming by modes")
    plant, interface = device.plant(), device.interface
    whole, remainder = interface.delay_ticks
    mechanical = plant.a[: 2 * plant.dof, : 2 * plant.dof]
    poles = np.linalg.eigvals(mechanical).astype(np.complex128)
    poles = poles[np.lexsort((poles.imag, poles.real, np.round(np.abs(poles), 9)))]
    names = [RIGID if i < 2 else f"mode {i // 2}" for i in range(poles.size)]
    z = [*np.exp(poles * interface.period)]
    if plant.lag > 0.0:
        names.append(AMPLIFIER)
        z.append(np.exp(-interface.period / plant.lag))
    for _ in range(whole + (remainder > 0.0)):
        names.append(DELAY)
        z.append(0.0)
    remembered = np.linalg.eigvals(linear_estimator(interface).keep).tolist()
    names += [FILTER if abs(one) > 0.0 else DELAY for one in remembered]
    z += remembered
    straight, from_slope, to_slope, kept = interface.velocity_filter
    if interface.second_order:
        names += [FILTER, FILTER]
        z += np.linalg.eigvals([[1.0 - straight, from_slope], [-to_slope, kept]]).tolist()
    elif straight < 1.0:
        names.append(FILTER)
        z.append(1.0 - straight)
    return tuple(names), np.array(z, dtype=np.complex128)


def _rank(name: str) -> int:
    """Return 0 for a mode of the mechanism, 1 for an eigenvalue that the loop adds."""
    return int(name in (DELAY, FILTER, AMPLIFIER))


def _values(gains: Iterable[float], name: str) -> list[float]:
    values = [float(gain) for gain in gains]
    for value in values:
        if not np.isfinite(value):
            raise ValueError(f"{name} is {value}; only finite numbers are allowed")
    return values


def _locus(
    loop: Loop,
    names: tuple[str, ...],
    z: Complexes,
    gains: list[float],
    wall: Callable[[float], tuple[float, float]],
    origin: tuple[float, float] = (0.0, 0.0),
) -> Branches:
    rows: list[Complexes] = []
    for gain in gains:
        z = _follow(loop, names, z, origin, wall(gain))
        origin = wall(gain)
        rows.append(z)
    return Branches(names, np.array(gains), np.array(rows), loop.period)


def _follow(
    loop: Loop,
    names: tuple[str, ...],
    z: Complexes,
    start: tuple[float, float],
    end: tuple[float, float],
) -> Complexes:
    """Continue the eigenvalues z of the wall `start` = (K, B) along the straight line to `end`.

    New eigenvalues are paired with the extrapolated old ones so that the sum of the distances is
    least. The step is halved until the distances of all named eigenvalues are short.
    """
    foreign = np.array([[own != other for other in names] for own in names])
    known = np.array([name != DELAY for name in names])
    rate, at, step = np.zeros_like(z), 0.0, FIRST_STEP
    while at < 1.0 and start != end:
        step = min(step, 1.0 - at)
        k, b = (p + (at + step) * (q - p) for p, q in zip(start, end, strict=True))
        new = np.linalg.eigvals(loop.closed(k, b)).astype(np.complex128)
        expected = z + step * rate
        order = linear_sum_assignment(np.abs(expected[:, None] - new[None, :]))[1]
        new = new[order]
        apart = np.where(foreign, np.abs(z[:, None] - z[None, :]), np.inf).min(axis=1)
        short = bool(np.all((np.abs(new - expected) <= SHORT * apart)[known]))
        if short or step <= SHORTEST_STEP:
            rate, z, at = (new - z) / step, new, at + step
            step = min(2.0 * step, LONGEST_STEP)
        else:
            step = max(0.5 * step, SHORTEST_STEP)
    return z
