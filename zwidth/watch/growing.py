"""The complete part of a growing log, from a file or a pipe: `Growing`.

Readers read complete files. So the data so far are copied to a file of the same name in a separate
folder: a text table up to its last complete line, an MCAP file entirely, since its reader ignores
an incomplete record.
"""

import os
import queue
import threading
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from mcap.writer import MCAP0_MAGIC

from zwidth.files.protection import INPUT, reading
from zwidth.logs.errors import LogIsDirectory, LogNotFound, LogNotReadable
from zwidth.logs.open_source import STARTS
from zwidth.logs.source import RecordingError

BLOCK = 1 << 20  # bytes copied at once
ENDS = ((b"\xff\xfe", b"\n\0"), (b"\xfe\xff", b"\0\n"))  # byte order mark, end of a line
WIDEST = 8  # bytes that identify the format

Take = Callable[[], tuple[bytes, bool]]
"""Returns the data since the last call, and whether nothing more will come."""


class Growing:
    """A copy, `spool`, of the received part of a log.

    take: returns new data; name: of the file, as its reader shows it. bytes: copied so far; ended:
    nothing more will come.
    """

    def __init__(self, take: Take, name: str, folder: Path) -> None:
        self.spool = folder / name
        self.ended = False
        self.bytes = 0
        self._take, self._begun, self._held = take, b"", b""

    @property
    def is_mcap(self) -> bool:
        """Whether it is an MCAP file."""
        return self._begun.startswith(MCAP0_MAGIC)

    def poll(self) -> int:
        """Copy new complete data, and return their bytes; raises RecordingError, OSError."""
        new, self.ended = self._take()
        if len(self._begun) < WIDEST:
            self._begun = (self._begun + new)[:WIDEST]
            _refuse_whole_formats(self.spool.name, self._begun)
        whole, self._held = self._whole(self._held + new)
        if whole:
            with self.spool.open("ab") as copy:
                copy.write(whole)
            self.bytes += len(whole)
        if self.is_mcap and not self.ended:
            self.ended = self._closed()
        return len(whole)

    def rest(self) -> bytes:
        """Return the held-back part of an incomplete line."""
        return self._held

    def _whole(self, data: bytes) -> tuple[bytes, bytes]:
        """Return the whole lines of new data, or records, and the rest."""
        if MCAP0_MAGIC.startswith(self._begun) and not self.is_mcap:
            return b"", data  # too little to decide
        if self.is_mcap:
            return data, b""
        end = next((e for mark, e in ENDS if self._begun.startswith(mark)), b"\n")
        at = data.rfind(end)
        while at >= 0 and len(end) == 2 and (self.bytes + at) % 2:
            at = data.rfind(end, 0, at + 1)  # halves of two characters are not an end of line
        cut = at + len(end) if at >= 0 else 0
        return data[:cut], data[cut:]

    def _closed(self) -> bool:
        """Whether an MCAP file has its end: the magic after a footer."""
        if self.bytes <= 2 * len(MCAP0_MAGIC):
            return False
        with self.spool.open("rb") as copy:
            copy.seek(-len(MCAP0_MAGIC), os.SEEK_END)
            return copy.read() == MCAP0_MAGIC


def of_file(path: Path, why: str = INPUT) -> Take:
    """Return a `Take` of a growing file; why: what the file is, as for `protection.reading`.

    It ends when the file is renamed or removed. Raises LogNotFound and other `logs.errors` if there
    is no file, and RecordingError, when called, if the file was started again.
    """
    if path.is_dir():
        raise LogIsDirectory(f"{path} is a folder; give the log that grows in it")
    if not path.exists():
        raise LogNotFound(f"{path} does not exist yet; start what writes it first")
    if not path.is_file():
        raise LogNotReadable(
            f"{path} is not a regular file; give '-' and send it to standard input"
        )
    reading(path, why)
    taken, first = 0, path.stat().st_ino

    def take() -> tuple[bytes, bool]:
        nonlocal taken
        try:
            file = path.open("rb")
        except FileNotFoundError:  # like NAME.partial.mcap, which becomes NAME.mcap at its end
            return b"", True
        with file:
            known = os.fstat(file.fileno())
            if known.st_size < taken or known.st_ino != first:
                raise RecordingError(
                    f"{path} was started again; run the same command again to follow it"
                )
            file.seek(taken)
            new = file.read(known.st_size - taken)
        taken += len(new)
        return new, False

    return take


def of_stream(stream: BinaryIO) -> Take:
    """Return a `Take` of a pipe that does not wait: a thread waits."""
    blocks: queue.SimpleQueue[bytes] = queue.SimpleQueue()

    def wait() -> None:
        while block := os.read(stream.fileno(), BLOCK):
            blocks.put(block)
        blocks.put(b"")

    threading.Thread(target=wait, daemon=True, name="standard input").start()

    def take() -> tuple[bytes, bool]:
        found: list[bytes] = []
        while not blocks.empty():
            if not (block := blocks.get()):
                blocks.put(b"")
                return b"".join(found), True
            found.append(block)
        return b"".join(found), False

    return take


def _refuse_whole_formats(name: str, begun: bytes) -> None:
    for start, _ in STARTS:
        if begun.startswith(start[:WIDEST]):
            raise RecordingError(
                f"{name} has a format that can only be read when it is complete; follow an MCAP"
                " file or a text table, or give this one to 'zwidth diagnose' when it is finished"
            )
