"""Ticks a second and core of a bench with dry friction and play: zwidth, MuJoCo, diffrax.

    ZWIDTH_THREADS=1 python -m benchmarks.ticks
    ZWIDTH_THREADS=1 python -m benchmarks.ticks --diffrax PYTHON

A tick is 1 ms of two inertias on a link with play, friction at the first. All follow the same
command from rest, as 32 members whose friction differs; times are process times, the least of
several rounds that take turns, so that other work on the machine counts little. Beside the speed
stand what it is worth: how far the motion of the first is from that of zwidth in 256 substeps a
tick, rms over two seconds, and by how much a mass creeps that half of its friction pulls for ten
seconds. PYTHON: an interpreter that has `diffrax` (and jax for the CPU).
"""

import argparse
import json
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.noise.predictor import SEARCHING, substeps_of
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.equations import equations
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.population import Population, Readings, Recorded
from zwidth.sim.predict import GROUND, Outputs, alone
from zwidth.sim.run import Start, start_memory

Floats = NDArray[np.float64]
PERIOD, TICKS, HOLD, MEMBERS, ROUNDS = 1e-3, 2000, 10_000, 32, 9
M1, M2, K, LEVEL, GAP = 2e-4, 1e-3, 20.0, 0.02, 0.02
C = 0.0  # N m s/rad: a damper of a tendon acts inside its dead band too, one of a link does not
SLOW, CORNER = 1e-2, 1e-4  # rad/s of the tanh that stands for a sign, rad of the play's edge
FINE = 256
OUT = Outputs(np.array([0]), np.array([False]), np.array([GROUND]), np.zeros(1))


@dataclass
class Engine:
    """What one simulator does: the bench's ticks of all members (once), motion, creep."""

    name: str
    what: str
    once: Callable[[], object]
    motion: Floats
    creep: float
    seconds: float = float("inf")
    count: int = MEMBERS * TICKS


def bench(scale: float = 1.0) -> Device:
    """Return the bench, its friction scaled."""
    chain = make_chain([M1, M2], [0.0, 0.0], link_springs=[K], link_dampers=[C])
    face = Interface(period=PERIOD, delay=0.0)
    return Device("bench", "a benchmark", True, chain, face).with_physics(
        make_physics("coulomb_friction", "m1", level=scale * LEVEL),
        make_physics("backlash", "link12", gap=GAP),
    )


def command(ticks: int = TICKS) -> Floats:
    """Return torques that turn about, stick and slip."""
    t = PERIOD * np.arange(ticks)
    return 0.05 * np.sin(2.0 * np.pi * 1.3 * t) + 0.03 * np.sin(2.0 * np.pi * 4.1 * t)


def scales() -> Floats:
    """Return by how much the members' friction differs."""
    return np.linspace(0.9, 1.1, MEMBERS)


def run_alone(device: Device, u: Floats, few: int, many: int) -> Floats:
    """Return the positions of m1, of one device in the scalar kernel."""
    eq, fine = equations(device, few), equations(device, many)
    zero = np.zeros((u.size, 1))
    return -alone(
        eq, fine, OUT, u, zero, np.zeros((eq.states, 1)), np.zeros((0, 2)),
        start_memory(eq, Start()),
    )[:, 0]  # fmt: skip


def by_zwidth() -> list[Engine]:
    """Return the lanes and the scalar kernel."""
    few, many = substeps_of(bench(), SEARCHING)  # as a search takes
    devices = [bench(float(s)) for s in scales()]
    population = Population(devices, few, many)
    still, u = np.zeros((MEMBERS, 2)), command()
    recorded = Recorded(u, np.zeros((TICKS, 1)), OUT)
    readings = Readings(np.zeros((4, 1)))

    def lanes(keep: bool = False) -> Any:
        memories = population.start(still, still)
        return population.follow(recorded, memories, readings, keep=keep)

    eq, fine = equations(devices[0], few), equations(devices[0], many)
    zero, blind, free = np.zeros((TICKS, 1)), np.zeros((eq.states, 1)), np.zeros((0, 2))

    def scalar() -> object:
        return alone(eq, fine, OUT, u, zero, blind, free, start_memory(eq, Start()))

    motion = -lanes(keep=True).innovations[0, :, 0]
    held = run_alone(bench(), np.full(HOLD, 0.5 * LEVEL), few, many)
    creep = float(abs(held[-1] - held[HOLD // 10]))
    what = "friction that sticks exactly, play as a pin"
    return [
        Engine("zwidth, 32 members in lanes", what, lanes, motion, creep),
        Engine("zwidth, one at a time", what, scalar, motion, creep, count=TICKS),
    ]


def mujoco_model(steps: int, scale: float) -> Any:
    """Return the bench for MuJoCo: play is a tendon whose spring has a dead band."""
    import mujoco

    friction = scale * LEVEL
    bodies = "".join(
        f'<body><inertial pos="0 0 0" mass="1" diaginertia="{m} {m} {m}"/>'
        f'<joint name="q{i}" type="hinge" axis="1 0 0" frictionloss="{friction if i == 1 else 0.0}"'
        ' solreffriction="0.002 1" solimpfriction="0.99 0.9999 0.001"/></body>'
        for i, m in ((1, M1), (2, M2))
    )
    xml = (
        f'<mujoco><option timestep="{PERIOD / steps}" gravity="0 0 0" integrator="implicitfast">'
        f'<flag contact="disable"/></option><worldbody>{bodies}</worldbody>'
        f'<tendon><fixed name="link" stiffness="{K}" damping="{C}"'
        f' springlength="{-GAP / 2} {GAP / 2}"><joint joint="q1" coef="1"/>'
        '<joint joint="q2" coef="-1"/></fixed></tendon>'
        '<actuator><motor joint="q1"/></actuator></mujoco>'
    )
    return mujoco.MjModel.from_xml_string(xml)  # pyright: ignore[reportAttributeAccessIssue]


def by_mujoco(steps: int) -> Engine:
    """Return `mujoco.rollout` on one thread."""
    import mujoco
    from mujoco import rollout

    models = [mujoco_model(steps, float(scale)) for scale in scales()]
    data = [mujoco.MjData(models[0])]  # pyright: ignore[reportAttributeAccessIssue]
    size = mujoco.mj_stateSize(models[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)  # pyright: ignore[reportAttributeAccessIssue]

    def run(u: Floats, some: list[Any]) -> Floats:
        control = np.tile(np.repeat(u, steps)[:, None], (len(some), 1, 1))
        found, _ = rollout.rollout(some, data, np.zeros((len(some), size)), control)
        return np.asarray(found)[0, steps - 1 :: steps, 1]

    motion = np.append(0.0, run(command(), models[:1]))[:TICKS]
    held = run(np.full(HOLD, 0.5 * LEVEL), [mujoco_model(steps, 1.0)])
    return Engine(
        f"MuJoCo rollout, {steps} step{'s' if steps > 1 else ''} a tick",
        "friction as a stiff constraint, play as a dead band of a tendon's spring",
        lambda: run(command(), models), motion, float(abs(held[-1] - held[HOLD // 10])),
    )  # fmt: skip


def by_diffrax(python: str, steps: int) -> Engine:
    """Return diffrax, which times itself in its own interpreter."""
    given = {
        "m1": M1, "m2": M2, "k": K, "c": C, "level": LEVEL, "gap": GAP, "members": MEMBERS,
        "steps": steps, "period": PERIOD, "slow": SLOW, "corner": CORNER, "rounds": ROUNDS,
        "scales": scales().tolist(), "command": command().tolist(), "hold_ticks": HOLD,
    }  # fmt: skip
    script = Path(__file__).with_name("ticks_diffrax.py")
    made = subprocess.run(
        [python, str(script)], input=json.dumps(given), capture_output=True, text=True, check=True,
        env={"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false", "OMP_NUM_THREADS": "1"},
    )  # fmt: skip
    told: dict[str, Any] = json.loads(made.stdout)
    engine = Engine(
        f"diffrax Tsit5, {steps} steps a tick, vmap", f"friction as tanh(v / {SLOW:g} rad/s)",
        lambda: None, np.array(told["motion"]), told["creep"],
    )  # fmt: skip
    return replace(engine, seconds=told["seconds"])


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--diffrax", metavar="PYTHON", help="an interpreter that has it")
    asked = options.parse_args()
    engines = [*by_zwidth(), by_mujoco(1), by_mujoco(10)]
    for _ in range(ROUNDS):  # in turns
        for e in engines:
            begun = time.process_time()
            e.once()
            e.seconds = min(e.seconds, time.process_time() - begun)
    if asked.diffrax:
        engines += [by_diffrax(asked.diffrax, steps) for steps in (4, 20)]
    true = run_alone(bench(float(scales()[0])), command(), FINE, FINE)
    print("| engine | ticks a second and core | error of m1, rms | creep in 9 s | how |")
    print("|---|---|---|---|---|")
    for e in engines:
        off = float(np.sqrt(np.mean((e.motion - true) ** 2)) / true.std())
        print(f"| {e.name} | {e.count / e.seconds:.3g} | {100.0 * off:.2g} % | {e.creep:.2g} rad |"
              f" {e.what} |")  # fmt: skip


if __name__ == "__main__":
    main()
