"""How many times over a device seems driven: the scale of the command that its motion tells.

One step ahead the prediction of a linear device is linear in its command, so with a scale s

    e(s) = e - (s - 1) b,      b: what the command alone adds to the prediction,

and s is a regression. Alone it would be drawn by all that the device file does not know: drag on a
mass is a force that goes with the motion, and so with the command. Hence what commonly acts stands
beside it, and with the sign that it has in nature: on each mass viscous, dry and quadratic drag
that resist, a spring that holds, a constant force; and masses, springs and dampers that are off by
up to a half, or twice as much. What is told is what no such device does under the command it is
said to have had.

It is asked under observers that look differently far ahead, and the one under which the command
explains most counts, unless another tells more surely that the command is too large. Those that
hardly look ahead see little but noise; where a feedback has put that noise into the command, both
go together, and the scale comes out tens of times too large. So one that is told clearly and within
what a device file may be off by is taken before a larger one.
"""

from collections.abc import Sequence
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
MOST = 20_000  # ticks looked at
RATIOS = (1e-6, 1e-4, 1e-2, 1.0)
FOLLOWING = 1e2  # ratio of the observer that tells how the masses move, whatever the device
LINEAR = ("masses", "link_springs", "ground_dampers", "link_dampers")
OFF = 2.5  # factor by which a device file may be off in how much a command drives
WEAK = 0.5  # scale below which a command is far too large, to which no noise adds
STEP = 0.2  # share of a linear parameter by which its effect is told
LEAST, MORE = -0.5, 1.0  # share by which a linear parameter may be off
TOLD = 40.0  # -2 ln likelihood, below which a command does not show
TURNS = 0.1  # of the rms velocity, over which dry friction changes its sign
SMALLEST = 1e-3  # scale of a command that is known to drive forward
TINY = 1e-10


@dataclass(frozen=True)
class Driven:
    """scale: of the command that explains a motion best.

    gained: -2 ln likelihood over the command as it is; better: the same as a factor of the rms
    error. told: -2 ln likelihood over no command at all.
    """

    scale: float
    gained: float
    better: float
    told: float


def driven(device: Device, e: Experiment, forward: bool = False) -> Driven | None:
    """Return how many times over a device seems driven, None where nothing can be compared.

    forward: the sign of its command is known to be right.
    """
    bare = device.with_interface(encoder_step=0.0, command_step=0.0)
    e = e.part(0, min(MOST, e.ticks))
    found: list[Driven] = []
    with np.errstate(all="ignore"):
        try:
            moved = followed(_linear(bare), e, observer_near(_linear(bare), e, FOLLOWING))
        except NoObserver:
            return None
        if not np.all(np.isfinite(moved)):
            return None
        forces = resisting(moved)
        for ratio in RATIOS:
            one = _under(bare, e, forces, ratio, forward)
            found += [] if one is None else [one]
    if not found:
        return None
    clearest = max(found, key=lambda d: d.told)
    if clearest.scale > OFF:
        clear = [d for d in found if d.scale > 0.0 and d.told > TOLD]
        lowest = min(clear, key=lambda d: d.scale, default=clearest)
        clearest = lowest if lowest.scale < OFF else clearest
    weaker = [d for d in found if d.scale < WEAK and d.told > TOLD]
    least = max(weaker, key=lambda d: d.gained, default=clearest)
    return least if least.gained > clearest.gained else clearest


def _linear(device: Device) -> Device:
    return device.bare()


def resisting(moved: Floats) -> list[Floats]:
    """Forces (ticks, n) that resist or hold, of unit size, by how the masses move (ticks, 2n)."""
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


def _under(
    device: Device, e: Experiment, forces: Sequence[Floats], ratio: float, forward: bool
) -> Driven | None:
    """The same under one observer."""
    plain = _linear(device)
    try:
        gain, ready = observer_near(plain, e, ratio), prepared(plain, SEARCHING)
        own = innovations(device, e, gain)
        still = replace(e, measured=np.zeros_like(e.measured), start=None, force=None)
        unmoved = replace(still, command=np.zeros_like(e.command))
        # What adds to a prediction is taken from the innovation: e(s) = own + (s - 1) columns[0].
        columns = [innovations(plain, still, gain, ready=ready)]
        constant = np.zeros_like(forces[0]) if forces else np.zeros((e.ticks, 1))
        constant[:, 0] = 1.0
        columns += [innovations(plain, unmoved, gain, f, ready) for f in (constant, *forces)]
        chain = device.chain
        off: list[Floats] = []
        for name in LINEAR:
            for i in np.flatnonzero(getattr(chain, name)):
                values = getattr(chain, name).copy()
                values[i] *= 1.0 + STEP
                other = device.with_chain(chain._replace(**{name: values}))
                off.append((innovations(other, e, gain) - own) / STEP)
    except NoObserver:
        return None
    skip = min(SETTLING, e.ticks // 5)
    every = np.stack([*columns, *off], axis=-1)[skip:]
    own = own[skip:]
    if not (np.all(np.isfinite(every)) and np.all(np.isfinite(own))):
        return None
    least = np.concatenate([[-np.inf], np.zeros(len(forces)), np.full(len(off), LEAST)])
    most = np.concatenate([[np.inf], np.full(len(forces), np.inf), np.full(len(off), MORE)])
    try:
        fit = _Fit(every, own, least, most)
        if not fit.usable:
            return None
        free, scale = fit.left(None, SMALLEST - 1.0 if forward else -np.inf)
        as_is, nothing = fit.left(0.0)[0], fit.left(-1.0)[0]
    except (np.linalg.LinAlgError, ValueError):  # sizes that no number holds
        return None
    if not free > 0.0:
        return None
    samples = own.size
    return Driven(
        1.0 + scale,
        samples * float(np.log(as_is / free)),
        float(np.sqrt(as_is / free)),
        samples * float(np.log(nothing / free)),
    )


class _Fit:
    """Least squares of own + columns z, all but the first of z inside bounds."""

    def __init__(self, columns: Floats, own: Floats, least: Floats, most: Floats) -> None:
        weights = 1.0 / np.maximum(np.sqrt(np.mean(own**2, axis=0)), 1e-300)
        a = (columns * weights[:, None]).reshape(-1, columns.shape[-1])
        b = -(own * weights).ravel()
        square = a.T @ a
        self.size = np.sqrt(np.maximum(np.diag(square), 1e-300))
        self.usable = bool(square[0, 0] > 0.0)
        unit = square / self.size / self.size[:, None] + TINY * np.eye(self.size.size)
        lower = np.linalg.cholesky(unit)
        self.a = lower.T
        self.b = np.linalg.solve(lower, a.T @ b / self.size)
        self.rest = max(float(b @ b - self.b @ self.b), 0.0)  # that no column explains
        self.least, self.most = least, most

    def left(self, first: float | None, lowest: float = -np.inf) -> tuple[float, float]:
        """Return what is left with the first of z at a value, or free, and that value."""
        low, high = self.least * self.size[1:], self.most * self.size[1:]
        if first is None:
            bounds = (
                np.concatenate([[lowest * self.size[0]], low]),
                np.concatenate([[np.inf], high]),
            )
            z = lsq_linear(self.a, self.b, bounds).x
            return self._rest(z), float(z[0] / self.size[0])
        fixed = first * self.size[0]
        z = lsq_linear(self.a[:, 1:], self.b - self.a[:, 0] * fixed, (low, high)).x
        return self._rest(np.concatenate([[fixed], z])), first

    def _rest(self, z: Floats) -> float:
        off = self.a @ z - self.b
        return self.rest + float(off @ off)
