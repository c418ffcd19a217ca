"""Making of many concealed recordings: their order and effects, written with sealed keys."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from zwidth.exam.by_mujoco import BY_MUJOCO
from zwidth.exam.drawing import draw
from zwidth.exam.laboratory import draw_laboratory
from zwidth.exam.outsiders import draw_outsider
from zwidth.exam.rigs import draw_rig
from zwidth.exam.strata import LABORATORY, MUJOCO, OUTSIDE, RIGS, STRATA
from zwidth.exam.subject import Subject
from zwidth.export.mujoco_run import engine
from zwidth.files.protection import check, reading
from zwidth.files.whole import write_text
from zwidth.jobs.executor import Executor
from zwidth.scenarios.concealed.handout import (
    PARTS,
    VALIDATION,
    all_files,
    key_file,
    made_file,
    names,
    recording_files,
    write_data,
    write_descriptions,
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
    """Return the recordings to be made, in an order that does not reveal their classes.

    Raises ValueError for rigs of MuJoCo where that is not installed.
    """
    if MUJOCO in asked and engine() is None:
        raise ValueError(f"{MUJOCO} needs MuJoCo, which is not installed; pip install mujoco")
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
    """Make the recordings that do not exist yet; return how many were made.

    A recording is finished when its key exists, so that an interrupted run continues where it
    stopped. Raises OSError if they cannot be written, ValueError if the folder holds others.
    """
    for part in ("recordings", "keys"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    _refuse_others(folder, asked)
    unfinished = {o.name: o for o in asked if not key_file(folder, o.name).exists()}
    for name, _ in executor.run(make, unfinished):
        done(name)
    return len(unfinished)


def _refuse_others(folder: Path, asked: Sequence[Order]) -> None:
    """Keep the settings beside the keys, and refuse a folder with other ones."""
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
    """Draw and write one subject with its recordings; the key comes last."""
    folder = Path(order.folder)
    subject = drawn(order)
    traces = dict(zip(PARTS, subject.traces, strict=False))
    traces |= dict(zip([VALIDATION], subject.judged, strict=False))
    write_data(folder, order.name, traces, subject.nominal)
    key = key_of(order, subject)
    random = np.random.default_rng([order.seed, order.index, 1])
    salt = random.bytes(SALT_BYTES).hex()
    write_descriptions(folder, order.name, traces, subject.nominal, seal(salt, key))
    write_key(key_file(folder, order.name), salt, key)
    return order.name


def drawn(order: Order) -> Subject:
    """Draw what an order asks for."""
    stratum = STRATA[order.stratum]
    if stratum.kind == RIGS:
        return draw_rig(order.seed, order.index, seconds=order.seconds)
    if stratum.kind == MUJOCO:
        return draw_rig(order.seed, order.index, seconds=order.seconds, engine=BY_MUJOCO)
    if stratum.kind == LABORATORY:
        return draw_laboratory(order.seed, order.index, order.seconds)
    if stratum.kind == OUTSIDE:
        return draw_outsider(order.seed, order.index, order.seconds)
    return draw(stratum, order.seed, order.index, order.rank, order.seconds).subject()


def key_of(order: Order, subject: Subject) -> dict[str, Any]:
    """Return the full truth of a subject, in JSON's types."""
    folder = Path(order.folder)
    files = recording_files(folder, order.name)
    law = subject.law
    if law is not None:
        outside = {"name": "law", "text": law.text, "sigma": subject.law_sigma} | asdict(law)
    else:
        outside = subject.outside
    return {
        "recording": order.name,
        "stratum": subject.stratum,
        "seed": order.seed,
        "index": order.index,
        "rank": order.rank,
        "recordings": {part: path.name for part, path in files.items() if part in PARTS},
        "hidden": [asdict(h) for h in subject.hidden],
        "outside": outside,
        "floor": subject.floor,
        "device": device_to_text(subject.truth),
        "device_file": subject.device_file,
        **subject.about,
        "sha256": {name: digest(path) for name, path in files.items()},
    }
