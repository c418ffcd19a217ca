"""The pipeline, from recordings to an answer, in the order of docs/diagnosis.md."""

from collections.abc import Sequence
from dataclasses import replace

from zwidth.diagnosis.account import keeping, stage
from zwidth.diagnosis.answer.answered import answered
from zwidth.diagnosis.answer.knowing_events import knowing_events
from zwidth.diagnosis.answer.result import Diagnosis
from zwidth.diagnosis.intake.take_in import Taken, not_diagnosed, take_in
from zwidth.diagnosis.learning.events import set_apart
from zwidth.diagnosis.mishaps import Say, collecting, debugging, silent
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError
from zwidth.diagnosis.selection.effort import NORMAL, Effort
from zwidth.diagnosis.selection.search import Moves
from zwidth.diagnosis.selection.searched import Searched, searched
from zwidth.sim.device import Device


def diagnose(
    device: Device,
    experiments: Sequence[Experiment],
    validate: Sequence[Experiment] | None = None,
    say: Say = silent,
    effort: Effort = NORMAL,
) -> Diagnosis:
    """Return why recordings differ from the simulation of a device.

    validate: recordings to judge by. By default the last 30 % of each recording are held out for
    this and opened once, at the end: to judge the answer, and to search for effects that only they
    show, which a fault then states. An unexpected error loses only the part in which it occurs
    (`Diagnosis.errors`). effort: how much the search may try. Raises ExperimentError if the
    recordings cannot be used with this device, and NotDiagnosed if an error prevents any answer.
    """
    with collecting(say) as mishaps, keeping() as account:
        with stage("reading the recordings"):
            taken = take_in(device, experiments, validate)
        account.ticks = sum(e.ticks for e in taken.fit_on)
        for fault in taken.faults:
            say(fault.sentence)
        say("refitting the linear parameters, then trying every effect")
        device = taken.device
        found = _sought(device, taken, say, effort)
        say("looking for one-time events (a hit, a slip, a jam)")
        with stage("events"):
            taken, found, events = knowing_events(taken, found, say)
        with stage("answering"):
            answer = answered(device, taken, found, mishaps, say, events)
        return replace(answer, cost=account.as_json())


def _sought(device: Device, taken: Taken, say: Say, effort: Effort) -> Searched:
    """The result of searching the recordings; without a refit there is no answer."""
    try:
        return searched(device, taken.fit_on, say, effort, Moves(apart=set_apart))
    except NoObserver as error:
        raise ExperimentError(str(error)) from error
    except Exception as error:
        if debugging():
            raise
        raise not_diagnosed("refit", error, taken.faults) from error
