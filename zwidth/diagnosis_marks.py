"""The findings of a diagnosis on stretches of a recording, as annotations of its log."""

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise

from zwidth.diagnosis.answer.result import Diagnosis, Finding
from zwidth.diagnosis.forces.locate import DENSER
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis_report import effect_at, estimate
from zwidth.logs.annotations import Annotation, Severity
from zwidth.sim.readable import number

# Start and end [s] from the first sample of the recording, severity, text, details.
Mark = tuple[float, float, Severity, str, Mapping[str, str]]


def marks_of(found: Diagnosis, e: Experiment, first_s: float) -> list[Annotation]:
    """Return the annotations of one stretch of a recording, in the recording's own time.

    first_s: time of the recording's first sample [s]. Findings that last all the time mark the
    whole stretch. Names are mark_1, mark_2 ..., as of the log's channels.
    """
    begins, ends = e.begins, e.begins + (e.ticks - 1) * e.period
    kept: list[Mark] = []
    for start, end, severity, text, details in _marks(found, e):
        start, end = max(start, begins), min(end, ends)
        if start <= end:
            kept.append((start, end, severity, text, details))
    return [
        Annotation(first_s + start, first_s + end, severity, f"mark_{n}", text, details)
        for n, (start, end, severity, text, details) in enumerate(kept, 1)
    ]


def _marks(found: Diagnosis, e: Experiment) -> Iterator[Mark]:
    always = (-math.inf, math.inf)
    yield *always, "info", found.headline, {"verdict": found.verdict.value}
    for fault in found.faults:
        if fault.recording in ("", e.name):
            severity = "error" if fault.wrong else "info"
            yield *always, severity, fault.sentence, {"fault": fault.kind}
    for finding in found.findings:
        # Short: PlotJuggler drops texts of more than 100 characters; sizes are in the details.
        missing = f"missing: {effect_at(found, finding.effect, finding.at)}"
        yield *always, "warning", missing, _details(finding)
    for change in found.changes:
        if change.recording in ("", e.name):
            yield *(change.between or always), "warning", change.sentence, {"change": change.shape}
    for event in found.events:
        if event.recording == e.name:
            last = event.between[1] if event.until is None else event.until
            yield event.between[0], last, "warning", event.sentence, {"event": event.kind}
    for run in found.whole_runs:
        if run.recording == e.name and run.held_out:
            last = run.begins + (run.measured.size - 1) * run.period
            yield run.begins, last, "info", "kept out of the fit, to judge it", {}
            break  # each output has a run
    yield from _dense(found)


def _details(finding: Finding) -> dict[str, str]:
    sigma = number(finding.separation_sigma)
    about = {"effect": finding.effect, "at": finding.at, "separation_sigma": sigma}
    return about | {name: estimate(value) for name, value in finding.parameters.items()}


def _dense(found: Diagnosis) -> Iterator[Mark]:
    """Where in time the refitted device errs much more than elsewhere.

    Its shares are counted over all recordings, one after the other; so of several nothing is said.
    """
    slices, fitted = found.located.time, found.searched.problem.experiments
    if len(fitted) != 1 or not slices:
        return
    even = 1.0 / len(slices)
    dense = [s for s in slices if float(s["share"]) >= DENSER * even]
    starts = [s for s in dense if not any(s["from"] == o["to"] for o in dense)]
    edges = [float(s["from"]) for s in starts] + [math.inf]
    for start, after in pairwise(edges):
        part = [s for s in dense if start <= s["from"] < after]
        share = sum(float(s["share"]) for s in part)
        text = (
            f"this {100.0 * even * len(part):.0f} % of the time has {100.0 * share:.0f} % of the"
            " prediction error of the refitted device"
        )
        begins = fitted[0].begins
        yield begins + start, begins + float(part[-1]["to"]), "info", text, {}
