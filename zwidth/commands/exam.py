"""`zwidth exam`: diagnose concealed recordings, open the seals, score."""

import shlex
from pathlib import Path
from typing import Any

import click

from zwidth.compiling import announce
from zwidth.console import Column, Console, progress
from zwidth.diagnosis.exam.conceal import conceal, orders
from zwidth.diagnosis.exam.strata import counts
from zwidth.diagnosis.exam.take import mark_all, result, sit_all
from zwidth.exam_page import goals, page
from zwidth.figures.exam import confusion_figure, magnitude_figure
from zwidth.figures.style import save_figure
from zwidth.files.whole import json_text, write_text
from zwidth.jobs.choose import executor
from zwidth.options import Quantity, cluster_option, json_option


@click.command("exam")
@click.argument("folder", metavar="DIR", type=click.Path(file_okay=False, path_type=Path))
@click.option("--count", type=click.IntRange(1),
              help="Make so many recordings in DIR first, as zwidth conceal does.")  # fmt: skip
@click.option("--strata", metavar="NAME=N,...", help="Make so many of each class first.")
@click.option("--seed", type=click.IntRange(0), help="Seed of the recordings made first.")
@click.option("--seconds", type=Quantity("s", 2.0), help="Length of each, else 10 to 20 s.")
@click.option("--processes", type=click.IntRange(1), help="Processes side by side, else one.")
@cluster_option
@click.option("--page", "page_file", type=click.Path(dir_okay=False, path_type=Path),
              help="Write the page of evidence here too, with its pictures beside it.")  # fmt: skip
@json_option
def command(
    folder: Path,
    count: int | None,
    strata: str | None,
    seed: int | None,
    seconds: float | None,
    processes: int | None,
    cluster: str | None,
    page_file: Path | None,
    json_file: str | None,
) -> None:
    """Diagnose concealed recordings, open the seals, and score.

    DIR is a folder of zwidth conceal, or is filled first where --count or --strata is given. Writes
    DIR/exam.json and DIR/exam.md with its pictures. Answers are kept as they come: an interrupted
    exam goes on where it stopped. Delete DIR/answers and DIR/marks to sit it again.
    """
    console = Console(json_file)
    making = count is not None or strata is not None
    if not making and (seed is not None or seconds is not None):
        raise ValueError("--seed and --seconds say how to make recordings; add --count or --strata")
    announce(console)
    with executor(cluster, processes) as runner:
        if making:
            asked = orders(folder, counts(count or 1, strata), seed or 0, seconds)
            with progress("concealing", len(asked)) as advance:
                conceal(folder, asked, runner, lambda name: advance(now=name))
        total = len(list((folder / "keys").glob("*.json")))
        with progress("diagnosing", total) as advance:
            every = sit_all(folder, runner, lambda name: advance(now=name))
        with progress("marking", total) as advance:
            marks, fits = mark_all(folder, every, runner, lambda name: advance(now=name))
    found = result(marks, fits)
    console.say(f"wrote {write_text(folder / 'exam.json', json_text(found))}")
    made = _made(folder)
    facts = {
        "command": _line(folder, made, processes, page_file),
        "seed": made[0][2],
        "length": "10 to 20 s" if made[0][4] == "None" else f"{made[0][4]} s",
    }
    for path in [folder / "exam.md", *([page_file] if page_file else [])]:
        for written in _write(path, found, facts):
            console.say(f"wrote {written}")
    columns = [Column("asked", False), Column("goal"), Column("seen", False), Column("reached")]
    rows = [[cell.strip("*") for cell in row] for row in goals(found)]
    console.table(f"\n{found['recordings']} recordings", columns, rows)
    console.result(found)


def _write(path: Path, found: dict[str, Any], facts: dict[str, Any]) -> list[Path]:
    """Write the page and its pictures beside it."""
    pictures = {
        "confusion": confusion_figure(found["confusion"]),
        "magnitude": magnitude_figure(found["by_magnitude"]),
    }
    written: list[Path] = []
    names: dict[str, str] = {}
    for name, figure in pictures.items():
        stem = path.with_name(f"{path.stem}_{name}")
        written += save_figure(figure, stem)
        names[name] = f"{stem.name}.png"
    return [write_text(path, page(found, facts, names)), *written]


def _made(folder: Path) -> list[list[str]]:
    """Return name, class, seed, rank and length of each recording, as they stand by the keys."""
    listed = (folder / "keys" / "made.txt").read_text(encoding="utf-8")
    return [line.split() for line in listed.splitlines()]


def _line(
    folder: Path, made: list[list[str]], processes: int | None, page_file: Path | None
) -> str:
    """Return the command line that makes and takes this exam."""
    classes = [entry[1] for entry in made]
    asked = ",".join(f"{name}={classes.count(name)}" for name in sorted(set(classes)))
    words = ["zwidth", "exam", folder.name, "--strata", asked, "--seed", made[0][2]]
    words += [] if made[0][4] == "None" else ["--seconds", made[0][4]]
    words += [] if processes is None else ["--processes", str(processes)]
    return shlex.join(words + ([] if page_file is None else ["--page", str(page_file)]))
