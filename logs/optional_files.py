"""Formats read with optional libraries, which `pip install zwidth[formats]` installs.

TDMS of LabVIEW by npTDMS: `group/channel`, and the interval of a waveform, if given. ULog of PX4 by
pyulog: `topic.field`, `topic_1.field` for the second of a topic.
"""

import io
import logging
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from zwidth.logs.source import Collector, RecordingError, Signal, Source

MOST_BYTES = 1 << 33  # of all channels, whatever their header claims
MICROSECOND = 1000  # ns
INTERVAL = "wf_increment"  # [s], of a waveform


def read_tdms(path: Path, data: bytes) -> Source:
    """Return the channels of a TDMS file; raises RecordingError."""
    try:
        from nptdms import TdmsFile
    except ModuleNotFoundError:
        raise _missing(path, "TDMS", "npTDMS") from None
    found = Collector()
    logging.getLogger("nptdms").setLevel(logging.CRITICAL)  # it prints raw bytes of damaged parts
    try:
        file: Any = TdmsFile.open(io.BytesIO(data))
        channels = [channel for group in file.groups() for channel in group.channels()]
        if sum(len(one) * 8 for one in channels) > MOST_BYTES:
            raise ValueError(f"it claims more than {MOST_BYTES >> 30} GiB")
        if not channels:
            raise ValueError("it has no channel")
        names = [one.name for one in channels]
        for one in channels:
            name = one.name if names.count(one.name) == 1 else f"{one.group_name}/{one.name}"
            unit = str(one.properties.get("unit_string", ""))
            found.add(name, one[:], unit)
            interval = one.properties.get(INTERVAL)
            if INTERVAL not in found.signals and isinstance(interval, float) and interval > 0.0:
                found.add(INTERVAL, np.array([interval]), "s")
    except MemoryError:
        raise
    except Exception as error:  # npTDMS raises many types: ValueError, KeyError, struct.error
        raise _damaged(path, "TDMS", error) from None
    return Source(path, "TDMS", found.signals, found.unreadable)


class _Ending(io.BytesIO):
    """Bytes that can be read as often as there are bytes, and some: a message takes three at least.

    pyulog seeks back by the length that a message claims, even if the file is shorter, and then
    reads the same bytes for ever.
    """

    def __init__(self, data: bytes) -> None:
        super().__init__(data)
        self.left = len(data) + 1000

    def read(self, size: int | None = -1, /) -> bytes:
        """Read on; raises ValueError if a reader goes round in circles."""
        self.left -= 1
        if self.left < 0:
            raise ValueError("the references between its messages form a loop")
        return super().read(size)


def read_ulog(path: Path, data: bytes) -> Source:
    """Return the fields of the topics of a ULog file; raises RecordingError."""
    try:
        from pyulog import ULog
    except ModuleNotFoundError:
        raise _missing(path, "ULog", "pyulog") from None
    signals: dict[str, Signal] = {}
    try:
        with redirect_stdout(io.StringIO()):  # it prints errors
            log: Any = ULog(_Ending(data))
        for topic in log.data_list:
            stamps = np.asarray(topic.data["timestamp"]).astype(np.int64) * MICROSECOND
            own = f"{topic.name}_{topic.multi_id}" if topic.multi_id else topic.name
            for field, values in topic.data.items():
                if field != "timestamp" and values.dtype.kind in "biuf":
                    name = f"{own}.{field}"
                    signals[name] = Signal(name, values, stamps={"timestamp": stamps})
    except MemoryError:
        raise
    except BaseException as error:  # pyulog raises many types, and exits if there is no header
        if isinstance(error, KeyboardInterrupt):
            raise
        raise _damaged(path, "ULog", error) from None
    return Source(path, "ULog", signals)


def _missing(path: Path, kind: str, library: str) -> RecordingError:
    return RecordingError(
        f"{path.name} is a {kind} file, which {library} reads; pip install {library}, or"
        " 'zwidth[formats]'"
    )


def _damaged(path: Path, kind: str, error: BaseException) -> RecordingError:
    reason = " ".join(str(error).split())[:160] or type(error).__name__
    return RecordingError(f"{path.name} cannot be read as {kind}, it is damaged: {reason}")
