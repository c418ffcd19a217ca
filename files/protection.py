"""Protection of a user's files: records of inputs, of writers, and of earlier results.

A file may be written if none exists there, if what exists is empty, or if it is an earlier result
of the same writer that was not edited since (recognised by its SHA-256). `--force` of a command and
`overwrite=True` of a function lift this, but never for inputs: a command does not overwrite what it
has read (`reading`). All paths, links and hard links to a file count as the same file.

A writer is a command, within its `command` block, or a public function called from Python, which
declares this by `writing_as`; within a command, the command is the writer.

A note on each result is kept beside it, in `.zwidth-results/NAME.json`:

    {"by": "zwidth devices", "sha256": [of the new result, of the result that it replaces]}

The note is written before the result is moved into place, and with both sums, so that a result is
recognised even if the program is killed in between. Each result has its own note, so that programs
that write into one folder do not lose each other's notes. If the note cannot be written, the result
is written nevertheless.
"""

import hashlib
import json
import os
import warnings
from collections.abc import Generator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import NamedTuple

RECORDS = ".zwidth-results"
INPUT = "is an input"
ANOTHER = "give another file to write"

Identity = tuple[int, int]  # device and inode: the same for every path to a file


class Protected(ValueError):
    """A file must not be overwritten; the message explains why, and what to do."""


@dataclass
class Writer:
    """Who writes. inputs: files that were read, and why each is protected; late: late refusals.

    A command declares early what it will write (`check`). If a result is refused nevertheless when
    the work is done, it gets another name, the other results are written, and the command ends with
    the message in `late`. late is None for functions, which refuse at once.
    """

    name: str = "zwidth"
    overwrite: bool = False
    inputs: dict[Identity, str] = field(default_factory=dict[Identity, str])
    late: list[str] | None = None

    def objection(self, path: Path) -> tuple[str, str] | None:
        """Return why this writer may not write to a path and what to do instead; None if it may."""
        place = path.resolve()  # the path that `replacing` writes to, without ".."
        identity = _identity(place)
        if (
            identity is None or not place.is_file()
        ):  # a terminal, a pipe, /dev/null: nothing to lose
            return None
        if identity in self.inputs:
            return self.inputs[identity], ANOTHER
        if self.overwrite or place.stat().st_size == 0:  # an empty file needs no protection
            return None
        say = "use overwrite=True" if self.late is None else "use --force"
        remedy = f"give another name, move it away, or {say}"
        known = _record(place)
        if known.by != self.name:
            return f"was not written by '{self.name}'", remedy
        if _sha256(place) not in known.sha256:
            return f"was edited since '{self.name}' wrote it", remedy
        return None

    def put(self, draft: Path, path: Path, recorded: bool = True) -> None:
        """Move a finished draft to a path, or to another name if the path is protected.

        Raises OSError; Protected if the writer is a function, which gets no other name.
        """
        place, objection = path.resolve(), self.objection(path)
        if objection is not None:
            place = _free(place)
        if recorded:
            _remember(self.name, draft, place)
        draft.replace(place)
        if objection is not None:
            sentence = f"{path} {objection[0]}, so the result is in {place.name} instead"
            if self.late is None:
                raise Protected(sentence)
            self.late.append(sentence)


_writer: ContextVar[Writer | None] = ContextVar("writer", default=None)


def writer() -> Writer:
    """Return who writes now; a function without a name of its own writes as "zwidth"."""
    return _writer.get() or Writer()


def reading(path: Path, why: str = INPUT) -> Path:
    """Record that a user's file is about to be read, and return its path.

    why: what the file is, such as "is what rig.toml describes"; the first reason is kept.
    """
    identity = _identity(path)
    if identity is not None:
        writer().inputs.setdefault(identity, why)
    return path


def check(*paths: Path) -> None:
    """Raise Protected for the first path that may not be written now, or that is given twice.

    Commands call it for all that they will write as soon as they have read their inputs.
    """
    for path in paths:
        if objection := writer().objection(path):
            raise Protected(f"{path} {'; '.join(objection)}")
    places = [path.resolve() for path in paths]
    for path, place in zip(paths, places, strict=True):
        plain = place.is_file() or not place.exists()
        if plain and places.count(place) > 1:
            raise Protected(f"{path} would be written twice; {ANOTHER}")


def begin(path: Path, own: bool = False) -> Writer:
    """Return the writer for a path; raises Protected for a function that may not write there.

    own: the caller has verified that the existing file is its own, so only inputs are protected.
    """
    present = replace(writer(), overwrite=True) if own else writer()
    if present.late is None and (objection := present.objection(path)):
        raise Protected(f"{path} {'; '.join(objection)}")
    return present


def force() -> None:
    """Let the present command overwrite all files except its inputs."""
    writer().overwrite = True


@contextmanager
def command(name: str) -> Generator[None]:
    """Let a command write within the block.

    At the end it raises Protected if results could not replace existing files.
    """
    present = Writer(name, late=(late := list[str]()))
    token = _writer.set(present)
    try:
        yield
    except BaseException:
        for sentence in late:
            warnings.warn(sentence, stacklevel=2)
        raise
    finally:
        _writer.reset(token)
    if late:
        raise Protected("; ".join(late))


@contextmanager
def writing_as(function: str, overwrite: bool = False) -> Generator[None]:
    """Let a public function write within the block, unless it serves another writer."""
    if _writer.get() is not None:
        yield
        return
    token = _writer.set(Writer(f"zwidth.{function}", overwrite))
    try:
        yield
    finally:
        _writer.reset(token)


def _identity(path: Path) -> Identity | None:
    try:
        known = path.stat()
    except (OSError, ValueError):  # missing or impossible: opening it reports the error
        return None
    return known.st_dev, known.st_ino


def _sha256(path: Path) -> str | None:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return None


def _free(path: Path) -> Path:
    """Return the first free path among NAME-2, NAME-3, ... beside a path."""
    names = (path.with_name(f"{path.stem}-{n}{path.suffix}") for n in count(2))
    return next(name for name in names if not name.exists())


class _Record(NamedTuple):
    by: str = ""
    sha256: tuple[str, ...] = ()


def _record_file(path: Path) -> Path:
    return path.parent / RECORDS / f"{path.name}.json"


def _record(path: Path) -> _Record:
    """Return the record of a result; it names no writer if the record is missing or damaged."""
    try:
        known = json.loads(_record_file(path).read_bytes())
        return _Record(str(known["by"]), tuple(map(str, known["sha256"])))
    except (OSError, ValueError, KeyError, TypeError):
        return _Record()


def _remember(name: str, draft: Path, place: Path) -> None:
    """Record a draft as the result that will be at a place, with the result that it replaces.

    A user's file that --force replaces is not a result.
    """
    known, standing = _record(place), _sha256(place)
    earlier = [standing] if known.by == name and standing in known.sha256 else []
    text = json.dumps({"by": name, "sha256": [_sha256(draft), *earlier]})
    file = _record_file(place)
    record = file.with_name(f"{file.name}.{os.getpid()}.part")
    with suppress(OSError):
        file.parent.mkdir(exist_ok=True)
        record.write_text(text)
        record.replace(file)
