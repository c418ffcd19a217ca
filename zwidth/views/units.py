"""Units of a device's quantities, and arrays with units."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from xarray import Dataset


class Units(NamedTuple):
    """The units of a device: force, length, mass, and derived ones."""

    force: str
    length: str
    mass: str

    @property
    def stiffness(self) -> str:
        """The unit of K and of springs."""
        return f"{self.force}/{self.length}"

    @property
    def damping(self) -> str:
        """The unit of B and of dampers."""
        return f"{self.force} s/{self.length}"


def units(rotary: bool) -> Units:
    """Return the units of a rotary or a linear device."""
    return Units("N m", "rad", "kg m2") if rotary else Units("N", "m", "kg")


Column = tuple[Sequence[Any] | np.ndarray[Any, Any], str | None]  # None for text, which has no unit


def numbers(values: Sequence[float | None]) -> list[float]:
    """Return numbers, NaN for none."""
    return [np.nan if value is None else float(value) for value in values]


def rows(
    axis: str,
    places: Column,
    columns: Mapping[str, Column],
    facts: Mapping[str, object] | None = None,
) -> "Dataset":
    """Return columns over one axis, each (values, unit), as a dataset.

    places: values of the axis. facts: attributes of the dataset; only text and numbers are kept.
    """
    from xarray import Dataset

    plain = {k: v for k, v in (facts or {}).items() if isinstance(v, str | int | float)}
    return Dataset(
        {name: (axis, _array(values), _said(unit)) for name, (values, unit) in columns.items()},
        {axis: (axis, _array(places[0]), _said(places[1]))},
        plain,
    )


def _array(values: Sequence[Any] | np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    array = np.asarray(values)
    return array.astype(object) if array.dtype.kind == "U" else array


def _said(unit: str | None) -> dict[str, str]:
    """The attribute of a unit; text has none."""
    return {} if unit is None else {"units": unit}
