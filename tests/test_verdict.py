"""The verdict as a function of facts: a table of what each fact decides, beside all others."""

from dataclasses import replace
from typing import Any

import pytest

from zwidth.diagnosis.answer.result import Estimate, Finding, Rival, Verdict
from zwidth.diagnosis.answer.validate import UNKNOWN_FIT, Adequacy, Ahead, Held, HeldOut
from zwidth.diagnosis.answer.verdict import Facts, Law, Left, Reason, refuted, verdict
from zwidth.diagnosis.answer.whole_run import NextLevel
from zwidth.diagnosis.answer.words import sentence
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.settings import VERDICT
from zwidth.sim.predict import OVERFLOW

NAME = Finding("extra_mode", "m1", {}, 39.0, (), 0.52, (), 0.99)
RUN = Ahead(0.5, 1.0, 1.0, 2.0, 0.05, 0.1)
SOUND = Adequacy((RUN,), 0.5, 5.0, True, 40)
GOOD = HeldOut(0.32, 0.43, 0.02, 0.007)
FAR = replace(GOOD, after=0.19)
LEFT = Left(90.0, "a force")
LEVEL = NextLevel(2.0, "N", 0.3, 0.087, 0.003)
LAW = Law(False, (), "speed", "a law", "a law")
INSTEAD = replace(LAW, instead=True, replaced=("extra_mode at m1",))
HOLDS_FORWARDS = Held("backwards", "forwards", -9.0, True)
RIVAL, RICHER = Rival("hysteresis", "link12", 3.0), Rival("stribeck_friction", "m1", 1.0)
WRONG = Fault("command_sign", "the sign is wrong", True, -1.0)
MOVED = {"m1": (1.0, Estimate(1.2, 1.19, 1.21, "kg"))}


def of(*findings: Finding, **known: Any) -> Facts:
    return replace(Facts(findings, explained=1e4, adequacy=SOUND, free=GOOD), **known)


def runs(**changes: float) -> Adequacy:
    return replace(SOUND, ahead=(replace(RUN, **changes),))


@pytest.mark.parametrize(
    ("facts", "said", "reason"),
    [
        (of(NAME), Verdict.IDENTIFIED, Reason.NAMED),
        (of(), Verdict.NOTHING_MISSING, Reason.NOTHING),
        (of(refit=MOVED), Verdict.LINEAR_PARAMETERS, Reason.PARAMETERS),
        (of(refit={"jitter": MOVED["m1"], "zero_m1": MOVED["m1"]}),
         Verdict.NOTHING_MISSING, Reason.NOTHING),
        # left over: anything where nothing is named, a hundredth of what names explain beside them
        (of(left=LEFT), Verdict.UNKNOWN_PHYSICS, Reason.LEFT),
        (of(NAME, left=LEFT), Verdict.IDENTIFIED, Reason.NAMED),
        (of(NAME, left=LEFT, explained=8e3), Verdict.UNKNOWN_PHYSICS, Reason.LEFT),
        (of(NAME, left=LEFT, explained=8e3, coloured=True), Verdict.IDENTIFIED, Reason.NAMED),
        # held-out data
        (of(NAME, adequacy=None), Verdict.UNDECIDED, Reason.UNJUDGED),
        (of(adequacy=None, free=UNKNOWN_FIT), Verdict.NOTHING_MISSING, Reason.NOTHING),
        (of(NAME, adequacy=replace(SOUND, better=0.9)),
         Verdict.UNKNOWN_PHYSICS, Reason.NO_BETTER),
        (of(NAME, adequacy=runs(error=3.0)), Verdict.UNKNOWN_PHYSICS, Reason.ERRS),
        (of(adequacy=runs(error=3.0)), Verdict.UNKNOWN_PHYSICS, Reason.ERRS),
        (of(NAME, adequacy=runs(led=0.2)), Verdict.UNKNOWN_PHYSICS, Reason.FOLLOWS),
        (of(NAME, adequacy=runs(error=OVERFLOW)), Verdict.UNKNOWN_PHYSICS, Reason.RUNS_AWAY),
        (of(replace(NAME, regimes=(HOLDS_FORWARDS,))), Verdict.UNKNOWN_PHYSICS, Reason.REGIME),
        (of(NAME, free=FAR), Verdict.UNKNOWN_PHYSICS, Reason.DISTURBED),
        (of(free=FAR), Verdict.UNDECIDED, Reason.CHANCE),
        (of(NAME, free=replace(FAR, noise_floor=0.18)), Verdict.IDENTIFIED, Reason.NAMED),
        (of(NAME, free=HeldOut(0.32, 0.43, 0.767, 0.757)), Verdict.IDENTIFIED, Reason.NAMED),
        (of(NAME, free=UNKNOWN_FIT), Verdict.IDENTIFIED, Reason.NAMED),
        # what is no longer promised
        (of(NAME, free=replace(GOOD, after=0.04), level=LEVEL),
         Verdict.UNDECIDED, Reason.ONE_LEVEL),
        (of(NAME, free=replace(GOOD, after=0.002), level=LEVEL), Verdict.IDENTIFIED, Reason.NAMED),
        (of(replace(NAME, rivals=(RIVAL,))), Verdict.CONFUSABLE, Reason.RIVAL),
        (of(Finding("coulomb_friction", "m1", {}, 9.0, (RICHER,))),
         Verdict.IDENTIFIED, Reason.NAMED),
        (of(replace(NAME, with_richer=0.5)), Verdict.CONFUSABLE, Reason.IMPROBABLE),
        # a law of no name
        (of(NAME, law=LAW), Verdict.IDENTIFIED, Reason.NAMED),
        (of(NAME, law=INSTEAD), Verdict.UNKNOWN_PHYSICS, Reason.LAW),
        (of(free=FAR, law=LAW), Verdict.UNKNOWN_PHYSICS, Reason.CHANCE),
        # errors, then faults of the recording, before all
        (of(NAME, lost=("a part of the search",)), Verdict.UNDECIDED, Reason.NAMED),
        (of(NAME, faults=(WRONG,)), Verdict.RECORDING_FAULT, Reason.NAMED),
        (of(NAME, faults=(replace(WRONG, wrong=False),)), Verdict.IDENTIFIED, Reason.NAMED),
        (of(NAME, faults=(WRONG,), adequacy=None), Verdict.UNDECIDED, Reason.UNJUDGED),
    ],
)  # fmt: skip
def test_each_fact_decides(facts: Facts, said: Verdict, reason: Reason) -> None:
    """Mutations: the order of any two reasons; a threshold turned round."""
    decision = verdict(facts)
    assert (decision.verdict, decision.reason) == (said, reason)
    unexplained = said is Verdict.UNKNOWN_PHYSICS and reason not in (Reason.LAW, Reason.CHANCE)
    assert (refuted(facts) is not None) == unexplained


def test_no_odds_are_stated_where_no_hypothesis_is_adequate() -> None:
    """Nor a name that a law stands for. Mutation: the findings returned as they are."""
    (found,) = verdict(of(NAME, free=FAR)).findings
    assert (found.probability, found.with_richer) == (None, None)
    other = replace(NAME, at="m2")
    kept = verdict(of(NAME, other, law=INSTEAD)).findings
    assert [f.label for f in kept] == ["extra_mode at m2"]
    assert verdict(of(NAME)).findings == (NAME,)


def test_the_thresholds_are_those_of_the_settings() -> None:
    """Mutation: a number of its own in `verdict`."""
    strict = replace(VERDICT, probable=0.999)
    assert verdict(of(NAME), strict).reason is Reason.IMPROBABLE
    assert verdict(of(refit=MOVED), replace(VERDICT, apart_sigma=1e3)).reason is Reason.NOTHING
    few = replace(VERDICT, left_share=1e-3)
    assert verdict(of(NAME, left=LEFT), few).reason is Reason.LEFT


def test_disturbances_are_said_with_their_share_of_the_motion() -> None:
    """What a law of time and speed left on a rig, taken for a slow force by the noise model."""
    facts = of(NAME, free=FAR)
    words = sentence(facts, verdict(facts))
    assert "err 19 % of the motion" in words
    assert "43 % without" in words
