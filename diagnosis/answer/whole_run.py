"""Free runs over whole recordings; and at another level of the command, which to record next.

Whole runs: each output as a user knows it, in units and over the motion. The model starts where the
recording does and is never corrected. What was taken otherwise than it was recorded is turned back:
a position that was counted from a velocity is differenced and filtered again,
v_k = a v_(k-1) + (1 - a) (q_k - q_(k-1)) / T, and what was folded out is folded.

Levels: of steps between +A and -A a friction F is hardly more than a command of A - F. What bends
with the size of the motion (dry friction, drag, a dead band, a limit) is told from linear
parameters by how the motion turns alone, and laws that bend differently from each other by less. A
second level tells them at once. Which one, simulations say: the recordings are repeated at shares
of their level by the answer and by what comes nearest to it. Over the motion they differ by

    d(share) = least of the others (rms(y_answer - y_other) / rms(y_answer)),

and the share is best where d is largest among those at which the device still moves.

What free runs err on held-out data, over the motion, is how well the answer holds. Where that is no
noise of readings, more than d(1) and less than d(share), another hypothesis is as good at this
level and is not at another: of such an answer no name is promised, however much likelier it is.

Limits: the others are those that the search fitted; a law that nothing asked for may need more.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from zwidth.diagnosis.answer.validate import as_filed, rms
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.beginning import begun
from zwidth.diagnosis.noise.predictor import (
    Observer,
    memory_at,
    prepared,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.searched import Searched
from zwidth.diagnosis.settings import ADEQUACY, VERDICT
from zwidth.sim.device import Device
from zwidth.sim.physics.effect import Physics
from zwidth.sim.predict import alone
from zwidth.sim.readable import percent, plain, with_unit

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class WholeRun:
    """How far free runs are off over a recording, rms in the unit of an output.

    measured (ticks,), from begins [s] on, every period [s]; simulated (ticks,) "before", of the
    device file, "refit", "after", with what was found, and "law", with a law of no name that was
    learned, where one was. held_out: whether nothing was fitted to it.
    """

    recording: str
    output: str
    unit: str
    begins: float
    period: float
    measured: Floats
    simulated: Mapping[str, Floats]
    held_out: bool

    @property
    def motion(self) -> float:
        """Rms of what was measured about its mean."""
        return float(self.measured.std())

    @property
    def errors(self) -> dict[str, float]:
        """Rms errors, infinite after an overflow."""
        with np.errstate(all="ignore"):
            each = {name: rms([s - self.measured]) for name, s in self.simulated.items()}
        return {name: r if math.isfinite(r) else math.inf for name, r in each.items()}

    @property
    def shares(self) -> dict[str, float]:
        """Rms errors over the motion."""
        return {
            name: e / self.motion if self.motion else math.nan for name, e in self.errors.items()
        }

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form: errors in units, and over the motion."""
        return {
            "recording": self.recording, "output": self.output, "unit": self.unit,
            "rms": self.errors, "motion_rms": self.motion, "share": self.shares,
            "held_out": self.held_out,
        }  # fmt: skip


def whole_runs(
    device: Device,
    found: Searched,
    fitted: Sequence[Experiment],
    judge_by: Sequence[Experiment],
    law: Searched | None = None,
) -> tuple[WholeRun, ...]:
    """Return the whole runs of recordings that were fitted, and of what was held out.

    Of the rest of a recording from where its first part ends, of which no whole run is given. law:
    what was found with a law of no name, None where none was learned.
    """
    models = {
        "before": as_filed(device),
        "refit": (found.refit.model, found.refit.x),
        "after": (found.final.model, found.final.x),
    }
    if law is not None:
        models["law"] = law.final.model, law.final.x
    rest = [e.before for e in judge_by if e.before is not None]
    whole = [e for e in fitted if not any(_same(e, first) for first in rest)]
    length = "rad" if device.rotary else "m"
    runs: list[WholeRun] = []
    for e, held in [*((e, True) for e in judge_by), *((e, False) for e in whole)]:
        each = {name: simulated(model, x, e, found.judge) for name, (model, x) in models.items()}
        measured = recorded(e, e.measured)
        for o, output in enumerate(e.outputs):
            quantity = "velocity" if output in e.differenced else output.quantity
            unit = length if quantity == "position" else f"{length}/s"
            if o == 0 and e.pushed is not None:
                quantity, unit = "force", "N m" if device.rotary else "N"
            name = f"{quantity}_{output.at}"
            said = {word: found[:, o] for word, found in each.items()}
            runs.append(
                WholeRun(e.name, name, unit, e.begins, e.period, measured[:, o], said, held)
            )
    return tuple(runs)


def _same(a: Experiment, b: Experiment) -> bool:
    return a.name == b.name and np.array_equal(a.command, b.command)


def simulated(model: Model, x: Floats, e: Experiment, observer: Observer) -> Floats:
    """Outputs (ticks, o), as recorded, of a free run in which nothing is corrected."""
    device = model.acting(x)
    seen = begun(device, model.seen(e, x), observer)
    eq, fine = ready = prepared(seen.on(device))
    with np.errstate(all="ignore"):  # infinite after an overflow
        memory, full = memory_at(ready, seen, device, observer.gain)
        wrong = alone(
            eq, fine, seen.places(eq), seen.command, seen.measured, np.zeros_like(full),
            seen.external(eq.dof), memory, seen.strengths,
        )  # fmt: skip
        # What a model reads otherwise (an origin) is in both, and goes.
        return recorded(e, e.measured - wrong)


def recorded(e: Experiment, taken: Floats) -> Floats:
    """Return outputs (ticks, o), as a recording was taken, as it was recorded."""
    found = taken.copy()
    for o, output in enumerate(e.outputs):
        if (a := e.differenced.get(output)) is not None:
            moved = np.diff(taken[:, o], prepend=taken[0, o]) / e.period
            found[:, o] = lfilter([1.0 - a], [1.0, -a], moved)
    if e.pushed is not None:
        found[:, 0] = e.pushed.force(taken[:, 0])
    if e.folded:
        found[:, 0] = np.abs(found[:, 0])
    return found


@dataclass(frozen=True)
class NextLevel:
    """The one level of all commands [unit], the share of it to record next, by what they differ.

    differs: of the motion, the answer and the nearest other, there; now: the same as recorded.
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
        return f"record the same at {level} ({plain(self.share, 2)} times)"

    def undecides(self, error: float, noise: float) -> bool:
        """Whether names are not to be promised; error: of free runs, noise: of readings in it.

        Both over the motion. Where noise makes most of the error, nothing is left to doubt by.
        """
        return self.now < error < self.differs and noise**2 < ADEQUACY.most * error**2

    @property
    def sentence(self) -> str:
        """Say what to record, without a full stop."""
        return (
            f"the command has one level, {with_unit(self.level, self.unit, 3)}, at which friction"
            f" is little else than a weaker command: {self.advice}"
            " and diagnose both together; there this answer and what comes nearest to it differ by"
            f" {percent(self.differs)} of the motion, and here by {percent(self.now)}"
        )


def next_level(
    found: Searched,
    fitted: Sequence[Experiment],
    judge_by: Sequence[Experiment],
    shares: tuple[float, ...] = (0.3, 0.5, 0.75, 1.5, 2.0),
) -> NextLevel | None:
    """Return the level to record next; None where there are several, or nothing bends.

    Where nothing was found the refit is the answer, which other levels may refute. shares: of the
    level, that are simulated.
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
    asked = (1.0, *(s for s in shares if s * level <= allowed))
    differ = {s: _differs((model, x), others, found, fitted, s) for s in asked}
    now = differ.pop(1.0)
    share = max(differ, key=lambda s: differ[s])
    if not differ[share] > now:
        return None
    unit = "N m" if model.nominal.rotary else "N"
    return NextLevel(level, unit, share, differ[share], now)


def one_level(experiments: Sequence[Experiment]) -> float | None:
    """Return the level of the commands of all recordings; None where they have several, or none.

    What is below a twentieth of the largest command is none.
    """
    size = np.abs(np.concatenate([e.command for e in experiments]))
    if any(e.pushed is not None for e in experiments) or not size.max() > 0.0:
        return None
    low, middle, high = np.quantile(size[size > 0.05 * size.max()], (0.05, 0.5, 0.95))
    return float(middle) if high <= VERDICT.one_level * low else None


def _bends(p: Physics) -> bool:
    """Whether its force does not grow with the motion."""
    return p.effect.hook in ("friction", "force", "command") and p.effect.name != "constant_force"


def _others(found: Searched, most: int = 3) -> list[tuple[Model, Floats]]:
    """The refit, and the likeliest hypotheses that lack some of what was found."""
    own = found.tried.best.labels
    tried = [h for h in found.tried.tried.values() if h.model.effects and not own <= h.labels]
    tried.sort(key=lambda h: h.cost.total)
    refit = [(found.refit.model, found.refit.x)] if own else []
    return [*refit, *((h.model, h.x) for h in tried[:most])]


def _differs(
    answer: tuple[Model, Floats],
    others: Sequence[tuple[Model, Floats]],
    found: Searched,
    experiments: Sequence[Experiment],
    share: float,
    moves: float = 0.2,
) -> float:
    """Return d(share), 0 where the answer runs away or moves less than `moves` in proportion."""
    least = np.inf
    played = [replace(e, command=share * e.command, measured=share * e.measured)
              for e in experiments]  # fmt: skip
    own = [simulated(*answer, e, found.judge)[:, 0] for e in played]
    with np.errstate(all="ignore"):  # infinite after an overflow
        size = rms([y - y.mean() for y in own])
        recorded = rms([e.measured[:, 0] - e.measured[:, 0].mean() for e in experiments])
        if not moves * share * recorded < size < np.inf:
            return 0.0
        for other in others:
            theirs = [simulated(*other, e, found.judge)[:, 0] for e in played]
            least = min(least, rms([a - b for a, b in zip(own, theirs, strict=True)]) / size)
    return least if np.isfinite(least) else 0.0
