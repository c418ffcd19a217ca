"""A fleet of simulated devices with known faults: is every one found, and how long does it take?

    python -m benchmarks.bench_fleet                  # 200 devices, 5 recordings of each: 1000
    python -m benchmarks.bench_fleet --devices 40 --faults 10
    python -m benchmarks.bench_fleet --cluster 1 2 --recordings 100 200 400   # fits on clusters
    python -m benchmarks.bench_fleet --driver --recordings 1000 10000         # all but the fits

Five kinds of fault (`zwidth.exam.fleets`) in some of the devices, and one whose dry friction drifts
from a date on. Found is a recording that is said to be unlike the others, named one whose reason is
the right one; false is any other recording, and any other change over time. docs/fleets.md and
docs/scale.md say what was seen.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import psutil

from zwidth.exam.fleets import Truth, make_fleet, nominal
from zwidth.fleet.diagnosed import EACH, diagnose_fleet
from zwidth.fleet.kept import Kept
from zwidth.fleet.listing import Listed, listed
from zwidth.fleet.quick import Task, run
from zwidth.fleet.reading import content_of
from zwidth.fleet.result import Fleet
from zwidth.fleet.structure import Structure, known_structure
from zwidth.fleet_report import save_fleet_report
from zwidth.jobs.cluster import Cluster
from zwidth.jobs.executor import Local, Processes
from zwidth.sim.physics import make_physics

SAID = {
    "inverted_sign": "inverted_sign",
    "other_unit": "other_unit",
    "slipped_clamp": "slipped",
    "stale_sensor": "stale_sensor",
    "other_spring": "other_device",
}
PORT = 18797
KNOWN = nominal().with_physics(make_physics("coulomb_friction", "m1", level=0.05))


def marked(found: Fleet, truth: Truth) -> dict[str, object]:
    """Return how many faults were found and named, and what was said falsely."""
    odd = {m.listed.name: m.reason for m in found.members if m.reason is not None}
    sound = len(found.members) - len(truth.faults)
    kinds: dict[str, dict[str, int]] = {}
    for name, kind in truth.faults.items():
        own = kinds.setdefault(kind, {"recordings": 0, "found": 0, "named": 0})
        reason = odd.get(name)
        own["recordings"] += 1
        own["found"] += reason is not None
        own["named"] += reason is not None and reason.kind == SAID[kind]
    false = sorted(set(odd) - set(truth.faults))
    drifts = [c for c in found.changes if c.device == truth.drifting]
    return {
        "recordings": len(found.members),
        "structure": found.structure.labels,
        "kinds": kinds,
        "false": {name: odd[name].sentence for name in false},
        "false_share": len(false) / sound,
        "drifting": truth.drifting,
        "since": str(truth.since),
        "drifts": [found.said_of(c) for c in drifts],
        "false_changes": [found.said_of(c) for c in found.changes if c not in drifts],
        "parameters": [found.said_of_parameter(name) for name in found.spreads],
    }


def exam(folder: Path, devices: int, runs: int, faults: int, seed: int, processes: int) -> None:
    """Make a fleet, diagnose it, diagnose it once more with one recording changed, and say all."""
    truth = make_fleet(folder / "fleet", devices, runs, faults, seed)
    recordings = listed(folder / "fleet")
    begun = time.monotonic()
    times: dict[str, float] = {}

    def say(text: str) -> None:
        times[text] = time.monotonic() - begun
        print(f"{times[text]:6.0f} s  {text}", file=sys.stderr)

    runner = Processes(processes)
    found = diagnose_fleet(nominal(), recordings, folder / "work", runner, say=say)
    took = time.monotonic() - begun
    again = time.monotonic()
    diagnose_fleet(nominal(), recordings, folder / "work", runner)
    rerun = time.monotonic() - again
    seen = marked(found, truth) | {
        "seconds": round(took, 1),
        "seconds_of_a_rerun": round(rerun, 1),
        "processes": processes,
        "load": os.getloadavg(),
    }
    print(json.dumps(seen, indent=1))


def cpu(processes: Sequence[psutil.Process]) -> list[float]:
    """Return the CPU time that each process and its children have taken [s]."""
    return [
        sum(sum(p.cpu_times()[:2]) for p in (one, *one.children(recursive=True)))
        for one in processes
    ]


def known_fits(folder: Path, devices: int, runs: int) -> tuple[list[Listed], Structure]:
    """Make a sound fleet whose structure is known, so that nothing is searched for."""
    make_fleet(folder / "fleet", devices, runs, 0)
    return listed(folder / "fleet"), known_structure(KNOWN)


def clustered(folder: Path, workers: Sequence[int], sizes: Sequence[int]) -> None:
    """Fit fleets on local clusters: seconds of each process, which grow with the recordings.

    Workers that share cores wait for each other, so what counts is the CPU time of each: that of
    the busiest worker is what a cluster takes that has a core for each.
    """
    every, structure = known_fits(folder, max(sizes) // 5, 5)
    print("workers recordings  wall [s]  CPU of workers [s]  busiest  scheduler  driver  each")
    for count in workers:
        port = PORT + count
        address = f"tcp://127.0.0.1:{port}"
        dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1"]
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--no-dashboard"]
        quiet = subprocess.DEVNULL
        started = [subprocess.Popen([*dask, "--port", str(port), "--no-dashboard"], stderr=quiet)]
        time.sleep(3.0)
        alone = [*worker, "--nthreads", "1", "--no-nanny"]
        started += [subprocess.Popen(alone, stderr=quiet) for _ in range(count)]
        try:
            with Cluster(address) as cluster:
                while cluster.cores < count:
                    time.sleep(0.2)
                warm = {f"warm{k}": fits(every[:EACH], structure)["0"] for k in range(4 * count)}
                list(cluster.run(run, warm))  # every worker loads its kernels once
                watched = [psutil.Process(p.pid) for p in started]
                for size in sizes:
                    tasks, begun = fits(every[:size], structure), time.monotonic()
                    before, own = cpu(watched), time.process_time()
                    list(cluster.run(run, tasks))
                    wall, own = time.monotonic() - begun, time.process_time() - own
                    taken = [b - a for a, b in zip(before, cpu(watched), strict=True)]
                    each = " ".join(f"{t:.1f}" for t in taken[1:])
                    print(
                        f"{count:7d} {size:10d} {wall:9.1f} {sum(taken[1:]):19.1f}"
                        f" {max(taken[1:]):8.1f} {taken[0]:10.2f} {own:7.2f}  {each}",
                        flush=True,
                    )
        finally:
            for process in started:
                process.terminate()
                process.wait()


def fits(recordings: Sequence[Listed], structure: Structure) -> dict[str, Task]:
    """Return the tasks that fit recordings, as `diagnose_fleet` cuts them."""
    parts = [recordings[k : k + EACH] for k in range(0, len(recordings), EACH)]
    return {
        str(n): Task(tuple((r.name, r.path) for r in part), structure)
        for n, part in enumerate(parts)
    }


def driven(folder: Path, sizes: Sequence[int]) -> None:
    """Say what the driver takes for a fleet whose fits are all there: seconds of its CPU.

    The fits are those of 100 recordings, each as often as is needed, moved by its own errors.
    """
    few, structure = known_fits(folder, 20, 5)
    quicks = [q for task in fits(few, structure).values() for q in run(task)]
    random = np.random.default_rng(0)
    print("recordings  keep fits  hash and read  decide  JSON  report  MB of report  each [ms]")
    for size in sizes:
        place = folder / str(size)
        every: list[Listed] = []
        for k in range(size):
            one, stem = few[k % len(few)], place / f"d{k // 5:05}" / f"r{k % 5}"
            data = f"# {k}\n" + one.path.with_suffix(".csv").read_text()
            stem.parent.mkdir(parents=True, exist_ok=True)
            stem.with_suffix(".csv").write_text(data)
            text = one.path.read_text().replace(f"{one.path.stem}.csv", f"{stem.name}.csv")
            stem.with_suffix(".toml").write_text(text)
            name = f"{stem.parent.name}/{stem.name}"
            path = stem.with_suffix(".toml")
            every.append(Listed(name, path, stem.parent.name, one.date, one.known))
        kept = Kept(place / "work", KNOWN, "quick")
        kept.keep_structure(structure, size)
        keys = [kept.key(content_of(one.path), structure) for one in every]
        times = [time.process_time()]
        for k, key in enumerate(keys):
            q = quicks[k % len(quicks)]
            moved = q.values + q.errors * random.standard_normal(q.values.size)
            kept.keep_fit(key, replace(q, name=every[k].name, values=moved))
        times.append(time.process_time())
        read = times[-1]

        def told(stage: str, done: int, of: int) -> None:
            nonlocal read
            if stage == "fitting" and done == of:
                read = time.process_time()

        found = diagnose_fleet(KNOWN, every, place / "work", Local(), advance=told)
        times += [read, time.process_time()]
        text = json.dumps(found.as_json())
        times.append(time.process_time())
        page = save_fleet_report(found, "", place / "typical.toml", place / "fleet.html")
        times.append(time.process_time())
        keep, look, decide, dump, report = np.diff(times)
        each = 1e3 * (times[-1] - times[0]) / size
        print(
            f"{size:10d} {keep:10.1f} {look:14.1f} {decide:7.1f} {dump:5.1f} {report:7.1f}"
            f" {page.stat().st_size / 1e6:13.1f} {each:10.2f}",
            flush=True,
        )
        print(f"  {len(found.odd)} unlike, {len(text) / 1e6:.1f} MB of JSON", file=sys.stderr)


def main() -> None:
    """Run what the command line asks for."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--devices", type=int, default=200)
    asked.add_argument("--runs", type=int, default=5)
    asked.add_argument("--faults", type=int, default=25)
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--processes", type=int, default=2)
    asked.add_argument("--cluster", type=int, nargs="+", help="workers of local clusters")
    asked.add_argument("--driver", action="store_true", help="what the driver alone takes")
    asked.add_argument("--recordings", type=int, nargs="+", default=[100, 200, 400])
    given = asked.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if given.cluster:
            clustered(Path(folder), given.cluster, given.recordings)
        elif given.driver:
            driven(Path(folder), given.recordings)
        else:
            exam(Path(folder), given.devices, given.runs, given.faults, given.seed, given.processes)


if __name__ == "__main__":
    main()
