"""The reference pages say what the code declares, and the declarations what the readers read."""

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import pytest
from page_checks import chromium, faults_of_picture

from zwidth.cli import run
from zwidth.errors import Status
from zwidth.logs import recording_file
from zwidth.logs.recording_keys import RECORDING_KEYS
from zwidth.sim import device_file
from zwidth.sim.changes import KEYS
from zwidth.sim.device_file import commented_text, device_from_text, load_device, template_text
from zwidth.sim.device_keys import DEVICE_KEYS
from zwidth.sim.drive import NEEDED, POSSIBLE
from zwidth.sim.physics import EFFECTS, make_physics
from zwidth.sim.physics.points import of_points
from zwidth.sim.uncertainty import UNCERTAINTY_FIELDS

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("made", ROOT / "docs" / "make_reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    importlib.import_module("sys").modules["made"] = module  # dataclasses look there
    spec.loader.exec_module(module)
    return module


def test_the_pages_are_up_to_date(maker: ModuleType):
    """If it fails: python docs/make_reference.py (--pictures where an effect is new)."""
    folder, pages = ROOT / "docs" / "reference", maker.pages()
    for name, text in pages.items():
        assert (folder / name).read_text(encoding="utf-8") == text, name
    there = {str(path.relative_to(folder).as_posix()) for path in folder.rglob("*.md")}
    assert there == {*pages, "export.md"}  # that by docs/make_export_page.py
    for effect in EFFECTS:
        assert (folder / "effects" / f"{effect}.png").stat().st_size > 5000


def test_every_key_that_is_read_is_declared_and_no_other():
    """Mutation: a key added to a reader alone."""
    of = {t: {k.name for k in DEVICE_KEYS if k.table == t} for t in {k.table for k in DEVICE_KEYS}}
    tables = {"modal", "chain", "interface", "drive", "uncertainty", "band", "posterior", "physics"}
    assert of[""] == set(device_file.TOP_KEYS) - tables
    assert of["chain"] == set(device_file.CHAIN_KEYS)
    assert of["modal"] == {key for keys in device_file.MODAL_KEYS.values() for key in keys}
    assert of["modal.mode"] == set(device_file.MODE_KEYS)
    assert of["interface"] == set(device_file.INTERFACE_KEYS)
    assert of["band"] == set(device_file.BAND_KEYS)
    assert of["band.output"] == set(device_file.BAND_OUTPUT_KEYS)
    assert of["posterior"] == set(device_file.POSTERIOR_KEYS)
    assert of["uncertainty"] == set(UNCERTAINTY_FIELDS)
    numbers = {key for keys in (*NEEDED.values(), *POSSIBLE.values()) for key in keys}
    assert of["drive"] == {"kind", *numbers}
    signals = {"input", "output", "base", "known_force", "joint", "covariate", "enable", "supply"}
    said = {t: {k.name for k in RECORDING_KEYS if k.table == t} for t in ("", *signals)}
    assert said[""] == set(recording_file.TOP_KEYS) - signals - {"use", "csv", "device", "free"}
    assert said["covariate"] == set(recording_file.COVARIATE_KEYS)
    assert said["joint"] == set(recording_file.JOINT_KEYS)
    assert said["input"] == set(recording_file.COMMAND_KEYS)
    assert said["output"] == set(recording_file.OUTPUT_KEYS)
    assert said["base"] == set(recording_file.BASE_KEYS)
    assert said["known_force"] == set(recording_file.KNOWN_FORCE_KEYS)
    (changes,) = (k.meaning for k in RECORDING_KEYS if k.table == "device")
    assert all(key in changes for key in KEYS if key != "masses")


def test_every_parameter_says_what_it_is():
    for effect in EFFECTS.values():
        assert all(parameter.meaning for parameter in effect.parameters), effect.name
        assert set(effect.mistaken_for) <= set(EFFECTS)


def test_every_law_is_a_formula_in_the_names_of_its_parameters():
    """Mutation: `static_level` left out of Stribeck's. A table has no numbers to name."""
    for effect in EFFECTS.values():
        assert effect.formula, effect.name
        names = set() if of_points(effect.parameters) else {p.name for p in effect.parameters}
        assert {n for n in names if n not in effect.formula} == set(), effect.name


@pytest.mark.parametrize("name", ["backlash", "encoder_step"])
def test_the_picture_of_an_effect_is_drawn_and_no_text_lies_on_another(name: str, tmp_path: Path):
    """Mutation: as many ticks as matplotlib takes, which lie on each other under the play."""
    assert run(["effects", name, "--picture", str(tmp_path / "p.png")]) == Status.DONE
    assert (tmp_path / "p.png").stat().st_size > 10_000
    with chromium() as browser:
        svg = (tmp_path / "p.svg").read_text(encoding="utf-8")
        assert faults_of_picture(browser.new_page(), svg[svg.index("<svg") :]) == []


def test_comments_change_nothing_of_a_device():
    """Mutation: a comment put into a line of numbers."""
    device = load_device("phantom_1_0").with_physics(
        make_physics("backlash", "link12", gap=0.01),
        make_physics("gravity_pendulum", "m1", level=0.1, angle=0.5),
    )
    text = commented_text(device)
    assert device_from_text(text) == device
    assert "gap = 0.01  # [rad] all of the play" in text
    assert "period_s = 0.001  # [s] sampling period" in text


def test_a_template_is_a_device_of_so_many_masses():
    for masses in (1, 2, 5):
        text = template_text(masses)
        assert device_from_text(text).chain.masses.size == masses
        assert all(f"{key.name} = " in text for key in DEVICE_KEYS if key.table == "interface")


def test_effects_are_listed_and_described(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert run(["effects"]) == Status.DONE
    said = capsys.readouterr().out
    assert all(name in said for name in EFFECTS)
    assert run(["effects", "backlash", "--json", str(tmp_path / "e.json")]) == Status.DONE
    said = capsys.readouterr().out
    assert "all of the play" in said
    assert "0 within gap" in said
    found = json.loads((tmp_path / "e.json").read_text())
    assert found["parameters"][0]["unit"] == {"rotary": "rad", "linear": "m"}
    assert run(["effects", "free_force"]) == Status.DONE
    assert "force_1_1 to force_8_8" in capsys.readouterr().out
    assert run(["effects", "free_product"]) == Status.DONE
    assert "second_at_1 to second_at_32" in capsys.readouterr().out
    assert run(["effects", "backlach"]) == Status.BAD_INPUT
    assert "did you mean 'backlash'" in capsys.readouterr().err


def test_a_file_of_another_kind_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Mutation: a device file given as a scenario ends in "unknown key 'chain'"."""
    (tmp_path / "device.toml").write_text(template_text(1))
    (tmp_path / "scenario.toml").write_text('duration_s = 1\n[controller]\nkind = "wall"\n')
    for words in (["simulate", "device.toml"], ["devices", "scenario.toml"]):
        assert run([words[0], str(tmp_path / words[1])]) == Status.BAD_INPUT
        kind = words[1].removesuffix(".toml")
        assert f"this is a {kind}" in capsys.readouterr().err


def test_a_shipped_device_given_as_a_scenario_is_named(capsys: pytest.CaptureFixture[str]):
    assert run(["simulate", "phantom_1_0"]) == Status.BAD_INPUT
    assert "that is a device, and a scenario file is needed" in capsys.readouterr().err


def test_a_device_is_named_in_its_place_or_by_option_once(capsys: pytest.CaptureFixture[str]):
    """Mutation: the option that nobody reads."""
    for words in (["--device", "nope"], ["nope"]):
        for command in ("plan", "boundary", "map", "relay", "explore"):
            assert run([command, *words]) == Status.BAD_INPUT
            assert "'nope' is neither a file nor a shipped device" in capsys.readouterr().err
    assert run(["plan", "phantom_1_0", "--device", "phantom_1_0"]) == Status.BAD_INPUT
    assert "given twice" in capsys.readouterr().err
    assert run(["boundary", "phantom_1_0", "--damping", "1e300"]) == Status.BAD_INPUT
    assert "--damping is 1e+300" in capsys.readouterr().err
