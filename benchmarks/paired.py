"""The paired set: the same recordings diagnosed by two versions of the code, pair by pair.

    python -m benchmarks.paired make FOLDER [--seed N]               100 sealed recordings
    python -m benchmarks.paired sit FOLDER TABLE.json                diagnose them all
        [--code CHECKOUT] [--only r0001 ...] [--limit 900] [--machines RECORDINGS [NAME ...]]
    python -m benchmarks.paired compare BEFORE.json AFTER.json       what is worse, what is better
    python -m benchmarks.paired show TABLE.json                      how often it is right

A change to the diagnosis is judged on all of it. Each recording is one `zwidth diagnose` with
everything that it writes, in a process of its own; CPU seconds are those of all its threads.
`--code` takes another checkout's `zwidth`, so that the version before is asked the same question.
A table is added to: what is in it is not diagnosed again. `--machines` diagnoses the machines of
`docs/machines` too, from the folder that has their published files. Another `--seed` makes 100
of the same classes that no search was developed on.

A pair is worse where a concealed effect is no longer named or in a class that is, where something
is claimed that was not before, or where an answer that was right is no answer any more.
"""

import argparse
import json
import math
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scipy.stats import binomtest

from docs.make_machine_pages import MACHINES, PAGES
from zwidth.exam.mark import linear_truth, mark
from zwidth.scenarios.concealed.handout import PARTS, VALIDATION, data_file, description_file, names
from zwidth.sim.device_file import device_from_text

SEED = 20261126
# Classes, seconds, and what is added to the seed.
SETS = (
    ("none=7,single_2x=5,single_5x=7,single_any=6,two_5x=8,three_5x=6,unknown=5", 6.0, 0),
    ("rigs=11,outside=5", 8.0, 1),
    ("laboratory=20,mujoco=20", 8.0, 2),
)
CLEAN = ("nothing_missing", "linear_parameters")  # verdicts that say that no physics is missing
LIMIT = 900.0  # CPU s after which a diagnosis is ended, and is no answer


@dataclass(frozen=True)
class Question:
    """Arguments of `zwidth diagnose`, and the folder in which they are given."""

    name: str
    arguments: tuple[str, ...]
    folder: Path


def make(folder: Path, seed: int = SEED) -> None:
    """Make the sealed recordings, those of each set in a folder of its own."""
    for strata, seconds, more in SETS:
        asked = ["--strata", strata, "--seed", str(seed + more), "--seconds", str(seconds)]
        line = [sys.executable, "-m", "zwidth", "conceal", *asked, "--processes", "2"]
        subprocess.run([*line, "--out", str(folder / f"set{more}")], check=True)


def sealed(folder: Path) -> Iterator[tuple[Question, Path]]:
    """Yield the questions of the sealed recordings, with their folders."""
    for each in sorted(folder.glob("set*")):
        for name in names(each):
            there = [p for p in PARTS if data_file(each, name, p).exists()]
            fit = [description_file(each, name, p).name for p in there if p != VALIDATION]
            judge = [description_file(each, name, p).name for p in there if p == VALIDATION]
            asked = (*fit, "--device", f"{name}.device.toml")
            more = [w for file in judge for w in ("--validate", file)]
            yield Question(f"{each.name}/{name}", (*asked, *more), each / "recordings"), each


def machines(data: Path, chosen: Sequence[str]) -> Iterator[Question]:
    """Yield the questions of the machines' pages."""
    for name in chosen or MACHINES:
        machine = MACHINES[name]
        folder = Path(tempfile.mkdtemp())
        for file in (data / (machine.data or name)).iterdir():
            (folder / file.name).symlink_to(file.resolve())
        for file in (PAGES / name).glob("*.toml"):
            (folder / file.name).unlink(missing_ok=True)
            shutil.copy(file, folder / file.name)
        words = [*(f"{stem}.toml" for stem in machine.fit), "--device", "device.toml"]
        words += [w for stem in machine.judge for w in ("--validate", f"{stem}.toml")]
        yield Question(name, (*words, "--effort", machine.effort), folder)


def asked(question: Question, code: Path, limit: float) -> dict[str, Any]:
    """Return what `zwidth diagnose` answers, what it took, and what kept it from answering."""
    out, most = Path(tempfile.mkdtemp()), math.ceil(limit)
    line = [sys.executable, "-m", "zwidth", "diagnose", *question.arguments]
    line += ["--out", str(out), "--json", str(out / "answer.json")]
    environment = os.environ | {"PYTHONPATH": str(code), "PYTHONSAFEPATH": "1"}
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    ended = subprocess.run(
        line, cwd=question.folder, env=environment, capture_output=True, text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (most, most)),
    )  # fmt: skip
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    found: dict[str, Any] = {"cpu_s": spent, "wall_s": time.perf_counter() - begun, "answer": None}
    if (out / "answer.json").exists():
        found["answer"] = json.loads((out / "answer.json").read_text())
    else:
        found["error"] = f"ended with {ended.returncode} after {spent:.0f} s: {ended.stderr[-300:]}"
    shutil.rmtree(out)
    return found


def marked(folder: Path, name: str, found: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the key says of an answer."""
    key = json.loads((folder / "keys" / f"{name}.json").read_text())["key"]
    answer = {"diagnosis": found["answer"], "seconds": found["wall_s"], "samples": 0}
    answer["core_seconds"] = found["cpu_s"]
    truth = linear_truth(device_from_text(key["device"]).chain)
    m = mark(key, answer, truth)
    return {
        "stratum": m.stratum,
        "concealed": {f"{e.effect}@{e.at}": e.in_class for e in m.effects},
        "outside": m.outside,
        "claims": list(m.claims),
        "inside": [all(e.inside.values()) for e in m.effects if e.inside],
        "linear_inside": dict(m.linear),
    }


def brief(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return of an answer what pairs are compared by."""
    said = found["answer"]
    kept = {k: v for k, v in found.items() if k != "answer"}
    if said is None:
        return kept | {"verdict": "none", "names": [], "fit": {}, "headline": ""}
    return kept | {
        "verdict": said["verdict"],
        "headline": said.get("headline", said.get("sentence", "")),
        "names": [f"{f['effect']}@{f['at']}" for f in said["findings"]],
        "values": {
            f"{f['effect']}@{f['at']}.{k}": (p["value"], p["ci95"])
            for f in said["findings"]
            for k, p in f["parameters"].items()
        },
        "linear": {k: (p["value"], p["ci95"]) for k, p in said["linear_refit"].items()},
        "worth": {
            f"{f['effect']}@{f['at']}": (f["worth"]["times"], f["worth"]["sigma"])
            for f in (*said["findings"], *said.get("negligible", ()))
            if f.get("worth")
        },
        "negligible": [f"{f['effect']}@{f['at']}" for f in said.get("negligible", ())],
        "fit": {k: said["fit"][k]["after"] for k in ("one_step", "free_run")},
        "whole_runs": [r["shares"].get("after") for r in said.get("whole_runs", [])],
        "force_errors": [r["shares"].get("after") for r in said.get("force_errors", [])],
        "errors": [f"{m['stage']} ({m['what']}): {m['error']}" for m in said.get("errors", [])],
        "simulations": said.get("cost", {}).get("simulations"),
        "by": _by_stage(said.get("cost", {}).get("by", ())),
    }


def _by_stage(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Simulations of each stage."""
    found: dict[str, float] = {}
    for row in rows:
        found[row["stage"]] = found.get(row["stage"], 0.0) + row["simulations"]
    return found


def sit(options: argparse.Namespace) -> None:
    """Diagnose what is not in the table yet."""
    table = Path(options.table)
    rows: dict[str, Any] = json.loads(table.read_text()) if table.exists() else {}
    code = Path(options.code).resolve()
    questions: list[tuple[Question, Path | None]] = []
    if options.folder.is_dir():
        questions += list(sealed(options.folder.resolve()))
    if options.machines:
        data, *chosen = options.machines
        questions += [(q, None) for q in machines(Path(data).resolve(), chosen)]
    if not questions:
        raise SystemExit(
            f"{options.folder} holds no set of sealed recordings; make them there first"
        )
    for question, folder in questions:
        if question.name in rows or (options.only and question.name not in options.only):
            continue
        found = asked(question, code, options.limit)
        row = brief(found)
        if folder is not None:
            row |= marked(folder, Path(question.name).name, found)
        rows[question.name] = row
        table.write_text(json.dumps(rows, indent=1) + "\n")
        print(line_of(question.name, row), flush=True)


def line_of(name: str, row: Mapping[str, Any]) -> str:
    """Return a line of the table."""
    missed = [k for k, so in row.get("concealed", {}).items() if not so]
    said = f"{name:11} {row.get('stratum', ''):10} {row['cpu_s']:7.1f} s {row['verdict']:16} "
    said += ", ".join(row["names"])
    said += f" (negligible: {', '.join(row['negligible'])})" if row.get("negligible") else ""
    said += f" | missed {', '.join(missed)}" if missed else ""
    said += f" | claimed {', '.join(row['claims'])}" if row.get("claims") else ""
    return said + (f" | internal errors: {'; '.join(row['errors'])}" if row.get("errors") else "")


def worse(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """Return what an answer lacks that the one before had, or says wrongly that it did not."""
    found: list[str] = []
    was = before.get("concealed", {})
    for name, named in after.get("concealed", {}).items():
        if was.get(name) and not named:
            found.append(f"lost {name}")
    found += [f"claims {c}" for c in after.get("claims", []) if c not in before.get("claims", [])]
    if after["verdict"] == "none" != before["verdict"]:
        found.append("no answer")
    if (
        before.get("stratum") in ("none", "laboratory")
        and before["verdict"] in CLEAN
        and (after["verdict"] not in CLEAN)
    ):
        found.append(after["verdict"])
    return found


def compare(before: Mapping[str, Any], after: Mapping[str, Any]) -> None:
    """Print pair by pair what changed, and the sums."""
    both = [name for name in before if name in after]
    ratios: list[float] = []
    fits: list[float] = []
    sums = {"worse": 0, "better": 0}
    for name in both:
        one, other = before[name], after[name]
        down, up = worse(one, other), worse(other, one)
        sums["worse"] += bool(down)
        sums["better"] += bool(up)
        ratios.append(other["cpu_s"] / one["cpu_s"])
        pairs = [(one["fit"].get(k), other["fit"].get(k)) for k in ("one_step", "free_run")]
        change = [f"{b / a:.3f}" for a, b in pairs if a and b]
        fits += [b / a for a, b in pairs if a and b]
        print(
            f"{name:11} {one['cpu_s']:6.0f} -> {other['cpu_s']:5.0f} s"
            f" {one['verdict']:>16} -> {other['verdict']:16} errors x {' '.join(change):12}"
            f" {'WORSE: ' + ', '.join(down) if down else ''}"
            f" {'better: ' + ', '.join(up) if up else ''}"
        )
    was, now = (sum(table[n]["cpu_s"] for n in both) for table in (before, after))
    print(
        f"{len(both)} pairs: {sums['worse']} worse, {sums['better']} better; CPU seconds"
        f" x {statistics.median(ratios):.3f} in the median, sum {was:.0f} -> {now:.0f};"
        f" held-out errors x {statistics.median(fits):.4f} in the median"
    )


def share(right: int, of: int) -> str:
    """Return a share with its 95 % interval (Clopper and Pearson)."""
    if of == 0:
        return "-"
    between = binomtest(right, of).proportion_ci(0.95)
    return f"{right} of {of} ({100 * between.low:.0f} to {100 * between.high:.0f} %)"


def show(table: Mapping[str, Any]) -> None:
    """Print by stratum what was named, and over all how far an answer is to be trusted."""
    rows = [row for row in table.values() if "stratum" in row]
    print("| what was hidden | recordings | all named | effects named | nothing claimed | CPU s |")
    print("| --- | --- | --- | --- | --- | --- |")
    for stratum in dict.fromkeys(row["stratum"] for row in rows):
        own = [row for row in rows if row["stratum"] == stratum]
        whole = sum(all(row["concealed"].values()) and row["verdict"] != "none" for row in own)
        named = [so for row in own for so in row["concealed"].values()]
        quiet = sum(not row["claims"] for row in own)
        cpu = statistics.median(row["cpu_s"] for row in own)
        print(
            f"| {stratum} | {len(own)} | {share(whole, len(own))} |"
            f" {share(sum(named), len(named))} | {share(quiet, len(own))} | {cpu:.0f} |"
        )
    sure = [row for row in rows if row["verdict"] == "identified"]
    wrong = sum(bool(row["claims"]) or not all(row["concealed"].values()) for row in sure)
    clean = [row for row in rows if row["stratum"] in ("none", "laboratory")]
    quiet = sum(row["verdict"] in CLEAN for row in clean)
    inside = [so for row in rows for so in row["inside"]]
    linear = [so for row in rows for so in row.get("linear_inside", {}).values()]
    spent = [row["cpu_s"] for row in rows]
    print(f"identified, and something claimed or missed: {share(wrong, len(sure))}")
    print(f"nothing hidden, and the verdict says so: {share(quiet, len(clean))}")
    print(f"effects with intervals that hold the truth: {share(sum(inside), len(inside))}")
    print(f"linear parameters within their intervals: {share(sum(linear), len(linear))}")
    print(f"no answer at the limit: {sum(row['verdict'] == 'none' for row in rows)}")
    print(f"answers with internal errors: {sum(bool(row.get('errors')) for row in rows)}")
    print(f"CPU s: median {statistics.median(spent):.0f}, longest {max(spent):.0f}")


def main() -> None:
    """Make, sit, compare or show."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    what = options.add_subparsers(dest="what", required=True)
    making = what.add_parser("make")
    making.add_argument("folder", type=Path)
    making.add_argument("--seed", type=int, default=SEED)
    sitting = what.add_parser("sit")
    sitting.add_argument("folder", type=Path)
    sitting.add_argument("table", type=Path)
    sitting.add_argument("--code", default=Path(__file__).parents[1])
    sitting.add_argument("--only", nargs="+", default=[])
    sitting.add_argument("--limit", type=float, default=LIMIT)
    sitting.add_argument("--machines", nargs="+", default=[])
    comparing = what.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    showing = what.add_parser("show")
    showing.add_argument("table", type=Path)
    given = options.parse_args()
    if given.what == "make":
        make(given.folder, given.seed)
    elif given.what == "sit":
        sit(given)
    elif given.what == "show":
        show(table_in(given.table))
    else:
        compare(table_in(given.before), table_in(given.after))


def table_in(file: Path) -> dict[str, Any]:
    """Return a table that 'sit' wrote."""
    if not file.exists():
        raise SystemExit(f"there is no table {file}; 'sit' writes one")
    try:
        return json.loads(file.read_text())
    except ValueError as error:
        raise SystemExit(f"{file} is no table of 'sit': {error}; let it write one anew") from error


if __name__ == "__main__":
    main()
