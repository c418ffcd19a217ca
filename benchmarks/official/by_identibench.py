"""The same answers in `identibench`: its data, its window, its metric, its runner."""

import os
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.official.boards import Board
from zwidth import Diagnosis

Floats = NDArray[np.float64]
Model = Callable[[Floats, Floats, dict[str, Any]], Floats]


def model_of(board: Board, answer: Diagnosis) -> Model:
    """Return what `identibench` calls a model: u (ticks, 1), y_init (n, 1), attrs -> (ticks, 1)."""
    return lambda u, y_init, attrs: board.predicted(answer, u, y_init)[:, None]


def scores(board: Board, answer: Diagnosis, trained_on: Any, folder: Path) -> dict[str, float]:
    """Return the score of each test set in the benchmark's unit (hence `identibench`'s factor).

    trained_on: what the answer is of; folder: as of `boards.placed`. Raises ValueError if
    `identibench` would train on anything else.
    """
    import identibench
    from identibench.datasets import workshop

    def build(context: Any) -> Model:
        (train,) = context.get_train_valid_sequences()
        same = np.allclose(np.ravel(train.u), np.ravel(trained_on.u), rtol=1e-6) and np.allclose(
            np.ravel(train.y), np.ravel(trained_on.y), rtol=1e-5
        )  # its files hold single precision
        if not same:
            raise ValueError(f"identibench trains {board.name} on other data than this answer's")
        return model_of(board, answer)

    with _at_home(folder):
        result = identibench.run_benchmark(getattr(workshop, board.identibench), build, seed=0)
    return {name: next(iter(each.values())) for name, each in result["test_sets"].items()}


@contextmanager
def _at_home(folder: Path) -> Generator[None]:
    """Let the loaders, which look under the user's home, find the files that are there already."""
    home = folder / "home"
    home.mkdir(exist_ok=True)
    there = home / ".nonlinear_benchmarks"
    if not there.exists():
        there.symlink_to(folder.resolve(), target_is_directory=True)
    own = {name: os.environ.get(name) for name in ("HOME", "IDENTIBENCH_DATA_ROOT")}
    os.environ |= {"HOME": str(home.resolve()), "IDENTIBENCH_DATA_ROOT": str(home / "identibench")}
    try:
        yield
    finally:
        for name, value in own.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value
