"""Regression of the motion of an approximately known device on its command.

One step ahead, the prediction of a linear device is linear in its command. Let s be a scale of the
command, n the number of samples by which the command acts earlier than recorded, and d the relative
errors of masses, springs and dampers. Then

    e(s, n, d) = y + s u_n + sum_i d_i (y_i' + s u_in'),

where y are the innovations of the measurement without any command, u_n those of the command alone,
advanced by n samples (the device does not depend on time), and y' and u' their slopes. Common
forces that are in no device file are added, with their natural sign: on each mass viscous, dry and
quadratic drag, and on the first a spring and a constant force. The remainder of e, with and without
an s or an n, shows what drives the device.

Because of the product s d, the regression alternates: first s with d = 0, then s and d, with the
last s in the product s d. A regression about s = 1 would not represent a device that is off (s =
0), and a wrong mass would compensate a command that is a thousand times too large. For a rigid body
s and 1 - d are one factor; so d has a narrow prior, and s explains as much as possible.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from zwidth.diagnosis.noise.predictor import (
    SEARCHING,
    SETTLING,
    followed,
    innovations,
    observer_near,
    prepared,
)
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
LINEAR = ("masses", "link_springs", "ground_dampers", "link_dampers")
STEP = 0.2  # share of a linear parameter over which its slope is computed
LEAST, MORE = -0.5, 1.0  # share by which a linear parameter may be off
WIDTH = 0.02  # prior deviation of this share, narrow so that the scale explains more
TURNS = 0.1  # of the rms velocity: width over which dry friction changes its sign
ROUNDS = 3  # alternations of scale and shares
LOOKED_AT = 20_000  # ticks
RATIOS = (1e-4, 1e-2)  # ratios of two observers with different horizons
FOLLOWING = 1e2  # ratio of the observer for the motion, which hardly trusts the device


def unstepped(device: Device) -> Device:
    """Return a device without effects, steps and limit, on which a command acts most."""
    unlimited = {"encoder_step": 0.0, "command_step": 0.0, "command_limit": np.inf}
    return device.bare().with_interface(**unlimited)


def looked_at(e: Experiment) -> Experiment:
    """Return the part of a recording that suffices to see its response to the command."""
    return e.part(0, min(LOOKED_AT, e.ticks))


def motion(device: Device, e: Experiment) -> Floats | None:
    """Return the motion of the masses (ticks, 2n), None if not finite or without an observer."""
    # Values that overflow give no result.
    with suppress(NoObserver, np.linalg.LinAlgError, ValueError), np.errstate(all="ignore"):
        moved = followed(device, e, observer_near(device, e, FOLLOWING))
        return moved if np.all(np.isfinite(moved)) else None
    return None


def resisting(moved: Floats) -> list[Floats]:
    """Return forces (ticks, n) of unit size that resist or hold a motion (ticks, 2n)."""
    n = moved.shape[1] // 2
    found: list[Floats] = []
    for mass in range(n):
        x, v = moved[:, mass] - moved[:, mass].mean(), moved[:, n + mass]
        size = float(np.sqrt(np.mean(v**2)))
        if not size > 0.0:
            continue
        kinds = [-v, -np.tanh(v / (TURNS * size)), -v * np.abs(v)]
        kinds += [-x] if mass == 0 else []
        for kind in kinds:
            force = np.zeros((x.size, n))
            force[:, mass] = kind / max(float(np.sqrt(np.mean(kind**2))), 1e-300)
            found.append(force)
    return found


@dataclass(frozen=True)
class Left:
    """The remaining innovations: mean square, values (samples,), and the scale s."""

    square: float
    errors: Floats
    scale: float


class Answering:
    """The regression for a recording with one observer.

    resists: forces (ticks, n) with a known sign; free: forces of either sign. margin: samples by
    which a command may act earlier or later. Raises NoObserver if none is possible. Results are
    meaningless unless `usable` (all columns are finite).
    """

    def __init__(
        self, device: Device, e: Experiment, ratio: float, resists: Sequence[Floats],
        free: Sequence[Floats] = (), margin: int = 0,
    ) -> None:  # fmt: skip
        gain, ready = observer_near(device, e, ratio), prepared(e.on(device), SEARCHING)
        quiet = replace(e, command=np.zeros(e.ticks))
        silent = replace(e.unmoved(), measured=np.zeros(e.measured.shape))
        unmoved = replace(silent, command=quiet.command)
        constant = np.zeros((e.ticks, device.chain.masses.size))
        constant[:, 0] = 1.0
        with np.errstate(all="ignore"):  # not finite after an overflow
            own = innovations(device, quiet, gain, ready=ready)
            command = innovations(device, silent, gain, ready=ready)
            forces = [
                innovations(device, unmoved, gain, f, ready) for f in (constant, *free, *resists)
            ]
            slopes = [
                ((innovations(other, quiet, gain) - own) / STEP,
                 (innovations(other, silent, gain) - command) / STEP)
                for other in _off(device)
            ]  # fmt: skip
            skip = min(SETTLING, e.ticks // 5)
            self.kept = slice(skip + margin, e.ticks - margin)
            self.size = np.sqrt(np.mean(own[self.kept] ** 2, axis=0))
            every = [own, command, *forces, *(s for pair in slopes for s in pair)]
            self.usable = bool(
                all(np.all(np.isfinite(one)) for one in every) and np.all(self.size > 0.0)
            )
        self.own, self.command = own, command
        self.forces = np.stack([self.flat(f) for f in forces], axis=1)
        self.slopes = slopes
        count = len(slopes)
        self.least = np.concatenate(
            [np.full(1 + len(free), -np.inf), np.zeros(len(resists)), np.full(count, LEAST)]
        )
        self.most = np.concatenate([np.full(self.forces.shape[1], np.inf), np.full(count, MORE)])

    @property
    def samples(self) -> int:
        """Number of innovations."""
        return self.forces.shape[0]

    def left(self, scale: float | None, earlier: int = 0, lowest: float = -np.inf) -> Left:
        """Return the remainder for a scale (None: the best from `lowest` on) and an advance."""
        own, drives = self.flat(self.own), self.flat(self.command, earlier)
        if scale is not None:
            columns = self._columns(scale, earlier)
            _, errors = self._solved(columns, own + scale * drives, self.least, self.most)
            return Left(float(np.mean(errors**2)), errors, scale)
        least, most = np.concatenate([[lowest], self.least]), np.concatenate([[np.inf], self.most])
        plain = np.column_stack([drives, self.forces])
        known = plain.shape[1]
        z, errors = _bounded(plain, own, least[:known], most[:known], np.zeros(known))
        for _ in range(ROUNDS if self.slopes else 0):
            columns = np.column_stack([drives, self._columns(float(z[0]), earlier)])
            z, errors = self._solved(columns, own, least, most)
        return Left(float(np.mean(errors**2)), errors, float(z[0]))

    def _solved(
        self, columns: Floats, own: Floats, least: Floats, most: Floats
    ) -> tuple[Floats, Floats]:
        """Solve like `_bounded`, with the prior of the shares in units of the remainder."""
        count = len(self.slopes)
        known = columns.shape[1] - count
        first = _bounded(columns, own, least, most, np.zeros(known + count))
        left = float(np.mean(first[1] ** 2))
        prior = np.concatenate([np.zeros(known), np.full(count, left / own.size / WIDTH**2)])
        return _bounded(columns, own, least, most, prior)

    def _columns(self, scale: float, earlier: int) -> Floats:
        """Additional forces, and the effects of wrong masses, springs and dampers."""
        off = [self.flat(y) + scale * self.flat(u, earlier) for y, u in self.slopes]
        return np.column_stack([self.forces, *off])

    def flat(self, values: Floats, earlier: int = 0) -> Floats:
        """Return a command or motion, some samples earlier, in the form of the regression."""
        kept = slice(self.kept.start + earlier, self.kept.stop + earlier)
        with np.errstate(all="ignore"):
            return (values[kept] / self.size).ravel()


def _off(device: Device) -> list[Device]:
    """The device with each linear parameter a fifth larger."""
    found: list[Device] = []
    for name in LINEAR:
        for i in np.flatnonzero(getattr(device.chain, name)):
            values = getattr(device.chain, name).copy()
            values[i] *= 1.0 + STEP
            found.append(device.with_chain(device.chain._replace(**{name: values})))
    return found


def _bounded(
    columns: Floats, own: Floats, least: Floats, most: Floats, prior: Floats
) -> tuple[Floats, Floats]:
    """Return z in bounds that minimises mean (own + columns z)^2 + prior z^2, and the remainder."""
    size = np.sqrt(np.maximum(np.mean(columns**2, axis=0), 1e-300))
    unit = columns / size
    square = unit.T @ unit / own.size + np.diag(1e-10 + prior / size**2)
    lower = np.linalg.cholesky(square)
    right = np.linalg.solve(lower, -(unit.T @ own) / own.size)
    z = lsq_linear(lower.T, right, (least * size, most * size), method="bvls").x / size
    return z, own + columns @ z
