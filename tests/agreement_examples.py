"""Drawn devices, and what boundary, map, explorer and single simulations say of their walls."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from engine_examples import coulomb
from numpy.typing import NDArray

from zwidth.controllers.wall import wall
from zwidth.explore.bench import Bench
from zwidth.explore.view import View
from zwidth.scenarios.run_verdict import run_verdict
from zwidth.scenarios.scenario import Scenario, usual_substeps
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.fate import FEW, Fate
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Start
from zwidth.stability.bisection import Bracket, Search, find_brackets
from zwidth.stability.fates import evaluate
from zwidth.stability.judging import Trial
from zwidth.stability.linear import boundary, last_stable_damping
from zwidth.stability.plane import Axis, Plane

Floats = NDArray[np.float64]
MASS, START, LIMIT_S = 0.02, 1e-3, 16.0
SHARES = (0.5, 0.98, 1.02, 1.5)  # of the boundary's K: walls that are asked about
IN_BANDS = (0.5, 0.98, 1.0, 1.0)  # where stiffer walls than the unstable K may hold again
STABLE = (Fate.RESTS, Fate.DITHERS, Fate.FELT)


def drawn_device(rng: np.random.Generator) -> Device:
    """Return a mass of 20 g, with some of encoder, limit, friction, delay, play, filter, steps."""
    has = rng.random(8) < (0.7, 0.4, 0.35, 0.5, 0.25, 0.25, 0.2, 0.15)
    interface: dict[str, Any] = {}
    values = (
        ("encoder_step", 10.0 ** rng.uniform(-7.0, -5.5)),
        ("command_limit", 10.0 ** rng.uniform(0.0, 1.0)),
        ("delay", rng.uniform(0.0, 3e-3)),
        ("velocity_cutoff_hz", rng.uniform(30.0, 300.0)),
        ("command_step", 10.0 ** rng.uniform(-4.0, -2.5)),
    )
    of = (has[0], has[1], has[3], has[5], has[6])
    interface |= {
        name: float(value) for (name, value), there in zip(values, of, strict=True) if there
    }
    if has[7] and not has[5]:
        interface["velocity_ticks"] = int(rng.integers(2, 5))
    damper = float(10.0 ** rng.uniform(-1.5, 0.5))
    level, gap = float(10.0 ** rng.uniform(-3.0, -1.3)), float(10.0 ** rng.uniform(-6.0, -3.5))
    physics = [coulomb(level)] if has[2] else []
    chain = make_chain([MASS], [damper], 0.0)
    if has[4]:
        spring, share = 10.0 ** rng.uniform(3.5, 5.0), rng.uniform(0.2, 0.8)
        masses = [share * MASS, (1.0 - share) * MASS]
        link = 2.0 * rng.uniform(0.05, 0.4) * math.sqrt(spring * masses[0] * masses[1] / MASS)
        chain = make_chain(masses, [damper, 0.3 * damper], 0.0, [float(spring)], [float(link)])
        physics.append(make_physics("backlash", "link12", gap=gap))
    return Device("drawn", "-", False, chain, Interface(**interface), tuple(physics))


@dataclass(frozen=True)
class Asked:
    """A wall: what the boundary makes of it, and the fates by map, explorer, single run."""

    device: Device
    damping: float
    stiffness: float
    stable: bool
    map: Fate
    explorer: Fate
    run: Fate

    @property
    def said(self) -> tuple[Fate, Fate, Fate]:
        """What the three say."""
        return self.map, self.explorer, self.run

    @property
    def agrees(self) -> bool:
        """Whether nothing contradicts the boundary; who has not decided does not."""
        against = (Fate.GROWS,) if self.stable else STABLE
        return not any(fate in against for fate in self.said)

    @property
    def decided(self) -> bool:
        """Whether all have decided."""
        return Fate.UNDECIDED not in self.said


def has_play(device: Device) -> bool:
    """Whether a link of the device has play."""
    return any(physics.effect.name == "backlash" for physics in device.physics)


def has_bands(device: Device, brackets: list[Bracket]) -> bool:
    """Whether walls above the boundary may hold again: play, or a limit within what steps hold."""
    face = device.interface
    largest = max(
        (b.stable + 2.0 * b.damping / face.period for b in brackets if b.stable), default=0
    )
    return has_play(device) or face.command_limit < FEW * face.encoder_step * largest


def dampings_of(device: Device, count: int) -> Floats:
    """Return dampings up to 0.85 of the last that linear theory calls stable."""
    return np.linspace(0.0, 0.85 * (last_stable_damping(device) or 0.0), count)


def brackets_of(device: Device, dampings: Floats, tolerance: float = 5e-3) -> list[Bracket]:
    """Return the boundary as `zwidth boundary` finds it."""
    trial = Trial(START, limit_s=LIMIT_S, substeps=usual_substeps(device))
    return find_brackets([device], [dampings], trial, Search(tolerance))[0]


def asked(device: Device, brackets: list[Bracket]) -> list[Asked]:
    """Ask all about walls beside the boundary, outside a band of 2 % (in bands: at its ends)."""
    known = [b for b in brackets if b.stable is not None and b.unstable is not None]
    shares = IN_BANDS if has_bands(device, known) else SHARES
    damping = np.repeat([b.damping for b in known], len(shares))
    edge = [b.stable if share < 1.0 else b.unstable for b in known for share in shares]
    stiffness = np.tile(shares, len(known)) * np.array(edge, dtype=np.float64)
    stable = np.tile(shares, len(known)) < 1.0
    if not known:
        return []
    trial = Trial(START, limit_s=LIMIT_S, substeps=usual_substeps(device))
    plane = Plane(device, Axis("B", 0.0, 1e3), Axis("K", 1e-3, 1e6), trial=trial)
    view = View(
        start=START, damping_range=(0.0, float(damping.max()) + 1.0),
        stiffness_range=(1.0, float(stiffness.max())),
    )  # fmt: skip
    with np.errstate(over="ignore"):
        mapped = evaluate(plane, damping, stiffness).fate
        explored = evaluate(Bench([device]).plane(view), damping, stiffness).fate
    return [
        Asked(device, b, k, bool(s), Fate(int(m)), Fate(int(e)), single_run(device, b, k))
        for b, k, s, m, e in zip(
            damping.tolist(), stiffness.tolist(), stable, mapped, explored, strict=True
        )
    ]


def steady(one: Asked) -> Asked:
    """Return a wall with an undecided single run if another fate follows after four times as long.

    An irregular cycle about as large as what steps keep up is on one side of that in some windows
    and on the other in others (of 200 devices one has 55 to 59 um, where steps keep up 58 um). So
    it is undecided, too, if its largest and smallest half second since are on both sides.
    """
    longer, sizes = _run(one.device, one.damping, one.stiffness, 4.0 * LIMIT_S)
    kept = FEW * one.device.interface.encoder_step
    crosses = float(sizes.min()) < kept < float(sizes.max())
    return one if longer == one.run and not crosses else replace(one, run=Fate.UNDECIDED)


def single_run(device: Device, damping: float, stiffness: float) -> Fate:
    """Return the fate of a wall by `zwidth simulate`."""
    return _run(device, damping, stiffness, LIMIT_S)[0]


def _run(device: Device, damping: float, stiffness: float, duration: float) -> tuple[Fate, Floats]:
    """The fate of a wall, and half the travel of m1 in each half second of the last 7/8."""
    scenario = Scenario(
        device, wall(stiffness, damping), duration, Start(START), energy="none", bound=1e3
    )
    setup = scenario.prepare()
    (trace, _, outcome), *_ = setup.blocks(setup.ticks)
    found = run_verdict(scenario, trace, outcome)
    assert found is not None
    assert found.fate is not None
    q = trace.channels["position_m1"]
    parts = np.array_split(q, max(1, round(2.0 * duration)))
    return found.fate, np.array([0.5 * np.ptp(part) for part in parts[len(parts) // 8 :]])


def theory_of(device: Device, dampings: Floats) -> Floats:
    """Return K_CR of linear theory, NaN where none."""
    return np.array([point.stiffness or math.nan for point in boundary(device, dampings)])
