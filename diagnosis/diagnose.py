"""The pipeline from gate to verdict, in the order of docs/diagnosis.md."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest

from zwidth.diagnosis.answer.adequacy import Adequacy, adequacy
from zwidth.diagnosis.augmented import all_smooth, augmented
from zwidth.diagnosis.candidates import candidates
from zwidth.diagnosis.experiment import Experiment, ExperimentError
from zwidth.diagnosis.fit import Fitted, Problem
from zwidth.diagnosis.gate import ON_LATTICE, Fault
from zwidth.diagnosis.held_out import held_out
from zwidth.diagnosis.intake import Taken, not_diagnosed, take_in
from zwidth.diagnosis.lattice import chances_seen, step_interval
from zwidth.diagnosis.locate import NOWHERE, locate
from zwidth.diagnosis.mishaps import Mishaps, attempt, collecting, debugging, isolated
from zwidth.diagnosis.next_experiment import NextExperiment, next_experiment
from zwidth.diagnosis.parameters import (
    Model,
    effect_labels,
    first_velocity,
    linear_parameters,
    values_of,
)
from zwidth.diagnosis.predictor import FINAL
from zwidth.diagnosis.removal import fit_without
from zwidth.diagnosis.result import (
    NEAR,
    UNKNOWN_FIT,
    Diagnosis,
    Estimate,
    Finding,
    Residuals,
    Rival,
    Verdict,
)
from zwidth.diagnosis.screen import Complement, screen
from zwidth.diagnosis.search import Searched, search
from zwidth.diagnosis.selection.effort import Effort
from zwidth.diagnosis.selection.searched import probability, rivals, searched, unnamed, without
from zwidth.diagnosis.steady import NoObserver
from zwidth.diagnosis.trials import Say, Step
from zwidth.diagnosis.uncertainty import Z95, covariance, inflation
from zwidth.diagnosis.unknown import Instead
from zwidth.diagnosis.verdict import Left, instead_of, judged, left_over, matters
from zwidth.sim.device import Device, place_label
from zwidth.sim.physics import richer_at
from zwidth.sim.physics.effect import Physics
from zwidth.sim.place import label_of, of_label

Floats = NDArray[np.float64]
DAMPER, SPRING = ("N m s/rad", "N s/m"), ("N m/rad", "N/m")
UNITS = {
    "mass": ("kg m2", "kg"), "damper": DAMPER, "link": DAMPER, "spring": SPRING, "k0": SPRING,
    "gain": ("", ""), "origin": ("rms motions", "rms motions"), "jitter": ("s", "s"),
}  # fmt: skip
# Stages without which no verdict stands, and what an error in them takes from it.
WHAT_IS_LOST = {
    "search": "a part of the search",
    "detect": "whether anything is left",
    "separation": "how well it can be told apart",
    "held out": "what the held-out data say",
}
DECISIVE = tuple(WHAT_IS_LOST)
SAME_STEP = 0.01  # relative difference of steps that are the same
NOTICED = 0.1  # of the noise: a step below is a way to write numbers


def diagnose(
    device: Device,
    experiments: Sequence[Experiment],
    validate: Sequence[Experiment] | None = None,
    say: Say = lambda _: None,
    effort: Effort | None = None,
) -> Diagnosis:
    """Say why recordings differ from the simulation of a device.

    validate: recordings to judge by; without them the last 30 % of each recording are kept for it
    and opened once, at the end: to judge, and where a force of no name is left in them, to name it,
    which a fault then says. An unexpected error costs what it concerns alone (`Diagnosis.errors`).
    effort: how much the search of whole hypotheses may try, None for the search of single steps.
    Raises ExperimentError with one sentence where the recordings are no use with this device, and
    NotDiagnosed where an error leaves nothing to say.
    """
    with collecting(say) as mishaps:
        taken = take_in(device, experiments, validate)
        for fault in taken.faults:
            say(fault.sentence)
        say("refitting the linear parameters, then trying every effect")
        try:
            found = _searched(device, taken.fit_on, say, effort)
        except NoObserver as error:
            raise ExperimentError(str(error)) from error
        except Exception as error:
            if debugging():
                raise
            raise not_diagnosed("refit", error, taken.faults) from error
        return _answered(device, taken, found, mishaps, say, effort)


def _searched(
    device: Device, experiments: Sequence[Experiment], say: Say, effort: Effort | None
) -> Searched:
    if effort is None:
        return search(device, experiments, say)
    return searched(device, experiments, say, effort)


def _answered(
    device: Device,
    taken: Taken,
    found: Searched,
    mishaps: Mishaps,
    say: Say,
    effort: Effort | None,
) -> Diagnosis:
    """What a search found, located, judged and with all that is to be said of it."""
    found = _standing(device, taken, found, say)
    left, other = _what_is_left(found, taken)
    by, faults = found, taken.faults
    if taken.whole_unopened and _named_only_whole(found, left, other):
        with isolated("search", "all that was recorded"):
            again, beyond, note = second_look(device, found, left, taken.whole, say, effort)
            if note is not None:
                by, faults = on_first_part(again), (*faults, note)
            found, left = again, beyond
    say("locating")
    located = attempt("locate", "", partial(locate, found.problem, found.refit)) or NOWHERE
    say("held-out data")
    judge = partial(held_out, device, by, taken.judge_by)
    one, free = attempt("held out", "", judge) or (UNKNOWN_FIT, UNKNOWN_FIT)
    sound = attempt("adequacy", "", partial(_adequacy, device, found, taken))
    findings = _all_findings(device, taken, found)
    intervals = partial(_linear, device, found.final, taken.whole)
    refit = attempt("intervals", "linear parameters", intervals) or {}
    bounds = {} if findings else attempt("limits", "", partial(_upper_bounds, found)) or {}
    augment = partial(_augmented, taken, found, findings)
    judge = sound if found.tried is not None else None
    verdict, sentence = _verdict(found, findings, refit, left, other, mishaps, judge)
    wrong = [f for f in faults if f.wrong]
    if wrong:
        said = "; ".join(f.sentence for f in wrong)
        sentence = f"{said}; with that corrected, {sentence}"
        verdict = Verdict.UNDECIDED if verdict is Verdict.UNDECIDED else Verdict.RECORDING_FAULT
    shape = (-1, len(taken.whole[0].outputs))
    residuals = Residuals(
        taken.whole[0].period, found.refit.white.reshape(shape), found.final.white.reshape(shape)
    )
    return Diagnosis(
        verdict, sentence, findings, refit, located, one, free, bounds, faults,
        attempt("augmented device", "", augment) or device,
        residuals, found, taken.whole, found.interrupted, _facts(found, left),
        errors=tuple(mishaps.found), left_out=taken.left_out, adequacy=sound,
    )  # fmt: skip


def _standing(device: Device, taken: Taken, found: Searched, say: Say) -> Searched:
    """What was found, or nothing where its names predict held-out data no better than without."""
    if found.tried is None or not found.final.model.effects:
        return found
    sound = attempt("adequacy", "", partial(_adequacy, device, found, taken))
    if sound is None or sound.useful:
        return found
    say(f"{found.final.model.label} predicts held-out data no better than without: not named")
    return unnamed(found)


def _adequacy(device: Device, found: Searched, taken: Taken) -> Adequacy | None:
    """How the answer stands on held-out data."""
    observer = found.problem.observer
    return adequacy(Model(device), found.refit, found.final, observer, taken.judge_by)


def _what_is_left(found: Searched, taken: Taken) -> tuple[Left, Instead | None]:
    """What the final model leaves, and what of no library may stand in the place of its names."""
    left = attempt("detect", "what is left", partial(left_over, found, taken.whole))
    other: Instead | None = None
    with isolated("detect", "physics of no library in the place of what was named"):
        other = instead_of(found)
    return left or Left(0.0, ""), other


def _all_findings(device: Device, taken: Taken, found: Searched) -> tuple[Finding, ...]:
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


def _augmented(taken: Taken, found: Searched, findings: Sequence[Finding]) -> Device:
    """The device with refitted parameters, with all that was found and how recordings are read."""
    model = found.final.model
    steps = [f for f in findings if f.effect == "encoder_step" and not model.has(f.effect)]
    return augmented(
        model, found.final.x, taken.whole[0].swing,
        smooth=all_smooth(taken.faults, taken.whole),
        folded=any(f.effect == "rectified_sensor" for f in findings),
        encoder_step=max((f.parameters["step"].value for f in steps), default=0.0),
    )  # fmt: skip


def _verdict(
    found: Searched,
    findings: tuple[Finding, ...],
    refit: dict[str, tuple[float, Estimate]],
    left: Left,
    other: Instead | None,
    mishaps: Mishaps,
    sound: Adequacy | None = None,
) -> tuple[Verdict, str]:
    """As `judged`; undecided where an error took what the verdict rests on, which it then says."""
    verdict, sentence = judged(found, findings, refit, left, other, sound)
    if mishaps.of(*DECISIVE):
        verdict = Verdict.UNDECIDED
        lost = " and ".join(dict.fromkeys(WHAT_IS_LOST[m.stage] for m in mishaps.of(*DECISIVE)))
        sentence = f"an error left out {lost}; from what was done, {sentence}"
    untried = list(dict.fromkeys(m.what.replace("@", " at ") for m in mishaps.of("candidates")))
    if untried:
        sentence += f"; {', '.join(untried)} could not be tried"
    return verdict, sentence


def _facts(found: Searched, left: Left) -> dict[str, Any]:
    return {
        "chi2_per_sample": {"refit": found.refit.chi2 / found.refit.samples,
                            "final": found.final.chi2 / found.final.samples},
        "samples": found.final.samples,
        "left_chi2": left.gained,
        "explained_chi2": found.refit.chi2 - found.final.chi2,
        "comparisons": _comparisons(found),
    }  # fmt: skip


def _comparisons(found: Searched) -> int:
    if found.tried is not None:
        return found.tried.fits
    return sum(len(s.trials) for s in found.steps)


def _named_only_whole(found: Searched, left: Left, other: Instead | None) -> bool:
    """Whether a search of all that was recorded may name what the first part of it does not."""
    unnamed = left.whole and matters(found, left, bool(found.final.model.effects))
    return unnamed and other is None and not found.interrupted


def second_look(
    device: Device,
    found: Searched,
    left: Left,
    acted: Sequence[Experiment],
    say: Say,
    effort: Effort | None = None,
) -> tuple[Searched, Left, Fault | None]:
    """Search all that was recorded, where a force is seen there that has no name in the first part.

    A command may meet its limit in the last seconds only. What has a name then was named with the
    data that were to judge it, which the note says. What was found before is returned, without a
    note, where nothing new has a name, something is still left, a name is lost, or it was
    interrupted, which it then says.
    """
    say("a force of no name is left in all that was recorded: all of it is searched")
    try:
        again = _searched(device, acted, say, effort)
    except NoObserver:
        return found, left, None
    except KeyboardInterrupt:
        return replace(found, interrupted=True), left, None
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
        other = _with_rival(searched, own, label)
        if other is None:
            continue
        a, b = _as_fitted(own, final), _as_fitted(label, other)
        observer = searched.problem.observer
        return next_experiment(kept.acting(x), a, b, found.experiments, observer, out)
    return None


def _with_rival(searched: Searched, own: str, label: str) -> Fitted | None:
    """A fit with a rival in the place of an effect, or of it at all."""
    if searched.tried is not None:
        kept = searched.tried.tried
        wanted = searched.tried.best.labels - {own} | {label}
        found = kept.get(wanted)
        return None if found is None else found.fitted
    trials = [t for s in searched.steps for t in s.trials if t.label == label]
    return max(trials, key=lambda t: t.gained).fitted if trials else None


def _as_fitted(label: str, fitted: Fitted) -> Physics:
    """An effect of a model with its fitted values."""
    every = fitted.model.effects_at(fitted.x)
    return next(p for p in every if place_label(p) == label)


def _findings(found: Searched) -> tuple[Finding, ...]:
    spread = attempt("intervals", "", partial(_spread, found.final))
    if spread is None:
        spread = np.full(found.final.x.size, np.nan)
    findings: list[Finding] = []
    labels = effect_labels(found.final.model.effects)
    for i, physics in enumerate(found.final.model.effects):
        name = f"{physics.effect.name} at {physics.at}"
        estimates = _estimates(found.final, i, spread)
        if physics.effect.sought == "lattice":
            step = partial(_step_estimate, found, physics)
            estimates |= attempt("intervals", name, step) or {}
        apart = attempt("separation", name, partial(_separated, found, i))
        sigma, near = (np.nan, ()) if apart is None else apart
        chance = None
        if found.tried is not None:
            chance = attempt("separation", name, partial(probability, found.tried, labels[i]))
        findings.append(Finding(physics.effect.name, physics.at, estimates, sigma, near, chance))
    return tuple(findings)


def _spread(final: Fitted) -> Floats:
    """Standard errors in x."""
    return np.sqrt(np.diag(covariance(final)))


def _estimates(final: Fitted, index: int, spread: Floats) -> dict[str, Estimate]:
    """Values of an effect of the model with their intervals."""
    physics = final.model.effects[index]
    estimates: dict[str, Estimate] = {}
    for j, p in enumerate(final.model.parameters):
        if p.kind == "effect" and p.index == index:
            value = physics.values[p.key] + p.scale * float(final.x[j])
            half = Z95 * p.scale * float(spread[j])
            unit = physics.effect.parameter(p.key).unit_for(final.model.nominal.rotary)
            estimates[p.key] = Estimate(value, value - half, value + half, unit)
    return estimates


def _separated(found: Searched, index: int) -> tuple[float, tuple[Rival, ...]]:
    """At how many sigma an effect stands above doing without it, and its rivals."""
    final = found.final
    named = effect_labels(final.model.effects)
    if found.tried is not None:
        return without(found.tried, named[index]), rivals(found.tried, named[index])
    bare = fit_without(found.problem, final, index)
    wide = inflation(final.white)
    sigma = float(np.sqrt(max(0.0, bare.chi2 - final.chi2) / wide))
    others = rivals_of(named[index], found.steps, wide, final.model.nominal.rotary)
    return sigma, tuple(r for r in others if f"{r.effect}@{r.at}" not in named)


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
    for effect, place in richer_at(*of_label(label), rotary):
        yield label_of(effect.name, place)


def _rival(label: str, sigma: float) -> Rival:
    effect, place = of_label(label)
    return Rival(effect, str(place), sigma)


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
    for one in screen(problem, fitted, candidates(built, problem.experiments), "limits"):
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
