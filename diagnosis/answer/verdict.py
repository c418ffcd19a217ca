"""What a diagnosis concludes: one pure function of facts, asked once.

`refuted` says why what was named (or nothing) does not explain the recordings; the stages before
ask it to know what else to look for. `verdict` decides. The first reason that holds counts:

    lost          an error took a part that the verdict rests on
    left          a force remains that has no name, of more than `left_share` of what names explain
    inadequate    free runs on held-out data err farther than noise makes them, follow the motion,
                  run away, or are no better than without the names
    regime        a name holds in a part of the recordings only
    disturbed     only disturbances by chance explain what free runs err by beside the names
    unjudged      too little was held out to judge names by
    one level     at the one level of the command others explain as much
    law           one law without a name explains it better than several names
    rival, odds   another effect is within `apart_sigma`, or the probability is below `probable`
    named         the effects are missing
    chance        nothing is named, and free runs err beyond the noise of readings
    parameters    linear parameters differ
    nothing       nothing is missing
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from zwidth.diagnosis.answer.result import Estimate, Finding, Verdict
from zwidth.diagnosis.answer.validate import UNKNOWN_FIT, Adequacy, Held, HeldOut
from zwidth.diagnosis.fitting.uncertainty import Z95
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.settings import VERDICT
from zwidth.diagnosis.settings import Verdict as Settings
from zwidth.sim.predict import OVERFLOW

if TYPE_CHECKING:
    from zwidth.diagnosis.answer.whole_run import NextLevel


@dataclass(frozen=True)
class Left:
    """What the final model leaves: chi-square that an unknown force would gain, 0 for chance.

    whole: in all that was recorded, and not where it was fitted.
    """

    gained: float
    sentence: str
    whole: bool = False


NOTHING_LEFT = Left(0.0, "")


@dataclass(frozen=True)
class Law:
    """A law of no name that was learned and holds on held-out data.

    instead: whether it is the answer rather than several names. replaced: the names ("effect at
    place") that it stands for; over: the state that it is over; sentence and headline: it in words.
    """

    instead: bool
    replaced: tuple[str, ...]
    over: str
    sentence: str
    headline: str


@dataclass(frozen=True)
class Facts:
    """All that a verdict rests on.

    explained: chi-square that the names take away; coloured: whether the noise model leaves colour,
    so that chi-square is no statistic. refit: name -> (device file's, refitted). adequacy and free:
    what held-out data say. level: where the command has one level, what another would tell. lost:
    what errors took; untried: effects that errors kept from being tried.
    """

    findings: tuple[Finding, ...] = ()
    refit: Mapping[str, tuple[float, Estimate]] = field(
        default_factory=dict[str, tuple[float, Estimate]]
    )
    left: Left = NOTHING_LEFT
    explained: float = 0.0
    coloured: bool = False
    adequacy: Adequacy | None = None
    free: HeldOut = UNKNOWN_FIT
    level: "NextLevel | None" = None
    law: Law | None = None
    faults: tuple[Fault, ...] = ()
    lost: tuple[str, ...] = ()
    untried: tuple[str, ...] = ()


class Reason(Enum):
    """Why a verdict is what it is."""

    LEFT = "left"
    NO_BETTER = "no better than without"
    ERRS = "free runs err"
    FOLLOWS = "free runs follow the motion"
    RUNS_AWAY = "free runs run away"
    REGIME = "regime"
    DISTURBED = "disturbed"
    UNJUDGED = "unjudged"
    ONE_LEVEL = "one level"
    LAW = "law"
    RIVAL = "rival"
    IMPROBABLE = "improbable"
    NAMED = "named"
    CHANCE = "chance"
    PARAMETERS = "parameters"
    NOTHING = "nothing"


CONCLUDED = {
    Reason.UNJUDGED: Verdict.UNDECIDED,
    Reason.ONE_LEVEL: Verdict.UNDECIDED,
    Reason.RIVAL: Verdict.CONFUSABLE,
    Reason.IMPROBABLE: Verdict.CONFUSABLE,
    Reason.NAMED: Verdict.IDENTIFIED,
    Reason.CHANCE: Verdict.UNDECIDED,
    Reason.PARAMETERS: Verdict.LINEAR_PARAMETERS,
    Reason.NOTHING: Verdict.NOTHING_MISSING,
}
"""Of each reason; of all others physics without a name is missing."""


@dataclass(frozen=True)
class Decision:
    """The verdict, and that on the physics alone, before what is wrong with the recordings.

    reason: why; about: the finding that it is about, where it is about one; findings: those that
    the answer states, without probabilities where none of the hypotheses is adequate.
    """

    verdict: Verdict
    physics: Verdict
    reason: Reason
    about: Finding | None
    findings: tuple[Finding, ...]


def verdict(facts: Facts, settings: Settings = VERDICT) -> Decision:
    """Decide."""
    reason, about = reason_of(facts, settings)
    physics = CONCLUDED.get(reason, Verdict.UNKNOWN_PHYSICS)
    if facts.law is not None and reason is Reason.CHANCE:  # what was said of chance does not stand
        physics = Verdict.UNKNOWN_PHYSICS
    if facts.lost:
        physics = Verdict.UNDECIDED
    findings = facts.findings
    if reason is Reason.LAW and facts.law is not None:
        findings = tuple(f for f in findings if f.label not in facts.law.replaced)
    if physics is Verdict.UNKNOWN_PHYSICS:
        findings = tuple(f.without_probability() for f in findings)
    wrong = any(f.wrong for f in facts.faults) and physics is not Verdict.UNDECIDED
    return Decision(Verdict.RECORDING_FAULT if wrong else physics, physics, reason, about, findings)


def refuted(facts: Facts, settings: Settings = VERDICT) -> tuple[Reason, Finding | None] | None:
    """Return why the recordings are not explained by what was named; None where they are."""
    if matters(facts.left, facts.explained, facts.coloured, bool(facts.findings), settings):
        return Reason.LEFT, None
    if (inadequate := _inadequate(facts)) is not None:
        return inadequate, None
    odd = next((f for f in facts.findings if failing(f) is not None), None)
    if odd is not None:
        return Reason.REGIME, odd
    if facts.findings and facts.free.strays:
        return Reason.DISTURBED, None
    return None


def matters(
    left: Left, explained: float, coloured: bool, named: bool, settings: Settings = VERDICT
) -> bool:
    """Whether what is left is too much for a verdict by name, or there is no name."""
    share = settings.left_share_coloured if coloured else settings.left_share
    return left.gained > 0.0 and (not named or left.gained > share * max(explained, 1.0))


def failing(finding: Finding) -> Held | None:
    """Return the regime in which a finding does not hold, None where it holds everywhere."""
    return next((h for h in finding.regimes if h.fails), None)


def _inadequate(facts: Facts) -> Reason | None:
    sound = facts.adequacy
    if sound is None or (sound.adequate if facts.findings else sound.sound):
        return None
    if sound.sound:
        return Reason.NO_BETTER
    worst = max(sound.ahead, key=lambda a: a.error / a.most)
    if worst.error <= worst.most:
        return Reason.FOLLOWS
    return Reason.RUNS_AWAY if worst.error >= OVERFLOW else Reason.ERRS


def reason_of(facts: Facts, settings: Settings = VERDICT) -> tuple[Reason, Finding | None]:
    """Return the first reason that holds, and the finding that it is about."""
    if (against := refuted(facts, settings)) is not None:
        return against
    if facts.findings:
        return _of_names(facts, settings)
    if facts.free.strays:
        return Reason.CHANCE, None
    moved = any(differs(name, *both, settings) for name, both in facts.refit.items())
    return (Reason.PARAMETERS if moved else Reason.NOTHING), None


def _of_names(facts: Facts, settings: Settings) -> tuple[Reason, Finding | None]:
    """Why names that nothing refutes are promised, or not."""
    if facts.adequacy is None:
        return Reason.UNJUDGED, None
    free, level = facts.free, facts.level
    if level is not None and level.undecides(free.after, free.noise_floor):
        return Reason.ONE_LEVEL, None
    if facts.law is not None and facts.law.instead:
        return Reason.LAW, None
    confused = next((f for f in facts.findings if f.confusable_with), None)
    if confused is not None:
        return Reason.RIVAL, confused
    odds = [(f.with_richer, f) for f in facts.findings if f.with_richer is not None]
    least, doubtful = min(odds, key=lambda pair: pair[0], default=(1.0, None))
    if least < settings.probable:
        return Reason.IMPROBABLE, doubtful
    return Reason.NAMED, None


def differs(name: str, nominal: float, refitted: Estimate, settings: Settings = VERDICT) -> bool:
    """Whether a linear parameter is clearly not as the device file says.

    Not by how a recording is read: when commands arrive, and where an output has its zero.
    """
    sigma = 0.5 * (refitted.upper - refitted.lower) / Z95
    apart = abs(refitted.value - nominal) > settings.apart_sigma * sigma
    return apart and name != "jitter" and not name.startswith("zero_")
