"""What a release says of itself, in every place the same."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
WORKFLOW = ROOT / ".github" / "workflows" / "release.yml"
if not WORKFLOW.is_file():
    pytest.skip("not a clone: a distribution has no workflow", allow_module_level=True)
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_the_version_stands_in_one_place_and_others_repeat_it():
    version = PROJECT["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    first = re.search(r"^## (\S+?),? ", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert first is not None
    assert first[1] == version
    assert f"from {version} on" in (ROOT / "SECURITY.md").read_text()
    assert not list((ROOT / "zwidth").glob("_version.py"))


def test_the_supported_pythons_are_those_that_the_workflow_tries():
    yaml = pytest.importorskip("yaml", reason="PyYAML, which mkdocs brings, is not installed")
    jobs = yaml.safe_load(WORKFLOW.read_text())["jobs"]
    tried = jobs["try"]["strategy"]["matrix"]["python"]
    said = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if "Python :: 3." in c]
    assert tried == said
    assert PROJECT["requires-python"] == f">={said[0]}"
    assert f"Python {said[0]} to {said[-1]}." in (ROOT / "SECURITY.md").read_text()
    assert jobs["publish"]["permissions"] == {"id-token": "write"}
    assert "secrets." not in WORKFLOW.read_text()
