"""Innovations of one model on a recording, at many parameter vectors x side by side.

Slopes of a fit and costs of a population are predictions of one structure with different values,
which the lanes of the kernel compute together (`sim/population.py`). Members without one of the
effects (an extra mass of zero) or with another number of substeps run as separate groups.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.model.parameters import Model, leads
from zwidth.diagnosis.noise.gaps import Gain, along
from zwidth.diagnosis.noise.predictor import (
    MOST_SUBSTEPS,
    Fineness,
    first_motion,
    observer_memories,
    padded,
    substeps_for,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.device import Device
from zwidth.sim.members import Members, together
from zwidth.sim.population import Followed, Population, Readings, Recorded

Floats = NDArray[np.float64]
Shares = tuple[tuple[int, float], ...]
Differing = tuple[int, Shares]  # known differences of the device, and shares of changes
BEGINNING = 32  # samples that determine the start of a run


class Many:
    """A model at several x: prepared once, then run on several recordings.

    A member that needs too many substeps has infinite innovations. Raises ValueError like
    `Model.acting`.
    """

    def __init__(self, model: Model, xs: Sequence[Floats], fineness: Fineness) -> None:
        self.model, self.size, self.fineness = model, len(xs), fineness
        self.xs = np.stack(xs) if len(xs) else np.zeros((0, len(model.parameters)))
        self._kinds: dict[Differing, list[_Kind]] = {}
        self._members: dict[Shares, Members] = {}
        if self.size:
            self._everyone(self.xs, ())

    def kinds(self, experiment: Experiment) -> list["_Kind"]:
        """Return the members for a recording, by their kind."""
        key = id(experiment.changes), self.model.shares(experiment)
        if key not in self._kinds:
            self._kinds[key] = list(self._prepared(experiment)) if self.size else []
        return self._kinds[key]

    def _everyone(self, xs: Floats, shares: Shares) -> Members:
        """The members for given shares of the changes."""
        if shares not in self._members:
            self._members[shares] = self.model.members(xs)
            self._members[shares].check()
        return self._members[shares]

    def _prepared(self, experiment: Experiment) -> Iterator["_Kind"]:
        there, changes = self.model.there(self.xs, experiment), experiment.changes
        everyone = self._everyone(there, self.model.shares(experiment))
        everyone = everyone if changes is None else changes.of_members(everyone)
        for which in everyone.kinds():
            alike = everyone.taken(which)
            needed = alike.enough_substeps()
            for some in together(needed):
                steps = int(needed[some[0]])
                if steps <= MOST_SUBSTEPS:
                    few, many = substeps_for(alike.physics, self.fineness, steps)
                    members = alike.taken(some)
                    yield _Kind(which[some], Population(members, few, many), members.first)

    def innovations(self, experiment: Experiment, gain: Gain) -> Floats:
        """Return innovations (x, ticks, o) under an observer's gain (states, o)."""
        found = np.full((self.size, *experiment.measured.shape), np.inf)
        for which, followed in self._followed(experiment, gain, keep=True):
            found[which] = followed.innovations
        if experiment.uncounted is not None:
            found[:, experiment.uncounted] = 0.0
        return found

    def moments(self, experiment: Experiment, gain: Gain, filters: Floats, skip: int) -> Floats:
        """Return sums of w w' (x, o, o), w filtered innovations after `skip`; inf if impossible."""
        o = len(experiment.outputs)
        found = np.full((self.size, o, o), np.inf)
        for which, followed in self._followed(experiment, gain, filters, skip):
            found[which] = followed.moments
        return found

    def _followed(
        self,
        experiment: Experiment,
        gain: Gain,
        filters: Floats | None = None,
        skip: int = 0,
        keep: bool = False,
    ) -> Iterator[tuple[NDArray[np.int64], Followed]]:
        plain = self.model.plain(experiment)
        first = self.model.plain(experiment.part(0, min(BEGINNING, experiment.ticks)))
        change, arriving = self.model.arriving_change(first), self.model.arriving_change(plain)
        there = self.model.there(self.xs, experiment)
        gains, at, jitter, zeros, late, push = self.model.reads_each(there)
        still = np.array([o.tells_position for o in experiment.outputs], dtype=np.float64)
        own = zeros[:, [o.mass for o in experiment.outputs]]
        origins = (at[:, None] * experiment.swing + own) * still
        led = leads(experiment.outputs, jitter, late, push)
        period = self.model.nominal.interface.period
        for which, population, device in self.kinds(experiment):
            motions = np.array(
                [_first_motion(first, period, origins[i], led[i], change) for i in which]
            )
            force = experiment.external(population.dof)
            (wide,), columns = along([gain], experiment.bridged, experiment.motions)
            recorded = Recorded(
                plain.command, plain.readings, experiment.places(population), force, arriving,
                plain.strengths, plain.uncounted, columns,
            )  # fmt: skip
            readings = Readings(
                padded(wide, device, population, experiment),
                gains[which],
                origins[which],
                led[which],
                np.tile(late[which, None], (1, still.size)),
            )
            memories = observer_memories(population, motions, experiment.begins)
            yield which, population.follow(
                recorded, memories, readings, filters, skip, keep,
                run_all=lambda tasks: in_parallel(tasks, threads()),
            )  # fmt: skip


class _Kind(NamedTuple):
    """Members with the same states and substeps: their indices, prepared, and the first of them."""

    which: NDArray[np.int64]
    population: Population
    device: Device


def _first_motion(
    first: Experiment,
    period: float,
    origin: Floats,
    led: Floats,
    change: Floats,
) -> tuple[float, float]:
    """The motion at the first sample as a member reads it, see `Model.seen`."""
    measured = first.measured
    if origin.any():
        measured = measured - origin
    if led.any():
        measured = measured - led * change[:, None]
    return first_motion(first.outputs, measured, period)
