"""Files that zwidth wrote, whichever their format: `read_own`."""

from pathlib import Path

from zwidth.logs.errors import ForeignLog, LogEmpty
from zwidth.logs.mcap_reader import Log, read_log
from zwidth.logs.open_source import is_mcap, open_source
from zwidth.logs.opening import opened
from zwidth.logs.source import RecordingError, Source
from zwidth.logs.table_log import log_of


def read_own(path: Path) -> Log:
    """Return the log in an MCAP, CSV, Parquet or NPZ file that zwidth wrote.

    Raises RecordingError for everyone else's files, or another LogError.
    """
    log = own_log(path)
    if isinstance(log, Log):
        return log
    raise RecordingError(
        f"{path.name} was not written by zwidth, so describe it in a recording TOML;"
        f" 'zwidth convert {path}' drafts one"
    )


def own_log(path: Path) -> Log | Source:
    """Return the log in a file of ours, or the signals in another; raises LogError.

    A log without a sample, such as the start of one that was cut short, is an error, too.
    """
    with opened(path) as file:
        mcap = is_mcap(file)
    if mcap:
        try:
            return _with_samples(read_log(path))
        except ForeignLog:
            pass
    source = open_source(path)
    return _with_samples(log_of(source)) if source.about else source


def _with_samples(log: Log) -> Log:
    if len(log.tick) == 0:
        damaged = "it was cut short or damaged before the first one was complete"
        never = "what wrote it ended before the first"
        raise LogEmpty(f"{log.path} holds no sample: {damaged if log.warnings else never}")
    return log
