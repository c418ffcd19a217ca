"""What was found, in the words of an answer: values with intervals, rivals, bounds."""

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from zwidth.diagnosis.answer.beside import (
    elsewhere,
    probability,
    rivals,
    with_richer,
    without,
)
from zwidth.diagnosis.answer.regimes import held
from zwidth.diagnosis.answer.result import Estimate, Finding, Held, Rival
from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.fitting.uncertainty import Z95, covariance, inflation, standard_errors
from zwidth.diagnosis.intake.gate import ON_LATTICE, Fault
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
from zwidth.diagnosis.selection.searched import Searched
from zwidth.sim.device import Device
from zwidth.sim.physics.effect import Physics

Floats = NDArray[np.float64]
DAMPER, SPRING = ("N m s/rad", "N s/m"), ("N m/rad", "N/m")
UNITS = {
    "mass": ("kg m2", "kg"), "damper": DAMPER, "link": DAMPER, "spring": SPRING, "k0": SPRING,
    "gain": ("", ""), "origin": ("rms motions", "rms motions"), "jitter": ("s", "s"),
    "skew": ("s", "s"),
    "zero": ("rad", "m"),
}  # fmt: skip
SAME_STEP = 0.01  # relative difference of steps that are the same
NOTICED = 0.1  # of the noise: a step below is a way to write numbers


def all_findings(device: Device, taken: Taken, found: Searched) -> tuple[Finding, ...]:
    """The effects of the model, and before them a folded sensor, after them an encoder's step."""
    findings = _findings(found)
    with isolated("detect", "encoder_step at sensor"):
        steps = _encoder(device, found, taken.whole, taken.faults)
        findings = findings if steps is None else (*findings, steps)
    if taken.folded > 1.0:
        # n samples whose deviation is a factor larger without it
        ticks = sum(e.ticks for e in taken.fit_on)
        sigma = float(np.sqrt(2.0 * ticks * np.log(taken.folded)))
        findings = (Finding("rectified_sensor", "sensor", {}, sigma, ()), *findings)  # found first
    return findings


def _findings(found: Searched) -> tuple[Finding, ...]:
    """The effects of the model, what explains most first."""
    spread = attempt("intervals", "", partial(standard_errors, found.final))
    if spread is None:
        spread = np.full(found.final.x.size, np.nan)
    findings: list[Finding] = []
    labels = effect_labels(found.final.model.effects)
    for i, physics in enumerate(found.final.model.effects):
        name = f"{physics.effect.name} at {physics.at}"
        among = attempt("intervals", name, partial(elsewhere, found.tried, labels[i])) or {}
        estimates = _estimates(found.final, i, spread, among)
        if physics.effect.sought == "lattice":
            step = partial(_step_estimate, found, physics)
            estimates |= attempt("intervals", name, step) or {}
        apart = attempt("separation", name, partial(_separated, found, labels[i]))
        sigma, near, chance, kind = (np.nan, (), None, None) if apart is None else apart
        everywhere = attempt("regimes", name, partial(_held, found, labels[i])) or ()
        findings.append(
            Finding(
                physics.effect.name, physics.at, estimates, sigma, near, chance, everywhere, kind
            )
        )
    return tuple(sorted(findings, key=lambda f: np.nan_to_num(f.separation_sigma), reverse=True))


def _held(found: Searched, label: str) -> tuple[Held, ...]:
    """How an effect does in each regime that was left out, beside the hypothesis without it."""
    best = found.tried.best
    bare = found.tried.tried.get(best.labels - {label})
    return () if bare is None else tuple(held(best, bare))


def _estimates(
    final: Fitted, index: int, spread: Floats, among: Mapping[str, float]
) -> dict[str, Estimate]:
    """Values of an effect of the model with their intervals.

    among: variances over the structures that may be true, beside those in the one that was found.
    """
    physics = final.model.effects[index]
    estimates: dict[str, Estimate] = {}
    for j, p in enumerate(final.model.parameters):
        if p.kind == "effect" and p.index == index:
            value = physics.values[p.key] + p.scale * float(final.x[j])
            half = Z95 * math.hypot(p.scale * float(spread[j]), math.sqrt(among.get(p.key, 0.0)))
            unit = physics.effect.parameter(p.key).unit_for(final.model.nominal.rotary)
            estimates[p.key] = Estimate(value, value - half, value + half, unit)
    return estimates | _own_estimates(final, index)


def _own_estimates(final: Fitted, index: int) -> dict[str, Estimate]:
    """What recordings have of their own of an effect's numbers: "phase in WORD"."""
    spread, model = covariance(final), final.model
    found: dict[str, Estimate] = {}
    for j, p in enumerate(model.parameters):
        target = model.parameters[p.index] if p.kind == "change" else None
        if target is None or target.kind != "effect" or target.index != index:
            continue
        if model.is_found(p):
            continue
        way = np.zeros(final.x.size)
        way[[j, p.index]] = target.scale
        physics = model.effects[index]
        value = physics.values[target.key] + float(way @ final.x)
        half = Z95 * float(np.sqrt(max(way @ spread @ way, 0.0)))
        unit = physics.effect.parameter(target.key).unit_for(model.nominal.rotary)
        name = f"{target.key} in {p.name.partition(' in ')[2]}"
        found[name] = Estimate(value, value - half, value + half, unit)
    return found


def _separated(found: Searched, label: str) -> tuple[float, tuple[Rival, ...], float, float]:
    """At how many sigma an effect stands above doing without it, its rivals, its probabilities."""
    tried = found.tried
    chances = probability(tried, label), with_richer(tried, label)
    return without(tried, label), rivals(tried, label), *chances


def _encoder(
    device: Device, found: Searched, acted: Sequence[Experiment], faults: Sequence[Fault]
) -> Finding | None:
    """The encoder's step that the samples themselves show, where the device does not know it.

    Values that were not counted would all lie within `ON_LATTICE` of a lattice with the odds of
    (2 ON_LATTICE)^n: that gives the sigma. A step far below the noise is no matter of physics.
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
    sigma = float(np.sqrt(-2.0 * values * np.log(2.0 * ON_LATTICE)))
    unit = "rad" if device.rotary else "m"
    half = step * ON_LATTICE / values
    estimate = Estimate(step, step - half, step + half, unit)
    return Finding("encoder_step", "sensor", {"step": estimate}, sigma, ())


def _step_estimate(found: Searched, physics: Physics) -> dict[str, Estimate]:
    """Estimates of what no slope leads to: steps, and the rate of lost commands."""
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
    device: Device, final: Fitted, experiments: Sequence[Experiment]
) -> dict[str, tuple[float, Estimate]]:
    """Return (nominal, estimate) of each linear parameter by name; a gain only where it is free."""
    nominal = values_of(Model(device), np.zeros(len(linear_parameters(device))))
    fitted = values_of(final.model, final.x)
    spread = standard_errors(final)
    result: dict[str, tuple[float, Estimate]] = {}
    for j, p in enumerate(linear_parameters(device)):
        if not is_read(p, experiments):
            continue
        own, value = nominal[p.name], fitted[p.name]
        half = Z95 * abs(p.slope(own, float(final.x[j]))) * float(spread[j])
        unit = UNITS[p.kind][0 if device.rotary else 1]
        result[p.name] = (own, Estimate(value, value - half, value + half, unit))
    return result | _of_recordings(device, final, experiments)


def _of_recordings(
    device: Device, final: Fitted, experiments: Sequence[Experiment]
) -> dict[str, tuple[float, Estimate]]:
    """(nominal, estimate) of each linear parameter that recordings have of their own, by name.

    As it is in the first recording that has it, with what is known to be different there.
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
        half = Z95 * float(np.sqrt(max(way @ spread @ way, 0.0)))
        low, value, high = (
            _on(e, model, final.x, p.index, k * half, target.name) for k in (-1.0, 0.0, 1.0)
        )
        bare = Model(device)
        known = _on(e, bare, np.zeros(bare.linear_count), p.index, 0.0, target.name)
        unit = UNITS[target.kind][0 if device.rotary else 1]
        result[p.name] = (known, Estimate(value, low, high, unit))
    return result


def _on(e: Experiment, model: Model, x: Floats, index: int, more: float, name: str) -> float:
    """A linear parameter in a recording, by so much more in x."""
    there = model.there(x, e).copy()
    there[index] += more
    moved = model.within(there)
    if name in ("origin", "gain", "jitter", "skew") or name.startswith("zero_"):
        return values_of(model, moved)[name]
    return chain_values(e.on(model.build(moved)).chain)[name]


def upper_bounds(found: Searched) -> dict[str, dict[str, float]]:
    """The magnitude of each effect that the recording would have shown: best fit and 1.96 sigma."""
    problem, fitted = found.problem, found.final
    built = fitted.model.build(fitted.x)
    off = Complement(fitted.jacobian)
    base = off(fitted.residual)
    wide = np.sqrt(inflation(fitted.white))
    bounds: dict[str, dict[str, float]] = {}
    for one in screen(
        problem,
        fitted,
        candidates(built, problem.experiments, fitted.model.reads(fitted.x).gain),
        "limits",
    ):
        effect = one.start.physics.effect
        name, size = effect.strength, float(np.linalg.norm(one.signature))
        if name is None or not effect.magnitudes or size == 0.0:
            continue
        best = max(0.0, -float(base @ one.signature) / size**2)
        factor = best + Z95 * float(wide) / size
        none = effect.parameter(name).none_of_it()
        own = abs(one.start.physics.values[name] - none)
        bounds[one.start.label] = {name: none + own * factor}
    return bounds
