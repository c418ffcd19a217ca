"""Marking one answer against its key.

At the limit: an effect is distinct if its computed separation from every rival is at least five
sigma; then it must be named first. Otherwise it must be in the class that was named: the finding
and its rivals within five sigma. A rival that merely contains the effect does not count, since the
simplest is meant (`Effect.contains`). An effect that moves the rig as another one does (a limit
that falls with speed by nothing) is that other one, too.

On rigs at full size: an effect must be found at its place, or be in a class that was named.

Everywhere: a finding is claimed alone if the answer names no rival within five sigma, or gives it a
probability of at least 0.9. If it then explains nothing that was concealed, it is a confident wrong
name. Every statement with a probability is kept, together with whether it is true.
"""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from zwidth.exam.strata import STRATA
from zwidth.sim.physics import contains
from zwidth.sim.place import of_label, place_at

APART = 5.0  # sigma
SAME = 1e-3  # sigma: no recording of any length tells these apart
SURE = 0.9  # probability from which on a finding is said with confidence
ANGLES = ("phase", "angle")


@dataclass(frozen=True)
class Marked:
    """One concealed effect: whether it is distinct, and was named first, at all, or in a class.

    inside: parameter -> whether its 95 % interval contains the truth, if it was found; errors:
    parameter -> relative error of its value.
    """

    effect: str
    at: str
    times_limit: float
    sigma: float
    apart: bool
    first: bool
    found: bool
    in_class: bool
    inside: Mapping[str, bool]
    errors: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def right(self) -> bool:
        """Whether the effect was found or, if not distinct, is in the class that was named."""
        return self.found if self.apart else self.in_class


@dataclass(frozen=True)
class Mark:
    """One answer. claims: findings that nothing concealed explains. first: first finding, if any.

    linear: of the device's masses, dampers and springs, parameter -> truth inside its interval.
    kind: of the stratum. alone: findings that stand alone -> whether each explains something.
    first_right: whether the first finding is a concealed effect at its place. adequate: what the
    answer says of itself, None if it does not. stated: (probability, whether it is so).
    """

    recording: str
    stratum: str
    verdict: str
    first: str
    effects: tuple[Marked, ...]
    claims: tuple[str, ...]
    outside: str
    linear: Mapping[str, bool]
    seconds: float
    core_seconds: float
    samples: int
    kind: str = "limit"
    alone: Mapping[str, bool] = field(default_factory=dict[str, bool])
    first_right: bool = False
    adequate: bool | None = None
    stated: tuple[tuple[float, bool], ...] = ()

    @property
    def all_named(self) -> bool:
        """Whether every concealed effect was found or is in a class named."""
        return all(e.in_class for e in self.effects)

    @property
    def right(self) -> bool:
        """Whether all that is concealed was named, and nothing else."""
        return self.all_named and not self.claims and not self.outside

    @property
    def first_alone(self) -> bool:
        """Whether the first finding stands alone."""
        return self.first in self.alone


def mark(key: Mapping[str, Any], answer: Mapping[str, Any], truth: Mapping[str, float]) -> Mark:
    """Return the mark; truth: linear parameters of the true device by name."""
    said: Mapping[str, Any] = answer["diagnosis"] or {}
    findings: Sequence[Mapping[str, Any]] = said.get("findings", ())
    seen = [*findings, *said.get("negligible", ())]  # no claims, but what is concealed may be there
    kind = STRATA[str(key["stratum"])].kind
    outside = key["outside"]["name"] if key["outside"] else ""
    # What is of another library is no effect to be named; beside a law there may be some.
    unnamed = bool(outside) and kind == "limit"
    hidden: Sequence[Mapping[str, Any]] = () if unnamed else key["hidden"]
    labels = [_label(f) for f in findings]
    classes = [named_class(f) for f in findings]
    named = [_label(f) for f in seen]
    effects = tuple(_marked(h, seen, named, [named_class(f) for f in seen]) for h in hidden)
    explained = {label for h in hidden for label in _names(h)}
    right = [bool(explained.intersection(group)) for group in classes]
    refit: Mapping[str, Any] = said.get("linear_refit", {})
    adequacy = said.get("adequacy")
    return Mark(
        str(key["recording"]),
        str(key["stratum"]),
        str(said.get("verdict", "error")),
        labels[0] if labels else "",
        effects,
        tuple(label for label, so in zip(labels, right, strict=True) if not so),
        outside,
        {k: _inside(refit[k], value) for k, value in truth.items() if k in refit},
        float(answer["seconds"]),
        float(answer["core_seconds"]),
        int(answer["samples"]),
        kind,
        {
            label: so
            for label, f, so in zip(labels, findings, right, strict=True)
            if stands_alone(f)
        },
        bool(labels) and labels[0] in explained,
        None if adequacy is None else bool(adequacy["adequate"]),
        tuple(_stated(findings, explained)),
    )


def stands_alone(finding: Mapping[str, Any]) -> bool:
    """Whether a finding is said with confidence.

    By its probability if it has one; otherwise, if no rival within five sigma does anything but
    contain it.
    """
    if (probability := finding.get("probability")) is not None:
        return float(probability) >= SURE
    near = {
        _label(r): float(r["separation_sigma"])
        for r in finding.get("rivals", ())
        if r["separation_sigma"] is not None
    }
    return stands_apart({"effect": finding["effect"], "at": finding["at"], "rivals": near})


def _stated(
    findings: Sequence[Mapping[str, Any]], explained: Collection[str]
) -> Iterator[tuple[float, bool]]:
    for finding in findings:
        for said in (finding, *finding.get("rivals", ())):
            if said.get("probability") is not None:
                yield float(said["probability"]), _label(said) in explained


def _label(entry: Mapping[str, Any]) -> str:
    return f"{entry['effect']}@{entry['at']}"


def _names(hidden: Mapping[str, Any]) -> list[str]:
    """effect@place of a concealed effect, then of those that move the rig as it does."""
    same = [rival for rival, distance in hidden.get("rivals", {}).items() if distance < SAME]
    return [_label(hidden), *same]


def named_class(finding: Mapping[str, Any]) -> set[str]:
    """Return effect@place of a finding and of its rivals within five sigma."""
    near = {
        _label(r)
        for r in finding.get("rivals", ())
        if r["separation_sigma"] is not None and r["separation_sigma"] < APART
    }
    return {_label(finding)} | near


def _marked(
    hidden: Mapping[str, Any],
    findings: Sequence[Mapping[str, Any]],
    labels: Sequence[str],
    classes: Sequence[set[str]],
) -> Marked:
    label, names = _label(hidden), set(_names(hidden))
    inside: dict[str, bool] = {}
    errors: dict[str, float] = {}
    if label in labels:
        estimates = findings[labels.index(label)]["parameters"]
        for name, value in hidden["values"].items():
            if name not in estimates:
                continue
            inside[name] = _inside(estimates[name], value, name in ANGLES)
            if value and estimates[name]["value"] is not None:
                errors[name] = float(estimates[name]["value"]) / value - 1.0
    return Marked(
        hidden["effect"],
        hidden["at"],
        float(hidden.get("times_limit", hidden["sigma"] / APART)),
        float(hidden["sigma"]),
        stands_apart(hidden),
        bool(labels) and labels[0] in names,
        not names.isdisjoint(labels),
        any(names & group for group in classes),
        inside,
        errors,
    )


def stands_apart(hidden: Mapping[str, Any]) -> bool:
    """Whether no rival comes within five sigma that does not merely contain the effect."""
    own = hidden["effect"], place_at(hidden["at"])
    for rival, distance in hidden.get("rivals", {}).items():
        if distance < APART and not contains(*of_label(rival), *own):
            return False
    return True


def _inside(estimate: Mapping[str, Any], value: float, angle: bool = False) -> bool:
    low, high = estimate["ci95"]
    if low is None or high is None or estimate["value"] is None:
        return False
    if angle:  # nearest turn
        value -= 2.0 * math.pi * round((value - estimate["value"]) / (2.0 * math.pi))
    return bool(low <= value <= high)


def linear_truth(device_chain: Any) -> dict[str, float]:
    """Return masses, dampers, springs of a chain by the names of `linear_refit`.

    And the gain, which is 1 and in a refit only where the device file leaves it open.
    """
    masses, dampers, spring, springs, links = device_chain
    found = {f"m{i + 1}": float(m) for i, m in enumerate(masses)}
    found |= {f"b{i + 1}": float(b) for i, b in enumerate(dampers)}
    found |= {f"k{i + 1}{i + 2}": float(k) for i, k in enumerate(springs)}
    found |= {f"b{i + 1}{i + 2}": float(b) for i, b in enumerate(links)}
    return found | {"k0": float(spring), "gain": 1.0}
