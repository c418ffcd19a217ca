"""Forces that remember: Dahl's bristle and Bouc-Wen's yielding, against their closed forms."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from zwidth.controllers.none import none
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.hysteresis import bouc_wen_along
from zwidth.sim.physics.path import out_and_back
from zwidth.sim.physics.presliding_friction import dahl_along
from zwidth.sim.run import Start, simulate

Along = Callable[[float, float, np.ndarray], float]
Areas = tuple[float, float]
MASS, LEVEL, STIFFNESS = 1e-3, 2e-3, 20.0
DAHL = np.array([LEVEL, STIFFNESS])
REACH = LEVEL / STIFFNESS


def bouc_wen(shape: float) -> np.ndarray:
    """Return the parameters of a Bouc-Wen spring of this shape."""
    return np.array([STIFFNESS, LEVEL, shape])


def one_mass(damper: float) -> Device:
    """Return a device of one mass."""
    return Device("one mass", "", True, make_chain([MASS], [damper]))


def _loop_area(along: Along, p: np.ndarray, z: float, amplitude: float, steps: int) -> Areas:
    """Energy of one steady cycle between +-amplitude, by trapezoids, and z at its upper end."""
    for _ in range(500):
        for way in (2.0 * amplitude, -2.0 * amplitude):
            z = along(z, way, p)
    energy, upper, step = 0.0, 0.0, 2.0 * amplitude / steps
    for direction in (1.0, -1.0):
        for _ in range(steps):
            after = along(z, direction * step, p)
            energy += 0.5 * (z + after) * LEVEL * direction * step
            z = after
        upper = max(upper, z)
    return energy, upper


def test_dahls_bristle_is_exact_for_any_cut_of_the_way() -> None:
    """1e-15. Mutation: an explicit step of the law."""
    way = 3.7 * REACH
    once = dahl_along(-0.3, way, DAHL)
    assert once == pytest.approx(1.0 - 1.3 * math.exp(-3.7), rel=1e-15)
    z = -0.3
    for _ in range(100):
        z = dahl_along(z, way / 100.0, DAHL)
    assert z == pytest.approx(once, rel=1e-13)


def test_dahls_loop_has_its_closed_area() -> None:
    """z at the ends is tanh(A s / f_c); area 2 f_c (2A - (f_c / s)(1 + z)(1 - e^(-2As/f_c)))."""
    for ratio in (0.1, 1.0, 5.0):
        amplitude = ratio * REACH
        energy, upper = _loop_area(dahl_along, DAHL, 0.0, amplitude, 2000)
        assert upper == pytest.approx(math.tanh(ratio), rel=1e-12)
        whole = (1.0 + upper) * (1.0 - math.exp(-2.0 * ratio))
        closed = 2.0 * LEVEL * (2.0 * amplitude - REACH * whole)
        assert energy == pytest.approx(closed, rel=1e-5)


def test_bouc_wens_loop_of_shape_2_is_exact() -> None:
    """Unloads straight, loads as tanh: z_A = tanh(2 A k / f - z_A), 1e-12; area by quadrature."""
    for ratio in (0.5, 1.0, 5.0):
        energy, upper = _loop_area(bouc_wen_along, bouc_wen(2.0), 0.0, ratio * REACH, 4000)
        root = brentq(lambda z, r=ratio: z - math.tanh(2.0 * r - z), 0.0, 1.0, xtol=1e-15)
        z = float(root)
        assert upper == pytest.approx(z, rel=1e-12)
        loading, _ = quad(math.tanh, 0.0, 2.0 * ratio - z)
        assert energy == pytest.approx(2.0 * LEVEL * REACH * (loading - 0.5 * z * z), rel=1e-5)


@pytest.mark.parametrize("shape", [1.0, 1.5, 3.0, 20.0])
def test_bouc_wen_loads_by_its_own_law(shape: float) -> None:
    """Against solve_ivp: second order in the way, and within +-1 for any way.

    At z = 0 the rate of shape 1.5 has no second derivative: a further error, of order 2.5.

    Mutation: the Euler rule (`middle` replaced by z): slope 1.
    """
    p, way = bouc_wen(shape), 0.8

    def law(_: float, z: np.ndarray) -> np.ndarray:
        return 1.0 - np.abs(z) ** shape

    truth = solve_ivp(law, (0.0, way), [0.0], rtol=1e-12, atol=1e-14).y[0, -1]
    errors = []
    for steps in (16, 32, 64, 128):
        z = 0.0
        for _ in range(steps):
            z = bouc_wen_along(z, way * REACH / steps, p)
        errors.append(abs(z - truth))
    slope = -np.polyfit(np.log([16, 32, 64, 128]), np.log(errors), 1)[0]
    assert 1.9 < slope < (2.5 if shape == 1.5 else 2.1)
    for z in (-1.0, -0.5, 0.0, 0.5, 1.0):
        for far in (1e-12, 1.0, 1e6, 1e300):
            assert abs(bouc_wen_along(z, far * REACH, p)) <= 1.0
    assert bouc_wen_along(-0.7, 1e3 * REACH, p) == pytest.approx(1.0, rel=1e-12)


def test_bouc_wen_unloads_with_its_stiffness_and_never_gives_energy() -> None:
    """Mutation: (1 + sign) without the half: it unloads too steeply."""
    p = bouc_wen(1.5)
    assert bouc_wen_along(0.8, -0.3 * REACH, p) == pytest.approx(0.5, rel=1e-14)
    rng = np.random.default_rng(5)
    for shape in (1.0, 1.5, 4.0, 50.0):
        p, z, energy = bouc_wen(shape), 0.0, 0.0
        for way in rng.normal(size=300) * REACH:
            for _ in range(50):
                after = bouc_wen_along(z, way / 50.0, p)
                energy += 0.5 * (z + after) * LEVEL * way / 50.0
                z = after
            assert energy - 0.5 * LEVEL * REACH * z * z >= -1e-4 * LEVEL * REACH


def test_a_substep_that_turns_is_cut_at_its_turning_point() -> None:
    """The way out and back of v0 + (v1 - v0) t / h. Mutation: the net way alone."""
    out, back = out_and_back(0.0, 0.5 * (3.0 - 1.0) * 0.1, 3.0, -1.0, 0.1)
    assert out == pytest.approx(0.5 * 3.0 * 0.075)
    assert back == pytest.approx(-0.5 * 1.0 * 0.025)
    assert out_and_back(1.0, 3.0, 1.0, 2.0, 0.1) == (2.0, 0.0)


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("presliding_friction", {"level": LEVEL, "stiffness": STIFFNESS}),
        ("hysteresis", {"level": LEVEL, "stiffness": STIFFNESS, "shape": 1.0}),
    ],
)
def test_under_a_small_load_it_yields_by_the_closed_form(
    name: str, values: dict[str, float]
) -> None:
    """Overdamped, it comes to q = -(f_c / s) ln(1 - F / f_c), 1e-6; beyond f_c it slides.

    Both laws agree on the way up from zero. Mutation: stiffness and level exchanged.
    """
    place = "m1" if name == "presliding_friction" else "ground"
    device = one_mass(1.0).with_physics(make_physics(name, place, **values))
    for load in (0.1, 0.5, 0.9):
        push = np.full(8000, load * LEVEL)
        run = simulate(device, none(), duration=8.0, disturbance=push, substeps=4)
        expected = -REACH * math.log(1.0 - load)
        assert run.trace["position_m1"][-1] == pytest.approx(expected, rel=1e-6)
    run = simulate(device, none(), duration=4.0, disturbance=np.full(4000, 3.0 * LEVEL))
    assert run.trace["velocity_m1"][-1] == pytest.approx(2.0 * LEVEL, rel=1e-9)


@pytest.mark.parametrize("name", ["presliding_friction", "hysteresis"])
def test_small_oscillations_have_the_frequency_of_the_stiffness(name: str) -> None:
    """sqrt(stiffness / m) within 0.3 %, amplitudes far below level / stiffness."""
    place = "m1" if name == "presliding_friction" else "ground"
    values = {"level": 1.0, "stiffness": STIFFNESS} | ({"shape": 2.0} if place == "ground" else {})
    device = one_mass(0.0).with_physics(make_physics(name, place, **values))
    run = simulate(device, none(), duration=1.0, start=Start(0.0, 1e-3), substeps=10)
    q = run.trace["position_m1"]
    up = np.flatnonzero((q[:-1] < 0.0) & (q[1:] >= 0.0))
    crossings = up - q[up] / (q[up + 1] - q[up])
    frequency = (crossings.size - 1) / (crossings[-1] - crossings[0]) * 1e3
    assert frequency == pytest.approx(math.sqrt(STIFFNESS / MASS) / (2.0 * math.pi), rel=3e-3)
