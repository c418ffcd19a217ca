"""`zwidth diagnose`: why a recording differs from the simulation of a device."""

from collections.abc import Sequence
from pathlib import Path

import click

from zwidth.diagnosis.selection.effort import EFFORTS
from zwidth.options import cluster_option, force_option, json_option, out_option, typed_line


@click.command("diagnose")
@click.argument(
    "recordings",
    metavar="RECORDING...",
    nargs=-1,
    required=True,
    type=click.Path(path_type=Path),
)
@click.option(
    "--device", "name", metavar="DEVICE",
    help="Device file or name; without it one is fitted: one to three masses, as the data ask.",
)  # fmt: skip
@click.option(
    "--validate",
    metavar="RECORDING",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Judge by this recording; without it by the last 30 % of each.",
)
@click.option(
    "--effort",
    type=click.Choice(list(EFFORTS)),
    default="normal",
    show_default=True,
    help="How much to try: quick looks for three effects at most, for no play and for no law of no"
    " name over two states.",
)
@click.option(
    "--wall/--no-wall",
    default=None,
    help="Say what becomes of the stiffest wall, or not; else where a --device may render one.",
)
@click.option(
    "--known-torque", "model", metavar="MODEL", type=click.Path(path_type=Path),
    help="MJCF or URDF of the robot: what its arms do to --joint in the recorded posture is known.",
)  # fmt: skip
@click.option("--joint", metavar="INDEX|NAME",
              help="The joint to take of a recording with several, or of MODEL.")  # fmt: skip
@click.option("--processes", type=click.IntRange(1), help="Of a fleet: processes side by side.")
@cluster_option
@out_option("runs")
@force_option
@json_option
def command(
    recordings: tuple[Path, ...],
    name: str | None,
    validate: tuple[Path, ...],
    effort: str,
    wall: bool | None,
    model: Path | None,
    joint: str | None,
    processes: int | None,
    cluster: str | None,
    out: Path,
    json_file: str | None,
) -> None:
    """Say why recordings differ from the simulation of a device, and what physics is missing.

    RECORDING is any file that 'zwidth convert' reads: a CSV, MAT, HDF5, NPY or MCAP of another
    tool, a recording TOML, or a log that zwidth wrote; several are diagnosed together. What a file
    of another tool is taken for is said, and written as NAME.recording.toml; a device that is not
    given is fitted, and written as NAME.device.toml. Edit either and give the same line again.

    Writes NAME.diagnosis.html, the report; NAME.augmented.toml, the device with what was found,
    which every command takes; NAME.diagnosis.mcap, residual, missing force and predictions, which
    opens beside the recording; and NAME.next.toml, what to record where rivals are left. Ctrl-C
    ends the search and judges what was found until then.

    A folder of recordings, or a table of them (CSV or TOML: recording, device, date, known values),
    is a fleet: what is shared, what differs from device to device, what changed and when, and which
    recordings are unlike the others and why. Writes NAME.fleet.html (docs/fleets.md).
    """
    # What a diagnosis needs takes seconds to load, and help and a mistyped option need none of it.
    from zwidth.console import Console
    from zwidth.fleet.listing import is_fleet

    console = Console(json_file)
    if any(is_fleet(path) for path in recordings):
        _refuse_beside_a_fleet(recordings, validate, wall, model)
        from zwidth.fleet_door import diagnose_recordings
        from zwidth.sim.device_file import load_device

        device = None if name is None else load_device(name)
        line = typed_line(click.get_current_context())
        (path,) = recordings
        diagnose_recordings(console, path, device, effort, out, processes, cluster, line)
        return
    if processes is not None or cluster is not None:
        raise ValueError(
            "--processes and --cluster are for a fleet, a folder or a table of recordings; leave"
            " them out, or give one"
        )
    from zwidth.diagnose_files import diagnose_files

    line = typed_line(click.get_current_context())
    robot = (model, joint)
    diagnose_files(console, recordings, name, validate, effort, wall, out, line, robot)


def _refuse_beside_a_fleet(
    recordings: Sequence[Path], validate: Sequence[Path], wall: bool | None, model: Path | None
) -> None:
    """Raise ValueError for what has no use where a fleet is diagnosed."""
    if len(recordings) > 1:
        raise ValueError(
            f"{len(recordings)} are given and one of them is a fleet; give the folder or the table"
            " of recordings alone, or recordings only"
        )
    if validate or wall is not None or model is not None:
        option = "--validate" if validate else "--known-torque" if wall is None else "--wall"
        raise ValueError(f"{option} has no use with a fleet; leave it out")
