"""Whether a parameter is the same in a whole fleet, or differs from device to device or run to run.

Recording i of device d gives y_i for a parameter, with standard error s_i. The model is a random
effects model (DerSimonian & Laird, Control. Clin. Trials 7, 1986) with two levels and known
columns,

    y_i = b_0 + sum_k b_k x_ik + u_d + w_i + e_i,
    u_d ~ N(0, tau_d^2),   w_i ~ N(0, tau_r^2),   e_i ~ N(0, s_i^2).

"Shared" is tau_d = tau_r = 0. For given taus, y is normal with covariance V, and b is integrated
out in closed form (Gelman et al., Bayesian Data Analysis, 3rd ed., 5.4 and 14.8):

    cost = r' V^-1 r + ln det V + ln det X' V^-1 X + 2 sum_k ln range_k - k ln 2 pi,

r are the residuals of generalized least squares, range_k = 2 ptp(y) / ptp(x_k) for a slope. The
terms of b_0 and n ln 2 pi are in all hypotheses and left out. A tau above zero is uniform in its
logarithm between `LEAST_TAU` of the median standard error and the whole range of y, summed on a
grid. A hypothesis is preferred to a simpler one if it costs less by more than 2 ln (1 / ALPHA) for
each level or column that it adds, the threshold of `zwidth.diagnosis.selection.evidence`.

Columns that the recordings cannot distinguish (one is a multiple of another, or there are fewer
informative recordings than columns) are not used together.

Limits: the ranges come from the data. A device must have been recorded at least twice to
distinguish its own value from the run's: without repeats, differences count as per run. The normal
distributions do not allow for outliers, which must be removed first.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from zwidth.diagnosis.selection.evidence import ALPHA
from zwidth.shown import Valued, fields_html

Floats = NDArray[np.float64]
LEAST_TAU = 0.1  # of the median standard error; a smaller spread changes no interval
GRID = 24  # values of a tau, uniform in its logarithm
STEP_COST = 2.0 * math.log(1.0 / ALPHA)
NEGLIGIBLE = 1e-6  # share of a pair of taus below which it is left out of means


class Slope(NamedTuple):
    """The change of a parameter per unit of a known column, with its standard error."""

    value: float
    error: float

    _repr_html_ = fields_html


@dataclass(frozen=True)
class Spread(Valued):
    """How one parameter varies over a fleet, in the unit of the estimates.

    per_device, per_run: whether it differs between devices, between runs. tau_device, tau_run:
    standard deviations of these differences as posterior root mean squares, 0 without any. center:
    the value with each column at its mean. slopes: by the columns that it depends on. pooled (n,),
    pooled_errors (n,): each recording's own value, estimated with the help of the others, and its
    error. gains: of each level and column, in -2 ln evidence: how much more the answer would cost
    without it or, for one that it does not have, how much less with it.
    """

    per_device: bool
    per_run: bool
    center: Slope
    tau_device: float
    tau_run: float
    slopes: Mapping[str, Slope]
    pooled: Floats
    pooled_errors: Floats
    gains: Mapping[str, float]

    @property
    def shared(self) -> bool:
        """Whether all recordings have one value, apart from the slopes."""
        return not (self.per_device or self.per_run)


def spread(
    values: Floats,
    errors: Floats,
    devices: Sequence[str],
    columns: Mapping[str, Floats] | None = None,
) -> Spread:
    """Decide by cost how a parameter varies, and pool its estimates accordingly.

    values (n,), errors (n,): estimates and their standard errors, n at least 2; devices (n,): the
    device of each; columns: name to known values (n,). An estimate with an infinite error is
    ignored, and its recording gets a value from the others. Constant columns are left out. Raises
    ValueError for lengths that differ, values that are not finite, errors that are not above 0, and
    fewer than two finite errors.
    """
    data = _read(values, errors, devices, columns or {})
    sought: dict[_Kind, _Weighed] = {}

    def weighed(kind: _Kind) -> _Weighed:
        if kind not in sought:
            sought[kind] = _weigh(data, kind)
        return sought[kind]

    def penalized(kind: _Kind) -> float:
        return weighed(kind).cost + STEP_COST * len(kind)

    # Every step lowers the penalised cost, so no state repeats. Double steps let a column replace a
    # spread that was found in its place.
    kind: _Kind = frozenset()
    while True:
        single = [frozenset({term}) for term in data.terms]
        double = [a | b for i, a in enumerate(single) for b in single[:i]]
        best = min((kind ^ step for step in single + double), key=penalized, default=kind)
        if penalized(best) >= penalized(kind):
            break
        kind = best
    found = weighed(kind)
    gains = {
        term: (weighed(kind ^ {term}).cost - found.cost) * (1.0 if term in kind else -1.0)
        for term in data.terms
        if math.isfinite(weighed(kind ^ {term}).cost)
    }
    return _answer(data, kind, found, gains)


DEVICE, RUN = "per device", "per run"
_Kind = frozenset[str]


class _Data(NamedTuple):
    y: Floats
    variance: Floats
    device: NDArray[np.intp]
    columns: dict[str, Floats]
    terms: tuple[str, ...]


class _Point(NamedTuple):
    tau_device: float
    tau_run: float
    cost: float
    b: Floats
    b_covariance: Floats


class _Weighed(NamedTuple):
    cost: float
    points: list[_Point]


def _read(
    values: Floats, errors: Floats, devices: Sequence[str], columns: Mapping[str, Floats]
) -> _Data:
    y, s = np.asarray(values, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    lengths = {"errors": s.size, "devices": len(devices)}
    lengths |= {f"column {name!r}": len(column) for name, column in columns.items()}
    for name, length in lengths.items():
        if length != y.size:
            raise ValueError(f"{name} has {length} entries and values {y.size}; give one for each")
    known = {name: np.asarray(column, dtype=np.float64) for name, column in columns.items()}
    for name, column in {"values": y, **known}.items():
        if not np.all(np.isfinite(column)):
            raise ValueError(
                f"{name} has NaN or infinite numbers; leave out the recordings that they belong to"
            )
    for name in set(known) & {DEVICE, RUN}:
        raise ValueError(
            f"a column is called {name!r}, which is the name of a level; give it another name"
        )
    if not np.all(s > 0.0):
        raise ValueError("errors has values that are not above 0; give standard errors")
    telling = np.isfinite(s)
    if np.count_nonzero(telling) < 2:
        raise ValueError("fewer than two estimates have a finite error; give more recordings")
    known = {
        name: column - column.mean() for name, column in known.items() if np.ptp(column[telling])
    }
    _, device = np.unique(np.asarray(devices), return_inverse=True)
    recorded = np.bincount(device[telling])
    repeated = np.count_nonzero(recorded) > 1 and bool(recorded.max() > 1)
    terms = ((DEVICE,) if repeated else ()) + (RUN, *known)
    return _Data(y, s**2, device, known, terms if np.ptp(y[telling]) > 0.0 else ())


def _design(data: _Data, kind: _Kind) -> tuple[list[str], Floats]:
    names = [name for name in data.columns if name in kind]
    return names, np.column_stack([np.ones(data.y.size), *(data.columns[n] for n in names)])


def _taus(data: _Data) -> Floats:
    telling = np.isfinite(data.variance)
    least = LEAST_TAU * math.sqrt(float(np.median(data.variance[telling])))
    return np.geomspace(least, max(float(np.ptp(data.y[telling])), 10.0 * least), GRID)


def _weigh(data: _Data, kind: _Kind) -> _Weighed:
    names, design = _design(data, kind)
    grid, nothing = _taus(data), np.zeros(1)
    telling = np.isfinite(data.variance)
    told = design[telling] / np.linalg.norm(design[telling], axis=0)
    if np.linalg.matrix_rank(told) < design.shape[1]:  # proportional columns, or too few recordings
        return _Weighed(math.inf, [])
    ranges = sum(
        2.0 * math.log(2.0 * np.ptp(data.y[telling]) / np.ptp(data.columns[n][telling]))
        - math.log(2.0 * math.pi)
        for n in names
    )
    points = [
        _at(data, design, float(device), float(run))
        for run in (grid if RUN in kind else nothing)
        for device in (grid if DEVICE in kind else nothing)
    ]
    costs = np.array([point.cost for point in points])
    total = -2.0 * float(logsumexp(-0.5 * costs)) + 2.0 * math.log(len(points)) + ranges
    return _Weighed(total, points)


def _sums(data: _Data, weight: Floats, what: Floats) -> Floats:
    """Sum weight * what (n, k) over each device: (devices, k)."""
    found = np.zeros((int(data.device.max()) + 1, what.shape[1]))
    np.add.at(found, data.device, weight[:, None] * what)
    return found


def _at(data: _Data, design: Floats, tau_device: float, tau_run: float) -> _Point:
    # V is a block D + tau^2 1 1' for each device, D = diag(s_i^2 + tau_run^2), so that (Sherman &
    # Morrison) V^-1 = D^-1 - D^-1 1 1' D^-1 / (1 / tau^2 + 1' D^-1 1), and
    # ln det V = ln det D + ln (1 + tau^2 1' D^-1 1).
    both = np.column_stack([design, data.y])
    apart = data.variance + tau_run**2
    weight = 1.0 / apart
    sums = _sums(data, weight, np.column_stack([both, np.ones(data.y.size)]))
    part, held = sums[:, :-1], sums[:, -1]
    taken = tau_device**2 / (1.0 + tau_device**2 * held)
    gram = both.T @ (weight[:, None] * both) - part.T @ (taken[:, None] * part)
    covariance = np.asarray(np.linalg.inv(gram[:-1, :-1]), dtype=np.float64)
    b = covariance @ gram[:-1, -1]
    log_det = float(np.sum(np.log(apart[np.isfinite(apart)])))
    log_det += float(np.sum(np.log1p(tau_device**2 * held)))
    left = float(gram[-1, -1] - gram[:-1, -1] @ b)
    return _Point(
        tau_device,
        tau_run,
        left + log_det - float(np.linalg.slogdet(covariance)[1]),
        b,
        covariance,
    )


def _pooled(data: _Data, design: Floats, point: _Point) -> tuple[Floats, Floats]:
    """Return mean and variance of each recording's own value at given taus."""
    # Given b: u_d is normal with precision 1 / tau^2 + 1' D^-1 1, and w_i, given u_d, has the share
    # tau_run^2 / (s_i^2 + tau_run^2) of the remaining y_i. The uncertainty of b adds to both.
    weight = 1.0 / (data.variance + point.tau_run**2)
    own = point.tau_run**2 * weight
    held = _sums(data, weight, np.ones((data.y.size, 1)))[:, 0]
    device_variance = point.tau_device**2 / (1.0 + point.tau_device**2 * held)
    off = data.y - design @ point.b
    u = device_variance * _sums(data, weight, off[:, None])[:, 0]
    moved = design - (device_variance[:, None] * _sums(data, weight, design))[data.device]
    moved *= (1.0 - own)[:, None]
    mean = design @ point.b + u[data.device] + own * (off - u[data.device])
    # own * s^2 = tau_run^2 (1 - own), which stays finite for an infinite error.
    variance = point.tau_run**2 * (1.0 - own) + (1.0 - own) ** 2 * device_variance[data.device]
    return mean, variance + np.einsum("ij,jk,ik->i", moved, point.b_covariance, moved)


def _answer(data: _Data, kind: _Kind, found: _Weighed, gains: Mapping[str, float]) -> Spread:
    names, design = _design(data, kind)
    costs = np.array([point.cost for point in found.points])
    shares = np.exp(-0.5 * (costs - costs.min()))
    shares[shares < NEGLIGIBLE * shares.max()] = 0.0
    shares /= shares.sum()
    kept = [(float(s), p) for s, p in zip(shares, found.points, strict=True) if s > 0.0]
    each = [(share, *_pooled(data, design, point)) for share, point in kept]
    pooled = sum((share * mean for share, mean, _ in each), np.zeros(data.y.size))
    variance = sum(
        (share * (var + (mean - pooled) ** 2) for share, mean, var in each), np.zeros(data.y.size)
    )
    b = sum((share * p.b for share, p in kept), np.zeros(design.shape[1]))
    b_variance = sum(
        (share * (np.diag(p.b_covariance) + (p.b - b) ** 2) for share, p in kept),
        np.zeros(design.shape[1]),
    )
    terms = [Slope(float(v), math.sqrt(e)) for v, e in zip(b, b_variance, strict=True)]
    return Spread(
        per_device=DEVICE in kind,
        per_run=RUN in kind,
        center=terms[0],
        tau_device=math.sqrt(sum(share * p.tau_device**2 for share, p in kept)),
        tau_run=math.sqrt(sum(share * p.tau_run**2 for share, p in kept)),
        slopes=dict(zip(names, terms[1:], strict=True)),
        pooled=pooled,
        pooled_errors=np.sqrt(variance),
        gains=dict(gains),
    )
