"""Formats that are recognised but not read: what each is, and how to convert it.

A format is recognised by its first bytes, or a text by its first line.
"""

import re
from pathlib import Path

from zwidth.logs.source import RecordingError

STARTS: tuple[tuple[bytes, str, str], ...] = (
    (
        b"#ROSBAG V2.0",
        "a bag of ROS 1",
        "'rostopic echo -p -b FILE /joint_states > joints.csv' makes a table of a topic, 'mcap"
        " convert FILE out.mcap' an MCAP file",
    ),
    (b"MDF     ", "an MDF file", "'asammdf' exports it as CSV, MAT or Parquet"),
    (b"LOGG\x90\0\0\0", "a CAN log of Vector (BLF)", "decode it with its DBC, in 'asammdf' for"
     " instance, to a CSV of signals"),
    (b"\xd4\xc3\xb2\xa1", "a capture of packets (pcap)", "decode its signals to a CSV"),
    (b"\x0a\x0d\x0d\x0a", "a capture of packets (pcapng)", "decode its signals to a CSV"),
    (b"\xa3\x95\x80", "a DataFlash log of ArduPilot", "'mavlogdump.py --format csv --types TYPE"
     " FILE' makes a table of a message"),
    (b"H Product:Blackbox", "a blackbox log of Betaflight", "'blackbox_decode FILE' makes a CSV"),
    (b"%PDF", "a PDF", "give the numbers themselves, as CSV"),
    (b"\x1f\x8b", "compressed by gzip", "unpack it with 'gunzip FILE' first"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", "unpack it first"),
    (b"Rar!\x1a\x07", "a RAR archive", "unpack it first"),
    *(
        (b"BZh%d1AY&SY" % level, "compressed by bzip2", "unpack it with 'bunzip2 FILE' first")
        for level in range(1, 10)
    ),
    (b"\xfd7zXZ\0", "compressed by xz", "unpack it with 'unxz FILE' first"),
    (b"\x28\xb5\x2f\xfd", "compressed by zstd", "unpack it with 'unzstd FILE' first"),
    (b"RIFF", "a sound or a film (RIFF)", "save its numbers as NPY"),
    (b"ARROW1", "an Arrow or Feather file", "in Python, pandas.read_feather(FILE).to_parquet"
     "('out.parquet') makes a Parquet file"),
    (b"version https://git-lfs", "a pointer of Git LFS, and not the file itself", "'git lfs pull'"
     " fetches the file"),
)  # fmt: skip
PICKLES = tuple(b"\x80" + bytes([protocol]) for protocol in range(2, 6))
LINES: tuple[tuple[re.Pattern[str], str], ...] = (
    (
        re.compile(r"\s*\(\d+\.\d+\)\s+\w+\s+[0-9A-Fa-f]{3,8}##?[0-9A-FRr]"),
        "candump",
    ),
    (re.compile(r"\s*(?:\(\d+\.\d+\)\s+)?\w*can\d+\s+[0-9A-Fa-f]{3,8}\s+\[\d+\]"), "candump"),
    (re.compile(r"base (?:hex|dec)\s+timestamps (?:absolute|relative)"), "a CAN log of Vector"),
)
FIRST_LINES = 5


def refuse_other(path: Path, data: bytes) -> None:
    """Raise RecordingError for a file that is known and not read, with what to do."""
    for start, what, to_do in STARTS:
        if data.startswith(start):
            raise RecordingError(f"{path.name} is {what}, which is not read; {to_do}")
    if data.startswith(PICKLES):
        raise RecordingError(
            f"{path.name} is a pickle of Python, which is not read since it can run any code; save"
            " its arrays with numpy.savez or its frame with to_parquet"
        )
    head = data[:2000].decode("latin1").splitlines()[:FIRST_LINES]
    for line in head:
        for form, tool in LINES:
            if form.match(line):
                raise RecordingError(
                    f"{path.name} holds frames of a CAN bus as {tool} writes them, which do not"
                    " show what their bytes mean; decode them with the DBC file of the bus"
                    " ('python3 -m cantools decode', or asammdf) to a table of signals"
                )
