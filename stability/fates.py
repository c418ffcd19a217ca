"""What becomes of a run at the points of a plane.

Three answers where linear theory knows two: the run comes to rest, oscillates on at an amplitude
that something other than linear theory sets, or grows until the amplifier's limit (or nothing)
holds it. A sustained oscillation is perceptible or not, by the force that its command swings.

Under an encoder's or a command's steps an oscillation may be irregular: it has no constant
amplitude, and no trend that lasts. At the end of the longest run it counts as sustained, also where
it seems to grow but is below the start and below a few steps. One that still falls there is
undecided: the steps decide whether it will stop.
"""

import enum
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.sim.device import Device
from zwidth.sim.ensemble import walls
from zwidth.sim.growth import DECAYS, GROWS, LIMIT_CYCLE, UNDECIDED, Growth
from zwidth.stability.bisection import judge_each, threshold
from zwidth.stability.dither import drifts, held_growth
from zwidth.stability.plane import OF_THE_DEVICE, Floats, Plane

Ints = NDArray[np.int64]


class Fate(enum.IntEnum):
    """What a run does in the end."""

    RESTS = 0
    IMPERCEPTIBLE_CYCLE = 1
    CYCLE = 2
    GROWS = 3
    UNDECIDED = 4


@dataclass(frozen=True)
class Fates:
    """Results at points (n,): fate, growth rate [1/s], amplitude [rad | m], force, frequency [Hz].

    amplitude, force [N m | N]: half the range of m1's position and of the command in the last
    window of the run.
    """

    fate: NDArray[np.int8]
    rate: Floats
    amplitude: Floats
    force: Floats
    frequency: Floats

    @staticmethod
    def empty(count: int) -> "Fates":
        """Return room for count results."""
        return Fates(np.full(count, -1, dtype=np.int8), *np.full((4, count), np.nan))

    def put(self, where: Ints, other: "Fates") -> None:
        """Write other's results at some of the points."""
        for name in (f.name for f in fields(self)):
            getattr(self, name)[where] = getattr(other, name)


def evaluate(plane: Plane, x: Floats, y: Floats, workers: int | None = None) -> Fates:
    """Run the device at points (x, y) of the plane, both (n,): those of one structure together."""
    columns: dict[str, Floats] = {plane.x.quantity: x, plane.y.quantity: y}
    apart = {q: columns[q] for q in OF_THE_DEVICE if q in columns}
    keys = np.column_stack(list(apart.values())) if apart else np.zeros((x.size, 1))
    values, which = np.unique(keys, axis=0, return_inverse=True)
    which = which.ravel().astype(np.int64)
    devices = [plane.device_at(dict(zip(apart, row, strict=False))) for row in values.tolist()]
    starts = columns.get("amplitude", np.full(x.size, plane.trial.start))
    stiffness = columns.get("K", np.full(x.size, plane.stiffness))
    damping = columns.get("B", np.full(x.size, plane.damping))
    setting = Setting.of(plane, devices, which, starts)
    ensemble = walls(stiffness, damping, 0.0, plane.one_sided, plane.trial.law)
    growth = judge_each(devices, which, ensemble, starts, setting.rest, plane.trial, workers)
    return classify(growth, setting, plane.trial.limit_s, plane.perceptible, plane.one_sided)


class Setting(NamedTuple):
    """What of device and trial decides a fate, each (runs,).

    limit of the command, encoder_step, stepped: whether anything is; start: amplitude at t = 0;
    rest: amplitude of a cycle that counts as rest.
    """

    limit: Floats
    encoder_step: Floats
    stepped: NDArray[np.bool_]
    start: Floats
    rest: Floats

    @staticmethod
    def of(
        plane: Plane, devices: Sequence[Device], which: NDArray[np.int64], starts: Floats
    ) -> "Setting":
        """Return the settings of runs on a plane."""
        faces = [device.interface for device in devices]
        steps = np.array([face.encoder_step for face in faces])[which]
        stepped = np.array([face.encoder_step > 0.0 or face.command_step > 0.0 for face in faces])
        rests = [
            threshold(devices[k], plane.trial_at(devices[k], a))
            for k, a in zip(which.tolist(), starts.tolist(), strict=True)
        ]
        limits = np.array([face.command_limit for face in faces])
        return Setting(limits[which], steps, stepped[which], starts, np.array(rests))


def classify(
    growth: Growth, setting: Setting, limit_s: float, perceptible: float, one_sided: bool = False
) -> Fates:
    """Turn verdicts into fates.

    A cycle at the amplifier's limit is growth that the limit holds (`stability/dither.py`); the
    command of a one-sided wall reaches the limit on one side only.
    """
    reach = (0.5 if one_sided else 1.0) * setting.limit
    stepped = setting.stepped
    with np.errstate(invalid="ignore"):
        resting = growth.amplitude <= setting.rest
        small = growth.force < perceptible
        falling = growth.rate * limit_s < -1.0
    decays, undecided = growth.verdict == DECAYS, growth.verdict == UNDECIDED
    restless = stepped & decays & ~resting
    grows = growth.verdict == GROWS
    drifting = stepped & drifts(growth, setting.start, setting.encoder_step)
    cycling = (growth.verdict == LIMIT_CYCLE) | (stepped & undecided) | drifting
    cycling |= restless & ~falling
    fate = np.full(growth.verdict.size, Fate.UNDECIDED, dtype=np.int8)
    fate[decays & ~restless] = Fate.RESTS
    fate[cycling & small] = Fate.IMPERCEPTIBLE_CYCLE
    fate[cycling & ~small] = Fate.CYCLE
    fate[(grows & ~drifting) | held_growth(growth, reach, limit_s)] = Fate.GROWS
    return Fates(fate, growth.rate, growth.amplitude, growth.force, growth.frequency)
