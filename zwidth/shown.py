"""Common methods of results: conversion to arrays and tables, pictures, display.

A result class has no code for this. Its table, arrays and pictures are defined in the package given
to `shown_by`, one module per class, which is imported when it is first needed: xarray and
matplotlib take a second to load, and a simulation needs neither.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, Protocol, cast

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset


class Views(Protocol):
    """The interface of the package that converts and draws results."""

    def text(self, result: Any) -> str:
        """Return a few lines for a terminal."""
        ...

    def html(self, result: Any) -> str:
        """Return a table for a notebook."""
        ...

    def dataset(self, result: Any) -> "Dataset":
        """Return the numbers as arrays with units."""
        ...

    def frame(self, result: Any) -> "DataFrame":
        """Return the numbers as one table."""
        ...

    def flat(self, result: Any, library: str | None) -> Any:
        """Return that table with its axes as columns, of pandas or polars."""
        ...

    def fields(self, value: Any) -> str:
        """Return the fields of a value as a table for a notebook."""
        ...

    def figure(self, result: Any, picture: str | None) -> "Figure":
        """Return a picture by its name, or the first one."""
        ...


_home: list[str] = []


def shown_by(package: str) -> None:
    """Set the package of the views."""
    _home[:] = [package]


def _views() -> Views:
    return cast("Views", import_module(*_home))


def fields_html(value: Any) -> str:
    """Return the fields of a value as a table for a notebook: `_repr_html_` of a named tuple."""
    return _views().fields(value)


class Valued:
    """A part of a result: a value of a few fields, shown as a table in a notebook."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        return fields_html(self)


class Shown:
    """A result with `to_xarray`, `to_pandas`, `to_frame` and `plot`, displayed as a table."""

    __slots__ = ()

    def to_xarray(self) -> "Dataset":
        """Return the numbers as an `xarray.Dataset`; `attrs["units"]` has the unit of each.

        Raises ImportError if xarray is missing, with what to install.
        """
        return _views().dataset(self)

    def to_pandas(self) -> "DataFrame":
        """Return the numbers of `to_xarray` that share its first axes as a `pandas.DataFrame`.

        `attrs["units"]` has the units of its columns by their names.

        Raises ImportError if pandas is missing, with what to install.
        """
        return _views().frame(self)

    def to_frame(self, library: Literal["pandas", "polars"] | None = None) -> Any:
        """Return the numbers of `to_pandas` as a data frame with its axes as columns.

        library: "pandas" or "polars"; by default pandas if it is installed, else polars. Raises
        ValueError for another one, ImportError, with what to install, if it is missing.
        """
        return _views().flat(self, library)

    def plot(self, picture: str | None = None) -> "Figure":
        """Return a `matplotlib.figure.Figure`, which a notebook shows and `savefig` writes.

        picture: which one, if a result has several; by default the first. Raises ValueError with
        the available names for an unknown one.
        """
        return _views().figure(self, picture)

    def __repr__(self) -> str:
        return _views().text(self)

    def _repr_html_(self) -> str:
        return _views().html(self)
