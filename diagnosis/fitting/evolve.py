"""Far starts: generations of members that need no slopes.

A model that sticks, rattles or saturates has a cost of creases: differences of 1e-4 point nowhere,
and a refit without the physics has bent the linear parameters so far that no path downhill leads
back. What arrives is a population whose covariance learns the valley (CMA-ES: Hansen & Ostermeier,
Evolutionary Computation 9(2), 2001), every generation one call of the lanes.

How far ahead the cost looks decides what it can see. Under the likeliest observer of a model
without the physics, which takes the physics for disturbance, the truth itself may cost more than
that model; under one that trusts the model for long, motion that rattles scatters beyond telling.
So a population walks a few ratios down, from what is followed easily to what is told apart.

Seen on two masses with play of 0.01 rad and friction, device file 30 % off, encoder of 16 384
steps: slopes came back with no play; 3840 members under 0.01 and 0.001 of the likeliest ratio with
play of 0.0094 from the refit as from the file.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cma
import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.fitting.landscape import Landscape
from zwidth.diagnosis.parameters import Model
from zwidth.diagnosis.settle import prepared_for
from zwidth.diagnosis.steady import NoObserver

Floats = NDArray[np.float64]
WALL = 10.0  # cost of a unit of x squared beyond a bound: far above noise, far below physics
RUNAWAY = 1e12  # cost of a member that runs away: worse than any that does not


@dataclass(frozen=True)
class Generations:
    """How long a population is let run.

    members a generation (of each start), generations under each ratio, ratios over the likeliest
    one; spread: standard deviation of the first generation, in x, of which one is a device file's
    own uncertainty.
    """

    members: int = 16
    generations: int = 60
    ratios: tuple[float, ...] = (1e-2, 1e-3)
    spread: float = 0.5
    seed: int = 1


@dataclass(frozen=True)
class Arrived:
    """Where a population ended: x, its cost under the last observer, the predictions it took."""

    x: Floats
    cost: float
    asked: int


def evolve(
    experiments: Sequence[Experiment],
    model: Model,
    starts: Sequence[Floats],
    likeliest: float,
    plan: Generations = Generations(),
    told: Callable[[float], None] = lambda _: None,
) -> list[Arrived]:
    """Let a population grow from each start, side by side; return where they ended, best first.

    likeliest: ratio of the observer that ratios are counted from. A ratio under which no observer
    follows the model is left out. told: the share done, 0 to 1.
    """
    found = [Arrived(model.within(x), np.inf, 0) for x in starts]
    steps = len(plan.ratios) * plan.generations
    for turn, share in enumerate(plan.ratios):
        ground = _ground(experiments, model, [f.x for f in found], likeliest * share)
        if ground is None:
            continue
        growing = [
            cma.CMAEvolutionStrategy(
                f.x, plan.spread,
                {"popsize": plan.members, "seed": plan.seed + i, "verbose": -9},
            )
            for i, f in enumerate(found)
        ]  # fmt: skip
        for generation in range(plan.generations):
            asked = [strategy.ask() for strategy in growing]
            free = [np.asarray(x) for members in asked for x in members]
            inside = [model.within(x) for x in free]
            beyond = np.array(
                [float(np.sum((a - b) ** 2)) for a, b in zip(free, inside, strict=True)]
            )
            costs = np.nan_to_num(ground.costs(inside), nan=RUNAWAY, posinf=RUNAWAY) + WALL * beyond
            for i, (strategy, members) in enumerate(zip(growing, asked, strict=True)):
                own = costs[i * plan.members : (i + 1) * plan.members]
                strategy.tell(members, own.tolist())
            told((turn * plan.generations + generation + 1) / steps)
        found = [_arrived(model, s, f, ground) for s, f in zip(growing, found, strict=True)]
    return sorted(found, key=lambda f: f.cost)


def _ground(
    experiments: Sequence[Experiment], model: Model, xs: Sequence[Floats], ratio: float
) -> Landscape | None:
    """The landscape under an observer made for the first x for which there is one."""
    for x in xs:
        try:
            there = prepared_for(experiments, model, x, ratio)
        except NoObserver:
            continue
        return Landscape(there.experiments, there.observer, model)
    return None


def _arrived(
    model: Model, strategy: cma.CMAEvolutionStrategy, before: Arrived, ground: Landscape
) -> Arrived:
    x = model.within(np.asarray(strategy.result.xbest))
    return Arrived(x, float(ground.costs([x])[0]), before.asked + strategy.result.evaluations)
