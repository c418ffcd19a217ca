"""Choose the excitation that separates a doubtful finding from its nearest rival."""

from pathlib import Path

from zwidth.diagnosis.answer.result import Diagnosis, NextExperiment
from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.selection.searched import Searched
from zwidth.planning.next_experiment import next_experiment
from zwidth.sim.device import place_label
from zwidth.sim.physics.effect import Physics


def separating(found: Diagnosis, out: Path) -> NextExperiment | None:
    """Choose and write the excitation that separates the first doubtful finding and its rival.

    Returns None if no finding is doubtful, or no excitation of the library tells them apart.
    """
    searched = found.searched
    final = searched.final
    labels = [place_label(p) for p in final.model.effects]
    for finding in found.findings:
        own = f"{finding.effect}@{finding.at}"
        if not finding.confusable_with or own not in labels:
            continue
        near = finding.confusable_with[0]
        label = f"{near.effect}@{near.at}"
        kept, x = final.model.less(final.x, labels.index(own))
        other = _with_rival(searched, own, label)
        if other is None:
            continue
        a, b = _as_fitted(own, final), _as_fitted(label, other)
        observer = searched.problem.observer
        return next_experiment(kept.acting(x), a, b, found.experiments, observer, out)
    return None


def _with_rival(searched: Searched, own: str, label: str) -> Fitted | None:
    """A fit with the rival in place of the effect `own`."""
    found = searched.tried
    other = found.tried.get(found.best.labels - {own} | {label})
    return None if other is None or other.slopes is None else other.fitted


def _as_fitted(label: str, fitted: Fitted) -> Physics:
    """An effect of a model with its fitted values."""
    every = fitted.model.effects_at(fitted.x)
    return next(p for p in every if place_label(p) == label)
