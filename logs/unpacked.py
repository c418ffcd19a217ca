"""Limits of unpacked sizes: a small file that would unpack to gigabytes is refused before it does.

Real recordings of motion unpack to 2 to 40 times their size, even if most columns are constant; a
file crafted to exhaust the memory unpacks to a thousand times and more.
"""

from pathlib import Path

from zwidth.logs.source import RecordingError

MOST_BYTES = 1 << 33  # whatever the size of the file
MOST_TIMES = 200  # of the file's size
ALWAYS_BYTES = 1 << 28  # allowed for any file: 33 million numbers
MEBIBYTE = 1 << 20


def most_bytes(size: int, most: int = MOST_BYTES, always: int | None = None) -> int:
    """Return how many bytes a file of this size may unpack to."""
    return min(most, max(MOST_TIMES * size, ALWAYS_BYTES if always is None else always))


def refuse_bomb(
    path: Path, unpacked: int, size: int, most: int = MOST_BYTES, always: int | None = None
) -> None:
    """Raise RecordingError if a file of this size unpacks to more than it may."""
    allowed = most_bytes(size, most, always)
    if unpacked > allowed:
        raise too_large(path, size, allowed)


def too_large(path: Path, size: int, allowed: int) -> RecordingError:
    """Return the error for a file that unpacks to more than is allowed."""
    return RecordingError(
        f"{path.name} has {size} bytes and unpacks to more than {allowed / MEBIBYTE:.4g} MiB, too"
        " much for a file of this size; split it, or save it without compression"
    )
