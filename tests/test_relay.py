"""The relay experiment on Table I's device: truth 10."""

import json
from pathlib import Path

import numpy as np
import pytest

from zwidth import cli
from zwidth.figures.relay import relay_figure, relay_title
from zwidth.identification.cycles import Cycle, RelayCondition, gathered, limit_cycles
from zwidth.identification.relay import (
    RelayResult,
    RelayTest,
    Waveform,
    critical_point,
    relay_run,
    waveform,
)
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Start

PHANTOM = load_device("phantom_1_0")


def at(ms: float) -> Device:
    return PHANTOM.with_interface(delay=1e-3 * ms)


@pytest.mark.parametrize(
    ("ms", "damping", "stiffness", "frequency"),
    [
        (2, 0.0, 2.222, 6.89), (2, 0.03, 16.102, 18.52), (2, 0.05, 24.338, 22.73),
        (4, 0.0, 1.149, 4.95), (4, 0.05, 10.998, 15.87), (4, 0.15, 25.96, 26.32),
        (4, 0.2, 32.95, 31.25), (8, 0.0, 0.612, 3.60), (8, 0.08, 7.747, 15.15),
        (8, 0.1, 8.838, 17.24), (2, 0.08, 60.22, 166.7),
    ],
)  # fmt: skip
def test_reading_from_the_reference_start(
    ms: float, damping: float, stiffness: float, frequency: float
) -> None:
    """Mutation: damping left out of the relay's delay (B v added at the device) moves all."""
    result = relay_run(at(ms), damping)
    assert result.verdict == "oscillates"
    assert result.stiffness == pytest.approx(stiffness, rel=0.01)
    assert result.frequency_hz == pytest.approx(frequency, rel=0.01)


@pytest.mark.parametrize(
    ("ms", "damping"),
    [(2, 0.1), (2, 0.11), (2, 0.12), (4, 0.25), (4, 0.254), (4, 0.264), (4, 0.27), (4, 0.3),
     (4, 0.5), (8, 0.13), (8, 0.14)],
)  # fmt: skip
def test_the_eleven_conditions_past_the_stable_region_diverge(ms: float, damping: float) -> None:
    """Mutation: a bound of 1e-2 in place of the growth test calls steady runs diverging too."""
    result = relay_run(at(ms), damping)
    assert result.verdict == "diverges"
    assert result.stiffness is None
    assert result.rate > 0.1


def test_a_loop_may_have_several_cycles_and_the_start_decides():
    """Mutation: seeds that all start alike give one cycle."""
    found = limit_cycles(at(2), 0.03, starts=24)
    stiffness = [cycle.stiffness for cycle in found.cycles]
    assert len(stiffness) >= 3
    assert 12.8 < min(stiffness) < 13.5
    assert 14.4 < max(stiffness) < 16.3
    assert sum(cycle.share for cycle in found.cycles) == pytest.approx(1.0)


def test_critical_point_of_a_square_wave_and_a_sine():
    """K = (4 D / pi) / A. Mutation: the mean not removed, or K from the range."""
    t = 0.001 * np.arange(25_000)
    phase = 2.0 * np.pi * 13.37 * t
    force, position = 0.05 * np.sign(np.sin(phase)), 0.3 - 0.004 * np.sin(phase)
    stiffness, frequency = critical_point(force, position, 0.001)
    assert stiffness == pytest.approx(4.0 * 0.05 / (np.pi * 0.004), rel=1e-3)
    assert frequency == pytest.approx(13.37, abs=1e-3)


def test_waveform_is_the_square_wave_against_the_position():
    """Fig. 8: opposite phase. Mutation: the sign of the recorded side."""
    wave = waveform(at(8), 0.08, 0.66)
    assert set(np.abs(wave.force)) == {0.05}
    assert np.corrcoef(wave.force, wave.position)[0, 1] < -0.8


def test_friction_moves_the_reading_up():
    """At the relay's small amplitude friction damps. Mutation: friction without effect."""
    rubbing = at(8).with_physics(make_physics("coulomb_friction", "m1", level=0.005))
    plain, rubbed = relay_run(at(8), 0.08), relay_run(rubbing, 0.08, test=RelayTest(substeps=4))
    assert plain.stiffness is not None
    assert rubbed.stiffness is not None
    assert rubbed.stiffness > 1.03 * plain.stiffness


def test_what_is_within_half_a_percent_is_one_cycle():
    results = [RelayResult("oscillates", k, 10.0, 0.1, 0.0) for k in (5.0, 5.01, 6.0, 5.02)]
    cycles = gathered([*results, RelayResult("diverges", None, None, None, 1.0)])
    assert [(round(c.stiffness, 2), c.share) for c in cycles] == [(5.01, 0.6), (6.0, 0.2)]


def test_settings_that_cannot_be_are_refused():
    with pytest.raises(ValueError, match="must be finite and > 0"):
        RelayTest(force=0.0)
    with pytest.raises(ValueError, match=r"stretch_s is 1.0; at least 3.0 s"):
        RelayTest(stretch_s=1.0)
    with pytest.raises(ValueError, match="starts is -1"):
        limit_cycles(at(2), 0.0, starts=-1)
    with pytest.raises(ValueError, match="the relay loop diverges"):
        waveform(at(2), 0.12, 0.4)
    with pytest.raises(ValueError, match="never switched"):
        critical_point(np.ones(10), np.ones(10), 0.001)


def test_the_likeliest_cycle_is_told_first_and_not_the_reference_start_s(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """2 ms and B = 0.08: the reference start gives 60.2, nine starts of ten 29.4.

    Breaks where the row begins with the reference start's cycle.
    """
    monkeypatch.chdir(tmp_path)
    line = "relay phantom_1_0 --delay-ms 2 --damping 0.08 --starts 15 --json r.json"
    assert cli.run(line.split()) == 0
    (found,) = json.loads(Path("r.json").read_text())["conditions"]
    assert found["stiffness"] == pytest.approx(29.4, abs=0.1)
    assert found["share"] > 0.8
    assert found["reference"]["stiffness"] == pytest.approx(60.22, abs=0.1)
    rows = (row.split() for row in capsys.readouterr().out.splitlines())
    (row,) = (row for row in rows if row[:2] == ["2", "0.08"])
    assert row[2] == "oscillates"
    assert float(row[5]) == pytest.approx(29.4, abs=0.1)
    assert float(row[-1]) == pytest.approx(60.22, abs=0.1)
    assert Path("runs/relay/relay_boundary.png").stat().st_size > 0


def test_the_picture_of_a_run_is_of_the_cycle_that_is_read():
    """Breaks where it starts from the reference start, of 167 Hz, or the title says its K."""
    condition = limit_cycles(at(2), 0.08, starts=15)
    cycle = condition.read
    assert cycle is not None
    assert cycle.start is not None
    wave = waveform(at(2), 0.08, 0.4, start=Start(*cycle.start))
    switches = np.count_nonzero(np.diff(wave.force))
    assert switches / 0.4 / 2 == pytest.approx(cycle.frequency_hz, rel=0.1)
    assert "K = 29.4" in relay_title(at(2), condition, cycle, RelayTest())


def test_where_more_starts_diverge_that_is_the_verdict():
    """Breaks where the few that oscillate are told first."""
    result = RelayResult("oscillates", 7.0, 15.0, 1e-3, 0.0)
    cycle = Cycle(7.0, 15.0, 1e-3, 0.2)
    assert RelayCondition(0.002, 0.1, result, (cycle,), 0.8, 0.0).verdict == "diverges"
    assert RelayCondition(0.002, 0.1, result, (cycle,), 0.1, 0.7).verdict == "undecided"
    assert RelayCondition(0.002, 0.1, result, (), 0.0, 0.0).verdict == "oscillates"


def test_a_picture_of_a_run_says_its_condition():
    """Breaks where two pictures of two conditions look the same."""
    t = np.arange(9, dtype=np.float64) * 1e-3
    figure = relay_figure(Waveform(t, 0.05 * np.sign(t - 4e-3), 1e-3 * t), "2 ms, B = 0.08")
    assert figure.get_suptitle() == "2 ms, B = 0.08"
    assert figure.axes[0].get_ylabel() == "relay torque [mN m]"
