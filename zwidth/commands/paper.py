"""`zwidth paper`: recomputed tables and figures beside those of the paper, as one report."""

from collections.abc import Iterator
from pathlib import Path

import click

from zwidth.console import Console, progress
from zwidth.jobs.executor import Processes
from zwidth.options import force_option, out_option
from zwidth.paper.report import DrawnSection, save_pictures, save_report
from zwidth.paper.sections import SECTIONS, compute

WORKERS = 2
LONG = ("explained",)  # long sections begin first, so that none runs alone at the end


@click.command("paper")
@click.option("--section", "chosen", multiple=True, metavar="NAME",
              type=click.Choice(list(SECTIONS)),
              help="Compute only this section; may be repeated. One of"
              f" {', '.join(SECTIONS)}.")  # fmt: skip
@out_option("runs/paper")
@force_option
def command(chosen: tuple[str, ...], out: Path) -> None:
    """Recompute the figures and tables of the paper on virtual walls, beside the published ones.

    docs/paper.md names the paper. Its block diagrams (Fig. 4, 5, 9) have no results and are left
    out. Writes one HTML report with all pictures, DIR/report.html, and each picture as PNG and SVG.
    """
    console = Console()
    console.will_write(out / "report.html")
    keys = [key for key in SECTIONS if key in chosen or not chosen]
    done: dict[str, DrawnSection] = {}
    try:
        with progress("computing", len(keys)) as advance:
            for section in _computed(keys):
                done[section.key] = section
                save_pictures(section, out)
                advance(1, now=section.title)
    finally:  # after Ctrl-C too, finished sections are kept
        if done:
            ordered = [done[key] for key in keys if key in done]
            missing = [SECTIONS[key] for key in keys if key not in done]
            for section in ordered:
                pictures = sum(kind == "picture" for kind, _ in section.parts)
                many = "1 picture" if pictures == 1 else f"{pictures} pictures"
                console.say(f"{section.seconds:5.1f} s  {section.title} ({many})")
            console.say(f"wrote {save_report(ordered, missing, out / 'report.html')}")


def _computed(keys: list[str]) -> Iterator[DrawnSection]:
    """Yield the sections as they are finished, two at a time in processes of their own."""
    if len(keys) == 1:
        yield compute(keys[0])
        return
    longest_first = sorted(keys, key=lambda key: key not in LONG)
    for _, section in Processes(WORKERS).run(compute, {key: key for key in longest_first}):
        yield section
