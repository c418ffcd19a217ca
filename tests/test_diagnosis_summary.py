"""The first screen of a report: one certainty, one figure of worth, and what to do."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from zwidth.diagnosis.answer.result import (
    Diagnosis,
    Estimate,
    Finding,
    HeldOut,
    NextExperiment,
    Verdict,
)
from zwidth.diagnosis_summary import how_sure, missing, next_sentence, title, what_now, worth
from zwidth.sim.chain import make_chain

LEVEL = {"level": Estimate(0.03, 0.029, 0.031, "N m")}
FRICTION = Finding("coulomb_friction", "m1", LEVEL, 40.0, (), 0.99)
GRAVITY = Finding("gravity_pendulum", "m1", LEVEL, 9.2, (), 0.9999)


def found(verdict: Verdict, *findings: Finding, **more: Any) -> Diagnosis:
    """As much of a diagnosis as its first screen reads."""
    device = SimpleNamespace(chain=make_chain([1e-3], [0.0]))
    nothing: dict[str, Any] = {"adequacy": None, "next_experiment": None}
    nothing |= {"next_level": None, "learned": None}
    values = {**nothing, "device": device, "headline": "h", **more}
    return cast("Diagnosis", SimpleNamespace(verdict=verdict, findings=findings, **values))


def test_the_title_names_what_is_missing_without_numbers():
    """Mutation: the headline with its intervals in the place of the title."""
    both = found(Verdict.IDENTIFIED, FRICTION, GRAVITY)
    assert title(both) == (
        "Missing: Coulomb friction at the motor and gravity pendulum at the motor"
    )
    assert title(found(Verdict.IDENTIFIED, *[FRICTION] * 5)).endswith("and 2 more")
    assert title(found(Verdict.NOTHING_MISSING)).startswith("Nothing is missing")


def test_a_law_that_includes_an_effect_stands_in_its_place():
    """Mutation: the effect is named in the title, or the law's worth repeated in the headline."""
    law = SimpleNamespace(worth="w", as_json=lambda: {"absorbed": ["coulomb_friction at m1"]})
    one = found(Verdict.UNKNOWN_PHYSICS, FRICTION, learned=law, headline="a force acts; w; as well")
    assert title(one) == "Physics is missing that has no name in the library"
    assert missing(one) == "a force acts; as well"
    both = found(Verdict.UNKNOWN_PHYSICS, FRICTION, GRAVITY, learned=law)
    assert title(both).endswith("beside gravity pendulum at the motor")


def test_how_sure_is_said_by_the_least_certain_effect():
    """Mutation: the first effect's figures, or the largest."""
    said = how_sure(found(Verdict.IDENTIFIED, FRICTION, GRAVITY), "s")
    assert said == (
        "the probability is 99 %; the least certain effect improves the fit by 9 sigma"
        " (5 are required)"
    )
    sound = SimpleNamespace(explained=0.95)
    half = how_sure(found(Verdict.UNKNOWN_PHYSICS, FRICTION, adequacy=sound), "s")
    assert half == "s. The named effects explain 95 % of the error"


def test_what_it_is_worth_is_one_figure_before_and_after():
    """Mutation: before and after exchanged; an infinite error printed as a number."""
    fit = HeldOut(3.0, 0.7, 0.03, 0.02)
    assert worth(fit, True).startswith(
        "error of short free runs on held-out data: 3 % of the motion with what was found, without"
        " it 70 %; noise alone would cause 2 %"
    )
    assert "70 % of the motion as refitted, as in the device file 300 %" in worth(fit, False)
    assert "do not simulate with it" in worth(HeldOut(3.0, 0.7, float("inf"), 0.02), True)
    assert worth(HeldOut(3.0, 0.0, 0.0, 0.0), True).startswith("there is too little")


def test_a_law_without_a_name_is_worth_what_its_own_free_runs_show():
    """The same figures as in the headline. Mutation: those of the names alone."""
    assert worth(HeldOut(3.0, 0.7, 0.011, 0.02), True, (0.0071, 0.011)).startswith(
        "error of short free runs on held-out data: 0.71 % of the motion with the law that has no"
        " name, 1.1 % without it, as refitted 70 %; noise alone would cause 2 %"
    )


@pytest.mark.parametrize(
    ("sigma", "said"),
    [(7.0, 'record the excitation "fast"'), (2.4, "no excitation tried")],
)
def test_an_experiment_that_would_not_decide_is_not_recommended(sigma: float, said: str):
    """Mutation: five sigma not asked of it."""
    rivals = ("dead_band@command", "coulomb_friction@m1")
    planned = NextExperiment("fast", Path("next.toml"), rivals, sigma, {"fast": sigma})
    assert said in next_sentence(planned)
    assert f"{sigma:.3g} sigma" in next_sentence(planned)


def test_the_improved_device_comes_first_where_the_answer_is_certain():
    """Mutation: the device offered where nothing is missing, or as certain where it is not."""
    (take,) = what_now(found(Verdict.IDENTIFIED, FRICTION), "runs/a.toml")
    assert take.startswith("take the improved device runs/a.toml")
    unsure = what_now(found(Verdict.UNKNOWN_PHYSICS, FRICTION), "runs/a.toml")
    assert not unsure[0].startswith("take")
    assert not any("a.toml" in s for s in what_now(found(Verdict.NOTHING_MISSING), "runs/a.toml"))
