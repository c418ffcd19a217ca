"""What a device is driven by: one kind of signal, or a session of several, open or closed loop."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.controllers.excitation import multisine, noise, random_steps, triangle
from zwidth.scenarios.concealed.integrator import integrate
from zwidth.scenarios.concealed.truth import truth_of
from zwidth.sim.device import Device

Floats = NDArray[np.float64]
KINDS = ("session", "noise", "multisine", "random_steps", "triangle")
SHARES = (0.5, 0.2, 0.15, 0.1, 0.05)
SEGMENTS = ("small_multisine", "multisine", "triangle", "random_steps")
FASTEST, FARTHEST = 2.0, 0.5  # rms speed and position that a signal is scaled to [rad/s, rad]
LEVER = 0.05  # m, for a linear device
COARSE = 4  # steps per tick, enough to scale a signal on a linear device


@dataclass(frozen=True)
class Drive:
    """wanted (ticks,) [N m | N]; feedback: stiffness and damping on the reading; its kind."""

    kind: str
    wanted: Floats
    feedback: tuple[float, float]


def draw_drive(random: np.random.Generator, device: Device, duration: float) -> Drive:
    """Return a drive of that duration [s], scaled to what a hand might do with the device."""
    kind = str(random.choice(KINDS, p=SHARES))
    feedback = (0.0, 0.0)
    if random.random() < 0.5 and device.chain.ground_spring == 0.0:
        mass = float(device.chain.masses.sum())
        rate = 2.0 * np.pi * random.uniform(0.4, 2.0)
        feedback = (mass * rate**2, 2.0 * random.uniform(0.1, 0.4) * mass * rate)
    size = float(np.exp(random.uniform(np.log(0.25), 0.0)))
    kinds = SEGMENTS if kind == "session" else (kind,)
    rounds = 2 if kind == "session" else 1
    period = device.interface.period
    each = duration / (len(kinds) * rounds)
    parts: list[Floats] = []
    for name in kinds * rounds:
        signal = _signal(random, name, each, period)
        parts.append(size * _scale(device, signal, feedback, name) * signal)
    wanted = np.concatenate(parts)
    return Drive(kind, wanted[: round(duration / period)], feedback)


def _signal(random: np.random.Generator, kind: str, duration: float, period: float) -> Floats:
    seed = int(random.integers(2**31))
    highest = float(random.uniform(80.0, 300.0))
    match kind:
        case "noise":
            return noise(1.0, 0.7, highest, duration, period, seed)
        case "multisine" | "small_multisine":
            return multisine(1.0, 0.7, highest, duration, period, seed)
        case "random_steps":
            return random_steps(1.0, float(random.uniform(0.05, 0.3)), duration, period, seed)
        case _:
            return triangle(1.0, min(duration, float(random.uniform(1.0, 4.0))), duration, period)


def _scale(device: Device, signal: Floats, feedback: tuple[float, float], kind: str) -> float:
    """Amplitude at which the linear device moves as fast, or as far, as it should."""
    still = np.zeros(signal.size)
    truth = truth_of(device, COARSE)
    states = np.zeros((signal.size, 2 * truth.masses.size))
    lost = np.zeros(signal.size, dtype=np.bool_)
    integrate(
        truth, device.interface.period, COARSE, signal, np.array(feedback), still, lost, still,
        still, states,
    )  # fmt: skip
    length = 1.0 if device.rotary else LEVER
    far = float(np.sqrt(np.mean(states[:, 0] ** 2)))
    fast = float(np.sqrt(np.mean(states[:, truth.masses.size] ** 2)))
    scale = min(FARTHEST * length / far, FASTEST * length / fast)
    return 0.2 * scale if kind == "small_multisine" else scale
