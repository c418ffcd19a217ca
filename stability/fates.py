"""The fates (`sim/fate.py`) of runs at the points of a plane."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from zwidth.shown import Valued
from zwidth.sim.ensemble import walls
from zwidth.sim.fate import Conditions, Dither, fates_of
from zwidth.stability.judging import judge_each
from zwidth.stability.plane import OF_THE_DEVICE, Floats, Plane

Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Fates(Valued):
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
        """Return arrays for count results, to be filled by `put`."""
        return Fates(np.full(count, -1, dtype=np.int8), *np.full((4, count), np.nan))

    def put(self, where: Ints, other: "Fates") -> None:
        """Copy the results of other to the points with these indices."""
        for name in (f.name for f in fields(self)):
            getattr(self, name)[where] = getattr(other, name)


def evaluate(plane: Plane, x: Floats, y: Floats, workers: int | None = None) -> Fates:
    """Run the device at points (x, y) of the plane, both (n,)."""
    columns: dict[str, Floats] = {plane.x.quantity: x, plane.y.quantity: y}
    apart = {q: columns[q] for q in OF_THE_DEVICE if q in columns}
    keys = np.column_stack(list(apart.values())) if apart else np.zeros((x.size, 1))
    values, which = np.unique(keys, axis=0, return_inverse=True)
    which = which.ravel().astype(np.int64)
    devices = [plane.device_at(dict(zip(apart, row, strict=False))) for row in values.tolist()]
    starts = columns.get("amplitude", np.full(x.size, plane.trial.start))
    rests = np.array(
        [plane.rest(devices[k], a) for k, a in zip(which.tolist(), starts.tolist(), strict=True)]
    )
    stiffness = columns.get("K", np.full(x.size, plane.stiffness))
    damping = columns.get("B", np.full(x.size, plane.damping))
    ensemble = walls(stiffness, damping, 0.0, plane.one_sided, plane.trial.law)
    trial = plane.trial
    growth = judge_each(devices, which, ensemble, starts, rests, trial, workers)
    dither = None if trial.threshold is None else Dither.unknown(x.size, 0.0)
    conditions = Conditions(
        devices, which, stiffness, damping, starts, rests, plane.one_sided, dither
    )
    fate = fates_of(growth, conditions, trial.limit_s, trial.perception)
    return Fates(fate, growth.rate, growth.amplitude, growth.force, growth.frequency)
