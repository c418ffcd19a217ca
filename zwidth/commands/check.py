"""`zwidth check`: whether a device file still describes the machine of its recordings."""

import os
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import click

from zwidth.errors import CheckFailed, Status, explain
from zwidth.files.protection import Protected, reading, writer
from zwidth.options import force_option, json_option, out_option, typed_line

if TYPE_CHECKING:
    from zwidth.checking import Check
    from zwidth.console import Console
    from zwidth.sim.device import Device


ANSWERED = "zwidth.check.answered"  # in the context once the result is written


class Checking(click.Command):
    """A command whose status 1 is an answer: errors have another, and are in its files."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; raise CheckFailed for an error that would have status 1."""
        try:
            status = super().invoke(ctx)
            sys.stdout.flush()
        except (Exception, KeyboardInterrupt) as error:
            status, sentence = explain(error)
            broken = status == Status.FAILED
            if not (ctx.meta.get(ANSWERED) or isinstance(error, Protected)):
                with suppress(Exception):  # this may fail too, without memory
                    _write_error(ctx.params, Status.BROKEN if broken else status, sentence)
            if broken and not _debugging():
                raise CheckFailed(sentence) from error
            raise
        return status


@click.command("check", cls=Checking)
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
              help="If a LOG is outside the band, also search for what is missing, as"
              " 'zwidth diagnose' does; this takes minutes.")  # fmt: skip
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
    input, 3 if the check itself failed, for example because of a full disk. If a LOG is outside
    the band, the parameters of DEVICE are refitted, and one sentence says which changed. With
    --diagnose, missing physics is searched for, too; the results go to --out.
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
        from zwidth.model_runs import ModelRuns, simulator_here

        simulate, simulator = ModelRuns(known, model, joint), simulator_here()
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
        return _rebased(console, rebased(known, recordings, simulate, simulator), rebase)
    name = f"{model.name} in {simulator}" if model is not None else ""
    found = check(known, recordings, simulate, name, HEART.begins)
    for one in found.recordings:
        console.say(f"{one.name}: {one.sentence}")
        for remark in one.remarks:
            console.note(f"{one.name}: {remark}")
    console.say(f"\n{found.sentence}")
    if junit is not None:
        from zwidth.files.whole import write_text

        console.say(f"wrote {write_text(junit, junit_text(found))}")
    console.result(found.as_json())
    click.get_current_context().meta[ANSWERED] = True
    if found.within:
        return Status.DONE
    if search:
        from zwidth.diagnose_files import diagnose_files

        outside = tuple(
            log for log, one in zip(logs, found.recordings, strict=True) if not one.within
        )
        line = typed_line(click.get_current_context())
        try:
            diagnose_files(Console(None), outside, device, (), "normal", None, out, line)
        except Exception as error:  # the check has its answer
            if _debugging():
                raise
            console.warn(f"the search for other physics failed: {explain(error)[1]}")
    return Status.FAILED


def _debugging() -> bool:
    return os.environ.get("ZWIDTH_DEBUG") == "1"


def _write_error(given: Mapping[str, Any], status: Status, sentence: str) -> None:
    """Write why there is no answer to the files that were asked for, where that harms none."""
    from zwidth.console import Console
    from zwidth.files.whole import json_text, write_text

    logs: tuple[Path, ...] = given.get("logs") or ()
    for path in (given.get("device"), given.get("model"), *logs):
        if path is not None:
            reading(Path(path))
    safely = replace(writer(), overwrite=False)  # a recording's files may be unknown yet
    found = {"error": sentence, "status": int(status)}
    texts = {given.get("junit"): junit_error(str(given.get("device")), logs, sentence)}
    if given.get("json_file") == "-":
        Console("-").result(found)
    elif given.get("json_file") is not None:
        texts[Path(given["json_file"])] = json_text(found)
    for path, text in texts.items():
        if path is not None and safely.objection(path) is None:
            with suppress(OSError):  # the error itself may be a full disk
                write_text(path, text)


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
    except RecordingError:  # it has only one joint
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
    return _xml(suite)


def junit_error(device: str, logs: tuple[Path, ...], sentence: str) -> str:
    """Return JUnit XML of a check without an answer: a suite whose only case is an error."""
    suite = ElementTree.Element(
        "testsuite", name=f"zwidth check {device}", tests="1", failures="0", errors="1",
        skipped="0",
    )  # fmt: skip
    name = ", ".join(log.name for log in logs)
    case = ElementTree.SubElement(suite, "testcase", classname=device, name=name)
    ElementTree.SubElement(case, "error", message=sentence).text = sentence
    return _xml(suite)


def _xml(suite: ElementTree.Element) -> str:
    ElementTree.indent(suite)
    return ElementTree.tostring(suite, encoding="unicode", xml_declaration=True) + "\n"
