"""MATLAB files: v4 to v7 by scipy, v7.3 (and any other HDF5) by h5py.

A field of a structure is `s.f`, the k-th signal of a matrix `X(:,k)` (time runs along its longer
side), a cell `c{k}`, an element of an array of structures `s(k)`; k counts from 1 as in MATLAB.
"""

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import scipy.io.matlab

from zwidth.logs.mat_elements import TooLarge, check_elements
from zwidth.logs.source import Collector, RecordingError, Source
from zwidth.logs.unpacked import most_bytes, too_large

DEEPEST = 16  # levels of nested structures
LEAST_CELLS = 100  # least cells of single numbers and texts that are a column
MOST_PARTS = 10_000  # cells, elements, fields of one file
TO_PLAIN = {
    "timeseries": "t = {name}.Time; x = squeeze({name}.Data); save('plain.mat', 't', 'x')",
    "timetable": (
        "T = timetable2table({name}); s = table2struct(T, 'ToScalar', true);"
        " s.Time = seconds(T.(1) - T.(1)(1)); save('plain.mat', '-struct', 's')"
    ),
    "table": "s = table2struct({name}, 'ToScalar', true); save('plain.mat', '-struct', 's')",
    "Simulink.SimulationOutput": (
        "t = {name}.tout; y = {name}.yout{{1}}.Values.Data; save('plain.mat', 't', 'y')"
    ),
    "Simulink.SimulationData.Dataset": (
        "e = {name}{{1}}.Values; t = e.Time; x = e.Data; save('plain.mat', 't', 'x'), and so for"
        " each element"
    ),
    "iddata": (
        "u = {name}.InputData; y = {name}.OutputData; Ts = {name}.Ts; save('plain.mat', 'u', 'y',"
        " 'Ts')"
    ),
}
"""What to type in MATLAB to convert an object to arrays, which any program can read."""
PLAIN = (
    *(b"double", b"single", b"logical", b"char", b"cell", b"struct", b"function_handle"),
    *(b"%sint%d" % (sign, bits) for sign in (b"", b"u") for bits in (8, 16, 32, 64)),
)
LABELS, NUMBERS, UNITS = ("Name", "label"), ("Data", "values"), ("Unit", "unit")
COLUMN, CELL, ELEMENT = "{name}(:,{k})", "{name}{{{k}}}", "{name}({k})"


class _Parts(Collector):
    """A collector that gives up on a file of endlessly many parts.

    aliases: the path of a signal that is called by its label -> that. left: the bytes that all
    that is still to be read may unpack to.
    """

    def __init__(self, left: int) -> None:
        super().__init__(COLUMN, 1)
        self.aliases: dict[str, str] = {}
        self.left = left

    def unpack(self, size: int) -> None:
        """Account for so many bytes before they are read; raises TooLarge."""
        self.left -= size
        if self.left < 0:
            raise TooLarge

    def take(self, name: str, values: Any) -> None:
        if len(self.signals) + len(self.unreadable) >= MOST_PARTS:
            raise RecordingError(f"the file has more than {MOST_PARTS} variables and fields")
        self.add(name, values)

    def call(self, name: str, value: dict[str, Any]) -> None:
        """Call the data of a structure as its own label does, which dSPACE and Simulink write."""
        label = next((value[key] for key in LABELS if isinstance(value.get(key), str)), "").strip()
        inner = next((f"{name}.{k}" for k in NUMBERS if f"{name}.{k}" in self.signals), None)
        if not label or label in self.signals or label in self.aliases:
            return
        if inner is None:
            self._call_columns(name, label)
            return
        self.aliases[inner] = label
        unit = next((value[k] for k in UNITS if isinstance(value.get(k), str)), "")
        self.signals[label] = replace(self.signals.pop(inner), name=label, unit=unit)

    def _call_columns(self, name: str, label: str) -> None:
        """Call the columns of a matrix as its label does: Simulink's "torque, angle" names both."""
        heads = tuple(f"{name}.{k}(:," for k in NUMBERS)
        columns = [n for n in self.signals if n.startswith(heads)]
        parts = [part.strip(" <>") for part in label.split(",")]
        if len(parts) != len(columns) or not all(parts) or len(set(parts)) < len(parts):
            return
        for column, part in zip(columns, parts, strict=True):
            if part not in self.signals and part not in self.aliases:
                self.aliases[column] = part
                self.signals[part] = replace(self.signals.pop(column), name=part)


def read_mat(path: Path, data: bytes) -> Source:
    """Return the variables of a file before v7.3; raises RecordingError."""
    found = _Parts(most_bytes(len(data)))
    try:
        if scipy.io.matlab.matfile_version(_stream(data))[0] == 1:
            check_elements(data, found.left)
        variables = scipy.io.loadmat(_stream(data), simplify_cells=True)
        for name, value in variables.items():
            if not name.startswith("__"):
                _walk(found, name, value, 0)
    except TooLarge:
        raise too_large(path, len(data), most_bytes(len(data))) from None
    except MemoryError:
        raise
    except Exception as error:  # scipy raises many types: ValueError, TypeError, zlib.error ...
        raise _damaged(path, "MAT", error) from None
    kind = "MAT v7 or older"
    return Source(path, kind, found.signals, found.unreadable, aliases=found.aliases)


def _stream(data: bytes) -> Any:
    """Return what scipy takes for a file, although its annotations name only paths."""
    return io.BytesIO(data)


def _walk(found: _Parts, name: str, value: Any, depth: int) -> None:
    if depth > DEEPEST:
        found.unreadable[name] = f"lies more than {DEEPEST} structures deep"
    elif isinstance(value, dict):
        units = _units(value)
        for field, part in value.items():
            inner = f"{name}.{field}"
            _walk(found, inner, part, depth + 1)
            if field in units and inner in found.signals:
                found.signals[inner] = replace(found.signals[inner], unit=units[field])
        found.call(name, value)
    elif isinstance(value, scipy.io.matlab.MatlabOpaque):
        owner, _, kind = (_text_of(value.flat[0][field]) for field in ("s0", "s1", "s2"))
        found.unreadable[owner or name] = _object(owner or name, kind)
    elif isinstance(value, np.ndarray) and value.dtype == object and _is_column(value):
        found.add_cells(name, [None if _is_empty(v) else v for v in value.flat])
    elif isinstance(value, np.ndarray) and value.dtype == object:
        pattern = ELEMENT if all(isinstance(v, dict) for v in value.flat) else CELL
        for k, part in enumerate(value.flat, start=1):
            _walk(found, pattern.format(name=name, k=k), part, depth + 1)
    elif isinstance(value, list):
        _walk(found, name, np.array(value, dtype=object), depth)
    elif isinstance(value, np.ndarray | np.generic | int | float | str | bytes):
        found.take(name, value)
    else:
        found.unreadable[name] = f"is a {type(value).__name__}; a signal is a row of numbers"


def _units(value: dict[str, Any]) -> dict[str, str]:
    """Return the units that an object of identification data, saved as a structure, tells."""
    told = {f"{side}Data": value.get(f"{side}Unit") for side in ("Input", "Output")}
    return {field: unit for field, unit in told.items() if isinstance(unit, str) and unit.strip()}


def _text_of(value: object) -> str:
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def _object(name: str, kind: str) -> str:
    """A sentence on what a MATLAB object is, and what to type there to save its numbers."""
    how = TO_PLAIN.get(kind, "save its numbers as plain arrays, such as x = double({name}.x)")
    return (
        f"is a MATLAB {kind} object, whose numbers only MATLAB can read; in MATLAB type:"
        f" {how.format(name=name)}"
    )


def _is_column(cells: np.ndarray) -> bool:
    """True for a long cell array of single numbers and texts, as `readcell` gives a column.

    A shorter one is a list of parameters, a signal for each cell.
    """
    return (
        cells.size >= LEAST_CELLS
        and max(cells.shape) == cells.size
        and all(isinstance(v, str | int | float | np.number) or _is_empty(v) for v in cells.flat)
    )


def _is_empty(cell: object) -> bool:
    return isinstance(cell, np.ndarray) and cell.size == 0


def read_hdf5(path: Path, data: bytes) -> Source:
    """Return the data sets of an HDF5 file, which MAT v7.3 is; raises RecordingError.

    Links to other files, and data sets stored in other files, are not followed.
    """
    import h5py

    found = _Parts(most_bytes(len(data)))
    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            matlab = any("MATLAB_class" in item.attrs for item in _members(file).values())
            for name, item in _members(file).items():
                if not name.startswith("#"):
                    _hdf5(found, name, item, (), file)
    except TooLarge:
        raise too_large(path, len(data), most_bytes(len(data))) from None
    except MemoryError:
        raise
    except Exception as error:  # h5py raises a dozen classes, depending on the error
        raise _damaged(path, "HDF5", error) from None
    return Source(path, "MAT v7.3" if matlab else "HDF5", found.signals, found.unreadable)


def _members(group: Any) -> dict[str, Any]:
    """Return what a group holds itself, without links out of the file."""
    import h5py

    return {
        name: group[name]
        for name in group
        if isinstance(group.get(name, getlink=True), h5py.HardLink)
    }


def _hdf5(found: _Parts, name: str, item: Any, above: tuple[int, ...], file: Any) -> None:
    """Take a group or data set; above: addresses of the groups around it, against cycles."""
    import h5py

    if isinstance(item, h5py.Group):
        address = _address(item)
        if address in above or len(above) > DEEPEST:
            found.unreadable[name] = "contains itself, or lies too deep"
            return
        for field, part in _members(item).items():
            _hdf5(found, f"{name}.{field}", part, (*above, address), file)
        return
    if not isinstance(item, h5py.Dataset):
        found.unreadable[name] = "is a named type; a signal is a row of numbers"
    elif (kind := item.attrs.get("MATLAB_class")) is not None and _bytes_of(kind) not in PLAIN:
        found.unreadable[name] = _object(name, _text_of(_bytes_of(kind)))
    elif item.external or item.is_virtual:
        found.unreadable[name] = "keeps its values in another file"
    elif item.shape is None or item.size == 0 or "MATLAB_empty" in item.attrs:
        found.unreadable[name] = "is empty"
    elif item.attrs.get("MATLAB_class") in (b"char", "char"):
        found.unreadable[name] = "is text; a signal is numbers"
    elif h5py.check_string_dtype(item.dtype) is not None:  # by dtype, texts look like references
        found.unpack(item.size * item.dtype.itemsize)
        found.take(name, np.asarray(item.asstr(errors="replace")[()], dtype=np.str_))
    elif item.dtype == h5py.ref_dtype:
        _references(found, name, item, above, file)
    elif item.dtype.kind in "biuf" or item.dtype.names is not None:
        found.unpack(item.size * item.dtype.itemsize)
        found.take(name, np.asarray(item[()]).T)
    else:
        found.unreadable[name] = f"holds {item.dtype}; a signal is numbers"


def _bytes_of(value: object) -> bytes:
    return value if isinstance(value, bytes) else str(value).encode()


def _address(item: Any) -> int:
    """Return where an object of an HDF5 file starts."""
    from h5py import h5o  # pyright: ignore[reportAttributeAccessIssue]  # a compiled module

    return int(h5o.get_info(item.id).addr)


def _references(found: _Parts, name: str, item: Any, above: tuple[int, ...], file: Any) -> None:
    """Take the cells of a cell array, which are references to data sets elsewhere in the file."""
    address = _address(item)
    if address in above or len(above) > DEEPEST or item.size > MOST_PARTS:
        found.unreadable[name] = "contains itself, or lies too deep"
        return
    pattern = CELL if item.attrs.get("MATLAB_class") in (b"cell", "cell") else ELEMENT
    for k, reference in enumerate(np.asarray(item[()]).T.flat, start=1):
        part = pattern.format(name=name, k=k)
        if reference:
            _hdf5(found, part, file[reference], (*above, address), file)
        else:
            found.unreadable[part] = "is empty"


def _damaged(path: Path, kind: str, error: Exception) -> RecordingError:
    reason = " ".join(str(error).split())[:160] or type(error).__name__
    return RecordingError(f"{path.name} cannot be read as {kind}, it is damaged: {reason}")
