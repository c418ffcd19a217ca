"""Sealed keys: what is concealed is fixed before anybody looks, and can be shown to be unchanged.

The key of a recording says what is concealed in it, and holds the SHA-256 of the recording and of
its device file. The recording's description holds the seal: SHA-256 over salt and canonical JSON of
the key. So whoever has both finds a changed key, recording or device file; whoever has the
recording alone learns nothing, since the salt has 128 bits.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from zwidth.files.protection import reading
from zwidth.files.whole import write_text

SALT_BYTES = 16
MARK = "sealed, SHA-256 "


class SealError(ValueError):
    """A recording, device file or key that is not the one that was sealed."""


def canonical(key: Mapping[str, Any]) -> bytes:
    """Return JSON with sorted names and no blanks; raises ValueError for NaN and infinities."""
    text = json.dumps(
        key, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False
    )
    return text.encode()


def seal(salt: str, key: Mapping[str, Any]) -> str:
    """Return the seal of a key; salt in hexadecimal digits."""
    return hashlib.sha256(bytes.fromhex(salt) + canonical(key)).hexdigest()


def digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(reading(path).read_bytes()).hexdigest()


def write_key(path: Path, salt: str, key: Mapping[str, Any]) -> None:
    """Write salt and key, whole or not at all."""
    text = json.dumps({"salt": salt, "key": key}, indent=1, allow_nan=False) + "\n"
    write_text(path, text, own=True)


def open_key(path: Path, sealed: str, files: Mapping[str, Path]) -> dict[str, Any]:
    """Return the key of a file if it is the sealed one and its files are unchanged.

    sealed: the recording's description, which ends with the seal. files: name in the key's `sha256`
    -> file. Raises SealError that says what was changed, or is no key.
    """
    try:
        stored = json.loads(reading(path).read_text(encoding="utf-8"))
        salt, key = str(stored["salt"]), stored["key"]
        found = seal(salt, key)
        expected: dict[str, str] = dict(key["sha256"])
    except (ValueError, TypeError, KeyError, UnicodeDecodeError) as error:
        raise SealError(f"{path.name} is not the key of a concealed recording: {error!r}") from None
    if not sealed.endswith(MARK + found):
        raise SealError(
            f"{path.name} does not match the seal in the recording; use the key that was written"
            " with this recording"
        )
    for name, file in files.items():
        if digest(file) != expected.get(name):
            raise SealError(
                f"{file.name} was changed after its key was sealed; restore the original file"
            )
    return dict(key)
