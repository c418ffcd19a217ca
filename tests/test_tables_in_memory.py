"""Recordings that a program holds: frames, dictionaries, arrays, with columns named or told."""

import importlib

import numpy as np
import pytest

from zwidth.api.given import named_traces, trace_of
from zwidth.logs.in_memory import AnyTable
from zwidth.logs.source import RecordingError
from zwidth.sim.trace import Trace

T = 0.01 * np.arange(300)
U, Q = np.cos(5.0 * T), np.sin(3.0 * T)
NAMED = {"time": "a", "command": "b", "position": "c"}


def read(table: AnyTable, columns: dict[str, str] | None = None) -> Trace:
    with pytest.warns(UserWarning, match="the table: assumed"):
        return trace_of(table, columns)


def same(trace: Trace) -> None:
    np.testing.assert_allclose(trace.t, T)
    np.testing.assert_allclose(trace["command"], U)
    np.testing.assert_allclose(trace["position_m1"], Q)


def test_columns_that_are_named() -> None:
    """Mutation: the names passed over; none of these says what it is."""
    same(read({"a": T, "b": U, "c": Q, "d": Q**2}, NAMED))
    array = np.column_stack([Q, U, T])
    same(read(array, {"time": "2", "command": "1", "position": "0"}))
    fields = np.empty(T.size, dtype=[("a", "f8"), ("b", "f8"), ("c", "f8")])
    fields["a"], fields["b"], fields["c"] = T, U, Q
    same(read(fields, NAMED))


def test_columns_that_tell_themselves() -> None:
    same(read({"t_ms": 1e3 * T, "torque": U, "angle": Q}))
    found = trace_of({"t": T, "torque_mNm": 1e3 * U, "angle_deg": np.degrees(Q), "temp": T + 20.0})
    np.testing.assert_allclose(found["command"], U)
    np.testing.assert_allclose(found["position_m1"], Q)


@pytest.mark.parametrize("library", ["pandas", "polars"])
def test_frames(library: str) -> None:
    """Mutation: the index of pandas passed over, where it is the time."""
    frames = pytest.importorskip(library)
    same(read(frames.DataFrame({"a": T, "b": U, "c": Q}), NAMED))
    stamps = np.datetime64("2024-05-03T10:00:00", "ns") + (1e9 * T).astype("timedelta64[ns]")
    frame = frames.DataFrame({"when": stamps, "u": U, "q": Q})
    same(read(frame.set_index("when") if library == "pandas" else frame, {"time": "when"}))


def test_a_table_of_arrow() -> None:
    """Mutation: its columns taken for their names."""
    arrow = importlib.import_module("pyarrow")
    same(read(arrow.table({"a": T, "b": U, "c": Q}), NAMED))


def test_the_errors_name_the_argument() -> None:
    with pytest.raises(RecordingError, match=r"command is 'torqe', which is not a .*'torque'"):
        trace_of({"t": T, "torque": U, "angle": Q}, {"command": "torqe"})
    with pytest.raises(RecordingError, match="has no column of numbers"):
        trace_of({"t": ["a", "b", "c"]})
    with pytest.raises(RecordingError, match="3 dimensions"):
        trace_of(np.zeros((2, 2, 2)))
    with pytest.raises(TypeError, match="recording is of type int"):
        importlib.import_module("zwidth.api.given").trace_of(7)


def test_one_table_and_several() -> None:
    """Mutation: a dictionary taken for several recordings, its keys."""
    table = {"t": T, "torque_Nm": U, "angle_rad": Q}
    one, two = named_traces(table), named_traces([table, table])
    assert [name for name, _ in one] == ["recording"]
    assert len(two) == 2
