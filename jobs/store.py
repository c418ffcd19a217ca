"""Results of numbered tasks in a folder: each is written whole and read again by a later run.

The folder has a description of the work and `part-00000.npz`, ..., numbered in the order in which
the work needs them and written as they are finished. A run that stops, however abruptly, leaves
only complete parts. The next run checks that they belong to the same work, and computes those that
are missing or damaged. With the description, the parts count as the work's own and may be
overwritten; a folder with parts but without a description is not touched.
"""

import io
import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.files.whole import write_bytes

Arrays = dict[str, NDArray[Any]]
UNREADABLE = (OSError, ValueError, KeyError, EOFError, AttributeError, zipfile.BadZipFile)


class PartStore:
    """The parts of one piece of work in a folder.

    identity: the description of the work, with its digest under "sha256" and the code's under
    "engine". what: the work and its subject in words, ("map", "plane"); the description is then in
    `plane.json`. Raises ValueError if the folder has other work, OSError if it cannot be created.
    """

    def __init__(self, folder: Path, identity: dict[str, Any], what: tuple[str, str]) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        work, subject = what
        file = folder / f"{subject}.json"
        if not file.exists():
            if next(folder.glob("part-*.npz"), None) is not None:
                raise ValueError(f"{folder} holds parts, but no {file.name}; choose another folder")
            text = json.dumps(identity, indent=2, allow_nan=False)
            write_bytes(file, text.encode(), own=True)
            return
        try:
            earlier = json.loads(file.read_text(encoding="utf-8"))
            digest, engine = earlier["sha256"], earlier["engine"]
        except (ValueError, KeyError, TypeError):
            raise ValueError(f"{file} is damaged; remove {folder}, or choose another") from None
        for found, wanted, difference in (
            (digest, identity["sha256"], f"of another {subject}"),
            (engine, identity["engine"], "begun with another version of the program"),
        ):
            if found != wanted:
                raise ValueError(
                    f"{folder} holds a {work} {difference}; choose another folder, or remove it"
                )

    def read(self, number: int) -> Arrays | None:
        """Return the arrays of a part by name; None if it is missing or damaged."""
        try:
            content = io.BytesIO(self._file(number).read_bytes())
            with np.load(content, allow_pickle=False) as part:
                return {name: part[name] for name in part.files}
        except UNREADABLE:
            return None

    def write(self, number: int, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Write a part, whole or not at all; raises OSError.

        A power cut may lose the last parts, which are then computed again: waiting for the disk
        would take ten times as long as writing a part.
        """
        buffer = io.BytesIO()
        # numpy 2.1 would treat allow_pickle as another array.
        np.savez(buffer, **dict(arrays))  # pyright: ignore[reportArgumentType]
        write_bytes(self._file(number), buffer.getvalue(), wait=False, own=True)

    def _file(self, number: int) -> Path:
        return self.folder / f"part-{number:05d}.npz"
