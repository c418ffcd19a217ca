"""From what a search found to the answer: located, judged, and all that is to be said of it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from zwidth.diagnosis.answer.adequacy import Adequacy, wander
from zwidth.diagnosis.answer.augmented import all_smooth, augmented
from zwidth.diagnosis.answer.cautions import cautions
from zwidth.diagnosis.answer.changes import Change, outlived
from zwidth.diagnosis.answer.consequence import may_be_nothing, weighed
from zwidth.diagnosis.answer.events import Event
from zwidth.diagnosis.answer.findings import all_findings, linear, upper_bounds
from zwidth.diagnosis.answer.headline import Answer, headline
from zwidth.diagnosis.answer.held_out import held_out
from zwidth.diagnosis.answer.inverse import ForceError, force_errors
from zwidth.diagnosis.answer.learned import (
    BETTER,
    LearnedLaw,
    learned,
    learned_over_two,
    replacement,
)
from zwidth.diagnosis.answer.learned_surface import LearnedSurface
from zwidth.diagnosis.answer.levels import next_level
from zwidth.diagnosis.answer.result import (
    UNKNOWN_FIT,
    Diagnosis,
    Estimate,
    Finding,
    HeldOut,
    Residuals,
    Verdict,
)
from zwidth.diagnosis.answer.stands import Stands, what_stands
from zwidth.diagnosis.answer.verdict import Left, ends_badly, judged
from zwidth.diagnosis.answer.where import where
from zwidth.diagnosis.answer.whole_run import WholeRun, whole_runs
from zwidth.diagnosis.forces.locate import NOWHERE, Located, locate
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.mishaps import Mishaps, Say, attempt
from zwidth.diagnosis.selection.searched import Searched, Searches
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
Law = LearnedLaw | LearnedSurface
NAMED = (Verdict.IDENTIFIED, Verdict.CONFUSABLE)


def answered(
    device: Device,
    taken: Taken,
    found: Searched,
    mishaps: Mishaps,
    search: Searches,
    say: Say,
    events: tuple[Event, ...] = (),
) -> Diagnosis:
    """Return the answer; opens the held-out data. events: what happened in the recordings.

    An error in one part costs that part, and the verdict where it rests on it.
    """
    stands = what_stands(device, taken, found, search, say)
    seen = _seen(device, stands, say)
    found, taken, changes = stands.found, stands.taken, stands.changes
    seen_all = weighed(all_findings(device, taken, found), stands.by, taken.judge_by)
    negligible = tuple(f for f in seen_all if may_be_nothing(f))
    findings = tuple(f for f in seen_all if f not in negligible)
    intervals = partial(linear, device, found.final, taken.whole)
    refit = attempt("intervals", "linear parameters", intervals) or {}
    bounds = {} if findings else attempt("limits", "", partial(upper_bounds, found)) or {}
    ended = partial(ends_badly, stands.by.final, seen.runs, seen.forces)
    bad = attempt("adequacy", "", ended) or ""
    verdict, sentence = _verdict(stands, findings, refit, mishaps, seen.free, bad)
    to_tell = partial(next_level, found, taken.fit_on, taken.judge_by)
    level = attempt("next level", "", to_tell)
    record = ""
    error, noise = seen.free.after, seen.free.noise_floor
    if level is not None and verdict in NAMED and level.undecides(error, noise):
        names = " and ".join(f"{f.effect} at {f.at}" for f in findings)
        verdict, sentence = Verdict.UNDECIDED, level.undecided(names, error)
        record = level.advice
    law, rather, halted = _law(device, stands, seen, verdict, findings, mishaps, say)
    augment = partial(_augmented, taken, refit, found, findings)
    if verdict is Verdict.UNKNOWN_PHYSICS:
        findings = tuple(f.without_probability() for f in findings)
    if law is not None:
        if rather:
            verdict, sentence = Verdict.UNKNOWN_PHYSICS, _rather_than(findings, law)
            gone = law.curve.replaced
            findings = tuple(
                f.without_probability() for f in findings if f"{f.effect} at {f.at}" not in gone
            )
        if verdict is Verdict.UNDECIDED:  # what was said of chance no longer stands
            verdict = Verdict.UNKNOWN_PHYSICS
            sentence = "something is missing that no effect of the library explains"
        sentence = f"{sentence}; {law.sentence}"
        augment = partial(_augmented, taken, refit, law.found, findings)
        changes = outlived(changes, law.found)
        runs = attempt("whole runs", "", partial(_whole_runs, device, stands, law.found))
        seen = replace(seen, runs=runs or seen.runs)
    said = _to_be_said(stands, findings, refit, verdict, seen.free, mishaps, law)
    first = headline(replace(said, record=record, bad=bad))
    also = _changed_and_happened(verdict, changes, events)
    first, sentence = f"{first}{also}", f"{sentence}{also}"
    verdict, sentence = _with_faults(verdict, sentence, stands.faults)
    shape = (-1, len(taken.whole[0].outputs))
    residuals = Residuals(
        taken.whole[0].period, found.refit.white.reshape(shape), found.final.white.reshape(shape)
    )
    masses = device.chain.masses.size
    return Diagnosis(
        verdict, sentence, findings, refit,
        replace(seen.located, sentence=where(seen.located, findings, masses)),
        seen.one, seen.free, bounds, stands.faults,
        attempt("augmented device", "", augment) or device,
        residuals, found, taken.whole, stands.halted or halted, _facts(found, stands.left),
        errors=tuple(mishaps.found), left_out=taken.left_out, adequacy=stands.sound,
        whole_runs=seen.runs, force_errors=seen.forces, learned=law, headline=first,
        cautions=cautions(findings, seen.free, stands.sound, seen.runs), changes=changes,
        events=events, next_level=level,
        negligible=negligible,
    )  # fmt: skip


@dataclass(frozen=True)
class _Seen:
    """What recordings show of an answer: where it is, and errors of each kind."""

    located: Located
    one: HeldOut
    free: HeldOut
    runs: tuple[WholeRun, ...]
    forces: tuple[ForceError, ...]


def _seen(device: Device, stands: Stands, say: Say) -> _Seen:
    """Look where what is missing lies, and what the held-out data say."""
    found, by, taken = stands.found, stands.by, stands.taken
    say("locating where the device and the recording differ")
    located = attempt("locate", "", partial(locate, found.problem, found.refit)) or NOWHERE
    say("judging the result on data that was kept out of the fit")
    judge = partial(held_out, device, by, taken.judge_by)
    one, free = attempt("held out", "", judge) or (UNKNOWN_FIT, UNKNOWN_FIT)
    runs = attempt("whole runs", "", partial(_whole_runs, device, stands)) or ()
    inverse = partial(force_errors, device, by, taken.fit_on, taken.judge_by)
    forces = attempt("force errors", "", inverse) or ()
    return _Seen(located, one, free, runs, forces)


def _whole_runs(
    device: Device, stands: Stands, law: Searched | None = None
) -> tuple[WholeRun, ...]:
    taken = stands.taken
    return whole_runs(device, stands.by, taken.fit_on, taken.judge_by, law=law)


def _law(
    device: Device,
    stands: Stands,
    seen: _Seen,
    verdict: Verdict,
    findings: Sequence[Finding],
    mishaps: Mishaps,
    say: Say,
) -> tuple[Law | None, bool, bool]:
    """A law without a name, whether it is said rather than names, and whether it was interrupted.

    Where names do not explain it all, or chance alone explains what free runs err by; rather than
    several names, where it costs less than they do; and where one of the names is a ripple, which
    is one sine of whatever repeats.
    """
    by_chance = not findings and wander(seen.free.after, seen.free.noise_floor)
    strays = verdict is Verdict.UNDECIDED and by_chance and not mishaps.of(*DECISIVE)
    asked = partial(_law_of_no_name, device, stands.by, stands.taken, seen.free, say)
    if verdict is Verdict.UNKNOWN_PHYSICS or strays:
        law, halted = asked()
        return law, False, halted
    if verdict not in NAMED or _as_foretold(stands.sound, seen.free):
        return None, False, False
    law, halted = _law_for_names(device, stands.by, stands.taken, seen.free, say)
    if law is not None or halted or all(f.effect != "force_ripple" for f in findings):
        return law, law is not None, halted
    law, halted = asked(turns=True)
    return law, False, halted


def _as_foretold(sound: Adequacy | None, free: HeldOut) -> bool:
    """Whether free runs of names err no more than the noise beside them makes.

    A law in their place errs as much at least, and so by no less than it must to be worth having.
    Where forces of chance must explain a good part of the motion (`wander`), that says nothing.
    """
    if sound is None or not sound.sound or wander(free.after, free.noise_floor):
        return False
    return all(a.expected >= BETTER * a.error for a in sound.ahead)


def _to_be_said(
    stands: Stands,
    findings: Sequence[Finding],
    refit: dict[str, tuple[float, Estimate]],
    verdict: Verdict,
    free: HeldOut,
    mishaps: Mishaps,
    law: Law | None,
) -> Answer:
    """What the headline is made of."""
    device = stands.found.final.model.nominal
    masses = device.chain.masses.size
    gone = () if law is None else law.curve.replaced
    named = [f for f in findings if f"{f.effect} at {f.at}" not in gone]
    in_words = "" if law is None else law.headline(masses, device.rotary)
    return Answer(
        verdict, named, refit, stands.faults, masses, stands.left, stands.other, stands.sound,
        free, _lost(mishaps), in_words,
    )  # fmt: skip


def _changed_and_happened(
    verdict: Verdict, changes: Sequence[Change], events: Sequence[Event]
) -> str:
    """What is said beside an answer of what changed and what happened once."""
    said = ""
    if changes:
        also = "; ".join(change.sentence for change in changes)
        unknown = verdict is Verdict.UNKNOWN_PHYSICS  # what lacks a law may look as if it changed
        said = f"; as far as these laws hold, {also}" if unknown else f"; {also}"
    return "".join([said, *(f"; {event.sentence}" for event in events)])


def _law_of_no_name(
    device: Device, found: Searched, taken: Taken, free: HeldOut, say: Say, turns: bool = False
) -> tuple[Law | None, bool]:
    """A law that is learned where no name is adequate, and whether it was interrupted.

    turns: where names are, but one of them is a ripple, which is one sine of whatever repeats.
    """
    if found.interrupted:
        return None, True
    law: Law | None = None
    try:
        learning = partial(learned, device, found, taken.judge_by, free, say, turns)
        law = one = attempt("learn", "a law of no name", learning)
        if not turns:
            over_two = partial(learned_over_two, device, found, taken.judge_by, free, one, say)
            law = attempt("learn", "a law over two states", over_two) or one
    except KeyboardInterrupt:
        return law, True
    return law, False


def _law_for_names(
    device: Device, found: Searched, taken: Taken, free: HeldOut, say: Say
) -> tuple[Law | None, bool]:
    """A law that explains better what several names do, and whether it was interrupted."""
    if found.interrupted:
        return None, True
    try:
        asking = partial(replacement, device, found, taken.judge_by, free, say)
        return attempt("learn", "a law of no name", asking), False
    except KeyboardInterrupt:
        return None, True


def _rather_than(findings: Sequence[Finding], law: Law) -> str:
    """Say which names a law stands for."""
    gone = law.curve.replaced
    names = [n for f in findings if (n := f"{f.effect} at {f.at}") in gone]
    return (
        f"something is missing that no effect of the library explains: {' and '.join(names)}"
        f" together come near it, and one law over {law.over.rstrip(',')} explains it better"
    )


def _augmented(
    taken: Taken,
    refit: Mapping[str, tuple[float, Estimate]],
    found: Searched,
    findings: Sequence[Finding],
) -> Device:
    """The device with refitted parameters, with all that was found and how recordings are read.

    Readings that are taken before commands act delay it, where that is told from nothing.
    """
    model = found.final.model
    _, skew = refit.get("skew", (0.0, Estimate(0.0, 0.0, 0.0)))
    steps = [f for f in findings if f.effect == "encoder_step" and not model.has(f.effect)]
    return augmented(
        model, found.final.x, taken.whole[0].swing,
        smooth=all_smooth(taken.faults, taken.whole),
        folded=any(f.effect == "rectified_sensor" for f in findings),
        encoder_step=max((f.parameters["step"].value for f in steps), default=0.0),
        early=-skew.value if skew.upper < 0.0 else 0.0,
    )  # fmt: skip


def _verdict(
    stands: Stands,
    findings: tuple[Finding, ...],
    refit: dict[str, tuple[float, Estimate]],
    mishaps: Mishaps,
    free: HeldOut,
    bad: str,
) -> tuple[Verdict, str]:
    """As `judged`; undecided where an error took what the verdict rests on, which it then says."""
    verdict, sentence = judged(
        stands.found, findings, refit, stands.left, stands.other, stands.sound, free, bad
    )
    if lost := _lost(mishaps):
        verdict = Verdict.UNDECIDED
        sentence = f"an error prevented {lost}; from the rest: {sentence}"
    untried = list(dict.fromkeys(m.what.replace("@", " at ") for m in mishaps.of("candidates")))
    if untried:
        sentence += f"; {', '.join(untried)} could not be tried"
    return verdict, sentence


def _lost(mishaps: Mishaps) -> str:
    """What errors took from the verdict, "" for nothing."""
    return " and ".join(dict.fromkeys(WHAT_IS_LOST[m.stage] for m in mishaps.of(*DECISIVE)))


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
