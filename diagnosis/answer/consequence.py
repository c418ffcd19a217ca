"""The worth of each finding: how much larger held-out free-run errors are without it.

The answer without one effect, with its other parameters fitted again, predicts the same held-out
recordings with the same observer. Over runs of each length that fits (`adequacy`), its mean square
error is compared with that of the answer,

    worth = sqrt(mean e_without^2 / mean e_with^2),    pays if the difference exceeds its scatter

over the runs, or that of the logarithms, since some stretches show more than others. The length
with the clearest difference counts.

A finding is negligible if held-out data are predicted better without it, or if the intervals of all
its magnitudes include zero effect and they are predicted less than five sigma worse without it.
Such an effect is significant by its likelihood, but may not exist; it is reported as negligible.

Limits: a parameter that only held-out motion excites has no worth here. Errors of free runs also
contain the noise of readings and random forces, which no finding removes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

from zwidth.diagnosis.answer.adequacy import clearly, each_length, log_ratios
from zwidth.diagnosis.answer.result import Finding, magnitudes
from zwidth.diagnosis.fitting.descend import fit
from zwidth.diagnosis.mishaps import attempt
from zwidth.diagnosis.model.parameters import effect_labels
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.searched import Searched
from zwidth.diagnosis.settings import ADEQUACY, VERDICT
from zwidth.shown import Valued
from zwidth.sim.physics import EFFECTS
from zwidth.sim.place import label_of, place_at


@dataclass(frozen=True)
class Worth(Valued):
    """How many times larger free-run errors are without a finding; sigma; horizon [s]."""

    times: float
    sigma: float
    horizon: float

    @property
    def pays(self) -> bool:
        """Whether the errors are larger without it, beyond the scatter of the runs."""
        return self.times > 1.0 and self.sigma > ADEQUACY.apart


def weighed(
    findings: Sequence[Finding], found: Searched, judge_by: Sequence[Experiment]
) -> tuple[Finding, ...]:
    """Return findings with their worth; found: the answer."""
    labels = effect_labels(found.final.model.effects)

    def own(f: Finding) -> Finding:
        label = label_of(f.effect, place_at(f.at))
        if label not in labels or not judge_by:
            return f
        name = f"{f.effect} at {f.at}"
        asked = partial(worth_of, found, labels.index(label), judge_by)
        return replace(f, worth=attempt("worth", name, asked))

    return tuple(own(f) for f in findings)


def worth_of(found: Searched, index: int, judge_by: Sequence[Experiment]) -> Worth | None:
    """Return the worth of an effect of the answer (its index in the model); None if unknown."""
    bare = fit(found.problem, *found.final.model.less(found.final.x, index))
    period = judge_by[0].period
    told: list[Worth] = []
    for ticks, own, other in each_length((found.final, found.judge), (bare, found.judge), judge_by):
        if own.mean() > 0.0:
            times = math.sqrt(float(other.mean() / own.mean()))
            sigma = max(clearly(other - own), clearly(log_ratios(other, own)))
            told.append(Worth(times, sigma, ticks * period))
    return max(told, key=lambda w: w.sigma, default=None)


def may_be_nothing(finding: Finding) -> bool:
    """Whether held-out data reject a finding, or do not need it and it may be zero.

    It may be zero if all its magnitudes together may be (`Finding.clear`): Stribeck friction may
    have no level in motion and still hold a mass at rest. An interval comes from a quadratic form,
    which can be wrong for a strength beside a similar effect: that of a pendulum beside a
    stiffening spring contained zero, but errors of free runs were 51 times as large without it. So
    free runs decide, at five sigma: a resonance that did not exist, beside a known arm, was worth 5
    %.

    Held-out data reject it if free runs err less without it, and over no horizon more. Of the
    effects named on 60 sealed recordings two were rejected, and neither existed. For effects that
    existed, the clearest horizon showed at least 0.8 sigma. Runs too few to have a scatter (0
    sigma) decide nothing.
    """
    worth = finding.worth
    if worth is not None and worth.sigma < 0.0 and worth.times < 1.0 / ADEQUACY.matters:
        return True
    if worth is not None and worth.times > 1.0 and worth.sigma > VERDICT.apart:
        return False
    sizes = [
        (finding.parameters[name], none)
        for name, none in magnitudes(EFFECTS[finding.effect]).items()
        if name in finding.parameters
    ]
    may = bool(sizes) and all(e.lower <= none <= e.upper for e, none in sizes)
    return may and not finding.clear
