"""A rig at full size: a machine that plays, up to five effects of it, each to be seen alone.

All of it follows from a seed and an index.
"""

from collections.abc import Sequence

import numpy as np

from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import ExperimentError
from zwidth.diagnosis.seeking.magnitude import magnitude
from zwidth.exam.machines import log_uniform
from zwidth.exam.odds import SHARES, choose, sized
from zwidth.exam.stages import OWN, Engine, Stage, device_file, draw_stage
from zwidth.exam.subject import Present, Subject
from zwidth.exam.visible import standing
from zwidth.scenarios.concealed.rig import Made, RunAway
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

CLEAN_SHARE = 0.15
MOST_EFFECTS = 5
VISIBLE = 25.0  # sigma, without any one effect
TRIES, REDRAWN = 100, 6
FAILURES = (RunAway, NoObserver, ExperimentError)  # with which another rig is drawn

Sized = list[tuple[Physics, float]]


def draw_rig(
    seed: int, index: int, effects: int | None = None, seconds: float | None = None,
    engine: Engine = OWN,
) -> Subject:  # fmt: skip
    """Return rig number `index` of a seed.

    effects: how many it has, drawn where None (none in a clean share, else one to five equally
    often). seconds: length of each recording, drawn from 6 to 30 s where None. engine: what moves
    it. Raises ValueError where no rig was found that shows so many.
    """
    random = np.random.default_rng([seed, index, engine.stream])
    count = _count(random) if effects is None else effects
    for _ in range(TRIES):
        try:
            found = _try(random, count, seconds, engine)
        except FAILURES:
            continue
        if found is not None:
            return found
    raise ValueError(f"no rig was found for index {index} of seed {seed}; try another")


def _count(random: np.random.Generator) -> int:
    if random.random() < CLEAN_SHARE:
        return 0
    return int(random.integers(1, MOST_EFFECTS + 1))


def _try(
    random: np.random.Generator, count: int, seconds: float | None, engine: Engine
) -> Subject | None:
    stage = draw_stage(random, seconds, engine)
    found = None if stage is None else with_effects(random, stage, count)
    if stage is None or found is None:
        return None
    made, hidden = found
    nominal, kind = device_file(random, stage, stage.seen(made))
    traces = tuple(m.trace for m in made)
    physics = [make_physics(h.effect, h.at, **h.values) for h in hidden]
    truth = stage.machine.device.with_physics(*physics)
    return Subject(
        engine.stratum, traces[: stage.fitted], traces[stage.fitted :], nominal, truth, hidden,
        kind, stage.about(),
    )  # fmt: skip


def with_effects(
    random: np.random.Generator, stage: Stage, count: int
) -> tuple[list[Made], tuple[Present, ...]] | None:
    """Return the recordings of a stage with so many effects, and these.

    An effect that does not show is drawn again while the others stay; None if one never shows.
    """
    found: Sized = []
    for _ in range(REDRAWN):
        if not _filled(random, stage, found, count):
            return None
        physics = [p for p, _ in found]
        if not stage.engine.whole(stage.machine.device.with_physics(*physics)):
            found = []
            continue
        made = [stage.engine.film(s) for s in stage.with_physics(physics)]
        sigmas = standing(stage.machine.device, physics, stage.seen(made), stage.noise, VISIBLE)
        if all(s >= VISIBLE for s in sigmas):
            return made, _present(stage, found, sigmas)
        found = [f for f, s in zip(found, sigmas, strict=True) if s >= VISIBLE]
    return None


def _filled(random: np.random.Generator, stage: Stage, found: Sized, count: int) -> bool:
    """Draw effects until this many are drawn; return whether that succeeded."""
    for _ in range(REDRAWN * count):
        if len(found) == count:
            break
        device = stage.machine.device
        chosen = choose(
            random, device, [(p.effect.name, p.at) for p, _ in found], stage.engine.effects
        )
        if chosen is None:
            return False
        share = log_uniform(random, *SHARES)
        physics = sized(random, *chosen, device, stage.motion, share)
        if physics is not None:
            found.append((physics, share))
    return len(found) == count


def _present(stage: Stage, found: Sized, sigmas: Sequence[float]) -> tuple[Present, ...]:
    peak = stage.motion.peak
    return tuple(
        Present(p.effect.name, p.at, dict(p.values), magnitude(p, peak), share, sigma)
        for (p, share), sigma in zip(found, sigmas, strict=True)
    )
