"""The exam: sit every recording, then open the seals, mark and tally.

DIR/answers/r0001.json    what the diagnosis said, written before any seal is opened
DIR/marks/r0001.json      held-out errors of the true device beside those of the answer

Either is written where there is none, and never again.
"""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from zwidth.exam.mark import Mark, linear_truth, mark
from zwidth.exam.perfect import HeldOut, held_out
from zwidth.exam.sitting import Paper, sit
from zwidth.exam.tally import tally
from zwidth.files.whole import write_text
from zwidth.jobs.executor import Executor
from zwidth.logs.recording_file import load_description
from zwidth.scenarios.concealed.handout import (
    PARTS,
    description_file,
    key_file,
    names,
    recording_files,
)
from zwidth.scenarios.concealed.sealing import SealError, digest, open_key
from zwidth.sim.device_file import device_from_text

Said = Callable[[str], None]


def sit_all(folder: Path, executor: Executor, done: Said = lambda _: None) -> list[str]:
    """Diagnose every recording that has no answer yet; return all names.

    Raises ValueError if the folder holds no concealed recordings.
    """
    every = names(folder)
    if not every:
        raise ValueError(
            f"{folder} holds no concealed recordings; make some there with 'zwidth conceal'"
        )
    (folder / "answers").mkdir(exist_ok=True)
    papers = {
        n: Paper(str(folder.resolve()), n) for n in every if not _answer_file(folder, n).exists()
    }
    for name, answer in executor.run(sit, papers):
        write_text(_answer_file(folder, name), json.dumps(answer, indent=1) + "\n", own=True)
        done(name)
    return every


def _answer_file(folder: Path, name: str) -> Path:
    return folder / "answers" / f"{name}.json"


def _mark_file(folder: Path, name: str) -> Path:
    return folder / "marks" / f"{name}.json"


@dataclass(frozen=True)
class Opened:
    """A recording whose seal was opened and found whole: its key and the answer given to it."""

    folder: str
    name: str
    key: dict[str, Any]
    answer: dict[str, Any]


def open_seal(folder: Path, name: str) -> Opened:
    """Return key and answer of a recording.

    Raises SealError if key, recording, device file or answer is not what it was.
    """
    sealed = load_description(description_file(folder, name)).source
    files = recording_files(folder, name)
    key = open_key(key_file(folder, name), sealed, files)
    if missing := set(key["sha256"]) - set(files):
        raise SealError(f"{name} lacks its {', '.join(sorted(missing))}; make it again")
    for part in PARTS:
        other = description_file(folder, name, part)
        if part in files and not load_description(other).source == sealed:
            raise SealError(f"{other.name} does not carry the seal of {name}; make it again")
    answer = json.loads(_answer_file(folder, name).read_text(encoding="utf-8"))
    for part, path in files.items():
        if answer["sha256"].get(part) != digest(path):
            raise SealError(
                f"the answer to {name} is about another {path.name}; delete the answer and repeat"
            )
    return Opened(str(folder.resolve()), name, key, answer)


def fit_of(opened: Opened) -> dict[str, float] | None:
    """Return the held-out errors as JSON, None if there are none."""
    found = held_out(Path(opened.folder), opened.name, opened.key, opened.answer)
    return None if found is None else asdict(found)


def mark_all(
    folder: Path, every: list[str], executor: Executor, done: Said = lambda _: None
) -> tuple[list[Mark], dict[str, HeldOut]]:
    """Open all seals, then mark; raises SealError for the first one broken."""
    opened = {name: open_seal(folder, name) for name in every}
    (folder / "marks").mkdir(exist_ok=True)
    left = {name: o for name, o in opened.items() if not _mark_file(folder, name).exists()}
    for name, errors in executor.run(fit_of, left):
        write_text(_mark_file(folder, name), json.dumps(errors) + "\n", own=True)
        done(name)
    fits: dict[str, HeldOut] = {}
    marks: list[Mark] = []
    for name, o in opened.items():
        errors = json.loads(_mark_file(folder, name).read_text(encoding="utf-8"))
        if errors is not None:
            fits[name] = HeldOut(**errors)
        chain = device_from_text(o.key["device"]).chain
        marks.append(mark(o.key, o.answer, linear_truth(chain)))
    return marks, fits


def result(marks: list[Mark], fits: dict[str, HeldOut]) -> dict[str, Any]:
    """Return the JSON of `zwidth exam`, with every mark behind it."""
    return tally(marks, fits) | {"marks": [asdict(m) for m in marks]}
