"""Friction as a curve over velocity, with its band and the force that each sample needs."""

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from zwidth.diagnosis.answer.friction_curve import FrictionCurve
from zwidth.diagnosis.answer.words import effect_in_words
from zwidth.figures.style import AFTER, MEASURED, STYLE
from zwidth.sim.readable import scaled

CURVE, SAMPLES = AFTER, MEASURED
SHOWN = 4000  # samples, at most
TALL = 2.5  # times the curve's height, within which samples are shown
TALL_FRAME = 1.05  # times the tallest that is shown, where samples lie beyond it
WIDE = 75  # letters that a line holds of a legend, whose columns are as wide as the longest


def friction_curve_figure(curve: FrictionCurve, rotary: bool) -> Figure:
    """Return what acts over the velocity at a place, as a resistance: positive against v > 0."""
    whole = curve.whole
    x, speed = scaled(float(np.abs(whole.states).max()), "rad/s" if rotary else "m/s")
    y, force = scaled(float(np.abs(whole.forces).max()), "N m" if rotary else "N")
    tall = TALL * float(np.abs(whole.forces).max())
    every = max(1, curve.velocities.size // SHOWN)
    inside = (curve.velocities >= whole.states[0]) & (curve.velocities <= whole.states[-1])
    v = curve.velocities[inside][::every]
    asked = -curve.forces[inside][::every]
    outside = float(np.mean(np.abs(asked) > tall)) if asked.size else 0.0
    beyond = f", {100.0 * outside:.0f} % of them beyond the frame" if outside > 0.0 else ""
    with rc_context(STYLE):
        figure = Figure(figsize=(6.4, 4.2), layout="constrained")
        axes = figure.subplots()
        axes.axhline(0.0, color="0.6", linewidth=0.8)
        if asked.size:  # of a free motion none is known
            axes.plot(x * v, y * asked, ".", color=SAMPLES, markersize=3.2, rasterized=True,
                      label=f"force needed at each sample{beyond}")  # fmt: skip
        for side in (whole.states < 0.0, whole.states > 0.0):
            if not side.any():
                continue
            at = x * whole.states[side]
            axes.fill_between(at, -y * whole.lower[side], -y * whole.upper[side], color=CURVE,
                              alpha=0.25, linewidth=0.0)  # fmt: skip
            axes.plot(at, -y * whole.forces[side], color=CURVE, linewidth=1.4)
        names = " and ".join(effect_in_words(name) for name in whole.names)
        axes.plot([], [], color=CURVE, linewidth=1.4, label=f"{names}, with its 95 % band")
        if outside > 0.0:
            axes.set_ylim(-TALL_FRAME * y * tall, TALL_FRAME * y * tall)
        axes.set_xlabel(f"velocity of {curve.at} [{speed}]")
        axes.set_ylabel(f"resistance at {curve.at} [{force}]")
        axes.set_title("The friction that was found, over velocity")
        labels = axes.get_legend_handles_labels()[1]
        columns = 1 if 2 * max(len(str(label)) for label in labels) > WIDE else 2
        figure.legend(loc="outside lower center", ncols=columns, markerscale=2.0)
    return figure
