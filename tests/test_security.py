"""What SECURITY.md promises: nothing in a file is executed, and none unpacks for ever."""

import io
import os
import pickle
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest

import zwidth
from zwidth.export.read_joint import device_of_joint
from zwidth.joint_door import plain
from zwidth.logs import excel_file, mat_elements, npz_file
from zwidth.logs.open_source import own_log
from zwidth.logs.source import RecordingError
from zwidth.scenarios.scenario_file import load_scenario
from zwidth.sim.device_file import device_to_text, load_device
from zwidth.sim.physics.own import translated
from zwidth.sim.table import TableError


class Bomb:
    """Creates a file where it is loaded from a pickle."""

    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.target),)


def test_the_bomb_of_these_tests_explodes(tmp_path: Path):
    """Or they would show nothing."""
    pickle.loads(pickle.dumps(Bomb(tmp_path / "stolen")))
    assert (tmp_path / "stolen").exists()


@pytest.mark.parametrize("name", ["x.pkl", "x.npy", "x.npz"])
def test_a_pickle_is_never_loaded(name: str, tmp_path: Path):
    """Mutation: `allow_pickle=True`."""
    path = tmp_path / name
    objects = np.array([Bomb(tmp_path / "stolen")], dtype=object)
    if name.endswith("pkl"):
        path.write_bytes(pickle.dumps(Bomb(tmp_path / "stolen")))
    elif name.endswith("npy"):
        np.save(path, objects, allow_pickle=True)
    else:
        np.savez(path, u=objects, q=np.zeros(9))
    with pytest.raises(ValueError, match=r"pickle|objects"):
        own_log(path)["u"]  # pyright: ignore[reportIndexIssue, reportUnusedExpression]
    assert not (tmp_path / "stolen").exists()


@pytest.mark.parametrize("kind", ["npz", "xlsx"])
def test_an_archive_that_unpacks_to_too_much_is_refused_unread(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """A thousandth of the limit, at a thousandth of the size. Mutation: no look at the sizes."""
    for module in (npz_file, excel_file):
        monkeypatch.setattr(module, "MOST_BYTES", 1 << 20)
    path = tmp_path / f"bomb.{kind}"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        content = io.BytesIO()
        np.save(content, np.zeros(1 << 18))
        archive.writestr("xl/workbook.xml" if kind == "xlsx" else "u.npy", content.getvalue())
    assert path.stat().st_size < 1 << 14
    with pytest.raises(RecordingError, match="unpacks to more than"):
        own_log(path)


def test_a_matlab_variable_that_unpacks_to_too_much_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Mutation: `decompress` without a limit."""
    monkeypatch.setattr(mat_elements, "MOST_BYTES", 1 << 16)
    packed = zlib.compress(bytes(1 << 20))
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H2s", 0x0100, b"IM")
    (tmp_path / "bomb.mat").write_bytes(head + struct.pack("<II", 15, len(packed)) + packed)
    with pytest.raises(RecordingError, match="unpacks to more than"):
        own_log(tmp_path / "bomb.mat")


LAUGHS = "".join(f'<!ENTITY l{k + 1} "{f"&l{k};" * 10}">' for k in range(9))


@pytest.mark.parametrize("root", ["robot", "mujoco"])
@pytest.mark.parametrize(
    "entities", [f'<!ENTITY l0 "ha">{LAUGHS}', '<!ENTITY l9 SYSTEM "file:///etc/passwd">']
)
def test_a_model_with_entities_is_refused(root: str, entities: str, tmp_path: Path):
    """Mutation: the DOCTYPE let through."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    text = f'<!DOCTYPE {root} [{entities}]><{root} name="&l9;"></{root}>'
    (tmp_path / "bomb.xml").write_text(text)
    with pytest.raises(ValueError, match="declares a DOCTYPE or entities"):
        device_of_joint(tmp_path / "bomb.xml", "m1")


@pytest.mark.parametrize(
    "formula",
    [
        "__import__('os').system('id')", "q.__class__", "(lambda: q)()", "[q for q in (1,)][0]",
        "open('/etc/passwd')", "exec('1')", "q if q else v", "f'{q}'", "q[0]", "(q := 1)",
    ],
)  # fmt: skip
def test_a_formula_is_arithmetic_and_nothing_else(formula: str):
    """Mutation: a case of the syntax let through as it is written."""
    with pytest.raises(TableError):
        translated(formula, ["q", "v"], ["level"])


@pytest.mark.parametrize(
    "line", ['law = "os:system"', 'import = "os"', "run = 1", '[hook]\npath = "x.py"']
)
def test_a_device_file_and_a_scenario_have_no_key_that_names_code(line: str, tmp_path: Path):
    text = device_to_text(zwidth.load_device("phantom_1_0"))
    (tmp_path / "dev.toml").write_text(f"{line}\n{text}" if "[" not in line else f"{text}\n{line}")
    with pytest.raises(ValueError, match="unknown key"):
        load_device(tmp_path / "dev.toml")
    scenario = 'duration_s = 1.0\n[device]\nshipped = "phantom_1_0"\n[controller]\n'
    (tmp_path / "s.toml").write_text(f'{scenario}kind = "user"\nfunction = "os:system"\n')
    with pytest.raises(ValueError, match="unknown key"):
        load_scenario(tmp_path / "s.toml")


@pytest.mark.parametrize("name", ["../../evil", "/etc/passwd", "..", ".", "a/b\\c", "\0"])
def test_a_joint_is_no_path(name: str):
    """Mutation: the name taken as it is."""
    assert Path(plain(name)).name == plain(name)
    assert plain(name) not in ("", ".", "..")
