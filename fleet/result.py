"""The result for a fleet, as values and as the JSON of `zwidth diagnose`."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.fleet.grouping import places_by
from zwidth.fleet.history import DRIFT, Change, date_of
from zwidth.fleet.listing import Listed
from zwidth.fleet.odd import Odd
from zwidth.fleet.quick import Quick
from zwidth.fleet.reasons import FAULTS, Reason, in_words
from zwidth.fleet.spread import Spread
from zwidth.fleet.structure import Structure
from zwidth.shown import Shown, Valued
from zwidth.sim.readable import with_unit

LISTED = 6  # odd recordings listed in the sentence


@dataclass(frozen=True)
class Member(Valued):
    """A recording: known values, its fit, and why it is unlike the others, if it is."""

    listed: Listed
    quick: Quick
    odd: Odd | None = None
    reason: Reason | None = None

    @property
    def pooled(self) -> bool:
        """Whether the recording is used for the result of the fleet."""
        return self.reason is None and not self.quick.problem


@dataclass(frozen=True, repr=False)
class Fleet(Shown):
    """The result for a fleet.

    names: unit of each reported parameter; spreads: how each varies over the fleet. candidates:
    structures that were tried, and how much more each costs; repeats: by parameter, the scatter of
    repeated recordings of one device over their estimated errors. notes: recordings that were not
    used.
    """

    structure: Structure
    names: Mapping[str, str]
    members: tuple[Member, ...]
    spreads: Mapping[str, Spread]
    changes: tuple[Change, ...]
    candidates: Mapping[str, float]
    repeats: Mapping[str, float]
    notes: tuple[str, ...] = ()

    @property
    def devices(self) -> list[str]:
        """The devices by name."""
        return sorted({m.listed.device for m in self.members})

    @property
    def odd(self) -> list[Member]:
        """The recordings that are unlike the others and left out of the fleet's values."""
        return [m for m in self.members if m.reason is not None]

    @cached_property
    def _places(self) -> dict[str, NDArray[np.intp]]:
        return places_by([m.listed.device for m in self.members])

    @cached_property
    def pooled_places(self) -> dict[str, int]:
        """Index in `Spread.pooled` of each pooled recording, by name."""
        return {m.listed.name: k for k, m in enumerate(m for m in self.members if m.pooled)}

    def of(self, device: str) -> list[Member]:
        """Return the recordings of a device, by date."""
        own = [self.members[k] for k in self._places[device].tolist()]
        return sorted(own, key=lambda m: (m.listed.day or -math.inf, m.listed.name))

    @property
    def headline(self) -> str:
        """The answer in one line."""
        labels = self.structure.labels
        what = " and ".join(in_words(label) for label in labels)
        count, devices = len(self.members), len(self.devices)
        whose = f"{devices} devices" if devices > 1 else "one device"
        parts = [
            f"{count} recordings of {whose} share {what or 'a linear model'}",
            f"{len(self.odd) or 'none'} {'are' if len(self.odd) > 1 else 'is'} unlike the others",
        ]
        parts += [self.said_of(change) for change in self.changes[:2]]
        return "; ".join(parts)

    def said_of(self, change: Change) -> str:
        """Return a sentence on a change."""
        unit = self.names[change.parameter]
        name = in_words(change.parameter).rstrip(",")
        a, b = with_unit(change.before, unit), with_unit(change.after, unit)
        first, last = (date_of(day) for day in change.between)
        verb = "drifts from" if change.shape == DRIFT else "steps from"
        when = (
            f"since {date_of(change.at)}" if change.shape == DRIFT else f"by {date_of(change.at)}"
        )
        span = f" (95 %: {first} to {last})" if first != last else ""
        return f"{name} of {change.device} {verb} {a} to {b} {when}{span}"

    def said_of_parameter(self, name: str) -> str:
        """Return a sentence on how a parameter varies over the fleet."""
        s, unit = self.spreads[name], self.names[name]
        words = in_words(name).rstrip(",")
        parts = [f"{words} is {with_unit(s.center.value, unit)}"]
        if s.shared and not s.slopes:
            parts = [f"{parts[0]} in all"]
        if s.per_device:
            parts.append(f"differs from device to device by {with_unit(s.tau_device, unit)} rms")
        if s.per_run:
            parts.append(f"differs from run to run by {with_unit(s.tau_run, unit)} rms")
        for column, slope in s.slopes.items():
            per = with_unit(slope.value, unit)
            parts.append(f"depends on {column}: {per} per unit")
        return ", ".join(parts)

    def as_json(self) -> dict[str, Any]:
        """Return the JSON of `zwidth diagnose` for a fleet; None where a number is not finite."""
        return _finite(self._as_json())

    def _as_json(self) -> dict[str, Any]:
        return {
            "fleet": True,
            "headline": self.headline,
            "recordings": len(self.members),
            "devices": len(self.devices),
            "structure": self.structure.labels,
            "candidates": dict(self.candidates),
            "parameters": {n: self._parameter(n) for n in self.spreads},
            "odd": [
                {
                    "recording": m.listed.name,
                    "device": m.listed.device,
                    "kind": m.reason.kind,
                    "what": FAULTS[m.reason.kind],
                    "sentence": m.reason.sentence,
                    "gained": m.reason.gained,
                    "parameters": list(m.reason.parameters),
                    "recording_fault": m.reason.recording,
                }
                for m in self.members
                if m.reason is not None
            ],
            "changes": [
                {
                    "device": c.device,
                    "parameter": c.parameter,
                    "shape": c.shape,
                    "date": date_of(c.at),
                    "date_ci95": [date_of(day) for day in c.between],
                    "before": c.before,
                    "after": c.after,
                    "unit": self.names[c.parameter],
                    "gained": c.gained,
                    "sentence": self.said_of(c),
                }
                for c in self.changes
            ],
            "members": [self._member(m) for m in self.members],
            "notes": list(self.notes),
        }

    def _parameter(self, name: str) -> dict[str, Any]:
        s = self.spreads[name]
        return {
            "unit": self.names[name],
            "center": s.center.value,
            "center_error": s.center.error,
            "shared": s.shared,
            "per_device": s.per_device,
            "per_run": s.per_run,
            "device_rms": s.tau_device,
            "run_rms": s.tau_run,
            "slopes": {k: {"value": v.value, "error": v.error} for k, v in s.slopes.items()},
            "gains": {k: float(v) for k, v in s.gains.items()},
            "repeats_over_errors": self.repeats.get(name),
            "sentence": self.said_of_parameter(name),
        }

    def _member(self, m: Member) -> dict[str, Any]:
        places = {name: k for k, name in enumerate(self.names)}
        pooled: dict[str, Any] = {}
        if m.pooled:
            place = self.pooled_places[m.listed.name]
            pooled = {
                name: {"value": float(s.pooled[place]), "error": float(s.pooled_errors[place])}
                for name, s in self.spreads.items()
            }
        q = m.quick
        own = {
            name: {
                "value": float(q.values[k]),
                "error": float(q.errors[k]),
            }
            for name, k in places.items()
            if not q.problem
        }
        return {
            "recording": m.listed.name,
            "device": m.listed.device,
            "date": m.listed.date and m.listed.date.isoformat(),
            "known": dict(m.listed.known),
            "problem": q.problem or None,
            "parameters": own,
            "pooled": pooled,
            "noise": q.noise,
            "free_run": q.free,
            "odd": m.reason is not None,
        }


def _finite(value: Any) -> Any:
    """The same value with None for numbers that JSON does not have: a free run may run away."""
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
