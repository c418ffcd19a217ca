"""Binary files of other tools: every array of numbers under a name its owner knows."""

import io
import json
import warnings
import zipfile
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pytest
import recording_examples as examples
import scipy.io
from google.protobuf.wrappers_pb2 import DoubleValue
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as nps
from mcap.writer import Writer as JsonWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as Ros2Writer
from numpy.typing import NDArray
from pyarrow import parquet

from zwidth.logs.mat_file import read_hdf5, read_mat
from zwidth.logs.npz_file import read_npy, read_npz
from zwidth.logs.open_source import open_source
from zwidth.logs.parquet_file import read_parquet
from zwidth.logs.source import RecordingError, Source

T, U, X = examples.wave(20)
HERE = Path("a.bin")


def opened(folder: Path, data: bytes, name: str = "recording.bin") -> Source:
    (folder / name).write_bytes(data)
    return open_source(folder / name)


@pytest.mark.parametrize(
    ("data", "name", "kind", "signals"),
    [
        (examples.npz_bytes(), "a", "NPZ", {"t": T, "u": U, "both[1]": X}),
        (examples.npy_bytes(), "a", "NPY", {"values[0]": T, "values[2]": X}),
        (examples.mat_bytes(), "a", "MAT v7 or older", {"x": X, "X(:,1)": U, "s.axis.q": X}),
        (examples.mat_bytes(version="7"), "a", "MAT v7 or older", {"t": T, "s.c{2}": X}),
        (examples.mat_bytes(version="4"), "a.mat", "MAT v7 or older", {"t": T, "X(:,2)": X}),
        (examples.mat73_bytes(), "a", "MAT v7.3", {"t": T, "X(:,1)": U, "s.q": X, "c{2}": X}),
        (examples.hdf5_bytes(), "a", "HDF5", {"time": T, "run.torque": U}),
        (examples.parquet_bytes(), "a", "Parquet", {"u": U, "axis.angle": X}),
        (examples.joint_lists_bytes(), "a", "Parquet", {"action[1]": X, "observation.state[0]": X}),
        (examples.excel_bytes(), "a", "Excel workbook, sheet 'run'", {"t": T, "angle": X}),
        (examples.json_bytes(), "a", "JSON", {"run.t": T, "run.q[0]": X}),
        (examples.json_lines_bytes(), "a", "JSON lines", {"stamp.sec": T, "position[0]": X}),
        (examples.lvm_bytes(), "a", "LabVIEW measurement", {"X_Value": T, "Angle": X}),
        (examples.codesys_bytes(), "a", "CODESYS trace", {"GVL.fTorque": U, "GVL.fActPos": X}),
        (examples.wpilog_bytes(), "a", "WPILOG", {"/motor/volts": U, "/arm/position[0]": X}),
        (examples.tdms_bytes(), "a", "TDMS", {"torque": U, "angle": X}),
        (examples.ulog_bytes(), "a", "ULog", {"servo.torque": U, "servo.position": X}),
        (
            examples.ros2_bytes(),
            "a",
            "MCAP",
            {"/joint_states.shoulder.effort": U, "/wrench.force.x": U},
        ),
        (
            examples.ros2_bytes(checked=False),
            "a",
            "MCAP",
            {"/joint_states.shoulder.position": X},
        ),
        (examples.json_mcap_bytes(), "a", "MCAP", {"/command.u": U}),
        (examples.protobuf_bytes(), "a", "MCAP", {"/axis.torque": U, "/axis.angle": X}),
        (examples.csv_bytes(), "a", "text table (commas)", {"t": T, "torque": U, "angle": X}),
    ],
    # Some of the bytes hold the time of day, so they are in no name.
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_every_format_is_known_by_its_content(
    tmp_path: Path, data: bytes, name: str, kind: str, signals: dict[str, NDArray[np.float64]]
) -> None:
    source = opened(tmp_path, data, name)
    assert source.kind == kind
    for signal, values in signals.items():
        np.testing.assert_array_equal(source[signal].values, values)


def test_text_and_constants_are_told_from_signals(tmp_path: Path) -> None:
    source = opened(tmp_path, examples.mat_bytes())
    assert source["s.axis.gain"].values.tolist() == [2.0]
    with pytest.raises(RecordingError, match=r"'s.note' is text; a signal is numbers"):
        source["s.note"]


def test_dates_are_nanoseconds(tmp_path: Path) -> None:
    stamps = opened(tmp_path, examples.parquet_bytes())["stamp"]
    assert stamps.unit == "ns"
    np.testing.assert_array_equal(stamps.values, examples.EPOCH + np.arange(20) * 1_000_000)
    source = opened(
        tmp_path, npz(t=np.arange(3).astype("datetime64[us]"), o=np.array([{}], object))
    )
    np.testing.assert_array_equal(source["t"].values, [0, 1000, 2000])
    with pytest.raises(RecordingError, match="never loaded"):
        source["o"]


def npz(**arrays: NDArray[np.generic]) -> bytes:
    out = io.BytesIO()
    np.savez(out, **arrays)  # pyright: ignore[reportArgumentType]
    return out.getvalue()


REAL = nps.integer_dtypes(endianness="=") | nps.floating_dtypes(sizes=(32, 64), endianness="=")
VECTORS = REAL.flatmap(lambda kind: nps.arrays(kind, st.integers(1, 8)))


@given(VECTORS)
def test_vectors_keep_every_bit(values: NDArray[np.generic]) -> None:
    """Of a NaN MATLAB keeps that it is one."""
    assert read_npz(HERE, npz(v=values))["v"].values.tobytes() == values.tobytes()
    out = io.BytesIO()
    parquet.write_table(pa.table({"v": values}), out)
    assert read_parquet(HERE, out.getvalue())["v"].values.tobytes() == values.tobytes()
    out = io.BytesIO()
    scipy.io.savemat(out, {"v": values})  # pyright: ignore[reportArgumentType]
    np.testing.assert_array_equal(read_mat(HERE, out.getvalue())["v"].values, values)


@given(VECTORS)
def test_vectors_keep_every_bit_in_npy_and_hdf5(values: NDArray[np.generic]) -> None:
    out = io.BytesIO()
    np.save(out, values)
    assert read_npy(HERE, out.getvalue())["values"].values.tobytes() == values.tobytes()
    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        file["v"] = values
    assert read_hdf5(HERE, out.getvalue())["v"].values.tobytes() == values.tobytes()


@given(
    st.lists(st.floats(allow_nan=False) | st.sampled_from([-0.0, 5e-324]), min_size=1, max_size=9)
)
def test_messages_keep_every_double(
    tmp_path_factory: pytest.TempPathFactory, values: list[float]
) -> None:
    """In JSON too: Python writes the digits that read back to the same double."""
    path = tmp_path_factory.mktemp("messages") / "a.mcap"
    expected = np.array(values).tobytes()
    for data in (ros2(values), json_messages(values), protobuf(values)):
        path.write_bytes(data)
        source = open_source(path)
        assert source.notes == ()
        assert source["/v.value"].floats().tobytes() == expected
        assert source["/v.value"].stamps["log_time"].tolist() == list(range(len(values)))


def ros2(values: list[float]) -> bytes:
    out = io.BytesIO()
    writer = Ros2Writer(out)
    schema = writer.register_msgdef("rig_msgs/msg/Value", "float64 value")
    for k, value in enumerate(values):
        writer.write_message("/v", schema, {"value": value}, k, k, k)
    writer.finish()
    return out.getvalue()


def json_messages(values: list[float]) -> bytes:
    out = io.BytesIO()
    writer = JsonWriter(out)
    writer.start()
    channel = writer.register_channel(
        "/v", "json", writer.register_schema("V", "jsonschema", b"{}")
    )
    for k, value in enumerate(values):
        writer.add_message(channel, k, json.dumps({"value": value}).encode(), k, k)
    writer.finish()
    return out.getvalue()


def protobuf(values: list[float]) -> bytes:
    out = io.BytesIO()
    writer = ProtobufWriter(out)
    for k, value in enumerate(values):
        writer.write_message("/v", DoubleValue(value=value), k, k, k)
    writer.finish()
    return out.getvalue()


def test_nulls_of_whole_numbers_are_nan() -> None:
    out = io.BytesIO()
    parquet.write_table(
        pa.table({"n": pa.array([1, None, 3]), "b": pa.array([True, None, False])}), out
    )
    source = read_parquet(HERE, out.getvalue())
    np.testing.assert_array_equal(source["n"].values, [1, np.nan, 3])
    np.testing.assert_array_equal(source["b"].values, [1, np.nan, 0])


def test_cycles_and_links_of_hdf5_are_not_followed(tmp_path: Path) -> None:
    secret = tmp_path / "secret.h5"
    with h5py.File(secret, "w") as file:
        file["key"] = np.arange(3.0)
    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        group = file.create_group("g")
        group["self"] = group
        group["v"] = np.arange(4.0)
        file["out"] = h5py.ExternalLink(str(secret), "key")
        file.create_dataset("raw", (3,), "f8", external=[(str(secret), 0, 24)])
        cells = file.create_dataset("c", (1,), h5py.ref_dtype)
        cells[0] = cells.ref
    source = read_hdf5(HERE, out.getvalue())
    assert list(source.signals) == ["g.v"]
    assert set(source.unreadable) == {"g.self", "raw", "c(1)"}


def test_a_damaged_chunk_of_messages_is_left_out_and_named(tmp_path: Path) -> None:
    data = bytearray(examples.ros2_bytes(200))
    whole = opened(tmp_path, bytes(data))
    data[len(data) // 2] ^= 0xFF
    source = opened(tmp_path, bytes(data))
    assert len(source.notes) == 1
    for name in whole.signals:
        assert 0 < source[name].values.size <= whole[name].values.size
        assert np.isin(source[name].values, whole[name].values).all()


def test_a_message_definition_that_is_none_is_named_and_nothing_is_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Mutation that breaks it: no redirect_stderr around the parser of definitions."""
    data = examples.ros2_bytes(checked=False).replace(b"uint32 nanosec", b"uint32 nanose@")
    source = opened(tmp_path, data)
    assert next(iter(source.signals)) == "/wrench.force.x"
    assert source.notes[0].startswith("/joint_states has a schema that cannot be read")
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("share", [0.2, 0.5, 0.9])
def test_a_cut_mcap_gives_what_is_before_the_cut(tmp_path: Path, share: float) -> None:
    data = examples.json_mcap_bytes(400)
    source = opened(tmp_path, data[: int(share * len(data))])
    values = source["/command.u"].values
    np.testing.assert_array_equal(values, examples.wave(400)[1][: values.size])
    assert "cut short" in source.notes[-1] or "no message is lost" in source.notes[-1]
    assert values.size > 0


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "is empty"),
        (b"PK\x03\x04rest", "damaged archive, of NPZ or Excel"),
        (b"PAR1rest", "damaged Parquet"),
        (b"\x89HDF\r\n\x1a\nrest", "cannot be read as HDF5"),
        (b"MATLAB 5.0 MAT-file", "cannot be read as MAT"),
        (b"\x93NUMPY\x01\x00", "damaged"),
        (b'{"t": [0.0, 0.001', "cannot be read as JSON"),
        (b"[" * 100_000 + b"{", "cannot be read as JSON"),
        (b"LabVIEW Measurement\t\nSeparator\tTab\n", "cut short"),
        (b"[key]; [value]\n0.Variable; a\n", "without a sample"),
        (b"WPILOG\x00", "ends within its header"),
        (b"TDSmrest", "cannot be read as TDMS"),
        (b"ULog\x01\x12\x35\x01rest", "cannot be read as ULog"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1rest", "cannot be read as an Excel workbook"),
        (b"\x89MCAP0\r\n", "no topic of"),
    ],
)
def test_damage_is_one_sentence(tmp_path: Path, data: bytes, words: str) -> None:
    with pytest.raises(ValueError, match=r"\A[^\n]*\Z") as caught:
        opened(tmp_path, data)
    assert words in str(caught.value)


def test_a_wrong_type_in_a_mat_file_is_an_error_and_not_the_end_of_the_interpreter() -> None:
    """Mutation that breaks it: no check_elements before scipy.io.loadmat, which then crashes."""
    data = examples.mat_bytes()
    at = data.index(U.tobytes()[:16]) - 8
    assert data[at] == 9
    for kind in (0, 8, 14, 19, 20, 200):
        with pytest.raises(RecordingError, match=f"data of type {kind}"):
            read_mat(HERE, data[:at] + bytes([kind]) + data[at + 1 :])
    at = data.index(b"text") - 4 - 24  # the tag of the dimensions of s.note
    assert data[at : at + 8] == b"\x05\0\0\0\x08\0\0\0"
    with pytest.raises(RecordingError, match="dimensions"):
        read_mat(HERE, data[:at] + b"\x05\0\x02\0" + data[at + 4 : at + 8] + data[at + 16 :])


def test_every_mat_file_that_scipy_reads_is_read() -> None:
    folder = Path(scipy.io.__file__).parent / "matlab" / "tests" / "data"
    files = sorted(folder.glob("*.mat"))
    if not files:
        pytest.skip("this scipy was installed without its own test data")
    for file in files:
        try:
            with warnings.catch_warnings(action="ignore"):
                scipy.io.loadmat(file)
        except Exception:  # scipy raises what it meets
            continue
        with warnings.catch_warnings(action="ignore"):
            assert open_source(file).kind == "MAT v7 or older"


def test_a_folder_and_a_device_are_no_recordings(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="is a folder"):
        open_source(tmp_path)
    with pytest.raises(ValueError, match="not a regular file"):
        open_source(Path("/dev/null"))


def test_an_archive_that_unpacks_without_end_is_refused(tmp_path: Path) -> None:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for k in range(3):
            archive.writestr(f"v{k}.npy", b"")
            archive.infolist()[k].file_size = 1 << 32  # as the directory of the archive will claim
    with pytest.raises(RecordingError, match="unpacks to more than 256 MiB"):
        opened(tmp_path, out.getvalue())


def test_an_archive_may_claim_what_it_likes(tmp_path: Path) -> None:
    """An array of 2^50 numbers in a header of 128 bytes is refused, not allocated."""
    entry = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        entry, {"descr": "<f8", "fortran_order": False, "shape": (2**50,)}
    )
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("v.npy", entry.getvalue())
    with pytest.raises(RecordingError):
        opened(tmp_path, out.getvalue())["v"]


@pytest.mark.parametrize("rest", [b"", b"abc"])
def test_a_ulog_that_leads_back_to_itself_is_refused(tmp_path: Path, rest: bytes) -> None:
    """A message of no known kind claims more than there is, at which pyulog reads for ever.

    Mutation: bytes that can be read without end.
    """
    damaged = examples.ulog_bytes(0)[:16] + b"\xff\xffX" + rest
    with pytest.raises(RecordingError, match="ULog"):
        opened(tmp_path, damaged, "a.ulg")
