"""Lines of a log as a table: numbers beside their names, or after a prefix such as a time stamp.

    target:0.50 angle:0.48 pwm:123                          Arduino's serial plotter
    t=0.01, q=0.2
    I (1000) motor: q=0.2                                   ESP-IDF: milliseconds
    2025-03-04 12:00:01,234 INFO servo goal=2048 pos=2047   Python's logging
    INFO:root:goal=2048 pos=2047                            the same, with default settings
    12:34:56.789 -> 0.50,0.48                               Arduino's serial monitor
    [INFO] [1741089600.25]: q=0.2                           ROS 1

The stamp before a line becomes the column `timestamp`, for ESP-IDF `log_time_ms`. Layouts: "Using
the Serial Plotter Tool", Arduino documentation (labels and numbers separated by colons, pairs by
commas, blanks or tabs); "logging", Python documentation.
"""

import re
from collections.abc import Sequence

LABEL = r"[A-Za-z_][\w .\[\]/-]*?"
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|inf"
PAIR = re.compile(rf"({LABEL})\s*[:=]\s*({NUMBER})(?=[,;|\s]|$)")
LINE = re.compile(rf"\s*(?:{LABEL}\s*[:=]\s*(?:{NUMBER})(?:[,;|\s]+|$))+$")
ESP = re.compile(r"(?:\x1b\[[\d;]*m)?[VDIWE] \((\d+)\) [\w.-]+: (?=\S)")
DAY = r"\d{4}[-/.]\d{1,2}[-/.]\d{1,2}[ T]"
CLOCK = rf"(?:{DAY})?\d{{1,2}}:\d{{2}}:\d{{2}}(?:[.,]\d{{1,9}})?(?:Z|[+-]\d{{2}}:?\d{{2}})?"
LEVEL = r"\[?(?:TRACE|DEBUG|INFO|WARN|WARNING|ERROR|FATAL|NOTICE)\]?"
BEFORE = re.compile(
    rf"\s*(?:{LEVEL}\s+)?"
    rf"(?:\[(?P<seconds>\d{{1,10}}\.\d{{1,9}})\]|\[?(?P<clock>{CLOCK})\]?)"
    rf"\s*(?:->|[|:>-])?\s*(?:{LEVEL}\s*[|:-]?\s*)?(?P<rest>[^,;\t]?.*)$"
)
ARROW = re.compile(rf"\s*(?P<clock>{CLOCK}) -> (?P<rest>.*)$")
LOGGER = re.compile(r"\s*(?:TRACE|DEBUG|INFO|WARN|WARNING|ERROR|CRITICAL):[\w.]*:\s*(?=\S)")
TIME, MILLISECONDS = "timestamp", "log_time_ms"
LOOKED_AT = 50  # lines
SHARE = 0.8  # least share of them that are such lines
LONGEST = 10_000  # characters of a line


def table_of(text: str) -> str | None:
    """Return such lines as a table, with a blank cell for each missing value; None for other text.

    Other lines are left out, such as those that a board writes when it starts.
    """
    lines = text.splitlines()
    return _labelled(lines) or _behind_arrows(lines)


def _labelled(lines: Sequence[str]) -> str | None:
    first = [one for line in lines[: 4 * LOOKED_AT] if (one := _apart(line)) and one[2].strip()]
    first = first[:LOOKED_AT]
    told = [one for one in first if LINE.match(one[2])]
    if not told or len(told) < SHARE * len(first):
        return None
    names = [name for name, _ in _pairs(told[0][2])]
    stamp = told[0][0]
    if len({*names, stamp}) != len(names) + 1:
        return None
    rows = [",".join([stamp, *names] if stamp else names)]
    for line in lines:
        one = _apart(line)
        if one is None or one[0] != stamp or not LINE.match(one[2]):
            continue
        found = dict(_pairs(one[2]))
        cells = [found.get(name, "") for name in names]
        rows.append(",".join([one[1], *cells] if stamp else cells))
    return "\n".join(rows) + "\n"


def _pairs(text: str) -> list[tuple[str, str]]:
    """Return names and numbers; the first is one word where all others are."""
    pairs = [(name.strip(), value) for name, value in PAIR.findall(text)]
    if len(pairs) > 1 and not any(" " in name for name, _ in pairs[1:]):
        pairs[0] = pairs[0][0].split()[-1], pairs[0][1]
    return pairs


def _apart(line: str) -> tuple[str, str, str] | None:
    """Return the name of the stamp before a line, the stamp and the rest; None if too long."""
    if len(line) >= LONGEST:
        return None
    if esp := ESP.match(line):
        return MILLISECONDS, esp[1], line[esp.end() :]
    if before := BEFORE.match(line):
        stamp = before["seconds"] or before["clock"].replace(",", ".")
        return TIME, stamp, before["rest"]
    return "", "", LOGGER.sub("", line, count=1)


def _behind_arrows(lines: Sequence[str]) -> str | None:
    """Return the table of which Arduino's serial monitor wrote the clock before each line."""
    first = [line for line in lines[: 4 * LOOKED_AT] if line.strip()][:LOOKED_AT]
    told = [found for line in first if len(line) < LONGEST and (found := ARROW.match(line))]
    if not told or len(told) < SHARE * len(first):
        return None
    delimiter = max("\t;, ", key=told[-1]["rest"].strip().count)
    rows = list[str]()
    for line in lines:
        found = ARROW.match(line) if len(line) < LONGEST else None
        if found is None or not found["rest"].strip():
            continue
        rest = found["rest"].strip()
        names = re.match(r"[A-Za-z_]", rest) is not None
        rows.append(f"{TIME if names else found['clock'].replace(',', '.')}{delimiter}{rest}")
    return "\n".join(rows) + "\n"
