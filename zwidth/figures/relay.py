"""Fig. 8, a relay experiment in steady state, and the relay's bias over conditions and physics."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from zwidth.figures.style import STYLE
from zwidth.identification.relay import Waveform

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Sweep:
    """One quantity changed: its values, K by relay and true K, each (n,), NaN for none."""

    label: str
    values: Floats
    relay: Floats
    true: Floats
    logarithmic: bool = False


def relay_figure(wave: Waveform) -> Figure:
    """Return relay force and position over time."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.2), layout="constrained")
        force, position = figure.subplots(2, 1, sharex=True)
        force.step(wave.t, wave.force, where="post", color="#BB5566")
        force.set_ylabel("relay force [N m]")
        position.plot(wave.t, 1e3 * wave.position, color="#004488")
        position.set_ylabel("position [mrad]")
        position.set_xlabel("time in steady state [s]")
        position.set_xlim(0.0, float(wave.t[-1]))
    return figure


def relay_bias_figure(
    labels: Sequence[str],
    reference: Sequence[float | None],
    cycles: Sequence[Sequence[float]],
) -> Figure:
    """Return K by relay over the true boundary, a row a condition."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 0.8 + 0.24 * len(labels)), layout="constrained")
        axes = figure.subplots()
        axes.axvline(1.0, color="black", linewidth=0.8)
        for i, (one, all_of_them) in enumerate(zip(reference, cycles, strict=True)):
            axes.plot(all_of_them, [i] * len(all_of_them), linestyle="none", marker=".",
                      markersize=7, color="#004488")  # fmt: skip
            if one is not None:
                axes.plot(one, i, marker="o", markersize=9, markerfacecolor="none",
                          markeredgecolor="#BB5566", markeredgewidth=1.4)  # fmt: skip
        axes.set_yticks(np.arange(len(labels)), labels)
        axes.invert_yaxis()
        axes.set_ylabel("delay, $B$ [N m s/rad]")
        axes.set_xscale("log")
        ticks = (0.2, 0.5, 0.8, 1.0, 1.25, 1.5, 1.75, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
        low, high = axes.get_xlim()
        shown = [t for t in ticks if low <= t <= high]
        axes.set_xticks(shown, [f"{t:g}" for t in shown])
        axes.set_xticks([], minor=True)
        axes.set_xlabel("$K$ by relay over the linear boundary")
    return figure


def relay_sweeps_figure(sweeps: Sequence[Sweep], linear: float) -> Figure:
    """Return one panel a sweep: K by relay and by bisection over what is changed."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 3.3), layout="constrained")
        panels = figure.subplots(1, len(sweeps), sharey=True, squeeze=False)[0]
        for axes, sweep in zip(panels, sweeps, strict=True):
            axes.axhline(linear, color="0.5", linewidth=1.0, linestyle=(0, (5, 2)))
            axes.plot(sweep.values, sweep.true, color="#004488", marker=".", markersize=5)
            axes.plot(sweep.values, sweep.relay, linestyle="none", marker="o", markersize=7,
                      markerfacecolor="none", markeredgecolor="#BB5566",
                      markeredgewidth=1.4)  # fmt: skip
            if sweep.logarithmic:
                axes.set_xscale("log")
            else:
                axes.locator_params(axis="x", nbins=4)
            axes.set_xlabel(sweep.label)
        panels[0].set_ylabel("$K$ [N m/rad]")
        panels[0].set_ylim(bottom=0.0)
        handles = [
            Line2D([], [], color="#BB5566", linestyle="none", marker="o", markerfacecolor="none",
                   label="relay"),
            Line2D([], [], color="#004488", marker=".", label="bisection, same physics"),
            Line2D([], [], color="0.5", linewidth=1.0, linestyle=(0, (5, 2)), label="linear"),
        ]  # fmt: skip
        figure.legend(handles=handles, loc="outside upper left", ncols=3, frameon=False, fontsize=9)
    return figure
