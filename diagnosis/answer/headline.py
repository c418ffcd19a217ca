"""The first line of an answer, as an engineer would say it: what is missing, how much, and where.

"Coulomb friction of 20.1 mN m (19.7 to 20.5) at the motor is missing": the physics by the name that
people have for it, its size in a unit of that size with its 95 % interval, its place in words. The
terminal, the report and the JSON (`headline`) all have it from here.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from zwidth.diagnosis.answer.adequacy import Adequacy
from zwidth.diagnosis.answer.result import Estimate, Finding, HeldOut, Verdict
from zwidth.diagnosis.answer.verdict import Left
from zwidth.diagnosis.forces.unknown import Instead
from zwidth.diagnosis.intake.gate import COMMAND, Fault
from zwidth.diagnosis.intake.units import asked_unit, unit_of
from zwidth.sim.physics import EFFECTS
from zwidth.sim.place import Place, place_at
from zwidth.sim.readable import interval, most, of_the_motion, percent, plain, with_unit

NAMED = 3  # effects in a headline; of more it says how many
HALF = 0.5  # of the error, that names must explain to come first
RIVALS = 3  # of what cannot be told apart


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
            return "in the measured velocity"
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


Values = dict[str, Estimate]


def _friction_by_direction(p: Values) -> str:
    return f"friction of {said(p['level_plus'])} forwards and {said(p['level_minus'])} backwards"


def _stribeck(p: Values) -> str:
    return f"friction of {said(p['level'])}, {said(p['static_level'])} at rest (Stribeck),"


def _rising(p: Values) -> str:
    return (
        f"friction that rises from {said(p['static_level'])} at rest to {said(p['level'])} in"
        " sliding"
    )


def _ripple(p: Values) -> str:
    period = with_unit(p["period"].value, p["period"].unit, 3)
    return f"a ripple of {said(p['amplitude'])} every {period}"


def _mode(p: Values) -> str:
    stiffness, mass = p["stiffness"].value, p["mass"].value
    hertz = math.sqrt(stiffness / mass) / (2.0 * math.pi) if stiffness > 0.0 < mass else 0.0
    return f"a resonance at {hertz:.3g} Hz (a mass of {said(p['mass'])} on a spring)"


def _eccentric(p: Values) -> str:
    period = with_unit(p["period"].value, p["period"].unit, 3)
    return f"an eccentric encoder, {said(p['amplitude'])} every {period},"


def _losses(p: Values) -> str:
    rate = p["rate"]
    value, lower, upper = (100.0 * v for v in (rate.value, rate.lower, rate.upper))
    return f"a loss of {interval(value, lower, upper, '%')} of the commands"


# effect -> its name with its values; {} is filled with the parameter after it.
SAYINGS: dict[str, Callable[[Values], str]] = {
    "coulomb_friction": lambda p: f"Coulomb friction of {said(p['level'])}",
    "stribeck_friction": _stribeck,
    "rising_friction": _rising,
    "presliding_friction": lambda p: (
        f"friction of {said(p['level'])} that yields by {said(p['stiffness'])} before it slides"
    ),
    "directional_friction": _friction_by_direction,
    "load_friction": lambda p: f"friction of {said(p['ratio'])} times the load",
    "quadratic_drag": lambda p: f"quadratic drag of {said(p['coefficient'])}",
    "constant_force": lambda p: f"a constant {_force(p['level'])} of {said(p['level'])}",
    "ground_spring": lambda p: f"a spring to the ground of {said(p['stiffness'])}",
    "gravity_pendulum": lambda p: f"the gravity of a pendulum, {said(p['level'])},",
    "force_ripple": _ripple,
    "backlash": lambda p: f"play of {said(p['gap'])}",
    "cubic_stiffness": lambda p: f"a spring's cubic part of {said(p['coefficient'])}",
    "hysteresis": lambda p: f"hysteresis of {said(p['level'])}",
    "extra_mode": _mode,
    "servo_limit": lambda p: f"a limit of {said(p['limit'])} in the servo",
    "servo_dead_zone": lambda p: f"a dead zone of {said(p['half'])} in the servo",
    "servo_integral": lambda p: f"integral action of {said(p['rate'])} in the servo",
    "goal_rate_limit": lambda p: f"a servo goal that moves at {said(p['rate'])} at most",
    "falling_limit": lambda p: f"a limit of {said(p['limit'])} that falls with speed",
    "open_winding": lambda p: (
        f"a winding that is open while off ({said(p['damping'])} less damping)"
    ),
    "rate_limit": lambda p: f"a command that changes by {said(p['rate'])} at most",
    "saturation": lambda p: f"a limit of {said(p['limit'])}",
    "dead_band": lambda p: f"a dead band of {said(p['width'])}",
    "command_step": lambda p: f"a step of {said(p['step'])}",
    "actuator_lag": lambda p: f"a lag of {said(p['time_constant'])}",
    "gain_asymmetry": lambda p: f"a gain that differs by direction ({said(p['ratio'])})",
    "loop_delay": lambda p: f"a delay of {said(p['delay'])}",
    "dropped_samples": _losses,
    "encoder_step": lambda p: f"an encoder step of {said(p['step'])}",
    "encoder_eccentricity": _eccentric,
    "rectified_sensor": lambda _: "a sensor that reads the absolute value",
    "sensor_lag": lambda p: f"a lag of {said(p['time_constant'])}",
    "sensor_filter": lambda p: (
        f"a second-order filter of {said(p['time_constant'])}"
        f" ({1.0 / (2.0 * math.pi * p['time_constant'].value):.3g} Hz)"
    ),
    "moving_average": lambda p: f"a mean over {said(p['window'])}",
}
OWN_PLACE = ("rectified_sensor", "encoder_step", "encoder_eccentricity", "servo_limit",
             "servo_dead_zone", "servo_integral", "goal_rate_limit", "open_winding",
             "dropped_samples", "cubic_stiffness_at_ground")  # fmt: skip


def _force(value: Estimate) -> str:
    return "torque" if value.unit.startswith("N m") else "force"


def effect_in_words(name: str) -> str:
    """Return an effect's name without its values: "Coulomb friction", "a dead band"."""
    words = name.replace("_", " ")
    return words.replace("coulomb", "Coulomb").replace("stribeck", "Stribeck")


def in_words(f: Finding, masses: int) -> str:
    """Return what was found with its size and its place."""
    try:
        what = SAYINGS[f.effect](f.parameters)
    except KeyError:  # an effect without a saying, or of which an error cost a value
        strength = EFFECTS[f.effect].strength or ""
        value = f.parameters.get(strength)
        what = effect_in_words(f.effect) + ("" if value is None else f" of {said(value)}")
    if f.effect in OWN_PLACE or (f.effect == "ground_spring" and masses == 1):
        return what
    return f"{what} {place_in_words(place_at(f.at), masses)}"


def _listed(words: Sequence[str]) -> str:
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} and {words[-1]}"


def all_in_words(findings: Sequence[Finding], masses: int) -> str:
    """Return what was found in a row, the strongest first; of many the last are only counted."""
    words = [in_words(f, masses).rstrip(",") for f in findings[:NAMED]]
    if (more := len(findings) - NAMED) > 0:
        words.append("one effect more" if more == 1 else f"{more} effects more")
    return _listed(words)


def worth_in_words(f: Finding) -> str:
    """Return what a finding is worth on held-out data, "" where that is not known."""
    w = f.worth
    if w is None:
        return ""
    if not w.pays:
        return "without it the error of free runs on held-out data grows by no more than chance"
    often = f"{w.times:.3g}" if w.times < 1000.0 else "over 1000"
    much = f"{often} times as large" if w.times >= 1.1 else f"{percent(w.times - 1.0)} larger"
    runs = f"free runs over {w.horizon:.3g} s on held-out data"
    return f"without it the error of {runs} is {much}"


def negligible_in_words(findings: Sequence[Finding], masses: int) -> str:
    """Return what was seen and is of no consequence as a sentence, "" for nothing."""
    if not findings:
        return ""
    return f"detected, but too small to matter: {all_in_words(findings, masses)}"


@dataclass(frozen=True)
class Answer:
    """What a headline is made of: the verdict as it is before faults of the recording.

    refit: name -> (device file's, refitted); masses: of the device's chain; left: what no effect of
    the library explains beside what was found, other: the same in its place; sound and free: what
    held-out data say; lost: what an error took from the verdict, "" for nothing; learned: a law of
    no name in words, "" for none; record: which level to, where that of the command cannot decide;
    bad: why the fit is no answer.
    """

    verdict: Verdict
    findings: Sequence[Finding]
    refit: Mapping[str, tuple[float, Estimate]]
    faults: Sequence[Fault]
    masses: int
    left: Left
    other: Instead | None
    sound: Adequacy | None
    free: HeldOut
    lost: str = ""
    learned: str = ""
    record: str = ""
    bad: str = ""


def headline(answer: Answer) -> str:
    """Return the headline, a sentence without its full stop."""
    words = SENTENCES[answer.verdict](answer)
    wrong = list(dict.fromkeys(_fault(f) for f in answer.faults if f.wrong))
    if wrong:
        clean = answer.verdict is Verdict.NOTHING_MISSING
        words = "; ".join(wrong) + ("" if clean else f"; with that corrected, {words}")
    return words[:1].upper() + words[1:]


def _identified(a: Answer) -> str:
    return f"{all_in_words(a.findings, a.masses)} {_is(a.findings)} missing from the simulation"


def _is(findings: Sequence[Finding]) -> str:
    return "is" if len(findings) == 1 else "are"


def _confusable(a: Answer) -> str:
    """What stands first, and what this recording cannot tell it from."""
    confused = next((f for f in a.findings if f.confusable_with), None)
    all_of_them = all_in_words(a.findings, a.masses)
    if confused is None:
        doubtful = [f for f in a.findings if f.with_richer is not None]
        least = min(doubtful, key=lambda f: f.with_richer or 0.0)
        odds = f"{100.0 * (least.with_richer or 0.0):.0f} %"
        of = "" if len(a.findings) == 1 else f" of {effect_in_words(least.effect)}"
        return f"{all_of_them} may be missing: the probability{of} is only {odds}"
    near = [
        f"{effect_in_words(r.effect)} {place_in_words(place_at(r.at), a.masses)}"
        for r in confused.confusable_with[:RIVALS]
    ]
    more = len(confused.confusable_with) - RIVALS
    others = [*near, f"{more} more"] if more > 0 else near
    if len(a.findings) == 1:
        rivals = " or ".join(others)
        return f"{all_of_them}, or {rivals}: this recording cannot tell which is missing"
    return (
        f"{all_of_them} are missing; instead of the {effect_in_words(confused.effect)} it may be"
        f" {' or '.join(others)}: this recording cannot tell them apart"
    )


def _unknown(a: Answer) -> str:
    """How far the names go, and what is known of the rest."""
    if a.learned:
        names = all_in_words(a.findings, a.masses)
        beside = f"{names} {_is(a.findings)} missing, and " if a.findings else ""
        return f"{beside}{a.learned}"
    if a.other is not None:
        return f"something is missing that has no name in the library: {_of_no_name(a, a.other)}"
    if not a.findings:
        rest = f": {a.left.sentence}" if a.left.gained > 0.0 and a.left.sentence else ""
        return f"something is missing that has no name in the library{rest}"
    names = all_in_words(a.findings, a.masses)
    if a.bad and a.left.gained == 0.0 and (a.sound is None or a.sound.adequate):
        return (
            "something is missing that has no name in the library; the best explanation"
            f" ({names}) is not acceptable: {a.bad}"
        )
    if a.sound is not None and a.sound.explained < HALF:
        names = _listed([effect_in_words(f.effect) for f in a.findings])
        share = f"{100.0 * max(0.0, a.sound.explained):.0f} %"
        return (
            f"something is missing that has no name in the library; the nearest effects ({names})"
            f" explain {share} of the error"
        )
    return (
        f"{names} {_is(a.findings)} missing, and something else that has no name in the"
        f" library{_explained(a.sound)}"
    )


def _of_no_name(a: Answer, other: Instead) -> str:
    at = place_in_words(place_at(other.place), a.masses)
    how = other.follows.rstrip(",")  # which the sentence goes on after
    how = how if how.startswith(("repeats", "follows")) else f"follows {how}"
    return f"a force {at} that {how}, and is not {other.name.replace('_', ' ')}"


def _explained(sound: Adequacy | None) -> str:
    """How much of the error over half a second the names take away, where that is something."""
    if sound is None or not 0.0 < sound.explained < 1.0:
        return ""
    return f"; these effects explain {most(sound.explained)} of the error"


def _linear(a: Answer) -> str:
    """The parameters that differ, the furthest first."""
    moved = [
        (abs(math.log(e.value / nominal)), name, nominal, e)
        for name, (nominal, e) in a.refit.items()
        if nominal > 0.0 < e.value and not e.lower <= nominal <= e.upper
    ]
    words = [_moved(name, nominal, e) for _, name, nominal, e in sorted(moved, reverse=True)]
    said_of = _listed(words[:NAMED]) or "linear parameters differ from the device file"
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


def parameter_in_words(name: str, unit: str) -> str:
    """Return a linear parameter as people call it: "the inertia m1", "the spring k12"."""
    if name == "gain":
        return "the scale of the command"
    if name == "skew":
        return "readings after the command"
    name, where, word = name.partition(" in ")  # a value of some recordings' own
    kind = {"m": "mass" if unit == "kg" else "inertia", "b": "damper", "k": "spring"}.get(name[:1])
    said = name if kind is None or not name[1:].isdigit() else f"the {kind} {name}"
    return f"{said}{where}{word}"


def _nothing(a: Answer) -> str:
    return "nothing is missing that this recording could show"


def _undecided(a: Answer) -> str:
    if a.lost:
        return f"undecided: an error left out {a.lost}"
    if a.findings and a.record:
        return (
            f"undecided: {all_in_words(a.findings, a.masses)} would explain what the one level of"
            f" the command shows, and so would others: {a.record}"
        )
    if a.findings:
        return (
            f"undecided: {all_in_words(a.findings, a.masses)} would explain what is missing, and"
            " too little was held out to judge by"
        )
    return (
        f"undecided: free runs have an error of {of_the_motion(a.free.after)}, and no effect of"
        " the library is significant"
    )


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


SENTENCES: dict[Verdict, Callable[[Answer], str]] = {
    Verdict.NOTHING_MISSING: _nothing,
    Verdict.IDENTIFIED: _identified,
    Verdict.CONFUSABLE: _confusable,
    Verdict.UNKNOWN_PHYSICS: _unknown,
    Verdict.LINEAR_PARAMETERS: _linear,
    Verdict.UNDECIDED: _undecided,
    Verdict.RECORDING_FAULT: _nothing,
}
