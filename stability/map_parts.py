"""The parts of one round of a map: read from the store, or run by an executor."""

from collections.abc import Generator, Mapping
from dataclasses import asdict, fields
from functools import partial

import numpy as np
from numpy.typing import NDArray

from zwidth.jobs.executor import AHEAD, Executor
from zwidth.jobs.store import PartStore
from zwidth.stability.fates import Fates, evaluate
from zwidth.stability.plane import Floats, Plane

Points = NDArray[np.int64]
Bundle = list[tuple[Floats, Floats]]  # x and y of the points of some parts
MOST_TOGETHER = 16  # parts per task


def run_parts(
    plane: Plane,
    axes: tuple[Floats, Floats],
    parts: Mapping[int, Points],
    store: PartStore | None,
    runner: Executor,
    workers: int | None,
) -> Generator[tuple[int, Fates]]:
    """Yield (number, fates) of every part: those in the store first, others as they finish.

    parts: flat indices into the lattice of the axes (x, y). A part is stored before it is yielded.
    If far more parts are missing than there are cores, several parts form one task.
    """
    missing: list[int] = []
    for number, points in parts.items():
        found = None if store is None else _read(store, number, points)
        if found is None:
            missing.append(number)
        else:
            yield number, found
    together = _together(len(missing), runner.cores)
    numbers = {
        f"part-{missing[i]:05d}": missing[i : i + together]
        for i in range(0, len(missing), together)
    }
    tasks = {key: [_places(axes, parts[n]) for n in some] for key, some in numbers.items()}
    for key, results in runner.run(partial(_evaluate, plane, workers), tasks):
        for number, found in zip(numbers[key], results, strict=True):
            if store is not None:
                store.write(number, {"points": parts[number], **asdict(found)})
            yield number, found


def _read(store: PartStore, number: int, points: Points) -> Fates | None:
    """Return a part if the store has it, complete and with these points; else None."""
    names = [f.name for f in fields(Fates)]
    part = store.read(number) or {}
    if not all(name in part and part[name].shape == points.shape for name in ("points", *names)):
        return None
    return Fates(*(part[n] for n in names)) if np.array_equal(part["points"], points) else None


def _together(parts: int, cores: int) -> int:
    """Parts per task: several if much work is left, so that a task is worth its overhead."""
    return 1 if cores == 1 else max(1, min(MOST_TOGETHER, parts // (AHEAD * cores)))


def _places(axes: tuple[Floats, Floats], points: Points) -> tuple[Floats, Floats]:
    x, y = axes
    return x[points % x.size], y[points // x.size]


def _evaluate(plane: Plane, workers: int | None, bundle: Bundle) -> list[Fates]:
    return [evaluate(plane, x, y, workers) for x, y in bundle]
