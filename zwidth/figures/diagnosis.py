"""Pictures of a diagnosis: the missing force against the state, the residual before and after."""

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.signal import welch

from zwidth.diagnosis.answer.result import Residuals
from zwidth.diagnosis.answer.whole_run import WholeRun
from zwidth.diagnosis.forces.locate import Located
from zwidth.figures.style import STYLE

Floats = NDArray[np.float64]
BEFORE, AFTER = "#bb5566", "#004488"
SLICES = 60
MOST_POINTS = 4000
ROOM = 1.4  # of the motion, for the legend


def force_map_figure(located: Located, rotary: bool) -> Figure:
    """Return the missing force at the likeliest place against position, velocity, command and time.

    Bars: one standard error. A flat line at zero means that nothing is missing there.
    """
    top = max(located.maps, key=lambda m: m.gained)
    force, length = ("N m", "rad") if rotary else ("N", "m")
    units = {"position": length, "velocity": f"{length}/s", "command": force, "time": "s"}
    maps = [m for m in located.maps if m.place == top.place]
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 5.0), layout="constrained")
        panels = figure.subplots(2, 2, squeeze=False).ravel()
        for axes in panels[len(maps) :]:  # of a free motion there is no command
            axes.remove()
        for axes, m in zip(panels, maps, strict=False):
            middle = 0.5 * (m.edges[1:] + m.edges[:-1])
            axes.axhline(0.0, color="0.6", linewidth=0.8)
            axes.errorbar(
                middle, m.force, m.error, 0.5 * np.diff(m.edges),
                fmt="o", color=AFTER, markersize=3.5, linewidth=1.2,
            )  # fmt: skip
            axes.set_xlabel(f"{m.against} [{units[m.against]}]")
            axes.set_title(f"chi-square {m.gained:.0f}", fontsize=9)
            axes.ticklabel_format(axis="y", scilimits=(-3, 3))
            axes.locator_params(axis="x", nbins=4)
        for axes in panels[: len(maps) : 2]:
            axes.set_ylabel(f"missing force at {top.place} [{force}]")
    return figure


def whole_run_figure(run: WholeRun) -> Figure:
    """Return what was measured beside free runs of the refit and of what was found, errors below.

    Runs that leave the picture are cut where they leave it.
    """
    t = run.begins + run.period * np.arange(run.measured.size)
    words = {"refit": ("refitted alone", BEFORE), "after": ("with what was found", AFTER)}
    shown = max(1, t.size // MOST_POINTS)
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.2), layout="constrained")
        motion, error = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
        motion.plot(
            t[::shown], run.measured[::shown], color="0.15", linewidth=1.6, label="measured"
        )
        for name, (label, colour) in words.items():
            simulated = run.simulated[name]
            with np.errstate(all="ignore"):
                off = simulated - run.measured
            style = {"color": colour, "linewidth": 1.0}
            motion.plot(t[::shown], simulated[::shown], linestyle="--", label=label, **style)
            said = (
                f"{label}: {run.errors[name]:.3g} {run.unit} rms, {100.0 * run.shares[name]:.3g} %"
            )
            error.plot(t[::shown], off[::shown], label=said, **style)
        middle = float(run.measured.mean())
        reach = ROOM * float(np.abs(run.measured - middle).max())
        motion.set_ylim(middle - reach, middle + reach)
        errors = [run.errors[name] for name in words if np.isfinite(run.errors[name])]
        error.set_ylim(-(most := min(reach, 4.0 * max(errors, default=reach)) or 1.0), most)
        error.axhline(0.0, color="0.6", linewidth=0.8)
        quantity, at = run.output.split("_")
        motion.set_ylabel(f"{quantity} of {at} [{run.unit}]")
        error.set_ylabel(f"error [{run.unit}]")
        error.set_xlabel("time [s]")
        held = "nothing was fitted to it" if run.held_out else "it was fitted"
        motion.set_title(f"{run.recording}, simulated freely; {held}", fontsize=9)
        for axes in (motion, error):
            axes.legend(loc="upper right", fontsize=7, ncols=3)
            axes.ticklabel_format(axis="y", scilimits=(-3, 3))
    return figure


def residual_figure(residuals: Residuals) -> Figure:
    """Return the rms of the innovations over time, and their spectrum, before and after.

    Both in units of the noise model: where nothing is missing they lie at one.
    """
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 3.0), layout="constrained")
        over_time, spectrum = figure.subplots(1, 2)
        for values, colour, label in (
            (residuals.before, BEFORE, "linear refit"),
            (residuals.after, AFTER, "with what was found"),
        ):
            _over_time(over_time, values, residuals.period, colour, label)
            _spectrum(spectrum, values, residuals.period, colour)
        for axes in (over_time, spectrum):
            axes.axhline(1.0, color="0.4", linestyle=":", linewidth=1.0, label="white noise")
        over_time.set_xlabel("time [s]")
        over_time.set_ylabel("residual, rms over its noise")
        over_time.set_ylim(bottom=0.0)
        spectrum.set_xlabel("frequency [Hz]")
        spectrum.set_ylabel("power over white noise")
        handles, labels = over_time.get_legend_handles_labels()
        figure.legend(
            handles, labels, loc="outside upper center", ncols=3, frameon=False, fontsize=8
        )
    return figure


def _over_time(axes: Axes, values: Floats, period: float, colour: str, label: str) -> None:
    pieces = np.array_split((values**2).mean(axis=1), min(SLICES, values.shape[0]))
    edges = np.cumsum([0, *(p.size for p in pieces)]) * period
    steps = [float(np.sqrt(p.mean())) for p in pieces]
    axes.stairs(steps, edges, baseline=None, color=colour, label=label)


def _spectrum(axes: Axes, values: Floats, period: float, colour: str) -> None:
    size = min(1024, values.shape[0])
    frequency, power = welch(values, 1.0 / period, nperseg=size, axis=0)
    # A one-sided density has its first and its Nyquist bin once, all others twice.
    twice = (frequency > 0.0) & (frequency < 0.499 / period)
    density = power[twice].mean(axis=1) / (2.0 * period)
    axes.loglog(frequency[twice], density, color=colour, linewidth=1.1)
