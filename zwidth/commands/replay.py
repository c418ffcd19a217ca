"""`zwidth replay`: show that a log can be simulated again bit for bit, or where it differs."""

from pathlib import Path
from typing import Any

import click

from zwidth.console import Console, json_number
from zwidth.errors import Status
from zwidth.files.protection import reading
from zwidth.heartbeat import HEART
from zwidth.options import force_option, json_option
from zwidth.scenarios.comparison import Difference
from zwidth.scenarios.replay import ReplayResult, replay
from zwidth.sim.controller import Step
from zwidth.user_law import controller_option


@click.command("replay")
@click.argument("log", metavar="LOG", type=click.Path(path_type=Path))
@controller_option
@force_option
@json_option
def command(log: Path, controller: Step | None, json_file: str | None) -> int:
    """Simulate a logged run again, from the log alone, and compare every value bit for bit.

    A log that ends early is compared as far as it goes. Exit status: 0 identical, 1 different (the
    first tick and channel are named), 2 a log that cannot be replayed.
    """
    console = Console(json_file)
    reading(log)
    console.will_write()
    HEART.begins(f"reading {log.name}")
    result = replay(
        log, controller, lambda share: HEART.begins(f"simulating again, {100.0 * share:.0f} %")
    )
    for note in result.notes:
        console.warn(note)
    console.say(sentence(result))
    console.result(as_json(result))
    return Status.DONE if result.identical else Status.FAILED


def sentence(result: ReplayResult) -> str:
    """Return the outcome of the replay in words."""
    if result.first_difference is None:
        return f"identical: {result.ticks} ticks, every channel bit for bit"
    return f"different: first at {result.first_difference}"


def as_json(result: ReplayResult) -> dict[str, Any]:
    """Return the result in plain types."""
    first = result.first_difference
    return {
        "identical": result.identical,
        "ticks": result.ticks,
        "first_difference": None if first is None else _difference(first),
        "warnings": list(result.notes),
    }


def _difference(first: Difference) -> dict[str, Any]:
    return {
        "tick": first.tick,
        "time_s": json_number(first.time),
        "topic": first.topic,
        "channel": first.channel,
        "logged": json_number(first.logged),
        "replayed": json_number(first.replayed),
    }
