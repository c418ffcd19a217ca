"""A law of no name: its curve with its band, the formula that it looks like, where it was seen."""

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from zwidth.diagnosis.answer.learned import LearnedLaw
from zwidth.diagnosis.learning.curves import law_at
from zwidth.figures.style import STYLE
from zwidth.sim.readable import scaled

CURVE, FORMULA = "#004488", "#bb5566"
FINE = 400  # states that a curve is drawn at
BINS = 60


def learned_figure(law: LearnedLaw, rotary: bool) -> Figure:
    """Return what was learned over the state that it follows, and how often that was visited."""
    curve = law.curve
    state_unit, made_unit = (
        p.unit_for(rotary)
        for p in (curve.physics.effect.parameters[1], curve.physics.effect.parameters[-1])
    )
    s = np.linspace(curve.seen.min(), curve.seen.max(), FINE)
    f = law_at(curve.physics, s)
    x, state_unit = scaled(float(np.abs(s).max()), state_unit)
    y, made_unit = scaled(float(np.abs(f).max()), made_unit)
    with rc_context(STYLE):
        figure = Figure(figsize=(6.4, 4.6), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (4, 1)})
        above.axhline(0.0, color="0.6", linewidth=0.8)
        above.plot(x * s, y * f, color=CURVE, linewidth=1.4, label="learned")
        for sign in (1.0, -1.0)[: 2 if curve.odd else 1]:
            there = (sign * curve.states >= s[0]) & (sign * curve.states <= s[-1])
            half = 0.5 * (curve.upper - curve.lower)
            above.errorbar(
                x * sign * curve.states[there], y * sign * curve.forces[there], y * half[there],
                fmt="o", color=CURVE, markersize=3.5, linewidth=1.0, capsize=2.0,
                label="its points, 95 %" if sign > 0.0 else None,
            )  # fmt: skip
        if law.formulas:
            like = law.formulas[0]
            above.plot(x * s, y * like.at(s), color=FORMULA, linestyle="--", linewidth=1.2,
                       label=f"{like.form.name}: {law.formula}")  # fmt: skip
        above.set_ylabel(f"law at {curve.physics.at} [{made_unit}]")
        above.set_title(f"What follows {curve.over} at {curve.physics.at} and has no name")
        figure.legend(loc="outside lower center", ncols=1)
        below.hist(x * curve.seen, bins=BINS, color="0.6")
        below.set_ylabel("samples")
        below.set_xlabel(f"{curve.over} [{state_unit}]")
    return figure
