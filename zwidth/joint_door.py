"""`zwidth diagnose --joint all`: each joint of a recording by itself, and a table of all.

The joints of a robot differ, so each has its own device and its own answer. For joints that are
alike, a table is written that `zwidth diagnose` reads as a fleet.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import tomli_w

from zwidth.console import Column, Console
from zwidth.diagnose_files import diagnose_files
from zwidth.diagnosis.answer.result import Diagnosis
from zwidth.door import described
from zwidth.files.whole import write_text
from zwidth.logs.assumed import Joints, joints_of
from zwidth.logs.open_source import own_log
from zwidth.logs.source import RecordingError, Source
from zwidth.sim.readable import percent


@dataclass(frozen=True)
class _OfOne(Console):
    """Where the words on one joint go; its JSON is kept for that of all."""

    results: list[Any] = field(default_factory=list[Any])

    def keep(self, value: Any) -> None:
        """Write nothing: the file is for all joints."""

    def result(self, value: Any) -> None:
        """Keep the JSON of a joint."""
        self.results.append(value)


def diagnose_joints(
    console: Console,
    path: Path,
    device: str | None,
    effort: str,
    wall: bool | None,
    out: Path,
    line: str,
) -> None:
    """Diagnose every joint that moves, and print and write the results of each.

    OUT/NAME.JOINT.toml says how the file is read, and OUT/NAME.JOINT.diagnosis.html and so on are
    the answer, as for one joint; OUT/NAME.joints.toml lists them as a fleet. A joint that cannot be
    diagnosed does not affect the others. Raises ValueError for a recording without several joints,
    ClickException if none can be diagnosed, KeyboardInterrupt at its end if interrupted.
    """
    joints = several_joints(path)
    told = f" ({', '.join(joints.still)} stand still)" if joints.still else ""
    console.note(f"{path.name} has {len(joints.moving)} joints that move{told}")
    files = {joint: f"{path.stem}.{plain(joint)}.toml" for joint in joints.moving}
    listing = out / f"{path.stem}.joints.toml"
    console.will_write(listing)
    rows: list[list[str]] = []
    results: dict[str, Any] = {}
    interrupted = False
    for place, (joint, signal) in enumerate(joints.moving.items(), 1):
        console.say(f"\njoint {joint}, {signal}: {place} of {len(joints.moving)}")
        own = _OfOne(console.json)
        try:
            toml = described(own, path, out, joint, name=files[joint])
            found = diagnose_files(own, (toml,), device, (), effort, wall, out, line)
            rows.append(_row(joint, found))
        except KeyboardInterrupt:
            interrupted = True
            rows.append([joint, "interrupted", "-", "-"])
        except (ValueError, click.ClickException) as error:
            said = error.message if isinstance(error, click.ClickException) else str(error)
            console.warn(f"joint {joint}: {said}")
            rows.append([joint, f"not diagnosed: {said}", "-", "-"])
            results[joint] = {"error": said}
        if own.results:
            results[joint] = own.results[-1]
        if interrupted:
            break
    columns = [
        Column("joint", False), Column("what is missing", False), Column("refitted"),
        Column("with it"),
    ]  # fmt: skip
    console.table("\nAll joints; error of free runs on held-out data", columns, rows)
    alike = {"recording": [{"recording": f, "device": j} for j, f in files.items()]}
    written = write_text(listing, tomli_w.dumps(alike))
    console.say(f"wrote {written}, a fleet if the joints are alike")
    console.result({"joints": results, "still": list(joints.still)})
    if interrupted:
        raise KeyboardInterrupt
    if all("error" in result for result in results.values()):
        raise click.ClickException("no joint could be diagnosed, as said above")


def several_joints(path: Path) -> Joints:
    """Return the joints of a file; RecordingError if zwidth wrote it or it has a description."""
    if path.suffix.lower() == ".toml":
        raise RecordingError(f"{path.name} already gives its joint; leave --joint out")
    found = own_log(path)
    if not isinstance(found, Source):
        raise RecordingError(f"{path.name} is a log of one device; leave --joint out")
    return joints_of(found)


def plain(joint: str) -> str:
    """Return the name of a joint as a part of a file name."""
    return re.sub(r"[^\w.-]+", "_", joint).strip("_.") or "joint"


def _row(joint: str, found: Diagnosis) -> list[str]:
    free = found.free_run
    after = percent(free.after) if found.findings else "-"
    return [joint, found.headline, percent(free.refit), after]
