"""One concealed recording: its rig drawn, its effects scaled by the limit of just this recording.

The limit is that of the true device without its physics, on a recording that differs from the one
handed out by nothing but the physics: same drive, same noise, same jitter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.exam.strata import Stratum
from diagnosis.experiment import Experiment, experiment
from diagnosis.fit import Problem
from diagnosis.limits import crossing, limit, sigma
from diagnosis.magnitude import magnitude, strengthened
from diagnosis.parameters import Model
from diagnosis.reference import Reference, reference
from diagnosis.search import refit
from diagnosis.separation import separation
from scenarios.concealed.devices import draw_device, mistaken
from scenarios.concealed.excitation import draw_drive
from scenarios.concealed.outside import OUTSIDE, Outside
from scenarios.concealed.rig import Rig, RunAway, draw_nuisance, draw_outputs, record
from scenarios.concealed.shapes import Motion, draw_physics, motion_of, places
from sim.device import Device
from sim.physics import EFFECTS
from sim.physics.effect import Physics
from sim.trace import Trace

Floats = NDArray[np.float64]
SHORTEST, LONGEST = 10.0, 20.0  # s
FITTED_SHARE = 0.3  # of device files that were fitted to the recording, effect and all
SEEN = 5.0  # sigma at which an effect is at its limit
BESIDE = 0.6  # share of its sigma that an effect must keep beside others
TRIES = 12
NEAR = 15.0  # sigma, beyond which a rival need not be written down
COARSE = 20  # steps a tick while a strength is sought
DRY = ("coulomb_friction", "stribeck_friction", "presliding_friction", "directional_friction")
"""Laws of one and the same friction: a mass has one of them."""


@dataclass(frozen=True)
class Hidden:
    """A concealed effect: its magnitude, and how many times the limit that is.

    sigma: at which it stands above what a refit absorbs, alone; sigma_beside: and above what the
    other concealed effects' sizes absorb. rivals: effect@place -> its distance from this effect, in
    sigma, up to `NEAR`, nearest first.
    """

    effect: str
    at: str
    values: dict[str, float]
    magnitude: float | None
    times_limit: float
    sigma: float
    sigma_beside: float
    rivals: dict[str, float]


@dataclass(frozen=True)
class Concealed:
    """A recording, the device file that goes with it, and what is kept from whoever gets them."""

    stratum: str
    trace: Trace
    nominal: Device
    rig: Rig
    hidden: tuple[Hidden, ...]
    fitted: bool

    @property
    def experiment(self) -> Experiment:
        """The recording as a diagnosis takes it."""
        return seen(self.trace, self.nominal)


def seen(trace: Trace, device: Device) -> Experiment:
    """Return a trace as a diagnosis takes it."""
    return experiment(trace, device.interface.period, device.chain.masses.size)


def draw(
    stratum: Stratum, seed: int, index: int, rank: int = 0, seconds: float | None = None
) -> Concealed:
    """Return recording number `index` of a seed.

    rank: its number within its class, by which its (first) effect is chosen, so that all effects
    come equally often. seconds: its length, drawn from 10 to 20 s where None. Raises ValueError
    where no rig was found that shows such effects.
    """
    random = np.random.default_rng([seed, index])
    names: list[str | None] = [*_names(stratum)] or [None]
    for offset in range(len(names)):  # the next effect, where no rig shows this one
        for _ in range(TRIES):
            try:
                made = _try(stratum, names[(rank + offset) % len(names)], random, seconds)
            except (RunAway, np.linalg.LinAlgError):
                continue
            if made is not None:
                return made
    raise ValueError(f"no rig was found for {stratum.name}; try another seed")


def _names(stratum: Stratum) -> list[str]:
    if stratum.outside:
        return list(OUTSIDE)
    if stratum.effects == 0:
        return []
    scalable = [name for name in EFFECTS if name != "rectified_sensor"]
    return scalable if stratum.most < 5.0 or stratum.effects > 1 else list(EFFECTS)


def _try(
    stratum: Stratum, first: str | None, random: np.random.Generator, seconds: float | None
) -> Concealed | None:
    device = draw_device(random, encoder=first != "encoder_step")
    possible = places(device)
    if first in EFFECTS and first not in {name for name, _ in possible}:
        return None
    duration = seconds or float(random.uniform(SHORTEST, LONGEST))
    drive = draw_drive(random, device, duration)
    nuisance = draw_nuisance(random, device, drive)
    outputs, noise = draw_outputs(random, device), int(random.integers(2**62))
    bare = Rig(device, drive, nuisance, outputs, None, noise)
    made = record(bare)
    hidden: tuple[Hidden, ...] = ()
    rig = bare
    if first is not None:
        known = reference(device, [seen(made.trace, device)])
        motion = motion_of(made, device)
        if first in OUTSIDE:
            found = _outside(stratum, first, random, bare, known, motion)
        else:
            found = _effects(stratum, first, random, bare, known, motion)
        if found is None:
            return None
        rig, hidden = found
    trace = record(rig).trace if hidden else made.trace
    nominal = mistaken(random, device)
    # A delay or step that is concealed is not in the device file; what is known there stays.
    nominal = replace(nominal, name="device under test", source="")
    fitted = bool(random.random() < FITTED_SHARE)
    if fitted:
        _, best = refit(nominal, [seen(trace, nominal)])
        nominal = best.model.build(best.x)
    return Concealed(stratum.name, trace, nominal, rig, hidden, fitted)


def _times(random: np.random.Generator, stratum: Stratum) -> float:
    return float(np.exp(random.uniform(math.log(stratum.least), math.log(stratum.most))))


def _effects(
    stratum: Stratum, first: str, random: np.random.Generator, rig: Rig, known: Reference,
    motion: Motion,
) -> tuple[Rig, tuple[Hidden, ...]] | None:  # fmt: skip
    possible = [place for place in places(rig.device) if place[0] != "rectified_sensor"]
    ats = [at for name, at in places(rig.device) if name == first]
    chosen = [(first, str(random.choice(ats)))]
    while len(chosen) < stratum.effects:
        taken = {name for name, _ in chosen}
        dry = {at for name, at in chosen if name in DRY}
        left = [p for p in possible if p[0] not in taken and not (p[0] in DRY and p[1] in dry)]
        chosen.append(left[int(random.integers(len(left)))])
    found: list[tuple[Physics, float]] = []
    for name, at in chosen:
        shape = draw_physics(random, name, at, rig.device, motion)
        times = _times(random, stratum)
        if magnitude(shape, known.peak) is None:
            found.append((shape, sigma(known, shape) / SEEN))
            continue
        smallest = limit(known, shape)
        strong = None if smallest is None else strengthened(smallest, times, known.peak)
        if strong is None:
            return None
        found.append((strong, times))
    physics = [p for p, _ in found]
    alone = [sigma(known, p) for p in physics]
    beside = _beside(known, physics) if len(physics) > 1 else alone
    if any(b < BESIDE * a or not a >= SEEN * 0.8 for a, b in zip(alone, beside, strict=True)):
        return None
    hidden = tuple(
        Hidden(
            p.effect.name, p.at, dict(p.values), magnitude(p, known.peak), times, a, b,
            {k: d for k, d in separation(known, p).items() if d < NEAR},
        )
        for (p, times), a, b in zip(found, alone, beside, strict=True)
    )  # fmt: skip
    return replace(rig, device=rig.device.with_physics(*physics)), hidden


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


def _outside(
    stratum: Stratum, name: str, random: np.random.Generator, rig: Rig, known: Reference,
    motion: Motion,
) -> tuple[Rig, tuple[Hidden, ...]] | None:  # fmt: skip
    if name == "swaying_stiffness" and rig.device.chain.masses.size < 2:
        return None
    shape = _outside_shape(random, name, motion, rig.device)
    off = known.off()

    def outside(strength: float) -> Outside | None:
        return _strong(name, strength, shape, motion)

    def sigma_at(strength: float) -> float | None:
        physics = outside(strength)
        if physics is None:
            return None
        try:
            trace = record(replace(rig, outside=physics), COARSE).trace
        except RunAway:
            return None
        return float(np.linalg.norm(off(_difference(known, seen(trace, rig.device)))))

    smallest = crossing(lambda factor: sigma_at(0.01 * factor))
    if smallest is None:
        return None
    times = _times(random, stratum)
    strength = 0.01 * smallest * times
    physics, stands = outside(strength), sigma_at(strength)
    if physics is None or stands is None or stands < SEEN * stratum.least:
        return None
    place = "command" if name == "slew_limit" else "link12" if "stiff" in name else "m1"
    hidden = Hidden(name, place, dict(physics.values), strength, times, stands, stands, {})
    return replace(rig, outside=physics), (hidden,)


def _difference(known: Reference, other: Experiment) -> Floats:
    """Return the innovations of another recording of the same noise, less the reference's."""
    model = Model(known.device)
    there = Problem([other], known.problem.observer).weighted(model, np.zeros(model.linear_count))
    moved = there - known.base
    return np.concatenate([moved, np.zeros(known.jacobian.shape[0] - moved.size)])


def _outside_shape(
    random: np.random.Generator, name: str, motion: Motion, device: Device
) -> tuple[float, ...]:
    """Numbers of the effect that are not its strength."""
    match name:
        case "swaying_stiffness":
            return (float(random.uniform(1.0, 10.0)),)
        case "swinging_inertia":
            return (motion.span * float(random.uniform(0.2, 1.0)),)
        case "warming_dampers":
            return (float(random.uniform(2.0, 8.0)),)
        case "hum":
            return float(random.uniform(5.0, 80.0)), float(random.uniform(-math.pi, math.pi))
        case "hard_stop":
            stiffness = float(device.chain.masses.sum()) * (2 * math.pi * 15.0) ** 2
            return stiffness, 0.02 * stiffness / (2 * math.pi * 15.0)
        case "detent":
            return motion.span * float(random.uniform(0.05, 0.3)), float(random.uniform(2.0, 6.0))
        case _:
            return ()


def _strong(name: str, s: float, shape: tuple[float, ...], motion: Motion) -> Outside | None:
    """Return the effect at a strength, 0.01 being about a percent of the motion."""
    keys = OUTSIDE[name][1]
    if name == "hard_stop":
        values = ((1.0 - s) * 0.5 * motion.span, *shape)
    elif name == "slew_limit":  # per second; the largest change of a command is 2 peaks a tick
        values = ((1.0 - s) * 2.0 * motion.peak * 1e3,)
    elif name == "cubic_drag":
        values = (s * motion.force / motion.speed**3,)
    elif name in ("hum", "detent"):
        values = (s * motion.force, *shape)
    else:
        values = (s, *shape)
    most = 0.9 if name not in ("cubic_drag", "hum", "detent", "warming_dampers") else math.inf
    if not 0.0 < s <= most:
        return None
    return Outside(name, dict(zip(keys, values, strict=True)))
