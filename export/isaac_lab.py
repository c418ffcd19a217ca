"""A device as an actuator of Isaac Lab, in the Python of its robot configurations.

`DelayedPDActuatorCfg` has a loop on the position, a limit of the effort and a delay in physics
steps; inertia and friction of the joint are PhysX properties. Names are as in Isaac Lab 2.3 and
3.0.
"""

import math

from zwidth.export.actuator import actuator_of, command_in_words
from zwidth.export.model import Exported
from zwidth.sim.device import Device


def isaac_lab(device: Device, name: str) -> Exported:
    """Return a device as a Python module with one configuration, NAME_CFG."""
    a = actuator_of(device, rises=True)
    limit = f"\n    effort_limit={a.limit!r}," if math.isfinite(a.limit) else ""
    body = f"""\
from isaaclab.actuators import DelayedPDActuatorCfg

PHYSICS_DT = {a.held.interface.period!r}  # [s], of which the delay is a multiple

{name.upper()}_CFG = DelayedPDActuatorCfg(
    joint_names_expr=["m1"],{limit}
    stiffness={a.stiffness!r},
    damping={a.damping!r},
    armature={a.mass!r},
    friction={a.at_rest!r},
    dynamic_friction={a.sliding!r},
    viscous_friction={a.viscous!r},
    min_delay={a.delay_ticks},
    max_delay={a.delay_ticks},
)
"""
    about = (
        f"{device.name}, exported by zwidth for Isaac Lab.",
        "",
        "Put it into `actuators` of an ArticulationCfg, with the names of its joints, and simulate"
        f" with a dt of {a.held.interface.period:.9g} s.",
        command_in_words(a, "the effort target"),
        "armature is all inertia that the device has: take off what the robot's links have.",
    )
    return Exported(body, about, a.lost, a.held, '"""', '"""\n')
