"""What a machine is made to do: a command played open loop, or a position asked of a controller.

A controller is proportional to the position error and, low-passed, to its rate, as drives have it:
    u = K (r - y) + B (r' - y'),    K = m w^2, B = 2 zeta m w,
with m all of the mass. The command that it gives is recorded.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zwidth.controllers.excitation import chirp, multisine, random_steps
from zwidth.exam.machines import Machine, log_uniform
from zwidth.scenarios.concealed.integrator import integrate
from zwidth.scenarios.concealed.truth import truth_of

Floats = NDArray[np.float64]
KINDS = {
    "multisine": 0.15, "chirp": 0.1, "steps": 0.1, "sines": 0.15,
    "held_steps": 0.25, "held_sines": 0.25,
}  # fmt: skip
HELD = ("held_steps", "held_sines")
SPEEDS, FARTHEST = (1.0, 12.0), 4.0  # rad/s and rad, rms, to which an open loop is scaled
REACHES = (0.3, 3.0)  # rad, of what a position loop is asked for
COARSE_S = 4e-4  # of a step while a signal is scaled


@dataclass(frozen=True)
class Playing:
    """wanted (ticks,): the command of an open loop, or what a controller adds to its feedback.

    feedback: stiffness, damping, and the weight of a new difference in the rate fed back.
    """

    kind: str
    wanted: Floats
    feedback: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def louder(self, factor: float) -> "Playing":
        """Return the same at another level."""
        return replace(self, wanted=factor * self.wanted)


def draw_playing(random: np.random.Generator, machine: Machine, duration: float) -> Playing:
    """Return something to do for so many seconds, at a size that suits the machine."""
    kind = str(random.choice(list(KINDS), p=list(KINDS.values())))
    period = machine.device.interface.period
    if kind in HELD:
        return _held(random, machine, kind, duration)
    nyquist = 0.5 / period
    highest = min(log_uniform(random, 8.0, 60.0), 0.6 * nyquist)
    match kind:
        case "multisine":
            seed = int(random.integers(2**31))
            signal = multisine(1.0, 0.3, highest, duration, period, seed)
        case "chirp":
            signal = chirp(1.0, 0.3, highest, duration, period)
        case "steps":
            signal = _steps(random, duration, period)
        case _:
            signal = _sines(random, duration, period, 0.3, 5.0)
    found = Playing(kind, signal)
    states = _moved(machine, found)
    n = machine.device.chain.masses.size
    speed = log_uniform(random, *SPEEDS) * machine.radius
    fast = speed / float(np.sqrt(np.mean(states[:, n] ** 2)))
    return found.louder(min(fast, FARTHEST * machine.radius / float(np.std(states[:, 0]))))


def _held(random: np.random.Generator, machine: Machine, kind: str, duration: float) -> Playing:
    period, chain = machine.device.interface.period, machine.device.chain
    mass = float(chain.masses.sum())
    # As fast as delay, the first link and the damping at the load leave room for.
    late = machine.device.interface.delay + 1.5 * period
    most = min(2.0 * np.pi * 4.0, 0.25 / late)
    if chain.link_springs.size:
        soft = float(np.sqrt(np.min(chain.link_springs) / mass))
        most = min(most, 0.35 * soft)
    rate = most * float(random.uniform(0.4, 1.0))
    damping = 2.0 * float(random.uniform(0.5, 1.0)) * mass * rate
    stiffness = mass * rate**2
    reach = log_uniform(random, *REACHES) * machine.radius
    if kind == "held_steps":
        asked = _steps(random, duration, period, shortest=0.6)
    else:
        fastest = max(0.3, 0.5 * rate / (2.0 * np.pi))
        asked = _sines(random, duration, period, 0.1, fastest)
    asked = asked * reach / float(np.abs(asked).max())
    smoothing = 1.0 - math.exp(-min(10.0 * rate * period, 3.0))
    change = np.diff(asked, prepend=0.0) / period
    slow = np.zeros(asked.size)
    for k in range(1, asked.size):
        slow[k] = slow[k - 1] + smoothing * (change[k] - slow[k - 1])
    # A step is asked for in position only: its rate would be a blow.
    wanted = stiffness * asked + (damping * slow if kind == "held_sines" else 0.0)
    return Playing(kind, wanted, (stiffness, damping, smoothing))


def _steps(
    random: np.random.Generator, duration: float, period: float, shortest: float = 0.15
) -> Floats:
    hold = min(log_uniform(random, shortest, 2.0), duration / 4.0)
    signal = random_steps(1.0, hold, duration, period, int(random.integers(2**31)))
    return signal - signal.mean()


def _sines(
    random: np.random.Generator, duration: float, period: float, low: float, high: float
) -> Floats:
    t = np.arange(round(duration / period)) * period
    signal = np.zeros(t.size)
    for _ in range(int(random.integers(1, 4))):
        turn = 2.0 * np.pi * log_uniform(random, low, high)
        signal += float(random.uniform(0.3, 1.0)) * np.sin(turn * t + random.uniform(-3.0, 3.0))
    ramp = np.minimum(1.0, t / min(0.5, 0.1 * duration))
    return signal * ramp


def _moved(machine: Machine, playing: Playing) -> Floats:
    """States (ticks, 2n) of the machine without physics, noise and steps."""
    device = machine.device.with_interface(encoder_step=0.0)
    period = device.interface.period
    steps = max(2, round(period / COARSE_S))
    truth = truth_of(device, steps)
    ticks = playing.wanted.size
    still, lost = np.zeros(ticks), np.zeros(ticks, dtype=np.bool_)
    states = np.zeros((ticks, 2 * truth.masses.size))
    integrate(
        truth, period, steps, playing.wanted, np.array(playing.feedback), still, lost, still,
        still, states,
    )  # fmt: skip
    return states
