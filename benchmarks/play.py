"""Two masses with play in their link: what a diagnosis calls it, and its gap. One row a seed.

    python -m benchmarks.play [SEED ...]

Masses, link, gap, noise and encoder are drawn anew for every seed; the device file is up to 20 %
off. Alone, with friction on the motor or with friction on the load; the load is measured in one
recording of four. 12 s at 500 Hz. Seeds 1 to 12 unless told; no search was developed on them but
1 to 6.
"""

import argparse
import os
import time
from dataclasses import dataclass

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command does: cores go to simulations

import numpy as np
from numpy.typing import NDArray

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate

Floats = NDArray[np.float64]
PERIOD, TICKS, FIRST = 2e-3, 6000, 20281500
ELSEWHERE = ("", "m1", "m2")  # of the friction


@dataclass(frozen=True)
class Made:
    """A recording, its device file, and the gap and the effects that the machine has."""

    experiment: Experiment
    device: Device
    gap: float
    effects: frozenset[tuple[str, str]]


def made(seed: int) -> Made:
    """Draw a machine and record it."""
    random = np.random.default_rng(FIRST + seed)
    masses = 1e-3 * random.uniform(0.5, 1.5, 2)
    reduced = masses[0] * masses[1] / masses.sum()
    spring = reduced * (2.0 * np.pi * random.uniform(12.0, 35.0)) ** 2
    dampers = np.array([4e-3, 2e-3]) * random.uniform(0.5, 1.5, 2)
    damper = 0.1 * np.sqrt(spring * reduced) * random.uniform(0.5, 2.0)
    gap, level = 0.02 * random.uniform(0.5, 2.0), 0.03 * random.uniform(0.5, 1.5)
    physics = [make_physics("backlash", "link12", gap=gap)]
    if rubs := ELSEWHERE[seed % 3]:
        physics.append(make_physics("coulomb_friction", rubs, level=level))
    values = np.array([*masses, *dampers, spring, damper])
    truth, device = (
        _device(values * off) for off in (np.ones(6), 1.0 + 0.2 * random.uniform(-1.0, 1.0, 6))
    )
    t = np.arange(TICKS) * PERIOD
    waves = zip(random.uniform(0.3, 4.0, 4), random.uniform(0.0, 6.0, 4), strict=True)
    white = np.convolve(random.standard_normal(TICKS), np.full(3, 1.0 / 3.0), "same")
    command = 0.06 * sum(np.sin(2.0 * np.pi * f * t + phase) for f, phase in waves)
    command = command + 0.05 * white / white.std()
    force = np.zeros((TICKS, 2))
    force[:, 0] = random.choice([3e-4, 1e-3, 3e-3]) * random.standard_normal(TICKS)
    run = simulate(
        truth.with_physics(*physics), recorded(command), duration=TICKS * PERIOD,
        disturbance=force, substeps=64,
    )  # fmt: skip
    seen = [run.trace[f"position_m{i + 1}"] for i in range(2 if seed % 4 == 3 else 1)]
    step = 2.0 * np.pi / random.choice([20_000, 80_000])
    read = np.column_stack(seen)
    read = step * np.round((read + 2e-5 * random.standard_normal(read.shape)) / step)
    outputs = tuple(Output("position", i) for i in range(read.shape[1]))
    effects = frozenset((p.effect.name, p.at) for p in physics) | {("encoder_step", "sensor")}
    return Made(Experiment(PERIOD, command, read, outputs), device, gap, effects)


def _device(values: Floats) -> Device:
    """Two masses: of masses (2), dampers (2), spring and damper of the link."""
    m1, m2, b1, b2, spring, damper = values.tolist()
    chain = make_chain([m1, m2], [b1, b2], 0.0, [spring], [damper])
    return Device("two masses", "", True, chain, Interface(period=PERIOD))


def main() -> None:
    """Diagnose, and print a row a seed."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("seeds", type=int, nargs="*", default=list(range(1, 13)))
    print("| seed | measured | friction | verdict | missed | claimed | gap | found | CPU s |")
    print("|---|---|---|---|---|---|---|---|---|")
    for seed in options.parse_args().seeds:
        one, begun = made(seed), time.process_time()
        found = diagnose(one.device, [one.experiment])
        spent = time.process_time() - begun
        named = {(f.effect, f.at) for f in found.findings}
        lacks, more = (
            ", ".join(f"{effect} at {at}" for effect, at in sorted(some))
            for some in (
                one.effects - named - {("encoder_step", "sensor")},
                named - one.effects,
            )
        )
        gaps = [f.parameters["gap"] for f in found.findings if f.effect == "backlash"]
        told = ", ".join(f"{g.value:.5f} ({g.lower:.5f} to {g.upper:.5f})" for g in gaps)
        measured = "both" if len(one.experiment.outputs) == 2 else "m1"
        print(
            f"| {seed} | {measured} | {ELSEWHERE[seed % 3] or 'none'} | `{found.verdict.value}`"
            f" | {lacks} | {more} | {one.gap:.5f} | {told} | {spent:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
