"""Updates on a growing log for people: a line for each, and a live table on a terminal."""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from zwidth.console import Console
from zwidth.watch.updates import FINAL, GATE, NOTE, QUICK, SEARCHED, Update

if TYPE_CHECKING:
    from rich.table import Table

WORDS = {
    GATE: "recording",
    NOTE: "note",
    QUICK: "quick fit",
    SEARCHED: "searched",
    FINAL: "answer",
}


@contextmanager
def shown(console: Console, name: str) -> Generator[Callable[[Update], None]]:
    """Yield a function that shows updates: a live table on a terminal, else a line for each."""
    if not console.stream.isatty():
        yield lambda update: print(update.line, file=console.stream, flush=True)
        return
    from rich.console import Console as Terminal
    from rich.live import Live

    terminal = Terminal(file=console.stream, markup=False, emoji=False, highlight=False)
    latest: dict[str, Update] = {}
    with Live(table(name, latest), console=terminal, refresh_per_second=4) as live:

        def take(update: Update) -> None:
            if update.kind != QUICK:  # frequent updates appear only in the table
                live.console.print(update.line, soft_wrap=True)
            latest[update.kind] = update
            live.update(table(name, latest))

        yield take


def table(name: str, latest: dict[str, Update]) -> "Table":
    """Return the last update of each kind, and the length of the log."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    last = max(latest.values(), key=lambda u: u.samples, default=None)
    far = "waiting" if last is None else f"{last.seconds:.1f} s, {last.samples} samples"
    found = Table(box=SIMPLE_HEAD, title=f"{name}: {far}", title_justify="left")
    found.add_column("")
    found.add_column("at")
    found.add_column("")
    for kind in (GATE, QUICK, SEARCHED, FINAL):
        update = latest.get(kind)
        if update is not None:
            found.add_row(WORDS[kind], f"{update.seconds:.1f} s", update.sentence)
    return found
