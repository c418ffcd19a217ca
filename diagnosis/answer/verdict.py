"""The verdict: a pure function of all results, called once they are complete.

`reason` returns the first reason of its list that holds, and each reason has one verdict.
`answer.words` puts both into words.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from zwidth.diagnosis.answer.adequacy import Adequacy
from zwidth.diagnosis.answer.levels import NextLevel
from zwidth.diagnosis.answer.result import UNKNOWN_FIT, Estimate, Finding, HeldOut, Verdict
from zwidth.diagnosis.answer.straying import beyond_noise, wander
from zwidth.diagnosis.fitting.uncertainty import Z95
from zwidth.diagnosis.forces.unknown import Instead
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.settings import ADEQUACY, VERDICT

if TYPE_CHECKING:
    from zwidth.diagnosis.answer.laws import Law


class Reason(Enum):
    """Reasons for a verdict; the first that holds decides."""

    LOST = "an internal error prevented a result that the verdict needs"
    ONE_LAW = "one learned law explains the recording better than several named effects"
    OTHER = "unknown physics explains more than a named effect"
    LEFT = "a force without a name remains"
    INADEQUATE = (
        "errors of free runs on held-out data exceed the noise, or are as large as without the"
        " found effects"
    )
    BAD = (
        "the fit ended at the limit of an allowed range, or predicts worse than without the found"
        " effects"
    )
    MORE = "a learned law is needed in addition to the named effects"
    ONE_REGIME = "a named effect improves the prediction in one regime only"
    DISTURBED = "large random forces are needed in addition to the named effects"
    UNJUDGED = "there are no held-out data to judge the named effects"
    ONE_LEVEL = "a command of one level does not distinguish the named effects from others"
    RIVALS = "other effects explain the recording equally well"
    IMPROBABLE = "a named effect is not probable enough"
    DOUBTED = "a law outside the library is likelier than a named effect, by less than five sigma"
    WITH_LEVEL = (
        "a parameter that changes with the level of the command, which a law outside the library"
        " may have caused"
    )
    ONE_PERIOD = (
        "several named effects repeat with the same period, which one law outside the library may"
        " have caused"
    )
    TOUCHED = (
        "more than one contact was excluded from the fit; a law outside the library may have caused"
        " them"
    )
    UNCONFIRMED = "held-out data are predicted no worse if any one named effect is left out"
    NAMED = "the named effects are confirmed"
    LAW = "only a learned law explains the recording"
    STRAY = "no effect is named, and errors of free runs are larger than noise predicts"
    LINEAR = "only linear parameters differ"
    NOTHING = "nothing is missing"

    @property
    def verdict(self) -> Verdict:
        """The verdict for recordings without a fault."""
        return VERDICTS.get(self, Verdict.UNKNOWN_PHYSICS)


VERDICTS = {
    Reason.LOST: Verdict.UNDECIDED,
    Reason.UNJUDGED: Verdict.UNDECIDED,
    Reason.ONE_LEVEL: Verdict.UNDECIDED,
    Reason.UNCONFIRMED: Verdict.UNDECIDED,
    Reason.STRAY: Verdict.UNDECIDED,
    Reason.RIVALS: Verdict.CONFUSABLE,
    Reason.IMPROBABLE: Verdict.CONFUSABLE,
    Reason.DOUBTED: Verdict.CONFUSABLE,
    Reason.WITH_LEVEL: Verdict.CONFUSABLE,
    Reason.ONE_PERIOD: Verdict.CONFUSABLE,
    Reason.TOUCHED: Verdict.CONFUSABLE,
    Reason.NAMED: Verdict.IDENTIFIED,
    Reason.LINEAR: Verdict.LINEAR_PARAMETERS,
    Reason.NOTHING: Verdict.NOTHING_MISSING,
}
NAMES_STAND = (Verdict.CONFUSABLE, Verdict.IDENTIFIED)  # unless a law is better


@dataclass(frozen=True)
class Left:
    """The unexplained rest: the chi-square that an unknown force would gain, 0 for chance.

    whole: whether it shows only in the complete recordings, not in the fitted part. beside:
    chi-square that may remain beside the named effects. hint: a law outside the library that may
    be in the place of an effect, "" for none.
    """

    gained: float
    sentence: str
    whole: bool = False
    beside: float = 0.0
    hint: str = ""

    def matters(self, named: bool) -> bool:
        """Whether too much is left beside named effects or, without these, anything at all."""
        return self.gained > (self.beside if named else 0.0)


@dataclass(frozen=True)
class Facts:
    """Everything that a verdict depends on.

    refit: name -> (device file's, refitted) linear parameter; left: forces that remain beside the
    findings, other: unknown physics in their place; sound, free: results on held-out data; bad: why
    the fit is not acceptable, "" if it is; level: another level to record; law: a learned law,
    instead: whether it explains more than the named effects; lost: results that an error prevented,
    "" for none; masses: number in the device's chain; contacts: number of forces from outside that
    acted once; with_level: whether a parameter changes with the level of the command.
    """

    findings: Sequence[Finding]
    refit: dict[str, tuple[float, Estimate]]
    left: Left
    other: Instead | None = None
    sound: Adequacy | None = None
    free: HeldOut = UNKNOWN_FIT
    bad: str = ""
    level: NextLevel | None = None
    law: "Law | None" = None
    instead: bool = False
    lost: str = ""
    faults: Sequence[Fault] = ()
    masses: int = 1
    contacts: int = 0
    with_level: bool = False

    @property
    def verdict(self) -> Verdict:
        """The verdict; a fault of the recordings comes before anything found in them."""
        found = reason(self).verdict
        wrong = any(f.wrong for f in self.faults) and found is not Verdict.UNDECIDED
        return Verdict.RECORDING_FAULT if wrong else found

    @property
    def strays(self) -> bool:
        """Whether chance must explain much of the error of free runs."""
        free = self.free
        return wander(free.after if free.typical is None else free.typical, free.noise_floor)

    @property
    def moved(self) -> list[str]:
        """The linear parameters that differ from the device file, without those of readings."""
        far = VERDICT.apart / Z95 * 0.5
        return [
            name
            for name, (nominal, e) in self.refit.items()
            if abs(e.value - nominal) > far * (e.upper - e.lower)
            and name not in ("jitter", "skew")
            and not name.startswith("zero_")
        ]

    @property
    def doubtful(self) -> Finding | None:
        """The least probable of the named effects, if it is not probable enough."""
        known = [(f.with_richer, f) for f in self.findings if f.with_richer is not None]
        chance, least = min(known, key=lambda pair: pair[0], default=(1.0, None))
        return least if chance < VERDICT.sure else None

    @property
    def of_one_period(self) -> list[Finding]:
        """The named effects that repeat with position with the same period, if there are several.

        Together they describe whatever repeats so: three ripples, at the sensor and in both links,
        imitated an inertia that varies as its mass turns.
        """
        waves = [f for f in self.findings if "period" in f.parameters]
        periods = [f.parameters["period"] for f in waves]
        return [
            f
            for f, p in zip(waves, periods, strict=True)
            if sum(p.lower <= q.upper and q.lower <= p.upper for q in periods) > 1
        ]

    @property
    def confirmed(self) -> bool:
        """Whether held-out data are predicted better with one of the named effects, beyond scatter.

        Of 45 answers of two exams that were identified, one was not confirmed: a ripple beside a
        push, where the truth was a law of position and speed. In the others, the clearest effect
        had 1.1 sigma or more.
        """
        worth = [one.worth for one in self.findings]
        known = [w for w in worth if w is not None and w.sigma != 0.0]  # 0: too few runs
        return not known or any(w.times > 1.0 and w.sigma > ADEQUACY.scatter for w in known)

    @property
    def undecided_by_level(self) -> bool:
        """Whether another hypothesis is as good at the command's only level, but not at others."""
        error = self.free.after
        if self.level is None or not self.level.now < error < self.level.differs:
            return False
        return beyond_noise(error, self.free.noise_floor)


def reason(f: Facts) -> Reason:
    """Return the reason for the verdict."""
    named = bool(f.findings)
    if f.lost:
        return Reason.LOST
    if f.instead:
        return Reason.ONE_LAW
    if f.other is not None:
        return Reason.OTHER
    if f.left.matters(named):
        return Reason.LEFT
    if f.sound is not None and not (f.sound.adequate if named else f.sound.sound):
        return Reason.INADEQUATE
    if named:
        return _of_names(f)
    if f.strays:
        return Reason.STRAY if f.law is None else Reason.LAW
    return Reason.LINEAR if f.moved else Reason.NOTHING


def _of_names(f: Facts) -> Reason:
    """The reason if effects are named and nothing else is left."""
    if f.bad:
        return Reason.BAD
    if f.law is not None and not f.law.turns:  # a periodic law is a ripple's shape
        return Reason.MORE
    if any(h.fails for one in f.findings for h in one.regimes):
        return Reason.ONE_REGIME
    if f.strays:
        return Reason.DISTURBED
    if f.sound is None:
        return Reason.UNJUDGED
    if f.undecided_by_level:
        return Reason.ONE_LEVEL
    if any(one.confusable_with for one in f.findings):
        return Reason.RIVALS
    if f.doubtful is not None:
        return Reason.IMPROBABLE
    if f.left.hint:
        return Reason.DOUBTED
    if f.with_level:
        return Reason.WITH_LEVEL
    if f.of_one_period:
        return Reason.ONE_PERIOD
    if f.contacts > 1:
        return Reason.TOUCHED
    return Reason.NAMED if f.confirmed else Reason.UNCONFIRMED
