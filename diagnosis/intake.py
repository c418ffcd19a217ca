"""The recordings as the diagnosis takes them: sound or corrected, and what is left out of them."""

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import TypeVar

from zwidth.diagnosis.experiment import Experiment, ExperimentError
from zwidth.diagnosis.gate import Fault, corrected, examine
from zwidth.diagnosis.hold import smooth, was_smooth
from zwidth.diagnosis.mishaps import collecting, debugging, isolated, silent
from zwidth.diagnosis.rectified import unfolded
from zwidth.diagnosis.result import NotDiagnosed, Unanswered
from zwidth.sim.device import Device

Result = TypeVar("Result")


@dataclass(frozen=True)
class Taken:
    """Recordings whole, the part of each to fit on, and what is to judge.

    faults: what is odd about them; folded: by which factor they are better folded out, or 1.
    whole_unopened: the held-out data are a part of them, and not other recordings. left_out: places
    of those that an error cost.
    """

    whole: tuple[Experiment, ...]
    fit_on: tuple[Experiment, ...]
    judge_by: tuple[Experiment, ...]
    faults: tuple[Fault, ...]
    folded: float
    whole_unopened: bool
    left_out: tuple[int, ...]


def take_in(
    device: Device, experiments: Sequence[Experiment], validate: Sequence[Experiment] | None
) -> Taken:
    """Take recordings in: fold each out, correct it by its own faults, take it held or smooth.

    An error in one of several costs that one alone. Raises ExperimentError where the only one is of
    no use, and NotDiagnosed where an error leaves none.
    """

    def looked_at(e: Experiment) -> tuple[Experiment, float, list[Fault]]:
        one, factor = _folded_out(device, e)
        own = examine(device, [one])
        return corrected(one, own), factor, own

    passed = _each(experiments, looked_at)
    every = [fault for _, (_, _, faults) in passed for fault in faults]
    swing = max(e.swing for _, (e, _, _) in passed)  # one origin for all

    def acted(e: Experiment) -> tuple[Experiment, list[Fault]]:
        return _as_it_acted(device, replace(e, swing=swing))

    places = [place for place, _ in passed]
    taken = _each([one for _, (one, _, _) in passed], acted)
    notes = [note for _, (_, notes) in taken for note in notes]
    whole = tuple(e for _, (e, _) in taken)
    left_out = {*range(len(experiments))} - {places[k] for k, _ in taken}
    if validate is None:
        fit_on, judge_by = zip(*(e.split() for e in whole), strict=True)
    else:
        others = _each(validate, looked_at)
        every += [fault for _, (_, _, faults) in others for fault in faults if fault.wrong]
        judges = _each([e for _, (e, _, _) in others], acted)
        fit_on, judge_by = whole, tuple(e for _, (e, _) in judges)
    faults = [*sorted(every, key=lambda f: not f.wrong), *notes]
    folded = max(factor for _, (_, factor, _) in passed)
    return Taken(
        whole, fit_on, judge_by, tuple(faults), folded, validate is None, tuple(sorted(left_out))
    )


def not_diagnosed(stage: str, error: Exception, faults: Sequence[Fault] = ()) -> NotDiagnosed:
    """Return the end of a diagnosis by an error in a stage that nothing can be said without."""
    with collecting(silent) as mishaps:
        sentence = f"nothing can be concluded: {mishaps.keep(stage, '', error).sentence}"
        return NotDiagnosed(Unanswered(sentence, tuple(faults), tuple(mishaps.found)))


def _each(
    experiments: Sequence[Experiment], work: Callable[[Experiment], Result]
) -> list[tuple[int, Result]]:
    """What work gives on each recording, with its place; an error in one of several costs it."""
    found: list[tuple[int, Result]] = []
    for place, e in enumerate(experiments):
        try:
            with isolated("gate", e.name) if len(experiments) > 1 else nullcontext():
                found.append((place, work(e)))
        except ExperimentError:
            raise
        except Exception as error:
            if debugging():
                raise
            raise not_diagnosed("gate", error) from error
    if not found:
        raise not_diagnosed("gate", ExperimentError("no recording is left"))
    return found


def _folded_out(device: Device, e: Experiment) -> tuple[Experiment, float]:
    """Fold out what a sensor reported as absolute values; by which factor that is better, or 1."""
    if any(p.effect.name == "rectified_sensor" for p in device.physics):
        return e, 1.0
    tried = unfolded(device, e)
    return (e, 1.0) if tried is None else (tried.experiment, tried.factor)


def _as_it_acted(device: Device, e: Experiment) -> tuple[Experiment, list[Fault]]:
    """Take a command as smooth between samples where that explains the motion much better.

    Or where the device file says that it is.
    """
    if device.interface.command_hold == "smooth":
        return smooth(e), []
    factor = was_smooth(device, e)
    if factor is None:
        return e, []
    sentence = (
        f"the command of {e.name} explains the motion {factor:.3g} times better as a signal"
        " that is smooth between its samples than as one that is held, and is taken so"
    )
    return smooth(e), [Fault("smooth_command", sentence, False, factor, e.name)]
