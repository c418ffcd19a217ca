"""A checksum inside each metadata record, since the format has none for metadata."""

import json
import zlib
from collections.abc import Mapping

SEAL = "log.crc32"


def seal(name: str, entries: Mapping[str, str]) -> dict[str, str]:
    """Return the entries of the record `name` with their checksum under the key `log.crc32`."""
    return dict(entries) | {SEAL: _checksum(name, entries)}


def unseal(name: str, entries: Mapping[str, str], *, required: bool) -> dict[str, str] | None:
    """Return the entries without the checksum, or None if they do not match it.

    Entries without one are returned as they are unless a checksum is required.
    """
    plain = {key: value for key, value in entries.items() if key != SEAL}
    intact = entries[SEAL] == _checksum(name, plain) if SEAL in entries else not required
    return plain if intact else None


def _checksum(name: str, entries: Mapping[str, str]) -> str:
    text = json.dumps([name, dict(entries)], sort_keys=True)
    return f"{zlib.crc32(text.encode()):08x}"
