from typing import Any

import control
import numpy as np
import pytest

from zwidth.sim.chain import Chain, Floats, make_chain, matrices, negative_dampers
from zwidth.sim.ladder import Complexes, dynamic_stiffness, from_vector, to_vector
from zwidth.sim.ladder import frequency_response as chain_response
from zwidth.sim.modal import (
    ModalModel,
    Mode,
    frequency_response,
    from_chain,
    to_chain,
    transfer_function,
)
from zwidth.sim.plant import assemble, hold
from zwidth.sim.sampled import (
    sampled_frequency_response,
    sampled_state_space,
    state_space,
)
from zwidth.sim.synthesis import polish

TABLE_I = ModalModel(
    1.168e-3, 0.00584, (Mode(479.166, 83, 417.612, 80), Mode(1159.31, 352, 546.626, 90))
)
PERIOD = 1e-3
FREQUENCY = np.geomspace(0.1, 499.0, 200)


def random_model(rng: np.random.Generator, modes: int) -> ModalModel:
    """Interlaced frequencies at least 2 % apart, damping ratios up to 0.3."""
    steps = 1.0 + rng.uniform(0.02, 1.5, 2 * modes)
    rates = rng.uniform(20.0, 500.0) * np.cumprod(steps)
    ratio = rng.uniform(0.0, 0.3, 2 * modes)
    terms = 2.0 * ratio * rates
    inertia = np.exp(rng.uniform(-9.0, 2.0))
    return ModalModel(
        inertia,
        inertia * rng.uniform(0.0, 20.0),
        tuple(Mode(rates[i + 1], terms[i + 1], rates[i], terms[i]) for i in range(0, 2 * modes, 2)),
    )


def random_chain(rng: np.random.Generator, n: int) -> Chain:
    """Lightly damped, so that no mode is overdamped."""
    masses = np.exp(rng.normal(0.0, 1.0, n))
    springs = np.exp(rng.normal(10.0, 1.0, n - 1))
    dampers = 0.02 * rng.random(n - 1) * np.sqrt(springs)
    return make_chain(masses, rng.random(n), 0.0, springs, dampers)


def relative_differences(model: ModalModel, other: ModalModel) -> list[float]:
    """Frequencies and inertia against themselves, damping terms against their frequency."""
    rate = model.modes[0].omega if model.modes else model.damping / model.inertia
    found = [
        other.inertia / model.inertia - 1.0,
        (other.damping - model.damping) / (model.inertia * rate),
    ]
    for a, b in zip(model.modes, other.modes, strict=True):
        found += [b.omega / a.omega - 1.0, (b.c - a.c) / a.omega]
        found += [b.v / a.v - 1.0, (b.d - a.d) / a.v]
    return [abs(value) for value in found]


def test_table_i_is_the_chain_of_fig_4() -> None:
    """Truth: physics.md, the one real solution, to the ten digits printed there.

    Broken by: dropping the damper of the link from the next mass's remainder.
    """
    expected = [
        *(1.972414555e-4, 9.054058660e-4, 6.705525060e-5),
        *(-1.013558338e-2, 1.158274135e-2, 4.392842031e-3),
        *(217.2007962, 14.56602965),
        *(6.339077638e-2, 1.353682884e-3),
    ]
    assert to_vector(to_chain(TABLE_I)) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("modes", [0, 1, 2, 3])
def test_modal_to_chain_and_back(modes: int) -> None:
    """Round trip to 1e-9 on random plausible models.

    Broken by: a relative change of 1e-7 of the stiffness of the chain held at m1.
    """
    rng = np.random.default_rng(modes)
    for _ in range(60):
        model = random_model(rng, modes)
        assert max(relative_differences(model, from_chain(to_chain(model)))) < 1e-9


@pytest.mark.parametrize("modes", [1, 2, 3])
def test_nearly_undamped_modes_come_back_too(modes: int) -> None:
    """Damping ratios up to 3e-4: the roots of polynomials alone lose two of three such models.

    Broken by: leaving out Newton's step in `polish`.
    """
    rng = np.random.default_rng(300 + modes)
    for _ in range(20):
        model = random_model(rng, modes)
        light = tuple(Mode(m.omega, 1e-3 * m.c, m.v, 1e-3 * m.d) for m in model.modes)
        model = ModalModel(model.inertia, 1e-3 * model.damping, light)
        assert max(relative_differences(model, from_chain(to_chain(model)))) < 1e-12


def test_newton_finds_the_chain_from_afar() -> None:
    """Broken by: leaving out Newton's step, or a step of the wrong sign."""
    chain = random_chain(np.random.default_rng(11), 3)
    model = from_chain(chain)
    poles, zeros = (
        np.array([complex(-c / 2, (w * w - c * c / 4) ** 0.5) for w, c in pairs])
        for pairs in ([mode[:2] for mode in model.modes], [mode[2:] for mode in model.modes])
    )
    off = from_vector(to_vector(chain) * (1.0 + 1e-3 * np.cos(np.arange(10))))
    found = polish(off, poles, zeros, model.damping, float(chain.masses[0]))
    assert to_vector(found) == pytest.approx(to_vector(chain), rel=1e-11)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_chain_to_modal_and_back(n: int) -> None:
    """A passive chain is found again: its response has no second one.

    The last masses of a long chain hardly show at m1, hence 1e-6. Broken by: dropping the damper
    of the link from the next mass's remainder.
    """
    rng = np.random.default_rng(100 + n)
    for _ in range(40):
        chain = random_chain(rng, n)
        again = to_chain(from_chain(chain))
        assert to_vector(again) == pytest.approx(to_vector(chain), rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_poles_and_zeros_are_the_eigenvalues_of_the_chain(n: int) -> None:
    """Invariant: the roots of eq. (1) are the eigenvalues of the chain, free and with m1 held.

    Broken by: a relative change of 1e-7 of the stiffness of the held chain.
    """
    rng = np.random.default_rng(200 + n)
    chain = random_chain(rng, n)
    mass, damping, stiffness = matrices(chain)
    model = from_chain(chain)
    numerator, denominator = transfer_function(model)
    for s, polynomial in (
        (_eigenvalues(mass, damping, stiffness), denominator),
        (_eigenvalues(mass[1:, 1:], damping[1:, 1:], stiffness[1:, 1:]), numerator),
    ):
        size = np.polyval(np.abs(polynomial), np.abs(s) + 1.0)
        assert np.all(np.abs(np.polyval(polynomial, s)) <= 1e-9 * size)


def _eigenvalues(mass: Floats, damping: Floats, stiffness: Floats) -> Complexes:
    n = mass.shape[0]
    inverse = np.linalg.inv(mass)
    a = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ stiffness, -inverse @ damping]])
    return np.linalg.eigvals(a).astype(np.complex128)


def test_two_undamped_masses_in_closed_form() -> None:
    """Truth: v^2 = k/m2, omega^2 = k (1/m1 + 1/m2), m = m1 + m2."""
    m1, m2, k = 2.0, 3.0, 600.0
    chain = to_chain(
        ModalModel(m1 + m2, 0.0, (Mode((k / m1 + k / m2) ** 0.5, 0, (k / m2) ** 0.5, 0),))
    )
    assert to_vector(chain) == pytest.approx([m1, m2, 0, 0, k, 0], rel=1e-12, abs=1e-12)
    model = from_chain(chain)
    assert relative_differences(model, ModalModel(5.0, 0.0, model.modes)) == pytest.approx(
        np.zeros(6), abs=1e-12
    )


def test_the_damping_of_the_rigid_body_is_the_sum_of_the_ground_dampers() -> None:
    chain = to_chain(TABLE_I)
    assert float(chain.ground_dampers.sum()) == pytest.approx(TABLE_I.damping, rel=1e-12)


def test_chain_and_modal_form_respond_alike() -> None:
    """Broken by: a relative change of 1e-8 of any mass."""
    for model in (TABLE_I, random_model(np.random.default_rng(7), 3), ModalModel(2.0, 0.3)):
        ratio = chain_response(to_chain(model), FREQUENCY) / frequency_response(model, FREQUENCY)
        assert np.abs(ratio - 1.0).max() < 1e-9


def test_the_ladder_is_the_inverse_of_the_matrices() -> None:
    """Broken by: leaving the ground spring out of the dynamic stiffness."""
    chain = random_chain(np.random.default_rng(3), 4)._replace(ground_spring=7000.0)
    mass, damping, stiffness = matrices(chain)
    for s in (3j, 40j + 1.0, 500j):
        receptance = np.linalg.inv(mass * s * s + damping * s + stiffness)[0, 0]
        assert dynamic_stiffness(chain, s) * receptance == pytest.approx(1.0, rel=1e-12)


def test_an_antiresonance_above_its_resonance_asks_for_a_negative_damper() -> None:
    chain = to_chain(ModalModel(1.0, 0.5, (Mode(100.0, 2.0, 130.0, 2.0),)))
    assert negative_dampers(chain)


def test_modes_are_kept_in_rising_order() -> None:
    modes = TABLE_I.modes
    assert ModalModel(1.168e-3, 0.00584, modes[::-1]) == TABLE_I


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((0.0, 1.0), "modal.inertia is 0; it must be > 0"),
        ((float("nan"), 1.0), "modal.inertia is nan"),
        ((1.0, float("inf")), "modal.damping is inf; it must be finite"),
        ((1.0, 1.0, (Mode(-3, 1, 2, 1),)), r"modal.mode\[0\].omega is -3; it must be > 0"),
        ((1.0, 1.0, (Mode(3, 1, 2, 1), Mode(3, 1, 0, 1))), r"modal.mode\[1\].v is 0"),
        ((1.0, 1.0, (Mode(3, float("nan"), 2, 1),)), r"mode\[0\].c is nan; it must be finite"),
        ((1.0, 1.0, 5 * (Mode(3, 1, 2, 1),)), "modal has 5 modes; it must have at most 4"),
    ],
)
def test_a_modal_model_is_checked(arguments: tuple[Any, ...], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        ModalModel(*arguments)


@pytest.mark.parametrize(
    ("chain", "sentence"),
    [
        (make_chain([1.0], [1.0], 5.0), "ground_spring is 5: a chain tied to ground"),
        (make_chain([1, 1], [0, 0], 0, [100], [50]), "real poles at -.*overdamped"),
        (make_chain([1, 1], [0, 40], 0, [100], [1]), "real (poles|zeros) at -.*overdamped"),
    ],
)
def test_a_chain_without_modal_form_says_so(chain: Chain, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        from_chain(chain)


def test_a_mode_that_cancels_itself_is_no_mass() -> None:
    with pytest.raises(ValueError, match="remove a mode that cancels itself"):
        to_chain(ModalModel(1.0, 1.0, (Mode(100.0, 3.0, 100.0, 3.0),)))


def test_transfer_function_and_state_space_are_the_frequency_response() -> None:
    """Broken by: v^2 - omega^2 taken as omega^2 - v^2 in the cascade."""
    s = 2j * np.pi * FREQUENCY
    expected = frequency_response(TABLE_I, FREQUENCY)
    numerator, denominator = transfer_function(TABLE_I)
    assert np.polyval(numerator, s) / np.polyval(denominator, s) == pytest.approx(
        expected, rel=1e-12
    )
    a, b, c = state_space(TABLE_I)
    realised = [c @ np.linalg.solve(x * np.eye(b.size) - a, b) for x in s]
    assert realised == pytest.approx(expected, rel=1e-12)


def test_sampled_response_is_the_sum_of_its_aliases() -> None:
    """Truth: Z[H G](e^{sT}) = (1 - e^{-sT})/T x sum of G(s_k)/s_k over s_k = s + 2 pi j k/T.

    The sum cut at |k| = 2000 leaves 1e-10. Broken by: holding over T (1 + 1e-7).
    """
    s = 2j * np.pi * FREQUENCY
    aliases = FREQUENCY + np.arange(-2000, 2001)[:, None] / PERIOD
    total = np.sum(frequency_response(TABLE_I, aliases) / (2j * np.pi * aliases), axis=0)
    expected = total * (1.0 - np.exp(-s * PERIOD)) / PERIOD
    found = sampled_frequency_response(TABLE_I, PERIOD, FREQUENCY)
    assert np.abs(found / expected - 1.0).max() < 1e-9


def test_sampled_response_agrees_with_python_control() -> None:
    """Witness: python-control's c2d of the chain's state space, and the plant's own hold."""
    plant = assemble(matrices(to_chain(TABLE_I)))
    z = np.exp(2j * np.pi * FREQUENCY * PERIOD)
    sampled = control.c2d(
        control.ss(plant.a, plant.b[:, :1], np.eye(1, plant.size), 0), PERIOD, "zoh"
    )
    a, b = hold(plant, PERIOD)
    held = [np.linalg.solve(x * np.eye(plant.size) - a, b[:, 0])[0] for x in z]
    found = sampled_frequency_response(TABLE_I, PERIOD, FREQUENCY)
    assert found == pytest.approx(sampled(z), rel=1e-9)
    assert found == pytest.approx(held, rel=1e-9)


def test_sampled_poles_are_exponentials_of_the_poles() -> None:
    poles = np.roots(transfer_function(TABLE_I)[1])
    sampled = np.linalg.eigvals(sampled_state_space(TABLE_I, PERIOD).a)
    expected = np.exp(poles * PERIOD)
    assert np.sort_complex(sampled) == pytest.approx(np.sort_complex(expected), rel=1e-9)
