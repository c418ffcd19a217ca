"""`zwidth check`: a machine that is as it was is within its band, and a change of it is named."""

import csv
import errno
import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from sampled import Sampled

import zwidth
from zwidth import cli
from zwidth.checking import Changed, Check, Output, Recording, _excess, check
from zwidth.diagnosis.answer.band import Windows, windows_of, with_band
from zwidth.diagnosis.recording.experiment import Experiment, stretches
from zwidth.errors import Status
from zwidth.sim.account import BOOK
from zwidth.sim.band import Band, OutputBand
from zwidth.sim.device import DeviceError
from zwidth.sim.device_file import commented_text, device_from_text, load_device, save_device
from zwidth.sim.posterior import Posterior

PERIOD, SECONDS, NOISE = 0.002, 8.0, 1e-4
SAMPLE_NOISE = np.deg2rad(0.005)  # docs/sample/make_bench.py
LINES = ((0.11, 0.5), (0.07, 1.3), (0.05, 2.9), (0.03, 7.1))  # [N m], [Hz]
RATIO = 1e-8
STEP = 1e-4 * np.pi / 180.0  # of an encoder [rad]


def stribeck(share: float = 1.0) -> zwidth.Physics:
    return zwidth.make_physics("stribeck_friction", "m1", level=share * 0.025,
                               static_level=share * 0.04, velocity=0.6)  # fmt: skip


def weight(share: float = 1.0) -> zwidth.Physics:
    return zwidth.make_physics("gravity_pendulum", "m1", level=share * 0.08, angle=0.0)


def bench() -> zwidth.Device:
    rotor = zwidth.make_chain([1.2e-3], [3e-3])
    plain = zwidth.Device("bench", "", True, rotor, zwidth.Interface(period=PERIOD))
    return plain.with_physics(stribeck(), weight())


def recorded(
    device: zwidth.Device, seed: int, sign: float = 1.0, noise: float = NOISE, s: float = SECONDS
) -> zwidth.Trace:
    t = np.linspace(0.0, s, round(s / PERIOD), endpoint=False)
    random = np.random.default_rng(seed)
    torque = np.zeros(t.size)
    for amplitude, f in LINES:
        torque = torque + amplitude * np.sin(2 * np.pi * f * t + random.uniform(0, 6))
    run = zwidth.simulate(device, zwidth.recorded(torque))
    q = run.trace["position_m1"][: t.size] + noise * random.standard_normal(t.size)
    channels = {"command": sign * torque, "position_m1": q}
    units = {"command": "N m", "position_m1": "rad"}
    return zwidth.Trace(t, channels, units, "recorded", {})


def experiments(device: zwidth.Device, seed: int, sign: float = 1.0) -> list[Experiment]:
    return stretches(recorded(device, seed, sign), bench(), "later")


@cache
def banded() -> zwidth.Device:
    """The bench with its band, from a recording that no test checks."""
    (one,) = experiments(bench(), 1)
    return with_band(bench(), [one.split()[1]], RATIO, ())


def found_in(device: zwidth.Device, seed: int = 30, sign: float = 1.0) -> zwidth.Check:
    return check(banded(), [("later.csv", experiments(device, seed, sign))])


def write_csv(path: Path, trace: zwidth.Trace) -> Path:
    with path.open("w", newline="") as file:
        lines = csv.writer(file)
        lines.writerow(["time_s", "torque_Nm", "angle_rad"])
        every = zip(trace.t, trace["command"], trace["position_m1"], strict=True)
        lines.writerows([f"{a:.3f}", f"{b:.6f}", f"{c:.6f}"] for a, b, c in every)
    return path


@pytest.mark.parametrize("seed", range(40, 46))
def test_a_machine_as_it_was_is_within_its_band(seed: int):
    """Mutation: no chance of windows in `most`: some of the six are outside."""
    found = found_in(bench(), seed)
    assert found.within, found.sentence
    assert not found.changed


def heavier(device: zwidth.Device) -> zwidth.Device:
    return device.with_chain(zwidth.make_chain([1.26e-3], [3e-3]))


def late(device: zwidth.Device) -> zwidth.Device:
    return device.with_interface(delay=0.001)


def rubs(device: zwidth.Device) -> zwidth.Device:
    return device.with_physics(stribeck(1.12))


CHANGES: dict[str, tuple[Callable[[zwidth.Device], zwidth.Device], tuple[str, ...]]] = {
    "friction": (rubs, ("Stribeck friction +12 %",)),
    "delay": (late, ("delay +1 ms",)),
    "inertia": (heavier, ("the inertia m1 +5 %",)),
    "both": (lambda d: late(rubs(d)), ("Stribeck friction +12 %", "delay +1 ms")),
}


@pytest.mark.parametrize("name", CHANGES)
def test_what_changed_is_named_with_its_size(name: str):
    """Mutations: each parameter by itself only; the quadratic's x taken without a fit."""
    change, said = CHANGES[name]
    found = found_in(change(bench()))
    assert not found.within
    assert found.explains, found.sentence
    assert len(found.changed) == len(said)
    assert {c.sentence for c in found.changed} == set(said)
    for delay in (c for c in found.changed if c.words == "delay"):  # a sentence rounds it
        assert delay.now - delay.was == pytest.approx(1e-3, rel=0.01)


def test_changes_that_no_recording_has_in_common_are_named_for_each():
    """Mutation: no fit of each by itself."""
    machines = {"rubs.csv": rubs, "good.csv": lambda d: d, "late.csv": late}
    every = [(name, experiments(of(bench()), 30 + i))
             for i, (name, of) in enumerate(machines.items())]  # fmt: skip
    found = check(banded(), every)
    assert found.explains
    assert found.sentence == (
        "device 'bench' no longer describes rubs.csv and late.csv: Stribeck friction +12 % in"
        " rubs.csv; delay +1 ms in late.csv"
    )
    of = {one["parameter"]: one["recording"] for one in found.as_json()["changed"]}
    assert of == {"stribeck_friction@m1": "rubs.csv", "loop_delay@clock.delay": "late.csv"}


def test_recordings_without_a_cause_are_told_from_those_with_one():
    """Mutation: each cause said once for each recording."""
    off = Output("position_m1", "rad", 2.0, 1.0, 1.0, 9.0)
    names = ("a", "b", "c", "d", "e")
    cause = Changed("delay", "delay", 0.0, 1e-3, 0.0, "s", False, "a")
    changed = (cause, replace(cause, recording="c"))
    every = tuple(Recording(name, (off,)) for name in names)
    found = Check("rig", every, changed, unexplained=("b", "d"), left=("e",))
    assert found.sentence == (
        "device 'rig' no longer describes a, b, c and 2 more: delay +1 ms in a and c; no change of"
        " the device's parameters explains b and d; --diagnose searches for other physics; check e"
        " alone, too"
    )


def known_well() -> zwidth.Device:
    """The bench with what a diagnosis leaves uncertain, and its lever as near zero as one puts it.

    An angle of exactly zero is not fitted.
    """
    sd = {"m1": 1e-8, "b1": 1e-7, "stribeck_friction@m1.level": 1e-6}
    posterior = Posterior(tuple(sd), tuple(sd.values()), tuple(map(tuple, np.eye(len(sd)))))
    arm = zwidth.make_physics("gravity_pendulum", "m1", level=0.08, angle=1e-6)
    return replace(banded(), physics=(stribeck(), arm), posterior=posterior)


def counted(device: zwidth.Device, *logs: list[Experiment]) -> tuple[Check, int]:
    """A check, and how many ticks its devices were simulated over."""
    ticks: list[int] = []
    token = BOOK.set(lambda members, length, _: ticks.append(members * length))
    try:
        return check(device, [(f"{i}.csv", log) for i, log in enumerate(logs)]), sum(ticks)
    finally:
        BOOK.reset(token)


def test_an_angle_near_zero_does_not_slow_a_fit():
    """Mutation: its unit a share of its value; the fit then ends before it is at the bottom."""
    found, _ = counted(known_well(), experiments(rubs(bench()), 31))
    (changed,) = found.changed
    assert changed.now / changed.was == pytest.approx(1.12, rel=1e-4)


def test_what_a_check_simulates_does_not_grow_with_the_recordings(
    monkeypatch: pytest.MonkeyPatch,
):
    """Beside the free runs over all of each: a check is to end in ten seconds.

    Mutations: a fit to all ticks; as many draws where the error is far larger than what they imply;
    a recording within the band searched for wrong signs.
    """
    free: list[int] = []

    def counting(*asked: Any) -> Windows:
        free.append(sum(e.ticks for e in asked[2]))
        return windows_of(*asked)

    monkeypatch.setattr("zwidth.checking.windows_of", counting)

    def long(of: Callable[[zwidth.Device], zwidth.Device], seed: int) -> list[Experiment]:
        return stretches(recorded(of(bench()), seed, s=3.0 * SECONDS), bench(), "later")

    device, ticks = known_well(), round(3.0 * SECONDS / PERIOD)
    within, once = counted(device, long(lambda d: d, 60))
    assert within.within
    assert once < 6 * ticks
    assert sum(free) == ticks
    free.clear()
    one, most = counted(device, long(rubs, 61))
    assert [c.sentence for c in one.changed] == ["Stribeck friction +12 %"]
    assert most < 5_000_000
    assert sum(free) < 8 * ticks
    two, both = counted(device, long(rubs, 61), long(late, 63))
    assert [c.sentence for c in two.changed] == ["Stribeck friction +12 %", "delay +1 ms"]
    assert both < 9_000_000


def test_a_run_without_an_error_explains_nothing():
    """Mutation: the largest share by `max` alone, which drops what is not a number."""
    band = banded().band
    assert band is not None
    (output,) = band.outputs
    none = np.full((3, 1), np.nan)
    found = Windows((output.name,), none, np.ones((3, 1)), np.ones(1))
    assert _excess(band, found, np.ones(1)) == np.inf


FINER: dict[str, Callable[[zwidth.Device], zwidth.Device]] = {
    "Stribeck friction +12 %": rubs,
    "delay +1 ms": late,
    "delay +2 ms": lambda d: d.with_interface(delay=0.002),
    "gravity pendulum level +5 %": lambda d: d.with_physics(weight(1.05)),
}


@pytest.mark.parametrize("in_steps", [True, False], ids=["in_steps", "in_full"])
@pytest.mark.parametrize("said", FINER)
def test_a_change_is_named_where_the_samples_have_no_noise(said: str, in_steps: bool):
    """Mutation: `_coarse` left out; delays and frictions then end as another parameter."""
    device = banded().with_interface(encoder_step=STEP)
    trace = recorded(FINER[said](bench()), 31, noise=0.0)
    if in_steps:
        q = STEP * np.rint(trace["position_m1"] / STEP)
        trace = replace(trace, channels={**trace.channels, "position_m1": q})
    found = check(device, [("later.csv", stretches(trace, device, "later"))])
    assert [c.sentence for c in found.changed] == [said]
    assert found.sentence.endswith(f"no longer describes later.csv: {said}")


@pytest.mark.parametrize(
    ("now", "half_width", "said"),
    [
        (0.998e-3, 3e-6, "delay +1 ms"),
        (1.26e-3, 3e-6, "delay +1.3 ms"),
        (1.26e-3, 3e-4, "delay +1.3 ms"),
        (14.2e-3, 2e-2, "delay +10 ms"),
        (-4.96e-4, 0.0, "delay -500 \u00b5s"),
    ],
)
def test_a_size_has_the_digits_that_its_error_leaves(now: float, half_width: float, said: str):
    assert Changed("delay", "delay", 0.0, now, half_width, "s", False).sentence == said


def test_what_its_own_parameters_do_not_explain_is_left_to_a_search():
    drag = zwidth.make_physics("quadratic_drag", "m1", coefficient=3e-4)
    found = found_in(bench().with_physics(drag))
    assert not found.within
    assert not found.explains
    assert not found.changed  # what it fits best is no cause
    assert found.sentence.endswith(
        "no change of the device's parameters explains the errors; --diagnose searches for other"
        " physics"
    )


def test_a_command_of_the_other_sign_is_a_fault_of_the_recording():
    """Mutation: the readings that are suspected not tried."""
    found = found_in(bench(), sign=-1.0)
    assert not found.within
    assert "sign is inverted" in found.sentence
    assert not found.changed


def test_a_fault_that_the_diagnosis_corrected_too_is_no_news():
    band = banded().band
    assert band is not None
    news = found_in(bench(), sign=-1.0).recordings[0].news
    known = replace(banded(), band=replace(band, corrected=tuple(f.kind for f in news)))
    assert check(known, [("later.csv", experiments(bench(), 30, -1.0))]).within


def test_a_recording_that_stands_still_says_nothing():
    (e,) = experiments(bench(), 50)
    random = np.random.default_rng(0)
    still = replace(e, measured=NOISE * random.standard_normal(e.measured.shape))
    with pytest.raises(
        ValueError, match="too little motion to check anything; give a recording in which"
    ):
        check(banded(), [("still.csv", [still])])


def test_a_diagnosis_gives_its_device_a_band(sampled: Sampled):
    """That of the shipped sample, which is of this bench.

    Mutations: `with_band` left out of it; a band without the uncertainty of the parameters.
    """
    found = sampled.found.device
    assert found.band is not None
    (output,) = found.band.outputs
    assert output.name == "position_m1"
    assert output.noise == pytest.approx(SAMPLE_NOISE, rel=0.1)
    assert SAMPLE_NOISE < output.error < 0.01 * output.motion
    for seed in (60, 62, 65):  # the last two ask more of the friction than the sample does
        assert zwidth.check(found, recorded(bench(), seed, noise=SAMPLE_NOISE)).within
    rubbed = replace(bench(), physics=(stribeck(1.02), weight()))
    assert not zwidth.check(found, recorded(rubbed, 65, noise=SAMPLE_NOISE)).within


@pytest.mark.truth
def test_another_motion_of_the_sample_is_no_change_and_two_percent_of_friction_are(
    sampled: Sampled,
):
    """The figures of docs/check.md."""
    found = sampled.found.device
    rubbed = replace(bench(), physics=(stribeck(1.02), weight()))

    def outside(machine: zwidth.Device, seeds: range) -> list[int]:
        logs = {s: recorded(machine, s, noise=SAMPLE_NOISE) for s in seeds}
        return [s for s, log in logs.items() if not zwidth.check(found, log).within]

    assert outside(bench(), range(60, 100)) == []
    assert outside(rubbed, range(60, 80)) == list(range(60, 80))


@pytest.mark.truth
def test_a_machine_as_it_was_is_within_the_band_of_its_diagnosis():
    """Mutation: no chance of windows in `most`."""
    rough = bench().without_physics("stribeck_friction")
    answer = zwidth.diagnose(recorded(bench(), 1), rough, effort="quick")
    assert answer.device.band is not None
    (output,) = answer.device.band.outputs
    assert output.noise == pytest.approx(NOISE, rel=0.1)
    assert NOISE < output.error < 0.01 * output.motion
    outside = [seed for seed in range(60, 70)
               if not zwidth.check(answer.device, recorded(bench(), seed)).within]  # fmt: skip
    assert len(outside) <= 1, outside  # 1 of 240: a fit is not exact where a motion asks more of it
    assert not zwidth.check(answer.device, recorded(heavier(bench()), 60)).within


def test_the_band_reads_back_from_its_file(tmp_path: Path):
    save_device(banded(), tmp_path / "bench.toml")
    assert load_device(tmp_path / "bench.toml") == banded()
    assert "rms error of free runs" in (tmp_path / "bench.toml").read_text()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (
            "windows = 6.0",
            "windows = 1.0",
            "band.windows is 1; it must be a whole number of 2 or more",
        ),
        ("windows = 6.0", "windows = 2.5", "band.windows is 2.5; it must be"),
        (
            "window_s = 0.5",
            "window_s = 0.0",
            "band.window_s is 0.0; it must be a finite number above 0",
        ),
        ("error = 1.0", "error = -1.0", "band.output.error of position_m1 is -1.0; it must be"),
        ("error = 1.0", "eror = 1.0", "unknown key 'band.output[0].eror'"),
    ],
)
def test_a_band_that_cannot_be_is_refused_in_a_sentence(old: str, new: str, said: str):
    band = Band(0.5, 6, 1e-4, (OutputBand("position_m1", 1.0, 0.1, 2.0, 0.3),))
    text = commented_text(replace(bench(), band=band))
    assert old in text
    with pytest.raises(DeviceError) as caught:
        device_from_text(text.replace(old, new, 1), "bench.toml")
    assert said in str(caught.value)


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the device file, a recording as ever and one with more inertia."""
    save_device(banded(), tmp_path / "bench.toml")
    write_csv(tmp_path / "good.csv", recorded(bench(), 70))
    write_csv(tmp_path / "bad.csv", recorded(heavier(bench()), 71))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_exit_status_the_json_and_the_junit_file_say_the_same(
    rig: Path, capsys: pytest.CaptureFixture[str]
):
    assert cli.run(["check", "bench.toml", "good.csv", "--json", "good.json"]) == Status.DONE
    assert json.loads((rig / "good.json").read_text())["within"] is True
    line = ["check", "bench.toml", "good.csv", "bad.csv", "--json", "x.json", "--junit", "x.xml"]
    assert cli.run(line) == Status.FAILED
    said = json.loads((rig / "x.json").read_text())
    assert [r["within"] for r in said["recordings"]] == [True, False]
    assert said["changed"][0]["parameter"] == "m1"
    assert said["changed"][0]["now"] == pytest.approx(1.26e-3, rel=2e-3)
    suite = ElementTree.parse(rig / "x.xml").getroot()
    assert suite.attrib["tests"] == "2"
    assert suite.attrib["failures"] == "1"
    failed = {case.attrib["name"] for case in suite if case.find("failure") is not None}
    assert failed == {"bad.csv"}
    assert said["sentence"] in capsys.readouterr().out


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("phantom_1_0 good.csv", "period is 0.002 s, the device's 0.001 s"),
        ("bench.toml none.csv", "none.csv does not exist"),
        ("bench.toml good.csv --model x.xml", "--model needs --joint NAME"),
        ("bench.toml good.csv --model no.xml --joint a", "model is 'no.xml', which is not a file"),
        ("bare.toml good.csv", "has no [band], which gives the allowed error"),
    ],
)
def test_bad_input_is_a_sentence_and_status_2(
    line: str, said: str, rig: Path, capsys: pytest.CaptureFixture[str]
):
    save_device(replace(banded(), band=None), rig / "bare.toml")
    assert cli.run(["check", *line.split()]) == Status.BAD_INPUT
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (MemoryError(), Status.BROKEN, "out of memory"),
        (OSError(errno.ENOSPC, "No space left on device"), Status.BROKEN, "No space left"),
        (ZeroDivisionError("division"), Status.BROKEN, "internal error, ZeroDivisionError"),
        (ValueError("this cannot be checked"), Status.BAD_INPUT, "this cannot be checked"),
        (KeyboardInterrupt(), Status.INTERRUPTED, "interrupted"),
    ],
)
def test_a_check_that_fails_is_no_machine_that_changed(
    error: BaseException,
    status: Status,
    said: str,
    rig: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    """Mutations: the status of other commands; the files of an earlier check left as they are."""
    monkeypatch.delenv("ZWIDTH_DEBUG", raising=False)
    line = ["check", "bench.toml", "good.csv", "bad.csv", "--json", "x.json", "--junit", "x.xml"]
    assert cli.run(line) == Status.FAILED
    capsys.readouterr()

    def fails(*_: object) -> Check:
        raise error

    monkeypatch.setattr("zwidth.checking.check", fails)
    assert cli.run(line) == status
    assert said in capsys.readouterr().err
    found = json.loads((rig / "x.json").read_text())
    assert found["status"] == status
    assert said in found["error"]
    suite = ElementTree.parse(rig / "x.xml").getroot()
    assert (suite.attrib["errors"], suite.attrib["failures"]) == ("1", "0")
    assert said in suite[0][0].attrib["message"]
    assert suite[0][0].tag == "error"


def test_a_check_whose_report_cannot_be_written_is_no_machine_that_changed(rig: Path):
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    line = ["check", "bench.toml", "good.csv", "--junit", "/dev/full", "--json", "x.json"]
    assert cli.run(line) == Status.BROKEN
    assert "No space left" in json.loads((rig / "x.json").read_text())["error"]


def test_the_report_of_an_error_replaces_no_file_of_the_user(rig: Path):
    """Not even with --force, as what a recording describes may not be known yet.

    Mutation: `--force` obeyed.
    """
    kept = (rig / "bad.csv").read_bytes()
    for option in ("--junit", "--json"):
        line = ["check", "no.toml", "good.csv", option, "bad.csv", "--force"]
        assert cli.run(line) == Status.BAD_INPUT
    assert cli.run(["check", "no.toml", "bad.csv", "--json", "bad.csv"]) == Status.BAD_INPUT
    assert (rig / "bad.csv").read_bytes() == kept


def test_a_search_that_fails_leaves_the_answer_of_the_check(
    rig: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Mutation: its error let through, which is then taken for one of the check."""
    monkeypatch.delenv("ZWIDTH_DEBUG", raising=False)

    def fails(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("zwidth.diagnose_files.diagnose_files", fails)
    line = ["check", "bench.toml", "bad.csv", "--diagnose", "--json", "x.json"]
    assert cli.run(line) == Status.FAILED
    assert "the search for other physics failed: out of memory" in capsys.readouterr().err
    assert json.loads((rig / "x.json").read_text())["within"] is False


def test_what_is_outside_is_searched_where_that_is_asked(
    rig: Path, monkeypatch: pytest.MonkeyPatch
):
    """Mutation: all recordings given to the search."""
    asked: list[tuple[object, ...]] = []
    monkeypatch.setattr("zwidth.diagnose_files.diagnose_files", lambda *a: asked.append(a))
    assert cli.run(["check", "bench.toml", "good.csv", "bad.csv", "--diagnose"]) == Status.FAILED
    assert [a[1] for a in asked] == [(Path("bad.csv"),)]
    assert cli.run(["check", "bench.toml", "good.csv", "--diagnose"]) == Status.DONE
    assert len(asked) == 1


@pytest.mark.parametrize("form", ["mjcf", "urdf"])
def test_a_model_is_checked_in_mujoco_and_one_that_changed_is_told_from_the_machine(
    form: str, rig: Path, capsys: pytest.CaptureFixture[str]
):
    """With the version that the band was of. Mutations: the device simulated in place of the model;
    the band without its simulator; versions in the wrong order.
    """
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    plain = bench().without_physics("gravity_pendulum", "stribeck_friction")
    rubbing = plain.with_physics(zwidth.make_physics("coulomb_friction", "m1", level=0.02))
    (one,) = stretches(recorded(rubbing, 1), rubbing, "one")
    save_device(with_band(rubbing, [one.split()[1]], RATIO, ()), rig / "rub.toml")
    write_csv(rig / "rub.csv", recorded(rubbing, 80))
    assert cli.run(f"export rub.toml --to {form} --out rub.xml".split()) == Status.DONE
    text = (rig / "rub.xml").read_text()
    on_model = ["check", "rub.toml", "rub.csv", "--joint", "m1", "--model", "rub.xml"]
    assert cli.run([*on_model, "--rebase", "own.toml"]) == Status.DONE
    own = ["check", "own.toml", "rub.csv", "--joint", "m1", "--model"]
    assert cli.run([*own, "rub.xml"]) == Status.DONE
    assert zwidth.check("own.toml", "rub.csv", joint="m1", model="rub.xml").within
    wrong = text.replace("0.02", "0.03")
    assert wrong != text
    (rig / "other.xml").write_text(wrong)
    assert cli.run([*own, "other.xml"]) == Status.FAILED
    here = load_device("own.toml").band
    assert here is not None
    assert here.simulator == f"MuJoCo {version('mujoco')}"
    assert f"the model, in the same {here.simulator}, has changed" in capsys.readouterr().out
    written = Path("own.toml").read_text()
    Path("own.toml").write_text(written.replace(here.simulator, "MuJoCo 3.17.0"))
    assert cli.run([*own, "other.xml"]) == Status.FAILED
    assert f"(MuJoCo 3.17.0 -> {version('mujoco')}) has changed" in capsys.readouterr().out
    own[1] = "rub.toml"
    assert cli.run([*own, "other.xml"]) == Status.FAILED
    assert "the model or its simulator has changed" in capsys.readouterr().out
