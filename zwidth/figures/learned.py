"""A learned law: its curve with its band, the nearest formula, and the states that were seen."""

from textwrap import wrap

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zwidth.diagnosis.answer.laws import LearnedLaw
from zwidth.diagnosis.learning.tables import law_at
from zwidth.diagnosis.learning.together import Together
from zwidth.figures.samples import framed, samples_on
from zwidth.figures.style import AFTER, BEFORE, LAW, STYLE
from zwidth.sim.physics.free_law import AT, FORCE
from zwidth.sim.readable import as_counted, scaled

Floats = NDArray[np.float64]
CURVE, TOGETHER, FORMULA = AFTER, LAW, BEFORE
FINE = 400  # states at which a curve is drawn
BINS = 60
SHOWN = 4000  # most samples that are drawn
WIDE = 90  # letters of a line of the legend
LINES = 2  # most lines of a legend for a formula


def learned_figure(law: LearnedLaw, rotary: bool) -> Figure:
    """Return the learned law over its state, and how often each state was visited."""
    curve = law.curve
    effect = curve.physics.effect
    units = effect.parameter(AT[0]).unit_for(rotary), effect.parameter(FORCE[0]).unit_for(rotary)
    state_unit, made_unit = units
    seen = _turned(law, curve.seen)
    s = np.linspace(float(seen.min()), float(seen.max()), FINE)
    f = law_at(curve.physics, s)
    tallest = f if curve.together is None else curve.together.forces
    x, state_unit = scaled(float(np.abs(s).max()), state_unit)
    y, made_unit = scaled(float(max(np.abs(f).max(), np.abs(tallest).max())), made_unit)
    with rc_context(STYLE):
        figure = Figure(figsize=(6.4, 5.0), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (4, 1)})
        above.axhline(0.0, color="0.6", linewidth=0.8)
        _samples(above, law, x, y)
        above.plot(x * s, y * f, color=CURVE, linewidth=1.4, label="learned")
        _points(above, law, s, x, y)
        if curve.together is not None:
            _beside(above, curve.together, x, y)
        if law.formulas:
            like = law.formulas[0]
            at = np.where((s == 0.0) | ~_visited(s, seen), np.nan, s)
            above.plot(x * at, y * like.at(at), color=FORMULA, linestyle="--", linewidth=1.2,
                       label=_formula(law, like.form.name, units))  # fmt: skip
        above.set_ylabel(f"law at {curve.physics.at} [{made_unit}]")
        above.set_title(f"Unnamed law of {curve.over} at {curve.physics.at}")
        figure.legend(loc="outside lower center", ncols=1)
        below.hist(x * seen, bins=BINS, color="0.6")
        below.set_ylabel("samples")
        within = " within a turn" if curve.period > 0.0 else ""
        below.set_xlabel(f"{curve.over}{within} [{state_unit}]")
    return figure


def _formula(law: LearnedLaw, name: str, units: tuple[str, str]) -> str:
    """The formula with its units, or its name alone where the formula is long."""
    state, made = map(as_counted, units)
    lines = wrap(f"{name}: {law.formula} [{made}], {law.letter} in {state}", WIDE)
    return "\n".join(lines) if len(lines) <= LINES else name


def _visited(s: Floats, seen: Floats) -> NDArray[np.bool_]:
    """Where the recording was, of evenly spaced states: elsewhere a formula says nothing."""
    counts, edges = np.histogram(seen, bins=BINS)
    return counts[np.clip(np.digitize(s, edges) - 1, 0, BINS - 1)] > 0


def _turned(law: LearnedLaw, states: Floats) -> Floats:
    """States within one turn of a periodic law; other states as they are."""
    period, first = law.curve.period, float(law.curve.states[0])
    return states if period == 0.0 else first + np.mod(states - first, period)


def _samples(axes: Axes, law: LearnedLaw, x: float, y: float) -> None:
    """The law according to each sample of the recording."""
    states, forces = law.samples()
    every = max(1, states.size // SHOWN)
    states, forces = _turned(law, states)[::every], forces[::every]
    curve = law.curve
    edges = np.array([curve.forces, curve.lower, curve.upper])
    edges = np.array([edges, -edges]) if curve.odd else edges
    frame, beyond = framed(forces, float(edges.min(initial=0.0)), float(edges.max(initial=0.0)))
    axes.set_ylim(y * frame[0], y * frame[1])
    if not states.size:  # unknown for a free motion
        return
    look, where = samples_on(forces - law_at(curve.physics, states), frame)
    axes.plot(x * states, y * forces, ".", rasterized=True,
              label=f"needed at each sample{where}{beyond}", **look)  # fmt: skip


def _points(axes: Axes, law: LearnedLaw, s: Floats, x: float, y: float) -> None:
    """The points of the table with their band."""
    curve = law.curve
    for sign in (1.0, -1.0)[: 2 if curve.odd else 1]:
        there = (sign * curve.states >= s[0]) & (sign * curve.states <= s[-1])
        half = 0.5 * (curve.upper - curve.lower)
        axes.errorbar(
            x * sign * curve.states[there], y * sign * curve.forces[there], y * half[there],
            fmt="o", color=CURVE, markersize=3.5, linewidth=1.0, capsize=2.0,
            label="points of the table, 95 %" if sign > 0.0 else None,
        )  # fmt: skip


def _beside(axes: Axes, whole: Together, x: float, y: float) -> None:
    """The curve with the names that follow the same state there."""
    for side in (whole.states < 0.0, whole.states > 0.0):
        if not side.any():
            continue
        at = x * whole.states[side]
        axes.fill_between(at, y * whole.lower[side], y * whole.upper[side], color=TOGETHER,
                          alpha=0.25, linewidth=0.0)  # fmt: skip
        axes.plot(at, y * whole.forces[side], color=TOGETHER, linewidth=1.4)
    axes.plot([], [], color=TOGETHER, linewidth=1.4,
              label=f"with {' and '.join(whole.names).replace('_', ' ')}, 95 %")  # fmt: skip
