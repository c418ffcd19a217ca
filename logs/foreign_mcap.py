"""MCAP files of other tools: ROS 2 messages, flat JSON, flat protobuf.

A signal is called topic.field: "/command.data", "/wrench.wrench.force.z". Of a
sensor_msgs/msg/JointState it is topic.joint.quantity: "/joint_states.elbow.effort". Each signal has
the clocks of its messages: log_time, publish_time and, if the messages contain it, header.stamp,
stamp or timestamp.

A field that is a number in most messages of its topic is a signal, with a gap where a message lacks
it or has text instead; a field that fewer messages have is a signal with only their stamps.

If a file has joint states, its topics that are neither these nor commands are set aside, for a
description to name; images, point clouds and transforms are not decoded at all.

The file is read like a log of zwidth: a chunk with a wrong checksum is left out and reported.
"""

import json
import os
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import redirect_stderr
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Message, Schema
from mcap.stream_reader import breakup_chunk
from numpy.typing import NDArray

from zwidth.logs.cells import Tally
from zwidth.logs.framing import Walk
from zwidth.logs.records import Records
from zwidth.logs.source import RecordingError, Signal, Source
from zwidth.logs.summary import read_summary

DEEPEST = 8  # levels of nested messages
LONGEST = 1 << 17  # bytes of a ROS definition; parsing time grows with the square
MOST_ELEMENTS = 64  # of an array within a message
MOST_NOTES = 5
NANOSECONDS = 1_000_000_000
JOINT_STATE = ("position", "velocity", "effort")
STAMPS = (("header", "stamp"), ("stamp",), ("timestamp",))
CLOCKS = ("log_time", "publish_time", *(".".join(place) for place in STAMPS))

JOINTS = ("JointState", "DynamicJointState", "JointTrajectoryControllerState")
COMMANDS = (
    "Float32", "Float64", "Float32MultiArray", "Float64MultiArray", "JointTrajectory", "JointJog",
    "JointCommand", "MultiDOFCommand", "Wrench", "WrenchStamped",
)  # fmt: skip
NO_MOTION = (
    "Image", "CompressedImage", "CameraInfo", "PointCloud2", "PointCloud", "LaserScan", "TFMessage",
    "OccupancyGrid", "Log", "ParameterEvent", "Marker", "MarkerArray", "DiagnosticArray",
)  # fmt: skip

Leaves = dict[str, float | int | str]
Decoder = Callable[[bytes], Any]


@dataclass
class Series:
    """The values read of one field, the message index of each, and its texts."""

    values: list[float | int] = field(default_factory=list[float | int])
    rows: list[int] = field(default_factory=list[int])
    tally: Tally = field(default_factory=Tally)


@dataclass
class Topic:
    """The messages of one channel: their clocks, and the fields found so far.

    kind: the name of their type without its package, "JointState"; "" for none.
    """

    name: str
    decode: Decoder
    kind: str = ""
    clocks: dict[str, list[int | None]] = field(default_factory=dict[str, list[int | None]])
    series: dict[str, Series] = field(default_factory=dict[str, Series])
    count: int = 0
    undecoded: int = 0

    def take(self, message: Message) -> None:
        """Decode one message; a message that does not match its schema is counted and skipped."""
        try:
            body = self.decode(message.data)
            leaves = _leaves(body)
            stamps = [_stamp(body, place) for place in STAMPS]
        except MemoryError:
            raise
        except Exception:  # three decoders, each with its own errors, struct's and protobuf's
            self.undecoded += 1
            return
        clocks = (message.log_time, message.publish_time, *stamps)
        for clock, ns in zip(CLOCKS, clocks, strict=True):
            self.clocks.setdefault(clock, []).append(ns)
        for name, value in leaves.items():
            series = self.series.setdefault(name, Series())
            if isinstance(value, str):
                series.tally.text(value, f"sample {self.count}")
            else:
                series.tally.numbers += 1
                series.values.append(value)
                series.rows.append(self.count)
        self.count += 1

    def signals(self) -> Iterator[Signal]:
        """Yield a signal for each field of numbers."""
        clocks = {
            clock: np.array(times, dtype=np.int64)
            for clock, times in self.clocks.items()
            if None not in times and _fits(times)
        }
        for name, series in self.series.items():
            if series.tally.is_text or not series.values:
                continue
            full = f"{self.name}.{name}"
            lacking = self.count - len(series.rows)
            if lacking and len(series.rows) > lacking:
                values = np.full(self.count, np.nan)
                values[series.rows] = [_float(v) for v in series.values]
                note = series.tally.note(full, self.count)
                yield Signal(full, values, stamps=clocks, note=note)
                continue
            rows = np.array(series.rows)
            stamps = {clock: times[rows] for clock, times in clocks.items()}
            yield Signal(full, _numbers(series.values), stamps=stamps)

    def texts(self) -> Iterator[tuple[str, str]]:
        """Yield name and reason of each field that had some numbers, but more texts."""
        for name, series in self.series.items():
            if series.tally.is_text and series.values:
                many = f"{series.tally.texts} of {self.count} messages"
                reason = f"is text in {many}, first {series.tally.first}; a signal is numbers"
                yield f"{self.name}.{name}", reason


def read_foreign_mcap(
    path: Path, file: BinaryIO, unpack: Callable[[bytes], bytes] | None = None
) -> Source:
    """Return every number of every message that can be decoded; raises RecordingError.

    unpack: decompresses a message, if each was compressed by itself; it raises ValueError.
    """
    summary = read_summary(file)
    size = os.fstat(file.fileno()).st_size
    walk = Walk(file, size) if summary is None else Walk(file, summary.start, summary.landmarks)
    schemas = {} if summary is None else {schema.id: schema for schema in summary.schemas}
    topics: dict[int, Topic | str] = {}
    for channel in () if summary is None else summary.channels:
        topics[channel.id] = open_topic(channel, schemas.get(channel.schema_id))
    inconsistent = 0
    for record in walk:
        try:
            for part in _parts(record):
                if isinstance(part, Schema):
                    schemas[part.id] = part
                elif isinstance(part, Channel):
                    if part.id not in topics:
                        topics[part.id] = open_topic(part, schemas.get(part.schema_id))
                elif isinstance(topic := topics.get(part.channel_id), Topic):
                    if unpack is not None:
                        part.data = unpack(part.data)
                    topic.take(part)
        except (McapError, UnicodeDecodeError, ValueError, OverflowError):
            inconsistent += 1
    return _source(path, walk, summary is not None, inconsistent, topics)


def _parts(record: object) -> Iterator[Schema | Channel | Message]:
    if isinstance(record, Records):
        chunk = Chunk("", record.data, 0, 0, 0, len(record.data))
        for part in breakup_chunk(chunk):
            if isinstance(part, Schema | Channel | Message):
                yield part
    elif isinstance(record, Schema | Channel):
        yield record


def open_topic(channel: Channel, schema: Schema | None) -> Topic | str:
    """Return a topic that can be decoded, or why it cannot."""
    encoding = channel.message_encoding
    kind = "" if schema is None else schema.name.rpartition("/")[2]
    if kind in NO_MOTION and encoding == "cdr":
        return f"{channel.topic} is of {kind}, which has no motion of a joint, and is not read"
    if encoding == "json":
        return Topic(channel.topic, json.loads)
    if encoding == "cdr" and schema is not None and len(schema.data) > LONGEST:
        return (
            f"{channel.topic} has a definition of {len(schema.data)} bytes, and at most {LONGEST}"
            " are read; record it without this topic"
        )
    from mcap_protobuf.decoder import DecoderFactory as Protobuf
    from mcap_ros2.decoder import DecoderFactory as Ros2

    try:
        for factory in (Ros2(), Protobuf()):
            with redirect_stderr(StringIO()):  # the parser of ROS messages prints errors
                decode = factory.decoder_for(encoding, schema)
            if decode is not None:
                return Topic(channel.topic, decode, kind)
    except MemoryError:
        raise
    except Exception as error:  # a schema that its own parser cannot read
        reason = " ".join(str(error).split())[:80]
        return f"{channel.topic} has a schema that cannot be read ({reason})"
    described = "no schema" if schema is None else f"schema encoding {schema.encoding!r}"
    return f"{channel.topic} is encoded as {encoding!r} with {described}, which is not read here"


def _leaves(body: Any) -> Leaves:
    """Return field -> number or text for all of them in a message."""
    leaves: Leaves = {}
    if _is_joint_state(body):
        for quantity in JOINT_STATE:
            for joint, value in zip(body.name, getattr(body, quantity), strict=False):
                leaves[f"{joint}.{quantity}"] = value
        return leaves
    _collect(leaves, "", body, 0)
    return leaves


def _is_joint_state(body: Any) -> bool:
    named = isinstance(getattr(body, "name", None), list)
    return named and all(hasattr(body, part) for part in JOINT_STATE)


def _collect(leaves: Leaves, name: str, value: Any, depth: int) -> None:
    if isinstance(value, bool | int | float | str):
        if name:
            leaves[name] = value
    elif depth >= DEEPEST or isinstance(value, bytes | bytearray) or value is None:
        return
    elif isinstance(value, list | tuple | array):
        for k, part in enumerate(value[:MOST_ELEMENTS]):
            _collect(leaves, f"{name}[{k}]", part, depth + 1)
    else:
        for part, inner in _fields(value):
            _collect(leaves, f"{name}.{part}" if name else part, inner, depth + 1)


def _fields(message: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(message, Mapping):
        yield from ((str(key), value) for key, value in message.items())
    elif hasattr(message, "DESCRIPTOR"):
        for described in message.DESCRIPTOR.fields:
            value = getattr(message, described.name)
            if hasattr(value, "extend"):
                yield described.name, list(value)
            elif hasattr(value, "keys"):
                continue  # a map
            elif described.message_type is None or message.HasField(described.name):
                yield described.name, value
    else:
        yield from ((part, getattr(message, part)) for part in getattr(message, "__slots__", ()))


def _stamp(body: Any, place: tuple[str, ...]) -> int | None:
    """Return the time that stands at a place of a message [ns], or None."""
    for part in place:
        body = _part(body, part)
    for seconds, fraction in (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos")):
        whole, rest = _part(body, seconds), _part(body, fraction)
        if isinstance(whole, int) and isinstance(rest, int):
            return whole * NANOSECONDS + rest
    return None


def _part(body: Any, name: str) -> Any:
    return body.get(name) if isinstance(body, Mapping) else getattr(body, name, None)


def _fits(times: list[int | None]) -> bool:
    return all(ns is not None and -(2**63) <= ns < 2**63 for ns in times)


def _numbers(values: list[float | int]) -> NDArray[Any]:
    whole = all(isinstance(v, int) and -(2**63) <= v < 2**63 for v in values)
    if whole:
        return np.array(values, dtype=np.int64)
    return np.array([_float(v) for v in values], dtype=np.float64)


def _float(value: float | int) -> float:
    try:
        return float(value)
    except OverflowError:
        return np.inf if value > 0 else -np.inf


def _source(
    path: Path, walk: Walk, indexed: bool, inconsistent: int, topics: dict[int, Topic | str]
) -> Source:
    notes = [f"bytes {d.start} to {d.stop - 1} were skipped: {d.reason}" for d in walk.damages]
    if len(notes) > MOST_NOTES:
        notes[MOST_NOTES:] = [f"{len(notes) - MOST_NOTES} further such places"]
    if inconsistent:
        notes.append(f"{inconsistent} chunks with records that cannot be decoded were skipped")
    if not walk.ended:
        notes.append("the file was not closed or is cut short; it is read up to there")
    elif not indexed:
        notes.append("the index at the end of the file is missing or damaged; no message is lost")
    signals, aside, unreadable, said = signals_of(list(topics.values()))
    notes += said
    if not topics:
        raise RecordingError(f"no topic of {path.name}, an MCAP file, can be read")
    return Source(path, "MCAP", signals, unreadable, tuple(notes), aside=aside)


def signals_of(
    topics: Sequence[Topic | str],
) -> tuple[dict[str, Signal], dict[str, Signal], dict[str, str], list[str]]:
    """Return the signals of topics, those set aside, what is unreadable and why, and notes."""
    signals: dict[str, Signal] = {}
    aside: dict[str, Signal] = {}
    unreadable: dict[str, str] = {}
    notes = [topic for topic in topics if isinstance(topic, str)]
    read = [topic for topic in topics if isinstance(topic, Topic)]
    joints = any(topic.kind in JOINTS and topic.series for topic in read)
    for topic in read:
        if topic.undecoded:
            notes.append(f"{topic.undecoded} messages of {topic.name} do not match their schema")
        beside = joints and topic.kind and topic.kind not in (*JOINTS, *COMMANDS)
        if beside:
            notes.append(f"{topic.name}, of {topic.kind}, is used only if a description gives it")
        for signal in topic.signals():
            place = aside if beside else signals
            place[_free(signal.name, signals | aside)] = signal
        unreadable.update(topic.texts())
    return signals, aside, unreadable, notes


def _free(name: str, taken: Mapping[str, Signal]) -> str:
    """Return the name, or with a number where two channels share a topic."""
    free, copy = name, 1
    while free in taken:
        copy += 1
        free = f"{name}#{copy}"
    return free
