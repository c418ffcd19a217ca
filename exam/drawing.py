"""One concealed recording: a random rig with effects scaled by the limit of this recording.

The limit is that of the true device without its physics, on a recording with the same drive, noise
and jitter as the published one.
"""

from dataclasses import asdict, dataclass, replace

import numpy as np

from zwidth.diagnosis.noise.settle import refit
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.exam.hidden import Hidden, Stage, seen
from zwidth.exam.of_library import conceal_effects
from zwidth.exam.of_no_library import conceal_outside
from zwidth.exam.strata import Stratum
from zwidth.exam.subject import Subject
from zwidth.planning.reference import reference
from zwidth.scenarios.concealed.devices import draw_device, mistaken
from zwidth.scenarios.concealed.excitation import draw_drive
from zwidth.scenarios.concealed.outside import OUTSIDE
from zwidth.scenarios.concealed.rig import Rig, RunAway, draw_nuisance, draw_outputs, record
from zwidth.scenarios.concealed.shapes import motion_of, places
from zwidth.sim.device import Device
from zwidth.sim.physics import EFFECTS
from zwidth.sim.trace import Trace

SHORTEST, LONGEST = 10.0, 20.0  # s
FITTED_SHARE = 0.3  # of device files that were fitted to the recording, effect and all
TRIES = 12


@dataclass(frozen=True)
class Concealed:
    """A recording with its device file, and the truth that is kept secret."""

    stratum: str
    trace: Trace
    nominal: Device
    rig: Rig
    hidden: tuple[Hidden, ...]
    fitted: bool

    @property
    def experiment(self) -> Experiment:
        """The recording as an experiment for a diagnosis."""
        return seen(self.trace, self.nominal)

    def subject(self) -> Subject:
        """Return the recording as a subject of the exam."""
        rig, outside = self.rig, self.rig.outside
        about = {
            "drive": {"kind": rig.drive.kind, "feedback": list(rig.drive.feedback)},
            "noise": asdict(rig.nuisance),
        }
        return Subject(
            self.stratum, (self.trace,), (), self.nominal, rig.device, self.hidden,
            "fitted to this recording" if self.fitted else "up to 10 % off", about,
            None if outside is None else {"name": outside.name, **outside.values},
        )  # fmt: skip


def draw(
    stratum: Stratum, seed: int, index: int, rank: int = 0, seconds: float | None = None
) -> Concealed:
    """Return recording number `index` of a seed.

    rank: its number within its class, by which its (first) effect is chosen, so that all effects
    come equally often. seconds: its length, drawn from 10 to 20 s if None. Raises ValueError if no
    rig was found that shows such effects.
    """
    random = np.random.default_rng([seed, index])
    names: list[str | None] = [*_names(stratum)] or [None]
    for offset in range(len(names)):  # the next effect, if no rig shows this one
        for _ in range(TRIES):
            try:
                made = _try(stratum, names[(rank + offset) % len(names)], random, seconds)
            except (RunAway, NoObserver):
                continue
            if made is not None:
                return made
    raise ValueError(f"no rig was found for {stratum.name}; try another seed")


def _names(stratum: Stratum) -> list[str]:
    if stratum.outside:
        return list(OUTSIDE)
    if stratum.effects == 0:
        return []
    scalable = [name for name, effect in EFFECTS.items() if effect.strength is not None]
    return scalable if stratum.most < 5.0 or stratum.effects > 1 else list(EFFECTS)


def _try(
    stratum: Stratum, first: str | None, random: np.random.Generator, seconds: float | None
) -> Concealed | None:
    # An encoder's steps hide the difference by which the unknown is measured (`of_no_library`).
    device = draw_device(random, encoder=first not in OUTSIDE and first != "encoder_step")
    possible = places(device)
    if first in EFFECTS and first not in {name for name, _ in possible}:
        return None
    duration = seconds or float(random.uniform(SHORTEST, LONGEST))
    drive = draw_drive(random, device, duration)
    nuisance = draw_nuisance(random, device, drive)
    outputs, noise = draw_outputs(random, device), int(random.integers(2**62))
    bare = Rig(device, drive, nuisance, outputs, None, noise)
    made = record(bare)
    rig, trace, hidden = bare, made.trace, ()
    if first is not None:
        known = reference(device, [seen(trace, device)])
        stage = Stage(bare, known, motion_of(made, device))
        hide = conceal_outside if first in OUTSIDE else conceal_effects
        found = hide(stratum, first, random, stage)
        if found is None:
            return None
        rig, trace, hidden = found
    nominal = mistaken(random, device)
    # A delay or step that is concealed is not in the device file; what is known there stays.
    nominal = replace(nominal, name="device under test", source="")
    fitted = bool(random.random() < FITTED_SHARE)
    if fitted:
        _, best = refit(nominal, [seen(trace, nominal)])
        nominal = best.model.build(best.x)
    return Concealed(stratum.name, trace, nominal, rig, hidden, fitted)
