"""What repeats, as a law of one turn: how long a turn may be."""

import numpy as np
import pytest

from zwidth.diagnosis.learning.tables import law_at, table
from zwidth.diagnosis.learning.where import Site, beside
from zwidth.diagnosis.model.parameters import Model
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics.free_law import points_of

DEVICE = Device("mass", "", False, make_chain([0.5], [0.8], 30.0), Interface(period=0.002))
V, TURN = np.linspace(0.0, 3.0, 13), 0.04
AT = TURN * np.arange(12) / 12
DETENT = table("free_spring", "m1", AT, 0.8 * np.sin(2.0 * np.pi * AT / TURN), False, TURN)


def test_a_turn_stays_longer_than_its_table_and_is_seen_twice() -> None:
    """A longer one is not seen twice, and any bend is a part of it.

    Mutations: a period without a bound, which a fit makes shorter than the points of its turn; one
    of twice its first length.
    """
    site = Site("free_spring", "m1", V, TURN, 0.1 * TURN)
    model, x = beside(Model(DEVICE), np.zeros(len(Model(DEVICE).parameters)), site, DETENT)
    (period,) = (i for i, p in enumerate(model.parameters) if p.name.endswith(".period"))
    ends = [np.where(np.arange(x.size) == period, far, x) for far in (-1e3, 1e3)]
    (shortest,), (longest,) = (model.effects_at(model.within(end)) for end in ends)
    last = max(s for s, _ in points_of(shortest.values))
    assert last < shortest.values["period"] < 1.01 * last
    assert np.all(np.isfinite(law_at(shortest, np.linspace(-1.0, 1.0, 50))))
    assert longest.values["period"] == pytest.approx(max(np.ptp(V) / 2.0, TURN))
