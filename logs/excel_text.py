"""The sheets of a workbook as text: a line for each row, tabs between cells.

As a program, it runs in its own process without the rest of zwidth: an old workbook (.xls) can
request any amount of memory in a few bytes, and if there is too little, its reader ends the
process. It reads the workbook from standard input, and writes for each sheet the lengths of name
and text, then both. If the system allows limits, it has `MEMORY` and `SECONDS`.
"""

import io
import os
import struct
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from datetime import date, datetime, time, timedelta
from pathlib import Path

MEMORY, SECONDS = 5 << 29, 120  # 2.5 GiB
LENGTHS = struct.Struct("<QQ")
REFUSED = 3  # exit status


class NotRead(Exception):
    """A workbook that could not be read; the message says why."""


def sheets(data: bytes) -> Iterator[tuple[str, str]]:
    """Yield name and text of each sheet; raises the exceptions of calamine."""
    import python_calamine as calamine

    book = calamine.load_workbook(io.BytesIO(data))
    for name in book.sheet_names:
        yield name, as_text(book.get_sheet_by_name(name).to_python())


def as_text(rows: Sequence[Sequence[object]]) -> str:
    """Return rows as lines."""
    return "\n".join("\t".join(map(_cell, row)) for row in rows) + "\n"


def _cell(value: object) -> str:
    match value:
        case bool():
            return str(int(value))
        case float() | int():
            return repr(value)
        case datetime() | date() | time():
            return value.isoformat()
        case timedelta():
            return repr(value.total_seconds())
        case _:
            return " ".join(str(value).split())


def sheets_apart(data: bytes, most: int) -> list[tuple[str, str]]:
    """Return name and text of each sheet, read in a process of its own; raises NotRead.

    most: largest size of all texts together, in bytes.
    """
    import python_calamine

    place = Path(python_calamine.__file__).parent.parent
    # -P: import no modules from the folder of this file, or from the current one.
    line = [sys.executable, "-P", __file__, str(most), str(place)]
    try:
        done = subprocess.run(
            line, input=data, capture_output=True, timeout=2 * SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        raise NotRead(f"reading it takes more than {2 * SECONDS} s") from None
    if done.returncode == REFUSED:
        raise NotRead(done.stderr.decode("utf-8", "replace").strip())
    if done.returncode:
        raise NotRead(
            f"its reader ended for want of memory or time: at most {MEMORY >> 20} MiB, {SECONDS} s"
        )
    found: list[tuple[str, str]] = []
    told, at = done.stdout, 0
    while at < len(told):
        name, text = LENGTHS.unpack_from(told, at)
        at += LENGTHS.size
        found.append((told[at : at + name].decode(), told[at + name : at + name + text].decode()))
        at += name + text
    return found


def _limit() -> None:
    with suppress(ImportError):  # Windows does not have it
        import resource

        for kind, most in (
            (resource.RLIMIT_AS, MEMORY),
            (resource.RLIMIT_CPU, SECONDS),
            (resource.RLIMIT_CORE, 0),
        ):
            with suppress(ValueError, OSError):
                hard = resource.getrlimit(kind)[1]
                kept = most if hard == resource.RLIM_INFINITY else min(most, hard)
                resource.setrlimit(kind, (kept, hard))


def main(most: int, place: str) -> int:
    """Write the sheets of the workbook on standard input; return the exit status."""
    _limit()
    sys.path.append(place)
    written = 0
    try:
        for name, text in sheets(sys.stdin.buffer.read()):
            said = [name.encode(), text.encode()]
            written += sum(map(len, said))
            if written > most:
                raise NotRead(f"its cells make more than {most >> 20} MiB of text")
            for part in (LENGTHS.pack(*map(len, said)), *said):
                sys.stdout.buffer.write(part)
        sys.stdout.buffer.flush()
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException as error:  # calamine is Rust: where it panics, that is no Exception
        print(" ".join(str(error).split())[:160] or type(error).__name__, file=sys.stderr)
        return REFUSED
    return 0


if __name__ == "__main__":
    os._exit(main(int(sys.argv[1]), sys.argv[2]))
