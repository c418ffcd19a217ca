"""Filters of several outputs, beside SciPy's."""

import numpy as np
from scipy.signal import lfilter

from zwidth.sim.filters import filtered


def test_each_output_is_the_sum_of_all_through_their_filters() -> None:
    """Mutation: the filters of the two outputs exchanged."""
    random = np.random.default_rng(1)
    errors, filters = random.normal(size=(3, 50, 2)), random.normal(size=(2, 2, 5))
    expected = np.zeros_like(errors)
    for m in range(3):
        for a in range(2):
            for b in range(2):
                expected[m, :, a] += lfilter(filters[a, b], [1.0], errors[m, :, b])
    assert np.allclose(filtered(errors, filters), expected, atol=1e-12)
    assert np.array_equal(filtered(errors[1], filters), filtered(errors, filters)[1])


def test_what_overflows_stays_in_its_own_member() -> None:
    errors = np.ones((2, 20, 1))
    errors[0, 7:] = np.inf
    found = filtered(errors, np.array([[[1.0, -0.5, 0.0]]]))
    assert np.all(np.isfinite(found[0, :7]))
    assert np.all(np.isfinite(found[1]))
    assert not np.any(np.isfinite(found[0, 7:]))
