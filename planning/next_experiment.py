"""The next recording to make, which distinguishes two effects that look alike.

Every excitation of the library is simulated on the fitted device, and the two effects are compared
on it at their fitted values: |s_a - s_b(p) - J x| with b's parameters p and the refit x fitted, and
with a and b exchanged. The chosen excitation is the one for which the smaller of the two distances
is largest. It is as strong and as long as the recording, with half as much again of travel.

A distance below 1, or below the best so far, does not help: it is not computed to the end, and an
upper limit is reported for these excitations.
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

    def prepared(name: str) -> Reference | None:
        try:
            command = excitation(name, device, seconds, scale, seed)
            played = rehearse(device, command, noise, outputs=outputs, seed=seed, name=name)
            return reference(device, [played], noise)
        except (NoExcitation, RunsAway, NoObserver):  # too short for the band of a slow device
            return None

    def first(name: str) -> tuple[float, Reference | None]:
        with isolated("next experiment", name):
            played = prepared(name)
            return (0.0 if played is None else _apart(played, a, b, TELLING)), played
        return 0.0, None

    every = in_parallel([partial(first, name) for name in LIBRARY], threads())
    found = dict(zip(LIBRARY, every, strict=True))
    limits, most = {name: sigma for name, (sigma, _) in found.items()}, TELLING
    for name in sorted(LIBRARY, key=lambda n: -limits[n]):
        played = found[name][1]
        if played is None or limits[name] <= most:
            continue
        limit, limits[name] = limits[name], 0.0  # 0 if an error prevents the second distance
        with isolated("next experiment", name):
            limits[name] = min(limit, _apart(played, b, a, most))
        most = max(most, limits[name])
    sigmas = dict(sorted(limits.items(), key=lambda pair: -pair[1]))
    best = next(iter(sigmas))
    if not sigmas[best] > TELLING:
        return None
    path = save_scenario(device, excitation(best, device, seconds, scale, seed), out)
    return NextExperiment(best, path, (place_label(a), place_label(b)), sigmas[best], sigmas)


def _apart(prepared: Reference, true: Physics, rival: Physics, enough: float) -> float:
    """Distance of one effect from its best imitation by the other, over several starts.

    An upper limit of it if it is not more than `enough`.
    """
    label = place_label(rival)
    others = [s for s in prepared.starts if s.label == label]
    free = {k for start in others for k, scale in start.scales.items() if scale != 0.0}
    kept = free or set(rival.values)
    own = Start(rival, {k: _scale(rival, k) for k in kept}, others[0].bounds if others else {})
    return separation(prepared, true, [own, *others], enough=enough)[label]


def _scale(physics: Physics, name: str) -> float:
    value = abs(physics.values[name])
    return value if value > 0.0 else float(np.finfo(np.float32).eps)
