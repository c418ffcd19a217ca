"""`zwidth diagnose`, with the device file and the recordings, as its command does."""

from contextlib import suppress

import numpy as np

from benchmarks.peer.method import Foretold
from benchmarks.peer.sets import Floats, Set
from zwidth.diagnosis.answer.result import Diagnosis
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.recording.experiment import ExperimentError
from zwidth.diagnosis.selection.effort import QUICK

LINEAR = "linear refit by zwidth"
LAW = "zwidth diagnose, and a law it learned"
SAME = 1e-3  # of the motion, within which two readings of a sample are the same
KNOWN = {
    "emps": "a device file: one mass and its damper, as published; no friction, no offset",
    "silverbox": "a device file: the resonance and its damping; nothing of a cubic part",
    "two_mass_cart": "a device file: two carts on a spring, with dampers, 2.5 times too light;"
    " no friction",
    "coupled_drives": "a device file: two inertias on a belt, guessed, the scale of the volts left"
    " open; no friction, nothing of the sensor",
}


def warm_up(s: Set) -> None:
    """Compile the simulation, by a diagnosis of the beginning of the recording."""
    with suppress(ExperimentError):  # where the device stands still until then
        diagnose(s.device, [s.recordings[0][0].part(0, 2000)], effort=QUICK)


def foretold(s: Set) -> Foretold:
    """Diagnose the recordings, and take the free run of the held-out part from the answer."""
    fit, judge = s.recordings
    found = diagnose(s.device, fit, judge, effort=QUICK)
    named = ", ".join(f"{f.effect} at {f.at}" for f in found.findings) or "no effect"
    also = {LINEAR: _held(s, found, "refit")}
    if found.learned is not None:
        also[LAW] = _held(s, found, "law")
        named += f"; learned: a law over {found.learned.over}"
    return Foretold(_held(s, found, "after"), f"`{found.verdict.value}`: {named}", also)


def _held(s: Set, found: Diagnosis, which: str) -> Floats:
    """The free runs of the held-out part (ticks, o), in the order of the outputs."""
    runs = {run.output: run for run in found.whole_runs if run.held_out}
    columns = [runs[name] for name in s.outputs]
    for o, run in enumerate(columns):
        # A velocity that was taken as counts of an encoder comes back rounded to its steps.
        if not np.allclose(run.measured, s.held.measured[:, o], rtol=0.0, atol=SAME * run.motion):
            raise ValueError(f"the held-out part of {run.output} is not that of the other methods")
    return np.column_stack([run.simulated[which] for run in columns])
