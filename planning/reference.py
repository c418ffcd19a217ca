"""A device on experiments, with all that a linear refit could absorb of an added effect."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.descend import fitted_at
from zwidth.diagnosis.fitting.fit import WORST, Problem
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import likeliest
from zwidth.diagnosis.noise.predictor import (
    SETTLING,
    innovations,
    prepared,
)
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.candidates import Start, candidates
from zwidth.diagnosis.seeking.screen import Complement
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.planning.rehearsal import Noise, known_observer
from zwidth.sim.device import Device, known
from zwidth.sim.physics import EFFECTS
from zwidth.sim.physics.effect import Physics
from zwidth.sim.place import place_at

Floats = NDArray[np.float64]
SMALL = 1e-4  # of a recording's motion: the signature of an effect this small is linear


@dataclass(frozen=True)
class Reference:
    """A device prepared on experiments by `reference`.

    problem: experiments and observer. base (samples,): weighted innovations. jacobian (samples and
    priors, parameters): of the linear refit. absorbed: for each further effect that a refit
    absorbs, its derivative (samples and priors,). peak: the largest command.
    """

    device: Device
    problem: Problem
    base: Floats
    jacobian: Floats
    absorbed: Mapping[str, Floats]
    peak: float
    _off: dict[frozenset[str], Complement] = field(
        default_factory=dict[frozenset[str], Complement], repr=False, compare=False
    )

    @property
    def experiments(self) -> list[Experiment]:
        """The recordings."""
        return self.problem.experiments

    @property
    def ticks(self) -> int:
        """Samples of all recordings together."""
        return sum(e.ticks for e in self.experiments)

    @cached_property
    def starts(self) -> list[Start]:
        """Every further effect that the device could have, at every place and in every shape."""
        return candidates(self.device, self.experiments)

    def off(self, *effects: str) -> Complement:
        """Return the projection off the refit's span; `effects` are left out of the refit."""
        key = frozenset(effects).intersection(self.absorbed)
        if key not in self._off:
            kept = [column for name, column in self.absorbed.items() if name not in key]
            self._off[key] = Complement(np.column_stack([self.jacobian, *kept]))
        return self._off[key]

    def signature(self, physics: Physics) -> Floats:
        """Return e(device with the effect) - e(device), (samples and priors,), not projected."""
        moved = weighted(self.problem, self.device.with_physics(physics)) - self.base
        return np.concatenate([moved, np.zeros(self.jacobian.shape[0] - moved.size)])


def weighted(problem: Problem, device: Device) -> Floats:
    """Return the innovations (samples,) of a device in units of their deviations.

    All are `WORST` if no kernel can simulate the device (a mode too fast for friction's substeps).
    """
    try:
        ready, gain = prepared(device), problem.observer.gain
    except NoObserver:
        samples = sum((e.ticks - SETTLING) * len(e.outputs) for e in problem.experiments)
        return np.full(samples, WORST)
    with np.errstate(all="ignore"):
        out = [innovations(device, e, gain, ready=ready) for e in problem.experiments]
        every = [
            problem.observer.weigh(one, e.uncounted)[SETTLING:]
            for one, e in zip(out, problem.experiments, strict=True)
        ]
        joined = np.concatenate([one.ravel() for one in every])
    return np.clip(np.nan_to_num(joined, nan=WORST, posinf=WORST, neginf=-WORST), -WORST, WORST)


def reference(
    device: Device, experiments: Sequence[Experiment], noise: Noise | None = None
) -> Reference:
    """Prepare a device on experiments.

    device: the best known one; its effects count as known. noise: if it is None, the observer is
    chosen by the likelihood of the recordings under this device, and remaining colour is whitened:
    the recordings must then contain no physics that the device lacks.
    """
    nothing = np.zeros(Model(device).linear_count)
    if noise is None:
        observer = likeliest(experiments, Model(device), nothing).observer
    else:
        observer = known_observer(device, experiments[0], noise)
    # Rounding the predictions as an encoder does would turn every small difference into noise.
    device = device.with_interface(encoder_step=0.0)
    problem, model = Problem(experiments, observer), Model(device)
    jacobian = fitted_at(problem, model, nothing).jacobian
    peak = max(float(np.abs(e.command).max()) for e in experiments)
    bare = Reference(device, problem, weighted(problem, device), jacobian, {}, peak)
    largest = float(np.linalg.norm(jacobian, axis=0).max())
    columns = {p.effect.name: bare.signature(p) for p in _small(device, experiments)}
    scaled = {k: c * largest / float(np.linalg.norm(c)) for k, c in columns.items() if c.any()}
    return replace(bare, absorbed=scaled)


def _small(device: Device, experiments: Sequence[Experiment]) -> list[Physics]:
    """The further effects that a refit absorbs, so small that their signatures are linear.

    A device with a spring to ground needs no further spring and no constant force: its refit has
    the same freedom in that spring and in the recording's origin.
    """
    sizes = sizes_of(device, experiments)
    found: list[Physics] = []
    for effect in EFFECTS.values():
        place = place_at(effect.places[0])
        if effect.absorbed and not known(effect, place, device):
            values = {effect.strength or "": SMALL * effect.natural(sizes, place)}
            found.append(Physics(effect, str(place), values))
    return found
