"""Benches that prescribe a motion and measure a force: the drive's spring tells where it ends."""

import numpy as np
import pytest

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.whole_run import recorded as as_recorded
from zwidth.diagnosis.intake.hold import smooth
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import ExperimentError, experiment
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.drive import Drive
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate
from zwidth.sim.smooth_command import held_for
from zwidth.sim.trace import Trace

T, STIFF = 0.001, 4e6
BENCH = Drive("position", stiffness=STIFF).on(
    Device("bench", "", False, make_chain([5.0, 5.0], [50.0, 200.0], 0.0, [8e5], [500.0]),
           Interface(period=T))
)  # fmt: skip
LEVEL = 900.0


def bench() -> Trace:
    """What the load cell of a bench reads beside the motion it was given."""
    t = T * np.arange(6000, dtype=np.float64)
    motion = 0.02 * np.sin(3.0 * t) + 0.004 * np.sin(11.0 * t)
    device = BENCH.with_physics(make_physics("coulomb_friction", "m2", level=LEVEL))
    # As a spring that is moved without steps: what is held acts like the smooth motion.
    run = simulate(device, recorded(held_for(motion)), duration=t.size * T, substeps=20)
    force = STIFF * (motion - run.trace["position_m1"])
    force = force + 20.0 * np.random.default_rng(1).standard_normal(t.size)
    channels = {"command": motion, "force_m1": force}
    return Trace(t, channels, {"command": "m", "force_m1": "N"}, "recorded", {})


def test_a_force_tells_where_the_spring_of_the_drive_ends():
    """q = u - F / K, and of q the force again to rounding. Mutation: the command not counted."""
    trace = bench()
    taken = experiment(trace, BENCH)
    assert [o.name for o in taken.outputs] == ["position_m1"]
    there = trace["command"] - trace["force_m1"] / STIFF
    np.testing.assert_allclose(taken.measured[:, 0], there, rtol=1e-12, atol=1e-15)
    back = as_recorded(taken, taken.measured)[:, 0]
    np.testing.assert_allclose(back, trace["force_m1"], atol=1e-6)


def test_a_fit_to_a_force_finds_the_friction_behind_it():
    """From a link, masses and a level 20 % off. Mutation: the sign of the force."""
    guessed = BENCH.with_chain(make_chain([6.0, 6.0], [50.0, 200.0], 0.0, [9.6e5], [500.0]))
    taken = experiment(bench(), guessed)
    friction = make_physics("coulomb_friction", "m2", level=750.0)
    model = Model(guessed).with_effect(friction, {"level": 300.0})
    found = settled(judged([smooth(taken)], model, np.zeros(len(model.parameters))))
    assert model.effects_at(found.x)[0].values["level"] == pytest.approx(LEVEL, rel=0.01)
    assert model.acting(found.x).chain.link_springs[0] == pytest.approx(8e5, rel=0.02)


@pytest.mark.parametrize("damping", [None, 10.0])
def test_a_force_without_a_spring_that_tells_is_refused(damping: float | None):
    device = Device("axis", "", False, make_chain([5.0, 5.0], [1.0, 1.0], 0.0, [8e5], [5.0]),
                    Interface(period=T))  # fmt: skip
    if damping is not None:
        device = Drive("position", stiffness=STIFF, damping=damping).on(device)
    with pytest.raises(ExperimentError, match=r"force of the drive, force_m1.*\[drive\] kind"):
        experiment(bench(), device)
