"""What a picture of a diagnosis shows of a long series."""

import numpy as np
import pytest

from zwidth.figures.diagnosis import COLUMNS, envelope


@pytest.mark.parametrize("size", [2 * COLUMNS + 1, 10_000, 123_457])
def test_an_envelope_loses_no_swing(size: int) -> None:
    """A single sample that stands out is drawn, wherever it is, and time rises.

    Mutations that break it: every n-th sample; the highest value of a column alone.
    """
    t = np.arange(size, dtype=np.float64)
    random = np.random.default_rng(1)
    for k in (0, 1, size // 3, size - 1):
        values = random.normal(size=size)
        values[k] = -50.0
        at, drawn = envelope(t, values)
        assert at.size <= 2 * COLUMNS
        assert np.all(np.diff(at) >= 0.0)
        assert drawn.min() == -50.0
        assert drawn.max() == values.max()
        np.testing.assert_array_equal(drawn, values[at.astype(int)])


def test_a_short_series_stays_as_it_is() -> None:
    """And what is not finite hides nothing. Mutation: `argmin` of a column with a nan."""
    t = np.arange(2.0 * COLUMNS)
    assert envelope(t, t)[1] is t
    values = np.full(10 * COLUMNS, np.nan)
    values[5] = 3.0
    assert 3.0 in envelope(np.arange(values.size, dtype=np.float64), values)[1]
