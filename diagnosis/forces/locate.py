"""Locates the difference of simulation and recording: in time, frequency, state and place.

Shares refer to the residual's excess energy: energy above one per whitened sample, which the noise
model does not expect. So a recording with nothing missing has nothing to locate.

A force of unknown shape is added at a place (each mass and link), with a constant in each of `BINS`
bins of position, velocity, command or time. Each such force has a signature in the innovations. A
regression of the residual on the signatures, orthogonal to the refit, gives the map of the missing
force and the chi-square that any force there could gain.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve, welch

from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.forces.spatial import response
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.lattice import predicted
from zwidth.diagnosis.seeking.screen import Complement
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.shown import Valued
from zwidth.sim.place import MASSES, Place, masses_and_links

Floats = NDArray[np.float64]
Share = dict[str, Any]  # {"from", "to" or "name", "share"}
BINS = 8
TELLING = 0.25  # share of the excess from which it is reported
DENSER = 1.5  # share of the excess over share of the time, from which it is reported
SLICES = 20
BANDS = (0.5, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0)
NEAR_REVERSAL_S = 0.012
STATES = ("position", "velocity", "command", "time")


@dataclass(frozen=True)
class ForceMap(Valued):
    """The missing force at a place over one state: bin edges, force in each bin, its error."""

    place: str
    against: str
    edges: Floats
    force: Floats
    error: Floats
    gained: float


@dataclass(frozen=True)
class Located(Valued):
    """Shares of the excess residual energy, each a list of {"from", "to" or "name", "share"}."""

    sentence: str
    time: list[Share]
    frequency_hz: list[Share]
    state: list[Share]
    entry: list[Share]
    maps: tuple[ForceMap, ...]


NOWHERE = Located(
    "where simulation and recording differ could not be determined", [], [], [], [], ()
)


def locate(problem: Problem, fitted: Fitted) -> Located:
    """Locate the unexplained part of a fitted model's residual."""
    first = problem.experiments[0]
    white = fitted.white.reshape(-1, first.measured.shape[1])
    time = _time(white, first.period)
    frequency = _frequency(white, first.period)
    moved = motions(problem, fitted)
    state = _state(problem, white, moved)
    maps = force_maps(problem, fitted, moved)
    entry = _entry(maps)
    return Located(_sentence(state, maps), time, frequency, state, entry, maps)


def _shares(values: Floats) -> Floats:
    positive = np.maximum(values, 0.0)
    total = float(positive.sum())
    return positive / total if total > 0.0 else np.full(values.size, 1.0 / values.size)


def _time(white: Floats, period: float) -> list[Share]:
    pieces = np.array_split((white**2).mean(axis=1) - 1.0, SLICES)
    shares = _shares(np.array([p.sum() for p in pieces]))
    edges = SETTLING * period + np.cumsum([0, *(p.size for p in pieces)]) * period
    return [
        {"from": float(a), "to": float(b), "share": float(s)}
        for (a, b), s in zip(pairwise(edges), shares, strict=True)
    ]


def _frequency(white: Floats, period: float) -> list[Share]:
    f, power = welch(white, 1.0 / period, nperseg=min(2048, white.shape[0]), axis=0)
    excess = power.mean(axis=1) - 2.0 * period
    edges = [*(b for b in BANDS if b < 0.5 / period), 0.5 / period]
    sums = [float(excess[(f >= a) & (f < b)].sum()) for a, b in pairwise(edges)]
    shares = _shares(np.array(sums))
    return [
        {"from": float(a), "to": float(b), "share": float(s)}
        for (a, b), s in zip(pairwise(edges), shares, strict=True)
    ]


def motions(problem: Problem, fitted: Fitted) -> list[tuple[Floats, Floats]]:
    """Return the predicted position and velocity of the first output's mass in every recording.

    They are the observer's predictions before each sample, the velocity over the last five of them.
    A motion computed from the samples would contain their noise, as the residual does.
    """
    found: list[tuple[Floats, Floats]] = []
    last = np.full(5, 0.2)
    for e, y in zip(problem.experiments, predicted(problem, fitted), strict=True):
        smooth = np.convolve(np.pad(y, (4, 0), mode="edge"), last, "valid")
        if e.outputs[0].quantity == "position":
            found.append((y, np.diff(smooth, prepend=smooth[0]) / e.period))
        else:
            found.append((np.cumsum(y - y.mean()) * e.period, smooth))
    return found


def _state(problem: Problem, white: Floats, moved: Sequence[tuple[Floats, Floats]]) -> list[Share]:
    """Excess energy near reversals of velocity, at high speed, at large command, elsewhere."""
    energy = (white**2).mean(axis=1) - 1.0
    near, fast, strong = [], [], []
    for e, (_, v) in zip(problem.experiments, moved, strict=True):
        turn = np.zeros(e.ticks)
        turn[1:] = np.diff(np.sign(v)) != 0
        width = max(1, round(NEAR_REVERSAL_S / e.period))
        near.append((np.convolve(turn, np.ones(2 * width + 1), "same") > 0)[SETTLING:])
        fast.append((np.abs(v) > np.quantile(np.abs(v), 0.8))[SETTLING:])
        u = np.abs(e.command)
        strong.append((u > np.quantile(u, 0.8))[SETTLING:])
    reversal, quick, large = (np.concatenate(x) for x in (near, fast, strong))
    groups = {
        f"within {1e3 * NEAR_REVERSAL_S:.0f} ms of a velocity reversal": reversal,
        "where the motion is fastest": quick & ~reversal,
        "where the command is largest": large & ~quick & ~reversal,
    }
    rest = ~np.any(list(groups.values()), axis=0)
    groups["elsewhere"] = rest
    shares = _shares(np.array([energy[g].sum() for g in groups.values()]))
    return [
        {"name": name, "share": float(s), "time_share": float(np.mean(g))}
        for (name, g), s in zip(groups.items(), shares, strict=True)
    ]


def force_maps(
    problem: Problem, fitted: Fitted, moved: Sequence[tuple[Floats, Floats]]
) -> tuple[ForceMap, ...]:
    """Return the missing force at every place over every state."""
    device = fitted.model.acting(fitted.x)
    off = Complement(fitted.jacobian)
    left = off(fitted.residual)
    prior = fitted.residual[fitted.samples :] * 0.0
    n = device.chain.masses.size
    units = np.array([response(problem, fitted, at) for at in MASSES[:n]])

    def signature(place: Place, masks: Sequence[NDArray[np.bool_]]) -> Floats:
        """The signature of a unit force where a mask is true, in the linear device."""
        answer = np.tensordot(place.row(n), units, 1)
        parts = [
            fftconvolve(mask[:, None].astype(float), answer, axes=0)[SETTLING : mask.size].ravel()
            for mask in masks
        ]
        return off(np.concatenate([*parts, prior]))

    found: list[ForceMap] = []
    for place in masses_and_links(n):
        for against in STATES:
            pairs = zip(problem.experiments, moved, strict=True)
            values = [state_of(e, motion, against) for e, motion in pairs]
            edges = np.quantile(np.concatenate(values), np.linspace(0.0, 1.0, BINS + 1))
            edges = np.unique(edges)
            if edges.size < 2:  # a state that never changes (no command)
                continue
            edges[-1] += 1e-12 + 1e-9 * abs(edges[-1])
            bins = [[(v >= a) & (v < b) for v in values] for a, b in pairwise(edges)]
            columns = in_parallel([lambda m=m, p=place: signature(p, m) for m in bins], threads())
            matrix = np.column_stack(columns)
            solved, *_ = np.linalg.lstsq(matrix, -left, rcond=1e-8)
            gained = float(left @ left - np.sum((left + matrix @ solved) ** 2))
            error = np.sqrt(np.diag(np.linalg.pinv(matrix.T @ matrix, rcond=1e-10)))
            force = np.asarray(solved, dtype=np.float64)
            found.append(ForceMap(str(place), against, edges, force, error, gained))
    return tuple(found)


def state_of(e: Experiment, motion: tuple[Floats, Floats], state: str) -> Floats:
    """Return the values (ticks,) of a state of `STATES`."""
    if state == "time":
        return np.asarray(e.period * np.arange(e.ticks), dtype=np.float64)
    return {"position": motion[0], "velocity": motion[1], "command": e.command}[state]


def _entry(maps: Sequence[ForceMap]) -> list[Share]:
    """Share of the explainable chi-square by place: the best map of each place."""
    places = list(dict.fromkeys(m.place for m in maps))
    best = np.array([max(m.gained for m in maps if m.place == p) for p in places])
    shares = _shares(best - BINS)
    return [{"name": p, "share": float(s)} for p, s in zip(places, shares, strict=True)]


def _sentence(state: Sequence[Share], maps: Sequence[ForceMap]) -> str:
    top = max(maps, key=lambda m: m.gained)
    if not stands_out(top):
        return "no force at any place would explain more than noise"
    force = f"a force at {top.place} that depends on {top.against}{sign_of(top)}"
    return f"{densest(state)}{force} best describes what is missing"


def stands_out(top: ForceMap) -> bool:
    """Whether the force of a map exceeds noise."""
    return top.gained >= 4.0 * BINS


def densest(state: Sequence[Share]) -> str:
    """Say in which part of the motion the excess is, "" if it is everywhere."""
    told = [
        s for s in state
        if s["name"] != "elsewhere" and s["share"] >= max(TELLING, DENSER * s["time_share"])
    ]  # fmt: skip
    if not told:
        return ""
    most = max(told, key=lambda s: float(s["share"]) / max(float(s["time_share"]), 1e-3))
    name, share, time = str(most["name"]), float(most["share"]), float(most["time_share"])
    return (
        f"{100.0 * share:.0f} % of the prediction error of the refitted device lies {name}"
        f" ({100.0 * time:.0f} % of the time); "
    )


def sign_of(top: ForceMap) -> str:
    """Say whether a force over velocity is against the motion, else ""."""
    middle = 0.5 * (top.edges[1:] + top.edges[:-1])
    if top.against != "velocity" or top.force.size < 4:
        return ""
    low, high = top.force[middle < 0.0], top.force[middle > 0.0]
    if low.size and high.size and low.mean() > 0.0 > high.mean():
        return " and acts against the motion"
    return ""
