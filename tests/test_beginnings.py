"""Recordings that stand still at first, and runs that leave all numbers behind."""

import numpy as np
import pytest

from zwidth.diagnosis.answer.adequacy import RAN_AWAY, clearly, log_ratios
from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.forces.leftover import _alike
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import Experiment, Output, beginnings
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface

T = 0.001
DEVICE = Device("mass", "", False, make_chain([0.5], [0.8]), Interface(period=T))


def recorded(still: int, ticks: int = 6000) -> Experiment:
    """A sine that begins after so many samples at rest."""
    t = T * np.arange(ticks)
    moved = np.where(t >= still * T, np.sin(6.0 * (t - still * T)), 0.0)
    swing = float(moved.std())
    return Experiment(T, 2.0 * moved, moved[:, None], (Output("position", 0),), swing=swing)


@pytest.mark.parametrize(("still", "begins"), [(0, 0.0), (50, 0.0), (2500, 2.26), (5900, 5.0)])
def test_it_begins_before_the_motion(still: int, begins: float) -> None:
    """A quarter stands still: it tells where friction breaks. Whole recordings end where they end.

    Mutation that breaks it: the first samples whatever they show.
    """
    e = recorded(still)
    (part,) = beginnings([e], 1000)
    assert part.ticks == 1000
    assert part.begins == pytest.approx(begins, abs=0.02)
    first = round(part.begins / T)
    assert np.array_equal(part.measured, e.measured[first : first + 1000])


def test_each_recording_for_itself() -> None:
    """Equally many of each; one that never moves by a tenth of its swing from its first sample."""
    still = recorded(6000)
    parts = beginnings([recorded(0), recorded(2500), still], 1500)
    assert [p.ticks for p in parts] == [500] * 3
    assert [round(p.begins, 1) for p in parts] == [0.0, 2.4, 0.0]


def test_noise_of_what_stands_still_is_a_number() -> None:
    """A running mean of squares is below zero by its rounding, where they are zero again.

    Mutation: the root of it as it is.
    """
    white = np.random.default_rng(2).standard_normal(4000) * 1e3
    white[500:3000] = 0.0
    fitted = Fitted(Model(DEVICE), np.zeros(0), 0.0, white, np.zeros((4000, 0)), 4000)
    assert np.isfinite(_alike(fitted, np.random.default_rng(1)).residual).all()


def test_a_run_that_overflowed_is_clearly_worse() -> None:
    """Mutation: 1e300 for it, of which the square is none."""
    still = np.array([1.0, 1.1, 0.9, 1.0])
    away = np.array([RAN_AWAY, 2.0, RAN_AWAY, RAN_AWAY])
    with np.errstate(all="raise"):
        assert clearly(log_ratios(away, still)) > 1.5
        assert np.isfinite(clearly(away - still))
