"""Effects to conceal, sized by the motion they meet; what no magnitude tells is drawn."""

import math
from dataclasses import dataclass

import numpy as np

from zwidth.scenarios.concealed.rig import Made
from zwidth.sim.device import Device, known
from zwidth.sim.physics import EFFECTS
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.sizes import Sizes
from zwidth.sim.place import place_at


@dataclass(frozen=True)
class Motion:
    """How a recording moves.

    rms force and largest command; of m1 rms speed, rms position, span and farthest position; rms
    stretch of each link.
    """

    force: float
    peak: float
    speed: float
    position: float
    span: float
    farthest: float
    stretch: tuple[float, ...]

    def sizes(self, device: Device) -> Sizes:
        """Return what an effect is sized by: every mass moves about as m1 does."""
        chain, n = device.chain, device.chain.masses.size
        return Sizes(
            rotary=device.rotary, period=device.interface.period, force=self.force, peak=self.peak,
            speed=self.speed, position=self.position, span=self.span,
            masses=tuple(chain.masses.tolist()), speeds=n * (self.speed,),
            positions=n * (self.position,), spans=n * (self.span,), fastest=n * (math.inf,),
            springs=tuple(chain.link_springs.tolist()), stretches=self.stretch,
            step=device.interface.encoder_step,
        )  # fmt: skip


def motion_of(made: Made, device: Device) -> Motion:
    """Return the sizes of a recording's motion."""
    n = device.chain.masses.size
    q, v = made.states[:, 0], made.states[:, n]
    command = made.trace["command"]
    links = made.states[:, : n - 1] - made.states[:, 1:n]
    return Motion(
        _rms(command), float(np.abs(command).max()),
        _rms(v), _rms(q - q.mean()), float(np.ptp(q)), float(np.abs(q).max()),
        tuple(_rms(links[:, i]) for i in range(n - 1)),
    )  # fmt: skip


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def places(device: Device) -> list[tuple[str, str]]:
    """Return every (effect, place) that can be concealed in a device.

    A spring to ground makes a constant force a shift of the recording's origin and a further spring
    to ground a mistaken one: neither is missing physics there. A known step or limit leaves none to
    find. Velocities alone are not filtered: few recordings have positions beside them.
    """
    return [
        (effect.name, str(place))
        for effect in EFFECTS.values()
        if device.rotary or not effect.rotary_only
        for place in map(place_at, effect.places)
        if place.kind != "velocity" and place.masses_needed <= device.chain.masses.size
        if not known(effect, place, device)
    ]


def draw_physics(
    random: np.random.Generator, name: str, at: str, device: Device, motion: Motion
) -> Physics:
    """Return an effect of about one percent of the motion, its other numbers drawn."""
    effect = EFFECTS[name]
    values = effect.drawn(random, motion.sizes(device), place_at(at))
    # A link that hardly moves asks for more than a device file may say; its size is sought anyway.
    within = {p.name: min(max(values[p.name], p.lower), p.upper) for p in effect.parameters}
    return Physics(effect, at, within)
