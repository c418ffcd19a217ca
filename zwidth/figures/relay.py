"""Fig. 8, a relay experiment in steady state, and the relay's bias over conditions."""

from collections.abc import Sequence

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure

from identification.relay import Waveform
from zwidth.figures.style import STYLE


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
