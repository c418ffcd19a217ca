"""Numbers as people read them."""

import math

import pytest

from zwidth.sim.readable import (
    interval,
    of_the_motion,
    percent,
    plain,
    scaled,
    with_unit,
    without_interval,
)


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (2e-3, "N m", "2 mN m"), (999e-6, "s", "999 \u00b5s"), (1000.0, "N/m", "1 kN/m"),
        (1420.0, "rad", "1420 rad"), (0.5, "kg", "500 g"), (95.1, "kg", "95.1 kg"),
        (2.05e-4, "kg m2", "2.05e-4 kg m2"), (0.0, "rad", "0 rad"), (math.inf, "N m", "none"),
    ],
)  # fmt: skip
def test_a_unit_has_the_size_of_its_number(value: float, unit: str, text: str):
    """Nobody says kiloradian or milli-kilogram; breaks where every unit takes every prefix."""
    assert with_unit(value, unit) == text


@pytest.mark.parametrize(
    ("ends", "unit", "text"),
    [
        ((0.0201, 0.0197, 0.0205), "N m", "20.1 mN m (19.7 to 20.5)"),
        ((3.9e-11, -0.0086, 0.0086), "N m", "0 mN m (-9 to 9)"),
        ((0.2841, -1.288, 1.856), "N m", "0.3 N m (-1.3 to 1.9)"),
        ((2.0, math.nan, math.nan), "rad", "2 rad"),
        ((2.048e-4, 2.017e-4, 2.078e-4), "kg m2", "2.05e-4 kg m2 (2.02e-4 to 2.08e-4)"),
        (
            (0.00150001, 0.0014999, 0.00150012),
            "kg m2",
            "0.00150001 kg m2 (0.00149990 to 0.00150012)",
        ),
        ((0.0800003, 0.0799996, 0.080001), "N m", "80.000 mN m (within 0.001 %)"),
        ((2.618e-5, 2.6171e-5, 2.6189e-5), "kg m2", "2.6180e-5 kg m2 (2.6171e-5 to 2.6189e-5)"),
        ((2.8e-5, 2.7999e-5, 2.8001e-5), "kg m2", "2.8000e-5 kg m2 (within 0.01 %)"),
    ],
)
def test_an_interval_says_which_digits_are_known(
    ends: tuple[float, float, float], unit: str, text: str
):
    """One digit of the half width, two where it begins with a one.

    Breaks where value and ends have digits or prefixes of their own.
    """
    assert interval(*ends, unit) == text


@pytest.mark.parametrize(
    ("ends", "unit", "text"),
    [
        ((0.0250004, 0.0249990, 0.0250018), "N m", "25.0 mN m"),
        ((10.2e3, 6e3, 13e3), "N", "10 kN"),
        ((0.99996, 0.9999, 1.0), "N", "1.00 N"),
        ((0.00026, 0.00024, 0.00029), "kg m2", "0.00026 kg m2"),
        ((2.618e-5, 2.6171e-5, 2.6189e-5), "kg m2", "2.62e-5 kg m2"),
        ((0.0, -0.5, 0.5), "N", "0 mN"),
        ((2.0, math.nan, math.nan), "rad", "2 rad"),
    ],
)
def test_a_value_without_its_interval_has_no_digit_that_is_not_known(
    ends: tuple[float, float, float], unit: str, text: str
):
    """Mutations: three digits of every value; all digits that are known; zeros left out."""
    assert without_interval(*ends, unit) == text


def test_errors_over_the_motion_have_no_infinity():
    """Breaks where 61 times the motion is 6.1e+03 %, or what runs away is inf %."""
    assert percent(0.0123) == "1.2 %"
    assert percent(61.0) == "61 times"
    assert of_the_motion(61.0) == "61 times the motion"
    assert of_the_motion(math.inf) == "without bound"
    assert percent(math.nan) == "unknown"


def test_an_axis_has_the_unit_of_its_numbers():
    """Breaks where the factor is the number's and not the unit's."""
    factor, unit = scaled(0.2, "rad")
    assert (factor, unit) == (pytest.approx(1e3), "mrad")
    assert plain(12345.678) == "12350"
