"""Laws, rates and force sensors in scenarios: run from a file, logged, and replayed bit for bit."""

from pathlib import Path

import pytest

from zwidth.cli import run
from zwidth.scenarios.scenario_file import load_scenario
from zwidth.sim.device_file import load_device, save_device

LAWS = {
    "guarded": "stiffness = 60.0\ndamping = 0.0\nmost_damping = 0.05\none_sided = true",
    "texture": "stiffness = 8.0\nwavelength = 2e-3\nshare = 0.6\ndamping = 0.01",
    "region": "damping = 0.03\nposition = -1e-3\nwidth = 3e-3",
}


@pytest.mark.parametrize("kind", LAWS)
def test_a_law_in_a_scenario_is_logged_and_replayed(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With two rates, a filter of second order and force feedback on the device.

    Mutations: the slope of the filter, or the position given to the law, not set at the start of a
    run; a law's key left out of its facts.
    """
    monkeypatch.chdir(tmp_path)
    device = load_device("phantom_1_0").with_interface(
        delay=3e-4, period=5e-4, velocity_ticks=2, position_ticks=3, velocity_cutoff_hz=90.0,
        velocity_order=2, force_sensor="link12", force_gain=0.2, encoder_step=2e-6,
    )  # fmt: skip
    save_device(device, "dev.toml")
    Path("law.toml").write_text(
        f'duration_s = 0.4\n[device]\npath = "dev.toml"\n[controller]\nkind = "{kind}"\n'
        f"{LAWS[kind]}\n[start]\nposition = -5e-4\nvelocity = 0.05\n"
    )
    scenario = load_scenario("law.toml")
    assert scenario.controller.kind == kind
    assert scenario.device.interface == device.interface
    assert run(["simulate", "law.toml", "--out", "o"]) == 0
    assert run(["replay", "o/law.mcap"]) == 0
    assert "identical" in capsys.readouterr().out


def test_an_unknown_key_of_a_law_names_the_nearest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("law.toml").write_text(
        'duration_s = 0.4\n[device]\nname = "phantom_1_0"\n[controller]\nkind = "texture"\n'
        "stiffness = 1.0\nwavelenght = 1e-3\n"
    )
    assert run(["simulate", "law.toml"]) == 2
    assert "wavelength" in capsys.readouterr().err
