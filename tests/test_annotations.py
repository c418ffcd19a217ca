"""Annotations of a log, as libraries of other people read them."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import DescriptorProto, FileDescriptorSet
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from zwidth.logs.annotations import Annotation, annotation_records, read_annotations
from zwidth.logs.errors import LogBlockError
from zwidth.logs.mcap_reader import read_log
from zwidth.logs.mcap_writer import write_log
from zwidth.sim.trace import Trace

EPOCH = 1_700_000_000 * 10**9
LATE = Annotation(0.25, 0.5, "error", "mark_2", "stands still", {"effect": "jam"})
EARLY = Annotation(0.125, 1.0, "info", "mark_1", "kept out of the fit")


def written(folder: Path, *annotations: Annotation) -> Path:
    path = folder / "run.mcap"
    t = 0.001 * np.arange(1001, dtype=np.float64)
    trace = Trace(t, {"position_m1": np.sin(t)}, {"position_m1": "rad"}, "recorded")
    write_log(path, trace, epoch_ns=EPOCH, annotations=annotations)
    return path


def messages(path: Path) -> list[tuple[str, str, int, Any]]:
    """Topic, schema, log time and content of every annotation."""
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()], validate_crcs=True)
        decoded = reader.iter_decoded_messages(["/annotations", "/annotations_text"])
        return [(c.topic, s.name, m.log_time, content) for s, c, m, content in decoded if s]


def test_ranges_with_severity_and_text(tmp_path: Path):
    """Mutations: ends written for beginnings; levels of severities off by one."""
    found = messages(written(tmp_path, LATE, EARLY))
    ranges = [(time, m) for _, schema, time, m in found if schema == "foxglove.Event"]
    texts = [(time, m) for _, schema, time, m in found if schema == "foxglove.Log"]
    assert [time - EPOCH for time, _ in ranges] == [125_000_000, 250_000_000]
    (first, second) = (m for _, m in ranges)
    assert first.start_time.ToNanoseconds() == EPOCH + 125_000_000
    assert first.end_time.ToNanoseconds() == EPOCH + 1_000_000_000
    about = {pair.key: pair.value for pair in second.metadata}
    assert about == {
        "name": "mark_2", "severity": "error", "text": "stands still", "effect": "jam",
    }  # fmt: skip
    assert [(m.level, m.name, m.message) for _, m in texts] == [
        (2, "mark_1", "kept out of the fit"), (4, "mark_2", "stands still"),
    ]  # fmt: skip
    assert texts[1][1].timestamp.ToNanoseconds() == texts[1][0] == EPOCH + 250_000_000


def test_the_run_reads_back_as_if_nothing_were_said_of_it(tmp_path: Path):
    """Mutation: annotations counted among the events."""
    log = read_log(written(tmp_path, LATE, EARLY))
    assert read_annotations(log.path, log.epoch_ns) == [EARLY, LATE]
    assert log.warnings == ()
    assert log.events == ()
    assert len(log.tick) == 1001


def test_what_cannot_be_written_is_said(tmp_path: Path):
    """Mutation: any of the checks left out."""
    for wrong, said in (
        ((LATE._replace(end=0.1),), "ends at 0.1 s, before it begins at 0.25 s"),
        ((LATE._replace(severity="fatal"),), "'fatal'; it must be one of info, warning, error"),  # pyright: ignore[reportArgumentType]
        ((LATE, LATE), "two annotations are called mark_2"),
    ):
        with pytest.raises(LogBlockError, match=said):
            written(tmp_path, *wrong)


def fields(files: FileDescriptorSet, message: str) -> dict[str, tuple[int, int, str, int]]:
    """Number, type, type name and label of every field of a message, and the values of enums."""
    (found,) = (m for f in files.file for m in f.message_type if m.name == message)
    own = {f.name: (f.number, f.type, f.type_name, f.label) for f in found.field}
    return own | _values(found)


def _values(message: DescriptorProto) -> dict[str, tuple[int, int, str, int]]:
    return {v.name: (v.number, 0, e.name, 0) for e in message.enum_type for v in e.value}


def test_schemas_are_foxglove_s_own():
    """Field by field as foxglove-sdk has them. Mutation: the number of any field."""
    try:
        foxglove = import_module("foxglove.messages")
    except ModuleNotFoundError:
        pytest.skip("foxglove-sdk is not installed")
    names = {"Event": ("Event", "KeyValuePair"), "Log": ("Log",)}
    for (schema, _), (own, parts) in zip(annotation_records(1), names.items(), strict=True):
        theirs = getattr(foxglove, own).get_schema()
        assert (schema.name, schema.encoding) == (theirs.name, theirs.encoding)
        for part in parts:
            mine, other = (
                fields(FileDescriptorSet.FromString(d), part) for d in (schema.data, theirs.data)
            )
            assert mine == other
