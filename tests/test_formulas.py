"""What formula a curve looks like, told with the band that a fit knows it in."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from zwidth.diagnosis.laws.formula import FORMS, formulas

Floats = NDArray[np.float64]
STATES = np.linspace(-2.0, 2.0, 12)
HALF = np.linspace(0.0, 2.0, 8)
TRUTHS: list[tuple[str, Callable[[Floats], Floats]]] = [
    ("cube", lambda s: -0.5 * s**3),
    ("power", lambda s: -0.4 * np.sign(s) * np.abs(s) ** 1.6),
    ("saturation", lambda s: -1.0 * np.tanh(s / 0.3)),
    ("arctangent", lambda s: -0.8 * np.arctan(s / 0.4)),
    ("clipped line", lambda s: 1.5 * np.clip(s, -0.7, 0.7)),
    ("dead zone", lambda s: -2.0 * (s - np.clip(s, -0.6, 0.6))),
    ("bump", lambda s: 3.0 * np.exp(-0.5 * ((s - 0.5) / 0.6) ** 2)),
    ("stop above", lambda s: -4.0 * np.maximum(s - 0.9, 0.0)),
    ("sine", lambda s: 0.7 * np.sin(s / 0.35 + 0.4)),
    ("exponential", lambda s: 0.2 + 0.5 * np.exp(s / 0.8)),
    ("magnet", lambda s: -0.9 * s / (0.3**2 + s**2)),
]


@pytest.mark.parametrize(("name", "law"), TRUTHS)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_form_is_told_from_a_curve_with_a_band(
    name: str, law: Callable[[Floats], Floats], seed: int
) -> None:
    """Mutation that breaks it: forms of more numbers at no cost."""
    random = np.random.default_rng(seed)
    size = 0.01 * float(np.abs(law(STATES)).max())
    noisy = law(STATES) + size * random.standard_normal(STATES.size)
    found = formulas(STATES, noisy, size**2 * np.eye(STATES.size), odd=False)
    assert name in [f.form.name for f in found]
    like = next(f for f in found if f.form.name == name)
    assert np.abs(like.at(STATES) - law(STATES)).max() < 4.0 * size


def test_what_a_damper_may_take_is_no_difference() -> None:
    """A cube beside a straight part of any size, which the fit cannot tell. Mutation: the
    covariance's diagonal alone."""
    covariance = 1e-4 * np.eye(8) + np.outer(HALF, HALF)
    found = formulas(HALF, -0.5 * HALF**3 + 0.9 * HALF, covariance, odd=True)
    assert found[0].form.name == "cube"
    assert found[0].numbers["a"] == pytest.approx(-0.5, abs=0.02)
    assert found[0].text("v").startswith("-0.5")
    assert found[0].text("v").endswith("v^3")


def test_a_curve_of_no_form_has_no_formula() -> None:
    random = np.random.default_rng(3)
    jagged = random.choice([-1.0, 1.0], 12)
    assert formulas(STATES, jagged, 1e-4 * np.eye(12), odd=False) == []


def test_a_wide_band_leaves_several_forms() -> None:
    found = formulas(HALF, -0.5 * HALF**3, 0.2 * np.eye(8), odd=True)
    assert len(found) > 2
    assert "cube" in [f.form.name for f in found]


@pytest.mark.parametrize("form", FORMS, ids=lambda f: f.name)
def test_a_formula_is_written_with_its_numbers(form: object) -> None:
    curve = next(f for f in FORMS if f is form)
    shape = np.array([0.5] * len(curve.shape))
    values = curve.columns(STATES, shape) @ np.ones(len(curve.factors))
    turn = np.pi if curve.turns else 0.0
    found = formulas(STATES, values, 1e-8 * np.eye(12), False, turn, curve.rubs)
    assert found
    text = found[0].text("q")
    assert "{" not in text
    assert "+ -" not in text


def test_what_repeats_has_as_many_harmonics_as_it_takes() -> None:
    """Mutation that breaks it: harmonics at no cost."""
    at = np.linspace(0.0, 2.0, 12, endpoint=False)
    one = 0.4 * np.sin(np.pi * at + 0.3)
    known = 1e-4 * np.eye(12)
    assert formulas(at, one, known, False, period=2.0)[0].form.name == "sine"
    two = one + 0.2 * np.cos(2.0 * np.pi * at)
    (like, *_) = formulas(at, two, known, False, period=2.0)
    assert like.form.name == "sum of two harmonics"
    assert like.numbers["e"] == pytest.approx(0.2, abs=1e-6)


def test_friction_with_a_saturation_is_told_where_friction_is_part_of_it() -> None:
    law = -1.0 * np.sign(STATES) - 0.6 * np.tanh(STATES / 0.5)
    known = 1e-4 * np.eye(STATES.size)
    assert formulas(STATES, law, known, False, rubs=True)[0].form.name == (
        "friction and a saturation"
    )
    assert not any(f.form.rubs for f in formulas(STATES, law, known, False))


def test_of_forms_that_cost_the_same_the_plainest_is_first():
    """A bend beside a line and a level that a spring and an origin are as well.

    An exponential costs 0.1 less than the parabola. Mutation: the cheapest first.
    """
    s = np.array([-0.2116, -0.104, -0.022, 0.0155, 0.0735, 0.22])
    noise = 5e-5
    unknown = [1e-2 * np.ones(6), 5e-2 * s, s**3]
    covariance = noise**2 * np.eye(6) + sum(np.outer(u, u) for u in unknown)
    f = 0.0875 * s**2 - 0.003 - 2e-3 * s + noise * np.random.default_rng(0).standard_normal(6)
    first, second, *_ = formulas(s, f, covariance, False)
    assert (first.form.name, second.form.name) == ("parabola", "exponential")
    assert second.cost < first.cost
