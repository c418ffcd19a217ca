"""Recordings of ROS 2 without ROS: a folder of `ros2 bag record`, or one SQLite3 file of it.

A folder contains metadata.yaml and one or more consecutive files, MCAP or SQLite3 (.db3). Only the
names of these files are read from metadata.yaml, and only files in the folder itself are used.
Messages in a SQLite3 file are in CDR, as in MCAP; from ROS 2 Iron on it has the definitions of
their types. For older files the definitions of standard types come from `rosbags`.

A bag may be compressed by zstd: each file as a whole (NAME.zstd), or each message by itself, which
only metadata.yaml states.
"""

import re
import sqlite3
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

import numpy as np
from mcap.records import Channel, Message, Schema
from zstandard import ZstdDecompressor, ZstdError, frame_content_size

from zwidth.logs.foreign_mcap import Topic, open_topic, read_foreign_mcap, signals_of
from zwidth.logs.opening import opened
from zwidth.logs.source import RecordingError, Signal, Source
from zwidth.logs.sqlite_tables import Tables, tables
from zwidth.logs.unpacked import most_bytes

METADATA, MARK = "metadata.yaml", "rosbag2_bagfile_information:"
SQLITE = b"SQLite format 3\x00"
LARGEST = 1 << 20  # bytes of metadata.yaml
LISTED = re.compile(r"^\s*-\s*[\"']?(.+?)[\"']?\s*$")
MODE = re.compile(r"^\s*compression_(mode|format):\s*[\"']?(\w+)", re.MULTILINE)
ZSTD = b"\x28\xb5\x2f\xfd"
MOST_DEFINED = 1 << 22  # characters of definitions, each counted once per topic of its type
MOST_BYTES, MOST_OF_MESSAGE = 1 << 33, 1 << 28  # of an unpacked file, and of a message


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
    files, unpack = bag_files(path), _unpacks_messages(path)
    parts = [_part(file, unpack) for file in files]
    return replace(_joined(parts), path=path, kind=f"ROS 2 bag of {len(files)} file(s)")


def bag_files(path: Path) -> list[Path]:
    """Return the files of a folder in their order.

    Raises RecordingError if metadata.yaml names a file that is not there or lies elsewhere, none
    at all, or a compression that is not zstd.
    """
    text = _metadata(path)
    kind = dict(MODE.findall(text)).get("format", "zstd").lower()
    if kind != "zstd":
        raise RecordingError(
            f"{path.name} is compressed by {kind}, which is not read; convert it with"
            " 'ros2 bag convert'"
        )
    _, _, rest = text.partition("relative_file_paths:")
    names: list[str] = []
    for line in rest.splitlines()[1:]:
        if (found := LISTED.match(line)) is None:
            break
        names.append(found[1])
    if not names:
        raise RecordingError(f"{METADATA} of {path.name} lists no file; record it again")
    for name in names:
        if Path(name).name != name or name == "..":
            raise RecordingError(
                f"{METADATA} of {path.name} lists {name!r}, which is not a file in that folder"
            )
        if not (path / name).is_file():
            raise RecordingError(f"{path.name} lacks {name!r}, which its {METADATA} lists; add it")
    return [path / name for name in names]


def _metadata(path: Path) -> str:
    with opened(path / METADATA) as file:
        return file.read(LARGEST).decode("utf-8", "replace")


def _unpacks_messages(path: Path) -> Callable[[bytes], bytes] | None:
    """Return what unpacks a message, None if messages are not compressed by themselves."""
    mode = dict(MODE.findall(_metadata(path))).get("mode", "")
    return _unpacked if mode.lower() == "message" else None


def _unpacked(data: bytes) -> bytes:
    """Return a message; raises ValueError for one that is damaged, or larger than messages are."""
    try:
        if frame_content_size(data) > MOST_OF_MESSAGE:
            raise ValueError(f"a message unpacks to more than {MOST_OF_MESSAGE >> 20} MiB")
        return ZstdDecompressor().decompress(data, max_output_size=MOST_OF_MESSAGE)
    except ZstdError as error:
        raise ValueError(str(error)) from None


def read_sqlite(path: Path, data: bytes, unpack: Callable[[bytes], bytes] | None = None) -> Source:
    """Return the signals of one SQLite3 file of a bag; raises RecordingError. data: not needed.

    unpack: decompresses a message, if each was compressed by itself.
    """
    del data
    topics: dict[int, Topic | str] = {}
    notes: list[str] = []
    log = path.with_name(f"{path.name}-wal")
    if log.is_file() and log.stat().st_size:
        notes.append(f"{path.name} was not closed; what is in {log.name} alone is not read")
    unpacked, defined = 0, 0
    try:
        with tables(path) as base:
            most = most_bytes(base.size, MOST_BYTES)
            definitions = _definitions(base)
            for number, name, kind, form in base.rows(
                "topics", "id, name, type, serialization_format"
            ):
                definition = definitions.get(str(kind))
                defined += len(definition or "")
                if defined > MOST_DEFINED:
                    raise ValueError(
                        f"the definitions of its topics have more than {MOST_DEFINED} characters;"
                        " record fewer topics"
                    )
                topics[int(number)] = _topic(
                    int(number), str(name), str(kind), str(form), definition
                )
            for number, stamp, body in base.rows(
                "messages", "topic_id, timestamp, data", "timestamp, id"
            ):
                topic = topics.get(int(number))
                if isinstance(topic, Topic):
                    told = _told(body, unpack)
                    unpacked += len(told)
                    if unpacked > most:
                        raise ValueError(
                            f"its messages unpack to more than {most >> 20} MiB, too much for a"
                            " file of this size; record a shorter bag"
                        )
                    topic.take(Message(int(number), int(stamp), told, int(stamp), 0))
    except RecordingError:
        raise
    except (sqlite3.Error, TypeError, ValueError, OverflowError) as error:
        raise RecordingError(f"{path.name} is not a readable ROS 2 bag: {error}") from None
    signals, aside, unreadable, said = signals_of(list(topics.values()))
    return Source(path, "ROS 2 bag", signals, unreadable, tuple(notes + said), aside=aside)


def _told(body: object, unpack: Callable[[bytes], bytes] | None) -> bytes:
    if not isinstance(body, bytes):
        raise ValueError(f"a message has {str(body)[:20]!r} for its data, which are bytes")
    return body if unpack is None else unpack(body)


def _definitions(base: Tables) -> dict[str, str]:
    """The definitions of types that a file has, by their names; none before ROS 2 Iron."""
    if not base.has("message_definitions"):
        return {}
    rows = base.rows("message_definitions", "topic_type, encoding, encoded_message_definition")
    return {str(kind): str(text) for kind, form, text in rows if form == "ros2msg" and text}


def _topic(number: int, name: str, kind: str, form: str, definition: str | None) -> Topic | str:
    text = _standard(kind) if definition is None else definition
    if text is None:
        return (
            f"{name} is of {kind}, whose definition the bag lacks; 'pip install zwidth[ros]'"
            " installs those of standard types"
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


def _part(file: Path, unpack: Callable[[bytes], bytes] | None) -> Source:
    with opened(file) as stream:
        start = stream.read(len(SQLITE))
        stream.seek(0)
        if start.startswith(ZSTD):
            with TemporaryDirectory(prefix="zwidth-bag-") as folder:
                return _part(_whole(file, stream, Path(folder)), unpack)
        if start == SQLITE:
            return read_sqlite(file, b"", unpack)
        return read_foreign_mcap(file, stream, unpack)


def _whole(file: Path, stream: BinaryIO, folder: Path) -> Path:
    """Unpack a file of a bag; raises RecordingError if it is damaged or too large."""
    target, size = folder / file.name.removesuffix(".zstd"), 0
    most = most_bytes(file.stat().st_size, MOST_BYTES)
    try:
        with target.open("wb") as out:
            for piece in ZstdDecompressor().read_to_iter(stream):
                size += len(piece)
                if size > most:
                    raise RecordingError(
                        f"{file.name} unpacks to more than {most >> 20} MiB; unpack it"
                        " yourself and take a part of it"
                    )
                out.write(piece)
    except ZstdError as error:
        raise RecordingError(f"{file.name} cannot be unpacked: {error}") from None
    if size == 0:
        raise RecordingError(f"{file.name} cannot be unpacked: it is damaged or cut short")
    return target


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
