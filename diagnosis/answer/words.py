"""All sentences of an answer; terminal, report and JSON take them from here.

The headline says what is missing, how much, and where, as an engineer would: "Coulomb friction of
20.1 mN m at the motor is missing". Intervals are in the table beside it; a headline that would be
too long leaves out sizes, too. `why` gives the reason for the verdict.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

from zwidth.diagnosis.answer.adequacy import Adequacy
from zwidth.diagnosis.answer.result import Estimate, Finding, HeldOut
from zwidth.diagnosis.answer.verdict import Facts, Reason, reason
from zwidth.diagnosis.answer.whole_run import WholeRun
from zwidth.diagnosis.forces.locate import Located, densest, sign_of, stands_out
from zwidth.diagnosis.intake.gate import COMMAND, Fault
from zwidth.diagnosis.intake.units import asked_unit, unit_of
from zwidth.diagnosis.settings import VERDICT
from zwidth.sim.physics import EFFECTS
from zwidth.sim.place import Place, place_at
from zwidth.sim.predict import OVERFLOW
from zwidth.sim.readable import (
    interval,
    most,
    of_the_motion,
    percent,
    plain,
    with_unit,
    without_interval,
)

LISTED = 3  # effects, rivals or parameters in a sentence; further ones are counted
LONGEST = 40  # words, numbers and units of a headline, above which it gives fewer sizes
IF_RIGHT = "if this model is right, "  # else a parameter may seem to change, as a law is missing
UNNAMED = "something is missing that is not in the library of effects"


def place_in_words(at: Place, masses: int) -> str:
    """Return a place in the terms of the machine: "at the motor", "in the command"."""
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
    """Return a mass in words: the first, on which the command acts, is the motor."""
    if index == 0:
        return "the motor" if masses == 1 else "the motor (m1)"
    return f"the load (m{index + 1})" if index == masses - 1 else f"the mass m{index + 1}"


def said(value: Estimate) -> str:
    """Return a value with its interval, in a unit that a person uses."""
    return interval(value.value, value.lower, value.upper, value.unit)


def short(value: Estimate) -> str:
    """Return a value without its interval, to three digits at most."""
    return without_interval(value.value, value.lower, value.upper, value.unit)


@dataclass(frozen=True)
class _Said:
    """A phrase with a value: {name}, with its interval if wanted, {name:...} as named here."""

    value: Estimate
    intervals: bool

    def __format__(self, how: str) -> str:
        e = self.value
        match how:
            case "alone":
                return with_unit(e.value, e.unit, 3)
            case "percent":
                to = interval if self.intervals else without_interval
                return to(100.0 * e.value, 100.0 * e.lower, 100.0 * e.upper, "%")
            case "hertz":
                return f"{1.0 / (2.0 * math.pi * e.value):.3g} Hz"
            case "force":
                return "torque" if e.unit.startswith("N m") else "force"
            case "brief":
                return short(e)
            case _:
                return said(e) if self.intervals else short(e)


# effect -> its name with its values.
SAYINGS = {
    "coulomb_friction": "Coulomb friction of {level}",
    "stribeck_friction": "Stribeck friction of {level} ({static_level:brief} at rest)",
    "rising_friction": "friction that rises from {static_level} at rest to {level} in sliding",
    "presliding_friction": "presliding friction of {level}",
    "directional_friction": "friction of {level_plus} forwards and {level_minus} backwards",
    "load_friction": "friction of {ratio} times the load",
    "quadratic_drag": "quadratic drag of {coefficient}",
    "constant_force": "a constant {level:force} of {level}",
    "ground_spring": "a spring of {stiffness} to the ground",
    "gravity_pendulum": "a gravity pendulum of {level}",
    "force_ripple": "a ripple of {amplitude} every {period:alone}",
    "backlash": "play of {gap}",
    "cubic_stiffness": "a cubic part of {coefficient} in the spring",
    "hysteresis": "hysteresis of {level}",
    "extra_mode": "a resonance at {hertz:.3g} Hz",
    "servo_limit": "a limit of {limit} in the servo",
    "servo_dead_zone": "a dead zone of {half} in the servo",
    "servo_integral": "integral action of {rate} in the servo",
    "goal_rate_limit": "a servo goal that moves at {rate} at most",
    "falling_limit": "a limit of {limit} that falls with speed",
    "open_winding": "a winding that opens while the drive is off ({damping:brief} less damping)",
    "rate_limit": "a command that changes by {rate} at most",
    "saturation": "a limit of {limit}",
    "dead_band": "a dead band of {width}",
    "command_step": "a step of {step}",
    "actuator_lag": "a lag of {time_constant}",
    "gain_asymmetry": "a gain that differs by direction (ratio {ratio:brief})",
    "loop_delay": "a delay of {delay}",
    "dropped_samples": "a loss of {rate:percent} of the commands",
    "encoder_step": "an encoder step of {step}",
    "encoder_eccentricity": "an encoder eccentricity of {amplitude} every {period:alone}",
    "rectified_sensor": "a sensor that reads the absolute value",
    "sensor_lag": "a lag of {time_constant}",
    "sensor_filter": "a second-order filter of {time_constant} ({time_constant:hertz})",
    "moving_average": "a moving average over {window}",
}
# The name of friction that acts in one direction only.
ONE_WAY = {
    "level_plus": "friction of {level_minus} backwards (none forwards)",
    "level_minus": "friction of {level_plus} forwards (none backwards)",
}
ZERO = re.compile(r"0(\.0*)? ")  # beginning of a value that is zero to its known digits
# Effects whose phrase includes their place.
PLACED = ("rectified_sensor", "encoder_step", "encoder_eccentricity", "servo_limit", "open_winding",
          "servo_dead_zone", "servo_integral", "goal_rate_limit", "dropped_samples")  # fmt: skip


def times_in_words(at: float, between: tuple[float, float]) -> tuple[str, str, str]:
    """Return a time [s] and its interval, to the digits that are known, without the unit."""
    half = max(0.5 * (between[1] - between[0]), 1e-4)
    digits = max(0, min(4, -math.floor(math.log10(half))))
    first, *ends = (f"{t:.{digits}f}" for t in (at, *between))
    return first, ends[0], ends[1]


def effect_in_words(name: str) -> str:
    """Return an effect's name without its values: "Coulomb friction", "a dead band"."""
    words = name.replace("_", " ")
    return words.replace("coulomb", "Coulomb").replace("stribeck", "Stribeck")


# Endings of the names of effects without an article: "friction", but "a dead band".
UNCOUNTED = ("friction", "drag", "backlash", "stiffness", "hysteresis", "saturation", "asymmetry",
             "samples", "eccentricity")  # fmt: skip


def an_effect(name: str) -> str:
    """Return an effect's name where a sentence first mentions it: "friction", "a dead band"."""
    words = effect_in_words(name)
    if words.endswith(UNCOUNTED):
        return words
    return f"{'an' if words[0] in 'aeiou' else 'a'} {words}"


def the_effect(name: str) -> str:
    """Return an effect's name where it is already known: "Coulomb friction", "the dead band"."""
    words = effect_in_words(name)
    return words if words.endswith(UNCOUNTED) else f"the {words}"


# Names of parameters that are not plain words -> their words.
PARAMETERS = {
    "level_plus": "forward level",
    "level_minus": "backward level",
    "viscous_plus": "forward damping",
    "viscous_minus": "backward damping",
}


def own_parameter(name: str) -> str:
    """Return the name of an effect's parameter in words: "static level", "level in run_2"."""
    name, where_, word = name.partition(" in ")  # own value of some recordings
    return f"{PARAMETERS.get(name, name.replace('_', ' '))}{where_}{word}"


def _at(effect: str, at: str, masses: int, beside: Finding | None = None) -> str:
    """Return an effect with its place; beside: a finding, whose name or place is not repeated."""
    where_ = place_in_words(place_at(at), masses)
    if beside is not None and beside.at == at:
        return an_effect(effect)
    if beside is not None and beside.effect == effect:
        return where_
    return f"{an_effect(effect)} {where_}"


def in_words(f: Finding, masses: int, intervals: bool = False) -> str:
    """Return a finding with its size, and with its interval if wanted, and its place."""
    return " ".join(filter(None, _what_and_where(f, masses, intervals)))


def unsized(effect: str, at: str, masses: int) -> tuple[str, str]:
    """Return an effect without its size, and where it is, "" if its name says it: a sensor lag."""
    where_ = "" if effect.startswith(at) else _where(effect, at, masses)
    return an_effect(effect), where_


def _where(effect: str, at: str, masses: int) -> str:
    placed = effect in PLACED or (effect == "ground_spring" and masses == 1)
    return "" if placed else place_in_words(place_at(at), masses)


def _what_and_where(
    f: Finding, masses: int, intervals: bool = False, sized: bool = True
) -> tuple[str, str]:
    """Return what was found, with its size if wanted, and where, "" where the first says it."""
    if f.parameters and not sized:
        return unsized(f.effect, f.at, masses)
    values: dict[str, object] = {name: _Said(e, intervals) for name, e in f.parameters.items()}
    if {"stiffness", "mass"} <= f.parameters.keys():
        stiffness, mass = (f.parameters[name].value for name in ("stiffness", "mass"))
        still = not stiffness > 0.0 < mass
        values["hertz"] = 0.0 if still else math.sqrt(stiffness / mass) / (2.0 * math.pi)
    none = [n for n in ONE_WAY if n in f.parameters and ZERO.match(short(f.parameters[n]))]
    try:
        saying = ONE_WAY[none[0]] if len(none) == 1 and not intervals else SAYINGS[f.effect]
        what = saying.format_map(values)
    except KeyError:  # an effect without a phrase, or that lost a value to an error
        value = f.parameters.get(EFFECTS[f.effect].strength or "")
        size = "" if value is None else f" of {said(value) if intervals else short(value)}"
        what = effect_in_words(f.effect) + size
    return what, _where(f.effect, f.at, masses)


def listed(words: Sequence[str], last: str = "and", first: int = LISTED) -> str:
    """Return words as a list; those beyond the first ones are only counted."""
    more = len(words) - first
    words = [*words[:first], f"{more} more"] if more > 0 else list(words)
    return f" {last} ".join([*filter(None, [", ".join(words[:-1])]), *words[-1:]])


def all_in_words(
    findings: Sequence[Finding], masses: int, intervals: bool = False, sized: int = LISTED
) -> str:
    """Return findings as a list, the strongest first; a shared place is mentioned once.

    sized: how many of them, from the first on, have their sizes.
    """
    named = [_what_and_where(f, masses, intervals, i < sized) for i, f in enumerate(findings)]
    shared = [(at, [what for what, _ in same])
              for at, same in groupby(named[:LISTED], key=lambda pair: pair[1])]  # fmt: skip
    if all(len(what) == 1 or not at for at, what in shared):
        return listed([" ".join(filter(None, pair)) for pair in named])
    parts = [" ".join(filter(None, (listed(what), at))) for at, what in shared]
    if (more := len(named) - LISTED) > 0:
        parts.append(f"{more} more")
    return ", and ".join([*filter(None, [", ".join(parts[:-1])]), *parts[-1:]])


def worth_in_words(f: Finding) -> str:
    """Return the worth of a finding on held-out data, "" if it is unknown."""
    w = f.worth
    if w is None:
        return ""
    if not w.pays:
        return (
            "without this effect, the error of free runs on held-out data grows by no more than"
            " chance"
        )
    often = f"{w.times:.3g}" if w.times < 1000.0 else "over 1000"
    much = f"{often} times as large" if w.times >= 1.1 else f"{percent(w.times - 1.0)} larger"
    return (
        f"without this effect, the error of free runs over {w.horizon:.3g} s on held-out data is"
        f" {much}"
    )


def negligible_in_words(findings: Sequence[Finding], masses: int) -> str:
    """Return a sentence on detected but negligible effects, "" for none."""
    if not findings:
        return ""
    return f"detected, but too small to matter: {all_in_words(findings, masses, intervals=True)}"


def headline(f: Facts, also: Sequence[str] = (), doubted: Sequence[str] = ()) -> str:
    """Return the headline, a sentence without its full stop: first what is wrong, then the rest.

    also: what changed, and what happened once, in short. doubted: the same, if it is doubtful. A
    headline longer than `LONGEST` leaves out sizes, those of the weakest effects first, and then
    what is doubtful.
    """
    words = ""
    for rest in ((*doubted, *also), also):
        for sized in range(min(LISTED, len(f.findings)), -1, -1):
            words = "; ".join([_whole(f, sized), *rest])
            if len(words.split()) <= LONGEST:
                return words[:1].upper() + words[1:]
    return words[:1].upper() + words[1:]


def _whole(f: Facts, sized: int) -> str:
    because = reason(f)
    words = _headline(f, because, sized)
    wrong = list(dict.fromkeys(_fault(fault) for fault in f.faults if fault.wrong))
    if not wrong:
        return words
    clean = because is Reason.NOTHING
    return "; ".join(wrong) + ("" if clean else f"; with that corrected, {words}")


def _headline(f: Facts, because: Reason, sized: int) -> str:
    names = all_in_words(f.findings, f.masses, sized=sized)
    is_ = "is" if len(f.findings) == 1 else "are"
    match because:
        case Reason.NOTHING:
            return "this recording shows no missing physics"
        case Reason.LINEAR:
            return _linear(f)
        case Reason.NAMED:
            return f"{names} {is_} missing from the simulation"
        case Reason.RIVALS:
            return _rivals(f, names)
        case Reason.IMPROBABLE if f.doubtful is not None:
            of = "" if len(f.findings) == 1 else f" of {the_effect(f.doubtful.effect)}"
            odds = f"{100.0 * (f.doubtful.with_richer or 0.0):.0f} %"
            return f"{names} may be missing: the probability{of} is only {odds}"
        case Reason.DOUBTED:
            return f"{names} {is_} missing, but {f.left.hint.partition(':')[0]}"
        case Reason.WITH_LEVEL | Reason.ONE_PERIOD:
            return f"{names} {is_} missing, or a law outside the library of effects"
        case Reason.TOUCHED:
            return f"{names} {is_} missing, if the {f.contacts} contacts in the recording were real"
        case Reason.LOST:
            return f"undecided: an internal error prevented {f.lost}"
        case Reason.ONE_LEVEL if f.level is not None:
            return (
                f"undecided: {names} would explain what a command of a single level shows, but so"
                f" would other effects: {f.level.advice}"
            )
        case Reason.UNJUDGED:
            return (
                f"undecided: {names} would explain what is missing, but there is too little"
                " held-out data to judge it"
            )
        case Reason.UNCONFIRMED:
            return (
                f"undecided: {names} would explain what is missing, but held-out data are predicted"
                " no worse if an effect is left out"
            )
        case Reason.STRAY:
            return (
                f"undecided: free runs have an error of {of_the_motion(f.free.after)}, and no"
                " effect of the library is significant"
            )
        case _:
            return _unknown(f, because, sized)


def _rivals(f: Facts, names: str) -> str:
    """Name the first confusable effect and the effects that may be in its place."""
    confused = next(one for one in f.findings if one.confusable_with)
    others = listed([_at(r.effect, r.at, f.masses, confused) for r in confused.confusable_with],
                    "or")  # fmt: skip
    if len(f.findings) == 1:
        return f"{names}, or {others}: this recording cannot tell which is missing"
    return f"{names} are missing; {the_effect(confused.effect)} may instead be {others}"


def _unknown(f: Facts, because: Reason, sized: int) -> str:
    """Say how much the named effects explain, and describe the rest."""
    detailed = because is Reason.MORE and f.law is not None and bool(f.law.curve.replaced)
    gone = () if f.law is None or detailed else f.law.curve.replaced
    named = [one for one in f.findings if f"{one.effect} at {one.at}" not in gone]
    names = all_in_words(named, f.masses, sized=sized)
    is_ = "is" if len(named) == 1 else "are"
    if detailed and f.law is not None:
        return f"{names} {is_} missing; a learned curve describes this better: {f.law.extent}"
    if f.law is not None:
        return (f"{names} {is_} missing, and " if names else "") + f.law.headline(f.masses)
    if f.other is not None:
        at, how = place_in_words(place_at(f.other.place), f.masses), f.other.follows.rstrip(",")
        how = how if how.startswith(("repeats", "depends on")) else f"depends on {how}"
        return f"{UNNAMED}: a force {at} that {how}, instead of {f.other.name.replace('_', ' ')}"
    if not named:
        rest = f": {f.left.sentence}" if f.left.gained > 0.0 and f.left.sentence else ""
        return f"{UNNAMED}{rest}"
    if because is Reason.BAD:
        return f"{UNNAMED}; the best explanation, {names}, is not acceptable"
    share = None if f.sound is None else f.sound.explained
    if share is not None and share < 0.5:  # the named effects are not the answer then
        near = listed([effect_in_words(one.effect) for one in named])
        return (
            f"{UNNAMED}; the nearest effects ({near}) explain {100.0 * max(0.0, share):.0f} % of"
            " the error"
        )
    if share is None or share >= 1.0:
        return f"{names} {is_} missing, and so is something that is not in the library of effects"
    explain = "explains" if len(named) == 1 else "explain"
    return (
        f"{names} {is_} missing and {explain} {most(share)} of the error; the rest is outside the"
        " library of effects"
    )


def _linear(f: Facts) -> str:
    """Say which parameters differ, the largest difference first."""
    moved = [
        (abs(math.log(e.value / nominal)), name, nominal, e)
        for name, (nominal, e) in f.refit.items()
        if nominal > 0.0 < e.value and not e.lower <= nominal <= e.upper
    ]
    moved.sort(reverse=True)
    if not moved:
        return f"no physics is missing, but {_differing(f)}"
    if len(moved) == 1:
        ((_, name, nominal, e),) = moved
        ratio = e.value / nominal
        off = _percent_off(ratio)
        above = f"{off.lstrip('-+')} {'above' if ratio > 1.0 else 'below'}"
        how = above if off else f"{plain(ratio, 3)} times"
        is_ = f"{parameter_in_words(name, e.unit)} is {short(e)}"
        return f"no physics is missing, but {is_}, {how} the device file's{_asked(ratio)}"
    words: list[str] = []
    for _, name, nominal, e in moved:
        ratio = e.value / nominal
        by = _percent_off(ratio) or f"a factor of {plain(ratio, 3)}"
        words.append(f"{parameter_in_words(name, e.unit)} by {by}{_asked(ratio)}")
    return f"no physics is missing, but parameters differ from the device file: {listed(words)}"


def _differing(f: Facts) -> str:
    """Say which parameters differ: "the inertia m1 differs from the device file"."""
    names = [parameter_in_words(name, f.refit[name][1].unit) for name in f.moved]
    differ = "differs" if len(names) == 1 else "differ"
    return f"{listed(names)} {differ} from the device file"


def _percent_off(ratio: float) -> str:
    """Return by how much a ratio differs from one, "" if that is better said as a factor."""
    return f"{100.0 * (ratio - 1.0):+.2g} %" if 0.2 < ratio < 2.0 else ""


def _asked(ratio: float) -> str:
    """Return a wrong unit that would explain a ratio, as a question; "" for none."""
    unit = unit_of(ratio) if not 0.2 < ratio < 5.0 else None
    return "" if unit is None else f" ({unit}?)"


def parameter_in_words(name: str, unit: str) -> str:
    """Return the usual name of a linear parameter: "the inertia m1", "the spring k12"."""
    if name == "gain":
        return "the scale of the command"
    if name == "skew":
        return "the delay of the readings"
    name, where_, word = name.partition(" in ")  # own value of some recordings
    kind = {"m": "mass" if unit == "kg" else "inertia", "b": "damper", "k": "spring"}.get(name[:1])
    called = name if kind is None or not name[1:].isdigit() else f"the {kind} {name}"
    return f"{called}{where_}{word}"


def _fault(fault: Fault) -> str:
    """Say what is wrong with a recording; the report adds what to do."""
    if not fault.channels:
        return fault.sentence
    command = fault.channels == COMMAND
    what = "the command" if command else " and ".join(fault.channels)
    of = f" of {fault.recording}" if fault.recording else ""
    size = abs(fault.value)
    if math.isclose(size, 1.0):
        return f"the sign of {what}{of} is wrong"
    asked = f" ({unit}?)" if (unit := asked_unit(fault.value, command)) else ""
    less = f"{plain(max(size, 1.0 / size), 3)} times too {'small' if size > 1.0 else 'large'}"
    return f"{what}{of} {'are' if len(fault.channels) > 1 else 'is'} {less}{asked}"


def why(f: Facts) -> str:
    """Return the reason for the verdict; a sentence without its full stop."""
    because, free, doubtful = reason(f), f.free, f.doubtful
    law = "" if f.law is None else f"learned from the remaining error: {f.law.sentence}"
    error = f"free runs on held-out data have an error of {of_the_motion(free.after)}"
    match because:
        case Reason.LOST:
            told = f"an internal error prevented {f.lost}"
        case Reason.ONE_LAW if f.law is not None:
            told = (
                f"one law that depends on {f.law.over} explains the recording better than"
                f" {_replaced(f)} together"
            )
        case Reason.OTHER if f.other is not None:
            told = f.other.sentence
        case Reason.LEFT:
            told = f"beyond the named effects, this remains: {f.left.sentence}" if f.findings else (
                f.left.sentence)  # fmt: skip
        case Reason.INADEQUATE if f.sound is not None:
            told = _inadequate(f.sound)
        case Reason.BAD:
            told = f.bad
        case Reason.MORE:
            told = "the named effects explain the recording only in part"
        case Reason.ONE_REGIME:
            told = _one_regime(f)
        case Reason.DISTURBED:
            told = (
                "the named effects explain the error of free runs on held-out data only together"
                " with large random forces"
            )
        case Reason.UNJUDGED:
            told = (
                "there is too little held-out data to judge by: record for longer, or give a second"
                " recording with --validate"
            )
        case Reason.UNCONFIRMED:
            told = (
                "leaving out any one of the named effects makes the prediction of held-out data no"
                " worse, within the scatter of the free runs: record more of the motion in which"
                " the effects would matter"
            )
        case Reason.ONE_LEVEL:
            told = (
                f"the command has only one level, and {error}; this error is too large to tell the"
                " found effects from the next best explanation"
            )
        case Reason.RIVALS:
            told = _nearest(f)
        case Reason.IMPROBABLE if doubtful is not None:
            told = (
                f"the probability of {the_effect(doubtful.effect)}"
                f" {place_in_words(place_at(doubtful.at), f.masses)} is"
                f" {doubtful.with_richer or 0.0:.2g}, and {VERDICT.sure:g} is required"
            )
        case Reason.DOUBTED:
            told = f"{f.left.hint}; five sigma are required to prefer it"
        case Reason.WITH_LEVEL:
            told = (
                "a parameter changes at the same time as the level of the command, so a law of"
                " speed or force that is not in the library explains as much; to tell them apart,"
                " record a run in which the level returns to its first value"
            )
        case Reason.ONE_PERIOD:
            told = (
                f"{all_in_words(f.of_one_period, f.masses, sized=0)} repeat with the same period,"
                " so one law of position that is not in the library may cause all of them"
            )
        case Reason.TOUCHED:
            told = (
                f"{f.contacts} forces that acted once were excluded from the fit; unless somebody"
                " touched the device at these times, a law that is not in the library acts, and the"
                " named effects may stand for part of it"
            )
        case Reason.STRAY:
            told = (
                f"{error}, but measurement noise alone would cause {percent(free.noise_floor)}: the"
                " rest is due to disturbances, or to physics that this recording is too short or"
                " too coarse to show;"
                " record for longer, at a higher level, or with a finer sensor"
            )
        case Reason.LINEAR:
            told = f"{_differing(f)} by more than {VERDICT.apart:g} sigma"
        case Reason.NAMED:
            told = "every other explanation is clearly worse, and held-out data agree"
        case Reason.NOTHING:
            told = "no effect of the library is significant, and held-out data agree"
        case _:
            told = ""
    return "; ".join(filter(None, [told, law]))


def _nearest(f: Facts) -> str:
    """Say how near the nearest rival of each confusable effect is."""
    words: list[str] = []
    for one in f.findings:
        if not one.confusable_with:
            continue
        near = min(one.confusable_with, key=lambda r: r.separation_sigma)
        sigma = f"{near.separation_sigma:.1f}"
        far = "no worse" if sigma == "0.0" else f"only {sigma} sigma worse"
        instead = _at(near.effect, near.at, f.masses)
        own = the_effect(one.effect)
        if near.effect == one.effect:
            own = f"{own} {place_in_words(place_at(one.at), f.masses)}"
        words.append(f"{far} with {instead} in place of {own}")
    enough = f"{VERDICT.apart:g} sigma are required"
    return f"the fit is {listed(words)}; to tell two effects apart, {enough}"


def _replaced(f: Facts) -> str:
    gone = () if f.law is None else f.law.curve.replaced
    return " and ".join(n for one in f.findings if (n := f"{one.effect} at {one.at}") in gone)


def _one_regime(f: Facts) -> str:
    """Say in which regime a named effect fails, and what to record."""
    odd, at = next((one, h) for one in f.findings for h in one.regimes if h.fails)
    return (
        f"{odd.effect} at {odd.at}, fitted to the motion {at.other}, makes the prediction of the"
        f" motion {at.regime} worse; record more of the motion {at.regime}"
    )


def _inadequate(sound: Adequacy) -> str:
    """Say why held-out data do not confirm an answer."""
    if sound.sound:
        return (
            "the named effects predict held-out data no better than the refitted device without"
            " them"
        )
    worst = max(sound.ahead, key=lambda a: a.error / a.most)
    if worst.error >= OVERFLOW:
        return "free runs with the answer diverge"
    if worst.error > worst.most:
        return (
            f"the error of free runs over {worst.horizon:.3g} s on held-out data is"
            f" {worst.error / worst.expected:.3g} times what the noise of this model would cause"
        )
    led = max(sound.ahead, key=lambda a: a.led - a.most_led)
    return (
        f"forces that depend on the motion would explain {100.0 * led.led:.0f} % of the squared"
        f" error of free runs over {led.horizon:.3g} s on held-out data; of noise alone they would"
        f" explain at most {100.0 * led.most_led:.0f} %"
    )


def where(located: Located, masses: int) -> str:
    """Say where the refitted device and the recording differ, before any effect is named.

    If forces at several places or over several states explain about as much as the best, all are
    listed, since so small a difference does not decide between them.
    """
    top = max(located.maps, key=lambda m: m.gained, default=None)
    if top is None:
        return located.sentence
    if not stands_out(top):
        return (
            "no force that depends on position, velocity, command or time stands out from the noise"
        )
    near = [m for m in located.maps if m.gained >= VERDICT.as_much * top.gained]
    near.sort(key=lambda m: -m.gained)
    at = listed(
        [place_in_words(place_at(p), masses) for p in dict.fromkeys(m.place for m in near)], "or"
    )
    states = list(dict.fromkeys(m.against for m in near))
    if len(states) > 1:
        return (
            f"{densest(located.state)}before effects are added, a force {at} describes what is"
            f" missing about equally well, whether it depends on {listed(states, 'or')}"
        )
    like = "changes with time" if top.against == "time" else f"depends on {top.against}"
    return (
        f"{densest(located.state)}before effects are added, a force {at} that {like}{sign_of(top)}"
        " best describes what is missing"
    )


def cautions(findings: Sequence[Finding], free: HeldOut, whole: Sequence[WholeRun]) -> list[str]:
    """Return the warnings of an answer that makes a simulation worse, without their full stops.

    free, whole: free runs over windows of held-out data, and over whole recordings.
    """
    by = "the found effects" if findings else "the refitted parameters"
    if free.after > VERDICT.worse_file * free.before:
        return [
            f"with {by}, free runs on held-out data have an error of {of_the_motion(free.after)},"
            f" more than with the device file as it is ({percent(free.before)}): do not simulate"
            " with the improved device"
        ]
    return [
        f"over the whole run, the error of the {run.output.replace('_', ' of ')} in {run.recording}"
        f" is {'without bound' if math.isinf(after) else with_unit(after, run.unit, 3)} with {by},"
        f" more than with the device file as it is ({with_unit(before, run.unit, 3)})"
        for run in whole
        for before, after in [(run.errors["before"], run.errors["after"])]
        if after > VERDICT.worse_file * before
    ]
