"""How small may a fault in a fleet be, and still be found?

    python -m benchmarks.small_faults                 # all kinds
    python -m benchmarks.small_faults slipped_clamp --rounds 2
    python -m benchmarks.small_faults --unasked       # whether found, and not why: much quicker

A fleet of 24 sound joints, five recordings of 6 s at 100 Hz of each (`zwidth.exam.fleets`). In each
round one recording of a few devices gets a fault of one kind, its size drawn between two bounds,
evenly in its logarithm; or all recordings of a few devices have another spring, or a dry friction
that grows from the third week on. Over the sizes s of all rounds a logistic curve is fitted,

    P(found) = 1 / (1 + exp(-(a + b ln s))),

with a slight penalty on b, which a clean cut between found and missed would send to infinity. What
is printed are the sizes at which it is 1/2 and 9/10. The seed had no part in anything else.
docs/fleets.md says what was seen.
"""

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from zwidth.exam.fleets import BEGIN, DRY, OWN_FRICTION, WEEK, nominal, record
from zwidth.fleet.diagnosed import diagnose_fleet
from zwidth.fleet.kept import Kept
from zwidth.fleet.listing import Listed
from zwidth.fleet.reasons import Reason, explained
from zwidth.fleet.result import Fleet
from zwidth.fleet.structure import known_structure
from zwidth.jobs.executor import Executor, Local, Processes
from zwidth.sim.physics import make_physics

SEED = 7310
DEVICES, RUNS = 24, 5
SECONDS = 6.0
DRIFTS_FROM = 2  # the recording from which on a friction grows
PENALTY = 0.02  # on b squared, beside the -ln likelihood
DEVICE = nominal().with_physics(make_physics("coulomb_friction", "m1", level=0.04))
Case = tuple[float, bool, bool]  # size, found, named with the right reason
SAID = {
    "other_unit": "other_unit",
    "slipped_clamp": "slipped",
    "stale_sensor": "stale_sensor",
    "other_spring": "other_device",
}


@dataclass(frozen=True)
class Kind:
    """A kind of fault: sizes between two bounds, on how many devices in each of how many rounds.

    every: whether all recordings of a device have it; sizes: the only ones that there are.
    """

    least: float
    most: float
    devices: int
    rounds: int
    every: bool = False
    sizes: Sequence[float] = ()


# A size is what a fault differs by from a sound recording: of factors, what they are beyond 1.
KINDS: Mapping[str, Kind] = {
    "slipped_clamp": Kind(1e-4, 0.1, 6, 6),
    "other_unit": Kind(0.01, 1.0, 6, 5),
    "drift": Kind(0.02, 1.0, 3, 8, every=True),
    "other_spring": Kind(0.005, 0.5, 3, 7, every=True),
    "stale_sensor": Kind(2.0, 4.0, 6, 3, sizes=(2.0, 3.0, 4.0)),
}


class Unasked(Local):
    """Runs fits, and asks of no recording why it is unlike the others."""

    def run(
        self, function: Callable[[Any], Any], tasks: Mapping[str, Any]
    ) -> Generator[tuple[str, Any]]:
        """Yield (key, what was found) in the order of the tasks."""
        if function is explained:
            yield from ((key, Reason("unexplained", "nobody asked", 0.0)) for key in tasks)
        else:
            yield from super().run(function, tasks)


@dataclass(frozen=True)
class Rig:
    """The sound fleet: its recordings, and the dry friction and load of each."""

    folder: Path
    listed: list[Listed]
    levels: list[float]
    loads: list[float]

    def of(self, device: int) -> list[int]:
        """Return the places of a device's recordings."""
        return list(range(device * RUNS, (device + 1) * RUNS))


def made(folder: Path, seed: int) -> Rig:
    """Record the sound fleet."""
    random = np.random.default_rng(seed)
    rig = Rig(folder, [], [], [])
    for d in range(DEVICES):
        level = DRY * (1.0 + OWN_FRICTION * float(random.standard_normal()))
        for run in range(RUNS):
            name, load = f"d{d:03}/r{run:02}", float(random.uniform(0.0, 2.0))
            record(folder / name, random, level, load, seconds=SECONDS)
            when = datetime(BEGIN.year, BEGIN.month, BEGIN.day, tzinfo=UTC)
            when += timedelta(days=WEEK * run)
            path = (folder / name).with_suffix(".toml")
            rig.listed.append(Listed(name, path, f"d{d:03}", when, {"load [kg]": load}))
            rig.levels.append(level)
            rig.loads.append(load)
    return rig


def with_faults(
    rig: Rig, kind: str, number: int, random: np.random.Generator
) -> tuple[list[Listed], dict[str, tuple[float, list[str]]]]:
    """Return the fleet with faults of a kind; by device its size and the recordings with it."""
    how, fleet = KINDS[kind], list(rig.listed)
    told: dict[str, tuple[float, list[str]]] = {}
    for k, d in enumerate(random.permutation(DEVICES)[: how.devices].tolist()):
        size = float(np.exp(random.uniform(np.log(how.least), np.log(how.most))))
        size = how.sizes[k % len(how.sizes)] if how.sizes else size
        places = rig.of(d)
        places = places if how.every else [places[int(random.integers(RUNS))]]
        for i in places:
            one = rig.listed[i]
            grown = max(0, i % RUNS - DRIFTS_FROM + 1) / (RUNS - DRIFTS_FROM)
            level = rig.levels[i] * (1.0 + (size * grown if kind == "drift" else 0.0))
            given = 1.0 + size if kind in ("other_unit", "other_spring") else size
            stem = rig.folder / f"{kind}-{number}" / one.name
            fault = "" if kind == "drift" else kind
            record(stem, random, level, rig.loads[i], fault, SECONDS, given)
            fleet[i] = replace(one, path=stem.with_suffix(".toml"))
        told[f"d{d:03}"] = size, [rig.listed[i].name for i in places]
    return fleet, told


def cases(kind: str, found: Fleet, told: Mapping[str, tuple[float, list[str]]]) -> list[Case]:
    """Return size, whether it was found and whether with the right reason, of each device."""
    reasons = {m.listed.name: m.reason for m in found.members if m.reason is not None}
    every: list[Case] = []
    for device, (size, names) in told.items():
        if kind == "drift":
            mine = [c for c in found.changes if c.device == device]
            named = any(c.parameter == "coulomb_friction@m1.level" for c in mine)
            every.append((size, bool(mine), named))
            continue
        odd = [reasons[n] for n in names if n in reasons]
        named = [r for r in odd if r.kind == SAID[kind]]
        every.append((size, 2 * len(odd) > len(names), 2 * len(named) > len(names)))
    return every


def curve(sizes: np.ndarray, found: np.ndarray) -> tuple[float, float]:
    """Return the sizes at which half and nine in ten are found; infinite if none ever is."""
    if not found.any():
        return math.inf, math.inf
    x = np.log(sizes)
    middle, sign = float(x.mean()), np.where(found, 1.0, -1.0)

    def cost(p: np.ndarray) -> float:
        margin = sign * (p[0] + p[1] * (x - middle))
        return float(np.logaddexp(0.0, -margin).sum() + PENALTY * p[1] ** 2)

    a, b = minimize(cost, np.array([0.0, 1.0]), method="Nelder-Mead").x
    half, most = (float(np.exp(middle + (v - a) / b)) for v in (0.0, np.log(9.0)))
    return half, most


def asked(rig: Rig, kind: str, rounds: int | None, work: Path, runner: Executor) -> object:
    """Ask all rounds of a kind."""
    random = np.random.default_rng([SEED, list(KINDS).index(kind)])
    every: list[Case] = []
    false: set[str] = set()
    for number in range(KINDS[kind].rounds if rounds is None else rounds):
        fleet, told = with_faults(rig, kind, number, random)
        found = diagnose_fleet(DEVICE, fleet, work, runner)
        every += cases(kind, found, told)
        at_fault = {n for _, names in told.values() for n in names}
        false |= {m.listed.name for m in found.odd} - at_fault
        print(f"{kind}, round {number + 1}: {len(every)} cases", file=sys.stderr, flush=True)
    table = np.array(sorted(every), dtype=np.float64)
    sizes, seen, named = table[:, 0], table[:, 1] > 0.5, table[:, 2] > 0.5
    said: dict[str, object] = {"cases": len(every), "false": sorted(false)}
    if KINDS[kind].sizes:
        for size in KINDS[kind].sizes:
            mine = sizes == size
            said[f"{size:g}"] = [int(mine.sum()), int(seen[mine].sum()), int(named[mine].sum())]
    else:
        said["found_half_and_nine_in_ten"] = curve(sizes, seen)
        if not isinstance(runner, Unasked):
            said["named_half_and_nine_in_ten"] = curve(sizes, named)
        said["table"] = [(float(f"{s:.3g}"), bool(f), bool(n)) for s, f, n in table.tolist()]
    return said


def main() -> None:
    """Run what the command line asks for."""
    given = argparse.ArgumentParser(description=__doc__)
    given.add_argument("kinds", nargs="*", default=list(KINDS))
    given.add_argument("--rounds", type=int)
    given.add_argument("--processes", type=int, default=1)
    given.add_argument("--unasked", action="store_true")
    line = given.parse_args()
    runner = Local() if line.processes == 1 else Processes(line.processes)
    runner = Unasked() if line.unasked else runner
    with tempfile.TemporaryDirectory() as folder:
        rig, work = made(Path(folder) / "fleet", SEED), Path(folder) / "work"
        # Which physics it is, is not what is asked here.
        Kept(work, DEVICE, "quick").keep_structure(known_structure(DEVICE), len(rig.listed))
        sound = diagnose_fleet(DEVICE, rig.listed, work, runner)
        print(json.dumps({"sound": sound.headline, "structure": sound.structure.labels}))
        for kind in line.kinds:
            said = asked(rig, kind, line.rounds, work, runner)
            print(json.dumps({kind: said}), flush=True)


if __name__ == "__main__":
    main()
