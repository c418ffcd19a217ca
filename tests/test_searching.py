"""Descent in lanes, whole hypotheses, and the search that moves between them."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from test_fitting import drive, recording

from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.fitting.descend import descend
from zwidth.diagnosis.fitting.landscape import Landscape
from zwidth.diagnosis.parameters import Model
from zwidth.diagnosis.selection.effort import NORMAL, QUICK, Effort
from zwidth.diagnosis.selection.evidence import ALPHA
from zwidth.diagnosis.selection.hypothesis import Hypothesis, gains, judged, settled
from zwidth.diagnosis.selection.moves import Move, Proposal
from zwidth.diagnosis.selection.search import Moves, search
from zwidth.diagnosis.selection.searched import probability, rivals, shares, without
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

FRICTION = make_physics("coulomb_friction", "m1", level=0.03)


@pytest.fixture(scope="module")
def rubbed() -> list[Experiment]:
    """Two masses with Coulomb friction of 0.03 N m at the motor."""
    return [recording(drive().with_physics(FRICTION), 3000, 1)]


def with_friction(level: float) -> Model:
    friction = make_physics("coulomb_friction", "m1", level=level)
    return Model(drive()).with_effect(friction, {"level": level})


def test_descent_over_creases_ends_at_the_friction_that_was_put_in(
    rubbed: list[Experiment],
) -> None:
    model = with_friction(0.015)
    start = judged(rubbed, model, np.zeros(len(model.parameters)))
    ground = Landscape(start.problem.experiments, start.noise.observer, model)
    there = descend(ground, start.x, rounds=15, creased=True)
    level = model.build(there.x).physics[0].values["level"]
    (truth,) = ground.costs([np.eye(1, len(model.parameters), len(model.parameters) - 1)[0]])
    assert there.cost < truth < start.cost.misfit - 100.0
    assert level == pytest.approx(0.03, rel=0.05)


def test_descent_never_goes_uphill(rubbed: list[Experiment]) -> None:
    model = Model(drive(np.array([1.3, 0.8, 1.2])))
    start = judged(rubbed, model, np.zeros(len(model.parameters)))
    costs = [descend(start.ground, start.x, rounds=n).cost for n in (1, 2, 4)]
    assert costs[0] >= costs[1] >= costs[2]


def test_the_stretches_of_a_hypothesis_sum_to_its_likelihood(rubbed: list[Experiment]) -> None:
    model = Model(drive())
    h = judged(rubbed, model, np.full(len(model.parameters), 0.1))
    prior = 0.01 * sum(p.prior for p in model.parameters)
    assert h.blocks.size > 10
    assert h.blocks.sum() + prior == pytest.approx(h.cost.misfit, rel=1e-9)


def test_a_parameter_that_explains_nothing_costs(rubbed: list[Experiment]) -> None:
    bare = settled(
        judged(rubbed, with_friction(0.03), np.zeros(with_friction(0.03).linear_count + 1))
    )
    drag = make_physics("quadratic_drag", "m2", coefficient=1e-6)
    richer = bare.model.with_effect(drag, {"coefficient": 1e-6})
    more = settled(judged(rubbed, richer, np.append(bare.x, 0.0)))
    assert abs(more.cost.misfit - bare.cost.misfit) < 12.0
    assert more.cost.total > bare.cost.total


def only(*physics_and_scales: tuple[Physics, dict[str, float]]) -> Moves:
    """Moves that propose one structure after the other, and nothing to exchange."""

    def adding(h: Hypothesis, _: Effort) -> Iterator[Proposal]:
        for physics, scales in physics_and_scales:
            if f"{physics.effect.name}@{physics.at}" not in h.labels:
                model = h.model.with_effect(physics, scales)
                extra = np.zeros(len(model.parameters) - h.x.size)
                yield Proposal(h.experiments, model, np.append(h.x, extra), h.problem)

    def nothing(_: int) -> Move:
        return lambda _h, _effort: iter(())

    return Moves(adding=(adding,), exchanging=(), replacing=nothing)


def test_a_search_takes_what_is_believed_and_nothing_else(rubbed: list[Experiment]) -> None:
    right = make_physics("coulomb_friction", "m1", level=0.02), {"level": 0.02}
    wrong = make_physics("quadratic_drag", "m2", coefficient=1e-5), {"coefficient": 1e-5}
    found = search(drive(), rubbed, QUICK, moves=only(right, wrong))
    assert found.best.labels == {"coulomb_friction@m1"}
    assert found.best.cost.total < found.plain.cost.total + 2.0 * np.log(ALPHA)


def test_what_was_fitted_has_probabilities_that_sum_to_one(rubbed: list[Experiment]) -> None:
    right = make_physics("coulomb_friction", "m1", level=0.02), {"level": 0.02}
    other = make_physics("coulomb_friction", "m2", level=0.02), {"level": 0.02}
    found = search(drive(), rubbed, QUICK, moves=only(right, other))
    assert sum(shares(found).values()) == pytest.approx(1.0)
    assert probability(found, "coulomb_friction@m1") > 0.99
    assert without(found, "coulomb_friction@m1") > 10.0
    assert [r.effect for r in rivals(found, "coulomb_friction@m1")] == ["coulomb_friction"]


def test_gains_are_those_of_each_stretch(rubbed: list[Experiment]) -> None:
    model = with_friction(0.03)
    new = judged(rubbed, model, np.zeros(len(model.parameters)))
    old = judged(rubbed, Model(drive()), np.zeros(len(model.parameters) - 1))
    assert gains(new, old).sum() == pytest.approx(old.cost.misfit - new.cost.misfit, rel=1e-9)
    assert np.mean(gains(new, old) > 0.0) > 0.9


@pytest.mark.parametrize("scale", [1.0, np.array([1.3, 0.8, 1.2])])
def test_friction_is_found_from_a_device_file_that_is_exact_or_off(
    rubbed: list[Experiment], scale: float | NDArray[np.float64]
) -> None:
    effort = replace(NORMAL, effects=2, near=2, far=2, rivals=2, ended=2, generations=5)
    found = search(drive(scale), rubbed, effort)
    assert found.best.labels == {"coulomb_friction@m1"}
    level = found.best.model.build(found.best.x).physics[0].values["level"]
    assert level == pytest.approx(0.03, rel=0.1)
