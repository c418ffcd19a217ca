"""A rig at full size: a machine, up to five effects, one or two recordings and maybe one to judge.

All of it follows from a seed and an index.
"""

from dataclasses import dataclass, replace

import numpy as np

from zwidth.diagnosis.experiment import Experiment, experiment
from zwidth.diagnosis.rehearsal import Noise
from zwidth.diagnosis.settle import refit
from zwidth.diagnosis.steady import NoObserver
from zwidth.exam.filming import Camera, Scene, draw_camera, film
from zwidth.exam.machines import Machine, draw_machine, guessed, log_uniform
from zwidth.exam.odds import SHARES, choose, sized
from zwidth.exam.playing import draw_playing
from zwidth.exam.visible import standing
from zwidth.scenarios.concealed.rig import RunAway
from zwidth.scenarios.concealed.shapes import Motion, motion_of
from zwidth.sim.device import Device
from zwidth.sim.physics.effect import Physics
from zwidth.sim.trace import Trace

CLEAN_SHARE = 0.15
MOST_EFFECTS = 5
SHORTEST, LONGEST = 6.0, 30.0  # s
TWO_SHARE, VALIDATED_SHARE = 1.0 / 3.0, 1.0 / 3.0
LEVELS = (0.35, 0.7)  # of another recording's level, or over it
FITTED_SHARE, EXACT_SHARE = 0.25, 0.15  # of device files
VISIBLE = 25.0  # sigma, without any one effect
TRIES, REDRAWN = 60, 6
STREAM = 17  # tells these seeds from those of other recordings


@dataclass(frozen=True)
class Present:
    """An effect that a rig has. share: of the command or travel; sigma: what its lack costs."""

    effect: str
    at: str
    values: dict[str, float]
    share: float
    sigma: float


@dataclass(frozen=True)
class FullRig:
    """A rig, what was recorded of it, and everything that is kept from whoever gets it.

    traces and judged: recordings to fit and to judge by; levels of both, in this order.
    device_file: "guessed", "fitted" or "exact".
    """

    traces: tuple[Trace, ...]
    judged: tuple[Trace, ...]
    nominal: Device
    truth: Device
    hidden: tuple[Present, ...]
    scenes: tuple[Scene, ...]
    levels: tuple[float, ...]
    device_file: str

    @property
    def experiments(self) -> list[Experiment]:
        """The recordings to fit, as a diagnosis takes them."""
        return [experiment(t, self.nominal, f"r{i + 1}") for i, t in enumerate(self.traces)]

    @property
    def validation(self) -> list[Experiment] | None:
        """The recordings to judge by, None where the rig has none."""
        found = [experiment(t, self.nominal, f"v{i + 1}") for i, t in enumerate(self.judged)]
        return found or None


def draw_rig(
    seed: int, index: int, effects: int | None = None, seconds: float | None = None
) -> FullRig:
    """Return rig number `index` of a seed.

    effects: how many it has, drawn where None (none in a clean share, else one to five equally
    often). seconds: length of each recording, drawn from 6 to 30 s where None. Raises ValueError
    where no rig was found that shows so many.
    """
    random = np.random.default_rng([seed, index, STREAM])
    count = _count(random) if effects is None else effects
    for _ in range(TRIES):
        try:
            found = _try(random, count, seconds)
        except (RunAway, NoObserver):
            continue
        if found is not None:
            return found
    raise ValueError(f"no rig was found for index {index} of seed {seed}; try another")


def _count(random: np.random.Generator) -> int:
    if random.random() < CLEAN_SHARE:
        return 0
    return int(random.integers(1, MOST_EFFECTS + 1))


@dataclass(frozen=True)
class Stage:
    """A machine that plays, without physics yet: scenes to fit, then those to judge by."""

    machine: Machine
    scenes: tuple[Scene, ...]
    fitted: int
    levels: tuple[float, ...]

    def with_physics(self, physics: list[Physics]) -> list[Scene]:
        """Return the scenes with effects."""
        device = self.machine.device.with_physics(*physics)
        return [replace(s, device=device) for s in self.scenes]


def _stage(random: np.random.Generator, seconds: float | None) -> Stage:
    machine = draw_machine(random)
    two, validated = random.random() < TWO_SHARE, random.random() < VALIDATED_SHARE
    duration = seconds or log_uniform(random, SHORTEST, LONGEST)
    playing = draw_playing(random, machine, duration)
    camera = draw_camera(random, machine)
    levels, playings = [1.0], [playing]
    for _ in range(int(two) + int(validated)):
        factor = log_uniform(random, *LEVELS)
        levels.append(factor if random.random() < 0.5 else 1.0 / factor)
        again = draw_playing(random, machine, duration) if random.random() < 0.3 else playing
        playings.append(again.louder(levels[-1]))
    seeds = [int(random.integers(2**62)) for _ in playings]
    scenes = [Scene(machine.device, p, camera, s) for p, s in zip(playings, seeds, strict=True)]
    size = float(np.sqrt(np.mean(film(scenes[0]).trace["command"] ** 2)))
    camera = replace(camera, process=camera.process * size)
    return Stage(
        machine, tuple(replace(s, camera=camera) for s in scenes), 1 + int(two), tuple(levels)
    )


def _try(random: np.random.Generator, count: int, seconds: float | None) -> FullRig | None:
    stage = _stage(random, seconds)
    bare = stage.machine.device
    motion = motion_of(film(stage.scenes[0]), bare)
    found: list[tuple[Physics, float]] = []
    for _ in range(REDRAWN):
        while len(found) < count:
            drawn = _drawn(random, bare, motion, [p for p, _ in found])
            if drawn is None:
                return None
            found.append(drawn)
        physics = [p for p, _ in found]
        scenes = stage.with_physics(physics)
        made = [film(s) for s in scenes]
        nominal = replace(bare, name="device under test", source="")
        seen = [replace(experiment(m.trace, nominal), dropped=m.lost) for m in made[: stage.fitted]]
        sigmas = standing(bare, physics, seen, _noise(stage.scenes[0].camera), VISIBLE)
        kept = [f for f, s in zip(found, sigmas, strict=True) if s >= VISIBLE]
        if len(kept) == count:
            break
        found = kept
    else:
        return None
    nominal, kind = _device_file(random, nominal, seen)
    hidden = tuple(
        Present(p.effect.name, p.at, dict(p.values), share, sigma)
        for (p, share), sigma in zip(found, sigmas, strict=True)
    )
    traces = tuple(m.trace for m in made)
    return FullRig(
        traces[: stage.fitted], traces[stage.fitted :], nominal, scenes[0].device, hidden,
        tuple(scenes), stage.levels, kind,
    )  # fmt: skip


def _drawn(
    random: np.random.Generator, device: Device, motion: Motion, physics: list[Physics]
) -> tuple[Physics, float] | None:
    for _ in range(REDRAWN):
        chosen = choose(random, device, [(p.effect.name, p.at) for p in physics])
        if chosen is None:
            return None
        share = log_uniform(random, *SHARES)
        found = sized(random, *chosen, device, motion, share)
        if found is not None:
            return found, share
    return None


def _noise(camera: Camera) -> Noise:
    return Noise(camera.process, camera.reading)


def _device_file(
    random: np.random.Generator, device: Device, seen: list[Experiment]
) -> tuple[Device, str]:
    kind = float(random.random())
    if kind < EXACT_SHARE:
        return device, "exact"
    nominal = guessed(random, device)
    if kind > EXACT_SHARE + FITTED_SHARE:
        return nominal, "guessed"
    _, best = refit(nominal, [replace(e, dropped=None) for e in seen])
    return best.model.build(best.x), "fitted"
