"""Did the command have one level only? If so, the level to record next.

With steps between +A and -A, a friction F hardly differs from a command of A - F. Effects that
depend on the size of the motion (dry friction, drag, a dead band, a limit) differ from linear
parameters only in how the motion reverses, and from one another by even less. A second level
distinguishes them at once. Simulations show which level: the recordings are repeated at shares of
their level by the answer and by the hypotheses nearest to it, each as it was fitted. Relative to
the motion they differ by

    d(share) = least of the others (rms(y_answer - y_other) / rms(y_answer)),

and the best share is the one with the largest d among those at which the device still moves.

If the error of free runs on held-out data, relative to the motion, exceeds the noise of readings
and lies between d(1) and d(share), another hypothesis is as good at this level but not at another.
Then no effect is claimed, however much more likely it is.

Limits: only hypotheses that the search fitted are compared; other laws may need yet another level.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.straying import rms
from zwidth.diagnosis.answer.whole_run import simulated
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.searched import Searched
from zwidth.shown import Valued
from zwidth.sim.physics.effect import Physics
from zwidth.sim.readable import percent, plain, with_unit

Floats = NDArray[np.float64]
NOTHING = 0.05  # of the largest command, below which a command counts as zero
SAME = 1.25  # largest over smallest level, up to which they count as one level
SHARES = (0.3, 0.5, 0.75, 1.5, 2.0)  # shares of the level that are simulated
MOVES = 0.2  # of a motion proportional to the command, below which a device hardly moves
OTHERS = 3  # hypotheses beside the refit that the answer is compared with
BENDING = ("friction", "force", "command")  # hooks of laws that do not grow with the motion


@dataclass(frozen=True)
class NextLevel(Valued):
    """The only level of all commands [unit], the share to record next, the difference there.

    differs: distance of answer and nearest other at that level, relative to the motion; now: the
    same at the recorded level.
    """

    level: float
    unit: str
    share: float
    differs: float
    now: float

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {**vars(self), "sentence": self.sentence}

    @property
    def advice(self) -> str:
        """Which level to record."""
        level = with_unit(self.share * self.level, self.unit, 3)
        return f"repeat the recording at {level} ({plain(self.share, 2)} times the present level)"

    @property
    def sentence(self) -> str:
        """Say what to record, without a full stop."""
        return (
            f"the command has a single level, {with_unit(self.level, self.unit, 3)}, at which"
            f" friction looks like a weaker command: {self.advice} and diagnose both together; at"
            " the new level, the predictions of this answer and of its nearest rival differ by"
            f" {percent(self.differs)} of the motion, instead of {percent(self.now)}"
        )


def next_level(
    found: Searched, fitted: Sequence[Experiment], judge_by: Sequence[Experiment]
) -> NextLevel | None:
    """Return the level to record next.

    None if the recordings have several levels, or recording another would not help. If nothing was
    found, the refit is the answer, which other levels may refute.
    """
    bends = [p for p in found.final.model.effects if _bends(p)]
    if found.final.model.effects and not bends:
        return None
    model, x = found.final.model, found.final.x
    level = one_level([e.joined() for e in (*fitted, *judge_by)])
    if level is None or any(p.effect.of_drive for p in model.nominal.physics):
        return None
    others = _others(found)
    if not others:
        return None
    allowed = model.nominal.interface.command_limit
    shares = [s for s in SHARES if s * level <= allowed]
    differ = {s: _differs((model, x), others, found, fitted, s) for s in (1.0, *shares)}
    now = differ.pop(1.0)
    share = max(differ, key=lambda s: differ[s])
    if not differ[share] > now:
        return None
    unit = "N m" if model.nominal.rotary else "N"
    return NextLevel(level, unit, share, differ[share], now)


def one_level(experiments: Sequence[Experiment]) -> float | None:
    """Return the level of the commands of all recordings; None if they have several, or none."""
    size = np.abs(np.concatenate([e.command for e in experiments]))
    if any(e.pushed is not None for e in experiments) or not size.max() > 0.0:
        return None
    low, middle, high = np.quantile(size[size > NOTHING * size.max()], (0.05, 0.5, 0.95))
    return float(middle) if high <= SAME * low else None


def _bends(p: Physics) -> bool:
    return p.effect.hook in BENDING and p.effect.name != "constant_force"


def _others(found: Searched) -> list[tuple[Model, Floats]]:
    """The refit, and the most likely hypotheses that lack some effect of the answer."""
    own = found.tried.best.labels
    tried = [h for h in found.tried.tried.values() if h.model.effects and not own <= h.labels]
    tried.sort(key=lambda h: h.cost.total)
    refit = [(found.refit.model, found.refit.x)] if own else []
    return [*refit, *((h.model, h.x) for h in tried[:OTHERS])]


def _differs(
    answer: tuple[Model, Floats],
    others: Sequence[tuple[Model, Floats]],
    found: Searched,
    experiments: Sequence[Experiment],
    share: float,
) -> float:
    """Return d(share), 0 if the answer hardly moves or diverges."""
    least = np.inf
    played = [replace(e, command=share * e.command, measured=share * e.measured)
              for e in experiments]  # fmt: skip
    own = [simulated(*answer, e, found.judge, measured=False)[:, 0] for e in played]
    with np.errstate(all="ignore"):  # infinite after an overflow
        size = rms([y - y.mean() for y in own])
        recorded = rms([e.measured[:, 0] - e.measured[:, 0].mean() for e in experiments])
        if not MOVES * share * recorded < size < np.inf:
            return 0.0
        for other in others:
            theirs = [simulated(*other, e, found.judge, measured=False)[:, 0] for e in played]
            least = min(least, rms([a - b for a, b in zip(own, theirs, strict=True)]) / size)
    return least if np.isfinite(least) else 0.0
