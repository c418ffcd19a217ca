"""How often a change is found, dated and measured, and how often one is said where there is none.

Each recording is of a mass with a damper, dry friction and, on half of them, a spring to ground,
at 250 Hz, drawn anew: all sizes, the command, the noise. On half of them nothing changes. On the
others one parameter steps by `--by` at a time between a quarter and three quarters of what is
fitted, or drifts by as much from the first sample to the last. The integrator is this file's own,
fifty steps a sample. Diagnosed as a user would, with `--effort quick`, by a device file that knows
no friction and whose numbers are off by up to 30 %.

    python -m benchmarks.changes --count 100 --seed 1
"""

import argparse
import time
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface

Floats = NDArray[np.float64]
T, FINE = 0.004, 50
KINDS = ("mass", "damper", "friction", "spring")
NAMES = {"mass": "m1", "damper": "b1", "friction": "level", "spring": "k0"}
FITTED = 0.7  # of a recording; the rest judges
NEAR = 0.05  # of the length, within which a step is dated rightly


@njit
def moved(command: Floats, numbers: Floats) -> Floats:  # pragma: no cover - compiled
    """Positions (ticks,) of a mass; numbers (ticks, 4): mass, damper, friction, spring."""
    found = np.zeros(command.size)
    x, v, h = 0.0, 0.0, T / FINE
    for k in range(command.size):
        m, b, friction, spring = numbers[k]
        found[k] = x
        for _ in range(FINE):
            w = v + h * (command[k] - b * v - spring * x) / m
            stops = h * friction / m
            w = w - stops if w > stops else (w + stops if w < -stops else 0.0)
            x += 0.5 * h * (v + w)
            v = w
    return found


@dataclass(frozen=True)
class Drawn:
    """A recording, the device file for it, and what changes: "" for nothing."""

    recording: Experiment
    device: Device
    what: str
    shape: str
    at: float


def drawn(seed: int, index: int, seconds: float, by: float) -> Drawn:
    """Draw a recording of so many seconds."""
    random = np.random.default_rng([seed, index, 31])

    def between(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    mass, ticks = between(2e-4, 5e-3), round(seconds / T)
    t = T * np.arange(ticks)
    command = np.zeros(ticks)
    for _ in range(4):
        command += random.uniform(0.4, 1.0) * np.sin(
            2.0 * np.pi * between(0.3, 5.0) * t + random.uniform(0.0, 6.3)
        )
    sprung = random.random() < 0.5
    peak = mass * between(30.0, 120.0)  # rad/s2
    command *= peak / float(np.abs(command).max())
    own = {
        "mass": mass,
        "damper": mass * between(1.0, 5.0),
        "friction": peak * between(0.1, 0.3),
        "spring": mass * (2.0 * np.pi * between(0.4, 2.0)) ** 2 if sprung else 0.0,
    }
    what, shape, at = "", "", 0.0
    numbers = np.array([own[key] * np.ones(ticks) for key in KINDS]).T
    if random.random() < 0.5:
        what = str(random.choice(KINDS[: 4 if sprung else 3]))
        shape = str(random.choice(("step", "drift")))
        amount = by * float(random.choice((-1.0, 1.0)))
        at = FITTED * seconds * float(random.uniform(0.25, 0.75))
        course = (t >= at).astype(np.float64) if shape == "step" else t / seconds
        numbers[:, KINDS.index(what)] *= 1.0 + amount * course
    clean = moved(command, numbers)
    noise = float(clean.std()) * between(1e-4, 1e-3)
    y = clean + noise * random.standard_normal(ticks)

    def guess(value: float) -> float:
        return value * float(np.exp(random.uniform(-0.3, 0.3)))

    chain = make_chain([guess(mass)], [guess(own["damper"])], guess(own["spring"]))
    device = Device("mass", "", True, chain, Interface(period=T))
    made = Experiment(T, command, y[:, None], (Output("position", 0),), "run", float(y.std()))
    return Drawn(made, device, what, shape, at)


def main() -> None:
    """Print a line for each recording, and the tally."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--by", type=float, default=0.05)
    asked = parser.parse_args()
    steps: list[bool] = []
    drifts: list[bool] = []
    inside: list[bool] = []
    false: list[bool] = []
    for index in range(asked.first, asked.first + asked.count):
        one = drawn(asked.seed, index, asked.seconds, asked.by)
        since = time.perf_counter()
        found = diagnose(one.device, [one.recording], effort=QUICK)
        spent = time.perf_counter() - since
        said = [(c.parameter, c.shape, c.at, c.between) for c in found.changes]
        right = [c for c in found.changes if one.what and NAMES[one.what] in c.parameter]
        if not one.what:
            false.append(bool(said))
        elif one.shape == "drift":
            drifts.append(any(c.shape != "run" for c in right))
        else:
            dated = [c for c in right if c.at is not None and c.shape == "step"]
            steps.append(any(abs((c.at or 0.0) - one.at) < NEAR * asked.seconds for c in dated))
            inside += [b[0] <= one.at <= b[1] for c in dated if (b := c.between) is not None]
        print(
            f"{index:4d} {one.what or 'nothing':8s} {one.shape:5s} {one.at:6.2f} s"
            f"  {found.verdict.value:16s} {said} {spent:.0f} s",
            flush=True,
        )
    for name, marks in (("steps dated", steps), ("date's interval holds", inside),
                        ("drifts found", drifts), ("said of none", false)):  # fmt: skip
        print(f"{name}: {sum(marks)} of {len(marks)}")


if __name__ == "__main__":
    main()
