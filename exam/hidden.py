"""A concealed effect, and the rig without it, in which it is to be concealed."""

from dataclasses import dataclass

import numpy as np

from zwidth.diagnosis.recording.experiment import Experiment, experiment
from zwidth.exam.strata import Stratum
from zwidth.planning.reference import Reference
from zwidth.scenarios.concealed.rig import Rig
from zwidth.scenarios.concealed.shapes import Motion
from zwidth.sim.device import Device
from zwidth.sim.trace import Trace

SEEN = 5.0  # sigma at which an effect is at its limit


@dataclass(frozen=True)
class Hidden:
    """A concealed effect: its magnitude, and the ratio of that to the limit.

    sigma: its distance from what a refit absorbs; sigma_beside: the same beyond what the magnitudes
    of the other concealed effects absorb as well. rivals: effect@place -> its distance from this
    effect, in sigma, up to `NEAR`, nearest first.
    """

    effect: str
    at: str
    values: dict[str, float]
    magnitude: float | None
    times_limit: float
    sigma: float
    sigma_beside: float
    rivals: dict[str, float]


@dataclass(frozen=True)
class Stage:
    """A rig with nothing concealed yet, the reference for its limits, and its motion."""

    rig: Rig
    known: Reference
    motion: Motion


def seen(trace: Trace, device: Device) -> Experiment:
    """Return a trace as an experiment for a diagnosis."""
    return experiment(trace, device)


def draw_times(random: np.random.Generator, stratum: Stratum) -> float:
    """Return how many times the limit an effect is to have, log-uniform."""
    low, high = np.log(stratum.least), np.log(stratum.most)
    return float(np.exp(random.uniform(low, high)))
