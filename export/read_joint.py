"""A joint of an MJCF or URDF model as a device: it moves all bodies beyond it, in zero pose."""

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from zwidth.export.dcmotor import effects_of_motor, further
from zwidth.export.model_size import ModelTooLarge, Sizes
from zwidth.export.mujoco_run import engine
from zwidth.files.protection import reading
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.drive import Drive
from zwidth.sim.interface import Interface
from zwidth.sim.nearest import nearest
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics


def device_of_joint(
    path: str | os.PathLike[str], joint: str, period: float = 0.001
) -> tuple[Device, list[str]]:
    """Return a joint of a model as a device of one mass, and sentences on what that leaves out.

    The mass is the inertia, about or along the joint, of all bodies that it moves, including the
    armature, with every other joint fixed in the model's zero pose. period [s]: of the sampled
    interface, which a model does not have.

    Raises ValueError for a file that is not a model, a joint that is missing or not a slide or
    hinge, and without MuJoCo, which reads both formats.
    """
    mujoco, model, index = joint_of(path, joint)
    file = Path(path)
    kind = int(model.jnt_type[index])
    rotary = kind == int(mujoco.mjtJoint.mjJNT_HINGE)
    dof = int(model.jnt_dofadr[index])
    address = int(model.jnt_qposadr[index])
    chain = make_chain(
        [float(model.dof_M0[dof])], [float(model.dof_damping[dof])],
        float(np.ravel(model.jnt_stiffness[index])[0]),
    )  # fmt: skip
    left_out: list[str] = []
    actuator = _actuator(mujoco, model, index, period, left_out)
    face = actuator.face
    chain.ground_dampers[0] += actuator.damper
    origin = float(model.qpos_spring[address]) if chain.ground_spring > 0.0 else 0.0
    beside, damper = _beside_the_drive(mujoco, model, index, origin, left_out)
    chain.ground_dampers[0] += damper
    device = Device(
        f"{joint} of {file.name}", str(file), rotary, chain,
        replace(face, position_origin=origin),
    ).with_physics(*_effects(model, index, dof, left_out), *beside)  # fmt: skip
    try:
        _remarks(mujoco, model, index, dof, left_out)
    except (RuntimeError, mujoco.FatalError) as error:
        raise ValueError(f"{file} is a model that MuJoCo cannot run: {_first(error)}") from None
    return (device if actuator.drive is None else actuator.drive.on(device)), left_out


def joint_of(path: str | os.PathLike[str], joint: str) -> tuple[Any, Any, int]:
    """Return MuJoCo, the model of a file, and the number of a hinge or slide in it.

    Raises ValueError as `device_of_joint`.
    """
    mujoco = engine()
    if mujoco is None:
        raise ValueError("reading a model needs MuJoCo, which is not installed; pip install mujoco")
    file = Path(path)
    if not file.is_file():
        raise ValueError(
            f"model is {str(file)!r}, which is not a file; give the MJCF or URDF file of the robot"
        )
    try:
        model = _model(mujoco, file)
    except ModelTooLarge:
        raise
    except MemoryError:
        raise ValueError(
            f"{file} takes MuJoCo more memory than there is; take out what the joint does not need"
        ) from None
    except (ValueError, RuntimeError, OSError, ElementTree.ParseError) as error:
        raise ValueError(f"{file} is not a model that MuJoCo can read: {_first(error)}") from None
    names = [model.joint(i).name for i in range(model.njnt)]
    if joint not in names:
        raise ValueError(f"{file} has no joint {joint!r}; {nearest(joint, names)}")
    index = names.index(joint)
    kind = int(model.jnt_type[index])
    if kind not in (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)):
        raise ValueError(
            f"joint {joint!r} of {file} is a ball or free joint; give a hinge or a slide"
        )
    return mujoco, model, index


def _first(error: Exception) -> str:
    """Return the first line of what MuJoCo says."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0]


def _model(mujoco: Any, file: Path) -> Any:
    root = _parsed(file)
    if root.tag != "robot":
        Sizes(file, *_check_included(root, file)).refuse()
        try:
            return mujoco.MjModel.from_xml_path(str(file))
        except ValueError:
            bare = _without_shapes(root, file)
            if bare is None:
                raise
            text = ElementTree.tostring(root, encoding="unicode")
            return mujoco.MjModel.from_xml_string(text, bare)
    for link in root.iter("link"):  # shapes are separate files, and do not affect the motion
        for shape in (*link.findall("visual"), *link.findall("collision")):
            link.remove(shape)
    Sizes(file, {file.resolve(): root}, {file.parent}).refuse()
    return mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))


def _parsed(file: Path) -> ElementTree.Element:
    text = reading(file).read_text(encoding="utf-8")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:  # entities may expand to gigabytes
        raise ValueError(
            f"{file.name} declares a DOCTYPE or entities, which no model needs; take them out"
        )
    return ElementTree.fromstring(text)


def _check_included(
    root: ElementTree.Element, file: Path
) -> tuple[dict[Path, ElementTree.Element], set[Path]]:
    """Return the model and those that it includes or attaches, and the folders of its files.

    MuJoCo looks for files from the folders of these models, and from those that a compiler element
    names. Raises ValueError if a file that it would open is a pipe, a device or a folder.
    """
    folders, names, models = {file.parent}, set[str](), set[str]()
    roots, waiting = {file.resolve(): root}, [root]
    while waiting:
        for part in waiting.pop().iter():
            if part.tag == "compiler":
                named = (part.get(key) for key in ("meshdir", "texturedir", "assetdir"))
                folders |= {file.parent / folder for folder in named if folder}
            names |= {name for key, name in part.attrib.items() if key.startswith("file")}
            if part.tag in ("include", "model") and (name := part.get("file")) is not None:
                models.add(name)
        found = {(folder / name).resolve() for folder in folders for name in models} - roots.keys()
        for path in filter(Path.is_file, found):
            roots[path] = _parsed(path)
            folders.add(path.parent)
            waiting.append(roots[path])
    for name in sorted(names):
        if any((folder / name).exists() and not (folder / name).is_file() for folder in folders):
            raise ValueError(f"{name!r} is not an ordinary file; put one in its place")
    return roots, folders


def _without_shapes(root: ElementTree.Element, file: Path) -> dict[str, bytes] | None:
    """Remove missing meshes from an MJCF model if inertias do not depend on them.

    Returns the files of the meshes that exist and stay; None if no mesh can be removed.
    """
    compiler = root.find("compiler")
    own = {} if compiler is None else compiler.attrib
    if own.get("inertiafromgeom", "auto") == "true":
        return None
    folder = file.parent / own.get("meshdir", own.get("assetdir", ""))
    missing: set[str] = set()
    kept: dict[str, bytes] = {}
    for asset in root.iter("asset"):
        for mesh in asset.findall("mesh"):
            named = mesh.get("file")
            if named is None:
                continue
            if (folder / named).is_file():
                kept[named] = reading(folder / named).read_bytes()
            else:
                missing.add(mesh.get("name", Path(named).stem))
                asset.remove(mesh)
    if not missing:
        return None
    for body in root.iter("body"):
        for geom in body.findall("geom"):
            if geom.get("mesh") not in missing:
                continue
            if body.find("inertial") is None and geom.get("mass") != "0":
                return None
            body.remove(geom)
    for world in root.iter("worldbody"):
        for geom in [g for g in world.findall("geom") if g.get("mesh") in missing]:
            world.remove(geom)
    return kept


def _effects(model: Any, index: int, dof: int, left_out: list[str]) -> list[Physics]:
    found: list[Physics] = []
    level = float(model.dof_frictionloss[dof])
    if level > 0.0:
        found.append(make_physics("coulomb_friction", "m1", level=level))
    for field, at, name, place in (
        ("jnt_stiffnesspoly", index, "cubic_stiffness", "ground"),
        ("dof_dampingpoly", dof, "quadratic_drag", "m1"),
    ):
        first, second = np.ravel(getattr(model, field, np.zeros((model.nv, 2)))[at])[:2].tolist()
        own, other = (second, first) if name == "cubic_stiffness" else (first, second)
        if own > 0.0:
            found.append(make_physics(name, place, coefficient=own))
        if other != 0.0 or own < 0.0:
            left_out.append(f"a further term of {field} ({first:g}, {second:g})")
    return found


def drives_of(mujoco: Any, model: Any, index: int) -> list[int]:
    """Return the actuators of a joint that its command reaches: all but those without an input."""
    return [i for i in _actuators(mujoco, model, index) if _driven(mujoco, model, i)]


def input_of(model: Any, i: int) -> int:
    """Return the index of an actuator's first input among the controls."""
    inputs = getattr(model, "actuator_ctrladr", None)  # in an older MuJoCo each actuator has one
    return i if inputs is None else int(inputs[i])


def _actuators(mujoco: Any, model: Any, index: int) -> list[int]:
    joints = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
    return [
        i for i, kind in enumerate(model.actuator_trntype.tolist())
        if kind in joints and int(model.actuator_trnid[i, 0]) == index
    ]  # fmt: skip


def _driven(mujoco: Any, model: Any, i: int) -> bool:
    inputs = getattr(model, "actuator_ctrlnum", None)
    if inputs is not None and inputs[i] == 0:
        return False
    fixed = int(model.actuator_gaintype[i]) == int(mujoco.mjtGain.mjGAIN_FIXED)
    affine = int(model.actuator_biastype[i]) == int(mujoco.mjtBias.mjBIAS_AFFINE)
    constant = fixed and affine and not np.any(model.actuator_biasprm[i, 1:3])
    return not (constant and float(model.actuator_gainprm[i, 0]) == 0.0)


def _is_motor(mujoco: Any, model: Any, i: int) -> bool:
    return int(model.actuator_gaintype[i]) == int(getattr(mujoco.mjtGain, "mjGAIN_DCMOTOR", -1))


def _beside_the_drive(
    mujoco: Any, model: Any, index: int, origin: float, left_out: list[str]
) -> tuple[list[Physics], float]:
    """Return what a joint's actuators do without a command: effects, and the damping.

    A dcmotor without inputs is shorted, so that its winding brakes.
    """
    found: list[Physics] = []
    damper = 0.0
    for i in _actuators(mujoco, model, index):
        gear, name = float(model.actuator_gear[i, 0]), model.actuator(i).name
        if hasattr(model, "actuator_damping"):
            damper += gear**2 * float(model.actuator_damping[i])
            if np.any(model.actuator_dampingpoly[i]):
                left_out.append(f"the damping of {name!r} that is not linear in the speed")
        driven = _driven(mujoco, model, i)
        if _is_motor(mujoco, model, i):
            found += effects_of_motor(model, i, gear, origin, left_out)
            if not driven:
                resistance, constant = model.actuator_gainprm[i, :2].tolist()
                damper += (gear * constant) ** 2 / resistance
                if constant > 0.0 and model.actuator_dynprm[i, 0] > 0.0:
                    left_out.append(f"the inductance of {name!r}, which has no input")
                if further(model, i):
                    left_out.append(f"the heat of {name!r}, which has no input")
        elif not driven and (force := gear * float(model.actuator_biasprm[i, 0])) != 0.0:
            found.append(make_physics("constant_force", "m1", level=force))
    return found, damper


@dataclass(frozen=True)
class _Actuator:
    """An actuator as seen from its joint: an interface, a loop on its position, a damper."""

    face: Interface
    drive: Drive | None = None
    damper: float = 0.0


def _actuator(mujoco: Any, model: Any, index: int, period: float, left_out: list[str]) -> _Actuator:
    """Return gain, limit, delay and loop of the joint's actuator, if it has one.

    force at the joint = gear (gain ctrl + b0 + b1 gear q + b2 gear v), which is a motor if all b
    are zero, a loop on the position if b1 < 0, and a loop on the speed if only b2 is not zero.
    """
    nothing = _Actuator(Interface(period=period))
    mine = drives_of(mujoco, model, index)
    if len(mine) != 1:
        if mine:
            left_out.append(f"its {len(mine)} actuators: a device has one")
        return nothing
    (i,) = mine
    control = input_of(model, i)
    gear, gain = float(model.actuator_gear[i, 0]), float(model.actuator_gainprm[i, 0])
    name = model.actuator(i).name
    if _is_motor(mujoco, model, i):
        if gear > 0.0:
            return _Actuator(_late(model, i, nothing.face), _motor(model, i, gear, left_out))
        left_out.append(f"the command: the gear of {name!r} is {gear:g}, which turns it round")
        resistance, constant = model.actuator_gainprm[i, :2].tolist()
        return replace(nothing, damper=(gear * constant) ** 2 / resistance)
    bias = [0.0, 0.0, 0.0]
    kind = int(model.actuator_biastype[i])
    if kind == int(mujoco.mjtBias.mjBIAS_AFFINE):
        bias = [float(b) for b in model.actuator_biasprm[i, :3]]
    fixed = int(model.actuator_gaintype[i]) == int(mujoco.mjtGain.mjGAIN_FIXED)
    known = kind in (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)) and fixed
    stiffness, damping = -(gear**2) * bias[1], -(gear**2) * bias[2]
    if not known or gain * gear <= 0.0 or stiffness < 0.0 or damping < 0.0:
        left_out.append(f"its actuator {name!r}, which is neither a motor nor a loop on the joint")
        return nothing
    if bias[0] != 0.0:
        left_out.append(f"the constant force {gear * bias[0]:g} of its actuator {name!r}")
    looped = stiffness > 0.0
    found = {"command_gain": gain * gear / (stiffness if looped else 1.0)}
    limits: list[float] = []
    if model.actuator_forcelimited[i]:
        limits.append(gear * float(np.abs(model.actuator_forcerange[i]).min()))
        if damping > 0.0 and not looped:
            left_out.append(f"that the force of {name!r} is limited with its damping, not before")
    if looped:
        limit = min((one for one in limits if one > 0.0), default=math.inf)
        drive = Drive("position", stiffness=stiffness, damping=damping, limit=limit)
        if model.actuator_ctrllimited[control]:
            low, high = model.actuator_ctrlrange[control].tolist()
            left_out.append(f"the range of its goal, {low:g} to {high:g}")
        face = _delayed(mujoco, model, i, replace(nothing.face, **found), left_out)
        return _Actuator(face, drive)
    if model.actuator_ctrllimited[control]:
        limits.append(gain * gear * float(np.abs(model.actuator_ctrlrange[control]).min()))
    if limits and math.isfinite(min(limits)) and min(limits) > 0.0:
        found["command_limit"] = min(limits)
    return _Actuator(
        _delayed(mujoco, model, i, replace(nothing.face, **found), left_out), damper=damping
    )


def _motor(model: Any, i: int, gear: float, left_out: list[str]) -> Drive:
    """Return the drive of a `dcmotor` under a voltage.

    force at the joint = gear K (u - gear K v) / R, behind the lag L / R: MuJoCo keeps R and K, the
    geometric mean of torque constant and back-EMF, in gainprm, and L / R in dynprm.
    """
    name = model.actuator(i).name
    resistance, constant = (float(x) for x in model.actuator_gainprm[i, :2])
    if further(model, i):
        left_out.append(f"what {name!r} has beside a winding: heat, a controller, a limit of rates")
    if model.actuator_forcelimited[i]:
        left_out.append(
            f"the limit of the force of {name!r},"
            f" {gear * float(np.abs(model.actuator_forcerange[i]).min()):g} at the joint"
        )
    supply, control = math.inf, input_of(model, i)
    if model.actuator_ctrllimited[control]:
        supply = float(np.abs(model.actuator_ctrlrange[control]).min()) or math.inf
    return Drive(
        "voltage", motor_constant=constant, resistance_ohm=resistance, gear=gear,
        inductance_h=float(model.actuator_dynprm[i, 0]) * resistance, supply_v=supply,
    )  # fmt: skip


def _late(model: Any, i: int, face: Interface) -> Interface:
    delay = float(getattr(model, "actuator_delay", np.zeros(model.nu))[i])
    return replace(face, delay=delay) if delay > 0.0 else face


def _delayed(mujoco: Any, model: Any, i: int, face: Interface, left_out: list[str]) -> Interface:
    """Return an interface with the delay of an actuator, and append what is left out."""
    if int(model.actuator_dyntype[i]) != int(mujoco.mjtDyn.mjDYN_NONE):
        left_out.append(f"the dynamics of its actuator {model.actuator(i).name!r}")
    return _late(model, i, face)


def _remarks(mujoco: Any, model: Any, index: int, dof: int, left_out: list[str]) -> None:
    if model.jnt_limited[index]:
        low, high = model.jnt_range[index].tolist()
        if max(-low, high) < 1e6:
            left_out.append(f"its range, {low:g} to {high:g}")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    weight = float(data.qfrc_bias[dof])
    if abs(weight) > 1e-12:
        left_out.append(f"gravity, which pulls with {-weight:.3g} in the zero pose")
    coupled = [
        i for i in range(model.ntendon) if model.tendon_stiffness.size and _pulls(model, i, index)
    ]
    if coupled:
        left_out.append(f"{len(coupled)} tendon(s) that tie it to other joints")


def _pulls(model: Any, tendon: int, joint: int) -> bool:
    first, count = int(model.tendon_adr[tendon]), int(model.tendon_num[tendon])
    return joint in [int(model.wrap_objid[i]) for i in range(first, first + count)]
