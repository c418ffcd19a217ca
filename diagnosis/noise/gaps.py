"""Gains of an observer that change along a recording: at its beginning, over lost samples, in play.

At the first sample the state is uncertain, and where a sample was not measured it becomes so. The
gains of Kalman's filter follow it,

    P_(k+1) = A (P_k - m_k K_k c P_k) A' + Q,    K_k = P_k c' (c P_k c' + R)^-1,

where m_k = 1 if sample k was measured and 0 if it was lost, for the linear model and the noise of
the steady observer (`noise.steady`). P_0 is its P plus some units of noise in each position, and as
many per tick in each velocity: ten if the position is read or the machine begins at rest, else as
many as it moves at first (`unrest`). After some ticks K is the steady gain. Simpler gains cost:

- At the beginning a steady gain forgets a wrong state slowly. An initial state by least squares was
  fitted to the first samples too, which the cost of a fit leaves out, so that fits and noise in
  turn drifted away from the truth. (On a rig with a limit of the command's rate, masses known to
  0.9 % ended 12 of their standard errors off. On 50 recordings of an exam, fits of the true
  structure from its device file had 383 of 412 linear values within their intervals; with these
  gains, and steps along curves, `fitting.straight`, 392.)
- After each gap of 10 samples, under an unknown force as large as the command, a link's damper was
  wrong by 5 of its standard errors with the steady gain.

With play, A differs from tick to tick: in contact, without it, and where contact begins or ends a
little earlier or later. It is found along the motion that the observer predicted last
(`sim/extended.py`), and is fixed during a fit. Example: two masses with play of a third of the
travel, two frictions and gravity, both positions measured, 2400 samples, no force but the command.
At the truth -2 ln is -74 540 with the best fixed gain, -74 860 with one gain for each linear model
of the phases, and -75 460 so, 100 more than without play; with the first two, a lag that does not
exist gains 160 to 190.

Other effects are neglected, as in the steady gain.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.noise.steady import Spread, process_of, spread
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device
from zwidth.sim.extended import gains_along, room_for
from zwidth.sim.physics.effect import Physics
from zwidth.sim.plant import hold

Floats = NDArray[np.float64]
Lost = NDArray[np.bool_]
AT_REST, FASTEST = 10.0, 100.0  # units of noise: at the first sample, and in a tick
BEGINNING = 10  # samples that determine how fast a machine moves at first
SETTLED = 1e-3  # of the steady gain: change below which a gain is the steady one
FIRST, MOST = 250, 2000  # ticks until then: first trial, and most
UNSEEN = 0.01  # variance of random accelerations of further masses, over that of m1


@dataclass(frozen=True, eq=False)
class Changing:
    """A steady gain (states, o), or (states, 2 o) with play, and the model behind it.

    begins (states, states): P before the first sample. follows: whether A is that of the observer's
    own motion.
    """

    steady: Floats
    spread: Spread
    begins: Floats
    follows: bool = False

    @cached_property
    def first(self) -> Floats:
        """The gains (states, ticks, o) of the first ticks, until they are the steady one."""
        steady = self.spread.gain()
        ticks = FIRST
        while True:
            found, _ = onward(self, self.begins, np.zeros(ticks, np.bool_), None)
            other = np.abs(found - steady[:, None]).max(axis=2)
            apart = np.flatnonzero(
                (other > SETTLED * np.abs(steady).max(axis=1)[:, None]).any(axis=0)
            )
            if ticks >= MOST or apart.size == 0 or apart[-1] < ticks - 1:
                return found[:, : 1 + (int(apart[-1]) if apart.size else 0)]
            ticks *= 2


Gain = Floats | Changing


def changing(
    device: Device,
    experiments: Sequence[Experiment],
    ratio: float,
    gain: Floats,
    *,
    follows: bool = False,
) -> Changing:
    """Return a gain that changes along recordings.

    device, ratio: of the steady gain. follows: as in `Changing`; random forces then act on every
    mass, in proportion to it, with `UNSEEN` of the variance on m1. Without them an observer trusts
    what it predicts of an unseen mass too much. (On six recordings with play, the motor alone, -2
    ln at the truth fell by up to 59 with them and rose by at most 4; with ten times as much it rose
    by up to 136.) Raises NoObserver like `steady.spread`.
    """
    like = experiments[0]
    known = spread(device, like, ratio)
    if follows:
        plant, masses = device.plant(), device.chain.masses
        unseen = ratio * UNSEEN * (masses[1:] / masses[0]) ** 2
        held = hold(plant, like.period)[1]
        own = process_of(plant, held, like.period, ratio, *unseen.tolist())
        known = known._replace(process=own)
    n, wide = known.p.shape[0] // 2, np.zeros(known.p.shape[0])
    begins = np.full(n, max(unrest(e) for e in experiments))
    begins[[o.mass for o in like.outputs if o.tells_position]] = AT_REST
    wide[:n], wide[n : 2 * n] = begins**2, (begins / like.period) ** 2
    return Changing(gain, known, known.p + np.diag(wide), follows)


def with_play(physics: Iterable[Physics]) -> bool:
    """Whether fits with these effects end in the valley where they begin, as with play."""
    return any(q.valleys for p in physics for q in p.effect.parameters)


def unrest(e: Experiment) -> float:
    """By how many units of noise a machine moves in a tick at first, from `AT_REST` to `FASTEST`.

    Its speed is that of the straight line through its first readings, its noise what is left.
    Masses may differ by as much from the motion that the first readings show. (With three units six
    motors with friction that begin at rest cost up to 74 less in -2 ln than with ten; but a rig of
    an exam that begins in motion cost 13 more, and the play of the friction damper was not found.)
    """
    first = next((o for o, output in enumerate(e.outputs) if output.tells_position), None)
    read = e.measured[:BEGINNING, 0 if first is None else first]
    at = np.arange(read.size) - 0.5 * (read.size - 1)
    speed = float(read.mean()) if first is None else float(at @ read) / float(at @ at)
    left = read - read.mean() - (0.0 if first is None else speed * at)
    noise = float(np.std(left))
    if abs(speed) <= AT_REST * noise:
        return AT_REST
    return min(abs(speed) / noise, FASTEST) if noise > 0.0 else FASTEST


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
    `Experiment`. If a gain is steady, or follows a motion that is not known, returns the steady
    gains and an empty array.
    """
    made = [g for g in gains if isinstance(g, Changing)]
    follows = any(g.follows for g in made)
    known = motions if follows else None
    if known is not None and known.shape[1] != made[0].spread.p.shape[0]:
        known = None  # it belongs to a device with other states
    if len(made) < len(gains) or (follows and known is None):
        return [steadily(g) for g in gains], np.zeros(0, dtype=np.int64)
    gone = lost if lost is not None and lost.any() else None
    o = made[0].spread.c.shape[0]
    if known is None and gone is None:
        ticks = max(g.first.shape[1] for g in made)
        wide = [_side_by_side(g, g.first, ticks) for g in made]
        return wide, np.append(1 + np.arange(ticks), 0) * o
    ticks = (known if gone is None else gone).shape[0]  # pyright: ignore[reportOptionalMemberAccess]
    text = None if gone is None else gone.tobytes()
    wide = [_along(g, ticks, text, _Itself(known)) for g in made]
    return wide, (1 + np.arange(ticks)) * o


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
    """The steady gain and those of all ticks, as in `_side_by_side`."""
    gone = np.zeros(ticks, np.bool_) if lost is None else np.frombuffer(lost, np.bool_)
    found, _ = onward(gain, gain.begins, gone, motions.of)
    return _side_by_side(gain, found, ticks, parted=motions.of is None)


def _side_by_side(gain: Changing, found: Floats, ticks: int, *, parted: bool = True) -> Floats:
    """The steady gain and gains (states, ticks, o), twice: in contact, and without it.

    ticks: how many, the last ones steady. parted: whether those without contact correct nothing
    that the steady one does not.
    """
    o = found.shape[2]
    steady = gain.steady[:, :o]
    more = np.tile(steady, ticks - found.shape[1])
    wide = np.hstack([steady, found.reshape(found.shape[0], -1), more])
    free = wide
    if parted and gain.steady.shape[1] > o:
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
    """Return P after the part before a recording; without that, P before its first sample."""
    if before is None:
        return gain.begins
    lost, motions, ticks = before.lost, before.all_motions, before.joined().ticks
    lost = np.zeros(ticks, dtype=np.bool_) if lost is None else lost
    return onward(gain, gain.begins, lost, motions if gain.follows else None)[1]
