"""Options that several commands share: physical quantities, lists of them, folders for results."""

import math
import re
import shlex
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from zwidth.files import protection
from zwidth.files.whole import check_folder

# A word that begins like a number counts as one: `--delay-ms 2 4x` is a wrong delay, not a device
# "4x".
LIKE_A_NUMBER = re.compile(r"[+-]?(\d|\.\d|nan\b|inf)", re.IGNORECASE)


class Quantity(click.ParamType[float]):
    """A finite number with a unit, at least `minimum`, or above it if `above` is true."""

    name = "number"

    def __init__(self, unit: str, minimum: float = 0.0, *, above: bool = False) -> None:
        self.unit = unit
        self.minimum = minimum
        self.above = above

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        """Return the help's placeholder for the number: its unit."""
        return f"<{self.unit}>"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number, or fail with what is allowed."""
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        enough = number > self.minimum if self.above else number >= self.minimum
        if not (enough and math.isfinite(number)):
            least = (
                f"a number above {self.minimum:g}" if self.above else f"{self.minimum:g} or more"
            )
            self.fail(f"{value} is not allowed; give {least} [{self.unit}].", param, ctx)
        return number


class Quantities(click.Option):
    """An option that takes one or more numbers, ``--delay-ms 2 4 8``, as a tuple.

    rising: the numbers are a grid, so each must be above the one before it; otherwise they may have
    any order, but no repeats.
    """

    def __init__(self, *args: Any, rising: bool = False, **kwargs: Any) -> None:
        super().__init__(*args, multiple=True, callback=self.check, **kwargs)
        self.rising = rising

    def check(
        self, ctx: click.Context, param: click.Parameter, value: tuple[float, ...]
    ) -> tuple[float, ...]:
        """Refuse a grid that does not rise, and a number given twice."""
        for earlier, later in pairwise(value):
            if self.rising and not later > earlier:
                message = f"{later:g} follows {earlier:g}; give the numbers in rising order."
                raise click.BadParameter(message, ctx, param)
        for number in value:
            if value.count(number) > 1:
                message = f"{number:g} is given twice; give each number once."
                raise click.BadParameter(message, ctx, param)
        return value


class ManyNumbers(click.Command):
    """A command whose `Quantities` take all the numbers that follow them, anywhere in the line."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Repeat the option before each of its numbers, as click requires."""
        flags = {
            flag for option in self.params if isinstance(option, Quantities) for flag in option.opts
        }
        return super().parse_args(ctx, spread(args, flags))


def spread(args: list[str], flags: set[str]) -> list[str]:
    """Return ``--x 1 --x 2`` for ``--x 1 2`` if ``--x`` is one of the flags."""
    result: list[str] = []
    flag, fresh = None, False  # the present list; whether click itself adds the next word to it
    for position, word in enumerate(args):
        if word == "--":
            return result + args[position:]
        if flag and not fresh and LIKE_A_NUMBER.match(word):
            result.append(flag)
        elif not fresh:
            name, equals, _ = word.partition("=")
            flag = name if name in flags else None
            fresh = flag is not None and not equals
            result.append(word)
            continue
        fresh = False
        result.append(word)
    return result


def _force(context: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        protection.force()


force_option = click.option(
    "--force", is_flag=True, expose_value=False, callback=_force,
    help="Overwrite existing files, even if this command did not write them; never its inputs.",
)  # fmt: skip

json_option = click.option(
    "--json", "json_file", metavar="FILE", help="Write the result as JSON; - for standard output."
)

cluster_option = click.option(
    "--cluster", metavar="ADDRESS",
    help="Run on a Dask cluster: tcp://host:8786, or a scheduler file (docs/scale.md).",
)  # fmt: skip


def device_argument(destination: str = "device") -> Callable[[Any], Any]:
    """Return the argument DEVICE, which may be given as ``--device DEVICE`` as well.

    This holds for every command of one device. If the arguments are recordings, there is only
    ``--device``.
    """
    key = "zwidth.named_device"

    def named(ctx: click.Context, param: click.Parameter, value: str | None) -> None:
        ctx.meta[key] = value

    def chosen(ctx: click.Context, param: click.Parameter, value: str | None) -> str:
        other = ctx.meta.get(key)
        if value is not None and other is not None:
            raise click.UsageError(
                f"the device is given twice, {value} and --device {other}; give it once", ctx
            )
        if value is None and other is None:
            raise click.UsageError(
                "the argument DEVICE is missing; give a device file, or a name that 'zwidth"
                " devices' lists",
                ctx,
            )
        return str(other if value is None else value)

    def add(command: Any) -> Any:
        command = click.option(
            "--device", "named_device", metavar="DEVICE", is_eager=True, expose_value=False,
            callback=named, help="Another way to give DEVICE.",
        )(command)  # fmt: skip
        argument = click.argument(
            destination, metavar="DEVICE", required=False, callback=chosen, default=None
        )
        return argument(command)

    return add


def out_option(default: str) -> Callable[[Any], Any]:
    """Return ``--out DIR`` with the default folder of the command.

    A folder that cannot be written to is refused before anything is computed.
    """
    return click.option(
        "--out",
        metavar="DIR",
        type=click.Path(file_okay=False, path_type=Path),
        default=default,
        show_default=True,
        callback=_writable,
        help="Folder for the results; it is created if it does not exist.",
    )


def _writable(ctx: click.Context, param: click.Parameter, value: Path) -> Path:
    try:
        check_folder(value)
    except OSError as error:
        raise click.BadParameter(
            f"{value} cannot be written to ({error.strerror}); give a folder that is writable.",
            ctx,
            param,
        ) from None
    return value


def typed_line(context: click.Context) -> str:
    """Return the complete command line of this call: with its folder and every option given.

    It can be copied to any terminal; omitted options have their defaults again.
    """
    words = ["zwidth", context.info_name or ""]
    for parameter in context.command.params:
        name = parameter.name or ""
        value: Any = context.params.get(name)
        if isinstance(parameter, click.Argument):
            words += map(str, value if parameter.nargs == -1 else [value])
            continue
        if context.get_parameter_source(name) != ParameterSource.COMMANDLINE:
            continue
        flag = max(parameter.opts, key=len)
        if isinstance(parameter, click.Option) and parameter.is_flag:
            words.append(flag if value in (True, None) else max(parameter.secondary_opts, key=len))
        else:
            for one in value if parameter.multiple else [value]:
                words += [flag, *map(str, one if isinstance(one, tuple) else [one])]
    return in_this_folder(*words)


def in_this_folder(*words: str) -> str:
    """Return a line to type anywhere: it first changes to the folder of its relative paths."""
    return f"cd {shlex.quote(str(Path.cwd()))} && {shlex.join(words)}"
