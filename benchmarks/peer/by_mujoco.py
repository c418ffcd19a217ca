"""MuJoCo's own system identification: a model of the right structure, its numbers fitted.

`mujoco.sysid` simulates the whole fitted part from its first sample, and fits every number that the
structure leaves open by least squares of the outputs (`optimize`, backend scipy), from the values
of the same device file that zwidth gets, and from zero for what that does not know. Friction is
MuJoCo's `frictionloss`, made stiff. The structure is told: this is what zwidth has to find.
"""

import importlib
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.peer.method import Foretold, state_before
from benchmarks.peer.sets import Floats, Part, Set

BEFORE = 300  # samples before the cut, at most, that say where a free run begins
STIFF = 'solreffriction="0.002 1" solimpfriction="0.99 0.9999 0.001"'
ROUNDS = 60


KNOWN = {
    "emps": "one mass with a damper, Coulomb friction and a constant force, and about how large",
    "silverbox": "a mass on a spring with a cubic part, about how large, and that the command is"
    " smooth between its samples",
    "two_mass_cart": "two carts on a spring, each with a damper and Coulomb friction, and about how"
    " large",
    "coupled_drives": "two inertias on a belt, friction on both, a lag of the drive, about how"
    " large, and that the sensor gives the absolute value of the speed",
}


@dataclass(frozen=True)
class Open:
    """A number that is fitted: its name, where it begins, how large it may become, and its place.

    put: writes it into a model's description. Fitted are numbers over `size`.
    """

    name: str
    begin: float
    size: float
    put: Callable[[Any, float], None]
    least: float = 0.0
    most: float = 50.0


@dataclass(frozen=True)
class Structure:
    """A model that is told: XML with its step and integrator left out, what is open, what is seen.

    seen: place of each output in (time, positions, velocities, activations). substeps of a sample;
    smooth: whether the command is smooth between samples.
    """

    xml: str
    opened: Sequence[Open]
    seen: tuple[int, ...]
    substeps: int = 1
    smooth: bool = False
    folded: bool = False
    integrator: str = "implicitfast"


ONE = (
    '<mujoco><option timestep="{period}" gravity="0 0 0" integrator="{integrator}">'
    '<flag contact="disable"/></option><worldbody><body name="m1">'
    '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    f'<joint name="q1" type="slide" axis="1 0 0" {STIFF}/></body></worldbody>'
    '<actuator><general name="force" joint="q1" biastype="affine"/></actuator></mujoco>'
)
BODY = (
    '<body name="m{k}"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    f'<joint name="q{{k}}" type="slide" axis="1 0 0" {STIFF}/></body>'
)
TWO = (
    '<mujoco><option timestep="{period}" gravity="0 0 0" integrator="{integrator}">'
    '<flag contact="disable"/></option><worldbody>'
    f"{BODY.format(k=1)}{BODY.format(k=2)}</worldbody>"
    '<tendon><fixed name="k12" springlength="0"><joint joint="q1" coef="1"/>'
    '<joint joint="q2" coef="-1"/></fixed></tendon>'
    '<actuator><general name="force" joint="q1"{lag}/></actuator></mujoco>'
)


def _joint(name: str, field: str, place: int | None = None) -> Callable[[Any, float], None]:
    def put(spec: Any, value: float) -> None:
        joint = spec.joint(name)
        values = np.array(np.atleast_1d(getattr(joint, field)), dtype=np.float64)
        if place is None and values.size == 1:
            setattr(joint, field, value)
        else:
            values[place or 0] = value
            setattr(joint, field, values)

    return put


def _tendon(field: str) -> Callable[[Any, float], None]:
    def put(spec: Any, value: float) -> None:
        values = np.array(np.atleast_1d(getattr(spec.tendon("k12"), field)), dtype=np.float64)
        values[0] = value
        setattr(spec.tendon("k12"), field, values if values.size > 1 else value)

    return put


def _mass(name: str) -> Callable[[Any, float], None]:
    return lambda spec, value: setattr(spec.body(name), "mass", value)


def _actuator(field: str, place: int = 0) -> Callable[[Any, float], None]:
    def put(spec: Any, value: float) -> None:
        values = np.array(getattr(spec.actuator("force"), field), dtype=np.float64)
        values[place] = value
        setattr(spec.actuator("force"), field, values)

    return put


def _structure(s: Set) -> Structure:
    """The right structure of a set, as its published analyses give it."""
    chain = s.device.chain
    m, b = chain.masses, chain.ground_dampers
    if s.kind.name == "emps":
        return Structure(
            ONE,
            (
                Open("mass", m[0], m[0], _mass("m1"), 0.01),
                Open("damping", b[0], b[0], _joint("q1", "damping")),
                Open("friction", 1.0, 10.0, _joint("q1", "frictionloss")),
                Open("offset", 0.0, 10.0, _actuator("biasprm"), -50.0),
            ),
            (1,),
        )
    if s.kind.name == "silverbox":
        k = chain.ground_spring
        return Structure(
            ONE,
            (
                Open("mass", m[0], m[0], _mass("m1"), 0.01),
                Open("damping", b[0], b[0], _joint("q1", "damping")),
                Open("stiffness", k, k, _joint("q1", "stiffness")),
                Open("cubic", 0.0, k, _joint("q1", "stiffness", 2), -50.0),
                Open("offset", 0.0, 0.01, _actuator("biasprm"), -50.0),
            ),
            (1,),
            substeps=4, smooth=True, integrator="RK4",
        )  # fmt: skip
    k, c = chain.link_springs[0], max(float(chain.link_dampers[0]), 0.1)
    cart = s.kind.name == "two_mass_cart"
    friction = 0.1 if cart else 1.0
    both = (
        Open("m1", m[0], m[0], _mass("m1"), 0.01),
        Open("m2", m[1], m[1], _mass("m2"), 0.01),
        Open("b1", b[0], b[0], _joint("q1", "damping")),
        Open("b2", b[1], b[1], _joint("q2", "damping")),
        Open("k12", k, k, _tendon("stiffness"), 0.01),
        Open("b12", c, c, _tendon("damping")),
        Open("friction 1", friction, friction, _joint("q1", "frictionloss")),
        Open("friction 2", friction, friction, _joint("q2", "frictionloss")),
    )
    if cart:
        return Structure(
            TWO.replace("{lag}", ""), both, (3, 4),
        )  # fmt: skip
    lag = ' dyntype="filterexact" dynprm="0.02"'
    more = (
        Open("gain", 10.0, 10.0, _actuator("gainprm"), -50.0),
        Open("lag", 0.02, 0.02, _actuator("dynprm"), 0.01),
    )
    return Structure(
        TWO.replace("{lag}", lag), (*both, *more), (4,),
        substeps=10, folded=True,
    )  # fmt: skip


def _writer(o: Open) -> Callable[[Any, Any], None]:
    """What writes a fitted value into a model's description."""

    def write(spec: Any, parameter: Any) -> None:
        o.put(spec, float(parameter.value[0]) * o.size)

    return write


def foretold(s: Set) -> Foretold:
    """Fit, and run freely over the held-out part."""
    sysid = importlib.import_module("mujoco.sysid")
    given = _structure(s)
    mujoco = importlib.import_module("mujoco")
    xml = given.xml.replace("{period}", repr(s.period / given.substeps))
    spec = mujoco.MjSpec.from_string(xml.replace("{integrator}", given.integrator))
    parameters = sysid.ParameterDict()
    for o in given.opened:
        parameters.add(
            sysid.Parameter(o.name, o.begin / o.size, o.least, o.most, modifier=_writer(o))
        )
    build = sysid.apply_param_modifiers
    swing = s.fit.measured.std(axis=0)

    def residual(x: Floats, values: Any) -> tuple[list[Floats], None, None]:
        values.update_from_vector(x)
        model = build(values, spec.copy())
        off = _run(given, model, _first(given, model, s.fit), s.fit.command) - s.fit.measured
        return [np.where(np.isfinite(off), off / swing, 1e3).ravel()], None, None

    with redirect_stdout(StringIO()):  # its backend prints every round
        best, _ = sysid.optimize(
            parameters, residual, "scipy", verbose=False, max_iters=ROUNDS, x_scale="jac",
            diff_step=1e-4,
        )  # fmt: skip
    model = build(best, spec.copy())
    values = [f"{o.name} {best[o.name].value[0] * o.size:.4g}" for o in given.opened]
    return Foretold(_held(s, given, model), ", ".join(values))


def _first(given: Structure, model: Any, part: Part) -> Floats:
    """The state at rest, as the first sample has it: (time, positions, velocities, activations)."""
    state = np.zeros(1 + model.nq + model.nv + model.na)
    for o, place in enumerate(given.seen):
        state[place] = 0.0 if given.folded else part.measured[0, o]
    return state


def _run(given: Structure, model: Any, state: Floats, command: Floats) -> Floats:
    """Outputs (ticks, o) of a free run from a state."""
    mujoco, rollout = (importlib.import_module(n) for n in ("mujoco", "mujoco.rollout"))
    n = given.substeps
    ticks = np.arange(command.size)
    if given.smooth:  # each substep holds the mean of its own stretch of the smooth signal
        fine = CubicSpline(ticks, command)((np.arange(n * command.size) + 0.5) / n)
    else:
        fine = np.repeat(command, n)
    control = fine[: n * (command.size - 1), None]
    states, _ = rollout.rollout(model, mujoco.MjData(model), state[None], control[None])
    after = states[0, n - 1 :: n]
    outputs = np.vstack([state[None], after])[:, list(given.seen)]
    return np.abs(outputs) if given.folded else outputs


def _held(s: Set, given: Structure, model: Any) -> Floats:
    if not s.follows:
        return _run(given, model, _first(given, model, s.held), s.held.command)
    last = s.fit.cut(max(0, s.fit.ticks - BEFORE))
    guess = _first(given, model, last)
    scale = np.ones(guess.size)
    scale[0] = 1e-12  # time

    def simulated(state: Floats) -> Floats:
        return _run(given, model, state, last.command)

    start = state_before(simulated, last.measured, guess, scale)
    both = np.r_[last.command, s.held.command]
    return _run(given, model, start, both)[last.ticks :]
