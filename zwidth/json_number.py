"""Numbers for JSON, which has no nan and no inf."""

import math


def json_number(value: float | None) -> float | str | None:
    """Return the number; "nan", "inf" or "-inf" as text."""
    return value if value is None or math.isfinite(value) else repr(float(value))
