"""The tree is checked by the tree: layers, public names, and the commands that the README shows."""

import ast
import importlib
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from importlinter.cli import lint_imports

import zwidth

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PACKAGES = sorted(
    folder.name
    for folder in ROOT.iterdir()
    if (folder / "__init__.py").exists() and folder.name != "tests"
)
UNTYPED = "# pyright: reportMissingParameterType=false, reportUnknownParameterType=false"


def sources() -> list[Path]:
    return [file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py"))]


def shown_commands() -> list[str]:
    """The README's command lines, which .ci/run runs."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    return re.findall(r"^python3 -m venv .venv.*$", text, re.MULTILINE)


def test_imports_point_down(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    monkeypatch.chdir(ROOT)
    assert lint_imports(no_cache=True) == 0, capsys.readouterr().out


def test_every_package_is_reached_through_its_link_and_mapped_into_the_wheel():
    """Mutation: a link left out of `exclude`, which puts it into the wheel beside the folder."""
    targets = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
    folders = [name for name in PACKAGES if name != "zwidth"]
    links = {link.name: link.resolve() for link in (ROOT / "zwidth").iterdir() if link.is_symlink()}
    assert links == {name: ROOT / name for name in folders}
    assert targets["packages"] == ["zwidth"]
    assert targets["exclude"] == [f"/zwidth/{name}" for name in folders]
    mapped = {name: f"zwidth/{name}" for name in folders} | {"docs/schemas": "zwidth/schemas"}
    assert targets["force-include"] == mapped
    assert set(PROJECT["tool"]["ruff"]["lint"]["flake8-tidy-imports"]["banned-api"]) == set(folders)


def test_public_names_are_what_type_checkers_see():
    """The names of `import zwidth` stand twice: for the running program and for type checkers."""
    tree = ast.parse(Path(zwidth.__file__).read_text(encoding="utf-8"))
    seen = {
        alias.name: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.asname == alias.name
    }
    assert seen == zwidth.HOMES


@pytest.mark.parametrize("name", zwidth.HOMES)
def test_every_public_name_exists_and_says_what_it_is(name: str):
    value = getattr(zwidth, name)
    assert value.__name__ == name
    assert value.__module__ == zwidth.HOMES[name]
    assert value.__doc__
    if isinstance(value, type):
        methods = [m for key, m in vars(value).items() if callable(m) and key[0] != "_"]
        assert all(method.__doc__ for method in methods)


def test_importing_zwidth_waits_for_none_of_them():
    """Mutation: `import zwidth` imports one of its names at once."""
    code = "import sys, zwidth; print(*dir(zwidth)); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    names, modules = (set(line.split()) for line in done.stdout.splitlines())
    assert set(zwidth.HOMES) <= names
    ours = {f"zwidth.{name}" for name in PACKAGES}
    assert not modules & {"numpy", "numba", "scipy", "matplotlib", "mcap", "xarray", *ours}


def test_only_files_writes_files():
    """What goes by `files` may write over what a user made; so nothing does.

    Mutation: `path.write_text(...)` anywhere. A log appends to a file that it makes, and `files`
    gives it its name; what is dropped into the page goes into a temporary folder, and so does the
    copy of a log that is followed.
    """
    opens = r"\.write_(text|bytes)\(|\bopen\((\w+, )?[\"'][wax]"
    others = r"\bos\.(open|replace|rename)\(|\.tofile\("
    writing = re.compile(f"{opens}|{others}")
    found = {f for f in sources() if writing.search(f.read_text(encoding="utf-8"))}
    assert {str(file.relative_to(ROOT)) for file in found} == {
        *("files/whole.py", "files/protection.py", "logs/sink.py"),
        "logs/bag_folder.py",  # unpacks into a folder of its own, which it removes
        *("zwidth/cli.py", "zwidth/explore/dropped.py", "zwidth/watch/growing.py"),
    }


def test_an_unknown_public_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'boundry'"):
        _ = zwidth.boundry  # pyright: ignore[reportAttributeAccessIssue]


def test_nothing_hides_from_the_type_checker():
    """Only compiled functions go untyped, and a file that has none may not say it does."""
    for file in sources():
        text = file.read_text(encoding="utf-8")
        relaxed = re.findall(r"^# pyright: (?!ignore).*$", text, re.MULTILINE)
        compiled = re.search(r"^@(jit|part)\b", text, re.MULTILINE)
        assert relaxed == [] or (relaxed == [UNTYPED] and compiled), f"{file}: {relaxed}"


def test_the_readme_shows_two_commands_that_ci_runs():
    main_job, tests = shown_commands()
    name, *arguments = shlex.split(main_job.split(" && ")[-1])
    assert name == ".venv/bin/zwidth"
    command = importlib.import_module(f"zwidth.commands.{arguments[0]}").command
    context = command.make_context(arguments[0], arguments[1:])
    (recording,) = context.params["recordings"]
    assert (ROOT / recording).is_file()
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) < 90
    assert tests.endswith(".venv/bin/pytest -n auto")
    assert "dev" in PROJECT["project"]["optional-dependencies"]
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert "grep '^python3 -m venv .venv' README.md" in script


def test_documents_point_at_files_that_exist():
    for name in ("README.md", "DEVELOPERS.md"):
        text = (ROOT / name).read_text(encoding="utf-8")
        for target in re.findall(r"\]\(([^)#:]+)\)", text):
            assert (ROOT / target).exists(), f"{name} points at {target}"


def test_data_files_of_the_packages_are_not_ignored_by_git():
    """What git ignores is left out of the wheel."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a git checkout")
    data = [str(f) for p in ("sim/devices", "scenarios/data") for f in (ROOT / p).glob("*.toml")]
    assert data
    done = subprocess.run(
        ["git", "check-ignore", *data], cwd=ROOT, env=os.environ, capture_output=True, check=False
    )
    assert done.returncode == 1, done.stdout
