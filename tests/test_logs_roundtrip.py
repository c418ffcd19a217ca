import math
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from log_examples import ATTACHMENTS, EPOCH, EVENTS, FACTS, METADATA, assert_same, bits, example

from zwidth.logs.clock import from_log_time, to_log_time
from zwidth.logs.mcap_reader import read_log
from zwidth.logs.mcap_writer import LogWriter, write_log
from zwidth.logs.schema import field_names, unit_suffix
from zwidth.sim.trace import Floats, Trace

names = st.text(st.characters(categories=["L", "N", "P", "S", "Zs"]), max_size=12).filter(
    str.isprintable
)
units = st.sampled_from(["", "rad", "rad/s", "N m", "N m/rad", "m/s^2", "%", "µm", "°", "[V] [s]"])
doubles = st.floats(width=64, allow_nan=True, allow_infinity=True)
times = st.floats(-1e9, 8e9).map(lambda t: t + 0.0)


def seconds(samples: int) -> Floats:
    """Return the clock of a run at 1 kHz."""
    return np.arange(samples, dtype=np.float64) * 0.001


@st.composite
def traces(draw: st.DrawFn) -> Trace:
    known = draw(st.dictionaries(names, units, max_size=5))
    samples = draw(st.integers(0, 40))
    columns = {n: draw(_array(doubles, samples)) for n in known}
    return Trace(draw(_array(times, samples)), columns, known, "recorded", {})


def _array(elements: st.SearchStrategy[float], samples: int) -> st.SearchStrategy[Floats]:
    drawn = st.lists(elements, min_size=samples, max_size=samples)
    return drawn.map(lambda values: np.array(values, dtype=np.float64))


@settings(max_examples=150, deadline=None, derandomize=True)
@given(traces(), st.integers(1, 15))
def test_any_trace_comes_back_bit_for_bit(trace: Trace, block: int) -> None:
    """Holds for any names, units, times and doubles, cut into any blocks.

    Breaks if the residual of the clock is left out, if log times are truncated instead of rounded
    (the residual is then 1 ns and inexact), or if a field name loses its channel's name.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        with LogWriter(path, trace.units, epoch_ns=2**60, origin="recorded") as log:
            for first in range(0, len(trace), block):
                part = slice(first, first + block)
                log.append(trace.t[part], {n: v[part] for n, v in trace.channels.items()})
        read = read_log(path)
        assert read.warnings == ()
        assert_same(read.tick, trace)


def test_everything_in_a_log_comes_back(tmp_path: Path) -> None:
    tick, fine, fine_times = example(500), example(2000, seed=1), seconds(2000) / 3.0
    path = tmp_path / "run.mcap"
    write_log(
        path,
        tick,
        substep=fine.with_channels(fine.channels, fine_times),
        events=EVENTS,
        metadata=METADATA,
        attachments=ATTACHMENTS,
        epoch_ns=EPOCH,
    )
    log = read_log(path)
    assert log.warnings == ()
    assert_same(log.tick, tick)
    assert log.substep is not None
    assert bits(log.substep.t) == bits(fine_times)
    assert log.events == EVENTS
    assert log.metadata == METADATA
    assert log.attachments == ATTACHMENTS
    assert log.tick.facts == FACTS
    assert log.epoch_ns == EPOCH


def test_a_later_note_wins(tmp_path: Path) -> None:
    with LogWriter(
        tmp_path / "run.mcap", {}, metadata={"verdict": "undecided", "seed": "3"}
    ) as log:
        log.note({"verdict": "grows"})
    metadata = read_log(tmp_path / "run.mcap").metadata
    assert (metadata["verdict"], metadata["seed"]) == ("grows", "3")


def test_a_run_without_samples_keeps_its_channels(tmp_path: Path) -> None:
    with LogWriter(tmp_path / "run.mcap", {"encoder": "rad"}):
        pass
    log = read_log(tmp_path / "run.mcap")
    assert (list(log.tick.channels), len(log.tick), log.warnings) == (["encoder"], 0, ())


def test_clock_is_exact_at_every_magnitude() -> None:
    """Breaks with np.floor for np.rint only beyond 2^53 ns; with n * 1e-9 for n / 1e9 at once."""
    rng = np.random.default_rng(7)
    for exponent in np.arange(-12.0, 9.5, 0.5):
        t = rng.normal(size=2000) * 10.0**exponent
        t = np.concatenate([t, np.round(t, 6) + 0.0, seconds(2000)])
        log_time, residual = to_log_time(t[np.abs(t) < 4e9], 2**62)
        assert bits(from_log_time(log_time, residual, 2**62)) == bits(t[np.abs(t) < 4e9])


def test_a_decimal_clock_leaves_almost_no_residual() -> None:
    t = seconds(10_000)
    residual = to_log_time(t, EPOCH)[1]
    assert np.all(np.abs(residual) <= np.spacing(t))
    assert np.count_nonzero(residual) < 0.3 * t.size


@pytest.mark.parametrize(
    ("unit", "suffix"),
    [("", ""), ("rad", "rad"), ("rad/s", "rad_s"), ("N m", "nm"), ("N", "n"), ("m/s", "m_s"),
     ("J", "j"), ("N m/rad", "nm_rad"), ("m/s^2", "m_s2"), ("\u00b5m", "um"), ("\u03bcm", "um")],
)  # fmt: skip
def test_units_end_field_names(unit: str, suffix: str) -> None:
    assert unit_suffix(unit) == suffix


def test_fields_are_named_after_channel_and_unit() -> None:
    fields = field_names(
        {"position_m1": "rad", "stored_energy": "J", "contact": "", "joint 1/x": "m", "1st": "",
         "joint 1_x": "m", "time_residual": "s"}
    )  # fmt: skip
    assert list(fields.values()) == [
        "position_m1_rad", "stored_energy_j", "contact", "joint_1_x_m", "_1st", "joint_1_x_m_2",
        "time_residual_s_2",
    ]  # fmt: skip


def test_infinite_and_missing_values_are_values(tmp_path: Path) -> None:
    values = np.array([math.nan, math.inf, -math.inf, -0.0, 5e-324])
    trace = Trace(np.arange(5.0), {"encoder": values}, {"encoder": "rad"}, "recorded", {})
    write_log(tmp_path / "run.mcap", trace)
    assert bits(read_log(tmp_path / "run.mcap").tick["encoder"]) == bits(values)
