"""What is said of the recordings of `docs/machines` after a fault of recording was sown in them.

Each machine's first recording, as its page describes it, with one output in degrees or millimetres
(or radians or metres) where the other is said, with its sign turned, with the command and the
output exchanged, and with the command late or early by some samples. Looked at as a diagnosis looks
at recordings before it searches (`intake.take_in`), by the device file of the page.

    python -m benchmarks.sown_faults RECORDINGS [NAME...]

One line a fault: what was sown, and all that was said. The recording as it is
comes first, and what is said of it there is no finding of ours.
"""

import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1] / "docs"))
from make_machine_pages import (  # pyright: ignore[reportMissingImports]
    MACHINES,
    PAGES,
    experiments,
)

from zwidth.diagnosis.intake.late import EARLY
from zwidth.diagnosis.intake.take_in import take_in
from zwidth.diagnosis.mishaps import collecting, silent
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError
from zwidth.sim.device_file import load_device

LATE = 8  # samples
LEFT_OUT = ("ecp_let_go", "friction_damper")  # let go by hand; moved, and not driven


def scaled(factor: float) -> Callable[[Experiment], Experiment]:
    """The first output counts so many times as much."""

    def sown(e: Experiment) -> Experiment:
        measured = e.measured.copy()
        measured[:, 0] *= factor
        return replace(e, measured=measured, swing=abs(factor) * e.swing)

    return sown


def exchanged(e: Experiment) -> Experiment:
    """The command in the place of the first output, and the other way."""
    measured = e.measured.copy()
    command, measured[:, 0] = measured[:, 0].copy(), e.command
    return replace(e, command=command, measured=measured, swing=float(np.std(e.command)))


def late(by: int) -> Callable[[Experiment], Experiment]:
    """The command so many samples later than it was."""

    def sown(e: Experiment) -> Experiment:
        command = np.roll(e.command, by)
        if by > 0:
            command[:by] = command[by]
        else:
            command[by:] = command[by - 1]
        return replace(e, command=command)

    return sown


def as_it_is(e: Experiment) -> Experiment:
    """Nothing sown."""
    return e


FAULTS: dict[str, Callable[[Experiment], Experiment]] = {
    "as it is": as_it_is,
    "in degrees, or inches": scaled(180.0 / np.pi),
    "in thousandths": scaled(1000.0),
    "in thousands": scaled(1e-3),
    "sign of the output": scaled(-1.0),
    "command and output exchanged": exchanged,
    f"command {LATE} samples late": late(LATE),
    f"command {LATE} samples early": late(-LATE),
}


def main() -> None:
    """Print what is said of each."""
    data = Path(sys.argv[1])
    names = sys.argv[2:] or [name for name in MACHINES if name not in LEFT_OUT]
    for name in names:
        device = load_device(PAGES / name / "device.toml")
        unit = 180.0 / np.pi if device.rotary else 1.0 / 25.4e-3
        sow = {k: scaled(unit) if "inches" in k else v for k, v in FAULTS.items()}
        stem = MACHINES[name].fit[0]
        made = experiments(name, (stem,), device, data)
        for fault, sown in sow.items():
            since = time.perf_counter()
            try:
                with collecting(silent):  # as a diagnosis does: an error costs what it concerns
                    taken = take_in(device, [sown(e) for e in made], None)
                named = [f for f in taken.faults if f.wrong or f.kind == EARLY]
                said = [f"[{f.kind} {f.value:.4g}] {f.sentence}" for f in named]
            except ExperimentError as error:
                said = [f"refused: {error}"]
            spent = time.perf_counter() - since
            print(f"{name:18s} {fault:30s} {spent:4.0f} s  {' | '.join(said) or '-'}", flush=True)


if __name__ == "__main__":
    main()
