"""The page on haptics: its pictures are there, its commands are as the commands take them."""

import re
from importlib import import_module
from pathlib import Path

import click
import pytest

DOCS = Path(__file__).parents[1] / "docs"
PAGE = (DOCS / "haptics.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^    zwidth (.+)$", PAGE, re.MULTILINE)


def test_every_picture_of_the_page_is_there_and_none_besides() -> None:
    """Mutation: a picture renamed in the maker only."""
    shown = set(re.findall(r"\(haptics/(\w+\.png)\)", PAGE))
    assert shown == {path.name for path in (DOCS / "haptics").glob("*.png")}
    assert len(shown) == 7
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
