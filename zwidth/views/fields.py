"""A value that results are made of, as a table: a row for each of its fields."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, cast

import numpy as np

from zwidth.diagnosis.answer.result import Estimate
from zwidth.diagnosis_report import estimate
from zwidth.sim.device import Device
from zwidth.views.table import NONE, Table, number

MOST = 6  # of a sequence, that are shown


def fields_table(value: Any) -> Table:
    """Return names and values of the fields of a dataclass or named tuple."""
    named = [f.name for f in fields(value)] if is_dataclass(value) else list(value._fields)
    rows = [[name.replace("_", " "), in_words(getattr(value, name))] for name in named]
    return Table(type(value).__name__, (), ("", ""), rows)


def in_words(value: Any) -> str:
    """Return a value in one cell."""
    match value:
        case None:
            return NONE
        case bool():
            return "yes" if value else "no"
        case Estimate():
            return estimate(value)
        case Device():
            return value.name
        case Enum():
            return str(value.value) if isinstance(value.value, str) else value.name.lower()
        case float() | int() | np.floating() | np.integer():
            return number(float(value))
        case np.ndarray():
            return _array(cast("Any", value))
        case Mapping():
            told = cast("Mapping[Any, Any]", value).items()
            return ", ".join(f"{key}: {in_words(one)}" for key, one in told) or NONE
        case tuple() if hasattr(value, "_fields"):
            return _inside(cast("Any", value), list(cast("Any", value)._fields))
        case tuple() | list():
            every: list[Any] = list(cast("Any", value))
            more = f", ... {len(every) - MOST} more" if len(every) > MOST else ""
            return (", ".join(map(in_words, every[:MOST])) + more) or NONE
        case _ if is_dataclass(value) and not isinstance(value, type):
            return _inside(value, [f.name for f in fields(value)])
        case _:
            return str(value)


def _inside(value: Any, names: list[str]) -> str:
    told = ((name.replace("_", " "), getattr(value, name)) for name in names)
    return ", ".join(f"{name} {in_words(one)}" for name, one in told if one is not None)


def _array(values: Any) -> str:
    if values.size <= MOST:
        return ", ".join(map(in_words, values.ravel().tolist())) or NONE
    finite = values[np.isfinite(values)]
    span = f", {number(finite.min())} to {number(finite.max())}" if finite.size else ""
    return f"{' x '.join(map(str, values.shape))} numbers{span}"
