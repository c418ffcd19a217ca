"""The page on exports: all effects stand in its table, its commands are taken as they stand."""

import re
from importlib import import_module
from pathlib import Path

import click
import pytest

from zwidth.sim.physics import LIBRARY

DOCS = Path(__file__).parents[1] / "docs"
PAGE = (DOCS / "export.md").read_text(encoding="utf-8")
HELD = (DOCS / "reference" / "export.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^    zwidth (.+)$", PAGE, re.MULTILINE)


def test_every_effect_has_its_row() -> None:
    """C holds each to the bit. Mutation: a page of before an effect was added."""
    rows = dict(re.findall(r"^\| ([a-z_]+) \| (.+?) \|", HELD, re.MULTILINE))
    rows.pop("effect")
    assert set(rows) == {"none", *LIBRARY}
    assert set(rows.values()) == {"**exact**"}
    assert "[[" not in HELD


@pytest.mark.parametrize("line", COMMANDS)
def test_its_commands_are_understood(line: str) -> None:
    """Every option is one of the command's. Mutation: `--to` without its choices."""
    name, *words = line.split()
    command = import_module(f"zwidth.commands.{name}").command
    assert isinstance(command, click.Command)
    assert command.make_context(name, words).params


def test_it_is_linked_from_the_front() -> None:
    assert "(docs/export.md)" in (DOCS.parent / "README.md").read_text(encoding="utf-8")
