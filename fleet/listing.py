"""The recordings of a fleet and the known values of each, from a folder or a table.

A table is a CSV with a line for each recording,

    recording,device,date,load [kg],temperature
    d01/monday.csv,d01,2026-03-02,0.5,21.5

or a TOML with `[[recording]]` tables of the same keys (`file` for `recording`). Only the file is
required. `device` (or `unit`) is the recorded device; without it all recordings are of one device.
`date` is ISO 8601. Every other column of numbers has known values that parameters may depend on.

If a folder has a table (`fleet.csv`, `fleet.toml`), this table lists its recordings. Otherwise
every recording in the folder is used: recording TOMLs, logs, and data files that no TOML describes.
Each subfolder is a device, and a date is read from the file's name (`2026-03-02` in it).
"""

import csv
import io
import math
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from pathlib import Path

from zwidth.logs.bag_folder import is_bag
from zwidth.logs.opening import opened
from zwidth.logs.recording_file import load_description
from zwidth.shown import Valued

TABLES = ("fleet.csv", "fleet.toml")
FILE, DEVICE, DATE = ("recording", "file"), ("device", "unit"), ("date",)
DATA = (".csv", ".mcap", ".mat", ".h5", ".hdf5", ".npy", ".npz", ".parquet")
OURS = (
    *(".recording.toml", ".device.toml", ".augmented.toml", ".next.toml", ".next.npy"),
    ".diagnosis.mcap",
)
DATED = re.compile(r"(\d{4}-\d{2}-\d{2})(?:[T_ ](\d{2})[-:]?(\d{2}))?")
ONLY = "the device"


@dataclass(frozen=True)
class Listed(Valued):
    """A recording of a fleet. date: when it was made, None if unknown; known: values by column."""

    name: str
    path: Path
    device: str = ONLY
    date: datetime | None = None
    known: Mapping[str, float] = field(default_factory=dict[str, float])

    @property
    def day(self) -> float | None:
        """The date in days since 1970."""
        return None if self.date is None else self.date.timestamp() / 86400.0


def is_fleet(path: Path) -> bool:
    """Whether a path is a folder or a table of recordings, and not itself a recording."""
    if path.is_dir():
        return not is_bag(path)
    if path.suffix.lower() not in (".csv", ".toml") or not path.is_file():
        return False
    with opened(path) as file:
        if path.suffix.lower() == ".csv":
            first = file.readline().decode("utf-8-sig", "replace").strip().lower()
            return any(cell.strip() in FILE for cell in re.split("[,;\t]", first))
        try:
            top = tomllib.loads(file.read().decode("utf-8-sig"))
        except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError):
            return False
    return isinstance(top.get("recording"), list)


def listed(path: Path) -> list[Listed]:
    """Return the recordings of a folder or a table, sorted by name.

    Raises ValueError with one sentence: no recording, one that is missing or listed twice, or an
    invalid value or date.
    """
    if path.is_dir():
        table = next((path / name for name in TABLES if (path / name).is_file()), None)
        return _of_folder(path) if table is None else listed(table)
    return _of_rows(path, _csv_rows(path) if path.suffix.lower() == ".csv" else _toml_rows(path))


def _of_rows(path: Path, rows: Sequence[Mapping[str, object]]) -> list[Listed]:
    found = [_listed(path, place, row) for place, row in enumerate(rows, 1)]
    seen = set[Path]()
    for one in found:
        if one.path.resolve() in seen:
            raise ValueError(f"{path.name} has {one.path} twice; leave one of them out")
        seen.add(one.path.resolve())
    if not found:
        raise ValueError(f"{path.name} lists no recording; add a line for each")
    return found


def listed_rows(rows: Sequence[Mapping[str, object]], folder: Path) -> list[Listed]:
    """Return the recordings of a table's rows; folder: what relative paths start from.

    Raises ValueError as `listed`.
    """
    table = folder / "recordings"  # the name of the row in messages
    return _of_rows(table, rows)


def columns_of(every: Sequence[Listed]) -> tuple[dict[str, list[float]], list[str]]:
    """Return the values of the columns that all recordings have, and the other columns' names."""
    names = list(dict.fromkeys(name for one in every for name in one.known))
    whole = [name for name in names if all(name in one.known for one in every)]
    return {n: [one.known[n] for one in every] for n in whole}, [n for n in names if n not in whole]


def _of_folder(folder: Path) -> list[Listed]:
    files = sorted(p for p in folder.rglob("*") if p.is_file() and not _hidden(p, folder))
    described = [p for p in files if _is_recording_toml(p)]
    taken = {(p.parent / load_description(p).file).resolve() for p in described}
    data = [
        p
        for p in files
        if p.suffix.lower() in DATA and p.resolve() not in taken and not p.name.endswith(OURS)
    ]
    found = sorted({*described, *data})
    if not found:
        raise ValueError(
            f"{folder} holds no recording; give a folder of recordings, or one with a table"
            f" {TABLES[0]}"
        )
    return [Listed(_name(p, folder), p, _device(p, folder), _date_in(p.stem, p)) for p in found]


def _hidden(path: Path, folder: Path) -> bool:
    return any(part.startswith(".") for part in path.relative_to(folder).parts)


def _is_recording_toml(path: Path) -> bool:
    if path.suffix.lower() != ".toml":
        return False
    try:
        top = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError):
        return False
    return "file" in top and ("output" in top or "input" in top)


def _device(path: Path, folder: Path) -> str:
    parts = path.relative_to(folder).parts
    return parts[0] if len(parts) > 1 else ONLY


def _name(path: Path, folder: Path) -> str:
    return path.relative_to(folder).with_suffix("").as_posix()


def _date_in(text: str, path: Path) -> datetime | None:
    match = DATED.search(text)
    if match is None:
        return None
    try:
        return _date(match[1] + (f"T{match[2]}:{match[3]}" if match[2] else ""))
    except ValueError:
        raise ValueError(
            f"{path.name} has {match[0]!r} in its name, which is not a date; rename it, or list the"
            f" recordings in {TABLES[0]}"
        ) from None


def _date(value: object) -> datetime:
    if isinstance(value, datetime):
        found = value
    elif isinstance(value, date):
        found = datetime(value.year, value.month, value.day)
    else:
        found = datetime.fromisoformat(str(value).strip())
    return found.replace(tzinfo=UTC) if found.tzinfo is None else found


def _csv_rows(path: Path) -> list[dict[str, object]]:
    with opened(path) as file:
        text = file.read().decode("utf-8-sig", "replace")
    try:
        form = csv.Sniffer().sniff(text.partition("\n")[0], ",;\t")
    except csv.Error:
        form = csv.excel
    lines = csv.DictReader(io.StringIO(text), dialect=form, restkey="")
    return [
        {str(key).strip(): value for key, value in line.items() if key and value not in (None, "")}
        for line in lines
        if any(line.values())
    ]


def _toml_rows(path: Path) -> list[dict[str, object]]:
    with opened(path) as file:
        try:
            top = tomllib.loads(file.read().decode("utf-8-sig"))
        except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
            raise ValueError(f"{path.name}: this is not TOML: {error}") from None
    rows = top.get("recording")
    if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
        raise ValueError(f"{path.name} has no [[recording]] tables; add one for each recording")
    return [dict(row) for row in rows]


def _listed(table: Path, place: int, row: Mapping[str, object]) -> Listed:
    at = f"{table.name}, recording {place}"
    lower = {key.lower(): key for key in row}

    def given(names: Sequence[str]) -> object:
        return next((row[lower[n]] for n in names if n in lower), None)

    file = given(FILE)
    if not isinstance(file, str):
        raise ValueError(f"{at} has no file; give it under 'recording'")
    path = table.parent / file.strip()
    if not path.is_file():
        raise ValueError(f"{at} is {file!r}, which does not exist; correct it, or take it out")
    when, device = given(DATE), given(DEVICE)
    try:
        dated = _date_in(path.stem, path) if when is None else _date(when)
    except ValueError:
        raise ValueError(
            f"{at} has date {when!r}; write it as ISO 8601, such as 2026-03-02"
        ) from None
    known: dict[str, float] = {}
    for key, value in row.items():
        if key.lower() in (*FILE, *DEVICE, *DATE):
            continue
        try:
            number = math.nan if isinstance(value, bool) else float(str(value))
        except ValueError:
            number = math.nan
        if not math.isfinite(number):
            raise ValueError(f"{at} has {key!r} of {value!r}; it must be a finite number")
        known[key] = number
    name = Path(file.strip()).with_suffix("").as_posix()
    return Listed(name, path, ONLY if device is None else str(device).strip(), dated, known)
