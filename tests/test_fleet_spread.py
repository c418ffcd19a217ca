"""What many recordings say of one parameter."""

import numpy as np
import pytest
from numpy.typing import NDArray

from zwidth.fleet.spread import _at, _pooled, _read, spread  # pyright: ignore[reportPrivateUsage]

Floats = NDArray[np.float64]


def fleet(
    seed: int,
    devices: int = 20,
    runs: int = 4,
    tau_device: float = 0.0,
    tau_run: float = 0.0,
    slope: float = 0.0,
) -> tuple[Floats, Floats, list[str], dict[str, Floats], Floats]:
    rng = np.random.default_rng(seed)
    device = np.repeat(np.arange(devices), runs)
    load = rng.uniform(0.0, 5.0, device.size)
    errors = rng.uniform(0.5, 2.0, device.size)
    own = 10.0 + slope * load + tau_device * rng.standard_normal(devices)[device]
    own += tau_run * rng.standard_normal(device.size)
    values = own + errors * rng.standard_normal(device.size)
    return values, errors, [f"d{d:02}" for d in device], {"load": load}, own


@pytest.mark.parametrize(
    ("made", "said"),
    [
        ({}, (False, False, False)),
        ({"tau_device": 3.0}, (True, False, False)),
        ({"tau_run": 4.0}, (False, True, False)),
        ({"tau_device": 8.0, "tau_run": 4.0}, (True, True, False)),
        ({"slope": 1.5}, (False, False, True)),
        ({"tau_device": 3.0, "slope": 1.5}, (True, False, True)),
    ],
)
def test_each_level_and_the_slope_are_told_apart(
    made: dict[str, float], said: tuple[bool, bool, bool]
):
    for seed in range(5):
        values, errors, devices, columns, _ = fleet(
            seed,
            tau_device=made.get("tau_device", 0.0),
            tau_run=made.get("tau_run", 0.0),
            slope=made.get("slope", 0.0),
        )
        found = spread(values, errors, devices, columns)
        assert (found.per_device, found.per_run, "load" in found.slopes) == said, seed
        for term, has in zip(("per device", "per run", "load"), said, strict=True):
            assert (found.gains[term] > 0.0) or not has
        if "slope" in made:
            slope = found.slopes["load"]
            assert abs(slope.value - made["slope"]) < 4.0 * slope.error


def test_a_fleet_without_differences_is_hardly_ever_said_to_differ():
    false = 0
    for seed in range(100):
        values, errors, devices, columns, _ = fleet(seed, devices=8, runs=3)
        found = spread(values, errors, devices, columns)
        false += not found.shared or bool(found.slopes)
    assert false <= 1


def test_intervals_hold_the_true_values_and_pooling_brings_them_nearer():
    covered, count, before, after = 0, 0, 0.0, 0.0
    for seed in range(20):
        values, errors, devices, columns, own = fleet(seed, tau_device=2.0)
        found = spread(values, errors, devices, columns)
        covered += np.count_nonzero(np.abs(found.pooled - own) < 1.96 * found.pooled_errors)
        count += own.size
        before += float(np.sum((values - own) ** 2))
        after += float(np.sum((found.pooled - own) ** 2))
    assert 0.93 < covered / count < 0.97
    assert after < 0.5 * before


def test_blocks_agree_with_the_dense_normal():
    values, errors, devices, columns, _ = fleet(3, devices=4, runs=3, tau_device=2.0)
    data = _read(values, errors, devices, columns)
    design = np.column_stack([np.ones(values.size), data.columns["load"]])
    tau_device, tau_run = 1.3, 0.7
    same = np.equal.outer(data.device, data.device)
    true = tau_device**2 * same + tau_run**2 * np.eye(values.size)
    inverse = np.linalg.inv(true + np.diag(errors**2))
    covariance = np.linalg.inv(design.T @ inverse @ design)
    b = covariance @ design.T @ inverse @ values
    left = values - design @ b
    cost = left @ inverse @ left - np.linalg.slogdet(inverse)[1] - np.linalg.slogdet(covariance)[1]
    point = _at(data, design, tau_device, tau_run)
    assert point.cost == pytest.approx(cost, rel=1e-10)
    assert point.b == pytest.approx(b, rel=1e-10)
    moved = design - true @ inverse @ design
    mean, variance = _pooled(data, design, point)
    dense = true - true @ inverse @ true + moved @ covariance @ moved.T
    assert mean == pytest.approx(design @ b + true @ inverse @ left, rel=1e-10)
    assert variance == pytest.approx(np.diag(dense), rel=1e-10)


def test_a_recording_that_says_nothing_gets_what_its_device_says():
    values, errors, devices, columns, own = fleet(1, tau_device=5.0)
    values[0], errors[0] = 1e6, np.inf
    found = spread(values, errors, devices, columns)
    assert found.per_device
    assert not found.per_run
    assert abs(found.pooled[0] - own[0]) < 3.0 * found.pooled_errors[0]
    assert found.pooled_errors[0] < 2.0


def test_without_repeats_a_difference_is_per_run():
    values, errors, devices, columns, _ = fleet(2, devices=60, runs=1, tau_device=5.0)
    found = spread(values, errors, devices, columns)
    assert found.per_run
    assert "per device" not in found.gains


def test_units_do_not_matter():
    values, errors, devices, columns, _ = fleet(4, tau_device=3.0, slope=1.5)
    one = spread(values, errors, devices, columns)
    other = spread(1e3 * values, 1e3 * errors, devices, {"load": 1e3 * columns["load"]})
    assert other.pooled == pytest.approx(1e3 * one.pooled, rel=1e-8)
    assert other.gains == pytest.approx(dict(one.gains), abs=1e-6)


def test_what_is_wrong_is_named():
    ones = np.ones(3)
    with pytest.raises(ValueError, match="errors has 2 entries and values 3"):
        spread(ones, np.ones(2), ["a"] * 3)
    with pytest.raises(ValueError, match="not above 0"):
        spread(ones, np.zeros(3), ["a"] * 3)
    with pytest.raises(ValueError, match="values has NaN"):
        spread(np.array([1.0, np.nan, 2.0]), ones, ["a"] * 3)
    with pytest.raises(ValueError, match="fewer than two"):
        spread(ones, np.array([1.0, np.inf, np.inf]), ["a"] * 3)


def test_columns_that_cannot_be_told_apart_are_not_taken_together():
    """Mutation: without the rank, the sums have no inverse."""
    values, errors, devices, columns, _ = fleet(1, tau_device=3.0, slope=1.5)
    twice = {**columns, "twice": 2.0 * columns["load"]}
    found = spread(values, errors, devices, twice)
    assert len(found.slopes) == 1
    few = np.where(np.arange(values.size) < 2, errors, np.inf)  # two that say anything
    other = np.linspace(-1.0, 1.0, values.size) ** 2
    assert len(spread(values, few, devices, {**columns, "other": other}).slopes) <= 1
