"""All sentences of an answer, as an engineer would say them.

The headline says what is missing, how much, and where: "Coulomb friction of 20.1 mN m (19.7 to
20.5) at the motor is missing": the physics by the name that people have for it, its size in a unit
of that size with its 95 % interval, its place in words. The sentence says what that rests on, with
effects by the names of device files. Terminal, report and JSON have both from here. Where the
misfit lies and what to know before an answer is used have a sentence each. None ends in a full
stop.
"""

import math
from collections.abc import Callable, Sequence

from zwidth.diagnosis.answer.result import Estimate, Finding, Verdict
from zwidth.diagnosis.answer.validate import Adequacy, HeldOut
from zwidth.diagnosis.answer.verdict import CONCLUDED, Decision, Facts, Reason, differs, failing
from zwidth.diagnosis.answer.whole_run import WholeRun
from zwidth.diagnosis.forces.locate import Located, densest, stands_out
from zwidth.diagnosis.intake.gate import COMMAND, Fault
from zwidth.diagnosis.intake.units import asked_unit, unit_of
from zwidth.diagnosis.settings import ADEQUACY, VERDICT
from zwidth.sim.physics import EFFECTS
from zwidth.sim.place import Place, place_at
from zwidth.sim.predict import OVERFLOW
from zwidth.sim.readable import interval, most, of_the_motion, percent, plain, with_unit

UNNAMED = "something is missing that has no name in the library"


def place_in_words(at: Place, masses: int) -> str:
    """Return where something is, for who sees the machine: "at the motor", "in the command"."""
    match at.kind:
        case "mass":
            return f"at {mass_in_words(at.index, masses)}"
        case "link":
            ends = [mass_in_words(i, masses) for i in (at.index, at.index + 1)]
            return f"between {' and '.join(ends)}"
        case "ground":
            return f"between {mass_in_words(0, masses)} and the ground"
        case "clock":
            return "in the timing"
        case "velocity":
            return "in the velocities that are read"
        case "command" | "sensor":
            return f"in the {at.kind}"


def mass_in_words(index: int, masses: int) -> str:
    """Return a mass: the command acts on the first, which is the motor's; the last is the load."""
    if index == 0:
        return "the motor" if masses == 1 else "the motor (m1)"
    return f"the load (m{index + 1})" if index == masses - 1 else f"the mass m{index + 1}"


def said(value: Estimate) -> str:
    """Return a value with its interval, in a unit that a person uses."""
    return interval(value.value, value.lower, value.upper, value.unit)


class _Said:
    """A value as `Effect.said` asks for it."""

    def __init__(self, of: Estimate) -> None:
        self.of = of

    def __format__(self, how: str) -> str:
        value, unit = self.of.value, self.of.unit
        if how == "value":
            return with_unit(value, unit, 3)
        if how == "kind":
            return "torque" if unit.startswith("N m") else "force"
        if how == "hertz":
            return f"{1.0 / (2.0 * math.pi * value):.3g} Hz"
        if how == "percent":
            share, lower, upper = (100.0 * v for v in (value, self.of.lower, self.of.upper))
            return interval(share, lower, upper, "%")
        return said(self.of)


def effect_in_words(name: str) -> str:
    """Return an effect's name without its values: "Coulomb friction", "a dead band"."""
    words = name.replace("_", " ")
    return words.replace("coulomb", "Coulomb").replace("stribeck", "Stribeck")


def in_words(f: Finding, masses: int) -> str:
    """Return what was found with its size and its place."""
    effect, values = EFFECTS[f.effect], f.parameters
    try:
        known = {name: _Said(v) for name, v in values.items()}
        what = effect.said.format_map(known | _resonance(values))
    except KeyError:  # an error cost a value
        what = ""
    if not what:
        size = values.get(effect.strength or "")
        what = effect_in_words(f.effect) + ("" if size is None else f" of {said(size)}")
    if not effect.said_place or (f.effect == "ground_spring" and masses == 1):
        return what
    return f"{what} {place_in_words(place_at(f.at), masses)}"


def _resonance(values: dict[str, Estimate]) -> dict[str, str]:
    """The frequency of a mass on a spring, where an effect has both."""
    if not {"stiffness", "mass"} <= values.keys():
        return {}
    stiffness, mass = values["stiffness"].value, values["mass"].value
    hertz = math.sqrt(stiffness / mass) / (2.0 * math.pi) if stiffness > 0.0 < mass else 0.0
    return {"resonance": f"{hertz:.3g} Hz"}


def _listed(words: Sequence[str]) -> str:
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"


def all_in_words(findings: Sequence[Finding], masses: int, named: int = 3) -> str:
    """Return what was found in a row, the strongest first; of more than `named` how many more."""
    words = [in_words(f, masses).rstrip(",") for f in findings[:named]]
    if (more := len(findings) - named) > 0:
        words.append("one effect more" if more == 1 else f"{more} effects more")
    return _listed(words)


def parameter_in_words(name: str, unit: str) -> str:
    """Return a linear parameter as people call it: "the inertia m1", "the spring k12"."""
    if name == "gain":
        return "the scale of the command"
    name, where, word = name.partition(" in ")  # a value of some recordings' own
    kind = {"m": "mass" if unit == "kg" else "inertia", "b": "damper", "k": "spring"}.get(name[:1])
    words = name if kind is None or not name[1:].isdigit() else f"the {kind} {name}"
    return f"{words}{where}{word}"


def headline(facts: Facts, decision: Decision, masses: int) -> str:
    """Return what is missing, in one line for people. masses: of the device's chain."""
    if facts.lost:
        words = f"undecided: an error left out {' and '.join(facts.lost)}"
    else:
        words = HEADLINES.get(decision.reason, _unknown)(facts, decision, masses)
    wrong = list(dict.fromkeys(_fault(f) for f in facts.faults if f.wrong))
    if wrong:
        clean = decision.physics is Verdict.NOTHING_MISSING
        words = "; ".join(wrong) + ("" if clean else f"; with that corrected, {words}")
    return words[:1].upper() + words[1:]


def _named(_: Facts, decision: Decision, masses: int) -> str:
    found = decision.findings
    return f"{all_in_words(found, masses)} {_is(found)} missing from the simulation"


def _is(findings: Sequence[Finding]) -> str:
    return "is" if len(findings) == 1 else "are"


def _rival(_: Facts, decision: Decision, masses: int, listed: int = 3) -> str:
    """What stands first, and what this recording cannot tell it from."""
    confused, every = decision.about, all_in_words(decision.findings, masses)
    assert confused is not None
    rivals = confused.confusable_with
    near = [
        f"{effect_in_words(r.effect)} {place_in_words(place_at(r.at), masses)}"
        for r in rivals[:listed]
    ]
    more = [f"{len(rivals) - listed} more"] if len(rivals) > listed else []
    others = " or ".join([*near, *more])
    if len(decision.findings) == 1:
        return f"{every}, or {others}: this recording cannot tell which is missing"
    return (
        f"{every} are missing; in place of the {effect_in_words(confused.effect)} it may be"
        f" {others}, which this recording cannot tell apart"
    )


def _improbable(_: Facts, decision: Decision, masses: int) -> str:
    least, found = decision.about, decision.findings
    assert least is not None
    of = "" if len(found) == 1 else f" of {effect_in_words(least.effect)}"
    odds = f"{100.0 * (least.with_richer or 0.0):.0f} %"
    return f"{all_in_words(found, masses)} may be missing: the probability{of} is {odds} only"


def _unknown(facts: Facts, decision: Decision, masses: int) -> str:
    """How far the names go, and what is known of the rest."""
    law, sound = facts.law, facts.adequacy
    gone = () if law is None else law.replaced
    found = [f for f in decision.findings if f.label not in gone]
    names = all_in_words(found, masses)
    if law is not None:
        return f"{names} {_is(found)} missing, and {law.headline}" if found else law.headline
    if not found:
        rest = f": {facts.left.sentence}" if facts.left.gained > 0.0 and facts.left.sentence else ""
        return f"{UNNAMED}{rest}"
    if sound is not None and sound.explained < ADEQUACY.most:
        names = _listed([effect_in_words(f.effect) for f in found])
        share = f"{100.0 * max(0.0, sound.explained):.0f} %"
        return f"{UNNAMED}; the nearest names ({names}) explain {share} of the error"
    share = "" if sound is None or not sound.explained < 1.0 else _explain(sound)
    return (
        f"{names} {_is(found)} missing, and something else that has no name in the library{share}"
    )


def _explain(sound: Adequacy) -> str:
    return f"; the names explain {most(sound.explained)} of the error"


def _linear(facts: Facts, _: Decision, __: int, named: int = 3) -> str:
    """The parameters that differ, the furthest first."""
    moved = [
        (abs(math.log(e.value / nominal)), name, nominal, e)
        for name, (nominal, e) in facts.refit.items()
        if nominal > 0.0 < e.value and not e.lower <= nominal <= e.upper
    ]
    words = [_moved(name, nominal, e) for _, name, nominal, e in sorted(moved, reverse=True)]
    said_of = _listed(words[:named]) or "linear parameters differ from the device file"
    return f"no physics is missing, but {said_of}"


def _moved(name: str, nominal: float, e: Estimate) -> str:
    ratio = e.value / nominal
    how = (
        f"{100.0 * abs(ratio - 1.0):.2g} % {'above' if ratio > 1.0 else 'below'}"
        if 0.2 < ratio < 2.0
        else f"{plain(ratio, 3)} times"
    )
    unit = unit_of(ratio) if not 0.2 < ratio < 5.0 else None
    asked = "" if unit is None else f" ({unit}?)"
    return f"{parameter_in_words(name, e.unit)} is {said(e)}, {how} the device file's{asked}"


def _one_level(facts: Facts, decision: Decision, masses: int) -> str:
    assert facts.level is not None
    return (
        f"undecided: {all_in_words(decision.findings, masses)} would explain what the one level of"
        f" the command shows, and so would others: {facts.level.advice}"
    )


def _unjudged(_: Facts, decision: Decision, masses: int) -> str:
    return (
        f"undecided: {all_in_words(decision.findings, masses)} would explain what is missing, and"
        " too little was held out to judge by"
    )


def _chance(facts: Facts, decision: Decision, masses: int) -> str:
    if facts.law is not None:
        return _unknown(facts, decision, masses)
    return (
        f"undecided: free runs err {of_the_motion(facts.free.after)}, and no effect of the library"
        " can be told from chance"
    )


def _nothing(*_: object) -> str:
    return "nothing is missing that this recording could show"


HEADLINES: dict[Reason, Callable[[Facts, Decision, int], str]] = {
    Reason.NAMED: _named,
    Reason.RIVAL: _rival,
    Reason.IMPROBABLE: _improbable,
    Reason.ONE_LEVEL: _one_level,
    Reason.UNJUDGED: _unjudged,
    Reason.CHANCE: _chance,
    Reason.PARAMETERS: _linear,
    Reason.NOTHING: _nothing,
}


def _fault(fault: Fault) -> str:
    """What is wrong with a recording, without what to do about it, which the report says."""
    if not fault.channels:
        return fault.sentence
    command = fault.channels == COMMAND
    what = "the command" if command else " and ".join(fault.channels)
    of = f" of {fault.recording}" if fault.recording else ""
    if math.isclose(abs(fault.value), 1.0):
        return f"the sign of {what}{of} is wrong"
    asked = f" ({unit}?)" if (unit := asked_unit(fault.value, command)) else ""
    size = abs(fault.value)
    less = f"{plain(max(size, 1.0 / size), 3)} times too {'little' if size > 1.0 else 'much'}"
    many = "" if len(fault.channels) > 1 else "s"
    return f"{what}{of} count{many} {less}{asked}"


def sentence(facts: Facts, decision: Decision) -> str:
    """Return what the verdict rests on, faults of the recordings first."""
    words = _because(facts, decision)
    if facts.lost:
        words = f"an error left out {' and '.join(facts.lost)}; from what was done, {words}"
    if facts.untried:
        words += f"; {', '.join(facts.untried)} could not be tried"
    if facts.law is not None:
        words = f"{words}; {facts.law.sentence}"
    wrong = "; ".join(f.sentence for f in facts.faults if f.wrong)
    return f"{wrong}; with that corrected, {words}" if wrong else words


def _because(facts: Facts, decision: Decision) -> str:
    """The reason in words."""
    free, reason, about = facts.free, decision.reason, decision.about
    names = " and ".join(f.label for f in facts.findings)
    if reason not in CONCLUDED:
        return _missing_because(facts, reason, about, names)
    explain = f"{names} explain{'' if len(facts.findings) > 1 else 's'} what is missing"
    match reason:
        case Reason.UNJUDGED:
            return (
                f"{names} would explain what is missing, and too little was held out to judge by:"
                " record for longer, or give a second recording by --validate"
            )
        case Reason.ONE_LEVEL:
            return (
                f"{names} would explain what is missing, at the one level that the command has;"
                f" free runs on held-out data err {percent(free.after)} of the motion, by which"
                " what comes nearest cannot be told from it there"
            )
        case Reason.RIVAL if about is not None:
            near = [f"{r.effect} at {r.at}" for r in about.confusable_with]
            more = f" and {len(near) - 4} more" if len(near) > 4 else ""
            others = f"{', '.join(near[:4])}{more}"
            return f"{explain}, and this recording cannot tell {about.label} from {others}"
        case Reason.IMPROBABLE if about is not None:
            odds = f"{about.with_richer or 0.0:.2g}"
            return (
                f"{explain}, and this recording leaves {about.label} a probability of {odds} only"
            )
        case Reason.CHANCE if facts.law is not None:
            return "something is missing that no effect of the library explains"
        case Reason.CHANCE:
            return (
                "no effect of the library can be told from chance, and free runs on held-out data"
                f" err {of_the_motion(free.after)} all the same, where noise of readings makes"
                f" {percent(free.noise_floor)}: disturbances, or physics that this recording is too"
                " short or too coarse to show; record for longer, at a higher level, or with a"
                " finer sensor"
            )
        case Reason.PARAMETERS:
            moved = [n for n, (file, e) in facts.refit.items() if differs(n, file, e)]
            return f"no physics is missing, but {', '.join(moved)} differ from the device file"
        case Reason.NOTHING:
            return _nothing()
        case _:
            return f"{names} {_is(facts.findings)} missing from the simulation"


def _missing_because(facts: Facts, reason: Reason, about: Finding | None, names: str) -> str:
    """Why something is missing that has no name."""
    beyond = f" beyond {names}" if names else " that no effect of the library explains"
    missing, sound, free = f"something is missing{beyond}", facts.adequacy, facts.free
    if reason is Reason.LEFT:
        also = " that no effect of the library explains" if names else ""
        return f"{missing}{also}: {facts.left.sentence}"
    if reason is Reason.DISTURBED:
        return (
            f"{missing}: free runs on held-out data still err {of_the_motion(free.after)}, which"
            f" only disturbances by chance explain ({percent(free.refit)} without the names)"
        )
    where = None if about is None else failing(about)
    if about is not None and where is not None:
        return (
            f"{missing}: {about.label} as fitted {where.other} makes what was recorded"
            f" {where.regime} less likely than doing without it; record more {where.regime}"
        )
    if facts.law is not None and reason is Reason.LAW:
        gone = " and ".join(f.label for f in facts.findings if f.label in facts.law.replaced)
        return (
            f"something is missing that no effect of the library explains: {gone} together come"
            f" near it, and one law over {facts.law.over} explains it better"
        )
    assert sound is not None
    share = f"; the names explain {most(sound.explained)} of the square error" if names else ""
    if reason is Reason.NO_BETTER:
        return f"{names} predict held-out data no better than device file and refit do without"
    if reason is Reason.RUNS_AWAY:
        return f"{missing}: free runs of the answer run away{share}"
    if reason is Reason.FOLLOWS:
        led = max(sound.ahead, key=lambda a: a.led - a.most_led)
        return (
            f"{missing}: forces that follow the motion would explain {100.0 * led.led:.0f} % of the"
            f" square of what free runs over {led.horizon:.3g} s err on held-out data, noise"
            f" {100.0 * led.most_led:.0f} % at most{share}"
        )
    worst = max(sound.ahead, key=lambda a: a.error / a.most)
    return (
        f"{missing}: over {worst.horizon:.3g} s the error of free runs on held-out data is"
        f" {worst.error / worst.expected:.3g} times what its own noise would make it{share}"
    )


def where(located: Located) -> str:
    """Return where in the motion the misfit lies: what the shares say, and no cause."""
    if not located.maps:
        return located.sentence
    if not any(map(stands_out, located.maps)):
        return "no force that follows position, velocity, command or time stands out of the noise"
    dense = densest(located.state).removesuffix("; ")
    return dense or "what the refitted device cannot predict is spread over the whole motion"


def cautions(
    named: bool, free: HeldOut, sound: Adequacy | None, whole: Sequence[WholeRun]
) -> tuple[str, ...]:
    """Return what to know before an answer is used.

    named: whether anything was found. free, sound, whole: free runs over windows, beside their own
    noise, and over whole recordings.
    """
    by = "what was found" if named else "the refitted parameters"
    worse = free.after > VERDICT.worse * free.before
    warned: list[str] = []
    if worse:
        warned.append(
            f"with {by} free runs on held-out data err {of_the_motion(free.after)}, more than"
            f" the device file as it is ({percent(free.before)}): do not simulate with the"
            " augmented device"
        )
    elif free.strays:
        warned.append(
            f"free runs on held-out data still err {of_the_motion(free.after)}, where the"
            f" noise of readings makes {percent(free.noise_floor)} (device file:"
            f" {percent(free.before)})"
        )
    if sound is not None and not sound.sound:
        far = max(sound.ahead, key=lambda a: a.error / a.most)
        if far.error >= OVERFLOW:
            warned.append("free runs of the answer run away")
        elif far.error > far.most:
            warned.append(
                f"over {with_unit(far.horizon, 's', 3)} the error of free runs is"
                f" {plain(far.error / far.expected, 3)} times what their own noise would make it"
            )
    for run in whole:
        before, after = run.errors["before"], run.errors["after"]
        if after > VERDICT.worse * before and not worse:
            size = "without bound" if math.isinf(after) else with_unit(after, run.unit, 3)
            warned.append(
                f"from beginning to end the {run.output.replace('_', ' of ')} in {run.recording}"
                f" errs {size} with {by}, more than with the device file as it is"
                f" ({with_unit(before, run.unit, 3)})"
            )
    return tuple(warned)
