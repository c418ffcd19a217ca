"""A log to another format and back: every sample to the bit, and nothing lost in silence."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from exported_examples import HERE, bare_log, full_log
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as nps
from log_examples import ATTACHMENTS, EPOCH, EVENTS, METADATA, assert_same, example

from zwidth.logs.csv_file import read_csv
from zwidth.logs.events import Event
from zwidth.logs.export import WRITERS
from zwidth.logs.mcap_reader import Log, read_log
from zwidth.logs.mcap_writer import write_log
from zwidth.logs.npz_file import read_npz
from zwidth.logs.open_source import read_own
from zwidth.logs.parquet_file import read_parquet
from zwidth.logs.source import RecordingError
from zwidth.logs.table_log import log_of
from zwidth.sim.trace import Trace

READERS = {".csv": read_csv, ".parquet": read_parquet, ".npz": read_npz}
SUFFIXES = list(WRITERS)


def through(suffix: str, log: Log) -> tuple[Log, list[str]]:
    """Return what comes back, and what the writer said it left out."""
    out = io.BytesIO()
    left_out = WRITERS[suffix](out, log)
    return log_of(READERS[suffix](HERE, out.getvalue())), left_out


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_kept_is_equal_and_what_is_not_is_named(suffix: str) -> None:
    log = full_log()
    found, left_out = through(suffix, log)
    assert_same(found.tick, log.tick)
    assert found.tick.facts == log.tick.facts
    assert found.metadata == log.metadata
    assert found.epoch_ns == EPOCH
    assert found.warnings == ()
    assert (found.substep is None) == any("substep" in item for item in left_out)
    assert (found.events == ()) == any("2 events" in item for item in left_out)
    assert (found.attachments == {}) == any("propagators.npy" in item for item in left_out)
    if found.substep is not None:
        assert_same(found.substep, log.substep or log.tick)
    if found.events:
        assert found.events == EVENTS
    if found.attachments:
        assert found.attachments == ATTACHMENTS
    assert len(left_out) == {".csv": 3, ".parquet": 1, ".npz": 0}[suffix]


def test_mcap_through_npz_is_the_same_log(tmp_path: Path) -> None:
    log = full_log()
    assert log.substep is not None
    write_log(
        tmp_path / "a.mcap",
        log.tick,
        substep=log.substep,
        events=log.events,
        metadata=METADATA,
        attachments=log.attachments,
        epoch_ns=EPOCH,
    )
    first = read_log(tmp_path / "a.mcap")
    with (tmp_path / "a.npz").open("wb") as stream:
        assert WRITERS[".npz"](stream, first) == []
    second = read_own(tmp_path / "a.npz")
    assert_same(second.tick, first.tick)
    assert_same(second.substep or second.tick, log.substep)
    assert (second.events, second.attachments) == (first.events, first.attachments)
    assert (second.metadata, second.epoch_ns) == (first.metadata, first.epoch_ns)
    assert second.tick.facts == first.tick.facts


NAMES = st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), min_size=1, max_size=6)
DOUBLES = st.floats(allow_nan=False) | st.sampled_from(
    [np.nan, -0.0, 5e-324, 1.7976931348623157e308]
)


@st.composite
def traces(draw: st.DrawFn) -> Trace:
    """Draw traces of any length, names, units and doubles; of NaN the usual one."""
    samples = draw(st.integers(0, 6))
    values = nps.arrays(np.float64, samples, elements=DOUBLES)
    times = nps.arrays(np.float64, samples, elements=st.floats(-1e6, 1e6))
    names = draw(st.lists(NAMES, unique=True, max_size=4))
    facts = draw(st.dictionaries(st.text(max_size=5), st.text(max_size=5) | st.floats(-1, 1)))
    units = {name: draw(st.sampled_from(["", "rad", "N m", "rad/s", "%", "Ω"])) for name in names}
    return Trace(draw(times), {name: draw(values) for name in names}, units, "recorded", facts)


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(trace=traces())
def test_any_trace_comes_back_to_the_bit(suffix: str, trace: Trace) -> None:
    """Mutation that breaks it: 16 digits in CSV instead of the shortest that read back."""
    found, left_out = through(suffix, bare_log(trace))
    assert_same(found.tick, trace)
    assert found.tick.facts == trace.facts
    assert left_out == []


@given(
    data=st.dictionaries(NAMES, st.binary(max_size=40), max_size=3),
    events=st.lists(st.builds(Event, st.floats(-1e3, 1e3), NAMES, NAMES, st.floats(-1.0, 1.0))),
)
@pytest.mark.parametrize("suffix", [".parquet", ".npz"])
def test_any_attachment_and_event_comes_back(
    suffix: str, data: dict[str, bytes], events: list[Event]
) -> None:
    log = replace(bare_log(example(3)), attachments=data, events=tuple(events))
    found, _ = through(suffix, log)
    assert found.attachments == data
    assert found.events == tuple(events)


def test_a_table_that_someone_has_edited() -> None:
    out = io.BytesIO()
    WRITERS[".csv"](out, bare_log(example(3)))
    lines = out.getvalue().decode().splitlines()
    more = [lines[0], lines[1] + ",mine", *(f"{line},1" for line in lines[2:]), ""]
    log = log_of(read_csv(HERE, "\n".join(more).encode()))
    assert_same(log.tick, example(3))
    assert log.warnings == ("columns that zwidth did not write are left out: mine",)
    renamed = "\n".join([lines[0], lines[1].replace("position_m1_rad", "position"), *lines[2:], ""])
    with pytest.raises(
        RecordingError, match=r"no signal 'position_m1_rad'; did you mean 'position'"
    ):
        log_of(read_csv(HERE, renamed.encode()))
    doubled = "\n".join([*lines[:2], lines[2], *lines[2:], ""])
    log = log_of(read_csv(HERE, doubled.encode()))
    assert log.warnings[0].startswith(
        "not as zwidth wrote them, edited or damaged, are the columns t_s"
    )
    assert log.tick.facts["warnings"] == list(log.warnings)
    newer = "\n".join([lines[0].replace('"schema": 1', '"schema": 2'), *lines[1:], ""])
    with pytest.raises(RecordingError, match="this version reads 1"):
        log_of(read_csv(HERE, newer.encode()))
    for word in ("columns", "origin", "epoch_ns", "facts", "substeps"):
        broken = "\n".join(
            [lines[0].replace(f'"{word}": ', f'"{word}": [7], "x": '), *lines[1:], ""]
        )
        with pytest.raises(RecordingError, match="is damaged"):
            log_of(read_csv(HERE, broken.encode()))
    with pytest.raises(RecordingError, match="its head is damaged"):
        read_csv(HERE, "\n".join([lines[0][:-9], *lines[1:], ""]).encode())


def test_writing_twice_gives_the_same_bytes() -> None:
    for writer in WRITERS.values():
        first, second = io.BytesIO(), io.BytesIO()
        writer(first, full_log())
        writer(second, full_log())
        assert first.getvalue() == second.getvalue()
