"""The first screen of a report: what is missing, how sure, what it is worth, what to do now."""

import math

from zwidth.diagnosis.answer.result import Diagnosis, HeldOut, NextExperiment, Verdict
from zwidth.diagnosis.answer.words import effect_in_words, place_in_words
from zwidth.sim.place import place_at
from zwidth.sim.readable import most, of_the_motion, percent, plain

ENOUGH = 5.0  # sigma from which two explanations count as told apart
LISTED = 3  # effects in a title
SHORT = "error of short free runs on held-out data"
TITLES = {
    Verdict.NOTHING_MISSING: "Nothing is missing that this recording could show",
    Verdict.LINEAR_PARAMETERS: "No physics is missing, but parameters differ",
    Verdict.RECORDING_FAULT: "The recording is at fault",
    Verdict.UNKNOWN_PHYSICS: "Physics is missing that has no name in the library",
    Verdict.UNDECIDED: "Undecided",
}
WITH = {
    Verdict.IDENTIFIED: "Missing",
    Verdict.CONFUSABLE: "Possibly missing",
    Verdict.UNKNOWN_PHYSICS: "Something unnamed is missing beside",
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
        f"{effect_in_words(f.effect)} {place_in_words(place_at(f.at), masses)}"
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


def missing(found: Diagnosis) -> str:
    """The headline without the worth of a law, which stands in a line of its own."""
    law = found.learned
    return found.headline if law is None else found.headline.replace(f"; {law.worth}", "")


def how_sure(found: Diagnosis, sentence: str) -> str:
    """Say how certain the answer is, by the least certain of its effects. sentence: the verdict's.

    Without a full stop, as the others.
    """
    if found.verdict is not Verdict.IDENTIFIED or not found.findings:
        return f"{sentence}{_explained(found)}"
    sigma = min(f.separation_sigma for f in found.findings)
    chances = [f.probability for f in found.findings if f.probability is not None]
    chance = f"the probability is {most(min(chances))}; " if chances else ""
    which = "the least certain effect" if len(found.findings) > 1 else "the effect"
    if not sigma < math.inf:
        return f"{sentence}: its distance from the next explanation is not known"
    return f"{chance}{which} improves the fit by {sigma:.0f} sigma ({ENOUGH:.0f} are required)"


def _explained(found: Diagnosis) -> str:
    if found.adequacy is None or not found.findings:
        return ""
    if found.verdict is not Verdict.UNKNOWN_PHYSICS:
        return ""
    share = most(min(1.0, max(0.0, found.adequacy.explained)))
    return f". The named effects explain {share} of the error"


def worth(fit: HeldOut, named: bool, law: tuple[float, float] | None = None) -> str:
    """Say how far free runs are off on data that were kept out of the fit, before and after.

    law: their errors over the motion with the law that has no name, and without it.
    """
    after = fit.after if named else fit.refit
    if not after > 0.0 or not fit.refit > 0.0:
        return "there is too little held-out data to judge by"
    if math.isinf(after):
        return "free runs of this model diverge on held-out data; do not simulate with it"
    noise = f"; noise alone would cause {percent(fit.noise_floor)}" if fit.noise_floor > 0.0 else ""
    meaning = (
        " (a free run is simulated without correction; held-out data were kept out of the fit)"
    )
    if law is not None:
        return f"{with_law(*law)}, as refitted {_off(fit.refit)}{noise}{meaning}"
    what = "with what was found" if named else "as refitted"
    rest = (
        f"without it {percent(fit.refit)}" if named else f"as in the device file {_off(fit.before)}"
    )
    if named and math.isinf(fit.refit):
        rest = "without it they diverge"
    return f"{SHORT}: {of_the_motion(after)} {what}, {rest}{noise}{meaning}"


def with_law(law: float, names: float) -> str:
    """Say what a law that has no name is worth: errors with it and without, over the motion."""
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
        use = "take the improved device" if trust else "use with care the partly improved device"
        steps.append(f"{use} {improved}, which every zwidth command accepts")
    if found.next_experiment is not None:
        steps.append(next_sentence(found.next_experiment))
    if found.next_level is not None:
        steps.append(found.next_level.sentence)
    if found.verdict is Verdict.UNKNOWN_PHYSICS:
        steps.append(
            "look at where the missing force acts, below; docs/after_a_verdict.md lists what to try"
        )
    return steps


def next_sentence(planned: NextExperiment | None) -> str:
    """Say what to record next, and whether that would decide; "" where nothing is in doubt."""
    if planned is None:
        return ""
    a, b = (effect_in_words(label).replace("@", " at ") for label in planned.separates)
    sigma = f"{planned.separation_sigma:.3g} sigma"
    words = planned.excitation.replace("_", " ")
    if planned.separation_sigma >= ENOUGH:
        return (
            f'to tell {a} from {b}, record the excitation "{words}": it separates them by {sigma}'
            f" ({plain(ENOUGH, 1)} are enough); {planned.scenario.name} plays it"
        )
    return (
        f"no excitation tried tells {a} from {b}: the best, {words!r}, separates them by"
        f" {sigma} of the {plain(ENOUGH, 1)} that are needed; record it longer or stronger"
        f" ({planned.scenario.name} plays it), or measure one of the two directly"
    )
