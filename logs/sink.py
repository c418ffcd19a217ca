"""The file of a log: written in whole pieces, and renamed when it is complete.

While a log is written it is called NAME.partial.mcap, beside NAME.mcap; a good file of that name
stays untouched until the new one is complete, and after a crash the partial file is still there.
"""

import errno
import os
from contextlib import suppress
from pathlib import Path

from zwidth.files.protection import begin
from zwidth.logs.errors import LogPathError, LogWriteError

NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
MOST_PARTIAL = 100


class Sink:
    """An append-only file. Every piece is passed to the operating system before append returns.

    For a reader, a piece is there whole or not at all: a piece cut short by a full disk is removed,
    one cut short by an interrupt is overwritten by the next. Appended data survive the end of this
    process, however it ends; only `finish` waits for the disk itself.

    Raises LogPathError if the file cannot be created, Protected for a user's file of that name,
    LogWriteError if the machine fails.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._writer = begin(path)
        self.partial, self._descriptor = _create(path)
        self.offset = 0
        self._open = True

    def append(self, data: bytes) -> int:
        """Write data at the end; return the offset at which it starts."""
        start = self.offset
        try:
            os.lseek(self._descriptor, start, os.SEEK_SET)
            rest = memoryview(data)
            while rest:
                rest = rest[os.write(self._descriptor, rest) :]
        except OSError as error:
            raise self._failed(error) from None
        self.offset = start + len(data)
        return start

    def close(self) -> None:
        """Close the partial file and leave it where it is."""
        if self._open:
            self._open = False
            with suppress(OSError):
                os.ftruncate(self._descriptor, self.offset)
            os.close(self._descriptor)

    def finish(self) -> None:
        """Wait until the file is on the disk, then give it its name."""
        try:
            os.fsync(self._descriptor)
            self.close()
            self._writer.put(self.partial, self.path)
        except OSError as error:
            raise self._failed(error) from None

    def _failed(self, error: OSError) -> LogWriteError:
        full = error.errno in NO_ROOM
        reason = "there is no room left" if full else (error.strerror or "writing failed").lower()
        remedy = "free some space" if full else "fix that"
        return LogWriteError(
            error.errno or errno.EIO,
            f"{reason}; what was logged before is kept in {self.partial.name}: {remedy} and run"
            " again",
            str(self.path),
        )


def _create(path: Path) -> tuple[Path, int]:
    for attempt in range(1, MOST_PARTIAL):
        number = "" if attempt == 1 else f"-{attempt}"
        try:
            real = Path(os.path.realpath(path))
            partial = real.with_name(f"{real.stem}.partial{number}{real.suffix}")
            _check_target(path)
            flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
            return partial, os.open(partial, flags, 0o666)
        except FileExistsError:
            continue
        except FileNotFoundError:
            reason = f"there is no folder {path.parent}; create it first"
        except PermissionError:
            reason = f"folder {path.parent} does not allow it; choose another"
        except OSError as error:
            reason = (error.strerror or "the operating system refuses").lower()
            if error.errno in NO_ROOM:
                raise LogWriteError(error.errno or 0, f"{reason}; free some", str(path)) from None
            reason += "; choose another path"
        raise LogPathError(f"cannot write {path}: {reason}")
    raise LogPathError(
        f"cannot write {path}: {MOST_PARTIAL - 1} unfinished logs of this name are in the folder;"
        " remove some"
    )


def _check_target(path: Path) -> None:
    if path.is_dir():
        raise LogPathError(f"{path} is a folder; give a file in it, such as {path / 'run.mcap'}")
    if path.exists() and not path.is_file():
        raise LogPathError(f"{path} is not a regular file; a log needs one, such as run.mcap")
    if path.exists() and not os.access(path, os.W_OK):
        raise LogPathError(f"{path} exists and is read-only; choose another name")
