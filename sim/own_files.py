"""Files that declare a user's own effects, which are compiled into the kernels.

They are those in `ZWIDTH_EFFECTS` (files or folders, separated as in PATH), else those in the
folder `effects` of the current folder. They are read when zwidth is imported, since an effect is
compiled into the kernels; in a folder, only files with a key `formula` count.
"""

import hashlib
import os
from pathlib import Path

VARIABLE = "ZWIDTH_EFFECTS"
FOLDER = "effects"


def own_files() -> tuple[Path, ...]:
    """Return the files that declare effects, in the order of their names."""
    named = os.environ.get(VARIABLE)
    places = [Path(FOLDER)] if named is None else [Path(p) for p in named.split(os.pathsep) if p]
    found: list[Path] = []
    for place in places:
        if place.is_dir():
            every = sorted(p for p in place.glob("*.toml") if p.is_file())
            found += [p for p in every if b"formula" in p.read_bytes()]
        elif named is not None:
            found.append(place)
    return tuple(found)


def own_texts() -> tuple[tuple[Path, bytes | None], ...]:
    """Return the files and their texts, None for one that cannot be read."""
    found: list[tuple[Path, bytes | None]] = []
    for file in own_files():
        try:
            found.append((file, file.read_bytes()))
        except OSError:
            found.append((file, None))
    return tuple(found)


def source_hash(text: bytes) -> str:
    """Return the hash that identifies the text of an effect in a log."""
    return hashlib.sha256(text).hexdigest()[:16]
