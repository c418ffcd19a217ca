"""What an effect does, and the motion with it and without it.

Simulated by the kernel on one mass of 1.5e-3 kg m2 (in a link: with a second mass of 0.8e-3 kg m2
on 12 N m/rad), with a clearly visible size.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.words import effect_in_words
from zwidth.figures.style import AFTER, STYLE, headed
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.equations import equations
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Effect
from zwidth.sim.physics.free_force import grid_values
from zwidth.sim.physics.free_law import table_values
from zwidth.sim.physics.two_tables import two_tables_values
from zwidth.sim.predict import GROUND, Outputs, alone
from zwidth.sim.run import Outcome, Run, Start, simulate, start_memory
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
PERIOD, SECONDS, SUBSTEPS = 0.001, 2.0, 10
MASSES, DAMPERS, LINK = (1.5e-3, 0.8e-3), (4e-3, 2e-3), (12.0, 0.01)


@dataclass(frozen=True)
class Shown:
    """An effect as drawn: its place, its size, and the states over which its law is drawn."""

    at: str
    values: Mapping[str, float]
    over: str = "position"
    top: float = 0.1  # of the command [N m]
    start: float = 0.0  # of m1 [rad]


SHOWN: dict[str, Shown] = {
    "coulomb_friction": Shown("m1", {"level": 0.03}, "velocity"),
    "stribeck_friction": Shown(
        "m1", {"level": 0.02, "static_level": 0.05, "velocity": 1.0}, "velocity"),
    "rising_friction": Shown(
        "m1", {"level": 0.05, "static_level": 0.02, "velocity": 1.0}, "velocity"),
    "presliding_friction": Shown("m1", {"level": 0.03, "stiffness": 0.3}, "position", 0.06),
    "directional_friction": Shown("m1", {"level_plus": 0.04, "level_minus": 0.01,
                                  "viscous_plus": 0.004, "viscous_minus": 0.001}, "velocity"),
    "load_friction": Shown("m1", {"ratio": 0.5}, "command"),
    "quadratic_drag": Shown("m1", {"coefficient": 1e-3}, "velocity"),
    "constant_force": Shown("m1", {"level": 0.02}, "velocity"),
    "ground_spring": Shown("m1", {"stiffness": 0.3}),
    "gravity_pendulum": Shown("m1", {"level": 0.08, "angle": 0.0}, start=2.5),
    "force_ripple": Shown("m1", {"amplitude": 0.03, "period": 1.0, "phase": 0.0}),
    "backlash": Shown("link12", {"gap": 0.1}, "deflection"),
    "cubic_stiffness": Shown("ground", {"coefficient": 0.3}),
    "hysteresis": Shown("ground", {"stiffness": 0.5, "level": 0.05, "shape": 2.0}),
    "extra_mode": Shown("m1", {"mass": 5e-4, "stiffness": 1.0, "damping": 5e-4}),
    "position_servo": Shown("m1", {"stiffness": 1.0, "damping": 0.01, "back_emf": 0.0}, "goal",
                            0.3),
    "servo_limit": Shown("m1", {"limit": 0.04}, "goal", 0.3),
    "servo_dead_zone": Shown("m1", {"half": 0.1}, "goal", 0.3),
    "servo_integral": Shown("m1", {"rate": 3.0, "limit": 0.05}, "goal", 0.3),
    "goal_rate_limit": Shown("command", {"rate": 1.0}, "goal", 0.3),
    "falling_limit": Shown("m1", {"limit": 0.08, "slope": 0.01}, "velocity"),
    "open_winding": Shown("m1", {"damping": 0.8 * DAMPERS[0]}, "velocity", 0.05),
    "saturation": Shown("command", {"limit": 0.06}, "command"),
    "rate_limit": Shown("command", {"rate": 0.4}, "command"),
    "dead_band": Shown("command", {"width": 0.06}, "command"),
    "command_step": Shown("command", {"step": 0.02}, "command"),
    "actuator_lag": Shown("command", {"time_constant": 0.03}, "command"),
    "gain_asymmetry": Shown("command", {"ratio": 2.0}, "command"),
    "loop_delay": Shown("clock", {"delay": 0.03}, "command"),
    "dropped_samples": Shown("clock", {"rate": 0.5}, "command"),
    "encoder_step": Shown("sensor", {"step": 0.3}, "reading"),
    "encoder_eccentricity": Shown(
        "sensor", {"amplitude": 0.2, "period": 2.0, "phase": 0.0}, "reading"),
    "rectified_sensor": Shown("sensor", {}, "reading", start=-0.6),
    "sensor_lag": Shown("sensor", {"time_constant": 0.05}, "reading"),
    "sensor_filter": Shown("sensor", {"time_constant": 0.05, "damping": 0.707}, "reading"),
    "moving_average": Shown("sensor", {"window": 0.1}, "reading"),
    "free_spring": Shown("m1", table_values([(-2.0, 0.02), (-1.0, 0.04), (1.0, -0.04),
                                             (2.0, -0.02)])),
    "free_damper": Shown("m1", table_values([(0.0, 0.0), (2.0, -0.03), (10.0, -0.05)], odd=True),
                         "velocity"),
    "free_amplifier": Shown("command", table_values([(-0.1, 0.02), (0.0, 0.0), (0.05, 0.0),
                                                     (0.1, -0.05)]), "command"),
    "free_sensor": Shown("sensor", table_values([(-1.0, 0.1), (0.0, -0.1), (1.0, 0.2)]),
                         "reading"),
    "free_force": Shown("m1", grid_values(
        ["position", "velocity"], [-1.0, 0.0, 1.0, 2.0], [-10.0, 0.0, 10.0],
        [[0.03, 0.0, -0.03], [0.0, 0.0, 0.0], [0.03, 0.0, -0.03], [0.06, 0.0, -0.06]]),
        "velocity"),
    "free_product": Shown("m1", two_tables_values(
        ["velocity", "position"], [(-10.0, 0.03), (-2.0, 0.02), (2.0, -0.02), (10.0, -0.03)],
        [(-2.0, 2.0), (-1.0, 1.0), (0.0, 0.0), (1.0, 1.0), (2.0, 2.0)]), "velocity"),
    "free_shift": Shown("m1", two_tables_values(
        ["position", "velocity"],
        [(-2.0, 0.0), (-1.0, 0.03), (0.0, 0.0), (1.0, -0.03), (2.0, 0.0), (3.0, 0.03)],
        [(-10.0, -0.5), (0.0, 0.0), (10.0, 0.5)])),
}  # fmt: skip


def effect_figure(effect: Effect) -> Figure:
    """Return a picture of what an effect does, of the motion with it and without, and the change.

    Raises ValueError for a user's own effect, for which no size to draw is known.
    """
    if effect.name not in SHOWN:
        raise ValueError(
            f"there is no picture of {effect.name}, an effect of your own; run the command"
            " without --out"
        )
    shown = SHOWN[effect.name]
    with_it, without = _runs(effect, shown)
    x, y, labels = _law(effect, shown, with_it)
    with rc_context(STYLE):
        figure = Figure(figsize=(7.2, 3.2), layout="constrained")
        places = figure.add_gridspec(2, 2, height_ratios=(2, 1))
        left, right = figure.add_subplot(places[:, 0]), figure.add_subplot(places[0, 1])
        below = figure.add_subplot(places[1, 1], sharex=right)
        reads = effect.hook == "sensor" or effect.follows is not None
        left.plot(x, y, color=AFTER, linewidth=1.2)
        left.xaxis.set_major_locator(MaxNLocator(5))
        if np.ptp(y) < 0.2 * float(np.abs(y).max()):  # so that a constant looks constant
            left.set_ylim(0.0, 1.3 * float(y.max()))
        left.set(xlabel=labels[0], ylabel=labels[1])
        key = "encoder" if reads else "position_m1"
        for run, label, color in ((without, "without", "0.6"), (with_it, "with it", AFTER)):
            right.plot(run.trace.t, run.trace[key], color=color, label=label)
        size = min(with_it.trace.t.size, without.trace.t.size)
        change = with_it.trace[key][:size] - without.trace[key][:size]
        below.plot(with_it.trace.t[:size], change, color=AFTER, linewidth=1.0)
        below.axhline(0.0, color="0.6", linewidth=0.8)
        seen = "reading" if reads else "position of m1"
        right.set(ylabel=f"{seen}\n[rad]")
        right.tick_params(labelbottom=False)
        below.set(xlabel="time [s]", ylabel="change\n[rad]")
        figure.legend(loc="outside lower right", ncols=2)
        headed(figure, f"{effect_in_words(effect.name)} at {shown.at}")
    return figure


def _device(shown: Shown) -> Device:
    two = shown.at == "link12"
    n = 2 if two else 1
    links = ([LINK[0]], [LINK[1]]) if two else ([], [])
    chain = make_chain(list(MASSES[:n]), list(DAMPERS[:n]), 0.0, *links)
    return Device("shown", "", True, chain, Interface(period=PERIOD))


def _runs(effect: Effect, shown: Shown) -> tuple[Run, Run]:
    command, device = _asked(shown), _device(shown)
    if effect.needs == "position_servo":
        device = device.with_physics(
            make_physics("position_servo", "m1", stiffness=1.0, damping=0.01, back_emf=0.0)
        )
    changed = device.with_physics(make_physics(effect.name, shown.at, **shown.values))
    if effect.name == "open_winding":
        return _switched_off(changed, command), _switched_off(device, command)
    with_it, without = (
        simulate(
            d,
            recorded(command),
            duration=SECONDS,
            substeps=SUBSTEPS,
            seed=1,
            start=Start(shown.start),
        )
        for d in (changed, device)
    )
    return with_it, without


def _switched_off(device: Device, command: Floats) -> Run:
    """Return a run whose drive is switched off halfway."""
    seen = Outputs(np.array([0, 1]), np.zeros(2, dtype=np.bool_), np.full(2, GROUND), np.zeros(2))
    eq, on = equations(device, SUBSTEPS), command.size // 2
    strengths = (np.arange(command.size) < on).astype(float)
    silent, blind = np.zeros((command.size, 2)), np.zeros((eq.states, 2))
    memory = start_memory(eq, Start())
    found = -alone(eq, eq, seen, command, silent, blind, np.zeros((0, 1)), memory, strengths)
    channels = {
        "position_m1": found[:, 0], "velocity_m1": found[:, 1], "applied": strengths * command,
    }  # fmt: skip
    units = {"position_m1": "rad", "velocity_m1": "rad/s", "applied": "N m"}
    trace = Trace(PERIOD * np.arange(command.size, dtype=np.float64), channels, units, "simulated")
    return Run(trace, Outcome.COMPLETED, memory, {})


def _asked(shown: Shown) -> Floats:
    """Return the command: a sine of 2 Hz that grows."""
    t = np.arange(round(SECONDS / PERIOD)) * PERIOD
    return shown.top * np.sin(2 * np.pi * 2.0 * t) * (0.4 + 0.6 * t / SECONDS)


def _law(effect: Effect, shown: Shown, run: Run) -> tuple[Floats, Floats, tuple[str, str]]:
    trace = run.trace
    if shown.over == "reading":
        return trace["position_m1"], trace["encoder"], ("position [rad]", "reading [rad]")
    if shown.over == "command" and effect.hook in ("command", "clock", "structure"):
        names = ("command [N m]", "torque of the amplifier [N m]")
        part = slice(-500, None)  # the last wave
        return _asked(shown)[part], trace["applied"][part], names
    if shown.over == "deflection":
        deflection = trace["position_m1"] - trace["position_m2"]
        names = ("deflection of the link [rad]", "torque of the link [N m]")
        return _middle(deflection), _moving(trace, 1), names
    if shown.over == "goal":
        part = slice(50, None)  # after the transient at the beginning
        goal = _asked(shown) / 1.0 - trace["position_m1"]
        names = ("goal - position [rad]", "torque of the servo [N m]")
        return _middle(goal)[part], _moving(trace, 0)[part], names
    force = _moving(trace, 0) - trace["applied"][:-1]
    commanded = shown.over == "command"
    x = trace["command"][:-1] if commanded else _middle(trace[f"{shown.over}_m1"])
    unit = {"position": "rad", "velocity": "rad/s", "command": "N m"}[shown.over]
    return x, force, (f"{shown.over} [{unit}]", "its torque [N m]")


def _moving(trace: Trace, mass: int) -> Floats:
    """Return the mean force on a mass over each tick, its damper's apart.

    Over whole ticks, in which a command is held: momentum and travel give the mean without error,
    where a slope across two ticks mixes two commands.
    """
    velocity, position = (trace[f"{key}_m{mass + 1}"] for key in ("velocity", "position"))
    return (MASSES[mass] * np.diff(velocity) + DAMPERS[mass] * np.diff(position)) / PERIOD


def _middle(x: Floats) -> Floats:
    """Return a signal in the middle of each tick."""
    return 0.5 * (x[1:] + x[:-1])
