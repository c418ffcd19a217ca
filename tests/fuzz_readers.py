"""Feed the readers damaged files, many of them: they answer with a log or with one sentence.

    python tests/fuzz_readers.py --inputs 120000 --seed 1

Every input is a small good file (made by tests/recording_examples.py and by our own writers),
damaged in one to four places: bits flipped, bytes overwritten, pieces cut out, doubled or taken
from another file, the end cut off, a length made huge, a cell or word put in. Input i of a seed is
always the same, so a finding is run again alone with --only I.

A finding is anything but a result or a ValueError of one line: another exception, a warning, a
crash of the interpreter, ten seconds without an answer, more than 4 GiB of memory, and, of a file
with checksums, numbers that differ from those written without a word of warning.
"""

import argparse
import multiprocessing
import resource
import signal
import sys
import tempfile
import time
import tomllib
import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import recording_examples as examples
from exported_examples import bare_log, full_log
from log_examples import ATTACHMENTS, EPOCH, EVENTS, METADATA, UNITS, example

from zwidth.logs.assumed import assumed
from zwidth.logs.export import WRITERS
from zwidth.logs.guess import clock_faults, draft, look
from zwidth.logs.mcap_reader import Log
from zwidth.logs.mcap_writer import write_log
from zwidth.logs.open_source import open_source, read_own
from zwidth.logs.recording import read_recording
from zwidth.sim.trace import Trace

SECONDS = 10
MEMORY = 4 << 30
BATCH = 1000
VERDICTS = ("read", "refused", "finding")
HUGE = (0, 1, 0x7F, 0x80, 0xFF, 0xFFFF, 0x7FFFFFFF, 0xFFFFFFFF, 2**63 - 1, 2**64 - 1)
WORDS = (
    b'nan;inf;-1e999;1,5;;"; ;[;];=;true;#;\n;\r;\t;deg;\xff;\x00;0x10;1_000;--;t;[[output]]'.split(
        b";"
    )
)
SIDE_BY_SIDE = b"time,torque,angle,time,torque,angle\n" + b"".join(
    b"%g,%g,%g,%g,%g,%g\n" % (k / 500, k % 7, k % 11, k / 500, k % 5, k % 13) for k in range(60)
)
TOML = b"""\
file = "a.csv"
time = "t"
[input]
signal = "torque"
scale = 2.0
offset = -0.5
[[output]]
signal = "angle"
quantity = "position"
at = "m1"
unit = "rad"
[use]
from_s = 0.002
"""

Generator = np.random.Generator


@dataclass(frozen=True)
class Kind:
    """A good file and what is done with its damaged copies. truth: what may come back of it."""

    name: str
    data: bytes
    file: str
    read: Callable[[Path], object]
    truth: Trace | None = None


def look_and_draft(path: Path) -> None:
    """Read a foreign file as `zwidth convert` and `diagnose` do; what they draft must be TOML."""
    source = open_source(path)
    seen = look(source)
    clock_faults(source)
    tomllib.loads(draft(source, seen))
    tomllib.loads(assumed(source, path.name).text)


def through_toml(path: Path) -> None:
    """Read a table through a good TOML."""
    description = path.with_name("good.toml")
    description.write_bytes(TOML.replace(b"a.csv", path.name.encode()))
    read_recording(description)


def with_good_table(path: Path) -> None:
    """Read a TOML that describes a good table."""
    path.with_name("a.csv").write_bytes(examples.csv_bytes())
    read_recording(path)


def kinds(folder: Path, named: str) -> list[Kind]:
    """Return everything that is damaged and has `named` in its name."""
    tick = example(40)
    write_log(
        folder / "run.mcap", tick, events=EVENTS, metadata=METADATA, attachments=ATTACHMENTS,
        epoch_ns=EPOCH,
    )  # fmt: skip
    foreign = {
        "CSV": (examples.csv_bytes(), "a.csv"),
        "CSV, decimal comma": (examples.german_csv_bytes(), "a.csv"),
        "MAT v4": (examples.mat_bytes(version="4"), "a.mat"),
        "MAT v5": (examples.mat_bytes(), "a.mat"),
        "MAT v7": (examples.mat_bytes(version="7"), "a.mat"),
        "MAT v7.3": (examples.mat73_bytes(), "a.mat"),
        "HDF5": (examples.hdf5_bytes(), "a.h5"),
        "NPY": (examples.npy_bytes(), "a.npy"),
        "NPZ": (examples.npz_bytes(), "a.npz"),
        "Parquet": (examples.parquet_bytes(), "a.parquet"),
        "Excel": (examples.excel_bytes(), "a.xlsx"),
        "JSON": (examples.json_bytes(), "a.json"),
        "JSON lines": (examples.json_lines_bytes(), "a.jsonl"),
        "LabVIEW": (examples.lvm_bytes(), "a.lvm"),
        "CODESYS": (examples.codesys_bytes(), "a.csv"),
        "TwinCAT": (examples.twincat_bytes(), "a.csv"),
        "Numbers beside names": (examples.labelled_bytes(), "a.txt"),
        "Numbers behind stamps": (examples.stamped_bytes(), "a.log"),
        "Motors in turn": (examples.in_turn_bytes(), "a.csv"),
        "Joint states, echoed": (examples.echoed_bytes(), "a.csv"),
        "Parquet, lists": (examples.joint_lists_bytes(), "a.parquet"),
        "WPILOG": (examples.wpilog_bytes(), "a.wpilog"),
        "TDMS": (examples.tdms_bytes(), "a.tdms"),
        "ULog": (examples.ulog_bytes(), "a.ulg"),
        "Runs side by side": (SIDE_BY_SIDE, "a.csv"),
        "CSV, written times": (examples.iso_csv_bytes(), "a.csv"),
        "MCAP, ROS 2": (examples.ros2_bytes(), "a.mcap"),
        "MCAP, ROS 2, no checksums": (examples.ros2_bytes(checked=False), "a.mcap"),
        "MCAP, JSON": (examples.json_mcap_bytes(), "a.mcap"),
        "MCAP, protobuf": (examples.protobuf_bytes(), "a.mcap"),
    }
    found = [Kind(name, data, file, look_and_draft) for name, (data, file) in foreign.items()]
    found.append(Kind("CSV through a TOML", examples.csv_bytes(), "a.csv", through_toml))
    found.append(Kind("recording TOML", TOML, "a.toml", with_good_table))
    found.append(Kind("our MCAP", (folder / "run.mcap").read_bytes(), "a.mcap", read_own, tick))
    for suffix, writer in WRITERS.items():
        target = folder / "run.bin"
        with target.open("wb") as stream:
            writer(stream, full_log(40) if suffix == ".npz" else bare_log(tick))
        found.append(Kind(f"our {suffix}", target.read_bytes(), f"a{suffix}", read_own, tick))
    return [kind for kind in found if named in kind.name]


def damaged(rng: Generator, good: bytes, other: bytes) -> bytes:
    """Return the file with one to four wounds."""
    data = bytearray(good)
    for _ in range(int(rng.integers(1, 5))):
        at = int(rng.integers(0, max(len(data), 1)))
        length = int(min(rng.geometric(0.05), len(data) - at))
        match int(rng.integers(0, 8)):
            case 0 if data:
                data[at] ^= 1 << int(rng.integers(0, 8))
            case 1:
                data[at : at + length] = rng.bytes(length)
            case 2:
                del data[at : at + length]
            case 3:
                data[at:at] = data[at : at + length]
            case 4:
                start = int(rng.integers(0, len(other)))
                data[at : at + length] = other[start : start + length]
            case 5:
                size = int(rng.choice([1, 2, 4, 8]))
                value = HUGE[int(rng.integers(0, len(HUGE)))] % (1 << 8 * size)
                order = "little" if rng.random() < 0.8 else "big"
                data[at : at + size] = value.to_bytes(size, order)
            case 6 if rng.random() < 0.3:
                del data[at:]
            case _:
                data[at : at + length] = WORDS[int(rng.integers(0, len(WORDS)))]
    return bytes(data)


def one(found: list[Kind], seed: int, i: int) -> tuple[Kind, bytes]:
    """Return input i of a seed."""
    rng = np.random.default_rng([seed, i])
    kind = found[i % len(found)]
    return kind, damaged(rng, kind.data, found[int(rng.integers(0, len(found)))].data)


def answer(kind: Kind, path: Path) -> tuple[str, str]:
    """Return ("read" | "refused" | "finding", what is to be said of it)."""
    try:
        result = kind.read(path)
    except ValueError as error:
        sentence = str(error)
        fine = sentence and "\n" not in sentence
        ours = type(error).__module__.startswith("zwidth.logs.")
        return ("refused", sentence) if fine and ours else ("finding", traceback.format_exc())
    except Exception:
        return "finding", traceback.format_exc()
    if isinstance(result, Log) and kind.truth is not None:
        return _true(result, kind.truth)
    return "read", ""


def _true(log: Log, truth: Trace) -> tuple[str, str]:
    """Without a warning everything must be as written; with one, no sample of an MCAP made up."""
    same = len(log.tick) == len(truth) and all(
        name in log.tick.channels and log.tick[name].tobytes() == truth[name].tobytes()
        for name in UNITS
    )
    if not same and not log.warnings:
        return "finding", "numbers differ from those written, and no warning says so"
    if log.path.suffix == ".mcap":
        for name in set(UNITS) & set(log.tick.channels):
            if not np.isin(log.tick[name], truth[name]).all():
                return "finding", f"{name} holds numbers that were never written"
    return "read", ""


@dataclass(frozen=True)
class Progress:
    """What a child tells while it works, in memory that outlives it.

    at: the input being read. tally: kind x (read, refused, finding). said: findings.
    """

    at: Any
    tally: Any
    said: Any


def worker(seed: int, first: int, last: int, found: list[Kind], progress: Progress) -> None:
    """Read inputs first to last - 1."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    warnings.simplefilter("error")
    with tempfile.TemporaryDirectory() as name:
        for i in range(first, last):
            progress.at.value = i
            kind, data = one(found, seed, i)
            path = Path(name) / kind.file
            path.write_bytes(data)
            verdict, said = answer(kind, path)
            if verdict == "finding":
                progress.said.put((i, said))
            progress.tally[len(VERDICTS) * (i % len(found)) + VERDICTS.index(verdict)] += 1
        progress.at.value = last


def run(seed: int, inputs: int, named: str) -> tuple[list[Kind], list[int], list[tuple[int, str]]]:
    """Read all inputs in child processes, and outlive those that do not."""
    context = multiprocessing.get_context("fork")
    with tempfile.TemporaryDirectory() as name:
        found = kinds(Path(name), named)
    tally = context.Array("q", len(VERDICTS) * len(found))
    progress = Progress(context.Value("q", 0), tally, context.Queue())
    findings: list[tuple[int, str]] = []
    first = 0
    while first < inputs:
        last = min(first + BATCH, inputs)
        child = context.Process(target=worker, args=(seed, first, last, found, progress))
        child.start()
        died = _attend(child, progress, findings)
        first = int(progress.at.value)
        if died is not None:
            findings.append((first, died))
            tally[len(VERDICTS) * (first % len(found)) + VERDICTS.index("finding")] += 1
            first += 1
        print(f"{first} of {inputs}, {len(findings)} findings", file=sys.stderr, flush=True)
    return found, tally[:], findings


def _attend(child: Any, progress: Progress, findings: list[tuple[int, str]]) -> str | None:
    """Wait for a child; return what it died of, or None."""
    position, since = -1, time.monotonic()
    while child.is_alive():
        child.join(0.05)
        if progress.at.value != position:
            position, since = progress.at.value, time.monotonic()
        if time.monotonic() - since > SECONDS:
            child.kill()
            child.join()
            return f"no answer in {SECONDS} s"
        while not progress.said.empty():
            findings.append(progress.said.get())
    while not progress.said.empty():
        findings.append(progress.said.get())
    if child.exitcode == 0:
        return None
    died = signal.Signals(-child.exitcode).name if child.exitcode < 0 else str(child.exitcode)
    return f"the interpreter died: {died}"


def main() -> int:
    """Run the fuzzing, print a table of results and every finding."""
    parser = argparse.ArgumentParser(description="Feed the readers damaged files.")
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", type=int, metavar="I", help="run input I alone, in this process")
    parser.add_argument("--kind", default="", help="damage only files with this in their name")
    options = parser.parse_args()
    if options.only is not None:
        return _only(options.seed, options.only, options.kind)
    started = time.monotonic()
    found, tally, findings = run(options.seed, options.inputs, options.kind)
    print(f"{'what':28} {'inputs':>8} {'read':>8} {'refused':>8} {'findings':>8}")
    for k, kind in enumerate(found):
        row = tally[len(VERDICTS) * k : len(VERDICTS) * (k + 1)]
        print(f"{kind.name:28} {sum(row):8}" + "".join(f" {count:8}" for count in row))
    seconds = time.monotonic() - started
    print(f"{sum(tally)} inputs in {seconds:.0f} s, {len(findings)} findings")
    for i, said in findings:
        print(f"\n--only {i} ({found[i % len(found)].name}):\n{said}")
    return 1 if findings else 0


def _only(seed: int, i: int, named: str) -> int:
    warnings.simplefilter("error")
    with tempfile.TemporaryDirectory() as name:
        kind, data = one(kinds(Path(name), named), seed, i)
        path = Path(name) / kind.file
        path.write_bytes(data)
        verdict, said = answer(kind, path)
    print(f"{kind.name}: {verdict}\n{said}")
    return 1 if verdict == "finding" else 0


if __name__ == "__main__":
    sys.exit(main())
