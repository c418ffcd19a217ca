"""Text tables as people and their tools write them."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recording_examples import csv_bytes, german_csv_bytes, wave

from zwidth.logs.csv_file import read_csv
from zwidth.logs.csv_form import CsvOptions
from zwidth.logs.source import RecordingError, Source

HERE = Path("a.csv")


def read(text: str, options: CsvOptions | None = None) -> Source:
    return read_csv(HERE, text.encode(), options or CsvOptions())


def columns(source: Source) -> dict[str, list[float]]:
    return {name: signal.values.tolist() for name, signal in source.signals.items()}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a,b\n1,2\n3,4\n", {"a": [1, 3], "b": [2, 4]}),
        ("a;b\n1,5;2\n3;4\n", {"a": [1.5, 3], "b": [2, 4]}),
        ("a\tb\n1.5\t2\n3\t4\n", {"a": [1.5, 3], "b": [2, 4]}),
        ("a\tb\n1,5\t2\n3\t4,5\n", {"a": [1.5, 3], "b": [2, 4.5]}),
        ('a,b\n"1,5","2,0"\n"3,0","4,5"\n', {"a": [1.5, 3], "b": [2, 4.5]}),
        ("  a   b\n  1   2\n -3e1 +4\n", {"a": [1, -30], "b": [2, 4]}),
        ("x\n1,5\n2,5\n", {"x": [1.5, 2.5]}),
        ("1,2\n3,4\n", {"column1": [1, 3], "column2": [2, 4]}),
        ("a,b,\n1,2,\n3,4,\n", {"a": [1, 3], "b": [2, 4]}),
        ("a,b\n1,2,\n3,4,\n", {"a": [1, 3], "b": [2, 4]}),
        ("rig 3\n\na,b\n1,2\n3,4\n", {"a": [1, 3], "b": [2, 4]}),
        ("sep=;\na;b\n1;2\n3;4\n", {"a": [1, 3], "b": [2, 4]}),
        ("# a b\n1 2\n3 4\n", {"a": [1, 3], "b": [2, 4]}),
        ("a,a\n1,2\n", {"a": [1], "a (column 2)": [2]}),
        ("a,b\r1,2\r\n3,4", {"a": [1, 3], "b": [2, 4]}),
        ("% MATLAB\na,b\n// why\n1,2\n\n# and\n3,4\n", {"a": [1, 3], "b": [2, 4]}),
        ("a,b\n1e3,-0.0\ninf,-inf\n", {"a": [1e3, math.inf], "b": [-0.0, -math.inf]}),
        ("\ufeffa,b\n+1,.5\n", {"a": [1], "b": [0.5]}),
    ],
)
def test_dialects(text: str, expected: dict[str, list[float]]) -> None:
    assert columns(read(text)) == expected


def test_units_behind_names_and_on_their_own_line() -> None:
    source = read("t [s],q (deg),note,tau [N m]\n0,1,2,3\n")
    assert {n: s.unit for n, s in source.signals.items()} == {
        "t": "s", "q": "deg", "note": "", "tau": "N m",
    }  # fmt: skip
    assert source["q (deg)"] is source["q"]
    source = read_csv(HERE, german_csv_bytes())
    assert {n: s.unit for n, s in source.signals.items()} == {
        "Zeit": "ms", "Moment": "Nm", "Winkel": "°",
    }  # fmt: skip
    np.testing.assert_allclose(source["Zeit"].floats(), 1e3 * wave(20)[0], atol=1e-12)


def test_blank_cells_are_nan_and_stay_in_place() -> None:
    source = read("a,b\n1,\n,4\nNaN,6\n n/a ,8\n")
    np.testing.assert_array_equal(source["a"].values, [1, np.nan, np.nan, np.nan])
    np.testing.assert_array_equal(source["b"].values, [np.nan, 4, 6, 8])


def test_a_stray_text_is_a_gap_that_is_counted_and_the_first_is_quoted() -> None:
    """Mutations: the column removed for one text; texts counted among the numbers."""
    source = read("# head\na,b,c\n1,2,3\n3,ERR,\n5,6,off\n7,8,9\n9,err,2\n")
    np.testing.assert_array_equal(source["b"].values, [2, np.nan, 6, 8, np.nan])
    np.testing.assert_array_equal(source["c"].values, [3, np.nan, np.nan, 9, 2])
    assert [source[name].note for name in "abc"] == [
        "",
        "2 cells of 5 in column 'b' are no number, first 'ERR' in line 4; taken as gaps",
        "1 cell of 5 in column 'c' is no number, first 'off' in line 5; taken as a gap",
    ]


def test_a_column_with_as_many_texts_as_numbers_is_text() -> None:
    """Blank cells count for neither. Mutation: the texts compared with all cells."""
    source = read("a,b,c\n1,idle,2\n3,1,idle\n5,run,\n7,2,\n9,3,\n")
    assert list(source.signals) == ["a", "b"]
    with pytest.raises(
        RecordingError, match="'c' has 'idle' in line 3, column 3, which is not a num"
    ):
        source["c"]
    words = read("a,b\n1,idle\n3,idle\n5,6\n")
    with pytest.raises(RecordingError, match="not a number; 1 below it are not numbers either"):
        words["b"]


def test_text_in_the_first_line_of_data_makes_no_header_of_it() -> None:
    source = read("a,b\n1,ERR\n3,4\n5,6\n")
    assert columns(source)["a"] == [1, 3, 5]
    assert "first 'ERR' in line 2" in source["b"].note


def test_a_cut_off_end_is_told() -> None:
    source = read("a,b\n1,2\n3,4\n5")
    assert columns(source) == {"a": [1, 3], "b": [2, 4]}
    assert source.notes == ("the last line, 4, is cut short and left out",)
    assert "has no end" in read("a,b\n1,2\n3,4").notes[0]


def test_lines_above_the_table_are_told() -> None:
    assert read("rig 3\na,b\n1,2\n3,4\n").notes == ("lines above the table are left out: 1",)
    assert read("a,b\n1,2,3\n4,5\n6,7\n").notes == ("lines above the table are left out: 2",)
    assert read("a,b\n[s],[m]\n4,5\n6,7\n").notes == ()


def test_a_ragged_line_is_an_error() -> None:
    with pytest.raises(RecordingError, match="line 3 has 3 cells but the table has 2"):
        read("a,b\n1,2\n3,4,5\n6,7\n8,9\n")


def test_what_cannot_be_found_out_can_be_said() -> None:
    assert columns(read("a|b\n1|2\n", CsvOptions(delimiter="|"))) == {"a": [1], "b": [2]}
    text = "run,7\nplace,3\na,b\n1,2\n"
    assert list(read(text).unreadable) == ["column1"]
    assert "first 'b' in line 3" in read(text)["column2"].note
    assert columns(read(text, CsvOptions(header_line=3))) == {"a": [1], "b": [2]}
    assert columns(read("1,2\n3,4\n", CsvOptions(header_line=1))) == {"1": [3], "2": [4]}
    unnamed = CsvOptions(header_line=0)
    assert columns(read("1,2\n3,4\n", unnamed)) == {"column1": [1, 3], "column2": [2, 4]}
    assert list(read("a,b\n1,2\n", unnamed).unreadable) == ["column1", "column2"]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"no table at all", "no line of numbers"),
        (b"a,b\n-,-\n", "no line of numbers"),
        (b"\x00\x01\x02\x03", "not in a format that can be read"),
        (b"\xff\xfe\x31", "not UTF-16 text"),
    ],
)
def test_other_files_are_refused(data: bytes, words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        read_csv(HERE, data)


def test_utf16() -> None:
    assert columns(read_csv(HERE, "a,b\n1,2\n".encode("utf-16"))) == {"a": [1], "b": [2]}


@given(
    rows=st.lists(
        st.tuples(*[st.floats(allow_nan=False) | st.integers(-(10**6), 10**6)] * 3), min_size=1
    ),
    dialect=st.sampled_from(
        [(",", "."), (";", "."), (";", ","), ("\t", "."), ("\t", ","), (" ", ".")]
    ),
    quoted=st.booleans(),
    plus=st.booleans(),
)
def test_every_number_comes_back(
    rows: list[tuple[float, ...]], dialect: tuple[str, str], quoted: bool, plus: bool
) -> None:
    """The fast and the slow parser agree with Python's own on every double."""
    delimiter, decimal = dialect
    style = '"{}"' if quoted and delimiter != " " else "{}"

    def cell(value: float) -> str:
        sign = "+" if plus and not repr(value).startswith("-") else ""
        return style.format(sign + repr(value).replace(".", decimal))

    lines = [delimiter.join("abc"), *(delimiter.join(map(cell, row)) for row in rows), ""]
    source = read("\n".join(lines))
    expected = np.array(rows, dtype=np.float64).T
    for name, values in zip("abc", expected, strict=True):
        assert source[name].values.tobytes() == values.tobytes()


def test_a_table_of_many_lines_is_read_by_columns(tmp_path: Path) -> None:
    source = read_csv(tmp_path / "a.csv", csv_bytes(20_000))
    np.testing.assert_array_equal(source["angle"].values, wave(20_000)[2])
