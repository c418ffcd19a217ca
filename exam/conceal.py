"""Many concealed recordings: in which order, with which effects, written with their sealed keys."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from zwidth.exam.drawing import Concealed, draw
from zwidth.exam.strata import STRATA
from zwidth.files.protection import check, reading
from zwidth.files.whole import write_text
from zwidth.jobs.executor import Executor
from zwidth.scenarios.concealed.handout import (
    all_files,
    key_file,
    made_file,
    names,
    recording_files,
    write_data,
    write_description,
)
from zwidth.scenarios.concealed.sealing import SALT_BYTES, digest, seal, write_key
from zwidth.sim.device_file import device_to_text

Said = Callable[[str], None]


@dataclass(frozen=True)
class Order:
    """One recording to be made; rank: its number within its class."""

    folder: str
    name: str
    stratum: str
    seed: int
    index: int
    rank: int
    seconds: float | None


def orders(
    folder: Path, asked: Mapping[str, int], seed: int, seconds: float | None = None
) -> list[Order]:
    """Return the recordings to be made, in an order that tells nothing of their classes."""
    ranked = [(stratum, rank) for stratum, n in asked.items() for rank in range(n)]
    shuffled = np.random.default_rng([seed, len(ranked)]).permutation(len(ranked))
    found: list[Order] = []
    for i, j in enumerate(shuffled):
        stratum, rank = ranked[int(j)]
        found.append(Order(str(folder.resolve()), f"r{i + 1:04d}", stratum, seed, i, rank, seconds))
    return found


def conceal(
    folder: Path, asked: Sequence[Order], executor: Executor, done: Said = lambda _: None
) -> int:
    """Make the recordings that are not yet there; return how many were made.

    Each is finished when its key is there, so that an interrupted run goes on where it stopped.
    Raises OSError where they cannot be written, ValueError where the folder holds others.
    """
    for part in ("recordings", "keys"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    _refuse_others(folder, asked)
    unfinished = {o.name: o for o in asked if not key_file(folder, o.name).exists()}
    for name, _ in executor.run(make, unfinished):
        done(name)
    return len(unfinished)


def _refuse_others(folder: Path, asked: Sequence[Order]) -> None:
    """Keep beside the keys what they were made by, and mix nothing with it."""
    text = "".join(f"{o.name} {o.stratum} {o.seed} {o.rank} {o.seconds}\n" for o in asked)
    listed = made_file(folder)
    if not listed.exists():
        if names(folder):
            raise ValueError(f"{folder} holds keys, but no {listed.name}; choose another folder")
        for order in asked:
            check(*all_files(folder, order.name))
        write_text(listed, text, own=True)
    elif reading(listed).read_text(encoding="utf-8") != text:
        raise ValueError(
            f"{folder} holds recordings of another seed, count or class; choose another folder"
        )


def make(order: Order) -> str:
    """Draw and write one recording; the key comes last."""
    folder = Path(order.folder)
    made = draw(STRATA[order.stratum], order.seed, order.index, order.rank, order.seconds)
    write_data(folder, order.name, made.trace, made.nominal)
    key = key_of(order, made)
    random = np.random.default_rng([order.seed, order.index, 1])
    salt = random.bytes(SALT_BYTES).hex()
    write_description(folder, order.name, made.trace, made.nominal, seal(salt, key))
    write_key(key_file(folder, order.name), salt, key)
    return order.name


def key_of(order: Order, made: Concealed) -> dict[str, Any]:
    """Return everything that is known of a recording, in JSON's types."""
    files = recording_files(Path(order.folder), order.name)
    rig = made.rig
    outside = rig.outside
    return {
        "recording": order.name,
        "stratum": made.stratum,
        "seed": order.seed,
        "index": order.index,
        "rank": order.rank,
        "hidden": [asdict(h) for h in made.hidden],
        "outside": None if outside is None else {"name": outside.name, **outside.values},
        "device": device_to_text(rig.device),
        "device_file": "fitted to this recording" if made.fitted else "up to 10 % off",
        "drive": {"kind": rig.drive.kind, "feedback": list(rig.drive.feedback)},
        "noise": asdict(rig.nuisance),
        "sha256": {name: digest(path) for name, path in files.items()},
    }
