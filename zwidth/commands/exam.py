"""`zwidth exam`: diagnose concealed recordings, open the seals, score."""

import shlex
from pathlib import Path
from typing import Any

import click

from zwidth.console import Column, Console, progress
from zwidth.exam.conceal import conceal, orders
from zwidth.exam.strata import counts
from zwidth.exam.take import mark_all, result, sit_all
from zwidth.exam_page import goals, page
from zwidth.figures.exam import confusion_figure, magnitude_figure, reliability_figure
from zwidth.figures.style import picture_files, save_figure
from zwidth.files.protection import reading
from zwidth.files.whole import json_text, write_text
from zwidth.jobs.choose import executor
from zwidth.options import Quantity, cluster_option, force_option, json_option
from zwidth.scenarios.concealed.handout import all_files, made_file, names

PICTURES = ("confusion", "magnitude", "reliability")


@click.command("exam")
@click.argument("folder", metavar="DIR", type=click.Path(file_okay=False, path_type=Path))
@click.option("--count", type=click.IntRange(1),
              help="First make this many recordings in DIR, as 'zwidth conceal' does.")  # fmt: skip
@click.option(
    "--strata",
    metavar="NAME=N,...",
    help="First make this many recordings of each class, such as none=100,single_2x=50.",
)
@click.option("--rigs", type=click.IntRange(0), default=0,
              help="First make this many rigs: machines with several effects.")  # fmt: skip
@click.option("--outside", type=click.IntRange(0), default=0,
              help="First make this many recordings with a law that is not in the"
              " library.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0), help="Seed of the recordings made first.")
@click.option(
    "--seconds",
    type=Quantity("s", 2.0),
    help="Length of each recording made first. Default: 10 to 20 s.",
)
@click.option(
    "--processes", type=click.IntRange(1), help="Number of parallel processes. Default: 1."
)
@cluster_option
@click.option("--page", "page_file", type=click.Path(dir_okay=False, path_type=Path),
              help="Also write the result as a page of evidence, with its pictures.")  # fmt: skip
@force_option
@json_option
def command(
    folder: Path,
    count: int | None,
    strata: str | None,
    rigs: int,
    outside: int,
    seed: int | None,
    seconds: float | None,
    processes: int | None,
    cluster: str | None,
    page_file: Path | None,
    json_file: str | None,
) -> None:
    """Diagnose recordings with concealed physics and score the answers.

    DIR is a folder that 'zwidth conceal' made; with --count, --strata, --rigs or --outside its
    recordings are made first. Writes DIR/exam.json and DIR/exam.md with its pictures. After an
    interruption, the same command continues where it stopped. Delete DIR/answers and DIR/marks to
    start again.
    """
    console = Console(json_file)
    making = count is not None or strata is not None or rigs > 0 or outside > 0
    if not making and (seed is not None or seconds is not None):
        raise ValueError(
            "--seed and --seconds need recordings that this command makes; add --count, --strata,"
            " --rigs or --outside"
        )
    for name in names(folder):  # these are finished and not made again
        for file in all_files(folder, name):
            reading(file)
    pages = [folder / "exam.md", *([page_file] if page_file else [])]
    stems = [stem for path in pages for stem in _pictures(path).values()]
    pictures = [file for stem in stems for file in picture_files(stem)]
    console.will_write(folder / "exam.json", *pages, *pictures)
    with executor(cluster, processes) as runner:
        if making:
            asked = orders(folder, counts(count, strata, rigs, outside), seed or 0, seconds)
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
        "length": None if made[0][4] == "None" else f"{made[0][4]} s",
    }
    for path in pages:
        for written in _write(path, found, facts):
            console.say(f"wrote {written}")
    columns = [Column("asked", False), Column("goal"), Column("seen", False), Column("reached")]
    rows = [[cell.strip("*") for cell in row] for row in goals(found)]
    console.table(f"\n{found['recordings']} recordings", columns, rows)
    console.result(found)


def _write(path: Path, found: dict[str, Any], facts: dict[str, Any]) -> list[Path]:
    """Write the page and its pictures beside it."""
    figures = {
        "confusion": confusion_figure(found["confusion"]),
        "magnitude": magnitude_figure(found["by_magnitude"]),
        "reliability": reliability_figure(found["calibration"]),
    }
    stems = _pictures(path)
    if not found["calibration"]["statements"]:
        del stems["reliability"]
    written = [file for name, stem in stems.items() for file in save_figure(figures[name], stem)]
    names = {name: f"{stem.name}.png" for name, stem in stems.items()}
    return [write_text(path, page(found, facts, names)), *written]


def _pictures(page_file: Path) -> dict[str, Path]:
    """Return the pictures of a page, without the kind of file that ends their names."""
    return {n: page_file.with_name(f"{page_file.stem}_{n}") for n in PICTURES}


def _made(folder: Path) -> list[list[str]]:
    """Return name, class, seed, rank and length of each recording, as they stand by the keys."""
    listed = reading(made_file(folder)).read_text(encoding="utf-8")
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
