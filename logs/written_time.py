"""Written times, "2025-11-12T10:03:29.555Z" or "10:03:29.555", as numbers.

A column of them becomes whole nanoseconds: since 1970 if the day is given, else since midnight,
continuing past midnight. Fractions may follow a point, a comma or a colon. A time zone is
subtracted; without one nothing is needed, since only differences count. In 3/5/2024 the month is
assumed to come first unless that is impossible, in 3.5.2024 the day.
"""

import calendar
import re
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

SECOND = 1_000_000_000
DAY = 86_400 * SECOND
SHARE = 0.9  # least share of times among the cells that are not blank
CLOCK = r"(?P<h>\d{1,2}):(?P<m>\d{2})(?::(?P<s>\d{2})(?:[.,:](?P<f>\d{1,9}))?)?"
ZONE = r"\s*(?P<half>[AaPp]\.?[Mm]\.?)?\s*(?:Z|UTC|GMT|(?P<zone>[+-]\d{2}:?\d{2}))?"
FORMS = tuple(
    re.compile(form + "$")
    for form in (
        rf"(?P<Y>\d{{4}})[-/.](?P<M>\d{{1,2}})[-/.](?P<D>\d{{1,2}})[T _,]+{CLOCK}{ZONE}",
        rf"(?P<D>\d{{1,2}})\.(?P<M>\d{{1,2}})\.(?P<Y>\d{{4}}|\d{{2}})[T _,]+{CLOCK}{ZONE}",
        rf"(?P<M>\d{{1,2}})[/-](?P<D>\d{{1,2}})[/-](?P<Y>\d{{4}}|\d{{2}})[T _,]+{CLOCK}{ZONE}",
        r"(?P<Y>\d{4})(?P<M>\d{2})(?P<D>\d{2})[T _-]?(?P<h>\d{2})(?P<m>\d{2})(?P<s>\d{2})"
        r"(?:[.,_](?P<f>\d{1,9}))?" + ZONE,
        rf"{CLOCK}{ZONE}",
        r"(?P<m>\d{1,4}):(?P<s>\d{2})[.,](?P<f>\d{1,9})",
        rf"(?P<days>\d{{1,5}}) days?,? {CLOCK}",
        r"(?P<own>\d{1,9}(?:[.,]\d{1,9})?) ?(?P<unit>s|sec|secs|seconds|ms|msec|us|µs)",
    )
)
DURATIONS = {"s": 1e9, "m": 1e6, "u": 1e3, "µ": 1e3}  # ns
DATES = (
    re.compile(r"(?P<Y>\d{4})[-/.](?P<M>\d{1,2})[-/.](?P<D>\d{1,2})$"),
    re.compile(r"(?P<D>\d{1,2})\.(?P<M>\d{1,2})\.(?P<Y>\d{4}|\d{2})$"),
    re.compile(r"(?P<M>\d{1,2})[/-](?P<D>\d{1,2})[/-](?P<Y>\d{4}|\d{2})$"),
)


def nanoseconds_of(cells: Sequence[object]) -> tuple[NDArray[np.int64], NDArray[np.bool_]] | None:
    """Return the times in cells of text [ns], and which are missing, each (samples,).

    None if less than `SHARE` of the cells that are not blank are times of one form.
    """
    texts = [str(cell).strip() if isinstance(cell, str) else "" for cell in cells]
    first = next((text for text in texts if text), "")
    form = next((f for f in FORMS if f.match(first)), None)
    if form is None:
        return None
    found = [_time(form, text) for text in texts]
    told = sum(one is not None for one in found)
    if told < 2 or told < SHARE * sum(map(bool, texts)):
        return None
    known = np.array([one is not None for one in found], dtype=np.bool_)
    least = min(one for one in found if one is not None)
    times = np.array([least if one is None else one for one in found], dtype=np.int64)
    if "Y" not in form.groupindex and "h" in form.groupindex and "days" not in form.groupindex:
        times = _past_midnight(times, known)
    return times, ~known


def is_date(text: str) -> bool:
    """Return whether a text is a date without a time, as in a column beside that of the time."""
    return any(form.match(text.strip()) for form in DATES)


def _time(form: re.Pattern[str], text: str) -> int | None:
    """Return the time in a text of that form, None for any other."""
    matched = form.match(text)
    if matched is None:
        return None
    told = matched.groupdict()
    if (own := told.get("own")) is not None:
        return round(float(own.replace(",", ".")) * DURATIONS[str(told["unit"])[0]])
    day = int(told["days"]) if told.get("days") else _day(told)
    hour, minute, second = (int(told.get(key) or 0) for key in "hms")
    if (half := told.get("half")) is not None:
        hour = hour % 12 + (12 if half[0] in "pP" else 0)
    if day is None or hour > 24 or second > 60 or ("h" in told and minute > 59):
        return None
    seconds = day * 86_400 + hour * 3_600 + minute * 60 + second
    if (zone := told.get("zone")) is not None:
        sign, digits = (-1 if zone[0] == "-" else 1), zone[1:].replace(":", "")
        seconds -= sign * (int(digits[:2]) * 3_600 + int(digits[2:]) * 60)
    return seconds * SECOND + int((told.get("f") or "0").ljust(9, "0"))


def _day(told: dict[str, str | None]) -> int | None:
    """Return the day since 1970, 0 where none is told, None for one that is not there."""
    if told.get("Y") is None:
        return 0
    year, month, day = (int(str(told[key])) for key in "YMD")
    if month > 12:
        month, day = day, month
    year += 2000 if year < 100 else 0
    if not (1970 <= year < 2262 and 1 <= month <= 12):
        return None
    if not 1 <= day <= calendar.monthrange(year, month)[1]:
        return None
    return calendar.timegm((year, month, day, 0, 0, 0)) // 86_400


def _past_midnight(times: NDArray[np.int64], known: NDArray[np.bool_]) -> NDArray[np.int64]:
    own = times[known]
    days = np.cumsum(np.diff(own, prepend=own[0]) < -DAY // 2)
    times[known] = own + days * DAY
    return times
