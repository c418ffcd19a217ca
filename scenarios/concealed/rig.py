"""A recording as it is made: a truth driven, disturbed and seen through noise."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from zwidth.scenarios.concealed.excitation import Drive
from zwidth.scenarios.concealed.integrator import NO_LAWS, Run, integrate, width
from zwidth.scenarios.concealed.outside import Outside
from zwidth.scenarios.concealed.truth import lost_rate, truth_of
from zwidth.sim.device import Device
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
STEPS = 40  # a tick


@dataclass(frozen=True)
class Nuisance:
    """What nobody asked for.

    measurement: rms noise of positions [rad | m], before the encoder counts; velocities have 0.3
    times as much over one period. process: rms of a force on m1, new every tick [N m | N]. colour
    and process_colour: pole of a first-order filter that the noise went through, 0 for white.
    jitter: commands arrive up to this much early or late [s].
    """

    measurement: float
    process: float
    colour: float = 0.0
    process_colour: float = 0.0
    jitter: float = 0.0


@dataclass(frozen=True)
class Rig:
    """Everything that a recording follows from, and it alone.

    device: the truth, with its physics; outside: physics in no library; outputs: channels, such as
    position_m1; seed of noise and lost commands. laws: rows of laws of no name (`integrator.LAW`).
    """

    device: Device
    drive: Drive
    nuisance: Nuisance
    outputs: tuple[str, ...] = ("position_m1",)
    outside: Outside | None = None
    seed: int = 0
    laws: Floats = field(default_factory=lambda: NO_LAWS, compare=False)

    def without_physics(self) -> "Rig":
        """Return the rig on which nothing is concealed: same drive, same noise."""
        return replace(self, device=self.device.without_physics(), outside=None, laws=NO_LAWS)


class RunAway(ValueError):
    """A rig whose motion grows beyond all bounds."""


@dataclass(frozen=True)
class Made:
    """A recording, the states (ticks, 2n) that nobody measures, which commands were lost.

    run: how it came about, to be repeated without noise.
    """

    trace: Trace
    states: Floats
    lost: NDArray[np.bool_]
    run: Run


def record(rig: Rig, steps: int = STEPS) -> Made:
    """Return the recording of a rig; raises RunAway if the device leaves all bounds."""
    device = rig.device
    period, ticks = device.interface.period, rig.drive.wanted.size
    # One stream of random numbers for each use, so that one use more changes no other.
    seeds = np.random.SeedSequence(rig.seed).spawn(4 + len(rig.outputs))
    streams = [np.random.default_rng(seed) for seed in seeds]
    jitter, lost, process, reading, *others = streams
    nuisance, wanted = rig.nuisance, rig.drive.wanted
    late = nuisance.jitter * jitter.uniform(-1.0, 1.0, ticks)
    drops = lost.random(ticks) < lost_rate(device)
    truth = truth_of(device, steps, rig.outside)._replace(laws=rig.laws)
    states = np.zeros((ticks, width(truth)))
    force = nuisance.process * _noise(process, ticks, nuisance.process_colour)
    commands, y, done = integrate(
        truth, period, steps, wanted, np.array(rig.drive.feedback), late, drops, force,
        nuisance.measurement * _noise(reading, ticks, nuisance.colour), states,
    )  # fmt: skip
    if done < ticks or not np.isfinite(states).all():
        raise RunAway(f"the simulated motion diverges after {done} ticks; conceal something weaker")
    channels = {"command": commands}
    length, unit = ("rad", "N m") if device.rotary else ("m", "N")
    units = {"command": unit}
    for name, stream in zip(rig.outputs, others, strict=True):
        noise = nuisance.measurement * _noise(stream, ticks, nuisance.colour)
        mass = int(name[-1]) - 1
        if name == "position_m1":
            channels[name] = y
        elif name.startswith("position"):
            channels[name] = states[:, truth.reads[0, mass]] + noise
        else:
            channels[name] = states[:, truth.reads[2, mass]] + 0.3 * noise / period
        units[name] = length if name.startswith("position") else f"{length}/s"
    t = np.arange(ticks, dtype=np.float64) * period
    run = Run(truth, period, steps, commands, late, drops, force)
    moved = np.ascontiguousarray(states[:, : 2 * truth.masses.size])
    return Made(Trace(t, channels, units, "recorded"), moved, drops, run)


def _noise(random: np.random.Generator, ticks: int, pole: float) -> Floats:
    """Gaussian noise of unit variance, white or through a pole."""
    white = random.standard_normal(ticks)
    if pole == 0.0:
        return white
    return np.asarray(lfilter([math.sqrt(1.0 - pole**2)], [1.0, -pole], white), dtype=np.float64)


def draw_nuisance(random: np.random.Generator, device: Device, drive: Drive) -> Nuisance:
    """Return noise like that of a device of its kind; half of the clocks jitter."""
    length = 1.0 if device.rotary else 0.05
    force = float(np.sqrt(np.mean(drive.wanted**2)))
    late = device.interface.delay > 0.0 and random.random() < 0.5
    return Nuisance(
        length * float(np.exp(random.uniform(np.log(2e-6), np.log(2e-5)))),
        force * float(np.exp(random.uniform(np.log(1e-3), np.log(2e-2)))),
        float(random.uniform(0.4, 0.95)) if random.random() < 0.3 else 0.0,
        float(random.uniform(0.4, 0.95)) if random.random() < 0.3 else 0.0,
        float(random.uniform(0.0, 2e-5)) if late else 0.0,
    )


def draw_outputs(random: np.random.Generator, device: Device) -> tuple[str, ...]:
    """Return what is measured: mostly m1's position."""
    n = device.chain.masses.size
    kind = random.random()
    if kind < 0.1 and n > 1:
        return ("position_m1", f"position_m{n}")
    if kind < 0.2:
        return ("position_m1", "velocity_m1")
    if kind < 0.25:
        return ("velocity_m1",)
    return ("position_m1",)
