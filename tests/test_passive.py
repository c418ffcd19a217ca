import numpy as np
import pytest

from zwidth.sim.chain import make_chain, negative_dampers
from zwidth.sim.device_file import load_device
from zwidth.sim.ladder import from_vector, to_vector
from zwidth.sim.passive import distance, nearest_passive

FREQUENCY = np.geomspace(1.0, 300.0, 240)


def test_a_passive_chain_is_its_own_nearest() -> None:
    chain = make_chain([1.0, 2.0], [0.1, 0.0], 0.0, [300.0], [0.2])
    assert nearest_passive(chain) == (chain, 0.0)


def test_table_i_has_a_passive_chain_within_two_percent() -> None:
    """Figures: 25 % by raising b1 to zero, 1.761 % by the nearest chain, b1 = 0 exactly.

    60 random starts of an unbounded search over logarithms found none nearer. Broken by: stopping
    at the first evaluation, or a weight of 1/f.
    """
    chain = load_device("phantom_1_0").chain
    fit = nearest_passive(chain)
    raised = chain._replace(ground_dampers=np.maximum(chain.ground_dampers, 0.0))
    assert distance(chain, raised, FREQUENCY) == pytest.approx(0.2500, abs=1e-4)
    assert fit.distance == pytest.approx(0.017608, abs=1e-6)
    assert fit.distance == distance(chain, fit.chain, FREQUENCY)
    assert not negative_dampers(fit.chain)
    assert fit.chain.ground_dampers[0] == 0.0


def test_the_static_properties_stay() -> None:
    """Total inertia and ground damping of Table I within 1 %."""
    chain = load_device("phantom_1_0").chain
    fit = nearest_passive(chain)
    assert fit.chain.masses.sum() == pytest.approx(chain.masses.sum(), rel=0.01)
    assert fit.chain.ground_dampers.sum() == pytest.approx(chain.ground_dampers.sum(), rel=0.01)


def test_no_small_step_within_the_bounds_comes_nearer() -> None:
    """Truth: at the minimum, every feasible change of one parameter by 1e-3 is farther away.

    Broken by: a tolerance of 1e-2 in place of 1e-12.
    """
    chain = load_device("phantom_1_0").chain
    fit = nearest_passive(chain)
    best = to_vector(fit.chain)
    for i, value in enumerate(best):
        for step in (1e-3, -1e-3):
            moved = best.copy()
            moved[i] = value * (1.0 + step) if value > 0.0 else abs(step) * best[4]
            assert distance(chain, from_vector(moved), FREQUENCY) > fit.distance


def test_the_ground_spring_stays() -> None:
    chain = make_chain([1e-3, 2e-3], [-0.001, 0.01], 3.0, [200.0], [0.05])
    fit = nearest_passive(chain)
    assert fit.chain.ground_spring == 3.0
    assert fit.distance < 0.05


def test_it_is_deterministic() -> None:
    chain = load_device("phantom_1_0").chain
    first, second = nearest_passive(chain), nearest_passive(chain)
    assert first.distance == second.distance
    assert to_vector(first.chain).tobytes() == to_vector(second.chain).tobytes()
