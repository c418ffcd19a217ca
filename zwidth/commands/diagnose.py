"""`zwidth diagnose`: why a recording differs from the simulation of a device."""

from collections.abc import Sequence
from pathlib import Path

import click

from zwidth.diagnosis.selection.effort import EFFORTS
from zwidth.options import cluster_option, force_option, json_option, out_option, typed_line

ALL_JOINTS = "all"


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
    help="Device file or the name of a shipped device. Without it, a device with one to three"
    " masses is fitted to the recording.",
)  # fmt: skip
@click.option(
    "--validate",
    metavar="RECORDING",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Test the answer on this recording. Default: fit the first 70 % of each recording, and"
    " test on the rest.",
)
@click.option(
    "--effort",
    type=click.Choice(list(EFFORTS)),
    default="normal",
    show_default=True,
    help="How long to search. quick finds at most three effects; it does not look for play, and"
    " learns no law that depends on two quantities.",
)
@click.option(
    "--wall/--no-wall",
    default=None,
    help="Also compute the stiffest stable wall of DEVICE and of the improved device. Default: only"
    " for a --device that can render a wall.",
)
@click.option(
    "--known-torque", "model", metavar="MODEL", type=click.Path(path_type=Path),
    help="MJCF or URDF model of the robot. The torque of the robot's arms on --joint is then"
    " computed from the model, not searched for.",
)  # fmt: skip
@click.option("--joint", metavar="INDEX|NAME",
              help="The joint to diagnose, if the recording or MODEL has several. all: diagnose"
              " every joint that moves, one by one, and print a table.")  # fmt: skip
@click.option(
    "--processes", type=click.IntRange(1), help="For a fleet: number of parallel processes."
)
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
    """Compare recordings of a device with its simulation, and find the missing physics.

    RECORDING is a CSV, MAT, HDF5, NPY or MCAP file of another tool, a recording TOML, or a log
    that zwidth wrote. Several recordings are diagnosed together. For a file of another tool, the
    meaning of its columns is guessed and written to NAME.recording.toml. Without --device, a device
    is fitted and written to NAME.device.toml. If a guess or the device is wrong, correct that file
    and run the same command again.

    Files written: the report (NAME.diagnosis.html); the improved device (NAME.augmented.toml),
    which every command accepts; a log with residual, missing force and predictions
    (NAME.diagnosis.mcap); and, if two explanations remain, the experiment that tells them apart
    (NAME.next.toml). Ctrl-C or SIGTERM stops the search, and the best answer so far is reported.

    Many recordings are a fleet: give a folder, or a table (CSV or TOML with recording, device,
    date, known values). The report NAME.fleet.html says what the devices share, where they differ,
    what changed and when, and which recordings are unlike the others (docs/fleets.md).
    """
    # A diagnosis needs modules that take seconds to load; help and mistyped options do not.
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
            "--processes and --cluster are for a fleet (a folder or a table of recordings); leave"
            " them out, or give a fleet"
        )
    if joint == ALL_JOINTS and model is None:
        _refuse_beside_all_joints(recordings, validate)
        from zwidth.joint_door import diagnose_joints

        line = typed_line(click.get_current_context())
        diagnose_joints(console, recordings[0], name, effort, wall, out, line)
        return
    from zwidth.diagnose_files import diagnose_files

    line = typed_line(click.get_current_context())
    robot = (model, joint)
    diagnose_files(console, recordings, name, validate, effort, wall, out, line, robot)


def _refuse_beside_all_joints(recordings: Sequence[Path], validate: Sequence[Path]) -> None:
    """Raise ValueError for what has no use where every joint of a recording is diagnosed."""
    if len(recordings) > 1 or validate:
        what = "--validate" if validate else f"{len(recordings)} recordings"
        raise ValueError(f"--joint all takes one recording, and {what} cannot be added")


def _refuse_beside_a_fleet(
    recordings: Sequence[Path], validate: Sequence[Path], wall: bool | None, model: Path | None
) -> None:
    """Raise ValueError for what has no use where a fleet is diagnosed."""
    if len(recordings) > 1:
        raise ValueError(
            f"{len(recordings)} arguments are given, and one of them is a fleet; give"
            " either one folder or table of recordings, or only recordings"
        )
    if validate or wall is not None or model is not None:
        option = "--validate" if validate else "--known-torque" if wall is None else "--wall"
        raise ValueError(f"{option} cannot be used with a fleet; leave it out")
