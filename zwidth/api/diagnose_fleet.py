"""Many recordings of devices that are alike: one answer for all."""

import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from zwidth.api.given import AnyDevice, device_of
from zwidth.api.notebook import telling
from zwidth.diagnosis.selection.effort import EFFORTS
from zwidth.files.protection import writing_as
from zwidth.fleet import diagnosed
from zwidth.fleet.listing import Listed, listed, listed_rows
from zwidth.fleet.result import Fleet
from zwidth.jobs.executor import Executor
from zwidth.sim.nearest import nearest

AnyFleet = str | PathLike[str] | Sequence[Listed] | Sequence[Mapping[str, object]]


def diagnose_fleet(
    recordings: AnyFleet,
    device: AnyDevice,
    *,
    effort: Literal["quick", "normal", "thorough"] = "normal",
    work: str | PathLike[str] | None = None,
    runner: Executor | None = None,
    say: Callable[[str], None] | None = None,
) -> Fleet:
    """Say what many recordings have in common, what differs, what changed, and which are odd.

    recordings: a folder, a table (CSV or TOML), a list of `Listed`, or rows of a table, such as
    `frame.to_dict("records")` of pandas: recording, device, date, and known values that parameters
    may follow. device: a Device, the name of a shipped one, or a device file. effort: of the search
    for their physics. work: a folder that stores the result of each recording, so that the next
    call computes only new ones; without it nothing is stored. runner: where fits run, see
    `executor`; by default here, one after another. say: called with a sentence on each step.

    Raises ValueError with one sentence if fewer than three recordings can be used, or if
    `recordings` is not a list of recordings.
    """
    if effort not in EFFORTS:
        raise ValueError(f"effort is {effort!r}; {nearest(effort, EFFORTS)}")
    known, every = device_of(device), _listed(recordings)
    with ExitStack() as stack:
        stack.enter_context(writing_as("diagnose_fleet"))
        stack.enter_context(warnings.catch_warnings(action="ignore", category=RuntimeWarning))
        folder = stack.enter_context(TemporaryDirectory()) if work is None else work
        tell = stack.enter_context(telling(say, "diagnosing the fleet"))
        return diagnosed.diagnose_fleet(known, every, Path(folder), runner, effort, tell)


def _listed(given: AnyFleet) -> list[Listed]:
    if isinstance(given, str | PathLike):
        path = Path(given)
        if not path.exists():
            raise ValueError(f"{path} does not exist; give a folder or a table of recordings")
        return listed(path)
    rows = list(given)
    if all(isinstance(row, Listed) for row in rows):
        if not rows:
            raise ValueError("no recording is given; give at least three")
        return [row for row in rows if isinstance(row, Listed)]
    if not all(isinstance(row, Mapping) for row in rows):
        raise TypeError(
            "recordings are a folder, a table, or a list of Listed or of rows, such as"
            " frame.to_dict('records') of pandas"
        )
    return listed_rows([row for row in rows if isinstance(row, Mapping)], Path())
