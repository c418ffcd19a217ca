"""A sample without a number is a lost sample, in every format: as if its row had been deleted."""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar, cast

import numpy as np
import pyarrow as pa
import pytest
from gap_examples import FORMATS, Cell, csv_table
from numpy.typing import NDArray
from pyarrow import parquet
from recording_examples import EPOCH, recorded, wave

from zwidth.cli import run
from zwidth.diagnosis.intake.gate import examine
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError, stretches
from zwidth.logs.cells import column_of
from zwidth.logs.stretches import without_gaps
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.trace import Trace

Number = TypeVar("Number", int, float)
Floats = NDArray[np.float64]
MASS = Device("mass", "", True, make_chain([0.5], [0.0]), Interface(period=0.001))
SAMPLES = 1500
LOST_POSITIONS = [*range(5), *range(400, 415), 700, *range(1495, 1500)]  # late, and ends early
LOST_COMMANDS = [1000, 1001, 1002, 1003]
LOST = [*LOST_POSITIONS, *LOST_COMMANDS]
TOML = """
    file = "{file}"
    time = "{time}"
    rotary = true
    {more}
    [input]
    signal = "{command}"
    [[output]]
    signal = "{position}"
    quantity = "position"
    at = "m1"
    """


def motion() -> tuple[list[float], list[float], list[float]]:
    t, u, x = wave(SAMPLES)
    return t.tolist(), u.tolist(), x.tolist()


def filled(values: Sequence[float], rows: Sequence[int], hole: Cell) -> list[Cell]:
    return [hole if k in rows else value for k, value in enumerate(values)]


def without(values: Sequence[Number], rows: Sequence[int]) -> list[Number]:
    return [value for k, value in enumerate(values) if k not in rows]


def read(
    folder: Path, kind: str, t: list[float], u: Sequence[Cell], x: Sequence[Cell], more: str = ""
) -> Trace:
    """Write a recording in a format, describe it, and read it."""
    known = FORMATS[kind]
    toml = TOML.format(
        file=kind.replace("_", "."), time=known.time, command=known.command,
        position=known.position, more=more,
    )  # fmt: skip
    return recorded(folder, toml, **{kind: known.write(t, list(u), list(x))})


def trace_of(position: Floats) -> Trace:
    t, u, _ = wave(SAMPLES)
    units = {"command": "N m", "position_m1": "rad"}
    return Trace(t, {"command": u, "position_m1": position}, units, "recorded")


def cut(trace: Trace) -> list[Experiment]:
    return stretches(trace, MASS, "rig")


def warnings_of(trace: Trace) -> list[str]:
    return cast("list[str]", trace.facts["warnings"])


@pytest.mark.parametrize(
    ("kind", "hole"), [(kind, hole) for kind, known in FORMATS.items() for hole in known.holes]
)
def test_samples_without_a_number_and_rows_deleted_are_diagnosed_alike(
    tmp_path: Path, kind: str, hole: Cell
) -> None:
    """A sensor that begins late and ends early, a long gap, one lost sample, four lost commands.

    Mutations that break it: samples without a number taken as read; only the output looked at;
    begins counted from the first sample that is known; a field that some messages lack given the
    stamps of the others alone.
    """
    t, u, x = motion()
    deleted = cut(read(tmp_path, kind, without(t, LOST), without(u, LOST), without(x, LOST)))
    assert [e.ticks for e in deleted] == [395, 1080]
    trace = read(tmp_path, kind, t, filled(u, LOST_COMMANDS, hole), filled(x, LOST_POSITIONS, hole))
    found = cut(trace)
    assert [e.ticks for e in found] == [e.ticks for e in deleted]
    for one, other in zip(found, deleted, strict=True):
        assert one.bridged is not None
        assert other.bridged is not None
        np.testing.assert_array_equal(one.bridged, other.bridged)
        np.testing.assert_array_equal(one.command[~one.bridged], other.command[~one.bridged])
        np.testing.assert_allclose(one.command, other.command, atol=1e-4)  # told by a line, once
        known = ~one.bridged
        np.testing.assert_array_equal(one.measured[known], other.measured[known])
        np.testing.assert_allclose(one.measured, other.measured, rtol=1e-12)
        assert one.outputs == other.outputs
        assert one.swing == pytest.approx(other.swing, rel=1e-12)
        assert one.period == pytest.approx(other.period, rel=1e-9)
        assert one.begins == pytest.approx(other.begins + 0.005, abs=1e-9)  # after the first row
    lacking = (
        "30 of 1500 samples of rig have no number for command, position_m1 and are taken as lost: 5"
        " gaps, the first at 0 s; 2 gaps of at most 4 samples, 5 together, are bridged"
    )
    assert any(note.startswith(lacking) for note in found[0].notes)
    warned = " ".join(warnings_of(trace))
    assert "position_m1 is not finite in 26 of 1500 samples, first in sample 0" in warned
    assert ("4 cells of 1500 in column" in warned) == (hole == "err")
    assert ("first 'err' in" in warned) == (hole == "err")


def test_the_diagnosis_tells_samples_without_a_number() -> None:
    """Mutation: the note left out of the stretches."""
    _, _, x = wave(SAMPLES)
    x[700] = np.nan
    said = [fault.sentence for fault in examine(MASS, cut(trace_of(x)))]
    assert any("1 of 1500 samples of rig has no number for position_m1" in s for s in said)
    assert any("1 gap of 1 sample, 1 together, is bridged" in s for s in said)


def test_a_sensor_at_a_mass_that_the_device_has_not_costs_no_sample() -> None:
    """Mutation: every channel of the recording looked at."""
    t, u, x = wave(SAMPLES)
    channels = {"command": u, "position_m1": x, "position_m3": np.full(SAMPLES, np.nan)}
    trace = Trace(t, channels, dict.fromkeys(channels, "rad"), "recorded")
    assert [e.ticks for e in cut(trace)] == [SAMPLES]


def test_where_too_little_is_left_the_sentence_counts_what_lacks() -> None:
    """Mutation: the sentence on the samples that lack left out of the error."""
    t, _, x = wave(SAMPLES)
    with pytest.raises(ExperimentError, match=r"1400 of 1500 samples.*the recording has 100 sam"):
        cut(trace_of(np.where(t < 0.1, x, np.nan)))
    with pytest.raises(ExperimentError, match=r"samples that lack.*record without gaps"):
        cut(trace_of(np.where(np.arange(SAMPLES) % 50 > 10, x, np.nan)))


@pytest.mark.parametrize("period", ["true", "0.004"])
def test_resampling_takes_a_sample_without_a_number_for_one_that_is_not_there(
    tmp_path: Path, period: str
) -> None:
    """A NaN would spread to its neighbours, and through a mean over ticks to all that follows.

    Mutation: the rows without a finite value kept before resampling.
    """
    t, u, x = motion()
    rows, more = [0, 1, 700, 1000, 1001], f"resample = {period}"
    deleted = read(tmp_path, "a_csv", without(t, rows), without(u, rows), without(x, rows), more)
    holes = read(tmp_path, "a_csv", t, filled(u, rows, "nan"), filled(x, rows, "nan"), more)
    np.testing.assert_array_equal(holes.t, deleted.t)
    for channel in ("command", "position_m1"):
        np.testing.assert_array_equal(holes[channel], deleted[channel])
    assert any("position_m1 is not finite in 5 of 1500" in w for w in warnings_of(holes))
    assert any("3 samples are missing in 2 gaps" in w for w in warnings_of(holes))


def test_rows_whose_time_is_missing_are_left_out(tmp_path: Path) -> None:
    """Times [ns] stay whole numbers, which doubles would round to 256 ns.

    Mutation: dates among which one is missing taken as doubles.
    """
    t, u, x = motion()
    stamps, rows = [EPOCH + round(s * 1e9) for s in t], [1, 2, 700]
    dates = pa.array([None if k in rows else ns for k, ns in enumerate(stamps)], pa.timestamp("ns"))
    kept = pa.array(without(stamps, rows), pa.timestamp("ns"))
    toml = TOML.format(
        file="a.parquet", time="t", command="u", position="x", more='time_unit = "ns"'
    )
    traces: list[Trace] = []
    for table in (
        pa.table({"t": dates, "u": u, "x": x}),
        pa.table({"t": kept, "u": without(u, rows), "x": without(x, rows)}),
    ):
        out = io.BytesIO()
        parquet.write_table(table, out)
        traces.append(recorded(tmp_path, toml, a_parquet=out.getvalue()))
    np.testing.assert_array_equal(traces[0].t, traces[1].t)
    np.testing.assert_array_equal(traces[0]["position_m1"], traces[1]["position_m1"])
    assert "time 't' is not finite in 3 of 1500 samples" in warnings_of(traces[0])[0]


def test_a_text_among_the_times_is_a_row_that_is_lost(tmp_path: Path) -> None:
    """Mutation: the note on the cells of the times left out."""
    t, u, x = motion()
    lines = csv_table(t, list(u), list(x)).split(b"\n")
    lines[701] = lines[701].replace(repr(t[700]).encode(), b"late")
    data = b"\n".join(lines)
    toml = TOML.format(file="a.csv", time="t", command="u", position="x", more="")
    trace = recorded(tmp_path, toml, a_csv=data)
    (whole,) = cut(trace)
    assert np.flatnonzero(whole.bridged).tolist() == [700]  # pyright: ignore[reportArgumentType]
    assert any("first 'late' in line 702; taken as a gap" in w for w in warnings_of(trace))


def test_convert_counts_gaps_and_quotes_the_first_text(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Mutation: only the count in the table, without a sentence."""
    t, u, x = motion()
    (tmp_path / "a.csv").write_bytes(csv_table(t, filled(u, [3], None), filled(x, [700], "err")))
    assert run(["convert", str(tmp_path / "a.csv")]) == 0
    error = " ".join(capsys.readouterr().err.split())
    assert "u is not finite in 1 of 1500 samples, first in sample 3; taken as a gap" in error
    said = "1 cell of 1500 in column 'x' is no number, first 'err' in line 702; taken as a gap"
    assert said in error


def test_a_field_that_most_messages_tell_as_text_is_no_signal(tmp_path: Path) -> None:
    """Mutation: the rule on texts asked of tables alone."""
    t, u, x = motion()
    cells: list[Cell] = [value if k % 3 == 0 else "idle" for k, value in enumerate(x)]
    with pytest.raises(ValueError, match=r"'/axis.x' is text in 1000 of 1500 messages, first 'idl"):
        read(tmp_path, "a_mcap", t, u, cells)


def test_a_column_is_text_from_as_many_texts_as_numbers_on() -> None:
    """Mutations: the comparison without equality; blank cells counted as numbers."""
    assert column_of("a", ["1", "b", "", None]) is None
    assert column_of("a", ["", None]) is None
    found = column_of("a", ["1", "b", " 2 ", None, True])
    assert found is not None
    np.testing.assert_array_equal(found[0], [1.0, np.nan, 2.0, np.nan, 1.0])
    said = "1 cell of 5 in column 'a' is no number, first 'b' in sample 1; taken as a gap"
    assert found[1] == said


def test_a_trace_without_a_gap_is_given_back_as_it_is() -> None:
    """Mutation: a sentence on no sample at all."""
    trace = trace_of(wave(SAMPLES)[2])
    kept, said = without_gaps(trace, ["command", "position_m1"], "rig")
    assert kept is trace
    assert said == ""
