"""How a theory of Table II is fitted to its rows.

A row (delay, B, K, f) measures the sampled plant P at z = e^{2 pi j f T}: -1/P = N (K + B w), w =
(1 - 1/z)/T, where N is the share that a limited amplifier passes (else 1). The error is

    e(ln K, ln f) = ln(-N (K + B w) P),

two numbers. After the jump the boundary falls so steeply that even a close fit of P gives a wrong
K: there the errors of the reading itself, d = -e / (de/d(ln K, ln f)) by the slope at the measured
point, are added, as arcsinh, so that they grow like a logarithm where the slope is useless.

A row also shows that nothing else was unstable, so every other eigenvalue of the loop at N (K, B)
must be inside the circle; each growth rate above zero counts as an error, in units of 1/s. Without
this a model may fit all points and still have its boundary on another branch.

Coulomb friction of level fc, seen by a relay of force D: amplitude A = 4 D / (pi K), describing
function 4 fc / (pi A w), hence a damper (fc/D) K / w at m1. D is not known: rho = fc/D is fitted.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import least_squares

from zwidth.paper.table_2_theories import NOT_NEGATIVE, SPREAD, Theory, theory
from zwidth.scenarios.misprints import JUMPED_HZ
from zwidth.scenarios.table_2 import MeasuredPoint
from zwidth.sim.interface import Interface
from zwidth.sim.loop import wired
from zwidth.sim.sampled import state_space
from zwidth.stability.limited_relay import command_share, passed_share

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]
PART_1, PART_2 = 0.03, 0.08  # errors of ln P, before and after the jump
STEP = 1e-4  # differences of ln K and ln f, for the slope
READING, READING_HZ = 0.1, 0.02  # relative errors of the reading's K and f after the jump
MOST_STEPS, NEARBY_STEPS = 200, 8  # of a first fit, and of one that starts from the fit to all rows


class Sampled(NamedTuple):
    """A plant through hold, delay and sampler: transition (n, n), newer, older (n,), whole ticks.

    older is None without remainder; the position is the first state.
    """

    transition: Floats
    newer: Floats
    older: Floats | None
    whole: int

    def response(self, z: Complexes) -> Complexes:
        """Return P(z), of the shape (n,) of z."""
        size = self.newer.size
        entered = np.broadcast_to(self.newer.astype(np.complex128), (z.size, size))
        if self.older is not None:
            entered = entered + self.older / z[:, None]
        states = np.linalg.solve(
            z[:, None, None] * np.eye(size) - self.transition, entered[..., None]
        )
        return z**-self.whole * states[:, 0, 0]


def fit(free: Sequence[str], rows: Sequence[MeasuredPoint], start: Floats | None = None) -> Floats:
    """Return the values of the free quantities (p,): logarithms of factors, or the value itself."""
    if not free:
        return np.zeros(0)
    spread = np.array([SPREAD[name] for name in free])
    lowest = np.where([name in NOT_NEGATIVE for name in free], 0.0, -np.inf)

    def error(x: Floats) -> Floats:
        return np.concatenate([misfit(free, x, rows), x / spread])

    first = 1e-3 * spread if start is None else np.maximum(start, lowest + 1e-9)
    return least_squares(
        error, first, bounds=(lowest, np.full(spread.size, np.inf)), x_scale=spread,
        max_nfev=MOST_STEPS if start is None else NEARBY_STEPS,
    ).x  # fmt: skip


def misfit(free: Sequence[str], x: Floats, rows: Sequence[MeasuredPoint]) -> Floats:
    """Return the errors of the rows over their spread, and the forbidden growth rates."""
    tried = theory(free, x)
    groups: dict[tuple[float, float], list[MeasuredPoint]] = {}
    for row in rows:
        damper = tried.rho * row.stiffness / (2.0 * np.pi * row.frequency)
        groups.setdefault((row.delay + tried.delay, damper), []).append(row)
    held = Held(tried)
    return np.concatenate([
        _misfit(tried, held.plant(*key), some) for key, some in groups.items()
    ])  # fmt: skip


class Held:
    """The plant of a theory under held inputs, each duration and damper computed once."""

    def __init__(self, tried: Theory) -> None:
        a, b, _ = state_space(tried.model)
        first = np.roll(np.arange(b.size), 2)  # position and velocity of m1 come last
        self.a, self.b = a[np.ix_(first, first)], tried.gain * b[first]
        self.tried = tried
        self._known: dict[tuple[float, float], tuple[Floats, Floats]] = {}

    def plant(self, delay: float, damper: float) -> Sampled:
        """Return the plant at a delay [s], with one more damper to ground at m1."""
        period = self.tried.period
        whole, remainder = Interface(period=period, delay=delay).delay_ticks
        late, newer = self._held(period - remainder, damper)
        if remainder == 0.0:
            return Sampled(late, newer, None, whole)
        older = late @ self._held(remainder, damper)[1]
        return Sampled(self._held(period, damper)[0], newer, older, whole)

    def _held(self, duration: float, damper: float) -> tuple[Floats, Floats]:
        """Return (Phi, Gamma) over a duration [s]."""
        if (duration, damper) not in self._known:
            size = self.b.size
            block = np.zeros((size + 1, size + 1))
            block[:size, :size], block[:size, size] = self.a, self.b
            block[:size, 1] -= damper / self.tried.gain * self.b
            full = np.asarray(expm(block * duration), dtype=np.float64)
            self._known[duration, damper] = full[:size, :size], full[:size, size]
        return self._known[duration, damper]


def _misfit(tried: Theory, plant: Sampled, rows: Sequence[MeasuredPoint]) -> Floats:
    """Return the errors of rows that share a plant."""
    frequency, stiffness, damping = np.array(
        [(row.frequency, row.stiffness, row.damping) for row in rows]
    ).T
    measured = Walls(frequency, stiffness, damping, tried)
    left = measured.error(plant)
    fast = frequency > JUMPED_HZ
    spread = np.where(fast, PART_2, PART_1)
    loop = wired(*plant, tried.period)
    closed = [
        loop.closed(n * k, n * b)
        for n, k, b in zip(measured.passed, stiffness, damping, strict=True)
    ]
    growth = [
        _others(every, known)
        for every, known in zip(np.linalg.eigvals(closed), measured.z, strict=True)
    ]
    return np.concatenate([
        left.real / spread, left.imag / spread, np.array(growth) / tried.period,
        *(_reading_errors(plant, measured.only(fast), left[fast]) if fast.any() else ()),
    ])  # fmt: skip


def _reading_errors(plant: Sampled, measured: "Walls", left: Complexes) -> tuple[Floats, Floats]:
    """Return the errors of K and f that would be read, to first order, over their spread."""
    by_stiffness = _slope(plant, measured, "stiffness")
    by_frequency = _slope(plant, measured, "frequency")
    area = _cross(by_stiffness, by_frequency)
    return (
        np.arcsinh(_cross(by_frequency, left) / area / READING),
        np.arcsinh(_cross(left, by_stiffness) / area / READING_HZ),
    )


class Walls(NamedTuple):
    """Rows as arrays (n,): frequency [Hz], K, B; and the theory by which they are read."""

    frequency: Floats
    stiffness: Floats
    damping: Floats
    tried: Theory

    @property
    def z(self) -> Complexes:
        """The rows' z on the unit circle."""
        return np.exp(2j * np.pi * self.frequency * self.tried.period)

    @property
    def wall(self) -> Complexes:
        """K + B w."""
        return self.stiffness + self.damping * (1.0 - 1.0 / self.z) / self.tried.period

    @property
    def passed(self) -> Floats:
        """N of each row."""
        return passed_share(command_share(self.wall, self.stiffness, self.tried.ratio))

    def only(self, chosen: NDArray[np.bool_]) -> "Walls":
        """Return some of the rows."""
        return Walls(
            self.frequency[chosen], self.stiffness[chosen], self.damping[chosen], self.tried
        )

    def error(self, plant: Sampled) -> Complexes:
        """Return ln(-N (K + B w) P)."""
        return np.log(-self.passed * self.wall * plant.response(self.z))


def _slope(plant: Sampled, measured: Walls, field: str) -> Complexes:
    """Derivative of the error by the logarithm of a field."""
    value = getattr(measured, field)
    above, below = (
        measured._replace(**{field: value * (1.0 + step)}).error(plant) for step in (STEP, -STEP)
    )
    return (above - below) / (2.0 * STEP)


def _cross(a: Complexes, b: Complexes) -> Floats:
    return a.real * b.imag - a.imag * b.real


def _others(eigenvalues: Complexes, known: complex) -> float:
    """Growth per tick of all oscillations but the one that is known to be critical."""
    upper = eigenvalues[eigenvalues.imag >= 0.0]
    others = np.delete(upper, int(np.argmin(np.abs(upper - known))))
    return float(np.maximum(np.log(np.maximum(np.abs(others), 1e-300)), 0.0).sum())
