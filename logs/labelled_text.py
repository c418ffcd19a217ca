"""Lines in which each number stands beside its name, as Arduino's serial plotter takes them.

    target:0.50 angle:0.48 pwm:123
    t=0.01, q=0.2

Lines of an ESP-IDF log, "I (1000) motor: q=0.2", have milliseconds before them, which become a
column `log_time_ms`. Such lines become a table with a line of names. Layout: "Using the Serial
Plotter Tool", Arduino documentation; labels and numbers with a colon between, pairs apart by
commas, blanks or tabs.
"""

import re

LABEL = r"[A-Za-z_][\w .\[\]/-]*?"
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|inf"
PAIR = re.compile(rf"({LABEL})\s*[:=]\s*({NUMBER})(?=[,;\s]|$)")
LINE = re.compile(rf"\s*(?:{LABEL}\s*[:=]\s*(?:{NUMBER})(?:[,;\s]+|$))+$")
ESP = re.compile(r"(?:\x1b\[[\d;]*m)?[VDIWE] \((\d+)\) [\w.-]+: (?=\S)")
TIME = "log_time_ms"
LOOKED_AT = 50  # lines
SHARE = 0.8  # of them, that must be such lines
LONGEST = 10_000  # characters of a line


def table_of(text: str) -> str | None:
    """Return such lines as a table of commas, a blank cell for what a line lacks; None for others.

    Lines that are none, as those that a board writes when it starts, are left out.
    """
    lines = [ESP.sub(rf"{TIME}=\1 ", line[:LONGEST], count=1) for line in text.splitlines()]
    first = [line for line in lines[: 4 * LOOKED_AT] if line.strip()][:LOOKED_AT]
    told = [line for line in first if len(line) < LONGEST and LINE.match(line)]
    if not told or len(told) < SHARE * len(first):
        return None
    names = [name.strip() for name, _ in PAIR.findall(told[0])]
    if len(set(names)) != len(names):
        return None
    rows = [",".join(names)]
    for line in lines:
        if len(line) < LONGEST and LINE.match(line):
            found = {name.strip(): value for name, value in PAIR.findall(line)}
            rows.append(",".join(found.get(name, "") for name in names))
    return "\n".join(rows) + "\n"
