"""Gains of an observer that change along a recording: over lost samples, and with its motion.

A sample that was not measured corrects nothing, so the uncertainty of the state continues to grow,
and the first samples after a gap correct it by more:

    P_(k+1) = A (P_k - m_k K_k c P_k) A' + Q,    K_k = P_k c' (c P_k c' + R)^-1,

where m_k = 1 if sample k was measured and 0 if it was lost. This is Kalman's filter of the same
linear model and noise as the steady observer (`noise.steady`), from whose P it starts. (With the
steady gain after each gap of 10 samples, under an unknown force as large as the command, a link's
damper was wrong by 5 of its standard errors.)

With play, A is another at each tick: in contact and without it, and where contact begins or ends a
little earlier or later. It is found along the motion that the observer predicted last
(`sim/extended.py`), and is fixed during a fit. Example: two masses with play of a third of the
travel, two frictions and gravity, both positions measured, 2400 samples, no force but the command.
At the truth -2 ln is -74 540 with the best fixed gain, -74 860 with one gain for each linear model
of the phases, and -75 460 so, 100 more than without play; with the first two, a lag that does not
exist gains 160 to 190.

Other effects are neglected, as in the steady gain.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.noise.steady import Spread, process_of, spread
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device
from zwidth.sim.extended import gains_along, room_for
from zwidth.sim.plant import hold

Floats = NDArray[np.float64]
Lost = NDArray[np.bool_]
UNSEEN = 0.01  # of the variance of random accelerations of m1, those of further masses


@dataclass(frozen=True, eq=False)
class Changing:
    """A steady gain (states, o), or (states, 2 o) with play, and the model behind it.

    follows: whether A is that of the observer's own motion.
    """

    steady: Floats
    spread: Spread
    follows: bool = False


Gain = Floats | Changing


def changing(
    device: Device,
    experiments: Sequence[Experiment],
    ratio: float,
    gain: Floats,
    *,
    follows: bool = False,
) -> Gain:
    """Return a gain that changes along recordings, if they have gaps or it follows the motion.

    device, ratio: of the steady gain. follows: as in `Changing`; random forces then act on every
    mass, in proportion to it, with `UNSEEN` of the variance on m1. Without them an observer trusts
    what it predicts of an unseen mass too much. (On six recordings with play, the motor alone, -2
    ln at the truth fell by up to 59 with them and rose by at most 4; with ten times as much it rose
    by up to 136.) Raises NoObserver like `steady.spread`.
    """
    if not follows and all(e.bridged is None for e in experiments):
        return gain
    known = spread(device, experiments[0], ratio)
    if follows:
        plant, masses = device.plant(), device.chain.masses
        unseen = ratio * UNSEEN * (masses[1:] / masses[0]) ** 2
        held = hold(plant, experiments[0].period)[1]
        own = process_of(plant, held, experiments[0].period, ratio, *unseen.tolist())
        known = known._replace(process=own)
    return Changing(gain, known, follows)


def steadily(gain: Gain) -> Floats:
    """Return the steady part of a gain."""
    return gain.steady if isinstance(gain, Changing) else gain


def with_steady(gain: Gain, steady: Floats) -> Gain:
    """Return a gain with another steady one, of the same model and noise."""
    return replace(gain, steady=steady) if isinstance(gain, Changing) else steady


def along(
    gains: Sequence[Gain], lost: Lost | None, motions: Floats | None = None
) -> tuple[list[Floats], NDArray[np.int64]]:
    """Return gains, and the first column that counts at each sample, as in `sim.predict.Gains`.

    lost (ticks,): which samples were not measured, None for none; motions (ticks, n, n): as in
    `Experiment`. If neither changes anything, or a gain is steady, returns the steady gains and an
    empty array.
    """
    made = [g for g in gains if isinstance(g, Changing)]
    known = motions if any(g.follows for g in made) else None
    if known is not None and known.shape[1] != made[0].spread.p.shape[0]:
        known = None  # of a device with other states
    gone = lost if lost is not None and lost.any() else None
    if len(made) < len(gains) or (known is None and gone is None):
        return [steadily(g) for g in gains], np.zeros(0, dtype=np.int64)
    ticks = np.zeros(0) if known is None else known
    ticks = (ticks if gone is None else gone).shape[0]
    text = None if gone is None else gone.tobytes()
    wide = [_along(g, ticks, text, _Itself(known)) for g in made]
    return wide, (1 + np.arange(ticks)) * made[0].spread.c.shape[0]


class _Itself:
    """An array, or None, as the key of a cache: it equals itself alone."""

    def __init__(self, of: Floats | None) -> None:
        self.of = of

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Itself) and other.of is self.of

    def __hash__(self) -> int:
        return id(self.of)


@lru_cache(maxsize=40)  # a fit asks for the same again and again, and a family has 18 ratios
def _along(gain: Changing, ticks: int, lost: bytes | None, motions: _Itself) -> Floats:
    """The steady gain and those of all ticks, side by side, twice: in contact, and without it."""
    gone = np.zeros(ticks, np.bool_) if lost is None else np.frombuffer(lost, np.bool_)
    found, _ = onward(gain, gain.spread.p, gone, motions.of)
    o = found.shape[2]
    wide = np.hstack([gain.steady[:, :o], found.reshape(found.shape[0], -1)])
    free = wide
    if motions.of is None and gain.steady.shape[1] > o:
        free = wide.copy()
        free[~gain.steady[:, o:].any(axis=1)] = 0.0
    return np.hstack([wide, free])


def onward(gain: Changing, p: Floats, lost: Lost, motions: Floats | None) -> tuple[Floats, Floats]:
    """Return gains (states, ticks, o) from P on, and P after them; motions: as in `along`."""
    spread, p = gain.spread, p.copy()
    o, n = spread.c.shape
    found = np.zeros((n, lost.size, o))
    gains_along(
        p, spread.motion[None] if motions is None else motions, spread.process, spread.c,
        np.diag(spread.noise).copy(), lost, room_for(n, o), found,
    )  # fmt: skip
    return found, p


def covariance_after(gain: Changing, before: Experiment | None) -> Floats:
    """Return P after the part before a recording, the steady one without it."""
    if before is None:
        return gain.spread.p
    lost, motions, ticks = before.lost, before.all_motions, before.joined().ticks
    lost = np.zeros(ticks, dtype=np.bool_) if lost is None else lost
    return onward(gain, gain.spread.p, lost, motions if gain.follows else None)[1]
