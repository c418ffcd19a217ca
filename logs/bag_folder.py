"""Recordings of ROS 2 without ROS: a folder of `ros2 bag record`, or one SQLite3 file of it.

A folder holds metadata.yaml and one or more files, MCAP or SQLite3 (.db3), which follow each other.
Of metadata.yaml only the names of these files are taken, and only files in the folder itself. In a
SQLite3 file messages lie in CDR, as in MCAP; from ROS 2 Iron on it has the definitions of their
types. For older ones the definitions of standard types come from `rosbags`.
"""

import re
import sqlite3
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
from mcap.records import Channel, Message, Schema

from zwidth.logs.foreign_mcap import Topic, open_topic, read_foreign_mcap, signals_of
from zwidth.logs.opening import opened
from zwidth.logs.source import RecordingError, Signal, Source

METADATA, MARK = "metadata.yaml", "rosbag2_bagfile_information:"
SQLITE = b"SQLite format 3\x00"
LARGEST = 1 << 20  # bytes of metadata.yaml
LISTED = re.compile(r"^\s*-\s*[\"']?(.+?)[\"']?\s*$")
COMPRESSED = re.compile(r"^\s*compression_mode:\s*[\"']?(FILE|MESSAGE)\b", re.MULTILINE)


def is_bag(path: Path) -> bool:
    """Whether a path is a folder that `ros2 bag record` wrote."""
    file = path / METADATA
    try:
        if not path.is_dir() or not file.is_file() or file.stat().st_size > LARGEST:
            return False
        return MARK in file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False


def read_bag(path: Path) -> Source:
    """Return the signals of a folder, its files joined; raises RecordingError, LogError."""
    files = bag_files(path)
    parts = [_part(file) for file in files]
    return replace(_joined(parts), path=path, kind=f"ROS 2 bag of {len(files)} file(s)")


def bag_files(path: Path) -> list[Path]:
    """Return the files of a folder in their order.

    Raises RecordingError where metadata.yaml names a file that is not there or lies elsewhere, none
    at all, or says that they are compressed.
    """
    with opened(path / METADATA) as file:
        text = file.read(LARGEST).decode("utf-8", "replace")
    if (mode := COMPRESSED.search(text)) is not None:
        raise RecordingError(
            f"{path.name} is compressed by {mode[1].lower()}, which is not read; convert it with"
            " 'ros2 bag convert'"
        )
    _, _, rest = text.partition("relative_file_paths:")
    names: list[str] = []
    for line in rest.splitlines()[1:]:
        if (found := LISTED.match(line)) is None:
            break
        names.append(found[1])
    if not names:
        raise RecordingError(f"{METADATA} of {path.name} names no file; record it again")
    for name in names:
        if Path(name).name != name or name == "..":
            raise RecordingError(
                f"{METADATA} of {path.name} names {name!r}, which is no file in that folder"
            )
        if not (path / name).is_file():
            raise RecordingError(f"{path.name} lacks {name!r}, which its {METADATA} names; add it")
    return [path / name for name in names]


def read_sqlite(path: Path, data: bytes) -> Source:
    """Return the signals of one SQLite3 file of a bag; raises RecordingError. data: not needed."""
    del data
    topics: dict[int, Topic | str] = {}
    notes: list[str] = []
    log = path.with_name(f"{path.name}-wal")
    if log.is_file() and log.stat().st_size:
        notes.append(f"{path.name} was not closed; what is in {log.name} alone is not read")
    address = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(address, uri=True)) as base:
            base.execute("PRAGMA trusted_schema = OFF")
            definitions = _definitions(base)
            for number, name, kind, form in base.execute(
                "SELECT id, name, type, serialization_format FROM topics"
            ):
                topics[int(number)] = _topic(int(number), str(name), str(kind), str(form),
                                             definitions.get(str(kind)))  # fmt: skip
            for number, stamp, body in base.execute(
                "SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id"
            ):
                topic = topics.get(int(number))
                if isinstance(topic, Topic):
                    topic.take(Message(int(number), int(stamp), bytes(body), int(stamp), 0))
    except (sqlite3.Error, TypeError, ValueError) as error:
        raise RecordingError(f"{path.name} is no bag of ROS 2 that can be read: {error}") from None
    signals, aside, unreadable, said = signals_of(list(topics.values()))
    return Source(path, "ROS 2 bag", signals, unreadable, tuple(notes + said), aside=aside)


def _definitions(base: sqlite3.Connection) -> dict[str, str]:
    """The definitions of types that a file has, by their names; none before ROS 2 Iron."""
    tables = {str(name) for (name,) in base.execute("SELECT name FROM sqlite_master")}
    if "message_definitions" not in tables:
        return {}
    rows = base.execute("SELECT topic_type, encoding, encoded_message_definition"
                        " FROM message_definitions")  # fmt: skip
    return {str(kind): str(text) for kind, form, text in rows if form == "ros2msg" and text}


def _topic(number: int, name: str, kind: str, form: str, definition: str | None) -> Topic | str:
    text = _standard(kind) if definition is None else definition
    if text is None:
        return (
            f"{name} is of {kind}, whose definition the bag lacks; 'pip install zwidth[ros]' brings"
            " those of standard types"
        )
    schema = Schema(data=text.encode(), encoding="ros2msg", id=number, name=kind)
    return open_topic(Channel(number, name, form, {}, number), schema)


def _standard(kind: str) -> str | None:
    """The definition of a standard type of ROS 2, None without `rosbags` or for another one."""
    try:
        from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports]
    except ImportError:
        return None
    try:
        return get_typestore(Stores.ROS2_HUMBLE).generate_msgdef(kind, ros_version=2)[0]
    except KeyError:
        return None


def _part(file: Path) -> Source:
    with opened(file) as stream:
        start = stream.read(len(SQLITE))
        stream.seek(0)
        if start == SQLITE:
            return read_sqlite(file, b"")
        return read_foreign_mcap(file, stream)


def _joined(parts: Sequence[Source]) -> Source:
    """The signals of files that follow each other as those of one."""
    first, *others = parts
    if not others:
        return first
    notes = tuple(dict.fromkeys(note for part in parts for note in part.notes))
    unreadable = {name: why for part in parts for name, why in part.unreadable.items()}
    return replace(
        first,
        signals=_after_each_other([part.signals for part in parts]),
        aside=_after_each_other([part.aside for part in parts]),
        unreadable=unreadable,
        notes=notes,
    )


def _after_each_other(parts: Sequence[Mapping[str, Signal]]) -> dict[str, Signal]:
    found: dict[str, Signal] = {}
    for name in dict.fromkeys(name for part in parts for name in part):
        own = [part[name] for part in parts if name in part]
        clocks = set.intersection(*(set(one.stamps) for one in own))
        stamps = {clock: np.concatenate([one.stamps[clock] for one in own]) for clock in clocks}
        values = np.concatenate([one.values for one in own])
        found[name] = replace(own[0], values=values, stamps=stamps)
    return found
