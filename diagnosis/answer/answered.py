"""From what a search found to the answer: located, judged, and all that is to be said of it."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from zwidth.diagnosis.answer.adequacy import Adequacy, adequacy, freer, wander
from zwidth.diagnosis.answer.augmented import all_smooth, augmented
from zwidth.diagnosis.answer.cautions import cautions
from zwidth.diagnosis.answer.changes import Change, changing, outlived
from zwidth.diagnosis.answer.events import Event
from zwidth.diagnosis.answer.findings import all_findings, linear, upper_bounds
from zwidth.diagnosis.answer.headline import Answer, headline
from zwidth.diagnosis.answer.held_out import held_out
from zwidth.diagnosis.answer.inverse import force_errors
from zwidth.diagnosis.answer.learned import LearnedLaw, learned, replacement
from zwidth.diagnosis.answer.lost import knowing_losses
from zwidth.diagnosis.answer.result import (
    UNKNOWN_FIT,
    Diagnosis,
    Estimate,
    Finding,
    HeldOut,
    Residuals,
    Verdict,
)
from zwidth.diagnosis.answer.second_look import named_only_whole, on_first_part, second_look
from zwidth.diagnosis.answer.verdict import Left, instead_of, judged, left_over, unexplained
from zwidth.diagnosis.answer.where import where
from zwidth.diagnosis.answer.whole_run import whole_runs
from zwidth.diagnosis.forces.locate import NOWHERE, locate
from zwidth.diagnosis.forces.unknown import Instead
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.mishaps import Mishaps, Say, attempt, isolated
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.selection.effort import Effort
from zwidth.diagnosis.selection.searched import Searched, farther, next_believed, unnamed
from zwidth.sim.device import Device

# Stages without which no verdict stands, and what an error in them takes from it.
WHAT_IS_LOST = {
    "search": "a part of the search",
    "detect": "whether anything is left",
    "separation": "how well it can be told apart",
    "held out": "what the held-out data say",
    "adequacy": "how good the answer is",
    "regimes": "where it holds",
}
DECISIVE = tuple(WHAT_IS_LOST)
NAMED = (Verdict.IDENTIFIED, Verdict.CONFUSABLE)


def answered(
    device: Device,
    taken: Taken,
    found: Searched,
    mishaps: Mishaps,
    say: Say,
    effort: Effort,
    events: tuple[Event, ...] = (),
) -> Diagnosis:
    """Return the answer; opens the held-out data. events: what happened in the recordings.

    An error in one part costs that part, and the verdict where it rests on it.
    """
    before = taken
    found, taken, changes, halted = _what_changes(device, found, taken, say)
    asked, taken = taken, _knowing_losses(taken, found)
    found, sound = _standing(device, taken, found, say)
    left, other = _what_is_left(found, taken)
    asked_far = found.far or found.interrupted
    if not asked_far and unexplained(found, left, other, sound):
        again = farther(device, found, say)
        pair = (again.final, again.judge), (found.final, found.judge)
        if again.final is found.final:
            found = again
        elif freer(*pair, taken.judge_by):  # nothing is promised, so the better of two is said
            found, sound = _standing(device, taken, again, say)
            left, other = _what_is_left(found, taken)
        else:
            found = replace(found, far=True)
    by, faults = found, taken.faults
    if taken.whole_unopened and named_only_whole(found, left, other, sound):
        with isolated("search", "all that was recorded"):
            again, beyond, note = second_look(device, found, left, taken.whole, say, effort)
            if note is not None:
                by, faults = on_first_part(again), (*faults, note)
                taken = _knowing_losses(asked, by)
                sound = attempt("adequacy", "", partial(_adequacy, device, by, taken))
            found, left = again, beyond
    if changes and not (changes := outlived(changes, found)):
        taken = _knowing_losses(before, found)  # a part of it, where something changes
    say("locating")
    located = attempt("locate", "", partial(locate, found.problem, found.refit)) or NOWHERE
    say("held-out data")
    judge = partial(held_out, device, by, taken.judge_by)
    one, free = attempt("held out", "", judge) or (UNKNOWN_FIT, UNKNOWN_FIT)
    free_runs = partial(whole_runs, device, by, taken.fit_on, taken.judge_by)
    runs = attempt("whole runs", "", free_runs) or ()
    inverse = partial(force_errors, device, by, taken.fit_on, taken.judge_by)
    forces = attempt("force errors", "", inverse) or ()
    findings = all_findings(device, taken, found)
    intervals = partial(linear, device, found.final, taken.whole)
    refit = attempt("intervals", "linear parameters", intervals) or {}
    bounds = {} if findings else attempt("limits", "", partial(upper_bounds, found)) or {}
    augment = partial(_augmented, taken, found, findings)
    verdict, sentence = _verdict(found, findings, refit, left, other, mishaps, sound, free)
    law, stopped = None, found.interrupted or halted
    by_chance = not findings and wander(free.after, free.noise_floor)
    strays = verdict is Verdict.UNDECIDED and by_chance and not mishaps.of(*DECISIVE)
    if verdict is Verdict.UNKNOWN_PHYSICS or strays:
        findings = tuple(f.without_probability() for f in findings)
        law, stopped = _law_of_no_name(device, by, taken, free, say)
    elif verdict in NAMED:
        law, stopped = _law_for_names(device, by, taken, free, say)
        if law is not None:
            verdict, sentence = Verdict.UNKNOWN_PHYSICS, _rather_than(findings, law)
            findings = tuple(
                f.without_probability()
                for f in findings
                if f"{f.effect} at {f.at}" not in law.curve.replaced
            )
        elif any(f.effect == "force_ripple" for f in findings) and not stopped:
            law, stopped = _law_of_no_name(device, by, taken, free, say, turns=True)
    if law is not None:
        runs = attempt("whole runs", "", partial(free_runs, law=law.found)) or runs
        if verdict is Verdict.UNDECIDED:  # what was said of chance no longer stands
            verdict = Verdict.UNKNOWN_PHYSICS
            sentence = "something is missing that no effect of the library explains"
        sentence = f"{sentence}; {law.sentence}"
        augment = partial(_augmented, taken, law.found, findings)
        changes = outlived(changes, law.found)
    lost = " and ".join(dict.fromkeys(WHAT_IS_LOST[m.stage] for m in mishaps.of(*DECISIVE)))
    masses = device.chain.masses.size
    law_in_words = "" if law is None else law.headline(masses, device.rotary)
    gone = () if law is None else law.curve.replaced
    named = [f for f in findings if f"{f.effect} at {f.at}" not in gone]
    said_of = Answer(
        verdict, named, refit, faults, masses, left, other, sound, free, lost, law_in_words
    )
    first = headline(said_of)
    if changes:
        also = "; ".join(change.sentence for change in changes)
        if verdict is Verdict.UNKNOWN_PHYSICS:  # what lacks a law may look as if it changed
            also = f"as far as these laws hold, {also}"
        first, sentence = f"{first}; {also}", f"{sentence}; {also}"
    if events:
        happened = "; ".join(event.sentence for event in events)
        first, sentence = f"{first}; {happened}", f"{sentence}; {happened}"
    verdict, sentence = _with_faults(verdict, sentence, faults)
    located = replace(located, sentence=where(located, findings, masses))
    shape = (-1, len(taken.whole[0].outputs))
    residuals = Residuals(
        taken.whole[0].period, found.refit.white.reshape(shape), found.final.white.reshape(shape)
    )
    return Diagnosis(
        verdict, sentence, findings, refit, located, one, free, bounds, faults,
        attempt("augmented device", "", augment) or device,
        residuals, found, taken.whole, stopped, _facts(found, left),
        errors=tuple(mishaps.found), left_out=taken.left_out, adequacy=sound,
        whole_runs=runs, force_errors=forces, learned=law, headline=first,
        cautions=cautions(findings, free, sound, runs), changes=changes,
        events=events,
    )  # fmt: skip


def _what_changes(
    device: Device, found: Searched, taken: Taken, say: Say
) -> tuple[Searched, Taken, tuple[Change, ...], bool]:
    """As `changing`, and whether it was interrupted."""
    if found.interrupted:
        return found, taken, (), True
    try:
        return *changing(device, found, taken, say), False
    except KeyboardInterrupt:
        return found, taken, (), True


def _knowing_losses(taken: Taken, found: Searched) -> Taken:
    """Recordings with what was lost in those that judge, where the answer says that such are."""
    lost = attempt("adequacy", "lost commands", partial(knowing_losses, found, taken.judge_by))
    return taken if lost is None else replace(taken, judge_by=tuple(lost))


def _standing(
    device: Device, taken: Taken, found: Searched, say: Say
) -> tuple[Searched, Adequacy | None]:
    """What was found and how it stands; the next believed where held-out data speak against it.

    Nothing where they speak against that as well. What was refused costs less than what is named
    then, and stays beside it as the likelier rival: such an answer is never `identified`.
    """
    sound = attempt("adequacy", "", partial(_adequacy, device, found, taken))
    if sound is None or sound.useful:
        return found, sound
    say(f"{found.final.model.label} predicts held-out data no better than without: not named")
    for other in next_believed(found):
        say(f"asking the held-out data of {other.final.model.label}")
        stands = attempt("adequacy", "", partial(_adequacy, device, other, taken))
        if stands is not None and stands.useful:
            return other, stands
    bare = unnamed(found)
    return bare, attempt("adequacy", "", partial(_adequacy, device, bare, taken))


def _adequacy(device: Device, found: Searched, taken: Taken) -> Adequacy | None:
    """How the answer stands on held-out data."""
    return adequacy(Model(device), found.refit, found.final, found.judge, taken.judge_by)


def _what_is_left(found: Searched, taken: Taken) -> tuple[Left, Instead | None]:
    """What the final model leaves, and what of no library may stand in the place of its names."""
    left = attempt("detect", "what is left", partial(left_over, found, taken.whole))
    other: Instead | None = None
    with isolated("detect", "physics of no library in the place of what was named"):
        other = instead_of(found)
    return left or Left(0.0, ""), other


def _law_of_no_name(
    device: Device, found: Searched, taken: Taken, free: HeldOut, say: Say, turns: bool = False
) -> tuple[LearnedLaw | None, bool]:
    """A law that is learned where no name is adequate, and whether it was interrupted.

    turns: where names are, but one of them is a ripple, which is one sine of whatever repeats.
    """
    if found.interrupted:
        return None, True
    try:
        learning = partial(learned, device, found, taken.judge_by, free, say, turns)
        return attempt("learn", "a law of no name", learning), False
    except KeyboardInterrupt:
        return None, True


def _law_for_names(
    device: Device, found: Searched, taken: Taken, free: HeldOut, say: Say
) -> tuple[LearnedLaw | None, bool]:
    """A law that explains better what several names do, and whether it was interrupted."""
    if found.interrupted:
        return None, True
    try:
        asking = partial(replacement, device, found, taken.judge_by, free, say)
        return attempt("learn", "a law of no name", asking), False
    except KeyboardInterrupt:
        return None, True


def _rather_than(findings: Sequence[Finding], law: LearnedLaw) -> str:
    """Say which names a law stands for."""
    gone = law.curve.replaced
    names = [n for f in findings if (n := f"{f.effect} at {f.at}") in gone]
    return (
        f"something is missing that no effect of the library explains: {' and '.join(names)}"
        f" together come near it, and one law over {law.over.rstrip(',')} explains it better"
    )


def _augmented(taken: Taken, found: Searched, findings: Sequence[Finding]) -> Device:
    """The device with refitted parameters, with all that was found and how recordings are read."""
    model = found.final.model
    steps = [f for f in findings if f.effect == "encoder_step" and not model.has(f.effect)]
    return augmented(
        model, found.final.x, taken.whole[0].swing,
        smooth=all_smooth(taken.faults, taken.whole),
        folded=any(f.effect == "rectified_sensor" for f in findings),
        encoder_step=max((f.parameters["step"].value for f in steps), default=0.0),
    )  # fmt: skip


def _verdict(
    found: Searched,
    findings: tuple[Finding, ...],
    refit: dict[str, tuple[float, Estimate]],
    left: Left,
    other: Instead | None,
    mishaps: Mishaps,
    sound: Adequacy | None,
    free: HeldOut,
) -> tuple[Verdict, str]:
    """As `judged`; undecided where an error took what the verdict rests on, which it then says."""
    verdict, sentence = judged(found, findings, refit, left, other, sound, free)
    if mishaps.of(*DECISIVE):
        verdict = Verdict.UNDECIDED
        lost = " and ".join(dict.fromkeys(WHAT_IS_LOST[m.stage] for m in mishaps.of(*DECISIVE)))
        sentence = f"an error left out {lost}; from what was done, {sentence}"
    untried = list(dict.fromkeys(m.what.replace("@", " at ") for m in mishaps.of("candidates")))
    if untried:
        sentence += f"; {', '.join(untried)} could not be tried"
    return verdict, sentence


def _with_faults(verdict: Verdict, sentence: str, faults: Sequence[Fault]) -> tuple[Verdict, str]:
    """The verdict beside what is wrong about the recordings, which comes first."""
    said = "; ".join(f.sentence for f in faults if f.wrong)
    if not said:
        return verdict, sentence
    undecided = verdict is Verdict.UNDECIDED
    return (
        Verdict.UNDECIDED if undecided else Verdict.RECORDING_FAULT,
        f"{said}; with that corrected, {sentence}",
    )


def _facts(found: Searched, left: Left) -> dict[str, Any]:
    return {
        "chi2_per_sample": {"refit": found.refit.chi2 / found.refit.samples,
                            "final": found.final.chi2 / found.final.samples},
        "samples": found.final.samples,
        "left_chi2": left.gained,
        "explained_chi2": found.refit.chi2 - found.final.chi2,
        "comparisons": found.tried.fits,
    }  # fmt: skip
