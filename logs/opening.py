"""Opens files for reading; a sentence explains each way in which this can fail."""

import stat
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from zwidth.files.protection import reading
from zwidth.logs.errors import LogEmpty, LogIsDirectory, LogNotFound, LogNotReadable


@contextmanager
def opened(path: Path) -> Generator[BinaryIO]:
    """Open a regular file that is not empty.

    Raises LogNotFound, LogIsDirectory, LogNotReadable or LogEmpty, also for errors in the block.
    """
    if "\0" in str(path):
        raise LogNotFound(f"{str(path)!r} cannot be the name of a file; check the name")
    try:
        if not path.is_dir() and not stat.S_ISREG(path.stat().st_mode):
            raise LogNotReadable(f"{path} is not a regular file; give a recording or a log")
        with reading(path).open("rb") as file:
            if not file.read(1):
                raise LogEmpty(f"{path} is empty; check the program that wrote it")
            file.seek(0)
            yield file
    except FileNotFoundError:
        raise LogNotFound(f"{path} does not exist{_unfinished(path)}") from None
    except IsADirectoryError:
        raise LogIsDirectory(f"{path} is a folder; give a file in it") from None
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise LogNotReadable(f"{path} cannot be read: {reason}") from None


def _unfinished(path: Path) -> str:
    partial = path.with_name(f"{path.stem}.partial{path.suffix}")
    if partial.exists():
        return f"; {partial.name}, left there by a run that was not finished, does: read that"
    return "; check the name"
