"""A device of one, two or three masses to start from, identified from a recording alone.

`identify` fits eq. (1) to a frequency response, which needs an excitation of all frequencies and
about 8000 samples. The method here works with ordinary recordings. They are cut into windows, in
each of which the chain runs freely under the command. The error is measured as a speed, so that a
small fast mode counts beside a large slow drift:

    e_w = (I - P) d/dt (y_w - H (u_w + sum_i a_i f_i,w)),

P projects onto the free motions and the effect of a constant force, so that neither the initial
state of a window nor an offset counts; H is the impulse response; f_i are further possible forces
computed from the *measured* motion: friction, q^3, sin q, cos q, and u^3 of a saturating amplifier.
Their strengths a_i are solved for at every step, so that friction, gravity, a spring and a limit
neither distort masses and dampers nor require a further mass. The returned device has neither these
forces nor the spring to ground that is fitted with the chain: the diagnosis has to find them.
Without a command the spring stays in the device, which could not swing otherwise, and masses are in
units of m1.

The number of masses is chosen on three of ten windows, which are not fitted: another mass is added
if it reduces the rms error there by a fifth (`WORTH`), and if masses and modes have values that a
recording can determine.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from zwidth.identification.response import RecordingError
from zwidth.sim.chain import Chain, make_chain

Floats = NDArray[np.float64]
MOST_MASSES = 3
LEAST_SAMPLES = 200
WINDOW_S = 1.0  # longer than a damper's time constant; a wrong model stays in phase for longer
LEAST_WINDOW, LEAST_WINDOWS = 60, 6
MOST_SAMPLES = 20_000  # windows of all recordings; of more, evenly spaced ones are used
FIT_SHARE = 0.7
WORTH = 0.8  # largest ratio of held-out errors, with and without another mass, that justifies it
LEAST_SHARE = 0.05  # least share of a mass in the whole inertia
SLOWEST, FASTEST = 2.0, 0.4  # least periods of a mode per window, and most per sample
SMOOTHED = 9  # samples of the smoothing that gives speed and acceleration for the starts
COST = 0.03  # share of the motion that a further force as large as the command must explain
TRUSTED = 0.03  # share of the motion that a factor of e from the regression's inertia must explain
LEAST_DAMPED = 0.01  # least damper, over the inertia's force at the slowest motion of a window
STILL = 0.02  # of the rms speed, below which the sign of a speed is uncertain
SHARES = (0.5, 0.15)  # starting shares of a further mass in the inertia
MODES = 5  # starting frequencies of a further mass, between the band's ends
STEPS = 40  # most steps of a descent
RANGE = 9.0  # of a logarithm on either side of the start


@dataclass(frozen=True)
class Motion:
    """The part of a recording that a fit uses.

    period [s]; command (ticks,), None if nothing drives the device; outputs (ticks, o) in SI;
    quantities: of each output "position" or "velocity" and the mass, counted from 0; rotary:
    whether the position is an angle.
    """

    period: float
    command: Floats | None
    outputs: Floats
    quantities: tuple[tuple[str, int], ...]
    rotary: bool


@dataclass(frozen=True)
class FirstDevice:
    """The chain chosen, and the held-out errors that chose it.

    errors: for each number of masses from `least` on, the rms error of free runs over windows that
    were not fitted, relative to the rms motion in them; window: length [s].
    """

    chain: Chain
    least: int
    errors: tuple[float, ...]
    window: float


def first_device(motions: Sequence[Motion]) -> FirstDevice:
    """Return a chain of masses identified from recordings of one device.

    Raises RecordingError if they are too short or do not move.
    """
    least = 1 + max(mass for motion in motions for _, mass in motion.quantities)
    windows = Windows.of(motions)
    windows = replace(windows, inertia=float(_regressed(windows.of_one_mass())[0]))
    fit, judge = windows.split()
    found: list[Floats] = []
    errors: list[float] = []
    for n in range(least, max(least, MOST_MASSES) + 1):
        x = _fitted(fit, n, found[-1] if found and n > least else None)
        error = _error(judge, x, n, _residual(x, n, fit)[1])
        if found and not (error <= WORTH * errors[-1] and _plausible(x, n, windows)):
            errors.append(error)
            break
        found.append(x)
        errors.append(error)
    chosen = len(found) - 1
    masses = least + chosen
    x = _descended(windows, found[chosen], masses)
    chain = _chain(x, masses, windows)
    return FirstDevice(chain, least, tuple(errors), windows.length * windows.period)


def _plausible(x: Floats, n: int, windows: "Windows") -> bool:
    """Whether no mass is too small a share of the device, and windows can show every mode."""
    masses, springs = np.exp(x[:n]), np.exp(x[2 * n : 3 * n - 1])
    reduced = 1.0 / (1.0 / masses[1:] + 1.0 / masses[:-1])
    hertz = np.sqrt(springs / reduced) / (2.0 * np.pi)
    slowest, fastest = SLOWEST / (windows.length * windows.period), FASTEST / windows.period
    ratio = np.exp(x[3 * n - 1 : 4 * n - 2]) / (4.0 * np.pi * hertz * reduced)
    within = bool(np.all((hertz > slowest) & (hertz < fastest) & (ratio < 1.0)))
    return within and bool(np.all(masses > LEAST_SHARE * masses.sum()))


@dataclass(frozen=True)
class Windows:
    """Windows of equal length: forces (1 + f, length, windows), the command first, and outputs.

    at (1 + f,): the mass that each force acts on, counted from 0; brakes (1 + f,): whether the
    force is friction; free: whether nothing drives the device; inertia: logarithm of the inertia
    found by a regression.
    """

    period: float
    length: int
    free: bool
    forces: Floats
    at: tuple[int, ...]
    brakes: NDArray[np.bool_]
    outputs: Floats
    quantities: tuple[tuple[str, int], ...]
    inertia: float = 0.0

    @property
    def command(self) -> Floats:
        """The command (length, windows)."""
        return self.forces[0]

    @staticmethod
    def of(motions: Sequence[Motion]) -> "Windows":
        """Cut recordings into windows; raises RecordingError if no usable window results."""
        first = motions[0]
        quantities = tuple(q for q in first.quantities if all(q in m.quantities for m in motions))
        if not quantities:
            raise RecordingError(
                "the recordings have no motion in common; diagnose them one by one"
            )
        shortest = min(m.outputs.shape[0] for m in motions)
        if shortest < LEAST_SAMPLES:
            raise RecordingError(
                f"the recording has {shortest} samples; at least {LEAST_SAMPLES} are needed, and 10"
                " s is plenty"
            )
        free = all(m.command is None or np.ptp(m.command) == 0.0 for m in motions)
        length = round(WINDOW_S / first.period)
        length = max(LEAST_WINDOW, min(length, shortest // LEAST_WINDOWS))
        kinds = _forces(first, quantities, free)
        at, brakes = tuple(f.mass for f in kinds), np.array([f.brakes for f in kinds])
        parts = [_cut(m, length, quantities, free) for m in motions]
        forces, outputs = (np.concatenate(p, axis=-1) for p in zip(*parts, strict=True))
        step = max(1, math.ceil(outputs[0].size / MOST_SAMPLES))
        return Windows(
            first.period,
            length,
            free,
            forces[..., ::step],
            at,
            brakes,
            outputs[..., ::step],
            quantities,
        )

    def split(self) -> tuple["Windows", "Windows"]:
        """Return windows to fit, and held-out windows.

        Of every ten windows, the last three are held out, so that each recording has both kinds.
        """
        count = self.outputs.shape[2]
        judged = np.arange(count) % 10 >= 10 * FIT_SHARE - 1e-9
        if not judged.any():
            judged[-1] = True
        return self._only(~judged), self._only(judged)

    def of_one_mass(self) -> "Windows":
        """Return the windows with the first output only, as if it belonged to m1."""
        own = self.quantities[0][1]
        keep = [i for i, mass in enumerate(self.at) if i == 0 or mass == own]
        quantities = ((self.quantities[0][0], 0),)
        return replace(
            self,
            forces=self.forces[keep],
            at=(0,) * len(keep),
            brakes=self.brakes[keep],
            outputs=self.outputs[:1],
            quantities=quantities,
        )

    def _only(self, which: NDArray[np.bool_]) -> "Windows":
        return replace(self, forces=self.forces[..., which], outputs=self.outputs[..., which])


def _cut(
    motion: Motion, length: int, quantities: tuple[tuple[str, int], ...], free: bool
) -> tuple[Floats, Floats]:
    count = motion.outputs.shape[0] // length
    rows = [motion.quantities.index(q) for q in quantities]
    forces = [force.values for force in _forces(motion, quantities, free)]
    signals = np.vstack([*forces, *motion.outputs.T[rows]])
    cut = signals[:, : count * length].reshape(-1, count, length).transpose(0, 2, 1)
    return cut[: -len(rows)], cut[-len(rows) :]


class Force(NamedTuple):
    """A force on a mass, values (ticks,); brakes: whether it is friction, against the speed."""

    mass: int
    values: Floats
    brakes: bool = False

    def of_rms_one(self) -> "Force":
        """Return the force in units of its own rms."""
        with np.errstate(all="ignore"):
            size = float(np.sqrt(np.mean(self.values**2)))
        return self._replace(values=self.values / size) if 0.0 < size < math.inf else self


def _forces(motion: Motion, quantities: tuple[tuple[str, int], ...], free: bool) -> list[Force]:
    """Return the command, and the further possible forces computed from the measured motion.

    The latter have an rms of one and are computed for the middle of each sample's period, over
    which a force is held.
    """
    command = np.zeros(motion.outputs.shape[0]) if motion.command is None else motion.command
    further = [] if free else [Force(0, command**3)]
    for mass in sorted({m for _, m in quantities}):
        known = {q: motion.outputs[:, motion.quantities.index((q, m))] for q, m in quantities
                 if m == mass}  # fmt: skip
        speed = _speed(known, motion.period)
        rms = float(np.sqrt(np.mean(speed**2))) or 1.0
        further.append(Force(mass, _held(-np.tanh(speed / (STILL * rms))), brakes=True))
        if not free and mass == 0 and "position" in known:
            q = known["position"]
            own = [q**3, *((np.sin(q), np.cos(q)) if motion.rotary else ())]
            further += [Force(mass, _held(force)) for force in own]
    return [Force(0, command), *(force.of_rms_one() for force in further)]


def _held(force: Floats) -> Floats:
    return 0.5 * (force + np.append(force[1:], force[-1]))


def _speed(known: Mapping[str, Floats], period: float) -> Floats:
    if "velocity" in known:
        return known["velocity"]
    return np.asarray(savgol_filter(known["position"], SMOOTHED, 2, deriv=1, delta=period))


# x (4 n - 1,): ln masses, dampers, link springs and link dampers; then the spring to ground over
# the first mass, the square of a frequency.
@dataclass(frozen=True)
class _Linear:
    """The sampled equations: free (length, o, 2n) and forced (length, o, n) motion of outputs."""

    free: Floats
    forced: Floats


def _matrices(x: Floats, n: int) -> tuple[Floats, Floats, Floats]:
    masses, dampers = np.exp(x[:n]), np.exp(x[n : 2 * n])
    springs, link_dampers = np.exp(x[2 * n : 3 * n - 1]), np.exp(x[3 * n - 1 : 4 * n - 2])
    damping, stiffness = np.diag(dampers), np.zeros((n, n))
    stiffness[0, 0] = x[-1] * np.exp(x[0])  # x[-1] is the square of a frequency; may be negative
    link = np.array([[1.0, -1.0], [-1.0, 1.0]])
    for i in range(n - 1):
        ends = slice(i, i + 2)
        stiffness[ends, ends] += springs[i] * link
        damping[ends, ends] += link_dampers[i] * link
    return masses, damping, stiffness


def _linear(x: Floats, n: int, windows: Windows) -> _Linear:
    masses, damping, stiffness = _matrices(x, n)
    system = np.zeros((3 * n, 3 * n))
    system[:n, n : 2 * n] = np.eye(n)
    system[n : 2 * n, :n] = -stiffness / masses[:, None]
    system[n : 2 * n, n : 2 * n] = -damping / masses[:, None]
    system[n : 2 * n, 2 * n :] = np.diag(1.0 / masses)
    step = expm(system * windows.period)
    seen = np.zeros((len(windows.quantities), 2 * n))
    for row, (quantity, mass) in enumerate(windows.quantities):
        seen[row, mass + (n if quantity == "velocity" else 0)] = 1.0
    rows, power = seen[None], step[: 2 * n, : 2 * n]
    while rows.shape[0] < windows.length:
        rows = np.concatenate([rows, rows @ power])
        power = power @ power
    rows = rows[: windows.length]
    forced = np.zeros((windows.length, rows.shape[1], n))
    forced[1:] = rows[:-1] @ step[: 2 * n, 2 * n :]
    return _Linear(rows, forced)


def _projected(x: Floats, n: int, windows: Windows) -> tuple[Floats, Floats] | None:
    """Return the measured motion (ticks * windows,) and that of each force (..., 1 + f), projected.

    Both are speeds in units of each output's own, stacked, without the part that free motion and a
    constant force can explain. None if the model overflows.
    """
    with np.errstate(all="ignore"):
        linear = _linear(x, n, windows)
        size = 2 * windows.length
        response = np.fft.rfft(linear.forced, size, axis=0).transpose(2, 1, 0)[list(windows.at)]
        forces = np.fft.rfft(windows.forces, size, axis=1)
        moved = np.fft.irfft(response[..., None] * forces[:, None], size, axis=2)
        steady = np.cumsum(linear.forced[..., 0], axis=0)
        free = np.concatenate([linear.free, steady[..., None]], axis=2).transpose(1, 0, 2)
    parts = [windows.outputs[None], moved[:, :, : windows.length]]
    signals = np.concatenate(parts).transpose(1, 2, 3, 0)
    rows: list[Floats] = []
    bases: list[Floats] = []
    for (quantity, _), values, basis in zip(windows.quantities, signals, free, strict=True):
        speeds = np.diff(values, axis=0) if quantity == "position" else values[1:]
        size = float(np.std(speeds[..., 0])) or 1.0
        rows.append(speeds / size)
        bases.append((np.diff(basis, axis=0) if quantity == "position" else basis[1:]) / size)
    stacked, basis = np.concatenate(rows), np.concatenate(bases)
    if not (np.all(np.isfinite(basis)) and np.all(np.isfinite(stacked))):
        return None
    norm = np.linalg.norm(basis, axis=0)
    u, s, _ = np.linalg.svd(basis / np.where(norm > 0.0, norm, 1.0), full_matrices=False)
    u = u[:, s > 1e-9 * s[0]]
    flat = stacked.reshape(stacked.shape[0], -1)
    left = (flat - u @ (u.T @ flat)).reshape(-1, stacked.shape[2])
    return left[:, 0], left[:, 1:]


def _residual(
    x: Floats, n: int, windows: Windows, strengths: Floats | None = None
) -> tuple[Floats, Floats]:
    """Return the error, and the strengths of the further forces; these are solved for unless given.

    Among parameters that cannot be distinguished, such as a mass and a spring under one sine,
    smaller forces are preferred: a force of the command's size costs `COST` of the motion.
    """
    projected = _projected(x, n, windows)
    if projected is None:
        size = (windows.length - 1) * windows.outputs.shape[0] * windows.outputs.shape[2]
        return np.full(size + windows.forces.shape[0] - 1, 1e6), np.zeros(len(windows.at) - 1)
    wanted, moved = projected
    error, further = wanted - moved[:, 0], moved[:, 1:]
    if strengths is not None:
        return error - further @ strengths, strengths
    cost = COST * math.sqrt(wanted.size) / (float(np.sqrt(np.mean(windows.command**2))) or 1.0)
    table = np.vstack([further, cost * np.eye(further.shape[1])])
    target = np.concatenate([error, np.zeros(further.shape[1])])
    found = np.zeros(further.shape[1])
    brakes = windows.brakes[1:]
    kept = np.ones(found.size, dtype=np.bool_)
    for _ in range(2):  # leave out "friction" that drives: it only reproduces the measured motion
        found[:] = 0.0
        found[kept] = np.linalg.lstsq(table[:, kept], target, rcond=None)[0]
        kept &= ~(brakes & (found < 0.0))
    return target - table @ found, found


def _error(windows: Windows, x: Floats, n: int, strengths: Floats | None = None) -> float:
    return float(np.sqrt(np.mean(_residual(x, n, windows, strengths)[0] ** 2)))


def _descended(windows: Windows, x: Floats, n: int, steps: int = STEPS) -> Floats:
    scale, spread = np.ones(x.size), np.full(x.size, RANGE)
    scale[-1], spread[-1] = (2.0 * np.pi / (windows.length * windows.period)) ** 2, np.inf
    free = np.ones(x.size, dtype=np.bool_)
    if windows.free:  # the scale is undetermined
        free[0] = False

    def whole(part: Floats) -> Floats:
        y = x.copy()
        y[free] = part
        return y

    trust = TRUSTED * math.sqrt(windows.outputs.size)

    def error(part: Floats) -> Floats:
        y = whole(part)
        away = trust * (np.logaddexp.reduce(y[:n]) - windows.inertia)
        return np.append(_residual(y, n, windows)[0], away)

    found = least_squares(
        error, x[free], x_scale=scale[free],
        bounds=((x - spread)[free], (x + spread)[free]), max_nfev=steps, ftol=1e-6, xtol=1e-9,
        gtol=1e-9,
    )  # fmt: skip
    return whole(found.x)


def _fitted(windows: Windows, n: int, simpler: Floats | None) -> Floats:
    """Return the best fit of n masses, started from a regression or from the fit of n - 1."""
    if simpler is None and n > 1:  # divide one body that was fitted to the first output alone
        simpler = _fitted(windows.of_one_mass(), 1, None)
        for masses in range(2, n):
            simpler = next(_richer(windows, simpler, masses))
    if simpler is None:
        sprung = _regressed(windows)
        starts = [sprung, np.append(sprung[:2], 0.0)]
    else:
        starts = [*_richer(windows, simpler, n)]
    cost = [_error(windows, x, n) for x in starts]
    best = [starts[i] for i in np.argsort(cost)[:2]]
    tried = [_descended(windows, x, n, STEPS // 4) for x in best]
    tried.sort(key=lambda x: _error(windows, x, n))
    return _descended(windows, tried[0], n)


def _regressed(windows: Windows) -> Floats:
    """Return a start of one mass: m a + b v = u + further forces, by least squares."""
    values, position = windows.outputs[0], windows.quantities[0][0] == "position"
    first = 1 if position else 0
    speed, acceleration = (
        np.asarray(savgol_filter(values, SMOOTHED, 3, deriv=d, delta=windows.period, axis=0))
        for d in (first, first + 1)
    )
    command, *further = windows.forces
    columns = [acceleration, speed, *([values] if position else []), np.ones_like(speed)]
    inner = slice(SMOOTHED, -SMOOTHED)
    table = np.column_stack([c[inner].ravel() for c in (*columns, *(-f for f in further))])
    target = command[inner].ravel()
    if windows.free:  # per unit of m1
        target, table = -table[:, 0], table[:, 1:]
    size = np.linalg.norm(table, axis=0)
    size[size == 0.0] = 1.0
    found = np.linalg.lstsq(table / size, target, rcond=1e-9)[0] / size
    if windows.free:
        mass, damper, spring = 1.0, float(found[0]), max(0.0, float(found[1])) if position else 0.0
    else:
        rough = float(np.std(command)) / (float(np.std(acceleration)) or 1.0)
        mass, damper, spring = float(found[0]), float(found[1]), 0.0
        mass = mass if 1e-3 * rough < mass < 1e3 * rough else rough
        spring = max(0.0, float(found[2])) if position else 0.0
    damper = max(damper, 1e-3 * mass / (windows.length * windows.period))
    return np.array([math.log(mass), math.log(damper), spring / mass])


def _richer(windows: Windows, x: Floats, n: int) -> Iterator[Floats]:
    """Yield starts of n masses: those of a fit, its last mass divided in two joined by a spring."""
    before = n - 1
    last = before - 1
    low = 2.0 / (windows.length * windows.period)
    for hz in np.geomspace(low, 0.25 / windows.period, MODES):
        for share in SHARES:
            own = x[last] + math.log(1.0 - share)
            mass = x[last] + math.log(share)
            reduced = np.exp(mass) * (1.0 - share)
            omega = 2.0 * np.pi * hz
            spring, damper = math.log(reduced * omega**2), math.log(0.1 * reduced * omega)
            yield np.concatenate([
                x[:last], [own, mass],
                x[before : 2 * before], [x[2 * before - 1] + math.log(share)],
                x[2 * before : 3 * before - 1], [spring],
                x[3 * before - 1 : 4 * before - 2], [damper],
                x[-1:],
            ])  # fmt: skip


def _chain(x: Floats, n: int, windows: Windows) -> Chain:
    ground = max(0.0, float(x[-1] * np.exp(x[0]))) if windows.free else 0.0
    slow = 2.0 * np.pi / (windows.length * windows.period)
    masses, dampers = np.exp(x[:n]), np.exp(x[n : 2 * n])
    dampers = np.maximum(dampers, LEAST_DAMPED * slow * masses)  # a damper of 0 has no logarithm
    return make_chain(
        masses, dampers, ground, np.exp(x[2 * n : 3 * n - 1]),
        np.exp(x[3 * n - 1 : 4 * n - 2]),
    )  # fmt: skip
