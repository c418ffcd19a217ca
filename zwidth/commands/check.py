"""`zwidth check`: whether a device file still describes the machine of its recordings."""

from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import click

from zwidth.errors import Status
from zwidth.options import force_option, json_option, out_option, typed_line

if TYPE_CHECKING:
    from zwidth.checking import Check
    from zwidth.console import Console
    from zwidth.sim.device import Device


@click.command("check")
@click.argument("device", metavar="DEVICE")
@click.argument("logs", metavar="LOG...", nargs=-1, required=True,
                type=click.Path(path_type=Path))  # fmt: skip
@click.option("--junit", metavar="FILE", type=click.Path(dir_okay=False, path_type=Path),
              help="Also write the result as JUnit XML, with a test case for each"
              " LOG.")  # fmt: skip
@click.option("--model", metavar="FILE", type=click.Path(path_type=Path),
              help="MJCF or URDF model to check instead of DEVICE. MuJoCo runs it; its errors are"
              " compared with the band of DEVICE.")  # fmt: skip
@click.option("--joint", metavar="INDEX|NAME",
              help="The joint to check, if a LOG has several; also that of --model.")  # fmt: skip
@click.option("--diagnose", "search", is_flag=True,
              help="If a LOG is outside, also search for what is missing, as 'zwidth diagnose'"
              " does; this takes minutes.")  # fmt: skip
@click.option("--rebase", metavar="FILE", type=click.Path(dir_okay=False, path_type=Path),
              help="Do not check: measure the errors of free runs on LOG, and write DEVICE to FILE"
              " with these errors as its band. Useful for a --model with larger"
              " errors.")  # fmt: skip
@out_option("runs")
@force_option
@json_option
def command(
    device: str,
    logs: tuple[Path, ...],
    junit: Path | None,
    model: Path | None,
    joint: str | None,
    search: bool,
    rebase: Path | None,
    out: Path,
    json_file: str | None,
) -> int:
    """Check whether a device file still describes its machine, for automatic builds.

    DEVICE is the improved device of a diagnosis (NAME.augmented.toml). Its [band] is the range of
    errors that free runs may have. LOG is any recording that 'zwidth diagnose' can read.

    Exit status: 0 if the errors of all LOGs are within the band, 1 if a LOG is outside, 2 for bad
    input. If a LOG is outside, the parameters of DEVICE are refitted, and one sentence says which
    changed. With --diagnose, missing physics is searched for, too; the results go to --out.
    """
    from zwidth.checking import check, rebased
    from zwidth.console import Console
    from zwidth.diagnosis.recording.experiment import Experiment, stretches
    from zwidth.door import taken
    from zwidth.heartbeat import HEART
    from zwidth.sim.device_file import load_device

    console = Console(json_file)
    if model is not None and joint is None:
        raise ValueError(
            "--model needs --joint NAME, the joint of the model that DEVICE describes; add it"
        )
    known = load_device(device)
    simulate, simulator = None, ""
    if model is not None and joint is not None:
        from zwidth.model_runs import ModelRuns, named_simulator

        simulate, simulator = ModelRuns(known, model, joint), named_simulator(model)
    HEART.begins("reading the recordings")
    recordings: list[tuple[str, list[Experiment]]] = []
    for log in logs:
        trace, said = taken(log, joint=joint if model is None else _of_log(log, joint))
        for line in said:
            if line.startswith("assumed"):
                console.note(f"{log.name}: {line}")
        recordings.append((log.name, stretches(trace, known, log.stem)))
    console.will_write(*(file for file in (junit, rebase) if file is not None))
    HEART.begins("checking")
    if rebase is not None:
        return _rebased(console, rebased(known, recordings, simulate), rebase)
    found = check(known, recordings, simulate, simulator, HEART.begins)
    for one in found.recordings:
        console.say(f"{one.name}: {one.sentence}")
        for remark in one.remarks:
            console.note(f"{one.name}: {remark}")
    console.say(f"\n{found.sentence}")
    if junit is not None:
        from zwidth.files.whole import write_text

        console.say(f"wrote {write_text(junit, junit_text(found))}")
    console.result(found.as_json())
    if found.within:
        return Status.DONE
    if search:
        from zwidth.diagnose_files import diagnose_files

        outside = tuple(
            log for log, one in zip(logs, found.recordings, strict=True) if not one.within
        )
        line = typed_line(click.get_current_context())
        diagnose_files(Console(None), outside, device, (), "normal", None, out, line)
    return Status.FAILED


def _rebased(console: "Console", device: "Device", file: Path) -> int:
    """Write a device with its new band, and say it."""
    from zwidth.files.whole import write_text
    from zwidth.sim.device_file import commented_text

    band = device.band
    assert band is not None
    console.say(f"wrote {write_text(file, commented_text(device))}")
    errors = {o.name: o.error for o in band.outputs}
    console.result({"device": device.name, "file": str(file), "error": errors,
                    "windows": band.windows})  # fmt: skip
    return Status.DONE


def _of_log(log: Path, joint: str | None) -> str | None:
    """The joint, where the recording has several and one is called so."""
    from zwidth.logs.assumed import joints_of
    from zwidth.logs.open_source import own_log
    from zwidth.logs.source import RecordingError, Source

    if log.suffix.lower() == ".toml":
        return None
    source = own_log(log)
    if not isinstance(source, Source):
        return None
    try:
        every = joints_of(source)
    except RecordingError:  # it is of one joint
        return None
    return joint if joint in (*every.moving, *every.still) else None


def junit_text(found: "Check") -> str:
    """Return a check as JUnit XML: a suite with a case for each recording."""
    outside = [one for one in found.recordings if not one.within]
    suite = ElementTree.Element(
        "testsuite", name=f"zwidth check {found.device}", tests=str(len(found.recordings)),
        failures=str(len(outside)), errors="0", skipped="0",
    )  # fmt: skip
    for one in found.recordings:
        case = ElementTree.SubElement(suite, "testcase", classname=found.device, name=one.name)
        if not one.within:
            failure = ElementTree.SubElement(case, "failure", message=found.sentence)
            failure.text = one.sentence
        ElementTree.SubElement(case, "system-out").text = "\n".join([one.sentence, *one.remarks])
    ElementTree.indent(suite)
    return ElementTree.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"
