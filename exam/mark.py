"""Marking one answer against its key.

An effect stands apart where the computed separation from every rival is at least five sigma; there
it must be named first. Elsewhere it must stand in the class that was named: the finding and its
rivals within five sigma. A rival that merely contains the effect does not count: the simplest is
meant (`diagnosis.candidates.CONTAINED`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from zwidth.diagnosis.candidates import CONTAINED

APART = 5.0  # sigma
ANGLES = ("phase", "angle")


@dataclass(frozen=True)
class Marked:
    """One concealed effect: does it stand apart, was it named first or at all, or in the class.

    inside: parameter -> whether its 95 % interval holds the truth, where it was found.
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

    @property
    def right(self) -> bool:
        """What is asked: found, or in the class where no more can be told."""
        return self.found if self.apart else self.in_class


@dataclass(frozen=True)
class Mark:
    """One answer. claims: findings that nothing concealed explains. first: first finding, if any.

    linear: of the device's masses, dampers and springs, parameter -> truth inside its interval.
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


def mark(key: Mapping[str, Any], answer: Mapping[str, Any], truth: Mapping[str, float]) -> Mark:
    """Return the mark; truth: linear parameters of the true device by name."""
    said: Mapping[str, Any] = answer["diagnosis"] or {}
    findings: Sequence[Mapping[str, Any]] = said.get("findings", ())
    outside = key["outside"]["name"] if key["outside"] else ""
    hidden: Sequence[Mapping[str, Any]] = () if outside else key["hidden"]
    labels = [_label(f) for f in findings]
    classes = [named_class(f) for f in findings]
    effects = tuple(_marked(h, findings, labels, classes) for h in hidden)
    explained = {_label(h) for h in hidden}
    claims = tuple(
        label
        for label, group in zip(labels, classes, strict=True)
        if not explained.intersection(group)
    )
    refit: Mapping[str, Any] = said.get("linear_refit", {})
    linear = {k: _inside(refit[k], value) for k, value in truth.items() if k in refit}
    return Mark(
        str(key["recording"]),
        str(key["stratum"]),
        str(said.get("verdict", "error")),
        labels[0] if labels else "",
        effects,
        claims,
        outside,
        linear,
        float(answer["seconds"]),
        float(answer["core_seconds"]),
        int(answer["samples"]),
    )


def _label(entry: Mapping[str, Any]) -> str:
    return f"{entry['effect']}@{entry['at']}"


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
    label = _label(hidden)
    inside: dict[str, bool] = {}
    if label in labels:
        estimates = findings[labels.index(label)]["parameters"]
        for name, value in hidden["values"].items():
            if name in estimates:
                inside[name] = _inside(estimates[name], value, name in ANGLES)
    return Marked(
        hidden["effect"],
        hidden["at"],
        float(hidden["times_limit"]),
        float(hidden["sigma"]),
        stands_apart(hidden),
        bool(labels) and labels[0] == label,
        label in labels,
        any(label in group for group in classes),
        inside,
    )


def stands_apart(hidden: Mapping[str, Any]) -> bool:
    """Whether no rival comes within five sigma that does not merely contain the effect."""
    richer = CONTAINED.get(hidden["effect"], set())
    for rival, distance in hidden["rivals"].items():
        effect, _, at = rival.partition("@")
        contains = effect in richer and at in (hidden["at"], "ground")
        if distance < APART and not contains:
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
    """Return masses, dampers, springs of a chain by the names of `linear_refit`; gain is 1."""
    masses, dampers, spring, springs, links = device_chain
    found = {f"m{i + 1}": float(m) for i, m in enumerate(masses)}
    found |= {f"b{i + 1}": float(b) for i, b in enumerate(dampers)}
    found |= {f"k{i + 1}{i + 2}": float(k) for i, k in enumerate(springs)}
    found |= {f"b{i + 1}{i + 2}": float(b) for i, b in enumerate(links)}
    return found | {"k0": float(spring), "gain": 1.0}
