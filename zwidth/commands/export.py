"""`zwidth export`: a device for another simulator, and what its format cannot describe."""

from pathlib import Path
from typing import Any

import click

from zwidth.console import Console
from zwidth.export.bam import bam
from zwidth.export.c_source import c_source, identifier
from zwidth.export.cost import cost_of
from zwidth.export.draws import FORMATS as WITH_FIELDS
from zwidth.export.draws import (
    SUFFIXES,
    as_csv,
    as_json,
    as_npz,
    draws_of,
    independent_sentence,
)
from zwidth.export.fmu import fmu
from zwidth.export.isaac_lab import isaac_lab
from zwidth.export.mjcf import mjcf
from zwidth.export.model import Exported
from zwidth.export.newton import newton
from zwidth.export.robots import sdf, urdf
from zwidth.files.whole import json_text, write_bytes, write_text
from zwidth.options import Quantity, device_argument, force_option, json_option
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device, remarks_on

NAMES = {"isaaclab": "Isaac Lab", "newton": "Newton"}
FORMATS = ("c", "fmu", "mjcf", "urdf", "sdf", "isaaclab", "newton", "bam")


@click.command("export")
@device_argument()
@click.option("--to", type=click.Choice(FORMATS), required=True, help="The format.")
@click.option("out", "-o", "--out", "--save", metavar="FILE", required=True,
              type=click.Path(dir_okay=False, path_type=Path),
              help="The file to write.")  # fmt: skip
@click.option("--name", help="Prefix of the names in the file. Default: the name of FILE.")
@click.option("--seconds", type=Quantity("s", 0.1), default=2.0, show_default=True,
              help="Length of the run in which the error is measured.")  # fmt: skip
@click.option("--seed", type=click.IntRange(0, 2**64 - 1), default=0, show_default=True,
              help="Seed of random events (lost samples) and of --randomise.")  # fmt: skip
@click.option("--randomise", type=click.IntRange(1, 100_000), metavar="N",
              help="Also write N random sets of the parameters in FILE, drawn from their"
              " uncertainty, for domain randomisation in training.")  # fmt: skip
@click.option("draws_file", "--draws", metavar="FILE", type=click.Path(dir_okay=False,
              path_type=Path), help="File for the sets of --randomise: .json, .npz or .csv."
              " Default: FILE with the ending .draws.json.")  # fmt: skip
@force_option
@json_option
def command(
    device: str,
    to: str,
    out: Path,
    name: str | None,
    seconds: float,
    seed: int,
    randomise: int | None,
    draws_file: Path | None,
    json_file: str | None,
) -> None:
    """Write a device in another simulator's format, and list the parts that are lost.

    DEVICE is a shipped device or a device file.

    \b
    c     C99 without dependencies: NAME_reset, NAME_read, NAME_step
    fmu   FMI 3.0 for co-simulation, with parameters that may be set; needs fmpy
    mjcf  MuJoCo
    urdf  one body on a joint with damping and dry friction
    sdf   the same, and springs
    isaaclab  a DelayedPDActuatorCfg of Isaac Lab, as Python
    newton    a body, a joint and a NewtonActuator, as USD
    bam       a JSON of Better Actuator Models, m1, m2 or m5

    The parts that are lost are printed, and written at the top of FILE. If this machine can run
    FILE, DEVICE and FILE are simulated under the same command, and the rms error between them is
    printed.
    """  # noqa: D301 (\b is click's mark of lines to be kept)
    console = Console(json_file)
    given = load_device(device)
    if randomise is not None and to not in WITH_FIELDS:
        raise click.BadParameter(
            f"{to} has masses and springs worked into its constants, so none of them can be drawn;"
            f" --randomise can be used with --to {', '.join(WITH_FIELDS)}",
            param_hint="--randomise",
        )
    drawn = draws_file or out.with_suffix(".draws.json")
    if draws_file is not None and randomise is None:
        raise click.BadParameter("there is nothing to write without --randomise N; add it",
                                 param_hint="--draws")  # fmt: skip
    if drawn.suffix.lower() not in SUFFIXES:
        raise click.BadParameter(
            f"{drawn} ends in {drawn.suffix or 'nothing'}; it must end in one of"
            f" {', '.join(SUFFIXES)}",
            param_hint="--draws",
        )
    console.will_write(out, *([] if randomise is None else [drawn]))
    for remark in remarks_on(given):
        console.warn(remark)
    called = identifier(name or out.stem)
    made = exported(given, to, called, seed)
    cost = cost_of(made, given, to, called, seconds, seed)
    written = write_bytes(out, made.content(cost.said))
    for sentence in made.lost:
        console.say(sentence)
    if not made.lost:
        what = "The C code" if to == "c" else f"The {NAMES.get(to, to.upper())} file"
        console.say(f"{what} contains everything of {given.name}")
    console.say(cost.said)
    console.say(f"wrote {written}")
    if randomise is not None:
        if given.posterior is None:
            console.warn(independent_sentence(given))
        draws = draws_of(given, randomise, seed)
        told = as_json(given, draws, lambda one: exported(one, to, called, seed), to, seed)
        console.say(f"wrote {_write(drawn, told)}")
    console.result({
        "device": given.name, "to": to, "file": str(out), "name": called, "lost": list(made.lost),
        "error_over_motion": cost.share, "cost": cost.said,
        "draws": None if randomise is None else str(drawn),
    })  # fmt: skip


def _write(path: Path, draws: dict[str, Any]) -> Path:
    """Write draws in the format of a file's name."""
    match path.suffix.lower():
        case ".npz":
            return write_bytes(path, as_npz(draws))
        case ".csv":
            return write_text(path, as_csv(draws))
        case _:
            return write_text(path, json_text(draws))


def exported(device: Device, to: str, name: str, seed: int) -> Exported:
    """Return a device in a format."""
    match to:
        case "c":
            return c_source(device, name, seed)
        case "fmu":
            return fmu(device, name, seed)
        case "mjcf":
            return mjcf(device, name)
        case "urdf":
            return urdf(device, name)
        case "isaaclab":
            return isaac_lab(device, name)
        case "newton":
            return newton(device, name)
        case "bam":
            return bam(device, name)
        case _:
            return sdf(device, name)
