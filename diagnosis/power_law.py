"""Whether what was named quadratic drag is drag by another power.

A drag that carries much of the motion turns it over, and a force added to the recording does not
follow it there (`diagnosis.unknown`). So the drag, and the drag with any one other effect, is
exchanged for one whose power is free, fitted by simulation to its end, observer and all. Likelier
by `CLEARLY` it is a force of no library: a cube passes for a square and some friction. Where
another effect goes with it, the unknowns are paid for.
"""

from collections.abc import Iterator

import numpy as np

from diagnosis.candidates import magnitudes
from diagnosis.fit import Fitted, Problem
from diagnosis.parameters import Model
from diagnosis.settle import settle
from diagnosis.unknown import CLEARLY, Instead, alone
from sim.device import place_label
from sim.physics.effect import Physics
from sim.physics.power_drag import power_drag

DRAG = "quadratic_drag"


def by_power(problem: Problem, final: Fitted) -> Instead | None:
    """Return the drag by another power that is likelier than a quadratic one that was found."""
    experiments = problem.experiments
    price = float(np.log(final.samples))
    least = alone(final, experiments) + price * final.x.size - CLEARLY
    best: Instead | None = None
    for drag, others in _exchanged(final):
        model, x = _with_power(problem, final, drag, others)
        try:
            there, settled = settle(experiments, model, x)
        except ValueError:  # no observer follows the recording with it
            continue
        # By the same drag with its power free, five sigma of that one unknown are enough.
        unknowns = settled.x.size if others else final.x.size
        paid = there.cost(settled) + price * unknowns
        if paid < least:
            power = settled.model.build(settled.x).physics[-1].values["power"]
            gone = [final.model.effects[i] for i in (drag, *others)]
            name = " and ".join(f"{p.effect.name} at {p.at}" for p in gone)
            follows = f"the power {power:.3g} of velocity"
            at = final.model.effects[drag].at
            best, least = Instead(least + CLEARLY - paid, 2, at, follows, name), paid
    return best


def _exchanged(final: Fitted) -> Iterator[tuple[int, tuple[int, ...]]]:
    """Each quadratic drag alone, and with any one other effect: their places in the model."""
    effects = final.model.effects
    for drag, physics in enumerate(effects):
        if physics.effect.name == DRAG:
            yield drag, ()
            yield from ((drag, (other,)) for other in range(len(effects)) if other != drag)


def _with_power(
    problem: Problem, final: Fitted, drag: int, others: tuple[int, ...]
) -> tuple[Model, np.ndarray]:
    """Model and start: the square at the strength found, its power free, less some effects."""
    effects = final.model.effects
    gone = {place_label(effects[i]) for i in (drag, *others)}
    keep = [p.name.split(".")[0] not in gone for p in final.model.parameters]
    model = final.model
    for i in sorted((drag, *others), reverse=True):
        model = model.without_effect(i)
    device = final.model.build(final.x)
    found = next(p for p in device.physics if place_label(p) == place_label(effects[drag]))
    speed = magnitudes(device, problem.experiments).speed
    level = max(found.values["coefficient"] * speed**2, np.finfo(float).tiny)
    physics = Physics(power_drag, found.at, {"level": level, "power": 2.0, "speed": speed})
    model = model.with_effect(physics, {"level": level, "power": 0.5})
    return model, np.concatenate([final.x[np.array(keep)], np.zeros(2)])
