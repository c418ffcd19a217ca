"""Every effect at every place it may enter, with starts over the magnitudes the data could show.

Magnitudes come from the recording: F the rms of the command, V and Q the rms speed and position of
m1 over the recording, the rms deflections of links as an observer follows them, T the period. Each
start has the scale by which its parameters are of order one; a scale of 0 holds a parameter fixed.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from zwidth.diagnosis.experiment import Experiment
from zwidth.diagnosis.predictor import SETTLING, followed, observer_near
from zwidth.diagnosis.steady import NoObserver
from zwidth.sim.device import Device, masses_needed, place_label
from zwidth.sim.physics import EFFECTS, make_physics
from zwidth.sim.physics.effect import Effect, Physics

# Of a scale along a line less than one wave in all its travel is a bend, not an eccentricity.
ECCENTRIC = (1.2, 0.9, 0.7, 0.5, 0.2, 0.07)  # of the travel; what is shorter the residual shows
FOLLOWING = 1e-2  # ratio of the observer that deflections are taken from
QUARTER = 0.5 * math.pi
SHARES = (0.001, 0.004, 0.015, 0.06, 0.2)
# Parameters that scale the effect's whole signature, to first order.
MAGNITUDE = {
    "coulomb_friction": ("level",),
    "stribeck_friction": ("level", "static_level"),
    "presliding_friction": ("level", "stiffness"),
    "directional_friction": ("level_plus", "level_minus", "viscous_plus", "viscous_minus"),
    "quadratic_drag": ("coefficient",),
    "constant_force": ("level",),
    "ground_spring": ("stiffness",),
    "gravity_pendulum": ("level",),
    "force_ripple": ("amplitude",),
    "backlash": ("gap",),
    "cubic_stiffness": ("coefficient",),
    "hysteresis": ("level", "stiffness"),
    "extra_mode": ("mass", "stiffness", "damping"),
    "dead_band": ("width",),
    "actuator_lag": ("time_constant",),
    "loop_delay": ("delay",),
    "encoder_eccentricity": ("amplitude",),
}
# A richer effect contains a simpler one and can never explain less: within five sigma the simpler
# is meant, and the richer is named as a rival without making the verdict doubtful.
CONTAINED = {
    "coulomb_friction": {
        "stribeck_friction", "presliding_friction", "directional_friction", "hysteresis",
    },
    "constant_force": {"directional_friction", "gravity_pendulum"},
    "ground_spring": {"gravity_pendulum", "hysteresis", "extra_mode"},
    "quadratic_drag": {"directional_friction"},
    "presliding_friction": {"hysteresis"},
}  # fmt: skip
NOT_BY_FIT = ("dropped_samples", "rectified_sensor")


@dataclass(frozen=True)
class Start:
    """One effect at one place with starting values, and the scales of its free parameters."""

    physics: Physics
    scales: dict[str, float]

    @property
    def label(self) -> str:
        """effect@place."""
        return place_label(self.physics)

    def scaled(self, factor: float) -> "Start | None":
        """Return the start with the effect a factor as strong, None where that has no meaning."""
        names = MAGNITUDE.get(self.physics.effect.name)
        if self.physics.effect.name == "gain_asymmetry":  # from one on
            ratio = 1.0 + factor * (self.physics.values["ratio"] - 1.0)
            changed = (
                replace(self.physics, values={"ratio": ratio}) if 1e-3 <= ratio <= 1e3 else None
            )
            return changed and Start(changed, {"ratio": factor * self.scales["ratio"]})
        if names is None:
            return None
        values = {k: v * factor if k in names else v for k, v in self.physics.values.items()}
        scales = {k: v * factor if k in names else v for k, v in self.scales.items()}
        bounds = {p.name: (p.lower, p.upper) for p in self.physics.effect.parameters}
        if not all(bounds[k][0] <= v <= bounds[k][1] for k, v in values.items()):
            return None
        return Start(replace(self.physics, values=values), scales)


@dataclass(frozen=True)
class Magnitudes:
    """What the recording moves by: force, speed, position rms; largest command; span; period.

    stretches: rms deflection of every link, as an observer follows it: far less than the force over
    its spring where the end is light, and more at a resonance.
    """

    force: float
    speed: float
    position: float
    peak: float
    span: float
    period: float
    mass: float
    stretches: tuple[float, ...]

    def reach(self, at: str) -> float:
        """Rms position of m1 for what ties it to ground, rms deflection of a link."""
        return self.stretches[int(at[4]) - 1] if at.startswith("link") else self.position


def magnitudes(device: Device, experiments: Sequence[Experiment]) -> Magnitudes:
    """Return the magnitudes over all experiments."""
    command = np.concatenate([e.command for e in experiments])
    positions, speeds = [], []
    for e in experiments:
        for o, output in enumerate(e.outputs):
            y = e.measured[:, o]
            if output.quantity == "position":
                smooth = np.convolve(y, np.full(5, 0.2), "valid")
                positions.append(y)
                speeds.append(np.gradient(smooth) / e.period)
            else:
                speeds.append(y)
                positions.append(np.cumsum(y) * e.period)
    q, v = np.concatenate(positions), np.concatenate(speeds)
    return Magnitudes(
        float(np.sqrt(np.mean(command**2))),
        float(np.std(v)),
        float(np.std(q)),
        float(np.abs(command).max()),
        float(np.ptp(q)),
        experiments[0].period,
        float(device.chain.masses.sum()),
        _stretches(device, experiments, float(np.sqrt(np.mean(command**2)))),
    )


def _stretches(
    device: Device, experiments: Sequence[Experiment], force: float
) -> tuple[float, ...]:
    """Rms deflection of every link; what the force gives at rest, where no observer follows."""
    chain, links = device.chain, device.chain.masses.size - 1
    at_rest = force / np.asarray(chain.link_springs[:links], dtype=np.float64)
    if not links:
        return ()
    bare = device.without_physics() if device.physics else device
    try:
        gain = observer_near(bare, experiments[0], FOLLOWING)
    except NoObserver:
        return tuple(at_rest.tolist())
    with np.errstate(all="ignore"):
        x = np.concatenate([followed(bare, e, gain)[SETTLING:] for e in experiments])
        found = np.std(x[:, :links] - x[:, 1 : links + 1], axis=0)
    usable = np.isfinite(found) & (found > 0.0)
    return tuple(np.where(usable, found, at_rest).tolist())


def candidates(device: Device, experiments: Sequence[Experiment]) -> list[Start]:
    """Return all starts for a device and its recordings."""
    size = magnitudes(device, experiments)
    present = {place_label(p) for p in device.physics}
    found: list[Start] = []
    for effect in EFFECTS.values():
        if effect.name in NOT_BY_FIT or (effect.rotary_only and not device.rotary):
            continue
        for at in effect.places:
            if masses_needed(at) > device.chain.masses.size or f"{effect.name}@{at}" in present:
                continue
            if any(f"{simple}@{acts_on(at)}" in present for simple in simpler(effect.name)):
                continue
            for values, scales in _starts(effect, at, size, device):
                if home_taken(effect, at, device):
                    continue
                if not all(p.lower <= values[p.name] <= p.upper for p in effect.parameters):
                    continue  # a start from very stiff links may lie beyond what is allowed
                physics = make_physics(effect.name, at, **values)
                found.append(Start(physics, scales))
    return found


def acts_on(at: str) -> str:
    """Return the mass or link that an effect at a place acts on: what ties m1 to ground, on m1."""
    return "m1" if at == "ground" else at


def simpler(name: str) -> list[str]:
    """Return the effects that an effect contains."""
    return [simple for simple, richer in CONTAINED.items() if name in richer]


def home_taken(effect: Effect, at: str, device: Device) -> bool:
    """Whether the device already has the quantity that this effect would set."""
    interface = device.interface
    if effect.name == "saturation":
        return math.isfinite(interface.command_limit)
    if effect.name in ("encoder_step", "command_step"):
        return getattr(interface, effect.name) > 0.0
    # With a spring to ground, the recording's origin is fitted: the same as a constant force.
    sprung = device.chain.ground_spring > 0.0
    return sprung and (effect.name, at) in (("ground_spring", "m1"), ("constant_force", "m1"))


def _held(device: Device, z: Magnitudes, at: str) -> float:
    """Rms force: of a link's spring, of the command at ground."""
    if at == "ground":
        return z.force
    return float(device.chain.link_springs[int(at[4]) - 1]) * z.reach(at)


Values = tuple[dict[str, float], dict[str, float]]


def _starts(effect: Effect, at: str, z: Magnitudes, device: Device) -> Iterator[Values]:
    f, v, q = z.force, z.speed, z.position
    name = effect.name
    if name == "coulomb_friction":
        for s in SHARES:
            yield {"level": s * f}, {"level": s * f}
    elif name == "stribeck_friction":
        for s in (0.01, 0.06, 0.2):
            for part in (0.03, 0.3):
                level = {"level": s * f, "static_level": 1.6 * s * f}
                yield (
                    level | {"velocity": part * v},
                    {k: 0.5 * x for k, x in level.items()} | {"velocity": 0.5 * part * v},
                )
    elif name == "presliding_friction":
        for s in (0.01, 0.06, 0.2):
            for reach in (0.01, 0.1):
                yield (
                    {"level": s * f, "stiffness": s * f / (reach * q)},
                    {"level": 0.5 * s * f, "stiffness": 0.5 * s * f / (reach * q)},
                )
    elif name == "directional_friction":
        for s in (0.01, 0.06, 0.2):
            drag = 0.3 * s * f / v
            yield (
                {"level_plus": s * f, "level_minus": s * f, "viscous_plus": drag,
                 "viscous_minus": 0.5 * drag},
                {"level_plus": s * f, "level_minus": s * f, "viscous_plus": drag,
                 "viscous_minus": drag},
            )  # fmt: skip
    elif name == "quadratic_drag":
        for s in (0.004, 0.06):  # what is linear in its strength needs few
            yield {"coefficient": s * f / v**2}, {"coefficient": s * f / v**2}
    elif name == "constant_force":
        for s in (0.01, -0.01):
            yield {"level": s * f}, {"level": abs(s) * f}
    elif name == "ground_spring":
        for s in (0.01, 0.1):
            yield {"stiffness": s * f / q}, {"stiffness": s * f / q}
    elif name == "gravity_pendulum":
        for s in (0.01, 0.1, 0.5):
            for angle in (0.0, QUARTER):
                yield {"level": s * f, "angle": angle}, {"level": s * f, "angle": 0.5}
    elif name == "force_ripple":
        # A start must lie within a fraction of a wave over all travel: the residual's own spectrum
        # (`waves`) shows the shorter ones.
        for period in np.geomspace(z.span / 9.0, z.span / 1.8, 7):
            for phase in (0.0, QUARTER):
                yield (
                    {"amplitude": 0.02 * f, "period": float(period), "phase": phase},
                    {"amplitude": 0.02 * f, "period": 0.02 * float(period), "phase": 0.5},
                )
    elif name == "backlash":
        # From a part of what the spring gives way to what a lightly driven device rattles in.
        reach = z.reach(at)
        for gap in np.geomspace(0.003 * reach, max(0.3 * reach, 0.03 * q), 6):
            yield {"gap": float(gap)}, {"gap": float(gap)}
    elif name == "cubic_stiffness":
        reach, size = z.reach(at), _held(device, z, at)
        for s in (3e-4, -3e-4, 0.01, -0.01, 0.2, -0.2):
            yield {"coefficient": s * size / reach**3}, {"coefficient": abs(s) * size / reach**3}
    elif name == "hysteresis":
        reach, size = z.reach(at), _held(device, z, at)
        for s in (0.03, 0.15):
            for part in (0.1, 0.5):
                k = s * size / (part * reach)
                yield (
                    {"stiffness": k, "level": s * size, "shape": 1.5},
                    {"stiffness": 0.5 * k, "level": 0.5 * s * size, "shape": 0.5},
                )
    elif name == "extra_mode":
        for share in (0.02, 0.15):
            mass = share * z.mass
            for hertz in np.geomspace(6.0, 0.4 / z.period, 6):
                k = mass * (2.0 * math.pi * float(hertz)) ** 2
                b = 0.1 * math.sqrt(k * mass)
                yield (
                    {"mass": mass, "stiffness": k, "damping": b},
                    {"mass": 0.5 * mass, "stiffness": 0.5 * k, "damping": b},
                )
    elif name == "saturation":
        for s in (0.97, 0.85, 0.7, 0.5, 0.3):
            yield {"limit": s * z.peak}, {"limit": 0.05 * z.peak}
        for s in (0.5, 0.2):  # of a command that bursts, far below its peak
            if s * f < 0.2 * z.peak:
                yield {"limit": s * f}, {"limit": 0.2 * s * f}
    elif name == "dead_band":
        for s in SHARES:
            yield {"width": s * f}, {"width": s * f}
    elif name == "command_step":
        for s in (0.003, 0.01, 0.03, 0.1):
            yield {"step": s * f}, {"step": 0.1 * s * f}
    elif name == "actuator_lag":
        for s in (0.05, 0.3, 1.5, 8.0, 30.0):
            yield {"time_constant": s * z.period}, {"time_constant": s * z.period}
    elif name == "gain_asymmetry":
        for s in (-0.1, -0.01, 0.01, 0.1):
            yield {"ratio": 1.0 + s}, {"ratio": abs(s)}
    elif name == "loop_delay":
        for s in (0.05, 0.3, 1.0, 3.0, 12.0):
            yield {"delay": s * z.period}, {"delay": min(s, 0.3) * z.period}
    elif name == "encoder_step":
        for s in (1e-5, 1e-4, 1e-3):
            yield {"step": s * z.span}, {"step": 0.1 * s * z.span}
    elif name == "encoder_eccentricity":
        shares = [s for s in ECCENTRIC if device.rotary or s < 1.0]
        turn = [2.0 * math.pi] if device.rotary else []
        for period in (*(z.span * s for s in shares), *turn):
            for phase in (0.0, QUARTER):
                yield (
                    {"amplitude": 1e-3 * z.span, "period": period, "phase": phase},
                    {"amplitude": 1e-3 * z.span, "period": 0.1 * period, "phase": 0.5},
                )
