"""The controller of one run of an ensemble: a law of walls with its stiffness and damping."""

from zwidth.controllers.guarded import guarded
from zwidth.controllers.region import region
from zwidth.controllers.texture import texture
from zwidth.controllers.wall import wall
from zwidth.sim.controller import Controller
from zwidth.sim.law import Law


def controller_of(
    law: Law, stiffness: float, damping: float, position: float = 0.0, one_sided: bool = False
) -> Controller:
    """Return the controller of a wall K, B under a law."""
    match law.kind:
        case "texture":
            return texture(stiffness, law.wavelength, damping, position, law.share, one_sided)
        case "region":
            return region(damping, stiffness, position, law.width)
        case "guarded":
            return guarded(stiffness, damping, law.most_damping, position, one_sided)
        case _:
            return wall(stiffness, damping, position, one_sided)
