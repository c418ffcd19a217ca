"""Values of an answer in a recording's own units (A, V, counts) if a scale is unknown.

One ampere or one count then counts as one SI unit (`sim.readable.counted_in`), so that only the
units change and not the numbers: a friction of 0.4 N m becomes one of 0.4 A.
"""

from dataclasses import fields, is_dataclass, replace
from typing import Any

from zwidth.diagnosis.answer.inverse import ForceError
from zwidth.diagnosis.answer.result import Diagnosis, Estimate
from zwidth.diagnosis.answer.whole_run import WholeRun
from zwidth.sim.readable import as_counted

PARTS = ("findings", "negligible", "linear_refit", "changes", "events", "whole_runs",
         "force_errors")  # fmt: skip


def in_own_units(found: Diagnosis) -> Diagnosis:
    """Return the answer in the units of the enclosing `counted_in`; unchanged in SI units."""
    if as_counted("N m") == "N m" and as_counted("rad") == "rad":
        return found
    return replace(found, **{name: _called(getattr(found, name)) for name in PARTS})


def _called(value: Any) -> Any:
    match value:
        case Estimate() | WholeRun() | ForceError():
            return replace(value, unit=as_counted(value.unit))
        case dict():
            return {key: _called(one) for key, one in value.items()}  # pyright: ignore[reportUnknownVariableType]
        case tuple():
            return tuple(map(_called, value))  # pyright: ignore[reportUnknownArgumentType]
        case _ if is_dataclass(value) and not isinstance(value, type):
            parts = {one.name: getattr(value, one.name) for one in fields(value) if one.init}
            kept = {name: _called(one) for name, one in parts.items()}
            changed = {name: one for name, one in kept.items() if one is not parts[name]}
            return replace(value, **changed) if changed else value
        case _:
            return value
