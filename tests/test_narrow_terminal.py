"""A terminal of 80 columns breaks no word: tables, errors, and results shown in Python."""

import io
import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from zwidth import cli
from zwidth.commands.plan import _say_pairs
from zwidth.console import Column, Console, fitted
from zwidth.errors import Status
from zwidth.planning import plan as planning
from zwidth.planning.plan import Confusable, Plan, Visible
from zwidth.views.table import Table, as_text

WIDE = 80
BOUNDARY = "boundary phantom_1_0 --delay-ms 2 --damping 0 0.01 --limit-s 4 --tolerance 0.01 --table"
PLAN = (
    "plan phantom_1_0 --noise 1e-5 --seconds 1"
    " --excitation two_level_multisine --excitation standard_session --excitation chirp"
)
ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class Terminal(io.StringIO):
    """A terminal, as far as is asked of one."""

    def isatty(self) -> bool:
        return True


def shown(
    monkeypatch: pytest.MonkeyPatch, folder: Path, command: str, stream: io.StringIO
) -> list[str]:
    """What a command writes there, without the names of the files it writes, line by line."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", str(WIDE))
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", stream)
        assert cli.run(command.split()) == Status.DONE
    lines = ESCAPES.sub("", stream.getvalue()).splitlines()
    return [line for line in lines if not line.startswith("wrote ")]


def words(lines: list[str]) -> Counter[str]:
    """How often each word stands there; rules of a table are none."""
    return Counter(word for line in lines for word in line.split() if "\u2500" not in word)


def test_the_tables_of_a_boundary_break_no_word(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Mutation: columns as narrow as rich makes them, "[N m/rad" and "]"."""
    narrow = shown(monkeypatch, tmp_path, BOUNDARY, Terminal())
    assert max(map(len, narrow)) <= WIDE
    assert words(narrow) == words(shown(monkeypatch, tmp_path, BOUNDARY, io.StringIO()))


def test_the_tables_of_a_plan_break_no_word(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of three effects, row by row. Mutation: a table that does not fit is drawn all the same."""
    every = planning._typical
    monkeypatch.setattr(planning, "_typical", lambda *asked: every(*asked)[:3])
    narrow = shown(monkeypatch, tmp_path, PLAN, Terminal())
    assert max(map(len, narrow)) <= WIDE
    plain = words(shown(monkeypatch, tmp_path, PLAN, io.StringIO()))
    assert plain["two_level_multisine"] > 0
    assert set(words(narrow)) == set(plain)


def test_the_excitation_that_tells_effects_apart_is_named_whole(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Mutation: a column as narrow as rich makes it, "two_level_multisin" and "e"."""
    labels = ("directional_friction@m1", "presliding_friction@m1")
    pairs = (Confusable(*labels, 1.0, "two_level_multisine", 6.2),)
    monkeypatch.setenv("COLUMNS", str(WIDE))
    screen = Terminal()
    monkeypatch.setattr(sys, "stdout", screen)
    _say_pairs(Console(), Plan("chirp", 2.0, (), labels, np.ones((2, 2)), pairs))
    lines = ESCAPES.sub("", screen.getvalue()).splitlines()
    assert max(map(len, lines)) <= WIDE
    assert words(lines)["two_level_multisine"] == 1


@pytest.mark.parametrize("wide", range(34, 60))
def test_a_table_of_any_width_breaks_no_word(wide: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """As columns or, where its words do not fit, row by row. Mutation: a column too narrow by 1."""
    columns = [Column("effect", False), Column("K_max [N m/rad]"), Column("what it is", False)]
    row = ["play of the gear", "0.0123456", "measured at half of the travel"]
    monkeypatch.setenv("COLUMNS", str(wide))
    screen = Terminal()
    monkeypatch.setattr(sys, "stdout", screen)
    Console().table("", columns, [row])
    lines = ESCAPES.sub("", screen.getvalue()).splitlines()
    assert max(map(len, lines)) <= wide
    said = words(lines)
    assert all(said[word] for cell in row for word in cell.split())
    assert "N m/rad" in "\n".join(lines)
    assert all("play of the gear" in line for line in lines if "play" in line)


def test_a_table_in_a_file_is_cut_off_nowhere(capsys: pytest.CaptureFixture[str]) -> None:
    """Words that do not fit into 160 columns. Mutation: rich's own width, which crops."""
    Console().table("", [Column(f"column {i}") for i in range(9)], [["x" * 30] * 9])
    assert capsys.readouterr().out.split().count("x" * 30) == 9


def test_the_widest_columns_give_way_first() -> None:
    assert fitted([10, 30, 20], [10, 5, 5], 45) == [10, 17, 18]
    assert fitted([10, 30], [10, 30], 20) == [10, 30]
    assert fitted([3, 4], [1, 1], 80) == [3, 4]


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals there")
def test_an_error_is_wrapped_between_words() -> None:
    """On a real terminal of 80 columns. Mutation: `print` of the whole line."""
    import pty

    master, slave = pty.openpty()
    arguments = [
        "export",
        "phantom_1_0",
        "--to",
        "a format that is not one of those that there are",
    ]
    done = subprocess.run(
        [sys.executable, "-m", "zwidth", *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=slave,
        env=os.environ | {"COLUMNS": str(WIDE), "TERM": "xterm"},
        check=False,
        timeout=120,
    )
    os.close(slave)
    said = os.read(master, 65536).decode().rpartition("error: ")[2].splitlines()
    os.close(master)
    assert done.returncode == Status.BAD_INPUT
    assert len(said) > 1
    assert len("error: " + said[0]) <= WIDE
    assert max(map(len, said)) <= WIDE
    assert "a format that is not one of those that there are" in " ".join(said)


def test_a_plan_in_python_shows_whole_names() -> None:
    """Also where an effect looks like three others. Mutation: the six columns of before."""
    levels = {"presliding_friction@m1": "level", "directional_friction@m1": "level_plus",
              "stribeck_friction@m1": "level", "rising_friction@m1": "level"}  # fmt: skip
    labels = tuple(levels)
    seen = tuple(Visible(at, None, 2.19e-4, name, "N m", 1.0) for at, name in levels.items())
    pairs = tuple(Confusable(labels[0], rival, 1.0) for rival in labels[1:])
    lines = repr(Plan("noise", 2.0, seen, labels, np.ones((4, 4)), pairs)).splitlines()
    assert max(map(len, lines)) <= 100
    (first,) = (line for line in lines if line.startswith(labels[0]))
    assert "  level 0.000219 N m  " in first
    names = set(re.findall(r"\w+@\S*", first.replace(",", " ")))
    assert names <= set(labels)
    assert len(names) >= 2
    assert first.endswith("\u2026")


def test_a_magnitude_that_is_no_parameter_is_called_what_it_is() -> None:
    """A gear of 1.002 shows by 0.002. Mutation: the parameter's name, "ratio 0.002"."""
    seen = Visible("load_friction@m1", None, 0.002, "ratio", "", 1.0)
    assert seen.measure == "|ratio - 1|"


def test_a_cell_is_cut_between_words() -> None:
    shown = as_text(Table("t", (), ("a", "b"), [["one", " ".join(["words"] * 30)]]))
    last = shown.splitlines()[-1]
    assert len(last) <= 100
    assert last.endswith("words \u2026")
    long = as_text(Table("t", (), ("a",), [["x" * 300]])).splitlines()[-1]
    assert len(long) == 100
