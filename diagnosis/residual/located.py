"""Where simulation and recording part: in time, frequency, state, and at which entry point.

Shares are of the residual's excess energy, the part that the noise model does not expect: energy
above one per whitened sample, so that a clean recording has nothing to locate.

The entry point: a force that is a step function of one state (`residual.left`) is let in at each
mass and link. The strengths that explain most are the map of the missing force over that state.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.residual.left import chance, solved_bank
from zwidth.diagnosis.residual.remainder import Remainder
from zwidth.diagnosis.settings import EVIDENCE, RESIDUAL

Floats = NDArray[np.float64]
Share = dict[str, Any]  # {"from", "to" or "name", "share"}
BANDS = (0.5, 2.0, 5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0)


@dataclass(frozen=True)
class ForceMap:
    """The missing force at a place against one state: bin edges, force in each bin, its error.

    among: how many maps it is one of.
    """

    place: str
    against: str
    edges: Floats
    force: Floats
    error: Floats
    gained: float
    among: int = 1


@dataclass(frozen=True)
class Located:
    """Shares of the excess residual energy, a list each of {"from", "to" or "name", "share"}."""

    sentence: str
    time: list[Share]
    frequency_hz: list[Share]
    state: list[Share]
    entry: list[Share]
    maps: tuple[ForceMap, ...]


NOWHERE = Located("where simulation and recording part could not be said", [], [], [], [], ())


def locate(problem: Problem, fitted: Fitted) -> Located:
    """Locate what a fitted model leaves unexplained."""
    rest = Remainder(problem, fitted)
    white = fitted.white.reshape(-1, problem.experiments[0].measured.shape[1])
    state = _state(rest, white)
    steps = [(s, g) for s, g in solved_bank(rest) if s.edges.size]
    maps = tuple(
        ForceMap(str(s.place), s.follows, s.edges, g.strength, g.error, g.gained, len(steps))
        for s, g in steps
    )
    time, frequency = _time(white, rest.period), _frequency(white, rest.period)
    return Located(_sentence(state, maps), time, frequency, state, _entry(maps), maps)


def _shares(values: Floats) -> Floats:
    positive = np.maximum(values, 0.0)
    total = float(positive.sum())
    return positive / total if total > 0.0 else np.full(values.size, 1.0 / values.size)


def _over(edges: Sequence[float] | Floats, sums: Sequence[float]) -> list[Share]:
    return [
        {"from": float(a), "to": float(b), "share": float(s)}
        for (a, b), s in zip(pairwise(edges), _shares(np.array(sums)), strict=True)
    ]


def _time(white: Floats, period: float, slices: int = 20) -> list[Share]:
    pieces = np.array_split((white**2).mean(axis=1) - 1.0, slices)
    edges = SETTLING * period + np.cumsum([0, *(p.size for p in pieces)]) * period
    return _over(edges, [float(p.sum()) for p in pieces])


def _frequency(white: Floats, period: float) -> list[Share]:
    f, power = welch(white, 1.0 / period, nperseg=min(2048, white.shape[0]), axis=0)
    excess = power.mean(axis=1) - 2.0 * period
    edges = [*(b for b in BANDS if b < 0.5 / period), 0.5 / period]
    return _over(edges, [float(excess[(f >= a) & (f < b)].sum()) for a, b in pairwise(edges)])


def _state(rest: Remainder, white: Floats, reversal_s: float = 0.012) -> list[Share]:
    """Excess energy near reversals of velocity, at high speed, at large command, elsewhere."""
    energy = (white**2).mean(axis=1) - 1.0
    near, fast, strong = [], [], []
    for e, (_, v) in zip(rest.problem.experiments, rest.motions, strict=True):
        turn = np.zeros(e.ticks)
        turn[1:] = np.diff(np.sign(v)) != 0
        width = max(1, round(reversal_s / e.period))
        near.append((np.convolve(turn, np.ones(2 * width + 1), "same") > 0)[SETTLING:])
        fast.append((np.abs(v) > np.quantile(np.abs(v), 0.8))[SETTLING:])
        u = np.abs(e.command)
        strong.append((u > np.quantile(u, 0.8))[SETTLING:])
    reversal, quick, large = (np.concatenate(x) for x in (near, fast, strong))
    groups = {
        f"within {1e3 * reversal_s:.0f} ms of a velocity reversal": reversal,
        "fastest fifth": quick & ~reversal,
        "largest fifth of the command": large & ~quick & ~reversal,
    }
    groups["elsewhere"] = ~np.any(list(groups.values()), axis=0)
    shares = _shares(np.array([energy[g].sum() for g in groups.values()]))
    return [
        {"name": name, "share": float(s), "time_share": float(np.mean(g))}
        for (name, g), s in zip(groups.items(), shares, strict=True)
    ]


def _entry(maps: Sequence[ForceMap]) -> list[Share]:
    """Share of the explicable chi-square by place: the best map of each place."""
    places = list(dict.fromkeys(m.place for m in maps))
    best = [max(m.gained - m.force.size for m in maps if m.place == p) for p in places]
    return [
        {"name": p, "share": float(s)} for p, s in zip(places, _shares(np.array(best)), strict=True)
    ]


def _sentence(state: Sequence[Share], maps: Sequence[ForceMap]) -> str:
    top = max(maps, key=lambda m: m.gained)
    if not stands_out(top):
        return "no force of any shape at any place would explain more than noise does"
    force = f"a force at {top.place} that follows {top.against}{sign_of(top)}"
    return f"{densest(state)}{force} explains most of it"


def stands_out(top: ForceMap) -> bool:
    """Whether a map shows a force at all."""
    return top.gained >= chance(top.force.size, top.among, EVIDENCE.alpha)


def densest(state: Sequence[Share]) -> str:
    """Say where in the motion the excess lies, "" where that is everywhere."""
    told = [
        s for s in state
        if s["name"] != "elsewhere"
        and s["share"] >= max(RESIDUAL.telling, RESIDUAL.denser * s["time_share"])
    ]  # fmt: skip
    if not told:
        return ""
    most = max(told, key=lambda s: float(s["share"]) / max(float(s["time_share"]), 1e-3))
    name, share, time = str(most["name"]), float(most["share"]), float(most["time_share"])
    name = name if name.startswith("within") else f"in the {name}"
    return (
        f"{100.0 * share:.0f} % of what the refitted device cannot predict lies {name}, in"
        f" {100.0 * time:.0f} % of the time; "
    )


def sign_of(top: ForceMap) -> str:
    """Say the sign of a force that follows velocity."""
    middle = 0.5 * (top.edges[1:] + top.edges[:-1])
    if top.against != "velocity" or top.force.size < 4:
        return ""
    low, high = top.force[middle < 0.0], top.force[middle > 0.0]
    if low.size and high.size and low.mean() > 0.0 > high.mean():
        return ", against the motion,"
    return ""
