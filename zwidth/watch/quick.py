"""A quick fit of the last search's structure to the last samples, which tests it.

The structure is kept, its numbers are fitted again (`settled`, from their last values), and so is
the structure without its effects. It still holds if it costs less than without them by more than
chance allows, 2 ln (1 / ALPHA), and if free runs err no more than its own noise predicts
(`answer.adequacy`), here on the samples that it was fitted to. No new effects are sought; that is
left to the next search.
"""

import math
import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.answer.adequacy import Adequacy, adequacy
from zwidth.diagnosis.intake.gate import corrected
from zwidth.diagnosis.intake.take_in import readings
from zwidth.diagnosis.model.own_values import first_x
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError
from zwidth.diagnosis.selection.evidence import ALPHA
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.fleet.quick import estimates, names_of
from zwidth.fleet.structure import Structure
from zwidth.logs.recording_file import Description
from zwidth.sim.device import Device
from zwidth.sim.readable import with_unit
from zwidth.watch.searched import Searched
from zwidth.watch.state import latest, read
from zwidth.watch.wall import Wall, renders, wall

Floats = NDArray[np.float64]
SURELY = 2.0 * math.log(1.0 / ALPHA)
MUCH = 2.0  # error of free runs over noise, above which a sentence explains why this is accepted


@dataclass(frozen=True)
class Quick:
    """The result of a quick fit to the samples from `begins` to `ends` [s].

    structure: effect@place of each effect; values: value, 95 % half width and unit by parameter.
    stands: whether the structure explains them; gained: -2 ln over the structure without its
    effects, 0 if it has none; ahead: error of free runs over that predicted by noise, at the
    horizon where it is largest, None if unknown (a structure is also rejected if these errors
    follow the motion, so it may be near 1). took: duration of the fit [s].
    """

    samples: int
    begins: float
    ends: float
    structure: tuple[str, ...]
    values: dict[str, tuple[float, float, str]]
    stands: bool
    gained: float
    ahead: float | None
    x: Floats
    wall: Wall | None
    took: float

    @property
    def sentence(self) -> str:
        """A sentence on whether the found structure still explains the log."""
        names = " and ".join(s.replace("_", " ").replace("@", " at ") for s in self.structure)
        if self.structure and self.gained <= SURELY:
            return f"{names} no longer explains more than chance"
        much = (
            "" if self.ahead is None else f"error of free runs {self.ahead:.3g} times their noise"
        )
        if self.stands and self.ahead is not None and self.ahead > MUCH:
            much += ", which may be chance"
        far = f" ({much})" if much else ""
        if self.stands:
            return (f"{names} explains it" if names else "nothing seems to be missing") + far
        if not names:
            return f"the known physics does not explain the log{far}"
        return f"something is missing beyond {names}{far}"

    @property
    def numbers(self) -> str:
        """The parameters of effects in one line."""
        return ", ".join(
            f"{name.partition('.')[2]} {with_unit(v, u)} +- {with_unit(e, u, 2)}"
            for name, (v, e, u) in self.values.items()
            if "@" in name
        )

    def as_json(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "from_s": self.begins,
            "to_s": self.ends,
            "structure": list(self.structure),
            "stands": self.stands,
            "sentence": self.sentence,
            "gained": self.gained,
            "free_run_over_noise": self.ahead,
            "parameters": {
                k: {"value": v, "half_width95": e if math.isfinite(e) else None, "unit": u}
                for k, (v, e, u) in self.values.items()
            },
            "wall": self.wall and self.wall.as_json(),
        }


@dataclass(frozen=True)
class Order:
    """The input of a quick fit: the copy of the log, the device, the last search, and the last fit.

    x: parameters of the last fit, from which this one starts. samples: number of newest samples to
    fit. damping: B of the wall. walls: whether a wall is computed; None: if the device may render
    one.
    """

    spool: Path
    description: Description | None
    name: str
    device: Device
    found: Searched | None
    x: Floats | None
    samples: int
    damping: float
    walls: bool | None


def quick(order: Order) -> Quick:
    """Fit the last samples; raises ExperimentError if they cannot be used."""
    began = time.monotonic()
    trace = read(order.spool, order.description).trace
    assert trace is not None
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # of numpy, on 1e300
        last = latest(trace, order.device, order.name, order.samples)
        first = readings(order.device, last, None)[0]
        taken = list(first.whole)
        # The result of a search belongs to its own device, whose zeros may be free.
        device = first.device if order.found is None else order.found.model.nominal
        if order.found is not None:
            taken = [corrected(e, order.found.misread) for e in taken]
        try:
            h, refit = _fits(order, device, taken)
        except NoObserver as error:
            raise ExperimentError(str(error)) from error
        sound = adequacy(Model(device), refit.fitted, h.fitted, h.noise.observer, taken)
        built = h.model.build(h.x)
        drawn = wall(built, order.damping) if renders(built, taken, order.walls) else None
    gained = refit.cost.total - h.cost.total if h.model.effects else 0.0
    stands = (not h.model.effects or gained > SURELY) and (sound is None or sound.sound)
    return Quick(
        sum(e.ticks for e in taken), taken[0].begins,
        taken[-1].begins + (taken[-1].ticks - 1) * taken[-1].period, tuple(sorted(h.labels)),
        _values(h), stands, gained, _ahead(sound), h.x, drawn, time.monotonic() - began,
    )  # fmt: skip


def _fits(
    order: Order, device: Device, taken: Sequence[Experiment]
) -> tuple[Hypothesis, Hypothesis]:
    """The structure that was found, and the device's own physics alone."""
    bare = Model(device)
    refit = settled(judged(taken, bare, first_x(bare, taken)))
    if order.found is None or not order.found.model.effects:
        return refit, refit
    model = Model(
        device, order.found.model.effects, order.found.model.scales,
        bounds=order.found.model.bounds,
    )  # fmt: skip
    x = order.found.x[: len(model.parameters)] if order.x is None else order.x
    return settled(judged(taken, model, model.within(x))), refit


def _values(h: Hypothesis) -> dict[str, tuple[float, float, str]]:
    model = h.model
    units = names_of(Structure(model.nominal, model.effects, model.scales, model.bounds))
    values, errors, _ = estimates(h)
    return {
        name: (float(v), 1.96 * float(e), unit)
        for (name, unit), v, e in zip(units.items(), values, errors, strict=True)
    }


def _ahead(sound: Adequacy | None) -> float | None:
    """By how many times free runs err farther than noise makes them, where they do so most."""
    if sound is None:
        return None
    return max(a.error / max(a.expected, 1e-300) for a in sound.ahead)
