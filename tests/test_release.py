"""What a release says of itself, in every place the same."""

import json
import os
import re
import shutil
import subprocess
import sys
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


def test_a_release_is_tried_with_the_lowest_versions_and_has_its_bill_of_materials():
    """Mutation: `publish` without `lowest`, or a release without the SBOM."""
    yaml = pytest.importorskip("yaml", reason="PyYAML, which mkdocs brings, is not installed")
    jobs = yaml.safe_load(WORKFLOW.read_text())["jobs"]
    assert set(jobs["publish"]["needs"]) == {"try", "lowest"}
    assert "--resolution lowest-direct" in jobs["lowest"]["steps"][-1]["run"]
    assert jobs["attach"]["permissions"] == {"contents": "write"}
    assert "zwidth.cdx.json" in jobs["attach"]["steps"][-1]["run"]


def test_a_tag_of_another_version_is_not_published(tmp_path: Path):
    """By the step's own lines. Mutations: only the beginning compared; publishing before it."""
    yaml = pytest.importorskip("yaml", reason="PyYAML, which mkdocs brings, is not installed")
    steps = yaml.safe_load(WORKFLOW.read_text())["jobs"]["publish"]["steps"]
    lines = [step.get("run", "") for step in steps]
    (refusal,) = [i for i, line in enumerate(lines) if "GITHUB_REF_NAME" in line]
    assert "gh-action-pypi-publish" in steps[refusal + 1]["uses"]
    version = PROJECT["version"]
    (tmp_path / "dist").mkdir()

    def refused(tag: str) -> bool:
        return subprocess.run(
            ["bash", "-e", "-c", lines[refusal]], cwd=tmp_path, capture_output=True, check=False,
            env=os.environ | {"GITHUB_REF_NAME": tag},
        ).returncode != 0  # fmt: skip

    assert refused(f"v{version}")  # nothing was built
    for name in (f"zwidth-{version}-py3-none-any.whl", f"zwidth-{version}.tar.gz"):
        (tmp_path / "dist" / name).touch()
    assert not refused(f"v{version}")
    assert all(refused(tag) for tag in ("v0.9", f"v{version}1", f"v{version[:-1]}", "v*"))
    (tmp_path / "dist" / "zwidth-0.9.tar.gz").touch()
    assert refused(f"v{version}")


def test_the_bill_of_materials_names_zwidth_as_its_root(tmp_path: Path):
    """Of this environment, which needs no network; a release validates it, too, for 20 s.

    Mutation: without `--pyproject`, no root.
    """
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    if shutil.which("cyclonedx-py", path=path) is None:
        pytest.skip("cyclonedx-py is not here (pip install cyclonedx-bom)")
    out = tmp_path / "zwidth.cdx.json"
    line = ["bash", ROOT / ".ci" / "sbom", sys.executable, out, "--no-validate"]
    subprocess.run(line, check=True, env=os.environ | {"PATH": path})
    found = json.loads(out.read_text())
    root = found["metadata"]["component"]
    assert (root["name"], root["version"]) == ("zwidth", PROJECT["version"])
    assert "numpy" in {component["name"] for component in found["components"]}
    of_root = next(one for one in found["dependencies"] if one["ref"] == root["bom-ref"])
    assert len(of_root["dependsOn"]) >= len(PROJECT["dependencies"])
