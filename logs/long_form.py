"""Tables whose rows belong to several motors, with a column of motor numbers, split by motor.

    time, motor_id, position, current
    0.0000, 1, 0.12, 0.3
    0.0002, 2, 1.04, 0.1
    0.0020, 1, 0.13, 0.3

Loggers of a bus write such tables. Each quantity of each motor becomes a signal, "position 1", with
the times of its own rows. A column that hardly changes from row to row, such as the number of an
episode, is left as it is. A column of words may have the same role, for joints or topics:

    time, topic, value
    0.0000, /cmd/torque, 0.12
    0.0004, /joint/position, 1.04

If there is only one column of values, the words alone are the names.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from zwidth.logs.guess import seconds_of, since_1970, time_seen, unit_seen
from zwidth.logs.names import words_of
from zwidth.logs.source import Signal, Source

IDS = {"id", "ids", "motorid", "servoid", "jointid", "nodeid", "canid", "axisid", "deviceid"}
TOPICS = {"topic", "signal", "channel", "name", "variable", "field", "key", "series", "measurement"}
VALUES = {"value", "values", "val", "data", "reading"}
OF_MANY = {"motor", "servo", "joint", "axis", "node", "actuator", "device"}
MOST = 64  # motors
FEWEST = 10  # least rows of each motor
IN_TURN = 0.3  # share of rows with another number than the row before
NANOSECONDS = 1e9
DIVISORS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def apart(source: Source) -> Source:
    """Return a table with its motors separated, any other source unchanged."""
    if any(signal.stamps for signal in source.signals.values()):
        return source
    time, _ = time_seen(source)
    found = next((s for s in source.signals.values() if _tells_the_motor(s)), None)
    told = next((n for n, words in source.texts.items() if _tells_the_topic(n, words)), None)
    if (found is None and told is None) or time is None or time is found or not time.known.all():
        return source
    of = source.texts[str(told)] if found is None else found.values
    name = str(told) if found is None else found.name
    unit = unit_seen(time)
    since = since_1970(float(time.floats()[0]))
    factor = unit.factor if unit is not None and unit.si == "s" else DIVISORS.get(since or "s", 1.0)
    seconds = seconds_of(time, factor)
    signals: dict[str, Signal] = {}
    for one in np.unique(of).tolist():
        rows = of == one
        stamps = np.rint(np.asarray(seconds[rows]) * NANOSECONDS).astype(np.int64)
        own = one if isinstance(one, str) else f"{one:g}"
        signals |= _of_motor(source.signals, own, rows, stamps, (time.name, name))
    note = f"{name} gives what each row is: the rows are separated by it"
    return replace(source, signals=signals, notes=(*source.notes, note), texts={})


def _tells_the_topic(name: str, words: np.ndarray) -> bool:
    own = set(words_of(name))
    joined = "".join(words_of(name)[::-1])
    if not (own & (TOPICS | OF_MANY) or joined in IDS):
        return False
    topics, counts = np.unique(words, return_counts=True)
    turns = float(np.mean(words[1:] != words[:-1]))
    return 2 <= topics.size <= MOST and int(counts.min()) >= FEWEST and turns > IN_TURN


def _tells_the_motor(signal: Signal) -> bool:
    words = set(words_of(signal.name))
    if not (words & IDS or (len(words) == 1 and words & OF_MANY)):
        return False
    values = signal.floats()
    if values.size < 2 * FEWEST or not signal.known.all() or np.any(values != np.rint(values)):
        return False
    motors, counts = np.unique(values, return_counts=True)
    turns = float(np.mean(np.diff(values) != 0.0))
    return 2 <= motors.size <= MOST and int(counts.min()) >= FEWEST and turns > IN_TURN


def _of_motor(
    signals: Mapping[str, Signal],
    motor: str,
    rows: np.ndarray,
    stamps: np.ndarray,
    left_out: tuple[str, str],
) -> dict[str, Signal]:
    found: dict[str, Signal] = {}
    kept = [n for n, s in signals.items() if n not in left_out and s.values.size == rows.size]
    kept = [n for n in kept if signals[n].known[rows].any()]
    for name in kept:
        signal = signals[name]
        only = kept == [name] and not VALUES.isdisjoint(words_of(name)) and not motor.isdigit()
        own = motor if only else f"{name} {motor}"
        lost = None if signal.lost is None else signal.lost[rows]
        found[own] = replace(
            signal, name=own, values=signal.values[rows], lost=lost, stamps={"stamp": stamps}
        )
    return found
