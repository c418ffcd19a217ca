"""The parts of a map in a folder while it is made: each written whole, read again when taken up.

A folder holds `plane.json` (what the map is of) and `part-00000.npz`, ... in the order of the run.
A run that stops, however abruptly, leaves whole parts. The next one checks that they are of the
same plane, and goes on behind the last of them; a part that is damaged is run again.
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
        self.folder, self.next = folder, 0
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

    def read(self, points: NDArray[np.int64]) -> Fates | None:
        """Return the next part if it is there, whole, and of these points."""
        try:
            content = io.BytesIO(self._file().read_bytes())
            with np.load(content, allow_pickle=False) as part:
                if not np.array_equal(part["points"], points):
                    return None
                found = Fates(*(part[f.name] for f in fields(Fates)))
        except UNREADABLE:
            return None
        if any(getattr(found, f.name).shape != points.shape for f in fields(Fates)):
            return None
        self.next += 1
        return found

    def write(self, points: NDArray[np.int64], found: Fates) -> None:
        """Write the next part, whole or not at all; raises OSError."""
        buffer = io.BytesIO()
        np.savez(buffer, points=points, **{f.name: getattr(found, f.name) for f in fields(found)})
        write_whole(self._file(), buffer.getvalue())
        self.next += 1

    def _file(self) -> Path:
        return self.folder / f"part-{self.next:05d}.npz"


def write_whole(file: Path, content: bytes) -> None:
    """Write a file that is seen whole or not at all; raises OSError.

    The draft's name is always the same, so what a killed process left of it is written over.
    """
    draft = file.with_name(f".{file.name}.draft")
    try:
        with draft.open("wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        draft.replace(file)
    except OSError as error:
        with suppress(OSError):
            draft.unlink()
        raise OSError(error.errno, error.strerror or str(error), str(file)) from error
