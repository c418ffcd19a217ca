"""NumPy files: NPY with one array, NPZ with named ones. Nothing pickled is ever loaded."""

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from zwidth.logs.source import Collector, RecordingError, Source

MOST_BYTES = 1 << 33  # of all arrays, unpacked
ABOUT = "zwidth.json"  # the entry, UTF-8 in an array of bytes, of a file of our own


def read_npy(path: Path, data: bytes) -> Source:
    """Return the columns of one array; raises RecordingError."""
    found = Collector()
    found.add("values", _array(path, "", data))
    return Source(path, "NPY", found.signals, found.unreadable)


def read_npz(path: Path, data: bytes) -> Source:
    """Return every array of an archive; raises RecordingError."""
    found = Collector()
    about: dict[str, Any] = {}
    for name, content in _entries(path, data).items():
        if name == ABOUT:
            about = _about(path, content)
            continue
        try:
            found.add(name, _array(path, name, content))
        except RecordingError as error:
            found.unreadable[name] = f"cannot be read: {error}"
    return Source(path, "NPZ", found.signals, found.unreadable, about=about)


def _entries(path: Path, data: bytes) -> dict[str, bytes]:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > MOST_BYTES:
                raise ValueError(f"it unpacks to more than {MOST_BYTES >> 30} GiB")
            return {
                name.removesuffix(".npy"): archive.read(name)
                for name in archive.namelist()
                if name.endswith(".npy")
            }
    except MemoryError:
        raise
    except Exception as error:  # zipfile raises what it meets: BadZipFile, zlib.error, struct.error
        said = f"{path.name} is a damaged archive, of NPZ or Excel: {error}"
        raise RecordingError(said) from None


def _array(path: Path, name: str, content: bytes) -> np.ndarray:
    try:
        return np.load(io.BytesIO(content), allow_pickle=False)
    except MemoryError:
        raise
    except Exception as error:
        if "allow_pickle" in str(error):
            reason = "it holds Python objects, which are never loaded"
        else:
            reason = f"it is damaged ({error})"
        raise RecordingError(
            f"{name or path.name}: {reason}; save it as an array of numbers"
        ) from None


def _about(path: Path, content: bytes) -> dict[str, Any]:
    try:
        about = json.loads(_array(path, ABOUT, content).tobytes())
    except (ValueError, RecursionError):
        raise RecordingError(f"{path.name}: its entry {ABOUT} is damaged") from None
    return about if isinstance(about, dict) else {}
