"""Public parameter sets of actuators beside what their own recordings say.

    python -m benchmarks.audit RECORDINGS
    python -m benchmarks.audit RECORDINGS --only hsm150 --write

RECORDINGS: the folder of the published files, a folder a machine. Each set has the structure that
its authors give it; the same structure is fitted to their recording, by errors over half a second,
beginning at their numbers. What no author states of it (`-`) is fitted as well and begins at a
tenth. Both sets then run freely over the same windows of half a second of recordings that nothing
was fitted to. Nothing is searched for: what the structure lacks is on the machines' own pages.
--write puts the table into benchmarks/notes/audit.md.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.command import between_marks, ended
from zwidth.diagnosis.answer.band import windows_of
from zwidth.diagnosis.answer.findings import UNITS
from zwidth.diagnosis.answer.result import Estimate
from zwidth.diagnosis.fitting.uncertainty import Z95, standard_errors
from zwidth.diagnosis.model.parameters import Model, Parameter, values_of
from zwidth.diagnosis.noise.family import as_far_as
from zwidth.diagnosis.recording.experiment import Experiment, stretches
from zwidth.diagnosis.selection.hypothesis import Hypothesis, independent, judged, settled
from zwidth.diagnosis.selection.searched import judge_of
from zwidth.diagnosis_report import estimate
from zwidth.files.protection import writing_as
from zwidth.files.whole import write_text
from zwidth.logs.recording import read_recording
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.physics import make_physics
from zwidth.sim.readable import with_unit

Floats = NDArray[np.float64]
ROOT = Path(__file__).parents[1]
MACHINES = ROOT / "docs" / "machines"
PAGE = ROOT / "benchmarks" / "notes" / "audit.md"
HORIZON_S = 0.5


@dataclass(frozen=True)
class Stated:
    """A set of parameters as its authors state it, and their recordings.

    physics: (effect, place, values); unstated: of these the numbers that nobody gives. linear: what
    is stated of mass, damper and the scale of the drive, by the model's names. judged by: the last
    30 % of what is fitted where judge is empty.
    """

    title: str
    of: str
    machine: str
    fit: tuple[str, ...]
    judge: tuple[str, ...]
    physics: tuple[tuple[str, str, Mapping[str, float]], ...]
    linear: Mapping[str, float]
    unstated: frozenset[str] = field(default_factory=frozenset[str])


SETS = {
    "sts3250": Stated(
        "STS3250 servo with a pendulum (BAM)",
        "data sheet and file headers: winding, motor constant, weight and lever",
        "servo_pendulum",
        ("sin_sin_kp8", "sin_sin_kp32", "sin_sin_heavy_kp8", "sin_sin_heavy_kp32"),
        ("up_and_down_kp8", "up_and_down_kp32", "up_and_down_heavy_kp8", "up_and_down_heavy_kp32"),
        (("gravity_pendulum", "m1", {"level": 0.535 * 9.81 * 0.15, "angle": 0.0}),
         ("load_friction", "m1", {"ratio": 0.1})),
        {"gain": 1.0}, frozenset({"ratio", "m1", "b1"}),
    ),
    "hsm150": Stated(
        "HSM150 motor",
        "catalogue: inertia and damper; published fits of the runs forwards: friction",
        "hsm150", ("hsm_pos_0.06_1",), (),
        (("coulomb_friction", "m1", {"level": 0.0345}),),
        {"m1": 1.2e-4, "b1": 7.03e-5},
    ),
    "lugre": Stated(
        "Servo motor of the LuGre recordings",
        "its builders: inertia and Coulomb friction",
        "lugre_motor", ("LuGre_J_1",), ("LuGre_J_2",),
        (("coulomb_friction", "m1", {"level": 0.0149}),),
        {"m1": 1.76e-4}, frozenset({"b1"}),
    ),
    "lugre_presliding": Stated(
        "The same motor before it slides",
        "its builders: break-away friction and stiffness of the presliding",
        "lugre_motor", ("LuGre_sigma0_1",), (),
        (("presliding_friction", "m1", {"level": 0.0230, "stiffness": 1.39}),),
        {"m1": 1.76e-4}, frozenset({"b1"}),
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Told:
    """A parameter: as stated (None for not), as the recording has it, and half of its 95 %."""

    name: str
    stated: float | None
    value: float
    half: float
    unit: str

    @property
    def agrees(self) -> bool:
        """Whether what is stated lies in the recording's interval."""
        return self.stated is not None and abs(self.stated - self.value) <= self.half


@dataclass(frozen=True)
class Audit:
    """What came out; errors: rms of free runs of half a second, by whose numbers."""

    of: Stated
    told: tuple[Told, ...]
    authors: float
    ours: float
    unit: str


def experiments_of(s: Stated, stems: Sequence[str], device: Device, data: Path) -> list[Experiment]:
    """Return recordings as the machine's page reads them."""
    folder = MACHINES / s.machine
    each = [(read_recording(folder / f"{stem}.toml", data / s.machine), stem) for stem in stems]
    return [e for trace, stem in each for e in stretches(trace, device, stem)]


def fitted(s: Stated, device: Device, fit: Sequence[Experiment]) -> Hypothesis:
    """Return the authors' structure as their recording tells it."""
    effects = tuple(make_physics(name, at, **values) for name, at, values in s.physics)
    scales = tuple({k: abs(v) or 1.0 for k, v in values.items()} for _, _, values in s.physics)
    model = Model(device, effects, scales)
    family = as_far_as(HORIZON_S, fit)
    first = settled(judged(fit, model, np.zeros(len(model.parameters)), family))
    return settled(independent(first, HORIZON_S))


def of_parameter(s: Stated, h: Hypothesis, p: Parameter, place: int, error: float) -> Told | None:
    """Return a parameter with its stated value; None for what is of the recording alone."""
    if p.kind == "effect":
        physics, x = h.model.effects[p.index], float(h.x[place])
        unit = physics.effect.parameter(p.key).unit_for(h.model.nominal.rotary)
        stated = None if p.key in s.unstated else dict(s.physics[p.index][2])[p.key]
        value, half = physics.values[p.key] + p.scale * x, Z95 * p.scale * error
        return Told(f"{physics.effect.name}: {p.key}", stated, value, half, unit)
    if p.name not in s.linear and p.name not in s.unstated:
        return None
    value = values_of(h.model, h.x)[p.name]
    nominal = values_of(Model(h.model.nominal), np.zeros(len(Model(h.model.nominal).parameters)))
    half = Z95 * abs(p.slope(nominal[p.name], float(h.x[place]))) * error
    unit = UNITS[p.kind][0 if h.model.nominal.rotary else 1]
    return Told(p.name, s.linear.get(p.name), value, half, unit)


def free_error(model: Model, x: Floats, judge: Sequence[Experiment], ratio: float) -> float:
    """Return the rms error of the first output; each window begins in an observer's state."""
    return float(windows_of(model, x, judge, ratio, HORIZON_S).rms[0])


def audit(s: Stated, data: Path) -> Audit:
    """Fit, and hold both sets against what was kept out."""
    device = load_device(MACHINES / s.machine / "device.toml")
    whole = experiments_of(s, s.fit, device, data)
    if s.judge:
        fit, judge = whole, experiments_of(s, s.judge, device, data)
    else:
        fit, judge = map(list, zip(*(e.split() for e in whole), strict=True))
    h = fitted(s, device, fit)
    errors = standard_errors(h.fitted).tolist()
    told = [of_parameter(s, h, p, k, errors[k]) for k, p in enumerate(h.model.parameters)]
    authors = tuple(make_physics(n, at, **v) for n, at, v in s.physics
                    if not s.unstated.intersection(v))  # fmt: skip
    stated = Model(replace(device, physics=(*device.physics, *authors)))
    ratio = judge_of(h).ratio  # under which the next sample is likeliest: it forgets soon
    unit = "rad" if device.rotary else "m"
    return Audit(
        s, tuple(t for t in told if t is not None),
        free_error(stated, np.zeros(len(stated.parameters)), judge, ratio),
        free_error(h.model, h.x, judge, ratio), unit,
    )  # fmt: skip


def table(audits: Sequence[Audit]) -> str:
    """Return what each set states beside what its recording says, as Markdown."""
    lines = [
        "| set | parameter | stated | its recording says (95 %) | stated lies within |"
        " free runs of 0.5 s: stated; fitted |",
        "|---|---|---|---|---|---|",
    ]
    for a in audits:
        errors = f"{with_unit(a.authors, a.unit, 3)}; **{with_unit(a.ours, a.unit, 3)}**"
        if a.authors <= a.ours:
            errors = f"**{with_unit(a.authors, a.unit, 3)}**; {with_unit(a.ours, a.unit, 3)}"
        for k, t in enumerate(a.told):
            stated = "-" if t.stated is None else with_unit(t.stated, t.unit, 3)
            within = "-" if t.stated is None else "yes" if t.agrees else "no"
            told = estimate(Estimate(t.value, t.value - t.half, t.value + t.half, t.unit))
            first = k == 0
            lines.append(
                f"| {f'{a.of.title}; {a.of.of}' if first else ''} | {t.name} | {stated} | {told} |"
                f" {within} | {errors if first else ''} |"
            )
    return "\n".join(lines) + "\n"


def main() -> int:
    """Audit what was asked for, and print the table; 2 where that cannot be."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("recordings", type=Path, help="folder of the published files")
    options.add_argument("--only", choices=list(SETS), action="append", help="this set")
    options.add_argument("--write", action="store_true", help="write the page, too")
    asked = options.parse_args()

    def work() -> None:
        made = table([audit(SETS[name], asked.recordings) for name in asked.only or list(SETS)])
        print(made)
        if asked.write:
            page = between_marks(PAGE.read_text(encoding="utf-8"), made, "benchmarks/audit.py")
            with writing_as("audit", overwrite=True):
                write_text(PAGE, page)

    return ended(work)


if __name__ == "__main__":
    sys.exit(main())
