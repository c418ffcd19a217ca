"""Tests by complete fits whether a named effect is really a similar one that the library lacks.

A strong drag or a stop changes the motion completely, which a force added to the recording
(`forces.unknown`) cannot represent. So a named effect is replaced by a law that is not in the
library, which is simulated and fitted like any effect:

    quadratic_drag, alone or with any one other effect      a drag whose power is free
    effects over position at m1, each alone and all         a spring met on one side only
    force_ripple, alone, with any one other and with all    a force of four harmonics

If this law is more likely (`rather`), after the penalty for its unknowns, the physics is not in the
library. For example, a cubic drag resembles a quadratic one and some friction, a stop resembles a
spring that stiffens and some gravity, a magnet's detent resembles a ripple and an eccentric
encoder.
"""

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.forces.leftover import predicted_states
from zwidth.diagnosis.forces.unknown import Instead, alone
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import NEXT_SAMPLE
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.noise.settle import fitted_in_turn, settle
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.diagnosis.settings import FREE_FORCES
from zwidth.sim.device import place_label
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.force_ripple import force_ripple
from zwidth.sim.physics.one_sided_spring import one_sided_spring
from zwidth.sim.physics.periodic_force import HARMONICS, periodic_force
from zwidth.sim.physics.power_drag import power_drag

Floats = NDArray[np.float64]
BY_POSITION = (
    "cubic_stiffness@ground",
    "gravity_pendulum@m1",
    "ground_spring@m1",
    "force_ripple@m1",
    "hysteresis@ground",
)
MET = (0.25, 0.05, 0.01)  # initial shares of the samples beyond a stop
TURNS, LOOK = 2, 4  # choices of the noise for a first fit, and rounds of fitting with each
JUDGED = 3  # most likely probes, which are fitted to the end
HOPE = 100.0  # in -2 ln: most by which a first fit may cost more than the named effects
DEPTH = 1e-4  # of the travel: least depth by which a stop must be pressed


@dataclass(frozen=True)
class Probe:
    """A law that is not in the library, in place of some effects of a model (their indices)."""

    gone: tuple[int, ...]
    physics: Physics
    scales: dict[str, float]
    nested: bool  # whether the named effect is a case of the law


def instead_by_law(problem: Problem, final: Fitted) -> Instead | None:
    """Return the most likely law outside the library, if more likely than the named effects.

    A law is returned as not `sure` if it is likelier by less than that, but by three sigma of one
    number.
    """
    probes = [*_powers(problem, final), *_stops(problem, final), *repeating(final)]
    if not probes:
        return None
    rotary = final.model.nominal.rotary
    experiments, price = problem.experiments, float(np.log(problem.observer.told * final.samples))
    near = NEXT_SAMPLE.near(problem.observer.ratio)
    own = alone(final, experiments, near) + price * final.x.size
    least = own - FREE_FORCES.rather
    best: Instead | None = None
    looked: list[tuple[float, Probe, Model, Floats]] = []
    for probe in probes:
        model, x = _exchanged(final, probe)
        with suppress(NoObserver):
            cost, x, _ = fitted_in_turn(experiments, model, x, near, TURNS, LOOK)
            looked.append((cost + price * x.size, probe, model, x))
    likely = sorted((one for one in looked if one[0] < least + HOPE), key=lambda one: one[0])
    for _, probe, model, x in likely[:JUDGED]:
        try:
            there, settled = settle(experiments, model, x, near)
        except NoObserver:
            continue
        paid = there.cost(settled) + price * settled.x.size
        # If the effect is a case of the law, its further unknown needs five sigma, but no penalty.
        weighed = paid - price * (settled.x.size - final.x.size) if probe.nested else paid
        sure = weighed < least
        doubtful = best is None and weighed < own - FREE_FORCES.doubt
        if sure or doubtful:
            gone = [final.model.effects[i] for i in probe.gone]
            name = " and ".join(f"{p.effect.name} at {p.at}" for p in gone)
            law = settled.model.build(settled.x).physics[-1]
            says = _says(law, rotary)
            best = Instead(own - paid, len(probe.scales), law.at, says, name, sure)
            least = min(least, weighed)
    return best


def _says(law: Physics, rotary: bool) -> str:
    unit = "rad" if rotary else "m"
    if law.effect is power_drag:
        return f"the power {law.values['power']:.3g} of velocity"
    if law.effect is periodic_force:
        period = law.values["period"]
        return f"position and repeats every {period:.4g} {unit}, in a shape other than a sine,"
    where = "above" if law.values["side"] > 0.0 else "below"
    return f"position only {where} {law.values['place']:.4g} {unit}, like the force of a stop"


def _powers(problem: Problem, final: Fitted) -> Iterator[Probe]:
    effects = final.model.effects
    device = final.model.build(final.x)
    for drag, named in enumerate(effects):
        if named.effect.name != "quadratic_drag":
            continue
        found = next(p for p in device.physics if place_label(p) == place_label(named))
        speed = sizes_of(device, problem.experiments).speed
        level = max(found.values["coefficient"] * speed**2, np.finfo(float).tiny)
        physics = Physics(power_drag, named.at, {"level": level, "power": 2.0, "speed": speed})
        scales = {"level": level, "power": 0.5}
        yield Probe((drag,), physics, scales, True)
        for other in range(len(effects)):
            if other != drag:
                yield Probe((drag, other), physics, scales, False)


def _stops(problem: Problem, final: Fitted) -> Iterator[Probe]:
    labels = [place_label(p) for p in final.model.effects]
    named = [i for i, label in enumerate(labels) if label in BY_POSITION]
    if not named:
        return
    sets = {(i,) for i in named} | {tuple(named)}
    q = np.concatenate([x[SETTLING:, 0] for x in predicted_states(problem, final)])
    gain = final.model.reads(final.x).gain
    force = sizes_of(final.model.build(final.x), problem.experiments, gain).force
    for gone in sorted(sets):
        for share in MET:
            for side in (-1.0, 1.0):
                place = float(np.quantile(q, share if side < 0.0 else 1.0 - share))
                depth = abs(float(q.min() if side < 0.0 else q.max()) - place)
                if depth > DEPTH * float(np.ptp(q)):  # else the mass only rests at the end
                    values = {"place": place, "stiffness": force / depth, "side": side}
                    scales = {"place": depth, "stiffness": force / depth}
                    yield Probe(gone, Physics(one_sided_spring, "m1", values), scales, False)


def repeating(final: Fitted) -> Iterator[Probe]:
    """Yield starts at each ripple of the answer, as each of the harmonics in turn."""
    built = {place_label(p): p for p in final.model.build(final.x).physics}
    for ripple, named in enumerate(final.model.effects):
        if named.effect is force_ripple:
            yield from _harmonics(final, ripple, built[place_label(named)])


def _harmonics(final: Fitted, ripple: int, found: Physics) -> Iterator[Probe]:
    effects = final.model.effects
    amplitude, period, phase = found.vector()
    rest = [i for i in range(len(effects)) if i != ripple]
    waves = [f"{wave}{k}" for k in range(1, HARMONICS + 1) for wave in ("cosine", "sine")]
    for gone in sorted({(ripple,), *((ripple, i) for i in rest), (ripple, *rest)}):
        for first in range(1, HARMONICS + 1):
            values = {"period": first * period, **dict.fromkeys(waves, 0.0)}
            values[f"cosine{first}"] = amplitude * math.sin(phase)
            values[f"sine{first}"] = amplitude * math.cos(phase)
            scales = {"period": first * final.model.scales[ripple]["period"]}
            scales |= {wave: float(amplitude) for wave in waves}
            yield Probe(gone, Physics(periodic_force, found.at, values), scales, False)


def _exchanged(final: Fitted, probe: Probe) -> tuple[Model, Floats]:
    """Model and start with the law in place of the effects."""
    model, x = final.model.less(final.x, *probe.gone)
    x = model.beside(x, np.zeros(len(probe.scales)))
    return model.with_effect(probe.physics, probe.scales), x
