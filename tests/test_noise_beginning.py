"""How an observer begins: uncertain, in motion or at rest, on either side of a gap."""

from dataclasses import replace

import numpy as np
import pytest
from fitting_examples import drive, play, recording

from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.fitting.uncertainty import standard_errors
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import as_far_as, followed_by, likeliest, noises
from zwidth.diagnosis.noise.gaps import Changing, changing
from zwidth.diagnosis.noise.predictor import SETTLING, followed, innovations
from zwidth.diagnosis.noise.steady import steady
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

GAP = 0.05
FRICTION = make_physics("coulomb_friction", "m2", level=0.03)
BOTH = (play(GAP), FRICTION)


def motor_alone(begin: int) -> tuple[Experiment, Experiment]:
    """Return what m1 shows from a sample on, of a device with play, and what both masses do."""
    truth = drive().with_physics(*BOTH)
    both = recording(truth, 1500, 3, (0, 1)).part(begin, 1500)
    return Experiment(both.period, both.command, both.measured[:, :1], both.outputs[:1], "m1"), both


def model_of(*physics: Physics) -> Model:
    return Model(drive(), tuple(physics), ({},) * len(physics))


@pytest.mark.parametrize("outputs", [(0,), (0, 1)], ids=["m1", "m1 and m2"])
def test_an_observer_finds_a_motion_that_goes_on_at_once(outputs: tuple[int, ...]) -> None:
    """A recording cut out of a motion, and an observer that trusts its model.

    Mutations: the steady gain from the first sample on; P of the steady observer at the beginning.
    """
    device = drive()
    cut = recording(device, 2500, 4, outputs).part(700, 2500)
    gain = changing(device, [cut], 1e-9, steady(device, cut, 1e-9).gain)
    early = np.std(innovations(device, cut, gain)[SETTLING:400], axis=0)
    late = np.std(innovations(device, cut, gain)[-800:], axis=0)
    assert np.all(early < 1.1 * late)
    assert np.all(np.std(innovations(device, cut, gain.steady)[SETTLING:400], axis=0) > 1.1 * late)
    assert gain.first.shape[1] < 2000


def test_the_gains_of_a_beginning_end_as_the_steady_one() -> None:
    """Mutations: a column too far after the last; the first gain for all."""
    device, e = drive(), recording(drive(), 1200, 4)
    gain = changing(device, [e], 1e-2, steady(device, e, 1e-2).gain)
    found, plain = innovations(device, e, gain), innovations(device, e, gain.steady)
    assert gain.first.shape[1] < 200
    assert found[600:] == pytest.approx(plain[600:], abs=1e-3 * float(np.std(plain)))
    assert np.abs(found - plain).max() > 0.1 * np.std(plain)


@pytest.mark.parametrize("seed", [5, 6, 7, 8])
def test_a_beginning_moves_no_parameter(seed: int) -> None:
    """Masses of a clean recording are within three of their standard errors.

    With an initial state by least squares over all first samples, as it was once, they were 24.5,
    1.4, 2.3 and 2.4 off.
    """
    device, model = drive(), Model(drive(np.array([1.1, 0.9, 1.05])))
    x = np.zeros(len(model.parameters))
    h = settled(judged([recording(device, 3000, seed)], model, x), to_the_end=True)
    told = standard_errors(h.fitted)
    found = np.log(model.build(h.x).chain.masses / device.chain.masses)
    own = [e * p.scale for p, e in zip(model.parameters, told, strict=True) if p.kind == "mass"]
    assert np.abs(found / own).max() < 3.0
    assert max(own) < 0.05


def test_what_is_behind_play_is_found_on_its_side() -> None:
    """Nothing measures it. Mutations: a known beginning; steady gains."""
    model = model_of(*BOTH)
    x = np.zeros(len(model.parameters))
    found = 0
    for begin in (300, 350, 400, 450, 500):
        e, both = motor_alone(begin)
        own = likeliest([e], model, x)
        gain = own.observer.gain
        assert isinstance(gain, Changing)
        (seen,) = own.problem([e]).experiments
        states = followed(model.acting(x), seen, gain)
        off = np.abs(states[SETTLING:400, 1] - both.measured[SETTLING:400, 1])
        found += float(np.median(off)) < 0.1 * GAP
    assert found >= 4


@pytest.mark.parametrize("begin", [300, 400, 450])
def test_a_motion_costs_what_it_says_and_a_judge_finds_it_too(begin: int) -> None:
    """At 500 the judge's costs 900 more: the motion is chaotic.

    Mutations: the noise of the steady observer kept; a judge without motions.
    """
    e, _ = motor_alone(begin)
    model = model_of(*BOTH)
    x = np.zeros(len(model.parameters))
    own = likeliest([e], model, x)
    assert own.cost < min(n.cost for n in noises([e], model, x)) - 50.0
    problem = own.problem([e])
    again = problem.observer.cost(problem.weighted(model, x))
    assert again == pytest.approx(own.cost, abs=1e-6)
    there = Problem([followed_by(model.acting(x), e, own.observer)], own.observer, problem.fineness)
    assert own.observer.cost(there.weighted(model, x)) < own.cost + 50.0
    bare = Problem([replace(e, motions=None)], own.observer, problem.fineness)
    assert own.observer.cost(bare.weighted(model, x)) > own.cost + 50.0


@pytest.mark.parametrize(
    "more",
    [
        make_physics("sensor_filter", "sensor", time_constant=0.01, damping=0.7),
        make_physics("sensor_lag", "sensor", time_constant=0.01),
        make_physics("extra_mode", "m2", mass=2e-4, stiffness=5.0, damping=1e-3),
    ],
)
def test_a_device_with_further_states_is_followed_too(more: Physics) -> None:
    """Mutation: as many states as the observer has."""
    e, _ = motor_alone(350)
    model = model_of(*BOTH, more)
    x = np.zeros(len(model.parameters))
    far = as_far_as(0.05, [e])
    (plain,) = noises([e], model, x, far)
    own = likeliest([e], model, x, far)
    assert own.cost <= plain.cost
