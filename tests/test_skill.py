"""The skill that agents read: the tools that there are, and every verdict that they may get."""

import re
from pathlib import Path
from typing import Any

import pytest

from zwidth.cli import COMMANDS
from zwidth.diagnosis.answer.result import Verdict

SKILL = Path(__file__).parents[1] / "skills" / "zwidth" / "SKILL.md"
if not SKILL.is_file():
    pytest.skip("not a clone: the wheel has no skill", allow_module_level=True)
TEXT = SKILL.read_text(encoding="utf-8")
KEYS = ("verdict", "augmented_device", "next_experiment", "warnings", "assumptions", "report")


def agent_tools() -> Any:
    mcp = pytest.importorskip("mcp", reason="the SDK is not installed; pip install zwidth[mcp]")
    if not hasattr(mcp, "Client"):
        pytest.skip("the SDK is of before 2.0")
    from zwidth import agent_tools

    return agent_tools


def test_its_tools_are_those_of_the_server_and_commands():
    """Mutations: a tool renamed or added, in the server or in the skill."""
    import anyio  # pyright: ignore[reportMissingImports]

    served = [tool.name for tool in anyio.run(agent_tools().server().list_tools)]
    rows = re.findall(r"^\| .+ \| `(\w+)` \| .+ \|$", TEXT, re.MULTILINE)
    assert sorted(rows) == sorted(served)
    assert set(rows) <= set(COMMANDS)


def test_it_says_what_to_do_after_each_verdict():
    """Mutation: a verdict renamed, or one that the skill does not name."""
    assert sorted(re.findall(r"`(\w+)`:\s", TEXT)) == sorted(verdict.value for verdict in Verdict)


def test_the_keys_that_it_names_are_in_what_a_tool_returns():
    """Mutation: a key left out of the summary."""
    assert [key for key in KEYS if f"`{key}`" not in TEXT] == []
    assert set(KEYS) <= set(agent_tools().SUMMARY)
