"""Small recordings in every format that is read, made here so that none need be kept."""

import io
import json
import math
import struct
import textwrap
import zipfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import scipy.io
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import CompressionType
from mcap.writer import Writer as JsonWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as Ros2Writer
from pyarrow import parquet

from zwidth.logs.recording import read_recording
from zwidth.sim.trace import Trace

EPOCH = 1_700_000_000_000_000_000  # ns, a November
PERIOD = 0.001

JOINT_STATE = textwrap.dedent("""\
    std_msgs/Header header
    string[] name
    float64[] position
    float64[] velocity
    float64[] effort
    ================================================================================
    MSG: std_msgs/Header
    builtin_interfaces/Time stamp
    string frame_id
    ================================================================================
    MSG: builtin_interfaces/Time
    int32 sec
    uint32 nanosec
    """)
WRENCH = textwrap.dedent("""\
    geometry_msgs/Vector3 force
    float64[3] offsets
    ================================================================================
    MSG: geometry_msgs/Vector3
    float64 x
    float64 y
    float64 z
    """)


def wave(samples: int, period: float = PERIOD) -> tuple[Any, Any, Any]:
    """Return (t, command, position) of a small motion, each of shape (samples,)."""
    t = period * np.arange(samples)
    return t, 0.2 * np.sin(40.0 * t), 0.01 * np.cos(40.0 * t)


def recorded(folder: Path, toml: str, **files: bytes) -> Trace:
    """Write files (with _ for .) and a recording TOML beside them, and read it."""
    for name, data in files.items():
        (folder / name.replace("_", ".")).write_bytes(data)
    (folder / "recording.toml").write_text(textwrap.dedent(toml), encoding="utf-8")
    return read_recording(folder / "recording.toml")


def csv_bytes(samples: int = 20) -> bytes:
    t, u, x = wave(samples)
    rows = [
        f"{a!r},{b!r},{c!r}" for a, b, c in zip(t.tolist(), u.tolist(), x.tolist(), strict=True)
    ]
    return "\n".join(["# a small motion", "t [s],torque [N m],angle [rad]", *rows, ""]).encode()


def iso_csv_bytes(samples: int = 20) -> bytes:
    t, u, x = wave(samples)
    rows = [
        f"2024-05-03T10:15:{a:09.6f}Z,{b!r},{c!r}"
        for a, b, c in zip(t.tolist(), u.tolist(), x.tolist(), strict=True)
    ]
    return "\n".join(["stamp,torque [N m],angle [rad]", *rows, ""]).encode()


def german_csv_bytes(samples: int = 20) -> bytes:
    t, u, x = wave(samples)
    rows = [
        f"{1e3 * a:.3f};{b:.6f};{math.degrees(c):.6f}".replace(".", ",")
        for a, b, c in zip(t.tolist(), u.tolist(), x.tolist(), strict=True)
    ]
    return "\r\n".join(["Zeit;Moment;Winkel", "[ms];[Nm];[°]", *rows, ""]).encode("cp1252")


def npz_bytes(samples: int = 20) -> bytes:
    t, u, x = wave(samples)
    out = io.BytesIO()
    np.savez_compressed(
        out, t=t, u=u, both=np.stack([u, x]), gain=np.float64(3.5), note=np.array("a")
    )
    return out.getvalue()


def npy_bytes(samples: int = 20) -> bytes:
    out = io.BytesIO()
    np.save(out, np.stack(wave(samples), axis=1))
    return out.getvalue()


def mat_bytes(samples: int = 20, version: str = "5") -> bytes:
    t, u, x = wave(samples)
    out = io.BytesIO()
    flat = {"t": t[:, None], "u": u[:, None], "x": x[None, :], "X": np.stack([u, x], axis=1)}
    if version == "4":
        scipy.io.savemat(out, flat, format="4")  # pyright: ignore[reportArgumentType]
        return out.getvalue()
    cells = np.empty(2, dtype=object)
    cells[:] = [u, x]
    nested = {"axis": {"q": x, "gain": 2.0, "name": "phi"}, "c": cells, "note": "text"}
    compressed = version == "7"
    scipy.io.savemat(out, flat | {"s": nested}, do_compression=compressed)  # pyright: ignore[reportArgumentType]
    return out.getvalue()


def mat73_bytes(samples: int = 20) -> bytes:
    """Return HDF5 as MATLAB lays it out: structures are groups, cells references, columns first."""
    t, u, x = wave(samples)
    out = io.BytesIO()
    with h5py.File(out, "w", libver="earliest") as file:
        for name, values in (("t", t[None, :]), ("X", np.stack([u, x]))):
            file[name] = values
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        structure = file.create_group("s")
        structure.attrs["MATLAB_class"] = np.bytes_("struct")
        structure["q"] = x[None, :]
        structure["name"] = np.frombuffer("phi".encode("utf-16-le"), dtype=np.uint16)[:, None]
        structure["name"].attrs["MATLAB_class"] = np.bytes_("char")
        store = file.create_group("#refs#")
        store["a"], store["b"] = u[None, :], x[None, :]
        cells = np.array([[store["a"].ref], [store["b"].ref]], dtype=h5py.ref_dtype)
        file.create_dataset("c", data=cells, dtype=h5py.ref_dtype)
        file["c"].attrs["MATLAB_class"] = np.bytes_("cell")
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    return head.ljust(512, b"\0") + out.getvalue()


def hdf5_bytes(samples: int = 20) -> bytes:
    t, u, x = wave(samples)
    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        file["time"] = t
        file.create_dataset("run/torque", data=u, compression="gzip", chunks=True)
        file["run/angle"] = x.astype(np.float32)
    return out.getvalue()


def parquet_bytes(samples: int = 20) -> bytes:
    t, u, x = wave(samples)
    stamps = pa.array(EPOCH + np.rint(t * 1e9).astype(np.int64), pa.timestamp("ns"))
    inner = pa.StructArray.from_arrays([pa.array(x)], ["angle"])
    label = pa.array(["a"] * samples)
    out = io.BytesIO()
    parquet.write_table(pa.table({"stamp": stamps, "u": u, "axis": inner, "label": label}), out)
    return out.getvalue()


def ros2_bytes(samples: int = 20, checked: bool = True) -> bytes:
    """Return joint states and wrenches, compressed and with checksums, or neither."""
    t, u, x = wave(samples)
    out = io.BytesIO()
    kind = CompressionType.ZSTD if checked else CompressionType.NONE
    writer = Ros2Writer(out, chunk_size=1024, compression=kind, enable_crcs=checked)
    joints = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
    wrench = writer.register_msgdef("custom_msgs/msg/Wrench", WRENCH)
    for k in range(samples):
        ns = EPOCH + round(t[k] * 1e9)
        sec, nanosec = divmod(ns, 1_000_000_000)
        message = {
            "header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": "base"},
            "name": ["shoulder", "elbow"],
            "position": [float(x[k]), 2.0 * float(x[k])],
            "velocity": [0.0, 1.0],
            "effort": [float(u[k]), -float(u[k])],
        }
        writer.write_message("/joint_states", joints, message, ns + 50_000, ns + 20_000, k)
        force = {"force": {"x": float(u[k]), "y": 0.0, "z": 0.0}, "offsets": [1.0, 2.0, 3.0]}
        writer.write_message("/wrench", wrench, force, ns + 60_000, ns + 60_000, k)
    writer.finish()
    return out.getvalue()


def json_mcap_bytes(samples: int = 20) -> bytes:
    """Return JSON messages: commands at 1 kHz, positions at 250 Hz from 2.5 ms on."""
    out = io.BytesIO()
    writer = JsonWriter(out, chunk_size=512)
    writer.start()
    schema = writer.register_schema("Sample", "jsonschema", json.dumps({"type": "object"}).encode())
    topics = [writer.register_channel(topic, "json", schema) for topic in ("/command", "/encoder")]
    t, u, _ = wave(samples)
    for k in range(samples):
        ns = EPOCH + round(t[k] * 1e9)
        writer.add_message(
            topics[0], ns, json.dumps({"u": float(u[k]), "on": True}).encode(), ns, k
        )
        if k % 4 == 0:
            late = ns + 2_500_000
            x = 0.01 * math.cos(40.0 * (t[k] + 0.0025))
            data = json.dumps({"pose": {"deg": math.degrees(x)}, "label": "a"}).encode()
            writer.add_message(topics[1], late, data, late, k)
    writer.finish()
    return out.getvalue()


def protobuf_bytes(samples: int = 20) -> bytes:
    file = FileDescriptorProto(name="axis.proto", package="rig", syntax="proto3")
    message = file.message_type.add(name="Axis")
    for number, name in enumerate(("torque", "angle", "count"), start=1):
        kind = (
            FieldDescriptorProto.TYPE_INT32 if name == "count" else FieldDescriptorProto.TYPE_DOUBLE
        )
        message.field.add(
            name=name, number=number, type=kind, label=FieldDescriptorProto.LABEL_OPTIONAL
        )
    pool = DescriptorPool()
    pool.Add(file)
    axis = GetMessageClass(pool.FindMessageTypeByName("rig.Axis"))
    out = io.BytesIO()
    writer = ProtobufWriter(out, chunk_size=512)
    t, u, x = wave(samples)
    for k in range(samples):
        ns = EPOCH + round(t[k] * 1e9)
        body = axis(torque=float(u[k]), angle=float(x[k]), count=k)
        writer.write_message("/axis", body, ns, ns, k)
    writer.finish()
    return out.getvalue()


def excel_bytes(samples: int = 20) -> bytes:
    """A workbook of two sheets, the second of them a table with dates in it."""
    t, u, x = wave(samples)
    rows = [
        f'<row r="1">{_texts("A1", "t [s]")}{_texts("B1", "torque")}{_texts("C1", "angle")}</row>'
    ]
    for k, (a, b, c) in enumerate(zip(t.tolist(), u.tolist(), x.tolist(), strict=True), start=2):
        cells = "".join(
            f'<c r="{col}{k}"><v>{v!r}</v></c>' for col, v in zip("ABC", (a, b, c), strict=True)
        )
        rows.append(f'<row r="{k}">{cells}</row>')
    main = "http://schemas.openxmlformats.org/spreadsheetml/2006/main"
    rel = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    package = "http://schemas.openxmlformats.org/package/2006"
    kind = "application/vnd.openxmlformats-officedocument.spreadsheetml"
    head = '<?xml version="1.0" encoding="UTF-8"?>'
    sheet = f'{head}<worksheet xmlns="{main}"><sheetData>%s</sheetData></worksheet>'
    parts = {
        "[Content_Types].xml": f'{head}<Types xmlns="{package}/content-types">'
        f'<Default Extension="xml" ContentType="application/xml"/><Default Extension="rels"'
        f' ContentType="application/vnd.openxmlformats-package.relationships+xml"/><Override'
        f' PartName="/xl/workbook.xml" ContentType="{kind}.sheet.main+xml"/></Types>',
        "_rels/.rels": f'{head}<Relationships xmlns="{package}/relationships"><Relationship Id="r"'
        f' Type="{rel}/officeDocument" Target="xl/workbook.xml"/></Relationships>',
        "xl/workbook.xml": f'{head}<workbook xmlns="{main}" xmlns:r="{rel}"><sheets><sheet'
        ' name="notes" sheetId="1" r:id="a"/><sheet name="run" sheetId="2" r:id="b"/></sheets>'
        "</workbook>",
        "xl/_rels/workbook.xml.rels": f'{head}<Relationships xmlns="{package}/relationships">'
        f'<Relationship Id="a" Type="{rel}/worksheet" Target="worksheets/sheet1.xml"/>'
        f'<Relationship Id="b" Type="{rel}/worksheet" Target="worksheets/sheet2.xml"/>'
        "</Relationships>",
        "xl/worksheets/sheet1.xml": sheet % f'<row r="1">{_texts("A1", "my rig")}</row>',
        "xl/worksheets/sheet2.xml": sheet % "".join(rows),
    }  # fmt: skip
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, text in parts.items():
            archive.writestr(name, text)
    return out.getvalue()


def _texts(cell: str, text: str) -> str:
    return f'<c r="{cell}" t="inlineStr"><is><t>{text}</t></is></c>'


def json_bytes(samples: int = 20) -> bytes:
    """Columns in an object, an array of joints and a setting beside."""
    t, u, x = (row.tolist() for row in wave(samples))
    joints = [[a, b] for a, b in zip(x, u, strict=True)]
    return json.dumps({"rate_hz": 1000, "run": {"t": t, "u": u, "x": x, "q": joints}}).encode()


def json_lines_bytes(samples: int = 20) -> bytes:
    t, u, x = (row.tolist() for row in wave(samples))
    lines = (
        json.dumps({"stamp": {"sec": a}, "effort": [b], "position": [c, None]})
        for a, b, c in zip(t, u, x, strict=True)
    )
    return "\n".join([*lines, ""]).encode()


def lvm_bytes(samples: int = 20) -> bytes:
    t, u, x = wave(samples)
    head = [
        "LabVIEW Measurement\t", "Separator\tTab", "Decimal_Separator\t,", "X_Columns\tOne",
        "***End_of_Header***\t", "\t", "Channels\t2", "Samples\t20\t20",
        "Y_Unit_Label\tNewton-Meter\tDegrees", "X_Dimension\tTime\tTime", "Delta_X\t0,001\t0,001",
        "***End_of_Header***\t\t\t", "X_Value\tTorque\tAngle\tComment",
    ]  # fmt: skip
    rows = [
        f"{a!r}\t{b!r}\t{c!r}\t".replace(".", ",")
        for a, b, c in zip(t.tolist(), u.tolist(), x.tolist(), strict=True)
    ]
    return "\r\n".join([*head, *rows, ""]).encode()


def codesys_bytes(samples: int = 20) -> bytes:
    t, u, x = wave(samples)
    lines = ["[key]; [value]", "Version; 0x03050000"]
    for k, (name, values) in enumerate((("GVL.fTorque", u), ("GVL.fActPos", x))):
        lines += [f"{k}.Variable; {name}", f"{k}.Class; 14", f"{k}.Data; "]
        lines += [f"; {1e3 * a:g}; {v!r}" for a, v in zip(t.tolist(), values.tolist(), strict=True)]
    return "\r\n".join([*lines, ""]).encode()


def joint_lists_bytes(samples: int = 20) -> bytes:
    """Parquet with lists of joints, as LeRobot writes them."""
    t, u, x = wave(samples)
    joints = {
        "action": pa.array(np.column_stack([u, x]).tolist(), pa.list_(pa.float64())),
        "observation.state": pa.array(np.column_stack([x, u]).tolist(), pa.list_(pa.float64(), 2)),
        "ragged": pa.array([[0.0] * (k % 3) for k in range(samples)], pa.list_(pa.float64())),
    }
    out = io.BytesIO()
    parquet.write_table(pa.table({"timestamp": t, **joints}), out)
    return out.getvalue()


def twincat_bytes(samples: int = 20) -> bytes:
    t, u, x = wave(samples)
    lines = ["Name\tProject", "File\ta.svdx", "", "Name\tfTorque\tName\tfActPos"]
    lines += ["SampleTime[ms]\t2\tSampleTime[ms]\t2", "SymbolName\tMAIN.u\tSymbolName\tMAIN.x", ""]
    rows = zip(t.tolist(), u.tolist(), x.tolist(), strict=True)
    lines += [f"{1e3 * a:.3f}\t{b!r}\t{1e3 * a:.3f}\t{c!r}" for a, b, c in rows]
    return "\n".join([*lines, ""]).encode()


def labelled_bytes(samples: int = 20) -> bytes:
    t, u, x = wave(samples)
    rows = zip(t.tolist(), u.tolist(), x.tolist(), strict=True)
    return "".join(f"time:{a!r},torque:{b!r} angle={c!r}\n" for a, b, c in rows).encode()


def stamped_bytes(samples: int = 20) -> bytes:
    t, u, x = wave(samples)
    rows = zip(t.tolist(), u.tolist(), x.tolist(), strict=True)
    return "".join(
        f"2025-03-04 12:00:{a:06.3f} INFO servo torque={b!r} angle={c!r}\n" for a, b, c in rows
    ).encode()


def echoed_bytes(samples: int = 20) -> bytes:
    t, u, x = wave(samples)
    rows = zip(t.tolist(), u.tolist(), x.tolist(), strict=True)
    return "".join(
        f"1741089600,{round(1e9 * a)},base,j1,j2,{c!r},0.0,,{b!r},0.0\n" for a, b, c in rows
    ).encode()


def in_turn_bytes(samples: int = 40) -> bytes:
    t, u, x = wave(samples)
    rows = zip(t.tolist(), u.tolist(), x.tolist(), strict=True)
    head = "time,motor_id,torque,angle\n"
    return (
        head + "".join(f"{a!r},{1 + k % 2},{b!r},{c!r}\n" for k, (a, b, c) in enumerate(rows))
    ).encode()


def wpilog_bytes(samples: int = 20) -> bytes:
    t, u, x = wave(samples)

    def record(entry: int, stamp: int, payload: bytes) -> bytes:
        sizes = struct.pack("<BII", entry, len(payload), stamp)
        return bytes([0b0011_1100]) + sizes + payload

    def begin(entry: int, name: bytes, kind: bytes) -> bytes:
        told = struct.pack("<BI", 0, entry)
        for text in (name, kind, b""):
            told += struct.pack("<I", len(text)) + text
        return record(0, 0, told)

    parts = [b"WPILOG\x00\x01", struct.pack("<I", 2), b"{}"]
    parts += [begin(1, b"/motor/volts", b"double"), begin(2, b"/arm/position", b"double[]")]
    for k, (a, b, c) in enumerate(zip(t.tolist(), u.tolist(), x.tolist(), strict=True)):
        stamp = round(1e6 * a)
        parts += [
            record(1, stamp, struct.pack("<d", b)),
            record(2, stamp, struct.pack("<2d", c, k)),
        ]
    return b"".join(parts)


def tdms_bytes(samples: int = 20) -> bytes:
    from nptdms import ChannelObject, TdmsWriter

    _, u, x = wave(samples)
    out = io.BytesIO()
    with TdmsWriter(out) as writer:
        interval = {"wf_increment": PERIOD, "unit_string": "Nm"}
        writer.write_segment([ChannelObject("run", "torque", u, interval)])
        writer.write_segment([ChannelObject("run", "angle", x, {"unit_string": "rad"})])
    return out.getvalue()


def ulog_bytes(samples: int = 20) -> bytes:
    t, u, x = wave(samples)

    def message(kind: bytes, payload: bytes) -> bytes:
        return struct.pack("<H", len(payload)) + kind + payload

    parts = [b"ULog\x01\x12\x35\x01", struct.pack("<Q", 0), message(b"B", bytes(40))]
    parts += [message(b"F", b"servo:uint64_t timestamp;double torque;double position;")]
    parts += [message(b"A", struct.pack("<BH", 0, 0) + b"servo")]
    for a, b, c in zip(t.tolist(), u.tolist(), x.tolist(), strict=True):
        parts.append(message(b"D", struct.pack("<HQ2d", 0, round(1e6 * a) + 1, b, c)))
    return b"".join(parts)
