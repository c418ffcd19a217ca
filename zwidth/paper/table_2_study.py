"""Which physics explains Table II? Candidates fitted to its rows, judged by rows left out.

A row (delay, B, K, f) measures the sampled plant at z = e^{2 pi j f T}: -1/G = (K + B w) z^-d,
w = (1 - 1/z)/T. The fit compares ln of both sides, 0.03 in part I, 0.08 after the jump of f. A row
says more: nothing else was unstable there, so every other eigenvalue of the loop at (K, B) must
lie inside the circle; each growth rate above zero counts as an error of 1/s. Without this, a model
may fit all points and still have its boundary on another branch.

Coulomb friction of level fc, seen by a relay of force D: amplitude A = 4 D / (pi K), describing
function 4 fc / (pi A w), hence a damper (fc/D) K / w at m1. D is not known: rho = fc/D is fitted.
Limits: priors of 10 % on inertia and frequencies, 30 % on c and d, 50 % on b hold the parameters;
24 rows cannot tell all candidates apart.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from identification.coordinates import parameters
from scenarios.misprints import JUMPED_HZ
from scenarios.table_2 import DEVICE, MeasuredPoint, table_2
from sim.device import Device
from sim.device_file import load_device
from sim.modal import ModalModel, Mode
from stability.decomposition import from_modal, from_plant, sampled
from stability.linear import critical_stiffness
from stability.loop import open_loop

Floats = NDArray[np.float64]
PARAMETERS = ("m", "b", "omega_1", "c_1", "v_1", "d_1", "omega_2", "c_2", "v_2", "d_2")
SECOND = PARAMETERS[6:]
SPREAD: dict[str, float] = {
    **dict(zip(PARAMETERS, (0.1, 0.5, *(0.1, 0.3, 0.1, 0.3) * 2), strict=True)),
    "viscous": 0.02,
    "delay": 1e-3,
    "gain": 0.1,
    "rho": 0.3,
}
NOT_NEGATIVE = ("viscous", "delay", "rho")
PART_1, PART_2 = 0.03, 0.08
ROUNDS = 30  # of the friction's damper, which depends on the K that it changes
MOST_STEPS, NEARBY_STEPS = 300, 8  # of a fit from nothing, and from the fit to all rows
CANDIDATES: dict[str, tuple[str, ...]] = {
    "Table I (the paper's)": (),
    "Coulomb friction": ("rho",),
    "extra viscous friction": ("viscous",),
    "fractional delay": ("delay",),
    "gain error": ("gain",),
    "another second mode": SECOND,
    "second mode, viscous friction": (*SECOND, "viscous"),
    "second mode, Coulomb friction": (*SECOND, "rho"),
    "Table I refitted": PARAMETERS,
    "Table I refitted, Coulomb friction": (*PARAMETERS, "rho"),
}


class Errors(NamedTuple):
    """Mean absolute errors: K in parts I and II [N m/rad], f in part I [Hz]; rows with no wall."""

    part_1: float
    part_2: float
    frequency_hz: float
    without: int


@dataclass(frozen=True)
class Judged:
    """A candidate: its fit to all good rows, and the errors with and without the row in the fit."""

    name: str
    values: dict[str, float]
    fitted: Errors
    left_out: Errors


def good_rows() -> list[MeasuredPoint]:
    """Return the rows of Table II that are no misprints."""
    return [row for row in table_2() if row.damping_meant is None]


def study(names: Sequence[str] = tuple(CANDIDATES), leave_out: bool = True) -> list[Judged]:
    """Fit and judge candidates; without leave_out both errors are those of the fit."""
    rows = good_rows()
    found: list[Judged] = []
    for name in names:
        free = CANDIDATES[name]
        x = fit(free, rows)
        points = [predict(free, x, row) for row in rows]
        others = points
        if leave_out and free:
            others = [predict(free, fit(free, _without(rows, row), x), row) for row in rows]
        values = dict(zip(free, x.tolist(), strict=True))
        found.append(Judged(name, values, errors(rows, points), errors(rows, others)))
    return found


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
    """Return the errors of the rows over their spread, and the growth rates that must not be."""
    values = dict(zip(free, x.tolist(), strict=True))
    plain = changed(values)
    period = plain.interface.period
    gain, rho = float(np.exp(values.get("gain", 0.0))), values.get("rho", 0.0)
    found: list[float] = []
    for row in rows:
        z = np.exp(2j * np.pi * row.frequency * period)
        wall = row.stiffness + row.damping * (1.0 - 1.0 / z) / period
        damper = rho * row.stiffness / (2.0 * np.pi * row.frequency)
        device = _rubbed(plain, damper).with_interface(delay=row.delay + values.get("delay", 0.0))
        known = device.modal
        fractions = from_plant(device.plant()) if known is None else from_modal(known)
        plant = gain * sampled(fractions, period, *device.interface.delay_ticks, np.array([z]))[0]
        ratio = np.log(-wall * plant)
        spread = PART_1 if row.frequency < JUMPED_HZ else PART_2
        loop = open_loop(device).closed(gain * row.stiffness, gain * row.damping)
        others = _upper(loop, complex(z))
        growth = np.maximum(np.log(np.maximum(np.abs(others), 1e-300)) / period, 0.0)
        found += [ratio.real / spread, ratio.imag / spread, float(growth.sum())]
    return np.array(found)


def _upper(loop: Floats, known: complex) -> NDArray[np.complex128]:
    """Eigenvalues of the upper half plane without the one that is known to be critical."""
    every = np.linalg.eigvals(loop).astype(np.complex128)
    upper = every[every.imag >= 0.0]
    return np.delete(upper, int(np.argmin(np.abs(upper - known))))


def changed(values: dict[str, float]) -> Device:
    """Return the device of Table I with these changes of its mechanism."""
    device = load_device(DEVICE)
    assert device.modal is not None
    p = parameters(device.modal)
    p *= np.exp([values.get(name, 0.0) for name in PARAMETERS])
    p[1] += values.get("viscous", 0.0)
    modes = (Mode(*p[2:6].tolist()), Mode(*p[6:10].tolist()))
    return device.with_modal(ModalModel(float(p[0]), float(p[1]), modes))


def _rubbed(device: Device, damper: float) -> Device:
    if damper == 0.0:
        return device
    dampers = device.chain.ground_dampers.copy()
    dampers[0] += damper
    return device.with_chain(device.chain._replace(ground_dampers=dampers))


def predict(free: Sequence[str], x: Floats, row: MeasuredPoint) -> tuple[float, float]:
    """Return (K_CR, f [Hz]) of the boundary at the row's delay and B; (0, nan) for no wall."""
    values = dict(zip(free, x.tolist(), strict=True))
    device = changed(values).with_interface(delay=row.delay + values.get("delay", 0.0))
    gain, damper = float(np.exp(values.get("gain", 0.0))), 0.0
    stiffness, frequency = 0.0, float("nan")
    for _ in range(ROUNDS if values.get("rho") else 1):
        point = critical_stiffness(_rubbed(device, damper), gain * row.damping)
        if point.stiffness is None or point.frequency_hz is None:
            return 0.0, float("nan")
        stiffness, frequency = point.stiffness, point.frequency_hz
        damper = 0.5 * (damper + values.get("rho", 0.0) * stiffness / (2.0 * np.pi * frequency))
    return stiffness / gain, frequency


def errors(rows: Sequence[MeasuredPoint], points: Sequence[tuple[float, float]]) -> Errors:
    """Return the errors of predicted (K, f) at rows; no stable wall counts as K = 0."""
    stiffness = np.array([abs(k - row.stiffness) for row, (k, _) in zip(rows, points, strict=True)])
    frequency = np.array([abs(f - row.frequency) for row, (_, f) in zip(rows, points, strict=True)])
    slow = np.array([row.frequency < JUMPED_HZ for row in rows])
    same = slow & np.array([f < JUMPED_HZ for _, f in points])
    without = sum(k == 0.0 for k, _ in points)
    return Errors(
        float(np.mean(stiffness[slow])),
        float(np.mean(stiffness[~slow])),
        float(np.mean(frequency[same])),
        without,
    )


def winner() -> Device:
    """Return Table I refitted, as `phantom_1_0_table2` holds it (to five digits)."""
    free = CANDIDATES["Table I refitted"]
    values = dict(zip(free, fit(free, good_rows()).tolist(), strict=True))
    return replace(changed(values), name="PHANToM 1.0, phi axis, refitted to Table II")


def _without(rows: Sequence[MeasuredPoint], one: MeasuredPoint) -> list[MeasuredPoint]:
    return [row for row in rows if row != one]
