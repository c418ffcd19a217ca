"""What a newcomer's CSV files give: `zwidth diagnose FILE.csv`, at default effort, rig by rig.

    python -m benchmarks.newcomer [RIG ...] [--out DIR]

The rigs are simulated here, in plain Python and without zwidth: dry friction in closed form from
one stop to the next, all else by Runge-Kutta of fourth order with 40 steps a sample. Each file has
8 s at 500 Hz: seconds, N m, and degrees with 0.002 degrees of noise. The table is that of
docs/first_answers.md.
"""

import argparse
import contextlib
import io
import json
import math
import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zwidth.cli import run

Floats = NDArray[np.float64]
State = tuple[float, ...]
RATE, SECONDS, STEPS = 500.0, 8.0, 40
MASS, DAMPER = 1.5e-3, 4e-3  # kg m2, N m s/rad
FRICTION, SMOOTH, WEIGHT, LIMIT = 0.04, 0.003, 0.08, 0.15  # N m, rad/s, N m, N m
LOAD, LOAD_DAMPER, SHAFT, PLAY = 0.8e-3, 2e-3, 12.0, 0.02  # kg m2, N m s/rad, N m/rad, rad
NOISE_DEG, SEED = 0.002, 7


def command() -> Floats:
    """A sum of sines from 0.3 to 40 Hz of 0.3 N m at most."""
    random, t = np.random.default_rng(3), np.arange(round(SECONDS * RATE)) / RATE
    f = np.geomspace(0.3, 40.0, 24)
    u = np.sum(np.sin(2 * np.pi * f * t[:, None] + random.uniform(0, 7, f.size)) / f**0.25, axis=1)
    return 0.3 * u / np.abs(u).max()


def runge_kutta(u: Floats, slope: Callable[[State, float], State], masses: int = 1) -> Floats:
    """Return the angles (samples, masses); slope: of (angle, speed) of each mass under a torque."""
    h, x = 1.0 / RATE / STEPS, (0.0,) * (2 * masses)
    angles = np.empty((u.size, masses))

    def ahead(state: State, rate: State, by: float) -> State:
        return tuple(s + by * r for s, r in zip(state, rate, strict=True))

    for k, force in enumerate(u.tolist()):
        angles[k] = x[::2]
        for _ in range(STEPS):
            a = slope(x, force)
            b = slope(ahead(x, a, 0.5 * h), force)
            c = slope(ahead(x, b, 0.5 * h), force)
            d = slope(ahead(x, c, h), force)
            x = tuple(
                s + h / 6.0 * (p + 2.0 * q + 2.0 * r + w)
                for s, p, q, r, w in zip(x, a, b, c, d, strict=True)
            )
    return angles


def loaded(torque: Callable[[float, float], float]) -> Callable[[Floats], Floats]:
    """Return what simulates one mass with a damper and a torque of (angle, speed)."""

    def slope(x: State, force: float) -> State:
        return x[1], (force - DAMPER * x[1] + torque(*x)) / MASS

    return lambda u: runge_kutta(u, slope)


def rubbing(u: Floats) -> Floats:
    """Coulomb friction in closed form: between stops the speed decays exponentially."""
    angle, speed, angles = 0.0, 0.0, np.empty((u.size, 1))
    for k, force in enumerate(u.tolist()):
        angles[k], left = angle, 1.0 / RATE
        while left > 0.0:
            if speed == 0.0 and abs(force) <= FRICTION:
                break  # it sticks
            way = math.copysign(1.0, speed if speed != 0.0 else force)
            final = (force - way * FRICTION) / DAMPER  # the speed that it tends to
            ratio = final / (final - speed) if final != speed else 0.0
            stop = -MASS / DAMPER * math.log(ratio) if speed != 0.0 and 0.0 < ratio < 1.0 else left
            part = min(stop, left)
            decay = math.exp(-DAMPER / MASS * part)
            angle += final * part + (speed - final) * MASS / DAMPER * (1.0 - decay)
            speed = 0.0 if stop < left else final + (speed - final) * decay
            left -= part
    return angles


def rattling(u: Floats) -> Floats:
    """Motor and load with play in the shaft between them."""

    def slope(x: State, force: float) -> State:
        bent = x[0] - x[2]
        torque = SHAFT * (bent - min(max(bent, -0.5 * PLAY), 0.5 * PLAY))
        return (
            x[1], (force - DAMPER * x[1] - torque) / MASS,
            x[3], (torque - LOAD_DAMPER * x[3]) / LOAD,
        )  # fmt: skip

    return runge_kutta(u, slope, 2)


RIGS: dict[str, Callable[[Floats], Floats]] = {
    "nothing": loaded(lambda _q, _v: 0.0),
    "friction": rubbing,
    "smooth_friction": loaded(lambda _, v: -FRICTION * math.tanh(v / SMOOTH)),
    "gravity": loaded(lambda q, _: -WEIGHT * math.sin(q)),
    "saturation": lambda u: loaded(lambda _q, _v: 0.0)(np.clip(u, -LIMIT, LIMIT)),
    "play": rattling,
}


def save(rig: str, folder: Path) -> Path:
    """Write the CSV of a rig."""
    u = command()
    angles = np.rad2deg(RIGS[rig](u))
    angles += NOISE_DEG * np.random.default_rng(SEED).standard_normal(angles.shape)
    names = "angle_deg" if angles.shape[1] == 1 else "motor_angle_deg,load_angle_deg"
    path = folder / f"{rig}.csv"
    table = np.column_stack([np.arange(u.size) / RATE, u, angles])
    np.savetxt(path, table, "%.7g", ",", header=f"time,torque_Nm,{names}", comments="")
    return path


def main() -> None:
    """Diagnose each rig, and print a row for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rigs", nargs="*", choices=[*RIGS, []], metavar="RIG")
    parser.add_argument("--out", type=Path, default=Path("runs/newcomer"))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    os.chdir(given.out)
    print("| rig | answer | verdict | seconds |\n|---|---|---|---|")
    for rig in given.rigs or RIGS:
        path, begun = save(rig, Path()), time.monotonic()
        with contextlib.redirect_stdout(io.StringIO()):
            run(["diagnose", str(path), "--json", f"runs/{rig}.json", "--force"])
        answer = json.loads(Path(f"runs/{rig}.json").read_text())
        took = time.monotonic() - begun
        print(f"| {rig} | {answer['headline']} | `{answer['verdict']}` | {took:.0f} |", flush=True)


if __name__ == "__main__":
    main()
