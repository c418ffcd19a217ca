"""Views of results as arrays, tables and pictures, one module per class.

The module of a class has its name in lower case (`FateMap`: `fate_map`). It contains `table`,
`dataset` and PICTURES, name -> function, the first of which is the default. This package finds them
for `zwidth.shown`.
"""

import re
import sys
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, cast

from zwidth.views.fields import fields_table
from zwidth.views.table import as_html, as_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from xarray import Dataset

LIBRARIES = ("pandas", "polars")
WORD = re.compile(r"(?<=[a-z])(?=[A-Z])")  # beginning of a word in a class name


def text(result: Any) -> str:
    """Return a few lines for a terminal."""
    return as_text(_module(result).table(result))


def html(result: Any) -> str:
    """Return a table for a notebook."""
    return as_html(_module(result).table(result))


def fields(value: Any) -> str:
    """Return the fields of a value as a table for a notebook."""
    return as_html(fields_table(value))


def dataset(result: Any) -> "Dataset":
    """Return the numbers as arrays with units; raises ImportError if xarray is missing."""
    _needed("xarray", "to_xarray")
    return _module(result).dataset(result)


def frame(result: Any) -> "DataFrame":
    """Return the variables that share the first one's axes; raises ImportError without pandas."""
    _needed("pandas", "to_pandas")
    found = dataset(result)
    axes = next(iter(found.data_vars.values())).dims
    apart = [name for name, values in found.data_vars.items() if set(values.dims) - set(axes)]
    left = found.drop_vars(apart)
    foreign = [name for name in left.coords if set(left.coords[name].dims) - set(axes)]
    return _with_rows(left.drop_vars(foreign))


def flat(result: Any, library: str | None = None) -> Any:
    """Return the same with its axes as columns, of pandas or polars; raises as `Shown.to_frame`."""
    if library is None:
        library = "pandas" if find_spec("pandas") or not find_spec("polars") else "polars"
    if library not in LIBRARIES:
        raise ValueError(f"library is {library!r}; it must be {' or '.join(LIBRARIES)}")
    _needed(library, "to_frame")
    table = frame(result)
    axes = table.index.names != [None] and table.index.names != ["row"]
    found = table.reset_index(drop=not axes)
    if library == "pandas":
        found.attrs["units"] = table.attrs["units"]
        return found
    import polars  # pyright: ignore[reportMissingImports]

    return polars.DataFrame({str(name): found[name].to_numpy() for name in found.columns})


def _with_rows(found: "Dataset") -> "DataFrame":
    """Return a table with the units of its columns; of numbers without an axis, one row."""
    table = found.to_dataframe() if found.sizes else found.expand_dims("row").to_dataframe()
    said = {str(n): v.attrs["units"] for n, v in found.variables.items() if "units" in v.attrs}
    table.attrs["units"] = said
    return table


def figure(result: Any, picture: str | None = None) -> "Figure":
    """Return a picture by its name, or the first one; raises ValueError with the names."""
    pictures = cast("dict[str, Callable[[Any], Figure]]", _module(result).PICTURES)
    name = next(iter(pictures)) if picture is None else picture
    if name not in pictures:
        raise ValueError(
            f"picture is {name!r}; {type(result).__name__} draws {' or '.join(map(repr, pictures))}"
        )
    drawn = pictures[name](result)
    _seen_in_notebooks()
    return drawn


def _module(result: Any) -> Any:
    name = WORD.sub("_", type(result).__name__).lower()
    return import_module(f"zwidth.views.{name}")


def _needed(package: str, method: str) -> None:
    try:
        import_module(package)
    except ImportError:
        raise ImportError(
            f"{method}() needs {package}, which is not installed; run: pip install {package}"
        ) from None


def _seen_in_notebooks() -> None:
    """Let a notebook show figures, which by itself it does only once pyplot has made one."""
    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if shell is None or not hasattr(shell, "kernel"):
        return
    from matplotlib.figure import Figure

    formatter = shell.display_formatter.formatters["image/png"]
    try:
        formatter.lookup_by_type(Figure)
    except KeyError:
        pylabtools = import_module("IPython.core.pylabtools")
        pylabtools.select_figure_formats(shell, {"png"})
