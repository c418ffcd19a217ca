"""Concealing effects of the library, each at its multiple of the limit.

Limits hold on the recording without the effect. An effect may change where the device moves (a
weight that turns it by a radian), so its sigma is computed again on the recording with the effect.
If the two differ by half, the rig is discarded.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from zwidth.diagnosis.fitting.descend import fit
from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.magnitude import magnitude, strengthened
from zwidth.exam.hidden import SEEN, Hidden, Stage, draw_times, seen
from zwidth.exam.strata import Stratum
from zwidth.planning.limits import limit, sigma
from zwidth.planning.reference import Reference
from zwidth.planning.separation import separation
from zwidth.scenarios.concealed.rig import Rig, record
from zwidth.scenarios.concealed.shapes import draw_physics, places
from zwidth.sim.device import Device
from zwidth.sim.physics import EFFECTS
from zwidth.sim.physics.effect import Physics
from zwidth.sim.trace import Trace

BESIDE = 0.6  # share of its sigma that an effect must keep beside others
AGREE = (0.5, 2.0)  # of the limit's sigma, the one in the recording as it was made
NEAR = 15.0  # sigma, beyond which a rival need not be written down
Made = tuple[Rig, Trace, tuple[Hidden, ...]]


def conceal_effects(
    stratum: Stratum, first: str, random: np.random.Generator, stage: Stage
) -> Made | None:
    """Return rig, recording and concealed effects, `first` and others; None if that fails.

    Raises RunAway if the device leaves all bounds.
    """
    known, rig = stage.known, stage.rig
    found: list[tuple[Physics, float]] = []
    for name, at in chosen(stratum, first, random, rig.device):
        shape = draw_physics(random, name, at, rig.device, stage.motion)
        sized = _sized(known, shape, draw_times(random, stratum))
        if sized is None:
            return None
        found.append(sized)
    physics = [p for p, _ in found]
    alone = [sigma(known, p) for p in physics]
    beside = _beside(known, physics) if len(physics) > 1 else alone
    if any(b < BESIDE * a or not a >= SEEN * 0.8 for a, b in zip(alone, beside, strict=True)):
        return None
    rig = replace(rig, device=rig.device.with_physics(*physics))
    made = record(rig)
    trace = made.trace
    # Which commands are lost is chance: of few, all may be lost where the command stands still.
    stands = as_made(known, replace(seen(trace, rig.device), dropped=made.lost), physics)
    for p, a, s in zip(physics, beside, stands, strict=True):
        if magnitude(p, known.peak) is not None and not AGREE[0] * a <= s <= AGREE[1] * a:
            return None
    hidden = tuple(
        Hidden(
            p.effect.name, p.at, dict(p.values), magnitude(p, known.peak), times, a, b,
            {k: d for k, d in separation(known, p).items() if d < NEAR},
        )
        for (p, times), a, b in zip(found, alone, beside, strict=True)
    )  # fmt: skip
    return rig, trace, hidden


def chosen(
    stratum: Stratum, first: str, random: np.random.Generator, device: Device
) -> list[tuple[str, str]]:
    """Return effects and places, `first` first: one law of a family a place, each effect once."""
    possible = [place for place in places(device) if EFFECTS[place[0]].strength is not None]
    ats = [at for name, at in places(device) if name == first]
    found = [(first, str(random.choice(ats)))]
    while len(found) < stratum.effects:
        taken = {name for name, _ in found}
        families = {(EFFECTS[name].family, at) for name, at in found if EFFECTS[name].family}
        left = [
            (name, at) for name, at in possible
            if name not in taken and (EFFECTS[name].family, at) not in families
        ]  # fmt: skip
        found.append(left[int(random.integers(len(left)))])
    return found


def _sized(known: Reference, shape: Physics, times: float) -> tuple[Physics, float] | None:
    """Return the effect at that many times its limit; without a magnitude, unchanged."""
    if magnitude(shape, known.peak) is None:
        return shape, sigma(known, shape) / SEEN
    smallest = limit(known, shape)
    strong = None if smallest is None else strengthened(smallest, times, known.peak)
    return None if strong is None else (strong, times)


def _beside(known: Reference, physics: Sequence[Physics]) -> list[float]:
    """Return the sigma of each effect above what a refit and the other effects' sizes absorb."""
    off = known.off(*(p.effect.name for p in physics))
    columns = np.column_stack([off(known.signature(p)) for p in physics])
    found: list[float] = []
    for i in range(columns.shape[1]):
        others = np.delete(columns, i, axis=1)
        share = np.linalg.lstsq(others, columns[:, i])[0]
        found.append(float(np.linalg.norm(columns[:, i] - others @ share)))
    return found


def as_made(known: Reference, made: Experiment, physics: Sequence[Physics]) -> list[float]:
    """Return at how many sigma each effect is visible in the recording as made.

    This is how much worse a device without this effect predicts it, with its linear parameters
    fitted to the recording completely and not to first order: a heavy weight holds its device where
    it acts as a spring, which a refit absorbs.
    """
    problem = Problem([made], known.problem.observer)
    off = known.off(*(p.effect.name for p in physics))

    def innovations(kept: Sequence[Physics], fitted: bool) -> np.ndarray:
        # Lost commands are taken off the recording, where they are under trial.
        lost = [p for p in kept if p.effect.in_recording]
        model = Model(known.device.with_physics(*(p for p in kept if p not in lost)))
        for p in lost:
            model = model.with_effect(p, {})
        x = np.zeros(model.linear_count)
        return problem.weighted(model, fit(problem, model, x).x if fitted else x)

    whole = innovations(physics, fitted=False)
    found: list[float] = []
    for gone in physics:
        moved = innovations([p for p in physics if p is not gone], fitted=True) - whole
        padded = np.concatenate([moved, np.zeros(known.jacobian.shape[0] - moved.size)])
        found.append(float(np.linalg.norm(off(padded))))
    return found
