"""What a recording TOML says is what the trace holds; what it says wrongly is one sentence."""

import json
import math
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recording_examples import csv_bytes, json_mcap_bytes, npz_bytes, recorded, ros2_bytes, wave

from zwidth.diagnosis.recording.experiment import experiment
from zwidth.logs.csv_form import CsvOptions
from zwidth.logs.recording import load_log, read_recording
from zwidth.logs.recording_file import load_description
from zwidth.logs.source import RecordingError
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface

PLAIN = """
    file = "a.csv"
    time = "t"
    [input]
    signal = "torque"
    [[output]]
    signal = "angle"
    quantity = "position"
    at = "m1"
    """


def test_channels_units_and_facts(tmp_path: Path) -> None:
    trace = recorded(tmp_path, PLAIN, a_csv=csv_bytes())
    t, u, x = wave(20)
    assert trace.origin == "recorded"
    assert dict(trace.units) == {"command": "N m", "position_m1": "rad"}
    np.testing.assert_array_equal(trace.t, t)
    np.testing.assert_array_equal(trace["command"], u)
    np.testing.assert_array_equal(trace["position_m1"], x)
    assert trace.facts["file"] == "a.csv"
    assert trace.facts["warnings"] == []
    assert json.loads(json.dumps(trace.facts)) == trace.facts


@given(
    raw=st.lists(st.floats(-1e6, 1e6), min_size=2, max_size=20),
    scale=st.floats(-1e6, 1e6).filter(bool),
    offset=st.floats(-1e6, 1e6),
)
def test_value_is_scale_raw_plus_offset(
    tmp_path_factory: pytest.TempPathFactory, raw: list[float], scale: float, offset: float
) -> None:
    """Mutation that breaks it: scale * (raw + offset) in logs.conversion.convert."""
    folder = tmp_path_factory.mktemp("scale")
    np.savez(folder / "a.npz", u=np.array(raw))
    toml = f"""
        file = "a.npz"
        period_s = 0.001
        [input]
        signal = "u"
        scale = {scale!r}
        offset = {offset!r}
        """
    values = recorded(folder, toml)["command"]
    np.testing.assert_array_equal(values, scale * np.array(raw) + offset)


@pytest.mark.parametrize(
    ("unit", "extra", "factor", "si"),
    [
        ("deg", "", math.pi / 180.0, "rad"),
        ("counts", "counts_per_rev = 4000", 2.0 * math.pi / 4000.0, "rad"),
        ("counts", "counts_per_m = 2e5", 5e-6, "m"),
        ("mm", "", 1e-3, "m"),
        ("V", "scale = 0.25\nrotary = true", 0.25, "rad"),
        ("mV", "scale = 0.25\nrotary = false", 2.5e-4, "m"),
        ("counts", "scale = 0.5\nrotary = true", 0.5, "rad"),
        ("µm", "", 1e-6, "m"),
    ],
)
def test_units_become_si(tmp_path: Path, unit: str, extra: str, factor: float, si: str) -> None:
    """Mutation that breaks it: TURN / 2 for a revolution in logs.conversion."""
    lines = extra.splitlines()
    own, top = [x for x in lines if "rotary" not in x], [x for x in lines if "rotary" in x]
    head = ['file = "a.npz"', "period_s = 0.001", *top]
    output = ["[[output]]", 'signal = "u"', 'quantity = "position"', 'at = "m1"', *own]
    toml = "\n".join([*head, *output, f'unit = "{unit}"'])
    trace = recorded(tmp_path, toml, a_npz=npz_bytes())
    np.testing.assert_allclose(trace["position_m1"], factor * wave(20)[1], rtol=4e-16)
    assert trace.units["position_m1"] == si


HEAD = 'file = "a.csv"\n'
INPUT = '[input]\nsignal = "torque"\n'
OUTPUT = '[[output]]\nsignal = "angle"\nquantity = "position"\nat = "m1"\n'
TIME = 'time = "t"\n'
SUPPLY = '[supply]\nsignal = "torque"\nunit = "V"\nscale = 1.0\n'
BESIDE = (
    '[[known_force]]\nsignal = "v"\nat = "m1"\n',
    '[[covariate]]\nsignal = "v"\n',
    '[base]\nsignal = "v"\nquantity = "position"\n',
    '[[joint]]\nsignal = "v"\nname = "elbow"\n',
    '[enable]\nsignal = "v"\n',
    '[supply]\nsignal = "v"\nnominal = 12.0\n',
)
TABLES = ("known_force", "covariate", "base", "joint", "enable", "supply")


def kind_of(table: str) -> str:
    """Return what errors call a table."""
    head = table.partition("\n")[0]
    return head.strip("[]") + ("[0]" if head.startswith("[[") else "")


@pytest.mark.parametrize(
    ("toml", "words"),
    [
        ("file = ", "this is not TOML"),
        (HEAD + TIME, "describes no signal"),
        (TIME + INPUT, "file is missing"),
        (HEAD + INPUT, "period_s or time is missing"),
        (HEAD + TIME + "period_s = 0.001\n" + INPUT, "both period_s and time"),
        (HEAD + "period_s = 0\n" + INPUT, "period_s is 0; it must be a number above 0"),
        (HEAD + "perod_s = 0.001\n" + INPUT, "did you mean 'period_s'?"),
        (HEAD + TIME + INPUT + "scail = 2\n", "unknown key 'input.scail'; did you mean 'scale'?"),
        (HEAD + TIME + INPUT + "scale = 0\n", "input.scale is 0"),
        (HEAD + TIME + INPUT + "scale = nan\n", "it must be a finite number"),
        (HEAD + TIME + INPUT + "scale = true\n", "input.scale is True; it must be a number"),
        (HEAD + TIME + INPUT + 'unit = "Nmn"\n', "'Nmn', which is not a known unit"),
        (HEAD + TIME + INPUT + 'unit = "V"\n', "give scale, in N m or N per V"),
        (HEAD + TIME + INPUT + 'unit = "counts"\n', "give counts_per_rev"),
        (HEAD + TIME + INPUT + "counts_per_rev = 4\n", 'needs unit = "counts"'),
        (HEAD + TIME + OUTPUT.replace("position", "positon"), "did you mean 'position'?"),
        (HEAD + TIME + OUTPUT.replace("m1", "m9"), "output[0].at is 'm9'"),
        (HEAD + TIME + OUTPUT.replace("m1", "m0"), "output[0].at is 'm0'; did you mean 'm1'?"),
        (HEAD + TIME + OUTPUT + OUTPUT, "position_m1 is described twice"),
        (HEAD + TIME + INPUT.replace("torque", "tork"), "no signal 'tork'; did you mean 'torque'?"),
        (HEAD.replace("a.csv", "b.csv") + TIME + INPUT, "b.csv does not exist"),
        (HEAD.replace("a.csv", "b\\u0000") + TIME + INPUT, "cannot be the name of a file"),
        (HEAD + TIME + INPUT + "[use]\nfrom_s = 2\nto_s = 1\n", "from_s must be below to_s"),
        (HEAD + TIME + INPUT + "[use]\nfrom_s = 2\n", "leaves no sample"),
        (HEAD + TIME + "rotary = false\n" + INPUT, "linear device"),
        (HEAD + TIME + "resample = -1\n" + INPUT, "it must be true, false or a period above 0"),
        (HEAD + TIME + 'time_unit = "rad"\n' + INPUT, "it must be one of s, ms, us"),
        (HEAD + TIME + "schema = 2\n" + INPUT, "this version reads 1"),
        (HEAD + TIME + INPUT + '[csv]\ndelimiter = "ab"\n', "it must be one character"),
        (HEAD + TIME + "input = 3\n", "input is 3; it must be a table"),
        *[
            (HEAD + TIME + INPUT + OUTPUT + one.replace('"v"', name), words)
            for one in BESIDE
            for name, words in (
                ('"nosuch"', "a.csv has no signal 'nosuch'; choose from"),
                ('"torque"\nfoo = 1', f"{kind_of(one)}.foo'"),
                ('"torque"\nscale = nan', f"{kind_of(one)}.scale is nan; it must be a finite"),
                (
                    '"torque"\nscale = 0',
                    f"{kind_of(one)}.scale is 0; it must be a number other than 0",
                ),
                ('"torque"\noffset = "x"', f"{kind_of(one)}.offset is 'x'; it must be a number"),
                ("3", f"{kind_of(one)}.signal is 3; it must be a string in quotes"),
            )
        ],
        *[(HEAD + TIME + f"{t} = 3\n" + INPUT, f"{t} is 3; it must be a") for t in TABLES],
        (HEAD + TIME + INPUT + '[[joint]]\nsignal = "torque"\nname = ""\n', "[0].name is ''"),
        (HEAD + TIME + INPUT + '[enable]\nsignal = "torque"\nunit = "deg"\n', "has no unit"),
        (
            HEAD + TIME + INPUT + SUPPLY + "nominal = 0\n",
            "supply.nominal is 0; it must be a finite",
        ),
        (HEAD + TIME + INPUT + SUPPLY, "supply.nominal is missing; add it"),
        *[
            (HEAD + TIME + OUTPUT + f"wraps_at = {wrong}\n", f"wraps_at is {said}; it must be a")
            for wrong, said in (("0", "0"), ("nan", "nan"), ("inf", "inf"), ('"x"', "'x'"))
        ],
        (HEAD + TIME + OUTPUT + "wraps_at = 1e-9\n", "more than its wraps_at = 1e-09 allows"),
    ],
)
def test_errors_say_what_to_change(tmp_path: Path, toml: str, words: str) -> None:
    with pytest.raises(ValueError, match=r"\A[^\n]*\Z") as caught:
        recorded(tmp_path, toml, a_csv=csv_bytes())
    assert words in str(caught.value)


def test_a_unit_in_the_header_is_not_passed_over(tmp_path: Path) -> None:
    data = csv_bytes().replace(b"angle [rad]", b"angle [deg]")
    with pytest.raises(RecordingError, match='add unit = "deg"'):
        recorded(tmp_path, PLAIN, a_csv=data)
    trace = recorded(tmp_path, PLAIN + '    unit = "deg"\n', a_csv=data)
    np.testing.assert_allclose(trace["position_m1"], np.radians(wave(20)[2]), rtol=1e-15)
    trace = recorded(tmp_path, PLAIN + '    unit = "mrad"\n', a_csv=data)
    assert "by its own header" in str(trace.facts["warnings"])
    with pytest.raises(RecordingError, match='time_unit = "ms"'):
        recorded(tmp_path, PLAIN, a_csv=csv_bytes().replace(b"t [s]", b"t [ms]"))


def test_without_a_unit_it_is_said_that_none_shows_the_kind_of_device(tmp_path: Path) -> None:
    toml = 'file = "a.npz"\nperiod_s = 0.001\n[input]\nsignal = "u"\n'
    trace = recorded(tmp_path, toml, a_npz=npz_bytes())
    assert trace.units["command"] == ""
    assert "set rotary" in str(trace.facts["warnings"])
    assert recorded(tmp_path, "rotary = false\n" + toml).units["command"] == "N"


def test_use_keeps_the_times_of_the_recording(tmp_path: Path) -> None:
    trace = recorded(tmp_path, PLAIN + "[use]\nfrom_s = 0.005\nto_s = 0.01\n", a_csv=csv_bytes())
    np.testing.assert_array_equal(trace.t, wave(20)[0][5:10])
    assert trace.facts["use"] == {"from_s": trace.t[0], "to_s": trace.t[-1]}


JOINTS = """
    file = "a.mcap"
    time = "header.stamp"
    rotary = true
    [input]
    signal = "/joint_states.elbow.effort"
    [[output]]
    signal = "/joint_states.elbow.position"
    quantity = "position"
    at = "m1"
    """


def test_ros_joint_states(tmp_path: Path) -> None:
    """Stamps of 1.7e18 ns keep their nanoseconds: a double alone has steps of 238 ns there."""
    trace = recorded(tmp_path, JOINTS, a_mcap=ros2_bytes())
    t, u, x = wave(20)
    np.testing.assert_allclose(trace.t, t, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(trace["command"], -u)
    np.testing.assert_array_equal(trace["position_m1"], 2.0 * x)
    assert trace.facts["counted_from_s"] == "1700000000.000000000"
    assert load_log(tmp_path / "recording.toml").epoch_ns == 1_700_000_000_000_000_000
    with pytest.raises(
        RecordingError, match=r"no clock 'hedaer.stamp'; did you mean 'header.stamp'"
    ):
        recorded(tmp_path, JOINTS.replace("header", "hedaer"), a_mcap=ros2_bytes())


TWO_RATES = """
    file = "a.mcap"
    time = "log_time"
    rotary = true
    {resample}
    [input]
    signal = "/command.u"
    [[output]]
    signal = "/encoder.pose.deg"
    unit = "deg"
    quantity = "position"
    at = "m1"
    """


def test_streams_with_clocks_of_their_own_need_to_be_asked(tmp_path: Path) -> None:
    with pytest.raises(RecordingError) as caught:
        recorded(tmp_path, TWO_RATES.format(resample=""), a_mcap=json_mcap_bytes(400))
    sentence = str(caught.value)
    assert "command 400 samples at 1000 Hz and position_m1 100 samples at 250 Hz" in sentence
    assert "starting 0.0025 s apart" in sentence
    assert "resample = true (period 0.004 s)" in sentence


@pytest.mark.parametrize(("resample", "period"), [("true", 0.004), ("0.001", 0.001)])
def test_resampled_streams_stand_at_the_times_of_one_axis(
    tmp_path: Path, resample: str, period: float
) -> None:
    """Interpolating a 40 rad/s cosine over 4 ms errs by 0.01 (40 x 0.004)^2 / 8 = 3.2e-5 at most.

    Mutation that breaks it: interpolation at t + period / 2 in logs.one_axis (off by 8e-4).
    """
    toml = TWO_RATES.format(resample=f"resample = {resample}")
    trace = recorded(tmp_path, toml, a_mcap=json_mcap_bytes(400))
    np.testing.assert_allclose(np.diff(trace.t), period, rtol=1e-9)
    np.testing.assert_allclose(trace["position_m1"], 0.01 * np.cos(40.0 * trace.t), atol=3.3e-5)
    resampling = trace.facts["resampling"]
    assert isinstance(resampling, dict)
    assert resampling["streams"]["position_m1"]["offset_s"] == pytest.approx(0.0025, abs=1e-12)
    u = wave(400)[1]
    if period == 0.001:  # between two commands the first of them is in force
        first = int(np.floor(trace.t[0] / 0.001 + 1e-9))
        np.testing.assert_array_equal(trace["command"], u[first : first + len(trace)])
    else:  # half of one, all of three, half of another: the impulse of four ticks
        held = (0.5 * u[2] + u[3] + u[4] + u[5] + 0.5 * u[6]) / 4.0
        assert trace["command"][0] == pytest.approx(held, rel=1e-9)


def test_clocks_of_their_own_in_one_file(tmp_path: Path) -> None:
    t, u, x = wave(40)
    np.savez(tmp_path / "a.npz", t1=1e3 * t, u=u, t2=t[::2] + 0.25, x=x[::2])
    toml = """
        file = "a.npz"
        rotary = true
        resample = true
        [input]
        signal = "u"
        time = "t1"
        time_unit = "ms"
        [[output]]
        signal = "x"
        time = "t2"
        shift_s = -0.25
        quantity = "position"
        at = "m1"
        """
    trace = recorded(tmp_path, toml)
    np.testing.assert_allclose(trace["position_m1"], x[::2][: len(trace)], rtol=1e-9)
    np.testing.assert_allclose(trace.t, t[::2], atol=1e-12)


def test_lengths_and_times_that_cannot_be(tmp_path: Path) -> None:
    """A row without a time cannot be placed. Mutation: the values kept where their time is not."""
    np.savez(tmp_path / "a.npz", t=np.array([0.0, np.nan, 2.0]), u=np.arange(3.0), v=np.arange(4.0))
    toml = 'file = "a.npz"\ntime = "t"\n[input]\nsignal = "{}"\n'
    trace = recorded(tmp_path, toml.format("u"))
    np.testing.assert_array_equal(trace.t, [0.0, 2.0])
    np.testing.assert_array_equal(trace["command"], [0.0, 2.0])
    warned = cast("list[str]", trace.facts["warnings"])
    assert "time 't' is not finite in 1 of 3 samples, first in sample 1" in warned[0]
    np.savez(tmp_path / "a.npz", t=np.full(3, np.nan), u=np.arange(3.0))
    with pytest.raises(RecordingError, match="time 't' has no finite number at all"):
        recorded(tmp_path, toml.format("u"))
    np.savez(tmp_path / "a.npz", t=np.arange(3.0), v=np.arange(4.0))
    with pytest.raises(RecordingError, match="'v' has 4 samples and its time 't' has 3"):
        recorded(tmp_path, toml.format("v"))


def test_faults_of_a_signal_are_facts(tmp_path: Path) -> None:
    np.savez(
        tmp_path / "a.npz", u=np.array([1.0, np.nan, np.inf]), v=np.ones(3), w=np.full(3, np.nan)
    )
    toml = 'file = "a.npz"\nrotary = true\nperiod_s = 1\n[input]\nsignal = "{}"\n'
    warned = recorded(tmp_path, toml.format("u")).facts["warnings"]
    assert warned == ["command is not finite in 2 of 3 samples, first in sample 1; taken as gaps"]
    assert recorded(tmp_path, toml.format("v")).facts["warnings"] == ["command is constant at 1"]
    with pytest.raises(RecordingError, match="no finite number at all"):
        recorded(tmp_path, toml.format("w"))


def test_a_file_of_another_tool_needs_a_toml(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(csv_bytes())
    with pytest.raises(RecordingError, match="describe it in a recording TOML"):
        read_recording(tmp_path / "a.csv")


def test_the_documented_toml_is_one(tmp_path: Path) -> None:
    text = (Path(__file__).parents[1] / "docs" / "recordings.md").read_text(encoding="utf-8")
    (tmp_path / "a.toml").write_text(text.split("```toml\n")[1].split("```")[0], encoding="utf-8")
    description = load_description(tmp_path / "a.toml")
    channels = ["command", "position_m1", "base_acceleration", "known_force_m1", "joint_elbow"]
    channels += ["enable", "supply", "covariate_temp"]
    assert [entry.channel for entry in description.entries] == channels
    assert description.csv == CsvOptions(";", ",", 3)


def test_what_parameters_may_follow_keeps_its_unit(tmp_path: Path) -> None:
    """Mutations that break it: a unit that is converted; a covariate taken for an output."""
    t = 0.001 * np.arange(300)
    rows = zip(t, np.sin(40.0 * t), np.cumsum(np.sin(40.0 * t)), 20.0 + t, strict=True)
    text = "t,u,q,oil temp\n" + "\n".join(
        ",".join(f"{v!r}" for v in map(float, row)) for row in rows
    )
    (tmp_path / "a.csv").write_text(text, encoding="utf-8")
    toml = """
        file = "a.csv"
        time = "t"
        rotary = true
        [input]
        signal = "u"
        [[output]]
        signal = "q"
        quantity = "position"
        at = "m1"
        [[covariate]]
        signal = "oil temp"
        unit = "degC"
        scale = 2.0
        """
    (tmp_path / "a.toml").write_text(toml, encoding="utf-8")
    trace = read_recording(tmp_path / "a.toml")
    assert trace.units["covariate_oil_temp"] == "degC"
    assert trace["covariate_oil_temp"][:2] == pytest.approx([40.0, 40.002])
    device = Device("m", "", True, make_chain([1e-3], [0.0], 0.0), Interface(period=1e-3))
    (covariate,) = experiment(trace, device).part(1, 250).covariates
    assert (covariate.name, covariate.unit, covariate.values.size) == ("oil_temp", "degC", 249)
    (tmp_path / "a.toml").write_text(toml + toml[toml.index("[[cov") :], encoding="utf-8")
    with pytest.raises(RecordingError, match="described twice; keep one of the two tables"):
        read_recording(tmp_path / "a.toml")
    (tmp_path / "a.toml").write_text(toml + '        quantity = "x"\n', encoding="utf-8")
    with pytest.raises(RecordingError, match="quantity"):
        read_recording(tmp_path / "a.toml")
