"""The pipeline: gate, predict, refit, detect, locate, candidates, rank, tell apart, verdict, show."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from diagnosis.candidates import MAGNITUDE, candidates
from diagnosis.experiment import Experiment
from diagnosis.fit import Fitted, Problem
from diagnosis.gate import Fault, examine
from diagnosis.locate import locate
from diagnosis.parameters import Model, linear_parameters, values_of
from diagnosis.predictor import (
    SETTLING,
    choose_observer,
    free_run_errors,
    innovations,
)
from diagnosis.result import Diagnosis, Estimate, Finding, HeldOut, Rival, Verdict
from diagnosis.screen import Complement, screen
from diagnosis.search import THRESHOLD, Say, Searched, Step, inflation, search
from sim.device import Device, place_label

Floats = NDArray[np.float64]
Z95 = 1.959963984540054
FREE_RUN_S = 0.5
SHIFTED = 5.0  # sigma by which a linear parameter must differ to be a finding
UNEXPLAINED = 0.35  # share of chi-square excess that may remain under an identified verdict


def diagnose(
    device: Device,
    experiments: Sequence[Experiment],
    validate: Sequence[Experiment] | None = None,
    say: Say = lambda _: None,
) -> Diagnosis:
    """Say why recordings differ from the simulation of a device.

    validate: recordings to judge by; without them the last 30 % of each recording are kept for it
    and opened once, at the end. Raises ExperimentError or ValueError with one sentence.
    """
    faults = tuple(examine(device, experiments))
    blocking = [f for f in faults if f.blocking]
    if blocking:
        return _faulty(device, faults, blocking)
    if validate is None:
        fit_on, judge_by = zip(*(e.split() for e in experiments), strict=True)
    else:
        fit_on, judge_by = tuple(experiments), tuple(validate)
    say("refitting the linear parameters, then trying every effect")
    found = search(device, fit_on, say)
    say("locating")
    located = locate(found.problem, found.refit)
    final_device, gain = found.final.model.build(found.final.x)
    say("held-out data")
    one, free = _held_out(device, found, judge_by)
    findings = _findings(found)
    refit = _linear(device, found.final)
    bounds = {} if findings else _upper_bounds(found)
    verdict, sentence = _verdict(found, findings, refit, located.sentence)
    facts = {
        "gain": gain,
        "chi2_per_sample": {"refit": found.refit.chi2 / found.refit.samples,
                            "final": found.final.chi2 / found.final.samples},
        "samples": found.final.samples,
        "comparisons": sum(len(s.trials) for s in found.steps),
    }  # fmt: skip
    return Diagnosis(
        verdict, sentence, findings, refit, located, one, free, bounds, faults, final_device, facts
    )


def _faulty(device: Device, faults: tuple[Fault, ...], blocking: list[Fault]) -> Diagnosis:
    return Diagnosis(
        Verdict.RECORDING_FAULT, blocking[0].sentence, (), {}, None, None, None, {}, faults, device
    )


def covariance(fitted: Fitted) -> Floats:
    """Return the covariance of x, (p, p), that holds for a coloured residual.

    With A = (J'J)^-1 J', x errs by A r: cov = A cov(r) A', cov(r) from the residual's spectrum by
    transforming the rows of A (a circulant approximation, good for rows much longer than the
    residual's memory).
    """
    rows = np.linalg.pinv(fitted.jacobian)
    white, prior = rows[:, : fitted.samples], rows[:, fitted.samples :]
    power = _smooth_spectrum(fitted.white)
    spectra = np.fft.rfft(white, axis=1)
    twice = np.full(spectra.shape[1], 2.0)
    twice[0] = 1.0
    coloured = np.real((np.conj(spectra) * (power * twice)) @ spectra.T) / fitted.samples
    return coloured + prior @ prior.T


def _smooth_spectrum(white: Floats) -> Floats:
    """Power spectrum of the residual, one where white with unit variance, over coarse bands."""
    from scipy.signal import welch

    frequency, power = welch(white, nperseg=min(256, white.size))
    power[0] = power[1]
    return np.interp(np.fft.rfftfreq(white.size), frequency, 0.5 * power)


def _findings(found: Searched) -> tuple[Finding, ...]:
    final = found.final
    spread = np.sqrt(np.diag(covariance(final)))
    parameters = final.model.parameters
    findings: list[Finding] = []
    for i, physics in enumerate(final.model.effects):
        label = place_label(physics)
        estimates: dict[str, Estimate] = {}
        for j, p in enumerate(parameters):
            if p.kind == "effect" and p.index == i:
                value = physics.values[p.key] + p.scale * float(final.x[j])
                half = Z95 * p.scale * float(spread[j])
                unit = physics.effect.parameter(p.key).unit_for(final.model.nominal.rotary)
                estimates[p.key] = Estimate(value, value - half, value + half, unit)
        without = found.problem.fit(
            final.model.without_effect(i),
            np.array([x for x, p in zip(final.x, parameters, strict=True)
                      if not (p.kind == "effect" and p.index == i)]),
        )  # fmt: skip
        wide = inflation(final.white)
        sigma = float(np.sqrt(max(0.0, without.chi2 - final.chi2) / wide))
        rivals = _rivals(label, found.steps, wide)
        findings.append(Finding(physics.effect.name, physics.at, estimates, sigma, rivals))
    return tuple(findings)


def _rivals(label: str, steps: Sequence[Step], wide: float) -> tuple[Rival, ...]:
    """The other trials of the step that took an effect, by how much worse they were."""
    for step in steps:
        if step.taken is not None and step.taken.label == label:
            others = [
                (t.label, float(np.sqrt(max(0.0, step.taken.gained - t.gained) / wide)))
                for t in step.trials
                if t.label != label
            ]
            others.sort(key=lambda pair: pair[1])
            return tuple(Rival(*name.split("@"), sigma) for name, sigma in others)
    return ()


def _linear(device: Device, final: Fitted) -> dict[str, tuple[float, Estimate]]:
    nominal = values_of(Model(device), np.zeros(len(linear_parameters(device))))
    fitted = values_of(final.model, final.x)
    spread = np.sqrt(np.diag(covariance(final)))
    result: dict[str, tuple[float, Estimate]] = {}
    for j, p in enumerate(linear_parameters(device)):
        value, error = fitted[p.name], Z95 * p.scale * float(spread[j])
        half = error if p.kind in ("damper", "link") else abs(value) * error
        result[p.name] = (nominal[p.name], Estimate(value, value - half, value + half))
    return result


def _held_out(
    device: Device, found: Searched, judge_by: Sequence[Experiment]
) -> tuple[HeldOut, HeldOut]:
    """Open the held-out data, once."""
    gain = found.problem.observer.gain
    models = [(device, 1.0), found.refit.model.build(found.refit.x),
              found.final.model.build(found.final.x)]  # fmt: skip
    one: list[float] = []
    free: list[float] = []
    for built, scale in models:
        errors, signals, frees, swings = [], [], [], []
        for e in judge_by:
            scaled = Experiment(e.period, scale * e.command, e.measured, e.outputs, e.name)
            errors.append(innovations(built, scaled, gain)[SETTLING:, 0])
            signals.append(e.measured[SETTLING:, 0] - e.measured[SETTLING:, 0].mean())
            run, signal = free_run_errors(built, scaled, gain, round(FREE_RUN_S / e.period))
            frees.append(run[:, 0])
            swings.append(signal[:, 0])
        one.append(_ratio(errors, signals))
        free.append(_ratio(frees, swings))
    floor = float(found.problem.observer.deviation[0]) / _rms(signals)
    noise = floor * _rms(signals) / _rms(swings)
    return HeldOut(*one, floor), HeldOut(*free, noise)


def _rms(parts: Sequence[Floats]) -> float:
    joined = np.concatenate(parts)
    return float(np.sqrt(np.mean(joined**2))) if joined.size else float("nan")


def _ratio(errors: Sequence[Floats], signals: Sequence[Floats]) -> float:
    return _rms(errors) / _rms(signals)


def _upper_bounds(found: Searched) -> dict[str, dict[str, float]]:
    """The magnitude of each effect that the recording would have shown: best fit and 1.96 sigma."""
    problem, fitted = found.problem, found.final
    built, _ = fitted.model.build(fitted.x)
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


def _verdict(
    found: Searched,
    findings: tuple[Finding, ...],
    refit: dict[str, tuple[float, Estimate]],
    where: str,
) -> tuple[Verdict, str]:
    left = locate(found.problem, found.final)
    unknown = max((m.gained for m in left.maps), default=0.0)
    explained = found.refit.chi2 - found.final.chi2
    wide = inflation(found.final.white)
    if unknown > 2.0 * THRESHOLD * wide and unknown > UNEXPLAINED * max(explained, 1.0):
        return Verdict.UNKNOWN_PHYSICS, (
            "something is missing that no effect of the library explains: " + where
        )
    if findings:
        names = " and ".join(f"{f.effect} at {f.at}" for f in findings)
        confused = [f for f in findings if f.confusable_with]
        if confused:
            others = ", ".join(f"{r.effect} at {r.at}" for r in confused[0].confusable_with)
            return Verdict.CONFUSABLE, (
                f"{names} explains what is missing, and this recording cannot tell it apart from"
                f" {others}"
            )
        return Verdict.IDENTIFIED, f"{names} is missing from the simulation"
    moved = [
        name
        for name, (nominal, e) in refit.items()
        if abs(e.value - nominal) > SHIFTED / Z95 * 0.5 * (e.upper - e.lower)
    ]
    if moved:
        return Verdict.LINEAR_PARAMETERS, (
            f"no physics is missing, but {', '.join(moved)} differ from the device file"
        )
    return Verdict.NOTHING_MISSING, "nothing is missing that this recording could show"
