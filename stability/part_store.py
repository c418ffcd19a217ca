"""The parts of a map in a folder while it is made: each written whole, read again when taken up.

A folder holds `plane.json` (what the map is of) and `part-00000.npz`, ..., numbered in the order in
which the map needs them and written in the order in which they are finished. A run that stops,
however abruptly, leaves whole parts. The next one checks that they are of the same plane, and runs
those that are missing or damaged.
"""

import io
import json
import os
import zipfile
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stability.fates import Fates

UNREADABLE = (OSError, ValueError, KeyError, EOFError, AttributeError, zipfile.BadZipFile)


class PartStore:
    """The parts of one map in a folder.

    identity: what the map is of; under "sha256" and "engine" it has its digest and that of the code
    that makes it. Raises ValueError where the folder holds another map, OSError where it cannot be
    made.
    """

    def __init__(self, folder: Path, identity: dict[str, Any]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        file = folder / "plane.json"
        if not file.exists():
            write_whole(file, json.dumps(identity, indent=2, allow_nan=False).encode())
            return
        try:
            earlier = json.loads(file.read_text(encoding="utf-8"))
            digest, engine = earlier["sha256"], earlier["engine"]
        except (ValueError, KeyError, TypeError):
            raise ValueError(f"{file} is damaged; remove {folder}, or choose another") from None
        for found, wanted, what in (
            (digest, identity["sha256"], "of another plane"),
            (engine, identity["engine"], "begun with another version of the program"),
        ):
            if found != wanted:
                raise ValueError(
                    f"{folder} holds a map {what}; choose another folder, or remove it"
                )

    def read(self, number: int, points: NDArray[np.int64]) -> Fates | None:
        """Return a part if it is there, whole, and of these points."""
        try:
            content = io.BytesIO(self._file(number).read_bytes())
            with np.load(content, allow_pickle=False) as part:
                if not np.array_equal(part["points"], points):
                    return None
                found = Fates(*(part[f.name] for f in fields(Fates)))
        except UNREADABLE:
            return None
        if any(getattr(found, f.name).shape != points.shape for f in fields(Fates)):
            return None
        return found

    def write(self, number: int, points: NDArray[np.int64], found: Fates) -> None:
        """Write a part, whole or not at all; raises OSError.

        A power cut may take the last of them, which are then run again: to wait for the disk at
        every part would take ten times as long as to write it.
        """
        buffer = io.BytesIO()
        np.savez(buffer, points=points, **{f.name: getattr(found, f.name) for f in fields(found)})
        write_whole(self._file(number), buffer.getvalue(), wait=False)

    def _file(self, number: int) -> Path:
        return self.folder / f"part-{number:05d}.npz"


def write_whole(file: Path, content: bytes, wait: bool = True) -> None:
    """Write a file that is seen whole or not at all; raises OSError.

    wait: until the disk has it, so that it is whole after a power cut, too.
    The draft's name is always the same, so what a killed process left of it is written over.
    """
    draft = file.with_name(f".{file.name}.draft")
    try:
        with draft.open("wb") as stream:
            stream.write(content)
            stream.flush()
            if wait:
                os.fsync(stream.fileno())
        draft.replace(file)
    except OSError as error:
        with suppress(OSError):
            draft.unlink()
        raise OSError(error.errno, error.strerror or str(error), str(file)) from error
