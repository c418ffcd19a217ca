"""A device as URDF or SDF: bodies and joints with damping and dry friction.

A joint of URDF has no spring, so a chain becomes one rigid body. A joint of SDF has a spring, so a
chain becomes a row of bodies, in which each joint is the link to the preceding body.
"""

import math
from dataclasses import replace
from xml.sax.saxutils import quoteattr

import numpy as np

from zwidth.export.mechanics import Joints, interface_lost, joints_of
from zwidth.export.model import Exported
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics

FASTEST = 1e6  # URDF requires a velocity limit


def urdf(device: Device, name: str) -> Exported:
    """Return a device as the text of a URDF robot of this name: one body on one joint."""
    joints = joints_of(device)
    for (i, j), (spring, damper) in joints.between.items():
        joints.lost.append(
            f"link m{i + 1}-m{j + 1}: its spring {spring:g} and damper {damper:g} are not"
            " exported, the"
            " masses are one"
        )
    for i in np.flatnonzero(joints.springs).tolist():
        joints.lost.append(
            f"the spring {joints.springs[i]:g} from m{i + 1} to ground is not exported"
        )
    face = _face(joints.device, joints.lost)
    mass, damper = float(joints.masses.sum()), float(joints.dampers.sum())
    friction = float(joints.friction.sum())
    body_alone = make_chain([mass], [damper])
    held = replace(face, chain=body_alone, modal=None, physics=()).with_physics(*_dry(friction))
    kind, axis = ("continuous", "0 0 1") if device.rotary else ("prismatic", "1 0 0")
    span = "" if device.rotary else f'lower="{-FASTEST!r}" upper="{FASTEST!r}" '
    body = f"""\
<robot name={quoteattr(name)}>
  <link name="ground"/>
  <link name="body">
    <inertial>
      <origin xyz="0 0 0"/>
      {_mass(device.rotary, mass, "urdf")}
    </inertial>
  </link>
  <joint name="m1" type="{kind}">
    <parent link="ground"/>
    <child link="body"/>
    <axis xyz="{axis}"/>
    <limit {span}effort="{_effort(held)!r}" velocity="{FASTEST!r}"/>
    <dynamics damping="{damper!r}" friction="{friction!r}"/>
  </joint>
</robot>
"""
    return Exported(body, _about(device), tuple(joints.lost), held)


def sdf(device: Device, name: str) -> Exported:
    """Return a device as the text of an SDF model of this name."""
    joints = joints_of(device)
    n = joints.masses.size
    held = joints.device
    for what, values in (
        ("damper", joints.dampers), ("spring", joints.springs), ("dry friction", joints.friction),
    ):  # fmt: skip
        for i in np.flatnonzero(values[1:]).tolist():
            joints.lost.append(
                f"the {what} {values[i + 1]:g} from m{i + 2} to ground is held at m1 instead: a"
                " body farther on has no joint with the ground"
            )
        values[:] = [values.sum(), *[0.0] * (n - 1)]
    own = held.chain.masses.size
    chain = held.chain._replace(
        ground_dampers=np.array([joints.dampers[0], *[0.0] * (own - 1)]),
        ground_spring=float(joints.springs[0]),
    )
    added = tuple(p for p in held.physics if p.effect.adds_mass)
    face = _face(replace(held, chain=chain, modal=None, physics=added), joints.lost)
    friction = float(joints.friction[0])
    held = face.with_physics(*_dry(friction))
    rotary = device.rotary
    bodies = "\n".join(
        f'    <link name="b{i + 1}">\n      <inertial>\n        '
        + _mass(rotary, float(joints.masses[i]), "sdf") + "\n      </inertial>\n    </link>"
        for i in range(n)
    )  # fmt: skip
    links = "\n".join(
        [_joint(joints, held, -1, 0), *(_joint(joints, held, i, j) for i, j in joints.between)]
    )
    body = f"""\
<sdf version="1.9">
  <model name={quoteattr(name)}>
{bodies}
{links}
  </model>
</sdf>
"""
    return Exported(body, _about(device), tuple(joints.lost), held)


def _about(device: Device) -> tuple[str, ...]:
    unit = "N m" if device.rotary else "N"
    return (
        f"{device.name}, exported by zwidth.",
        "",
        f"The command [{unit}] drives the joint 'm1', held for {device.interface.period:.9g} s each"
        " time. Gravity has no part in it.",
    )


def _mass(rotary: bool, mass: float, to: str) -> str:
    """A body of this mass or, if rotary, of this inertia about its axis and a nominal mass."""
    inertia, weight = (mass, 1.0) if rotary else (1e-3 * mass, mass)
    if to == "urdf":
        same = " ".join(f'{axis}="{inertia!r}"' for axis in ("ixx", "iyy", "izz"))
        return f'<mass value="{weight!r}"/>\n      <inertia {same} ixy="0" ixz="0" iyz="0"/>'
    same = "".join(f"<{axis}>{inertia!r}</{axis}>" for axis in ("ixx", "iyy", "izz"))
    return f"<mass>{weight!r}</mass>\n        <inertia>{same}</inertia>"


def _joint(joints: Joints, held: Device, i: int, j: int) -> str:
    """The joint that carries mass j, on the world or on mass i."""
    kind, axis = ("revolute", "0 0 1") if held.rotary else ("prismatic", "1 0 0")
    if i < 0:
        parent, label, friction = "world", "m1", float(joints.friction[0])
        spring, damper = float(joints.springs[0]), float(joints.dampers[0])
        effort = f"<effort>{_effort(held)!r}</effort>"
    else:
        parent, label, friction, effort = f"b{i + 1}", f"link{i + 1}{j + 1}", 0.0, ""
        spring, damper = joints.between[i, j]
    return f"""\
    <joint name="{label}" type="{kind}">
      <parent>{parent}</parent>
      <child>b{j + 1}</child>
      <axis>
        <xyz>{axis}</xyz>
        <limit><lower>{-FASTEST!r}</lower><upper>{FASTEST!r}</upper>{effort}</limit>
        <dynamics>
          <damping>{damper!r}</damping>
          <friction>{friction!r}</friction>
          <spring_stiffness>{spring!r}</spring_stiffness>
          <spring_reference>0</spring_reference>
        </dynamics>
      </axis>
    </joint>"""


def _face(device: Device, lost: list[str]) -> Device:
    """Return the device with what such a format has of the interface: the limit of an effort."""
    if device.interface.command_gain != 1.0:
        gain = device.interface.command_gain
        lost.append(f"the gain {gain:g} of the command is not exported: multiply commands by it")
        device = device.with_interface(command_gain=1.0)
    return interface_lost(device, False, True, lost)


def _effort(device: Device) -> float:
    limit = device.interface.command_limit
    return limit if math.isfinite(limit) else FASTEST


def _dry(level: float) -> tuple[Physics, ...]:
    return (make_physics("coulomb_friction", "m1", level=level),) if level > 0.0 else ()
