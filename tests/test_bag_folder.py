"""Folders of `ros2 bag record`, written by rosbags, which shares no code with our reader."""

import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zwidth
from zwidth import cli
from zwidth.errors import Status
from zwidth.fleet.listing import is_fleet
from zwidth.logs.bag_folder import is_bag, read_bag
from zwidth.logs.open_source import own_log
from zwidth.logs.source import RecordingError, Source

pytest.importorskip("rosbags", reason="rosbags is not installed; pip install zwidth[ros]")
STORAGES = ["SQLITE3", "MCAP"]
JOINTS = ("shoulder", "elbow", "wrist")
TICKS, PERIOD_NS = 3000, 2_000_000
EPOCH_NS = 1_700_000_000_000_000_000


def arm() -> dict[str, np.ndarray[Any, np.dtype[np.float64]]]:
    """Position, velocity and effort (ticks, joints); the wrist stands still, the elbow rubs."""
    random = np.random.default_rng(3)
    found = {name: np.zeros((TICKS, len(JOINTS))) for name in ("position", "velocity", "effort")}
    t = 1e-9 * PERIOD_NS * np.arange(TICKS)
    for j, level in ((0, 0.0), (1, 0.03)):
        torque = sum(
            a * np.sin(2.0 * np.pi * f * t + random.uniform(0.0, 6.0))
            for a, f in ((0.11, 0.5), (0.07, 1.3), (0.05, 2.9), (0.03, 7.1))
        )
        device = zwidth.Device("joint", "", True, zwidth.make_chain([1.2e-3], [3e-3]),
                               zwidth.Interface(period=1e-9 * PERIOD_NS))  # fmt: skip
        if level:
            device = device.with_physics(zwidth.make_physics("coulomb_friction", "m1", level=level))
        run = zwidth.simulate(device, zwidth.recorded(np.asarray(torque)))
        q = run.trace["position_m1"][:TICKS] + 1e-4 * random.standard_normal(TICKS)
        found["position"][:, j], found["effort"][:, j] = q, torque
        found["velocity"][:, j] = np.gradient(q, 1e-9 * PERIOD_NS)
    return found


def write_bag(
    folder: Path, storage: str, part: slice = slice(None), compression: str = "NONE"
) -> Path:
    """A robot's bag: its joints, an IMU, a camera and transforms."""
    from rosbags.rosbag2 import (  # pyright: ignore[reportMissingImports]
        CompressionFormat,
        CompressionMode,
        StoragePlugin,
        Writer,
    )
    from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports]

    types = get_typestore(Stores.ROS2_HUMBLE)
    kinds = {name: types.types[name] for name in types.types}
    motion = arm()

    def stamp(k: int) -> Any:
        ns = EPOCH_NS + k * PERIOD_NS
        time = kinds["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9)
        return kinds["std_msgs/msg/Header"](stamp=time, frame_id="")

    def vector(*values: float) -> Any:
        return kinds["geometry_msgs/msg/Vector3"](*values)

    to = Writer(folder, version=9, storage_plugin=StoragePlugin[storage])
    to.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
    with to as writer:
        joints, imu, camera, text = (
            writer.add_connection(topic, kind, typestore=types)
            for topic, kind in (
                ("/joint_states", "sensor_msgs/msg/JointState"),
                ("/imu", "sensor_msgs/msg/Imu"),
                ("/camera/image_raw", "sensor_msgs/msg/Image"),
                ("/robot_description", "std_msgs/msg/String"),
            )
        )
        said = kinds["std_msgs/msg/String"](data="<robot/>")
        writer.write(text, EPOCH_NS, types.serialize_cdr(said, "std_msgs/msg/String"))
        for k in range(*part.indices(TICKS)):
            ns = EPOCH_NS + k * PERIOD_NS + 40_000
            state = kinds["sensor_msgs/msg/JointState"](
                header=stamp(k), name=list(JOINTS),
                **{quantity: values[k].copy() for quantity, values in motion.items()},
            )  # fmt: skip
            writer.write(joints, ns, types.serialize_cdr(state, state.__msgtype__))
            if k % 50:
                continue
            still = np.zeros(9)
            turn = kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
            felt = kinds["sensor_msgs/msg/Imu"](
                header=stamp(k), orientation=turn, orientation_covariance=still,
                angular_velocity=vector(np.sin(k), 0.0, 0.0), angular_velocity_covariance=still,
                linear_acceleration=vector(0.0, 0.0, 9.8), linear_acceleration_covariance=still,
            )  # fmt: skip
            writer.write(imu, ns, types.serialize_cdr(felt, felt.__msgtype__))
            seen = kinds["sensor_msgs/msg/Image"](
                header=stamp(k), height=4, width=4, encoding="mono8", is_bigendian=0, step=4,
                data=np.zeros(16, dtype=np.uint8),
            )  # fmt: skip
            writer.write(camera, ns, types.serialize_cdr(seen, seen.__msgtype__))
    return folder


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("bags")
    return {storage: write_bag(folder / storage.lower(), storage) for storage in STORAGES}


@pytest.mark.parametrize("storage", STORAGES)
def test_a_bag_has_the_joints_that_were_written_and_puts_the_rest_aside(
    storage: str, made: dict[str, Path]
):
    """Mutations: the IMU among the signals; an image decoded."""
    assert is_bag(made[storage])
    assert not is_fleet(made[storage])
    found = own_log(made[storage])
    assert isinstance(found, Source)
    motion = arm()
    for j, joint in enumerate(JOINTS):
        for quantity, values in motion.items():
            signal = found[f"/joint_states.{joint}.{quantity}"]
            assert np.array_equal(signal.values, values[:, j])
            stamps = EPOCH_NS + PERIOD_NS * np.arange(TICKS)
            assert np.array_equal(signal.stamps["header.stamp"], stamps)
            assert np.array_equal(signal.stamps["log_time"], stamps + 40_000)
    assert {name.split(".")[0] for name in found.signals} == {"/joint_states"}
    assert {name.split(".")[0] for name in found.aside} == {"/imu"}
    assert any("/camera/image_raw is of Image" in note for note in found.notes)


def test_a_bag_of_before_iron_takes_standard_types_from_rosbags(
    made: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Its file has no definitions. Without rosbags the sentence says what to install."""
    folder = Path(shutil.copytree(made["SQLITE3"], tmp_path / "humble"))
    (file,) = folder.glob("*.db3")
    with closing(sqlite3.connect(file)) as base, base:
        base.execute("DROP TABLE message_definitions")
    elbow = "/joint_states.elbow.position"
    assert np.array_equal(read_bag(folder)[elbow].values, arm()["position"][:, 1])
    monkeypatch.setattr("zwidth.logs.bag_folder._standard", lambda _: None)
    assert any("pip install zwidth[ros]" in note for note in read_bag(folder).notes)


def test_files_of_a_bag_follow_each_other_as_its_metadata_says(tmp_path: Path):
    """Mutation: the files in the order of their names."""
    first = write_bag(tmp_path / "b", "MCAP", slice(0, 100))
    second = write_bag(tmp_path / "a", "SQLITE3", slice(100, 250))
    shutil.move(second / "a.db3", first / "a.db3")
    text = (first / "metadata.yaml").read_text()
    assert "- b.mcap" in text
    (first / "metadata.yaml").write_text(text.replace("- b.mcap", "- b.mcap\n  - a.db3", 1))
    found = read_bag(first)
    values = found["/joint_states.elbow.position"].values
    assert np.array_equal(values, arm()["position"][:250, 1])
    (first / "a.db3").unlink()
    with pytest.raises(RecordingError, match=r"lacks 'a\.db3'"):
        read_bag(first)


@pytest.mark.parametrize("name", ["../other.db3", "/etc/passwd", ".."])
def test_a_bag_that_names_files_elsewhere_is_refused(
    name: str, made: dict[str, Path], tmp_path: Path
):
    folder = Path(shutil.copytree(made["MCAP"], tmp_path / "bag"))
    text = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").write_text(text.replace("- mcap.mcap", f"- {name}"))
    with pytest.raises(RecordingError, match="which is not a file in that folder"):
        read_bag(folder)


@pytest.mark.parametrize("content", [b"", b"SQLite format 3\x00" + bytes(99), b"junk" * 99])
def test_a_damaged_database_is_a_sentence(content: bytes, made: dict[str, Path], tmp_path: Path):
    folder = Path(shutil.copytree(made["SQLITE3"], tmp_path / "bag"))
    (folder / "sqlite3.db3").write_bytes(content)
    with pytest.raises(ValueError, match=r"sqlite3\.db3"):
        read_bag(folder)


@pytest.mark.parametrize(("storage", "mode"), [
    ("SQLITE3", "FILE"), ("SQLITE3", "MESSAGE"), ("MCAP", "FILE"), ("MCAP", "MESSAGE"),
    ("MCAP", "STORAGE"),
])  # fmt: skip
def test_a_compressed_bag_is_read(storage: str, mode: str, tmp_path: Path):
    """Files, messages, and MCAP's own chunks. Mutation: messages decoded as they lie there."""
    part = slice(0, 300)
    folder = write_bag(tmp_path / "bag", storage, part, mode)
    found = own_log(folder)
    assert isinstance(found, Source)
    position = found["/joint_states.elbow.position"].values
    assert np.array_equal(position, arm()["position"][part, 1])
    assert [file.name for file in tmp_path.iterdir()] == ["bag"]  # nothing is left there


def test_what_cannot_be_unpacked_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Mutation: any of the limits."""
    folder = write_bag(tmp_path / "bag", "SQLITE3", slice(0, 300), "FILE")
    (file,) = folder.glob("*.zstd")
    with monkeypatch.context() as patch:
        patch.setattr("zwidth.logs.bag_folder.MOST_BYTES", 1000)
        with pytest.raises(RecordingError, match="unpacks to more than 0 MiB"):
            read_bag(folder)
    file.write_bytes(file.read_bytes()[:5000] + b"x" * 100)
    with pytest.raises(RecordingError, match=r"db3\.zstd cannot be unpacked"):
        read_bag(folder)
    metadata = folder / "metadata.yaml"
    text = metadata.read_text().replace("compression_format: zstd", "compression_format: lz4")
    metadata.write_text(text)
    with pytest.raises(RecordingError, match="compressed by lz4, which is not read"):
        read_bag(folder)
    small = write_bag(tmp_path / "messages", "SQLITE3", slice(0, 300), "MESSAGE")
    monkeypatch.setattr("zwidth.logs.bag_folder.MOST_OF_MESSAGE", 10)
    with pytest.raises(RecordingError, match="a message unpacks to more than 0 MiB"):
        read_bag(small)


def test_the_joint_that_is_asked_for_is_diagnosed(
    made: dict[str, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """From the folder to what is missing: friction in the elbow, nothing in the shoulder."""
    shutil.copytree(made["MCAP"], tmp_path / "bag")
    monkeypatch.chdir(tmp_path)
    line = "diagnose bag/ --joint elbow --effort quick --json x.json"
    assert cli.run(line.split()) == Status.DONE
    found = json.loads((tmp_path / "x.json").read_text())
    assert [f["effect"] for f in found["findings"]] == ["coulomb_friction"]
    level = found["findings"][0]["parameters"]["level"]["value"]
    assert level == pytest.approx(0.03, rel=0.02)
    assert "/joint_states.elbow" in (tmp_path / "runs" / "bag.recording.toml").read_text()
