"""Which answer stands: with what changed, before held-out data, and beside what is left over."""

from dataclasses import dataclass, replace
from functools import partial

from zwidth.diagnosis.answer.adequacy import Adequacy, adequacy
from zwidth.diagnosis.answer.changes import Change, changing, outlived
from zwidth.diagnosis.answer.lost import knowing_losses
from zwidth.diagnosis.answer.second_look import named_only_whole, on_first_part, second_look
from zwidth.diagnosis.answer.verdict import Left, instead_of, left_over, unexplained
from zwidth.diagnosis.forces.unknown import Instead
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.mishaps import Say, attempt, isolated
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.selection.searched import (
    Searched,
    Searches,
    farther,
    next_believed,
    runs_freer,
    unnamed,
)
from zwidth.sim.device import Device


@dataclass(frozen=True)
class Stands:
    """The answer that stands, and the recordings as it knows them.

    found: on all that was searched; by: the same as held-out data may judge it, fitted to the first
    part where `found` had to be searched in all. sound: how it stands on held-out data; left: what
    it leaves; other: physics of no library in its place. halted: whether a person interrupted it.
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


def what_stands(
    device: Device, taken: Taken, found: Searched, search: Searches, say: Say
) -> Stands:
    """Return the answer that stands of what was searched; opens the held-out data.

    Where it does not explain them, what shows over a longer horizon is asked too, and then all that
    was recorded.
    """
    before = taken
    found, taken, changes, halted = _what_changes(device, found, taken, say)
    asked, taken = taken, _knowing_losses(taken, found)
    found, sound = standing(device, taken, found, say)
    left, other = _what_is_left(found, taken)
    if not found.interrupted and unexplained(found, left, other, sound):
        first, second = _both(found if found.far else farther(device, found, say), found)
        # Nothing is promised, so the better of two is said.
        if second is not None and runs_freer(second, first, taken.judge_by):
            say(f"better on held-out data: {second.final.model.label}")
            again, how = standing(device, taken, second, say)
            if again is second or not first.final.model.effects:  # and not refused itself
                first, sound = again, how
                left, other = _what_is_left(first, taken)
        found = first
    by, faults = found, taken.faults
    if taken.whole_unopened and named_only_whole(found, left, other, sound):
        with isolated("search", "all that was recorded"):
            again, beyond, note = second_look(found, left, taken.whole, search, say)
            if note is not None:
                by, faults = on_first_part(again), (*faults, note)
                taken = _knowing_losses(asked, by)
                sound = attempt("adequacy", "", partial(held_adequacy, device, by, taken))
            found, left = again, beyond
    if changes and not (changes := outlived(changes, found)):
        taken = _knowing_losses(before, found)  # a part of it, where something changes
    halted = halted or found.interrupted
    return Stands(found, by, taken, sound, left, other, changes, faults, halted)


def _both(asked: Searched, stood: Searched) -> tuple[Searched, Searched | None]:
    """What stood, knowing the longer horizon, and the answer of the other judge, None for none."""
    if asked.final is stood.final or asked.beside is None:
        return asked, asked.beside
    return asked.beside, asked


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
    say(f"{found.final.model.label} predicts the held-out data no better than without it: dropped")
    for other in next_believed(found):
        say(f"judging {other.final.model.label} on the held-out data")
        stands = attempt("adequacy", "", partial(held_adequacy, device, other, taken))
        if stands is not None and stands.useful:
            return other, stands
    bare = unnamed(found)
    return bare, attempt("adequacy", "", partial(held_adequacy, device, bare, taken))


def held_adequacy(device: Device, found: Searched, taken: Taken) -> Adequacy | None:
    """How the answer stands on held-out data."""
    return adequacy(Model(device), found.refit, found.final, found.judge, taken.judge_by)


def _what_is_left(found: Searched, taken: Taken) -> tuple[Left, Instead | None]:
    """What the final model leaves, and what of no library may stand in the place of its names."""
    left = attempt("detect", "what is left", partial(left_over, found, taken.whole))
    other: Instead | None = None
    with isolated("detect", "physics of no library in the place of what was named"):
        other = instead_of(found)
    return left or Left(0.0, ""), other
