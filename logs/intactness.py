"""The damage of a log, in sentences."""

from collections.abc import Sequence

from zwidth.logs.framing import Damage, Walk
from zwidth.logs.reading import Reading
from zwidth.logs.schema import ENDED
from zwidth.logs.summary import Summary
from zwidth.sim.trace import Trace

MOST_SENTENCES = 5


def skipped(damages: Sequence[Damage], inconsistent: Sequence[str]) -> list[str]:
    """Return a sentence for each of the first few damaged places, and one for the others."""
    sentences = [f"bytes {d.start} to {d.stop - 1} were skipped: {d.reason}" for d in damages]
    sentences += [f"skipped: {reason}" for reason in inconsistent]
    if len(sentences) > MOST_SENTENCES:
        sentences[MOST_SENTENCES:] = [f"{len(sentences) - MOST_SENTENCES} further such places"]
    return sentences


def ending(
    walk: Walk, summary: Summary | None, reading: Reading, tick: Trace, size: int
) -> list[str]:
    """Return sentences on how the file ends, and on checksums over all of it."""
    sentences: list[str] = []
    if not walk.ended:
        unfinished = 0 if walk.cut_at is None else size - walk.cut_at
        cut = f", its last {unfinished} bytes are unfinished" if unfinished else ""
        until = f"up to t = {tick.t[-1]:.9g} s" if len(tick) else "without a sample"
        sentences.append(
            f"the log was not closed{cut}: the run was killed or goes on, or the file was cut"
            f" short; it is here {until}"
        )
    elif summary is None:
        sentences.append(
            "the index at the end of the file is missing or damaged; no sample is lost with it"
        )
    if walk.ended and not walk.checksum_holds and not walk.damages:
        doubt = "no sample did" if reading.all_checked else "it is not known what"
        sentences.append(
            f"the checksum over the whole log is wrong: something in it changed, {doubt}"
        )
    if ENDED in reading.metadata:
        sentences.append(f"the run ended {reading.metadata[ENDED]}")
    return sentences
