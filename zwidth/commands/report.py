"""`zwidth report`: find and open the report of a diagnosis."""

import re
import webbrowser
from html import unescape
from pathlib import Path

import click

from zwidth.console import Console
from zwidth.files.protection import reading
from zwidth.options import force_option, json_option

ENDINGS = (".diagnosis.html", ".fleet.html")
HEADLINE = re.compile(r"<title>(.*?)</title>", re.DOTALL)


@click.command("report")
@click.argument("what", metavar="[WHAT]", default="runs", type=click.Path(path_type=Path))
@click.option("show", "--open", is_flag=True, help="Open the report in the browser.")
@force_option
@json_option
def command(what: Path, show: bool, json_file: str | None) -> None:
    """Find the report of a diagnosis, and open it with --open.

    WHAT is a report (NAME.diagnosis.html), a folder (its newest report is taken), or a recording
    (its report in runs/ or beside the recording is taken). Default: runs.

    A report is one HTML file below 3 MB that loads nothing from elsewhere, so it can be sent as it
    is. Drag across a curve in it to zoom.
    """
    console = Console(json_file)
    path = found(what)
    text = reading(path).read_text(encoding="utf-8")
    if "</html>" not in text:
        raise ValueError(f"{path} is not a complete report; run 'zwidth diagnose' again to make it")
    console.will_write()
    headline = headline_of(text) or path.stem
    size = path.stat().st_size
    console.say(headline)
    console.say(f"{path} ({size / 1e6:.2f} MB)")
    if show and not webbrowser.open(path.resolve().as_uri()):
        console.warn(f"no browser could be started; open {path} in one")
    console.result({"report": str(path), "headline": headline, "bytes": size})


def headline_of(text: str) -> str | None:
    """Return the headline of a report, its title; None without one."""
    title = HEADLINE.search(text)
    return unescape(title[1]) if title else None


def found(what: Path) -> Path:
    """Return the path of the report; raises ValueError if there is none."""
    if what.name.endswith(ENDINGS) and what.is_file():
        return what
    if what.is_dir():
        reports = [file for ending in ENDINGS for file in what.glob(f"*{ending}")]
        if reports:
            return max(reports, key=lambda file: file.stat().st_mtime)
        raise ValueError(
            f"there is no report in {what}; 'zwidth diagnose RECORDING --out {what}' writes one"
        )
    stem = what.name.partition(".")[0]
    for folder in (Path("runs"), what.parent):
        for ending in ENDINGS:
            if (file := folder / f"{stem}{ending}").is_file():
                return file
    raise ValueError(
        f"{what} is not a report, and runs/ has none for it; give NAME.diagnosis.html, a folder of"
        " them, or the recording that was diagnosed"
    )
