"""Tables as strangers' programs leave them: clocks, rows, names and units of many kinds."""

import datetime
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from zwidth.door import taken
from zwidth.logs.errors import LogError
from zwidth.logs.source import Floats

SAMPLES, RATE = 600, 100.0
T: Floats = np.arange(SAMPLES, dtype=np.float64) / RATE
RANDOM = np.random.default_rng(3)
U = np.repeat(RANDOM.normal(0.0, 0.1, SAMPLES // 20), 20)
Q = np.cumsum(np.cumsum(U)) * 0.01 + 0.3 * np.sin(0.7 * T)
BEGUN = datetime.datetime(2024, 3, 5, 10, 22, 33, tzinfo=datetime.UTC)

Column = Sequence[str] | np.ndarray


def text(names: str, *columns: Column, above: str = "") -> str:
    rows = zip(*([c if isinstance(c, str) else f"{c:.9g}" for c in one] for one in columns),
               strict=True)  # fmt: skip
    return "\n".join([*([above] if above else []), names, *(",".join(row) for row in rows), ""])


def lists(*columns: Floats) -> list[str]:
    return ['"[' + ", ".join(f"{x:.6f}" for x in row) + ']"' for row in zip(*columns, strict=True)]


def own_rows() -> str:
    """Two sources on clocks of their own, the slower one ends earlier."""
    slow = [f"{t:.4f},{u:.5f}" for t, u in zip(T[::2], U[::2], strict=True)]
    slow += [","] * (SAMPLES - len(slow))
    fast = [f"{t + 0.0013:.4f},{q:.6f}" for t, q in zip(T, Q, strict=True)]
    rows = [f"{one},{other}" for one, other in zip(slow, fast, strict=True)]
    return "\n".join(["t_cmd,torque_cmd,t_pos,position", *rows, ""])


def long_rows() -> str:
    rows = [
        f"{t:.4f},/cmd/torque,{u:.5f}\n{t + 0.0004:.4f},/joint/position,{q:.6f}"
        for t, u, q in zip(T, U, Q, strict=True)
    ]
    return "\n".join(["timestamp,topic,value", *rows, ""])


def spoken_rows() -> str:
    """A board's words before and between its rows."""
    rows = text("time_us,pwm,enc", 1e4 * np.arange(SAMPLES), np.rint(800 * U), np.rint(300 * Q))
    lines = rows.splitlines()
    return "\n".join(["rst:0x1 (POWERON_RESET)", *lines[:300], "WARN: late", *lines[300:], ""])


def days() -> list[str]:
    return [f"{45356.4323 + t / 86400.0:.11f}" for t in T]


def ticks() -> list[str]:
    return [str(638_450_000_000_000_000 + round(1e7 * t)) for t in T]


CASES: dict[str, tuple[str, dict[str, str]]] = {
    "two clocks": (own_rows(), {"command": "torque_cmd", "position_m1": "position"}),
    "a row for each topic": (
        long_rows(), {"command": "/cmd/torque", "position_m1": "/joint/position"},
    ),
    "words between rows": (spoken_rows(), {"command": "pwm", "position_m1": "enc"}),
    "lists in cells": (
        text("Time,position,effort", T, lists(Q, 0.0 * Q), lists(U, 0.0 * U)),
        {"command": "effort[0]", "position_m1": "position[0]"},
    ),
    "durations": (
        text("Time,u,angle", [f"{t:.2f} sec" for t in T], U, Q),
        {"command": "u", "position_m1": "angle"},
    ),
    "a timedelta": (
        text("time,u,angle", [f"0 days 00:00:{t:09.6f}" for t in T], U, Q),
        {"command": "u", "position_m1": "angle"},
    ),
    "days": (text("Date/Time,torque,angle", days(), U, Q),
             {"command": "torque", "position_m1": "angle"}),
    "ticks": (text("Ticks,torque,angle", ticks(), U, Q),
              {"command": "torque", "position_m1": "angle"}),
    "a period in each row": (text("dt,torque,theta", np.full(SAMPLES, 0.01), U, Q),
                             {"command": "torque", "position_m1": "theta"}),
    "a rate in each row": (
        text("frame,fps,force_N,pos_mm", np.rint(100.0 * T), np.full(SAMPLES, 100.0), U, Q),
        {"command": "force_N", "position_m1": "pos_mm"},
    ),
    "newton metres in small letters": (text("t,torque_nm,angle_rad", T, U, Q),
                                       {"command": "torque_nm", "position_m1": "angle_rad"}),
    "objects of a drive": (
        text("Time,Target torque (6071h),Position actual value (6064h)", T, U, np.rint(1e4 * Q)),
        {"command": "Target torque", "position_m1": "Position actual value"},
    ),
    "a spring's torque": (text("t,spring_torque,cmd_current,motor_pos", T, 0.1 * Q, U, Q),
                          {"command": "cmd_current", "position_m1": "motor_pos"}),
    "Chinese": (text("时间(ms),目标位置(deg),实际位置(deg),电流(A)", 1e3 * T, Q, Q, U),
                {"command": "电流", "position_m1": "实际位置"}),
    "a loop's letters": (text("t,sp,pv,out", T, Q, Q + 1e-3 * U, U),
                         {"command": "out", "position_m1": "pv"}),
    "left and right": (text("t,posR,posL,pwmR,pwmL", T, Q, 0.1 * Q, U, 0.1 * U),
                       {"command": "pwmR", "position_m1": "posR"}),
    "a unit that is not known": (
        text("Zeit,Drehmoment,Winkel", T, U, Q).replace("\n", "\ns,Nm,Striche\n", 1),
        {"command": "Drehmoment", "position_m1": "Winkel"},
    ),
    "Python's logging": (
        "".join(f"INFO:root:t={t:.3f} pos={q:.5f} cmd={u:.4f}\n"
                for t, q, u in zip(T, Q, U, strict=True)),
        {"command": "cmd", "position_m1": "pos"},
    ),
}  # fmt: skip


def signals_of(path: Path) -> tuple[dict[str, str], float, list[str]]:
    trace, said = taken(path)
    told = cast("Mapping[str, Mapping[str, Any]]", trace.facts["signals"])
    period = float(np.median(np.diff(trace.t)))
    return {channel: str(one["signal"]) for channel, one in told.items()}, 1.0 / period, said


@pytest.mark.parametrize("case", CASES)
def test_the_columns_of_a_strange_table_are_told(case: str, tmp_path: Path) -> None:
    """Each fails where its own reader or rule is taken out."""
    content, expected = CASES[case]
    path = tmp_path / "strange.csv"
    path.write_text(content, encoding="utf-8")
    found, rate, _ = signals_of(path)
    assert found == expected
    assert rate == pytest.approx(50.0 if case == "two clocks" else RATE, rel=0.01)


def test_a_short_or_still_column_of_topics_is_no_table_of_rows(tmp_path: Path) -> None:
    """Mutation: any column of words takes rows apart."""
    path = tmp_path / "one.csv"
    state = ["ready"] * 300 + ["busy"] * 300
    path.write_text(text("time,name,torque,angle", T, state, U, Q))
    assert signals_of(path)[0] == {"command": "torque", "position_m1": "angle"}


def test_two_times_of_the_same_rows_are_no_clocks_of_their_own(tmp_path: Path) -> None:
    """Mutation: clocks that run together in the same rows taken apart."""
    path = tmp_path / "one.csv"
    path.write_text(text("time,torque,sensor_time,angle", T, U, T + 1e-5, Q))
    trace, said = taken(path)
    assert "time: time [s], 100 samples a second" in said
    assert len(trace) == SAMPLES


def test_many_spoiled_rows_are_refused(tmp_path: Path) -> None:
    """Mutation: no bound on the rows left out."""
    lines = text("t,torque,angle", T, U, Q).splitlines()
    lines[10:30] = [line.rsplit(",", 1)[0] for line in lines[10:30]]
    path = tmp_path / "torn.csv"
    path.write_text("\n".join([*lines, ""]))
    with pytest.raises(LogError, match="line 11 has 2 cells but the table has 3"):
        taken(path)
    lines = text("t,torque,angle", T, U, Q).splitlines()
    lines[10] = "0.09,0.0"
    path.write_text("\n".join([*lines, ""]))
    trace, _ = taken(path)
    warnings = cast("list[str]", trace.facts["warnings"])
    assert any(
        "1 line is not a row of the table and left out, first line 11" in w for w in warnings
    )


@pytest.mark.parametrize("lengths", [(200, 200, 200), (150, 250, 200)])
def test_runs_that_begin_anew_are_taken_one_after_another(
    lengths: tuple[int, ...], tmp_path: Path
) -> None:
    """Mutation: a clock that begins anew taken for a counter that wraps."""
    t = np.concatenate([np.arange(n) / RATE for n in lengths])
    path = tmp_path / "episodes.csv"
    path.write_text(text("t,torque,angle", t, U, Q))
    trace, _ = taken(path)
    warnings = cast("list[str]", trace.facts["warnings"])
    assert any("starts again at 0 s, twice: 3 runs are taken" in w for w in warnings)
    assert np.flatnonzero(np.diff(trace.t) > 0.5).tolist() == [lengths[0] - 1, sum(lengths[:2]) - 1]


def test_names_beside_a_matrix_are_those_of_its_columns(tmp_path: Path) -> None:
    """Mutation: names not looked at."""
    path = tmp_path / "named.npz"
    names = np.array(["time", "torque", "position"])
    np.savez(path, data=np.column_stack([T, U, Q]), columns=names)
    assert signals_of(path)[0] == {"command": "torque", "position_m1": "position"}


NESTED: tuple[Callable[[], str], ...] = (
    lambda: "time,topic,value\n" + "0,a,1\n" * 40,
    lambda: "t_a,t_b\n" + "0,0\n" * 40,
    lambda: "t,x\n" + '0,"[1, 2]"\n1,"[1]"\n' * 20,
    lambda: "t,x\n" + '0,"[[1], 2]"\n' * 20,
    lambda: "Ticks,x\n" + "1e300,1\n" * 20,
    lambda: "dt,x\n" + "nan,1\n" * 20,
    lambda: "fps,x\n" + "1e-320,1\n" * 20,
    lambda: "t_a,u,t_b,y\n" + "1e308,1,-1e308,2\n" * 20,
)


@pytest.mark.parametrize("hostile", range(len(NESTED)))
def test_what_looks_like_such_a_table_and_is_none_ends_in_a_sentence(
    hostile: int, tmp_path: Path
) -> None:
    path = tmp_path / "hostile.csv"
    path.write_text(NESTED[hostile]())
    with pytest.raises(LogError, match=r"hostile"):
        taken(path)
