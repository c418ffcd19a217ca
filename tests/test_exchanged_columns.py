"""A header that names command and position the wrong way round is read as the numbers have it."""

from pathlib import Path

import numpy as np
import pytest

from zwidth.door import taken


def rig(folder: Path, names: tuple[str, str], step: float = 1e-3) -> tuple[Path, np.ndarray]:
    """Write a mass under a multisine, read by an encoder, its torque under the first name."""
    random, period = np.random.default_rng(3), 1e-3
    t = period * np.arange(6000)
    hertz = np.array([0.7, 1.3, 2.9, 5.3, 11.0, 23.0])
    lines = np.cos(2.0 * np.pi * np.outer(t, hertz) + random.uniform(0.0, 6.28, hertz.size))
    u = 0.05 * lines.sum(axis=1)
    x, v = np.zeros(t.size), 0.0
    for k in range(1, t.size):
        for _ in range(4):
            v += 0.25 * period * (u[k - 1] - 4e-3 * v - 5e-3 * np.tanh(v / 0.05)) / 8e-4
        x[k] = x[k - 1] + period * v
    rows = np.column_stack([t, u, step * np.round(x / step)])
    path = folder / "rig.csv"
    np.savetxt(path, rows, "%.9g", ",", header=f"time,{names[0]},{names[1]}", comments="")
    return path, u


@pytest.mark.parametrize(
    ("names", "factor"),
    [(("torque_Nm", "angle_rad"), 1.0), (("torque_mNm", "angle_deg"), 1e-3)],
)
def test_each_signal_gets_the_place_that_it_moves_like(
    tmp_path: Path, names: tuple[str, str], factor: float
) -> None:
    """And keeps the unit of that place; as named, nothing is exchanged.

    Mutations: the units exchanged with the signals; the names believed; exchanged whatever numbers
    say.
    """
    for order, said in ((names, False), ((names[1], names[0]), True)):
        path, u = rig(tmp_path, order)
        trace, doubts = taken(path)
        np.testing.assert_allclose(trace["command"], factor * u, rtol=1e-6, atol=1e-9)
        assert any("are exchanged against their names" in one for one in doubts) == said
        assert trace.units == {"command": "N m", "position_m1": "rad"}
