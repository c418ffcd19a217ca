"""A law of no name, as an answer says it: its curve, its formula, and what it is worth."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from zwidth.diagnosis.answer.held_out import held_out
from zwidth.diagnosis.answer.result import HeldOut
from zwidth.diagnosis.learning.curves import Learned, learn
from zwidth.diagnosis.learning.formulas import Formula, formulas
from zwidth.diagnosis.mishaps import Say
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.searched import Searched, as_found
from zwidth.sim.device import Device

BETTER = 0.95  # of the error of the names' free runs, below which a law is worth having
LETTERS = {"free_spring": "q", "free_damper": "v", "free_amplifier": "u", "free_sensor": "q"}
QUANTILES = (0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0)


@dataclass(frozen=True)
class LearnedLaw:
    """A law, the formulas it looks like (cheapest first, none: of no form), and held-out fits.

    names, law: errors over the motion of free runs on held-out data, with the names that are
    believed alone, and with the law. found: the fit with it.
    """

    curve: Learned
    formulas: tuple[Formula, ...]
    names: HeldOut
    law: HeldOut
    found: Searched

    @property
    def letter(self) -> str:
        """What the formulas call the state."""
        return LETTERS[self.curve.physics.effect.name]

    @property
    def formula(self) -> str:
        """What it looks like, "" for no form."""
        return self.formulas[0].text(self.letter) if self.formulas else ""

    @property
    def sentence(self) -> str:
        """Say what was learned, and what it is worth."""
        curve = self.curve
        what = {
            "free_amplifier": "what is added to the command",
            "free_sensor": "what the reading errs by",
        }.get(curve.physics.effect.name, f"a force at {curve.physics.at}")
        looks = f", which looks like {self.formula}," if self.formula else ""
        own, other = 100.0 * self.law.after, 100.0 * self.names.after
        return (
            f"learned from it: {what} over {curve.over}{looks} with which free runs on held-out"
            f" data err {own:.2g} % of the motion ({other:.2g} % without)"
        )

    def as_json(self) -> dict[str, Any]:
        """Return the JSON of `zwidth diagnose`."""
        curve = self.curve
        return {
            "effect": curve.physics.effect.name,
            "at": curve.physics.at,
            "over": curve.over,
            "odd": curve.odd,
            "points": [
                {"state": s, "force": f, "lower": low, "upper": high}
                for s, f, low, high in np.column_stack(
                    [curve.states, curve.forces, curve.lower, curve.upper]
                ).tolist()
            ],
            "seen": dict(
                zip(map(str, QUANTILES), np.quantile(curve.seen, QUANTILES).tolist(), strict=True)
            ),
            "formula": self.formula or None,
            "formulas": [
                {"form": f.form.name, "text": f.text(self.letter), "numbers": f.numbers,
                 "chance": f.chance, "cost": f.cost}
                for f in self.formulas
            ],
            "beside": list(curve.names),
            "gained": curve.gained,
            "free_run": {"names": self.names.after, "law": self.law.after},
        }  # fmt: skip


def learned(
    device: Device, found: Searched, judge_by: Sequence[Experiment], names: HeldOut, say: Say
) -> LearnedLaw | None:
    """Learn a law where names do not explain a recording; None where none holds on other data.

    names: free runs on held-out data of what is named.
    """
    say("no name explains it: learning a law")
    curve = learn(found.tried, say)
    if curve is None:
        return None
    with_law = as_found(device, replace(found.tried, best=curve.hypothesis))
    _, free = held_out(device, with_law, judge_by)
    if not free.after < BETTER * names.after:
        say("the law that was learned does not hold on held-out data")
        return None
    like = formulas(curve.states, curve.forces, curve.covariance, curve.odd)
    return LearnedLaw(curve, tuple(like), names, free, with_law)
