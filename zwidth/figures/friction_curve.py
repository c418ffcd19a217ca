"""Friction as a curve against velocity, with its band and the force that each sample needs."""

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from numpy.typing import NDArray

from zwidth.diagnosis.answer.friction_curve import FrictionCurve
from zwidth.diagnosis.answer.words import effect_in_words
from zwidth.diagnosis.learning.together import Together
from zwidth.figures.samples import framed, samples_on
from zwidth.figures.style import AFTER, STYLE, pushing
from zwidth.sim.readable import scaled, with_unit

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
CURVE = AFTER
SHOWN = 4000  # most samples that are drawn
SEEN = 0.03  # of the frame: a narrower band is hidden by the line, and is given in numbers
WIDE = 90  # letters in a line of the legend, whose columns have the width of the longest


def friction_curve_figure(curve: FrictionCurve, rotary: bool) -> Figure:
    """Return the force over velocity at a place, as a resistance: positive against v > 0."""
    whole = curve.whole
    x, speed = scaled(float(np.abs(whole.states).max()), "rad/s" if rotary else "m/s")
    y, force = scaled(float(np.abs(whole.forces).max()), pushing(rotary)[1])
    every = max(1, curve.velocities.size // SHOWN)
    inside = (curve.velocities >= whole.states[0]) & (curve.velocities <= whole.states[-1])
    v = curve.velocities[inside][::every]
    asked = -curve.forces[inside][::every]
    edges = -np.array([whole.lower, whole.upper, whole.forces])
    frame, beyond = framed(asked, float(edges.min(initial=0.0)), float(edges.max(initial=0.0)))
    ways = [whole.states < 0.0, whole.states > 0.0]  # friction jumps between them
    look, where = samples_on(asked + _law(whole, v, ways), frame)
    half = 0.5 * float(np.max(whole.upper - whole.lower))
    if 2.0 * half > SEEN * (frame[1] - frame[0]):
        band = ", with its 95 % band"
    else:
        band = f" (95 % within ±{with_unit(half, pushing(rotary)[1], 2)})" if half > 0.0 else ""
    what = pushing(rotary)[0]
    with rc_context(STYLE):
        figure = Figure(figsize=(6.4, 4.2), layout="constrained")
        axes = figure.subplots()
        axes.axhline(0.0, color="0.6", linewidth=0.8)
        if asked.size:  # unknown for a free motion
            axes.plot(x * v, y * asked, ".", rasterized=True,
                      label=f"{what} needed at each sample{where}{beyond}", **look)  # fmt: skip
        for side in ways:
            if not side.any():
                continue
            at = x * whole.states[side]
            axes.fill_between(at, -y * whole.lower[side], -y * whole.upper[side], color=CURVE,
                              alpha=0.25, linewidth=0.0)  # fmt: skip
            axes.plot(at, -y * whole.forces[side], color=CURVE, linewidth=1.4)
        names = " and ".join(effect_in_words(name) for name in whole.names)
        axes.plot([], [], color=CURVE, linewidth=1.4, label=f"{names}{band}")
        axes.set_ylim(y * frame[0], y * frame[1])
        axes.set_xlabel(f"velocity of {curve.at} [{speed}]")
        axes.set_ylabel(f"resistance at {curve.at} [{force}]")
        axes.set_title("The friction that was found, against velocity")
        labels = axes.get_legend_handles_labels()[1]
        columns = 1 if 2 * max(len(str(label)) for label in labels) > WIDE else 2
        figure.legend(loc="outside lower center", ncols=columns, markerscale=2.0)
    return figure


def _law(whole: Together, v: Floats, ways: Sequence[Flags]) -> Floats:
    """The law's forces at velocities (samples,), each from the side of its sign."""
    sides = [
        np.interp(v, whole.states[side], whole.forces[side]) if side.any() else np.zeros(v.size)
        for side in ways
    ]
    return np.where(v < 0.0, *sides)
