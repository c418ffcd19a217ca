"""What a fit leaves of recordings, and how a force anywhere would change it, to first order.

Innovations of a linear device are linear in all that enters it. So a force f_k at a place moves
the weighted innovations r by F f, F the convolution with the `response` to a unit at one tick, and
what a force would explain is linear algebra: no force is simulated. What the fit itself would
absorb, the span of its Jacobian, is taken off first (`Complement`).

Limits: the response is that of the device without its nonlinear physics.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.signal import fftconvolve

from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.noise.predictor import (
    SETTLING,
    Observer,
    followed,
    innovations,
    prepared,
    whitened,
)
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device
from zwidth.sim.place import Place, place_at

Floats = NDArray[np.float64]


class Complement:
    """Projection off the span of a Jacobian."""

    def __init__(self, jacobian: Floats, least: float = 1e-10) -> None:
        """Take directions above `least` of the largest for known, less for rounding."""
        left, singular, right = np.linalg.svd(jacobian, full_matrices=False)
        kept = singular > least * singular[0]
        self.basis = left[:, kept]
        self.inverse = right[kept].T / singular[kept]

    def __call__(self, vector: Floats) -> Floats:
        """Return the part of vectors (samples,) or (samples, k) that the fit cannot absorb."""
        return vector - self.basis @ (self.basis.T @ vector)

    def absorbing(self, vector: Floats) -> Floats:
        """Return the change of x (p,) by which the fit absorbs its part of a vector."""
        return -self.inverse @ (self.basis.T @ vector)


def predicted_states(problem: Problem, fitted: Fitted) -> list[Floats]:
    """Return positions and velocities (ticks, 2n) of all masses as the observer predicts them."""
    device, gain = fitted.model.acting(fitted.x), problem.observer.gain
    return [followed(device, fitted.model.seen(e, fitted.x), gain) for e in problem.experiments]


def predicted(problem: Problem, fitted: Fitted) -> list[Floats]:
    """Return the first output (ticks,) as the observer predicts it, of every recording."""
    device = fitted.model.acting(fitted.x)
    seen = [fitted.model.seen(e, fitted.x) for e in problem.experiments]
    errors = [innovations(device, e, problem.observer.gain) for e in seen]
    return [e.measured[:, 0] - error[:, 0] for e, error in zip(seen, errors, strict=True)]


def response(
    problem: Problem,
    fitted: Fitted,
    place: str,
    output: int = 0,
    longest: int = 2000,
    lead: int = 20,
) -> Floats:
    """Return the weighted innovations (ticks, o) after a unit at a place, `longest` ticks of them.

    In a link it pushes the first mass, and the second the other way; in "sensor" it is in the
    reading of an output. The response is that of the device without its nonlinear physics.
    lead: ticks before the unit enters, since an observer begins with the first samples.
    """
    device, observer = fitted.model.acting(fitted.x), problem.observer
    length = min(longest, problem.experiments[0].ticks - lead)
    answer = unit_answer(device, problem.experiments[0], observer.gain, place, length, output, lead)
    return observer.weigh(answer)[lead:]


def unit_answer(
    device: Device,
    experiment: Experiment,
    gain: Floats,
    place: str,
    length: int,
    output: int = 0,
    lead: int = 0,
) -> Floats:
    """Return innovations (lead + length, o) under a gain of a unit at a place, as `response`."""
    device = experiment.on(device.bare())
    command, measured = np.zeros(lead + length), np.zeros((lead + length, gain.shape[1]))
    ready = prepared(device)
    force = np.zeros((lead + length, ready.coarse.dof))
    if place == "command":
        command[lead] = 1.0
    elif place == "sensor":
        measured[lead, output] = 1.0
    else:
        force[lead] = place_at(place).row(ready.coarse.dof)
    still = replace(
        experiment.unmoved(), command=command, measured=measured, sensor_error=None, dropped=None,
        start=None, force=None, before=None,
    )  # fmt: skip
    return innovations(device, still, gain, force, ready)


def matched(problem: Problem, fitted: Fitted, place: str) -> list[Floats]:
    """Return g = F' r (ticks,) of every experiment for what enters at a place, as in `response`.

    <r, F f> = <g, f>: how much the residual is like the answer to a unit at each tick.
    """
    return correlated(problem, fitted.white, response(problem, fitted, place))


def correlated(problem: Problem, white: Floats, answer: Floats) -> list[Floats]:
    """Return `matched` for other weighted innovations (samples,) and a response (ticks, o)."""
    found: list[Floats] = []
    first = 0
    for e in problem.experiments:
        last = first + (e.ticks - SETTLING) * len(e.outputs)
        rows = np.zeros((e.ticks, len(e.outputs)))
        rows[SETTLING:] = white[first:last].reshape(-1, len(e.outputs))
        first = last
        both = fftconvolve(rows[::-1], answer, axes=0)[: e.ticks][::-1]
        found.append(both.sum(axis=1))
    return found


@dataclass(frozen=True)
class Solved:
    """Strengths (k,) of some forces that explain most, their errors, and the chi-square gained."""

    strength: Floats
    error: Floats
    gained: float


class Remainder:
    """What a fit leaves, with what is predicted and what a force does: each computed once.

    left: residual (samples and priors,) off the span of the fit.
    """

    def __init__(self, problem: Problem, fitted: Fitted) -> None:
        self.problem, self.fitted = problem, fitted
        self.period = problem.experiments[0].period
        self.device = fitted.model.acting(fitted.x)
        self.masses = int(self.device.chain.masses.size)
        self.off = Complement(fitted.jacobian)
        self.left = self.off(fitted.residual)

    @cached_property
    def states(self) -> list[Floats]:
        """Positions and velocities (ticks, 2n) of every recording, as `predicted_states`."""
        return predicted_states(self.problem, self.fitted)

    @cached_property
    def units(self) -> Floats:
        """Responses (n, ticks, o) to a unit force at each mass."""
        places = [str(Place("mass", i)) for i in range(self.masses)]
        return np.array([response(self.problem, self.fitted, at) for at in places])

    def answer(self, place: Place) -> Floats:
        """Return the response (ticks, o) to a unit force at a mass or in a link."""
        return np.tensordot(place.row(self.masses), self.units, 1)

    @cached_property
    def motions(self) -> list[tuple[Floats, Floats]]:
        """Position and velocity (ticks,) of the first output's mass, of every recording.

        Velocity over the last five samples of what is predicted: one that is taken from the
        samples themselves holds their noise, and the residual would follow it by itself.
        """
        first = self.problem.experiments[0].outputs[0]
        found: list[tuple[Floats, Floats]] = []
        for x in self.states:
            speed = x[:, self.masses + first.mass]
            smooth = np.convolve(np.pad(speed, (4, 0), mode="edge"), np.full(5, 0.2), "valid")
            if first.quantity == "position":
                found.append((x[:, first.mass], smooth))
            else:  # whose mean is known to its error only, which would be a motion without end
                found.append((np.cumsum(speed - speed.mean()) * self.period, smooth))
        return found

    def signatures(self, place: Place, columns: list[Floats]) -> Floats:
        """Return what forces (ticks, k) of each recording add to the residual (samples, k)."""
        answer = self.answer(place)[:, :, None]
        parts: list[Floats] = []
        for f in columns:
            size = next_fast_len(f.shape[0] + answer.shape[0] - 1, real=True)
            spectrum = np.fft.rfft(f, size, axis=0)[:, None] * np.fft.rfft(answer, size, axis=0)
            moved = np.fft.irfft(spectrum, size, axis=0)[SETTLING : f.shape[0]]
            parts.append(moved.reshape(-1, f.shape[1]))
        found = np.zeros((self.left.size, columns[0].shape[1]))
        found[: self.fitted.samples] = np.concatenate(parts)
        return found

    def solved(self, place: Place, columns: list[Floats], level: bool = True) -> Solved:
        """Return the strengths of forces (ticks, k) that explain most off the span of the fit.

        level: whether a constant in all of them is a force as well. Nothing is explained where the
        device answers a force by an overflow.
        """
        matrix = self.off(self.signatures(place, columns))
        count = matrix.shape[1]
        if not np.isfinite(matrix).all():
            return Solved(np.zeros(count), np.full(count, np.inf), 0.0)
        size = np.linalg.norm(matrix, axis=0)
        size[size == 0.0] = 1.0
        told, ways = np.linalg.eigh(matrix.T @ matrix / np.outer(size, size))
        kept = told > 1e-10 * told[-1]  # of rounding
        ways, told = ways[:, kept] / size[:, None], told[kept]
        along = matrix.T @ self.left
        strength = -ways @ (ways.T @ along / told)
        if not level:
            strength -= strength.mean()
        gained = -float(2.0 * strength @ along + np.sum((matrix @ strength) ** 2))
        return Solved(strength, np.sqrt(np.sum(ways**2 / told, axis=1)), gained)

    def coarsely(self, lags: float = 8.0) -> "Remainder":
        """Return the same, whitened by filters of so many lags, which no single line is seen by.

        A fine filter takes a strong line for noise: 8 lags see 20 Hz at 1 kHz.
        """
        observer = self.problem.observer
        if observer.whitening is None:
            return self
        fine, first = observer.filters(), self.problem.experiments[0]
        plain = replace(observer, whitening=None, deviation=np.ones(len(first.outputs)))
        samples, residual = self.fitted.samples, self.fitted.residual.copy()
        raw = _refiltered(self.problem, residual[:samples, None], fine, plain)
        padded = [np.vstack([np.zeros((SETTLING, r.shape[1])), r[:, :, 0]]) for r in raw]
        coarse = whitened(observer, padded, lags)
        slopes = self.fitted.jacobian.copy()
        for rows in (residual[:, None], slopes):
            found = _refiltered(self.problem, rows[:samples], fine, coarse)
            rows[:samples] = np.concatenate([f.reshape(-1, rows.shape[1]) for f in found])
        chi2 = float(residual @ residual)
        fitted = replace(self.fitted, residual=residual, jacobian=slopes, chi2=chi2)
        again = Remainder(Problem(self.problem.experiments, coarse), fitted)
        again.states = self.states
        return again


def _refiltered(problem: Problem, rows: Floats, fine: Floats, to: Observer) -> list[Floats]:
    """Return columns (samples, k) that `fine` filters (o, o, taps) made as `to` weighs them.

    Of every recording (ticks, o, k): divided and multiplied by spectra. Innovations before the
    first that is kept count for nothing, which is forgotten within the memory of the filters.
    """
    outputs, found, first = fine.shape[0], list[Floats](), 0
    for e in problem.experiments:
        ticks = e.ticks - SETTLING
        mine = rows[first : first + ticks * outputs].reshape(ticks, outputs, -1)
        first += ticks * outputs
        size = next_fast_len(ticks + 1000, real=True)  # filters have forgotten by then
        before, after = (
            np.moveaxis(np.fft.rfft(w, size, axis=2), 2, 0) for w in (fine, to.filters())
        )
        spectrum = after @ np.linalg.solve(before, np.fft.rfft(mine, size, axis=0))
        found.append(np.fft.irfft(spectrum, size, axis=0)[:ticks])
    return found
