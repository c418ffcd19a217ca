"""The page on haptics: its pictures are there, its commands are as the commands take them."""

import re
from importlib import import_module
from pathlib import Path

import click
import pytest

from zwidth.scenarios.table_2 import table_2
from zwidth.sim.device_file import load_device
from zwidth.stability.linear import critical_stiffness

DOCS = Path(__file__).parents[1] / "docs"
PAGE = (DOCS / "haptics.md").read_text(encoding="utf-8")
AWAY = [  # from the corner, where the second mode sets in
    (0.002, 0.05), (0.002, 0.08), (0.008, 0.05), (0.008, 0.08), (0.008, 0.1),
    *((0.004, b) for b in (0.05, 0.08, 0.1, 0.15, 0.18, 0.2)),
]  # fmt: skip
COMMANDS = re.findall(r"^    zwidth (.+)$", PAGE, re.MULTILINE)


def test_every_picture_of_the_page_is_there_and_none_besides() -> None:
    """Mutation: a picture renamed in the maker only."""
    shown = set(re.findall(r"\(haptics/(\w+\.png)\)", PAGE))
    assert shown == {path.name for path in (DOCS / "haptics").glob("*.png")}
    assert len(shown) == 9
    assert "[[" not in PAGE


@pytest.mark.parametrize("line", COMMANDS)
def test_its_commands_are_understood(line: str) -> None:
    """Every option is one of the command's. Mutation: `--law` without its choices."""
    name, *words = line.split()
    command = import_module(f"zwidth.commands.{name}").command
    assert isinstance(command, click.Command)
    context = command.make_context(name, words)
    assert context.params


def test_it_is_linked_from_the_front() -> None:
    assert "(docs/haptics.md)" in (DOCS.parent / "README.md").read_text(encoding="utf-8")


def test_measured_walls_are_within_ten_percent() -> None:
    """Of Table I, to which nothing was fitted, by theory; the page has the same by simulation.

    Where the device has a damper and its first mode oscillates, away from the corner. Mutation: a
    tick of delay more or less.
    """
    rows = [r for r in table_2() if r.place >= 0.05 and (r.delay, r.place) in AWAY]
    off = []
    for row in rows:
        device = load_device("phantom_1_0").with_interface(delay=row.delay)
        found = critical_stiffness(device, row.place).stiffness
        assert found is not None
        off.append(abs(found / row.stiffness - 1.0))
    assert len(off) == 11
    assert max(off) < 0.13
    assert sorted(off)[8] < 0.1
    for row in rows:
        meant = "" if row.damping_meant is None else f", read as {row.place:g}"
        cells = (f"{1e3 * row.delay:g} ms", f"{row.damping:g}{meant}", f"{row.stiffness:g}")
        assert f"| {' | '.join(cells)} |" in PAGE
