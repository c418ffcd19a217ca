"""Messages missing from a topic, found by the sequence counter in each message."""

import numpy as np
from numpy.typing import NDArray

from zwidth.logs.layout import Floats

MOST_SENTENCES = 5
BACKWARDS = 1 << 31  # of 2^32: a larger step means that the counter went back


def gaps(topic: str, sequence: NDArray[np.uint32], t: Floats, expected: int | None) -> list[str]:
    """Return a sentence for each gap or repetition in one topic.

    sequence (n,), t (n,) [s]. expected: the number of messages that the file states. If all
    counters are 0, there is no counter, and only the number of messages is checked.
    """
    if sequence.size == 0:
        return [f"{topic}: all {expected} samples are missing"] if expected else []
    counted = bool(sequence.any()) or sequence.size == 1
    sentences, missing = list[str](), 0
    if counted:
        steps = np.diff(sequence)  # unsigned: wraps as the counter does
        if sequence[0] != 0:
            missing += int(sequence[0])
            sentences.append(f"{topic}: {_samples(missing)} before t = {t[0]:.9g} s")
        for i in np.flatnonzero(steps != 1).tolist():
            step = int(steps[i])
            if 0 < step < BACKWARDS:
                missing += step - 1
                sentences.append(
                    f"{topic}: {_samples(step - 1)} between t = {t[i]:.9g} s and {t[i + 1]:.9g} s"
                )
            else:
                sentences.append(
                    f"{topic}: the counter of samples goes back at t = {t[i + 1]:.9g} s"
                )
    rest = 0 if expected is None else expected - sequence.size - missing
    if len(sentences) > MOST_SENTENCES:
        more = len(sentences) - MOST_SENTENCES
        sentences[MOST_SENTENCES:] = [f"{topic}: {more} further such gaps"]
    if rest > 0:
        where = f"after t = {t[-1]:.9g} s" if counted else "somewhere"
        sentences.append(f"{topic}: {_samples(rest)} {where}")
    return sentences


def _samples(count: int) -> str:
    return "1 sample is missing" if count == 1 else f"{count} samples are missing"
