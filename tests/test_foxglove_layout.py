"""docs/foxglove_layout.json shows what a log really holds, as a reader that is not ours sees it."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from zwidth.controllers.wall import wall
from zwidth.logs.events import Event
from zwidth.logs.mcap_writer import write_log
from zwidth.sim.device_file import load_device
from zwidth.sim.run import Start, simulate

LAYOUT = Path(__file__).parents[1] / "docs" / "foxglove_layout.json"


def places(value: Any) -> Iterator[str]:
    """Yield all topics and message paths in a layout: strings that begin with a slash."""
    if isinstance(value, dict):
        for one in value.values():
            yield from places(one)
    elif isinstance(value, list):
        for one in value:
            yield from places(one)
    elif isinstance(value, str) and value.startswith("/"):
        yield value


def fields_of(path: Path) -> dict[str, set[str]]:
    """Return the names of the fields of every topic."""
    found: dict[str, set[str]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            found.setdefault(channel.topic, {f.name for f in message.DESCRIPTOR.fields})
    return found


def test_every_place_in_the_layout_is_in_a_log(tmp_path: Path) -> None:
    """Mutation: a channel written under another name (`units.SUFFIXES`), or a misspelt path."""
    start = Start(1e-3)
    phantom = load_device("phantom_1_0")
    run = simulate(phantom, wall(10.0, 0.02), duration=0.05, start=start, ledger=True)
    log = tmp_path / "run.mcap"
    write_log(log, run.trace, events=[Event(0.01, "contact", "m1", 0.1)], epoch_ns=0)
    fields = fields_of(log)
    named = set(places(json.loads(LAYOUT.read_text(encoding="utf-8"))))
    assert len(named) >= 10
    for place in named:
        topic, field = re.fullmatch(r"(/[^.]+)(?:\.(\w+).*)?", place).groups()  # pyright: ignore[reportOptionalMemberAccess]
        assert topic in fields, place
        assert field is None or field in fields[topic], place
    assert {place.partition(".")[0] for place in named} == {"/tick", "/events"}
