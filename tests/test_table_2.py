"""Table II as it is printed, and the inference on its two misprints."""

import numpy as np
import pytest

from scenarios.table_2 import DEVICE, MeasuredPoint, measured_at, table_2
from sim.device_file import load_device
from sim.sampled import sampled_frequency_response


def implied_damping(point: MeasuredPoint) -> float:
    """B at which Table I's loop is on the unit circle at the measured frequency.

    The imaginary part of -z^d/G = K + B (1 - 1/z)/T does not contain K.
    """
    device = load_device(DEVICE)
    assert device.modal is not None
    period = device.interface.period
    z = np.exp(2j * np.pi * point.frequency * period)
    response = sampled_frequency_response(device.modal, period, point.frequency)
    return float((-(z ** (point.delay / period)) / response).imag / ((1 - 1 / z) / period).imag)


def test_table_is_complete_and_as_printed():
    points = table_2()
    assert len(points) == 26
    assert [len(measured_at(ms / 1e3)) for ms in (2, 4, 8)] == [7, 13, 6]
    assert sum(p.damping for p in points) == pytest.approx(3.688)
    assert sum(p.stiffness for p in points) == pytest.approx(496.8)
    assert sum(p.frequency for p in points) == pytest.approx(1796.92)
    assert [(p.delay, p.damping) for p in points if p.damping_meant] == [
        (0.004, 0.05),
        (0.004, 0.5),
    ]


def test_misprints_continue_their_neighbours_only_as_they_are_read():
    """The excess of B over the model falls steadily along the 4 ms rows once both are moved.

    Mutation: drop `damping_meant` of either row, or exchange the two.
    """
    low = [p for p in measured_at(0.004) if p.place <= 0.15 and p.damping > 0]
    assert [p.place for p in low] == [0.05, 0.08, 0.1, 0.15]
    excess = [implied_damping(p) - p.place for p in low]
    assert excess == sorted(excess, reverse=True)
    assert excess == pytest.approx([0.0102, 0.0098, 0.0087, 0.0023], abs=1e-4)
