"""From a device, as it is declared, to the numbers that the integrator moves."""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from zwidth.scenarios.concealed.integrator import Floats, Truth
from zwidth.scenarios.concealed.outside import Outside
from zwidth.sim.device import Device
from zwidth.sim.physics.effect import Physics
from zwidth.sim.place import Place
from zwidth.sim.reading import reading

ROW = 5  # numbers of a row of which there is none
BRISTLE, MICRO = 0.3, 0.7  # omega h of a stiff bristle, its damping ratio


def truth_of(device: Device, steps: int, outside: Outside | None = None) -> Truth:
    """Return the true simulation of a device with its physics, with `steps` steps per tick.

    outside: physics that the library does not have, on top. Raises ValueError for a device with an
    effect twice in one place (a device file cannot have that).
    """
    by_name: dict[str, list[Physics]] = {}
    for physics in device.physics:
        by_name.setdefault(physics.effect.name, []).append(physics)

    def one(name: str) -> Mapping[str, float]:
        return by_name[name][0].values if name in by_name else {}

    def row(name: str, neutral: tuple[float, ...]) -> Floats:
        return np.array(list(one(name).values()) or neutral)

    masses, dampers, links = _chain(device, by_name)
    n = masses.size
    springs, drag, constant, viscous = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((n, 2))
    springs[0] = device.chain.ground_spring
    for physics in by_name.get("ground_spring", ()):
        springs[physics.place.index] += physics.values["stiffness"]
    for physics in by_name.get("quadratic_drag", ()):
        drag[physics.place.index] += physics.values["coefficient"]
    for physics in by_name.get("constant_force", ()):
        constant[physics.place.index] += physics.values["level"]
    for physics in by_name.get("directional_friction", ()):
        _, _, *viscous[physics.place.index] = physics.values.values()
    interface = device.interface
    amplifier = [
        one("actuator_lag").get("time_constant", 0.0),
        interface.command_step,
        one("dead_band").get("width", 0.0),
        one("gain_asymmetry").get("ratio", 1.0),
        interface.command_limit,
        one("rate_limit").get("rate", math.inf) * interface.period,
    ]
    rectified = float("rectified_sensor" in by_name)
    yields = _yields(by_name)
    filters, reads = _filters(device, n, yields.shape[0])
    truth = Truth(
        masses=masses,
        dampers=dampers,
        springs=springs,
        drag=drag,
        cubic_drag=np.zeros(n),
        links=links,
        yields=yields,
        bristles=_bristles(by_name, masses, interface.period / steps),
        viscous=viscous,
        constant=constant,
        gravity=_rows([p.place.index, *p.vector()] for p in by_name.get("gravity_pendulum", ())),
        ripples=_rows([*p.place.ends, *p.vector()] for p in by_name.get("force_ripple", ())),
        hum=np.array([0.0, 1.0, 0.0]),
        detent=np.array([0.0, 1.0, 1.0]),
        stop=np.array([math.inf, 0.0, 0.0]),
        inertia=np.array([0.0, 1.0]),
        warming=np.array([0.0, 1.0]),
        falling=row("falling_limit", (math.inf, 0.0)),
        amplifier=np.array(amplifier),
        delay=interface.delay,
        sensor=np.array(
            [*row("encoder_eccentricity", (0.0, 1.0, 0.0)), rectified, interface.encoder_step]
        ),
        filters=filters,
        reads=reads,
    )
    return truth if outside is None else _with(truth, outside)


def lost_rate(device: Device) -> float:
    """Return the share of commands that a device loses."""
    named = (p for p in device.physics if p.effect.name == "dropped_samples")
    return next((p.values["rate"] for p in named), 0.0)


def _rows(rows: Iterable[Sequence[float]]) -> Floats:
    """Rows as the integrator takes them, also where there is none."""
    found = [list(row) for row in rows]
    return np.array(found, dtype=np.float64).reshape(len(found), -1 if found else ROW)


def _chain(device: Device, by_name: Mapping[str, list[Physics]]) -> tuple[Floats, Floats, Floats]:
    """Masses, dampers to ground, links: those of the chain, of further masses, cubic ones."""
    chain = device.chain
    masses, dampers = list(chain.masses), list(chain.ground_dampers)
    links: list[list[float]] = []
    gaps = {p.place: p.values["gap"] for p in by_name.get("backlash", ())}
    for i, (k, c) in enumerate(zip(chain.link_springs, chain.link_dampers, strict=True)):
        gap = gaps.get(Place("link", i), 0.0)
        # Masses pull apart: stretch is counted from the first to the second.
        links.append([i, i + 1, k, c, 0.0, gap, 0.0, 1.0])
    for physics in by_name.get("cubic_stiffness", ()):
        links.append([*physics.place.ends, 0.0, 0.0, *physics.values.values(), 0.0, 0.0, 1.0])
    for physics in by_name.get("extra_mode", ()):
        mass, k, c = physics.values.values()
        if mass > 0.0:
            links.append([physics.place.index, len(masses), k, c, 0.0, 0.0, 0.0, 1.0])
            masses.append(mass)
            dampers.append(0.0)
    return np.array(masses), np.array(dampers), np.array(links, dtype=np.float64).reshape(-1, 8)


def _filters(device: Device, masses: int, yields: int) -> tuple[Floats, NDArray[np.int64]]:
    """Rows of filtered readings, and the columns in which each mass of the chain is read."""
    made = [p for p in device.physics if p.effect.follows and p.effect.acts(p.values)]
    n = device.chain.masses.size
    reads, followers, counts = reading(n, masses, [p.place for p in made])
    base = 2 * masses + 1 + yields

    def columns(places: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        own, after = places < masses, base + 2 * (places - masses)
        return np.where(own, places, after), np.where(own, masses + places, after + 1)

    position, rate = columns(followers[:, 1])
    laws = [p.effect.follows(p.values) for p in made if p.effect.follows]
    each = [law for law, count in zip(laws, counts, strict=True) for _ in range(count)]
    numbers = np.array(each, dtype=np.float64).reshape(-1, 4)
    seen = np.stack([columns(reads[0])[0], *columns(reads[1])])
    sources = np.column_stack([position, rate]).astype(np.float64)
    return np.hstack([sources, numbers]), seen


def _yields(by_name: Mapping[str, list[Physics]]) -> Floats:
    rows = [
        [*p.place.ends, *p.values.values()]
        for p in by_name.get("hysteresis", ())
        if p.values["level"] > 0.0
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 5)


def _bristles(by_name: Mapping[str, list[Physics]], masses: Floats, h: float) -> Floats:
    rows: list[list[float]] = []

    def stiff(
        i: int, levels: tuple[float, float, float, float], velocity: float, load: float = 0.0,
        power: float = 2.0,
    ) -> None:  # fmt: skip
        rate, mass = BRISTLE / h, masses[i]
        rows.append([i, mass * rate**2, 2.0 * MICRO * mass * rate, *levels, velocity, load, power])

    for p in by_name.get("coulomb_friction", ()):
        level = p.values["level"]
        stiff(p.place.index, (level, level, level, level), 1.0)
    for p in by_name.get("stribeck_friction", ()):
        level, static, velocity = p.values.values()
        stiff(p.place.index, (level, static, level, static), velocity)
    for p in by_name.get("rising_friction", ()):
        level, static, velocity = p.values.values()
        stiff(p.place.index, (level, static, level, static), velocity, power=1.0)
    for p in by_name.get("directional_friction", ()):
        plus, minus, *_ = p.values.values()
        stiff(p.place.index, (plus, plus, minus, minus), 1.0)
    for p in by_name.get("load_friction", ()):
        stiff(p.place.index, (0.0, 0.0, 0.0, 0.0), 1.0, p.values["ratio"])
    for p in by_name.get("presliding_friction", ()):
        level, stiffness = p.values.values()
        if stiffness > 0.0:
            rows.append([p.place.index, stiffness, 0.0, level, level, level, level, 1.0, 0.0, 2.0])
    return np.array(rows, dtype=np.float64).reshape(-1, 10)


def _with(truth: Truth, outside: Outside) -> Truth:
    values = np.array(list(outside.values.values()))
    match outside.name:
        case "swaying_stiffness":
            links = truth.links.copy()
            if links.shape[0] == 0:
                raise ValueError("swaying_stiffness needs a link; give the device two masses")
            links[0, 6:8] = values
            return truth._replace(links=links)
        case "cubic_drag":
            drag = truth.cubic_drag.copy()
            drag[0] = values[0]
            return truth._replace(cubic_drag=drag)
        case "sagging_drive":
            return truth._replace(sagging=values)
        case "swinging_inertia":
            return truth._replace(inertia=values)
        case "warming_dampers":
            return truth._replace(warming=values)
        case "hum":
            return truth._replace(hum=values)
        case "hard_stop":
            return truth._replace(stop=values)
        case _:
            return truth._replace(detent=values)
