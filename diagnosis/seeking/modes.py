"""Starts for a further mass on a spring, at the frequencies that the residual shows.

A mass m on a spring and damper pulls its host with F = -m H(s) a, where a is the host's
acceleration and

    H = (2 z w s + w^2) / (s^2 + 2 z w s + w^2),

which is linear in m for given w and z. So one convolution for each w and z gives the chi-square
that the best m > 0 gains; a fit from the wrong w finds nothing, since a resonance is narrow.
Limits: a is the acceleration of the device without the mass, so starts are only good if m is small
against the host.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.signal import bilinear, fftconvolve, lfilter

from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.forces.spatial import response
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.seeking.candidates import Start
from zwidth.diagnosis.seeking.screen import Complement
from zwidth.sim.device import has_room, place_label
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.extra_mode import extra_mode
from zwidth.sim.place import Place, label_of, place_at

Floats = NDArray[np.float64]
LOWEST_HZ = 3.0
HIGHEST = 0.4  # of the sampling rate: the highest frequency
FREQUENCIES = 32
DAMPINGS = (0.03, 0.12, 0.5)  # damping ratios that are tried
COUNT = 3  # starts for each host
HEAVIEST = 0.5  # largest mass, over the host's


@dataclass(frozen=True)
class Resonance:
    """A mass with its frequency [rad/s] and damping ratio, and the chi-square it would gain."""

    gained: float
    mass: float
    omega: float
    ratio: float


def mode_starts(problem: Problem, fitted: Fitted) -> list[Start]:
    """Return the most promising further masses at every host that may have one."""
    device = fitted.model.acting(fitted.x)
    built = fitted.model.build(fitted.x)
    if not has_room(extra_mode, built.chain.masses.size + len(built.hosts())):
        return []
    present = {place_label(p) for p in built.physics}
    masses = device.chain.masses
    off = Complement(fitted.jacobian)
    base = off(fitted.residual)
    starts: list[Start] = []
    states = predicted_states(problem, fitted)
    for place in map(place_at, extra_mode.places):
        host = place.index
        if host >= masses.size or label_of(extra_mode.name, place) in present:
            continue
        answer = response(problem, fitted, str(place))
        speeds = [x[:, masses.size + host] for x in states]
        found = sorted(
            _resonances(problem, off, base, answer, speeds), key=lambda r: r.gained, reverse=True
        )
        kept: list[Resonance] = []
        for one in found:
            if all(abs(math.log(one.omega / k.omega)) > 0.3 for k in kept):
                kept.append(one)
        starts += [_start(place, one, float(masses[host])) for one in kept[:COUNT]]
    return starts


def _resonances(
    problem: Problem, off: Complement, base: Floats, answer: Floats, speeds: list[Floats]
) -> Iterator[Resonance]:
    """Yield every frequency and damping at which a positive mass gains anything."""
    period = problem.experiments[0].period
    pulls = [-np.gradient(v) / period for v in speeds]
    for pull in pulls:
        pull[: SETTLING + 5] = 0.0
    # Both are causal filters, so their order is free, and this part is the same for all.
    seen = [fftconvolve(pull[:, None], answer, axes=0)[: pull.size] for pull in pulls]
    for hertz in np.geomspace(LOWEST_HZ, HIGHEST / period, FREQUENCIES):
        for ratio in DAMPINGS:
            omega = 2.0 * math.pi * float(hertz)
            b, a = _filter(omega, ratio, period)
            parts = [lfilter(b, a, one, axis=0)[SETTLING:].ravel() for one in seen]
            joined = np.concatenate(parts)
            signature = off(np.concatenate([joined, np.zeros(base.size - joined.size)]))
            size = float(signature @ signature)
            along = -float(base @ signature)
            if size > 0.0 and along > 0.0:
                yield Resonance(along**2 / size, along / size, omega, ratio)


@cache
def _filter(omega: float, ratio: float, period: float) -> tuple[Floats, Floats]:
    """H as a filter of samples: bilinear, exact at omega."""
    warped = 2.0 / period * math.tan(0.5 * omega * period)
    top = [2.0 * ratio * warped, warped**2]
    return bilinear(top, [1.0, *top], 1.0 / period)


def _start(place: Place, one: Resonance, host: float) -> Start:
    mass = min(one.mass, HEAVIEST * host)
    stiffness, damping = mass * one.omega**2, 2.0 * one.ratio * one.omega * mass
    values = {"mass": mass, "stiffness": stiffness, "damping": damping}
    return Start(
        Physics(extra_mode, str(place), values),
        {"mass": 0.5 * mass, "stiffness": 0.5 * stiffness, "damping": damping},
    )
