"""From what a search found to the answer, stage after stage.

    changes        what differs between or within recordings
    losses         commands that were lost in held-out data
    standing       held-out data are opened; names that they speak against are not given
    other judge    the answer of the other horizon, where this one does not explain the recordings
    whole          all that was recorded is searched, where its first part names less
    shown          what recordings show of the answer: where the misfit is, errors of each kind
    law            a law of no name, where names do not explain the recordings, or badly
    verdict        decided once, of all these facts

An error in one stage costs that stage, and the verdict where it rests on it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from zwidth.diagnosis.answer.augmented import all_smooth, augmented
from zwidth.diagnosis.answer.changes import Change, changing, outlived
from zwidth.diagnosis.answer.events import Event
from zwidth.diagnosis.answer.findings import all_findings, linear, upper_bounds
from zwidth.diagnosis.answer.inverse import ForceError, force_errors
from zwidth.diagnosis.answer.learned import LearnedLaw, learned, learned_over_two, replacement
from zwidth.diagnosis.answer.learned_surface import LearnedSurface
from zwidth.diagnosis.answer.result import Diagnosis, Finding, Residuals, Verdict
from zwidth.diagnosis.answer.validate import UNKNOWN_FIT, Adequacy, HeldOut, adequacy, held_out
from zwidth.diagnosis.answer.verdict import (
    CONCLUDED,
    NOTHING_LEFT,
    Facts,
    Law,
    Left,
    Reason,
    matters,
    reason_of,
    refuted,
    verdict,
)
from zwidth.diagnosis.answer.whole_run import NextLevel, WholeRun, next_level, whole_runs
from zwidth.diagnosis.answer.words import cautions, headline, sentence, where
from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.fitting.uncertainty import inflation
from zwidth.diagnosis.forces.leftover import leftover
from zwidth.diagnosis.forces.locate import NOWHERE, Located, locate
from zwidth.diagnosis.forces.unknown import TOUCHED, unknown
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.mishaps import Mishaps, Say, attempt, isolated
from zwidth.diagnosis.model.parameters import Model, effect_labels
from zwidth.diagnosis.noise.beginning import begun, begun_as
from zwidth.diagnosis.noise.predictor import FINAL
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.lattice import losses
from zwidth.diagnosis.selection.searched import (
    Searched,
    Searches,
    farther,
    next_believed,
    runs_freer,
    unnamed,
)
from zwidth.diagnosis.settings import VERDICT
from zwidth.sim.device import Device
from zwidth.sim.physics import richer_at
from zwidth.sim.place import label_of, of_label

# Stages without which no verdict stands, and what an error in them takes from it.
WHAT_IS_LOST = {
    "search": "a part of the search",
    "detect": "whether anything is left",
    "separation": "how well it can be told apart",
    "held out": "what the held-out data say",
    "adequacy": "how good the answer is",
    "regimes": "where it holds",
}
Learned = LearnedLaw | LearnedSurface


@dataclass(frozen=True)
class Stands:
    """The answer that stands, and the recordings as it knows them.

    found: on all that was searched; by: the same as held-out data may judge it, fitted to the first
    part where `found` had to be searched in all. sound: how it stands on held-out data; left: what
    it leaves. halted: whether a person interrupted it.
    """

    found: Searched
    by: Searched
    taken: Taken
    sound: Adequacy | None = None
    left: Left = NOTHING_LEFT
    changes: tuple[Change, ...] = ()
    faults: tuple[Fault, ...] = ()
    halted: bool = False

    @property
    def facts(self) -> Facts:
        """What is known of it before anything is shown: its names count, and not their figures."""
        names = [label.split("@") for label in effect_labels(self.found.final.model.effects)]
        findings = tuple(Finding(effect, at, {}, np.nan, ()) for effect, at in names)
        return replace(_of_search(self.found), findings=findings, left=self.left,
                       adequacy=self.sound)  # fmt: skip


def answered(
    device: Device,
    taken: Taken,
    found: Searched,
    mishaps: Mishaps,
    search: Searches,
    say: Say,
    events: tuple[Event, ...] = (),
) -> Diagnosis:
    """Return the answer; opens the held-out data. events: what happened in the recordings."""
    stands = what_stands(device, taken, found, search, say)
    shown = _shown(device, stands, say)
    facts, level = _facts(device, stands, shown, mishaps)
    law, halted = _law(device, stands, facts, say)
    facts = replace(facts, law=_in_words(device, stands, law))
    decision = verdict(facts)
    found, taken, changes, best = stands.found, stands.taken, stands.changes, stands.found
    if law is not None:
        best = law.learned.found
        changes = outlived(changes, best)
        runs = attempt("whole runs", "", partial(_whole_runs, device, stands, best))
        shown = replace(shown, runs=runs or shown.runs)
    also = _changed_and_happened(decision.physics, changes, events)
    augment = partial(_augmented, taken, best, decision.findings)
    bounds = {} if facts.findings else attempt("limits", "", partial(upper_bounds, found)) or {}
    shape = (-1, len(taken.whole[0].outputs))
    return Diagnosis(
        decision.verdict, sentence(facts, decision) + also, decision.findings, dict(facts.refit),
        replace(shown.located, sentence=where(shown.located)), shown.one, shown.free, bounds,
        stands.faults, attempt("augmented device", "", augment) or device,
        Residuals(
            taken.whole[0].period, found.refit.white.reshape(shape),
            found.final.white.reshape(shape),
        ),
        found, taken.whole, stands.halted or halted, _figures(found, stands.left),
        errors=tuple(mishaps.found), left_out=taken.left_out, adequacy=stands.sound,
        whole_runs=shown.runs, force_errors=shown.forces, learned=law and law.learned,
        headline=headline(facts, decision, device.chain.masses.size) + also,
        cautions=cautions(bool(facts.findings), shown.free, stands.sound, shown.runs),
        changes=changes, events=events, next_level=level,
    )  # fmt: skip


def what_stands(
    device: Device, taken: Taken, found: Searched, search: Searches, say: Say
) -> Stands:
    """Return the answer that stands of what was searched; opens the held-out data.

    Where it does not explain them, what shows over a longer horizon is asked too, and then all that
    was recorded.
    """
    before = taken
    found, asked, changes, halted = _what_changes(device, found, taken, say)
    at = Stands(found, found, asked, changes=changes, faults=asked.faults, halted=halted)
    at = _judged_by_held_out(device, replace(at, taken=_knowing_losses(asked, found)), say)
    at = _of_other_judge(device, at, say)
    at = _of_whole(device, at, asked, search, say)
    if changes and not (changes := outlived(changes, at.found)):
        # a part of it, where something changes
        at = replace(at, taken=_knowing_losses(before, at.found))
    return replace(at, changes=changes, halted=halted or at.found.interrupted)


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


def knowing_losses(found: Searched, judge_by: Sequence[Experiment]) -> list[Experiment]:
    """Return recordings with the commands that were lost in them, where the answer has such.

    Which ones were lost is chance: no model foretells it, and no free run is judged by it. Each
    stands out alone, by log odds of 3 beyond the rate; no parameter is touched.
    """
    final, observer = found.final, found.judge
    if not final.model.has("dropped_samples"):
        return list(judge_by)
    parts = found.problem.experiments
    followed = [_going_on(e, parts) for e in judge_by]
    device = final.model.acting(final.x)
    seen = [begun(device, final.model.seen(e, final.x), observer) for e in followed]
    started = [begun_as(e, mine) for e, mine in zip(followed, seen, strict=True)]
    problem = Problem(started, observer)
    there = replace(final, residual=problem.residual(final.model, final.x), samples=problem.samples)
    lost = losses(problem, there)
    return [replace(e, dropped=d) for e, d in zip(followed, lost, strict=True)]


def _going_on(e: Experiment, parts: Sequence[Experiment]) -> Experiment:
    """The rest of a recording, which knows what was lost in its first part."""
    if e.before is None:
        return e
    command = e.before.command
    first = next((p for p in parts if np.array_equal(p.command, command)), None)
    return e if first is None else replace(e, before=replace(e.before, dropped=first.dropped))


def _judged_by_held_out(device: Device, at: Stands, say: Say) -> Stands:
    """The answer that held-out data leave, how it stands, and what it leaves."""
    found, sound = standing(device, at.taken, at.found, say)
    return replace(at, found=found, by=found, sound=sound, left=_what_is_left(found, at.taken))


def standing(
    device: Device, taken: Taken, found: Searched, say: Say
) -> tuple[Searched, Adequacy | None]:
    """What was found and how it stands; the next believed where held-out data speak against it.

    Nothing where they speak against that as well. What was refused costs less than what is named
    then, and stays beside it as the likelier rival: such an answer is never `identified`.
    """
    sound = attempt("adequacy", "", partial(held_adequacy, device, found, taken))
    if sound is None or sound.useful:
        return found, sound
    say(f"{found.final.model.label} predicts held-out data no better than without: not named")
    for other in next_believed(found):
        say(f"asking the held-out data of {other.final.model.label}")
        stands = attempt("adequacy", "", partial(held_adequacy, device, other, taken))
        if stands is not None and stands.useful:
            return other, stands
    bare = unnamed(found)
    return bare, attempt("adequacy", "", partial(held_adequacy, device, bare, taken))


def held_adequacy(device: Device, found: Searched, taken: Taken) -> Adequacy | None:
    """How the answer stands on held-out data."""
    return adequacy(Model(device), found.refit, found.final, found.judge, taken.judge_by)


def _what_is_left(found: Searched, taken: Taken) -> Left:
    left = attempt("detect", "what is left", partial(left_over, found, taken.whole))
    return left or NOTHING_LEFT


def left_over(found: Searched, acted: Sequence[Experiment]) -> Left:
    """Hold the final residual against forces that follow one state, and that repeat or sway.

    Then all that was recorded, held-out data too, against forces of free shape under observers that
    hide none: nothing of that is kept, and a stop may first be hit in what was held out.
    """
    wide = inflation(found.final.white)
    located = locate(found.problem, found.final)
    followed = [m for m in located.maps if m.against != "time" or m.gained > TOUCHED * wide]
    top = max((m.gained for m in followed), default=0.0)
    line = leftover(found.problem, found.final)
    if line.gained > max(line.chance * wide, top):
        return Left(line.gained, line.sentence(found.final.model.nominal.rotary))
    if top > VERDICT.left_chi2 * wide:
        return Left(top, located.sentence)
    try:
        free = unknown(acted, found.final)
    except NoObserver:  # no observer follows what was held out
        return NOTHING_LEFT
    if free is None or free.gained <= VERDICT.left_chi2 * wide + 1.5 * free.unknowns:
        return NOTHING_LEFT
    return Left(free.gained, free.sentence, True)


def _of_other_judge(device: Device, at: Stands, say: Say) -> Stands:
    """The better of the answers of two horizons, where nothing is promised.

    Laws that differ in the next sample by little can differ by much in where the motion ends. The
    one that held-out data prefer stands, unless they refuse it itself and the other names anything.
    """
    if at.found.interrupted or refuted(at.facts) is None:
        return at
    asked = at.found if at.found.far else farther(device, at.found, say)
    first, second = asked, asked.beside
    if asked.final is not at.found.final and asked.beside is not None:
        first, second = asked.beside, asked
    at = replace(at, found=first, by=first)
    if second is None or not runs_freer(second, first, at.taken.judge_by):
        return at
    say(f"freer on held-out data: {second.final.model.label}")
    again, sound = standing(device, at.taken, second, say)
    if again is not second and first.final.model.effects:  # which was refused itself
        return at
    return replace(at, found=again, by=again, sound=sound, left=_what_is_left(again, at.taken))


def _of_whole(device: Device, at: Stands, asked: Taken, search: Searches, say: Say) -> Stands:
    """The answer of all that was recorded, where that may name what its first part does not.

    A command may meet its limit in the last seconds only. What has a name then was named with the
    data that were to judge it, which a note says. asked: recordings without what was lost in them.
    """
    if not (at.taken.whole_unopened and named_only_whole(at)):
        return at
    with isolated("search", "all that was recorded"):
        again, left, note = second_look(at.found, at.left, at.taken.whole, search, say)
        if note is None:
            return replace(at, found=again, by=again, left=left)
        by = on_first_part(again)
        taken = _knowing_losses(asked, by)
        sound = attempt("adequacy", "", partial(held_adequacy, device, by, taken))
        return replace(
            at, found=again, by=by, taken=taken, sound=sound, left=left, faults=(*at.faults, note)
        )
    return at


def named_only_whole(at: Stands) -> bool:
    """Whether a search of all that was recorded may name what the first part of it does not.

    A force without a name is left in all of it, or free runs err farther than noise makes them on
    what was held out, and on what was fitted do not.
    """
    facts = at.facts
    named = bool(facts.findings)
    unnamed = at.left.whole and matters(at.left, facts.explained, facts.coloured, named)
    fails_later = at.found.held and at.sound is not None and not at.sound.sound
    return (unnamed or fails_later) and not at.found.interrupted


def second_look(
    found: Searched, left: Left, acted: Sequence[Experiment], search: Searches, say: Say
) -> tuple[Searched, Left, Fault | None]:
    """Search all that was recorded.

    What was found before is returned, without a note, where nothing new has a name, something is
    still left, a name is lost, or it was interrupted, which it then says.
    """
    say("what was held out shows more than was named: all that was recorded is searched")
    try:
        again = search(acted)
    except NoObserver:
        return found, left, None
    except KeyboardInterrupt:
        return _interrupted(found), left, None
    if again.interrupted:
        return _interrupted(found), left, None
    rotary = found.final.model.nominal.rotary
    known, labels = (effect_labels(s.final.model.effects) for s in (found, again))

    def akin(one: str, others: Sequence[str]) -> bool:
        richer = {one, *_containing(one, rotary)}
        return bool(richer & {*others}) or any(one in _containing(o, rotary) for o in others)

    new = [label for label in labels if not akin(label, known)]
    if not new or not all(akin(label, labels) for label in known):
        return found, left, None
    beyond, known_of = left_over(again, acted), _of_search(again)
    if matters(beyond, known_of.explained, known_of.coloured, named=True):
        return found, left, None
    names = " and ".join(label.replace("@", " at ") for label in new)
    note = (
        f"{names} could be named only with the held-out data, which therefore do not judge it;"
        " give a second recording by --validate"
    )
    return again, beyond, Fault("held_out_used", note, False, float(len(new)))


def on_first_part(found: Searched) -> Searched:
    """The same models fitted to the first part, as far as that determines them."""
    parts = [e.split()[0] for e in found.problem.experiments]
    there = Problem(parts, found.problem.observer, FINAL)
    refit, final = (there.fit(f.model, f.x) for f in (found.refit, found.final))
    return replace(found, problem=there, refit=refit, final=final)


def _interrupted(found: Searched) -> Searched:
    return replace(found, tried=replace(found.tried, interrupted=True))


def _containing(label: str, rotary: bool) -> Iterator[str]:
    """The effects that contain one, where it is."""
    for effect, place in richer_at(*of_label(label), rotary):
        yield label_of(effect.name, place)


def _of_search(found: Searched) -> Facts:
    """What a search says of how much its names explain."""
    return Facts(
        explained=found.refit.chi2 - found.final.chi2,
        coloured=found.problem.observer.whitening is None,
    )


@dataclass(frozen=True)
class _Shown:
    """What recordings show of an answer: where the misfit is, and errors of each kind."""

    located: Located
    one: HeldOut
    free: HeldOut
    runs: tuple[WholeRun, ...]
    forces: tuple[ForceError, ...]


def _shown(device: Device, stands: Stands, say: Say) -> _Shown:
    found, by, taken = stands.found, stands.by, stands.taken
    say("locating")
    located = attempt("locate", "", partial(locate, found.problem, found.refit)) or NOWHERE
    say("held-out data")
    judge = partial(held_out, device, by, taken.judge_by)
    one, free = attempt("held out", "", judge) or (UNKNOWN_FIT, UNKNOWN_FIT)
    runs = attempt("whole runs", "", partial(_whole_runs, device, stands)) or ()
    inverse = partial(force_errors, device, by, taken.fit_on, taken.judge_by)
    forces = attempt("force errors", "", inverse) or ()
    return _Shown(located, one, free, runs, forces)


def _whole_runs(
    device: Device, stands: Stands, law: Searched | None = None
) -> tuple[WholeRun, ...]:
    taken = stands.taken
    return whole_runs(device, stands.by, taken.fit_on, taken.judge_by, law=law)


def _facts(
    device: Device, stands: Stands, shown: _Shown, mishaps: Mishaps
) -> tuple[Facts, NextLevel | None]:
    """What a verdict rests on, but for a law; and which level of the command would tell more."""
    found, taken = stands.found, stands.taken
    findings = all_findings(device, taken, found)
    refit = attempt(
        "intervals", "linear parameters", partial(linear, device, found.final, taken.whole)
    )
    level = attempt("next level", "", partial(next_level, found, taken.fit_on, taken.judge_by))
    lost = dict.fromkeys(WHAT_IS_LOST[m.stage] for m in mishaps.of(*WHAT_IS_LOST))
    untried = dict.fromkeys(m.what.replace("@", " at ") for m in mishaps.of("candidates"))
    facts = replace(
        stands.facts, findings=findings, refit=refit or {}, free=shown.free, level=level,
        faults=stands.faults, lost=tuple(lost), untried=tuple(untried),
    )  # fmt: skip
    return facts, level


@dataclass(frozen=True)
class _Learned:
    """A law of no name, and whether it is the answer rather than several names."""

    learned: Learned
    instead: bool


def _law(device: Device, stands: Stands, facts: Facts, say: Say) -> tuple[_Learned | None, bool]:
    """A law without a name, and whether learning it was interrupted.

    Where names do not explain it all, or chance alone explains what free runs err by; rather than
    several names, where it costs less than they do; and where one of the names is a ripple, which
    is one sine of whatever repeats.
    """
    reason, _ = reason_of(facts)
    if facts.lost or reason in (Reason.UNJUDGED, Reason.ONE_LEVEL):
        return None, False
    kept: list[Learned] = []
    by, judge_by = stands.by, stands.taken.judge_by

    def keep(learn: Callable[..., Learned | None], what: str, *rest: Any) -> Learned | None:
        law = attempt("learn", what, partial(learn, device, by, judge_by, facts.free, *rest))
        kept.extend([] if law is None else [law])
        return law

    if by.interrupted:
        return None, True
    instead = False
    try:
        if reason not in CONCLUDED or reason is Reason.CHANCE:
            one = keep(learned, "a law of no name", say)
            keep(learned_over_two, "a law over two states", one, say)
        elif facts.findings:
            instead = keep(replacement, "a law of no name", say) is not None
            if not instead and any(f.effect == "force_ripple" for f in facts.findings):
                keep(learned, "a law of no name", say, True)
    except KeyboardInterrupt:
        return (_Learned(kept[-1], instead) if kept else None), True
    return (_Learned(kept[-1], instead) if kept else None), False


def _in_words(device: Device, stands: Stands, law: _Learned | None) -> Law | None:
    if law is None:
        return None
    one = law.learned
    first = one.headline(device.chain.masses.size, device.rotary)
    return Law(law.instead, tuple(one.curve.replaced), one.over.rstrip(","), one.sentence, first)


def _changed_and_happened(
    physics: Verdict, changes: Sequence[Change], events: Sequence[Event]
) -> str:
    """What is said beside an answer of what changed and what happened once."""
    also = "; ".join(change.sentence for change in changes)
    if also and physics is Verdict.UNKNOWN_PHYSICS:  # what lacks a law may look as if it changed
        also = f"as far as these laws hold, {also}"
    return "".join(f"; {said}" for said in (also, *(event.sentence for event in events)) if said)


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


def _figures(found: Searched, left: Left) -> dict[str, Any]:
    return {
        "chi2_per_sample": {"refit": found.refit.chi2 / found.refit.samples,
                            "final": found.final.chi2 / found.final.samples},
        "samples": found.final.samples,
        "left_chi2": left.gained,
        "explained_chi2": found.refit.chi2 - found.final.chi2,
        "comparisons": found.tried.fits,
    }  # fmt: skip
