"""Lanes over the scalar kernel, for every kind of physics; and beside them what others offer.

    python -m benchmarks.bench_lanes            # one core: ZWIDTH_THREADS=1
    python -m benchmarks.bench_lanes --peers    # MuJoCo, scipy, and JAX with diffrax if it is there

The scalar kernel predicts each member alone; the lanes predict all of them in one call. Members are
PHANToMs whose masses, springs and effects differ by a tenth. Least of several rounds, in
nanoseconds a tick and member; every member's innovations are compared bit for bit first.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.fitting.descend import SMOOTH
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import likeliest
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.jobs.parallel import in_parallel, threads
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.equations import equations
from zwidth.sim.lane_type import WIDTH
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics
from zwidth.sim.population import Population, Readings, Recorded
from zwidth.sim.predict import GROUND, Outputs, alone
from zwidth.sim.run import Start, simulate, start_memory

Floats = NDArray[np.float64]
TICKS, MEMBERS, ROUNDS = 20000, 2 * WIDTH, 5
OUTPUTS = Outputs(np.array([0]), np.array([True]), np.array([GROUND]), np.zeros(1))


def coulomb(level: float, at: str = "m1") -> Physics:
    """Return Coulomb friction."""
    return make_physics("coulomb_friction", at, level=level)


# name -> effects, substeps a tick, and those of ticks that need more
CASES: dict[str, tuple[tuple[Physics, ...], int, int]] = {
    "linear": ((), 1, 1),
    "Coulomb friction, m1": ((coulomb(0.02),), 1, 4),
    "Coulomb friction, m1 m2 m3": (
        (coulomb(0.01), coulomb(0.01, "m2"), coulomb(0.01, "m3")), 1, 4,
    ),
    "play": ((make_physics("backlash", "link12", gap=1e-4),), 8, 16),
    "Stribeck friction": (
        (make_physics("stribeck_friction", "m1", level=0.01, static_level=0.015, velocity=0.1),),
        1, 4,
    ),
    "gravity": ((make_physics("gravity_pendulum", "m1", level=0.01, angle=0.3),), 4, 4),
    "ripple": ((make_physics("force_ripple", "m1", amplitude=0.01, period=0.1, phase=0.3),), 4, 4),
    "cubic spring": ((make_physics("cubic_stiffness", "link12", coefficient=1e6),), 4, 4),
    "drag": ((make_physics("quadratic_drag", "m1", coefficient=0.01),), 4, 4),
    "presliding friction": (
        (make_physics("presliding_friction", "m1", level=0.01, stiffness=50.0),), 4, 4,
    ),
    "hysteresis": (
        (make_physics("hysteresis", "link12", level=0.01, stiffness=50.0, shape=2.5),), 4, 4,
    ),
}  # fmt: skip


def varied(physics: tuple[Physics, ...], members: int) -> list[Device]:
    """Return devices of one structure and different numbers."""
    rng, base = np.random.default_rng(5), load_device("phantom_1_0")
    found: list[Device] = []
    for _ in range(members):
        scale, chain = 1.0 + 0.1 * rng.uniform(-1.0, 1.0, 6), base.chain
        masses, springs = chain.masses * scale[:3], chain.link_springs * scale[3:5]
        own = base.with_chain(chain._replace(masses=masses, link_springs=springs))
        for p in physics:
            values = {name: float(scale[5]) * value for name, value in p.values.items()}
            own = own.with_physics(replace(p, values=values))
        found.append(own)
    return found


def least(work: Callable[[], Any], rounds: int = ROUNDS) -> float:
    """Return the least wall time [s] of some rounds, after one that does not count."""
    work()
    times: list[float] = []
    for _ in range(rounds):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def signals() -> tuple[Floats, Floats]:
    """Return a command, and a motion that it may have made."""
    rng = np.random.default_rng(0)
    command = 0.1 * rng.normal(size=TICKS)
    device = load_device("phantom_1_0")
    run = simulate(device, recorded(command), duration=TICKS * 1e-3)
    return command, (run.trace["position_m1"] + 1e-5 * rng.normal(size=TICKS))[:, None]


def one_case(name: str) -> tuple[float, float]:
    """Return ns a tick and member, alone and in lanes, of members that agree to the bit."""
    physics, few, many = CASES[name]
    devices, (command, motion) = varied(physics, MEMBERS), signals()
    population = Population(devices, few, many)
    observer = np.zeros((6, 1))
    observer[0], observer[3] = 0.3, 20.0
    still = np.zeros((MEMBERS, 3))
    starts, recording = population.start(still, still), Recorded(command, motion, OUTPUTS)
    each = [(equations(d, few), equations(d, many)) for d in devices]
    free = np.zeros((0, 3))

    def by_itself(i: int) -> Floats:
        eq, fine = each[i]
        memory = start_memory(eq, Start())
        return alone(eq, fine, OUTPUTS, command, motion, observer, free, memory)

    def run_all(tasks: Any) -> None:
        in_parallel(tasks, threads())

    def in_lanes(keep: bool = False) -> Floats:
        found = population.follow(recording, starts, Readings(observer), keep=keep, run_all=run_all)
        return found.innovations

    found = in_lanes(keep=True)
    assert all(np.array_equal(found[i], by_itself(i)) for i in range(MEMBERS))
    indices = range(WIDTH // 2)
    slow = least(lambda: in_parallel([lambda i=i: by_itself(i) for i in indices], threads()))
    return slow / len(indices) / TICKS * 1e9, least(in_lanes) / MEMBERS / TICKS * 1e9


def jacobian() -> tuple[float, float]:
    """Return [s] of the slopes of a fit, one by one and in lanes: 20 s, friction, 13 columns."""
    device = load_device("phantom_1_0")
    rng = np.random.default_rng(0)
    command = 0.15 * rng.normal(size=TICKS)
    truth = device.with_physics(coulomb(4e-3))
    run = simulate(truth, recorded(command), duration=TICKS * 1e-3, substeps=16)
    motion = (run.trace["position_m1"] + 1e-5 * rng.normal(size=TICKS))[:, None]
    experiment = Experiment(1e-3, command, motion, (Output("position", 0),))
    model = Model(device, (coulomb(3e-3),), ({"level": 3e-3},))
    x = np.zeros(len(model.parameters))
    problem = likeliest([experiment], model, x).problem([experiment])

    xs = [x, *(x + SMOOTH * np.eye(x.size))]

    def one_by_one() -> list[Floats]:
        return in_parallel([lambda x=x: problem.weighted(model, x) for x in xs], threads())

    return least(one_by_one, 3), least(lambda: problem.weighted_each(model, xs), 3)


def propagator() -> float:
    """Return [us] for a propagator of six states, in a loop of one device after the other."""
    from zwidth.sim.exponential import SPACES, held_motion_each

    plants = [d.plant() for d in varied((), 2000)]
    a, b = np.stack([p.a for p in plants]), np.stack([p.b for p in plants])
    scale, work, out = np.zeros(6), np.zeros((SPACES, 6, 6)), np.zeros((a.shape[0], 6, 10))
    seconds = least(lambda: held_motion_each(a, b, 1e-3, 3, scale, work, out))
    return seconds / a.shape[0] * 1e6


def mujoco_ns() -> float:
    """Return ns a tick and member of `mujoco.rollout`: the chain as three slides, implicit."""
    import mujoco
    from mujoco import rollout

    bodies = close = ""
    chain = load_device("phantom_1_0").chain
    for i, mass in enumerate(chain.masses):
        first = i == 0
        spring = 0.0 if first else float(chain.link_springs[i - 1])
        damper = max(0.0, float(chain.ground_dampers[0] if first else chain.link_dampers[i - 1]))
        bodies += (
            f'<body><inertial pos="0 0 0" mass="{mass}" diaginertia="1e-9 1e-9 1e-9"/>'
            f'<joint name="j{i}" type="slide" axis="1 0 0" stiffness="{spring}"'
            f' damping="{damper}" frictionloss="{0.02 if first else 0.0}"/>'
        )
        close += "</body>"
    text = (
        '<mujoco><option timestep="0.001" gravity="0 0 0" integrator="implicitfast"/>'
        f"<worldbody>{bodies}{close}</worldbody>"
        '<actuator><motor joint="j0"/></actuator></mujoco>'
    )
    model: Any = mujoco.MjModel.from_xml_string(text)  # pyright: ignore[reportAttributeAccessIssue]
    data = [mujoco.MjData(model) for _ in range(threads())]  # pyright: ignore[reportAttributeAccessIssue]
    size = mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)  # pyright: ignore[reportAttributeAccessIssue]
    start = np.zeros((MEMBERS, size))
    control = np.tile(signals()[0][:, None], (MEMBERS, 1, 1))
    work = least(lambda: rollout.rollout(model, data, start, control), 2)
    return work / MEMBERS / TICKS * 1e9


def scipy_ns() -> float:
    """Return ns a tick of `solve_ivp` (LSODA, rtol 1e-6) over the linear chain, tick by tick."""
    from scipy.integrate import solve_ivp

    plant = varied((), 1)[0].plant()
    command, ticks = signals()[0], 200

    def run() -> None:
        x = np.zeros(6)
        for u in command[:ticks]:
            force = plant.b[:, 0] * u
            x = solve_ivp(
                lambda _, x, f=force: plant.a @ x + f, (0.0, 1e-3), x, "LSODA", rtol=1e-6
            ).y[:, -1]

    return least(run, 2) / ticks * 1e9


def jax_ns() -> float | None:
    """Return ns a tick and member of a vmap of diffrax's Tsit5 over the linear chain, or None."""
    try:
        import diffrax  # pyright: ignore[reportMissingImports]
        import jax  # pyright: ignore[reportMissingImports]
        import jax.numpy as jnp  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError:
        return None
    jax.config.update("jax_enable_x64", True)
    plants = [d.plant() for d in varied((), MEMBERS)]
    a, b = (jnp.array(np.stack([getattr(p, f) for p in plants])) for f in ("a", "b"))
    command, ticks = jnp.array(signals()[0][:2000]), 2000

    def run(a: Any, b: Any) -> Any:
        def field(t: Any, x: Any, _: Any) -> Any:
            return a @ x + b[:, 0] * command[jnp.minimum(t / 1e-3, ticks - 1).astype(int)]

        term, solver = diffrax.ODETerm(field), diffrax.Tsit5()
        end, step = ticks * 1e-3, 2.5e-4
        found = diffrax.diffeqsolve(
            term, solver, 0.0, end, step, jnp.zeros(6), max_steps=4 * ticks + 8
        )
        return found.ys

    together = jax.jit(jax.vmap(run))

    def once() -> None:
        together(a, b).block_until_ready()

    return least(once, 2) / MEMBERS / ticks * 1e9


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--peers", action="store_true")
    arguments = parser.parse_args()
    print(f"{threads()} thread(s), {WIDTH} lanes, {MEMBERS} members, ns a tick and member")
    print("| physics | substeps | scalar | lanes | ratio |\n|---|---|---|---|---|")
    for name, (_, few, many) in CASES.items():
        slow, fast = one_case(name)
        print(f"| {name} | {few} to {many} | {slow:.0f} | {fast:.1f} | {slow / fast:.1f} |")
    slow, fast = jacobian()
    print(f"\nslopes of 13 parameters, 20 s: {slow:.3f} s one by one, {fast:.3f} s in lanes,"
          f" ratio {slow / fast:.1f}")  # fmt: skip
    print(f"a propagator of six states: {propagator():.1f} us")
    if arguments.peers:
        print(f"MuJoCo rollout, friction at m1: {mujoco_ns():.0f} ns a tick and member")
        print(f"scipy solve_ivp, linear: {scipy_ns():.0f} ns a tick")
        own = jax_ns()
        print("diffrax: not installed" if own is None else f"diffrax vmap: {own:.0f} ns")


if __name__ == "__main__":
    main()
