"""What to know before using an answer: free runs far above their noise, or worse than before."""

import math

from zwidth.diagnosis.answer.adequacy import Adequacy, wander
from zwidth.diagnosis.answer.result import Finding, HeldOut
from zwidth.diagnosis.answer.whole_run import WholeRun
from zwidth.sim.predict import OVERFLOW
from zwidth.sim.readable import of_the_motion, percent, plain, with_unit

WORSE = 1.2  # times the error of the device file, from which an answer makes a simulation worse


def cautions(
    findings: tuple[Finding, ...],
    free: HeldOut,
    sound: Adequacy | None,
    whole: tuple[WholeRun, ...],
) -> tuple[str, ...]:
    """Return the warnings of an answer, each a sentence without its full stop.

    free, sound, whole: free runs over windows, beside their own noise, and over whole recordings.
    """
    by = "what was found" if findings else "the refitted parameters"
    said: list[str] = []
    if free.after > WORSE * free.before:
        said.append(
            f"with {by} free runs on held-out data have an error of {of_the_motion(free.after)},"
            f" more than with the device file as it is ({percent(free.before)}): do not simulate"
            " with the augmented device"
        )
    elif wander(free.after, free.noise_floor):
        said.append(
            f"free runs on held-out data still have an error of {of_the_motion(free.after)},"
            f" where measurement noise alone would cause {percent(free.noise_floor)} (device file:"
            f" {percent(free.before)})"
        )
    if sound is not None and not sound.sound:
        worst = max(sound.ahead, key=lambda a: a.error / a.most)
        if worst.error >= OVERFLOW:
            said.append("free runs with the answer diverge")
        elif worst.error > worst.most:
            said.append(
                f"the error of free runs over {with_unit(worst.horizon, 's', 3)} is"
                f" {plain(worst.error / worst.expected, 3)} times what their own noise would cause"
            )
    for run in whole:
        before, after = run.errors["before"], run.errors["after"]
        if after > WORSE * before and not free.after > WORSE * free.before:
            size = "without bound" if math.isinf(after) else with_unit(after, run.unit, 3)
            said.append(
                f"over the whole run the error of the {run.output.replace('_', ' of ')} in"
                f" {run.recording} is {size} with {by}, more than with the device file as it is"
                f" ({with_unit(before, run.unit, 3)})"
            )
    return tuple(said)
