"""All that was recorded, searched where its first part names less than is seen in the whole."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from zwidth.diagnosis.answer.adequacy import Adequacy
from zwidth.diagnosis.answer.verdict import Left, instead_of, left_over, matters
from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.forces.unknown import Instead
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.mishaps import Say
from zwidth.diagnosis.model.parameters import effect_labels
from zwidth.diagnosis.noise.predictor import FINAL
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.searched import Searched, Searches
from zwidth.sim.physics import richer_at
from zwidth.sim.place import label_of, of_label


def named_only_whole(
    found: Searched, left: Left, other: Instead | None, sound: Adequacy | None
) -> bool:
    """Whether a search of all that was recorded may name what the first part of it does not.

    A force without a name is left in all of it, or free runs err farther than noise makes them on
    what was held out, and on what was fitted do not.
    """
    unnamed = left.whole and matters(found, left, bool(found.final.model.effects))
    fails_later = found.held and sound is not None and not sound.sound
    return (unnamed or fails_later) and other is None and not found.interrupted


def second_look(
    found: Searched, left: Left, acted: Sequence[Experiment], search: Searches, say: Say
) -> tuple[Searched, Left, Fault | None]:
    """Search all that was recorded, where a force is seen there that has no name in the first part.

    A command may meet its limit in the last seconds only. What has a name then was named with the
    data that were to judge it, which the note says. What was found before is returned, without a
    note, where nothing new has a name, something is still left, a name is lost, or it was
    interrupted, which it then says.
    """
    say("the held-out data show more than was found: searching all of the recording")
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
        within = [o for o in others if one in _containing(o, rotary)]
        return one in others or bool(within) or bool({*others} & {*_containing(one, rotary)})

    new = [label for label in labels if not akin(label, known)]
    if not new or not all(akin(label, labels) for label in known):
        return found, left, None
    beyond = left_over(again, acted)
    if matters(again, beyond, named=True) or instead_of(again) is not None:
        return found, left, None
    names = " and ".join(label.replace("@", " at ") for label in new)
    sentence = (
        f"{names} could be named only with the held-out data, which therefore do not judge it;"
        " give a second recording by --validate"
    )
    return again, beyond, Fault("held_out_used", sentence, False, float(len(new)))


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
