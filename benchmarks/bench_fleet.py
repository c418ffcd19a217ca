"""A fleet of simulated devices with known faults: is every one found, and how long does it take?

    python -m benchmarks.bench_fleet                  # 200 devices, 5 recordings of each: 1000
    python -m benchmarks.bench_fleet --devices 40 --faults 10
    python -m benchmarks.bench_fleet --cluster 1 2    # the fits alone, on local clusters of workers

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
from pathlib import Path

from zwidth.exam.fleets import Truth, make_fleet, nominal
from zwidth.fleet.diagnosed import EACH, diagnose_fleet
from zwidth.fleet.listing import listed
from zwidth.fleet.quick import Task, run
from zwidth.fleet.result import Fleet
from zwidth.fleet.structure import structure_from
from zwidth.jobs.cluster import Cluster
from zwidth.jobs.executor import Processes

SAID = {
    "inverted_sign": "inverted_sign",
    "other_unit": "other_unit",
    "slipped_clamp": "slipped",
    "stale_sensor": "stale_sensor",
    "other_spring": "other_device",
}
PORT = 18797


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


def clustered(folder: Path, workers: Sequence[int], devices: int, runs: int) -> None:
    """Fit a fleet on local clusters, and say how many recordings a second that is."""
    make_fleet(folder / "fleet", devices, runs, 0)
    recordings = listed(folder / "fleet")
    found = diagnose_fleet(nominal(), recordings[: 4 * runs], folder / "work")
    structure = structure_from(found.structure.to_json())
    parts = [recordings[k : k + EACH] for k in range(0, len(recordings), EACH)]
    tasks = {
        str(n): Task(tuple((r.name, r.path) for r in part), structure)
        for n, part in enumerate(parts)
    }
    for count in workers:
        address = f"tcp://127.0.0.1:{PORT + count}"
        dask = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
        scheduler = subprocess.Popen(
            [*dask, "--host", "127.0.0.1", "--port", str(PORT + count), "--no-dashboard"],
            stderr=subprocess.DEVNULL,
        )
        time.sleep(3.0)
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address]
        others = [
            subprocess.Popen(
                [*worker, "--nthreads", "1", "--no-dashboard", "--nanny"],
                stderr=subprocess.DEVNULL,
            )
            for _ in range(count)
        ]
        try:
            time.sleep(8.0)
            with Cluster(address) as cluster:
                # Every worker loads its kernels once.
                warm = {f"warm{k}": tasks["0"] for k in range(2 * count)}
                list(cluster.run(run, warm))
                begun = time.monotonic()
                list(cluster.run(run, tasks))
                took = time.monotonic() - begun
            print(f"{count} workers: {len(recordings) / took:.1f} recordings a second")
        finally:
            for process in [*others, scheduler]:
                process.terminate()
                process.wait()


def main() -> None:
    """Run what the command line asks for."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--devices", type=int, default=200)
    asked.add_argument("--runs", type=int, default=5)
    asked.add_argument("--faults", type=int, default=25)
    asked.add_argument("--seed", type=int, default=0)
    asked.add_argument("--processes", type=int, default=2)
    asked.add_argument("--cluster", type=int, nargs="+")
    given = asked.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if given.cluster:
            clustered(Path(folder), given.cluster, given.devices, given.runs)
        else:
            exam(Path(folder), given.devices, given.runs, given.faults, given.seed, given.processes)


if __name__ == "__main__":
    main()
