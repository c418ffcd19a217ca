"""A command of one level: that it is seen, and at which level to record next."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.levels import NextLevel, one_level
from zwidth.diagnosis.answer.result import Diagnosis, HeldOut, Verdict
from zwidth.diagnosis.answer.verdict import Facts, Left
from zwidth.diagnosis.answer.words import headline
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate

PERIOD, LEVEL, FRICTION, DAMPER = 0.002, 0.05, 0.02, 4e-3
KNOWN = Device("cart", "", True, make_chain([2e-4], [DAMPER]), Interface(period=PERIOD))


def steps(level: float, seconds: float = 8.0, turn_s: float = 0.5) -> NDArray[np.float64]:
    """Return a command that goes to and fro between two levels."""
    t = PERIOD * np.arange(round(seconds / PERIOD))
    return level * np.where(t // turn_s % 2 < 1, 1.0, -1.0)


def recording(command: NDArray[np.float64], seed: int = 1) -> Experiment:
    """Return what a cart with dry friction does under a command."""
    cart = KNOWN.with_physics(make_physics("coulomb_friction", "m1", level=FRICTION))
    run = simulate(cart, recorded(command), duration=PERIOD * command.size, substeps=10, bound=1e9)
    noise = 1e-4 * np.random.default_rng(seed).standard_normal(command.size)
    q = run.trace["position_m1"] + noise
    return Experiment(PERIOD, command, q[:, None], (Output("position", 0),), "steps")


@cache
def answer(*levels: float) -> Diagnosis:
    """Return the diagnosis of a recording at each level."""
    each = [recording(steps(level), seed) for seed, level in enumerate(levels)]
    return diagnose(KNOWN, each, None, effort=QUICK)


@pytest.mark.parametrize(
    ("command", "level"),
    [
        (steps(0.05), 0.05),
        (np.where(np.arange(4000) % 1000 < 300, 0.0, steps(0.05)), 0.05),
        (0.05 * np.sin(np.arange(4000) / 50.0), None),
        (np.random.default_rng(1).standard_normal(4000), None),
        (np.concatenate([steps(0.05), steps(0.03)]), None),
        (np.zeros(4000), None),
    ],
)
def test_steps_have_one_level(command: NDArray[np.float64], level: float | None) -> None:
    """Steps to and fro, also with pauses; no sine. Mutation: samples without a command counted."""
    e = Experiment(PERIOD, command, np.zeros((command.size, 1)), (Output("position", 0),))
    found = one_level([e])
    assert found is None if level is None else found == pytest.approx(level)


def test_two_recordings_at_two_levels_have_two() -> None:
    """Mutation: each recording asked alone."""
    each = [recording(steps(level)) for level in (0.05, 0.035)]
    assert [one_level([e]) for e in each] == pytest.approx([0.05, 0.035])
    assert one_level(each) is None


def test_from_one_level_the_level_to_record_next_is_one_at_which_it_still_moves() -> None:
    """Steady under steps of +-sA the cart goes at (sA - F) / b, and refitted at s (A - F) / b.

    They differ by (1 - s) F / (sA - F) of the motion: most at the least s that moves, which 0.3 is
    not and 0.5 is: 2.0, less what passes in turning. Mutations: levels at which it stands still
    allowed (0.3); the level of the least difference (0.75).
    """
    found = answer(LEVEL)
    assert [f.effect for f in found.findings] == ["coulomb_friction"]
    told = found.next_level
    assert told is not None
    assert told.level == pytest.approx(LEVEL)
    assert told.share == 0.5
    assert told.differs > 4.0 * told.now
    assert "repeat the recording at 25 mN m (0.5 times the present level)" in told.sentence
    assert found.as_json()["next_level"]["share"] == 0.5


@pytest.mark.truth
def test_with_a_second_level_no_other_is_asked_for() -> None:
    """Nor is anything in doubt. Mutation: the first recording's levels alone."""
    found = answer(LEVEL, 0.6 * LEVEL)
    assert found.next_level is None
    assert found.verdict is Verdict.IDENTIFIED


def test_an_answer_that_errs_more_than_its_rivals_differ_promises_no_name() -> None:
    """But not where another level would tell no more, nor where readings' noise is the error.

    Mutations: the error as recorded alone; that noise left in it (friction that is found exactly,
    and is that of a load as well at one level, is undecided then).
    """
    level = NextLevel(2.0, "N", 0.3, 0.087, 0.003)
    found = answer(LEVEL)

    def facts(error: float, noise: float) -> Facts:
        free = HeldOut(1.0, 1.0, error, noise)
        return Facts(found.findings, {}, Left(0.0, ""), None, found.adequacy, free, level=level)

    assert facts(0.04, 0.001).undecided_by_level
    assert not facts(0.04, 0.035).undecided_by_level
    assert not facts(0.002, 0.0).undecided_by_level
    assert not facts(0.1, 0.0).undecided_by_level
    assert not facts(float("nan"), 0.0).undecided_by_level
    assert found.verdict is Verdict.CONFUSABLE
    assert facts(0.04, 0.001).verdict is Verdict.UNDECIDED
    said = headline(facts(0.04, 0.001))
    assert said.startswith("Undecided: Coulomb friction of")
    assert said.endswith(
        "so would other effects: repeat the recording at 600 mN (0.3 times the present level)"
    )
