"""How old is what `zwidth watch` says? A log that grows at 1 kHz, with a gap in it at half time.

    python -m benchmarks.bench_watch                  # 40 s of samples in 40 s
    python -m benchmarks.bench_watch --seconds 120

A motor with dry friction that its device file does not know is recorded, and its table fed to a
file at the pace at which it was recorded. Told is, in seconds of the wall clock: how long after the
gap stood in the file the gate spoke of it; how old the newest sample of each quick fit was when it
was told, and how far apart these are; when each search was told. Beside it stands the CPU time of a
look at the whole log, which does not depend on what else the machine does. docs/watch.md says what
was seen.
"""

import argparse
import os
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from zwidth.commands.watch import GIVES_WAY
from zwidth.controllers.excitation import random_steps
from zwidth.controllers.recorded import recorded
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate
from zwidth.watch.growing import Growing, of_file
from zwidth.watch.state import gate, read
from zwidth.watch.updates import QUICK, Update
from zwidth.watch.watching import Asked, follow
from zwidth.watch.worker import Worker

MOTOR = Device("motor", "", True, make_chain([1.2e-3], [6e-3]), Interface(period=0.001))
GAP = 50  # samples that lack
AHEAD_S = 1.0  # of samples that stand in the file already
STARTING_S = 20.0  # until the processes have started
HEAD = "t [s],u [N m],q [rad]\n"


def lines(seconds: float) -> list[str]:
    """Return the lines of a recording with a gap at half time."""
    truth = MOTOR.with_physics(make_physics("coulomb_friction", "m1", level=0.02))
    rng = np.random.default_rng(0)
    ticks = round(seconds * 1000)
    command = random_steps(0.1, duration=seconds)[:ticks]
    pushed = 1e-3 * rng.standard_normal(command.size)
    trace = simulate(truth, recorded(command), duration=seconds, disturbance=pushed).trace
    q = trace["position_m1"] + 1e-5 * rng.standard_normal(len(trace))
    rows = zip(trace.t.tolist(), trace["command"].tolist(), q.tolist(), strict=True)
    every = [f"{t:.6f},{u:.9g},{x:.9g}\n" for t, u, x in rows]
    half = len(every) // 2
    return every[:half] + every[half + GAP :]


def main() -> None:
    """Feed a log, follow it, and print how old each update was."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--seconds", type=float, default=40.0)
    seconds = asked.parse_args().seconds
    every = lines(seconds)
    stamps = np.array([float(line.partition(",")[0]) for line in every])
    told: list[tuple[float, float, Update]] = []
    began = 0.0

    def tell(update: Update) -> None:
        now = time.monotonic() - began
        age = now + AHEAD_S - float(update.values.get("to_s", update.seconds))
        told.append((now + AHEAD_S, age, update))
        print(f"{age:7.2f} s old  {update.line[:150]}", flush=True)

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        path.write_text(HEAD)
        workers = Worker(), Worker(GIVES_WAY)
        time.sleep(STARTING_S)
        began = time.monotonic()

        def feed() -> None:
            done = 0
            with path.open("a") as file:
                while done < len(every):
                    upto = int(np.searchsorted(stamps, time.monotonic() - began + AHEAD_S))
                    file.write("".join(every[done:upto]))
                    file.flush()
                    done = upto
                    time.sleep(0.02)

        threading.Thread(target=feed, daemon=True).start()
        log = Growing(of_file(path), "copy.csv", Path(folder))
        follow(Asked(log, None, "log", MOTOR, 0.0, None, 5.0), tell, workers)
        for worker in workers:
            worker.close()
        took = time.process_time()
        gate(read(log.spool, None), MOTOR, "log")
        took = time.process_time() - took
    after = float(stamps[1:][np.diff(stamps) > 0.01][0])
    late = [at - after for at, _, u in told if "missing in a gap" in u.sentence]
    quick = np.array([(at, age) for at, age, u in told if u.kind == QUICK and at < seconds])
    if late and len(quick) > 1:
        print(f"\nthe gap was told {late[0]:.1f} s after it stood in the file;", end=" ")
        print(f"quick fits: {len(quick)}, {np.median(quick[:, 1]):.1f} s old (oldest", end=" ")
        print(f"{quick[:, 1].max():.1f} s), one every {np.median(np.diff(quick[:, 0])):.1f} s")
    print(f"to read and examine the whole takes {took:.2f} s of CPU")
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")


if __name__ == "__main__":
    main()
