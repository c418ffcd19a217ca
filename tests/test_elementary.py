"""exp, log, sin, cos, tanh and atan of our own: against a library's, alone and in lanes."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from engine_examples import Floats

from zwidth.sim import elementary
from zwidth.sim.jit import jit
from zwidth.sim.lane_type import WIDTH, as_lanes

COUNT = 1250 * WIDTH
RNG = np.random.default_rng(0)
NEAR = RNG.normal(size=COUNT)
ARGUMENTS: dict[str, Floats] = {
    "exp": np.concatenate([RNG.uniform(-707.0, 709.0, COUNT), NEAR]),
    "log": np.concatenate([np.exp(RNG.uniform(-700.0, 700.0, COUNT)), 1.0 + 1e-3 * NEAR]),
    "sin": np.concatenate([RNG.uniform(-1e6, 1e6, COUNT), 3.0 * NEAR]),
    "cos": np.concatenate([RNG.uniform(-1e6, 1e6, COUNT), 3.0 * NEAR]),
    "tanh": np.concatenate([RNG.uniform(-20.0, 20.0, COUNT), 0.5 * NEAR]),
    "atan": np.concatenate([RNG.uniform(-20.0, 20.0, COUNT), NEAR]),
}
LARGEST = {"exp": 1.0, "log": 1.0, "sin": 2.0, "cos": 2.0, "tanh": 3.0, "atan": 2.0}


def loops(function: Callable[..., Any]) -> tuple[Any, Any]:
    @jit
    def one(x: Any, found: Any) -> None:
        for i in range(x.size):
            found[i] = function(x[i])

    @jit
    def many(x: Any, found: Any) -> None:
        a, b = as_lanes(x), as_lanes(found)
        for i in range(a.size):
            b[i] = function(a[i])

    return one, many


@pytest.mark.parametrize("name", ARGUMENTS)
def test_as_exact_as_a_library(name: str) -> None:
    """In units of the last place of the library's value. Mutation: any constant's last digit but
    those of the highest powers; lanes to the bit of a run alone.
    """
    x = ARGUMENTS[name]
    one, many = loops(getattr(elementary, name))
    alone, lanes = np.zeros(x.size), np.zeros((x.size // WIDTH, WIDTH))
    one(x, alone)
    many(x.reshape(-1, WIDTH), lanes)
    assert np.array_equal(alone, lanes.ravel())
    truth = np.array([getattr(math, name)(v) for v in x.tolist()])
    assert np.max(np.abs(alone - truth) / np.spacing(np.abs(truth))) <= LARGEST[name]
    source = getattr(elementary, name).py_func
    assert [source(v) for v in x[:40].tolist()] == alone[:40].tolist()


def test_exp_ends_in_zero_and_infinity() -> None:
    one, _ = loops(elementary.exp)
    found = np.zeros(6)
    one(np.array([-1e9, -np.inf, 710.0, np.inf, 0.0, np.nan]), found)
    assert found[:5].tolist() == [0.0, 0.0, np.inf, np.inf, 1.0]
    assert np.isnan(found[5])


@pytest.mark.parametrize("exponent", [1.0, 2.5, 40.0])
def test_powers(exponent: float) -> None:
    """The error of a rounded logarithm, times the exponent. Mutation: `LN2_LOW` left out."""
    x = np.linspace(0.01, 2.0, 401)
    found = np.array([elementary.power(v, exponent) for v in x.tolist()])
    wrong = np.abs(found / x**exponent - 1.0)
    assert np.all(wrong <= np.finfo(float).eps * (2.0 + exponent * np.abs(np.log(x))))
    assert elementary.power(0.0, exponent) == 0.0
