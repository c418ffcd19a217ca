"""The next recording to make, to tell two effects that look alike apart.

Every excitation of the library is simulated on the fitted device, and the two effects are compared
on it at their fitted values: |s_a - s_b(p) - J x| with b's parameters p and the refit x fitted, and
with a and b exchanged. The chosen excitation is the one for which the smaller of the two distances
is largest. It is as strong and as long as the recording, with half as much again of travel.
"""

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from zwidth.diagnosis.answer.result import NextExperiment
from zwidth.diagnosis.mishaps import isolated
from zwidth.diagnosis.noise.predictor import Observer
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.candidates import Start
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.planning.excitations import (
    LIBRARY,
    NoExcitation,
    Scale,
    excitation,
    save_scenario,
    scale_for,
)
from zwidth.planning.reference import Reference, reference
from zwidth.planning.rehearsal import RunsAway, noise_of, rehearse
from zwidth.planning.separation import separation
from zwidth.sim.device import Device, place_label
from zwidth.sim.physics.effect import Physics

SHORTEST_S, LONGEST_S = 10.0, 60.0
TELLING = 1.0  # sigma below which an excitation does not help


def next_experiment(
    device: Device,
    a: Physics,
    b: Physics,
    experiments: Sequence[Experiment],
    observer: Observer,
    out: Path,
    scale: Scale | None = None,
    seed: int = 0,
) -> NextExperiment | None:
    """Choose the excitation that separates two effects best, and write it to `out`, a TOML path.

    device: as fitted, without a and b; a, b: each with the values that explain the recording.
    experiments, observer: of the diagnosis; they give the strength and the noise of the rig.
    Returns None if no excitation of the library tells the effects apart.
    """
    noise = noise_of(device, experiments[0], observer)
    scale = scale or scale_for(device, experiments)
    outputs = experiments[0].outputs
    longest = max(e.ticks for e in experiments) * device.interface.period
    seconds = min(LONGEST_S, max(SHORTEST_S, longest))

    def distance(name: str) -> float:
        try:
            command = excitation(name, device, seconds, scale, seed)
            played = rehearse(device, command, noise, outputs=outputs, seed=seed, name=name)
            prepared = reference(device, [played], noise)
        except (NoExcitation, RunsAway, NoObserver):  # too short for the band of a slow device
            return 0.0
        return min(_apart(prepared, a, b), _apart(prepared, b, a))

    def kept(name: str) -> float:
        with isolated("next experiment", name):
            return distance(name)
        return 0.0

    found = in_parallel([partial(kept, name) for name in LIBRARY], threads())
    sigmas = dict(sorted(zip(LIBRARY, found, strict=True), key=lambda pair: -pair[1]))
    best = next(iter(sigmas))
    if not sigmas[best] > TELLING:
        return None
    path = save_scenario(device, excitation(best, device, seconds, scale, seed), out)
    return NextExperiment(best, path, (place_label(a), place_label(b)), sigmas[best], sigmas)


def _apart(prepared: Reference, true: Physics, rival: Physics) -> float:
    """Distance of one effect from its best imitation by the other, over several starts."""
    label = place_label(rival)
    others = [s for s in prepared.starts if s.label == label]
    free = {k for start in others for k, scale in start.scales.items() if scale != 0.0}
    kept = free or set(rival.values)
    own = Start(rival, {k: _scale(rival, k) for k in kept}, others[0].bounds if others else {})
    return separation(prepared, true, [own, *others])[label]


def _scale(physics: Physics, name: str) -> float:
    value = abs(physics.values[name])
    return value if value > 0.0 else float(np.finfo(np.float32).eps)
