"""Recording of a full-size machine: encoder counts, with velocities as drives compute them.

Every position is counted by an encoder with the machine's step, after noise is added. A velocity is
the difference of such counts over a period, possibly through a first-order low-pass.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from zwidth.exam.machines import Machine, log_uniform
from zwidth.exam.playing import Playing
from zwidth.scenarios.concealed.integrator import NO_LAWS, Run, integrate, width
from zwidth.scenarios.concealed.rig import Made, RunAway
from zwidth.scenarios.concealed.truth import lost_rate, truth_of
from zwidth.sim.device import Device
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
STEP_S = 1e-4  # of the integrator at most; a stiff bristle then bends by microradians
FEWEST = 4  # steps per tick
LOW_PASS_HZ = (20.0, 200.0)


@dataclass(frozen=True)
class Camera:
    """How a machine is recorded.

    outputs: channels, such as position_m1. cutoff_hz: of the low-pass of velocities, infinite for
    mere differences. reading: rms noise before an encoder counts; process: rms of a force on m1
    that nobody commanded, new every tick.
    """

    outputs: tuple[str, ...]
    cutoff_hz: float
    reading: float
    process: float


@dataclass(frozen=True)
class Scene:
    """A machine, what it plays, and how it is seen; the seed makes its noise.

    laws: rows of laws without a name.
    """

    device: Device
    playing: Playing
    camera: Camera
    seed: int
    laws: Floats = field(default_factory=lambda: NO_LAWS, compare=False)


def draw_camera(random: np.random.Generator, machine: Machine) -> Camera:
    """Return a way to see a machine; process noise is a share of a command of rms one."""
    n = machine.device.chain.masses.size
    kind = float(random.random())
    last = f"m{n}"
    if kind < 0.25 and n > 1:
        outputs: tuple[str, ...] = ("position_m1", f"position_{last}")
    elif kind < 0.65:
        outputs = ("position_m1",)
    elif kind < 0.75 and n > 1:
        outputs = ("velocity_m1", f"velocity_{last}")
    elif kind < 0.9:
        outputs = ("velocity_m1",)
    else:
        outputs = ("position_m1", "velocity_m1")
    cutoff = math.inf
    nyquist = 0.5 / machine.device.interface.period
    if random.random() < 0.6:
        cutoff = log_uniform(random, LOW_PASS_HZ[0], min(LOW_PASS_HZ[1], 0.8 * nyquist))
    step = machine.device.interface.encoder_step
    return Camera(
        outputs, cutoff, step * log_uniform(random, 0.1, 1.0), log_uniform(random, 1e-3, 1e-2)
    )


def steps_a_tick(period: float) -> int:
    """Return the integrator's steps per tick."""
    return max(FEWEST, math.ceil(period / STEP_S - 1e-9))


def streams(scene: Scene) -> list[np.random.Generator]:
    """Return random numbers for lost commands, process, the encoder, and each output."""
    # One stream for each use, so that one use more changes no other.
    seeds = np.random.SeedSequence(scene.seed).spawn(3 + len(scene.camera.outputs))
    return [np.random.default_rng(seed) for seed in seeds]


def film(scene: Scene) -> Made:
    """Return the recording; raises RunAway if the machine leaves all bounds."""
    device, camera, playing = scene.device, scene.camera, scene.playing
    period, ticks = device.interface.period, playing.wanted.size
    lost, process, reading, *others = streams(scene)
    drops = lost.random(ticks) < lost_rate(device)
    force, late = camera.process * process.standard_normal(ticks), np.zeros(ticks)
    steps = steps_a_tick(period)
    truth = truth_of(device, steps)._replace(laws=scene.laws)
    n = device.chain.masses.size
    states = np.zeros((ticks, width(truth)))
    commands, y, done = integrate(
        truth, period, steps, playing.wanted, np.array(playing.feedback), late, drops, force,
        camera.reading * reading.standard_normal(ticks), states,
    )  # fmt: skip
    if done < ticks or not np.isfinite(states).all():
        raise RunAway(f"the simulated motion diverges after {done} ticks; conceal something weaker")

    def read(moving: bool, mass: int) -> Floats | None:
        column = int(truth.reads[int(moving), mass])
        return None if column == truth.reads[0, 0] else states[:, column]

    run = Run(truth, period, steps, commands, late, drops, force)
    chain = np.hstack([states[:, :n], states[:, truth.masses.size :][:, :n]])
    trace = recorded(scene, commands, y, read, others)
    return Made(trace, np.ascontiguousarray(chain), drops, run)


def recorded(
    scene: Scene, commands: Floats, y: Floats, read: Callable[[bool, int], Floats | None],
    others: Sequence[np.random.Generator],
) -> Trace:  # fmt: skip
    """Return what a scene's camera makes of a motion.

    commands, y (ticks,): as given, and as the encoder counted. read: of a mass, the position that
    a channel counts (ticks,), or of which it tells the rate; None if it is the encoder's. others:
    random numbers for each output.
    """
    device, camera = scene.device, scene.camera
    period, step = device.interface.period, device.interface.encoder_step
    channels = {"command": commands}
    length, unit = ("rad", "N m") if device.rotary else ("m", "N")
    units = {"command": unit}
    for name, stream in zip(camera.outputs, others, strict=True):
        moving = name.startswith("velocity")
        position = read(moving, int(name[-1]) - 1)
        if position is None:
            counts = y
        else:
            counts = counted(position + camera.reading * stream.standard_normal(y.size), step)
        channels[name] = _rate(counts, period, camera.cutoff_hz) if moving else counts
        units[name] = f"{length}/s" if moving else length
    t = np.arange(y.size, dtype=np.float64) * period
    return Trace(t, channels, units, "recorded")


def counted(position: Floats, step: float) -> Floats:
    """Return positions in whole steps of an encoder, half a step away from zero."""
    if step == 0.0:
        return position
    return step * np.sign(position) * np.floor(np.abs(position) / step + 0.5)


def _rate(counted: Floats, period: float, cutoff_hz: float) -> Floats:
    change = np.diff(counted, prepend=counted[0]) / period
    if math.isinf(cutoff_hz):
        return change
    weight = 1.0 - math.exp(-2.0 * math.pi * cutoff_hz * period)
    return np.asarray(lfilter([weight], [1.0, weight - 1.0], change), dtype=np.float64)
