"""What every result can do: become arrays, be drawn, be looked at.

A result contains no code for this. Its table, arrays and pictures are defined in the package that
`shown_by` names, one module a class, which is imported when it is first needed: xarray and
matplotlib take a second to load, and a simulation needs neither.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, Protocol, cast

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset


class Views(Protocol):
    """The package that knows what results look like."""

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
    """Name the package of the views."""
    _home[:] = [package]


def _views() -> Views:
    return cast("Views", import_module(*_home))


def fields_html(value: Any) -> str:
    """Return the fields of a value as a table for a notebook: `_repr_html_` of a named tuple."""
    return _views().fields(value)


class Valued:
    """A value of a few fields, as results are made of: a table of them in a notebook."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        return fields_html(self)


class Shown:
    """A result: `to_xarray`, `to_pandas`, `to_frame`, `plot`, a table where it is looked at."""

    __slots__ = ()

    def to_xarray(self) -> "Dataset":
        """Return the numbers as an `xarray.Dataset`; `attrs["units"]` has the unit of each.

        Raises ImportError where xarray is missing, with what to install.
        """
        return _views().dataset(self)

    def to_pandas(self) -> "DataFrame":
        """Return the numbers of `to_xarray` that share its first axes as a `pandas.DataFrame`.

        `attrs["units"]` has the units of its columns by their names.

        Raises ImportError where pandas is missing, with what to install.
        """
        return _views().frame(self)

    def to_frame(self, library: Literal["pandas", "polars"] | None = None) -> Any:
        """Return the numbers of `to_pandas` as a data frame whose axes are columns, too.

        library: of whom the frame is, "pandas" or "polars"; without it that of pandas where it is
        installed, else that of polars. Raises ValueError for another one, ImportError where it is
        missing, with what to install.
        """
        return _views().flat(self, library)

    def plot(self, picture: str | None = None) -> "Figure":
        """Return a `matplotlib.figure.Figure`, which a notebook shows and `savefig` writes.

        picture: which one, where a result has several; by default the first of them. Raises
        ValueError, which names them, for one that there is not.
        """
        return _views().figure(self, picture)

    def __repr__(self) -> str:
        return _views().text(self)

    def _repr_html_(self) -> str:
        return _views().html(self)
