"""What scatters more where a law is nonsmooth is no event, and what happens there is one still."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.learning.events import highest
from zwidth.diagnosis.learning.scatter import scatter_in_like_states
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate

T, TICKS = 5e-3, 2400
CHAIN = make_chain([1e-3, 8e-4], [4e-3, 2e-3], 0.0, [12.0], [4e-3])
DEVICE = Device("motor and load", "", True, CHAIN, Interface(period=T))
PLAY = make_physics("backlash", "link12", gap=0.02)


@cache
def judged_with_play(hit: float, stiffer: float) -> Hypothesis:
    """What a model with play thinks of a device whose link is so many times as stiff as its own.

    hit: a torque [N m] on the motor for 20 ms, at 6 s.
    """
    t, random = T * np.arange(TICKS), np.random.default_rng(4)
    command = 0.1 * sum(np.sin(2.0 * np.pi * f * t + p) for f, p in ((0.7, 0.3), (1.9, 2.0)))
    command = command + 0.02 * random.standard_normal(TICKS)
    chain = make_chain([1e-3, 8e-4], [4e-3, 2e-3], 0.0, [12.0 * stiffer], [4e-3])
    truth = Device("motor and load", "", True, chain, Interface(period=T)).with_physics(PLAY)
    force = np.zeros((TICKS, 2))
    force[1200:1204, 0] = hit
    run = simulate(truth, recorded(command), duration=TICKS * T, disturbance=force, substeps=32)
    y = run.trace["position_m1"] + 1e-4 * random.standard_normal(TICKS)
    e = Experiment(T, command, y[:, None], (Output("position", 0),), "run", float(y.std()))
    model = Model(DEVICE).with_effect(PLAY, {"gap": 0.01})
    return judged([e], model, np.zeros(len(model.parameters)))


def squares_by_class(h: Hypothesis, scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean squares of innovations over their scale, from the least scale to the largest."""
    r = h.residual[: h.samples]
    parts = np.array_split(np.argsort(scale, kind="stable"), 8)
    return np.array([float(np.mean(r[p] ** 2 / scale[p] ** 2)) for p in parts])


def test_innovations_over_their_scale_are_alike_in_all_classes():
    """Without it the most sensitive eighth has half as much variance again as the least.

    Mutation that breaks it: the root left out of the scale; sensitivity of white noise.
    """
    h = judged_with_play(0.0, 1.3)
    (scale,) = scatter_in_like_states(h, [np.zeros(TICKS, dtype=np.bool_)])
    own = scale[SETTLING:, 0]
    as_they_are = squares_by_class(h, np.ones(own.size) + 1e-9 * own)
    assert as_they_are.max() > 1.5 * as_they_are.min()
    over_it = squares_by_class(h, own)
    assert over_it.max() < 1.3 * over_it.min()


def test_impacts_of_a_device_with_play_do_not_happen():
    """Mutation that breaks it: all innovations of one variance (it gains 106 of 75)."""
    h = judged_with_play(0.0, 1.0)
    assert highest(h.experiments, h) is None


def test_a_hit_on_a_device_with_play_happens():
    """Mutation that breaks it: every tick a class of its own."""
    h = judged_with_play(0.15, 1.0)
    peak = highest(h.experiments, h)
    assert peak is not None
    assert abs(peak.first - 1200) <= 8
