"""Findings of an answer: values with intervals, rival effects, detection limits."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, chi2

from zwidth.diagnosis.answer.regimes import held
from zwidth.diagnosis.answer.result import Estimate, Finding, Rival, magnitudes
from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.fitting.reach import reaches
from zwidth.diagnosis.fitting.uncertainty import (
    Z95,
    covariance,
    covariance_beside,
    inflation,
    spans,
)
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.mishaps import attempt, isolated
from zwidth.diagnosis.model.parameters import (
    Model,
    chain_values,
    effect_labels,
    is_read,
    linear_parameters,
    values_of,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.candidates import candidates
from zwidth.diagnosis.seeking.lattice import chances_seen, step_interval
from zwidth.diagnosis.seeking.screen import Complement, screen
from zwidth.diagnosis.selection.evidence import ALPHA, probabilities
from zwidth.diagnosis.selection.hypothesis import Hypothesis, against
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.selection.searched import Searched
from zwidth.diagnosis.settings import EVIDENCE, INTAKE, VERDICT
from zwidth.sim.device import Device, place_label
from zwidth.sim.physics import EFFECTS, contains
from zwidth.sim.physics.effect import Physics
from zwidth.sim.place import of_label

Floats = NDArray[np.float64]
Shares = dict[frozenset[str], float]
DAMPER, SPRING = ("N m s/rad", "N s/m"), ("N m/rad", "N/m")
UNITS = {
    "mass": ("kg m2", "kg"), "damper": DAMPER, "link": DAMPER, "spring": SPRING, "k0": SPRING,
    "gain": ("", ""), "origin": ("rms motions", "rms motions"), "jitter": ("s", "s"),
    "skew": ("s", "s"),
    "zero": ("rad", "m"),
}  # fmt: skip
SAME_STEP = 0.01  # relative difference of steps that are the same
NOTICED = 0.1  # of the noise: a smaller step is only the rounding of written numbers


def all_findings(device: Device, taken: Taken, found: Searched) -> tuple[Finding, ...]:
    """The effects of the model; before them a rectifying sensor, after them an encoder's step."""
    findings = _findings(found)
    with isolated("detect", "encoder_step at sensor"):
        steps = _encoder(device, found, taken.whole, taken.faults)
        findings = findings if steps is None else (*findings, steps)
    if taken.folded > 1.0:
        # Without the unfolding, the deviation of n samples is larger by this factor.
        ticks = sum(e.ticks for e in taken.fit_on)
        sigma = float(np.sqrt(2.0 * ticks * np.log(taken.folded)))
        findings = (Finding("rectified_sensor", "sensor", {}, sigma, ()), *findings)  # found first
    return findings


def _findings(found: Searched) -> tuple[Finding, ...]:
    """The effects of the model, the one that explains most first."""
    final, tried = found.final, found.tried
    reach = attempt("intervals", "", partial(spans, final))
    reach = np.full((final.x.size, 2), np.nan) if reach is None else reach
    own = [j for j, p in enumerate(final.model.parameters) if p.kind == "effect"]
    further = attempt("intervals", "", partial(reaches, found.problem, final, reach, own))
    reach[own] = reach[own] if further is None else further
    findings: list[Finding] = []
    odds = attempt("separation", "", partial(shares, tried)) if final.model.effects else None
    labels = effect_labels(final.model.effects)
    for i, (physics, label) in enumerate(zip(final.model.effects, labels, strict=True)):
        name = f"{physics.effect.name} at {physics.at}"
        scatter = partial(elsewhere, tried, odds or {}, label)
        among = attempt("intervals", name, scatter) or {}
        estimates = _estimates(final, i, reach, among)
        if physics.effect.sought == "lattice":
            step = partial(_step_estimate, found, physics)
            estimates |= attempt("intervals", name, step) or {}
        clear = attempt("intervals", name, partial(_together_clear, final, i)) or False
        one = Finding(physics.effect.name, physics.at, estimates, np.nan, (), clear=clear)
        one = attempt("separation", name, partial(_separated, one, tried, odds, label)) or one
        bare = tried.tried.get(tried.best.labels - {label})
        everywhere = bare and attempt("regimes", name, partial(held, tried.best, bare))
        findings.append(replace(one, regimes=tuple(everywhere or ())))
    return tuple(sorted(findings, key=lambda f: np.nan_to_num(f.separation_sigma), reverse=True))


def _separated(one: Finding, tried: Search, odds: Shares | None, label: str) -> Finding:
    """An effect's sigma over a model without it, its rivals, its probabilities."""
    if odds is None:
        return one
    return replace(
        one,
        separation_sigma=without(tried, label),
        rivals=rivals(tried, odds, label),
        probability=probability(odds, label),
        with_richer=with_richer(odds, label),
    )


def half_width(way: Floats, spread: Floats) -> float:
    """Return half of the 95 % interval along a direction x (p,); spread (p, p): covariance."""
    return Z95 * float(np.sqrt(max(way @ spread @ way, 0.0)))


def _estimates(
    final: Fitted, index: int, reach: Floats, among: Mapping[str, float]
) -> dict[str, Estimate]:
    """Values of an effect of the model with their intervals; also "phase in WORD".

    reach (p, 2): how far the intervals of x go below and above it. among: variances over the
    structures that may be true, besides those within the one that was found.
    """
    model, x = final.model, final.x
    physics, spread = model.effects[index], covariance(final)
    estimates: dict[str, Estimate] = {}
    for j, p in enumerate(model.parameters):
        target = model.parameters[p.index] if p.kind == "change" else p
        if target.kind != "effect" or target.index != index or model.is_found(p):
            continue
        value, scale = physics.values[target.key], target.scale
        if target is p:
            name, value = p.key, value + scale * float(x[j])
            other = Z95 * math.hypot(math.sqrt(among.get(p.key, 0.0)), EVIDENCE.finest * value)
            half = tuple(math.hypot(abs(scale) * float(r), other) for r in reach[j])
        else:  # a value of its own in some recordings
            name = f"{target.key} in {p.name.partition(' in ')[2]}"
            way = np.zeros(x.size)
            way[[j, p.index]] = scale
            value, half = value + float(way @ x), (half_width(way, spread),) * 2
        known = physics.effect.parameter(target.key)
        unit = known.unit_for(model.nominal.rotary)
        estimates[name] = _within(value, half, unit, known.lower, known.upper)
    return estimates


def _together_clear(final: Fitted, index: int) -> bool:
    """Whether the magnitudes of an effect together differ from none of it at 95 %.

    Each may be zero though all may not: of two levels of which only the sum is known, for example.
    """
    physics, parameters = final.model.effects_at(final.x)[index], final.model.parameters
    none = magnitudes(physics.effect)
    own = [
        j
        for j, p in enumerate(parameters)
        if p.kind == "effect" and p.index == index and p.key in none
    ]
    if len(own) < 2:
        return False
    gains = [j for j, p in enumerate(parameters) if p.kind == "gain"]
    spread = covariance_beside(final, gains)[np.ix_(own, own)]
    if not np.all(np.isfinite(spread)):
        return False
    each = [parameters[j] for j in own]
    off = np.array([(physics.values[p.key] - none[p.key]) / p.scale for p in each])
    told = off @ np.linalg.pinv(spread, hermitian=True) @ off
    return bool(told > chi2.ppf(0.95, len(own)))


def _within(
    value: float, half: Sequence[float], unit: str, lower: float = 0.0, upper: float = math.inf
) -> Estimate:
    """A value with the possible part of its interval: no stiffness is below zero.

    half: how far it reaches below and above the value.
    """
    below, above = half
    return Estimate(value, max(value - below, lower), min(value + above, upper), unit)


def _encoder(
    device: Device, found: Searched, acted: Sequence[Experiment], faults: Sequence[Fault]
) -> Finding | None:
    """The encoder's step that the samples themselves show, if the device file has none.

    Values that are not counts would all lie within `INTAKE.whole` of a lattice with a probability
    of (2 whole)^n: this gives the sigma. A step far below the noise is not physics.
    """
    position = next((o for o in acted[0].outputs if o.tells_position), None)
    seen = [f.value for f in faults if f.kind == "encoder_step"]
    if position is None or not seen or found.final.model.has("encoder_step"):
        return None
    step, known = max(seen), device.interface.encoder_step
    noise = float(found.problem.observer.deviation[acted[0].outputs.index(position)])
    if abs(step - known) < SAME_STEP * known or step < NOTICED * noise:
        return None
    values = sum(e.ticks for e in acted)
    sigma = float(np.sqrt(-2.0 * values * np.log(2.0 * INTAKE.whole)))
    unit = "rad" if device.rotary else "m"
    half = step * INTAKE.whole / values
    estimate = Estimate(step, step - half, step + half, unit)
    return Finding("encoder_step", "sensor", {"step": estimate}, sigma, ())


def _step_estimate(found: Searched, physics: Physics) -> dict[str, Estimate]:
    """Estimates of parameters without a slope: steps, and the rate of lost commands."""
    name, rotary = physics.effect.name, found.final.model.nominal.rotary
    (key,) = physics.values
    value = physics.values[key]
    unit = physics.effect.parameter(key).unit_for(rotary)
    if name == "dropped_samples":
        parts = [e.dropped for e in found.problem.experiments if e.dropped is not None]
        lost = sum(int(d.sum()) for d in parts)
        seen = round(chances_seen(found.problem, found.final, value))
        interval = binomtest(lost, max(seen, lost)).proportion_ci(method="exact")
        return {key: Estimate(value, float(interval.low), float(interval.high), unit)}
    half = step_interval(found.problem, found.final, name, inflation(found.final.white))
    return {key: Estimate(value, value - half, value + half, unit)}


def linear(
    device: Device,
    final: Fitted,
    experiments: Sequence[Experiment],
    among: Mapping[str, float] | None = None,
) -> dict[str, tuple[float, Estimate]]:
    """Return (nominal, estimate) of each linear parameter by name; of a gain only if it is free.

    among: variances over the structures that may be true, as in `linear_elsewhere`.
    """
    nominal = values_of(Model(device), np.zeros(len(linear_parameters(device))))
    fitted = values_of(final.model, final.x)
    reach = spans(final)
    result: dict[str, tuple[float, Estimate]] = {}
    for j, p in enumerate(linear_parameters(device)):
        if not is_read(p, experiments):
            continue
        own, value = nominal[p.name], fitted[p.name]
        other = Z95 * math.sqrt((among or {}).get(p.name, 0.0))
        below, above = np.hypot(abs(p.slope(own, float(final.x[j]))) * reach[j], other).tolist()
        unit = UNITS[p.kind][0 if device.rotary else 1]
        lowest, highest = (min(p.value(own, p.lower), value), max(p.value(own, p.upper), value))
        ends = max(value - below, lowest), min(value + above, highest)
        result[p.name] = (own, Estimate(value, *ends, unit))
    return result | _of_recordings(device, final, experiments)


def _of_recordings(
    device: Device, final: Fitted, experiments: Sequence[Experiment]
) -> dict[str, tuple[float, Estimate]]:
    """(nominal, estimate) of each linear parameter that recordings have of their own, by name.

    As in the first recording that has it, including what is known to differ there.
    """
    model, spread = final.model, covariance(final)
    result: dict[str, tuple[float, Estimate]] = {}
    for j, p in enumerate(model.parameters):
        if p.kind != "change" or not model.is_linear(p):
            continue
        e = next((e for e in experiments if p.name in e.own_names), None)
        if e is None:
            continue
        target = model.parameters[p.index]
        way = np.zeros(final.x.size)
        way[[j, p.index]] = 1.0
        half = half_width(way, spread)
        low, value, high = (
            _on(e, model, final.x, p.index, k * half, target.name) for k in (-1.0, 0.0, 1.0)
        )
        bare = Model(device)
        known = _on(e, bare, np.zeros(bare.linear_count), p.index, 0.0, target.name)
        unit = UNITS[target.kind][0 if device.rotary else 1]
        result[p.name] = (known, Estimate(value, low, high, unit))
    return result


def _on(e: Experiment, model: Model, x: Floats, index: int, more: float, name: str) -> float:
    """A linear parameter in a recording that differs by this much in x."""
    there = model.there(x, e).copy()
    there[index] += more
    moved = model.within(there)
    if name in ("origin", "gain", "jitter", "skew") or name.startswith("zero_"):
        return values_of(model, moved)[name]
    return chain_values(e.on(model.build(moved)).chain)[name]


def upper_bounds(found: Searched) -> dict[str, dict[str, float]]:
    """The smallest visible magnitude of each effect: best fit and 1.96 sigma."""
    problem, fitted = found.problem, found.final
    built, gain = fitted.model.build(fitted.x), fitted.model.reads(fitted.x).gain
    off = Complement(fitted.jacobian)
    base, wide = off(fitted.residual), float(np.sqrt(inflation(fitted.white)))
    bounds: dict[str, dict[str, float]] = {}
    tried = candidates(built, problem.experiments, gain)
    for one in screen(problem, fitted, tried, "limits"):
        effect = one.start.physics.effect
        name, size = effect.strength, float(np.linalg.norm(one.signature))
        if name is None or not effect.magnitudes or size == 0.0:
            continue
        best = max(0.0, -float(base @ one.signature) / size**2)
        none = effect.parameter(name).none_of_it()
        own = abs(one.start.physics.values[name] - none)
        bounds[one.start.label] = {name: none + own * (best + Z95 * wide / size)}
    return bounds


def without(found: Search, label: str) -> float:
    """How many sigma the best hypothesis is better than the same without an effect.

    If that was not fitted: than the best hypothesis with only some of its other effects. A
    hypothesis with another effect in its place is a rival, and says nothing about how much the
    effect explains.
    """
    best = found.best
    lacking = [h for h in found.tried.values() if h.labels <= best.labels - {label}]
    nearest = min(lacking, key=lambda h: h.cost.total)
    bare = found.tried.get(best.labels - {label}, nearest)
    return max(0.0, against(best, bare).sigma)


def shares(found: Search) -> Shares:
    """Return the probability of every structure that was fitted to the end, by its labels.

    A hypothesis with one effect more is the best of everything that was tried, so it pays the
    penalty that a search requires (`evidence.believed`).
    """
    best = found.best
    kept = list(found.tried.values())
    more = [max(0, len(h.model.effects) - len(best.model.effects)) for h in kept]
    looked_through = 2.0 * math.log(1.0 / ALPHA)
    behind = [_behind(h, best) + looked_through * n for h, n in zip(kept, more, strict=True)]
    return dict(zip((h.labels for h in kept), probabilities(behind).tolist(), strict=True))


def probability(odds: Shares, label: str) -> float:
    """Return the probability that a device has an effect, summed over all structures with it."""
    return math.fsum(p for labels, p in odds.items() if label in labels)


def with_richer(odds: Shares, label: str) -> float:
    """Return the probability that a device has an effect or a richer form of it.

    The name of a limit is right even if the limit also falls with speed: a richer form reduces
    neither the probability of an effect's name nor its sigma (`Finding.confusable_with`).
    """

    def has(labels: frozenset[str]) -> bool:
        return any(other == label or _contains(other, label) for other in labels)

    return math.fsum(p for labels, p in odds.items() if has(labels))


def elsewhere(found: Search, odds: Shares, label: str) -> dict[str, float]:
    """Return how much the values of an effect scatter over the structures that have it."""

    def off(h: Hypothesis) -> dict[str, float]:
        new = _values(h, label)
        return {name: _apart(label, name, new[name] - value) for name, value in own.items()}

    own = _values(found.best, label)
    having = {labels: share for labels, share in odds.items() if label in labels}
    return _scattered(found, having, off) or dict.fromkeys(own, 0.0)


def linear_elsewhere(found: Search) -> dict[str, float]:
    """Return how much the linear parameters scatter over the structures.

    A spring at the load in place of one at the motor changes all masses behind the motor.
    """
    own = values_of(found.best.model, found.best.x)

    def off(h: Hypothesis) -> dict[str, float]:
        new = values_of(h.model, h.x)
        return {name: new[name] - own[name] for name in own.keys() & new.keys()}

    return _scattered(found, shares(found), off)


def _scattered(
    found: Search, odds: Shares, off: Callable[[Hypothesis], Mapping[str, float]]
) -> dict[str, float]:
    """Return variances about the values of the best, weighted by the structures' probability.

    It is also uncertain which effects a device has, and others of them change the values. off: how
    far the values of a hypothesis are from those of the best.
    """
    total = math.fsum(odds.values())
    scatter: dict[str, float] = {}
    for labels, share in odds.items():
        if share > 0.0:
            for name, by in off(found.tried[labels]).items():
                scatter[name] = scatter.get(name, 0.0) + share / total * by**2
    return scatter


def _apart(label: str, name: str, off: float) -> float:
    """Return a difference of two values of an effect's parameter, of angles the nearest one."""
    parameter = EFFECTS[of_label(label)[0]].parameter(name)
    turns = parameter.role == "turning" and parameter.unit == "rad"
    return math.remainder(off, 2.0 * math.pi) if turns else off


def _values(h: Hypothesis, label: str) -> dict[str, float]:
    return next(dict(p.values) for p in h.model.effects_at(h.x) if place_label(p) == label)


def rivals(found: Search, odds: Shares, label: str) -> tuple[Rival, ...]:
    """Return the effects fitted in place of an effect of the best hypothesis, nearest first.

    A richer form whose own fit ended where it is another law is also a rival: "rising" friction
    that falls with speed. Within its bounds it explains as much as the effect, so only the penalty
    of its further parameters separates them. It has no probability of its own.
    """
    best = found.best
    behind = _in_its_place(found, label)
    for h in found.tried.values():
        new, gone = h.labels - best.labels, best.labels - h.labels
        if label not in gone or len(gone) < 2 or len(new) != 1 or not math.isfinite(h.cost.total):
            continue
        (other,) = new
        # One law in place of several effects is their rival if it contains each, or one that may
        # replace it: a constant force may act at either end of a link, and the law only at one.
        if all(
            any(_contains(other, part) for part in (one, *_near(_in_its_place(found, one))))
            for one in gone
        ):
            behind[other] = min(_sigmas_behind(h, best), behind.get(other, math.inf))
    for h in found.on_bounds.values():
        other = h.shrunk
        instead = h.labels == best.labels - {label} | {other}
        if instead and other not in behind and _contains(other, label):
            as_well = replace(h.cost, misfit=best.cost.misfit).total - best.cost.total
            behind[other] = math.sqrt(max(0.0, as_well)) if math.isfinite(as_well) else 0.0
    ordered = sorted(behind.items(), key=lambda pair: pair[1])
    named = frozenset[str]().union(*odds)
    return tuple(
        Rival(effect, str(place), sigma, probability(odds, other) if other in named else None)
        for other, sigma in ordered
        for effect, place in [of_label(other)]
    )


def _in_its_place(found: Search, label: str) -> dict[str, float]:
    """How many sigma worse the best hypothesis is with one other effect in place of this one.

    Or with this effect and another one each at another place: a pendulum and a constant force may
    both be at the motor or both at the load.
    """
    best, law = found.best, of_label(label)[0]
    others: dict[str, float] = {}
    for h in found.tried.values():
        new, gone = h.labels - best.labels, best.labels - h.labels
        moved = sorted(of_label(n)[0] for n in new) == sorted(of_label(g)[0] for g in gone)
        # A cost is infinite if the recordings do not determine a parameter.
        if label not in gone or not math.isfinite(h.cost.total):
            continue
        if len(new) == len(gone) == 1 or (moved and len(gone) == 2):
            instead = [n for n in new if len(new) == 1 or of_label(n)[0] == law]
            for other in instead:
                others[other] = min(_sigmas_behind(h, best), others.get(other, math.inf))
    return others


def _near(behind: Mapping[str, float]) -> list[str]:
    return [other for other, sigma in behind.items() if sigma < VERDICT.apart]


def _sigmas_behind(h: Hypothesis, best: Hypothesis) -> float:
    return math.sqrt(max(0.0, _behind(h, best))) if math.isfinite(h.cost.total) else math.inf


def _contains(richer: str, simple: str) -> bool:
    return contains(*of_label(richer), *of_label(simple))


def _behind(h: Hypothesis, best: Hypothesis) -> float:
    """How much more a hypothesis costs than the best, in units of the pair's overdispersion."""
    if h is best:
        return 0.0
    phi = against(best, h).phi
    return float(np.nan_to_num((h.cost.total - best.cost.total) / phi, posinf=1e300))
