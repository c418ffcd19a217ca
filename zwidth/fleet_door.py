"""`zwidth diagnose` of a folder or a table of recordings: one answer for a fleet."""

from pathlib import Path

from zwidth.console import Column, Console, progress
from zwidth.diagnosis_report import in_words as effects_in_words
from zwidth.door import fitted
from zwidth.figures.fleet import fleet_figure
from zwidth.figures.style import picture_files, save_figure
from zwidth.files.protection import reading
from zwidth.files.whole import write_text
from zwidth.fleet.diagnosed import diagnose_fleet
from zwidth.fleet.listing import TABLES, Listed, listed
from zwidth.fleet.reading import content_of, trace_of
from zwidth.fleet.reasons import FAULTS, in_words
from zwidth.fleet.result import Fleet
from zwidth.fleet_report import save_fleet_report
from zwidth.heartbeat import HEART
from zwidth.jobs.choose import executor
from zwidth.jobs.parallel import threads
from zwidth.sim.device import Device
from zwidth.sim.device_file import commented_text
from zwidth.sim.readable import with_unit

FEW = 16  # recordings, below which processes are not worth their start
FROM = 3  # recordings to which a device is fitted if none is given
SHOWN = 20  # odd recordings that are printed


def diagnose_recordings(
    console: Console,
    path: Path,
    device: Device | None,
    effort: str,
    out: Path,
    processes: int | None,
    cluster: str | None,
    line: str,
) -> Fleet:
    """Diagnose a folder or a table of recordings, and write the results.

    OUT/NAME.fleet.html, the report; NAME.fleet.png and .svg; NAME.fleet.device.toml, the typical
    device with its physics; NAME.fleet/, the results for each recording, from which a rerun
    continues. Raises ValueError as `diagnose_fleet`.
    """
    recordings = listed(path)
    for table in [path] if path.is_file() else [path / name for name in TABLES]:
        if table.is_file():
            reading(table)
    for one in recordings:
        content_of(one.path)  # so that none of them is overwritten
    stem = out / path.resolve().stem
    report, typical = (stem.with_name(f"{stem.name}.fleet.{e}") for e in ("html", "device.toml"))
    pictures = stem.with_name(f"{stem.name}.fleet")
    console.will_write(report, typical, *picture_files(pictures))
    if device is None:
        device = _fitted(console, recordings)
    if processes is None and cluster is None and len(recordings) > FEW:
        processes = threads()
    done = 0
    with executor(cluster, processes) as runner, progress("recordings", len(recordings)) as advance:

        def told(stage: str, count: int, total: int) -> None:
            nonlocal done
            if stage == "fitting":
                advance(count - done, now=stage)
                done = count
            else:
                advance(0, now=f"{stage}: {count} of {total}")

        def said(text: str) -> None:
            console.doing(effects_in_words(text.replace("@", " at ")), HEART.elapsed())

        found = diagnose_fleet(
            device, recordings, stem.with_name(f"{stem.name}.fleet"), runner, effort,
            said, told,
        )  # fmt: skip
    _say(console, found)
    console.say(f"wrote {write_text(typical, commented_text(found.structure.typical))}")
    for written in save_figure(fleet_figure(found), pictures):
        console.say(f"wrote {written}")
    console.say(f"wrote {save_fleet_report(found, line, typical, report)}")
    console.result(found.as_json())
    return found


def _fitted(console: Console, recordings: list[Listed]) -> Device:
    """A device that is fitted to a few of the recordings."""
    step = max(1, len(recordings) // FROM)
    some = recordings[::step][:FROM]
    device, said = fitted([(one.name, trace_of(one.path)) for one in some])
    for sentence in said:
        console.note(sentence)
    return device


def _say(console: Console, found: Fleet) -> None:
    console.say(f"\n{found.headline}\n")
    for note in found.notes:
        console.warn(note)
    rows: list[list[str]] = []
    for name, s in found.spreads.items():
        unit = found.names[name]
        levels = [w for has, w in ((s.per_device, "device"), (s.per_run, "run")) if has]
        rms = [with_unit(t, unit) for t in (s.tau_device, s.tau_run) if t > 0.0]
        slopes = [f"{k}: {with_unit(v.value, unit)} a unit" for k, v in s.slopes.items()]
        rows.append(
            [
                in_words(name).rstrip(","),
                with_unit(s.center.value, unit),
                "by " + " and ".join(levels) if levels else "no",
                " and ".join(rms) or "-",
                "; ".join(slopes) or "-",
            ]
        )
    columns = [
        Column("parameter", False), Column("value"), Column("differs", False), Column("rms"),
        Column("follows", False),
    ]  # fmt: skip
    console.table("What the fleet has in common", columns, rows)
    for change in found.changes:
        console.say(f"changed: {found.said_of(change)}")
    odd = [m for m in found.odd if m.reason is not None]
    for m in odd[:SHOWN]:
        if m.reason is not None:
            console.say(f"{m.listed.name}: {FAULTS[m.reason.kind]}: {m.reason.sentence}")
    if len(odd) > SHOWN:
        console.say(f"and {len(odd) - SHOWN} more, which the report lists")
