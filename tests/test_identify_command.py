"""`zwidth identify` and `zwidth relay` from the command line to files that other commands read."""

import json
from pathlib import Path

import numpy as np
import pytest

from zwidth import cli
from zwidth.controllers.excitation import noise
from zwidth.covariance import load_covariance
from zwidth.errors import Status
from zwidth.heartbeat import HEART
from zwidth.identification.output import position
from zwidth.sim.device_file import load_device

DESCRIPTION = """file = "rec.csv"
period_s = 0.001
[input]
signal = "u"
unit = "N m"
[[output]]
signal = "q"
quantity = "position"
at = "m1"
unit = "rad"
"""


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    modal = load_device("phantom_1_0").modal
    assert modal is not None
    u = noise(duration=12.0)
    q = position(modal, 0.0, u, 0.001) + 1e-5 * np.random.default_rng(0).standard_normal(u.size)
    table = np.column_stack([u, q])
    np.savetxt(tmp_path / "rec.csv", table, delimiter=",", header="u,q", comments="")
    (tmp_path / "rec.toml").write_text(DESCRIPTION)
    return tmp_path / "rec.toml"


def test_a_recording_becomes_a_device_with_its_covariance(recording: Path) -> None:
    """Mutation: the covariance written in another order than its names."""
    out, result = recording.parent / "out", recording.parent / "r.json"
    asked = ["identify", str(recording), "--modes", "2", "--out", str(out), "--json", str(result)]
    assert cli.run(asked) == Status.DONE
    device, truth = load_device(out / "rec.device.toml"), load_device("phantom_1_0").modal
    assert device.modal is not None
    assert truth is not None
    assert device.modal.inertia == pytest.approx(truth.inertia, rel=1e-4)
    assert device.modal.modes[1].omega == pytest.approx(truth.modes[1].omega, rel=5e-3)
    spread = load_covariance(out / "rec.covariance.json")
    found = json.loads(result.read_text())["parameters"]
    assert list(spread.names) == list(found)
    low, high = found["c_1"]["ci95"]
    deviation = np.sqrt(spread.values[3, 3])
    assert np.log(high / low) == pytest.approx(2.0 * 1.959964 * deviation, rel=1e-6)
    assert (out / "rec_bode.png").stat().st_size > 10_000


def test_it_says_what_it_does(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Mutation: a fit that says nothing of its models."""
    begun: list[str] = []
    monkeypatch.setattr(HEART, "begins", begun.append)
    asked = ["identify", str(recording), "--out", str(recording.parent / "out")]
    assert cli.run([*asked, "--modes", "1"]) == Status.DONE
    fitting = "fitting the device: with 1 vibration mode"
    assert begun == ["reading rec.toml", fitting, "drawing the Bode diagram"]
    begun.clear()
    assert cli.run(asked) == Status.DONE
    _, rigid, one, two, *_ = begun
    assert rigid == "fitting the device: 0 %, as a rigid body"
    assert one == "fitting the device: 20 %, with 1 vibration mode"
    assert two == "fitting the device: 40 %, with 2 vibration modes"


def test_what_cannot_be_identified_is_refused(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(["identify", str(recording.parent / "none.toml")]) == Status.BAD_INPUT
    assert cli.run(["identify", str(recording), "--delay-ms", "soon"]) == Status.BAD_INPUT
    assert "give 0 or more [ms], or fit" in capsys.readouterr().err


def test_relay_gives_verdicts_as_json(tmp_path: Path) -> None:
    result = tmp_path / "r.json"
    asked = ["relay", "phantom_1_0", "--delay-ms", "8", "--damping", "0.08", "0.14"]
    asked += ["--starts", "4", "--out", str(tmp_path), "--json", str(result)]
    assert cli.run(asked) == Status.DONE
    steady, growing = json.loads(result.read_text())["conditions"]
    assert steady["verdict"] == "oscillates"
    assert steady["stiffness"] == pytest.approx(7.747, rel=0.01)
    assert sum(cycle["share"] for cycle in steady["cycles"]) == pytest.approx(1.0)
    assert growing == growing | {"verdict": "diverges", "stiffness": None, "frequency_hz": None}
    assert (tmp_path / "relay.png").exists()
