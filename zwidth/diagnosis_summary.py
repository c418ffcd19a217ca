"""The first screen of a report: what is missing, how sure, its worth, and what to do now."""

import math

from zwidth.diagnosis.answer.result import Diagnosis, NextExperiment, Verdict
from zwidth.diagnosis.answer.words import an_effect, place_in_words, the_effect, unsized
from zwidth.diagnosis.settings import VERDICT
from zwidth.sim.place import place_at
from zwidth.sim.readable import most, of_the_motion, percent, plain, with_unit

ENOUGH = VERDICT.apart
LISTED = 3  # effects in a title
BETTER = 1.02  # least factor by which an error is called better or worse
SHORT = "error of short free runs on held-out data"
TITLES = {
    Verdict.NOTHING_MISSING: "This recording shows no missing physics",
    Verdict.LINEAR_PARAMETERS: "No physics is missing, but parameters differ",
    Verdict.RECORDING_FAULT: "The recording is at fault",
    Verdict.UNKNOWN_PHYSICS: "Physics is missing that is not in the library of effects",
    Verdict.UNDECIDED: "Undecided",
}
WITH = {
    Verdict.IDENTIFIED: "Missing",
    Verdict.CONFUSABLE: "Possibly missing",
    Verdict.UNKNOWN_PHYSICS: "Something that is not in the library of effects is missing besides",
    Verdict.RECORDING_FAULT: "The recording is at fault; also missing",
    Verdict.UNDECIDED: "Undecided; so far",
}


def title(found: Diagnosis) -> str:
    """The answer in a few words, without numbers: "Missing: Coulomb friction at the motor"."""
    if not found.findings or found.verdict not in WITH:
        return TITLES.get(found.verdict, found.headline)
    masses = found.device.chain.masses.size
    included = () if found.learned is None else found.learned.as_json()["absorbed"]
    names = [
        " ".join(filter(None, unsized(f.effect, f.at, masses)))
        for f in found.findings
        if f"{f.effect} at {f.at}" not in included
    ]
    if not names:
        return TITLES[Verdict.UNKNOWN_PHYSICS]
    if len(names) > LISTED:
        names[LISTED:] = [f"{len(names) - LISTED} more"]
    listed = ", ".join(names[:-1]) + (" and " if len(names) > 1 else "") + names[-1]
    colon = "" if found.verdict is Verdict.UNKNOWN_PHYSICS else ":"
    return f"{WITH[found.verdict]}{colon} {listed}"


def whereabouts(found: Diagnosis) -> str:
    """Say what the missing force depends on; "" if the found effects say it better.

    The search for that force uses the refitted device without effects.
    """
    if found.findings and found.verdict is not Verdict.UNKNOWN_PHYSICS:
        return ""
    return found.located.sentence


def how_sure(found: Diagnosis, sentence: str) -> str:
    """Say how certain the answer is, by its least certain effect. sentence: of the verdict.

    Without a full stop, like the others. Does not repeat the headline; may be "".
    """
    if found.verdict is not Verdict.IDENTIFIED or not found.findings:
        if sentence.lower() not in found.headline.lower():
            return f"{sentence}{_explained(found)}"
        unknown = found.verdict is Verdict.UNKNOWN_PHYSICS
        none = "no effect of the library explains it" if unknown and not found.findings else ""
        return (none + _explained(found)).removeprefix(". ")
    sigma = min(f.separation_sigma for f in found.findings)
    which = "the least certain effect" if len(found.findings) > 1 else "the effect"
    if not sigma < math.inf:
        return f"{sentence}: the distance from the next explanation is not known"
    fit = f"improves the fit by {sigma:.0f} sigma ({ENOUGH:.0f} are required)"
    return f"{_probable(found, which)}{which} {fit}"


def _probable(found: Diagnosis, which: str) -> str:
    """Say how probable the least probable effect is, by the figure that the verdict uses."""
    known = [(f.with_richer, f) for f in found.findings if f.with_richer is not None]
    chance, least = min(known, key=lambda pair: pair[0], default=(None, None))
    if chance is None or least is None:
        return ""
    alone = least.probability is None or most(least.probability) == most(chance)
    counted = "" if alone else f", counting richer forms of {which}"
    among = "the probability among all models tried"
    return f"{among} is {most(chance)}{counted} ({most(VERDICT.sure)} is required); "


def _explained(found: Diagnosis) -> str:
    if found.adequacy is None or not found.findings:
        return ""
    if found.verdict is not Verdict.UNKNOWN_PHYSICS:
        return ""
    share = f"{most(min(1.0, max(0.0, found.adequacy.explained)))} of the error"
    return "" if share in found.headline else f". The named effects explain {share}"


def law_errors(found: Diagnosis) -> tuple[float, float] | None:
    """Errors of short free runs with and without the learned law; None without a law."""
    learned = found.learned
    return None if learned is None else (learned.law.after, learned.names.after)


def no_better(found: Diagnosis) -> bool:
    """Whether free runs on held-out data gain nothing from the added effects, or from the refit."""
    after, before = _compared(found)
    return 0.0 < before <= BETTER * after < math.inf


def _compared(found: Diagnosis) -> tuple[float, float]:
    """Errors of short free runs with what was added to the device, and without it."""
    fit, law = found.free_run, law_errors(found)
    if law is not None:
        return law[0], fit.refit
    return (fit.after, fit.refit) if found.findings else (fit.refit, fit.before)


def worse_runs(found: Diagnosis) -> str:
    """Say which whole run got worse than with the device file (the worst one); "" for none."""
    if found.verdict is Verdict.NOTHING_MISSING:  # then nobody should use the refitted device
        return ""
    worse: list[tuple[float, str]] = []
    for run in found.whole_runs:
        errors = run.errors
        before, after = errors["before"], errors.get("law", errors["after"])
        if not after > BETTER * before:
            continue
        grown = math.inf if not before > 0.0 else after / before
        now = "without bound" if math.isinf(after) else with_unit(after, run.unit, 3)
        output = f"{run.output.replace('_', ' of ')} in {run.recording}"
        said = f"the error of the {output} is {now}, and {with_unit(before, run.unit, 3)}"
        worse.append((grown, f"over the whole run, {said} with the device file: it got worse"))
    return max(worse, default=(0.0, ""))[1]


def doubtful(found: Diagnosis) -> list[str]:
    """Reasons not to expect better simulations from the improved device, most serious first."""
    fit, after = found.free_run, _compared(found)[0]
    reasons: list[str] = []
    if after > BETTER * fit.before:
        reasons.append("its free runs on held-out data are worse than with the device file")
    elif no_better(found):
        reasons.append("its free runs on held-out data are no better")
    if worse_runs(found):
        reasons.append("over a whole run it is worse than the device file")
    return reasons


def worth(found: Diagnosis) -> str:
    """Say the error of free runs on held-out data, before and after."""
    fit, named, law = found.free_run, bool(found.findings), law_errors(found)
    after = fit.after if named else fit.refit
    if not after > 0.0 or not fit.refit > 0.0:
        return "there is too little held-out data to judge by"
    if math.isinf(after):
        return "free runs of this model diverge on held-out data; do not simulate with it"
    noise = f"; noise alone would cause {percent(fit.noise_floor)}" if fit.noise_floor > 0.0 else ""
    run = f"; {run}" if (run := worse_runs(found)) else ""
    meaning = (
        " (a free run is simulated without correction; held-out data were kept out of the fit)"
    )
    if law is not None:
        rest = f"{_off(fit.refit)} with the refit alone"
        rest += ": no better" if no_better(found) else ""
        return f"{with_law(*law)}, {rest}{noise}{meaning}{run}"
    what = "with the found effects" if named else "after the refit"
    base, reference = (fit.refit, "the refit alone") if named else (fit.before, "the device file")
    rest = f"{_off(base)} with {reference}"
    if named and math.isinf(fit.refit):
        rest = "while free runs of the refit alone diverge"
    if no_better(found):
        rest = f"no better than with {reference} ({_off(base)})"
        if named and after > BETTER * fit.before:
            rest += f", and worse than with the device file ({_off(fit.before)})"
    return f"{SHORT}: {of_the_motion(after)} {what}, {rest}{noise}{meaning}{run}"


def with_law(law: float, names: float) -> str:
    """Say what a learned law is worth: errors with it and without, over the motion."""
    return f"{SHORT}: {of_the_motion(law)} with the law that has no name, {_off(names)} without it"


def _off(share: float) -> str:
    return percent(share) if math.isfinite(share) else "without bound"


def what_now(found: Diagnosis, improved: str) -> list[str]:
    """Say what to do, most useful first. improved: the path of the improved device, "" for none."""
    steps: list[str] = []
    if found.verdict is Verdict.RECORDING_FAULT:
        steps.append(
            "correct the description of the recording as the list below says, and diagnose again"
        )
    elif found.verdict is Verdict.NOTHING_MISSING:
        steps.append("use the device as it is; the table below says how large each effect could be")
    elif found.verdict is Verdict.UNDECIDED:
        steps.append("record more, or give a second recording with --validate")
    if improved and found.verdict is not Verdict.NOTHING_MISSING:
        trust = found.verdict in (Verdict.IDENTIFIED, Verdict.LINEAR_PARAMETERS)
        use = f"use the improved device {improved}"
        use = use if trust else f"use the partly improved device {improved} with care"
        if reasons := " and ".join(doubtful(found)):
            steps.append(
                f"do not rely on the improved device {improved} yet: {reasons}; compare it with the"
                " device file on another recording before you simulate with it"
            )
        else:
            steps.append(f"{use}; every zwidth command accepts it")
    if found.next_experiment is not None:
        steps.append(next_sentence(found.next_experiment))
    if found.next_level is not None:
        steps.append(found.next_level.sentence)
    if found.verdict is Verdict.UNKNOWN_PHYSICS:
        steps.append(
            "look at where the missing force acts, below; check the unit and the channel of each"
            " column; then search with --effort thorough, add a mass to the device file, or write"
            " the physics that you suspect as an effect of your own"
        )
    planned = found.next_experiment is not None or found.next_level is not None
    return steps if planned else [*steps, *filter(None, [_record(found)])]


def _record(found: Diagnosis) -> str:
    """Say what to record next where no experiment was planned, or why nothing; "" if it is said."""
    masses = found.device.chain.masses.size
    if found.verdict is Verdict.IDENTIFIED:
        return (
            "nothing more has to be recorded; to test the answer, record at another level or speed"
            " and diagnose this with the improved device"
        )
    if found.verdict is Verdict.UNKNOWN_PHYSICS:
        return (
            "no next recording is proposed: one is proposed only to tell two effects of the"
            " library apart"
        )
    if found.verdict is not Verdict.CONFUSABLE:
        return ""
    for f in found.findings:
        if f.confusable_with:
            near = f.confusable_with[0]
            other = f"{an_effect(near.effect)} {place_in_words(place_at(near.at), masses)}"
            return (
                f"no excitation was found that tells {the_effect(f.effect)} from {other}: measure"
                " one of the two directly, or record at another level and speed and diagnose both"
                " recordings together"
            )
    known = [f for f in found.findings if f.with_richer is not None]
    least = min(known, key=lambda f: f.with_richer or 0.0, default=None)
    if least is not None and (least.with_richer or 0.0) < VERDICT.sure:
        return (
            f"no single rival makes {the_effect(least.effect)} doubtful, so no experiment is"
            " planned: record for longer, or at another level, and diagnose both recordings"
            " together"
        )
    if found.events:
        return (
            "record again without touching the device, and diagnose the new recording: it must show"
            " no contacts"
        )
    return (
        "no experiment is planned to tell an effect from a law outside the library: record at"
        " another level and speed, and diagnose both recordings together"
    )


def next_sentence(planned: NextExperiment | None) -> str:
    """Say what to record next, and whether that would decide; "" if nothing is in doubt."""
    if planned is None:
        return ""
    a, b = map(_label_in_words, planned.separates)
    sigma = f"{planned.separation_sigma:.3g} sigma"
    words = planned.excitation.replace("_", " ")
    if planned.separation_sigma >= ENOUGH:
        return (
            f'to tell {a} from {b}, record the excitation "{words}": it separates them by {sigma}'
            f" ({plain(ENOUGH, 1)} are enough); {planned.scenario.name} plays it"
        )
    return (
        f"none of the excitations that were tried can tell {a} from {b}: the best, {words!r},"
        f" separates them by {sigma}, and {plain(ENOUGH, 1)} are needed; record it for longer or at"
        f" a higher level ({planned.scenario.name} plays it), or measure one of the two directly"
    )


def _label_in_words(label: str) -> str:
    """Return EFFECT@PLACE in words: "Coulomb friction at m1", "a dead band in the command"."""
    effect, _, at = label.partition("@")
    where = f"at {at}" if place_at(at).kind == "mass" else place_in_words(place_at(at), 0)
    return f"{an_effect(effect)} {where}"
