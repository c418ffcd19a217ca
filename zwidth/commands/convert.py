"""`zwidth convert`: the content of a file, a TOML to start from, and any log in another format."""

from pathlib import Path
from typing import Any

import click
import numpy as np

from zwidth.console import Column, Console, json_number
from zwidth.files.whole import replacing, write_text
from zwidth.logs.export import WRITERS
from zwidth.logs.guess import Seen, clock_faults, draft, gaps_seen, look
from zwidth.logs.mcap_reader import Log
from zwidth.logs.mcap_writer import write_log
from zwidth.logs.open_source import own_log
from zwidth.logs.recording import load_log
from zwidth.logs.source import RecordingError, Source
from zwidth.options import force_option, json_option

MOST_ROWS = 200
TARGETS = (".mcap", *WRITERS, ".toml")


@click.command("convert")
@click.argument("source", metavar="SOURCE", type=click.Path(path_type=Path))
@click.argument("target", metavar="[TARGET]", required=False, type=click.Path(path_type=Path))
@click.option("--out", "other", metavar="FILE", type=click.Path(path_type=Path),
              help="Another way to give TARGET.")  # fmt: skip
@force_option
@json_option
def command(source: Path, target: Path | None, other: Path | None, json_file: str | None) -> None:
    """Show what a recorded file contains, draft its description, or convert it.

    SOURCE is a recording TOML, a log that zwidth wrote (MCAP, CSV, Parquet, NPZ), or a file of
    another tool (also MAT, NPY, HDF5, text tables). Without TARGET the signals are listed; for a
    file of another tool, a recording TOML to start from is printed too.

    TARGET is the file to write: .mcap, .csv, .parquet or .npz for the data, or .toml for the
    description.
    """
    console = Console(json_file)
    if target is not None and other is not None:
        raise click.UsageError(
            f"the target is given twice, {target} and --out {other}; give it once"
        )
    target = target or other
    if target is None:
        _show(console, source)
    elif target.suffix.lower() == ".toml":
        _draft(console, source, target)
    else:
        _convert(console, source, target)


def _convert(console: Console, source: Path, target: Path) -> None:
    suffix = target.suffix.lower()
    if suffix not in TARGETS:
        raise RecordingError(
            f"{target} ends in {target.suffix!r}; a log is written as {', '.join(TARGETS[:-1])}"
        )
    log = load_log(source)
    console.will_write(target)
    if suffix == ".mcap":
        _write_mcap(target, log)
        left_out: list[str] = []
    else:
        with replacing(target) as stream:
            left_out = WRITERS[suffix](stream, log)
    warnings = _warnings(log)
    for warning in warnings:
        console.warn(warning)
    console.say(f"wrote {target}: {len(log.tick)} samples of {', '.join(log.tick.channels)}")
    for item in left_out:
        console.say(f"left out: {item}")
    console.result(
        {
            "wrote": str(target),
            "samples": len(log.tick),
            "channels": list(log.tick.channels),
            "left_out": left_out,
            "warnings": warnings,
        }
    )


def _write_mcap(target: Path, log: Log) -> None:
    metadata = {key: value for key, value in log.metadata.items() if key != "origin"}
    write_log(
        target,
        log.tick,
        substep=log.substep,
        events=log.events,
        metadata=metadata,
        attachments=log.attachments,
        epoch_ns=log.epoch_ns,
    )


def _warnings(log: Log) -> list[str]:
    said = log.tick.facts.get("warnings", ())
    found = [str(warning) for warning in said] if isinstance(said, list | tuple) else []
    return [*found, *(warning for warning in log.warnings if warning not in found)]


def _draft(console: Console, source: Path, target: Path) -> None:
    found = _foreign(source)
    if found is None:
        raise RecordingError(f"{source} needs no TOML; zwidth can read it as it is")
    console.will_write(target)
    text = draft(found, look(found))
    console.say(f"wrote {write_text(target, text)}; check every line of it")
    console.result({"wrote": str(target), "toml": text})


def _foreign(source: Path) -> Source | None:
    """Return the signals of another tool's file, None for what zwidth can read as it is."""
    if source.suffix.lower() == ".toml":
        return None
    found = _opened(source)
    return found if isinstance(found, Source) else None


def _opened(source: Path) -> Log | Source:
    """Return a log or the signals of another tool's file; raises RecordingError for none."""
    found = own_log(source)
    if isinstance(found, Source) and not found.signals:
        raise RecordingError(
            f"{source} holds no array of numbers, so there is nothing to describe; give a file in"
            " which a command and a reading are columns"
        )
    return found


def _show(console: Console, source: Path) -> None:
    if source.suffix.lower() == ".toml":
        log = load_log(source)
        console.will_write()
        _show_log(console, log)
        return
    found = _opened(source)
    console.will_write()
    if isinstance(found, Log):
        _show_log(console, found)
    else:
        _show_source(console, found)


def _show_log(console: Console, log: Log) -> None:
    trace = log.tick
    rows: list[list[str]] = []
    channels: list[dict[str, Any]] = []
    for name, values in trace.channels.items():
        finite = values[np.isfinite(values)]
        least, most = (float(f(finite)) if finite.size else np.nan for f in (np.min, np.max))
        rows.append([name, trace.units[name], f"{least:.6g}", f"{most:.6g}"])
        channels.append(
            {
                "channel": name,
                "unit": trace.units[name],
                "least": json_number(least),
                "most": json_number(most),
            }
        )
    for warning in (warnings := _warnings(log)):
        console.warn(warning)
    console.table(
        f"{log.path.name}: {trace.origin}, {len(trace)} samples, {trace.t[0]:.6g} to"
        f" {trace.t[-1]:.6g} s",
        [Column("channel", False), Column("unit", False), Column("least"), Column("most")],
        rows,
    )
    console.result(
        {
            "file": str(log.path),
            "origin": trace.origin,
            "samples": len(trace),
            "channels": channels,
            "events": len(log.events),
            "attachments": list(log.attachments),
            "warnings": warnings,
        }
    )


def _show_source(console: Console, source: Source) -> None:
    seen = look(source)
    faults = [*clock_faults(source), *gaps_seen(source)]
    for note in (*source.notes, *faults):
        console.warn(note)
    columns = [
        *(Column("signal", False), Column("unit", False), Column("samples"), Column("rate [Hz]")),
        *(Column("least"), Column("most"), Column("step"), Column("not finite")),
        Column("seems", False),
    ]
    console.table(
        f"{source.path.name}: {source.kind}, {len(seen)} signals",
        columns,
        [_row(one) for one in seen[:MOST_ROWS]],
    )
    if len(seen) > MOST_ROWS:
        console.say(f"and {len(seen) - MOST_ROWS} more")
    for name, reason in list(source.unreadable.items())[:MOST_ROWS]:
        console.say(f"not read: {name} {reason}")
    text = draft(source, seen)
    console.say(
        f"\nA recording TOML to start from (zwidth convert {source.path} FILE.toml writes it):\n"
    )
    console.show(text)
    console.result(
        {
            "file": str(source.path),
            "format": source.kind,
            "signals": [_json(one) for one in seen],
            "unreadable": dict(source.unreadable),
            "warnings": [*source.notes, *faults],
            "toml": text,
        }
    )


def _row(one: Seen) -> list[str]:
    return [
        one.name,
        one.unit,
        str(one.samples),
        f"{one.rate:.6g}" if one.rate else "",
        f"{one.least:.6g}",
        f"{one.most:.6g}",
        "" if one.step is None else f"{one.step:.6g}",
        str(one.missing) if one.missing else "",
        one.seems,
    ]


def _json(one: Seen) -> dict[str, Any]:
    return {
        "signal": one.name,
        "unit": one.unit,
        "samples": one.samples,
        "not_finite": one.missing,
        "rate_hz": one.rate,
        "least": json_number(one.least),
        "most": json_number(one.most),
        "step": one.step,
        "seems": one.seems,
    }
