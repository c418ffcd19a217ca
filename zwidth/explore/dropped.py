"""A recording dropped into the page: files as the browser sends them, in a separate folder."""

import base64
import binascii
import os
from collections.abc import Sequence
from pathlib import Path, PurePosixPath, PureWindowsPath
from tempfile import TemporaryDirectory

from zwidth.door import taken
from zwidth.logs.recording_file import load_description
from zwidth.sim.trace import Trace


def read_dropped(names: Sequence[str], contents: Sequence[str]) -> tuple[Trace, list[str]]:
    """Return the recording in files that were dropped together, and the assumptions about it.

    contents are base64. One file, of zwidth or of another tool, whose content is then guessed; or a
    description (TOML) and the file that it describes. Only these files are opened, whatever the
    description names. Raises ValueError with a sentence.
    """
    if len(names) != len(contents) or not names:
        raise ValueError("no file arrived; drop a recording again")
    with TemporaryDirectory(prefix="zwidth-") as folder:
        paths = [
            _written(Path(folder), name, text) for name, text in zip(names, contents, strict=True)
        ]
        try:
            trace, said = taken(_chosen(paths))
        except ValueError as error:
            raise ValueError(str(error).replace(f"{folder}{os.sep}", "")) from None
    missing = {"position_m1", "command"} - set(trace.channels)
    if missing == {"position_m1", "command"}:
        raise ValueError(
            f"{paths[0].name} holds neither position_m1 nor command; there are"
            f" {', '.join(trace.channels)}"
        )
    return trace, said


def _written(folder: Path, name: str, text: str) -> Path:
    plain = PureWindowsPath(PurePosixPath(name).name).name
    if plain in ("", ".", "..") or "\0" in plain:
        raise ValueError(f"{name[:40]!r} is not a file name; rename it and drop it again")
    try:
        content = base64.b64decode(text, validate=True)
    except binascii.Error:
        raise ValueError(f"{plain} did not arrive whole; drop it again") from None
    path = folder / plain
    path.write_bytes(content)
    return path


def _chosen(paths: Sequence[Path]) -> Path:
    described = [p for p in paths if p.suffix.lower() == ".toml"]
    if len(described) > 1 or (not described and len(paths) > 1):
        raise ValueError(
            "drop one recording: a file of data, or a description (.toml) together with the file"
            " that it describes"
        )
    if not described:
        return paths[0]
    named = load_description(described[0]).file
    if named not in {p.name for p in paths}:
        raise ValueError(
            f"{described[0].name} describes {named}, which was not dropped with it; drop both"
            " together, from one folder"
        )
    return described[0]
