"""What SECURITY.md promises: nothing in a file is executed, and none unpacks for ever."""

import io
import os
import pickle
import struct
import sys
import zipfile
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
import scipy.io
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from pyarrow import parquet

import zwidth
from zwidth.export.read_joint import device_of_joint
from zwidth.joint_door import plain
from zwidth.logs import framing, unpacked
from zwidth.logs.open_source import own_log
from zwidth.logs.source import RecordingError, Source
from zwidth.scenarios.scenario_file import load_scenario
from zwidth.sim.device_file import device_to_text, load_device
from zwidth.sim.physics.own import translated
from zwidth.sim.table import TableError


def set_limit(monkeypatch: pytest.MonkeyPatch, size: int) -> None:
    """Lower the number of bytes to which any file may unpack, however small it is."""
    monkeypatch.setattr(unpacked, "ALWAYS_BYTES", size)


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
    """A hundredth of the limit, at a hundredth of the size. Mutation: no look at the sizes."""
    set_limit(monkeypatch, 1 << 20)
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
    """Mutations: `decompress` without a limit; a limit for each variable alone."""
    set_limit(monkeypatch, 1 << 20)
    for variables in (1, 9):
        values = {f"v{k}": np.zeros((1 << 19) // 9 * 3 // variables) for k in range(variables)}
        scipy.io.savemat(tmp_path / "bomb.mat", values, do_compression=True)
        with pytest.raises(RecordingError, match="unpacks to more than"):
            own_log(tmp_path / "bomb.mat")


@pytest.mark.parametrize("shape", ["one", "many", "referred to"])
def test_hdf5_is_limited_over_all_its_data_sets(
    shape: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Mutations: a limit for each data set alone; references to one data set not counted again."""
    h5py = pytest.importorskip("h5py")
    set_limit(monkeypatch, 1 << 20)
    with h5py.File(tmp_path / "bomb.mat", "w") as file:
        for k in range(1 if shape == "one" else 9 if shape == "many" else 0):
            length = 1 << 18 if shape == "one" else 1 << 15
            file.create_dataset(f"v{k}", (length,), "f8", chunks=(length,), compression="gzip")
        if shape == "referred to":
            group = file.create_group("#refs#")
            part = group.create_dataset("a", (1 << 15,), "f8", data=np.zeros(1 << 15),
                                        compression="gzip")  # fmt: skip
            cells = file.create_dataset("c", (9,), dtype=h5py.ref_dtype)
            for k in range(9):
                cells[k] = part.ref
    with pytest.raises(RecordingError, match="unpacks to more than"):
        own_log(tmp_path / "bomb.mat")


@pytest.mark.parametrize("rows", [1 << 16, 1 << 17])
def test_parquet_is_limited_by_its_metadata(
    rows: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Zeros are stored once, however many. Mutation: the sizes of the pages taken alone."""
    set_limit(monkeypatch, 1 << 20)
    path = tmp_path / "bomb.parquet"
    parquet.write_table(pa.table({"u": np.zeros(rows), "b": np.zeros(rows, dtype=bool)}), path)
    pages = parquet.ParquetFile(path).metadata.row_group(0).column(0).total_uncompressed_size
    assert pages < 1 << 12
    if rows == 1 << 16:  # 1 MiB in all, which is the limit
        assert isinstance(own_log(path), Source)
        return
    with pytest.raises(RecordingError, match="unpacks to more than"):
        own_log(path)


def test_a_text_of_parquet_that_repeats_is_stored_once(tmp_path: Path):
    """A megabyte, two thousand times. Mutation: read without its dictionary, 2 GB."""
    resource = pytest.importorskip("resource", reason="memory is not measured on Windows")
    words = pa.DictionaryArray.from_arrays(pa.array(np.zeros(2000, np.int32)), ["x" * (1 << 20)])
    path = tmp_path / "bomb.parquet"
    parquet.write_table(pa.table({"s": words, "t": np.arange(2e3)}), path, store_schema=False)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found = own_log(path)
    assert isinstance(found, Source)
    assert list(found.signals) == ["t"]
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < 500_000 * (1024 if sys.platform == "darwin" else 1)


@pytest.mark.parametrize("compression", list(CompressionType))
def test_an_mcap_file_is_limited_over_all_its_chunks(
    compression: CompressionType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Mutations: a limit for each chunk alone; messages decoded before."""
    path = tmp_path / "bomb.mcap"
    with path.open("wb") as stream:
        writer = McapWriter(stream, chunk_size=1 << 18, compression=compression)
        writer.start()
        channel = writer.register_channel("u", "json", 0)
        body = b'{"u":' + b" " * (1 << 14) + b"1}"
        for k in range(128):
            writer.add_message(channel, k, body, k)
        writer.finish()
    found = own_log(path)
    assert isinstance(found, Source)
    assert len(found.signals["u.u"].values) == 128
    monkeypatch.setattr(framing, "ALWAYS_UNPACKED", 1 << 20)
    if compression is CompressionType.NONE:  # as large as it is
        assert isinstance(own_log(path), Source)
        return
    assert path.stat().st_size < 1 << 15
    monkeypatch.setattr(unpacked, "MOST_TIMES", 10)
    with pytest.raises(RecordingError, match=r"bomb.mcap has .* unpacks to more than 1 MiB"):
        own_log(path)


def element(kind: int, data: bytes) -> bytes:
    """A data element of a MAT file of v5."""
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def matrix(kind: int, columns: int, name: bytes, content: bytes) -> bytes:
    shape = element(5, struct.pack("<ii", 1, columns))
    return element(14, element(6, struct.pack("<II", kind, 0)) + shape + element(1, name) + content)


def test_objects_and_functions_in_a_mat_file_are_not_executed(tmp_path: Path):
    """MAT has no pickles: bytes of one stay numbers, and a function handle (class 16) is a text.

    Mutation: a reader that makes a function of a handle, or objects of bytes.
    """
    stolen = tmp_path / "stolen"
    command = f"system('mkdir {stolen}')"
    cells = np.empty(2, dtype=object)
    cells[:] = [np.frombuffer(pickle.dumps(Bomb(stolen)), np.uint8), command]
    content = io.BytesIO()
    scipy.io.savemat(content, {"c": cells, "s": {"g": command}, "q": np.arange(9.0)})  # pyright: ignore[reportArgumentType]
    called = matrix(4, len(command), b"", element(16, command.encode()))
    (tmp_path / "x.mat").write_bytes(content.getvalue() + matrix(16, 1, b"f", called))
    found = own_log(tmp_path / "x.mat")
    assert isinstance(found, Source)
    assert set(found.signals) == {"q", "c{1}"}
    assert set(found.unreadable) == {"c{2}", "s.g", "f"}
    assert not stolen.exists()


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


PART = '<worldbody><body><joint name="m1"/><geom size="0.1" mass="1"/></body></worldbody>'


def included(path: str, tmp_path: Path) -> Path:
    """Write a model two folders down that includes another file."""
    (tmp_path / "a" / "b").mkdir(parents=True, exist_ok=True)
    model = tmp_path / "a" / "b" / "robot.xml"
    model.write_text(f'<mujoco><include file="{path}"/></mujoco>')
    return model


@pytest.mark.parametrize("folder", ["../../", "{}/"])
def test_a_model_may_include_others_from_anywhere_but_only_models(folder: str, tmp_path: Path):
    """As robots share their parts. What is no XML is refused, and none of it is shown."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    folder = folder.format(tmp_path)
    (tmp_path / "part.xml").write_text(f"<mujoco>{PART}</mujoco>")
    (tmp_path / "passwd").write_text("root:secret\n")
    device, _ = device_of_joint(included(f"{folder}part.xml", tmp_path), "m1")
    assert device.chain.masses.size == 1
    with pytest.raises(ValueError, match="is not a model that MuJoCo can read") as refused:
        device_of_joint(included(f"{folder}passwd", tmp_path), "m1")
    assert "secret" not in str(refused.value)


@pytest.mark.parametrize("part", ["include", "model", "mesh", "texture", "hfield"])
def test_what_a_model_includes_must_be_ordinary_files(part: str, tmp_path: Path):
    """MuJoCo waits for ever at a pipe. Mutation: the file given to MuJoCo unseen."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    if not hasattr(os, "mkfifo"):
        pytest.skip("no pipes in folders here")
    (tmp_path / "parts").mkdir()
    os.mkfifo(tmp_path / "parts" / "pipe.xml")
    path = "pipe.xml" if part not in ("include", "model") else "parts/pipe.xml"
    line = f'<{part} name="n" file="{path}"/>' if part != "include" else f'<include file="{path}"/>'
    inner = line if part == "include" else f"<asset>{line}</asset>"
    (tmp_path / "inner.xml").write_text(f"<mujoco>{inner}</mujoco>")
    (tmp_path / "robot.xml").write_text(
        f'<mujoco><compiler assetdir="parts"/><include file="inner.xml"/>{PART}</mujoco>'
    )
    with pytest.raises(ValueError, match=r"pipe.xml' is not an ordinary file"):
        device_of_joint(tmp_path / "robot.xml", "m1")


def test_entities_in_an_included_model_are_refused_too(tmp_path: Path):
    """Mutation: only the first file looked at."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    (tmp_path / "part.xml").write_text(f"<!DOCTYPE mujoco []><mujoco>{PART}</mujoco>")
    with pytest.raises(ValueError, match="declares a DOCTYPE or entities"):
        device_of_joint(included("../../part.xml", tmp_path), "m1")


def test_a_model_cannot_name_a_library_to_load(tmp_path: Path):
    """MuJoCo knows the plugins that it is installed with, and loads no other."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    for name in ("evil", "./evil.so", str(tmp_path / "evil.so")):
        (tmp_path / "robot.xml").write_text(
            f'<mujoco><extension><plugin plugin="{name}"/></extension>{PART}</mujoco>'
        )
        with pytest.raises(ValueError, match=r"plugin .* not found"):
            device_of_joint(tmp_path / "robot.xml", "m1")


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
