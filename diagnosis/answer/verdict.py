"""What a diagnosis says in the end: what the final model leaves, and the verdict in a sentence."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from zwidth.diagnosis.answer.adequacy import Adequacy, wander
from zwidth.diagnosis.answer.inverse import ForceError
from zwidth.diagnosis.answer.result import UNKNOWN_FIT, Estimate, Finding, Held, HeldOut, Verdict
from zwidth.diagnosis.answer.whole_run import WholeRun
from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.fitting.uncertainty import Z95, inflation
from zwidth.diagnosis.forces.leftover import leftover
from zwidth.diagnosis.forces.locate import locate
from zwidth.diagnosis.forces.probes import instead_by_law
from zwidth.diagnosis.forces.unknown import TOUCHED, Instead, instead, unknown
from zwidth.diagnosis.model.parameters import BENT, FACTORED, Parameter
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import EDGE
from zwidth.diagnosis.selection.searched import Searched
from zwidth.sim.predict import OVERFLOW
from zwidth.sim.readable import most, of_the_motion, percent

SHIFTED = 5.0  # sigma by which a linear parameter must differ to be a finding
MAPPED = 60.0  # chi-square that a map of the missing force over one state must gain
FREE_FORCE = 60.0  # -2 log likelihood that a force of free shape must gain besides its unknowns
UNEXPLAINED = 0.01  # share of the chi-square explained that may be left under a verdict by name
COLOURED = 0.05  # the same where the observer was asked for, and chi-square is no statistic
SURE = 0.95  # probability of a name or a richer form of it, below which it is not promised
# Times the error of the refit, above which an answer is none: of the force that the recorded motion
# needs, and of whole runs, which drift. On eight machines' pages answers have 0.2 to 0.6.
WORSE_FORCE, WORSE_RUN = 1.05, 1.5
LISTED = 4  # rivals in the verdict's sentence, the nearest; the others stand in the report


@dataclass(frozen=True)
class Left:
    """What the final model leaves: chi-square that an unknown force would gain, 0 for chance.

    whole: in all that was recorded, and not where it was fitted.
    """

    gained: float
    sentence: str
    whole: bool = False


def left_over(found: Searched, acted: Sequence[Experiment]) -> Left:
    """Hold the final residual against forces that follow one state, and that repeat or sway.

    Then all that was recorded, held-out data too, against forces of free shape under observers that
    hide none: nothing of that is kept, and a stop may first be hit in what was held out.
    """
    wide = inflation(found.final.white)
    located = locate(found.problem, found.final)
    followed = [m for m in located.maps if m.against != "time" or m.gained > TOUCHED * wide]
    top = max(followed, key=lambda m: m.gained, default=None)
    line = leftover(found.problem, found.final)
    rotary = found.final.model.nominal.rotary
    if line.gained > max(line.chance * wide, 0.0 if top is None else top.gained):
        return Left(line.gained, line.sentence(rotary))
    if top is not None and top.gained > MAPPED * wide:
        return Left(top.gained, located.sentence)
    try:
        free = unknown(acted, found.final)
    except NoObserver:  # no observer follows what was held out
        return Left(0.0, "")
    if free is not None and free.gained > FREE_FORCE * wide + 1.5 * free.unknowns:
        return Left(free.gained, free.sentence, True)
    return Left(0.0, "")


def instead_of(found: Searched) -> Instead | None:
    """Return a force of no library that explains more than one of the effects, or all of them."""
    if found.problem.observer.whitening is None:  # free runs judged, and likelihood is no judge
        return None
    final, effects = found.final, found.final.model.effects
    experiments = found.problem.experiments
    names = [f"{p.effect.name} at {p.at}" for p in effects]
    models = [(name, found.problem.fit_without(final, i)) for i, name in enumerate(names)]
    if len(effects) > 1:
        models.append((" and ".join(names), found.refit))
    asked = [
        instead(found.problem, final, without, experiments, name)
        for name, without in models
        if without.x.size < final.x.size
    ]
    asked.append(instead_by_law(found.problem, final))
    return max((a for a in asked if a is not None), key=lambda a: a.gained, default=None)


def matters(found: Searched, left: Left, named: bool) -> bool:
    """Whether what is left is too much for a verdict by name, or there is no name."""
    explained = max(found.refit.chi2 - found.final.chi2, 1.0)
    share = COLOURED if found.problem.observer.whitening is None else UNEXPLAINED
    return left.gained > 0.0 and (not named or left.gained > share * explained)


def unexplained(found: Searched, left: Left, other: Instead | None, sound: Adequacy | None) -> bool:
    """Whether what is named does not explain the recordings, or not as far as free runs go."""
    named = bool(found.final.model.effects)
    fails = sound is not None and not (sound.adequate if named else sound.sound)
    return other is not None or matters(found, left, named) or fails


def ends_badly(final: Fitted, runs: Sequence[WholeRun], forces: Sequence[ForceError]) -> str:
    """Say why a fit is no answer though it costs least, "" where nothing speaks against it.

    It ended as far from the device file as it may go; or the force that held-out motion needs, or
    else a whole run of it, is farther off than without what was found.
    """
    linear = zip(final.model.linear, final.x.tolist(), strict=False)
    far = next((p for p, x in linear if _at_its_end(p, x)), None)
    if far is not None:
        return f"the fit ends with {far.name} at the end of its allowed range"
    for told, times_most, what in (
        ([(f.errors["after"], f.errors["refit"]) for f in forces if f.held_out], WORSE_FORCE,
         "the force that the held-out motion needs"),
        ([(r.errors["after"], r.errors["refit"]) for r in runs if r.held_out], WORSE_RUN,
         "a free run over all held-out data"),
    ):  # fmt: skip
        if told and all(after > times_most * refit for after, refit in told):
            times = max(after / refit if refit else math.inf for after, refit in told)
            return f"{what} has an error {times:.3g} times as large as without it"
        if told:
            return ""
    return ""


def _at_its_end(p: Parameter, x: float) -> bool:
    """Whether a mass, a spring or the gain stands at either end, a damper at its upper one."""
    ends = ("lower", "upper") if p.kind in FACTORED else ("upper",) if p.kind in BENT else ()
    return p.at_end(x, ends, EDGE)


def judged(
    found: Searched,
    findings: tuple[Finding, ...],
    refit: dict[str, tuple[float, Estimate]],
    left: Left,
    other: Instead | None,
    sound: Adequacy | None = None,
    free: HeldOut = UNKNOWN_FIT,
    bad: str = "",
) -> tuple[Verdict, str]:
    """Return the verdict and its sentence.

    refit: name -> (nominal, estimate) of the linear parameters; other: physics of no library in the
    place of what was found, if any; sound: what held-out data say; free: free runs on them; bad: as
    `ends_badly`.
    """
    if other is not None:
        return Verdict.UNKNOWN_PHYSICS, (
            f"something is missing that no effect of the library explains: {other.sentence}"
        )
    if matters(found, left, bool(findings)):
        beyond = f" beyond {' and '.join(f.effect for f in findings)}" if findings else ""
        return Verdict.UNKNOWN_PHYSICS, (
            f"something is missing{beyond} that no effect of the library explains: {left.sentence}"
        )
    if sound is not None and not (sound.adequate if findings else sound.sound):
        return Verdict.UNKNOWN_PHYSICS, not_adequate(findings, sound)
    if findings and bad:
        names = " and ".join(f"{f.effect} at {f.at}" for f in findings)
        return Verdict.UNKNOWN_PHYSICS, f"{names} would fit best, but is not acceptable: {bad}"
    odd = next(((f, h) for f in findings for h in f.regimes if h.fails), None)
    if odd is not None:
        return Verdict.UNKNOWN_PHYSICS, not_everywhere(findings, *odd)
    if findings and wander(free.after, free.noise_floor):
        return Verdict.UNKNOWN_PHYSICS, too_disturbed(findings, free)
    if findings and sound is None:
        return Verdict.UNDECIDED, not_judged(findings)
    if findings:
        names = " and ".join(f"{f.effect} at {f.at}" for f in findings)
        many = len(findings) > 1
        confused = [f for f in findings if f.confusable_with]
        if confused:
            near = [f"{r.effect} at {r.at}" for r in confused[0].confusable_with]
            others = ", ".join(near[:LISTED])
            others += f" and {len(near) - LISTED} more" if len(near) > LISTED else ""
            return Verdict.CONFUSABLE, (
                f"{names} explain{'' if many else 's'} what is missing, and this recording cannot"
                f" tell {confused[0].effect} at {confused[0].at} from {others}"
            )
        doubtful = [f for f in findings if f.with_richer is not None and f.with_richer < SURE]
        if doubtful:
            least = min(doubtful, key=lambda f: f.with_richer or 0.0)
            return Verdict.CONFUSABLE, (
                f"{names} explain{'' if many else 's'} what is missing, but the probability of"
                f" {least.effect} at {least.at} is only {least.with_richer:.2g}"
            )
        return Verdict.IDENTIFIED, f"{names} {'are' if many else 'is'} missing from the simulation"
    if wander(free.after, free.noise_floor):
        return Verdict.UNDECIDED, told_from_chance(free)
    moved = [
        name
        for name, (nominal, e) in refit.items()
        if abs(e.value - nominal) > SHIFTED / Z95 * 0.5 * (e.upper - e.lower)
        and name not in ("jitter", "skew")
        and not name.startswith("zero_")
    ]
    if moved:
        return Verdict.LINEAR_PARAMETERS, (
            f"no physics is missing, but {', '.join(moved)} differ from the device file"
        )
    return Verdict.NOTHING_MISSING, "nothing is missing that this recording could show"


def told_from_chance(free: HeldOut) -> str:
    """Say of a recording that nothing was found in how much of its motion nothing explains."""
    return (
        "no effect of the library is significant, but free runs on held-out data have an error"
        f" of {of_the_motion(free.after)}, where measurement noise alone would cause"
        f" {percent(free.noise_floor)}: disturbances, or physics that this recording is too"
        " short or too coarse to show; record for longer, at a higher level, or with a finer sensor"
    )


def not_judged(findings: tuple[Finding, ...]) -> str:
    """Say of names that no held-out data judge what to record."""
    names = " and ".join(f"{f.effect} at {f.at}" for f in findings)
    return (
        f"{names} would explain what is missing, and too little was held out to judge by: record"
        " for longer, or give a second recording by --validate"
    )


def too_disturbed(findings: tuple[Finding, ...], free: HeldOut) -> str:
    """Say of names beside which chance disturbances do too much how much that is."""
    names = " and ".join(f"{f.effect} at {f.at}" for f in findings)
    return (
        f"something is missing beyond {names}: free runs on held-out data still have an"
        f" error of {of_the_motion(free.after)}, which only random disturbances explain"
        f" ({percent(free.refit)} without these effects)"
    )


def not_everywhere(findings: tuple[Finding, ...], odd: Finding, where: Held) -> str:
    """Say of a name that holds in one regime only where it does not, and what to record."""
    names = " and ".join(f"{f.effect} at {f.at}" for f in findings)
    return (
        f"something is missing beyond {names}: {odd.effect} at {odd.at} as fitted {where.other}"
        f" explains what was recorded {where.regime} worse than no such effect; record more"
        f" {where.regime}"
    )


def not_adequate(findings: tuple[Finding, ...], sound: Adequacy) -> str:
    """Say of names that do not hold on held-out data how far they go."""
    names = " and ".join(f"{f.effect} at {f.at}" for f in findings)
    beyond = f" beyond {names}" if findings else " that no effect of the library explains"
    share = f"; these effects explain {most(sound.explained)} of the squared error"
    share = share if findings else ""
    if sound.sound:
        return f"{names} predict held-out data no better than the refitted device without them"
    worst = max(sound.ahead, key=lambda a: a.error / a.most)
    if worst.error <= worst.most:
        led = max(sound.ahead, key=lambda a: a.led - a.most_led)
        return (
            f"something is missing{beyond}: forces that depend on the motion would explain"
            f" {100.0 * led.led:.0f} % of the squared error of free runs over {led.horizon:.3g} s"
            f" on held-out data, noise {100.0 * led.most_led:.0f} % at most{share}"
        )
    if worst.error >= OVERFLOW:
        return f"something is missing{beyond}: free runs with the answer diverge{share}"
    return (
        f"something is missing{beyond}: the error of free runs over {worst.horizon:.3g} s on"
        f" held-out data is {worst.error / worst.expected:.3g} times what its own noise would"
        f" cause{share}"
    )
