"""Calibration of stated probabilities: of the statements with 0.9, nine in ten should be true.

The expected calibration error is the mean over all statements of |share that is true - mean of the
stated probabilities|, taken in bins of probability (Naeini, Cooper & Hauskrecht, AAAI 2015).
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from zwidth.exam.share import share

EDGES = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)


def calibration(stated: Sequence[tuple[float, bool]]) -> dict[str, Any]:
    """Return the number of statements, the share that is true per bin, and the expected error."""
    said = np.array([p for p, _ in stated])
    so = np.array([right for _, right in stated], dtype=np.bool_)
    place = np.clip(np.searchsorted(EDGES, said, side="right") - 1, 0, len(EDGES) - 2)
    table: list[dict[str, Any]] = []
    error = 0.0
    for i, (low, high) in enumerate(pairwise(EDGES)):
        here = place == i
        if not here.any():
            continue
        mean = float(said[here].mean())
        seen = share(so[here].tolist())
        table.append({"from": low, "to": high, "said": mean, "seen": seen.as_json()})
        error += abs(mean - float(so[here].mean())) * int(here.sum()) / said.size
    return {
        "statements": int(said.size),
        "table": table,
        "expected_error": error if said.size else None,
    }
