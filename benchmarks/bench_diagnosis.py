"""Diagnosis: what it costs by what is missing, wall time by length, and the memory of a long one.

    python -m benchmarks.bench_diagnosis                the account of six recordings
    python -m benchmarks.bench_diagnosis --by           and what each stage simulated, and why
    python -m benchmarks.bench_diagnosis 10 20
    python -m benchmarks.bench_diagnosis --masses 1 600

The account: CPU seconds of all threads of a diagnosis, simulations of the fitted part, calls of
the kernel and its CPU seconds (`zwidth.diagnosis.account`), of `benchmarks/account_rigs.py`;
`--json` of a command has the same as `cost`. Each length [s] at 1 kHz: white torque on the PHANToM
of Table I (or on a single mass), once clean, once with Coulomb friction of 4 mN m. All cores are
used; run it on an idle machine. Kernels are compiled before.
"""

import argparse
import os
import resource
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command does: cores go to simulations

import numpy as np

from benchmarks.account_rigs import RIGS
from zwidth.controllers.excitation import noise
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate

FRICTION = make_physics("coulomb_friction", "m1", level=4e-3)
SINGLE = Device("one mass", "", True, make_chain([2e-4], [2e-3]), Interface(period=1e-3))
FORCE_NOISE, ENCODER_NOISE = 2e-3, 1e-5


def record(truth: Device, seconds: float) -> Experiment:
    """Return what the encoder of a device says of white torque."""
    command = noise(duration=seconds, seed=1)
    random = np.random.default_rng(0)
    force = FORCE_NOISE * random.standard_normal(command.size)
    run = simulate(
        truth, recorded(command), duration=seconds, disturbance=force,
        substeps=20 if truth.physics else 1,
    )  # fmt: skip
    position = run.trace["position_m1"] + ENCODER_NOISE * random.standard_normal(command.size)
    return Experiment(1e-3, command, position[:, None], (Output("position", 0),))


def account(each: bool) -> None:
    """Diagnose the recordings of the account, and print a row of each."""
    first = next(iter(RIGS.values()))()
    diagnose(first.device, [first.experiment().part(0, 2000)])  # compiles
    print("| recording | CPU s | simulations | calls | CPU s of the kernel | answer |")
    print("|---|---|---|---|---|---|")
    for name, make in RIGS.items():
        rig = make()
        recorded, begun = rig.experiment(), time.process_time()
        found = diagnose(rig.device, [recorded])
        spent, cost = time.process_time() - begun, found.cost
        names = ", ".join(f"{f.effect} at {f.at}" for f in found.findings)
        print(
            f"| {name} | {spent:.1f} | {cost['simulations']:.0f} | {cost['calls']}"
            f" | {cost['kernel_cpu_s']:.1f} | `{found.verdict.value}` {names} |",
            flush=True,
        )
        for row in cost["by"] if each else ():
            print(
                f"    {row['stage']}, {row['reason']}: {row['simulations']:.0f} simulations,"
                f" {row['calls']} calls, {row['kernel_cpu_s']:.1f} s"
            )


def main() -> None:
    """Diagnose, and say what it took."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("seconds", type=float, nargs="*", help="length of a recording")
    options.add_argument("--masses", type=int, choices=(1, 3), default=3, help="of the device")
    options.add_argument("--by", action="store_true", help="of the account, stages and reasons")
    given = options.parse_args()
    if not given.seconds:
        account(given.by)
        return
    device = SINGLE
    if given.masses == 3:
        device = load_device("phantom_1_0").with_interface(delay=0.0)
    diagnose(device, [record(device.with_physics(FRICTION), 2.0)])  # compiles
    for seconds in given.seconds:
        for truth in (device, device.with_physics(FRICTION)):
            e = record(truth, seconds)
            wall, core = time.perf_counter(), time.process_time()
            found = diagnose(device, [e])
            wall, core = time.perf_counter() - wall, time.process_time() - core
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
            names = ", ".join(f.effect for f in found.findings) or found.verdict.value
            print(
                f"{seconds:g} s, {given.masses} masses: {wall:.1f} s, {core:.1f} s of cores,"
                f" peak {peak:.2f} GiB: {names}",
                flush=True,
            )


if __name__ == "__main__":
    main()
