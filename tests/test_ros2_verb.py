"""`ros2 bag diagnose`, called as ros2cli calls a verb; ROS 2 itself is on no package registry."""

import argparse
import tomllib
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]


def verbs() -> dict[str, Any]:
    """An object of each verb that is declared, with its name, as `get_verb_extensions` makes it."""
    told = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    found: dict[str, Any] = {}
    for name, place in told["entry-points"]["ros2bag.verb"].items():
        module, _, kind = place.partition(":")
        found[name] = getattr(import_module(module), kind)()
        found[name].NAME = name
    return found


def test_a_bag_is_diagnosed_by_the_verb(monkeypatch: pytest.MonkeyPatch):
    """Mutations: options that the parser of ros2 takes for its own; a status that is lost."""
    asked: list[list[str]] = []
    monkeypatch.setattr("zwidth.cli.run", lambda words: asked.append(words) or 3)  # pyright: ignore[reportUnknownLambdaType, reportUnknownArgumentType, reportUnknownMemberType]
    parser = argparse.ArgumentParser(prog="ros2 bag")
    below = parser.add_subparsers()
    for name, verb in verbs().items():
        one = below.add_parser(name, description=verb.__doc__)
        one.set_defaults(_verb=verb)
        verb.add_arguments(one, f"ros2 bag {name}")
    args = parser.parse_args(["diagnose", "bag/", "--joint", "elbow", "--out", "o"])
    assert args._verb.main(args=args) == 3
    assert asked == [["diagnose", "bag/", "--joint", "elbow", "--out", "o"]]
    assert "differs from the simulation" in below.choices["diagnose"].format_help()
