"""A device as a USD stage for Newton: one body on a joint, and a `NewtonActuator` that drives it.

Attributes are from newton-usd-schemas. An actuator's are in radians, a joint's damping in degrees,
as in USD.
"""

import math

from zwidth.export.actuator import actuator_of, command_in_words
from zwidth.export.model import Exported
from zwidth.sim.device import Device

PER_DEGREE = math.pi / 180.0


def newton(device: Device, name: str) -> Exported:
    """Return a device as the text of a USD stage (USDA)."""
    a = actuator_of(device, rises=False)
    kind = "Revolute" if device.rotary else "Prismatic"
    axis, unit = ("Z", PER_DEGREE) if device.rotary else ("X", 1.0)
    mass, inertia = (1.0, a.mass) if device.rotary else (a.mass, 1.0)
    applied = ["NewtonPDControlAPI"]
    numbers = [f"float newton:kp = {a.stiffness!r}", f"float newton:kd = {a.damping!r}"]
    if math.isfinite(a.limit):
        applied.append("NewtonMaxEffortClampingAPI")
        numbers.append(f"float newton:maxEffort = {a.limit!r}")
    if a.delay_ticks:
        applied.append("NewtonActuatorDelayAPI")
        numbers.append(f"int newton:delaySteps = {a.delay_ticks}")
    schemas = ", ".join(f'"{one}"' for one in applied)
    attributes = "\n        ".join(numbers)
    body = f"""\
def Xform "{name}"
{{
    def Xform "body" (
        prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
    )
    {{
        float physics:mass = {mass!r}
        point3f physics:centerOfMass = (0, 0, 0)
        float3 physics:diagonalInertia = ({inertia!r}, {inertia!r}, {inertia!r})
        quatf physics:principalAxes = (1, 0, 0, 0)
    }}

    def Physics{kind}Joint "m1" (
        prepend apiSchemas = ["PhysicsArticulationRootAPI", "NewtonJointAPI"]
    )
    {{
        rel physics:body1 = </{name}/body>
        uniform token physics:axis = "{axis}"
        float newton:damping = {a.viscous * unit!r}
        float newton:friction = {a.sliding!r}
    }}

    def NewtonActuator "drive" (
        prepend apiSchemas = [{schemas}]
    )
    {{
        rel newton:targets = </{name}/m1>
        {attributes}
    }}
}}

def PhysicsScene "scene"
{{
    float physics:gravityMagnitude = 0
}}
"""
    lost = list(a.lost)
    if a.sliding > 0.0:
        lost.append("dry friction is a soft constraint there, under which a held body creeps")
    if a.delay_ticks:
        lost.append("before the first command there is none: Newton gives that at once")
    about = (
        f"{device.name}, exported by zwidth for Newton.",
        "",
        f"Step the actuators every {a.held.interface.period:.9g} s.",
        command_in_words(a, "Control.joint_act, the feed-forward"),
    )
    opening = '#usda 1.0\n(\n    doc = """'
    closing = (
        f'"""\n    defaultPrim = "{name}"\n    kilogramsPerUnit = 1\n    metersPerUnit = 1\n)\n'
    )
    return Exported(body, about, tuple(lost), a.held, opening, closing)
