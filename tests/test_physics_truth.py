"""Every smooth effect at every place against an integrator and laws written out here."""

from collections.abc import Callable

import numpy as np
import pytest
from physics_examples import EXAMPLES, five
from scipy.integrate import solve_ivp

from zwidth.controllers.none import none
from zwidth.sim.chain import matrices
from zwidth.sim.physics import EFFECTS, make_physics
from zwidth.sim.run import Start, simulate

Law = Callable[[float, float, float, dict[str, float]], tuple[float, float]]


def drag(q: float, v: float, z: float, p: dict[str, float]) -> tuple[float, float]:
    return -p["coefficient"] * v * abs(v), 0.0


def constant(q: float, v: float, z: float, p: dict[str, float]) -> tuple[float, float]:
    return p["level"], 0.0


def pendulum(q: float, v: float, z: float, p: dict[str, float]) -> tuple[float, float]:
    return -p["level"] * np.sin(q + p["angle"]), 0.0


def ripple(q: float, v: float, z: float, p: dict[str, float]) -> tuple[float, float]:
    return p["amplitude"] * np.sin(2.0 * np.pi * q / p["period"] + p["phase"]), 0.0


def cubic(q: float, v: float, z: float, p: dict[str, float]) -> tuple[float, float]:
    return -p["coefficient"] * q**3, 0.0


def dahl(q: float, v: float, z: float, p: dict[str, float]) -> tuple[float, float]:
    return -z, p["stiffness"] * (v - abs(v) * z / p["level"])


def bouc_wen(q: float, v: float, z: float, p: dict[str, float]) -> tuple[float, float]:
    share = abs(z / p["level"])
    yielding = 0.5 * (v * share ** p["shape"] + abs(v) * np.sign(z) * share ** p["shape"])
    return -z, p["stiffness"] * (v - yielding)


LAWS: dict[str, tuple[Law, dict[str, float]]] = {
    "quadratic_drag": (drag, {"coefficient": 0.03}),
    "constant_force": (constant, {}),
    "gravity_pendulum": (pendulum, {}),
    "force_ripple": (ripple, {}),
    "cubic_stiffness": (cubic, {"coefficient": 2e6}),
    "presliding_friction": (dahl, {}),
    "hysteresis": (bouc_wen, {}),
}
TICKS, N = 60, 5
START = [2e-3, 1e-3, -1e-3, 5e-4, 0.0]


@pytest.mark.parametrize(
    ("name", "place"), [(name, place) for name in LAWS for place in EFFECTS[name].places]
)
def test_a_smooth_effect_follows_its_law(name: str, place: str) -> None:
    """Rms of all velocities over 60 ticks, 1e-5 of their own at 128 substeps.

    Of a ripple in a link over the position of its first mass. Mutations: any sign, factor or index
    in the law under test; `origin` left at the second mass.
    """
    law, changed = LAWS[name]
    values = EXAMPLES[name] | changed
    bare = five().with_interface(delay=0.0)
    device = bare.with_physics(make_physics(name, place, **values))
    drive = 0.05 * np.sin(np.arange(TICKS) * 0.3)
    digits = [int(d) - 1 for d in place if d.isdigit()] or [0]
    first, across = np.eye(N)[digits[0]], np.eye(N)[digits[0]]
    if len(digits) > 1:
        across = first - np.eye(N)[digits[1]]
    over = first if name == "force_ripple" else across
    mass, damping, stiffness = matrices(bare.chain)
    inverse = np.linalg.inv(mass)

    def slope(_: float, y: np.ndarray, push: float) -> np.ndarray:
        q, v = y[:N], y[N : 2 * N]
        force, rate = law(float(over @ q), float(over @ v), float(y[2 * N]), values)
        total = across * force - stiffness @ q - damping @ v
        total[0] += push
        return np.concatenate([v, inverse @ total, [rate]])

    y = np.array([*START, *np.zeros(N + 1)])
    truth = np.zeros((TICKS, N))
    for k in range(TICKS):
        truth[k] = y[N : 2 * N]
        span = (0.0, 1e-3)
        y = solve_ivp(slope, span, y, args=(drive[k],), rtol=1e-9, atol=1e-12).y[:, -1]
    run = simulate(
        device, none(), duration=TICKS * 1e-3, start=Start(START), disturbance=drive, substeps=128
    )
    found = np.array([run.trace[f"velocity_m{i}"] for i in range(1, N + 1)]).T
    assert np.std(found - truth) < 1e-5 * np.std(truth)
