"""From marks to shares, each with its Clopper-Pearson interval."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from zwidth.exam.calibration import calibration
from zwidth.exam.mark import Mark, Marked
from zwidth.exam.perfect import HeldOut
from zwidth.exam.share import share
from zwidth.exam.strata import KINDS, LABORATORY, MUJOCO, OUTSIDE, RIGS, STRATA
from zwidth.exam.tally_rigs import adequacy, clean, held_out, outside, rigs

BINS = (1.0, 1.5, 3.0, 5.0, 10.0, 30.0, 100.1)  # times the limit
NOTHING, UNKNOWN = "nothing", "unknown"


def tally(marks: Sequence[Mark], fits: Mapping[str, HeldOut]) -> dict[str, Any]:
    """Return the JSON of `zwidth exam`; fits: recording -> its held-out errors."""
    by_kind = {kind: [m for m in marks if m.kind == kind] for kind in KINDS}
    stated = {kind: [s for m in found for s in m.stated] for kind, found in by_kind.items()}
    return {
        "recordings": len(marks),
        **_at_limit(by_kind["limit"], fits),
        "rigs": rigs(by_kind[RIGS], fits),
        "outside": outside(by_kind[OUTSIDE], fits),
        "laboratory": clean(by_kind[LABORATORY])
        | {
            "coverage_linear": share(
                ok for m in by_kind[LABORATORY] for ok in m.linear.values()
            ).as_json()
        },
        "mujoco": rigs(by_kind[MUJOCO], fits),
        "adequacy": adequacy(marks, fits),
        "calibration": {
            **calibration([s for kind in stated.values() for s in kind]),
            "by_kind": {kind: calibration(said) for kind, said in stated.items() if said},
        },
        "seconds": _seconds(marks),
        "errors": sorted(m.recording for m in marks if m.verdict == "error"),
    }


def _at_limit(marks: Sequence[Mark], fits: Mapping[str, HeldOut]) -> dict[str, Any]:
    by_class = {name: [m for m in marks if m.stratum == name] for name in STRATA}
    single = [m for m in marks if m.stratum.startswith("single")]
    none, unknown = by_class["none"], by_class["unknown"]
    silent = clean(none)
    inside = [ok for m in marks for e in m.effects for ok in e.inside.values()]
    coverage, linear = share(inside), share(ok for m in marks for ok in m.linear.values())
    return {
        "classes": {
            name: _class(found)
            for name, found in by_class.items()
            if found and STRATA[name].effects and not STRATA[name].outside
        },
        "none": silent,
        "unknown": {
            "recordings": len(unknown),
            "said_so": share(m.verdict == "unknown_physics" for m in unknown).as_json(),
            "confident_wrong": share(m.verdict == "identified" for m in unknown).as_json(),
            "by_effect": {
                name: dict(Counter(_column(m) for m in unknown if m.outside == name))
                for name in sorted({m.outside for m in unknown})
            },
        },
        "by_effect": _by_effect(single),
        "by_magnitude": _by_magnitude(single),
        "false_claims": silent["false_claims"]["share"],
        "extra_claims": share(bool(m.claims) for m in marks if m.effects).as_json(),
        "coverage": coverage.share,
        "coverage_counts": coverage.as_json(),
        "coverage_linear": linear.as_json(),
        "held_out": held_out([m for m in marks if m.effects], fits),
        "confusion": confusion(single),
    }


def _class(marks: Sequence[Mark]) -> dict[str, Any]:
    """Of single effects: named first where they stand apart; of several: all of them found."""
    all_right = share(all(e.right for e in m.effects) for m in marks)
    effects = [e for m in marks for e in m.effects]
    apart = [e for e in effects if e.apart]
    several = any(len(m.effects) > 1 for m in marks)
    named: Callable[[Marked], bool] = (lambda e: e.found) if several else (lambda e: e.first)
    return {
        "recordings": len(marks),
        "all_right": all_right.as_json(),
        "stand_apart": share(e.apart for e in effects).as_json(),
        "right_where_apart": share(named(e) for e in apart).as_json(),
        "in_class": share(e.in_class for e in effects).as_json(),
        "in_class_elsewhere": share(e.in_class for e in effects if not e.apart).as_json(),
        "extra_claims": share(bool(m.claims) for m in marks).as_json(),
    }


def _by_effect(single: Sequence[Mark]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name in sorted({e.effect for m in single for e in m.effects}):
        of_it = [(m, m.effects[0]) for m in single if m.effects[0].effect == name]
        effects = [e for _, e in of_it]
        found[name] = {
            "recordings": len(of_it),
            "stand_apart": sum(e.apart for e in effects),
            "first": sum(e.first for e in effects),
            "first_where_apart": share(e.first for e in effects if e.apart).as_json(),
            "in_class": share(e.in_class for e in effects).as_json(),
            "coverage": share(ok for e in effects for ok in e.inside.values()).as_json(),
            "taken_for": dict(Counter(_column(m) for m, e in of_it if not e.first)),
        }
    return found


def _by_magnitude(single: Sequence[Mark]) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = []
    for low, high in pairwise(BINS):
        effects = [m.effects[0] for m in single if low <= m.effects[0].times_limit < high]
        if effects:
            rows.append(
                {
                    "from": low,
                    "to": high,
                    "first_where_apart": share(e.first for e in effects if e.apart).as_json(),
                    "right": share(_right(e) for e in effects).as_json(),
                    "in_class": share(e.in_class for e in effects).as_json(),
                }
            )
    return rows


def _right(e: Marked) -> bool:
    return e.first if e.apart else e.in_class


def _column(m: Mark) -> str:
    if m.first:
        return m.first.partition("@")[0]
    return UNKNOWN if m.verdict == "unknown_physics" else NOTHING


def confusion(single: Sequence[Mark]) -> dict[str, Any]:
    """Return counts of the effect named first (columns) for each single concealed effect (rows)."""
    rows = sorted({m.effects[0].effect for m in single})
    seen = {_column(m) for m in single}
    columns = [*rows, *sorted(seen - {*rows, NOTHING, UNKNOWN}), UNKNOWN, NOTHING]
    counted = Counter((m.effects[0].effect, _column(m)) for m in single)
    return {
        "rows": rows,
        "columns": columns,
        "counts": [[counted[row, column] for column in columns] for row in rows],
    }


def _seconds(marks: Sequence[Mark]) -> dict[str, Any]:
    """Time of a diagnosis as it was, and per 10 s of recording at 1 kHz; and of all cores."""
    times = np.array([m.seconds for m in marks])
    scaled = np.array([m.seconds / m.samples * 1e4 for m in marks])
    cores = np.array([m.core_seconds / m.samples * 1e4 for m in marks])
    return {
        "median": float(np.median(times)),
        "most": float(times.max()),
        "median_of_10_s": float(np.median(scaled)),
        "ninth_decile_of_10_s": float(np.quantile(scaled, 0.9)),
        "core_seconds_of_10_s": float(np.median(cores)),
    }
