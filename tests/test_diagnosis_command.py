"""`zwidth diagnose` from a file of samples to report, device and JSON."""

import html
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

import zwidth.diagnose_files
from tests.diagnosis_examples import record
from tests.foxglove_layout import OF_A_DIAGNOSIS, assert_shown
from zwidth.cli import run
from zwidth.diagnosis.answer.result import Diagnosis, Estimate
from zwidth.logs.mcap_reader import read_log
from zwidth.logs.recording import load_log
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device, save_device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics

TOML = """
file = "swing.csv"
rotary = true
period_s = 0.001
[input]
signal = "u"
unit = "N m"
[[output]]
signal = "q"
unit = "rad"
quantity = "position"
at = "m1"
"""


# One mass, which has a tenth of the places for physics that the PHANToM has.
MOTOR = Device("motor", "", True, make_chain([1.2e-3], [6e-3]), Interface(period=0.001))

# What is said where the device file leaves the command's scale open, and only there.
SCALE = (
    "the command's scale: 0.938 (0.920 to 0.950);"
    " all forces, masses, springs and dampers are proportional to this scale"
)


def write(folder: Path, seconds: float = 3.0) -> None:
    truth = MOTOR.with_physics(make_physics("coulomb_friction", "m1", level=0.02))
    e = record(truth, seconds, seed=1)
    values = np.column_stack([e.command, e.measured[:, 0]])
    np.savetxt(folder / "swing.csv", values, "%.17g", ",", header="u,q", comments="")
    (folder / "swing.toml").write_text(TOML)
    save_device(MOTOR, folder / "known.toml")


def test_diagnose_from_file_to_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Mutations that break it: the device as loaded saved in place of the augmented one; numbers
    that are none written as such (held out are 0.9 s, too short for a free run); progress among
    the results; residuals at the time of writing.
    """
    write(tmp_path)
    monkeypatch.chdir(tmp_path)
    kept: list[Diagnosis] = []
    monkeypatch.setattr(zwidth.diagnose_files, "diagnose", _keeping(kept))
    line = ["diagnose", "swing.toml", "--device", "known.toml", "--effort", "quick", "--out", "o"]
    assert run([*line, "--json", "o/r.json"]) == 0
    result = json.loads(Path("o/r.json").read_text())
    assert result["verdict"] == "identified"
    assert result["findings"][0]["effect"] == "coulomb_friction"
    assert result["fit"]["held_out"]["after"] < result["fit"]["held_out"]["refit"]
    augmented = load_device(result["augmented_device"])
    level = result["findings"][0]["parameters"]["level"]["value"]
    assert augmented.physics[0].values["level"] == pytest.approx(level, rel=1e-9)
    page = Path(result["report"]).read_text(encoding="utf-8")
    assert result["headline"].startswith("Coulomb friction of ")
    assert result["headline"].endswith(" at the motor is missing from the simulation")
    assert "<h1>Missing: Coulomb friction at the motor</h1>" in page
    assert f"<dd>{result['headline']}.</dd>" in page.replace("\u00a0", " ")
    sure = "<dt>How sure</dt><dd><strong>Identified</strong>. The probability among all models"
    assert f"{sure} tried is " in page
    assert "improved device o/swing.augmented.toml" in page  # what to do now
    assert " ".join(["zwidth", *line, "--json", "o/r.json"]) in html.unescape(page)
    assert f"cd {tmp_path} &amp;&amp; zwidth diagnose" in page
    first, where = page.index("<img"), page.index('<h2 id="found">')
    assert "beside free runs before and after" in page[first:where]  # the first picture
    assert 'class="warning"' not in page
    assert result["warnings"] == []
    assert "command's scale" not in html.unescape(page)
    assert "gain" not in result["linear_refit"]
    assert ">nan<" not in page
    (whole,) = result["fit"]["whole_run"]
    assert whole["output"] == "position_m1"
    assert whole["held_out"]
    assert whole["unit"] == "rad"
    assert whole["rms"]["after"] < whole["rms"]["refit"]
    assert whole["share"]["after"] == pytest.approx(whole["rms"]["after"] / whole["motion_rms"])
    out, err = capsys.readouterr()
    assert "... " not in out
    assert f"\n{result['headline']}\n" in out
    assert "command's scale" not in out
    assert " s  locating" in err
    residual, recording = read_log(result["logs"][0]), load_log("swing.toml")
    assert residual.epoch_ns == recording.epoch_ns
    assert residual.tick.t == pytest.approx(recording.tick.t)
    _what_a_viewer_shows(Path(result["logs"][0]), result)
    _what_else_it_may_say(kept[0], monkeypatch, capsys)


def _what_a_viewer_shows(log: Path, result: dict[str, Any]) -> None:
    """Measured, before and after on one clock, and what was found over the stretch that it is of.

    Mutations that break it: the refitted device in place of the device file's; held-out data marked
    from the recording's first sample; a path of the layout for Foxglove misspelt.
    """
    topics = assert_shown(log, OF_A_DIAGNOSIS)
    assert topics == {"/tick", "/annotations", "/annotations_text"}
    tick, period = read_log(log).tick, 0.001
    free = {word: tick[f"{word}_free_position_m1"] for word in ("before", "refit", "found")}
    off = {word: np.nanstd(run - tick["position_m1"]) for word, run in free.items()}
    assert off["found"] < 0.5 * off["refit"] < 0.5 * off["before"]
    with log.open("rb") as file:
        decoded = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages
        messages = [(c.topic, m) for _, c, _, m in decoded(["/annotations", "/annotations_text"])]
    told = {m.name: m for topic, m in messages if topic == "/annotations_text"}
    texts = {name: m.message for name, m in told.items()}
    assert texts["mark_1"] == result["headline"]
    (friction,) = (n for n, t in texts.items() if t.startswith("missing: Coulomb friction at the"))
    assert told[friction].level == 3  # a warning
    assert np.all(tick[friction] == 3.0)
    (judges,) = (n for n, t in texts.items() if "to judge it" in t)
    lasts = tick.t[tick[judges] > 0.0]
    assert lasts[0] == pytest.approx(0.7 * tick.t[-1], abs=0.02)
    assert lasts[-1] == tick.t[-1]
    for topic, m in messages:
        if topic == "/annotations":
            about = {pair.key: pair.value for pair in m.metadata}
            inside = tick.t[tick[about["name"]] > 0.0]
            ends = [m.start_time.ToNanoseconds(), m.end_time.ToNanoseconds()]
            clock = read_log(log).epoch_ns
            assert [(end - clock) / 1e9 for end in ends] == pytest.approx(
                [inside[0], inside[-1]], abs=period
            )
            assert about["text"] == texts[about["name"]]


def _keeping(kept: list[Diagnosis]) -> Any:
    """Let `diagnose` do its work and keep what it finds."""
    real = zwidth.diagnose_files.diagnose

    def diagnose(*asked: Any) -> Diagnosis:
        kept.append(real(*asked))
        return kept[-1]

    return diagnose


def _what_else_it_may_say(
    found: Diagnosis, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Interrupted, nothing found, a gain, and two recordings of one name."""
    other = replace(
        found,
        findings=(),
        interrupted=True,
        upper_bounds={
            "coulomb_friction@m1": {"level": 1e-3},
            "gain_asymmetry@command": {"ratio": 1.0000003},  # of which there is none at 1
        },
        experiments=2 * found.experiments,
        linear_refit={"gain": (1.0, Estimate(0.938, 0.92, 0.95))},
    )
    monkeypatch.setattr(zwidth.diagnose_files, "diagnose", lambda *_: other)
    Path("sub").mkdir()
    for name in ("swing.toml", "swing.csv"):
        shutil.copy(name, Path("sub", name))
    line = ["diagnose", "swing.toml", "sub/swing.toml", "--device", "known.toml", "--out", "o"]
    assert run(line) == 130
    out, _ = capsys.readouterr()
    assert "\ninterrupted, so this is the result so far: Coulomb friction of " in out
    assert "augmented.toml\nthe improved device multiplies the command by 0.938" in out
    assert f"\n{SCALE}\n" in out
    assert "gain  " not in out
    assert "swing.diagnosis.mcap\nwrote o/swing-2.diagnosis.mcap\n" in out
    page = Path("o/swing.diagnosis.html").read_text(encoding="utf-8")
    assert "<strong>Identified</strong>, interrupted, so this is the result so far. " in page
    assert "Coulomb friction at the motor</td>" in page
    assert '<td class="text">below 1 mN m</td>' in page
    assert '<td class="text">within 3e-7 of 1</td>' in page
    assert "The improved device multiplies the command by 0.938" in page
    assert SCALE[1:] in html.unescape(page).replace("\u00a0", " ")
    assert '<td class="text">gain</td>' not in page


def test_a_recording_that_is_fitted_does_not_judge(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """By another spelling neither; mutation that breaks it: paths compared unresolved."""
    write(tmp_path, 0.3)
    monkeypatch.chdir(tmp_path)
    again = f"../{tmp_path.name}/swing.toml"
    line = ["diagnose", "swing.toml", "--device", "known.toml", "--validate", again]
    assert run(line) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"error: --validate is {again}, a recording that is fitted")
    assert said.count("\n") == 1


def test_a_recording_in_which_nothing_moves_does_not_judge(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Mutation that breaks it: the error let through, by which there was no answer at all."""
    write(tmp_path, 0.3)
    monkeypatch.chdir(tmp_path)
    rows = Path("swing.csv").read_text().splitlines()
    still = [rows[0], *(f"{row.split(',')[0]},0" for row in rows[1:]), ""]
    Path("still.csv").write_text("\n".join(still))
    Path("still.toml").write_text(Path("swing.toml").read_text().replace("swing", "still"))
    judged_by: list[object] = []

    def diagnose(*asked: object) -> Diagnosis:
        judged_by.append(asked[2])
        raise KeyboardInterrupt

    monkeypatch.setattr(zwidth.diagnose_files, "diagnose", diagnose)
    line = ["diagnose", "swing.toml", "--device", "known.toml", "--validate", "still.toml"]
    assert run(line) == 130
    assert judged_by == [None]
    assert (
        "still.toml cannot judge the answer (channel 'position_m1' is constant at 0); the last 30 %"
        " of each recording are used instead"
    ) in " ".join(capsys.readouterr().err.split())


def test_absurd_values_end_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Mutation that breaks it: numpy's warnings of 1e300 let through."""
    write(tmp_path, 0.5)
    monkeypatch.chdir(tmp_path)
    rows = Path("swing.csv").read_text().splitlines()
    rows[50] = f"{rows[50].split(',')[0]},1e300"
    Path("swing.csv").write_text("\n".join([*rows, ""]))
    assert run(["diagnose", "swing.toml", "--device", "known.toml"]) == 2
    said = [row for row in capsys.readouterr().err.splitlines() if not row.startswith("... ")]
    assert len(said) == 1
    assert said[0].startswith("error: ")


def test_what_cannot_be_diagnosed_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Mutation that breaks it: ExperimentError is no ValueError."""
    write(tmp_path, 0.1)
    monkeypatch.chdir(tmp_path)
    assert run(["diagnose", "swing.toml", "--device", "known.toml"]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert said[-1].startswith("error: the recording has 100 samples")
