"""Fig. 8, a relay experiment in steady state, and the relay's bias over conditions and physics."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from zwidth.figures.style import AFTER, BEFORE, COLOURS, DASHES, STYLE, headed
from zwidth.identification.cycles import Cycle, RelayCondition
from zwidth.identification.relay import RelayTest, Waveform
from zwidth.sim.device import Device
from zwidth.sim.readable import scaled, with_unit
from zwidth.stability.linear import boundary, has_theory, last_stable_damping

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Sweep:
    """One quantity changed: its values, K by relay, true K, each (n,), NaN for none.

    rests (n,): the K up to which walls also come to rest, NaN if this was not requested.
    """

    label: str
    values: Floats
    relay: Floats
    true: Floats
    rests: Floats
    logarithmic: bool = False


def relay_figure(wave: Waveform, title: str = "", rotary: bool = True) -> Figure:
    """Return relay force and position over time. title: the condition."""
    force_unit, length = ("N m", "rad") if rotary else ("N", "m")
    push, pushed = scaled(float(np.abs(wave.force).max()), force_unit)
    by, unit = scaled(float(np.abs(wave.position).max()), length)
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.2), layout="constrained")
        force, position = figure.subplots(2, 1, sharex=True)
        force.step(wave.t, push * wave.force, where="post", color=BEFORE)
        force.set_ylabel(f"relay {'torque' if rotary else 'force'} [{pushed}]")
        position.plot(wave.t, by * wave.position, color=AFTER)
        position.set_ylabel(f"position [{unit}]")
        position.set_xlabel("time in steady state [s]")
        position.set_xlim(0.0, float(wave.t[-1]))
        if title:
            headed(figure, title)
    return figure


def relay_title(device: Device, c: RelayCondition, cycle: Cycle, test: RelayTest) -> str:
    """Return the title of a run's picture: the condition, and the cycle that it shows."""
    force, length = ("N m", "rad") if device.rotary else ("N", "m")
    whose = f"the cycle of {100.0 * cycle.share:.0f} % of the starts"
    whose = whose if cycle.share else "from the reference start"
    return (
        f"{device.name}: relay of \u00b1{with_unit(test.force, force)},"
        f" delay {1e3 * c.delay:g} ms, B = {c.damping:g} {force} s/{length},\n{whose}:"
        f" K = {cycle.stiffness:.4g} {force}/{length} at {cycle.frequency_hz:.3g} Hz"
    )


def relay_boundary_figure(
    devices: Sequence[Device], conditions: Sequence[RelayCondition]
) -> Figure:
    """Return K by relay over B beside the linear boundary, with a colour per delay.

    Discs: the cycles, with an area proportional to the share of the starts that end on them; a ring
    around that of the reference start. Crosses on the axis: conditions that diverge.
    """
    force, length = ("N m", "rad") if devices[0].rotary else ("N", "m")
    delays = list(dict.fromkeys(c.delay for c in conditions))
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.8), layout="constrained")
        axes = figure.subplots()
        handles: list[Line2D] = []
        for i, delay in enumerate(delays):
            mine = [(d, c) for d, c in zip(devices, conditions, strict=True) if c.delay == delay]
            colour, dashes = COLOURS[i % len(COLOURS)], DASHES[i % len(DASHES)]
            _linear_line(axes, mine[0][0], max(c.damping for _, c in mine), colour, dashes)
            for _, c in mine:
                _cycles(axes, c, colour)
            handles.append(
                Line2D([], [], color=colour, linestyle=dashes, marker="o", markersize=6,
                       label=f"delay {1e3 * delay:g} ms")
            )  # fmt: skip
        grey: dict[str, Any] = {"color": "0.35", "linestyle": "none"}
        handles += [
            *(
                [Line2D([], [], color="0.35", label="line: linear boundary")]
                if any(map(has_theory, devices)) else []
            ),
            Line2D([], [], marker="o", markersize=8, alpha=0.6, **grey,
                   label="cycle found by the relay (area: share of starts)"),
            Line2D([], [], marker="o", markersize=9, markerfacecolor="none", **grey,
                   label="of the reference start"),
            Line2D([], [], marker="x", **grey, label="most starts diverge"),
        ]  # fmt: skip
        axes.set_xlabel(f"virtual damping $B$ [{force} s/{length}]")
        axes.set_ylabel(f"$K$ [{force}/{length}]")
        axes.set_ylim(bottom=0.0)
        axes.set_title(f"{devices[0].name}: critical stiffness by relay")
        figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def _linear_line(axes: Axes, device: Device, furthest: float, colour: str, dashes: Any) -> None:
    """The linear boundary, to its end or a little beyond the requested range."""
    if not has_theory(device):
        return
    last = last_stable_damping(device)
    if last is None or last <= 0.0:
        return
    grid: Floats = np.linspace(0.0, min(last * (1.0 - 1e-6), 1.1 * furthest or last), 201)
    points = [(p.damping, p.stiffness) for p in boundary(device, grid) if p.stiffness is not None]
    x, y = zip(*points, strict=True)
    axes.plot(x, y, color=colour, linestyle=dashes, linewidth=1.3)


def _cycles(axes: Axes, c: RelayCondition, colour: str) -> None:
    for cycle in c.cycles:
        axes.scatter(c.damping, cycle.stiffness, s=6.0 + 90.0 * cycle.share, color=colour,
                     alpha=0.6, linewidths=0.0, zorder=3)  # fmt: skip
    if c.reference.stiffness is not None:
        axes.plot(c.damping, c.reference.stiffness, marker="o", markersize=11, color=colour,
                  markerfacecolor="none", markeredgewidth=1.0, zorder=4)  # fmt: skip
    if c.verdict == "diverges":
        axes.plot(c.damping, 0.0, marker="x", markersize=6, color=colour, clip_on=False, zorder=5)


def relay_bias_figure(
    labels: Sequence[str],
    reference: Sequence[float | None],
    cycles: Sequence[Sequence[float]],
) -> Figure:
    """Return K by relay over the true boundary, a row per condition."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 0.8 + 0.24 * len(labels)), layout="constrained")
        axes = figure.subplots()
        axes.axvline(1.0, color="black", linewidth=0.8)
        for i, (one, all_of_them) in enumerate(zip(reference, cycles, strict=True)):
            axes.plot(all_of_them, [i] * len(all_of_them), linestyle="none", marker=".",
                      markersize=7, color=AFTER)  # fmt: skip
            if one is not None:
                axes.plot(one, i, marker="o", markersize=9, markerfacecolor="none",
                          markeredgecolor=BEFORE, markeredgewidth=1.4)  # fmt: skip
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
    """Return one panel per sweep: K by relay and by bisection over the changed quantity."""
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 3.3), layout="constrained")
        panels = figure.subplots(1, len(sweeps), sharey=True, squeeze=False)[0]
        for axes, sweep in zip(panels, sweeps, strict=True):
            axes.axhline(linear, color="0.5", linewidth=1.0, linestyle=(0, (5, 2)))
            axes.plot(sweep.values, sweep.true, color=AFTER, marker=".", markersize=5)
            axes.plot(sweep.values, sweep.rests, color=AFTER, linestyle=":")
            axes.plot(sweep.values, sweep.relay, linestyle="none", marker="o", markersize=7,
                      markerfacecolor="none", markeredgecolor=BEFORE,
                      markeredgewidth=1.4)  # fmt: skip
            if sweep.logarithmic:
                axes.set_xscale("log")
            else:
                axes.locator_params(axis="x", nbins=4)
            axes.set_xlabel(sweep.label)
        panels[0].set_ylabel("$K$ [N m/rad]")
        panels[0].set_ylim(bottom=0.0)
        handles = [
            Line2D([], [], color=BEFORE, linestyle="none", marker="o", markerfacecolor="none",
                   label="relay"),
            Line2D([], [], color=AFTER, marker=".", label="bisection, same physics"),
            Line2D([], [], color=AFTER, linestyle=":", label="comes to rest"),
            Line2D([], [], color="0.5", linewidth=1.0, linestyle=(0, (5, 2)), label="linear"),
        ]  # fmt: skip
        figure.legend(handles=handles, loc="outside upper left", ncols=4)
    return figure
