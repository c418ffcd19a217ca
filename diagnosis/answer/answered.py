"""Turns the result of the search into the answer: locates the difference and judges the model."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from zwidth.diagnosis.account import stage
from zwidth.diagnosis.answer.adequacy import BOOTSTRAPS, drawn_x
from zwidth.diagnosis.answer.augmented import improved
from zwidth.diagnosis.answer.band import with_band
from zwidth.diagnosis.answer.changes import Change, outlived
from zwidth.diagnosis.answer.consequence import may_be_nothing, weighed
from zwidth.diagnosis.answer.events import CONTACTS, Event
from zwidth.diagnosis.answer.findings import (
    all_findings,
    linear,
    linear_elsewhere,
    upper_bounds,
)
from zwidth.diagnosis.answer.held_out import held_out
from zwidth.diagnosis.answer.inverse import force_errors
from zwidth.diagnosis.answer.laws import LearnedLaw, LearnedSurface
from zwidth.diagnosis.answer.learned import Asked, beside_names, learned, learned_over_two
from zwidth.diagnosis.answer.levels import next_level
from zwidth.diagnosis.answer.posterior import with_posterior
from zwidth.diagnosis.answer.result import UNKNOWN_FIT, Diagnosis, Residuals, Verdict
from zwidth.diagnosis.answer.stands import Stands, ends_badly, what_stands
from zwidth.diagnosis.answer.verdict import NAMES_STAND, Facts, Reason, reason
from zwidth.diagnosis.answer.whole_run import WholeRun, whole_runs
from zwidth.diagnosis.answer.words import IF_RIGHT, cautions, headline, where, why
from zwidth.diagnosis.forces.locate import NOWHERE, locate
from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.learning.changing import WITH_LEVEL
from zwidth.diagnosis.mishaps import Mishaps, Say, attempt
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.searched import Searched
from zwidth.diagnosis.settings import VERDICT
from zwidth.sim.device import Device

# Stages without which there is no verdict, and what an error in each of them prevents.
WHAT_IS_LOST = {
    "search": "a part of the search",
    "detect": "the test for remaining forces",
    "separation": "the comparison with other effects",
    "held out": "the test on held-out data",
    "adequacy": "the test of how well the answer predicts",
    "regimes": "the test of where the named effects hold",
}


def answered(
    device: Device,
    taken: Taken,
    found: Searched,
    mishaps: Mishaps,
    say: Say,
    events: tuple[Event, ...] = (),
) -> Diagnosis:
    """Return the answer; opens the held-out data.

    If one part fails, the answer lacks that part, and the verdict if it depends on that part.
    """
    stands = what_stands(device, taken, found, say)
    found, by, taken, changes = stands.found, stands.by, stands.taken, stands.changes
    fitted, judge_by = taken.fit_on, taken.judge_by
    say("locating where the device and the recording differ")
    located = attempt("locate", "", partial(locate, found.problem, found.refit)) or NOWHERE
    say("judging the result on data that was kept out of the fit")
    judged = attempt("held out", "", partial(held_out, device, by, judge_by))
    one_step, free = judged or (UNKNOWN_FIT, UNKNOWN_FIT)
    whole = partial(whole_runs, device, by, fitted, judge_by)
    runs = attempt("whole runs", "", whole) or ()
    forces = attempt("force errors", "", partial(force_errors, device, by, fitted, judge_by)) or ()
    seen = weighed(all_findings(device, taken, found), by, judge_by)
    negligible = tuple(f for f in seen if may_be_nothing(f))
    findings = tuple(f for f in seen if f not in negligible)
    structures = partial(linear_elsewhere, found.tried)
    among = attempt("intervals", "over the structures", structures)
    intervals = partial(linear, device, found.final, taken.whole, among)
    refit = attempt("intervals", "linear parameters", intervals) or {}
    bounds = {} if findings else attempt("limits", "", partial(upper_bounds, found)) or {}
    drawn = partial(_drawn_runs, device, by, fitted, judge_by)
    bad = attempt("adequacy", "", partial(ends_badly, by.final, runs, forces, drawn)) or ""
    level = attempt("next level", "", partial(next_level, found, fitted, judge_by))
    lost = dict.fromkeys(WHAT_IS_LOST[m.stage] for m in mishaps.of(*WHAT_IS_LOST))
    facts = Facts(
        findings, refit, stands.left, stands.other, stands.sound, free, bad, level,
        lost=" and ".join(lost), faults=stands.faults, masses=device.chain.masses.size,
        contacts=sum(event.kind in CONTACTS for event in events),
        with_level=any(WITH_LEVEL in change.as_well for change in changes),
    )  # fmt: skip
    with stage("an unnamed law"):
        law, instead, halted = _law(device, stands, facts, say)
    facts = replace(facts, law=law, instead=instead)
    if reason(facts).verdict is Verdict.UNKNOWN_PHYSICS:
        # No fitted hypothesis is then true, so their shares are not probabilities.
        gone = law.curve.replaced if law is not None and instead else ()
        kept = (f for f in findings if f"{f.effect} at {f.at}" not in gone)
        findings = tuple(f.without_probability() for f in kept)
    said = found
    if law is not None:
        said = law.found
        changes = outlived(changes, law.found)
        runs = attempt("whole runs", "", partial(whole, law=law.found)) or runs
    changed, happened = _in_short(changes, events)
    unknown = reason(facts).verdict is Verdict.UNKNOWN_PHYSICS
    doubted = [f"{IF_RIGHT}{words}" for words in changed] if unknown else []
    also = happened if unknown else [*changed, *happened]
    untried = dict.fromkeys(m.what.replace("@", " at ") for m in mishaps.of("candidates"))
    untried = [f"{', '.join(untried)} could not be tried"] if untried else []
    refit_white, white = (
        f.white.reshape(-1, len(taken.whole[0].outputs)) for f in (found.refit, found.final)
    )
    better = attempt("augmented device", "", partial(improved, taken, said, refit, findings))
    better = better or device
    banded = partial(with_band, better, judge_by, said.judge.ratio, stands.faults)
    better = attempt("band", "", banded) or replace(better, band=None)
    known = attempt("posterior", "", partial(with_posterior, better, said.final))
    better = known or replace(better, posterior=None)
    hint = "" if reason(facts) is Reason.DOUBTED else stands.left.hint
    return Diagnosis(
        facts.verdict, "; ".join([why(facts), *untried]), findings, refit,
        replace(located, sentence=where(located, facts.masses)),
        one_step, free, bounds, stands.faults, better,
        Residuals(taken.whole[0].period, refit_white, white),
        found, taken.whole, stands.halted or halted, _facts(found, stands.left.gained),
        errors=tuple(mishaps.found), left_out=taken.left_out, adequacy=stands.sound,
        whole_runs=runs, force_errors=forces, learned=law,
        headline=headline(facts, also, doubted),
        cautions=(*cautions(findings, free, runs), *filter(None, [hint])), changes=changes,
        events=events, next_level=level, negligible=negligible,
    )  # fmt: skip


def _drawn_runs(
    device: Device, by: Searched, fitted: Sequence[Experiment], judge_by: Sequence[Experiment]
) -> Iterator[Sequence[WholeRun]]:
    """Whole runs of an answer whose parameters are drawn from their uncertainty."""
    random = np.random.default_rng(0)
    for _ in range(BOOTSTRAPS):
        other = replace(by.final, x=drawn_x(by.final, random))
        yield whole_runs(device, replace(by, final=other), fitted, judge_by)


def _in_short(changes: Sequence[Change], events: Sequence[Event]) -> tuple[list[str], list[str]]:
    """Say in short what changed, and what happened once: of each the first, the rest counted."""
    changed = [change.short for change in changes[:1]]
    if (more := len(changes) - 1) > 0:
        changed[0] += f", and {more} more parameter{'s' if more > 1 else ''} changed"
    happened = [event.short for event in events[:1]]
    if (more := len(events) - 1) > 0:
        happened[0] += f", and {more} more event{'s' if more > 1 else ''}"
    return changed, happened


def _law(
    device: Device, stands: Stands, facts: Facts, say: Say
) -> tuple[LearnedLaw | LearnedSurface | None, bool, bool]:
    """A learned law, whether it replaces named effects, and whether learning was interrupted.

    A law is learned if effects do not explain everything, or if only chance explains the error of
    free runs. If the named effects' free runs err more than noise predicts, a law is learned beside
    these effects or in their place.
    """
    by, because, free = stands.by, reason(facts), facts.free
    unnamed = because.verdict is Verdict.UNKNOWN_PHYSICS or because is Reason.STRAY
    named = because.verdict in NAMES_STAND and not _as_foretold(facts)
    if not (unnamed or named):
        return None, False, False
    if by.interrupted:
        return None, False, True
    law: LearnedLaw | LearnedSurface | None = None
    try:
        asked = Asked(device, by, stands.taken.judge_by, say)
        if named:
            told = attempt("learn", "an unnamed law", partial(beside_names, asked, free))
            law, instead = told or (None, False)
            return law, instead, False
        law = one = attempt("learn", "an unnamed law", partial(learned, asked, free))
        two = partial(learned_over_two, asked, free, one)
        law = attempt("learn", "a law over two states", two) or one
    except KeyboardInterrupt:
        return law, False, True
    return law, False, False


def _as_foretold(facts: Facts) -> bool:
    """Whether free runs of the named effects err no more than the noise predicts.

    A law in their place must lower the error by at least as much as any law. If random forces must
    explain a large part of the motion (`wander`), that comparison is useless.
    """
    sound = facts.sound
    if sound is None or not sound.sound or facts.strays:
        return False
    return all(a.expected >= VERDICT.worth_a_law * a.error for a in sound.ahead)


def _facts(found: Searched, left: float) -> dict[str, Any]:
    refit, final = found.refit, found.final
    return {
        "chi2_per_sample": {"refit": refit.chi2 / refit.samples,
                            "final": final.chi2 / final.samples},
        "samples": final.samples,
        "left_chi2": left,
        "explained_chi2": refit.chi2 - final.chi2,
        "comparisons": found.tried.fits,
    }  # fmt: skip
