"""The first screen of a report: one certainty, one figure of worth, and what to do."""

from dataclasses import replace
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
    Rival,
    Verdict,
)
from zwidth.diagnosis_report import improvement
from zwidth.diagnosis_summary import (
    doubtful,
    how_sure,
    next_sentence,
    title,
    what_now,
    whereabouts,
    worth,
)
from zwidth.sim.chain import make_chain

LEVEL = {"level": Estimate(0.03, 0.029, 0.031, "N m")}
FRICTION = Finding("coulomb_friction", "m1", LEVEL, 40.0, (), 0.99, with_richer=0.99)
FIT = HeldOut(3.0, 0.7, 0.03, 0.02)
SAME = HeldOut(0.031, 0.034, 0.034, 0.00018)
GRAVITY = Finding("gravity_pendulum", "m1", LEVEL, 9.2, (), 0.9999, with_richer=0.9999)


def found(verdict: Verdict, *findings: Finding, **more: Any) -> Diagnosis:
    """As much of a diagnosis as its first screen reads."""
    device = SimpleNamespace(chain=make_chain([1e-3], [0.0]))
    nothing: dict[str, Any] = {"adequacy": None, "next_experiment": None}
    nothing |= {"next_level": None, "learned": None, "free_run": FIT, "whole_runs": ()}
    nothing |= {"events": ()}
    values = {**nothing, "device": device, "headline": "h", **more}
    return cast("Diagnosis", SimpleNamespace(verdict=verdict, findings=findings, **values))


def test_the_title_names_what_is_missing_without_numbers():
    """Mutation: the headline with its intervals in the place of the title."""
    both = found(Verdict.IDENTIFIED, FRICTION, GRAVITY)
    assert title(both) == (
        "Missing: Coulomb friction at the motor and a gravity pendulum at the motor"
    )
    assert title(found(Verdict.IDENTIFIED, *[FRICTION] * 5)).endswith("and 2 more")
    assert title(found(Verdict.NOTHING_MISSING)) == "This recording shows no missing physics"


def test_a_law_that_includes_an_effect_stands_in_its_place():
    """Mutation: the effect is named in the title."""
    law = SimpleNamespace(as_json=lambda: {"absorbed": ["coulomb_friction at m1"]})
    one = found(Verdict.UNKNOWN_PHYSICS, FRICTION, learned=law)
    assert title(one) == "Physics is missing that is not in the library of effects"
    both = found(Verdict.UNKNOWN_PHYSICS, FRICTION, GRAVITY, learned=law)
    assert title(both).endswith("besides a gravity pendulum at the motor")


def test_how_sure_is_said_by_the_least_certain_effect():
    """Mutation: the first effect's figures, or the largest."""
    said = how_sure(found(Verdict.IDENTIFIED, FRICTION, GRAVITY), "s")
    assert said == (
        "the probability among all models tried is 99 % (95 % is required); the least certain"
        " effect improves the fit by 9 sigma (5 are required)"
    )
    sound = SimpleNamespace(explained=0.95)
    half = how_sure(found(Verdict.UNKNOWN_PHYSICS, FRICTION, adequacy=sound), "s")
    assert half == "s. The named effects explain 95 % of the error"
    said = found(Verdict.UNKNOWN_PHYSICS, FRICTION, adequacy=sound, headline="95 % of the error")
    assert how_sure(said, "s") == "s"


def test_the_probability_on_the_first_screen_is_the_one_that_decides():
    """A limit that may also fall with speed. Mutation: the probability of the limit alone."""
    limit = replace(FRICTION, probability=0.811, with_richer=0.982)
    assert how_sure(found(Verdict.IDENTIFIED, limit), "s").startswith(
        "the probability among all models tried is 98.2 %, counting richer forms of the effect"
        " (95 % is required)"
    )


def run(before: float, after: float, **more: float) -> Any:
    """A whole run with its errors, as far as a first screen reads it."""
    errors = {"before": before, "refit": before, "after": after, **more}
    return SimpleNamespace(errors=errors, output="position_m1", recording="r2", unit="rad")


def test_what_it_is_worth_is_one_figure_before_and_after():
    """Mutation: before and after exchanged; an infinite error printed as a number."""
    assert worth(found(Verdict.IDENTIFIED, FRICTION)).startswith(
        "error of short free runs on held-out data: 3 % of the motion with the found effects, 70 %"
        " with the refit alone; noise alone would cause 2 %"
    )
    assert "70 % of the motion after the refit, 300 % with the device file" in worth(
        found(Verdict.LINEAR_PARAMETERS)
    )
    lost = HeldOut(3.0, 0.7, float("inf"), 0.02)
    assert "do not simulate with it" in worth(found(Verdict.IDENTIFIED, FRICTION, free_run=lost))
    short = HeldOut(3.0, 0.0, 0.0, 0.0)
    assert worth(found(Verdict.IDENTIFIED, FRICTION, free_run=short)).startswith("there is too")


def test_a_law_without_a_name_is_worth_what_its_own_free_runs_show():
    """The same figures as in the headline. Mutation: those of the names alone."""
    law = SimpleNamespace(law=SimpleNamespace(after=0.0071), names=SimpleNamespace(after=0.011))
    fit = HeldOut(3.0, 0.7, 0.011, 0.02)
    one = found(Verdict.UNKNOWN_PHYSICS, FRICTION, learned=law, free_run=fit)
    assert worth(one).startswith(
        "error of short free runs on held-out data: 0.71 % of the motion with the law that has no"
        " name, 1.1 % without it, 70 % with the refit alone; noise alone would cause 2 %"
    )
    assert doubtful(one) == []


def test_an_answer_that_simulates_no_better_says_so_in_every_line():
    """Report and terminal agree. Mutation: the device offered because the verdict is certain."""
    same = found(Verdict.IDENTIFIED, FRICTION, free_run=SAME)
    assert "3.4 % of the motion with the found effects, no better than with the refit alone" in (
        worth(same)
    )
    assert "worse than with the device file (3.1 %)" in worth(same)
    assert "no better than with the refit alone" in improvement(same)
    now, _ = what_now(same, "runs/a.toml")
    assert now.startswith("do not rely on the improved device runs/a.toml yet: its free runs on")
    refit = found(Verdict.LINEAR_PARAMETERS, free_run=replace(SAME, before=0.034))
    assert "no better than with the device file (3.4 %)" in worth(refit)
    assert "no better than with the device file (3.4 %)" in improvement(refit)
    assert what_now(refit, "runs/a.toml")[0].startswith("do not rely on")


def test_a_whole_run_that_got_worse_is_said_in_every_line():
    """Mutations: an improvement, or a law that makes good what the names spoil, taken for one."""
    worse = found(Verdict.IDENTIFIED, FRICTION, whole_runs=(run(2.0, 1.0), run(2.6e-3, 3.1e-3)))
    said = (
        "over the whole run, the error of the position of m1 in r2 is 3.1 mrad, and 2.6 mrad with"
        " the device file: it got worse"
    )
    assert said in worth(worse)
    assert said in improvement(worse)
    assert "over a whole run it is worse" in what_now(worse, "runs/a.toml")[0]
    lost = found(Verdict.IDENTIFIED, FRICTION, whole_runs=(run(2.0, float("inf")),))
    assert "without bound" in worth(lost)
    for runs in ((run(2.0, 1.0),), (run(2.0, 3.0, law=1.0),)):
        good = found(Verdict.IDENTIFIED, FRICTION, whole_runs=runs)
        assert doubtful(good) == []
        assert "worse" not in worth(good) + improvement(good)


def test_where_the_refit_fails_is_said_only_if_no_effect_says_it_better():
    """Mutation: 'no force stands out' printed under the verdict 'identified'."""
    located = SimpleNamespace(sentence="no force stands out from the noise")
    assert whereabouts(found(Verdict.IDENTIFIED, FRICTION, located=located)) == ""
    assert whereabouts(found(Verdict.CONFUSABLE, FRICTION, located=located)) == ""
    for kept in (
        found(Verdict.NOTHING_MISSING, located=located),
        found(Verdict.UNKNOWN_PHYSICS, FRICTION, located=located),
    ):
        assert whereabouts(kept) == located.sentence


def test_how_sure_does_not_repeat_what_is_missing():
    """Mutation: the verdict's sentence in both lines."""
    said = "a force at m2 would gain a chi-square of 264"
    headline = f"Something is missing that is not in the library of effects: {said}"
    one = found(Verdict.UNKNOWN_PHYSICS, headline=headline)
    assert how_sure(one, said) == "no effect of the library explains it"
    half = found(Verdict.UNKNOWN_PHYSICS, FRICTION, headline=headline,
                 adequacy=SimpleNamespace(explained=0.95))  # fmt: skip
    assert how_sure(half, said) == "The named effects explain 95 % of the error"
    assert how_sure(found(Verdict.UNKNOWN_PHYSICS, headline="h"), said) == said


@pytest.mark.parametrize(
    ("sigma", "said"),
    [(7.0, 'record the excitation "fast"'), (2.4, "none of the excitations that were tried")],
)
def test_an_experiment_that_would_not_decide_is_not_recommended(sigma: float, said: str):
    """Mutation: five sigma not asked of it."""
    rivals = ("dead_band@command", "coulomb_friction@m1")
    planned = NextExperiment("fast", Path("next.toml"), rivals, sigma, {"fast": sigma})
    assert said in next_sentence(planned)
    assert f"{sigma:.3g} sigma" in next_sentence(planned)


def test_the_improved_device_comes_first_where_the_answer_is_certain():
    """Mutation: the device offered where nothing is missing, or as certain where it is not."""
    take, _ = what_now(found(Verdict.IDENTIFIED, FRICTION), "runs/a.toml")
    assert take.startswith("use the improved device runs/a.toml")
    unsure = what_now(found(Verdict.UNKNOWN_PHYSICS, FRICTION), "runs/a.toml")
    assert not unsure[0].startswith("use the improved")
    assert not any("a.toml" in s for s in what_now(found(Verdict.NOTHING_MISSING), "runs/a.toml"))


RIVAL = Rival("dead_band", "command", 2.0, 0.3)
LIKELY = replace(FRICTION, with_richer=0.7)


@pytest.mark.parametrize(
    ("one", "events", "said"),
    [
        (replace(LIKELY, rivals=(RIVAL,)), (), "Coulomb friction from a dead band in the command:"),
        (LIKELY, (), "no single rival makes Coulomb friction doubtful"),
        (FRICTION, ("a hit", "a hit"), "record again without touching the device"),
        (FRICTION, (), "a law outside the library"),
    ],
)
def test_where_no_experiment_was_planned_it_is_said_what_to_record(
    one: Finding, events: tuple[str, ...], said: str
):
    """Mutations: nothing; the same for every doubt; also where an experiment was planned."""
    unsure = found(Verdict.CONFUSABLE, one, events=events)
    *_, last = what_now(unsure, "runs/a.toml")
    assert said in last
    labels = ("dead_band@command", "coulomb_friction@m1")
    planned = NextExperiment("fast", Path("next.toml"), labels, 7.0, {"fast": 7.0})
    *_, last = what_now(found(Verdict.CONFUSABLE, one, next_experiment=planned), "runs/a.toml")
    assert last.startswith("to tell a dead band in the command from Coulomb friction at m1, record")


def test_a_certain_answer_needs_no_further_recording():
    """Mutation: said where parameters alone differ."""
    for verdict in (Verdict.IDENTIFIED, Verdict.UNKNOWN_PHYSICS):
        assert "record" in what_now(found(verdict, FRICTION), "runs/a.toml")[-1]
    assert len(what_now(found(Verdict.LINEAR_PARAMETERS), "runs/a.toml")) == 1
