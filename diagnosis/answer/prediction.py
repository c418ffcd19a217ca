"""Predicts outputs under a new command: the state from the first samples, then a free run.

The answer's observer follows the first window, uncertain at its first sample (`noise.gaps`); after
the window nothing is corrected. An answer is judged on held-out data by the same free run
(`whole_run`), with the data before it cut to the window.

The prediction uses the answer, with a learned law only if the law is well known: a curve whose band
is as wide as the curve is high (friction between the speeds at which a recording dwells) predicts
nothing along another path. Without a law, the parameters are fitted once more by the error of free
runs as long as the recordings. If such a fit to the first part errs less on the held-out rest, the
prediction uses such a fit to all data. (On a device without a spring, a wrong offset of 0.1 N
changes one sample by nothing and half a minute by a centimetre.)

Limits: influences known only for the recordings (forces from outside, a supply, a moving base, a
change at some time, a value that depends on a temperature) do not act here. A sensor that folds
gives no sign; in the window the command's sign is used.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import lfilter

from zwidth.diagnosis.answer.whole_run import free_run, recorded
from zwidth.diagnosis.fitting.uncertainty import Z95
from zwidth.diagnosis.intake.gate import Fault
from zwidth.diagnosis.intake.rectified import folded_out
from zwidth.diagnosis.intake.swapped import EXCHANGED
from zwidth.diagnosis.learning.curves import Learned
from zwidth.diagnosis.mishaps import attempt
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import as_far_as
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.drive_force import Pushed
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.diagnosis.selection.searched import Searched
from zwidth.diagnosis.settings import VERDICT
from zwidth.sim.smooth_command import held_for

if TYPE_CHECKING:
    from zwidth.diagnosis.answer.laws import LearnedLaw, LearnedSurface

Floats = NDArray[np.float64]
LEAST = 10  # first readings needed
KEPT = ("period", "outputs", "swing", "differenced", "folded")


def predicted(
    found: Searched,
    like: Experiment,
    faults: Sequence[Fault],
    smooth: bool,
    command: ArrayLike,
    first: ArrayLike,
) -> Floats:
    """Return the outputs, or raise, as `Diagnosis.predict` does; like: a diagnosed recording."""
    _refuse_corrected(faults)
    u, y = _checked(like, command, first)
    new = _taken(like, held_for(u) if smooth else u, y)
    n = y.shape[0]
    rest = replace(new.part(n, new.ticks), before=new.part(0, n))
    free = free_run(found.final.model, found.final.x, rest, found.judge)
    whole = recorded(new, np.concatenate([new.measured[:n], free]))
    whole[:n] = y
    return whole[:, 0] if np.ndim(first) == 1 else whole


def predicts(
    found: Searched, learned: "LearnedLaw | LearnedSurface | None", whole: Sequence[Experiment]
) -> Searched:
    """Return the fit that predicts. found: with the named effects; whole: complete recordings."""
    if learned is not None and _is_known(learned):
        return learned.found
    longer = attempt("prediction", "by long free runs", partial(_by_long_runs, found, whole))
    return longer or found


def _is_known(law: "LearnedLaw | LearnedSurface") -> bool:
    """Whether a learned law is known well where it has samples; always for a surface."""
    curve = law.curve
    if not isinstance(curve, Learned):
        return True
    # Its straight part is exchangeable with a damper or a spring, and is known together with it.
    line = np.column_stack([np.ones(curve.states.size), curve.states])
    bends = np.eye(curve.states.size) - line @ np.linalg.pinv(line)
    half = Z95**2 * np.trace(bends @ curve.covariance @ bends)
    return bool(half <= VERDICT.known_law**2 * np.sum((bends @ curve.forces) ** 2))


def _by_long_runs(found: Searched, whole: Sequence[Experiment]) -> Searched | None:
    """The same effects, fitted by free runs as long as the recordings; None if no better."""
    firsts, final = found.problem.experiments, found.final
    pairs = list(zip(firsts, whole, strict=False))
    cut = len(firsts) == len(whole) and all(a.ticks < b.ticks for a, b in pairs)
    if not cut or not final.model.effects or final.model.varying:
        return None
    rests = [
        replace(e.part(a.ticks, e.ticks), before=e.part(0, a.ticks))
        for a, e in zip(firsts, whole, strict=True)
    ]

    def fitted(to: Sequence[Experiment], model: Model, x: Floats) -> Searched:
        family = as_far_as(max(e.ticks for e in whole) * whole[0].period, to)
        h = settled(judged(to, model, x, family))
        return replace(found, final=replace(final, model=h.model, x=h.x))

    def error(of: Searched) -> float:
        runs = (free_run(of.final.model, of.final.x, e, of.judge) - e.measured for e in rests)
        with np.errstate(all="ignore"):  # infinite after an overflow
            return float(np.sum([np.sum(off[:, 0] ** 2) for off in runs]))

    plain = [e.part(0, a.ticks) for a, e in zip(firsts, whole, strict=True)]
    with suppress(NoObserver):
        longer = fitted(plain, final.model, final.x)
        if error(longer) < error(found):
            return fitted(whole, longer.final.model, longer.final.x)
    return None


def _refuse_corrected(faults: Sequence[Fault]) -> None:
    for fault in faults:
        if fault.wrong and (fault.channels or fault.kind in ("command_late", EXCHANGED)):
            raise ValueError(
                f"the answer is of a recording that was corrected ({fault.sentence}), and a new"
                " command and reading would have to be corrected alike; correct the file of the"
                " recording and diagnose it again"
            )


def _checked(like: Experiment, command: ArrayLike, first: ArrayLike) -> tuple[Floats, Floats]:
    """Return command (ticks,) and first readings (n, o), or raise ValueError."""
    names = " and ".join(o.name for o in like.outputs)
    u, y = np.asarray(command, dtype=np.float64), np.asarray(first, dtype=np.float64)
    if u.ndim != 1:
        raise ValueError(
            f"u_test has the shape {u.shape}; it must be (ticks,), one command per sample"
        )
    y = y[:, None] if y.ndim == 1 else y
    if y.ndim != 2 or y.shape[1] != len(like.outputs):
        raise ValueError(
            f"y_first has the shape {np.shape(first)}; give (n, {len(like.outputs)}), the first"
            f" samples of {names}"
        )
    if not LEAST <= y.shape[0] < u.size:
        raise ValueError(
            f"y_first has {y.shape[0]} samples and u_test {u.size}; give y_first {LEAST} or more,"
            " and fewer than u_test has"
        )
    for name, values in (("u_test", u), ("y_first", y)):
        if not np.all(np.isfinite(values)):
            raise ValueError(f"{name} holds values that are not finite; give numbers alone")
    return u, y


def _taken(like: Experiment, u: Floats, y: Floats) -> Experiment:
    """A recording of a command and its first readings, converted as the diagnosed recording was."""
    measured = np.zeros((u.size, y.shape[1]))
    measured[: y.shape[0]] = y
    same = {name: getattr(like, name) for name in KEPT}
    new = Experiment(command=u, measured=measured, name="prediction", **same)
    if like.pushed is not None:
        stiffness = like.pushed.stiffness
        new = replace(new, pushed=Pushed(stiffness * u, stiffness))
        measured[:, 0] = new.pushed.position(measured[:, 0]) if new.pushed else measured[:, 0]
    if like.folded:
        measured[: y.shape[0], 0] = folded_out(y[:, 0], u[: y.shape[0]])
    for o, output in enumerate(like.outputs):
        if (a := like.differenced.get(output)) is not None:  # inverts `recorded`
            moved = lfilter([1.0, -a], [1.0 - a], y[:, o]) * like.period
            measured[: y.shape[0], o] = np.cumsum(moved)
    return new
