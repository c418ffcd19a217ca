"""A diagnosis: the verdict, the effects found, the refitted parameters."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from zwidth.diagnosis.answer.result import Diagnosis, Estimate, Verdict
from zwidth.diagnosis_report import improvement, in_words, linear_rows, sentence
from zwidth.views.table import Table, number
from zwidth.views.units import numbers, rows

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

Row = tuple[str, str, str, Estimate, float | None, float | None]  # ..., of the file, sigma


def table(found: Diagnosis) -> Table:
    """Return the verdict in a sentence, then a row for each fitted number."""
    headings = ("effect", "at", "parameter", "value", "95 % from", "to", "unit", "sigma")
    grid = [
        [effect, at, name, *map(number, (e.value, e.lower, e.upper)), e.unit or "-", number(sigma)]
        for effect, at, name, e, _, sigma in _rows(found)
    ]
    said = [f"{found.headline}."]
    if found.verdict is not Verdict.IDENTIFIED:  # the headline already says it
        said.append(f"{sentence(in_words(found.sentence))}.")
    said.append(f"{sentence(improvement(found))}.")
    said += [f"{sentence(fault.sentence)}." for fault in found.faults]
    title = f"Diagnosis of {found.device.name}: {found.verdict.value.replace('_', ' ')}"
    return Table(title, said, headings, grid)


def _rows(found: Diagnosis) -> Iterator[Row]:
    for f in found.findings:
        for name, estimate in f.parameters.items():
            yield f.effect, f.at, name, estimate, None, f.separation_sigma
        if not f.parameters:
            nothing = Estimate(float("nan"), float("nan"), float("nan"))
            yield f.effect, f.at, "-", nothing, None, f.separation_sigma
    for name, (nominal, estimate) in linear_rows(found).items():
        yield "refitted", "-", name, estimate, nominal, None


def dataset(found: Diagnosis) -> "Dataset":
    """Return the fitted numbers over the parameters; `unit` is the unit of each."""
    every = list(_rows(found))
    values = [e for _, _, _, e, _, _ in every]
    text = {
        "effect": [effect for effect, *_ in every],
        "at": [at for _, at, *_ in every],
        "unit": [e.unit for e in values],
    }
    columns = {
        "value": numbers([e.value for e in values]),
        "lower": numbers([e.lower for e in values]),
        "upper": numbers([e.upper for e in values]),
        "in_device_file": numbers([nominal for *_, nominal, _ in every]),
    }
    sigma = numbers([s for *_, s in every])
    shown = {
        **{name: (column, "as in unit") for name, column in columns.items()},
        "separation": (sigma, "sigma"),
        **{name: (column, None) for name, column in text.items()},
    }
    names = [name for _, _, name, *_ in every]
    facts = {"verdict": found.verdict.value, "sentence": found.sentence}
    errors = {f"free_run_{k}": v for k, v in found.free_run.as_json().items()}
    return rows("parameter", (names, None), shown, {**facts, **errors})


def _motion(found: Diagnosis) -> "Figure":
    from zwidth.figures.diagnosis import whole_run_figure

    if not found.whole_runs:
        return _residual(found)
    return whole_run_figure(found.whole_runs[0], bool(found.findings))


def _inverse(found: Diagnosis) -> "Figure":
    from zwidth.figures.diagnosis import force_error_figure

    if not found.force_errors:
        raise ValueError(
            "there is no force error, which needs a force command and the measured motion of every"
            " mass; draw 'motion' instead"
        )
    return force_error_figure(found.force_errors[0], bool(found.findings))


def _force(found: Diagnosis) -> "Figure":
    from zwidth.figures.diagnosis import force_map_figure

    if not found.located.maps:
        raise ValueError("no missing force was located; draw 'residual' instead")
    return force_map_figure(found.located, found.device.rotary)


def _residual(found: Diagnosis) -> "Figure":
    from zwidth.figures.diagnosis import residual_figure

    return residual_figure(found.residuals, bool(found.findings))


PICTURES = {"motion": _motion, "missing force": _force, "residual": _residual, "force": _inverse}
