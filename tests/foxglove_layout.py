"""What docs/foxglove_layout.json shows, and what a log holds for a reader that is not ours."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

LAYOUT = json.loads(
    (Path(__file__).parents[1] / "docs" / "foxglove_layout.json").read_text(encoding="utf-8")
)
OF_A_RUN = {"Plot!position", "Plot!command", "Plot!energy", "StateTransitions!contact"}
OF_A_DIAGNOSIS = set(LAYOUT["configById"]) - OF_A_RUN


def assert_shown(log: Path, panels: set[str]) -> set[str]:
    """Fail unless the log has every topic and field of these panels; return the topics."""
    fields = fields_of(log)
    named = set(_places([LAYOUT["configById"][panel] for panel in sorted(panels)]))
    for place in named:
        found = re.fullmatch(r"(/[^.]+)(?:\.(\w+).*)?", place)
        assert found, place
        topic, field = found.groups()
        assert topic in fields, place
        assert field is None or field in fields[topic], place
    return {place.partition(".")[0] for place in named}


def fields_of(path: Path) -> dict[str, set[str]]:
    """Return the names of the fields of every topic."""
    found: dict[str, set[str]] = {}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            found.setdefault(channel.topic, {f.name for f in message.DESCRIPTOR.fields})
    return found


def placed(layout: Any) -> Iterator[str]:
    """Yield the panels that a layout places."""
    if isinstance(layout, str):
        yield layout
    else:
        yield from placed(layout["first"])
        yield from placed(layout["second"])


def _places(value: Any) -> Iterator[str]:
    """Yield all topics and message paths in a layout: strings that begin with a slash."""
    if isinstance(value, dict):
        for one in value.values():
            yield from _places(one)
    elif isinstance(value, list):
        for one in value:
            yield from _places(one)
    elif isinstance(value, str) and value.startswith("/"):
        yield value
