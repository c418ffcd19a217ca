"""What is said of the recordings of `docs/machines` after a fault of recording was sown in them.

Each machine's first recording, as its page describes it, with one output in degrees or millimetres
(or radians or metres) where the other is said, with its sign turned, with the command and the
output exchanged, and with the command late or early by some samples. Looked at as a diagnosis looks
at recordings before it searches (`intake.take_in`), by the device file of the page.

    python -m benchmarks.sown_faults RECORDINGS [NAME...]
    python -m benchmarks.sown_faults --drawn FOLDER

FOLDER: what `zwidth conceal --out FOLDER` made. Of its recordings it is counted how often columns
are said to be exchanged, as they are and where they are.

One line a fault: what was sown, and all that was said. The recording as it is
comes first, and what is said of it there is no finding of ours.
"""

import sys
import time
from collections import Counter
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
from zwidth.diagnosis.intake.swapped import in_place
from zwidth.diagnosis.intake.take_in import take_in
from zwidth.diagnosis.mishaps import collecting, silent
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError, stretches
from zwidth.logs.recording import read_recording
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


def others_exchanged(e: Experiment) -> Experiment | None:
    """The first two outputs one in the place of the other, None if they are not of a kind."""
    if len(e.outputs) < 2 or e.outputs[0].quantity != e.outputs[1].quantity:
        return None
    measured = e.measured.copy()
    measured[:, :2] = measured[:, 1::-1]
    return replace(e, measured=measured)


def drawn(folder: Path) -> None:
    """Print how often columns of recordings of an exam are said to be exchanged."""
    sow = {"as it is": as_it_is, "command and output": exchanged, "two outputs": others_exchanged}
    said: dict[str, Counter[str]] = {name: Counter() for name in sow}
    files = sorted((folder / "recordings").glob("r*.device.toml"))
    if not files:
        sys.exit(f"{folder} has no recordings of an exam; make some with `zwidth conceal --out`")
    for file in files:
        device = load_device(file)
        trace = read_recording(file.with_name(file.name.replace(".device.toml", ".toml")))
        for name, how in sow.items():
            with collecting(silent):
                made = how(stretches(trace, device, "r")[0])
                if made is not None:
                    kinds = [f.kind for f in in_place(device, made)[1]]
                    said[name][kinds[0] if kinds else "nothing"] += 1
    for name, count in said.items():
        each = ", ".join(f"{kind} {times}" for kind, times in count.most_common())
        print(f"{name:20s} of {count.total()}: {each}")


def main() -> None:
    """Print what is said of each."""
    if sys.argv[1:] in ([], ["--drawn"]):
        print(f"no folder was named\n\n{__doc__}", file=sys.stderr)
        sys.exit(2)
    if sys.argv[1] == "--drawn":
        drawn(Path(sys.argv[2]))
        return
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
