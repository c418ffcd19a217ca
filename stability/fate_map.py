"""A map of fates over a plane: computed adaptively, resumed from its folder, saved as NetCDF."""

import hashlib
import json
import math
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from zwidth.files.protection import writing_as
from zwidth.files.whole import write_bytes
from zwidth.jobs.executor import Executor, Local
from zwidth.jobs.only_driver import only_driver
from zwidth.jobs.store import PartStore
from zwidth.shown import Shown
from zwidth.sim.device_file import device_to_text
from zwidth.sim.fate import Fate
from zwidth.sim.jit import cache_folder
from zwidth.stability.adaptive import filled, rounds, side
from zwidth.stability.fates import Fates
from zwidth.stability.map_parts import run_parts
from zwidth.stability.plane import Floats, Plane
from zwidth.stability.plane_theory import linear_radius

if TYPE_CHECKING:
    from xarray import Dataset

WHAT = ("map", "plane")  # kind and content of a map's folder
CHUNK = 512  # points per part: the most that each core loses if a run is stopped


@dataclass(frozen=True, repr=False)
class FateMap(Shown):
    """A finished map. x, y: lattice values; fates, flat, and run: (y, x).

    run: flags of the points that were simulated; each other point lies between points of one fate
    and has this fate.
    """

    plane: Plane
    x: Floats
    y: Floats
    fates: Fates
    run: NDArray[np.bool_]

    @property
    def runs(self) -> int:
        """How many points were simulated."""
        return int(self.run.sum())

    @cached_property
    def linear(self) -> Floats:
        """Spectral radius of the linear loop less one (negative: stable), (y, x)."""
        return linear_radius(self.plane, self.x, self.y)

    def transitions(self) -> tuple[Floats, Floats]:
        """Return, for each x, the y up to which all runs come to rest, and the lowest y that grows.

        Each lies halfway between two points of the lattice. The first is NaN if the run at the
        lowest y does not come to rest, and the last y if all runs do. The second is NaN if no run
        grows or the one at the lowest y already does.
        """
        rests, grows = self.fates.fate == Fate.RESTS, self.fates.fate == Fate.GROWS
        return _first(self.y, ~rests, self.y[-1]), _first(self.y, grows, math.nan)


def _first(y: Floats, there: NDArray[np.bool_], otherwise: float) -> Floats:
    """The y halfway below the first of `there` (NaN: it is the lowest); without any: otherwise."""
    index = there.argmax(axis=0)
    halfway = 0.5 * (y[np.maximum(index - 1, 0)] + y[index])
    return np.where(there.any(axis=0), np.where(index > 0, halfway, math.nan), otherwise)


def make_map(
    plane: Plane,
    coarse: int = 25,
    levels: int = 3,
    folder: Path | None = None,
    progress: Callable[[float, int], None] | None = None,
    workers: int | None = None,
    runner: Executor | None = None,
) -> FateMap:
    """Run a map, in memory or in a folder where it resumes.

    progress: called with (share done, all levels counted as equal work; points run). workers:
    threads per part (None: all). runner: executes the parts (None: this process, one after
    another). Raises ValueError if the folder has another map or another program is filling it,
    OSError if it cannot be written or all workers are lost.
    """
    size = side(coarse, levels)
    x, y = plane.x.values(size), plane.y.values(size)
    fates = Fates.empty(size * size)
    runner = Local() if runner is None else runner
    numbered = done = 0
    with nullcontext() if folder is None else only_driver(folder):
        identity = description(plane, coarse, levels)
        store = None if folder is None else PartStore(folder, identity, WHAT)
        for level, points in rounds(fates.fate.reshape(size, size), levels):
            starts = range(0, points.size, CHUNK)
            parts = {numbered + i: points[s : s + CHUNK] for i, s in enumerate(starts)}
            numbered, before = numbered + len(parts), done
            for number, found in run_parts(plane, (x, y), parts, store, runner, workers):
                fates.put(parts[number], found)
                done += parts[number].size
                if progress is not None:
                    progress((level + (done - before) / points.size) / (levels + 1), done)
    return _finished(plane, x, y, fates, levels)


def _finished(plane: Plane, x: Floats, y: Floats, fates: Fates, levels: int) -> FateMap:
    shape = (y.size, x.size)
    run = fates.fate.reshape(shape) >= 0
    grids = [
        filled(getattr(fates, f.name).reshape(shape).astype(np.float64), run, levels)
        for f in fields(fates)
    ]
    return FateMap(plane, x, y, Fates(grids[0].astype(np.int8), *grids[1:]), run)


def description(plane: Plane, coarse: int, levels: int) -> dict[str, Any]:
    """Return the description that identifies a map: maps with equal descriptions are the same."""
    value = {
        "schema": 1,
        "device": device_to_text(plane.device),
        "x": asdict(plane.x),
        "y": asdict(plane.y),
        "stiffness": plane.stiffness,
        "damping": plane.damping,
        "trial": asdict(plane.trial),
        "one_sided": plane.one_sided,
        "coarse": coarse,
        "levels": levels,
        "points_a_part": CHUNK,
    }
    text = json.dumps(value, sort_keys=True, allow_nan=False)
    digest = hashlib.sha256(text.encode()).hexdigest()
    return value | {"sha256": digest, "engine": cache_folder().name}


def save_map(result: FateMap, file: Path, *, overwrite: bool = False) -> Path:
    """Write a map as NetCDF with units and attributes, whole or not at all; returns the path.

    The dimensions are the quantities of the axes: (K, B) for the usual map. Equal maps give equal
    bytes. An existing file is replaced only if this function wrote it and it was not edited since,
    or with overwrite. Otherwise raises Protected. Raises OSError if the file cannot be written.
    """
    with writing_as("save_map", overwrite):
        return write_bytes(file, bytes(map_dataset(result).to_netcdf(engine="scipy")))


def map_dataset(result: FateMap) -> "Dataset":
    """Return a map as an `xarray.Dataset` with units, over y and x."""
    import xarray  # its import takes half a second and only saving a map needs it

    plane = result.plane
    unit, force = ("rad", "N m") if plane.device.rotary else ("m", "N")
    rests, grows = result.transitions()
    across, up = (dimension(axis.quantity) for axis in (plane.x, plane.y))
    whole = (up, across)
    contents: dict[str, Any] = {
        "fate": (whole, result.fates.fate, {
            "flag_values": np.array([int(f) for f in Fate], dtype=np.int8),
            "flag_meanings": " ".join(f.word for f in Fate),
        }),
        "rate": (whole, result.fates.rate, {"units": "1/s"}),
        "amplitude": (whole, result.fates.amplitude, {"units": unit}),
        "force": (whole, result.fates.force, {"units": force}),
        "frequency": (whole, result.fates.frequency, {"units": "Hz"}),
        "run": (whole, result.run.astype(np.int8), {"long_name": "simulated, not filled in"}),
        "linear": (whole, result.linear, {"long_name": "spectral radius less one"}),
        "rests_up_to": (across, rests, {"long_name": f"{up} up to which all runs rest",
                                        "units": units_of(plane, plane.y.quantity)}),
        "grows_from": (across, grows, {"long_name": f"{up} from which a run grows",
                                       "units": units_of(plane, plane.y.quantity)}),
    }  # fmt: skip
    axes = {
        name: (name, values, {"long_name": axis.quantity, "units": units_of(plane, axis.quantity)})
        for name, values, axis in ((across, result.x, plane.x), (up, result.y, plane.y))
    }
    identity = description(plane, 3, 0)
    attributes = {
        "title": f"what becomes of a run of {plane.device.name}",
        "runs": result.runs,
        "device": identity["device"],
        "settings": json.dumps({q: str(v) for q, v in plane.at({}).items()}),
        "trial": json.dumps(identity["trial"]),
        "one_sided": int(plane.one_sided),
    }
    return xarray.Dataset(contents, axes, attributes)


def dimension(quantity: str) -> str:
    """Return the name of a quantity's dimension in a file, in which `amplitude` is a result."""
    return "start_amplitude" if quantity == "amplitude" else quantity


def units_of(plane: Plane, quantity: str) -> str:
    """Return the unit of a quantity of a plane."""
    angle, force = ("rad", "N m") if plane.device.rotary else ("m", "N")
    return {
        "K": f"{force}/{angle}", "B": f"{force} s/{angle}", "delay": "s", "encoder_step": angle,
        "command_limit": force, "friction": force, "amplitude": angle, "cutoff": "Hz",
    }[quantity]  # fmt: skip
