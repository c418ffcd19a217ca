"""Tables with a row for each motor in turn, told by a column with its number, apart by motor.

    time, motor_id, position, current
    0.0000, 1, 0.12, 0.3
    0.0002, 2, 1.04, 0.1
    0.0020, 1, 0.13, 0.3

as loggers of a bus write them. Each quantity of each motor becomes a signal, "position 1", with the
times of its own rows. A column that hardly changes from row to row, as the number of an episode
does, is left as it is.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from zwidth.logs.guess import seconds_of, since_1970, time_seen, unit_seen
from zwidth.logs.names import words_of
from zwidth.logs.source import Signal, Source

IDS = {"id", "ids", "motorid", "servoid", "jointid", "nodeid", "canid", "axisid", "deviceid"}
OF_MANY = {"motor", "servo", "joint", "axis", "node", "actuator", "device"}
MOST = 64  # motors
FEWEST = 10  # rows of each
IN_TURN = 0.3  # share of rows whose number is not that of the row before
NANOSECONDS = 1e9
DIVISORS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


def apart(source: Source) -> Source:
    """Return a table with its motors apart, any other source as it is."""
    if any(signal.stamps for signal in source.signals.values()):
        return source
    found = next((s for s in source.signals.values() if _tells_the_motor(s)), None)
    time, _ = time_seen(source)
    if found is None or time is None or time is found or not time.known.all():
        return source
    unit = unit_seen(time)
    told = since_1970(float(time.floats()[0]))
    factor = unit.factor if unit is not None and unit.si == "s" else DIVISORS.get(told or "s", 1.0)
    seconds = seconds_of(time, factor)
    signals: dict[str, Signal] = {}
    for motor in np.unique(found.values).tolist():
        rows = found.values == motor
        stamps = np.rint(np.asarray(seconds[rows]) * NANOSECONDS).astype(np.int64)
        signals |= _of_motor(source.signals, f"{motor:g}", rows, stamps, (time.name, found.name))
    note = f"{found.name} tells of which motor each row is: they are taken apart"
    return replace(source, signals=signals, notes=(*source.notes, note))


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
    for name, signal in signals.items():
        if name in left_out or signal.values.size != rows.size:
            continue
        own = f"{name} {motor}"
        lost = None if signal.lost is None else signal.lost[rows]
        found[own] = replace(
            signal, name=own, values=signal.values[rows], lost=lost, stamps={"stamp": stamps}
        )
    return found
