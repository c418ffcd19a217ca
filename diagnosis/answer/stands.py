"""Chooses the final answer, with or without changes, by held-out data and unexplained forces."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from zwidth.diagnosis.account import stage
from zwidth.diagnosis.answer.adequacy import Adequacy, adequacy
from zwidth.diagnosis.answer.changes import Change, changing, outlived
from zwidth.diagnosis.answer.inverse import ForceError
from zwidth.diagnosis.answer.verdict import Left
from zwidth.diagnosis.answer.whole_run import WholeRun
from zwidth.diagnosis.fitting.descend import fit
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.fitting.uncertainty import inflation
from zwidth.diagnosis.forces.leftover import leftover
from zwidth.diagnosis.forces.locate import locate
from zwidth.diagnosis.forces.probes import instead_by_law
from zwidth.diagnosis.forces.unknown import Instead, instead, unknown
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.mishaps import Say, attempt, isolated
from zwidth.diagnosis.model.parameters import BENT, FACTORED, Model, effect_labels
from zwidth.diagnosis.noise.family import followed_by
from zwidth.diagnosis.noise.predictor import FINAL
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.lattice import losses
from zwidth.diagnosis.selection.hypothesis import EDGE
from zwidth.diagnosis.selection.searched import (
    Searched,
    farther,
    next_believed,
    runs_freer,
    searched_through,
    unnamed,
)
from zwidth.diagnosis.settings import FREE_FORCES, VERDICT
from zwidth.sim.device import Device
from zwidth.sim.physics import richer_at
from zwidth.sim.place import label_of, of_label

UNDETERMINED = (
    "the linear parameters predict the last part of the recordings only if they are fitted to it"
    " too, since the first part hardly excites what they decide there (as a chirp does), so no data"
    " are left to judge the answer; give a second recording with --validate"
)


@dataclass(frozen=True)
class Stands:
    """The final answer, and the recordings as it reads them.

    found: fitted to all data that were searched; by: the same answer, but fitted to the first part
    only if the search needed all data, so that held-out data may judge it. sound: its adequacy on
    held-out data; left: unexplained forces; other: unknown physics in place of effects. halted:
    whether a person interrupted the search.
    """

    found: Searched
    by: Searched
    taken: Taken
    sound: Adequacy | None
    left: Left
    other: Instead | None
    changes: tuple[Change, ...]
    faults: tuple[Fault, ...]
    halted: bool


def what_stands(device: Device, taken: Taken, found: Searched, say: Say) -> Stands:
    """Return the final answer of a search; opens the held-out data.

    If the answer does not explain these, effects over a longer horizon are tried too, and then all
    recorded data are searched; at once if one more effect explains what looks like an event there.
    """
    before, changes, halted = taken, (), found.interrupted
    if not halted:
        try:
            with stage("changes"):
                found, taken, changes = changing(device, found, taken, say)
        except KeyboardInterrupt:
            halted = True
    asked, taken = taken, _knowing_losses(taken, found)
    found, sound = standing(device, taken, found, say)
    say("checking what the answer leaves unexplained")
    left, other = _what_is_left(found, taken)
    there = Stands(found, found, taken, sound, left, other, changes, taken.faults, halted)
    if found.later:
        there = _all_searched(device, asked, there, say)
    named = there.found is not found
    if not (named or found.interrupted) and _unexplained(found, left, other, sound):
        there = _farther_stands(device, there, say)
        if named_only_whole(there.found, there.left, there.other, there.sound):
            there = _all_searched(device, asked, there, say)
    if changes and not (changes := outlived(changes, there.found)):
        there = replace(there, taken=_knowing_losses(before, there.found))  # was cut at the changes
    return replace(there, changes=changes, halted=halted or there.found.interrupted)


def _farther_stands(device: Device, before: Stands, say: Say) -> Stands:
    """The better of two answers on held-out data: as it was, and over a longer horizon."""
    stood, taken, sound = before.found, before.taken, before.sound
    left, other = before.left, before.other
    found = stood if stood.far else farther(device, stood, say)
    second = found.beside
    if found.final is not stood.final and second is not None:
        found, second = second, found  # the earlier answer, marked as `far`
    # Neither answer explains everything, so the better one is reported.
    if second is not None and runs_freer(second, found, taken.judge_by):
        say(f"this answer predicts held-out data better: {second.final.model.label}")
        again, how = standing(device, taken, second, say)
        if again is second or not found.final.model.effects:  # second was not rejected itself
            found, sound = again, how
            # An answer without effects must also leave nothing in one-step errors.
            own = found if found.final.model.effects else unnamed(found)
            left, other = _what_is_left(own, taken)
    return replace(before, found=found, by=found, sound=sound, left=left, other=other)


def _all_searched(device: Device, asked: Taken, before: Stands, say: Say) -> Stands:
    """The answer of a search of all recorded data if that names more (`second_look`).

    asked: the recordings without the commands that an answer calls lost.
    """
    if not before.taken.whole_unopened:
        return before
    with isolated("search", "all that was recorded"):
        whole = before.taken.whole
        again, left, note = second_look(before.found, before.left, whole, say)
        if note is None:
            return replace(before, found=again, left=left)
        by = on_first_part(again) if again.final.model.effects else again
        taken = _knowing_losses(asked, by)
        sound = attempt("adequacy", "", partial(held_adequacy, device, by, taken))
        if by is again and not (sound is not None and sound.sound):
            return before
        faults = (*before.faults, note)
        return replace(
            before, found=again, by=by, taken=taken, sound=sound, left=left, faults=faults
        )
    return before


def _unexplained(
    found: Searched, left: Left, other: Instead | None, sound: Adequacy | None
) -> bool:
    """Whether the named effects leave something of the recordings or of free runs unexplained."""
    named = bool(found.final.model.effects)
    fails = sound is not None and not (sound.adequate if named else sound.sound)
    return other is not None or left.matters(named) or fails


def standing(
    device: Device, taken: Taken, found: Searched, say: Say
) -> tuple[Searched, Adequacy | None]:
    """The answer and its adequacy; the next most likely answer if held-out data reject the first.

    If they reject every answer, one without effects is returned. A rejected answer costs less than
    the named one and stays its more likely rival, so the verdict is then never `identified`.
    """
    sound = attempt("adequacy", "", partial(held_adequacy, device, found, taken))
    if sound is None or sound.useful:
        return found, sound
    say(f"{found.final.model.label} does not improve the prediction of held-out data: dropped")
    for other in next_believed(found):
        say(f"judging {other.final.model.label} on the held-out data")
        stands = attempt("adequacy", "", partial(held_adequacy, device, other, taken))
        if stands is not None and stands.useful:
            return other, stands
    bare = unnamed(found)
    return bare, attempt("adequacy", "", partial(held_adequacy, device, bare, taken))


def held_adequacy(device: Device, found: Searched, taken: Taken) -> Adequacy | None:
    """How well the answer predicts held-out data."""
    return adequacy(Model(device), found.refit, found.final, found.judge, taken.judge_by)


def _what_is_left(found: Searched, taken: Taken) -> tuple[Left, Instead | None]:
    """Forces that the final model leaves, and unknown physics in place of its effects, or None."""
    with stage("what is left"):
        left = attempt("detect", "what is left", partial(left_over, found, taken.whole))
    other: Instead | None = None
    name = "unknown physics in place of the named effects"
    with stage("in place of names"), isolated("detect", name):
        other = instead_of(found)
    left = left or Left(0.0, "")
    if other is not None and not other.sure:
        return replace(left, hint=f"the law may be another one: {other.sentence}"), None
    return left, other


def left_over(found: Searched, acted: Sequence[Experiment]) -> Left:
    """Test the final residual for forces that depend on one state, and that repeat or drift.

    Then all data, including the held-out part, are tested for forces of free shape under observers
    that hide none of them. The answer keeps nothing of this; it only shows whether, say, a stop is
    first reached in held-out data.
    """
    wide = inflation(found.final.white)
    coloured = found.problem.observer.whitening is None
    share = VERDICT.left_coloured if coloured else VERDICT.left_white
    beside = share * max(found.refit.chi2 - found.final.chi2, 1.0)
    located = locate(found.problem, found.final)
    followed = [
        m for m in located.maps if m.against != "time" or m.gained > FREE_FORCES.over_time * wide
    ]
    top = max(followed, key=lambda m: m.gained, default=None)
    line = leftover(found.problem, found.final)
    if line.gained > max(line.chance * wide, 0.0 if top is None else top.gained):
        return Left(line.gained, line.sentence(found.final.model.nominal.rotary), beside=beside)
    if top is not None and top.gained > VERDICT.unnamed * wide:
        return Left(top.gained, located.sentence, beside=beside)
    try:
        free = unknown(acted, found.final)
    except NoObserver:  # no observer can follow the held-out data
        return Left(0.0, "")
    if free is not None and free.gained > VERDICT.unnamed * wide + 1.5 * free.unknowns:
        return Left(free.gained, free.sentence, True, beside)
    return Left(0.0, "")


def instead_of(found: Searched) -> Instead | None:
    """Return unknown physics that explains more than one effect does, or all together; or None."""
    if found.problem.observer.whitening is None:  # chosen by free runs
        return None
    final, effects = found.final, found.final.model.effects
    experiments = found.problem.experiments
    names = [f"{p.effect.name} at {p.at}" for p in effects]
    models = [
        (name, fit(found.problem, *final.model.less(final.x, i))) for i, name in enumerate(names)
    ]
    if len(effects) > 1:
        models.append((" and ".join(names), found.refit))
    asked = [
        instead(found.problem, final, without, experiments, name)
        for name, without in models
        if without.x.size < final.x.size
    ]
    asked.append(instead_by_law(found.problem, final))
    told = [a for a in asked if a is not None]
    return max(told, key=lambda a: (a.sure, a.gained), default=None)


def ends_badly(
    final: Fitted,
    runs: Sequence[WholeRun],
    forces: Sequence[ForceError],
    drawn: Callable[[], Iterable[Sequence[WholeRun]]] = tuple,
) -> str:
    """Say why the cheapest fit is not acceptable as an answer, "" if it is.

    It ended at the limit of its allowed distance from the device file; or it predicts the force
    that held-out motion needs, or a whole held-out run, worse than the refit. A whole run is one
    sample, so it must be worse than that of the refit with all parameters that are `drawn` from the
    uncertainty of the fit, too. (Of five masses with a friction that is hardly seen, the error was
    1.7 times that of the refit, and 1 to 3.5 times with 16 such parameters.)
    """
    for p, x in zip(final.model.linear, final.x.tolist(), strict=False):
        # A mass, a spring or the gain at either end, a damper at its upper one.
        ends = ("lower", "upper") if p.kind in FACTORED else ("upper",) if p.kind in BENT else ()
        if p.at_end(x, ends, EDGE):
            return f"the fit ends with {p.name} at the limit of its allowed range"
    if any(e.held_out for e in forces):
        times = _times_worse(forces, VERDICT.worse_force)
        what = "the force that the held-out motion needs"
    else:
        times = _times_worse(runs, VERDICT.worse_run)
        what = "a free run over all held-out data"
        if times and not all(_times_worse(those, VERDICT.worse_run) for those in drawn()):
            return ""
    if not times:
        return ""
    return f"{what} has an error {times:.3g} times as large as without the found effects"


def _times_worse(every: Sequence[WholeRun] | Sequence[ForceError], most: float) -> float:
    """How many times the refit's error an answer has where it is worst; 0 unless always `most`."""
    told = [(e.errors["after"], e.errors["refit"]) for e in every if e.held_out]
    if not told or not all(after > most * refit for after, refit in told):
        return 0.0
    return max(after / refit if refit else math.inf for after, refit in told)


def named_only_whole(
    found: Searched, left: Left, other: Instead | None, sound: Adequacy | None
) -> bool:
    """Whether a search of all recorded data may find effects that the first part does not show.

    That is if an unexplained force is left only in the complete data, or if free runs err more than
    noise predicts on held-out data but not on fitted data.
    """
    unnamed_force = left.whole and left.matters(bool(found.final.model.effects))
    fails_later = found.held and sound is not None and not sound.sound
    return (unnamed_force or fails_later) and other is None and not found.interrupted


def second_look(
    found: Searched, left: Left, acted: Sequence[Experiment], say: Say
) -> tuple[Searched, Left, Fault | None]:
    """Search all recorded data for effects that the first part does not show.

    A command may reach its limit only in the last seconds. An effect named then has no data left
    that judge it, and the returned fault states this. The earlier answer is returned, without a
    fault, if no new effect was named, a force is still left, an effect was lost, or the search was
    interrupted. If no effect is named either way and nothing is left, the linear parameters of all
    data are returned: a chirp excites the resonance that they decide only at its end.
    """
    say("held-out data show physics that the search missed: searching the whole recording")
    try:
        again = searched_through(found, acted)
        halted = again.interrupted
    except NoObserver:
        return found, left, None
    except KeyboardInterrupt:
        again, halted = found, True
    if halted:
        return replace(found, tried=replace(found.tried, interrupted=True)), left, None
    rotary = found.final.model.nominal.rotary
    known, labels = (effect_labels(s.final.model.effects) for s in (found, again))

    def akin(one: str, others: Sequence[str]) -> bool:
        within = any(one in _containing(o, rotary) for o in others)
        return one in others or within or bool({*others} & {*_containing(one, rotary)})

    new = [label for label in labels if not akin(label, known)]
    if not (new or known or labels):
        beyond = left_over(again, acted)
        note = Fault("held_out_used", UNDETERMINED, False, 0.0)
        return (found, left, None) if beyond.matters(named=False) else (again, beyond, note)
    if not new or not all(akin(label, labels) for label in known):
        return found, left, None
    beyond = left_over(again, acted)
    other = instead_of(again)
    if beyond.matters(named=True) or (other is not None and other.sure):
        return found, left, None
    names = " and ".join(label.replace("@", " at ") for label in new)
    sentence = (
        f"{names} could be found only by fitting the held-out data too, so no data are left to"
        " judge the answer; give a second recording with --validate"
    )
    return again, beyond, Fault("held_out_used", sentence, False, float(len(new)))


def _containing(label: str, rotary: bool) -> Iterator[str]:
    """The effects at the same place that contain this one."""
    return (label_of(effect.name, place) for effect, place in richer_at(*of_label(label), rotary))


def on_first_part(found: Searched) -> Searched:
    """The same models fitted to the first part of the recordings."""
    parts = [e.split()[0] for e in found.problem.experiments]
    there = Problem(parts, found.problem.observer, FINAL)
    refit, final = (fit(there, f.model, f.x) for f in (found.refit, found.final))
    return replace(found, problem=there, refit=refit, final=final)


def _knowing_losses(taken: Taken, found: Searched) -> Taken:
    """The same, with lost commands of the held-out recordings if the answer has such an effect."""
    lost = attempt("adequacy", "lost commands", partial(knowing_losses, found, taken.judge_by))
    return taken if lost is None else replace(taken, judge_by=tuple(lost))


def knowing_losses(found: Searched, judge_by: Sequence[Experiment]) -> list[Experiment]:
    """Return recordings with their lost commands, if the answer has such an effect.

    Which commands were lost is chance, which no model predicts and no free run should be judged by.
    Each must stand out by itself, by log odds of 3 beyond the rate; no parameter is changed.
    """
    final, observer = found.final, found.judge
    if not final.model.has("dropped_samples"):
        return list(judge_by)
    parts = found.problem.experiments
    followed = [_going_on(e, parts) for e in judge_by]
    device = final.model.acting(final.x)
    seen = [followed_by(device, final.model.seen(e, final.x), observer) for e in followed]
    started = [replace(e, motions=m.motions) for e, m in zip(followed, seen, strict=True)]
    problem = Problem(started, observer)
    there = replace(final, residual=problem.residual(final.model, final.x), samples=problem.samples)
    lost = losses(problem, there)
    return [replace(e, dropped=d) for e, d in zip(followed, lost, strict=True)]


def _going_on(e: Experiment, parts: Sequence[Experiment]) -> Experiment:
    """The rest of a recording, with the lost commands of its first part."""
    if e.before is None:
        return e
    command = e.before.command
    first = next((p for p in parts if np.array_equal(p.command, command)), None)
    return e if first is None else replace(e, before=replace(e.before, dropped=first.dropped))
