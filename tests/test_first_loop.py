"""A device to start from where the command is a goal: a loop on the position of one mass."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lsim

from zwidth.console import Console
from zwidth.door import device_of, taken
from zwidth.identification.first_device import Motion
from zwidth.identification.first_loop import first_loop, speed_loop
from zwidth.identification.response import RecordingError
from zwidth.logs.conversion import integrated
from zwidth.logs.recording_file import description_of
from zwidth.logs.source import Floats
from zwidth.logs.source import RecordingError as RecordingFileError

PERIOD, STIFFNESS, DAMPER, LATE = 0.01, 400.0, 30.0, 4


def goal(samples: int = 1500) -> Floats:
    t = PERIOD * np.arange(samples)
    return 0.5 + np.sin(2.0 * t) + 0.3 * np.sign(np.sin(1.3 * t)) + 0.1 * np.sin(17.0 * t)


def answered(asked: Floats, late: int = LATE) -> Floats:
    """The loop in closed form over each sample: q'' + b q' = K (g - q), by scipy's lsim."""
    t = PERIOD * np.arange(asked.size)
    delayed = np.concatenate([np.full(late, asked[0]), asked[: asked.size - late]])
    loop = ([STIFFNESS], [1.0, DAMPER, STIFFNESS])
    return np.asarray(lsim(loop, delayed - asked[0], t, interp=False)[1]) + asked[0]


@pytest.mark.parametrize("late", [0, LATE])
def test_a_loop_is_what_it_is(late: int) -> None:
    """Mutations: no delay fitted; the command held a sample later; the offset of the start."""
    asked = goal()
    quantities = (("position", 0),)
    moved = answered(asked, late)[:, None]
    found = first_loop([Motion(PERIOD, asked, moved, quantities, True)])
    assert found.stiffness == pytest.approx(STIFFNESS, rel=1e-6)
    assert found.damper == pytest.approx(DAMPER, rel=1e-6)
    assert found.delay == pytest.approx(late * PERIOD)
    assert found.error < 1e-6


def test_what_is_no_loop_is_refused() -> None:
    asked = goal(100)
    with pytest.raises(RecordingError, match="100 samples"):
        first_loop([Motion(PERIOD, asked, answered(asked)[:, None], (("position", 0),), True)])
    with pytest.raises(RecordingError, match="needs a goal"):
        first_loop([Motion(PERIOD, None, asked[:, None], (("position", 0),), True)])


def test_a_goal_and_a_position_become_a_drive(tmp_path: Path) -> None:
    """Mutation: the goal taken as a torque."""
    asked = goal()
    table = np.column_stack([PERIOD * np.arange(asked.size), asked, answered(asked)])
    path = tmp_path / "servo.csv"
    np.savetxt(path, table, "%.9g", ",", header="t,goal_pos_rad,present_pos_rad", comments="")
    trace, said = taken(path)
    assert trace.units["command"] == "rad"
    assert any(line.startswith("goal: goal_pos_rad") for line in said)
    file, device, fresh = device_of(Console(None), [("servo", trace)], tmp_path / "out")
    (servo,) = (p for p in device.physics if p.effect.name == "position_servo")
    assert fresh
    assert servo.values["stiffness"] == pytest.approx(STIFFNESS, rel=1e-3)
    assert device.interface.command_gain == pytest.approx(STIFFNESS, rel=1e-3)
    assert file.exists()


def speeds(k_p: float, k_i: float) -> tuple[Floats, Floats]:
    """A goal of a speed and m v' + b v = k_p (g - v) + k_i integral(g - v), m = 0.02, b = 0.05.

    Exact for a goal that is held, by the state of speed and integral.
    """
    asked = np.repeat(np.random.default_rng(3).normal(0.0, 20.0, 30), 50)
    rates = ([[-(0.05 + k_p) / 0.02, k_i / 0.02], [-1.0, 0.0]], [[k_p / 0.02], [1.0]])
    system = (*rates, [[1.0, 0.0]], [[0.0]])
    t = PERIOD * np.arange(asked.size)
    return asked, np.asarray(lsim(system, asked, t, interp=False)[1])


@pytest.mark.parametrize(("k_p", "k_i"), [(0.2, 1.5), (0.1, 0.5), (2.0, 30.0), (2.0, 100.0)])
def test_a_loop_on_the_speed_that_integrates_is_fitted_as_it_is(k_p: float, k_i: float) -> None:
    """Also where it settles within two samples: nothing is held.

    Mutations: the integral taken a sample late; held at its mean (the time is 72 % too long).
    """
    found = speed_loop(*speeds(k_p, k_i), PERIOD)
    assert found.integral_time == pytest.approx(k_p / k_i, rel=1e-5)
    assert found.stiffness == pytest.approx(k_i / 0.02, rel=1e-5)
    assert found.delay == 0.0
    assert found.error < 1e-5 < 0.02 < found.proportional


@pytest.mark.parametrize(("k_p", "k_i"), [(0.2, 1.5), (0.1, 0.5)])
def test_a_loop_on_the_speed_that_integrates_is_one_on_the_position(k_p: float, k_i: float) -> None:
    """But for the hold. Mutation: the speed compared with the position."""
    asked, moved = speeds(k_p, k_i)
    found = speed_loop(asked, moved, PERIOD)
    stamps = np.linspace(0.0, PERIOD * (asked.size - 1), asked.size)
    goal = integrated(asked, stamps, found.integral_time)
    motion = Motion(PERIOD, goal, moved[:, None], (("velocity", 0),), True)
    loop = first_loop([motion])
    assert loop.stiffness == pytest.approx(k_i / 0.02, rel=5e-3)
    assert loop.damper == pytest.approx((0.05 + k_p) / 0.02, rel=5e-3)


def test_a_goal_and_a_speed_become_a_drive_that_integrates(tmp_path: Path) -> None:
    """Mutation: the loop taken in proportion. One in proportion stays so."""
    asked, moved = speeds(0.2, 1.5)
    t = PERIOD * np.arange(asked.size)
    path = tmp_path / "speed.csv"
    np.savetxt(path, np.column_stack([t, 9.55 * asked, 9.55 * moved]), "%.9g", ",",
               header="t,target_rpm,actual_rpm", comments="")  # fmt: skip
    trace, said = taken(path)
    assert trace.units == {"command": "rad", "velocity_m1": "rad/s"}
    assert any("a loop that integrates is taken, of an integral time of 0.13" in s for s in said)
    _, device, _ = device_of(Console(), [("speed", trace)], tmp_path)
    assert device.physics[0].values["stiffness"] == pytest.approx(75.0, rel=0.01)
    asked, moved = speeds(0.2, 1e-9)
    np.savetxt(path, np.column_stack([t, 9.55 * asked, 9.55 * moved]), "%.9g", ",",
               header="t,target_rpm,actual_rpm", comments="")  # fmt: skip
    assert taken(path)[0].units["command"] == "N m"


def test_a_loop_that_is_stiff_against_the_sampling_is_said(tmp_path: Path) -> None:
    """What its speed is too low by is K T^2 / 12, 1.25 %. Mutation: half of that."""
    asked, moved = speeds(2.0, 30.0)
    t = PERIOD * np.arange(asked.size)
    path = tmp_path / "stiff.csv"
    np.savetxt(path, np.column_stack([t, 9.55 * asked, 9.55 * moved]), "%.9g", ",",
               header="t,target_rpm,actual_rpm", comments="")  # fmt: skip
    (told,) = (s for s in taken(path)[1] if "stiff against the sampling" in s)
    assert "1.3 % too low" in told
    assert "record at 354 Hz or more" in told
    held = integrated(asked, np.asarray(t, dtype=np.float64), 2.0 / 30.0)
    motion = Motion(PERIOD, held, moved[:, None], (("velocity", 0),), True)
    assert first_loop([motion]).error > 5e-3  # what the hold leaves


def test_an_integral_time_stands_at_a_speed(tmp_path: Path) -> None:
    text = (
        'file = "a.csv"\ntime = "t"\n[input]\nsignal = "g"\nunit = "rad"\n'
        'integral_time_s = 0.1\n[[output]]\nsignal = "v"\nquantity = "velocity"\nat = "m1"\n'
    )
    with pytest.raises(RecordingFileError, match="integral_time_s is allowed only if the"):
        description_of(text.encode(), tmp_path / "a.toml")
