"""Boundary, map, explorer and single simulations say the same of the same wall."""

import math

import numpy as np
import pytest
from agreement_examples import (
    Asked,
    asked,
    brackets_of,
    dampings_of,
    drawn_device,
    steady,
    theory_of,
)

from zwidth.sim.fate import Fate
from zwidth.stability.bisection import Bracket

UNDECIDED_AT_MOST = 0.05  # of the walls


def check(seed: int, count: int) -> list[Asked]:
    """Ask about the walls of drawn devices; no damping without a K or a reason in words."""
    rng = np.random.default_rng(seed)
    found: list[Asked] = []
    for _ in range(count):
        device = drawn_device(rng)
        dampings = dampings_of(device, 3)
        brackets = brackets_of(device, dampings)
        assert all(complete(bracket) for bracket in brackets)
        if device.interface.linear and not device.physics:
            exact = brackets_of(device, dampings, 5e-4)
            known = [bracket.stable or math.nan for bracket in exact]
            np.testing.assert_allclose(known, theory_of(device, dampings), rtol=1e-3)
        found += [one if one.agrees else steady(one) for one in asked(device, brackets)]
    apart = [(a.device.interface, a.device.physics, a) for a in found if not a.agrees]
    assert apart == []
    assert np.mean([a.decided for a in found]) > 1.0 - UNDECIDED_AT_MOST
    return found


def complete(bracket: Bracket) -> bool:
    """Whether there are a stable and an unstable K, or words that say why not."""
    return bool(bracket.reason) or (bracket.stable is not None and bracket.unstable is not None)


def test_all_say_the_same_of_the_walls_of_6_devices() -> None:
    """At 0.5, 0.98, 1.02 and 1.5 times the boundary's K: none says the opposite.

    That what all say is true is the matter of `test_dither.py` and `test_map_plane.py`.
    Mutation: `look_below` left out of `run`.
    """
    found = check(4, 6)
    words = {fate for one in found for fate in one.said}
    assert {Fate.RESTS, Fate.DITHERS, Fate.GROWS} <= words


@pytest.mark.truth
def test_all_say_the_same_of_the_walls_of_200_devices() -> None:
    """200 other devices."""
    check(5, 200)
