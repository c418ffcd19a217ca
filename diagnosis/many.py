"""One model at many x, side by side: their innovations on a recording.

A fit asks for its slopes, a population for its costs: the same structure with other numbers, which
the lanes of the kernel run together (`sim/population.py`). Members that have lost an effect (an
extra mass of nothing) or take other substeps are of another kind, and run with their own.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.parameters import Model, first_velocity
from zwidth.diagnosis.predictor import Fineness, observer_memory, padded, substeps_of
from zwidth.diagnosis.steady import NoObserver
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.device import Device
from zwidth.sim.population import Followed, Population, Readings, Recorded

Floats = NDArray[np.float64]
BEGINNING = 32  # samples that say where a run begins


class Many:
    """A model at several x: prepared once, to follow one recording after the other.

    least: substeps a tick that all take at least, as `predictor.prepared` has it. A member that
    moves too fast to be followed has infinite innovations.
    """

    def __init__(
        self, model: Model, xs: Sequence[Floats], fineness: Fineness, least: int = 1
    ) -> None:
        self.model, self.xs = model, list(xs)
        self.devices = [model.acting(x) for x in xs]
        kinds: dict[object, list[int]] = {}
        for i, device in enumerate(self.devices):
            substeps = _substeps(device, fineness, least)
            if substeps is not None:
                size = device.plant().size
                labels = tuple((p.effect.name, p.at) for p in device.physics)
                kinds.setdefault((substeps, size, labels), []).append(i)
        self.populations = [
            (which, Population([self.devices[i] for i in which], *key[0]))
            for key, which in kinds.items()
            if isinstance(key, tuple)
        ]

    def innovations(self, experiment: Experiment, gain: Floats) -> Floats:
        """Return innovations (x, ticks, o) under an observer's gain (states, o), or one a member.

        experiment.start: of all, or (x, 2n) where each begins with its own.
        """
        found = np.full((len(self.xs), *experiment.measured.shape), np.inf)
        for which, followed in self._followed(experiment, gain, keep=True):
            found[which] = followed.innovations
        return found

    def moments(self, experiment: Experiment, gain: Floats, filters: Floats, skip: int) -> Floats:
        """Return the sums of w w' (x, o, o), w the filtered innovations after the first `skip`.

        Infinite where a member cannot be followed; nothing of the recording's length is kept.
        """
        o = len(experiment.outputs)
        found = np.full((len(self.xs), o, o), np.inf)
        for which, followed in self._followed(experiment, gain, filters, skip):
            found[which] = followed.moments
        return found

    def _followed(
        self,
        experiment: Experiment,
        gain: Floats,
        filters: Floats | None = None,
        skip: int = 0,
        keep: bool = False,
    ) -> Iterator[tuple[list[int], Followed]]:
        plain = self.model.plain(experiment)
        still = np.array([o.quantity == "position" for o in experiment.outputs], dtype=np.float64)
        place = first_velocity(experiment)
        first = experiment.part(0, min(BEGINNING, experiment.ticks))
        for which, population in self.populations:
            reads = [self.model.reads(self.xs[i]) for i in which]
            eq = population.coarse[0].eq
            jitters = np.zeros((len(which), still.size))
            if place is not None:
                jitters[:, place] = [r.jitter for r in reads]
            readings = Readings(
                padded(gain, self.devices[which[0]], eq),
                np.array([r.gain for r in reads]),
                np.array([r.origin * experiment.swing * still for r in reads]),
                jitters,
            )
            starts = [
                observer_memory(m.eq, self.model.seen(first, self.xs[i]))
                for i, m in zip(which, population.coarse, strict=True)
            ]
            force = experiment.force
            if force is not None:
                force = np.pad(force, ((0, 0), (0, eq.dof - force.shape[1])))
            recorded = Recorded(
                plain.command, plain.measured, experiment.places(eq.dof), force,
                None if place is None else self.model.arriving_change(plain),
            )  # fmt: skip
            yield which, population.follow(
                recorded, starts, readings, filters, skip, keep,
                run_all=lambda tasks: in_parallel(tasks, threads()),
            )  # fmt: skip


def _substeps(device: Device, fineness: Fineness, least: int) -> tuple[int, int] | None:
    try:
        return substeps_of(device, fineness, least)
    except NoObserver:
        return None
