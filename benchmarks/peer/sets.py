"""The recordings of the comparison: what is fitted, what is held out, and the one error of all.

Every method gets the same arrays and hands back what it foretells of the held-out part; `judged`
is the only place where that is held against what was measured.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.recording.experiment import Experiment, stretches
from zwidth.logs.recording import read_recording
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device

Floats = NDArray[np.float64]
HERE = Path(__file__).parent
MACHINES = HERE.parents[1] / "docs" / "machines"
DIVERGED = 3.0  # times the motion: a constant errs once the motion about its mean


@dataclass(frozen=True)
class Part:
    """A stretch of a recording: command (ticks,) and measured (ticks, o), every period [s]."""

    command: Floats
    measured: Floats

    @property
    def ticks(self) -> int:
        """Number of samples."""
        return self.command.size

    def cut(self, start: int, stop: int | None = None) -> "Part":
        """Return the samples start <= k < stop."""
        return Part(self.command[start:stop], self.measured[start:stop])


@dataclass(frozen=True)
class Kind:
    """What is known of a set beforehand.

    folder: of its device and recording files; fit, judge: the names of recording files; without
    judge the last 30 % of the first are held out. published: what the literature reaches, and on
    what. window [s]: what the picture shows, from where the held-out part begins; period [s] of its
    samples.
    """

    name: str
    title: str
    folder: Path
    data: str
    fit: str
    judge: str | None
    start: str
    published: str
    window: tuple[float, float]
    period: float


@dataclass(frozen=True)
class Set:
    """A set with its data. follows: whether the held-out part goes on where the fitted one ends."""

    kind: Kind
    device: Device
    period: float
    units: tuple[str, ...]
    outputs: tuple[str, ...]
    fit: Part
    held: Part
    recordings: tuple[tuple[Experiment, ...], tuple[Experiment, ...] | None]

    @property
    def follows(self) -> bool:
        """Whether the held-out part goes on where the fitted part ends."""
        return self.kind.judge is None


GOES_ON = "the state at the cut, which each method estimates from the fitted part before it"
KINDS = {
    kind.name: kind
    for kind in (
        Kind(
            "emps", "EMPS, a ball-screw axis", HERE / "emps", "emps", "recording", None, GOES_ON,
            "published structure 1.04 mm, with a damper for each direction 0.34 mm (in windows of"
            " 0.62 s, not one free run: not the same figure)",
            (0.0, 7.4), 1e-3,
        ),
        Kind(
            "silverbox", "Silverbox, a Duffing circuit", HERE / "silverbox", "silverbox",
            "recording", None, GOES_ON,
            "black boxes 0.24 to 0.26 mV on this set; linear + cubic 0.909 mV (each on its authors'"
            " parts)",
            (10.3, 10.45), 0.0016384,
        ),
        Kind(
            "two_mass_cart", "Two carts on a spring", MACHINES / "two_mass_cart", "two_mass_cart",
            "tm_2", "tm_1_5", "at rest, at the first velocities that were read",
            "a simulation with two Coulomb forces, fitted to the same: 14.0 and 15.2 %; linear 26"
            " and 28 %",
            (0.0, 3.0), 1e-3,
        ),
        Kind(
            "coupled_drives", "Two motors on a belt", MACHINES / "coupled_drives",
            "coupled_drives", "drive_2", None, GOES_ON,
            "third-order linear with the absolute value 0.516, without 1.583 (on the last 200"
            " samples; here the last 150)",
            (0.0, 3.0), 0.02,
        ),
    )
}  # fmt: skip


def read(name: str, recordings: Path) -> Set:
    """Return a set of the folder that has the published files, a folder a set.

    Raises OSError or ValueError if a file is missing or is not what it should be.
    """
    kind = KINDS[name]
    device = load_device(kind.folder / "device.toml")

    def experiments(stem: str) -> tuple[Experiment, ...]:
        trace = read_recording(kind.folder / f"{stem}.toml", recordings / kind.data)
        return tuple(stretches(trace, device, stem))

    fit = experiments(kind.fit)
    if kind.judge is None:
        judge, parts = None, fit[0].split()
    else:
        judge = experiments(kind.judge)
        parts = (fit[0], judge[0])
    length = "rad" if device.rotary else "m"
    units = tuple(length if o.quantity == "position" else f"{length}/s" for o in fit[0].outputs)
    first, rest = (Part(e.command, e.measured) for e in parts)
    names = tuple(o.name for o in fit[0].outputs)
    return Set(kind, device, fit[0].period, units, names, first, rest, (fit, judge))


@dataclass(frozen=True)
class Error:
    """How far a free run is off, an output each: rms in its unit, and over the rms of the motion.

    Infinite if the run has left the motion: where it is not finite, or errs beyond `DIVERGED`
    times the motion about its mean.
    """

    rms: tuple[float, ...]
    share: tuple[float, ...]

    @property
    def diverges(self) -> bool:
        """Whether any output has left the motion."""
        return not all(math.isfinite(r) for r in self.rms)


def judged(measured: Floats, foretold: Floats) -> Error:
    """Return the error of what was foretold (ticks, o) of what was measured (ticks, o).

    Raises ValueError if the two differ in shape: nobody may leave samples out.
    """
    if measured.shape != foretold.shape:
        raise ValueError(
            f"what is foretold has the shape {foretold.shape}, what was measured"
            f" {measured.shape}; foretell every held-out sample of every output"
        )
    motion = measured.std(axis=0)
    with np.errstate(all="ignore"):
        rms = np.sqrt(np.mean((foretold - measured) ** 2, axis=0))
    rms = np.where(np.isfinite(rms) & (rms <= DIVERGED * motion), rms, np.inf)
    return Error(tuple(rms.tolist()), tuple((rms / motion).tolist()))


def inner(part: Part, share: float = 0.7) -> tuple[Part, Part]:
    """Split a fitted part in two, to choose settings by: the held-out part is for nothing else."""
    cut = round(share * part.ticks)
    return part.cut(0, cut), part.cut(cut)


def total(error: Error) -> float:
    """One figure of all outputs, to choose settings by."""
    return math.sqrt(float(np.mean(np.square(error.share))))


def best_of(errors: Sequence[float]) -> int:
    """Place of the least of errors, the first where none is finite."""
    return int(np.argmin([e if math.isfinite(e) else math.inf for e in errors]))
