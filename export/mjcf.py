"""A device as MJCF, MuJoCo's format: slides or hinges, links as tendons, an actuator as drive.

A device limits its command after the gain, so the limit is written as a range of the force. Without
dry friction MuJoCo integrates by the fourth-order Runge-Kutta method. With dry friction, which is a
soft constraint there, it integrates implicitly; step and impedance are chosen so that a body held
by friction creeps by a ten-thousandth. Friction with a curve or with bristles and a ripple of the
force are passive actuators (`zwidth.export.dcmotor`), with the same implicit steps for friction.

If a device states the damping D of its winding (`open_winding`), the drive is a `dcmotor`. With the
gain G from volts to force, referred to the joint (gear 1), its force K (u - K v) / R is G u - D v
for

    K = D / G,    R = K / G,    inductance = lag R.

The inductance delays the back-EMF too, which in the device is a damper without lag.
"""

import math
from xml.sax.saxutils import quoteattr

import numpy as np

from zwidth.export.dcmotor import BRISTLES, PASSIVE, TURN, passive_motor, softened
from zwidth.export.mechanics import Joints, interface_lost, joints_of
from zwidth.export.model import Exported
from zwidth.sim.device import Device
from zwidth.sim.physics.effect import Physics

ALSO = (
    "constant_force", "cubic_stiffness", "quadratic_drag", "gravity_pendulum", "backlash",
    "actuator_lag", "open_winding",
)  # fmt: skip
GRAVITY = 9.81
DRY_STEP, STEP, OF_A_RADIAN = 2e-5, 1e-4, 0.1  # [s], [s]; phase of the fastest mode per step


def mjcf(device: Device, name: str) -> Exported:
    """Return a device as the text of an MJCF model of this name."""
    joints = joints_of(device, ALSO, PASSIVE)
    lost = joints.lost
    held = interface_lost(joints.device, True, True, lost)
    gaps = {p.place.index: p.values["gap"] for p in joints.others if p.effect.name == "backlash"}
    for i in gaps:
        if joints.between[i, i + 1][1] != 0.0:
            lost.append(
                f"backlash@link{i + 1}{i + 2}: the spring has the gap, the damper of"
                f" {joints.between[i, i + 1][1]:g} beside it acts inside the gap too"
            )
    if any(p.effect.name == "open_winding" for p in joints.others):
        lost.append(
            "open_winding@m1: the winding brakes while the drive is off (ctrl 0); nothing opens it"
        )
    if _winding(joints) > 0.0 and _lag(joints) > 0.0:
        lost.append("actuator_lag@command: the inductance of a dcmotor lets its back-EMF lag, too")
    period = device.interface.period
    step = _step(joints, held, period)
    length = "rad" if device.rotary else "m"
    lost += [said for p in _passive(joints, BRISTLES)
             if (said := softened(p, _mass(joints, p), step, length))]  # fmt: skip
    unit = "V" if _winding(joints) > 0.0 else "N m" if device.rotary else "N"
    needs: tuple[str, ...] = ()
    if _passive(joints):
        needs = ("It has a dcmotor without inputs, for which MuJoCo must be 3.12 or later.",)
    elif unit == "V":
        needs = ("It has a dcmotor, for which MuJoCo must be 3.7 or later.",)
    about = (
        f"{device.name}, exported by zwidth.",
        "",
        f"Set ctrl of the actuator 'drive' [{unit}] every {period:.9g} s, which are"
        f" {round(period / step)} steps, and hold it; the joint 'm1' is what the encoder reads.",
        *needs,
    )
    return Exported(_model(joints, held, name, step, gaps), about, tuple(lost), held)


def _step(joints: Joints, held: Device, period: float) -> float:
    """Return a timestep that divides the period and resolves the fastest mode."""
    fastest = float(np.abs(np.linalg.eigvals(held.plant().a)).max())
    for p in _passive(joints, ("force_ripple",)):  # stiffness at the bottom of a wave
        slope = p.values["amplitude"] * TURN / p.values["period"]
        fastest = max(fastest, math.sqrt(slope / _mass(joints, p)))
    longest = DRY_STEP if _dry(joints) else STEP
    if fastest > 0.0:
        longest = min(longest, OF_A_RADIAN / fastest)
    return period / math.ceil(period / longest)


def _model(joints: Joints, held: Device, name: str, step: float, gaps: dict[int, float]) -> str:
    integrator = "implicitfast" if _dry(joints) else "RK4"
    bodies = "\n".join(_body(joints, held, i, step) for i in range(joints.masses.size))
    links = "\n".join(_link(joints, i, j, gaps) for i, j in joints.between)
    tendons = f"  <tendon>\n{links}\n  </tendon>\n" if links else ""
    return f"""\
<mujoco model={quoteattr(name)}>
  <compiler angle="radian" autolimits="true"/>
  <option timestep="{step!r}" integrator="{integrator}" gravity="0 {-GRAVITY} 0" tolerance="1e-14"
    iterations="200">
    <flag contact="disable"/>
  </option>
  <worldbody>
{bodies}
  </worldbody>
{tendons}  <actuator>
{_actuators(joints, held, step)}
  </actuator>
  <sensor>
    <jointpos name="encoder" joint="m1"/>
  </sensor>
</mujoco>
"""


def _body(joints: Joints, held: Device, i: int, step: float) -> str:
    kind, axis = ("hinge", "0 0 1") if held.rotary else ("slide", "1 0 0")
    mass = float(joints.masses[i])
    cubic = quadratic = 0.0
    inertial = f'pos="0 0 0" mass="1" diaginertia="{mass!r} {mass!r} {mass!r}"'
    if not held.rotary:
        inertial = f'pos="0 0 0" mass="{mass!r}" diaginertia="1 1 1"'
    for p in joints.others:
        if p.place.index != i or p.place.kind == "link":
            continue
        if p.effect.name == "cubic_stiffness":
            cubic = p.values["coefficient"]
        elif p.effect.name == "quadratic_drag":
            quadratic = p.values["coefficient"]
        elif p.effect.name == "gravity_pendulum":
            inertial = _pendulum(mass, p.values["level"], p.values["angle"])
    damper = float(joints.dampers[i]) - (_winding(joints) if i == 0 else 0.0)
    friction = ""
    if joints.friction[i] > 0.0:
        friction = (
            f' frictionloss="{float(joints.friction[i])!r}" solreffriction="{2.0 * step!r} 1"'
            ' solimpfriction="0.9999 0.9999 0.001"'
        )
    return (
        f'    <body name="b{i + 1}">\n'
        f'      <joint name="m{i + 1}" type="{kind}" axis="{axis}"'
        f' damping="{damper!r} {quadratic!r} 0"'
        f' stiffness="{float(joints.springs[i])!r} 0 {cubic!r}"{friction}/>\n'
        f"      <inertial {inertial}/>\n    </body>"
    )


def _pendulum(inertia: float, level: float, angle: float) -> str:
    """An eccentric mass with m g l = level and m l^2 a quarter of the inertia about the axis.

    It hangs at rest where the law is zero.
    """
    if level == 0.0:
        return f'pos="0 0 0" mass="1" diaginertia="{inertia!r} {inertia!r} {inertia!r}"'
    arm = 0.25 * inertia * GRAVITY / level
    mass = level / (GRAVITY * arm)
    own = 0.75 * inertia
    x, y = arm * math.sin(angle), -arm * math.cos(angle)
    return f'pos="{x!r} {y!r} 0" mass="{mass!r}" diaginertia="{own!r} {own!r} {own!r}"'


def _link(joints: Joints, i: int, j: int, gaps: dict[int, float]) -> str:
    spring, damper = joints.between[i, j]
    cubic = sum(
        p.values["coefficient"] for p in joints.others
        if p.effect.name == "cubic_stiffness" and p.place.kind == "link" and j == i + 1
        and p.place.index == i
    )  # fmt: skip
    half = 0.5 * gaps.get(i, 0.0) if j == i + 1 else 0.0
    length = f"{-half!r} {half!r}" if half > 0.0 else "0"
    return (
        f'    <fixed name="link{i + 1}{j + 1}" stiffness="{spring!r} 0 {float(cubic)!r}"'
        f' damping="{damper!r}" springlength="{length}">\n'
        f'      <joint joint="m{i + 1}" coef="1"/>\n      <joint joint="m{j + 1}" coef="-1"/>\n'
        "    </fixed>"
    )


def _passive(joints: Joints, names: tuple[str, ...] = PASSIVE) -> list[Physics]:
    return [p for p in joints.others if p.effect.name in names]


def _mass(joints: Joints, p: Physics) -> float:
    return float(joints.masses[p.place.index])


def _dry(joints: Joints) -> bool:
    return bool(joints.friction.any() or _passive(joints, BRISTLES))


def _lag(joints: Joints) -> float:
    return next((p.values["time_constant"] for p in joints.others
                 if p.effect.name == "actuator_lag"), 0.0)  # fmt: skip


def _winding(joints: Joints) -> float:
    """Return the winding's part of the damping of m1, 0 if it is unknown or m1 has less."""
    told = (p.values["damping"] for p in joints.others if p.effect.name == "open_winding")
    damping = next(told, 0.0)
    return damping if 0.0 < damping <= float(joints.dampers[0]) else 0.0


def _actuators(joints: Joints, held: Device, step: float) -> str:
    face = held.interface
    gain, limit = face.command_gain, face.command_limit
    lag, winding = _lag(joints), _winding(joints)
    drive = f'    <general name="drive" joint="m1" gainprm="{gain!r}"'
    if winding > 0.0:
        constant = winding / gain
        drive = f'    <dcmotor name="drive" joint="m1" motorconst="{constant!r}"'
        drive += f' resistance="{constant / gain!r}"'
        drive += f' inductance="{lag * constant / gain!r}"' if lag > 0.0 else ""
        drive += f' ctrlrange="{-limit / gain!r} {limit / gain!r}"' if math.isfinite(limit) else ""
    elif lag > 0.0:  # the limit acts before the lag, so it limits the command
        drive += f' dyntype="filterexact" dynprm="{lag!r}"'
        drive += f' ctrlrange="{-limit / gain!r} {limit / gain!r}"' if math.isfinite(limit) else ""
    elif math.isfinite(limit):
        drive += f' forcerange="{-limit!r} {limit!r}"'
    if face.delay > 0.0:
        samples = math.ceil(face.delay / step) + 2
        drive += f' delay="{face.delay!r}" nsample="{samples}" interp="zoh"'
    lines = [drive + "/>"]
    lines += [
        f'    <general name="constant_m{p.place.index + 1}" joint="m{p.place.index + 1}"'
        f' gainprm="0" biastype="affine" biasprm="{p.values["level"]!r} 0 0"/>'
        for p in joints.others
        if p.effect.name == "constant_force"
    ]
    lines += [passive_motor(p, _mass(joints, p), step) for p in _passive(joints)]
    return "\n".join(line for line in lines if line)
