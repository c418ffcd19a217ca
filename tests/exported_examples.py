"""Logs that are written as files of other tools."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from log_examples import ATTACHMENTS, EPOCH, EVENTS, METADATA, example

from zwidth.logs.mcap_reader import Log
from zwidth.sim.trace import Trace

HERE = Path("run")


def full_log(samples: int = 30) -> Log:
    """Return a log with everything that a log can hold."""
    tick = example(samples)
    fine = replace(example(4 * samples, seed=1), t=0.00025 * np.arange(4.0 * samples))
    metadata = {"origin": "simulated", **METADATA}
    return Log(HERE, tick, fine, EVENTS, metadata, ATTACHMENTS, "zwidth", EPOCH, ())


def bare_log(trace: Trace) -> Log:
    return Log(HERE, trace, None, (), {}, {}, "zwidth", 0, ())
