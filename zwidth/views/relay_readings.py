"""What a relay reads of a device, beside the linear boundary."""

from typing import TYPE_CHECKING

from zwidth.identification.cycles import RelayReadings
from zwidth.identification.relay import waveform
from zwidth.stability.linear import critical_stiffness
from zwidth.views.table import Table, number
from zwidth.views.units import numbers, rows, units

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

SHOWN_S = 0.4


def table(found: RelayReadings) -> Table:
    """Return a row a damping."""
    unit = units(found.device.rotary)
    in_k = f"[{unit.stiffness}]"
    headings = (f"B [{unit.damping}]", "verdict", f"K relay {in_k}", "f [Hz]",
                f"K linear {in_k}", "limit cycles", "diverge")  # fmt: skip
    grid = [
        [number(c.damping), c.reference.verdict, number(c.reference.stiffness),
         number(c.reference.frequency_hz), number(linear), str(len(c.cycles)),
         f"{100.0 * c.diverging:.0f} %"]
        for c, linear in zip(found.conditions, _linear(found), strict=True)
    ]  # fmt: skip
    force = f"relay of {number(found.test.force)} {unit.force}"
    delay = f"delay {1e3 * found.device.interface.delay:g} ms"
    return Table(f"Relay on {found.device.name}, {force}, {delay}", (), headings, grid)


def _linear(found: RelayReadings) -> list[float | None]:
    return [critical_stiffness(found.device, c.damping).stiffness for c in found.conditions]


def dataset(found: RelayReadings) -> "Dataset":
    """Return what the relay reads over the damping B; NaN where it does not oscillate."""
    unit, each = units(found.device.rotary), found.conditions
    columns = {
        "stiffness": (numbers([c.reference.stiffness for c in each]), unit.stiffness),
        "frequency": (numbers([c.reference.frequency_hz for c in each]), "Hz"),
        "amplitude": (numbers([c.reference.amplitude for c in each]), unit.length),
        "linear": (numbers(_linear(found)), unit.stiffness),
        "diverging": (numbers([c.diverging for c in each]), ""),
        "undecided": (numbers([c.undecided for c in each]), ""),
        "verdict": ([c.reference.verdict for c in each], None),
    }
    facts = {"device": found.device.name, "relay_force": found.test.force}
    dampings = (numbers([c.damping for c in each]), unit.damping)
    return rows("damping", dampings, columns, facts)


def _drawn(found: RelayReadings) -> "Figure":
    from zwidth.figures.relay import relay_figure

    steady = [c.damping for c in found.conditions if c.reference.verdict == "oscillates"]
    if not steady:
        raise ValueError("the relay loop oscillates at none of these dampings; nothing to draw")
    return relay_figure(waveform(found.device, steady[0], SHOWN_S, found.test))


PICTURES = {"waveform": _drawn}
