"""An experiment before it is run: device, external forces, duration."""

from typing import TYPE_CHECKING

import numpy as np

from zwidth.scenarios.scenario import Scenario
from zwidth.sim.trace import Floats, Trace
from zwidth.views import trace as signals
from zwidth.views.table import Table, number
from zwidth.views.units import units

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset


def table(scenario: Scenario) -> Table:
    """Return a row for each external force."""
    unit, law = units(scenario.device.rotary), scenario.controller
    facts = ", ".join(f"{k} {v:g}" for k, v in law.facts.items() if isinstance(v, float))
    said = [
        f"Controller: {law.kind}" + (f" ({facts})" if facts else ""),
        f"Start: position {scenario.start.position} {unit.length},"
        f" velocity {scenario.start.velocity} {unit.length}/s",
    ]
    headings = ("disturbance", "at", f"amplitude [{unit.force}]", "from [s]", "to [s]")
    end = scenario.duration
    grid = [
        [d.kind, d.at, number(d.amplitude), number(d.from_s), number(min(d.to_s, end))]
        for d in scenario.disturbances
    ]  # fmt: skip
    title = f"Scenario on {scenario.device.name}: {scenario.duration:g} s, {scenario.ticks} ticks"
    return Table(title, said, headings, grid)


def _forces(scenario: Scenario) -> Trace:
    """What acts over time: the disturbances, and a recorded command."""
    force, ticks = units(scenario.device.rotary).force, scenario.ticks
    outside = scenario.forces()
    outside = np.zeros((ticks, scenario.masses)) if outside is None else outside
    channels = {f"disturbance_m{i + 1}": column for i, column in enumerate(outside.T)}
    moved = channels.pop(f"disturbance_m{scenario.masses + 1}", None)
    units_of = dict.fromkeys(channels, force)
    if moved is not None:
        channels["base"] = moved
        units_of["base"] = "rad/s2" if scenario.device.rotary else "m/s2"
    if scenario.controller.kind == "recorded":
        channels |= {"command": _fitted(scenario.controller.parameters, ticks)}
        units_of["command"] = force
    t = np.arange(ticks, dtype=np.float64) * scenario.device.interface.period
    facts = {"device": scenario.device.name}
    return Trace(t, channels, units_of, "simulated", facts)


def _fitted(command: Floats, ticks: int) -> Floats:
    """The command over the run: cut at its end, zero after the command's own."""
    return np.pad(command[:ticks], (0, max(0, ticks - command.size)))


def dataset(scenario: Scenario) -> "Dataset":
    """Return the external forces, and a recorded command, over time."""
    return signals.dataset(_forces(scenario))


def _drawn(scenario: Scenario) -> "Figure":
    from zwidth.figures.channels import channels_figure

    what = f"{scenario.device.name}, {scenario.controller.kind}: what acts from outside"
    return channels_figure(_forces(scenario), what)


PICTURES = {"forces": _drawn}
