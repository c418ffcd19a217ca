"""Corrects a guess of a proportional speed loop, if the loop integrates its error.

An integrating loop follows its goal without a lasting error, unlike a proportional one. Both are
fitted to goal and speed (`identification.first_loop`); if the integrating one leaves less than half
of the error, the description gets its integral time.

A diagnosis holds the integral of the goal at its mean over each sample, although it rises by g T.
The difference, g (T / 2 - s) at s in the sample, changes the speed at the samples by -K T^2 / 12
times the speed, for m = 1. If this is significant, a sentence says so.
"""

import math
import re
import tomllib
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from zwidth.identification.first_loop import SpeedLoop, speed_loop
from zwidth.logs.assumed import SPEED_GOAL, Assumed
from zwidth.logs.recording import read_source
from zwidth.logs.recording_file import description_of
from zwidth.logs.source import Source
from zwidth.logs.stretches import longest_stretch
from zwidth.logs.timing import examine

SPEED = "velocity_m1"
LOW = 1e-3  # of the speed: a smaller effect of the hold is not mentioned
WORTH = 0.5  # largest ratio of an integrating loop's error to a proportional one's, to choose it


def with_integral(guess: Assumed, source: Source) -> Assumed:
    """Return a guess with the integral time of its speed loop, if the numbers show one."""
    said = tomllib.loads(guess.text)
    doubt = next((d for d in guess.doubts if SPEED_GOAL in d), None)
    if doubt is None or all(one["quantity"] != "velocity" for one in said["output"]):
        return guess
    loop: SpeedLoop | None = None
    period = 0.0
    with suppress(ValueError):  # too short or too broken for a fit: it stays proportional
        loop, period = _loop(guess.text, source)
    if loop is None or loop.integral_time <= 0.0 or loop.error >= WORTH * loop.proportional:
        return guess
    time = float(f"{loop.integral_time:.4g}")
    told = (
        f"{said['input']['signal']} {SPEED_GOAL}: a loop that integrates is taken, of an integral"
        f" time of {time:g} s ({100.0 * loop.error:.3g} % of the motion is left in a free run, and"
        f" {100.0 * loop.proportional:.3g} % without the integral); its gains are fitted, and"
        " forces are counted in them"
    )
    if (low := loop.stiffness * period**2 / 12.0) > LOW:
        told += (
            f"; it is stiff against the sampling: the simulated speed is {100.0 * low:.2g} % too"
            " low, and effects of that size may be none; record at"
            f" {math.ceil(math.sqrt(low / LOW) / period):g} Hz or more"
        )
    text = re.sub(
        r"(?m)^(\[input\].*\n(?:.+\n)*?)scale = .*$",
        rf"\g<1>integral_time_s = {time!r} # proportional over integral gain",
        guess.text,
        count=1,
    )
    return replace(
        guess,
        text=_without_position(text),
        doubts=[told if one == doubt else one for one in guess.doubts],
    )


def _loop(text: str, source: Source) -> tuple[SpeedLoop, float]:
    trace = read_source(description_of(text.encode(), Path("guess.recording.toml")), source)
    used, _ = longest_stretch(trace, ("command", SPEED), "the recording")
    period = examine(used.t).period
    return speed_loop(used["command"], used[SPEED], period), period


def _without_position(text: str) -> str:
    """Leave out the position: it is counted from elsewhere than the integral of the goal is."""
    blocks = re.split(r"\n(?=\[)", text)
    return "\n".join(b for b in blocks if 'quantity = "position"' not in b).rstrip("\n") + "\n"
