"""Forms with more than one reading: runs side by side, labels of several signals, fine clocks."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io
from numpy.typing import NDArray

from zwidth.door import taken
from zwidth.logs.names import read_name, together
from zwidth.logs.open_source import open_source

Floats = NDArray[np.float64]
SAMPLES, PERIOD = 600, 0.002


def motion(seed: int) -> tuple[Floats, Floats, Floats]:
    t = PERIOD * np.arange(SAMPLES, dtype=np.float64)
    return t, np.sin(9.0 * t + seed), 0.2 * np.cos(7.0 * t + seed)


def csv(path: Path, heads: list[str], columns: list[Floats], shorter: int = 0) -> Path:
    table = np.column_stack(columns).astype(object)
    if shorter:
        table[-shorter:, len(columns) // 2 :] = ""
    rows = [",".join(str(cell) for cell in row) for row in table]
    path.write_text("\n".join([*heads, *rows, ""]))
    return path


@pytest.mark.parametrize(
    "heads",
    [
        ["time,torque,angle,time,torque,angle"],
        ["Run 1 time,Run 1 torque,Run 1 angle,Run 2 time,Run 2 torque,Run 2 angle"],
    ],
)
def test_runs_side_by_side_are_runs(tmp_path: Path, heads: list[str]) -> None:
    """The second ends earlier. Mutation: a column of one run with a column of the other."""
    path = csv(tmp_path / "two.csv", heads, [*motion(1), *motion(2)], shorter=100)
    source = open_source(path)
    assert list(source.signals) == ["time", "torque", "angle"]
    for name, k in (("torque", 1), ("angle", 2)):
        together = np.concatenate([motion(1)[k], motion(2)[k][:-100]])
        np.testing.assert_allclose(source[name].floats(), together)
    assert any("2 runs are side by side" in note for note in source.notes)
    trace, _ = taken(path)
    assert len(trace) == 2 * SAMPLES - 100
    np.testing.assert_allclose(trace["command"][:SAMPLES], motion(1)[1])


def test_signals_with_clocks_of_their_own_are_no_runs(tmp_path: Path) -> None:
    """Mutation: any two columns of time taken for two runs."""
    t, u, x = motion(1)
    path = csv(tmp_path / "own.csv", ["t_cmd,torque,t_pos,angle"], [t, u, t, x])
    assert {"torque", "angle"} <= set(open_source(path).signals)
    path = csv(tmp_path / "joints.csv", ["time,q,time,qd"], [t, x, t, u])
    assert len(open_source(path)["q"].values) == SAMPLES


def scope(values: Floats, label: str) -> dict[str, object]:
    signals = {"values": values, "dimensions": float(values.shape[1]), "label": label}
    return {"time": motion(1)[0][:, None], "signals": signals}


def test_a_label_of_several_signals_names_each(tmp_path: Path) -> None:
    """As Simulink writes a scope of a mux. Mutation: the label ignored where there is a matrix."""
    t, u, x = motion(1)
    path = tmp_path / "scope.mat"
    three = np.column_stack([u, x, np.gradient(x, t)])
    scipy.io.savemat(path, {"ScopeData": scope(three, "<torque>, angle, speed")})
    source = open_source(path)
    assert {"torque", "angle", "speed"} <= set(source.signals)
    np.testing.assert_array_equal(source["ScopeData.signals.values(:,2)"].values, x)
    trace, _ = taken(path)
    np.testing.assert_allclose(trace["command"], u)
    np.testing.assert_allclose(trace["position_m1"], x)


@pytest.mark.parametrize("label", ["", "state", "q, v, a"])
def test_a_label_of_another_number_names_none(tmp_path: Path, label: str) -> None:
    """Mutation: columns called by one label, which both would be a position."""
    _, u, x = motion(1)
    path = tmp_path / "scope.mat"
    scipy.io.savemat(path, {"state": scope(np.column_stack([x, u]), label)})
    assert {"state.signals.values(:,1)", "state.signals.values(:,2)"} <= set(
        open_source(path).signals
    )


@pytest.mark.parametrize(("step", "rate"), [(20, 500.0), (100, 100.0), (10_000, 100.0)])
def test_the_fine_clock_of_xsens(tmp_path: Path, step: int, rate: float) -> None:
    """10 kHz of an MTi, which wraps at 32 bits; microseconds of a DOT. Mutation: milliseconds."""
    fine = (np.arange(SAMPLES) * step + 2**32 - 3000) % 2**32
    _, u, x = motion(1)
    path = csv(tmp_path / "mti.csv", ["SampleTimeFine,torque_Nm,angle_rad"],
               [fine.astype(np.float64), u, x])  # fmt: skip
    trace, _ = taken(path)
    assert 1.0 / np.median(np.diff(trace.t)) == pytest.approx(rate)


def test_goals_of_libfranka_are_goals_also_of_many_joints() -> None:
    """Beside q and dq of the same joint; alone it may be a speed. Mutation: by name."""
    names = [f"{q}[{k}]" for q in ("q", "q_d", "dq", "dq_d", "tau_J_d") for k in range(2)]
    told = together(names)
    assert (told["q_d[1]"].quantity, told["q_d[1]"].role) == ("position", "goal")
    assert (told["dq_d[0]"].quantity, told["dq_d[0]"].role) == ("velocity", "goal")
    assert together(["q[0]", "q_d[0]"]) == {}


def test_what_a_controller_gives_is_no_position() -> None:
    """Mutation: the end of a path read without what stands before."""
    said = read_name("Model Root/Controller/Out1")
    assert (said.quantity, said.role) == ("input", "command")
    assert read_name("Model Root/Plant/Out1").quantity == "position"
