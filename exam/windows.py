"""Where free runs begin on held-out data: half a second each, once an observer has settled."""

from zwidth.diagnosis.noise.predictor import SETTLING

SECONDS = 0.5
FITTED = 0.7  # share of a recording that is fitted to, where none is there to judge by


def cut(ticks: int) -> int:
    """Return the first sample that is held out."""
    return round(FITTED * ticks)


def window_of(ticks: int, period: float) -> int:
    """Return the ticks of a window: a third of all, where that is less."""
    return min(round(SECONDS / period), ticks // 3)


def window_starts(ticks: int, window: int) -> list[int]:
    """Return the first tick of each window in so many samples."""
    return [f for f in range(0, ticks - window + 1, window) if f >= SETTLING]
