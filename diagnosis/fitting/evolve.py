"""Evolutionary search for distant starting points: generations of models, no gradients.

A model that sticks, rattles or saturates has a cost with creases, where differences of 1e-4 point
in no useful direction, and a refit without the physics has moved the linear parameters so far that
no path downhill leads back. A population whose covariance adapts to the valley gets there (CMA-ES:
Hansen & Ostermeier, Evolutionary Computation 9(2), 2001); every generation is one call of the
lanes.

The observer decides which physics the cost can show. With one faster than the right one, physics
counts as disturbance, and the truth may cost more than a model without it. With a far slower one,
motion that rattles diverges. With the right one the valley is wide, but which one this is depends
on the truth. So each ratio of a ladder has its own population, on a stretch of the recordings, and
each result is judged with its own most likely noise.

Example: two masses with play of 0.01 rad and friction (500 Hz, 7000 ticks; the refit's valley has a
gap of 0.0080 and a spring of 30 instead of 40 N m/rad). Populations of 32 members that start there
and at the device file, with 120 generations on 3000 ticks and the right ratio, arrive at gaps of
0.01003 and 0.01001 and springs of 39.8 and 40.9. With ten times that ratio, or a tenth, they arrive
at 0.0087 and 0.0080. A population that goes through all of these ratios in turn leaves the valley
again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.landscape import Landscape
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import blind
from zwidth.diagnosis.noise.settle import prepared_for
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment

Floats = NDArray[np.float64]
WALL = 10.0  # cost of a unit of x squared beyond a bound: far above noise, far below physics
RUNAWAY = 1e12  # cost of a member that runs away: worse than any that does not


@dataclass(frozen=True)
class Generations:
    """How long a population runs.

    members: per generation, from each start; spread: standard deviation of the first generation in
    x, of which 1 is the device file's own uncertainty.
    """

    members: int = 32
    generations: int = 80
    spread: float = 0.5
    seed: int = 1


@dataclass(frozen=True)
class Arrived:
    """The end of a population: x, its cost with its observer, and the number of predictions."""

    x: Floats
    cost: float
    asked: int


def evolve(
    experiments: Sequence[Experiment],
    model: Model,
    starts: Sequence[Floats],
    ratio: float,
    plan: Generations = Generations(),
) -> list[Arrived]:
    """Run a population from each start, side by side; return their results, best first.

    ratio: of the observer, which is made for the first start that allows one. Empty if none does.
    """
    inside = [model.within(x) for x in starts]
    ground = _ground(experiments, model, inside, ratio)
    if ground is None:
        return []
    import cma  # it loads pyplot, half a second, and few searches need a population

    # Slopes find the clock's parameters later; in a population they only mislead.
    free = [i for i, p in enumerate(model.parameters) if p.kind not in ("jitter", "skew")]

    def whole(x: Floats, member: Floats) -> Floats:
        found = x.copy()
        found[free] = member
        return found

    # Each draws from its own stream: by default all share numpy's, so that populations side by side
    # on threads would not be reproducible.
    growing = [
        cma.CMAEvolutionStrategy(
            x[free], plan.spread,
            {"popsize": plan.members, "verbose": -9, "seed": np.nan,
             "randn": _own_stream(plan.seed + i)},
        )
        for i, x in enumerate(inside)
    ]  # fmt: skip
    for _ in range(plan.generations):
        alive = [(x, s) for x, s in zip(inside, growing, strict=True) if not s.stop()]
        if not alive:
            break
        asked = [[np.asarray(member) for member in strategy.ask()] for _, strategy in alive]
        each = zip(alive, asked, strict=True)
        costs = _costs(ground, [whole(x, member) for (x, _), members in each for member in members])
        for i, ((_, strategy), members) in enumerate(zip(alive, asked, strict=True)):
            own = costs[i * plan.members : (i + 1) * plan.members]
            strategy.tell(members, own.tolist())
    arrived = [
        (model.within(whole(x, np.asarray(s.result.xbest))), s.result.evaluations)
        for x, s in zip(inside, growing, strict=True)
    ]
    costs = ground.costs([x for x, _ in arrived]).tolist()
    each = zip(arrived, costs, strict=True)
    return sorted((Arrived(x, cost, asked) for (x, asked), cost in each), key=lambda f: f.cost)


def _own_stream(seed: int) -> Callable[..., Floats]:
    random = np.random.default_rng(seed)
    return lambda *shape: random.standard_normal(shape)


def _costs(ground: Landscape, free: Sequence[Floats]) -> Floats:
    """The cost at each x; beyond a bound, the cost at the bound plus a penalty for the distance."""
    inside = [ground.model.within(x) for x in free]
    beyond = np.array([float(np.sum((a - b) ** 2)) for a, b in zip(free, inside, strict=True)])
    return np.nan_to_num(ground.costs(inside), nan=RUNAWAY, posinf=RUNAWAY) + WALL * beyond


def _ground(
    experiments: Sequence[Experiment], model: Model, xs: Sequence[Floats], ratio: float
) -> Landscape | None:
    """The landscape with an observer made for the first x that has one."""
    for x in xs:
        try:
            there = prepared_for(experiments, model, x, blind(ratio))
        except NoObserver:
            continue
        return Landscape(there.experiments, there.observer, model)
    return None
