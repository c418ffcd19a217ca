"""The updates on a growing log, one after another: as lines and as JSON."""

from dataclasses import dataclass, field
from typing import Any

from zwidth.watch.quick import Quick
from zwidth.watch.searched import Searched

GATE, QUICK, SEARCHED, NOTE, FINAL = "gate", "quick", "searched", "note", "final"


@dataclass(frozen=True)
class Update:
    """One update. kind: one of the words above; seconds, samples: length of the log.

    sentence: for people; values: further values of the JSON.
    """

    kind: str
    seconds: float
    samples: int
    sentence: str
    values: dict[str, Any] = field(default_factory=dict[str, Any])

    @property
    def line(self) -> str:
        """The update in one line."""
        return f"{self.seconds:8.1f} s  {self.kind:<8}  {self.sentence}"

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form, one line of the stream."""
        return {
            "kind": self.kind,
            "seconds": self.seconds,
            "samples": self.samples,
            "sentence": self.sentence,
            **self.values,
        }


def of_quick(found: Quick, last: Searched | None, seconds: float, samples: int) -> Update:
    """Return the update on a quick fit; last: the search of its structure, None if none."""
    parts = [found.sentence]
    if found.numbers:
        parts.append(found.numbers)
    if found.wall is not None:
        parts.append(found.wall.sentence)
    if last is None:
        parts.append("not searched yet")
    else:
        parts.append(f"the structure is that of the search over {last.seconds:.4g} s")
    verdict = "undecided" if last is None or not found.stands else last.verdict
    searched_to = None if last is None else last.seconds
    values = {"verdict": verdict, "searched_s": searched_to, **found.as_json()}
    values.pop("sentence")
    return Update(QUICK, seconds, samples, "; ".join(parts), values)


def of_search(found: Searched, effort: str, seconds: float, samples: int) -> Update:
    """Return the update on a search."""
    said = f"{found.verdict}: {found.headline} (all of the first {found.seconds:.4g} s, {effort})"
    values = {
        "verdict": found.verdict,
        "headline": found.headline,
        "explanation": found.sentence,
        "structure": sorted(f"{p.effect.name}@{p.at}" for p in found.model.effects),
        "searched_s": found.seconds,
        "searched_samples": found.samples,
        "effort": effort,
    }
    return Update(SEARCHED, seconds, samples, said, values)
