"""`zwidth watch`: a diagnosis of a log that is still being written."""

import json
import math
import shlex
import signal
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event, current_thread, main_thread
from typing import Any

import click

from zwidth.console import Console
from zwidth.diagnose_files import RESULTS, diagnose_files
from zwidth.diagnosis.selection.effort import EFFORTS
from zwidth.files import protection
from zwidth.files.whole import write_bytes, write_text
from zwidth.heartbeat import HEART
from zwidth.logs.recording_file import Description, load_description
from zwidth.options import Quantity, force_option, json_option, out_option, typed_line
from zwidth.sim.device_file import load_device
from zwidth.watch.display import shown
from zwidth.watch.growing import Growing, of_file, of_stream
from zwidth.watch.state import Read
from zwidth.watch.updates import FINAL, Update
from zwidth.watch.watching import Asked, Tell, follow
from zwidth.watch.worker import Worker

STREAM, UNFINISHED = "-", ".partial"
GIVES_WAY = 5  # niceness of searches, which give way to checks and to the log's writer


@click.command("watch")
@click.argument("log", metavar="FILE|-", type=click.Path(path_type=Path, allow_dash=True))
@click.option(
    "--device", "name", metavar="DEVICE",
    help="Device file or the name of a shipped device. Without it, a device with one to three"
    " masses is fitted to the recording.",
)  # fmt: skip
@click.option(
    "--idle", type=Quantity("s", above=True),
    help="Stop after this many seconds without new data. Default: at the end of the source, or"
    " at Ctrl-C.",
)  # fmt: skip
@click.option(
    "--damping", type=Quantity("N m s/rad | N s/m"), default=0.0, show_default=True,
    help="Damping of the wall whose largest stable stiffness is shown.",
)  # fmt: skip
@click.option(
    "--wall/--no-wall",
    default=None,
    help="Show the stiffest stable wall. Default: only for a device that can render one.",
)
@click.option(
    "--effort",
    type=click.Choice(list(EFFORTS)),
    default="normal",
    show_default=True,
    help="Effort of the final diagnosis; searches before it are always quick.",
)
@out_option("runs")
@force_option
@json_option
def command(
    log: Path,
    name: str | None,
    idle: float | None,
    damping: float,
    wall: bool | None,
    effort: str,
    out: Path,
    json_file: str | None,
) -> None:
    """Diagnose a log while it is being written.

    FILE is a text table or an MCAP log that another program is writing, or a recording TOML that
    describes one. With -, standard input is read, and kept as DIR/stdin.csv or .mcap.

    While data come in, it reports faults of the recording, a quick fit every few seconds (does the
    physics found so far explain the latest samples?), and the result of a new search each time the
    amount of data has doubled.

    At the end of the source, or after --idle, it diagnoses the whole recording and writes the same
    files as 'zwidth diagnose FILE'. Ctrl-C stops without this last step. --json writes each line
    as JSON.
    """
    console = Console(json_file)
    device = None if name is None else load_device(name)
    description, data = _described(log)
    line = typed_line(click.get_current_context())
    with TemporaryDirectory(prefix="zwidth-watch-") as folder:
        is_stream = str(log) == STREAM
        why = protection.INPUT if data == log else f"is what {log.name} describes"
        source = of_stream(sys.stdin.buffer) if is_stream else of_file(data, why)
        growing = Growing(source, "stdin" if is_stream else data.name, Path(folder))
        if not is_stream:
            with _as_diagnose():
                protection.check(*(out / f"{log.stem}.{ending}" for ending in RESULTS))
        console.will_write()
        lines = _Lines(console)
        asked = Asked(growing, description, log.stem if not is_stream else "stdin", device,
                      damping, wall, idle)  # fmt: skip
        with HEART.held(), shown(console, log.name if not is_stream else "standard input") as show:

            def tell(update: Update) -> None:
                show(update)
                lines.add(update)

            found = _followed(asked, tell)
        final = _finished(console, log, growing, out)
    if found is None:
        words = ["zwidth", "diagnose", str(final), *(["--device", name] if name else [])]
        more = f"; '{shlex.join(words)}' has the whole answer"
        console.say("ended" if final is None else f"ended{more}")
        return
    if final is None:
        raise ValueError("the input ended without a sample, so there is nothing to diagnose")
    answer = _answer(_Answer(console), final, name, effort, wall, out, line)
    said = str(answer.get("headline") or answer["sentence"])
    last = Update(FINAL, found.seconds, found.samples, said, {"diagnosis": answer})
    lines.add(last)


def _described(log: Path) -> tuple[Description | None, Path]:
    """The description of a recording TOML, and the file that grows."""
    if log.suffix.lower() != ".toml":
        return None, log
    description = load_description(log)
    return description, log.parent / description.file


def _followed(asked: Asked, tell: Tell) -> Read | None:
    """Follow the log to its end, and return what it held; None where Ctrl-C stopped it."""
    workers: list[Worker] = []
    try:
        with _halting() as halted:
            workers += [Worker(), Worker(nice=GIVES_WAY)]
            return follow(asked, tell, (workers[0], workers[1]), halted)
    except KeyboardInterrupt:
        return None
    finally:
        for worker in workers:
            worker.close()


@contextmanager
def _halting() -> Generator[Callable[[], bool]]:
    """Yield a function that says whether Ctrl-C or SIGTERM came; each still interrupts."""
    came = Event()

    def interrupted(*_: object) -> None:
        came.set()
        raise KeyboardInterrupt

    if current_thread() is not main_thread():  # signals reach only the main thread
        yield came.is_set
        return
    before = {s: signal.signal(s, interrupted) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield came.is_set
    finally:
        for ends, handler in before.items():
            signal.signal(ends, handler)


def _finished(console: Console, log: Path, growing: Growing, out: Path) -> Path | None:
    """The file that is finished: what came in by a pipe is kept under a name that is free."""
    if str(log) != STREAM:
        whole = log.with_name(log.name.replace(UNFINISHED, ""))
        return whole if not log.exists() and whole.exists() else log
    if not growing.bytes and not growing.rest():
        return None
    content = (growing.spool.read_bytes() if growing.bytes else b"") + growing.rest()
    ending = "mcap" if growing.is_mcap else "csv"
    place, number = out / f"stdin.{ending}", 2
    while place.exists():  # earlier measurements are not overwritten
        place, number = out / f"stdin-{number}.{ending}", number + 1
    console.say(f"wrote {write_bytes(place, content)}")
    return place


@dataclass(frozen=True)
class _Answer(Console):
    """A console that keeps the result of a diagnosis, and leaves the stream where it goes."""

    kept: list[Any] = field(default_factory=list[Any])

    def __init__(self, console: Console) -> None:
        object.__setattr__(self, "json", console.json)
        object.__setattr__(self, "kept", [])

    def will_write(self, *files: Path) -> None:
        """Refuse what may not be written; the JSON is not of the diagnosis."""
        protection.check(*files)

    def keep(self, value: Any) -> None:
        """Keep a result that is still to grow."""
        self.kept[:] = [value]

    def result(self, value: Any) -> None:
        """Keep the result."""
        self.kept[:] = [value]


def _answer(
    console: _Answer,
    log: Path,
    name: str | None,
    effort: str,
    wall: bool | None,
    out: Path,
    line: str,
) -> dict[str, Any]:
    """Diagnose the finished log as `zwidth diagnose` does, and return its JSON."""
    with _as_diagnose(), suppress(KeyboardInterrupt):  # then the results so far are reported
        diagnose_files(console, (log,), name, (), effort, wall, out, line)
    if not console.kept:
        raise KeyboardInterrupt
    (answer,) = console.kept
    return answer


@contextmanager
def _as_diagnose() -> Generator[None]:
    """Write as `zwidth diagnose`, whose files they are: it may write over them, and this over its.

    --force of this command holds.
    """
    forced = protection.writer().overwrite
    with protection.command("zwidth diagnose"):
        if forced:
            protection.force()
        yield


class _Lines:
    """Updates as lines of JSON: to standard output, or as a file that is whole at any time."""

    def __init__(self, console: Console) -> None:
        self.console, self.every = console, list[str]()

    def add(self, update: Update) -> None:
        """Write an update."""
        place = self.console.json
        if place is None:
            return
        text = json.dumps(_finite(update.as_json()), allow_nan=False, ensure_ascii=False) + "\n"
        if place == STREAM:
            print(text, end="", flush=True)
            return
        path = Path(place)
        if path.exists() and not path.is_file():  # a pipe gets each line only once
            write_text(path, text)
            return
        self.every.append(text)
        write_text(path, "".join(self.every))


def _finite(value: Any) -> Any:
    """JSON types; what is not finite becomes null."""
    match value:
        case dict():
            return {k: _finite(v) for k, v in value.items()}
        case list() | tuple():
            return [_finite(v) for v in value]
        case float() if not math.isfinite(value):
            return None
        case _:
            return value
