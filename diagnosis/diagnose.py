"""The pipeline from gate to verdict, in the order of docs/diagnosis.md."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from zwidth.diagnosis.candidates import CONTAINED, MAGNITUDE, acts_on, candidates
from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.fit import Fitted, Problem
from zwidth.diagnosis.gate import ON_LATTICE, Fault, corrected, examine
from zwidth.diagnosis.held_out import held_out
from zwidth.diagnosis.hold import smooth, was_smooth
from zwidth.diagnosis.lattice import STEPPED, chances_seen, step_interval
from zwidth.diagnosis.locate import locate
from zwidth.diagnosis.next_experiment import NextExperiment, next_experiment
from zwidth.diagnosis.parameters import (
    Model,
    effect_labels,
    first_velocity,
    linear_parameters,
    values_of,
)
from zwidth.diagnosis.predictor import FINAL
from zwidth.diagnosis.rectified import unfolded
from zwidth.diagnosis.removal import fit_without
from zwidth.diagnosis.result import NEAR, Diagnosis, Estimate, Finding, Residuals, Rival, Verdict
from zwidth.diagnosis.screen import Complement, screen
from zwidth.diagnosis.search import Searched, search
from zwidth.diagnosis.trials import Say, Step
from zwidth.diagnosis.uncertainty import Z95, covariance, inflation
from zwidth.diagnosis.unknown import Instead
from zwidth.diagnosis.verdict import Left, instead_of, judged, left_over, matters
from zwidth.sim.device import Device, place_label
from zwidth.sim.physics import effect_named, make_physics
from zwidth.sim.physics.effect import Physics

Floats = NDArray[np.float64]
DAMPER, SPRING = ("N m s/rad", "N s/m"), ("N m/rad", "N/m")
UNITS = {
    "mass": ("kg m2", "kg"), "damper": DAMPER, "link": DAMPER, "spring": SPRING, "k0": SPRING,
    "gain": ("", ""), "origin": ("rms motions", "rms motions"), "jitter": ("s", "s"),
}  # fmt: skip
SAME_STEP = 0.01  # relative difference of steps that are the same
NOTICED = 0.1  # of the noise: a step below is a way to write numbers


def diagnose(
    device: Device,
    experiments: Sequence[Experiment],
    validate: Sequence[Experiment] | None = None,
    say: Say = lambda _: None,
) -> Diagnosis:
    """Say why recordings differ from the simulation of a device.

    validate: recordings to judge by; without them the last 30 % of each recording are kept for it
    and opened once, at the end: to judge, and where a force of no name is left in them, to name it,
    which a fault then says. Raises ExperimentError or ValueError with one sentence.
    """
    swing = max(e.swing for e in experiments)  # one origin for all
    experiments = [replace(e, swing=swing) for e in experiments]
    validate = None if validate is None else [replace(e, swing=swing) for e in validate]
    experiments, folded = _folded_out(device, experiments)
    validate = None if validate is None else _folded_out(device, validate)[0]
    faults = examine(device, experiments)
    acted, notes = _as_they_acted(device, corrected(experiments, faults))
    faults = (*faults, *notes)
    for fault in faults:
        say(fault.sentence)
    if validate is None:
        fit_on, judge_by = zip(*(e.split() for e in acted), strict=True)
    else:
        fit_on, judge_by = (
            tuple(acted),
            tuple(_as_they_acted(device, corrected(validate, faults))[0]),
        )
    say("refitting the linear parameters, then trying every effect")
    found = search(device, fit_on, say)
    left, other = left_over(found, acted), instead_of(found)
    by = found
    if validate is None and _named_only_whole(found, left, other):
        found, left, note = second_look(device, found, left, acted, say)
        if note is not None:
            by, faults = on_first_part(found), (*faults, note)
    say("locating")
    located = locate(found.problem, found.refit)
    final_device = found.final.model.build(found.final.x)
    say("held-out data")
    one, free = held_out(device, by, judge_by)
    findings = _findings(found)
    steps = _encoder(device, found, acted, faults)
    if steps is not None:
        findings = (*findings, steps)
        step = make_physics("encoder_step", "sensor", step=steps.parameters["step"].value)
        final_device = final_device.with_physics(step)
    if folded > 1.0:
        # n samples whose deviation is a factor larger without it
        sigma = float(np.sqrt(2.0 * sum(e.ticks for e in fit_on) * np.log(folded)))
        findings = (Finding("rectified_sensor", "sensor", {}, sigma, ()), *findings)  # found first
        final_device = final_device.with_physics(make_physics("rectified_sensor", "sensor"))
    refit = _linear(device, found.final, acted)
    bounds = {} if findings else _upper_bounds(found)
    verdict, sentence = judged(found, findings, refit, left, other)
    wrong = [f for f in faults if f.wrong]
    if wrong:
        verdict, sentence = (
            Verdict.RECORDING_FAULT,
            f"{wrong[0].sentence}; with that corrected, {sentence}",
        )
    facts = {
        "chi2_per_sample": {"refit": found.refit.chi2 / found.refit.samples,
                            "final": found.final.chi2 / found.final.samples},
        "samples": found.final.samples,
        "left_chi2": left.gained,
        "explained_chi2": found.refit.chi2 - found.final.chi2,
        "comparisons": sum(len(s.trials) for s in found.steps),
    }  # fmt: skip
    shape = (-1, len(acted[0].outputs))
    residuals = Residuals(
        acted[0].period, found.refit.white.reshape(shape), found.final.white.reshape(shape)
    )
    return Diagnosis(
        verdict, sentence, findings, refit, located, one, free, bounds, faults, final_device,
        residuals, found, tuple(acted), found.interrupted, facts,
    )  # fmt: skip


def _named_only_whole(found: Searched, left: Left, other: Instead | None) -> bool:
    """Whether a search of all that was recorded may name what the first part of it does not."""
    unnamed = left.whole and matters(found, left, bool(found.final.model.effects))
    return unnamed and other is None and not found.interrupted


def second_look(
    device: Device, found: Searched, left: Left, acted: Sequence[Experiment], say: Say
) -> tuple[Searched, Left, Fault | None]:
    """Search all that was recorded, where a force is seen there that has no name in the first part.

    A command may meet its limit in the last seconds only. What has a name then was named with the
    data that were to judge it, which the note says. What was found before is returned, without a
    note, where nothing new has a name, something is still left, a name is lost, or it was
    interrupted, which it then says.
    """
    say("a force of no name is left in all that was recorded: all of it is searched")
    try:
        again = search(device, acted, say)
    except (ValueError, KeyboardInterrupt) as end:
        return replace(found, interrupted=isinstance(end, KeyboardInterrupt)), left, None
    if again.interrupted:
        return replace(found, interrupted=True), left, None
    known, labels = (effect_labels(s.final.model.effects) for s in (found, again))

    def akin(one: str, others: Sequence[str]) -> bool:
        within = [o for o in others if one in _containing(o, device.rotary)]
        return one in others or bool(within) or bool({*others} & {*_containing(one, device.rotary)})

    new = [label for label in labels if not akin(label, known)]
    if not new or not all(akin(label, labels) for label in known):
        return found, left, None
    beyond = left_over(again, acted)
    if matters(again, beyond, named=True) or instead_of(again) is not None:
        return found, left, None
    names = " and ".join(label.replace("@", " at ") for label in new)
    sentence = (
        f"{names} could be named only with the held-out data, which therefore do not judge it;"
        " give a second recording by --validate"
    )
    return again, beyond, Fault("held_out_used", sentence, False, float(len(new)))


def on_first_part(found: Searched) -> Searched:
    """The same models fitted to the first part, as far as that determines them."""
    parts = [e.split()[0] for e in found.problem.experiments]
    there = Problem(parts, found.problem.observer, FINAL)
    refit, final = (there.fit(f.model, f.x) for f in (found.refit, found.final))
    return replace(found, problem=there, refit=refit, final=final)


def _folded_out(
    device: Device, experiments: Sequence[Experiment]
) -> tuple[list[Experiment], float]:
    """Fold out what a sensor reported as absolute values; by which factor that is better, or 1."""
    if any(p.effect.name == "rectified_sensor" for p in device.physics):
        return list(experiments), 1.0
    tried = [unfolded(device, e) for e in experiments]
    kept = [e if t is None else t.experiment for e, t in zip(experiments, tried, strict=True)]
    return kept, max((t.factor for t in tried if t is not None), default=1.0)


def separating(found: Diagnosis, out: Path) -> NextExperiment | None:
    """Choose and write the excitation that tells the first doubtful finding from its nearest rival.

    None where nothing is doubtful, or no excitation of the library tells them apart.
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
        trials = [t for s in searched.steps for t in s.trials if t.label == label]
        if not trials:
            continue
        a = _as_fitted(own, final)
        b = _as_fitted(label, max(trials, key=lambda t: t.gained).fitted)
        observer = searched.problem.observer
        return next_experiment(kept.acting(x), a, b, found.experiments, observer, out)
    return None


def _as_fitted(label: str, fitted: Fitted) -> Physics:
    """An effect of a model with its fitted values."""
    index = [place_label(p) for p in fitted.model.effects].index(label)
    values = dict(fitted.model.effects[index].values)
    for p, x in zip(fitted.model.parameters, fitted.x, strict=True):
        if p.kind == "effect" and p.index == index:
            values[p.key] += p.scale * float(x)
    return replace(fitted.model.effects[index], values=values)


def _as_they_acted(
    device: Device, experiments: Sequence[Experiment]
) -> tuple[list[Experiment], list[Fault]]:
    """Take a command as smooth between samples where that explains the motion much better."""
    acted: list[Experiment] = []
    notes: list[Fault] = []
    for e in experiments:
        factor = was_smooth(device, e)
        acted.append(e if factor is None else smooth(e))
        if factor is not None:
            sentence = (
                f"the command of {e.name} explains the motion {factor:.3g} times better as a signal"
                " that is smooth between its samples than as one that is held, and is taken so"
            )
            notes.append(Fault("smooth_command", sentence, False, factor))
    return acted, notes


def _findings(found: Searched) -> tuple[Finding, ...]:
    final = found.final
    spread = np.sqrt(np.diag(covariance(final)))
    parameters = final.model.parameters
    findings: list[Finding] = []
    named = effect_labels(final.model.effects)
    for i, physics in enumerate(final.model.effects):
        label = place_label(physics)
        estimates: dict[str, Estimate] = {}
        for j, p in enumerate(parameters):
            if p.kind == "effect" and p.index == i:
                value = physics.values[p.key] + p.scale * float(final.x[j])
                half = Z95 * p.scale * float(spread[j])
                unit = physics.effect.parameter(p.key).unit_for(final.model.nominal.rotary)
                estimates[p.key] = Estimate(value, value - half, value + half, unit)
        if physics.effect.name in STEPPED:
            estimates |= _step_estimate(found, physics)
        without = fit_without(found.problem, final, i)
        wide = inflation(final.white)
        sigma = float(np.sqrt(max(0.0, without.chi2 - final.chi2) / wide))
        others = rivals_of(label, found.steps, wide, final.model.nominal.rotary)
        rivals = tuple(r for r in others if f"{r.effect}@{r.at}" not in named)
        findings.append(Finding(physics.effect.name, physics.at, estimates, sigma, rivals))
    return tuple(findings)


def _encoder(
    device: Device, found: Searched, acted: Sequence[Experiment], faults: Sequence[Fault]
) -> Finding | None:
    """The encoder's step that the samples themselves show, where the device does not know it.

    Values that were not counted would all lie within `ON_LATTICE` of a lattice with the odds of
    (2 ON_LATTICE)^n: that gives the sigma. A step far below the noise is no matter of physics.
    """
    position = next((o for o in acted[0].outputs if o.quantity == "position"), None)
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


def rivals_of(label: str, steps: Sequence[Step], wide: float, rotary: bool) -> tuple[Rival, ...]:
    """The other trials of the step that took an effect, by how much worse they were.

    What contains the effect there explains no less, fitted to its end, whether it was tried or not;
    and what contains a near rival is as near.
    """
    richer = set(_containing(label, rotary))
    behind = dict.fromkeys(sorted(richer), 0.0)
    for step in reversed(steps):  # the last one saw what else is missing
        if step.taken is not None and step.taken.label == label:
            for t in step.trials:
                if t.label not in (label, *richer):
                    gap = max(0.0, step.taken.worth - t.worth)
                    behind[t.label] = float(np.sqrt(gap / wide))
            break
    for near, sigma in [pair for pair in behind.items() if pair[1] < NEAR]:
        for name in _containing(near, rotary):
            if name != label:
                behind[name] = min(sigma, behind.get(name, sigma))
    ordered = sorted(behind.items(), key=lambda pair: pair[1])
    return tuple(_rival(name, sigma) for name, sigma in ordered)


def _containing(label: str, rotary: bool) -> Iterator[str]:
    """The effects that contain one, where it is."""
    name, at = label.split("@")
    for richer in CONTAINED.get(name, ()):
        effect = effect_named(richer)
        for place in effect.places:
            if acts_on(place) == at and (rotary or not effect.rotary_only):
                yield f"{richer}@{place}"


def _rival(label: str, sigma: float) -> Rival:
    effect, at = label.split("@")
    return Rival(effect, at, sigma)


def _linear(
    device: Device, final: Fitted, experiments: Sequence[Experiment]
) -> dict[str, tuple[float, Estimate]]:
    nominal = values_of(Model(device), np.zeros(len(linear_parameters(device))))
    fitted = values_of(final.model, final.x)
    spread = np.sqrt(np.diag(covariance(final)))
    result: dict[str, tuple[float, Estimate]] = {}
    for j, p in enumerate(linear_parameters(device)):
        if p.kind == "jitter" and all(first_velocity(e) is None for e in experiments):
            continue
        value, error = fitted[p.name], Z95 * p.scale * float(spread[j])
        half = error if p.kind in ("damper", "link", "origin", "jitter") else abs(value) * error
        unit = UNITS[p.kind][0 if device.rotary else 1]
        result[p.name] = (nominal[p.name], Estimate(value, value - half, value + half, unit))
    return result


def _upper_bounds(found: Searched) -> dict[str, dict[str, float]]:
    """The magnitude of each effect that the recording would have shown: best fit and 1.96 sigma."""
    problem, fitted = found.problem, found.final
    built = fitted.model.build(fitted.x)
    off = Complement(fitted.jacobian)
    base = off(fitted.residual)
    wide = np.sqrt(inflation(fitted.white))
    bounds: dict[str, dict[str, float]] = {}
    for one in screen(problem, fitted, candidates(built, problem.experiments)):
        names = MAGNITUDE.get(one.start.physics.effect.name)
        size = float(np.linalg.norm(one.signature))
        if names is None or size == 0.0:
            continue
        best = max(0.0, -float(base @ one.signature) / size**2)
        factor = best + Z95 * float(wide) / size
        name = names[0]
        bounds[one.start.label] = {name: abs(one.start.physics.values[name]) * factor}
    return bounds
