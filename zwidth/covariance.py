"""The covariance of identified parameters as a file, written by `zwidth identify`."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from zwidth.files.protection import reading
from zwidth.files.whole import json_text, write_text

Floats = NDArray[np.float64]
SCHEMA = 1


class Covariance(NamedTuple):
    """names (p,): m, b, omega_1, ...; values (p, p), of logarithms, of a delay [s] itself."""

    names: tuple[str, ...]
    values: Floats


class _File(msgspec.Struct, forbid_unknown_fields=True):
    schema: int
    names: list[str]
    covariance: list[list[float]]


def save_covariance(path: Path, names: Sequence[str], values: Floats) -> Path:
    """Write the file; returns the path. Raises OSError, ValueError for NaN."""
    known = _File(SCHEMA, list(names), values.tolist())
    return write_text(path, json_text(msgspec.to_builtins(known)))


def load_covariance(path: Path) -> Covariance:
    """Read the file; raises OSError, ValueError (one sentence) for any other content."""
    try:
        known = msgspec.json.decode(reading(path).read_bytes(), type=_File)
        values = np.array(known.covariance, dtype=np.float64)
    except (msgspec.DecodeError, ValueError) as error:
        raise ValueError(
            f"{path} is not a covariance file ({error}); give the one that `zwidth identify` wrote"
        ) from error
    if known.schema != SCHEMA:
        raise ValueError(f"{path} has schema {known.schema}; this version reads schema {SCHEMA}")
    if values.shape != (len(known.names),) * 2:
        raise ValueError(
            f"{path} has {len(known.names)} names and a covariance of shape {values.shape}; they"
            " must have the same size: write it again with `zwidth identify`"
        )
    return Covariance(tuple(known.names), values)
