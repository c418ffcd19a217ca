"""The diagnosis of files: reads and diagnoses recordings, and writes all results."""

import itertools
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import click
import numpy as np

from zwidth.console import Column, Console, hanging
from zwidth.diagnosis.answer.held_out import models_of
from zwidth.diagnosis.answer.own_units import in_own_units
from zwidth.diagnosis.answer.result import Diagnosis, NotDiagnosed, Verdict
from zwidth.diagnosis.answer.words import negligible_in_words, own_parameter, worth_in_words
from zwidth.diagnosis.compiled import compiled
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.mishaps import Mishaps, attempt, collecting, isolated
from zwidth.diagnosis.recording.experiment import Experiment, StandsStill, stretches
from zwidth.diagnosis.selection.effort import EFFORTS
from zwidth.diagnosis_log import diagnosis_trace
from zwidth.diagnosis_marks import marks_of
from zwidth.diagnosis_report import (
    INTERRUPTED,
    Commands,
    assumptions,
    changes_in_words,
    effect_at,
    error,
    estimate,
    gain_sentence,
    improvement,
    in_words,
    linear_words,
    masses_of,
    output_in_words,
    save_report,
    save_unanswered,
    scale_sentence,
    verdict_line,
)
from zwidth.diagnosis_summary import next_sentence, whereabouts
from zwidth.door import described, device_of, kept
from zwidth.files.whole import write_text
from zwidth.heartbeat import HEART
from zwidth.logs.mcap_writer import write_log
from zwidth.logs.recording import load_log, read_recording, unscaled
from zwidth.options import in_this_folder
from zwidth.sim.device import Device
from zwidth.sim.device_file import commented_text, load_device
from zwidth.sim.readable import counted_in, number, percent
from zwidth.sim.trace import Trace

if TYPE_CHECKING:
    from zwidth.stability.augmented_boundary import AugmentedBoundary

# Endings of the files written beside the logs: NAME.diagnosis.html, ...
WHEN = ("before", "refit", "after")
RESULTS = ("diagnosis.html", "augmented.toml", "next.toml", "next.npy")


def diagnose_files(
    console: Console,
    recordings: tuple[Path, ...],
    name: str | None,
    validate: tuple[Path, ...],
    effort: str,
    wall: bool | None,
    out: Path,
    line: str,
    robot: tuple[Path | None, str | None] = (None, None),
) -> Diagnosis:
    """Diagnose recordings, print, write and return the results; arguments as of the command.

    line: the command line that repeats this. robot: its model and the joint in it. Raises
    ValueError and ClickException as the command does, and KeyboardInterrupt at its end where it was
    interrupted.
    """
    _refuse_fitted(recordings, validate)
    known = None if name is None else load_device(name)  # its errors are reported at once
    arms = _arms(*robot, known)
    joint = robot[1] if robot[0] is None else None  # of a table with several joints, not of a model
    doubts: list[str] = []
    every = (*recordings, *validate)
    HEART.begins("reading the recordings")
    read = {path: described(console, path, out, joint, doubts) for path in every}
    compiled()
    with ExitStack() as scales, collecting(console.warn) as mishaps:
        with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # of numpy: 1e300
            fitted_to = arms(console, _traces(console, recordings, read))
            scales.enter_context(counted_in(*unscaled([trace for _, trace in fitted_to])))
            fresh, file = False, Path(name or "")
            if known is None:
                HEART.begins("fitting a device")
                named = [(path.stem, trace) for path, trace in fitted_to]
                file, known, fresh = device_of(console, named, out)
            device, name = known, name or str(file)
            if fresh and wall is None:
                wall = False  # without a device file, walls were not requested
            assumed = tuple(dict.fromkeys(doubts))
            asked = Asked(console, recordings, read, device, name, out, line, wall, assumed)
            fit_on = _stretches(fitted_to, device)
            judged_by = arms(console, _traces(console, validate, read))
            judge_by = _judges(console, judged_by, device)
            logs = _log_files(out, [path for path, _ in fit_on])
            console.will_write(*map(asked.file, RESULTS), *(log for _, log in logs))
            say, tries = _timed(console), EFFORTS[effort]
            try:
                found = diagnose(device, [e for _, e in fit_on], judge_by, say, tries)
                if fresh and not found.interrupted and found.verdict is Verdict.LINEAR_PARAMETERS:
                    console.note(
                        "only linear parameters differ: searching again from the refitted device"
                    )
                    device = kept(found.device, file)
                    asked = replace(asked, device=device)
                    fit_on = _stretches(fitted_to, device)
                    found = diagnose(device, [e for _, e in fit_on], judge_by, say, tries)
            except NotDiagnosed as end:
                raise _unanswered(asked, end, mishaps) from end
        _say(console, found, asked.assumed)
        _answer(asked, found, logs, mishaps)
    if found.interrupted:
        raise KeyboardInterrupt
    return found


def _timed(console: Console) -> Callable[[str], None]:
    """A function that prints the current step with the time since the beginning."""

    def say(text: str) -> None:
        console.doing(in_words(text.replace("@", " at ")), HEART.elapsed())

    return say


@dataclass(frozen=True)
class Asked:
    """The inputs of a diagnosis, and the folder for its results.

    read: the file from which each recording is read; name: of the device, given or made; line: the
    command line to repeat. wall: whether to compute the stiffest wall; None: if the device may
    render one. assumed: the assumptions about the files, in sentences.
    """

    console: Console
    recordings: tuple[Path, ...]
    read: Mapping[Path, Path]
    device: Device
    name: str
    out: Path
    line: str = ""
    wall: bool | None = None
    assumed: tuple[str, ...] = ()

    def file(self, ending: str) -> Path:
        """The path of a file of the answer."""
        return self.out / f"{self.recordings[0].stem}.{ending}"


@dataclass
class Files:
    """The files written, and the pictures drawn for them."""

    augmented: Path | None = None
    logs: list[Path] = field(default_factory=list[Path])
    report: Path | None = None
    drawn: dict[str, str] = field(default_factory=dict[str, str])


def _answer(
    asked: Asked, found: Diagnosis, logs: Sequence[tuple[Path, Path]], mishaps: Mishaps
) -> None:
    """Write every file as soon as it can be, then what follows from the diagnosis.

    logs: recording and log of each stretch. Report and JSON are written before what
    follows, which takes long and may fail, and again with it.
    """
    console, files = asked.console, Files()
    with isolated("augmented device"):
        if not mishaps.of("augmented device"):
            text = commented_text(found.device)
            files.augmented = write_text(asked.file("augmented.toml"), text)
    _report(asked, found, files, None)
    console.keep(_result(asked, found, files, None, mishaps))
    bounds: AugmentedBoundary | None = None
    try:
        files.logs = _logs(asked, found, [(asked.read[path], log) for path, log in logs])
        with isolated("next experiment"):
            from zwidth.planning.separating import separating  # not needed if nothing is found

            found = replace(found, next_experiment=separating(found, asked.file("next.toml")))
            if found.next_experiment is not None:
                console.say(f"\n{next_sentence(found.next_experiment)}")
        bounds = _boundary(asked, found)
    finally:  # after Ctrl-C too
        found = replace(found, errors=tuple(mishaps.found))
        _report(asked, found, files, bounds)
        _say_written(console, found, files)
        console.result(_result(asked, found, files, bounds, mishaps))
    _fail_for_what_is_not_written(mishaps)


def _report(
    asked: Asked, found: Diagnosis, files: Files, bounds: "AugmentedBoundary | None"
) -> None:
    """Write the report as far as there is an answer."""
    with isolated("report"):
        names = [path.name for path in asked.recordings]
        path = asked.file("diagnosis.html")
        files.report = save_report(found, names, _commands(asked, files), path, bounds, files.drawn)


def _commands(asked: Asked, files: Files) -> Commands:
    """What the reader of an answer can do next, and what it was read from."""
    shown = str(files.augmented or asked.name)
    view = in_this_folder("zwidth", "explore", asked.name, "--compare", shown)
    read = tuple(dict.fromkeys(str(asked.read[path]) for path in asked.recordings))
    improved = str(files.augmented or "")
    return Commands(asked.line, view, improved, asked.name, read, asked.assumed)


def _log_files(out: Path, paths: Sequence[Path]) -> list[tuple[Path, Path]]:
    """The recording and the log of each stretch."""
    names = _distinct([path.stem for path in paths])
    logs = [out / f"{name}.diagnosis.mcap" for name in names]
    return list(zip(paths, logs, strict=True))


def _logs(asked: Asked, found: Diagnosis, files: Sequence[tuple[Path, Path]]) -> list[Path]:
    """Write a log for every stretch that was diagnosed. files: of all stretches."""
    kept = [pair for k, pair in enumerate(files) if k not in found.left_out]
    written: list[Path] = []
    for e, (recording, path) in zip(found.experiments, kept, strict=True):
        with isolated("log", recording.name):
            _log(asked.device, found, e, recording, path)
            written.append(path)
    return written


def _result(
    asked: Asked,
    found: Diagnosis,
    files: Files,
    bounds: "AugmentedBoundary | None",
    mishaps: Mishaps,
) -> Any:
    """The JSON of the results so far."""
    found = in_own_units(replace(found, errors=tuple(mishaps.found)))
    more = {
        "boundary": bounds and bounds.as_json(),
        "device": asked.device.name,
        "assumptions": [*asked.assumed, *assumptions(found, _commands(asked, files))],
        "augmented_device": files.augmented and str(files.augmented),
        "report": files.report and str(files.report),
        "logs": [str(p) for p in files.logs],
    }
    return _plain(found.as_json() | more)


def _say_written(console: Console, found: Diagnosis, files: Files) -> None:
    if files.augmented is not None:
        console.say(f"wrote {files.augmented}")
    if gain := gain_sentence(found):
        console.say(gain)
    for path in (*files.logs, files.report):
        if path is not None:
            console.say(f"wrote {path}")


def _fail_for_what_is_not_written(mishaps: Mishaps) -> None:
    """Raise the error that prevented a promised file, so that the exit status shows it."""
    for mishap in mishaps.of("augmented device", "log", "report"):
        if isinstance(mishap.cause, OSError):
            raise mishap.cause
        raise click.ClickException(f"a file with results was not written: {mishap.sentence}")


def _unanswered(asked: Asked, end: NotDiagnosed, mishaps: Mishaps) -> click.ClickException:
    """Write what there is where nothing can be concluded; the error to end with."""
    answer = replace(end.unanswered, errors=tuple(mishaps.found))
    names = [path.name for path in asked.recordings]
    report: Path | None = None
    with isolated("report"):
        path = asked.file("diagnosis.html")
        report = save_unanswered(answer, asked.device.name, names, asked.line, path)
        asked.console.say(f"wrote {report}")
    more = {
        "boundary": None, "device": asked.device.name, "augmented_device": None,
        "report": report and str(report), "logs": list[str](),
    }  # fmt: skip
    asked.console.result(_plain(answer.as_json() | more))
    return click.ClickException(answer.sentence)


def _refuse_fitted(recordings: Sequence[Path], validate: Sequence[Path]) -> None:
    """Raise ValueError if a recording is given both to fit and to judge by."""
    fitted = {path.resolve() for path in recordings}
    for path in validate:
        if path.resolve() in fitted:
            raise ValueError(
                f"--validate is {path}, a recording that is fitted; give one that is not, or leave"
                " --validate out to judge by the last 30 % of each"
            )


def _distinct(stems: Sequence[str]) -> list[str]:
    """Return a distinct name for each stem; repeated ones get -2, -3, ..."""
    names: list[str] = []
    for stem in stems:
        tries = (f"{stem}-{n}" for n in itertools.count(2))
        name = stem
        while name in names or (name != stem and name in stems):
            name = next(tries)
        names.append(name)
    return names


def may_render(device: Device, experiments: Sequence[Experiment]) -> bool:
    """Whether a rig may render a virtual wall at all.

    A wall needs a loop of at least 200 Hz, a force that is commanded directly (not by a servo's own
    loop or a prescribed motion), and the position of the mass on which it acts.
    """
    asked = [e.command for e in experiments if e.pushed is None]
    driven = any(np.ptp(command) > 0.0 for command in asked)
    sees = any(o.quantity == "position" and o.mass == 0 for e in experiments for o in e.outputs)
    servo = any(p.effect.sought == "given" for p in device.physics)
    return driven and sees and not servo and device.interface.period <= 0.005


def _boundary(asked: Asked, found: Diagnosis) -> "AugmentedBoundary | None":
    """The stiffest wall before and after; None if nothing was found or there is no such wall."""
    if not found.findings or asked.wall is False:
        return None
    from zwidth.stability.augmented_boundary import augmented_boundary

    console, device = asked.console, asked.device
    renders = may_render(device, found.experiments) if asked.wall is None else asked.wall
    if not renders:
        return None
    names = " and ".join(effect_at(found, f.effect, f.at) for f in found.findings)
    console.doing(
        "computing the stiffest stable wall of the device file and of the improved device",
        HEART.elapsed(),
    )
    bounds = attempt("boundary", "", lambda: augmented_boundary(device, found.device, names))
    if bounds is not None:
        console.say(bounds.sentence)
    return bounds


def _log(device: Device, found: Diagnosis, e: Experiment, recording: Path, path: Path) -> None:
    """Write what belongs to a recording, in its own time: a viewer shows both side by side."""
    log = load_log(recording)
    shares = found.located.entry or [{"name": "m1", "share": 1.0}]
    place = max(shares, key=lambda share: float(share["share"]))["name"]
    searched, first = found.searched, float(log.tick.t[0])
    marks = marks_of(found, e, first)
    trace = diagnosis_trace(
        searched.problem, searched.refit, searched.final, e, place=str(place),
        start_s=first + e.begins, rotary=found.device.rotary,
        before=models_of(device, searched)["before"], marks=marks,
    )  # fmt: skip
    write_log(path, trace, epoch_ns=log.epoch_ns, annotations=marks)


def _traces(
    console: Console, paths: Sequence[Path], read: Mapping[Path, Path]
) -> list[tuple[Path, Trace]]:
    """Read recordings; if there are several, an unreadable one is skipped."""
    found: list[tuple[Path, Trace]] = []
    for path in paths:
        with isolated("recording", path.name) if len(paths) > 1 else nullcontext():
            trace = read_recording(read[path])
            for warning in cast("list[str]", trace.facts.get("warnings", [])):
                console.warn(f"{path.name}: {warning}")
            found.append((path, trace))
    if paths and not found:
        raise ValueError("none of the recordings can be read, as said above")
    return found


Traces = list[tuple[Path, Trace]]


def _arms(
    model: Path | None, joint: str | None, device: Device | None
) -> Callable[[Console, Traces], Traces]:
    """What adds to recordings the force of the rest of a robot, nothing where none is given.

    A joint without a model is one of the recording's own. Raises ValueError for a model without a
    joint, and without a device.
    """
    if model is not None and joint is None:
        raise ValueError("--known-torque MODEL and --joint NAME must be given together; give both")
    if model is None or joint is None:
        return lambda _, traces: traces
    if device is None:
        raise ValueError(
            "--known-torque needs --device, the device of the joint; 'zwidth devices --from"
            f" {model} --joint {joint} --out FILE' writes one"
        )
    from zwidth.export.known_torque import with_known_torque
    from zwidth.export.read_joint import joint_of

    joint_of(model, joint)  # its errors are reported at once

    def add(console: Console, traces: Traces) -> Traces:
        found: Traces = []
        for path, trace in traces:
            more, said = with_known_torque(trace, device, model, joint)
            console.note(f"{path.name}: {said}")
            found.append((path, more))
        return found

    return add


def _stretches(
    traces: Sequence[tuple[Path, Trace]], device: Device
) -> list[tuple[Path, Experiment]]:
    """Divide recordings into stretches; if there are several, an unusable one is skipped."""
    found: list[tuple[Path, Experiment]] = []
    for path, trace in traces:
        with isolated("recording", path.name) if len(traces) > 1 else nullcontext():
            found += [(path, e) for e in stretches(trace, device, path.stem)]
    if traces and not found:
        raise ValueError("none of the recordings can be read, as said above")
    return found


def _judges(
    console: Console, traces: Sequence[tuple[Path, Trace]], device: Device
) -> list[Experiment] | None:
    """Return the recordings to judge by, None for parts of those that are fitted.

    One in which nothing moves has no motion of which an error would be a share.
    """
    try:
        return [e for _, e in _stretches(traces, device)] or None
    except StandsStill as still:
        console.warn(
            f"{traces[0][0].name} cannot judge the answer ({str(still).rpartition(';')[0]}); the"
            " last 30 % of each recording are used instead"
        )
        return None


def _say(console: Console, found: Diagnosis, assumed: Sequence[str]) -> None:
    before = f"{INTERRUPTED}: " if found.interrupted else ""
    console.say(f"\n{before}{found.headline}\n")
    for change in changes_in_words(found):
        console.say(f"changes over time: {change}")
    for event in found.events:
        console.say(f"happened once: {event.sentence}")
    for doubt in assumed:  # the answer depends on these
        console.say(f"assumed: {doubt}")
    for caution in found.cautions:
        console.warn(caution)
    console.say(f"{verdict_line(found)}\n")
    for fault in found.faults:
        console.say(fault.sentence)
    if where := whereabouts(found):
        console.say(where)
    if found.findings:
        console.say("\nEffects found, with 95 % intervals")
        for line in found_lines(found):
            console.say(line)
        for f in found.findings:
            if worth := worth_in_words(f):
                console.say(f"{effect_at(found, f.effect, f.at)}: {worth}")
    if aside := negligible_in_words(found.negligible, masses_of(found)):
        console.say(aside)
    rows = [list(row) for row in linear_words(found)]
    columns = [Column("", False), Column("device file"), Column("refitted")]
    console.table("\nLinear parameters", columns, rows)
    if scale := scale_sentence(found):
        console.say(scale)
    console.say(f"\n{improvement(found)}")
    whens = WHEN if found.findings else WHEN[:2]
    heads = ("device file", "refitted", "with the found effects")[: len(whens)]
    runs = found.whole_runs
    law = ("law",) if runs and "law" in runs[0].errors else ()
    rows = [
        [output_in_words(run)]
        + [f"{error(run.errors[w], run.unit)} ({percent(run.shares[w])})" for w in (*whens, *law)]
        + ["held out" if run.held_out else "fitted"]
        for run in found.whole_runs
    ]
    if rows:
        columns = _columns(*heads, *("with the law" for _ in law))
        title = "One free run over the whole stretch: rms error (share of the motion)"
        console.table(f"\n{title}", columns, rows)
    rows = [
        [f"{run.recording}, up to {number(run.band)} Hz"]
        + [f"{error(run.errors[w], run.unit)} ({percent(run.shares[w])})" for w in whens]
        + ["held out" if run.held_out else "fitted"]
        for run in found.force_errors
    ]
    if rows:
        title = "Force that each model lacks to follow the recording: rms (share of the command)"
        console.table(f"\n{title}", _columns(*heads), rows)
    if found.next_level is not None:
        console.say(f"\n{found.next_level.sentence}")


def found_lines(found: Diagnosis) -> list[str]:
    """Return each effect with its sigma, and below it a line for each of its parameters."""
    wide = max((len(own_parameter(n)) for f in found.findings for n in f.parameters), default=0)
    lines: list[str] = []
    for f in found.findings:
        sigma = f.separation_sigma
        known = f" ({number(sigma)} sigma)" if math.isfinite(sigma) else ""
        lines.append(f"{effect_at(found, f.effect, f.at)}{known}")
        for name, value in f.parameters.items():
            head = f"  {own_parameter(name).ljust(wide)}  "
            lines.append(hanging(head, estimate(value)))
    return lines


def _columns(*heads: str) -> list[Column]:
    """Columns of numbers, between what they are of and which data they were measured on."""
    return [Column("", False), *map(Column, heads), Column("data", False)]


def _plain(value: Any) -> Any:
    """Return JSON types; what is not finite becomes null."""
    match value:
        case dict():
            return {str(k): _plain(v) for k, v in cast("dict[Any, Any]", value).items()}
        case list() | tuple():
            return [_plain(v) for v in cast("list[Any]", value)]
        case float() if not math.isfinite(value):
            return None
        case np.floating():
            return _plain(float(value))
        case _:
            return value
