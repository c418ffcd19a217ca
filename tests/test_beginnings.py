"""What is looked at first of a recording: where the machine moves."""

import numpy as np
import pytest

from zwidth.diagnosis.recording.experiment import Experiment, Output, beginnings

T = 0.001


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
