"""Shows recordings and logs of diagnoses in Rerun: `rerun-importer-zwidth FILE`.

For an unknown file Rerun runs every program on PATH with a name rerun-importer-..., and reads its
output on stdout; a program that does not know the file either ends with status 66
(https://rerun.io/docs/concepts/logging-and-ingestion/importers/overview). Rerun itself reads an
MCAP file as messages; `rerun-importer-zwidth LOG.mcap | rerun -` shows it as curves.
"""

import re
import sys
from argparse import ArgumentParser
from importlib import import_module
from pathlib import Path
from typing import Any

from zwidth.door import taken
from zwidth.logs.annotations import Annotation, Severity, read_annotations
from zwidth.logs.errors import LogError
from zwidth.logs.mcap_reader import Log, read_log
from zwidth.sim.readable import number
from zwidth.sim.trace import Trace

NOT_OURS = 66
LOG_SUFFIX = ".mcap"
# "found_free_position_m1": model, kind, output (`diagnosis_log`).
OF_A_MODEL = re.compile(r"(before|refit|found)_(?:(free|residual)_)?(.+)")
LEVELS: dict[Severity, str] = {"info": "INFO", "warning": "WARN", "error": "ERROR"}  # of Rerun


def main() -> None:
    """Write a recording to stdout in the form for Rerun, with the arguments of Rerun."""
    parser = ArgumentParser(prog="rerun-importer-zwidth", description=__doc__)
    parser.add_argument("file", type=Path, help="a recording, a recording TOML or a log of zwidth")
    parser.add_argument("--application-id", help="application id of the recording in Rerun")
    parser.add_argument("--recording-id", help="recording id of the recording in Rerun")
    parser.add_argument("--entity-path-prefix", default="", help="prefix of all curves' names")
    asked, _ = parser.parse_known_args()  # Rerun passes more, which a recording does not need
    path: Path = asked.file
    log: Log | None = None
    try:
        if not path.is_file():
            sys.exit(NOT_OURS)
        if path.suffix.lower() == LOG_SUFFIX:
            log = read_log(path)
        trace = taken(path)[0] if log is None else log.tick
    except (LogError, ValueError):
        sys.exit(NOT_OURS)
    try:
        rerun = import_module("rerun")
    except ModuleNotFoundError:
        sys.exit("rerun-importer-zwidth needs rerun-sdk: pip install 'zwidth[rerun]'")
    stream = rerun.RecordingStream(
        asked.application_id or path.name, recording_id=asked.recording_id
    )
    stream.stdout()
    prefix = asked.entity_path_prefix.rstrip("/")
    send(rerun, stream, prefix, trace)
    if log is not None:
        send_annotations(rerun, stream, prefix, log)


def send(rerun: Any, stream: Any, prefix: str, trace: Trace) -> None:
    """Send every channel of a trace as a curve over the timeline `time`.

    An output is grouped with the models' predictions: `position_m1/measured`,
    `position_m1/found_free`; the residuals are under `position_m1_residual`.
    """
    for name, values in trace.channels.items():
        place = f"{prefix}/{entity(name, trace)}"
        unit = trace.units[name]
        label = f"{place.rpartition('/')[2]} [{unit}]" if unit else place.rpartition("/")[2]
        stream.log(place, rerun.SeriesLines(names=label), static=True)
        index = [rerun.TimeColumn("time", duration=trace.t)]
        stream.send_columns(place, indexes=index, columns=rerun.Scalars.columns(scalars=values))


def entity(name: str, trace: Trace) -> str:
    """Return the path of a trace's channel in Rerun."""
    if (model := OF_A_MODEL.fullmatch(name)) and model[3] in trace.channels:
        word, kind, output = model.groups()
        if kind == "residual":
            return f"{output}_residual/{word}"
        return f"{output}/{word}_{kind or 'one_step'}"
    if f"found_{name}" in trace.channels:
        return f"{name}/measured"
    return f"annotations/{name}" if re.fullmatch(r"mark_\d+", name) else name


def send_annotations(rerun: Any, stream: Any, prefix: str, log: Log) -> None:
    """Send the annotations of a log as lines of text at their beginnings."""
    for one in read_annotations(log.path, log.epoch_ns):
        stream.set_time("time", duration=one.start)
        stream.log(
            f"{prefix}/annotations",
            rerun.TextLog(in_words(one), level=LEVELS[one.severity]),
        )


def in_words(one: Annotation) -> str:
    """Return an annotation as one line: its name, duration and text."""
    about = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in one.details.items())
    lasts = f"{one.name}, {number(one.start)} to {number(one.end)} s"
    return f"{lasts}: {one.text}{f' ({about})' if about else ''}"
