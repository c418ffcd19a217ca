"""Small files that would become huge or endless: each is refused in one sentence, before it does.

What SECURITY.md promises of workbooks, bags, models and formulas. Each bomb here would take more
memory than there is, or run for ever; they are built small, and none is lit.
"""

import io
import re
import sqlite3
import struct
import sys
import tomllib
import zipfile
import zlib
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import recording_examples as examples

from zwidth import cli
from zwidth.diagnosis.learning.formulas import LAWS
from zwidth.diagnosis.learning.own_effect import law_of_two_text
from zwidth.errors import Status
from zwidth.export.mujoco_run import engine
from zwidth.export.read_joint import device_of_joint
from zwidth.files.formulas import DEEPEST, refuse_endless
from zwidth.logs import bag_folder, excel_bounds, excel_text, foreign_mcap, sqlite_tables, unpacked
from zwidth.logs.bag_folder import read_sqlite
from zwidth.logs.open_source import own_log
from zwidth.logs.source import RecordingError, Source

# Workbooks

ONE = '<row r="1"><c r="A1"><v>1</v></c></row>'
SHEET = "xl/worksheets/sheet2.xml"


def book(rows: str, texts: Sequence[str] = (), **parts: str) -> bytes:
    """A workbook whose second sheet has these rows; texts: shared ones."""
    out = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(examples.excel_bytes())) as good,
        zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        for name in good.namelist():
            if name != SHEET:
                archive.writestr(name, good.read(name))
        archive.writestr(SHEET, f"<worksheet><sheetData>{rows}</sheetData></worksheet>")
        shared = "".join(f"<si><t>{text}</t></si>" for text in texts)
        archive.writestr("xl/sharedStrings.xml", f"<sst>{shared}</sst>")
        for name, text in parts.items():
            archive.writestr(name, text)
    return out.getvalue()


def texts_of(rows: int, form: str = '<c r="A{0}" t="s"><v>0</v></c>') -> str:
    return "".join(f'<row r="{k}">{form.format(k)}</row>' for k in range(1, rows + 1))


FAR = '<row r="1048576"><c r="XFD1048576"><v>1</v></c></row>'
UNSAID = f'<row r="1048000">{"<c/>" * 900}<c><v>1</v></c></row>'


@pytest.mark.parametrize(
    "rows",
    [
        ONE + FAR,
        FAR.replace('"XFD', '"&#88;FD'),
        FAR.replace("<c r", "<x:c r").replace("</c>", "</x:c>").replace("<row", '<row xmlns:x="y"'),
        UNSAID,
        '<row r="4294967290"><c><v>1</v></c></row>' + ONE,
        FAR.replace("<v>1</v>", "<is><t>x</t></is>"),
    ],
)
def test_a_workbook_of_one_far_cell_is_refused(rows: str, tmp_path: Path):
    """The reader makes every cell up to it, 549 GB, and ends the process without them.

    Mutations: cells that say no place not counted; a place counted as it is escaped; the plain form
    taken for a sheet of another.
    """
    data = book(rows)
    assert len(data) < 2500
    (tmp_path / "far.xlsx").write_bytes(data)
    with pytest.raises(RecordingError, match=r"sheet2\.xml of far\.xlsx has its furthest cell"):
        own_log(tmp_path / "far.xlsx")


def test_far_cells_of_many_sheets_count_together(monkeypatch: pytest.MonkeyPatch):
    """Mutation: each sheet held against the limit alone."""
    monkeypatch.setattr(unpacked, "ALWAYS_BYTES", 1 << 20)
    monkeypatch.setattr(unpacked, "MOST_TIMES", 1)
    rows = '<row r="1500"><c r="J1500"><v>1</v></c></row>'
    sheet = f"<worksheet><sheetData>{rows}</sheetData></worksheet>"
    excel_bounds.bounded(Path("one.xlsx"), book(rows))
    excel_bounds.bounded(Path("two.xlsx"), book(rows, **{"xl/worksheets/sheet3.xml": sheet}))
    more = {f"xl/worksheets/sheet{k}.xml": sheet for k in (3, 4, 5)}
    with pytest.raises(RecordingError, match=r"all sheets of a workbook of .* 32768 cells"):
        excel_bounds.bounded(Path("four.xlsx"), book(rows, **more))


@pytest.mark.parametrize(
    "form",
    [
        '<c r="A{0}" t="s"><v>0</v></c>',
        '<c t="s" r="A{0}"><v> 0\n</v></c>',
        "<c r='A{0}' t='s'><v>0<!-- -->1</v></c>",
        '<c r="A{0}" t="s"><v><![CDATA[0]]></v></c>',
        '<c r="A{0}" t="s"><v>0<x>1</x></v></c>',
    ],
)
def test_a_shared_text_counts_as_often_as_it_is_used(form: str, tmp_path: Path):
    """A megabyte, four thousand times, 4.7 GiB in the reader; 24 KB in the file.

    Mutations: uses not counted; a number that readers read differently taken as one of them.
    """
    data = book(texts_of(4000, form), ["x" * (1 << 20), "y"])
    assert len(data) < 50_000
    (tmp_path / "text.xlsx").write_bytes(data)
    with pytest.raises(RecordingError, match="repeats shared texts in its cells, which makes 4000"):
        own_log(tmp_path / "text.xlsx")


def test_a_workbook_is_read_as_before(tmp_path: Path):
    """Cells without a value stand far out where borders are drawn. Mutation: they count."""
    rows = "".join(
        f'<row r="{k}"><c r="A{k}"><v>{k * 0.5}</v></c><c r="B{k}" t="s"><v>{k % 2}</v></c>'
        f'<c r="C{k}"><v>{k * k}</v></c></row>'
        for k in range(1, 30)
    )
    drawn = '<row r="1048576"><c r="XFD1048576" s="1"/></row>'
    for name, sheet in {"plain": rows, "drawn": rows + drawn}.items():
        (tmp_path / f"{name}.xlsx").write_bytes(book(sheet, ["go", "x" * 99_999]))
        found = own_log(tmp_path / f"{name}.xlsx")
        assert isinstance(found, Source)
        first, last = found.signals.values()
        assert np.array_equal(first.values, 0.5 * np.arange(1, 30))
        assert np.array_equal(last.values, np.arange(1.0, 30) ** 2)


def test_both_ways_to_measure_a_sheet_agree():
    """The one for the form of programs, and the one that goes through it. Mutation: either."""
    lengths = [3, 50, 7]
    part = "<worksheet><sheetData>" + "".join(
        f'<row r="{k}"><c r="B{k}" s="2" t="s"><v>{k % 4}</v></c><c r="AC{k}"><v>{k}</v></c></row>'
        for k in range(5, 40)
    ).replace("\n", "")
    part = f"{part}</sheetData></worksheet>".encode()
    sheet = excel_bounds._Sheet(Path("a.xlsx"), "a", lengths)
    excel_bounds._go_through(Path("a.xlsx"), "a", part, sheet.start, sheet.text)
    sheet.end()
    assert sheet.rows == 39
    assert sheet.columns == 29
    assert sheet.texts == 2 * sum([*lengths, 50][k % 4] for k in range(5, 40))
    plain = excel_bounds._plain(part, lengths)
    assert plain == 32 * 39 * 29 + sheet.texts


@pytest.mark.parametrize(
    ("sheet", "said"),
    [
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><a><sheetData><c/></sheetData></a>", "declares a DOCTYPE"),
        ("<a><sheetData><c></sheetData></a>", "is not XML"),
        ('<a><sheetData><row r="1A"><c/></row></sheetData></a>', "row '1A', which is no place"),
        ('<a><sheetData><row><c r="-1"/></row></sheetData></a>', "cell or row '-1', which is no"),
        (f'<a><sheetData><row><c r="A{"9" * 5000}"/></row></sheetData></a>', "which is no place"),
    ],
)
def test_a_sheet_that_cannot_be_gone_through_is_refused(sheet: str, said: str):
    """Mutation: the reader tries it."""
    data = book("", **{"xl/worksheets/sheet3.xml": sheet})
    with pytest.raises(RecordingError, match=said):
        excel_bounds.bounded(Path("a.xlsx"), data)


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_what_is_read_is_what_was_checked(tmp_path: Path):
    """Other formats, and a part twice, are ways past the check. Mutation: the file handed on."""
    for name, said in {
        SHEET: "has 2 parts named 'xl/worksheets/sheet2.xml'",
        SHEET.replace("s", "S"): "has 2 parts named 'xl/worksheets/sheet2.xml'",
        "xl/workbook.bin": r"binary form \(\.xlsb\), which is not read",
    }.items():
        (tmp_path / "a.xlsx").write_bytes(book(ONE, **{name: "<a/>"}))
        with pytest.raises(RecordingError, match=said):
            own_log(tmp_path / "a.xlsx")
    made = excel_bounds.bounded(Path("a.xlsx"), book(ONE, **{"content.xml2": "x", "mimetype": "x"}))
    with zipfile.ZipFile(io.BytesIO(made)) as archive:
        assert SHEET in archive.namelist()
        assert not {"content.xml2", "mimetype"} & set(archive.namelist())


# Workbooks of before 2007


def record(kind: int, content: bytes) -> bytes:
    return struct.pack("<HH", kind, len(content)) + content


def old_book(cells: bytes) -> bytes:
    """A workbook of BIFF8 with one sheet of these records, in a compound file of one FAT sector."""

    def begin(kind: int) -> bytes:
        return record(0x809, struct.pack("<HHHHII", 0x600, kind, 0, 1997, 0, 6))

    def whole(at: int) -> bytes:
        named = record(0x85, struct.pack("<IHBB3s", at, 0, 3, 0, b"run"))
        return begin(5) + record(0x42, struct.pack("<H", 1200)) + named + record(0xA, b"")

    stream = whole(len(whole(0))) + begin(0x10) + cells + record(0xA, b"")
    stream = stream.ljust(4096, b"\0")
    stream += bytes(-len(stream) % 512)
    none, end, of_fat = 0xFFFFFFFF, 0xFFFFFFFE, 0xFFFFFFFD
    sectors = len(stream) // 512
    fat = [of_fat, end, *range(3, sectors + 2), end]
    assert len(fat) <= 128
    header = bytes.fromhex("D0CF11E0A1B11AE1") + bytes(16)
    header += struct.pack("<5H6x", 0x3E, 3, 0xFFFE, 9, 6)
    header += struct.pack("<9I", 0, 1, 1, 0, 4096, end, 0, end, 0)
    header += struct.pack("<109I", 0, *[none] * 108)

    def entry(name: str, kind: int, start: int, size: int, child: int = none) -> bytes:
        raw = name.encode("utf-16-le")
        head = struct.pack("<64sHBB3I", raw, len(raw) + 2, kind, 1, none, none, child)
        return head + bytes(36) + struct.pack("<IIxxxx", start, size)

    folder = entry("Root Entry", 5, end, 0, 1) + entry("Workbook", 2, 2, len(stream))
    return (
        header
        + struct.pack("<128I", *fat, *[none] * (128 - len(fat)))
        + folder.ljust(512, b"\0")
        + stream
    )


def numbers_of(places: Iterable[tuple[int, int, float]]) -> bytes:
    return b"".join(record(0x203, struct.pack("<HHHd", r, c, 0, v)) for r, c, v in places)


def test_an_old_workbook_is_read(tmp_path: Path):
    """In a process of its own. Mutation: the sheets cut at a wrong length."""
    cells = numbers_of((k, j, 0.5 * k + j) for k in range(30) for j in range(3))
    (tmp_path / "old.xls").write_bytes(old_book(cells))
    found = own_log(tmp_path / "old.xls")
    assert isinstance(found, Source)
    assert found.kind == "Excel workbook, sheet 'run'"
    for j, signal in enumerate(found.signals.values()):
        assert np.array_equal(signal.values, 0.5 * np.arange(30) + j)


needs_limits = pytest.mark.skipif(sys.platform != "linux", reason="memory is not limited here")


@needs_limits
@pytest.mark.parametrize(
    "cells",
    [
        record(0x200, struct.pack("<IIHHH", 0, 0xFFFFFFF0, 0, 200, 0)),
        numbers_of([(0, 0, 1.0), (65535, 65535, 1.0)]),
    ],
)
def test_an_old_workbook_that_asks_for_too_much_ends_its_own_process_alone(
    cells: bytes, tmp_path: Path
):
    """34 TB that it says it has, or 137 GB up to its furthest cell. Mutation: read in this one."""
    (tmp_path / "bomb.xls").write_bytes(old_book(cells))
    with pytest.raises(RecordingError, match=r"bomb\.xls cannot be read .* want of memory or time"):
        own_log(tmp_path / "bomb.xls")


@needs_limits
def test_an_old_workbook_makes_as_much_text_as_it_may(monkeypatch: pytest.MonkeyPatch):
    """Mutation: all that it makes sent on."""
    data = old_book(numbers_of((k, 0, 0.1 * k) for k in range(300)))
    assert len(excel_text.sheets_apart(data, 9999)) == 1
    with pytest.raises(excel_text.NotRead, match="its cells make more than 0 MiB of text"):
        excel_text.sheets_apart(data, 100)
    with pytest.raises(excel_text.NotRead, match="Cannot detect file format"):
        excel_text.sheets_apart(b"junk", 100)
    monkeypatch.setattr(excel_text, "SECONDS", 0)
    with pytest.raises(excel_text.NotRead, match="takes more than 0 s"):
        excel_text.sheets_apart(data, 9999)


def test_no_module_of_the_current_folder_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Beside a workbook may lie anything. Mutation: `python -m`, which looks there first."""
    for name in ("python_calamine", "struct", "io", "resource"):
        (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'stolen')!r}, 'w')")
    monkeypatch.chdir(tmp_path)
    data = old_book(numbers_of((k, 0, 0.1 * k) for k in range(30)))
    assert len(excel_text.sheets_apart(data, 9999)) == 1
    assert not (tmp_path / "stolen").exists()


# Bags of SQLite3

DEFINITION = "float64 data\n"
TABLES = (
    "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)",
    "CREATE TABLE message_definitions(topic_type TEXT, encoding TEXT,"
    " encoded_message_definition TEXT)",
    "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)",
    "INSERT INTO topics VALUES(1, '/u', 'p/msg/F', 'cdr')",
    f"INSERT INTO message_definitions VALUES('p/msg/F', 'ros2msg', '{DEFINITION}')",
)
ENDLESS = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n{}) SELECT"
DROPPED = "DROP TABLE messages"
COLUMNS = "id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER"


def bag(path: Path, *more: str, messages: int = 50) -> Path:
    with closing(sqlite3.connect(path)) as base:
        for statement in TABLES:
            base.execute(statement)
        for k in range(messages):
            data = struct.pack("<BBHd", 0, 1, 0, 0.5 * k)
            base.execute("INSERT INTO messages VALUES(?, 1, ?, ?)", (k + 1, 10 * k, data))
        for statement in more:
            base.execute(statement)
        base.commit()
    return path


def test_a_bag_of_ordinary_tables_is_read(tmp_path: Path):
    """With an index and without. Mutation: what every file has taken for a bomb."""
    for k, more in enumerate([(), ("CREATE INDEX at ON messages (timestamp)",)]):
        found = own_log(bag(tmp_path / f"{k}.db3", *more))
        assert isinstance(found, Source)
        assert np.array_equal(found["/u.data"].values, 0.5 * np.arange(50))


VIEW = (
    f"CREATE VIEW messages AS {ENDLESS} i AS id, 1 AS topic_id, i AS timestamp, {{}} AS data FROM n"
)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ((DROPPED, VIEW.format("", "x'00'")), "'messages' of bomb.db3 is a view"),
        ((DROPPED, VIEW.format(" WHERE i < 100", "zeroblob(900000000)")), "'messages'.* is a view"),
        (
            ("DROP TABLE topics", f"CREATE VIEW Topics AS {ENDLESS.format('')} i AS id, 'a'"
             " AS name, 'b' AS type, 'cdr' AS serialization_format FROM n"),
            "'topics' of bomb.db3 is a view",
        ),
        (
            ("DROP TABLE message_definitions", f"CREATE VIEW message_definitions AS"
             f" {ENDLESS.format('')} 'a' AS topic_type, 'b' AS encoding,"
             " 'c' AS encoded_message_definition FROM n"),
            "'message_definitions' of bomb.db3 is a view",
        ),
        (
            (DROPPED, f"CREATE TABLE messages({COLUMNS}, data BLOB AS (zeroblob(900000000)))",
             "INSERT INTO messages(topic_id, timestamp) VALUES(1, 1)"),
            "'messages' of bomb.db3 has the computed column 'data'",
        ),
        (
            (DROPPED, "CREATE VIRTUAL TABLE messages USING rtree(id, topic_id, timestamp)"),
            "'messages' of bomb.db3 is a virtual table",
        ),
        (
            (DROPPED, "CREATE VIRTUAL TABLE messages USING rtree(id, topic_id, timestamp)",
             "PRAGMA writable_schema = ON", "UPDATE sqlite_master SET rootpage = 2,"
             " sql = replace(sql, 'E VIR', 'E/**/VIR') WHERE name = 'messages'"),
            "'messages' of bomb.db3 is a virtual table",
        ),
        (
            (DROPPED, f"CREATE TABLE messages({COLUMNS})", "INSERT INTO messages(topic_id,"
             f" timestamp) {ENDLESS.format(' WHERE i < 5000')} 1, i FROM n",
             f"ALTER TABLE messages ADD COLUMN data BLOB DEFAULT x'{'00' * 50_000}'"),
            "'messages' of bomb.db3 gives more than .* bytes, which is all that the file has",
        ),
        (("UPDATE messages SET data = 9000000000",), "has '9000000000' for its data, which are b"),
        (("UPDATE messages SET timestamp = 9e999",), "is not a readable ROS 2 bag"),
        ((DROPPED,), "'messages' of bomb.db3 is missing"),
    ],
)  # fmt: skip
def test_a_bag_that_computes_or_repeats_is_refused(more: Sequence[str], said: str, tmp_path: Path):
    """Mutations: views read; columns that are computed read; no sum of what is read; bytes(n)."""
    path = bag(tmp_path / "bomb.db3", *more)
    assert path.stat().st_size < 300_000
    with pytest.raises(RecordingError, match=said):
        own_log(path)


def test_pages_that_are_read_many_times_over_are_refused(tmp_path: Path):
    """Pages that name the same page a thousand times, six deep: 1e17 rows in 40 KB.

    Mutation: no sum of what is read.
    """
    path = bag(tmp_path / "bomb.db3")
    with closing(sqlite3.connect(path)) as base:
        ((root,),) = base.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'")
    data = bytearray(path.read_bytes())
    (size,) = struct.unpack(">H", data[16:18])
    data += data[(root - 1) * size : root * size]
    for last in (False,) * 5 + (True,):
        child, count = len(data) // size, size // 8
        page = bytearray(size)
        struct.pack_into(">BHHHBI", page, 0, 5, 0, count, size - 5 * count, 0, child)
        for k in range(count):
            struct.pack_into(">IB", page, size - 5 * (k + 1), child, 1)
            struct.pack_into(">H", page, 12 + 2 * k, size - 5 * (k + 1))
        if last:
            data[(root - 1) * size : root * size] = page
        else:
            data += page
    struct.pack_into(">I", data, 28, len(data) // size)
    path.write_bytes(data)
    with pytest.raises(RecordingError, match=r"gives more than .* bytes, which is all that the"):
        own_log(path)


def test_sqlite_stops_after_as_many_steps_as_a_file_may_take(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Mutation: no handler of its progress."""
    path = bag(tmp_path / "long.db3", messages=3000)
    monkeypatch.setattr(sqlite_tables, "EVERY", 100)
    assert isinstance(own_log(path), Source)
    monkeypatch.setattr(sqlite_tables, "ALWAYS_STEPS", 0)
    monkeypatch.setattr(sqlite_tables, "STEPS", 0)
    with pytest.raises(
        RecordingError, match=r"takes SQLite more than 0 steps, too many for a file of .* bytes;"
    ):
        own_log(path)


def test_ctrl_c_within_sqlite_is_no_damaged_bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """SQLite takes an exception of its handler for an answer. Mutation: said as an error of it."""

    def pressed(_: object) -> bool:
        raise KeyboardInterrupt

    monkeypatch.setattr(sqlite_tables, "EVERY", 100)
    monkeypatch.setattr(sqlite_tables.Tables, "_has_ended", pressed)
    with pytest.raises(KeyboardInterrupt):
        own_log(bag(tmp_path / "long.db3", messages=3000))


def test_a_value_larger_than_the_file_is_refused(tmp_path: Path):
    """As a damaged or made row says it is. Mutation: no limit of a length."""
    path = bag(tmp_path / "bomb.db3")
    with (
        sqlite_tables.tables(path) as base,
        pytest.raises(
            RecordingError, match=r"has a value that is larger than the file itself \(.* bytes\)"
        ),
    ):
        list(base._each("SELECT zeroblob(900000000)"))


def test_messages_unpack_to_what_a_file_may(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Each within its limit, and all together beyond theirs. Mutation: no sum of them."""
    path = bag(tmp_path / "packed.db3")
    monkeypatch.setattr(unpacked, "ALWAYS_BYTES", 1 << 20)
    monkeypatch.setattr(unpacked, "MOST_TIMES", 1)

    def unpack(body: bytes) -> bytes:
        return body + bytes(1 << 15)

    with pytest.raises(RecordingError, match="its messages unpack to more than 1 MiB"):
        read_sqlite(path, b"", unpack)


def test_definitions_are_as_long_as_any_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The time of their parser grows with the square. Mutations: either limit."""
    long = "".join(f"float64 a{k}\n" for k in range(12_000))
    changed = f"UPDATE message_definitions SET encoded_message_definition = '{long}'"
    path = bag(tmp_path / "one.db3", changed)
    found = own_log(path)
    assert isinstance(found, Source)
    assert any(f"/u has a definition of {len(long)} bytes" in note for note in found.notes)
    monkeypatch.setattr(bag_folder, "MOST_DEFINED", 100)
    topics = [f"INSERT INTO topics VALUES({k}, '/t{k}', 'p/msg/F', 'cdr')" for k in range(2, 12)]
    with pytest.raises(RecordingError, match="definitions of its topics have more than 100 char"):
        own_log(bag(tmp_path / "many.db3", *topics))
    assert len(long) > foreign_mcap.LONGEST


# Models of MuJoCo

BODY = '<body><joint name="m1"/><geom size="0.1" mass="1"/></body>'
needs_mujoco = pytest.mark.skipif(engine() is None, reason="MuJoCo is not installed")


def model(path: Path, bodies: str = BODY, before: str = "", after: str = "") -> Path:
    path.write_text(f"<mujoco>{before}<worldbody>{bodies}</worldbody>{after}</mujoco>")
    return path


def nested(count: int, levels: int, inner: str) -> str:
    return f'<replicate count="{count}">' * levels + inner + "</replicate>" * levels


@needs_mujoco
@pytest.mark.parametrize(
    ("bodies", "before", "after", "said"),
    [
        (nested(100_000_000, 1, BODY), "", "", "the count of its <replicate> is '100000000'"),
        (nested(150, 4, BODY), "", "", "bodies, joints and shapes, as the count of its <replic"),
        (BODY + nested(20_000, 1, "<site/>"), "", "", "it has at least 20001 bodies, joints and"),
        (BODY, '<asset><hfield name="h" nrow="60000" ncol="60000" size="1 1 1 1"/></asset>', "",
         "take 54931 MiB, as the nrow of its <hfield> is '60000', and at most 256 MiB"),
        (BODY, '<asset><texture name="t" builtin="flat" width="60000" height="9"/></asset>', "",
         "the width of its <texture> is '60000'"),
        (BODY, '<default><texture width="3000" height="3000" type="2d"/></default><asset>'
         + '<texture builtin="flat" type="2d"/>' * 10 + "</asset>", "",
         "take 566 MiB, as the width of its <texture> is '3000'"),
        (BODY, '<asset><mesh name="m" builtin="cone" params="100000 1"/></asset>', "",
         "'100000 1' for the params of a <mesh>"),
        (BODY, '<size memory="1T"/>', "", "'1T' for the memory of its <size>, and at most 4G"),
        (BODY, '<size memory="lots"/>', "", "the memory of its <size> is 'lots'"),
        (BODY, '<size nkey="1000000000"/>', "", "the nkey of its <size> is '1000000000'"),
        (BODY, '<size nuser_geom="1000000000"/>', "", "the nuser_geom of its <size>"),
        (BODY, '<size nuserdata="1000000000"/>', "", "the nuserdata of its <size>"),
        (BODY, "", '<sensor><user dim="1000000000"/></sensor>', "the dim of its <user>"),
        (BODY, "", '<actuator><motor joint="m1" delay="1" nsample="16000000"/></actuator>',
         "the nsample of its <motor>"),
        ('<camera name="c" resolution="60000 60000"/>' + BODY, "",
         '<sensor><rangefinder camera="c"/></sensor>', "the resolution of its <camera>"),
        ('<body name="b"><flexcomp name="f" count="3000 3000 1"/></body>' + BODY, "", "",
         "the count of its <flexcomp> is '3000 3000 1'"),
        ('<body name="b"><flexcomp name="f"/><flexcomp name="g"/></body>' * 5 + BODY, "", "",
         "it has at least 100.* bodies"),
        (nested(1, 1, BODY).replace('"1"', '"many"'), "", "", "is 'many', and must be numbers"),
        (nested(1, 1, BODY).replace('"1"', '"1e999"'), "", "", "is '1e999', and must be numbers"),
    ],
)  # fmt: skip
def test_a_model_that_declares_too_much_is_refused(
    bodies: str, before: str, after: str, said: str, tmp_path: Path
):
    """MuJoCo works at it for ever, or fails without a word. Mutation: any of the counts left out.

    Counts within counts multiply.
    """
    with pytest.raises(ValueError, match=said):
        device_of_joint(model(tmp_path / "bomb.xml", bodies, before, after), "m1")


@needs_mujoco
def test_models_within_models_multiply(tmp_path: Path):
    """Ten of ten of ten, and one that attaches itself, which ends the process in MuJoCo.

    Mutations: attached models counted once; an included part counted once; no look for itself.
    """
    model(tmp_path / "m0.xml", '<body name="b">' + '<geom size="1"/>' * 20 + "</body>")
    for k in range(1, 4):
        attached = "".join(f'<attach model="m" body="b" prefix="p{j}"/>' for j in range(10))
        asset = f'<asset><model name="m" file="m{k - 1}.xml"/></asset>'
        model(tmp_path / f"m{k}.xml", f'<body name="b">{attached}</body>{BODY}', asset)
    with pytest.raises(
        ValueError, match=r"m3.xml is too large for MuJoCo: it has at least 2.* bodies"
    ):
        device_of_joint(tmp_path / "m3.xml", "m1")
    device, _ = device_of_joint(tmp_path / "m1.xml", "m1")
    assert device.chain.masses.size == 1
    (tmp_path / "part.xml").write_text("<mujoco>" + "<site/>" * 200 + "</mujoco>")
    within = nested(200, 1, '<include file="part.xml"/>')
    with pytest.raises(ValueError, match=r"it has at least .* shapes, as the count of its <rep"):
        device_of_joint(model(tmp_path / "robot.xml", within + BODY), "m1")
    itself = '<asset><model name="m" file="robot.xml"/></asset>'
    with pytest.raises(ValueError, match=r"robot\.xml has itself among the models"):
        device_of_joint(model(tmp_path / "robot.xml", BODY, itself), "m1")


@needs_mujoco
@pytest.mark.parametrize("kind", ["hfield", "texture"])
def test_a_picture_of_a_model_counts_by_its_pixels(kind: str, tmp_path: Path):
    """20 000 x 20 000 in black are 50 KB, and 3 GiB in MuJoCo. Mutation: files not looked at."""
    head = struct.pack(">II5B", 20_000, 20_000, 1, 0, 0, 0, 0)
    chunk = b"IHDR" + head
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "p.png").write_bytes(
        b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + chunk + struct.pack(">I", zlib.crc32(chunk))
    )
    asset = f'<asset><{kind} name="p" file="some/where/p.png" size="1 1 1 1"/></asset>'
    before = f'<compiler assetdir="parts" strippath="true"/>{asset}'
    with pytest.raises(ValueError, match=f"as its {kind} p.png has 20000 x 20000 pixels, and at m"):
        device_of_joint(model(tmp_path / "robot.xml", BODY, before), "m1")


@needs_mujoco
def test_what_mujoco_says_itself_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Its RuntimeError, its FatalError and no memory. Mutation: ValueError alone taken."""
    mujoco = pytest.importorskip("mujoco")
    path = model(tmp_path / "robot.xml")
    line = ["devices", "--from", str(path), "--joint", "m1"]
    for error in (RuntimeError("Caught an unknown exception!"), RuntimeError(), MemoryError()):

        def compiled(_: str, error: Exception = error) -> object:
            raise error

        with monkeypatch.context() as patch:
            patch.setattr(mujoco, "MjModel", SimpleNamespace(from_xml_path=compiled))
            assert cli.run(line) == Status.BAD_INPUT
        said = capsys.readouterr().err.splitlines()[-1]
        assert said.startswith(f"error: {path} ")
        assert "internal" not in said

    def stopped(*_: object) -> None:
        raise mujoco.FatalError("mj_stackAlloc: out of memory\nmax = 1")

    with monkeypatch.context() as patch:
        patch.setattr(mujoco, "mj_forward", stopped)
        with pytest.raises(ValueError, match=r"cannot run: mj_stackAlloc: out of memory$"):
            device_of_joint(path, "m1")


@needs_mujoco
def test_an_included_part_that_is_no_xml_is_refused(tmp_path: Path):
    """MuJoCo reads more than XML is, and that would not be counted. Mutation: passed over."""
    (tmp_path / "part.xml").write_text("<mujoco><worldbody><site></worldbody></mujoco>")
    with pytest.raises(ValueError, match="is not a model that MuJoCo can read: mismatched tag"):
        device_of_joint(model(tmp_path / "robot.xml", BODY, '<include file="part.xml"/>'), "m1")


# Formulas


@pytest.mark.parametrize(
    ("formula", "said"),
    [
        ("-" * 5000 + "c", f"more than {DEEPEST} operations within each other"),
        ("-" * 50_000 + "c", "formula has 50001 characters, and may have 10000"),
        ("c" + " + c" * 1500, f"more than {DEEPEST} operations within each other"),
        ("abs(" * 150 + "c" + ")" * 150, f"more than {DEEPEST} operations within each other"),
        ("v if q > c else " * 200 + "c", f"more than {DEEPEST} operations within each other"),
        ("c * (((((v**8)**8)**8)**8)**8)**8", "and may have 5000; write it shorter"),
        ("c * 1e999 * v", "formula has a number above 1.8e308"),
        (f"c * {'9' * 400}", "formula has a number above 1.8e308"),
    ],
)
def test_a_formula_that_is_too_deep_is_one_sentence(
    formula: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):  # fmt: skip
    """Before zwidth goes through it and calls itself for each operation. Mutation: no limits."""
    with pytest.raises(ValueError, match=said):
        refuse_endless(formula)
    (tmp_path / "effects").mkdir()
    (tmp_path / "effects" / "law.toml").write_text(f'name = "law"\nformula = "{formula}"\n')
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("ZWIDTH_EFFECTS", raising=False)
    assert cli.run(["effects"]) == Status.BAD_INPUT
    assert re.search(rf"^error: effects.law\.toml: .*{said}", one_line(capsys.readouterr().err))


def test_a_formula_as_long_as_any_that_is_learned_passes():
    """Mutation: a limit below the longest."""
    numbers = dict.fromkeys("abcdefghijklmnopqrstuvwxyz", 0.5) | {"k1": 0.3, "k2": 0.2}
    longest = 0
    for name in LAWS:
        for forms in ([(name, numbers), ("cube", numbers)], [(name, numbers)] * 2):
            text = law_of_two_text("mine", ("velocity", "command"), forms, "a test", shifts=True)
            formula = tomllib.loads(text)["formula"]
            refuse_endless(formula)
            longest = max(longest, len(formula))
    assert longest > 2000
    refuse_endless("c" + " + c" * (DEEPEST - 1))
    refuse_endless("no expression at all")


def test_values_nested_too_deep_in_an_effect_are_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    """Mutation: tomllib's RecursionError let through."""
    (tmp_path / "law.toml").write_text(f"formula = 'c'\nx = {'[' * 50_000}{']' * 50_000}")
    monkeypatch.setenv("ZWIDTH_EFFECTS", str(tmp_path / "law.toml"))
    assert cli.run(["effects"]) == Status.BAD_INPUT
    assert "its values nest too deep" in one_line(capsys.readouterr().err)


def one_line(text: str) -> str:
    return " ".join(text.split())


# Each of them as a command


def test_a_bomb_is_bad_input_of_a_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    """Exit status 2 and one line. Mutation: an error that is no ValueError."""
    (tmp_path / "far.xlsx").write_bytes(book(ONE + FAR))
    bag(tmp_path / "view.db3", DROPPED, VIEW.format("", "x'00'"))
    for name in ("far.xlsx", "view.db3"):
        assert cli.run(["convert", str(tmp_path / name)]) == Status.BAD_INPUT
        said = one_line(capsys.readouterr().err)
        assert said.startswith("error: ")
        assert name in said
