"""Tests whether errors of free runs are coherent with the motion, as missing physics is.

The errors of a linear device's free run are its filtered innovations. So noise of the right
spectrum causes errors as large as missing physics does, and their size does not distinguish the
two. But noise is independent of the motion. The errors are therefore compared with the effect of
missing forces, each a function of the motion that the free run itself predicts, which later noise
does not influence,

    e = sum_j a_j (g * phi_j(s, s')) + noise,

where s is the position of m1 or the deflection of a link, and g the linear device's response to a
force there from rest. The result is the share of the square of e that all phi_j explain together. A
constant force, which slow noise resembles, is removed first. A share does not depend on size, so
the strength that the noise model assumes does not matter.

Limits: few forms of force are tried, along the motion of a model that lacks them. Friction is
detected; play in a link is not, since the link rattles at times that no free run predicts. If few
runs of a horizon are held out, noise seems to depend on any motion, and the test is not made.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from zwidth.diagnosis.noise.predictor import prepared
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device
from zwidth.sim.place import masses_and_links
from zwidth.sim.predict import alone
from zwidth.sim.run import Start, start_memory

Floats = NDArray[np.float64]
FORMS: tuple[Callable[[Floats, Floats], Floats], ...] = (
    lambda s, _: s,
    lambda s, _: s**3,
    lambda s, _: np.sign(s),
    lambda _, v: np.sign(v),
    lambda _, v: v * np.abs(v),
)
LEAST = 1e-6  # of the largest direction, below which forces are linearly dependent


@dataclass(frozen=True)
class Span:
    """Orthonormal errors (samples, k) caused by a constant force, and by the other forces."""

    constant: Floats
    forces: Floats

    def share(self, errors: Floats) -> float:
        """Return the share of the square of errors (samples,) that forces explain."""
        left = errors - self.constant @ (self.constant.T @ errors)
        explained = self.forces.T @ left
        return float(explained @ explained) / float(left @ left)


def span(device: Device, experiment: Experiment, motion: Floats) -> Span:
    """Return errors of the first output by forces along a motion (runs, length, 2n).

    Forces act at m1 and in the links. A motion that has overflowed explains nothing.
    """
    n, length = device.chain.masses.size, motion.shape[1]
    motion = np.where(np.isfinite(motion).all(axis=(1, 2), keepdims=True), motion, 0.0)
    linear = device.bare()
    constant = np.zeros((motion.shape[0] * length, 0))
    columns: list[Floats] = []
    for place in (p for p in masses_and_links(n) if p.kind == "link" or p.index == 0):
        row = place.row(n)
        answer = _response(linear, experiment, row, length)
        if not columns:
            ones = np.ones((motion.shape[0], length))
            constant = _directions(_filtered(ones, answer).reshape(-1, 1))
        way, speed = motion[:, :, :n] @ row, motion[:, :, n:] @ row
        columns += [_filtered(form(way, speed), answer).ravel() for form in FORMS]
    forces = np.column_stack(columns)
    return Span(constant, _directions(forces - constant @ (constant.T @ forces)))


def _filtered(forces: Floats, answer: Floats) -> Floats:
    """Forces (runs, length) through a response (length,), each run from rest."""
    length = forces.shape[1]
    size = next_fast_len(2 * length, real=True)
    spectrum = np.fft.rfft(forces, size, axis=1) * np.fft.rfft(answer, size)
    return np.fft.irfft(spectrum, size, axis=1)[:, :length]


def _directions(columns: Floats) -> Floats:
    """Return orthonormal directions of columns, without linearly dependent ones."""
    size = np.linalg.norm(columns, axis=0)
    left, values, _ = np.linalg.svd(columns[:, size > 0.0] / size[size > 0.0], full_matrices=False)
    return left[:, values > LEAST * values.max(initial=0.0)]


def _response(linear: Device, experiment: Experiment, row: Floats, length: int) -> Floats:
    """Return the first output (length,) after a force of one tick along a row (n,), from rest."""
    eq, fine = prepared(experiment.on(linear))
    places = experiment.places(eq)
    external = np.zeros((length, eq.dof))
    external[0, : row.size] = row
    still = np.zeros((length, places.state.size))
    blind = np.zeros((eq.states, places.state.size))
    places = places._replace(sensed=np.zeros_like(places.sensed))
    memory = start_memory(eq, Start())
    return -alone(eq, fine, places, np.zeros(length), still, blind, external, memory)[:, 0]
