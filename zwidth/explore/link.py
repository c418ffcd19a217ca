"""How other commands lead into the page: the line that starts it, and the address of a view."""

import shlex
from collections.abc import Sequence
from pathlib import Path

from zwidth.explore.view import View

PORT = 5006


def explore_command(
    device: str | Path, compare: Sequence[str | Path] = (), recording: str | Path | None = None
) -> str:
    """Return the line that opens devices and a recording, to be pasted into a shell."""
    words = ["zwidth", "explore", str(device)]
    for other in compare:
        words += ["--compare", str(other)]
    if recording is not None:
        words += ["--recording", str(recording)]
    return shlex.join(words)


def explore_link(view: View, port: int = PORT) -> str:
    """Return the address of a view; it answers while the command runs on this port."""
    query = view.query()
    return f"http://localhost:{port}/{'?' if query else ''}{query}"
