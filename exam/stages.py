"""A machine of full size that plays, before physics is concealed in it.

A third of them come as two recordings at different levels, a third with a further one to judge by.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from zwidth.diagnosis.recording.experiment import Experiment, experiment
from zwidth.exam.filming import Scene, draw_camera, film
from zwidth.exam.machines import Machine, draw_machine, guessed, log_uniform
from zwidth.exam.playing import draw_playing
from zwidth.exam.strata import RIGS
from zwidth.exam.visible import refitted
from zwidth.planning.rehearsal import Noise
from zwidth.scenarios.concealed.integrator import NO_LAWS
from zwidth.scenarios.concealed.rig import Floats, Made
from zwidth.scenarios.concealed.shapes import Motion, motion_of
from zwidth.sim.device import Device
from zwidth.sim.physics import EFFECTS
from zwidth.sim.physics.effect import Physics

SHORTEST, LONGEST = 6.0, 30.0  # s
TWO_SHARE, VALIDATED_SHARE = 1.0 / 3.0, 1.0 / 3.0
LEVELS = (0.35, 0.7)  # of another recording's level, or over it
ANOTHER_SHARE = 0.3  # of further recordings that play something else
FITTED_SHARE, EXACT_SHARE = 0.25, 0.15  # of device files
LEAST_STEPS = 15.0  # of the encoder, rms: what moves less shows little but its steps


@dataclass(frozen=True)
class Engine:
    """What moves and records rigs.

    stratum: of its rigs; stream: tells their seeds from those of others; effects: that it has;
    whole: whether it has all that a device has.
    """

    stratum: str
    stream: int
    machine: Callable[[np.random.Generator], Machine]
    film: Callable[[Scene], Made]
    effects: Collection[str]
    whole: Callable[[Device], bool]


OWN = Engine(RIGS, 17, draw_machine, film, frozenset(EFFECTS), lambda _: True)


@dataclass(frozen=True)
class Stage:
    """A machine, its scenes to fit and then those to judge by, and how it moves in the first.

    levels: of the scenes, over that of the first; engine: what moves it.
    """

    machine: Machine
    scenes: tuple[Scene, ...]
    fitted: int
    levels: tuple[float, ...]
    first: Made
    engine: Engine = OWN

    @property
    def motion(self) -> Motion:
        """How the machine moves without physics."""
        return motion_of(self.first, self.machine.device)

    @property
    def noise(self) -> Noise:
        """What nobody asked for, as an observer takes it."""
        camera = self.scenes[0].camera
        return Noise(camera.process, camera.reading)

    def with_physics(self, physics: Sequence[Physics], laws: Floats = NO_LAWS) -> list[Scene]:
        """Return the scenes with effects and laws."""
        device = self.machine.device.with_physics(*physics)
        return [replace(s, device=device, laws=laws) for s in self.scenes]

    def seen(self, made: Sequence[Made]) -> list[Experiment]:
        """Return the recordings to fit, with what is known of lost commands."""
        return [
            replace(experiment(m.trace, self.machine.device), dropped=m.lost)
            for m in made[: self.fitted]
        ]

    def about(self) -> dict[str, Any]:
        """Return drives, views, noise and levels in JSON's types."""
        camera = self.scenes[0].camera
        return {
            "drive": [
                {"kind": s.playing.kind, "feedback": list(s.playing.feedback)} for s in self.scenes
            ],
            "levels": list(self.levels),
            "outputs": list(camera.outputs),
            "low_pass_hz": camera.cutoff_hz if np.isfinite(camera.cutoff_hz) else None,
            "noise": {"reading": camera.reading, "process": camera.process},
        }


def draw_stage(
    random: np.random.Generator, seconds: float | None, engine: Engine = OWN
) -> Stage | None:
    """Return a machine that plays; None if it hardly moves its encoder.

    seconds: length of each recording, drawn where None. Raises RunAway if it leaves all bounds.
    """
    machine = engine.machine(random)
    two, validated = random.random() < TWO_SHARE, random.random() < VALIDATED_SHARE
    duration = seconds or log_uniform(random, SHORTEST, LONGEST)
    playing = draw_playing(random, machine, duration)
    camera = draw_camera(random, machine)
    levels, playings = [1.0], [playing]
    for _ in range(int(two) + int(validated)):
        factor = log_uniform(random, *LEVELS)
        levels.append(factor if random.random() < 0.5 else 1.0 / factor)
        another = random.random() < ANOTHER_SHARE
        again = draw_playing(random, machine, duration) if another else playing
        playings.append(again.louder(levels[-1]))
    seeds = [int(random.integers(2**62)) for _ in playings]
    scenes = [Scene(machine.device, p, camera, s) for p, s in zip(playings, seeds, strict=True)]
    first = engine.film(replace(scenes[0], camera=replace(camera, process=0.0)))
    size = float(np.sqrt(np.mean(first.trace["command"] ** 2)))
    step = machine.device.interface.encoder_step
    if np.std(first.states[:, 0]) < LEAST_STEPS * step:
        return None
    camera = replace(camera, process=camera.process * size)
    return Stage(
        machine, tuple(replace(s, camera=camera) for s in scenes), 1 + int(two), tuple(levels),
        first, engine,
    )  # fmt: skip


def device_file(
    random: np.random.Generator, stage: Stage, seen: Sequence[Experiment]
) -> tuple[Device, str]:
    """Return what the user's file says of the device, and how it came to."""
    device = replace(stage.machine.device, name="device under test", source="")
    kind = float(random.random())
    if kind < EXACT_SHARE:
        return device, "exact"
    nominal = guessed(random, device)
    if kind > EXACT_SHARE + FITTED_SHARE:
        return nominal, "guessed"
    return refitted(nominal, [replace(e, dropped=None) for e in seen], stage.noise), "fitted"
