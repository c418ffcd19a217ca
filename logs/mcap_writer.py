"""Write a run to an MCAP file while it runs (`LogWriter`), or a complete trace (`write_log`)."""

import json
import time
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import PackageNotFoundError, version
from os import PathLike
from pathlib import Path
from types import TracebackType

import numpy as np
from mcap.records import Attachment

from zwidth.files.protection import writing_as
from zwidth.logs.annotations import Annotation, annotation_chunks, annotation_records
from zwidth.logs.container import Container, Content, encode
from zwidth.logs.errors import LogBlockError, LogWriteError
from zwidth.logs.events import Event, encode_events, event_records
from zwidth.logs.layout import Floats
from zwidth.logs.schema import (
    ENDED,
    FACTS,
    LIBRARY,
    RECORD,
    SUBSTEP,
    TICK,
    Origin,
    channel_record,
    flat_schema,
    schema_record,
)
from zwidth.logs.seal import seal
from zwidth.logs.sink import Sink
from zwidth.logs.topic import Topic
from zwidth.sim.trace import Trace

MEDIA_TYPES = {".toml": "application/toml", ".json": "application/json", ".txt": "text/plain"}


class LogWriter:
    """A log being written: a context manager that appends blocks of samples.

    path: the log's final name. channels and substep_channels: name -> unit of the channels of
    `/tick` and `/substep`, in order. metadata: text about the run (version, seed, model hash, K,
    B). attachments: file name -> bytes (device.toml, scenario.toml, propagators.npy). epoch_ns: the
    log time of t = 0 in ns since 1970, by default now. facts: the trace's facts, kept as JSON.
    annotations: on stretches of time, for viewers.

    Every block is passed to the operating system, in complete chunks, before append returns, so
    after `kill -9` all appended blocks can be read. Until the log is closed it is called `partial`
    (NAME.partial.mcap); only then does it take the name `path`. If the `with` block fails or is
    interrupted, the log is completed under its partial name.

    Append about a second at a time: each block is compressed alone and repeats its schema, 0.7 kB.

    A file at `path` is replaced only if a log writer wrote it and it was not edited since, or with
    overwrite.

    Raises LogPathError (path), Protected (a user's file), LogBlockError (data that do not fit),
    LogWriteError (a full disk).
    """

    def __init__(
        self,
        path: str | PathLike[str],
        channels: Mapping[str, str],
        *,
        substep_channels: Mapping[str, str] | None = None,
        metadata: Mapping[str, str] | None = None,
        attachments: Mapping[str, bytes] | None = None,
        epoch_ns: int | None = None,
        origin: Origin = "simulated",
        facts: Mapping[str, object] | None = None,
        annotations: Sequence[Annotation] = (),
        overwrite: bool = False,
    ) -> None:
        self.epoch_ns = time.time_ns() if epoch_ns is None else epoch_ns
        if not 0 <= self.epoch_ns < 2**63:
            raise LogBlockError(
                f"epoch_ns is {self.epoch_ns}; it must be ns since 1970, 0 to 2^63 - 1"
            )
        units = {TICK: channels} | ({SUBSTEP: substep_channels} if substep_channels else {})
        flat = [flat_schema(topic, u, self.epoch_ns, origin) for topic, u in units.items()]
        schemas = [schema_record(f, i) for i, f in enumerate(flat, start=1)]
        records = [channel_record(f, i) for i, f in enumerate(flat, start=1)]
        self._topics = {
            f.topic: Topic(f, self.epoch_ns, schema, channel)
            for f, schema, channel in zip(flat, schemas, records, strict=True)
        }
        self._event_id = len(flat) + 1
        self._event_records = event_records(self._event_id, self.epoch_ns)
        self._event_count = 0
        more = annotation_records(self._event_id + 1) if annotations else []
        about = _text(metadata or {})
        with writing_as("LogWriter", overwrite):
            self._sink = Sink(Path(path))
        self._container = Container(self._sink)
        self._closed = False
        with self._keeping_what_is_written():
            described = [*zip(schemas, records, strict=True), self._event_records, *more]
            self._container.open(_library(), [s for s, _ in described], [c for _, c in described])
            self.note(about)
            self._add_facts(facts or {})
            for name, data in (attachments or {}).items():
                self._attach(name, data)
            if annotations:
                for chunk in annotation_chunks(annotations, self._event_id + 1, self.epoch_ns):
                    self._container.add_chunk(chunk)

    def _add_facts(self, facts: Mapping[str, object]) -> None:
        if facts:
            texts = {key: _json(value) for key, value in facts.items()}
            self._container.add_metadata(FACTS, seal(FACTS, texts))

    def _attach(self, name: str, data: bytes) -> None:
        media_type = MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream")
        self._container.add_attachment(
            Attachment(self.epoch_ns, self.epoch_ns, name, media_type, data)
        )

    @property
    def path(self) -> Path:
        """The log's final name."""
        return self._sink.path

    @property
    def partial(self) -> Path:
        """The log's name until it is closed."""
        return self._sink.partial

    def append(self, t: Floats, channels: Mapping[str, Floats], topic: str = TICK) -> None:
        """Append samples at times t [s], shape (n,), with one array (n,) for each channel."""
        self._check_open()
        for content in self._topic(topic).chunks(t, channels):
            self._container.add_chunk(content)

    def events(self, events: Iterable[Event]) -> None:
        """Append events, in the order of their times, to `/events`."""
        self._check_open()
        block = list(events)
        if not block:
            return
        head = encode(*self._event_records)
        encoded = encode_events(block, self._event_id, self._event_count, self.epoch_ns, len(head))
        pairs = np.array([encoded.log_times, encoded.offsets], dtype="<u8").T
        span = min(encoded.log_times), max(encoded.log_times)
        self._container.add_chunk(
            Content(self._event_id, head + encoded.content, *span, len(block), pairs.tobytes())
        )
        self._event_count += len(block)

    def note(self, metadata: Mapping[str, str]) -> None:
        """Write facts about the run, such as its verdict; later notes replace earlier ones."""
        self._check_open()
        self._container.add_metadata(RECORD, seal(RECORD, _text(metadata)))

    def close(self) -> None:
        """Complete the log and give it its name."""
        if not self._closed:
            self._closed = True
            with self._keeping_what_is_written():
                self._container.finish()
                self._sink.finish()

    def abandon(self, reason: str) -> None:
        """Complete the log under its partial name; metadata `ended`: why."""
        if not self._closed:
            with self._keeping_what_is_written():
                self.note({ENDED: reason})
                self._container.finish()
            self._closed = True
            self._sink.close()

    def __enter__(self) -> "LogWriter":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        elif isinstance(error, LogWriteError):
            self._sink.close()
        else:
            self.abandon(f"early, by {kind.__name__}")

    @contextmanager
    def _keeping_what_is_written(self) -> Generator[None]:
        try:
            yield
        except BaseException:
            self._closed = True
            self._sink.close()
            raise

    def _check_open(self) -> None:
        if self._closed:
            raise LogBlockError(f"{self.path} is closed already; open another log to go on")

    def _topic(self, topic: str) -> Topic:
        try:
            return self._topics[topic]
        except KeyError:
            known = ", ".join(self._topics)
            raise LogBlockError(f"topic {topic!r} is not in this log; it has {known}") from None


def write_log(
    path: str | PathLike[str],
    tick: Trace,
    *,
    substep: Trace | None = None,
    events: Iterable[Event] = (),
    metadata: Mapping[str, str] | None = None,
    attachments: Mapping[str, bytes] | None = None,
    epoch_ns: int | None = None,
    annotations: Sequence[Annotation] = (),
    overwrite: bool = False,
) -> None:
    """Write finished traces as one log; see `LogWriter` for the arguments and errors."""
    with (
        writing_as("write_log", overwrite),
        LogWriter(
            path,
            _units(tick),
            substep_channels=None if substep is None else _units(substep),
            metadata=metadata,
            attachments=attachments,
            epoch_ns=epoch_ns,
            origin=tick.origin,
            facts=tick.facts,
            annotations=annotations,
        ) as log,
    ):
        log.append(tick.t, tick.channels)
        if substep is not None:
            log.append(substep.t, substep.channels, SUBSTEP)
        log.events(events)


def _units(trace: Trace) -> dict[str, str]:
    return {name: trace.units[name] for name in trace.channels}


def _text(metadata: Mapping[str, object]) -> dict[str, str]:
    for key, value in metadata.items():
        if not isinstance(value, str):
            raise LogBlockError(f"metadata {key!r} is {value!r}; write it as text")
    return {key: str(value) for key, value in metadata.items()}


def _json(value: object) -> str:
    try:
        return json.dumps(value, default=_plain)
    except (TypeError, ValueError):
        return json.dumps(str(value))


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return {str(key): item for key, item in value.items()}
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else str(value)


def _library() -> str:
    try:
        return f"{LIBRARY} {version('zwidth')}"
    except PackageNotFoundError:
        return LIBRARY
