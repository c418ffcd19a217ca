"""The result of a diagnosis, as values and as the JSON of `zwidth diagnose` (docs/diagnosis.md)."""

from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zwidth.diagnosis.account import counts
from zwidth.diagnosis.answer.adequacy import Adequacy
from zwidth.diagnosis.forces.locate import NOWHERE, Located
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.mishaps import Mishap
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.searched import Searched
from zwidth.diagnosis.settings import VERDICT
from zwidth.shown import Shown, Valued
from zwidth.sim.device import Device
from zwidth.sim.physics import contains
from zwidth.sim.physics.effect import Effect
from zwidth.sim.place import place_at

if TYPE_CHECKING:
    from zwidth.diagnosis.answer.changes import Change
    from zwidth.diagnosis.answer.consequence import Worth
    from zwidth.diagnosis.answer.events import Event
    from zwidth.diagnosis.answer.inverse import ForceError
    from zwidth.diagnosis.answer.laws import LearnedLaw, LearnedSurface
    from zwidth.diagnosis.answer.levels import NextLevel
    from zwidth.diagnosis.answer.whole_run import WholeRun

Floats = NDArray[np.float64]


class Verdict(Enum):
    """The first line of a diagnosis; the value is the word in the JSON."""

    NOTHING_MISSING = "nothing_missing"
    IDENTIFIED = "identified"
    CONFUSABLE = "confusable"
    UNKNOWN_PHYSICS = "unknown_physics"
    LINEAR_PARAMETERS = "linear_parameters"
    RECORDING_FAULT = "recording_fault"
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class Estimate(Valued):
    """A value with its 95 % interval."""

    value: float
    lower: float
    upper: float
    unit: str = ""

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {"value": self.value, "unit": self.unit, "ci95": [self.lower, self.upper]}


@dataclass(frozen=True)
class Rival(Valued):
    """A rival effect: how many sigma worse it explains the recording.

    probability: None if no answer is adequate, or if its own fit ended beyond the law's bounds.
    """

    effect: str
    at: str
    separation_sigma: float
    probability: float | None = None


@dataclass(frozen=True)
class Held(Valued):
    """How well an effect predicts a regime that was not fitted (`answer.regimes`).

    other: the motion that was fitted. sigma: of the comparison with a model without the effect;
    fails: whether that model is believed in the regime.
    """

    regime: str
    other: str
    sigma: float
    fails: bool


def magnitudes(effect: Effect) -> dict[str, float]:
    """Return the magnitudes of an effect, each with the value at which the effect does nothing."""
    sizes = (p for p in effect.parameters if p.role in ("magnitude", "strength"))
    return {p.name: p.none_of_it() for p in sizes if p.neutral is not None}


@dataclass(frozen=True)
class Finding(Valued):
    """One effect of an answer.

    separation_sigma: how much better the best model with the effect is than the best without.
    rivals: other effects in its place, nearest first. probability: that the device has the effect,
    among all hypotheses that were fitted; None if it was seen in the recording itself, or if no
    hypothesis is adequate. with_richer: probability that the device has the effect or a richer
    form, which decides the verdict. regimes: how well the effect predicts parts of the motion that
    were not fitted. worth: how much larger the error of free runs on held-out data is without it;
    None if nothing was held out or the effect is not part of the model (`answer.consequence`).
    clear: whether its magnitudes together are not zero, though each of them may be.
    """

    effect: str
    at: str
    parameters: dict[str, Estimate]
    separation_sigma: float
    rivals: tuple[Rival, ...]
    probability: float | None = None
    regimes: tuple[Held, ...] = ()
    with_richer: float | None = None
    worth: "Worth | None" = None
    clear: bool = False

    @property
    def confusable_with(self) -> tuple[Rival, ...]:
        """Rivals within five sigma, without those that contain this effect."""
        own = self.effect, place_at(self.at)
        return tuple(
            r
            for r in self.rivals
            if r.separation_sigma < VERDICT.apart and not contains(r.effect, place_at(r.at), *own)
        )

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "effect": self.effect,
            "at": self.at,
            "parameters": {k: v.as_json() for k, v in self.parameters.items()},
            "separation_sigma": self.separation_sigma,
            "probability": self.probability,
            "probability_with_richer": self.with_richer,
            "rivals": [vars(r) for r in self.rivals],
            "regimes": [vars(h) for h in self.regimes],
            "worth": self.worth and vars(self.worth),
        }

    def without_probability(self) -> "Finding":
        """Return the finding without its probability, for an answer that is not adequate.

        No fitted hypothesis is adequate then, so their relative weights are not probabilities.
        """
        rivals = tuple(replace(r, probability=None) for r in self.rivals)
        return replace(self, rivals=rivals, probability=None, with_richer=None)


@dataclass(frozen=True)
class HeldOut(Valued):
    """rms error over rms of the signal on data not fitted to; noise_floor: the unavoidable part.

    typical: of free runs, the error of the answer's typical one (`straying`), None for `after`.
    """

    before: float
    refit: float
    after: float
    noise_floor: float
    typical: float | None = None

    def as_json(self) -> dict[str, float]:
        """Return the JSON form."""
        return {name: value for name, value in vars(self).items() if name != "typical"}


UNKNOWN_FIT = HeldOut(np.nan, np.nan, np.nan, np.nan)


@dataclass(frozen=True)
class Residuals(Valued):
    """Innovations in units of their noise, (ticks, outputs), of the refit and of the answer."""

    period: float
    before: Floats
    after: Floats


@dataclass(frozen=True)
class NextExperiment(Valued):
    """A scenario file whose excitation separates two effects.

    sigmas: excitation -> distance, or an upper limit of it where another excitation is better.
    """

    excitation: str
    scenario: Path
    separates: tuple[str, str]
    separation_sigma: float
    sigmas: dict[str, float]

    def as_json(self) -> dict[str, object]:
        """Return the JSON form of `zwidth diagnose`."""
        return {
            "scenario": str(self.scenario),
            "separates": list(self.separates),
            "separation_sigma": self.separation_sigma,
        }


@dataclass(frozen=True, repr=False)
class Diagnosis(Shown):
    """The result of a diagnosis. device: improved by the findings, with refitted parameters.

    headline: the answer in one line; sentence: the reason for the verdict; both without a full stop
    (`answer.words`). cautions: warnings for its use; next_level: another level to record, if all
    commands have one level. searched: the result of the search; experiments: the recordings as they
    were read. errors: internal errors that prevented a part of the answer; left_out: indices of
    recordings that could not be used because of errors. negligible: effects that are detected, but
    too small to matter (`answer.consequence`).
    """

    verdict: Verdict
    sentence: str
    findings: tuple[Finding, ...]
    linear_refit: dict[str, tuple[float, Estimate]]
    located: Located
    one_step: HeldOut
    free_run: HeldOut
    upper_bounds: dict[str, dict[str, float]]
    faults: tuple[Fault, ...]
    device: Device
    residuals: Residuals
    searched: Searched
    experiments: tuple[Experiment, ...]
    interrupted: bool = False
    facts: dict[str, Any] = field(default_factory=dict[str, Any])
    next_experiment: NextExperiment | None = None
    next_level: "NextLevel | None" = None
    errors: tuple[Mishap, ...] = ()
    left_out: tuple[int, ...] = ()
    adequacy: Adequacy | None = None
    whole_runs: "tuple[WholeRun, ...]" = ()
    force_errors: "tuple[ForceError, ...]" = ()
    learned: "LearnedLaw | LearnedSurface | None" = None
    headline: str = ""
    cautions: tuple[str, ...] = ()
    changes: "tuple[Change, ...]" = ()
    events: "tuple[Event, ...]" = ()
    cost: dict[str, Any] = field(default_factory=dict[str, Any])
    negligible: tuple[Finding, ...] = ()

    def predict(self, u_test: ArrayLike, y_first: ArrayLike) -> Floats:
        """Return the outputs of the improved device under a new command.

        u_test (ticks,): a command for every period of the recordings [N, N m; or the recordings'
        own units, if they were diagnosed in these]. y_first (n,), of one output, or (n, outputs):
        the first samples measured under u_test, in the order of the recordings' outputs [m, rad,
        m/s, rad/s; N, N m of a drive's force], at least ten.

        The state is estimated from y_first; after it the device runs free, with a learned law if
        this is known well. Returns (ticks,) or (ticks, outputs) in the same units, beginning with
        y_first; infinite after an overflow. Raises ValueError, with advice, if an array has another
        shape or is not finite, or if the recordings had to be corrected (a wrong sign or unit,
        exchanged columns, a late command).
        """
        from zwidth.diagnosis.answer.prediction import predicted  # it imports this module

        smooth = self.device.interface.command_hold == "smooth"
        return predicted(
            self.predicts_with, self.experiments[0], self.faults, smooth, u_test, y_first
        )

    @cached_property
    def predicts_with(self) -> Searched:
        """The fit that `predict` runs: with a well-known law, or with parameters for long runs.

        The first access may fit for some seconds (`answer.prediction`).
        """
        from zwidth.diagnosis.answer.prediction import predicts

        return predicts(self.searched, self.learned, self.experiments)

    def as_json(self) -> dict[str, Any]:
        """Return the JSON of `zwidth diagnose`."""
        where = {name: value for name, value in vars(self.located).items() if name != "maps"}
        one, free = self.one_step.as_json(), self.free_run.as_json()
        return {
            "verdict": self.verdict.value,
            "headline": self.headline,
            "sentence": self.sentence,
            "warnings": list(self.cautions),
            "findings": [f.as_json() for f in self.findings],
            "negligible": [f.as_json() for f in self.negligible],
            "linear_refit": {
                k: {"nominal": nominal, **e.as_json()}
                for k, (nominal, e) in self.linear_refit.items()
            },
            "where": where,
            "fit": {
                "held_out": one, "one_step": one, "free_run": free,
                "whole_run": [run.as_json() for run in self.whole_runs],
                "force": [force.as_json() for force in self.force_errors],
            },
            "adequacy": self.adequacy and self.adequacy.as_json(),
            "learned": self.learned and self.learned.as_json(),
            "changes": [change.as_json() for change in self.changes],
            "events": [event.as_json() for event in self.events],
            "upper_bounds": self.upper_bounds,
            "faults": [vars(f) for f in self.faults],
            "next_experiment": self.next_experiment and self.next_experiment.as_json(),
            "next_level": self.next_level and self.next_level.as_json(),
            "interrupted": self.interrupted,
            "facts": self.facts,
            "cost": counts(self.cost),
            "errors": [m.as_json() for m in self.errors],
        }  # fmt: skip


@dataclass(frozen=True)
class Unanswered(Valued):
    """The result if an error prevents a diagnosis: faults of recordings, and errors."""

    sentence: str
    faults: tuple[Fault, ...]
    errors: tuple[Mishap, ...]

    @property
    def headline(self) -> str:
        """Return the first line."""
        return "Undecided: an error prevented any answer"

    def as_json(self) -> dict[str, Any]:
        """Return the JSON of `zwidth diagnose`, with empty values for what is unknown."""
        lists = ("warnings", "findings", "negligible", "changes", "events")
        tables = ("linear_refit", "upper_bounds", "facts", "cost")
        unknown = ("adequacy", "learned", "next_experiment", "next_level")
        where = ("time", "frequency_hz", "state", "entry")
        fits = ("held_out", "one_step", "free_run")
        return {
            "verdict": Verdict.UNDECIDED.value,
            "headline": self.headline,
            "sentence": self.sentence,
            "where": {"sentence": NOWHERE.sentence} | {name: list[Any]() for name in where},
            "fit": {name: UNKNOWN_FIT.as_json() for name in fits}
            | {name: list[Any]() for name in ("whole_run", "force")},
            "faults": [vars(f) for f in self.faults],
            "interrupted": False,
            "errors": [m.as_json() for m in self.errors],
            **{name: list[Any]() for name in lists},
            **{name: dict[str, Any]() for name in tables},
            **dict.fromkeys(unknown),
        }


class NotDiagnosed(Exception):
    """An error prevented any conclusion; `unanswered` holds the results up to it."""

    def __init__(self, unanswered: Unanswered) -> None:
        super().__init__(unanswered.sentence)
        self.unanswered = unanswered
