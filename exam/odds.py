"""Which effects a machine of full size may have, how often each comes, and how large it is.

The effect itself (`Effect.odds`, `at_share`, `excludes`) states how often it occurs on small
drives, how large it is, and with which effects it does not occur. Sizes are a share of what drives
the machine: forces of the rms command, a limit of the largest one, free play of the rms travel, a
mass of all masses.
"""

from collections.abc import Collection

import numpy as np

from zwidth.diagnosis.seeking.magnitude import strengthened, within_bounds
from zwidth.scenarios.concealed.shapes import Motion, draw_physics, places
from zwidth.sim.device import Device, has_room
from zwidth.sim.physics import EFFECTS, contains
from zwidth.sim.physics.effect import Physics
from zwidth.sim.place import place_at

SHARES = (0.03, 0.3)
DRAWN_AT = 0.01  # the share at which `draw_physics` draws


def choose(
    random: np.random.Generator, device: Device, taken: list[tuple[str, str]],
    among: Collection[str] = tuple(EFFECTS),
) -> tuple[str, str] | None:  # fmt: skip
    """Return one of these effects and a place compatible with those chosen already, or None."""
    possible: dict[str, list[str]] = {}
    masses = device.chain.masses.size + sum(EFFECTS[name].adds_mass for name, _ in taken)
    for name, at in places(device):
        if name not in among or not EFFECTS[name].odds or not has_room(EFFECTS[name], masses):
            continue
        if not any(clash((name, at), other) for other in taken):
            possible.setdefault(name, []).append(at)
    if not possible:
        return None
    weights = np.array([EFFECTS[name].odds for name in possible])
    name = str(random.choice(list(possible), p=weights / weights.sum()))
    return name, str(random.choice(possible[name]))


def clash(one: tuple[str, str], other: tuple[str, str]) -> bool:
    """Whether two effects, each (name, place), exclude each other.

    At one place two laws of one family, or a law and what it contains, are one and the same thing.
    """
    (name, at), (beside, there) = one, other
    effect, second = EFFECTS[name], EFFECTS[beside]
    if one == other or name in second.excludes or beside in effect.excludes:
        return True
    if at == there and effect.family and effect.family == second.family:
        return True
    first, second_place = place_at(at), place_at(there)
    return contains(name, first, beside, second_place) or contains(
        beside, second_place, name, first
    )


def sized(
    random: np.random.Generator, name: str, at: str, device: Device, motion: Motion, share: float
) -> Physics | None:
    """Return an effect at a share of the motion; None if it cannot be so large."""
    effect = EFFECTS[name]
    if effect.at_share is None:
        return strengthened(draw_physics(random, name, at, device, motion), share / DRAWN_AT)
    values = effect.at_share(random, motion.sizes(device), place_at(at), share)
    return Physics(effect, at, values) if within_bounds(effect, values) else None
