"""The relay experiment of Section IV: a limit cycle whose first harmonic gives (K_CR, frequency).

The describing-function argument: a square wave of force +-D and the position it drives are in
opposite phase at the oscillation's frequency, so the loop with the gain |U|/|Y| of their first
harmonics in place of the relay would be marginal. They are read as in the paper, over the steady
part: from the peak of the averaged spectra of both signals and the empirical transfer function
there. Here the two spectra are one long Blackman-Harris window each: on a line spectrum the ratio
at the peak is the ratio of the harmonics, whatever the bin.

The steady state is detected, not assumed: the run continues until range and energy of the position
agree in three consecutive stretches. A run whose oscillation energy keeps growing has the verdict
"diverges" and no K_CR.

The period of most cycles is a whole number of ticks, so K is off the boundary by up to 15 %. There
may be several cycles: see `identification/cycles.py`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.signal.windows import blackmanharris

from zwidth.controllers.relay import relay
from zwidth.shown import Valued
from zwidth.sim.controller import Controller
from zwidth.sim.device import Device
from zwidth.sim.equations import Equations, equations
from zwidth.sim.growth import SIGNIFICANCE, growth_rate, window_weights
from zwidth.sim.kernel import Memory, advance, scratch
from zwidth.sim.run import Start, start_memory

Floats = NDArray[np.float64]
RelayVerdict = Literal["oscillates", "diverges", "undecided"]
WINDOW_S = 0.5
AGREEMENT = 1e-3


@dataclass(frozen=True)
class RelayTest(Valued):
    """Settings of a relay experiment.

    force: D of the relay [N m | N]; stretch_s: time between two checks for a steady state;
    steady_s: length of steady state that is measured; limit_s: longest run; bound: |position| at
    which a run ends; substeps: per tick, for devices that need them.

    Raises ValueError (field, value, what is allowed).
    """

    force: float = 0.05
    stretch_s: float = 5.0
    steady_s: float = 25.0
    limit_s: float = 120.0
    bound: float = 1e3
    substeps: int = 1

    def __post_init__(self) -> None:
        for field in ("force", "stretch_s", "steady_s", "limit_s", "bound"):
            if not 0.0 < getattr(self, field) < np.inf:
                raise ValueError(f"{field} is {getattr(self, field)}; it must be finite and > 0")
        if self.stretch_s < 6.0 * WINDOW_S:
            raise ValueError(
                f"stretch_s is {self.stretch_s}; at least {6.0 * WINDOW_S} s are needed"
            )


STANDARD = RelayTest()


@dataclass(frozen=True)
class RelayResult(Valued):
    """The result of one run. stiffness, frequency_hz, amplitude: None unless it oscillates.

    rate: growth rate [1/s] of the oscillation at the end.
    """

    verdict: RelayVerdict
    stiffness: float | None
    frequency_hz: float | None
    amplitude: float | None
    rate: float


@dataclass(frozen=True)
class Waveform:
    """Relay force and position over the last ticks of a run, all (ticks,); t begins at 0."""

    t: Floats
    force: Floats
    position: Floats


def reference_start(device: Device) -> Start:
    """Return the start of the reported results: m1 at 1e-3, the other masses at 0, all at rest."""
    others = device.chain.masses.size + len(device.hung()) - 1
    return Start(position=[1e-3] + [0.0] * others)


def relay_run(
    device: Device, damping: float, start: Start | None = None, test: RelayTest = STANDARD
) -> RelayResult:
    """Run a relay experiment with the device's delay until it is steady or grows, or time is up."""
    start = reference_start(device) if start is None else start
    return run(equations(device, test.substeps), damping, start, test)


def waveform(
    device: Device,
    damping: float,
    seconds: float,
    test: RelayTest = STANDARD,
    start: Start | None = None,
) -> Waveform:
    """Return the last seconds of a run, as in Fig. 8; start: by default the reference start.

    Raises ValueError if that run has no steady oscillation.
    """
    eq = equations(device, test.substeps)
    law = relay(test.force, damping)
    begun = reference_start(device) if start is None else start
    memory = start_memory(eq, begun, law.memory)
    result = _until_steady(eq, law, memory, test)
    if result.verdict != "oscillates":
        raise ValueError(
            f"the relay loop {result.verdict} at B = {damping:g}; choose a damping at which it"
            " oscillates"
        )
    ticks = max(1, round(seconds / eq.period))
    record, _ = _stretch(eq, law, memory, ticks, test.bound)
    t = np.arange(ticks, dtype=np.float64) * eq.period
    return Waveform(t, test.force * record[:, 2], record[:, 0])


def run(eq: Equations, damping: float, start: Start, test: RelayTest) -> RelayResult:
    """Run one relay experiment on prepared equations; see `relay_run`."""
    law = relay(test.force, damping)
    return _until_steady(eq, law, start_memory(eq, start, law.memory), test)


def _until_steady(eq: Equations, law: Controller, memory: Memory, test: RelayTest) -> RelayResult:
    ticks = round(test.stretch_s / eq.period)
    stretches: list[Floats] = []
    looks: list[tuple[float, float]] = []
    while len(stretches) * test.stretch_s < test.limit_s:
        record, whole = _stretch(eq, law, memory, ticks, test.bound)
        if not whole:
            return RelayResult("diverges", None, None, None, np.inf)
        stretches.append(record[:, 0])
        rate, error = _growth(stretches, eq)
        grown = rate > SIGNIFICANCE * error and rate * test.stretch_s * len(stretches) > 1.0
        looks.append((float(np.ptp(record[:, 0])), _energy(record[:, 1])))
        steady = len(looks) >= 3 and _agree(looks[-3:])
        if grown and len(looks) >= 3 and not steady:
            return RelayResult("diverges", None, None, None, rate)
        if steady:
            return _measured(eq, law, memory, test, rate)
    return RelayResult("undecided", None, None, None, _growth(stretches, eq)[0])


def _energy(velocity: Floats) -> float:
    """Mean square with smooth weights, hence independent of the phase at the ends."""
    return float(window_weights(velocity.size) @ (velocity * velocity))


def _agree(looks: Sequence[tuple[float, float]]) -> bool:
    values = np.array(looks)
    return bool(np.all(np.ptp(values, axis=0) <= AGREEMENT * values.max(axis=0)))


def _measured(
    eq: Equations, law: Controller, memory: Memory, test: RelayTest, rate: float
) -> RelayResult:
    ticks = round(test.steady_s / eq.period)
    record, whole = _stretch(eq, law, memory, ticks, test.bound)
    if not whole:
        return RelayResult("diverges", None, None, None, np.inf)
    stiffness, frequency = critical_point(test.force * record[:, 2], record[:, 0], eq.period)
    amplitude = 0.5 * float(np.ptp(record[:, 0]))
    return RelayResult("oscillates", stiffness, frequency, amplitude, rate)


def _stretch(
    eq: Equations, law: Controller, memory: Memory, ticks: int, bound: float
) -> tuple[Floats, bool]:
    """Return (position, velocity, relay side) of m1 over some ticks, and whether all were run."""
    record = np.zeros((ticks, eq.states + 6))
    done, _ = advance(
        eq, law.step, law.parameters, memory, scratch(eq), ticks, np.zeros((0, eq.dof)), bound,
        record, np.zeros((0, eq.states)), False,
    )  # fmt: skip
    return record[:done, [0, eq.dof, eq.states + 4]], done == ticks


def _growth(positions: Sequence[Floats], eq: Equations) -> tuple[float, float]:
    """Growth rate [1/s] of the position's oscillation over all stretches, and its error."""
    weights = window_weights(round(WINDOW_S / eq.period))
    position = np.concatenate(positions)
    position = position[: position.size // weights.size * weights.size].reshape(-1, weights.size)
    centred = position - position.mean(axis=1)[:, None]
    with np.errstate(divide="ignore"):
        lines = 0.5 * np.log((centred * centred) @ weights)
    rate, error = growth_rate(lines[:, None], weights.size * eq.period)
    return float(rate[0]), float(error[0])


def critical_point(force: Floats, position: Floats, period: float) -> tuple[float, float]:
    """Return (K_CR, frequency [Hz]) from steady relay force and position, each (ticks,).

    Raises ValueError if either signal is constant.
    """
    if np.ptp(force) == 0.0 or np.ptp(position) == 0.0:
        raise ValueError("the relay never switched in the steady part; raise its force")
    window = blackmanharris(force.size)
    size = 1 << (2 * force.size - 1).bit_length()
    u = np.abs(np.fft.rfft((force - force.mean()) * window, size))
    y = np.abs(np.fft.rfft((position - position.mean()) * window, size))
    power = u**2 / np.sum(u**2) + y**2 / np.sum(y**2)
    peak = int(np.argmax(power[1:-1])) + 1
    left, middle, right = np.log(power[peak - 1 : peak + 2])
    offset = 0.5 * (left - right) / (left - 2.0 * middle + right)
    return float(u[peak] / y[peak]), float((peak + offset) / (size * period))
