"""The exact one-tick closed loop of a device and a two-sided wall.

With a delay of d T + r, the command of tick k - d - 1 acts over [kT, kT + r) and that of tick k - d
over [kT + r, (k + 1) T), so that

    x_{k+1} = Phi(T) x_k + Gamma(T - r) u_{k-d} + Phi(T - r) Gamma(r) u_{k-d-1}
    u_k = -(K y_k + B v_k),   v_k = (1 - a) v_{k-1} + a (y_k - y_{k-1}) / T

State s = [x; u_{k-1} .. u_{k-D}; y_{k-1}; v_{k-1} where filtered; its slope where that is of second
order], D = d or, with r > 0, d + 1. With another linear estimator of velocity, its memory replaces
y_{k-1} and its estimate replaces the difference. Command, reading and velocity enter as single
vectors, so K and B are both rank-one changes:

    s_{k+1} = (A - b (K c_y + B c_v)) s_k

Linear parts only: steps, limits, friction and other forces without slope at rest are left out.
"""

import re
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.device import Device
from zwidth.sim.estimators import Linear
from zwidth.sim.force_sensor import force_row
from zwidth.sim.interface import Interface
from zwidth.sim.plant import hold

if TYPE_CHECKING:
    from control import StateSpace

Floats = NDArray[np.float64]
MOST_TICKS = 400  # of delay; the eigenproblem of the boundary then takes 20 s


class Loop(NamedTuple):
    """s' = transition s + entry u, y = reading s, v = velocity s, over one period T [s].

    transition (M, M), the rest (M,). shift is the state of the device at rest at position 1, zero
    if a spring to ground prevents this.
    """

    transition: Floats
    entry: Floats
    reading: Floats
    velocity: Floats
    shift: Floats
    period: float

    def damped(self, damping: float) -> Floats:
        """Return the loop of the virtual damper alone, A0 = A - B b c_v, shape (M, M)."""
        return self.transition - damping * np.outer(self.entry, self.velocity)

    def closed(self, stiffness: float, damping: float) -> Floats:
        """Return the loop of spring and damper, A0 - K b c_y, shape (M, M)."""
        return self.damped(damping) - stiffness * np.outer(self.entry, self.reading)

    @property
    def free(self) -> bool:
        """Whether only damping holds the device."""
        return bool(self.shift.any())

    def without_drift(self) -> "Loop":
        """Return the loop of a free device at K = 0 without its eigenvalue 1, shape M - 1.

        If all positions, including the stored reading, are measured from q_1, their equations do
        not contain q_1, so dropping it removes the eigenvalue exactly.
        """
        size = self.shift.size
        relative, absolute = np.eye(size), np.eye(size)
        relative[1:, 0], absolute[1:, 0] = -self.shift[1:], self.shift[1:]
        return Loop(
            (relative @ self.transition @ absolute)[1:, 1:],
            (relative @ self.entry)[1:],
            np.zeros(size - 1),
            (self.velocity @ absolute)[1:],
            np.zeros(size - 1),
            self.period,
        )


def open_loop(device: Device) -> Loop:
    """Return the one-tick equations of a device, with command and readings not yet connected.

    Raises ValueError for a delay of more than `MOST_TICKS` periods, several rates, or an estimator
    of velocity that is not linear.
    """
    plant = device.plant()
    period = device.interface.period
    whole, remainder = device.interface.delay_ticks
    if whole > MOST_TICKS:
        raise ValueError(
            f"interface.delay is {whole:.6g} periods; linear theory takes at most {MOST_TICKS}:"
            " shorten delay_s or lengthen period_s"
        )
    if device.interface.multirate:
        raise ValueError(
            "velocity_ticks or position_ticks is more than 1, but this theory takes only one rate:"
            " use `stability.periodic`, or set both to 1"
        )
    late, newer = hold(plant, period - remainder)
    transition, older = late, None
    if remainder > 0.0:
        transition = hold(plant, period)[0]
        older = late @ hold(plant, remainder)[1][:, 0]
    gain = device.interface.command_gain
    newer, older = gain * newer[:, 0], None if older is None else gain * older
    read = int(device.reading().reads[0, 0])
    estimator = linear_estimator(device.interface)
    loop = wired(
        transition, newer, older, whole, period, device.interface.velocity_filter, read, estimator
    )
    if device.interface.force_gain > 0.0:
        loop = _fed_back(device, plant.dof, loop)
    shift = loop.shift
    grounded = plant.matrices.stiffness
    if np.all(np.abs(grounded.sum(axis=1)) <= 1e-14 * np.diag(grounded)):
        shift[: plant.dof] = 1.0
        first = plant.size + whole + (remainder > 0.0)
        shift[first : first + estimator.rest.size] = estimator.rest
    return loop


def linear_estimator(interface: Interface) -> Linear:
    """Return the equations of the velocity estimator; raises ValueError if it has none."""
    estimator = interface.estimator
    if estimator.linear is None:
        raise ValueError(
            f"velocity_estimator is {estimator.name!r}, whose gain depends on the motion, so linear"
            " theory does not apply: use difference, kalman or kalman_acceleration, or look at"
            " simulated runs"
        )
    return estimator.linear(interface.estimator_settings)


def sampled_system(device: Device) -> "StateSpace":
    """Return the open loop as an object of python-control; see `Boundary.to_control`."""
    try:
        import control
    except ImportError as error:
        raise ImportError(
            "to_control needs python-control; install it with 'pip install control'"
        ) from error
    loop = open_loop(device)
    return control.StateSpace(
        loop.transition, loop.entry[:, None], np.vstack([loop.reading, loop.velocity]),
        np.zeros((2, 1)), loop.period, inputs=["force"], outputs=["position", "velocity"],
        name=re.sub(r"\W+", "_", device.name),
    )  # fmt: skip


def _fed_back(device: Device, dof: int, loop: Loop) -> Loop:
    """Close the loop of the force sensor: u = (1 + G) w - G F, F a row on the device's state."""
    gain = device.interface.force_gain
    row = np.zeros(loop.entry.size)
    row[: 2 * dof] = force_row(device.chain, device.interface, dof)
    return loop._replace(
        transition=loop.transition - gain * np.outer(loop.entry, row),
        entry=(1.0 + gain) * loop.entry,
    )


def wired(
    transition: Floats, newer: Floats, older: Floats | None, whole: int, period: float,
    weights: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0), read: int = 0,
    estimator: Linear | None = None,
) -> Loop:  # fmt: skip
    """Return the loop around a device whose position is the state `read`; shift is zero.

    transition (n, n) over a period; newer, older (n,): contributions of the commands that are
    `whole` and whole + 1 ticks old, older None without remainder. weights: of the velocity filter
    (`Interface.velocity_filter`), after the estimator (None: the backward difference).
    """
    if estimator is None:
        estimator = linear_estimator(Interface())
    n, depth = transition.shape[0], whole + (older is not None)
    first, v = n + depth, n + depth + estimator.rest.size
    kept_there = slice(first, v)
    straight, from_slope, to_slope, kept = weights
    second = from_slope != 0.0
    filtered = second or straight < 1.0
    size = v + filtered + second
    a = np.zeros((size, size))
    b, reading, velocity, shift = np.zeros((4, size))
    a[:n, :n] = transition
    for i in range(1, depth):
        a[n + i, n + i - 1] = 1.0
    if depth > 0:
        b[n] = 1.0
    if whole == 0:
        b[:n] = newer
    else:
        a[:n, n + whole - 1] = newer
    if older is not None:
        a[:n, n + whole] = older
    reading[read] = 1.0
    a[kept_there, kept_there] = estimator.keep
    a[kept_there, read] = estimator.take
    velocity[read] = straight * estimator.through / period
    velocity[kept_there] = straight * estimator.out / period
    if filtered:
        velocity[v] = 1.0 - straight
        if second:
            velocity[v + 1] = from_slope
            a[v + 1, read] = to_slope * estimator.through / period
            a[v + 1, kept_there] = to_slope * estimator.out / period
            a[v + 1, v], a[v + 1, v + 1] = -to_slope, kept
        a[v] = velocity
    return Loop(a, b, reading, velocity, shift, period)
