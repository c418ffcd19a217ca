"""Effects exchanged for others: simpler ones, and two at a time."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.diagnosis_examples import phantom, record
from zwidth.diagnosis import exchange, search
from zwidth.diagnosis.exchange import paired, plainly_there, split, swapped
from zwidth.diagnosis.fit import Fitted, Problem
from zwidth.diagnosis.parameters import Model, effect_labels
from zwidth.diagnosis.settle import refit
from zwidth.diagnosis.trials import Step, Trial
from zwidth.diagnosis.views import Answer, Asked
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

Floats = NDArray[np.float64]


def fitted_with(problem: Problem, *effects: Physics) -> Fitted:
    """The device with some effects, magnitudes free, fitted."""
    scales = tuple({k: abs(p.values[k]) or 1.0 for k in p.effect.magnitudes} for p in effects)
    return problem.fit(Model(phantom(), effects, scales), rounds=30)


def silent(_: str) -> None:
    pass


def test_a_richer_name_gives_way_to_the_simpler_truth_only(monkeypatch: pytest.MonkeyPatch):
    """Also where effects were taken for their free runs; something richer does not come in then.

    Mutations that break it: `freely` not looked at; the free run's limit turned round.
    """
    spring = make_physics("cubic_stiffness", "ground", coefficient=0.1)
    e = record(phantom().with_physics(spring), 3.0, seed=11)
    problem, _ = refit(phantom(), [e], (spring,))
    rich = make_physics("hysteresis", "ground", stiffness=0.02, level=5e-3, shape=1.5)
    poor = make_physics("constant_force", "m1", level=1e-3)
    asked = {"hysteresis@ground": (rich, 1), "constant_force@m1": (poor, 5)}
    for name, (physics, parameters) in asked.items():
        current = fitted_with(problem, physics)

        def take(
            p: Problem, without: Fitted, *_: object, n: int = parameters, **__: object
        ) -> Step:
            model = without.model.with_effect(spring, {"coefficient": 0.1})
            trial = p.fit(model, np.append(without.x, 0.0))
            own = Trial("cubic_stiffness@ground", trial, without.chi2 - trial.chi2, n)
            return Step((own,), own, 1.0, (own,))

        monkeypatch.setattr(exchange, "take", take)
        _, found, _ = swapped(problem, current, silent, freely=True)
        label = "cubic_stiffness@ground" if parameters == 1 else name
        assert effect_labels(found.model.effects) == [label]


def test_two_effects_at_wrong_masses_are_exchanged_together():
    """Friction at m1 and drag at m3, fitted as friction at m2 and drag at m1.

    Mutations that break it: only one of the two exchanged; the parameters paid on one side only.
    """
    friction = make_physics("coulomb_friction", "m1", level=3e-3)
    drag = make_physics("quadratic_drag", "m3", coefficient=1.5e-3)
    e = record(phantom().with_physics(friction, drag), 4.0, seed=12)
    problem, _ = refit(phantom(), [e], (friction, drag))
    wrong = (
        make_physics("coulomb_friction", "m2", level=3e-3),
        make_physics("quadratic_drag", "m1", coefficient=1.5e-3),
    )
    current = fitted_with(problem, *wrong)

    def step(own: Physics, rival: Physics, kept: Physics) -> Step:
        a = Trial(f"{own.effect.name}@{own.at}", current, 50.0, 1)
        b = Trial(
            f"{rival.effect.name}@{rival.at}", fitted_with(problem, kept, rival).light(), 40.0, 1
        )
        return Step((a, b), a, 1.0, (a, b))

    steps = [step(wrong[0], friction, wrong[1]), step(wrong[1], drag, wrong[0])]
    there, found = paired(problem, current, steps, silent)
    assert sorted(effect_labels(found.model.effects)) == [
        "coulomb_friction@m1",
        "quadratic_drag@m3",
    ]
    assert there.cost(found) < problem.cost(current) - 10.0
    truth = fitted_with(problem, friction, drag)
    again = [step(friction, wrong[0], drag), step(drag, wrong[1], friction)]
    assert paired(problem, truth, again, silent)[1] is truth


def test_an_effect_that_only_a_slow_observer_misses_is_not_exchanged():
    """Mutation that breaks it: any effect plainly there is enough."""
    friction = make_physics("coulomb_friction", "m1", level=6e-3)
    idle = make_physics("quadratic_drag", "m1", coefficient=1e-7)
    e = record(phantom().with_physics(friction), 3.0, seed=13)
    problem, _ = refit(phantom(), [e], (friction,))
    assert plainly_there(problem, fitted_with(problem, friction))
    assert not plainly_there(problem, fitted_with(problem, friction, idle))


def test_a_directional_friction_is_split_into_what_it_contains():
    """A constant force and Coulomb friction, fitted as friction that differs between directions.

    Mutation that breaks it: the second part sought beside the richer effect.
    """
    force = make_physics("constant_force", "m1", level=2e-3)
    friction = make_physics("coulomb_friction", "m1", level=3e-3)
    e = record(phantom().with_physics(force, friction), 4.0, seed=14)
    problem, _ = refit(phantom(), [e], (force, friction))
    values = {"level_plus": 1e-3, "level_minus": 5e-3, "viscous_plus": 1e-5, "viscous_minus": 1e-5}
    current = fitted_with(problem, make_physics("directional_friction", "m1", **values))
    for freely in (False, True):
        _, found = split(problem, current, silent, freely)
        labels = set(effect_labels(found.model.effects))
        assert labels == {"constant_force@m1", "coulomb_friction@m1"}


@pytest.mark.parametrize(("more", "explained", "gained", "exchanged"), [
    (1, 300.0, 10.0, False), (1, 300.0, 11.0, True),
    (2, 300.0, 13.0, False), (2, 300.0, 14.0, True),
    (1, 1000.0, 29.0, False), (1, 1000.0, 31.0, True),
])  # fmt: skip
def test_what_contains_an_effect_must_be_better_than_by_chance_or_by_an_inexact_law(
    monkeypatch: pytest.MonkeyPatch, more: int, explained: float, gained: float, exchanged: bool
):
    """Chi-square of one degree exceeds 10.83, of two 13.82, once in a thousand (any table).

    Mutations that break it: one degree for all; a strong effect's law taken for exact.
    """
    friction = make_physics("coulomb_friction", "m1", level=4e-3)
    e = record(phantom().with_physics(friction), 6.0, seed=11)
    problem, _ = refit(phantom(), [e], (friction,))
    current = fitted_with(problem, friction)
    values = {"level": 4e-3, "static_level": 6e-3, "velocity": 0.1}
    free = dict(list(values.items())[: more + 1])
    model = Model(phantom(), (make_physics("stribeck_friction", "m1", **values),), (free,))
    x = np.zeros(len(model.parameters))
    richer = Fitted(model, x, current.chi2 - gained, current.residual, np.ones((1, x.size)), 5900)
    trial = Trial("stribeck_friction@m1", richer, gained, more)
    monkeypatch.setattr(exchange, "inflation", lambda _: 1.0)
    without = replace(current, model=Model(phantom()), chi2=current.chi2 + explained)
    monkeypatch.setattr(exchange, "fit_without", lambda *_: without)
    monkeypatch.setattr(exchange, "richer_trials", lambda *_: [trial])
    monkeypatch.setattr(exchange, "_settled", lambda *_: (problem, richer))
    _, found = exchange.merged(problem, current, silent)
    assert (found is richer) is exchanged


def test_what_likelihood_believed_comes_back_where_free_runs_leave_nothing(
    monkeypatch: pytest.MonkeyPatch,
):
    """An observer that trusts the model takes a force of no size in place of the friction.

    Mutation that breaks it: what likelihood took is forgotten.
    """
    friction = make_physics("coulomb_friction", "m1", level=4e-3)
    nothing = make_physics("constant_force", "m1", level=1e-9)
    e = record(phantom().with_physics(friction), 3.0, seed=11)
    problem, _ = refit(phantom(), [e], (friction,))
    linear, right, wrong = (fitted_with(problem, *p) for p in ((), (friction,), (nothing,)))

    def answer(name: str, fitted: Fitted) -> Answer:
        trial = Trial(name, fitted, 100.0, 1)
        step = Step((trial,), trial, 1.0, (trial,))
        return Answer(step, trial, problem, False, problem, fitted, 0.0)

    likely, freer = answer("coulomb_friction@m1", right), answer("constant_force@m1", wrong)
    believed = [[likely], list[Answer]()]

    def ask(*_: object) -> Asked:
        return Asked(
            problem, linear if len(believed) > 1 else wrong, freer.step, believed.pop(0), []
        )

    monkeypatch.setattr(search, "refit", lambda *_: (problem, linear))
    monkeypatch.setattr(search, "ask", ask)
    monkeypatch.setattr(search, "runs_freer", lambda *_: freer)
    found = search.search(phantom(), [e])
    assert effect_labels(found.final.model.effects) == ["coulomb_friction@m1"]
