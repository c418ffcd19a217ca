"""SysIdentPy: polynomial NARX models by FROLS, the number of terms by an information criterion.

One model an output, since FROLS has one. Lags, degree and decimation are chosen by free runs over
the last 30 % of the fitted part (`predict` with steps_ahead=None, its infinite-step prediction),
then fitted to all of it. A recording far faster than its motion is decimated, as NARX models need:
one step ahead of it nearly nothing happens, and every model looks good.
"""

import importlib
import itertools
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.peer.method import Foretold
from benchmarks.peer.sets import Error, Floats, Part, Set, best_of, inner, judged, total
from zwidth.diagnosis.intake.rectified import folded_out

TERMS = 30  # tried, at most
TOLD = "SysIdentPy, told that the sensor folds"
Sense = Callable[[Floats], Floats]


@dataclass(frozen=True)
class Grid:
    """What is tried: every how many samples, lags of output and command, degrees.

    ahead: by how many samples the command is shifted, so that its lags begin with its present
    value, which its library leaves out, and which acts at once where a command is smooth.
    """

    every: tuple[int, ...]
    lags: tuple[tuple[int, int], ...]
    degrees: tuple[int, ...]
    ahead: tuple[int, ...] = (0,)


GRIDS = {
    "emps": Grid((5, 10, 20, 50), ((2, 2), (3, 3), (5, 5)), (1, 2, 3)),
    "silverbox": Grid((1,), ((2, 2), (3, 3), (4, 4)), (1, 3), (0, 1)),
    "two_mass_cart": Grid((5, 10, 20, 40), ((4, 4), (6, 6), (8, 8)), (1, 2, 3)),
    "coupled_drives": Grid((1,), ((2, 2), (3, 3), (5, 5), (8, 8)), (1, 2, 3), (0, 1)),
}
KNOWN = dict.fromkeys(GRIDS, "nothing of the machine")
KNOWN_TOLD = {"coupled_drives": "that the sensor folds; its signs were turned by zwidth's reader"}
Way = tuple[int, tuple[int, int], int, int]


def foretold(s: Set) -> Foretold:
    """Fit, and run freely over the held-out part."""
    return Foretold(*_foretold(s, s.fit))


def told(s: Set) -> Foretold:
    """The same with the fitted part's signs turned before, and the absolute value taken after."""
    z = folded_out(s.fit.measured[:, 0], s.fit.command)
    held, found = _foretold(s, Part(s.fit.command, z[:, None]))
    return Foretold(np.abs(held), found)


def _foretold(s: Set, fit: Part) -> tuple[Floats, str]:
    """The held-out part, an output at a time, and what the models are."""
    columns: list[Floats] = []
    said: list[str] = []
    for o in range(fit.measured.shape[1]):
        one = Part(fit.command, fit.measured[:, [o]])
        held = Part(s.held.command, s.held.measured[:, [o]])
        column, found = _one(s, one, held)
        columns.append(column)
        said.append(found)
    return np.column_stack(columns), "; ".join(said)


def _one(s: Set, fit: Part, held: Part) -> tuple[Floats, str]:
    grid = GRIDS[s.kind.name]
    part, rest = inner(fit)
    tried: list[tuple[float, Way]] = []
    for way in itertools.product(grid.every, grid.lags, grid.degrees, grid.ahead):
        model = _fitted(part, way)
        if model is not None:
            error: Error = judged(rest.measured, _run_on(model, way, part, rest))
            tried.append((total(error), way))
    way = tried[best_of([error for error, _ in tried])][1]
    model = _fitted(fit, way)
    if model is None:
        raise ValueError(f"SysIdentPy gives no model of {s.kind.name}")
    every, (ylag, xlag), degree, ahead = way
    found = f"{model.final_model.shape[0]} terms of degree {degree}, lags {ylag} and {xlag}"
    found += f", every {every} samples" if every > 1 else ""
    found += ", command from its present value on" if ahead else ""
    # Another recording begins by itself: its first samples stand for those before it.
    before = fit if s.follows else _at_rest(held, every * (max(ylag, xlag) + 1))
    return _run_on(model, way, before, held), found


def _at_rest(held: Part, ticks: int) -> Part:
    """What went before a recording that begins by itself: its first sample, for so many ticks."""
    return Part(np.full(ticks, held.command[0]), np.repeat(held.measured[:1], ticks, axis=0))


def _slow(command: Floats, every: int, ahead: int) -> Floats:
    """The command (ticks // every,), the mean of what acts from one kept sample to the next."""
    whole = command[: command.size // every * every]
    means = whole.reshape(-1, every).mean(axis=1)
    return np.r_[means[ahead:], np.repeat(means[-1:], ahead)]


def _fitted(part: Part, way: Way) -> Any:
    """A model fitted in one way, None if SysIdentPy gives none."""
    selection = importlib.import_module("sysidentpy.model_structure_selection")
    basis = importlib.import_module("sysidentpy.basis_function")
    estimators = importlib.import_module("sysidentpy.parameter_estimation")
    every, (ylag, xlag), degree, ahead = way
    u = _slow(part.command, every, ahead)
    y = part.measured[::every][: u.size]
    model = selection.FROLS(
        order_selection=True, n_info_values=TERMS, info_criteria="bic", ylag=ylag, xlag=xlag,
        basis_function=basis.Polynomial(degree=degree), estimator=estimators.LeastSquares(),
        model_type="NARMAX",
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            model.fit(X=u[:, None], y=y)
        except (ValueError, np.linalg.LinAlgError):
            return None
    return model


def _run_on(model: Any, way: Way, before: Part, held: Part) -> Floats:
    """The free run of what comes after `before`, whose last samples it begins with (ticks, 1)."""
    every, (ylag, xlag), _, ahead = way
    lag = max(ylag, xlag)
    # Samples that are kept: so that the last before the cut is one of them.
    u = np.r_[before.command[-every * lag :], held.command]
    known = before.measured[-every * lag :]
    pad = -u.size % every + (every if every > 1 else 0)  # so that nothing is extrapolated
    slow = _slow(np.r_[u, np.repeat(u[-1:], pad)], every, ahead)
    y = np.zeros((slow.size, 1))
    y[:lag] = known[::every]
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        run = np.asarray(model.predict(X=slow[:, None], y=y))[:, 0]
    if every == 1:
        return run[lag:, None]
    if not np.all(np.isfinite(run)):
        return np.full((held.ticks, 1), np.nan)
    spline = CubicSpline(every * np.arange(run.size), run)
    return spline(every * lag + np.arange(held.ticks))[:, None]
