"""NumPy files: NPY with one array, NPZ with named arrays. Pickled objects are never loaded."""

import io
import json
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from zwidth.logs.source import Collector, RecordingError, Signal, Source
from zwidth.logs.unpacked import refuse_bomb

OF_COLUMNS = ("columns", "names", "labels", "channels", "fields", "header", "keys", "signals")
ABOUT = "zwidth.json"  # in files of zwidth: an entry with UTF-8 in an array of bytes


def read_npy(path: Path, data: bytes) -> Source:
    """Return the columns of one array; raises RecordingError."""
    found = Collector()
    found.add("values", _array(path, "", data))
    return Source(path, "NPY", found.signals, found.unreadable)


def read_npz(path: Path, data: bytes) -> Source:
    """Return every array of an archive; raises RecordingError."""
    found = Collector()
    about: dict[str, Any] = {}
    texts: dict[str, list[str]] = {}
    for name, content in _entries(path, data).items():
        if name == ABOUT:
            about = _about(path, content)
            continue
        try:
            array = _array(path, name, content)
            if array.dtype.kind == "U" and name.lower().strip("_") in OF_COLUMNS:
                texts[name] = array.reshape(-1).tolist()
            found.add(name, array)
        except RecordingError as error:
            found.unreadable[name] = f"cannot be read: {error}"
    signals = _named(found.signals, texts)
    return Source(path, "NPZ", signals, found.unreadable, about=about)


def _named(signals: Mapping[str, Signal], texts: Mapping[str, list[str]]) -> dict[str, Signal]:
    """Return signals with the names of columns that stand in an array of texts beside a matrix."""
    told = dict(signals)
    for names in texts.values():
        matrices = {key.rsplit("[", 1)[0] for key in signals if key.endswith("]")}
        fit = [m for m in matrices if f"{m}[{len(names) - 1}]" in signals]
        fit = [m for m in fit if f"{m}[{len(names)}]" not in signals]
        if len(fit) == 1 and len({*names, *signals}) == len(names) + len(signals):
            renamed = {f"{fit[0]}[{k}]": name for k, name in enumerate(names)}
            told = {
                renamed.get(key, key): replace(one, name=renamed.get(key, key))
                for key, one in told.items()
            }
    return told


def _entries(path: Path, data: bytes) -> dict[str, bytes]:
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            refuse_bomb(path, sum(e.file_size for e in archive.infolist()), len(data))
            return {
                name.removesuffix(".npy"): archive.read(name)
                for name in archive.namelist()
                if name.endswith(".npy")
            }
    except (RecordingError, MemoryError):
        raise
    except Exception as error:  # zipfile raises many types: BadZipFile, zlib.error, struct.error
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
