"""The inverse model: the force that a recorded motion requires, compared with the command.

If the motion of every mass was recorded, no simulation is needed to find the force that a model
lacks. Positions are smoothed by a zero-phase low-pass (Butterworth, forwards and backwards), and
velocities are the derivatives of a quintic spline through them. At each sample every mass is set to
its recorded position and velocity; internal states (bristles, a lag, a further mode) continue. The
device then moves for one tick T under the command. Let v be its velocity afterwards and v^ the
recorded one; to first order in the missing force,

    f = G^-1 (v^ - v),    G = d v(T) / d (forces held over T),

is the mean missing force over the tick. That on m1 plus the force that acts there (the command
after the gain, lag, delay and limit of the model) is the force that the motion needs. Both are
compared at frequencies below half of the low-pass, which it passes unchanged:

    error = rms(f_1) / rms(force that acts).

This is the customary figure of the field: the inverse model of Gautier (Dynamic identification of
robots with power model, ICRA 1997), with the kernel in place of a regressor, so that all effects
are included. A mass that sticks balances any force within its friction, and needs no other.

The band ends where the noise of readings sigma would be a force of `NOISE` of the command,

    2 sigma^2 / f_s  sum over f < band of (m1^2 (2 pi f)^4 + k^2)  =  (NOISE rms(command))^2,

with (2 pi f)^2 for a velocity, and at a fifth of the sampling frequency at the latest.

Limits: only the force at the drive is compared; the missing forces of other masses are in their own
f. Sensors are assumed to read correctly. A position integrated from a velocity starts at zero.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline
from scipy.signal import butter, cont2discrete, dlsim, sosfiltfilt

from zwidth.diagnosis.answer.held_out import models_of, told_of
from zwidth.diagnosis.answer.whole_run import finite_rms
from zwidth.diagnosis.intake.gate import encoder_step_seen
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import observer_memory, prepared
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.searched import Searched
from zwidth.shown import Valued
from zwidth.sim.device import Device
from zwidth.sim.plant import hold_matrices
from zwidth.sim.predict import GROUND, Outputs, alone

Floats = NDArray[np.float64]
NOISE = 0.01  # of the command: the largest force that noise of readings may cause
WIDEST = 0.2  # of the sampling frequency
ORDER = 4  # of the low-pass, each way
EDGES = 2.0  # periods of the band at either end, where the low-pass lacks data
SPLINE = 5  # degree: its derivative errs by the fifth power of the period
FEWEST = 20  # periods of the band that a recording needs


@dataclass(frozen=True)
class ForceError(Valued):
    """The force at m1 that a recorded motion needs, and the one that was commanded.

    For the device file ("before"), the "refit" and the answer ("after"): acting (ticks,), the
    command as it arrives at m1, from begins [s] on, every period [s]; lacking (ticks,), the needed
    force minus acting. band [Hz]: the highest frequency that is compared. held_out: whether nothing
    was fitted to the recording.
    """

    recording: str
    unit: str
    band: float
    begins: float
    period: float
    acting: Mapping[str, Floats]
    lacking: Mapping[str, Floats]
    held_out: bool

    @property
    def sizes(self) -> dict[str, float]:
        """Rms of the forces that act."""
        return {name: finite_rms(f) for name, f in self.acting.items()}

    @property
    def errors(self) -> dict[str, float]:
        """Rms of the missing forces, infinite after an overflow."""
        return {name: finite_rms(f) for name, f in self.lacking.items()}

    @property
    def shares(self) -> dict[str, float]:
        """Rms of the missing force over the rms of the acting force."""
        sizes = self.sizes
        return {name: e / (sizes[name] or math.nan) for name, e in self.errors.items()}

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "recording": self.recording, "unit": self.unit, "band_hz": self.band,
            "rms": self.errors, "acting_rms": self.sizes, "share": self.shares,
            "held_out": self.held_out,
        }  # fmt: skip


def force_errors(
    device: Device, found: Searched, fitted: Sequence[Experiment], judge_by: Sequence[Experiment]
) -> tuple[ForceError, ...]:
    """Return the force errors of validation recordings and of fitted recordings.

    Recordings without the motion of every mass, or without a commanded force, have none. The
    held-out rest of a recording is filtered together with its first part, and judged alone.
    """
    models = models_of(device, found)
    return tuple(
        _of(models, device, e, held, band)
        for e, held in told_of(fitted, judge_by)
        if (band := band_of(device, e)) is not None
    )


def _of(
    models: Mapping[str, tuple[Model, Floats]], device: Device, e: Experiment, held: bool,
    band: float,
) -> ForceError:  # fmt: skip
    joined = e.joined()
    edge = math.ceil(EDGES / (band * e.period))
    kept = slice(max(joined.ticks - e.ticks, edge), joined.ticks - edge)
    lacking = {name: lacks(m, x, joined, band)[kept, 0] for name, (m, x) in models.items()}
    acting = {name: acts(m, x, joined, band)[kept] for name, (m, x) in models.items()}
    begins = joined.begins + kept.start * e.period
    return ForceError(
        e.name, "N m" if device.rotary else "N", band, begins, e.period,
        acting, lacking, held,
    )  # fmt: skip


def lacks(model: Model, x: Floats, e: Experiment, band: float) -> Floats:
    """Return the force (ticks, n) on each mass that a model lacks for a recorded motion, in a band.

    Infinite after an overflow. Zero at the last tick (before filtering), since the state after it
    was not recorded.
    """
    seen = model.seen(e, x)
    position, velocity = motion(seen, model.nominal.chain.masses.size, 2.0 * band)
    found = _forces(_without(model.acting(x), "sensor"), seen, position, velocity, band)
    arriving = _arrives(model, x, e, band)
    found[:, 0] += arriving - as_read(model.acting(x), seen, arriving)
    return found


def acts(model: Model, x: Floats, e: Experiment, band: float) -> Floats:
    """Return the command (ticks,) as it arrives at m1 in a model and as it is read, in a band."""
    return as_read(model.acting(x), model.seen(e, x), _arrives(model, x, e, band))


def _arrives(model: Model, x: Floats, e: Experiment, band: float) -> Floats:
    """Return the command (ticks,) as it arrives at m1, in a band.

    It is minus the force that a device without forces of its own would need to stand still.
    """
    seen = model.seen(e, x)
    still = np.zeros((seen.ticks, model.nominal.chain.masses.size))
    device = _without(model.acting(x), "sensor", "force", "friction")
    return -_forces(device, seen, still, still, band)[:, 0]


def as_read(device: Device, e: Experiment, force: Floats) -> Floats:
    """Return a force (ticks,) after the filters that act between m1's motion and its reading.

    A linear device needs an equally filtered force for a filtered motion: L (F q) = F (L q).
    """
    output = _of_mass(e, 0)
    places = ("sensor", "velocity") if output and output.quantity == "velocity" else ("sensor",)
    for p in device.physics:
        if p.effect.follows is not None and p.at in places:
            rate, straight, square, damping = map(float, p.effect.follows(p.values))
            a = np.array([[-rate, straight], [-square, -rate - damping]])
            b, c, d = np.array([[rate], [square]]), np.array([[1.0, 0.0]]), np.zeros((1, 1))
            ticked = cont2discrete((a, b, c, d), e.period, method="foh")
            force = np.asarray(dlsim(ticked, force)[1], dtype=np.float64)[:, 0]
    return force


def _without(device: Device, *hooks: str) -> Device:
    gone = [p.effect.name for p in device.physics if p.effect.hook in hooks]
    return device.without_physics(*gone) if gone else device


def _forces(
    device: Device, seen: Experiment, position: Floats, velocity: Floats, band: float
) -> Floats:
    """Forces (ticks, n) that a device lacks to move as recorded."""
    n = position.shape[1]
    eq, fine = ready = prepared(seen.on(device))
    places = np.concatenate([np.arange(n), eq.dof + np.arange(n)])
    outputs = Outputs(
        places, np.zeros(2 * n, dtype=np.bool_), np.full(2 * n, GROUND), np.zeros(2 * n)
    )
    put = np.zeros((eq.states, 2 * n))
    put[places, np.arange(2 * n)] = 1.0
    first = replace(seen, outputs=tuple(Output("position", i) for i in range(n)))
    memory = observer_memory(ready.coarse, replace(first, measured=position))
    with np.errstate(all="ignore"):  # infinite after an overflow
        errors = alone(
            eq, fine, outputs, seen.command, np.hstack([position, velocity]), put,
            seen.external(eq.dof), memory, seen.strengths,
        )  # fmt: skip
        plant = seen.on(device).plant()
        push = np.zeros((plant.size, n))
        push[plant.dof : plant.dof + n] = np.linalg.inv(plant.matrices.mass)[:n, :n]
        held = hold_matrices(plant.a, push, seen.period)[1][plant.dof : plant.dof + n]
        force = np.zeros((seen.ticks, n))
        force[:-1] = np.linalg.solve(held, errors[1:, n:].T).T
        if not np.all(np.isfinite(force)):
            return np.full(force.shape, np.inf)
        return low_passed(force, band, seen.period)


def motion(e: Experiment, masses: int, to_hz: float) -> tuple[Floats, Floats]:
    """Return the recorded positions and velocities (ticks, masses), below a frequency."""
    t = e.period * np.arange(e.ticks)
    position, velocity = np.zeros((e.ticks, masses)), np.zeros((e.ticks, masses))
    for mass in range(masses):
        output = _of_mass(e, mass)
        assert output is not None
        smooth = low_passed(e.measured[:, e.outputs.index(output)], to_hz, e.period)
        spline = make_interp_spline(t, smooth, k=SPLINE)
        if output.quantity == "position":
            position[:, mass], velocity[:, mass] = smooth, spline.derivative()(t)
        else:
            position[:, mass], velocity[:, mass] = spline.antiderivative()(t), smooth
    return position, velocity


def low_passed(values: Floats, to_hz: float, period: float) -> Floats:
    """Return the part below a frequency, without a shift in time."""
    return sosfiltfilt(butter(ORDER, to_hz, fs=1.0 / period, output="sos"), values, axis=0)


def band_of(device: Device, e: Experiment) -> float | None:
    """Return the frequency [Hz] up to which a recording determines the force at m1, or None.

    It cannot be computed if the motion of a mass, or its sign, is missing, if no force is commanded
    (free motion, a goal, a prescribed motion), or if noise hides the force.
    """
    outputs = [_of_mass(e, mass) for mass in range(device.chain.masses.size)]
    drives = any(p.effect.of_drive for p in device.physics)
    unknown = e.folded or e.pushed is not None or drives
    if unknown or np.ptp(e.command) == 0.0 or any(o is None for o in outputs):
        return None
    joined, chain = e.joined(), device.chain
    size = float(np.sqrt(np.mean((device.interface.command_gain * joined.command) ** 2)))
    frequency = np.linspace(0.0, WIDEST / e.period, joined.ticks)[1:]
    turned = 2.0 * np.pi * frequency
    power = np.zeros(frequency.size)
    stiff = chain.link_springs[0] if chain.link_springs.size else 0.0
    for mass, output in enumerate(outputs[:2]):
        assert output is not None
        sigma = _noise(joined.measured[:, joined.outputs.index(output)])
        at_once = turned**2 if output.quantity == "position" else turned
        acts = chain.masses[0] * at_once if mass == 0 else 0.0
        held = stiff + (chain.ground_spring if mass == 0 else 0.0)
        held = held if output.quantity == "position" else held / turned
        power += 2.0 * sigma**2 * e.period * (acts**2 + held**2)
    noise = np.sqrt(np.cumsum(power) * frequency[0])
    told = int(np.searchsorted(noise, NOISE * size))
    if told == 0 or frequency[told - 1] * joined.ticks * e.period < FEWEST:
        return None
    return float(frequency[told - 1])


def _noise(y: Floats) -> float:
    """Rms of the white part of a reading, by fourth differences; at least encoder rounding."""
    rough = float(np.sqrt(np.mean(np.diff(y, 4) ** 2) / 70.0))
    return max(rough, (encoder_step_seen(y) or 0.0) / math.sqrt(12.0))


def _of_mass(e: Experiment, mass: int) -> Output | None:
    """The output that measures a mass, preferably its position."""
    every = (Output("position", mass), Output("velocity", mass))
    return next((o for o in every if o in e.outputs), None)
