"""Tests are deterministic: hypothesis draws the same examples every time.

What takes long and is asked of by many tests is made once, over all processes of a run.
"""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from filelock import FileLock
from hypothesis import settings

if TYPE_CHECKING:
    from sampled import Sampled

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # small matrices, and tests run side by side

settings.register_profile("same", derandomize=True, deadline=None, database=None)
settings.load_profile("same")

MadeOnce = Callable[[str, Callable[[Path], object]], Path]


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> MadeOnce:
    """Give the folder of a name, which the first process that asks for it fills for all."""
    root = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        root = root.parent  # that of the run, in which each process has a folder of its own

    def folder(name: str, make: Callable[[Path], object]) -> Path:
        path, made = root / f"once-{name}", root / f"once-{name}.made"
        with FileLock(root / f"once-{name}.lock"):
            if not made.exists():
                shutil.rmtree(path, ignore_errors=True)  # what an error left
                path.mkdir()
                make(path)
                made.touch()
        return path

    return folder


@pytest.fixture(scope="session")
def sampled(made_once: MadeOnce) -> "Sampled":
    """The answer to the shipped sample."""
    from sampled import SAMPLE, Sampled, diagnose_sample

    if not SAMPLE.is_file():
        pytest.skip("not a clone: the wheel has no documentation")
    return Sampled(made_once("sample", diagnose_sample))
