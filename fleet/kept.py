"""A store of results, keyed by the content of each recording, so that no work is repeated.

    WORK/structure.json the structure, the number of recordings at its search, its device
    WORK/fits/KEY.json      the quick fit of a recording
    WORK/reasons/KEY.json why a recording is odd, and the expected values used

A key depends on the recording's bytes, the structure and the code, so only recordings that are new
or have changed are fitted. The structure is sought again if the device, the effort or the code has
changed, or if there are twice as many recordings.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from zwidth.files.whole import write_text
from zwidth.fleet.quick import Quick, from_arrays, run, to_arrays
from zwidth.fleet.reasons import Question, Reason
from zwidth.fleet.structure import Structure, structure_from
from zwidth.jobs.digest import code_digest
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_to_text

DAMAGED = (OSError, ValueError, KeyError, TypeError)
GROWN = 2.0  # growth of the number of recordings from which the structure is sought again
MOVED = 0.5  # deviations: change of expected values up to which a stored reason is valid


def digest(*words: str) -> str:
    """Return a short SHA-256 of words."""
    return hashlib.sha256("\0".join(words).encode()).hexdigest()[:24]


class Kept:
    """The folder of a fleet's results: made for this purpose, or not existing yet."""

    def __init__(self, folder: Path, device: Device, effort: str) -> None:
        self.folder = folder
        self.asked = digest(device_to_text(device), effort, code_digest(run))
        mark = folder / "structure.json"
        if folder.is_dir() and any(folder.iterdir()) and not mark.is_file():
            raise ValueError(f"{folder} holds other files; choose another folder with --out")

    def structure(self, recordings: int) -> Structure | None:
        """Return the stored structure, None if it must be sought (again)."""
        found = self._read(self.folder / "structure.json")
        try:
            same = found["asked"] == self.asked
            if not same or recordings >= GROWN * found["recordings"]:
                return None
            return structure_from(found["structure"])
        except DAMAGED:
            return None

    def keep_structure(self, structure: Structure, recordings: int) -> None:
        """Store a structure."""
        value = {
            "asked": self.asked,
            "recordings": recordings,
            "structure": structure.to_json(),
        }
        write_text(self.folder / "structure.json", json.dumps(value), own=True)

    def key(self, content: str, structure: Structure) -> str:
        """Return the key of a recording with that content."""
        return digest(content, structure.to_json(), self.asked)

    def fit(self, key: str, name: str) -> Quick | None:
        """Return a stored quick fit, with the present name of the recording."""
        try:
            return from_arrays({**self._read(self.folder / "fits" / f"{key}.json"), "name": name})
        except DAMAGED:
            return None

    def keep_fit(self, key: str, found: Quick) -> None:
        """Store a quick fit."""
        text = json.dumps(_plain(to_arrays(found)))
        write_text(self.folder / "fits" / f"{key}.json", text, own=True)

    def reason(self, key: str, question: Question) -> Reason | None:
        """Return a stored reason, unless the recording's expected values have changed since."""
        found = self._read(self.folder / "reasons" / f"{key}.json")
        try:
            moved = (np.array(found["expected"]) - question.expected) / question.spread
            if np.abs(moved).max(initial=0.0) > MOVED or found["name"] != question.name:
                return None
            gained = math.inf if found["gained"] is None else float(found["gained"])
            return Reason(found["kind"], found["sentence"], gained, tuple(found["parameters"]))
        except DAMAGED:
            return None

    def keep_reason(self, key: str, question: Question, found: Reason) -> None:
        """Store a reason."""
        value = {**vars(found), "name": question.name, "expected": question.expected.tolist()}
        text = json.dumps(_plain(value))
        write_text(self.folder / "reasons" / f"{key}.json", text, own=True)

    def _read(self, path: Path) -> dict[str, Any]:
        try:
            return cast("dict[str, Any]", json.loads(path.read_text(encoding="utf-8")))
        except DAMAGED:
            return {}


def _plain(value: Mapping[str, object]) -> dict[str, object]:
    """Values for JSON, which has no infinity: an infinite error is -1, an infinite gain null."""
    found = dict(value)
    if "errors" in found:
        found["errors"] = [
            e if math.isfinite(e) else -1.0 for e in cast("list[float]", found["errors"])
        ]
    if "gained" in found and not math.isfinite(cast("float", found["gained"])):
        found["gained"] = None
    return found
