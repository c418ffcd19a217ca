"""The relay readings of a device, beside the linear boundary."""

from typing import TYPE_CHECKING

from zwidth.identification.cycles import RelayCondition, RelayReadings
from zwidth.identification.relay import waveform
from zwidth.sim.run import Start
from zwidth.stability.linear import known_boundary
from zwidth.views.table import Table, number
from zwidth.views.units import numbers, rows, units

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

SHOWN_S = 0.4


def table(found: RelayReadings) -> Table:
    """Return a row per damping."""
    unit = units(found.device.rotary)
    in_k = f"[{unit.stiffness}]"
    headings = (f"B [{unit.damping}]", "verdict", "share of starts", f"K relay {in_k}", "f [Hz]",
                f"K linear {in_k}", "limit cycles", "diverge")  # fmt: skip
    grid = [
        [number(c.damping), c.verdict, _share(c), number(c.read and c.read.stiffness),
         number(c.read and c.read.frequency_hz), number(linear), str(len(c.cycles)),
         f"{100.0 * c.diverging:.0f} %"]
        for c, linear in zip(found.conditions, _linear(found), strict=True)
    ]  # fmt: skip
    force = f"relay of {number(found.test.force)} {unit.force}"
    delay = f"delay {1e3 * found.device.interface.delay:g} ms"
    return Table(f"Relay on {found.device.name}, {force}, {delay}", (), headings, grid)


def _share(c: RelayCondition) -> str:
    """Of the starts those that end on the cycle that is read."""
    return f"{100.0 * c.read.share:.0f} %" if c.read is not None and c.read.share else "-"


def _linear(found: RelayReadings) -> list[float | None]:
    dampings = [c.damping for c in found.conditions]
    return [point.stiffness for point in known_boundary(found.device, dampings)]


def dataset(found: RelayReadings) -> "Dataset":
    """Return the relay's readings over B: the most frequent cycle, NaN if there is none.

    share: of the starts that end on it; reference: the reading from the published start alone.
    """
    unit, each = units(found.device.rotary), found.conditions
    columns = {
        "stiffness": (numbers([c.read and c.read.stiffness for c in each]), unit.stiffness),
        "frequency": (numbers([c.read and c.read.frequency_hz for c in each]), "Hz"),
        "amplitude": (numbers([c.read and c.read.amplitude for c in each]), unit.length),
        "share": (numbers([c.read and c.read.share for c in each]), ""),
        "reference": (numbers([c.reference.stiffness for c in each]), unit.stiffness),
        "linear": (numbers(_linear(found)), unit.stiffness),
        "diverging": (numbers([c.diverging for c in each]), ""),
        "undecided": (numbers([c.undecided for c in each]), ""),
        "verdict": ([c.verdict for c in each], None),
    }
    facts = {"device": found.device.name, "relay_force": found.test.force}
    dampings = (numbers([c.damping for c in each]), unit.damping)
    return rows("damping", dampings, columns, facts)


def _boundary(found: RelayReadings) -> "Figure":
    from zwidth.figures.relay import relay_boundary_figure

    return relay_boundary_figure([found.device] * len(found.conditions), found.conditions)


def _waveform(found: RelayReadings) -> "Figure":
    from zwidth.figures.relay import relay_figure, relay_title

    steady = [(c, c.read) for c in found.conditions if c.read is not None]
    if not steady:
        raise ValueError("the relay loop oscillates at none of these dampings; nothing to draw")
    c, cycle = steady[-1]
    start = None if cycle.start is None else Start(*cycle.start)
    wave = waveform(found.device, c.damping, SHOWN_S, found.test, start)
    title = relay_title(found.device, c, cycle, found.test)
    return relay_figure(wave, title, found.device.rotary)


PICTURES = {"boundary": _boundary, "waveform": _waveform}
