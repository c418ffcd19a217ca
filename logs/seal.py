"""A checksum inside each metadata record: the format itself gives metadata none."""

import json
import zlib
from collections.abc import Mapping

SEAL = "log.crc32"


def seal(entries: Mapping[str, str]) -> dict[str, str]:
    """Return the entries and their checksum under the key `log.crc32`."""
    return dict(entries) | {SEAL: _checksum(entries)}


def unseal(entries: Mapping[str, str]) -> dict[str, str] | None:
    """Return the entries without the checksum, or None if they do not match it.

    Entries without a checksum come from another tool and are returned as they are.
    """
    plain = {key: value for key, value in entries.items() if key != SEAL}
    intact = SEAL not in entries or entries[SEAL] == _checksum(plain)
    return plain if intact else None


def _checksum(entries: Mapping[str, str]) -> str:
    text = json.dumps(entries, sort_keys=True)
    return f"{zlib.crc32(text.encode()):08x}"
