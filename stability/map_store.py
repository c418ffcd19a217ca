"""A map on disk while it grows: parts, each written whole, and the finished NetCDF file.

A folder holds `plane.json` (what the map is of) and `part-00000.npz`, ... in the order of the run. A
run that stops, however abruptly, leaves whole parts; the next one reads them, checks that they are
of the same plane, and goes on with the next. `map.nc` is made of them at the end.
"""

import hashlib
import json
import math
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim.device_file import device_to_text
from stability.adaptive import filled, rounds, side
from stability.plane import Fates, Plane, evaluate, linear_radius

Floats = NDArray[np.float64]
CHUNK = 1024


@dataclass(frozen=True)
class FateMap:
    """A finished map. x, y: lattice values; the rest (y, x); run: points that were simulated.

    linear: spectral radius of the linear loop less one (negative: stable), on the same lattice.
    """

    plane: Plane
    x: Floats
    y: Floats
    fates: Fates
    run: NDArray[np.bool_]
    linear: Floats

    @property
    def runs(self) -> int:
        """How many points were simulated."""
        return int(self.run.sum())


def description(plane: Plane, coarse: int, levels: int) -> dict[str, Any]:
    """Return what identifies a map: two maps with equal descriptions are the same map."""
    value = {
        "schema": 1,
        "device": device_to_text(plane.device),
        "x": asdict(plane.x),
        "y": asdict(plane.y),
        "stiffness": plane.stiffness,
        "damping": plane.damping,
        "trial": asdict(plane.trial),
        "perceptible": plane.perceptible,
        "one_sided": plane.one_sided,
        "coarse": coarse,
        "levels": levels,
    }
    text = json.dumps(value, sort_keys=True)
    return value | {"sha256": hashlib.sha256(text.encode()).hexdigest()}


def make_map(
    plane: Plane,
    coarse: int = 25,
    levels: int = 2,
    folder: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
    workers: int | None = None,
) -> FateMap:
    """Run a map, in memory or in a folder where it resumes.

    progress: called with (points run, points known to be needed so far). Raises ValueError where
    the folder holds another map, OSError where it cannot be written.
    """
    size = side(coarse, levels)
    x, y = plane.x.values(size), plane.y.values(size)
    fates = Fates.empty(size * size)
    store = None if folder is None else PartStore(folder, description(plane, coarse, levels))
    done = 0
    for level in rounds(fates.fate.reshape(size, size), levels):
        for first in range(0, level.size, CHUNK):
            points = level[first : first + CHUNK]
            found = None if store is None else store.read(points)
            if found is None:
                found = evaluate(plane, x[points % size], y[points // size], workers)
                if store is not None:
                    store.write(points, found)
            fates.put(points, found)
            done += points.size
            if progress is not None:
                progress(done, done - (first + points.size) + level.size)
    return _finished(plane, x, y, fates, levels)


def _finished(plane: Plane, x: Floats, y: Floats, fates: Fates, levels: int) -> FateMap:
    shape = (y.size, x.size)
    run = fates.fate.reshape(shape) >= 0
    grids = {
        f.name: filled(getattr(fates, f.name).reshape(shape).astype(np.float64), run, levels)
        for f in fields(fates)
    }
    whole = Fates(grids["fate"].astype(np.int8), *(grids[f.name] for f in fields(fates)[1:]))
    return FateMap(plane, x, y, whole, run, linear_radius(plane, x, y))


class PartStore:
    """The parts of one map in a folder."""

    def __init__(self, folder: Path, identity: dict[str, Any]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.next = folder, 0
        file = folder / "plane.json"
        if file.exists():
            try:
                earlier = json.loads(file.read_text(encoding="utf-8"))["sha256"]
            except (ValueError, KeyError, TypeError):
                raise ValueError(f"{file} is damaged; remove the folder or choose another") from None
            if earlier != identity["sha256"]:
                raise ValueError(
                    f"{folder} holds a map of another plane; choose another folder, or remove it"
                )
        else:
            _write(file, json.dumps(_plain(identity), indent=2).encode())

    def read(self, points: NDArray[np.int64]) -> Fates | None:
        """Return the next part if it is there, whole, and of these points."""
        file = self._file()
        try:
            with np.load(file) as part:
                if not np.array_equal(part["points"], points):
                    return None
                found = Fates(*(part[f.name] for f in fields(Fates)))
        except (OSError, ValueError, KeyError, EOFError):
            return None
        self.next += 1
        return found

    def write(self, points: NDArray[np.int64], found: Fates) -> None:
        """Write the next part, whole or not at all."""
        from io import BytesIO

        buffer = BytesIO()
        np.savez(buffer, points=points, **{f.name: getattr(found, f.name) for f in fields(found)})
        _write(self._file(), buffer.getvalue())
        self.next += 1

    def _file(self) -> Path:
        return self.folder / f"part-{self.next:05d}.npz"


def _write(file: Path, content: bytes) -> None:
    draft = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        with draft.open("wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        draft.replace(file)
    finally:
        draft.unlink(missing_ok=True)


def _plain(value: Any) -> Any:
    """JSON without infinities."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return value


def save_map(result: FateMap, file: Path) -> Path:
    """Write a map as NetCDF with units and attributes; returns the path."""
    import xarray

    rotary = result.plane.device.rotary
    unit, force = ("rad", "N m") if rotary else ("m", "N")
    grids: dict[str, Any] = {
        "fate": (("y", "x"), result.fates.fate, {
            "flag_values": np.arange(5, dtype=np.int8),
            "flag_meanings": "rests imperceptible_cycle cycle grows undecided",
        }),
        "rate": (("y", "x"), result.fates.rate, {"units": "1/s"}),
        "amplitude": (("y", "x"), result.fates.amplitude, {"units": unit}),
        "force": (("y", "x"), result.fates.force, {"units": force}),
        "frequency": (("y", "x"), result.fates.frequency, {"units": "Hz"}),
        "run": (("y", "x"), result.run.astype(np.int8), {"long_name": "simulated, not filled in"}),
        "linear": (("y", "x"), result.linear, {"long_name": "spectral radius less one"}),
    }  # fmt: skip
    axes = {
        "x": ("x", result.x, {"long_name": result.plane.x.quantity}),
        "y": ("y", result.y, {"long_name": result.plane.y.quantity}),
    }
    attributes = {"title": result.plane.device.name, "runs": result.runs}
    data = xarray.Dataset(grids, axes, attributes)
    _write(file, bytes(data.to_netcdf(engine="scipy")))
    return file
