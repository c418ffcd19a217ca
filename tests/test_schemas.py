"""The published JSON schemas, held against real outputs and real files."""

import json
import runpy
import tomllib
from pathlib import Path
from typing import Any

import pytest
from test_check import banded, bench, heavier, recorded, write_csv

from zwidth import cli
from zwidth.sim.device_file import commented_text, shipped_devices, template_text
from zwidth.sim.device_file import load_device as load

jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
DOCS = Path(__file__).parents[1] / "docs"
if not DOCS.is_dir():
    pytest.skip("not a clone: the wheel has no documentation", allow_module_level=True)


def refused(name: str, value: Any) -> list[str]:
    schema = json.loads((DOCS / "schemas" / f"{name}.schema.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    found = jsonschema.Draft202012Validator(schema).iter_errors(value)
    return [error.message for error in found]


def test_the_schemas_are_those_that_the_code_declares():
    """Mutation: an effect without a new `python docs/make_schemas.py`."""
    for name, text in runpy.run_path(str(DOCS / "make_schemas.py"))["texts"]().items():
        assert (DOCS / "schemas" / name).read_text() == text, "run: python docs/make_schemas.py"


@pytest.mark.parametrize("name", shipped_devices())
def test_shipped_devices_are_as_the_schema_says(name: str):
    assert refused("device", tomllib.loads(commented_text(load(name)))) == []


def test_a_device_with_a_band_and_the_template_are_too():
    assert refused("device", tomllib.loads(commented_text(banded()))) == []
    assert refused("device", tomllib.loads(template_text(2))) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [("period_s", "period"), ('"stribeck_friction"', '"stribeck"'), ("scatter", "scater"),
     ("[chain]", "[chains]"), ("level", "levl")],
)  # fmt: skip
def test_a_slip_in_a_device_file_is_refused(old: str, new: str):
    assert refused("device", tomllib.loads(commented_text(banded()).replace(old, new)))


def test_a_diagnosis_and_checks_are_as_the_schemas_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    write_csv(tmp_path / "good.csv", recorded(bench(), 70))
    write_csv(tmp_path / "bad.csv", recorded(heavier(bench()), 71))
    (tmp_path / "dev.toml").write_text(commented_text(bench().without_physics("stribeck_friction")))
    line = "diagnose good.csv --device dev.toml --effort quick --json d.json"
    assert cli.run(line.split()) == 0
    found = json.loads((tmp_path / "d.json").read_text())
    assert found["findings"]
    assert refused("diagnosis", found) == []
    improved = "runs/good.augmented.toml"
    assert refused("device", tomllib.loads((tmp_path / improved).read_text())) == []
    assert cli.run(["check", improved, "good.csv", "bad.csv", "--json", "c.json"]) == 1
    found = json.loads((tmp_path / "c.json").read_text())
    assert found["changed"]
    assert refused("check", found) == []
    del found["recordings"][0]["outputs"][0]["most"]
    assert refused("check", found) == ["'most' is a required property"]
