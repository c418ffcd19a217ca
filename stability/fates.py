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
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.device import Device
from zwidth.sim.ensemble import walls
from zwidth.sim.growth import DECAYS, GROWS, LIMIT_CYCLE, UNDECIDED, Growth
from zwidth.stability.bisection import Trial, judge, threshold
from zwidth.stability.plane import OF_THE_DEVICE, Floats, Plane

Ints = NDArray[np.int64]
AT_THE_LIMIT = 0.999
FEW_STEPS = 5.0


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
    """Run the device at points (x, y) of the plane, both (n,).

    Points that share everything of the device go through the kernel together; where there are
    many such groups they go side by side.
    """
    columns: dict[str, Floats] = {plane.x.quantity: x, plane.y.quantity: y}
    apart = [columns[q] for q in (*OF_THE_DEVICE, "amplitude") if q in columns]
    keys = np.column_stack(apart) if apart else np.zeros((x.size, 1))
    _, group = np.unique(keys, axis=0, return_inverse=True)
    groups = [np.flatnonzero(group.ravel() == g) for g in range(int(group.max(initial=-1)) + 1)]
    workers = workers or threads()
    inner = 1 if len(groups) >= workers else workers
    result = Fates.empty(x.size)

    def run(points: Ints) -> None:
        some = {name: column[points] for name, column in columns.items()}
        result.put(points, _of_one_device(plane, some, inner))

    in_parallel([lambda points=points: run(points) for points in groups], workers)
    return result


def _of_one_device(plane: Plane, columns: dict[str, Floats], workers: int) -> Fates:
    first = {name: float(column[0]) for name, column in columns.items()}
    device = plane.device_at(first)
    trial = plane.trial_at(device, first.get("amplitude", plane.trial.start))
    count = next(iter(columns.values())).size
    stiffness = columns.get("K", np.full(count, plane.stiffness))
    damping = columns.get("B", np.full(count, plane.damping))
    growth = judge(device, walls(stiffness, damping, 0.0, plane.one_sided), trial, workers)
    return classify(growth, device, trial, plane.perceptible, plane.one_sided)


def classify(
    growth: Growth, device: Device, trial: Trial, perceptible: float, one_sided: bool = False
) -> Fates:
    """Turn verdicts into fates.

    A cycle at the amplifier's limit is growth that the limit holds; the command of a one-sided wall
    reaches the limit on one side only. Such a cycle may seem to fall a little while it settles.
    """
    interface = device.interface
    reach = (0.5 if one_sided else 1.0) * interface.command_limit
    stepped = interface.encoder_step > 0.0 or interface.command_step > 0.0
    with np.errstate(invalid="ignore"):
        resting = growth.amplitude <= threshold(device, trial)
        held = growth.force >= AT_THE_LIMIT * reach
        small = growth.force < perceptible
        falling = growth.rate * trial.limit_s < -1.0
        low = growth.amplitude < max(abs(trial.start), FEW_STEPS * interface.encoder_step)
    decays, undecided = growth.verdict == DECAYS, growth.verdict == UNDECIDED
    restless = stepped & decays & ~resting
    grows = growth.verdict == GROWS
    drifting = stepped & grows & low & np.isfinite(growth.rate)
    cycling = (growth.verdict == LIMIT_CYCLE) | (stepped & undecided) | drifting
    cycling |= restless & ~falling
    fate = np.full(growth.verdict.size, Fate.UNDECIDED, dtype=np.int8)
    fate[decays & ~restless] = Fate.RESTS
    fate[cycling & small] = Fate.IMPERCEPTIBLE_CYCLE
    fate[cycling & ~small] = Fate.CYCLE
    fate[(grows & ~drifting) | (held & ~(decays & falling))] = Fate.GROWS
    return Fates(fate, growth.rate, growth.amplitude, growth.force, growth.frequency)
