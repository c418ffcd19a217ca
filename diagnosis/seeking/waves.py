"""Starts for effects periodic in position, at the periods that the residual shows."""

import math
from collections.abc import Mapping

import numpy as np

from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.forces.spatial import Peak, peaks, pulls
from zwidth.diagnosis.seeking.candidates import Start
from zwidth.diagnosis.seeking.lattice import predicted
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.sim.device import Device, known, place_label
from zwidth.sim.physics import EFFECTS
from zwidth.sim.physics.effect import Effect, Physics
from zwidth.sim.physics.sizes import QUARTER, Sizes
from zwidth.sim.place import Place, label_of, place_at

FINEST = 1e-3  # of the travel: the finest period
PHASES = (0.0, QUARTER)  # two phases determine any other (`diagnosis.seeking.screen`)


def wave_starts(problem: Problem, fitted: Fitted) -> list[Start]:
    """Return starts at two phases, for periods that gain more than their search costs."""
    if problem.experiments[0].outputs[0].quantity != "position":
        return []
    device = fitted.model.acting(fitted.x)
    sizes = sizes_of(device, problem.experiments, fitted.model.reads(fitted.x).gain)
    followed = predicted_states(problem, fitted) if device.chain.masses.size > 1 else []
    first = predicted(problem, fitted)
    noise = 6.0 * float(problem.observer.deviation[0])
    starts: list[Start] = []
    for effect, places in _sought(device, fitted).items():
        peaks_at: list[tuple[Place, float, list[Peak]]] = []
        own = {place: _own(effect, place, problem, fitted) for place in places}
        lines = 0
        for place in places:
            over = [x[:, place.index] for x in followed] if place.index else first
            span = max(float(np.ptp(q)) for q in over)
            finest = max(FINEST * span, noise)
            pulled, groups = pulls(problem, fitted, str(place)), list(own[place].values())
            found, seen = peaks(pulled, over, finest, groups=groups)
            peaks_at.append((place, span, found))
            lines += seen
        price = 2.0 * math.log(max(lines, 1))
        for place, span, found in peaks_at:
            for peak in found:
                if peak.gained >= price:
                    turned = dict(zip(own[place], peak.turned, strict=True))
                    turned.pop("")  # they have the phase of the effect
                    starts += _at_period(effect, place, sizes, peak.period, span, turned)
    return starts


def _own(effect: Effect, place: Place, problem: Problem, fitted: Fitted) -> dict[str, list[int]]:
    """Indices of recordings by the name of their own phase; "" for none is first."""
    (turning,) = effect.turning
    target = f"{label_of(effect.name, place)}.{turning}"
    names = [v.name for v in fitted.model.varying if v.declared and v.of == target]
    groups: dict[str, list[int]] = {"": []}
    for i, e in enumerate(problem.experiments):
        mine = next((name for name in names if name in e.own_names), "")
        groups.setdefault(mine, []).append(i)
    return groups


def _at_period(
    effect: Effect,
    place: Place,
    sizes: Sizes,
    period: float,
    span: float,
    turned: Mapping[str, float],
) -> list[Start]:
    values, scales = next(iter(effect.starts(sizes, place)))
    (turning,) = effect.turning
    values, scales = values | {"period": period}, scales | {"period": 0.1 * period**2 / span}
    bounds = effect.within(sizes, place)
    own = {name: (turning, more) for name, more in turned.items()}
    return [
        Start(Physics(effect, str(place), values | {turning: phase}), scales, bounds, own)
        for phase in PHASES
    ]


def _sought(device: Device, fitted: Fitted) -> dict[Effect, list[Place]]:
    """Effects that are periodic in position, and their open places."""
    named = {place_label(p) for p in (*device.physics, *fitted.model.effects)}
    found: dict[Effect, list[Place]] = {}
    for effect in EFFECTS.values():
        if effect.sought == "waves":
            found[effect] = [
                place
                for place in map(place_at, effect.places)
                if place.masses_needed <= device.chain.masses.size
                and label_of(effect.name, place) not in named
                and not known(effect, place, device)
            ]
    return found
