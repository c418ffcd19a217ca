"""A device to start from where the command is a goal: a loop on the position of one mass."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lsim

from zwidth.console import Console
from zwidth.door import device_of, taken
from zwidth.identification.first_device import Motion
from zwidth.identification.first_loop import first_loop
from zwidth.identification.response import RecordingError
from zwidth.logs.source import Floats

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
