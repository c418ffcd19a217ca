"""One recording in every format that is read, with something else in place of some numbers."""

import io
import json
import math
from collections.abc import Callable
from typing import Any, NamedTuple, cast

import h5py
import numpy as np
import pyarrow as pa
import scipy.io
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import Writer as JsonWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as Ros2Writer
from pyarrow import parquet
from recording_examples import EPOCH, JOINT_STATE

Cell = float | str | None
Writer = Callable[[list[float], list[Cell], list[Cell]], bytes]


def csv_table(t: list[float], u: list[Cell], x: list[Cell]) -> bytes:
    rows = [
        ",".join("" if cell is None else str(cell) for cell in row)
        for row in zip(t, u, x, strict=True)
    ]
    return "\n".join(["t,u,x", *rows, ""]).encode()


def plain(cells: list[Cell]) -> Any:
    """Return numbers where all are numbers, else the texts of all cells."""
    if any(isinstance(cell, str) for cell in cells):
        return np.array([str(cell) for cell in cells])
    return np.array(cells, dtype=np.float64)


def parquet_table(t: list[float], u: list[Cell], x: list[Cell]) -> bytes:
    columns: dict[str, Any] = {"t": t}
    for name, cells in (("u", u), ("x", x)):
        texts = any(isinstance(cell, str) for cell in cells)
        columns[name] = [str(cell) for cell in cells] if texts else cells
    out = io.BytesIO()
    parquet.write_table(pa.table(columns), out)
    return out.getvalue()


def npz_arrays(t: list[float], u: list[Cell], x: list[Cell]) -> bytes:
    out = io.BytesIO()
    np.savez(out, t=np.array(t), u=plain(u), x=plain(x))
    return out.getvalue()


def npy_matrix(t: list[float], u: list[Cell], x: list[Cell]) -> bytes:
    out = io.BytesIO()
    np.save(out, np.stack([np.array(t), plain(u), plain(x)], axis=1))
    return out.getvalue()


def mat_variables(t: list[float], u: list[Cell], x: list[Cell]) -> bytes:
    """Return doubles, or a column of cells as `readcell` makes one of a table with a text in it."""
    variables: dict[str, Any] = {"t": np.array(t)[:, None]}
    for name, cells in (("u", u), ("x", x)):
        if all(isinstance(cell, float) for cell in cells):
            variables[name] = plain(cells)[:, None]
        else:
            column = np.empty((len(cells), 1), dtype=object)
            for k, cell in enumerate(cells):
                column[k, 0] = np.empty((0, 0)) if cell is None else cell
            variables[name] = column
    out = io.BytesIO()
    scipy.io.savemat(out, variables)  # pyright: ignore[reportArgumentType]
    return out.getvalue()


def hdf5_sets(t: list[float], u: list[Cell], x: list[Cell]) -> bytes:
    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        file["t"] = t
        for name, cells in (("u", u), ("x", x)):
            values = plain(cells)
            file[name] = values.tolist() if values.dtype.kind == "U" else values
    return out.getvalue()


def joint_states(t: list[float], u: list[Cell], x: list[Cell]) -> bytes:
    out = io.BytesIO()
    writer = Ros2Writer(out)
    joints = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
    for k, seconds in enumerate(t):
        ns = EPOCH + round(seconds * 1e9)
        sec, nanosec = divmod(ns, 1_000_000_000)
        message = {
            "header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": ""},
            "name": ["x"], "position": [x[k]], "velocity": [0.0], "effort": [u[k]],
        }  # fmt: skip
        writer.write_message("/joints", joints, message, ns, ns, k)
    writer.finish()
    return out.getvalue()


def json_messages(t: list[float], u: list[Cell], x: list[Cell]) -> bytes:
    """Return messages in which an empty cell is null in one field and not there in the other."""
    out = io.BytesIO()
    writer = JsonWriter(out)
    writer.start()
    schema = writer.register_schema("Sample", "jsonschema", b'{"type": "object"}')
    topic = writer.register_channel("/axis", "json", schema)
    for k, seconds in enumerate(t):
        body = {"u": u[k]} | ({} if x[k] is None else {"x": x[k]})
        ns = EPOCH + round(seconds * 1e9)
        writer.add_message(topic, ns, json.dumps(body).encode(), ns, k)
    writer.finish()
    return out.getvalue()


def protobuf_messages(t: list[float], u: list[Cell], x: list[Cell]) -> bytes:
    file = FileDescriptorProto(name="gaps.proto", package="gaps", syntax="proto3")
    message = file.message_type.add(name="Axis")
    for number, name in enumerate(("u", "x"), start=1):
        message.field.add(
            name=name, number=number, type=FieldDescriptorProto.TYPE_DOUBLE,
            label=FieldDescriptorProto.LABEL_OPTIONAL,
        )  # fmt: skip
    pool = DescriptorPool()
    pool.Add(file)
    axis = GetMessageClass(pool.FindMessageTypeByName("gaps.Axis"))
    out = io.BytesIO()
    writer = ProtobufWriter(out)
    for k, seconds in enumerate(t):
        ns = EPOCH + round(seconds * 1e9)
        body = axis(u=cast("float", u[k]), x=cast("float", x[k]))
        writer.write_message("/axis", body, ns, ns, k)
    writer.finish()
    return out.getvalue()


class Format(NamedTuple):
    """How a format is written, what its signals are called, what stands in place of a number."""

    write: Writer
    time: str
    command: str
    position: str
    holes: tuple[Cell, ...]


FORMATS = {
    "a_csv": Format(csv_table, "t", "u", "x", ("nan", "inf", "err", None)),
    "a_parquet": Format(parquet_table, "t", "u", "x", (math.nan, math.inf, "err", None)),
    "a_npz": Format(npz_arrays, "t", "u", "x", (math.nan, -math.inf, "err")),
    "a_npy": Format(npy_matrix, "values[0]", "values[1]", "values[2]", (math.nan, math.inf)),
    "a_mat": Format(mat_variables, "t", "u", "x", (math.nan, math.inf, "err", None)),
    "a_h5": Format(hdf5_sets, "t", "u", "x", (math.nan, math.inf, "err")),
    "a_mcap": Format(json_messages, "log_time", "/axis.u", "/axis.x", (math.nan, "err", None)),
    "joints_mcap": Format(joint_states, "header.stamp", "/joints.x.effort", "/joints.x.position",
                          (math.nan, math.inf)),
    "axis_mcap": Format(protobuf_messages, "log_time", "/axis.u", "/axis.x", (math.nan, math.inf)),
}  # fmt: skip
