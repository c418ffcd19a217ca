"""Write a result whole or not at all: no reader sees half a file, no full disk loses the old one.

Nothing else in the package writes files, so this is where users' files are protected (see
`protection`).
"""

import json
import os
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any

from zwidth.files import protection


def check_folder(path: Path) -> None:
    """Raise OSError unless files can be written into the folder, whether or not it exists yet.

    The check writes a file, since permissions do not show what a file system allows, and leaves
    nothing behind.
    """
    missing = [folder for folder in (path, *path.parents) if not folder.exists()]
    try:
        path.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=path):
            pass
    finally:
        for folder in missing:
            with suppress(OSError):
                folder.rmdir()


@contextmanager
def replacing(path: Path, wait: bool = True, own: bool = False) -> Generator[IO[bytes]]:
    """Open a binary file that replaces `path` when the block ends without an error.

    Until then, and after an error, `path` keeps its old content. Folders are created. A path that
    is not a plain file (a terminal, a pipe, /dev/null) is written to directly. wait: until the file
    is on the disk, so that it is complete even after a power cut. own: the caller has verified that
    the existing file is its own, and keeps track of it. Raises OSError; Protected for a user's
    file.
    """
    writer = protection.begin(path, own)
    target = path.resolve()
    plain = target.is_file() or not target.exists()
    draft = target.with_name(f".{target.name}.{os.getpid()}.part") if plain else target
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with draft.open("wb") as stream:
            yield stream
            stream.flush()
            if plain and wait:
                os.fsync(stream.fileno())
        if plain:
            writer.put(draft, path, recorded=not own)
    except OSError as error:  # with the caller's path: the draft's name means nothing to the user
        raise OSError(error.errno, error.strerror or str(error), str(path)) from error
    finally:
        if plain:
            with suppress(OSError):
                draft.unlink()


def write_with(path: Path, write: Callable[[IO[bytes]], object]) -> Path:
    """Let `write` fill the file at `path`, whole or not at all; returns the path."""
    with replacing(path) as stream:
        write(stream)
    return path


def write_bytes(path: Path, content: bytes, wait: bool = True, own: bool = False) -> Path:
    """Write bytes, whole or not at all (see `replacing`); returns the path."""
    with replacing(path, wait, own) as stream:
        stream.write(content)
    return path


def write_text(path: Path, text: str, own: bool = False) -> Path:
    """Write UTF-8 text, whole or not at all (see `replacing`); returns the path."""
    return write_bytes(path, text.encode(), own=own)


def json_text(value: Any) -> str:
    """Return readable JSON; raises ValueError for NaN and infinities, which JSON does not have."""
    return json.dumps(value, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
