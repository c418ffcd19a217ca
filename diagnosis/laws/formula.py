"""What formula a learned law looks like: the smallest of the field's forms within its band.

A law is known at its points with the covariance C of the fit, so a form g(s; theta) is as far from
it as

    d^2 = (f - g)' C^-1 (f - g),

least over theta by weighted least squares. What else the fit cannot tell from the law is in C: of a
table of velocity the straight part is the damper's as well, so that forms are told apart by what
bends, and a form may have any straight part that C allows. A form costs d^2 + k ln m of its k
numbers, m points; it is within the band where chance makes d^2 as large often enough
(`LAWS.within`). The cheapest is said, with those it is not told apart from (`LAWS.apart`); of those
that cost the same (`LAWS.even`) that of the fewest numbers, and of these the plainest, in the order
of `FORMS`.

The forms are those of the field: straight lines, powers, a drag of two powers, saturations (tanh,
arctangent, a clipped line), dead zones and stops, exponentials, bumps, sines, magnets; of what acts
over a velocity together with a friction, frictions with a damper, a power, a saturation or a fall
beside them; of what repeats, as many harmonics as it takes. Each is a formula over a state s as an
effect of the user's own has it (`sim/physics/own.py`). Limits: a curve of some ten points tells few
numbers; a form is a description over the range that was seen, and no law beyond it.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.stats import chi2

from zwidth.diagnosis.settings import LAWS

Floats = NDArray[np.float64]
FUNCTIONS: dict[str, Any] = {
    "sign": np.sign, "abs": np.abs, "tanh": np.tanh, "atan": np.arctan, "clip": np.clip,
    "max": np.maximum, "min": np.minimum, "exp": np.exp, "sin": np.sin, "cos": np.cos,
}  # fmt: skip


@dataclass(frozen=True)
class Form:
    """A form of laws: how it is said, and its formula.

    text: with {s} for the state and its numbers in braces; law: of a state s and the same numbers.
    powers: of the state, by which each linear factor is less than the law. starts: of the other
    numbers (a power p, a place m, a width w), over the range of the states, from which they are
    sought. odd: whether f(-s) = -f(s). rubs: with a step at rest, as only friction has; turns: of
    what repeats, its w the period over 2 pi.
    """

    name: str
    text: str
    law: str
    powers: Mapping[str, int]
    starts: tuple[tuple[float, ...], ...] = ((),)
    odd: bool = True
    rubs: bool = False
    turns: bool = False

    @property
    def factors(self) -> tuple[str, ...]:
        """The numbers over which it is a straight line."""
        return tuple(self.powers)

    @property
    def shape(self) -> tuple[str, ...]:
        """The others."""
        return tuple(name for name in "pmw" if f"{{{name}}}" in self.text)

    @cached_property
    def _compiled(self) -> Callable[..., Any]:
        numbers = ", ".join(("s", *self.factors, *self.shape))
        return eval(f"lambda {numbers}: {self.law}", dict(FUNCTIONS))

    def columns(self, states: Floats, shape: Floats) -> Floats:
        """Return what its factors multiply at states (...,): (..., factors)."""
        units = np.eye(len(self.factors))
        found = [self._compiled(states, *unit, *shape) + 0.0 * states for unit in units]
        return np.stack(found, axis=-1)


@dataclass(frozen=True)
class Formula:
    """A form fitted to a law: its numbers by name, its distance, and what it costs."""

    form: Form
    numbers: dict[str, float]
    distance: float
    cost: float
    chance: float

    def at(self, states: Floats) -> Floats:
        """Return it at some states (...,)."""
        shape = np.array([self.numbers[n] for n in self.form.shape])
        factors = np.array([self.numbers[n] for n in self.form.factors])
        return self.form.columns(np.asarray(states, dtype=np.float64), shape) @ factors

    def text(self, state: str) -> str:
        """Return it as a formula of a state's letter, with its numbers."""
        numbers = {name: f"{value:.3g}" for name, value in self.numbers.items()}
        return self.form.text.format(s=state, **numbers).replace("+ -", "- ").replace("- -", "+ ")


def _sum_of(count: str, harmonics: int) -> Form:
    """The form of so many harmonics."""
    text, law, names = "{c}", "c", "abdeghijkl"
    for k in range(1, harmonics + 1):
        for name, f in zip(names[2 * k - 2 : 2 * k], ("sin", "cos"), strict=True):
            text += f" + {{{name}}} {f}({'' if k == 1 else f'{k} '}{{s}} / {{w}})"
            law += f" + {name} * {f}({'' if k == 1 else f'{k} * '}s / w)"
    powers: dict[str, int] = dict.fromkeys(("c", *names[: 2 * harmonics]), 0)
    return Form(f"sum of {count} harmonics", text, law, powers, odd=False, turns=True)


SINES = tuple((w,) for w in (0.05, 0.07, 0.1, 0.15, 0.25, 0.4, 0.7))  # periods over 2 pi
WIDTHS = tuple((w,) for w in (0.1, 0.25, 0.5, 1.0, 2.0))
FORMS = (
    Form("straight line", "{a} {s}", "a * s", {"a": 1}),
    Form("offset", "{c}", "c", {"c": 0}, odd=False),
    Form("line", "{c} + {a} {s}", "c + a * s", {"c": 0, "a": 1}, odd=False),
    Form("square", "{a} {s} |{s}|", "a * s * abs(s)", {"a": 2}),
    Form("cube", "{a} {s}^3", "a * s**3", {"a": 3}),
    Form("power", "{a} sign({s}) |{s}|^{p}", "a * sign(s) * abs(s)**p", {"a": 0},
         ((0.5,), (1.5,), (2.5,), (4.0,))),
    Form("line and square", "{a} {s} + {b} {s} |{s}|", "a * s + b * s * abs(s)", {"a": 1, "b": 2}),
    Form("line and cube", "{a} {s} + {b} {s}^3", "a * s + b * s**3", {"a": 1, "b": 3}),
    Form("parabola", "{c} + {a} {s} + {b} {s}^2", "c + a * s + b * s**2",
         {"c": 0, "a": 1, "b": 2}, odd=False),
    Form("saturation", "{a} tanh({s} / {w})", "a * tanh(s / w)", {"a": 0}, WIDTHS),
    Form("arctangent", "{a} atan({s} / {w})", "a * atan(s / w)", {"a": 0}, WIDTHS),
    Form("clipped line", "{a} clip({s}, -{w}, {w})", "a * clip(s, -w, w)", {"a": 1}, WIDTHS),
    Form("dead zone", "{a} ({s} - clip({s}, -{w}, {w}))", "a * (s - clip(s, -w, w))", {"a": 1},
         WIDTHS),
    Form("saturation and line", "{a} tanh({s} / {w}) + {b} {s}", "a * tanh(s / w) + b * s",
         {"a": 0, "b": 1}, WIDTHS),
    Form("stop above", "{a} max({s} - {m}, 0)", "a * max(s - m, 0)", {"a": 1},
         ((-0.5,), (0.0,), (0.25,), (0.5,), (0.75,)), odd=False),
    Form("stop below", "{a} min({s} - {m}, 0)", "a * min(s - m, 0)", {"a": 1},
         ((-0.75,), (-0.5,), (-0.25,), (0.0,), (0.5,)), odd=False),
    Form("exponential", "{c} + {a} exp({s} / {w})", "c + a * exp(clip(s / w, -50, 50))",
         {"c": 0, "a": 0}, ((0.3,), (-0.3,), (1.0,), (-1.0,)), odd=False),
    Form("bump", "{c} + {a} exp(-({s} - {m})^2 / (2 {w}^2))",
         "c + a * exp(-0.5 * ((s - m) / w)**2)", {"c": 0, "a": 0},
         tuple((m, w) for m in (-0.5, 0.0, 0.5) for w in (0.15, 0.4)), odd=False),
    Form("magnet", "{a} {s} / ({w}^2 + {s}^2)", "a * s / (w**2 + s**2)", {"a": -1}, WIDTHS),
    Form("sine from rest", "{a} sin({s} / {w})", "a * sin(s / w)", {"a": 0}, SINES),
    Form("sine", "{c} + {a} sin({s} / {w}) + {b} cos({s} / {w})",
         "c + a * sin(s / w) + b * cos(s / w)", {"c": 0, "a": 0, "b": 0}, SINES, odd=False,
         turns=True),
    *(_sum_of(count, k) for k, count in enumerate(("two", "three", "four", "five"), 2)),
    Form("friction", "{a} sign({s})", "a * sign(s)", {"a": 0}, rubs=True),
    Form("friction and a line", "{a} sign({s}) + {b} {s}", "a * sign(s) + b * s",
         {"a": 0, "b": 1}, rubs=True),
    Form("friction and a square", "{a} sign({s}) + {b} {s} |{s}|", "a * sign(s) + b * s * abs(s)",
         {"a": 0, "b": 2}, rubs=True),
    Form("friction and a power", "{a} sign({s}) + {b} sign({s}) |{s}|^{p}",
         "a * sign(s) + b * sign(s) * abs(s)**p", {"a": 0, "b": 0}, ((0.5,), (1.5,), (3.0,)),
         rubs=True),
    Form("friction and a saturation", "{a} sign({s}) + {b} tanh({s} / {w})",
         "a * sign(s) + b * tanh(s / w)", {"a": 0, "b": 0}, WIDTHS, rubs=True),
    Form("friction that falls, and a line",
         "{a} sign({s}) + {b} sign({s}) exp(-|{s}| / {w}) + {d} {s}",
         "a * sign(s) + b * sign(s) * exp(-abs(s / w)) + d * s", {"a": 0, "b": 0, "d": 1}, WIDTHS,
         rubs=True),
    Form("friction and a line, each by direction", "{c} + {a} sign({s}) + {b} {s} + {d} |{s}|",
         "c + a * sign(s) + b * s + d * abs(s)", {"c": 0, "a": 0, "b": 1, "d": 1}, odd=False,
         rubs=True),
    Form("friction and a saturation, each by direction",
         "{c} + {a} sign({s}) + {b} tanh({s} / {w}) + {d} |tanh({s} / {w})|",
         "c + a * sign(s) + b * tanh(s / w) + d * abs(tanh(s / w))",
         {"c": 0, "a": 0, "b": 0, "d": 0}, WIDTHS, odd=False, rubs=True),
)  # fmt: skip


def formulas(
    states: Floats,
    forces: Floats,
    covariance: Floats,
    odd: bool,
    period: float = 0.0,
    rubs: bool = False,
    coarse: float = 5e-3,
) -> list[Formula]:
    """Return what a law looks like, the likeliest first: that, and what it is not told from.

    states, forces (points,): of the law, covariance (points, points) of the forces. odd: of |s|.
    period: of one that repeats, which looks like harmonics; rubs: whether friction is part of it.
    coarse: of the largest force, by which the curve between points errs. Empty where no form is
    within the band.
    """
    if odd:  # nothing at nothing is known for certain, and says nothing
        states, forces, covariance = states[1:], forces[1:], covariance[1:, 1:]
    size = float(np.abs(forces).max())
    if size == 0.0 or states.size < 2:
        return []
    known = covariance + np.eye(states.size) * (coarse * size) ** 2
    weigh = np.asarray(np.linalg.inv(np.linalg.cholesky(known)), dtype=np.float64)
    found = [
        fitted
        for form in FORMS
        if (form.odd or not odd)
        and (rubs or not form.rubs)
        and (form.turns if period > 0.0 else form.starts != ((),) or not form.shape)
        and (fitted := _fitted(form, states, forces, weigh, period)) is not None
        and fitted.chance > LAWS.within
    ]
    if not found:
        return []
    least = min(f.cost for f in found)
    even = [f for f in found if f.cost < least + LAWS.even]  # in the order of `FORMS`
    first = min(even, key=lambda f: len(f.numbers))
    others = sorted((f for f in found if f is not first), key=lambda f: f.cost)
    return [first, *(f for f in others if f.cost < least + LAWS.apart)]


def _fitted(
    form: Form, states: Floats, forces: Floats, weigh: Floats, period: float
) -> Formula | None:
    """A form at its nearest to a law; None where the law has no more points than it has numbers."""
    count = len(form.factors) + (len(form.shape) if period == 0.0 else 0)
    if states.size <= count:
        return None
    reach, target = float(np.abs(states).max()), weigh @ forces
    scale = np.array([1.0 if name == "p" else reach for name in form.shape])

    def linear(shape: Floats) -> tuple[Floats, Floats]:
        columns = weigh @ form.columns(states, shape)
        factors = np.asarray(np.linalg.lstsq(columns, target, rcond=1e-12)[0], dtype=np.float64)
        return factors, target - columns @ factors

    if period > 0.0:
        ends = [np.array([period / (2.0 * math.pi)])]
    else:
        ends = [scale * start for start in form.starts]
    if form.shape and period == 0.0:
        ends = [
            least_squares(
                lambda t: linear(t)[1], start, bounds=_limits(form, start, reach), x_scale=scale
            ).x
            for start in ends
        ]
    each = [(float(np.sum(linear(shape)[1] ** 2)), k) for k, shape in enumerate(ends)]
    squares, k = min((one for one in each if math.isfinite(one[0])), default=(math.inf, -1))
    if k < 0:
        return None
    numbers = dict(zip(form.factors, linear(ends[k])[0].tolist(), strict=True))
    numbers |= dict(zip(form.shape, ends[k].tolist(), strict=True))
    chance = float(chi2.sf(squares, states.size - count))
    return Formula(form, numbers, squares, squares + count * math.log(states.size), chance)


def _limits(form: Form, start: Floats, reach: float) -> tuple[list[float], list[float]]:
    """Bounds of the numbers of a shape: a power, a place, or a width, which keeps its sign."""
    found: list[tuple[float, float]] = []
    for name, value in zip(form.shape, start.tolist(), strict=True):
        if name == "p":
            found.append((0.1, 10.0))
        elif name == "m":
            found.append((-2.0 * reach, 2.0 * reach))
        else:
            low, high = sorted(math.copysign(w * reach, value) for w in (1e-2, 1e2))
            found.append((low, high))
    return [low for low, _ in found], [high for _, high in found]
