"""Seconds of a run to MCAP log times and back, bit for bit.

log_time = epoch + n with n = round(t 1e9) [ns]; the residual r = t - n/1e9 is stored beside it.
|r| <= 0.5 ns, so n/1e9 lies within a factor of two of t (or is zero): by Sterbenz's lemma the
difference is exact, and n/1e9 + r returns every bit of t (-0.0 as 0.0). On a clock of whole
microseconds r is zero or one unit in the last place, and compresses far better than t itself.
"""

import numpy as np
from numpy.typing import NDArray

from zwidth.logs.errors import LogBlockError

Floats = NDArray[np.float64]
LONGEST = 9.2e9  # seconds that 63 bits of nanoseconds can count


def to_log_time(t: Floats, epoch_ns: int) -> tuple[NDArray[np.uint64], Floats]:
    """Return (log times [ns], residuals [s]); raises LogBlockError for times out of range."""
    inside = np.abs(t) < LONGEST  # False for NaN too
    if not inside.all():
        bad = t[np.argmin(inside)]
        raise LogBlockError(f"a time is {bad} s; a log holds finite times below 292 years")
    nanoseconds = np.rint(t * 1e9).astype(np.int64)
    for n in (nanoseconds.min(), nanoseconds.max()) if t.size else ():
        if not 0 <= epoch_ns + int(n) < 2**63:
            raise LogBlockError(
                f"{n / 1e9:g} s after epoch_ns {epoch_ns} is not a log time; these run from 1970"
                " to 2262, so choose another epoch"
            )
    return (nanoseconds + epoch_ns).view(np.uint64), t - nanoseconds / 1e9


def from_log_time(log_time: NDArray[np.uint64], residual: Floats, epoch_ns: int) -> Floats:
    """Return the times [s] that `to_log_time` was given."""
    return (log_time.view(np.int64) - epoch_ns) / 1e9 + residual
