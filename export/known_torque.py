"""The torque of a robot's other rigid bodies on one joint, by MuJoCo, from recorded positions.

Row j of M(q) q'' + c(q, q') + g(q) = tau is the torque that the arms need at joint j. The device of
that joint has its own inertia, M_jj in the model's zero pose (`zwidth devices --from`), damping and
friction. Everything else acts on it as a force that is computed from positions,

    f = -(row_j - M_jj(0) q_j''),

which contains gravity in the recorded posture, Coriolis and centrifugal forces, the coupled
accelerations of the other joints, and the change of its own inertia in that posture. Velocities and
accelerations are derivatives of a smoothing spline of each joint's positions,

    minimise  sum (q_k - s(t_k))^2 + lambda integral s''^2,

with twice the lambda for which a spline through every other sample predicts the others best (P.
Craven, G. Wahba, Numerische Mathematik 31, 377, 1979).

Limits: arms are rigid, and joints that were not recorded stay in the zero pose. Gravity is computed
in the recorded posture, also for free runs that drift away from it. Accelerations are as accurate
as the splines: for a motion of 1 Hz at 1 kHz within 5 % if the encoder's step is a thousandth of
the amplitude. Accelerations are too small in the first and last hundredth of a recording, where the
curvature of a spline goes to zero. The acceleration of the joint itself also has the error of the
measured position. Springs, dampers and friction of other joints are accounted for by their recorded
motion; tendons between joints are left out.
"""

import os
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import make_smoothing_spline

from zwidth.export.read_joint import joint_of
from zwidth.logs.recording_file import KNOWN_FORCE, joint_channel
from zwidth.sim.device import Device
from zwidth.sim.nearest import nearest
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
FEWEST = 5  # least number of samples of a spline
CHOSEN_BY = 4000  # most samples from which lambda is chosen
STRENGTHS = tuple(10.0**k for k in np.arange(-4.0, 10.1, 0.5).tolist())  # with time in samples


class KnownTorque(NamedTuple):
    """torque [N m | N] (samples,) on the joint; said: what it includes and leaves out."""

    torque: Floats
    said: str


def with_known_torque(
    trace: Trace, device: Device, path: str | os.PathLike[str], joint: str
) -> tuple[Trace, str]:
    """Return the recording with the robot's torque added as a known force, and a sentence on it.

    The torque is that of the rest of the robot. It acts on the last mass of the device, which is
    the arm, in addition to known forces of the recording. The joint's position is the recorded one
    of this mass, else of m1.

    Raises ValueError as `known_torque`, and if no position of the joint was recorded.
    """
    last = device.chain.masses.size
    places = [c for c in (f"position_m{last}", "position_m1", joint_channel(joint))
              if c in trace.channels]  # fmt: skip
    if not places:
        raise ValueError(
            f"the recording has no position of m1 and none of a [[joint]] {joint!r}"
            f" ({', '.join(trace.channels)}); a posture needs one"
        )
    found = known_torque(trace, path, joint, places[0])
    channel = f"{KNOWN_FORCE}m{last}"
    before = trace[channel] if channel in trace.channels else 0.0
    channels = {**trace.channels, channel: before + found.torque}
    units = {**trace.units, channel: "N m" if device.rotary else "N"}
    return Trace(trace.t, channels, units, trace.origin, trace.facts), found.said


def known_torque(
    trace: Trace, path: str | os.PathLike[str], joint: str, position: str
) -> KnownTorque:
    """Return the torque on a joint of an MJCF or URDF model in the postures of a recording.

    position: the channel of the joint itself; the channels of other joints are joint_NAME.

    Raises ValueError for a file that is not a model, a joint that is missing or not a slide or
    hinge, a [[joint]] of the recording that the model does not have, and without MuJoCo.
    """
    mujoco, model, index = joint_of(path, joint)
    names = [model.joint(i).name for i in range(model.njnt)]
    channels = {joint_channel(n): n for n in names if n}
    asked = [c for c in trace.channels if c.startswith("joint_")]
    for channel in asked:
        if channel not in channels:
            said = channel.removeprefix("joint_")
            raise ValueError(
                f"the recording has a joint {said!r}, which {Path(path).name} does not;"
                f" {nearest(said, [n for n in names if n])}"
            )
    moved = {names.index(channels[c]): c for c in asked} | {index: position}
    for i in moved:
        joint_of(path, names[i])  # raises for a ball joint
    motions = {i: smooth_motion(trace.t, trace[c]) for i, c in moved.items()}
    torque = _inverse(mujoco, model, index, motions)
    others = [names[i] for i in moved if i != index]
    still = [n or f"number {i}" for i, n in enumerate(names) if i not in moved]
    said = f"the rest of {Path(path).name} acts on {joint!r} as a known force: gravity"
    said += f" and the motion of {', '.join(others)}" if others else ""
    said += f"; held in the zero pose, since not recorded: {', '.join(still)}" if still else ""
    return KnownTorque(torque, said)


def smooth_motion(t: Floats, position: Floats) -> tuple[Floats, Floats, Floats]:
    """Return position, velocity and acceleration (samples,) of a smoothing spline.

    Samples that are not finite, or whose stamps do not rise, are left out of the fit and
    interpolated by the spline. Raises ValueError for fewer than five samples.
    """
    rising = np.concatenate(([True], np.diff(np.maximum.accumulate(t)) > 0.0))
    kept = rising & np.isfinite(position)
    if int(kept.sum()) < FEWEST:
        raise ValueError(f"a position has {int(kept.sum())} finite samples; {FEWEST} are needed")
    if np.ptp(position[kept]) == 0.0:
        still = np.zeros(t.size)
        return np.full(t.size, position[kept][0]), still, still
    unit = float(np.median(np.diff(t[kept])))  # unit of time, so that sums are of order one
    spline = make_smoothing_spline(
        t[kept] / unit, position[kept], lam=smoothness(t[kept] / unit, position[kept])
    )
    first = spline.derivative()
    at = t / unit
    return spline(at), first(at) / unit, first.derivative()(at) / unit**2


def smoothness(t: Floats, position: Floats) -> float:
    """Return lambda of the spline, for times in samples, from the middle of the recording."""
    middle = slice(max(0, t.size // 2 - CHOSEN_BY // 2), t.size // 2 + CHOSEN_BY // 2)
    t, position = t[middle], position[middle]
    if t.size < 4 * FEWEST:
        return 0.0

    def wrong(strength: float) -> float:
        spline = make_smoothing_spline(t[::2], position[::2], lam=strength)
        off = position[1:-1:2] - spline(t[1:-1:2])
        return float(off @ off)

    return 2.0 * min(STRENGTHS, key=wrong)


def _inverse(
    mujoco: Any, model: Any, index: int, motions: dict[int, tuple[Floats, Floats, Floats]]
) -> Floats:
    """Return f (samples,). `mj_rne` has no armature, which the device's own inertia does."""
    dof = int(model.jnt_dofadr[index])
    own = float(model.dof_M0[dof] - model.dof_armature[dof])
    data = mujoco.MjData(model)
    data.qpos[:] = model.qpos0
    row = np.empty(model.nv)
    at = [(int(model.jnt_qposadr[i]), int(model.jnt_dofadr[i]), m) for i, m in motions.items()]
    found = np.empty(motions[index][0].size)
    for k in range(found.size):
        for place, speed, (q, v, a) in at:
            data.qpos[place], data.qvel[speed], data.qacc[speed] = q[k], v[k], a[k]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        mujoco.mj_rne(model, data, 1, row)
        found[k] = own * data.qacc[dof] - row[dof]
    return found
