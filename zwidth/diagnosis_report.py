"""The report of a diagnosis as one HTML file: the verdict first, every picture inside it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from matplotlib import rc_context
from matplotlib.figure import Figure

from diagnosis.augmented_boundary import AugmentedBoundary
from diagnosis.next_experiment import NextExperiment
from diagnosis.result import Diagnosis, Estimate, HeldOut
from zwidth.figures.augmented_boundary import augmented_boundary_figure
from zwidth.figures.diagnosis import force_map_figure, residual_figure
from zwidth.figures.style import STYLE
from zwidth.files import write_text
from zwidth.report_page import embedded, page

WORDS = {
    "nothing_missing": "Nothing missing",
    "identified": "Identified",
    "confusable": "Cannot be told apart",
    "unknown_physics": "Unknown physics",
    "linear_parameters": "Linear parameters differ",
    "recording_fault": "The recording is at fault",
}


@dataclass(frozen=True)
class Commands:
    """Lines to type: what computes the report again, what opens both devices side by side."""

    again: str
    explore: str


def save_report(
    diagnosis: Diagnosis,
    recordings: Sequence[str],
    commands: Commands,
    path: Path,
    boundary: AugmentedBoundary | None = None,
) -> Path:
    """Write the report; boundary: the stiffest wall before and after. Returns the path."""
    top = max(diagnosis.located.maps, key=lambda m: m.gained)
    text = page(
        "diagnosis_report.html",
        {"number": number, "estimate": estimate},
        d=diagnosis,
        verdict=WORDS[diagnosis.verdict.value],
        recordings=recordings,
        commands=commands,
        boundary=boundary,
        boundary_picture=_embedded(augmented_boundary_figure(boundary)) if boundary else "",
        next_sentence=next_sentence(diagnosis.next_experiment),
        place=top.place,
        state=sorted(diagnosis.located.state, key=lambda s: -float(s["share"])),
        fits=(("one step ahead", diagnosis.one_step), ("free run", diagnosis.free_run)),
        improvement=improvement(diagnosis.free_run),
        force_map=_embedded(force_map_figure(diagnosis.located, diagnosis.device.rotary)),
        residual=_embedded(residual_figure(diagnosis.residuals)),
    )
    return write_text(path, text)


def improvement(fit: HeldOut) -> str:
    """Say how much smaller the error on held-out data became."""
    if not fit.after > 0.0 or not fit.refit > 0.0:
        return "there is too little held-out data to judge by"
    if fit.refit <= 1.02 * fit.after:
        return "the held-out free run is no better than with the refit alone"
    return f"the held-out free run errs {fit.refit / fit.after:.3g} times less than the refit alone"


def next_sentence(planned: NextExperiment | None) -> str:
    """Say what to record next, "" where nothing is in doubt."""
    if planned is None:
        return ""
    a, b = planned.separates
    sigma = f"{planned.separation_sigma:.3g} sigma"
    words = planned.excitation.replace("_", " ")
    return (
        f'to tell {a} from {b}, record the excitation "{words}": it separates them by {sigma};'
        f" {planned.scenario.name} plays it"
    )


def number(value: float) -> str:
    """Four significant digits; a dash for what there is too little data to tell."""
    return f"{value:.4g}" if math.isfinite(value) else "-"


def estimate(value: Estimate) -> str:
    """A value with its interval and unit."""
    return f"{value.value:.4g} [{value.lower:.4g}, {value.upper:.4g}] {value.unit}".rstrip()


def _embedded(figure: Figure) -> str:
    stream = BytesIO()
    with rc_context(STYLE):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return embedded(stream.getvalue())
