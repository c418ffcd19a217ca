"""Diagnose the recordings of `docs/machines` and write the results into their pages.

    python docs/make_machine_pages.py RECORDINGS [NAME...]

RECORDINGS: the folder that has the published files, a folder a machine; they are not ours to pass
on. Each page keeps its text; what stands between its two marks is made anew, with its picture. Half
a minute to ten minutes a machine.
"""

import os
import subprocess
import sys
import time
from dataclasses import dataclass
from datetime import date
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command does: sums round the same way

import numpy as np

from zwidth.diagnosis.answer.friction_curve import FrictionCurve, friction_curve
from zwidth.diagnosis.answer.own_units import in_own_units
from zwidth.diagnosis.answer.result import Diagnosis
from zwidth.diagnosis.answer.words import negligible_in_words
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.recording.experiment import Experiment, stretches
from zwidth.diagnosis.selection.effort import EFFORTS
from zwidth.diagnosis_report import changes_in_words, estimate, masses_of, sentence
from zwidth.figures.diagnosis import whole_run_figure
from zwidth.figures.friction_curve import friction_curve_figure
from zwidth.figures.learned_surface import law_figure
from zwidth.files.protection import writing_as
from zwidth.files.whole import write_text, write_with
from zwidth.logs.recording import read_recording, unscaled
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.readable import counted_in, number, percent, with_unit

PAGES = Path(__file__).parent / "machines"
BEGIN, END = "<!-- made by docs/make_machine_pages.py -->\n", "<!-- until here -->\n"
WHEN = ("before", "refit", "after")


@dataclass(frozen=True)
class Machine:
    """A machine: its recordings to fit, and those to judge by; the last 30 % where there are none.

    shown: which of the whole runs the picture is of. effort: how much is tried. data: the folder of
    its recordings, where it has another name. alone: a recording of which it is also said what it
    tells by itself.
    """

    fit: tuple[str, ...]
    judge: tuple[str, ...] = ()
    shown: int = 0
    effort: str = "quick"
    data: str = ""
    alone: str = ""


MACHINES = {
    "two_mass_cart": Machine(("tm_2", "tm_sine_1"), ("tm_1_5", "tm_sine_4"), alone="tm_2"),
    "rack_and_pinion": Machine(("rp1",)),
    "hsm150": Machine(("hsm_pos_0.06_1", "hsm_neg_0.04_1")),
    "lugre_motor": Machine(("LuGre_J_1",), ("LuGre_J_2",), effort="normal"),
    "coupled_drives": Machine(("drive_1", "drive_2", "drive_3")),
    "ecp_carts": Machine(("KhNoM", "Kh2M", "KmNoM", "Km2M", "KlNoM", "Kl2M"), effort="normal"),
    "ecp_two_carts": Machine(("KhKmNoM", "KhKm1M"), data="ecp_carts"),
    "ecp_let_go": Machine(("Khigh_let_go", "Kmed_let_go", "Klow_let_go"), data="ecp_carts"),
    "servo_pendulum": Machine(
        (*("sin_sin_kp8", "sin_sin_kp32", "sin_sin_heavy_kp8", "sin_sin_heavy_kp32"),),
        (
            *("up_and_down_kp8", "up_and_down_kp32"),
            *("up_and_down_heavy_kp8", "up_and_down_heavy_kp32"),
        ),
        effort="normal",
    ),
    "servo_switched_off": Machine(
        ("sin_sin_kp8", "lift_and_drop_kp8"),
        ("lift_and_drop_kp32",),
        effort="normal",
        data="servo_pendulum",
    ),
    "friction_damper": Machine(("brfd7",), effort="normal"),
    "emps": Machine(("emps",)),
    "silverbox": Machine(("multisine",)),
    "ethz_haptic_paddle": Machine(("position_time_sinusoid",)),
}


def experiments(name: str, stems: tuple[str, ...], device: Device, data: Path) -> list[Experiment]:
    """Return recordings of a machine, as `zwidth diagnose` reads them."""
    found: list[Experiment] = []
    for stem in stems:
        folder = data / (MACHINES[name].data or name)
        trace = read_recording(PAGES / name / f"{stem}.toml", folder)
        found += stretches(trace, device, stem)
    return found


def own_units(name: str, data: Path) -> tuple[str, str]:
    """Return the units of forces and lengths of a machine whose recordings have no scale."""
    folder = data / (MACHINES[name].data or name)
    return unscaled(
        [read_recording(PAGES / name / f"{s}.toml", folder) for s in MACHINES[name].fit]
    )


def diagnosed(name: str, data: Path) -> Diagnosis:
    """Return the diagnosis of a machine by its two kinds of files, in `docs/machines/NAME`."""
    machine = MACHINES[name]
    device = load_device(PAGES / name / "device.toml")
    fit = experiments(name, machine.fit, device, data)
    judge = experiments(name, machine.judge, device, data) or None
    return in_own_units(diagnose(device, fit, judge, progress, EFFORTS[machine.effort]))


def progress(text: str) -> None:
    """Print the current step."""
    print(f"{time.process_time():6.0f} s  {text}", file=sys.stderr, flush=True)


def by_itself(name: str, data: Path) -> str:
    """Return the diagnosis of one recording of a machine, as a part of the page."""
    machine = MACHINES[name]
    device = load_device(PAGES / name / "device.toml")
    fit = experiments(name, (machine.alone,), device, data)
    found = in_own_units(diagnose(device, fit, None, progress, EFFORTS[machine.effort]))
    one = Machine((machine.alone,), effort=machine.effort)
    lines = ["", f"The answer from `{machine.alone}` alone:", "", "```sh", command(one), "```", ""]
    lines += [f"**{found.headline}.**", "", f"Verdict: `{found.verdict.value}`.", ""]
    if found.next_level is not None:
        lines += [f"**What to record next**: {found.next_level.sentence}.", ""]
    return "\n".join(lines)


def command(machine: Machine) -> str:
    """Return what a user types beside the data."""
    words = [*(f"{stem}.toml" for stem in machine.fit), "--device device.toml"]
    words += [f"--validate {stem}.toml" for stem in machine.judge]
    words += [f"--effort {machine.effort}"] if machine.effort != "normal" else []
    return f"zwidth diagnose {' '.join(words)}"


def answer(name: str, found: Diagnosis, seconds: float) -> str:
    """Return the results, as a section of the page."""
    lines = ["```sh", command(MACHINES[name]), "```", "", f"**{found.headline}.**", ""]
    lines += [f"Verdict: `{found.verdict.value}`.", ""]
    for said in (*changes_in_words(found), *(event.sentence for event in found.events)):
        lines += [f"{sentence(said)}.", ""]
    lines += ["| effect | values (95 % interval) | sigma |", "|---|---|---|"]
    for f in found.findings:
        values = "; ".join(f"{key} {estimate(value)}" for key, value in f.parameters.items())
        lines.append(f"| `{f.effect}` at {f.at} | {values} | {number(f.separation_sigma)} |")
    if small := negligible_in_words(found.negligible, masses_of(found)):
        lines += ["", f"{small[:1].upper()}{small[1:]}."]
    lines += ["", "| linear parameter | device file | refitted |", "|---|---|---|"]
    for key, (nominal, value) in found.linear_refit.items():
        lines.append(f"| {key} | {with_unit(nominal, value.unit)} | {estimate(value)} |")
    runs = found.whole_runs
    when = (*WHEN, "law") if runs and "law" in runs[0].errors else WHEN
    more = " with the law |" * (len(when) - len(WHEN))
    lines += [
        "", "Errors of free runs over a whole recording, or over the last 30 % of a fitted one: rms"
        " error in percent of the rms of the motion.", "",
        f"| output | device file | refitted | with the found effects |{more} |",
        "|---|---|---|---|---|" + "---|" * (len(when) - len(WHEN)),
    ]  # fmt: skip
    for run in runs:
        shares = [percent(run.shares[w]) for w in when]
        last = f"{shares[-1]} ({number(run.errors[when[-1]])} {run.unit})"
        held = "held out" if run.held_out else "fitted"
        cells = " | ".join([*shares[:-1], last, held])
        lines.append(f"| {run.output} of {run.recording} | {cells} |")
    lines += ["", f"![Measured beside simulated]({name}.png)", ""]
    if told_by_velocity(found) is not None:
        lines += [f"![The friction that was found, against velocity]({name}_friction.png)", ""]
    if (law := found.learned) is not None:
        also = [s for s in (law.worth, law.absorbed, law.energy) if s]
        lines += [f"**The learned law**: {'; '.join([law.sentence, *also])}.", ""]
        lines += [f"![The learned law]({name}_law.png)", ""]
    if found.next_level is not None:
        lines += [f"**What to record next**: {found.next_level.sentence}.", ""]
    lines += [f"Made on {date.today()} in {seconds:.0f} s of processor time (commit {commit()})."]
    return "\n".join(lines) + "\n"


def told_by_velocity(found: Diagnosis) -> FrictionCurve | None:
    """Return the friction over velocity; None without one, or if most samples need another force.

    Then a picture shows a curve through a cloud. The rule: the median distance of the samples from
    the curve must be below half of the median size of their forces.
    """
    curve = friction_curve(found.searched)
    if curve is None or not curve.forces.size:  # of a free motion no sample is known
        return curve
    law = np.interp(curve.velocities, curve.whole.states, curve.whole.forces)
    far, large = (float(np.median(np.abs(f))) for f in (curve.forces - law, curve.forces))
    return curve if far < 0.5 * large else None


def commit() -> str:
    """Return the commit of the code."""
    asked = ("git", "-C", str(PAGES), "rev-parse", "--short", "HEAD")
    return subprocess.run(asked, check=True, capture_output=True, text=True).stdout.strip()


def main() -> None:
    """Make the pages asked for, or all."""
    data, names = Path(sys.argv[1]), sys.argv[2:] or list(MACHINES)
    for name in names:
        with counted_in(*own_units(name, data)):
            make(name, data)


def make(name: str, data: Path) -> None:
    """Make the page of a machine, and its pictures."""
    begun = time.process_time()  # of all threads; what else the machine does is not in it
    found = diagnosed(name, data)
    seconds = time.process_time() - begun
    alone = by_itself(name, data) if MACHINES[name].alone else ""
    print(name, f"{seconds:.0f} s", found.verdict.value, file=sys.stderr)
    page = PAGES / f"{name}.md"
    before, _, rest = page.read_text().partition(BEGIN)
    after = rest.partition(END)[2]
    figure = whole_run_figure(found.whole_runs[MACHINES[name].shown], bool(found.findings))
    with writing_as("machine pages", True):
        write_text(page, before + BEGIN + answer(name, found, seconds) + alone + END + after)
        write_with(
            PAGES / f"{name}.png", lambda file, f=figure: f.savefig(file, format="png", dpi=120)
        )
        if (rubs := told_by_velocity(found)) is not None:
            drawn = friction_curve_figure(rubs, found.device.rotary)
            write_with(
                PAGES / f"{name}_friction.png",
                lambda file, f=drawn: f.savefig(file, format="png", dpi=120),
            )
        if found.learned is not None:
            law = law_figure(found.learned, found.device.rotary)
            write_with(
                PAGES / f"{name}_law.png",
                lambda file, f=law: f.savefig(file, format="png", dpi=120),
            )


if __name__ == "__main__":
    main()
