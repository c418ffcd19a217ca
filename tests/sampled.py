"""The shipped sample, diagnosed once for all tests that ask something of the answer."""

import contextlib
import json
import pickle
import shutil
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import pytest

import zwidth.diagnose_files
from zwidth import cli
from zwidth.diagnosis.answer.result import Diagnosis
from zwidth.diagnosis.mishaps import silent
from zwidth.errors import Status

SAMPLE = Path(__file__).parents[1] / "docs" / "sample" / "bench.csv"


@dataclass(frozen=True)
class Sampled:
    """What the command of the first page, at its defaults, has written in a folder.

    It is shared by all processes of the tests: read it, and write elsewhere.
    """

    folder: Path

    @cached_property
    def found(self) -> Diagnosis:
        """The diagnosis itself."""
        return pickle.loads((self.folder / "answer.pickle").read_bytes())

    @cached_property
    def answer(self) -> dict[str, Any]:
        """The answer as JSON."""
        return json.loads((self.folder / "answer.json").read_text())

    @property
    def device(self) -> Path:
        """The file of the improved device."""
        return self.folder / self.answer["augmented_device"]


def diagnose_sample(folder: Path) -> None:
    """Run the command on the sample in an empty folder, and keep the diagnosis beside its files."""
    shutil.copy(SAMPLE, folder)
    kept: list[Diagnosis] = []
    real = zwidth.diagnose_files.diagnose

    def diagnose(*asked: Any) -> Diagnosis:
        kept.append(real(*asked))
        return kept[-1]

    with pytest.MonkeyPatch.context() as patch, contextlib.chdir(folder):
        patch.setattr(zwidth.diagnose_files, "diagnose", diagnose)
        assert cli.run(["diagnose", SAMPLE.name, "--json", "answer.json"]) == Status.DONE
    (found,) = kept
    found.searched.tried.say = silent  # of the command's own, a closure, no copy can be made
    (folder / "answer.pickle").write_bytes(pickle.dumps(found))
