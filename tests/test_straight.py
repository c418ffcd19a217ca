"""Steps of a fit along curves that are straight in the transfer function's coefficients."""

import numpy as np
import pytest
from scipy.signal import ss2tf

from zwidth.diagnosis.fitting.straight import along, coefficients
from zwidth.diagnosis.model.parameters import Model
from zwidth.sim.chain import Chains, make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface


def chain_of(masses: int, ground_spring: float = 0.0, seed: int = 1) -> Device:
    """Return a chain at 1 kHz."""
    random = np.random.default_rng(seed)
    chain = make_chain(
        random.uniform(0.5, 2.0, masses), random.uniform(0.0, 3.0, masses), ground_spring,
        random.uniform(50.0, 500.0, masses - 1), random.uniform(0.0, 3.0, masses - 1),
    )  # fmt: skip
    return Device("chain", "", True, chain, Interface(period=1e-3))


@pytest.mark.parametrize("ground_spring", [0.0, 30.0])
@pytest.mark.parametrize("masses", [1, 2, 3, 5])
def test_coefficients_are_those_of_the_transfer_function(masses: int, ground_spring: float) -> None:
    """Against scipy's, from the equations of state. Mutations: a link's damper left out; N not
    divided by det M; D's last coefficient where a spring ties the chain left out."""
    device = chain_of(masses, ground_spring)
    plant = device.plant()
    read = np.zeros((1, plant.size))
    read[0, 0] = 1.0
    top, bottom = ss2tf(plant.a, plant.b[:, :1], read, np.zeros((1, 1)))
    chains = Chains(*(np.asarray(part)[None] for part in device.chain))
    (found,) = coefficients(chains)
    expected = [top[0, 2:], bottom[1:] if ground_spring else bottom[1:-1]]
    np.testing.assert_allclose(found, np.concatenate(expected), rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("ground_spring", [0.0, 30.0])
@pytest.mark.parametrize("masses", [2, 3])
def test_steps_are_straight_in_the_coefficients(masses: int, ground_spring: float) -> None:
    """Mutations: slopes at the end of the curve; parts of the straight line."""
    model = Model(chain_of(masses, ground_spring))
    random = np.random.default_rng(2)
    x = 0.2 * random.standard_normal(len(model.parameters))
    steps = [0.2 * random.standard_normal(x.size) for _ in range(3)]
    parts = (0.25, 0.5, 1.0)
    found = along(model, x, steps, parts)
    begin = coefficients(model.chains(x[None]))
    skew = [i for i, p in enumerate(model.parameters) if p.kind == "skew"]
    for step, curve in zip(steps, found, strict=True):
        slope = coefficients(model.chains((x + 1e-6 * step)[None])) - begin
        slope -= coefficients(model.chains((x - 1e-6 * step)[None])) - begin
        for part, there in zip(parts, curve, strict=True):
            own = coefficients(model.chains(there[None]))
            np.testing.assert_allclose(own, begin + part * slope / 2e-6, rtol=1e-5)
            np.testing.assert_allclose(there[skew], (x + part * step)[skew])
        assert np.abs(curve[-1] - x - step).max() > 1e-3
        assert np.abs(curve[0] - x - 0.25 * step).max() < np.abs(curve[-1] - x - step).max()


def test_a_step_to_coefficients_of_no_chain_is_straight() -> None:
    """As is any of a single mass. Mutations: the last point of Newton's method taken as found."""
    model = Model(chain_of(2))
    x = np.zeros(len(model.parameters))
    far = -4.0 * np.ones(x.size)
    (curve,) = along(model, x, [far], (0.5, 1.0))
    ends = coefficients(model.chains(curve[-1:]))
    assert np.isfinite(ends).all()
    one = Model(chain_of(1))
    step = np.linspace(0.1, 0.4, len(one.parameters))
    (curve,) = along(one, np.zeros(step.size), [step], (0.5, 1.0))
    np.testing.assert_array_equal(curve, [0.5 * step, step])
