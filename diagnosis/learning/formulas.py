"""Finds a formula for a learned law: the simplest common form within its band.

A law is known at its points with the covariance C of the fit, so the distance of a form g(s; theta)
from it is

    d^2 = (f - g)' C^-1 (f - g),

minimised over theta by weighted least squares. C includes everything that the fit cannot
distinguish from the law. For example, the straight part of a table over velocity is also the
damper's, so forms are distinguished by their curvature, and may have any straight part that C
allows. A form with k numbers costs d^2 + k ln m for m points. It is within the band if chance makes
d^2 as large in one of a hundred fits. The form of least cost is reported, with those that cannot be
distinguished from it (`close` in the settings). Of forms of equal cost (`even`: "not worth more
than a bare mention", Kass & Raftery 1995), the one with the fewest numbers comes first, and of
these the first in `FORMS`.

The forms are those that engineers use: straight lines, powers, a drag of two powers, saturations
(tanh, arctangent, a clipped line), dead zones and stops, exponentials, bumps, sines, magnets; over
velocity, if friction is part of the curve, frictions with a damper, a power, a saturation or a fall
beside them; for a periodic law, up to five harmonics. Limits: a curve of ten points determines few
numbers. A form describes the range that was seen, and is not a law beyond it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import chi2

from zwidth.diagnosis.settings import LAWS as SETTINGS
from zwidth.shown import Valued

Floats = NDArray[np.float64]
COARSE = 5e-3  # of the largest point: error of the curve between points, added to all
POWERS = (0.1, 10.0)  # within which a power, a place (of the range) and a width are sought
PLACES = 2.0
WIDTHS = (1e-2, 1e2)
SINES = (0.05, 0.07, 0.1, 0.15, 0.25, 0.4, 0.7)  # starts, over the range: a period / 2 pi
SUMS = {2: "two", 3: "three", 4: "four", 5: "five"}  # harmonics of a periodic law
HARMONICS = ("a", "b", "d", "e", "g", "h", "i", "j", "k", "l")  # their sines and cosines
STARTS = (0.1, 0.25, 0.5, 1.0, 2.0)  # starts for widths and corners, as shares of the range


@dataclass(frozen=True)
class Form(Valued):
    """A form of a law: its text, and its columns by the linear factors.

    columns(s, shape): the columns of the linear numbers, (points, factors); shape: the nonlinear
    numbers, fitted from `starts` (relative to the range of the states). rubs: has a step at rest,
    as only friction has; turns: is periodic, with the period 2 pi w.
    """

    name: str
    text: str
    factors: tuple[str, ...]
    shape: tuple[str, ...]
    columns: Callable[[Floats, Floats], Floats]
    starts: tuple[tuple[float, ...], ...] = ((),)
    odd: bool = True
    rubs: bool = False
    turns: bool = False


@dataclass(frozen=True)
class Formula(Valued):
    """A form fitted to a law: its numbers by name, its distance, cost and chance."""

    form: Form
    numbers: dict[str, float]
    distance: float
    cost: float
    chance: float

    @property
    def within(self) -> bool:
        """Whether the formula is within the law's band."""
        return self.chance > SETTINGS.within

    def at(self, states: Floats) -> Floats:
        """Return the formula's values at states (...,)."""
        shape = np.array([self.numbers[n] for n in self.form.shape])
        factors = np.array([self.numbers[n] for n in self.form.factors])
        return self.form.columns(np.asarray(states, dtype=np.float64), shape) @ factors

    def text(self, state: str) -> str:
        """Return the formula as text, with its numbers, over a state's letter."""
        numbers = {name: f"{value:.3g}" for name, value in self.numbers.items()}
        return self.form.text.format(s=state, **numbers).replace("+ -", "- ").replace("- -", "+ ")


def _columns(*parts: Floats) -> Floats:
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def _odd_power(s: Floats, p: Floats | float) -> Floats:
    return np.sign(s) * np.abs(s) ** p


def _harmonics(s: Floats, w: float, count: int) -> Floats:
    turns = [f(k * s / w) for k in range(1, count + 1) for f in (np.sin, np.cos)]
    return _columns(np.ones_like(s), *turns)


def _sum_text(count: int, times: str, number: str, state: str) -> str:
    """A sum of harmonics of s / w, its numbers written in the format `number`."""
    text = number.format("c")
    for k in range(1, count + 1):
        turn = f"{'' if k == 1 else f'{k}{times}'}{state} / {number.format('w')}"
        for name, f in zip(HARMONICS[2 * k - 2 : 2 * k], ("sin", "cos"), strict=True):
            text += f" + {number.format(name)}{times}{f}({turn})"
    return text


def _sum_of(count: int) -> Form:
    """The form with a number of harmonics."""
    return Form(
        f"sum of {SUMS[count]} harmonics", _sum_text(count, " ", "{{{}}}", "{s}"),
        ("c", *HARMONICS[: 2 * count]), ("w",), lambda s, t: _harmonics(s, t[0], count),
        odd=False, turns=True,
    )  # fmt: skip


FORMS = (
    Form("straight line", "{a} {s}", ("a",), (), lambda s, _: _columns(s)),
    Form("offset", "{c}", ("c",), (), lambda s, _: _columns(np.ones_like(s)), odd=False),
    Form("line", "{c} + {a} {s}", ("c", "a"), (), lambda s, _: _columns(np.ones_like(s), s),
         odd=False),
    Form("square", "{a} {s} |{s}|", ("a",), (), lambda s, _: _columns(s * np.abs(s))),
    Form("cube", "{a} {s}^3", ("a",), (), lambda s, _: _columns(s**3)),
    Form("power", "{a} sign({s}) |{s}|^{p}", ("a",), ("p",),
         lambda s, t: _columns(_odd_power(s, t[0])),
         ((0.5,), (1.5,), (2.5,), (4.0,))),
    Form("line and square", "{a} {s} + {b} {s} |{s}|", ("a", "b"), (),
         lambda s, _: _columns(s, s * np.abs(s))),
    Form("line and cube", "{a} {s} + {b} {s}^3", ("a", "b"), (), lambda s, _: _columns(s, s**3)),
    Form("parabola", "{c} + {a} {s} + {b} {s}^2", ("c", "a", "b"), (),
         lambda s, _: _columns(np.ones_like(s), s, s**2), odd=False),
    Form("saturation", "{a} tanh({s} / {w})", ("a",), ("w",),
         lambda s, t: _columns(np.tanh(s / t[0])),
         tuple((w,) for w in STARTS)),
    Form("arctangent", "{a} atan({s} / {w})", ("a",), ("w",),
         lambda s, t: _columns(np.arctan(s / t[0])), tuple((w,) for w in STARTS)),
    Form("clipped line", "{a} clip({s}, -{w}, {w})", ("a",), ("w",),
         lambda s, t: _columns(np.clip(s, -abs(t[0]), abs(t[0]))), tuple((w,) for w in STARTS)),
    Form("dead zone", "{a} ({s} - clip({s}, -{w}, {w}))", ("a",), ("w",),
         lambda s, t: _columns(s - np.clip(s, -abs(t[0]), abs(t[0]))),
         tuple((w,) for w in STARTS)),
    Form("saturation and line", "{a} tanh({s} / {w}) + {b} {s}", ("a", "b"), ("w",),
         lambda s, t: _columns(np.tanh(s / t[0]), s), tuple((w,) for w in STARTS)),
    Form("stop above", "{a} max({s} - {m}, 0)", ("a",), ("m",),
         lambda s, t: _columns(np.maximum(s - t[0], 0.0)),
         tuple((w,) for w in (-0.5, 0.0, 0.25, 0.5, 0.75)), odd=False),
    Form("stop below", "{a} min({s} - {m}, 0)", ("a",), ("m",),
         lambda s, t: _columns(np.minimum(s - t[0], 0.0)),
         tuple((w,) for w in (-0.75, -0.5, -0.25, 0.0, 0.5)), odd=False),
    Form("exponential", "{c} + {a} exp({s} / {w})", ("c", "a"), ("w",),
         lambda s, t: _columns(np.ones_like(s), np.exp(np.clip(s / t[0], -50.0, 50.0))),
         ((0.3,), (-0.3,), (1.0,), (-1.0,)), odd=False),
    Form("bump", "{c} + {a} exp(-({s} - {m})^2 / (2 {w}^2))", ("c", "a"), ("m", "w"),
         lambda s, t: _columns(np.ones_like(s), np.exp(-0.5 * ((s - t[0]) / t[1]) ** 2)),
         tuple((m, w) for m in (-0.5, 0.0, 0.5) for w in (0.15, 0.4)), odd=False),
    Form("magnet", "{a} {s} / ({w}^2 + {s}^2)", ("a",), ("w",),
         lambda s, t: _columns(s / (t[0] ** 2 + s**2)), tuple((w,) for w in STARTS)),
    Form("sine from rest", "{a} sin({s} / {w})", ("a",), ("w",),
         lambda s, t: _columns(np.sin(s / t[0])), tuple((w,) for w in SINES)),
    Form("sine", "{c} + {a} sin({s} / {w}) + {b} cos({s} / {w})", ("c", "a", "b"), ("w",),
         lambda s, t: _columns(np.ones_like(s), np.sin(s / t[0]), np.cos(s / t[0])),
         tuple((w,) for w in SINES), odd=False, turns=True),
    *(_sum_of(count) for count in SUMS),
    Form("friction", "{a} sign({s})", ("a",), (), lambda s, _: _columns(np.sign(s)), rubs=True),
    Form("friction and a line", "{a} sign({s}) + {b} {s}", ("a", "b"), (),
         lambda s, _: _columns(np.sign(s), s), rubs=True),
    Form("friction and a square", "{a} sign({s}) + {b} {s} |{s}|", ("a", "b"), (),
         lambda s, _: _columns(np.sign(s), s * np.abs(s)), rubs=True),
    Form("friction and a power", "{a} sign({s}) + {b} sign({s}) |{s}|^{p}", ("a", "b"), ("p",),
         lambda s, t: _columns(np.sign(s), _odd_power(s, t[0])), ((0.5,), (1.5,), (3.0,)),
         rubs=True),
    Form("friction and a saturation", "{a} sign({s}) + {b} tanh({s} / {w})", ("a", "b"), ("w",),
         lambda s, t: _columns(np.sign(s), np.tanh(s / t[0])), tuple((w,) for w in STARTS),
         rubs=True),
    Form("friction that falls, and a line", "{a} sign({s}) + {b} sign({s}) exp(-|{s}| / {w})"
         " + {d} {s}", ("a", "b", "d"), ("w",),
         lambda s, t: _columns(np.sign(s), np.sign(s) * np.exp(-np.abs(s / t[0])), s),
         tuple((w,) for w in STARTS), rubs=True),
    Form("friction and a line that differ by direction",
         "{c} + {a} sign({s}) + {b} {s} + {d} |{s}|", ("c", "a", "b", "d"), (),
         lambda s, _: _columns(np.ones_like(s), np.sign(s), s, np.abs(s)), odd=False, rubs=True),
    Form("friction and a saturation that differ by direction",
         "{c} + {a} sign({s}) + {b} tanh({s} / {w}) + {d} |tanh({s} / {w})|",
         ("c", "a", "b", "d"), ("w",),
         lambda s, t: _columns(np.ones_like(s), np.sign(s), np.tanh(s / t[0]),
                               np.abs(np.tanh(s / t[0]))),
         tuple((w,) for w in STARTS), odd=False, rubs=True),
)  # fmt: skip


# Each form as the formula of an effect (`sim/physics/own.py`) over a state s. The unit of a factor
# is that of the law divided by these powers of the state's unit.
LAWS: dict[str, tuple[str, tuple[int, ...]]] = {
    "straight line": ("a * s", (1,)),
    "offset": ("c", (0,)),
    "line": ("c + a * s", (0, 1)),
    "square": ("a * s * abs(s)", (2,)),
    "cube": ("a * s**3", (3,)),
    "power": ("a * sign(s) * abs(s)**p", (0,)),
    "line and square": ("a * s + b * s * abs(s)", (1, 2)),
    "line and cube": ("a * s + b * s**3", (1, 3)),
    "parabola": ("c + a * s + b * s**2", (0, 1, 2)),
    "saturation": ("a * tanh(s / w)", (0,)),
    "arctangent": ("a * atan(s / w)", (0,)),
    "clipped line": ("a * clip(s, -w, w)", (1,)),
    "dead zone": ("a * (s - clip(s, -w, w))", (1,)),
    "saturation and line": ("a * tanh(s / w) + b * s", (0, 1)),
    "stop above": ("a * max(s - m, 0)", (1,)),
    "stop below": ("a * min(s - m, 0)", (1,)),
    "exponential": ("c + a * exp(clip(s / w, -50, 50))", (0, 0)),
    "bump": ("c + a * exp(-0.5 * ((s - m) / w)**2)", (0, 0)),
    "magnet": ("a * s / (w**2 + s**2)", (-1,)),
    "sine from rest": ("a * sin(s / w)", (0,)),
    "sine": ("c + a * sin(s / w) + b * cos(s / w)", (0, 0, 0)),
    **{
        f"sum of {word} harmonics": (_sum_text(count, " * ", "{}", "s"), (0,) * (1 + 2 * count))
        for count, word in SUMS.items()
    },
    "friction": ("a * sign(s)", (0,)),
    "friction and a line": ("a * sign(s) + b * s", (0, 1)),
    "friction and a square": ("a * sign(s) + b * s * abs(s)", (0, 2)),
    "friction and a power": ("a * sign(s) + b * sign(s) * abs(s)**p", (0, 0)),
    "friction and a saturation": ("a * sign(s) + b * tanh(s / w)", (0, 0)),
    "friction that falls, and a line": (
        "a * sign(s) + b * sign(s) * exp(-abs(s / w)) + d * s",
        (0, 0, 1),
    ),
    "friction and a line that differ by direction": (
        "c + a * sign(s) + b * s + d * abs(s)",
        (0, 0, 1, 1),
    ),
    "friction and a saturation that differ by direction": (
        "c + a * sign(s) + b * tanh(s / w) + d * abs(tanh(s / w))",
        (0, 0, 0, 0),
    ),
}


def formulas(
    states: Floats,
    forces: Floats,
    covariance: Floats,
    odd: bool,
    period: float = 0.0,
    rubs: bool = False,
) -> list[Formula]:
    """Return the formulas near a law, the most likely first, and those not distinguished from it.

    states, forces (points,): of the law, covariance (points, points) of the forces. odd: whether
    the table is over |s|. period: of a periodic law, whose forms are harmonics; rubs: whether
    friction is part of the law. Empty if no form is within the band.
    """
    if odd:  # an odd law is zero at zero, which carries no information
        states, forces, covariance = states[1:], forces[1:], covariance[1:, 1:]
    size = float(np.abs(forces).max())
    if size == 0.0 or states.size < 2:
        return []
    known = covariance + np.eye(states.size) * (COARSE * size) ** 2
    weigh = np.asarray(np.linalg.inv(np.linalg.cholesky(known)), dtype=np.float64)
    found = [
        fitted
        for form in FORMS
        if (form.odd or not odd)
        and (rubs or not form.rubs)
        and (form.turns if period > 0.0 else form.starts != ((),) or not form.shape)
        and (fitted := _fitted(form, states, forces, weigh, period)) is not None
        and fitted.within
    ]
    if not found:
        return []
    least = min(f.cost for f in found)
    even = [f for f in found if f.cost < least + SETTINGS.even]  # in the order of `FORMS`
    first = min(even, key=lambda f: len(f.numbers))
    others = sorted((f for f in found if f is not first), key=lambda f: f.cost)
    return [first, *(f for f in others if f.cost < least + SETTINGS.close)]


def _fitted(
    form: Form, states: Floats, forces: Floats, weigh: Floats, period: float
) -> Formula | None:
    """A form fitted to a law; None if the law has too few points for the numbers."""
    count = len(form.factors) + (len(form.shape) if period == 0.0 else 0)
    if states.size <= count:
        return None
    reach = float(np.abs(states).max())
    target = weigh @ forces

    def linear(shape: Floats) -> tuple[Floats, Floats]:
        columns = weigh @ form.columns(states, shape)
        factors = np.asarray(np.linalg.lstsq(columns, target, rcond=1e-12)[0], dtype=np.float64)
        return factors, target - columns @ factors

    best: tuple[float, Floats] | None = None
    if period > 0.0:
        shape = np.array([period / (2.0 * math.pi)])
        best = float(np.sum(linear(shape)[1] ** 2)), shape
    for start in () if period > 0.0 else form.starts:
        shape = np.array([v * _unit(n, reach) for n, v in zip(form.shape, start, strict=True)])
        if form.shape:
            limits = [_limits(n, v, reach) for n, v in zip(form.shape, start, strict=True)]
            bounds = [low for low, _ in limits], [high for _, high in limits]
            scale = [_unit(n, reach) for n in form.shape]
            shape = least_squares(lambda t: linear(t)[1], shape, bounds=bounds, x_scale=scale).x
        squares = float(np.sum(linear(shape)[1] ** 2))
        if math.isfinite(squares) and (best is None or squares < best[0]):
            best = squares, shape
    if best is None:
        return None
    squares, shape = best
    numbers = dict(zip(form.factors, linear(shape)[0].tolist(), strict=True))
    numbers |= dict(zip(form.shape, (float(v) for v in shape), strict=True))
    chance = float(chi2.sf(squares, states.size - count))
    cost = squares + count * math.log(states.size)
    return Formula(form, numbers, squares, cost, chance)


def _unit(name: str, reach: float) -> float:
    """The unit of a nonlinear number: powers are numbers, all others are states."""
    return 1.0 if name == "p" else reach


def _limits(name: str, start: float, reach: float) -> tuple[float, float]:
    """Bounds of a nonlinear number: a power, a place, or a width, which keeps its sign."""
    if name == "p":
        return POWERS
    if name == "m":
        return -PLACES * reach, PLACES * reach
    low, high = (math.copysign(w * reach, start) for w in WIDTHS)
    return min(low, high), max(low, high)
