"""A part of a result as a table: a row for each of its fields."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, cast

import numpy as np

from zwidth.diagnosis.answer.result import Estimate
from zwidth.diagnosis.answer.words import effect_in_words
from zwidth.diagnosis_report import estimate
from zwidth.sim.device import Device, place_label
from zwidth.sim.physics import EFFECTS
from zwidth.sim.physics.effect import Effect, Physics
from zwidth.sim.place import Place
from zwidth.views.table import NONE, Table, number

MOST = 6  # most elements shown of a sequence


def fields_table(value: Any) -> Table:
    """Return names and values of the fields of a dataclass or named tuple, without functions."""
    names = [f.name for f in fields(value)] if is_dataclass(value) else list(value._fields)
    each = {name: getattr(value, name) for name in names if not name.startswith("_")}
    rows = [[name.replace("_", " "), in_words(v)] for name, v in each.items() if not callable(v)]
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
        case Device() | Effect():
            return value.name
        case Physics():
            numbers = in_words(value.values)
            return in_words(place_label(value)) + (f" ({numbers})" if value.values else "")
        case str() if "@" in value and value.partition("@")[0] in EFFECTS:
            effect, _, at = value.partition("@")
            return f"{effect_in_words(effect)} at {at}"
        case Place():
            return str(value)
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
    each = ((name.replace("_", " "), getattr(value, name)) for name in names)
    told = [(name, one) for name, one in each if one is not None and not callable(one)]
    return ", ".join(f"{name} {in_words(one)}" for name, one in told)


def _array(values: Any) -> str:
    if values.size <= MOST:
        return ", ".join(map(in_words, values.ravel().tolist())) or NONE
    if values.dtype.kind not in "fiu":
        return f"{' x '.join(map(str, values.shape))} values"
    finite = values[np.isfinite(values)]
    span = f", {number(finite.min())} to {number(finite.max())}" if finite.size else ""
    return f"{' x '.join(map(str, values.shape))} numbers{span}"
