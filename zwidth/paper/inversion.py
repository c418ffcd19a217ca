"""Each row of Table II read as a measurement of the plant: where Table I's model differs, and how.

The computation is in `scenarios/inversion.py`.
"""

from typing import NamedTuple

import numpy as np

from zwidth.figures.inversion import PlantPoints, inversion_figure
from zwidth.paper.content import Picture, Section, Table
from zwidth.paper.theory import COLOUR, DELAYS, SHAPE, ms, phantom
from zwidth.scenarios.inversion import inverted
from zwidth.scenarios.misprints import JUMPED_HZ
from zwidth.scenarios.table_2 import MeasuredPoint, measured_at

COMMAND = "zwidth paper --section inversion"


class Measured(NamedTuple):
    """The plant at a row: frequency [Hz], measured over model (complex), excess damping."""

    frequency: float
    ratio: complex
    damping: float


def plant_at(row: MeasuredPoint) -> Measured:
    """Invert a row at its (corrected) damping."""
    device = phantom(0.0)
    assert device.modal is not None
    point = inverted(row, device.modal, device.interface.period)
    wall = (row.stiffness, row.place)
    return Measured(row.frequency, point.ratio(*wall), point.excess_damping(*wall))


def section() -> Section:
    """Return ratio and phase over frequency, the table, and their interpretation."""
    found = {delay: [(row, plant_at(row)) for row in measured_at(delay)] for delay in DELAYS}
    points = [
        PlantPoints(
            ms(delay), COLOUR[delay], SHAPE[delay],
            np.array([m.frequency for _, m in pairs]), np.array([m.ratio for _, m in pairs]),
        )
        for delay, pairs in found.items()
    ]  # fmt: skip
    rows = [
        [ms(row.delay), f"{row.place:g}", f"{m.frequency:g}", f"{abs(m.ratio):.2f}",
         f"{np.degrees(np.angle(m.ratio)):+.0f}",
         f"{m.damping:+.4f}" if m.frequency < JUMPED_HZ else ""]
        for pairs in found.values()
        for row, m in pairs
    ]  # fmt: skip
    first = found[0.002][0][1]
    fast = [m for pairs in found.values() for _, m in pairs if m.frequency > JUMPED_HZ]
    leads = [float(np.degrees(np.angle(m.ratio))) for m in fast]
    sizes = [abs(m.ratio) for m in fast]
    near = {
        delay: [abs(m.ratio) for _, m in pairs if 23.5 < m.frequency < 28.6]
        for delay, pairs in found.items()
    }
    return Section(
        "Table II read as measurements of the plant",
        (
            "A measured point of the boundary is a measured value of the device: at its frequency"
            " the loop is exactly marginal. Divided by Table I's model it says where model and"
            " device differ.",
            Picture(
                "inversion", inversion_figure(points),
                "The sampled plant measured by each row of Table II over the model of Table I:"
                " size and phase; 1 and 0 would be agreement. Rows with a misprinted B are read at"
                " the B that is meant.", COMMAND,
            ),
            f"At 2 ms and B = 0 ({first.frequency:g} Hz) the device damps"
            f" {first.damping:.4f} N m s/rad more than the model's 0.0058. At the modes"
            f" ({min(m.frequency for m in fast):.0f} to {max(m.frequency for m in fast):.0f} Hz) it"
            f" leads the model by {min(leads):.0f} to {max(leads):.0f} degrees and moves"
            f" {min(sizes):.2f} to {max(sizes):.2f} as much. The phase says that the second mode is"
            " not quite the fitted one; the size, that something limits these oscillations (next"
            " section). And the three delays do not describe one linear device: between 24 and 28"
            " Hz the size is"
            f" {np.mean(near[0.002]):.2f} of the model's at 2 ms and {np.mean(near[0.004]):.2f} at"
            " 4 ms, so something else than Table I's linear model acts, by amplitude or by delay.",
            Table(
                "Measured over model, and the damping to ground that the device shows beyond the"
                " model [N m s/rad] where the rigid body oscillates.",
                ["delay", "B", "f [Hz]", "size", "phase [deg]", "excess damping"],
                rows, COMMAND,
            ),
        ),
    )  # fmt: skip
