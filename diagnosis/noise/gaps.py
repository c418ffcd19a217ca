"""Gains of an observer that change along a recording: over lost samples, and while links are apart.

A sample that was not measured corrects nothing, so the uncertainty of the state continues to grow,
and the first samples after a gap correct it by more:

    P_(k+1) = A (P_k - m_k K_k c P_k) A' + Q,    K_k = P_k c' (c P_k c' + R)^-1,

where m_k = 1 if sample k was measured and 0 if it was lost. This is Kalman's filter of the same
linear model and noise as the steady observer (`noise.steady`), from whose P it starts. (With the
steady gain after each gap of 10 samples, under an unknown force as large as the command, a link's
damper was wrong by 5 of its standard errors.)

A link with play that carries nothing is another linear model, with another A and Q. What lies
behind it then moves on its own, and if nothing measures it, the first samples after the next
contact say where it is, by much more than later ones do. Where it carries nothing is taken from the
motion that the observer predicted last (`noise.family`), and is fixed during a fit. Example: two
masses with play and friction, the motor alone measured, 4200 samples. With one gain for contact and
one without it, the truth costs 669 more in -2 ln than the end of a fit that begins there, because
parameters imitate what the observer cannot correct.

Other effects are neglected, as in the steady gain.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.noise.steady import Spread, parted_plant, process_of, spread
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device
from zwidth.sim.jit import jit
from zwidth.sim.plant import hold

Floats = NDArray[np.float64]
Lost = NDArray[np.bool_]
UNSEEN = 0.01  # of the variance of random accelerations of m1, those of further masses
Phases = NDArray[np.uint8]  # (ticks,): as in `Experiment`


@dataclass(frozen=True, eq=False)
class Changing:
    """A steady gain (states, o), or (states, 2 o) with play, and the models behind it.

    apart: with play behind which something is not measured, else None.
    """

    steady: Floats
    spread: Spread
    apart: "Apart | None" = None


class Apart:
    """The linear models of a device in its phases, each made when it is first asked for.

    Random forces act on every mass, in proportion to it, with `UNSEEN` of the variance on m1.
    Without them an observer trusts what it predicts of an unseen mass too much. (On six recordings
    with play, the motor alone, -2 ln at the truth fell by up to 59 with them and rose by at most 4;
    with ten times as much it rose by up to 136.)
    """

    def __init__(self, device: Device, period: float, ratio: float) -> None:
        self.device, self.period, self.ratio = device, period, ratio
        self.known: dict[int, tuple[Floats, Floats]] = {}

    def of(self, phase: int) -> tuple[Floats, Floats]:
        """Return A and Q over a tick in a phase."""
        if phase not in self.known:
            links = range(self.device.chain.masses.size - 1)
            plant = parted_plant(self.device, [link for link in links if phase >> link & 1])
            motion, forces = hold(plant, self.period)
            unseen = UNSEEN * (self.device.chain.masses[1:] / self.device.chain.masses[0]) ** 2
            ratios = self.ratio * np.array([1.0, *unseen])
            process = process_of(plant, forces, self.period, *ratios.tolist())
            self.known[phase] = motion, process
        return self.known[phase]


Gain = Floats | Changing


def changing(
    device: Device,
    experiments: Sequence[Experiment],
    ratio: float,
    gain: Floats,
    *,
    apart: bool = False,
) -> Gain:
    """Return a gain that changes along recordings, if they have gaps or the device comes apart.

    device, ratio: of the steady gain. apart: whether it has play behind which something is not
    measured. Raises NoObserver like `steady.spread`.
    """
    if not apart and all(e.bridged is None for e in experiments):
        return gain
    together = spread(device, experiments[0], ratio)
    phases = Apart(device, experiments[0].period, ratio) if apart else None
    return Changing(gain, together, phases)


def steadily(gain: Gain) -> Floats:
    """Return the steady part of a gain."""
    return gain.steady if isinstance(gain, Changing) else gain


def with_steady(gain: Gain, steady: Floats) -> Gain:
    """Return a gain with another steady one, of the same model and noise."""
    return replace(gain, steady=steady) if isinstance(gain, Changing) else steady


def along(
    gains: Sequence[Gain], lost: Lost | None, phases: Phases | None = None
) -> tuple[list[Floats], NDArray[np.int64]]:
    """Return gains, and the first column that counts at each sample, as in `sim.predict.Gains`.

    lost (ticks,): which samples were not measured, None for none; phases (ticks,): None if not
    known. If neither changes anything, or a gain is steady, returns the steady gains and an empty
    array.
    """
    made = [g for g in gains if isinstance(g, Changing)]
    known = phases if any(g.apart for g in made) else None
    gone = lost if lost is not None and lost.any() else None
    if len(made) < len(gains) or (known is None and gone is None):
        return [steadily(g) for g in gains], np.zeros(0, dtype=np.int64)
    first = known if gone is None else gone
    assert first is not None
    texts = [None if a is None else a.tobytes() for a in (gone, known)]
    wide = [_along(g, first.size, *texts) for g in made]
    return wide, (1 + np.arange(first.size)) * made[0].spread.c.shape[0]


@lru_cache(maxsize=40)  # a fit asks for the same again and again, and a family has 18 ratios
def _along(gain: Changing, ticks: int, lost: bytes | None, phases: bytes | None) -> Floats:
    """The steady gain and those of all ticks, side by side, twice: in contact, and without it."""
    gone = np.zeros(ticks, np.bool_) if lost is None else np.frombuffer(lost, np.bool_).copy()
    each = np.zeros(ticks, np.uint8) if phases is None else np.frombuffer(phases, np.uint8)
    found, _ = onward(gain, gain.spread.p, gone, each)
    o = found.shape[2]
    wide = np.hstack([gain.steady[:, :o], found.reshape(found.shape[0], -1)])
    free = wide
    if phases is None and gain.steady.shape[1] > o:
        free = wide.copy()
        free[~gain.steady[:, o:].any(axis=1)] = 0.0
    return np.hstack([wide, free])


def onward(gain: Changing, p: Floats, lost: Lost, phases: Phases) -> tuple[Floats, Floats]:
    """Return gains (states, ticks, o) from P on, and P after them."""
    each, which = np.unique(phases, return_inverse=True)
    spread, p = gain.spread, p.copy()
    models = [(spread.motion, spread.process)]
    if gain.apart is not None:
        models = [gain.apart.of(int(phase)) for phase in each]
    n, o = p.shape[0], spread.c.shape[0]
    found = np.zeros((n, lost.size, o))
    gains_along(
        p, np.stack([a for a, _ in models]), np.stack([q for _, q in models]), spread.c,
        np.diag(spread.noise).copy(), which, lost, np.zeros((n, n)), found,
    )  # fmt: skip
    return found, p


def covariance_after(gain: Changing, before: Experiment | None) -> Floats:
    """Return P after the part before a recording, the steady one without it."""
    if before is None:
        return gain.spread.p
    lost, phases = before.lost, before.all_phases
    ticks = before.joined().ticks
    lost = np.zeros(ticks, dtype=np.bool_) if lost is None else lost
    phases = np.zeros(ticks, dtype=np.uint8) if phases is None else phases
    return onward(gain, gain.spread.p, lost, phases)[1]


@jit
def gains_along(
    p: Floats,
    motions: Floats,
    processes: Floats,
    c: Floats,
    noise: Floats,
    which: NDArray[np.int64],
    lost: Lost,
    room: Floats,
    gains: Floats,
) -> None:
    """Write Kalman's gains (n, ticks, o); p (n, n), room (n, n) are overwritten.

    motions, processes (k, n, n): A and Q of each model, which (ticks,): the one from each sample to
    the next; c (o, n); noise (o,): variances of the measurement; lost (ticks,). Outputs correct P
    one after the other, since their noise is independent; the gain of all is P c' / R after that.
    """
    n, outputs = p.shape[0], c.shape[0]
    for k in range(which.size):
        for i in range(n):  # what correcting would leave
            for j in range(n):
                room[i, j] = p[i, j]
        for o in range(outputs):
            seen = noise[o]
            for i in range(n):
                beside = 0.0
                for j in range(n):
                    beside += room[i, j] * c[o, j]
                gains[i, k, o] = beside
                seen += c[o, i] * beside
            for i in range(n):
                for j in range(n):
                    room[i, j] -= gains[i, k, o] * gains[j, k, o] / seen
        for o in range(outputs):
            for i in range(n):
                beside = 0.0
                for j in range(n):
                    beside += room[i, j] * c[o, j]
                gains[i, k, o] = beside / noise[o]
        if not lost[k]:
            for i in range(n):
                for j in range(n):
                    p[i, j] = room[i, j]
        motion, process = motions[which[k]], processes[which[k]]
        for i in range(n):
            for j in range(n):
                moved = 0.0
                for m in range(n):
                    moved += motion[i, m] * p[m, j]
                room[i, j] = moved
        for i in range(n):
            for j in range(i + 1):
                moved = process[i, j]
                for m in range(n):
                    moved += room[i, m] * motion[j, m]
                p[i, j] = moved
                p[j, i] = moved
