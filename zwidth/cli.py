"""The command `zwidth`: loads the requested command, and turns every error into one sentence."""

import os
import signal
import sys
import warnings
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from threading import Event, current_thread, main_thread
from typing import Any, NoReturn, TextIO

import click

from zwidth.console import wrapped
from zwidth.errors import Status, explain, one_line
from zwidth.files import protection
from zwidth.heartbeat import HEART
from zwidth.sim.own_files import own_files, own_texts

# Matrices are small here, so threads of the linear algebra library only slow down zwidth's own. The
# library reads this when numpy is first imported, which happens later.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# name -> its line in the help. A command is the object `command` in zwidth/commands/NAME.py and is
# imported when it is called, so that help does not wait for numpy, numba and matplotlib.
COMMANDS = {
    "diagnose": "Compare recordings of a device with its simulation, and find the missing physics.",
    "check": "Check whether a device file still describes its machine, for automatic builds.",
    "report": "Find the report of a diagnosis, and open it with --open.",
    "watch": "Diagnose a log while it is being written.",
    "convert": "Show what a recorded file contains, draft its description, or convert it.",
    "identify": "Fit a device to a recording of its command and position.",
    "plan": "Predict which effects a recording would show, before you make it.",
    "boundary": "Find the stability boundary of a device under a sampled virtual wall.",
    "map": "Map the outcome of runs over two quantities, with the linear boundary drawn over it.",
    "sweep": "Find the value of an interface setting that gives a device the largest Z-width.",
    "explore": "Explore the K-B plane of a device in the browser.",
    "relay": (
        "Find K_CR and the ultimate frequency by a relay, as the paper did on the real device."
    ),
    "simulate": "Run the experiment that a TOML file describes.",
    "replay": (
        "Simulate a logged run again, from the log alone, and compare every value bit for bit."
    ),
    "devices": "List the devices that come with zwidth, or describe one.",
    "export": "Write a device in another simulator's format, and list the parts that are lost.",
    "effects": "List the effects that zwidth knows, or describe one.",
    "conceal": "Make simulated recordings with concealed physics, to test a diagnosis.",
    "exam": "Diagnose recordings with concealed physics and score the answers.",
    "mcp": ("Serve diagnose, check, plan and boundary to agents, by the Model Context Protocol."),
    "paper": (
        "Recompute the figures and tables of the paper on virtual walls, beside the published ones."
    ),
}

# name -> a line that runs in a clone, in this order: later lines use the files of earlier ones.
EXAMPLES = {
    "diagnose": "zwidth diagnose docs/sample/bench.csv",
    "check": "zwidth check runs/bench.augmented.toml docs/sample/bench.csv",
    "report": "zwidth report docs/sample/bench.csv",
    "watch": "zwidth watch docs/sample/bench.csv --idle 5",
    "convert": "zwidth convert docs/sample/bench.csv",
    "plan": "zwidth plan phantom_1_0 --noise 1e-5 --excitation chirp --seconds 10",
    "boundary": "zwidth boundary phantom_1_0 --delay-ms 2 4 8",
    "map": "zwidth map phantom_1_0 --encoder-step 1e-4",
    "sweep": "zwidth sweep phantom_1_0 --encoder-step 1e-4",
    "explore": "zwidth explore phantom_1_0",
    "relay": "zwidth relay phantom_1_0 --delay-ms 2 --damping 0.02",
    "simulate": "zwidth simulate runs/plan/chirp.toml",
    "replay": "zwidth replay runs/chirp.mcap",
    "identify": "zwidth identify runs/chirp.mcap --delay-ms 2",
    "devices": "zwidth devices phantom_1_0 --out mine.toml",
    "export": "zwidth export phantom_1_0 --to c --out phantom.c",
    "effects": "zwidth effects backlash",
    "conceal": "zwidth conceal --strata single_5x=1 --seconds 8",
    "exam": "zwidth exam runs/exam --strata none=1,single_5x=1",
    "mcp": "zwidth mcp",
    "paper": "zwidth paper --section modes",
}
# name -> the command whose example writes the input of its own example.
FIRST = {
    "check": "diagnose",
    "report": "diagnose",
    "simulate": "plan",
    "replay": "simulate",
    "identify": "simulate",
}
HELP = frozenset(("-h", "--help", "--version"))


class CommandsByName(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the commands in the order of their usual use."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command, or return None if there is none with this name."""
        if cmd_name not in COMMANDS:
            return None
        own_effects_finite()
        command = import_module(f"zwidth.commands.{cmd_name}").command
        assert isinstance(command, click.Command)
        example = f"\b\nExample:\n  {EXAMPLES[cmd_name]}"
        if cmd_name in FIRST:
            example += f"\nRun `zwidth {FIRST[cmd_name]}` first, as its own --help shows."
        if example not in (command.epilog or ""):
            command.epilog = "\n\n".join(filter(None, (command.epilog, example)))
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command, or name the nearest ones."""
        try:
            return super().resolve_command(ctx, args)
        except click.exceptions.NoSuchCommand as error:
            raise click.exceptions.NoSuchCommand(
                error.command_name, possibilities=COMMANDS, ctx=ctx
            ) from None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """List the commands without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.command(
    cls=CommandsByName,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="\b\nBegin with this line, in a clone of the repository:\n"
    "  zwidth diagnose docs/sample/bench.csv\n\n"
    "A command overwrites its own earlier results unless they were edited, other files only with"
    " --force, and its inputs never."
    " Exit status: 0 done, 1 failed, 2 bad input, 130 interrupted with Ctrl-C, 143 with SIGTERM.",
)
@click.version_option(package_name="zwidth", message="%(prog)s %(version)s")
@click.pass_context
def zwidth(context: click.Context) -> None:
    """Say why a recording differs from its simulation, and how stiff a wall a device can render."""
    own_effects_readable()
    context.with_resource(protection.command(f"zwidth {context.invoked_subcommand}"))


def own_effects_finite() -> None:
    """Raise ValueError for a user's formula that would make the import fail."""
    if texts := own_texts():
        from zwidth.files.formulas import refuse_endless_file

        for file, text in texts:
            refuse_endless_file(file, text or b"")


def own_effects_readable() -> None:
    """Raise ValueError for an invalid file of a user's own effect."""
    if not own_files():
        return  # and nothing more is imported
    from zwidth.sim.physics import WRONG_FILES

    if WRONG_FILES:
        raise ValueError("; ".join(WRONG_FILES))


def run(arguments: Sequence[str] | None = None) -> int:
    """Run a command line and return its exit status; `None` uses the arguments of this process.

    Any error is one line on standard error. With ZWIDTH_DEBUG=1 in the environment the exception
    propagates instead.
    """
    warnings.showwarning = _one_line_warning
    with _terminable() as terminated:
        status = _run(arguments)
    if terminated() and status == Status.INTERRUPTED:
        return Status.TERMINATED
    return status


@contextmanager
def _terminable() -> Generator[Callable[[], bool]]:
    """Have SIGTERM do what Ctrl-C does, and yield what says whether it came.

    A batch system sends it some time before it kills; what was found until then is worth having.
    """
    came = Event()

    def interrupted(*_: object) -> None:
        came.set()
        raise KeyboardInterrupt

    if current_thread() is not main_thread() or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield came.is_set  # signals reach only the main thread; existing handlers are kept
        return
    signal.signal(signal.SIGTERM, interrupted)
    try:
        yield came.is_set
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _run(arguments: Sequence[str] | None) -> int:
    try:
        status = zwidth.main(arguments, prog_name="zwidth", standalone_mode=False)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader of the output has ended, as in `zwidth devices | head -1`
        _silence(sys.stdout)
        return Status.FAILED
    except click.exceptions.NoArgsIsHelpError as error:
        print(error.format_message(), file=sys.stderr)
        return Status.BAD_INPUT
    except (Exception, KeyboardInterrupt) as error:
        if os.environ.get("ZWIDTH_DEBUG") == "1":
            raise
        status, sentence = explain(error)
        HEART.said()
        print(wrapped(f"error: {sentence}", sys.stderr), file=sys.stderr)
        _silence_if_broken(sys.stdout)
    return status if isinstance(status, int) else Status.DONE


def main() -> NoReturn:
    """Run the command line of this process."""
    if len(sys.argv) > 1 and HELP.isdisjoint(sys.argv[1:]):  # help is short and does no work
        HEART.start()
    try:
        status = run()
    finally:
        HEART.stop()
    sys.exit(status)


def _one_line_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    HEART.said()
    print(wrapped(f"warning: {one_line(str(message))}", sys.stderr), file=sys.stderr)


def _silence_if_broken(stream: TextIO) -> None:
    try:
        stream.flush()
    except OSError:
        _silence(stream)


def _silence(stream: TextIO) -> None:
    """Send what is still buffered nowhere, or the interpreter fails on it again at its exit."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
