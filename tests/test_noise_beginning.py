"""Where a device with play begins, of which nothing measures the mass behind it."""

from collections.abc import Sequence

import numpy as np
import pytest
from fitting_examples import drive, play, recording

from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise import family
from zwidth.diagnosis.noise.beginning import by_own_slopes
from zwidth.diagnosis.noise.family import NEXT_SAMPLE, Family, as_far_as, begun, likeliest, noises
from zwidth.diagnosis.noise.predictor import innovations
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

GAP = 0.05
FRICTION = make_physics("coulomb_friction", "m2", level=0.03)
BOTH = (play(GAP), FRICTION)


def motor_alone(begin: int, physics: Sequence[Physics] = BOTH) -> tuple[Experiment, float]:
    """Return what m1 shows from a sample on, and where m2 is beside it there."""
    truth = drive().with_physics(*physics)
    both = recording(truth, 1500, 3, (0, 1)).part(begin, 1500)
    seen = Experiment(both.period, both.command, both.measured[:, :1], both.outputs[:1], "m1")
    return seen, float(both.measured[0, 1] - both.measured[0, 0])


def model_of(physics: Sequence[Physics]) -> Model:
    return Model(drive(), tuple(physics), ({},) * len(physics))


def test_what_is_behind_play_begins_on_its_side() -> None:
    """At the truth, at four of five beginnings; at 400 the search stays in the linear valley.

    Mutations: the linear answer alone; nothing moved across the gap.
    """
    model = model_of(BOTH)
    x = np.zeros(len(model.parameters))
    found = 0
    for begin in (300, 350, 400, 450, 500):
        e, beside = motor_alone(begin)
        linear = min(noises([e], model, x), key=lambda n: n.cost)
        assert (
            abs(linear.courses[0].start[1] - linear.courses[0].start[0]) < 0.1 * GAP
        )  # in the middle
        own = likeliest([e], model, x)
        m1, m2 = own.courses[0].start[:2]
        found += own.cost < linear.cost - 20.0 and abs(m2 - m1 - beside) < 0.1 * GAP
    assert found >= 4


@pytest.mark.parametrize(("far", "begin", "less"), [(False, 500, 50.0), (True, 300, 100.0)])
def test_a_beginning_costs_what_it_says_and_a_judge_finds_it_too(
    far: bool, begin: int, less: float
) -> None:
    """Mutations: the noise of the linear beginning kept; a judge that begins at that."""
    e, _ = motor_alone(begin)
    model = model_of(BOTH)
    x = np.zeros(len(model.parameters))
    among = as_far_as(0.05, [e]) if far else NEXT_SAMPLE
    own = likeliest([e], model, x, among)
    assert own.cost < min(n.cost for n in noises([e], model, x, among)) - less
    problem = own.problem([e])
    again = problem.observer.cost(problem.weighted(model, x))
    assert again == pytest.approx(own.cost, abs=1e-6)
    judged = begun(model.acting(x), e, own.observer)
    there = Problem([judged], own.observer, problem.fineness)
    assert own.observer.cost(there.weighted(model, x)) < own.cost + 50.0


@pytest.mark.parametrize(
    "more",
    [
        make_physics("sensor_filter", "sensor", time_constant=0.01, damping=0.7),
        make_physics("sensor_lag", "sensor", time_constant=0.01),
        make_physics("extra_mode", "m2", mass=2e-4, stiffness=5.0, damping=1e-3),
    ],
)
def test_a_device_with_further_states_begins_too(more: Physics) -> None:
    """Mutation: as many units as the observer has states."""
    physics = (*BOTH, more)
    e, _ = motor_alone(350)
    model = model_of(physics)
    x = np.zeros(len(model.parameters))
    far = as_far_as(0.05, [e])
    (linear,) = noises([e], model, x, far)
    own = likeliest([e], model, x, far)
    assert own.courses[0].start.shape == linear.courses[0].start.shape
    assert own.cost < linear.cost


@pytest.mark.parametrize("level", [0.015, 0.03])
def test_what_begins_at_rest_under_friction_begins_at_rest(level: float) -> None:
    """The noise is that of the encoder from the first sample on, at the truth.

    Mutations: one step of Gauss and Newton alone; rest not tried.
    """
    friction = make_physics("coulomb_friction", "m1", level=level)
    e = recording(drive().with_physics(friction), 3000, 4)
    model = model_of([friction])
    problem = likeliest([e], model, np.zeros(len(model.parameters))).problem([e])
    device = model.acting(np.zeros(len(model.parameters)))
    errors = innovations(device, problem.experiments[0], problem.observer.gain)[:, 0]
    assert np.std(errors[:300]) < 1.1 * np.std(errors[300:])


def test_what_has_no_play_begins_as_a_linear_device_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """No step of it is computed, which would cost a search its time. Mutation: asked of all."""
    e, _ = motor_alone(200, [FRICTION])
    model = model_of([FRICTION])
    x = np.zeros(len(model.parameters))
    expected = min(noises([e], model, x), key=lambda n: n.cost)

    def never(*_: object) -> None:
        raise AssertionError

    monkeypatch.setattr("zwidth.diagnosis.noise.beginning._nearest", never)
    found = likeliest([e], model, x)
    assert np.array_equal(found.courses[0].start, expected.courses[0].start)
    assert found.cost == expected.cost


def test_a_beginning_that_gains_nothing_is_the_linear_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same array, and the same beginning. Mutation: what costs more is returned."""
    e, _ = motor_alone(200)
    model = model_of(BOTH)
    x = np.zeros(len(model.parameters))
    best = likeliest([e], model, x)
    monkeypatch.setattr(
        "zwidth.diagnosis.noise.beginning._nearest", lambda _, begin, __: begin + 1.0
    )
    start = best.courses[0].start
    assert by_own_slopes(model.acting(x), e, best.observer, start) is start
    monkeypatch.setattr(family, "by_own_slopes", lambda _d, _e, _o, linear: linear)
    ratio = best.observer.ratio
    (plain,) = noises([e], model, x, Family((ratio,)))
    found = likeliest([e], model, x, Family((ratio,)))
    assert found.cost <= plain.cost
    assert np.array_equal(found.courses[0].start, plain.courses[0].start)
