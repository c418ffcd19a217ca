"""Truths of the intervals of a fit whose residual is neither white nor as large at all times."""

import numpy as np
import pytest
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.fitting.uncertainty import covariance
from zwidth.diagnosis.model.parameters import Model
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
SAMPLES, DRAWS = 1000, 200
MODEL = Model(Device("mass", "", False, make_chain([0.5], [0.0])))


def of(slopes: Floats, residual: Floats) -> Fitted:
    """Return a fit of one parameter, without a prior."""
    x = np.zeros(1)
    return Fitted(MODEL, x, float(residual @ residual), residual, slopes[:, None], SAMPLES)


def told_and_scattered(slopes: Floats, residuals: Floats) -> tuple[float, float]:
    """The standard error that is told (rms), and how much the estimates scatter."""
    rows = np.linalg.pinv(slopes[:, None])[0]
    told = [float(covariance(of(slopes, r))[0, 0]) for r in residuals]
    return float(np.sqrt(np.mean(told))), float(np.std(residuals @ rows))


def test_a_parameter_that_shows_where_noise_is_large_is_known_less_well() -> None:
    """A tenth of the samples tells of it, and errs three times as much as all do on the mean.

    Mutation that breaks it: variances from the spectrum alone, a third of the scatter.
    """
    draw = np.random.default_rng(1)
    tells = np.arange(SAMPLES) % 50 < 5
    size = np.where(tells, 3.0, 1.0 / 3.0)
    residuals = size * draw.standard_normal((DRAWS, SAMPLES))
    told, scattered = told_and_scattered(np.where(tells, 1.0, 0.0), residuals)
    assert told == pytest.approx(scattered, rel=0.15)


def test_what_errs_together_at_a_turn_counts_once() -> None:
    """Five samples in a row that err alike tell as much as one of them.

    Mutation that breaks it: no products of neighbours, half of the scatter.
    """
    draw = np.random.default_rng(2)
    tells = np.arange(SAMPLES) % 50 < 5
    alike = np.repeat(draw.standard_normal((DRAWS, SAMPLES // 50)), 50, axis=1)
    residuals = np.where(tells, 3.0 * alike, draw.standard_normal((DRAWS, SAMPLES)) / 3.0)
    told, scattered = told_and_scattered(np.where(tells, 1.0, 0.0), residuals)
    assert told == pytest.approx(scattered, rel=0.25)


def test_a_white_residual_needs_no_more() -> None:
    """Within 5 %: the larger of two estimates is larger, and by little."""
    residuals = np.random.default_rng(3).standard_normal((DRAWS, SAMPLES))
    told, scattered = told_and_scattered(np.ones(SAMPLES), residuals)
    assert told == pytest.approx(1.0 / np.sqrt(SAMPLES), rel=0.05)
    assert told == pytest.approx(scattered, rel=0.15)
