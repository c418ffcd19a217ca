"""How often an event is found, dated, named and weighed, and how often one is said of none.

Each recording is of a mass with a damper, dry friction and, on half of them, a spring to ground,
at 250 Hz, drawn anew: all sizes, the command, the noise. On half of them nothing happens. On the
others one thing does, of drawn size, at a drawn time of the 20 s, fitted or held out: a hit (half a
sine of 2 to 15 ms), a stop that the farthest excursion runs into, a jam (friction above every
command for 0.1 to 0.8 s), a hand (a spring and a damper that come and go over 0.2 to 1.5 s) or a
slip of the encoder (3 to 30 % of the rms motion). The integrator is this file's own, fifty steps a
sample, and adds up impulse and energy of what happened. Diagnosed as a user would, with `--effort
quick`, by a device file that knows no friction and whose numbers are off by up to 30 %.

    python -m benchmarks.events --count 100 --seed 1

With `--named` the friction has its name already and only what happens is sought, in a tenth of the
time: what a search makes of it before and after is not judged then.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from zwidth.diagnosis.answer.events import Event, events_in
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.diagnosis.time.force import Happened, with_events
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics

Floats = NDArray[np.float64]
T, FINE = 0.004, 50
NOTHING, HIT, STOP, JAM, TOUCH, SLIP = range(6)
KINDS = ("nothing", "hit", "stop", "jam", "touch", "slip")
NEAR_S = 0.1  # within which an event is dated rightly
ONCE_S = 0.5  # from the first touch of a stop to the last


@njit
def moved(
    command: Floats, numbers: Floats, kind: int, event: Floats
) -> tuple[Floats, Floats]:  # pragma: no cover - compiled
    """Positions (ticks,) of a mass, and impulse, energy, first and last time of what happened.

    numbers (4,): mass, damper, friction, spring. event: begins [s], lasts [s], and of a hit its
    peak force; of a stop its place, stiffness, damping; of a jam its friction; of a hand stiffness,
    damping, place.
    """
    m, b, friction, spring = numbers
    found, told = np.zeros(command.size), np.array([0.0, 0.0, -1.0, -1.0])
    x, v, h = 0.0, 0.0, T / FINE
    begins, lasts = event[0], event[1]
    for k in range(command.size):
        found[k] = x
        for i in range(FINE):
            t = k * T + i * h
            on = begins <= t < begins + lasts
            f, level = 0.0, friction
            if kind == HIT and on:
                f = event[2] * np.sin(np.pi * (t - begins) / lasts)
            if kind == STOP:
                deep = (x - event[2]) * np.sign(event[2])
                if deep > 0.0:
                    out = event[3] * deep + event[4] * v * np.sign(event[2])
                    f = -np.sign(event[2]) * max(out, 0.0)
            if kind == TOUCH and on:
                ramp = min(1.0, 5.0 * min(t - begins, begins + lasts - t) / lasts)
                f = -ramp * (event[2] * (x - event[4]) + event[3] * v)
            if kind == JAM and on:
                level = event[2]
            w = v + h * (command[k] + f - b * v - spring * x) / m
            stops = h * level / m
            before = w
            w = w - stops if w > stops else (w + stops if w < -stops else 0.0)
            if kind == JAM and on:  # what its friction does beyond the device's own
                plain = h * friction / m
                own = (
                    before - plain
                    if before > plain
                    else (before + plain if before < -plain else 0.0)
                )
                f = m * (w - own) / h
            if f != 0.0:
                told[0] += f * h
                told[1] += f * 0.5 * (v + w) * h
                if told[2] < 0.0:
                    told[2] = t
                told[3] = t
            x += 0.5 * h * (v + w)
            v = w
    return found, told


@dataclass(frozen=True)
class Drawn:
    """A recording, the device file for it, and what happens: its kind, when, what it brought."""

    recording: Experiment
    device: Device
    kind: int
    begins: float
    ends: float
    impulse: float
    energy: float


def drawn(seed: int, index: int, seconds: float, kind: int | None = None) -> Drawn:
    """Draw a recording of so many seconds. kind: of what happens, None for one that is drawn."""
    random = np.random.default_rng([seed, index, 47])

    def between(low: float, high: float) -> float:
        return float(np.exp(random.uniform(np.log(low), np.log(high))))

    ticks = round(seconds / T)
    own = int(random.integers(1, 6)) if random.random() < 0.5 else NOTHING
    kind = own if kind is None else kind
    while True:
        mass, peak, command = between(2e-4, 5e-3), between(30.0, 120.0), np.zeros(ticks)
        for _ in range(4):
            wave = 2.0 * np.pi * between(0.3, 5.0) * T * np.arange(ticks)
            command += random.uniform(0.4, 1.0) * np.sin(wave + random.uniform(0.0, 6.3))
        peak *= mass
        command *= peak / float(np.abs(command).max())
        spring = mass * (2.0 * np.pi * between(0.4, 2.0)) ** 2 if random.random() < 0.5 else 0.0
        numbers = np.array([mass, mass * between(1.0, 5.0), peak * between(0.1, 0.3), spring])
        clean, _ = moved(command, numbers, NOTHING, np.zeros(5))
        at = float(random.uniform(0.1, 0.9)) * seconds
        if kind != STOP or 0.1 < np.argmax(np.abs(clean)) / ticks < 0.9:
            break
    size, speed = float(clean.std()), float(np.diff(clean).std() / T)
    event = np.zeros(5)
    slip = 0.0
    if kind == HIT:
        lasts = between(2e-3, 15e-3)
        impulse = mass * speed * between(0.15, 1.0) * float(random.choice((-1.0, 1.0)))
        event = np.array([at, lasts, 0.5 * np.pi * impulse / lasts, 0.0, 0.0])
    elif kind == STOP:
        rate = 2.0 * np.pi * between(20.0, 100.0)
        far = clean[np.argmax(np.abs(clean))]
        place = far - np.sign(far) * min(0.3 * abs(far), size) * random.uniform(0.1, 1.0)
        event = np.array([0.0, 0.0, place, mass * rate**2, mass * rate * random.uniform(0.1, 1.0)])
    elif kind == JAM:
        event = np.array([at, between(0.1, 0.8), 3.0 * peak + spring * 3.0 * size, 0.0, 0.0])
    elif kind == TOUCH:
        stiff = peak / size * between(0.2, 1.0)
        place = clean[round(at / T)] + size * random.uniform(-0.5, 0.5)
        event = np.array([at, between(0.2, 1.5), stiff, mass * between(1.0, 20.0), place])
    elif kind == SLIP:
        slip = size * between(0.03, 0.3) * float(random.choice((-1.0, 1.0)))
    motion, (impulse, energy, begins, ends) = moved(command, numbers, kind, event)
    if kind == STOP and ends - begins > ONCE_S:  # what is met again and again is no event
        return drawn(seed, index + 1_000_000, seconds, kind)
    if kind == SLIP:
        begins = ends = at
        motion = motion + slip * (T * np.arange(ticks) >= at)
        impulse = slip
    noise = float(clean.std()) * between(1e-4, 1e-3)
    y = motion + noise * random.standard_normal(ticks)

    def guess(value: float) -> float:
        return value * float(np.exp(random.uniform(-0.3, 0.3)))

    chain = make_chain([guess(mass)], [guess(numbers[1])], guess(spring))
    device = Device("mass", "", True, chain, Interface(period=T))
    made = Experiment(T, command, y[:, None], (Output("position", 0),), "run", float(y.std()))
    return Drawn(made, device, kind, float(begins), float(ends), float(impulse), float(energy))


@dataclass
class Marks:
    """What was right: of events that there were, and of those that there were not."""

    found: list[bool]
    dated: list[bool]
    named: list[bool]
    inside: list[bool]
    weighed: list[float]
    energy: list[bool]
    more: list[bool]
    false: list[bool]


def main() -> None:
    """Print a line for each recording, and the tally."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--named", action="store_true")
    asked = parser.parse_args()
    marks = Marks([], [], [], [], [], [], [], [])
    for index in range(asked.first, asked.first + asked.count):
        one = drawn(asked.seed, index, asked.seconds)
        since = time.perf_counter()
        verdict, events = _named(one) if asked.named else _diagnosed(one)
        spent = time.perf_counter() - since
        if one.kind == NOTHING:
            marks.false.append(bool(events))
        else:
            _marked(marks, one, events)
        said = "; ".join(event.sentence for event in events)
        print(
            f"{index:4d} {KINDS[one.kind]:8s} {one.begins:6.3f} to {one.ends:6.3f} s"
            f" {one.impulse:9.2g} {one.energy:9.2g} J  {verdict} [{said}] {spent:.0f} s",
            flush=True,
        )
    for name, each in vars(marks).items():
        if name == "weighed":
            print(f"impulse or slip off by, in the median: {np.median(each or [np.nan]):.3f}")
        else:
            print(f"{name}: {sum(each)} of {len(each)}")


def _diagnosed(one: Drawn) -> tuple[str, tuple[Event, ...]]:
    """Verdict with names, and events, of a whole diagnosis."""
    found = diagnose(one.device, [one.recording], effort=QUICK)
    named = " and ".join(f.effect for f in found.findings)
    return f"{found.verdict.value} ({named})", found.events


def _named(one: Drawn) -> tuple[str, tuple[Event, ...]]:
    """Events as the right structure sees them, fitted to the part that a diagnosis fits."""
    fit, _ = one.recording.split()
    level = 0.2 * float(np.abs(fit.command).max())
    friction = make_physics("coulomb_friction", "m1", level=level)
    model = Model(one.device).with_effect(friction, {"level": level})
    h = settled(judged([fit], model, np.zeros(len(model.parameters))))

    def fit_on(known: Sequence[Happened]) -> list[Experiment]:
        return [with_events([one.recording], known)[0].part(0, fit.ticks)]

    return "", events_in([one.recording], h, fit_on)


def _marked(marks: Marks, one: Drawn, events: tuple[Event, ...]) -> None:
    near = [e for e in events if e.at - NEAR_S < one.ends + T
            and (e.until or e.at) + NEAR_S > one.begins]  # fmt: skip
    marks.found.append(bool(near))
    marks.more.append(len(events) > 1)
    if not near:
        return
    best = max(near, key=lambda e: e.gained)
    short = best.until is None
    true = 0.5 * (one.begins + one.ends) if short else one.begins
    marks.dated.append(abs(best.at - true) < NEAR_S)
    marks.inside.append(best.between[0] <= true <= best.between[1])
    marks.named.append(best.kind == KINDS[one.kind])
    amount = best.slip if one.kind == SLIP else best.impulse
    if amount is not None:
        marks.weighed.append(abs(amount.value / one.impulse - 1.0))
    if best.energy is not None:
        margin = 0.1 * abs(one.energy)
        marks.energy.append(best.energy.lower - margin <= one.energy <= best.energy.upper + margin)


if __name__ == "__main__":
    main()
