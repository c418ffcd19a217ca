"""Translates errors for the user of a command: a sentence and an exit status."""

import errno
import re
from enum import IntEnum

import click
from click.exceptions import NoSuchCommand


class Status(IntEnum):
    """Exit statuses of every command."""

    DONE = 0
    FAILED = 1  # a failure of machine or program; for `check` the answer "outside the band"
    BAD_INPUT = 2  # wrong input; the sentence says what to change
    BROKEN = 3  # only for `check`: what is FAILED elsewhere
    INTERRUPTED = 130  # 128 + SIGINT, as in shells
    TERMINATED = 143  # 128 + SIGTERM, which batch systems send at the end of the time


# A wrong path is an error of the input; a full disk or a missing permission is one of the machine.
PATH_ERRORS = frozenset(
    {errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.EEXIST, errno.ENAMETOOLONG, errno.ELOOP}
)
FULL = frozenset({errno.ENOSPC, errno.EDQUOT})


class CheckFailed(Exception):
    """`zwidth check` found no answer, though its input is valid; the message says why."""


def explain(error: BaseException) -> tuple[Status, str]:
    """Return the exit status and one line for any exception of a command."""
    match error:
        case KeyboardInterrupt() | click.Abort():
            return Status.INTERRUPTED, "interrupted; results finished before, if any, are kept"
        case CheckFailed():
            return Status.BROKEN, one_line(str(error))
        case click.UsageError():
            return Status.BAD_INPUT, _usage(error)
        case click.ClickException():
            return Status.FAILED, one_line(error.format_message())
        case OSError(errno=int()):
            status = Status.BAD_INPUT if error.errno in PATH_ERRORS else Status.FAILED
            return status, _operating_system(error)
        case ValueError():
            return Status.BAD_INPUT, one_line(str(error))
        case MemoryError():
            return Status.FAILED, "out of memory; ask for fewer runs at once or shorter ones"
        case _:
            kind = type(error).__name__
            return Status.FAILED, (
                f"internal error, {kind}: {one_line(str(error))}"
                " (set ZWIDTH_DEBUG=1 to see where, and report it)"
            )


def one_line(text: str) -> str:
    """Return sentences as one line that ends without a period, with one between any two.

    Texts of libraries may end in a period; joined with ours, this gave "..", "?." and ".;".
    """
    line = re.sub(r"(?<=[\w)\]'?])\.\.(?=\s|$)", ".", " ".join(text.split()))
    return re.sub(r"(?<=[\w)\]'])\.;", ";", line).rstrip(".")


def _usage(error: click.UsageError) -> str:
    hint = ""
    sentence = one_line(error.format_message())
    if isinstance(error, click.NoSuchOption | NoSuchCommand) and error.possibilities:
        sentence = one_line(error.message)
        hint = f"; did you mean {error.possibilities[0]!r}?"
    elif error.ctx is not None and not isinstance(error, click.BadParameter):
        hint = f"; see '{error.ctx.command_path} --help'"
    return f"{sentence[:1].lower()}{sentence[1:]}{hint}"


def _operating_system(error: OSError) -> str:
    reason = one_line(error.strerror or str(error))
    if error.filename is None:
        return reason
    if error.errno in FULL:
        reason += "; what is finished is kept, make room and give the same command again"
    return f"{error.filename}: {reason}"
