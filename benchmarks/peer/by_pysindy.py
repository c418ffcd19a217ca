"""PySINDy: sparse regression of accelerations on a library of named terms.

What its own guide recommends for noisy data is done for each set: derivatives by
SmoothedFiniteDifference (and SpectralDerivative), terms named by who knows the machine, dx = v as a
constraint of ConstrainedSR3, or given as x_dot to STLSQ. Window, optimizer, threshold and library
are chosen by free runs over the last 30 % of the fitted part, then fitted to all of it.
"""

import importlib
import itertools
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import savgol_filter

from benchmarks.peer.method import Foretold, state_before
from benchmarks.peer.sets import Floats, Part, Set, best_of, inner, judged, total
from zwidth.diagnosis.intake.rectified import folded_out

Term = Callable[..., Any]
THRESHOLDS = (1e-6, 3e-3, 1e-2, 3e-2, 0.1)
BEFORE = 300  # samples before the cut, at most, that say where a free run begins
TOLD = "PySINDy, told that the sensor folds"


AXIS = ("1", "q", "v", "u", "sign(v)", "abs(v) * v", "v * (v > 0)")
DUFFING = (
    "1", "q", "v", "u", "q**2", "q * v", "v**2", "q**3", "q**2 * v", "q * v**2", "v**3",
)  # fmt: skip
CARTS = ("1", "v1", "v2", "q1 - q2", "u", "sign(v1)", "sign(v2)", "(q1 - q2)**3")
BELT = ("1", "y", "dy", "ddy", "u")
BENT = (*BELT, "y**2", "y * dy", "dy**2", "y * u", "sign(y)")


@dataclass(frozen=True)
class Problem:
    """How a set is put to PySINDy.

    states: their names, of each output the measured one and its derivatives, `order` of them;
    integrated: velocities were measured, and positions are their sums. libraries: terms of the
    states and of the command u. windows [samples] of the smoothing; 0 for the
    spectral derivative, -n for finite differences of order n.
    smooth: whether the command is smooth between its samples.
    """

    states: tuple[str, ...]
    order: int
    libraries: Mapping[str, tuple[str, ...]]
    windows: tuple[int, ...]
    integrated: bool = False
    smooth: bool = False

    def exact(self) -> dict[int, str]:
        """States whose rate is the next state, by their places, with that state."""
        return {
            k: self.states[k + 1] for k in range(len(self.states)) if (k + 1) % self.order
        }  # fmt: skip

    def functions(self, library: str) -> list[Term]:
        """The terms of a library as functions of all states and the command, by their names."""
        known = {"sign": np.sign, "abs": np.abs}
        names = ", ".join((*self.states, "u"))
        same = f"0.0 * {self.states[0]}"  # a constant is as long as the states are
        return [eval(f"lambda {names}: {term} + {same}", known) for term in self.libraries[library]]


PROBLEMS = {
    "emps": Problem(("q", "v"), 2, {"an axis with friction": AXIS}, (21, 51, 101)),
    "silverbox": Problem(
        ("q", "v"), 2, {"cubic polynomials": DUFFING}, (0, -4, -8, 5, 7), smooth=True
    ),
    "two_mass_cart": Problem(
        ("q1", "v1", "q2", "v2"), 2, {"two carts with friction": CARTS}, (15, 31, 61),
        integrated=True,
    ),
    "coupled_drives": Problem(
        ("y", "dy", "ddy"), 3, {"linear": BELT, "linear and products": BENT}, (0, -4, 5, 7, 9)
    ),
}  # fmt: skip
KNOWN = {
    "emps": "one axis, and the terms that its friction may be made of",
    "silverbox": "that position and velocity are the state and that forces are cubic polynomials;"
    " that the command is smooth",
    "two_mass_cart": "two carts on one spring, where friction may act, and that velocities are sums"
    " of encoder counts",
    "coupled_drives": "the order, three",
}
KNOWN_TOLD = {
    "coupled_drives": "the order, three, and that the sensor folds; its signs were turned by"
    " zwidth's reader"
}


@dataclass(frozen=True)
class Prepared:
    """States (ticks, s), their derivatives (ticks, s) and command (ticks,), each over its scale.

    Time is in units in which every derivative of one output has the size of the output.
    """

    states: Floats
    rates: Floats
    command: Floats
    scales: Floats
    unit: float
    volts: float


def foretold(s: Set) -> Foretold:
    """Fit, and run freely over the held-out part."""
    return Foretold(*_foretold(s, PROBLEMS[s.kind.name], s.fit))


def told(s: Set) -> Foretold:
    """The same with the fitted part's signs turned before, and the absolute value taken after."""
    z = folded_out(s.fit.measured[:, 0], s.fit.command)
    held, found = _foretold(s, PROBLEMS[s.kind.name], Part(s.fit.command, z[:, None]))
    return Foretold(np.abs(held), found)


def _foretold(s: Set, p: Problem, fit: Part) -> tuple[Floats, str]:
    part, rest = inner(fit)
    tried: list[tuple[float, tuple[int, str, str, float]]] = []
    ways = itertools.product(p.windows, p.libraries, ("STLSQ", "ConstrainedSR3"), THRESHOLDS)
    for way in ways:
        model = _fitted(s, p, part, way)
        if model is not None:
            tried.append((total(judged(rest.measured, _run_on(s, p, model, part, rest))), way))
    way = tried[best_of([error for error, _ in tried])][1]
    model = _fitted(s, p, fit, way)
    if model is None:
        raise ValueError(f"PySINDy gives no model of {s.kind.name}")
    window, library, optimizer, threshold = way
    smoothed = f"{window} samples smoothed" if window > 0 else "spectral derivatives"
    smoothed = f"finite differences of order {-window}" if window < 0 else smoothed
    found = f"{model.terms}; {library}, {optimizer} at {threshold:g}, {smoothed}"
    if s.follows:
        return _run_on(s, p, model, fit, s.held), found
    start = np.zeros(model.size)
    start[1::2] = s.held.measured[0]
    return _free_run(s, p, model, start, s.held.command), found


@dataclass(frozen=True)
class Model:
    """Coefficients (states, terms) in scaled units, and what they belong to."""

    coefficients: Floats
    names: tuple[str, ...]
    functions: list[Term]
    scale: Prepared
    order: int

    @property
    def size(self) -> int:
        """Number of states."""
        return self.coefficients.shape[0]

    @property
    def terms(self) -> str:
        """The terms that are kept of each force."""
        kept = self.coefficients[self.order - 1 :: self.order]
        said = [[n for n, c in zip(self.names, row, strict=True) if c != 0.0] for row in kept]
        return "; ".join(f"`{'`, `'.join(names)}`" for names in said)


def _derivative(window: int) -> Any:
    ps = importlib.import_module("pysindy")
    if window < 0:
        return ps.FiniteDifference(order=-window)
    if window == 0:
        return ps.SpectralDerivative()
    return ps.SmoothedFiniteDifference(smoother_kws={"window_length": window, "polyorder": 3})


def _prepared(s: Set, p: Problem, part: Part, window: int) -> Prepared:
    """States, rates and command as PySINDy's derivatives give them."""
    t = s.period * np.arange(part.ticks)
    by, columns, rates = _derivative(window), [], []
    for o in range(part.measured.shape[1]):
        y = part.measured[:, o]
        y = s.period * np.cumsum(y) if p.integrated else y
        for _ in range(p.order):
            dy = by(y[:, None], t)[:, 0]
            columns.append(savgol_filter(y, window, 3) if window > 0 else y)
            rates.append(dy)
            y = dy
    # A held command acts between samples: at a sample, half of the one before and half of the next.
    u = (
        part.command
        if p.smooth
        else 0.5 * (part.command + np.r_[part.command[:1], part.command[:-1]])
    )
    u = savgol_filter(u, window, 3) if window > 0 else u
    edge = max(2 * window, 20)  # a window, or the wrap of a spectrum, spoils the ends
    x, dx, u = (np.array(a).T[edge:-edge] for a in (columns, rates, u))
    size = x.std(axis=0)
    unit = float(size[0] / size[1])
    powers = np.arange(x.shape[1]) % p.order
    scales = np.repeat(size[:: p.order], p.order) / unit**powers
    volts = float(u.std())
    return Prepared(x / scales, dx * unit / scales, u / volts, scales, unit, volts)


def _fitted(s: Set, p: Problem, part: Part, way: tuple[int, str, str, float]) -> Model | None:
    """A model fitted in one way, None if PySINDy gives none."""
    ps = importlib.import_module("pysindy")
    window, name, optimizer, threshold = way
    ready = _prepared(s, p, part, window)
    names, functions = p.libraries[name], p.functions(name)
    exact, states = p.exact(), len(p.states)
    rates = ready.rates.copy()
    rates[:, list(exact)] = ready.states[:, [k + 1 for k in exact]]
    if optimizer == "STLSQ":
        chosen = ps.STLSQ(threshold=threshold, alpha=1e-9)
    else:
        lhs = np.zeros((len(exact) * len(names), states * len(names)))
        rhs = np.zeros(lhs.shape[0])
        for j, (k, follows) in enumerate(exact.items()):
            rows = slice(j * len(names), (j + 1) * len(names))
            lhs[rows, k * len(names) : (k + 1) * len(names)] = np.eye(len(names))
            rhs[j * len(names) + names.index(follows)] = 1.0
        chosen = ps.ConstrainedSR3(
            reg_weight_lam=0.5 * threshold**2, regularizer="l0", relax_coeff_nu=1.0,
            constraint_lhs=lhs, constraint_rhs=rhs, equality_constraints=True, max_iter=200,
        )  # fmt: skip
    named = [_named(term) for term in names]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = ps.SINDy(optimizer=chosen, feature_library=ps.CustomLibrary(functions, named))
        try:
            model.fit(ready.states, t=s.period / ready.unit, x_dot=rates, u=ready.command[:, None])
        except (ValueError, np.linalg.LinAlgError):
            return None
    found = Model(np.asarray(model.coefficients()), names, functions, ready, p.order)
    _same_as_its_own(model, found)
    return found


def _named(term: str) -> Callable[..., str]:
    """What PySINDy calls to name a term."""

    def name(*_: str) -> str:
        return term

    return name


def _same_as_its_own(model: Any, found: Model) -> None:
    """Raise ValueError if the free run's equation is not what PySINDy itself predicts."""
    x, u = found.scale.states[:50], found.scale.command[:50]
    own = np.asarray(model.predict(x, u=u[:, None]))
    ours = np.column_stack([f(*x.T, u) for f in found.functions]) @ found.coefficients.T
    if not np.allclose(own, ours, rtol=1e-6, atol=1e-8):
        raise ValueError("PySINDy's terms are in another order than its library's")


def _free_run(s: Set, p: Problem, model: Model, start: Floats, command: Floats) -> Floats:
    """Outputs (ticks, o) from a state in SI, by Runge-Kutta, the command held or smooth."""
    scale, terms = model.scale, model.functions
    u = command / scale.volts
    ticks = np.arange(u.size)
    middle = CubicSpline(ticks, u)(ticks + 0.5) if p.smooth else u
    after = np.r_[u[1:], u[-1:]] if p.smooth else u
    h = s.period / scale.unit
    coefficients = model.coefficients

    def rate(x: Floats, v: float) -> Floats:
        return coefficients @ np.array([f(*x, v) for f in terms])

    x = start / scale.scales
    states = np.full((u.size, x.size), np.nan)
    with np.errstate(all="ignore"):
        for k in range(u.size):
            states[k] = x
            if not np.all(np.abs(x) < 1e3):
                break
            a = rate(x, u[k])
            b = rate(x + 0.5 * h * a, middle[k])
            c = rate(x + 0.5 * h * b, middle[k])
            d = rate(x + h * c, after[k])
            x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    first = 1 if p.integrated else 0
    return (states * scale.scales)[:, first :: p.order]


def _run_on(s: Set, p: Problem, model: Model, before: Part, held: Part) -> Floats:
    """The free run of what comes after `before`, from the state with which that ends."""
    last = before.cut(max(0, before.ticks - BEFORE))
    guess = np.zeros(model.size)
    guess[1 if p.integrated else 0 :: p.order] = last.measured[0]

    def simulated(x: Floats) -> Floats:
        return _free_run(s, p, model, x, last.command)

    start = state_before(simulated, last.measured, guess, model.scale.scales)
    both = np.r_[last.command, held.command]
    return _free_run(s, p, model, start, both)[last.ticks :]
