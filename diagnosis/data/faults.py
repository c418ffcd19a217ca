"""What intake says of recordings, as the stages after it and the answer need it."""

from collections.abc import Sequence
from dataclasses import dataclass

from zwidth.diagnosis.mishaps import Mishap, collecting, silent
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device

COMMAND = ("command",)


@dataclass(frozen=True)
class Fault:
    """Something about a recording. kind: a word; wrong: it makes the recording false as it is.

    value: what was seen, by kind; where channels are named, the factor that corrects these.
    recording: the name of the one that it is of, "" for all.
    """

    kind: str
    sentence: str
    wrong: bool
    value: float
    recording: str = ""
    channels: tuple[str, ...] = ()


@dataclass(frozen=True)
class Taken:
    """Recordings whole, the part of each to fit on, and what is to judge.

    faults: what is odd about them; folded: by which factor they are better folded out, or 1.
    whole_unopened: the held-out data are a part of them, and not other recordings. left_out: places
    of those that an error cost. misread: place in fit_on and fault of each correction that another
    way to read them does without; doubted: whether a recording to judge by is suspected. device:
    what they are of, its zeros as open as they leave them.
    """

    device: Device
    whole: tuple[Experiment, ...]
    fit_on: tuple[Experiment, ...]
    judge_by: tuple[Experiment, ...]
    faults: tuple[Fault, ...]
    folded: float
    whole_unopened: bool
    left_out: tuple[int, ...]
    misread: tuple[tuple[int, Fault], ...] = ()
    doubted: bool = False


class NotDiagnosed(Exception):
    """An error that leaves nothing to conclude; the message is a sentence that says so.

    faults, errors: what was known of the recordings before it, and what went wrong.
    """

    def __init__(
        self, sentence: str, faults: Sequence[Fault] = (), errors: Sequence[Mishap] = ()
    ) -> None:
        super().__init__(sentence)
        self.sentence, self.faults, self.errors = sentence, tuple(faults), tuple(errors)

    @classmethod
    def by(cls, stage: str, error: Exception, faults: Sequence[Fault] = ()) -> "NotDiagnosed":
        """Return the end of a diagnosis by an error in a stage that it cannot do without."""
        with collecting(silent) as mishaps:
            sentence = f"nothing can be concluded: {mishaps.keep(stage, '', error).sentence}"
            return cls(sentence, faults, mishaps.found)
