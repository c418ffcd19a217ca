"""A recorded file of any known format, recognised by its first bytes rather than by its name.

It is a log that zwidth wrote, or a file of another tool.
"""

from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO

from mcap.writer import MCAP0_MAGIC

from zwidth.logs.bag_folder import SQLITE, is_bag, read_bag, read_sqlite
from zwidth.logs.codesys_file import is_trace, read_trace
from zwidth.logs.csv_file import read_csv
from zwidth.logs.csv_form import NOTHING_SAID, CsvOptions
from zwidth.logs.echoed_file import is_echo, read_echo
from zwidth.logs.errors import ForeignLog, LogEmpty
from zwidth.logs.excel_file import is_workbook, read_excel
from zwidth.logs.foreign_mcap import read_foreign_mcap
from zwidth.logs.json_file import begins_as_json, read_json
from zwidth.logs.labview_file import START as LVM
from zwidth.logs.labview_file import read_lvm
from zwidth.logs.long_form import apart
from zwidth.logs.mat_file import read_hdf5, read_mat
from zwidth.logs.mcap_reader import Log, read_log
from zwidth.logs.npz_file import read_npy, read_npz
from zwidth.logs.opening import opened
from zwidth.logs.optional_files import read_tdms, read_ulog
from zwidth.logs.other_formats import refuse_other
from zwidth.logs.own_clocks import with_own_clocks
from zwidth.logs.parquet_file import read_parquet
from zwidth.logs.side_by_side import below
from zwidth.logs.source import RecordingError, Source
from zwidth.logs.table_log import log_of
from zwidth.logs.twincat_file import is_scope, read_scope
from zwidth.logs.wpilog_file import START as WPILOG
from zwidth.logs.wpilog_file import read_wpilog

Reader = Callable[[Path, bytes], Source]

HDF5 = b"\x89HDF\r\n\x1a\n"
AFTER_USER_BLOCK = 512  # offset of HDF5 in a MAT v7.3
STARTS: tuple[tuple[bytes, Reader], ...] = (
    (b"\x93NUMPY", read_npy),
    (b"PK\x03\x04", read_npz),
    (b"PK\x05\x06", read_npz),
    (b"PAR1", read_parquet),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", read_excel),
    (LVM, read_lvm),
    (b"TDSm", read_tdms),
    (SQLITE, read_sqlite),
    (b"ULog\x01\x12\x35", read_ulog),
    (WPILOG, read_wpilog),
    (HDF5, read_hdf5),
    (b"MATLAB 5.0", read_mat),
)


def open_source(path: Path, csv: CsvOptions = NOTHING_SAID) -> Source:
    """Return the signals of a file, or of the folder of a bag of ROS 2.

    csv: known settings of a text table. Raises RecordingError, or the LogError of a file that
    cannot be opened.
    """
    if is_bag(path):
        return read_bag(path)
    with opened(path) as file:
        if is_mcap(file):
            return read_foreign_mcap(path, file)
        data = file.read()
    reader = _reader(path, data)
    try:
        if reader is read_excel:
            return below(read_excel(path, data, csv))
        found = read_csv(path, data, csv) if reader is None else reader(path, data)
        return found if found.about else with_own_clocks(apart(below(found)))
    except MemoryError:
        raise RecordingError(
            f"{path.name} needs more memory than there is; it may be damaged; if not, split it"
        ) from None


def read_own(path: Path) -> Log:
    """Return the log in an MCAP, CSV, Parquet or NPZ file that zwidth wrote.

    Raises RecordingError for files of other tools, or another LogError.
    """
    log = own_log(path)
    if isinstance(log, Log):
        return log
    raise RecordingError(
        f"{path.name} was not written by zwidth, so describe it in a recording TOML;"
        f" 'zwidth convert {path}' drafts one"
    )


def own_log(path: Path) -> Log | Source:
    """Return the log in a file of zwidth, or the signals in another file; raises LogError.

    A log without a sample (cut off near its start, for example) is an error too.
    """
    if is_bag(path):
        return read_bag(path)
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
        never = "the program that wrote it ended before the first one"
        raise LogEmpty(f"{log.path} holds no sample: {damaged if log.warnings else never}")
    return log


def is_mcap(file: BinaryIO) -> bool:
    """Return whether a file starts like MCAP; the file is left at its start."""
    start = file.read(len(MCAP0_MAGIC))
    file.seek(0)
    return start == MCAP0_MAGIC


def _reader(path: Path, data: bytes) -> Reader | None:
    if data[AFTER_USER_BLOCK : AFTER_USER_BLOCK + len(HDF5)] == HDF5:
        return read_hdf5
    for start, reader in STARTS:
        if data.startswith(start):
            return read_excel if reader is read_npz and is_workbook(data) else reader
    if begins_as_json(data):
        return read_json
    if is_trace(data):
        return read_trace
    if is_scope(data):
        return read_scope
    if is_echo(data):
        return read_echo
    refuse_other(path, data)
    return read_mat if path.suffix.lower() == ".mat" else None  # v4 has no signature
