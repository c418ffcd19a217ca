"""Read a log, whole or damaged: `read_log`."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import BinaryIO

from mcap.writer import MCAP0_MAGIC

from zwidth.logs.errors import (
    ForeignLog,
    LogDamaged,
    NotMcap,
)
from zwidth.logs.events import Event
from zwidth.logs.framing import Walk
from zwidth.logs.intactness import MOST_SENTENCES, ending, skipped
from zwidth.logs.opening import opened
from zwidth.logs.reading import Reading
from zwidth.logs.schema import MESSAGES, SUBSTEP, TICK
from zwidth.logs.summary import Summary, read_summary
from zwidth.shown import Shown
from zwidth.sim.trace import Trace


@dataclass(frozen=True, repr=False)
class Log(Shown):
    """The content of a log. warnings: a sentence on each damage; empty for an intact log.

    substep: None if the log has no such topic. metadata: all notes; later ones replace earlier
    ones. attachments: name -> bytes. library: the file's writer. epoch_ns: log time of t = 0.
    """

    path: Path
    tick: Trace
    substep: Trace | None
    events: tuple[Event, ...]
    metadata: Mapping[str, str]
    attachments: Mapping[str, bytes]
    library: str
    epoch_ns: int
    warnings: tuple[str, ...]


def read_log(path: str | PathLike[str]) -> Log:
    """Read a log that `LogWriter` wrote, or another MCAP writer with the same topics and schemas.

    From a damaged file, everything intact is returned, bit for bit, and Log.warnings (also under
    "warnings" in each trace's facts) describes the damage. No sample is returned from a chunk whose
    checksum is wrong.

    Raises a LogError: LogNotFound, LogIsDirectory, LogNotReadable, LogEmpty, NotMcap, ForeignLog
    (no run in it), LogDamaged (nothing can be recovered).
    """
    with opened(Path(path)) as file:
        return _read(Path(path), file)


def _read(path: Path, file: BinaryIO) -> Log:
    size = os.fstat(file.fileno()).st_size
    warnings = _check_magic(path, file, size)
    summary = read_summary(file)
    reading = Reading()
    if summary is not None:
        _check_ours(path, summary)
        for described in (*summary.schemas, *summary.channels):
            reading.add(described)
    walk = Walk(file, size) if summary is None else Walk(file, summary.start, summary.landmarks)
    for record in walk:
        reading.add(record)
    stream = reading.stream(TICK)
    if stream is None:
        raise _nothing_of_ours(path, reading, walk)
    epoch_ns = stream.epoch_ns
    statistics = None if summary is None else summary.statistics
    tick, tick_gaps = reading.trace(stream, statistics)
    fine = reading.stream(SUBSTEP)
    substep, substep_gaps = (None, []) if fine is None else reading.trace(fine, statistics)
    events, event_gaps = reading.events(statistics)
    warnings += skipped(walk.damages, reading.inconsistent)
    warnings += [*tick_gaps, *substep_gaps, *event_gaps]
    warnings += ending(walk, summary, reading, tick, size)
    return Log(
        path=path,
        tick=_warned(tick, warnings),
        substep=None if substep is None else _warned(substep, warnings),
        events=events,
        metadata=reading.metadata,
        attachments=reading.attachments,
        library="" if reading.header is None else reading.header.library,
        epoch_ns=epoch_ns,
        warnings=tuple(warnings),
    )


def _warned(trace: Trace, warnings: list[str]) -> Trace:
    if not warnings:
        return trace
    return replace(trace, facts={**trace.facts, "warnings": list(warnings)})


def _check_magic(path: Path, file: BinaryIO, size: int) -> list[str]:
    start = file.read(len(MCAP0_MAGIC))
    if start == MCAP0_MAGIC:
        return []
    if MCAP0_MAGIC.startswith(start):
        raise LogDamaged(f"{path} ends after {size} bytes, before anything was logged")
    alike = sum(a == b for a, b in zip(start, MCAP0_MAGIC, strict=False))
    if alike < len(MCAP0_MAGIC) - 2:
        raise NotMcap(
            f"{path} is not an MCAP file: it starts with {start!r}; give a log, or a recording to"
            " 'zwidth convert'"
        )
    return ["the first bytes of the file are damaged"]


def _check_ours(path: Path, summary: Summary) -> None:
    if summary.channels and not any(channel.topic in MESSAGES for channel in summary.channels):
        raise _foreign(path, [channel.topic for channel in summary.channels], "another tool")


def _nothing_of_ours(path: Path, reading: Reading, walk: Walk) -> Exception:
    topics = [channel.topic for channel in reading.streams.channels.values()]
    if not reading.by_us and (topics or (walk.ended and not walk.damages)):
        library = "another tool" if reading.header is None else repr(reading.header.library)
        return _foreign(path, topics, library)
    return LogDamaged(
        f"{path} is damaged or cut short before its first sample; nothing can be recovered"
    )


def _foreign(path: Path, topics: list[str], library: str) -> ForeignLog:
    named = ", ".join(sorted(topics)[:MOST_SENTENCES]) or "none"
    more = f" and {len(topics) - MOST_SENTENCES} more" if len(topics) > MOST_SENTENCES else ""
    return ForeignLog(
        f"{path} is an MCAP file of {library} without a run in it (topics: {named}{more}); read it"
        " with a recording TOML, which 'zwidth convert' drafts"
    )
