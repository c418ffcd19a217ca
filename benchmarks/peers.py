"""`zwidth diagnose` beside PySINDy, SysIdentPy and MuJoCo's system identification, in one table.

    python -m benchmarks.peers RECORDINGS
    python -m benchmarks.peers RECORDINGS --only emps --only-peer pysindy
    python -m benchmarks.peers --draw

RECORDINGS: the folder that has the published files, a folder a set; they are not ours to pass on.
Every method is fitted to the same part and judged by the same free run over what is held out
(`benchmarks/peer`). Rows are kept in runs/peers, where a row that is computed again takes the place
of the old one; --draw writes peers.md and peers.png in benchmarks/notes from what is kept and
computes nothing. The other methods are installed with `pip install 'zwidth[peers]'`.
"""

import argparse
import importlib
import os
import resource
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command does: cores go to simulations

from benchmarks.command import between_marks, ended
from benchmarks.peer import by_mujoco, by_pysindy, by_sysidentpy, by_zwidth
from benchmarks.peer.method import Foretold
from benchmarks.peer.page import figure, found, not_computed, table
from benchmarks.peer.rows import Row, keep, keep_run, kept, kept_run, row_of
from benchmarks.peer.sets import KINDS, Floats, Set, judged, read
from zwidth.files.protection import writing_as
from zwidth.files.whole import write_text, write_with

NOTES = Path(__file__).parent / "notes"
RESULTS = Path(__file__).parents[1] / "runs" / "peers"
MEASURED = "measured"


@dataclass(frozen=True)
class Form:
    """A method as it stands in the table: how it foretells, and what a user had to know, by set.

    comes_along: what the answer gives beside it, which needs no more to be known.
    """

    method: str
    foretold: Callable[[Set], Foretold]
    known: Mapping[str, str]
    comes_along: tuple[str, ...] = ()


@dataclass(frozen=True)
class Peer:
    """A program, in one form or more. needs: modules and what they must have, to be of use."""

    forms: tuple[Form, ...]
    needs: tuple[tuple[str, str], ...] = ()


COMES_ALONG = (by_zwidth.LAW, by_zwidth.LINEAR)
PEERS = {
    "zwidth": Peer((Form("zwidth diagnose", by_zwidth.foretold, by_zwidth.KNOWN, COMES_ALONG),)),
    "pysindy": Peer(
        (
            Form("PySINDy", by_pysindy.foretold, by_pysindy.KNOWN),
            Form(by_pysindy.TOLD, by_pysindy.told, by_pysindy.KNOWN_TOLD),
        ),
        (("pysindy", "ConstrainedSR3"),),
    ),
    "sysidentpy": Peer(
        (
            Form("SysIdentPy", by_sysidentpy.foretold, by_sysidentpy.KNOWN),
            Form(by_sysidentpy.TOLD, by_sysidentpy.told, by_sysidentpy.KNOWN_TOLD),
        ),
        (("sysidentpy.model_structure_selection", "FROLS"),),
    ),
    "mujoco": Peer(
        (Form("MuJoCo sysid", by_mujoco.foretold, by_mujoco.KNOWN),),
        (("mujoco.sysid", "optimize"),),
    ),
}
KNOWN = {
    (name, method): said
    for peer in PEERS.values()
    for form in peer.forms
    for method in (form.method, *form.comes_along)
    for name, said in form.known.items()
}
ORDER = (
    "zwidth diagnose", by_zwidth.LAW, "MuJoCo sysid", "PySINDy", "SysIdentPy", by_pysindy.TOLD,
    by_sysidentpy.TOLD, by_zwidth.LINEAR,
)  # fmt: skip


class Missing(ValueError):
    """Peers that are not installed."""


def refuse_missing(names: list[str]) -> None:
    """Raise Missing, with what to install, unless all peers of these names can be imported."""
    lacking: list[str] = []
    for name in names:
        for module, attribute in PEERS[name].needs:
            try:
                there = hasattr(importlib.import_module(module), attribute)
            except ImportError:
                there = False
            lacking += [] if there else [PEERS[name].forms[0].method]
    if lacking:
        raise Missing(
            f"{' and '.join(lacking)} cannot be imported as needed; install them with"
            " pip install 'zwidth[peers]', or name those that are there with --only-peer"
        )


def cpu_seconds() -> float:
    """CPU time of this process with its threads, and of its children [s]."""
    used = [resource.getrusage(w) for w in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


def computed(s: Set, name: str) -> list[Row]:
    """Fit every form of a method to a set, keep the free runs and return the rows."""
    rows: list[Row] = []

    def add(method: str, run: Floats, seconds: float | None, what: str) -> None:
        keep_run(RESULTS, f"{s.kind.name}.{method}", run)
        error = judged(s.held.measured, run)
        rows.append(
            row_of(error, set=s.kind.name, peer=name, method=method, units=s.units,
                   seconds=seconds, found=what)
        )  # fmt: skip

    for form in PEERS[name].forms:
        if s.kind.name not in form.known:  # it makes sense on others alone
            continue
        if name == "zwidth":
            by_zwidth.warm_up(s)
        begun = cpu_seconds()
        answer = form.foretold(s)
        add(form.method, answer.held, cpu_seconds() - begun, answer.found)
        for method, run in answer.also.items():
            add(method, run, None, "")
    return rows


def compute(recordings: Path, sets: list[str], peers: list[str]) -> None:
    """Compute and keep the rows that were asked for."""
    refuse_missing(peers)
    for name in sets:
        s = read(name, recordings)
        keep_run(RESULTS, f"{name}.{MEASURED}", s.held.measured)
        for peer in peers:
            rows = computed(s, peer)
            keep(RESULTS, rows)
            for row in rows:
                said = [f"{r:.4g} {u}" if r is not None else "diverges"
                        for r, u in zip(row.rms, row.units, strict=True)]  # fmt: skip
                print(
                    f"{name}, {row.method}: {', '.join(said)}; {row.seconds or 0.0:.1f} s",
                    flush=True,
                )


def draw() -> None:
    """Write the page's table and the picture from what is kept."""
    rows = kept(RESULTS)
    if not rows:
        raise ValueError(
            f"nothing is kept in {RESULTS}; compute first, with the recordings' folder"
        )
    page = NOTES / "peers.md"
    # A law is learned on some sets alone.
    expected = {key: said for key, said in KNOWN.items() if key[1] != by_zwidth.LAW}
    made = table(rows, ORDER, KNOWN) + "\n" + not_computed(rows, expected) + found(rows, ORDER)
    measured = {row.set: kept_run(RESULTS, f"{row.set}.{MEASURED}") for row in rows}
    runs = {(r.set, r.method): kept_run(RESULTS, f"{r.set}.{r.method}") for r in rows}
    periods = {name: KINDS[name].period for name in measured}
    picture = figure(rows, ORDER, measured, runs, periods)
    text = between_marks(page.read_text(encoding="utf-8"), made, "benchmarks/peers.py")
    with writing_as("peers", overwrite=True):
        write_text(page, text)
        write_with(
            NOTES / "peers.png", lambda file: picture.savefig(file, format="png", dpi=130)
        )  # fmt: skip


def main() -> int:
    """Compute what was asked for, and print the table; 2 where that cannot be."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("recordings", type=Path, nargs="?", help="folder of the published files")
    options.add_argument("--only", choices=list(KINDS), action="append", help="this set")
    options.add_argument("--only-peer", choices=list(PEERS), action="append", help="this method")
    options.add_argument("--draw", action="store_true", help="write the page from what is kept")
    asked = options.parse_args()
    if asked.recordings is None and not asked.draw:
        options.error("name the folder of RECORDINGS, or say --draw")

    def work() -> None:
        if asked.recordings is not None:
            compute(asked.recordings, asked.only or list(KINDS), asked.only_peer or list(PEERS))
            print(table(kept(RESULTS), ORDER, KNOWN))
        if asked.draw:
            draw()

    return ended(work)


if __name__ == "__main__":
    sys.exit(main())
