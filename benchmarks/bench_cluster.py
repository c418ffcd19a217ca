"""What a map on a cluster costs: runs, tasks, parts, bytes; docs/scale.md reckons with it.

    python -m benchmarks.bench_cluster

Starts a scheduler and two workers on this machine. Seconds are CPU time of the process that is
named, so other work on the machine hardly changes them; bytes are those of the loopback device, so
nothing else may talk over it (Linux: `unshare --map-root-user --net`, then `ip link set lo up`).
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import psutil

from zwidth.jobs.cluster import Cluster
from zwidth.jobs.store import PartStore
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.physics import make_physics
from zwidth.stability.fate_map import make_map
from zwidth.stability.fates import evaluate
from zwidth.stability.judging import Trial
from zwidth.stability.plane import Axis, Plane, with_friction

PORT = 18786
B, K = Axis("B", 0.0, 0.12), Axis("K", 0.5, 50.0)
PHANTOM = load_device("phantom_1_0")
BACKLASH = make_physics("backlash", "link12", gap=1e-5)
DEVICES: dict[str, tuple[Device, int]] = {
    "step, limit, delay: lanes, 1 substep": (
        PHANTOM.with_interface(encoder_step=1e-4, command_limit=0.5, delay=0.0023), 1,
    ),
    "Coulomb friction at m1: lanes, 10 substeps": (with_friction(PHANTOM, 2e-3), 10),
    "backlash: scalar kernel, 10 substeps": (PHANTOM.with_physics(BACKLASH), 10),
}  # fmt: skip
POINTS = 512  # of a part


def plane(device: Device, substeps: int) -> Plane:
    """Return the K-B plane of a device, all runs of 4 s."""
    return Plane(device, B, K, trial=Trial(1e-3, 4.0, 4.0, substeps=substeps))


def points(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return places spread over the plane."""
    rng = np.random.default_rng(1)
    return rng.uniform(0.0, 0.12, count), rng.uniform(0.5, 50.0, count)


def seconds(work: Callable[[], object], repeats: int) -> float:
    """Return the least CPU time of one call on one thread."""
    found: list[float] = []
    for _ in range(repeats):
        before = time.process_time()
        work()
        found.append(time.process_time() - before)
    return min(found)


def cpu(processes: Sequence[psutil.Process]) -> float:
    """Return the CPU time that processes have taken."""
    return sum(sum(p.cpu_times()[:2]) for p in processes)


def on_the_wire() -> int:
    """Return the bytes that the loopback device has sent."""
    return int(psutil.net_io_counters(pernic=True)["lo"].bytes_sent)


def runs() -> None:
    """Runs of 4 s a second and core."""
    print("runs of 4 s, one core                             CPU a run    runs/s   10^9 runs")
    for name, (device, substeps) in DEVICES.items():
        count = POINTS if "lanes" in name else 64
        some, (x, y) = plane(device, substeps), points(count)
        evaluate(some, x, y, 1)
        each = seconds(lambda s=some, x=x, y=y: evaluate(s, x, y, 1), 5) / count
        hours = each * 1e9 / 3600.0
        print(f"{name:48s} {each * 1e6:8.1f} us {1 / each:9.0f} {hours:8.1f} core hours")


def parts() -> None:
    """What the driver takes to keep a part."""
    device, substeps = DEVICES["step, limit, delay: lanes, 1 substep"]
    found = evaluate(plane(device, substeps), *points(POINTS), 1)
    number = np.arange(POINTS)
    with tempfile.TemporaryDirectory() as folder:
        store = PartStore(Path(folder), {"sha256": "", "engine": ""}, ("map", "plane"))
        part = {"points": number, **asdict(found)}

        def keep() -> None:
            for i in range(200):
                store.write(i, part)

        each = seconds(keep, 3) / 200
        size = (Path(folder) / "part-00000.npz").stat().st_size
    print(f"\na part of {POINTS} runs, kept by the driver: {each * 1e3:.2f} ms, {size} bytes")


def tasks(processes: Sequence[psutil.Process]) -> None:
    """What a task costs scheduler and driver, and how many bytes a part is."""
    driver, scheduler = psutil.Process(), processes[0]
    with Cluster(f"tcp://127.0.0.1:{PORT}") as runner:
        while runner.cores < 2:
            time.sleep(0.1)
        list(runner.run(abs, {str(i): i for i in range(200)}))
        for count in (2000, 4000):
            before = cpu([scheduler]), cpu([driver]), on_the_wire(), time.perf_counter()
            list(runner.run(abs, {str(i): i for i in range(count)}))
            print(
                f"{count} tasks that do nothing: scheduler"
                f" {(cpu([scheduler]) - before[0]) / count * 1e6:.0f} us a task, driver"
                f" {(cpu([driver]) - before[1]) / count * 1e6:.0f} us,"
                f" {(on_the_wire() - before[2]) / count:.0f} bytes;"
                f" wall {(time.perf_counter() - before[3]) / count * 1e6:.0f} us"
            )
        device, substeps = DEVICES["step, limit, delay: lanes, 1 substep"]
        make_map(plane(device, substeps), 9, 0, runner=runner)  # workers compile, or load kernels
        before = cpu([scheduler]), cpu([driver]), on_the_wire(), time.perf_counter()
        working = cpu(processes[1:])
        with tempfile.TemporaryDirectory() as folder:
            found = make_map(plane(device, substeps), 257, 0, Path(folder), runner=runner)
        count, wall = found.runs / POINTS, time.perf_counter() - before[3]
        each = (cpu(processes[1:]) - working) / found.runs * 1e6
        print(
            f"a map of {found.runs} runs: workers {each:.1f} us a run; of {count:.0f} parts each:"
            f" driver {(cpu([driver]) - before[1]) / count * 1e3:.2f} ms, scheduler"
            f" {(cpu([scheduler]) - before[0]) / count * 1e3:.2f} ms,"
            f" {(on_the_wire() - before[2]) / count:.0f} bytes; wall {wall:.2f} s"
        )


def main() -> None:
    """Print all figures."""
    runs()
    parts()
    local = ["--host", "127.0.0.1", "--no-dashboard"]
    prefix = [sys.executable, "-m"]
    commands = [["distributed.cli.dask_scheduler", "--port", str(PORT), *local]]
    worker = ["distributed.cli.dask_worker", f"tcp://127.0.0.1:{PORT}", *local]
    commands += [[*worker, "--no-nanny", "--nthreads", "1"]] * 2
    root = Path(__file__).parents[1]
    null = subprocess.DEVNULL
    started = [
        subprocess.Popen([*prefix, *c], cwd=root, stdout=null, stderr=null) for c in commands
    ]
    try:
        tasks([psutil.Process(p.pid) for p in started])
    finally:
        for process in started:
            process.kill()
            process.wait()


if __name__ == "__main__":
    main()
