"""Shares with their exact intervals, and quantiles of what is known."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest


@dataclass(frozen=True)
class Share:
    """right of count, with the exact 95 % interval of the share (None of nothing)."""

    right: int
    count: int

    @property
    def share(self) -> float | None:
        """The share itself."""
        return self.right / self.count if self.count else None

    @property
    def interval(self) -> tuple[float, float] | None:
        """Clopper & Pearson, Biometrika 26, 1934."""
        if self.count == 0:
            return None
        found = binomtest(self.right, self.count).proportion_ci(0.95, method="exact")
        return float(found.low), float(found.high)

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {"right": self.right, "count": self.count, "share": self.share,
                "ci95": self.interval}  # fmt: skip


def share(of: Iterable[bool]) -> Share:
    """Return how many are true."""
    values = list(of)
    return Share(sum(values), len(values))


def quantiles(values: Sequence[float | None]) -> dict[str, Any]:
    """Return count, median, lower quartile and tenth of the values that are known and finite."""
    known = [v for v in values if v is not None and np.isfinite(v)]
    if not known:
        return {"count": 0, "median": None, "lower_quartile": None, "tenth": None}
    tenth, lower, median = np.quantile(known, (0.1, 0.25, 0.5)).tolist()
    return {"count": len(known), "median": median, "lower_quartile": lower, "tenth": tenth}
