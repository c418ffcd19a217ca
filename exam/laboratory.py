"""A machine with nothing concealed, recorded as laboratories do.

Readings are taken up to half a sample before or after the tick at which the command is written, and
with a jitter; stamps are rounded, of a coarse clock, or late; the logged command is rounded; the
recording begins in the middle of a motion, or after a rest. None of it is physics of the machine.

The readings are those of the motion at their own times: the recorded commands are given once more,
with every step of the integrator kept, and positions between two steps are cubic (Hermite). The
acceleration jumps within a step of at most 0.1 ms, which leaves an error of a 1e-9 s^2 of it.
"""

import math
from dataclasses import asdict, dataclass, replace

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from zwidth.exam.filming import Floats, Scene, counted, film, recorded
from zwidth.exam.machines import log_uniform
from zwidth.exam.rigs import FAILURES, TRIES
from zwidth.exam.stages import device_file, draw_stage
from zwidth.exam.strata import LABORATORY
from zwidth.exam.subject import Subject
from zwidth.scenarios.concealed.handout import TIME
from zwidth.scenarios.concealed.integrator import integrate, width
from zwidth.scenarios.concealed.rig import Made
from zwidth.sim.trace import Trace

STREAM = 23  # tells these seeds from those of other recordings
SKEWED_SHARE, SKEW = 0.6, 0.5  # of recordings; of a sample, at most
JITTER_SHARE, JITTER = 0.4, 0.1
STAMPS = ("counted", "exact", "rounded", "coarse", "late")
ROUNDING, COARSE, LATE = (0.05, 1.0), 2.0, 0.1  # of a sample
ROUNDED_SHARE, OF_RMS = 0.4, 1e-2  # of recordings; a decimal place of the command, at most
BEGINNINGS = ("as it is", "after a rest", "in motion")
REST_S, CUT = (0.3, 1.5), (0.05, 0.2)  # [s]; of the recording


@dataclass(frozen=True)
class Habits:
    """How a laboratory records.

    skew, jitter: of a reading, in samples, late > 0. stamps: one of STAMPS; resolution: of a
    rounded or coarse clock, in samples. decimal: the command is logged in multiples of it, 0 for
    all digits. beginning: one of BEGINNINGS; rest_s before the motion, cut: share left out.
    """

    skew: float
    jitter: float
    stamps: str
    resolution: float
    decimal: float
    beginning: str
    rest_s: float
    cut: float


def draw_habits(random: np.random.Generator, rms: float) -> Habits:
    """Return habits; rms: of the command."""
    skew = float(random.uniform(-SKEW, SKEW)) if random.random() < SKEWED_SHARE else 0.0
    jitter = float(random.uniform(0.0, JITTER)) if random.random() < JITTER_SHARE else 0.0
    stamps = str(random.choice(STAMPS))
    resolution = {"rounded": log_uniform(random, *ROUNDING), "coarse": COARSE}.get(stamps, 0.0)
    decimal = 10.0 ** math.floor(math.log10(OF_RMS * rms))
    beginning = str(random.choice(BEGINNINGS))
    return Habits(
        skew, jitter, stamps, resolution, decimal if random.random() < ROUNDED_SHARE else 0.0,
        beginning, float(random.uniform(*REST_S)) if beginning == "after a rest" else 0.0,
        float(random.uniform(*CUT)) if beginning == "in motion" else 0.0,
    )  # fmt: skip


def draw_laboratory(seed: int, index: int, seconds: float | None = None) -> Subject:
    """Return machine number `index` of a seed, with nothing concealed.

    Raises ValueError where none was found.
    """
    random = np.random.default_rng([seed, index, STREAM])
    for _ in range(TRIES):
        try:
            found = _try(random, seconds)
        except FAILURES:
            continue
        if found is not None:
            return found
    raise ValueError(f"no machine was found for index {index} of seed {seed}; try another")


def _try(random: np.random.Generator, seconds: float | None) -> Subject | None:
    stage = draw_stage(random, seconds)
    if stage is None:
        return None
    habits = draw_habits(random, float(np.sqrt(np.mean(stage.first.trace["command"] ** 2))))
    scenes = [rested(s, habits) for s in stage.scenes]
    made = [film(s) for s in scenes]
    nominal, kind = device_file(random, stage, stage.seen(made))
    traces = tuple(logged(s, m, habits, random) for s, m in zip(scenes, made, strict=True))
    return Subject(
        LABORATORY, traces[: stage.fitted], traces[stage.fitted :], nominal, stage.machine.device,
        (), kind, stage.about() | {"habits": asdict(habits)},
    )  # fmt: skip


def rested(scene: Scene, habits: Habits) -> Scene:
    """Return a scene that begins with the rest before it."""
    still = np.zeros(round(habits.rest_s / scene.device.interface.period))
    playing = replace(scene.playing, wanted=np.concatenate([still, scene.playing.wanted]))
    return replace(scene, playing=playing)


def logged(scene: Scene, made: Made, habits: Habits, random: np.random.Generator) -> Trace:
    """Return the recording that a laboratory has of a motion.

    With stamps, they are a channel of it.
    """
    commands, period = made.run.commands, made.run.period
    ticks, step = commands.size, scene.device.interface.encoder_step
    at = np.arange(ticks) + habits.skew + habits.jitter * random.uniform(-1.0, 1.0, ticks)
    columns = made.run.truth.reads
    motion = between(made)

    def place(mass: int) -> Floats:
        column, rate = int(columns[0, mass]), int(columns[2, mass])
        fine = np.arange(motion.shape[0]) * (period / made.run.steps)
        spline = CubicHermiteSpline(fine, motion[:, column], motion[:, rate])
        return np.asarray(spline(np.clip(at * period, 0.0, fine[-1])), dtype=np.float64)

    noise = scene.camera.reading * random.standard_normal(ticks)
    y = counted(place(0) + noise, step)
    trace = recorded(
        scene, in_steps(commands, habits.decimal), y,
        lambda moving, mass: None if mass == 0 else place(mass),
        random.spawn(len(scene.camera.outputs)),
    )  # fmt: skip
    first = round(habits.cut * ticks)
    stamps = stamped(ticks, habits, random) * period
    channels = dict(trace.channels) if habits.stamps == "counted" else {TIME: stamps}
    channels |= trace.channels
    cut = {name: values[first:] for name, values in channels.items()}
    return Trace(trace.t[first:], cut, dict(trace.units) | {TIME: "s"}, "recorded")


def between(made: Made) -> Floats:
    """Return the motion of a recording at every step of the integrator (ticks x steps, states)."""
    run = made.run
    ticks, steps = run.commands.size * run.steps, run.steps
    states, still = np.zeros((ticks, width(run.truth))), np.zeros(ticks)
    integrate(
        run.truth, run.period / steps, 1, np.repeat(run.commands, steps), np.zeros(3), still,
        np.repeat(run.lost, steps), np.repeat(run.process, steps), still, states,
    )  # fmt: skip
    return states


def in_steps(values: Floats, step: float) -> Floats:
    """Return the nearest multiples of a step, 0 for the values themselves."""
    return np.rint(values / step) * step if step else values


def stamped(ticks: int, habits: Habits, random: np.random.Generator) -> Floats:
    """Return stamps in samples (ticks,)."""
    true = np.arange(ticks, dtype=np.float64) + float(random.random())
    if habits.stamps == "coarse":
        return true - true % COARSE
    if habits.stamps == "rounded":
        return in_steps(true, habits.resolution)
    if habits.stamps == "late":
        return true + np.minimum(random.exponential(LATE, ticks), 0.5)
    return true
