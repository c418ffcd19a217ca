"""`zwidth diagnose` from a file of samples to report, device and JSON."""

import json
from pathlib import Path

import numpy as np
import pytest

from sim.device_file import load_device, save_device
from sim.physics import make_physics
from tests.diagnosis_examples import phantom, record
from zwidth.cli import run

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


def write(folder: Path, seconds: float = 3.0) -> None:
    truth = phantom().with_physics(make_physics("coulomb_friction", "m1", level=0.02))
    e = record(truth, seconds, seed=1)
    values = np.column_stack([e.command, e.measured[:, 0]])
    np.savetxt(folder / "swing.csv", values, "%.17g", ",", header="u,q", comments="")
    (folder / "swing.toml").write_text(TOML)
    save_device(phantom(), folder / "known.toml")


def test_diagnose_from_file_to_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Mutations that break it: the device as loaded saved in place of the augmented one; numbers
    that are none written as such (held out are 0.9 s, too short for a free run).
    """
    write(tmp_path)
    monkeypatch.chdir(tmp_path)
    line = ["diagnose", "swing.toml", "--device", "known.toml", "--out", "o", "--json", "o/r.json"]
    assert run(line) == 0
    result = json.loads(Path("o/r.json").read_text())
    assert result["verdict"] == "identified"
    assert result["findings"][0]["effect"] == "coulomb_friction"
    assert result["fit"]["held_out"]["after"] < result["fit"]["held_out"]["refit"]
    augmented = load_device(result["augmented_device"])
    level = result["findings"][0]["parameters"]["level"]["value"]
    assert augmented.physics[0].values["level"] == pytest.approx(level, rel=1e-9)
    page = Path(result["report"]).read_text(encoding="utf-8")
    assert "Identified" in page
    assert ">nan<" not in page


def test_what_cannot_be_diagnosed_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Mutation that breaks it: ExperimentError is no ValueError."""
    write(tmp_path, 0.1)
    monkeypatch.chdir(tmp_path)
    assert run(["diagnose", "swing.toml", "--device", "known.toml"]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert said[-1].startswith("error: the recording has 100 samples")
