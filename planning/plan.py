"""What a planned recording would show: the limit of each effect, and effects that look alike.

The recording is simulated with its noise and analysed as `planning.limits` does a real one. The
limit of every effect, its smallest magnitude at five sigma, is computed. Then each effect at
`ALIKE` times its limit is compared with every other effect, with the shape and strength of the
other that are nearest to first order.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.diagnosis.seeking.candidates import Start, starts_of
from zwidth.diagnosis.seeking.magnitude import magnitude, strengthened
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.planning.excitations import LIBRARY, Scale, excitation
from zwidth.planning.limits import SHOWN, limit
from zwidth.planning.reference import Reference, reference
from zwidth.planning.rehearsal import Noise, rehearse
from zwidth.planning.separation import shapes
from zwidth.shown import Shown, Valued
from zwidth.sim.device import Device, place_label
from zwidth.sim.physics import EFFECTS, contains
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.sizes import Sizes
from zwidth.sim.place import of_label, place_at

Floats = NDArray[np.float64]
ALIKE = 3.0  # times the limit, at which effects are compared with each other
RAN_AWAY = 1e5  # sigma of one sample
# The parameters whose magnitude is not their value.
MEASURES = {
    "limit": "largest command - limit",
    "ratio": "|ratio - 1|",
    "coefficient": "|coefficient|",
}
Advance = Callable[[str], object]


@dataclass(frozen=True)
class Visible(Valued):
    """The smallest visible magnitude of an effect; physics: the effect at five sigma, or None.

    None: no magnitude is visible. name, unit: of the parameter that gives its magnitude. natural:
    reference for a relative magnitude: a friction as large as the command, a gap as large as the
    link's stretch.
    """

    label: str
    physics: Physics | None
    magnitude: float | None
    name: str
    unit: str
    natural: float

    @property
    def shape(self) -> dict[str, float]:
        """The other parameters, for which the limit holds."""
        values = {} if self.physics is None else self.physics.values
        return {k: v for k, v in values.items() if k != self.name}

    @property
    def measure(self) -> str:
        """What the magnitude is: the parameter itself, or a difference or share of it."""
        effect, _ = of_label(self.label)
        if self.name and EFFECTS[effect].parameter(self.name).inverse:
            return f"1 / {self.name}"
        return MEASURES.get(self.name, self.name)


@dataclass(frozen=True)
class Confusable(Valued):
    """Two effects that look alike when one of them has three times its limit.

    separation_sigma: the smaller of the two distances, of each from the other. better: the
    excitation of the library that separates them best, with its sigma; None if no excitation
    reaches five sigma.
    """

    effect: str
    rival: str
    separation_sigma: float
    better: str | None = None
    better_sigma: float | None = None


@dataclass(frozen=True, repr=False)
class Plan(Shown):
    """The analysis of a planned recording.

    labels: of the compared effects. distances (effects, rivals): distances[i, j] is the distance in
    sigma of effect i, at three times its limit, from rival j; on the diagonal, from a device
    without the effect.
    """

    excitation: str
    seconds: float
    visible: tuple[Visible, ...]
    labels: tuple[str, ...]
    distances: Floats
    confusable: tuple[Confusable, ...]


def plan(
    device: Device, experiment: Experiment, noise: Noise, advance: Advance = lambda _: None
) -> tuple[Plan, Reference]:
    """Return the analysis of a simulated recording, and the reference used for it.

    advance is called after every effect. `better_excitations` adds better excitations.
    """
    prepared = reference(device, [experiment], noise)
    sizes = sizes_of(device, [experiment])
    typical = _typical(prepared, sizes)

    def seen(start: Start) -> Visible:
        found = limit(prepared, start.physics)
        advance(start.label)
        return _visible(prepared, sizes, start.physics, found)

    visible = tuple(in_parallel([lambda s=s: seen(s) for s in typical], threads()))
    compared = [v for v in visible if v.physics is not None and not v.physics.effect.in_recording]
    advance("comparing")
    distances = _distances(prepared, [v.physics for v in compared if v.physics is not None])
    labels = tuple(v.label for v in compared)
    seconds = experiment.ticks * experiment.period
    pairs = tuple(_confusable(labels, distances))
    return Plan(experiment.name, seconds, visible, labels, distances, pairs), prepared


def most_steps(device: Device) -> int:
    """Return the most calls of `advance` by `plan` and `better_excitations` together."""
    every = (place_at(at) for effect in EFFECTS.values() for at in effect.places)
    places = sum(place.masses_needed <= device.chain.masses.size for place in every)
    return places + 1 + len(LIBRARY)


def _typical(prepared: Reference, sizes: Sizes) -> list[Start]:
    """One start of middle shape per effect and place, including effects of the recording itself."""
    aside = [
        start
        for effect in EFFECTS.values()
        if effect.in_recording
        for start in starts_of(effect, place_at(effect.places[0]), sizes)
    ]
    grouped: dict[str, list[Start]] = {}
    for start in (*shapes(prepared.starts), *aside):
        grouped.setdefault(start.label, []).append(start)
    return [group[len(group) // 2] for group in grouped.values()]


def _visible(prepared: Reference, sizes: Sizes, physics: Physics, found: Physics | None) -> Visible:
    device, name = prepared.device, physics.effect.strength or ""
    unit = physics.effect.parameter(name).unit_for(device.rotary) if name else ""
    if name and physics.effect.parameter(name).inverse:
        unit = f"1/({unit})"
    strength = None if found is None else magnitude(found, prepared.peak)
    natural = physics.effect.natural(sizes, physics.place)
    return Visible(place_label(physics), found, strength, name, unit, natural)


def _distances(prepared: Reference, at_limit: Sequence[Physics]) -> Floats:
    """Distance of every effect at three times its limit from every rival's nearest shape."""
    strong = [strengthened(p, ALIKE, prepared.peak) or p for p in at_limit]
    rows = in_parallel([lambda p=p: prepared.signature(p) for p in strong], threads())
    labels = [place_label(p) for p in at_limit]
    bank = _bank(prepared, labels, float(ALIKE * SHOWN))
    names = [p.effect.name for p in at_limit]
    free = {name for name in names if name in prepared.absorbed}
    found = np.zeros((len(rows), len(rows)))
    for one in ("", *sorted(free)):
        for other in ("", *sorted(free)):
            mine = [i for i, n in enumerate(names) if (n if n in free else "") == one]
            theirs = [j for j, n in enumerate(names) if (n if n in free else "") == other]
            off = prepared.off(one, other)
            targets = [off(rows[i]) for i in mine]
            for j in theirs:
                signs = [off(s) for s in bank[labels[j]]]
                for i, target in zip(mine, targets, strict=True):
                    whole = float(np.linalg.norm(target))
                    same = i == j
                    found[i, j] = whole if same else nearest_of(target, signs, labels[j])
    return found


def _bank(prepared: Reference, labels: Sequence[str], strength: float) -> dict[str, list[Floats]]:
    """Signatures of every shape of some rivals, at about a strength in sigma."""
    chosen = [s for s in shapes(prepared.starts) if s.label in labels]

    def at_strength(start: Start) -> Floats:
        first = prepared.signature(start.physics)
        size = float(np.linalg.norm(prepared.off(start.physics.effect.name)(first)))
        if not size > 0.0:
            return first
        physics = strengthened(start.physics, strength / size, prepared.peak)
        found = first if physics is None else prepared.signature(physics)
        return found if np.abs(found).max() < RAN_AWAY else first

    found = in_parallel([lambda s=s: at_strength(s) for s in chosen], threads())
    bank: dict[str, list[Floats]] = {label: [] for label in labels}
    for start, signature in zip(chosen, found, strict=True):
        bank[start.label].append(signature)
    return bank


def nearest_of(target: Floats, signatures: Sequence[Floats], rival: str) -> float:
    """Distance of a target from the nearest positive multiple of any signature, all projected.

    Effects with a phase, such as waves, have signatures at two phases, which span all phases.
    """
    whole = float(target @ target)
    wave = bool(EFFECTS[of_label(rival)[0]].turning)
    groups = (
        [signatures[i : i + 2] for i in range(0, len(signatures), 2)]
        if wave
        else [[s] for s in signatures]
    )
    best = whole
    for group in groups:
        matrix = np.column_stack(group)
        gram = matrix.T @ matrix
        along = matrix.T @ target
        if not np.any(gram):
            continue
        if len(group) == 1 and along[0] < 0.0:
            continue
        best = min(best, whole - float(along @ np.linalg.pinv(gram, 1e-12) @ along))
    return float(np.sqrt(max(0.0, best)))


def _confusable(labels: Sequence[str], distances: Floats) -> list[Confusable]:
    """Pairs closer than five sigma, where neither effect contains the other."""
    found: list[Confusable] = []
    for i, one in enumerate(labels):
        for j, other in enumerate(labels[:i]):
            nearer = float(min(distances[i, j], distances[j, i]))
            if nearer < SHOWN and not _nested(one, other):
                found.append(Confusable(other, one, nearer))
    return sorted(found, key=lambda pair: pair.separation_sigma)


def _nested(one: str, other: str) -> bool:
    a, b = of_label(one), of_label(other)
    return contains(*a, *b) or contains(*b, *a)


def better_excitations(
    device: Device,
    found: Plan,
    noise: Noise,
    scale: Scale,
    seed: int = 0,
    advance: Advance = lambda _: None,
) -> Plan:
    """Return the plan with, for each pair, the library's excitation that separates it best.

    The effects have the same strength, noise and duration as in the plan.
    """
    wanted = {label for pair in found.confusable for label in (pair.effect, pair.rival)}
    physics = {v.label: v.physics for v in found.visible if v.label in wanted}
    tables: dict[str, Mapping[tuple[str, str], float]] = {}
    for name in LIBRARY if wanted else ():
        if name != found.excitation:
            command = excitation(name, device, found.seconds, scale, seed)
            experiment = rehearse(device, command, noise, seed=seed, name=name)
            prepared = reference(device, [experiment], noise)
            kept = [p for p in physics.values() if p is not None]
            labels = [place_label(p) for p in kept]
            table = _distances(prepared, kept)
            tables[name] = {
                (a, b): float(table[i, j])
                for i, a in enumerate(labels)
                for j, b in enumerate(labels)
            }
        advance(name)
    pairs = tuple(_with_better(pair, tables) for pair in found.confusable)
    return replace(found, confusable=pairs)


def _with_better(
    pair: Confusable, tables: Mapping[str, Mapping[tuple[str, str], float]]
) -> Confusable:
    def apart(name: str) -> float:
        table = tables[name]
        return min(table[pair.effect, pair.rival], table[pair.rival, pair.effect])

    best = max(tables, key=apart)
    if apart(best) < SHOWN:
        return pair
    return replace(pair, better=best, better_sigma=apart(best))
