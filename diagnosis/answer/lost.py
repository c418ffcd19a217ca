"""Recordings to judge by, as an answer sees them that says that commands are lost."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.noise.beginning import begun, begun_as
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.lattice import losses
from zwidth.diagnosis.selection.searched import Searched


def knowing_losses(found: Searched, judge_by: Sequence[Experiment]) -> list[Experiment]:
    """Return recordings with the commands that were lost in them, where the answer has such.

    Which ones were lost is chance: no model foretells it, and no free run is judged by it. Each
    stands out alone, by log odds of 3 beyond the rate; no parameter is touched.
    """
    final, observer = found.final, found.judge
    if not final.model.has("dropped_samples"):
        return list(judge_by)
    parts = found.problem.experiments
    followed = [_going_on(e, parts) for e in judge_by]
    device = final.model.acting(final.x)
    seen = [begun(device, final.model.seen(e, final.x), observer) for e in followed]
    started = [begun_as(e, mine) for e, mine in zip(followed, seen, strict=True)]
    problem = Problem(started, observer)
    there = replace(final, residual=problem.residual(final.model, final.x), samples=problem.samples)
    lost = losses(problem, there)
    return [replace(e, dropped=d) for e, d in zip(followed, lost, strict=True)]


def _going_on(e: Experiment, parts: Sequence[Experiment]) -> Experiment:
    """The rest of a recording, which knows what was lost in its first part."""
    if e.before is None:
        return e
    command = e.before.command
    first = next((p for p in parts if np.array_equal(p.command, command)), None)
    return e if first is None else replace(e, before=replace(e.before, dropped=first.dropped))
