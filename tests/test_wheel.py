"""What is installed is one name; a user's own files of our folders' names are in nobody's way."""

import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
OURS = ("sim", "logs", "diagnosis", "jobs", "files", "stability", "scenarios", "controllers")
SCRIPT = """
import zwidth
device = zwidth.load_device("phantom_1_0")
run = zwidth.simulate(device, zwidth.wall(2.0, 0.0), duration=0.1, start=zwidth.Start(1e-3))
import sim, logs, diagnosis
print(type(run).__name__, sim.MINE, logs.MINE, diagnosis.MINE)
"""


def checked(*command: str | Path, cwd: Path) -> str:
    """Run a command and return what it prints; nothing of this checkout is on its path."""
    environment = {k: v for k, v in os.environ.items() if k not in {"PYTHONPATH", "COLUMNS"}}
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=environment, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return wheels built from the tree and from the source distribution."""
    folder = tmp_path_factory.mktemp("dist")
    build = "import sys; from hatchling.build import build_{0} as b; print(b(sys.argv[1]))"
    whole = checked(sys.executable, "-c", build.format("sdist"), folder, cwd=ROOT).split()[-1]
    checked("tar", "-xzf", folder / whole, "-C", folder, cwd=folder)
    source = folder / whole.removesuffix(".tar.gz")
    wheels: dict[str, Path] = {}
    for name, tree in (("tree", ROOT), ("sdist", source)):
        to = folder / name
        made = checked(sys.executable, "-c", build.format("wheel"), to, cwd=tree).split()[-1]
        wheels[name] = to / made
    return wheels


def test_the_wheel_of_the_source_distribution_is_that_of_the_tree(built: dict[str, Path]) -> None:
    """Mutation: the folders not mapped in, which the wheel made from the sdist then lacks."""
    contents = {name: sorted(zipfile.ZipFile(wheel).namelist()) for name, wheel in built.items()}
    assert contents["tree"] == contents["sdist"]
    tops = {entry.split("/")[0] for entry in contents["tree"]}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"zwidth"}
    assert len(contents["tree"]) == len(set(contents["tree"]))


LINKLESS = """
import zwidth
from zwidth.jobs.digest import code_digest, _sources
device = zwidth.load_device("phantom_1_0")
import zwidth.diagnosis.diagnose, zwidth.export.mjcf, zwidth.views.fields
print(len(list(_sources("zwidth.stability.boundary"))) > 50, zwidth.sim.__file__)
"""


def test_a_clone_without_links_works(tmp_path: Path) -> None:
    """As Windows makes one: text files for links. Mutation: the folder above not looked into."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a clone")
    clone = tmp_path / "clone"
    checked("git", "clone", "-q", "-c", "core.symlinks=false", ROOT, clone, cwd=tmp_path)
    assert (clone / "zwidth" / "sim").read_text() == "../sim"
    source = f"import sys; sys.path.insert(0, {str(clone)!r})\n{LINKLESS}"
    said = checked(sys.executable, "-P", "-c", source, cwd=tmp_path).split()
    assert said == ["True", str(clone / "sim" / "__init__.py")]


@pytest.mark.truth
def test_a_users_own_sim_and_logs_are_in_nobodys_way(
    built: dict[str, Path], tmp_path: Path
) -> None:
    """Mutation: one module of ours imports `sim` by its bare name."""
    venv.create(tmp_path / "fresh", with_pip=False)
    python = tmp_path / "fresh" / "bin" / "python"
    site = next((tmp_path / "fresh" / "lib").glob("python*")) / "site-packages"
    pip = [sys.executable, "-m", "pip", "--python", python, "install", "-q", "--no-deps"]
    checked(*pip, "--no-index", "--disable-pip-version-check", built["tree"], cwd=tmp_path)
    assert {p.name for p in site.iterdir() if not p.name.endswith(".dist-info")} == {"zwidth"}

    # What we depend on comes from this environment. A path in a .pth file is no site folder, so the
    # .pth of our own editable install is not read there.
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    desk = tmp_path / "desk"
    for name in OURS:
        (desk / name).mkdir(parents=True)
        (desk / name / "__init__.py").write_text("MINE = 1\n", encoding="utf-8")
    for name in ("sim", "diagnosis"):
        (desk / name / "__init__.py").unlink()
        (desk / name).rmdir()
        (desk / f"{name}.py").write_text("MINE = 2\n", encoding="utf-8")
    (desk / "script.py").write_text(SCRIPT, encoding="utf-8")
    assert checked(python, "script.py", cwd=desk).split() == ["Run", "2", "1", "2"]
    shown = checked(tmp_path / "fresh" / "bin" / "zwidth", "devices", cwd=desk)
    assert "phantom_1_0" in shown
    again = checked(python, "-m", "zwidth", "devices", "phantom_1_0", cwd=desk)
    assert "PHANToM" in again
