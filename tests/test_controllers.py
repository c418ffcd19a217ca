"""Control laws: the wall's own truths, and a user's function without compiling the kernel again."""

import math
from typing import Any

import numpy as np
import pytest
from engine_examples import one_mass, phantom

from zwidth.controllers.none import none
from zwidth.controllers.recorded import recorded
from zwidth.controllers.wall import wall
from zwidth.sim.controller import Controller, user_controller
from zwidth.sim.kernel import advance
from zwidth.sim.run import Outcome, Start, simulate

# Numba compiles these; the types are those of sim.controller.SIGNATURE.
FACTOR = 2.5


def spring_and_damper(k, t, y, v, p, m):  # pyright: ignore
    m[0] = 1.0
    return -(p[0] * y + p[1] * v)


def counting(k, t, y, v, p, m):  # pyright: ignore
    m[0] = k
    m[1] += 1.0
    m[2] = t
    return FACTOR * m[1] if k < 3 else 0.0


def sine(k, t, y, v, p, m):  # pyright: ignore
    return p[0] * math.sin(p[1] * t)


def poisoned(k, t, y, v, p, m):  # pyright: ignore
    return math.nan if k == 5 else 0.0


def too_few(k, t, y, v, p):  # pyright: ignore
    return 0.0


def words(k, t, y, v, p, m):  # pyright: ignore
    return "stop"


def forgotten(k, t, y, v, p, m):  # pyright: ignore
    return not_defined_anywhere * y  # noqa: F821  # pyright: ignore


def silent(k, t, y, v, p, m):  # pyright: ignore
    pass


def test_a_users_law_runs_without_compiling_the_kernel_again() -> None:
    """One compiled kernel for all laws. Mutation: `Controller.step` given as an njit function."""
    device = phantom()
    simulate(device, wall(10.0, 0.02), duration=0.01)
    before = list(getattr(advance, "signatures", ()))
    for law in (
        user_controller(spring_and_damper, np.array([10.0, 0.02])),
        user_controller(counting, memory=3),
        user_controller(sine, np.array([1e-3, 50.0])),
        recorded(np.ones(4)),
        none(),
    ):
        assert simulate(device, law, duration=0.01).outcome is Outcome.COMPLETED
    assert list(getattr(advance, "signatures", ())) == before


def test_a_users_wall_is_the_wall() -> None:
    """To the bit, where the formula is the same."""
    mine = user_controller(spring_and_damper, np.array([12.0, 0.03]))
    runs = [
        simulate(phantom(), law, duration=0.5, start=Start(1e-3))
        for law in (mine, wall(12.0, 0.03))
    ]
    for name in runs[0].trace.channels:
        assert np.array_equal(runs[0].trace[name], runs[1].trace[name])


def test_a_law_sees_tick_time_and_its_own_memory() -> None:
    run = simulate(phantom(), user_controller(counting, memory=3), duration=0.005)
    assert run.trace["command"].tolist() == [2.5, 5.0, 7.5, 0.0, 0.0]
    assert run.trace["contact"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert run.memory.controller.tolist() == [4.0, 5.0, 0.004]
    again = simulate(phantom(), user_controller(counting, memory=3), duration=0.005)
    assert np.array_equal(again.trace["command"], run.trace["command"])


def test_the_facts_name_function_and_source() -> None:
    law, other = user_controller(sine, np.ones(2)), user_controller(counting, memory=3)
    assert law.facts["function"] == f"{__name__}:sine"
    assert len(str(law.facts["source_sha256"])) == 64
    assert law.facts["source_sha256"] != other.facts["source_sha256"]


def test_a_law_typed_into_a_shell_works_too() -> None:
    """It has no file: nothing to cache, and its code is hashed instead of its text."""
    space: dict[str, Any] = {}
    exec("def typed(k, t, y, v, p, m):\n    return -3.0 * y", space)
    law = user_controller(space["typed"])
    run = simulate(phantom(), law, duration=0.01, start=Start(1e-3))
    assert run.trace["command"][0] == -3e-3
    assert len(str(law.facts["source_sha256"])) == 64


@pytest.mark.parametrize(
    ("step", "said"),
    [
        (too_few, "takes 5 arguments"),
        (words, "No conversion from Literal"),
        (forgotten, "not_defined_anywhere"),
        (silent, "No conversion from none to float64"),
    ],
)
def test_a_law_that_does_not_compile_is_refused_with_the_reason(step: Any, said: str) -> None:
    with pytest.raises(ValueError, match=said) as caught:
        user_controller(step)
    message = str(caught.value)
    assert message.startswith(f"controller {step.__name__!r} does not compile as float64 step(k,")
    assert "\n" not in message


@pytest.mark.parametrize("thing", [3, "wall", math.sin])
def test_what_is_no_function_is_refused(thing: Any) -> None:
    with pytest.raises(ValueError, match="a function step"):
        user_controller(thing)


def test_parameters_are_one_row() -> None:
    with pytest.raises(ValueError, match="one row"):
        user_controller(sine, np.ones((2, 2)))
    with pytest.raises(ValueError, match="not finite"):
        user_controller(sine, np.array([1.0, np.nan]))
    with pytest.raises(ValueError, match=r"memory is 0"):
        user_controller(sine, np.ones(2), memory=0)
    with pytest.raises(ValueError, match="one value for each tick"):
        recorded(np.ones((2, 2)))
    with pytest.raises(ValueError, match=r"stiffness is nan"):
        wall(math.nan, 0.0)


@pytest.mark.parametrize("limit", [math.inf, 1.0])
def test_a_command_that_is_no_number_ends_the_run(limit: float) -> None:
    """Mutation: `limit_command` as max(-limit, min(limit, command)), which makes NaN full force."""
    device = phantom().with_interface(command_limit=limit, delay=0.0)
    run = simulate(device, user_controller(poisoned), duration=0.1, start=Start(1e-3))
    assert run.outcome is Outcome.NOT_FINITE
    assert len(run.trace) == 6


def test_a_one_sided_wall_pushes_out_and_never_pulls() -> None:
    """Free outside, u <= 0 inside also while the mass leaves fast against the damper."""
    run = simulate(
        one_mass(1e-3, 0.0), wall(40.0, 0.03, 1e-3, one_sided=True), duration=0.3,
        start=Start(0.0, 0.2),
    )  # fmt: skip
    x, u = run.trace["position_m1"], run.trace["command"]
    assert u.max() <= 0.0
    assert u.min() < -0.01
    assert not u[x <= 1e-3].any()
    leaving = (x > 1e-3) & (run.trace["velocity_estimate"] < -0.1)
    assert np.any(u[leaving] == 0.0)
    assert np.array_equal(run.trace["contact"] == 1.0, x > 1e-3)


def test_a_controllers_kind_is_kept() -> None:
    assert [law.kind for law in (wall(1.0, 0.0), none(), recorded(np.ones(2)))] == [
        "wall", "none", "recorded",
    ]  # fmt: skip
    assert isinstance(user_controller(sine, np.ones(2)), Controller)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"duration": 0.0}, "duration is 0.0"),
        ({"duration": math.nan}, "duration is nan"),
        ({"duration": 0.01, "substeps": 0}, "substeps is 0"),
        ({"duration": 0.01, "bound": 0.0}, "bound is 0.0"),
        ({"duration": 0.01, "start": Start([1.0, 2.0])}, "start.position has 2 values"),
        ({"duration": 0.01, "start": Start(0.0, math.inf)}, "start.velocity is inf"),
        ({"duration": 0.01, "disturbance": np.ones(3)}, r"disturbance has shape \(3, 3\)"),
        ({"duration": 0.01, "disturbance": np.full(10, math.nan)}, "not finite"),
    ],
)
def test_a_run_refuses_what_cannot_be(arguments: dict[str, Any], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        simulate(phantom(), none(), **arguments)


def test_a_run_that_leaves_the_bound_stops_there() -> None:
    run = simulate(phantom(), wall(60.0, 0.0), duration=10.0, start=Start(1e-3), bound=0.1)
    assert run.outcome is Outcome.ESCAPED
    assert len(run.trace) < 10000
    assert np.abs(run.trace["position_m1"]).max() <= 0.1
    assert abs(run.memory.x[0]) > 0.1
