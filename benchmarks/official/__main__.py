"""`zwidth diagnose` on public benchmarks: one run, fitted to the training data; tests opened once.

    python -m benchmarks.official RECORDINGS
    python -m benchmarks.official RECORDINGS --only emps --write

RECORDINGS: the folder with emps/DATA_EMPS.mat, official/DATA_EMPS_PULSES.mat and
official/SNLS80mV.csv, which are not ours to pass on. Splits, windows and metric are those of
`nonlinear_benchmarks`; `identibench` scores the same answers by its own runner. Both come with
pip install 'zwidth[boards]'. --write puts the table into docs/official.md.
"""

import argparse
import sys
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from benchmarks.command import between_marks, ended
from benchmarks.official.boards import BOARDS, Board, Floats, placed
from benchmarks.official.by_identibench import scores
from benchmarks.official.floor import floors
from zwidth import Diagnosis
from zwidth.files.protection import writing_as
from zwidth.files.whole import write_text
from zwidth.sim.device import place_label
from zwidth.sim.readable import plain

PAGE = Path(__file__).parents[2] / "docs" / "official.md"
RUNS = Path(__file__).parents[2] / "runs" / "official"
STEP = 5e-8  # m, of EMPS' encoder
NOTHING = 1e-6  # of a parameter's neighbour in the same unit, below which it is zero


@dataclass(frozen=True)
class Result:
    """errors, elsewhere: by the names of the tests, in the benchmark's unit, as is floor."""

    board: Board
    errors: dict[str, float]
    elsewhere: list[float]
    seconds: float
    physics: str
    floor: tuple[float, Floats] | None


def physics_of(answer: Diagnosis) -> str:
    """Return what the device that predicts is made of, with its numbers in plain SI units.

    A magnitude that is zero beside another of the effect, in the same unit, is written 0.
    """
    found = answer.predicts_with
    device = found.final.model.build(found.final.x)
    said: list[str] = []
    for p in device.physics:
        if p.effect.sought == "learned":
            said.append(f"`{place_label(p)}`: a learned table")
            continue
        units = {q.name: q.unit_for(device.rotary) for q in p.effect.parameters}
        values: list[str] = []
        for name, unit in units.items():
            most = max(abs(p.values[other]) for other in units if units[other] == unit)
            value = p.values[name] if abs(p.values[name]) > NOTHING * most else 0.0
            values.append(f"{name} {plain(value)} {unit}".rstrip())
        said.append(f"`{place_label(p)}`: {', '.join(values)}")
    return "; ".join(said)


def result_of(board: Board, folder: Path) -> Result:
    """Train, then open the tests."""
    from nonlinear_benchmarks.error_metrics import RMSE

    begun = time.process_time()
    train, tests = board.load(folder)
    answer = board.answer(train)
    physics = physics_of(answer)  # fits what predicts
    seconds = time.process_time() - begun
    factor = board.shown[1]
    errors: dict[str, float] = {}
    for name, test in zip(board.published, tests, strict=True):
        n = test.state_initialization_window_length
        model = board.predicted(answer, test.u, test.y[:n])
        errors[name] = factor * float(RMSE(test.y[n:], model[n:]))
    floor = None
    if answer.device.chain.ground_spring == 0.0:  # what has a spring forgets its beginning
        n = tests[0].state_initialization_window_length
        state, chance = floors(answer, board.scale * np.ravel(tests[0].u), n, STEP)
        floor = factor * state, factor * chance
    elsewhere = list(scores(board, answer, train, folder).values())
    return Result(board, errors, elsewhere, seconds, physics, floor)


def table(results: list[Result]) -> str:
    """Return the page's table, and below it the floors, as Markdown."""
    lines = [
        "| test | RMSE | in `identibench` | what predicts | what others reach | CPU s |",
        "|---|---|---|---|---|---|",
    ]
    below: list[str] = []
    for r in results:
        unit, others = r.board.unit, r.board.published
        for k, (name, error) in enumerate(r.errors.items()):
            first = k == 0
            what, spent = (r.physics, f"{r.seconds:.0f}") if first else ("the same", "")
            lines.append(
                f"| {f'{r.board.title}: ' if first else ''}{name} | **{error:.3g} {unit}** |"
                f" {r.elsewhere[k]:.3g} | {what} | {others[name]} | {spent} |"
            )
        if r.floor is not None:
            state, chance = r.floor
            low, middle, high = np.quantile(chance, [0.05, 0.5, 0.95])
            below.append(
                f"Drift floor of {r.board.title}: {state:.2g} {unit} from the first samples alone,"
                f" {middle:.2g} {unit} ({low:.2g} to {high:.2g}) from random forces."
            )
    packages = ", ".join(f"`{p}` {version(p)}" for p in ("nonlinear_benchmarks", "identibench"))
    return "\n".join([*lines, "", *below, f"Data and scores: {packages}.", ""])


def main() -> int:
    """Compute what was asked for, and print the table; 2 where that cannot be."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("recordings", type=Path, help="folder of the published files")
    options.add_argument(
        "--only", choices=list(BOARDS), action="append", help="this benchmark; may be repeated"
    )
    options.add_argument("--write", action="store_true", help="write docs/official.md, too")
    asked = options.parse_args()

    def work() -> None:
        RUNS.mkdir(parents=True, exist_ok=True)
        folder = placed(asked.recordings, RUNS)
        made = table([result_of(BOARDS[name], folder) for name in asked.only or list(BOARDS)])
        print(made)
        if asked.write:
            page = between_marks(PAGE.read_text(encoding="utf-8"), made, "benchmarks/official")
            with writing_as("official", overwrite=True):
                write_text(PAGE, page)

    return ended(work)


if __name__ == "__main__":
    sys.exit(main())
