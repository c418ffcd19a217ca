"""The diagnoses of the joints of a recording."""

from collections.abc import Mapping
from dataclasses import dataclass

from zwidth.diagnosis.answer.result import Diagnosis
from zwidth.shown import Shown


@dataclass(frozen=True, repr=False)
class JointAnswers(Shown):
    """answers: joint -> its diagnosis; left: joint -> a sentence on why it has none."""

    answers: Mapping[str, Diagnosis]
    left: Mapping[str, str]

    def __getitem__(self, joint: str) -> Diagnosis:
        """Return the diagnosis of a joint; raises KeyError with the reason if there is none."""
        if joint not in self.answers:
            raise KeyError(self.left.get(joint, f"no {joint!r} in {', '.join(self.answers)}"))
        return self.answers[joint]
