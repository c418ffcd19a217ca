"""Dry friction of every kind: complementarity, sticking, sliding, and truths computed apart."""

import itertools
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from physics_examples import phantom
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq

from zwidth.controllers.none import none
from zwidth.diagnosis.noise.predictor import Fineness, innovations, prepared
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.equations import Equations, equations
from zwidth.sim.kernel import advance, scratch
from zwidth.sim.physics import make_physics
from zwidth.sim.plant import hold, locked
from zwidth.sim.run import Start, simulate, start_memory

Floats = np.ndarray
MASS, VISCOUS = 1e-3, 2e-3


def one_mass(damper: float = 0.0, spring: float = 0.0) -> Device:
    """Return a device of one mass."""
    return Device("one mass", "", True, make_chain([MASS], [damper], spring))


def _chain_of_three(rng: np.random.Generator) -> Device:
    chain = make_chain(
        10.0 ** rng.uniform(-4, -3, 3), 10.0 ** rng.uniform(-4, -2, 3), 0.0,
        10.0 ** rng.uniform(0, 2.4, 2), 10.0 ** rng.uniform(-4, -2, 2),
    )  # fmt: skip
    return replace(phantom(), chain=chain, modal=None)


def _after_a_substep(eq: Equations, x: Floats, external: Floats) -> Floats:
    memory = start_memory(eq, Start(list(x[:3]), list(x[3:])))
    empty, fine = np.zeros((0, 0)), np.zeros((0, 6))
    law = none()
    advance(
        eq, law.step, law.parameters, memory, scratch(eq), 1, external[None, :], 1e9, empty, fine,
        False,
    )  # fmt: skip
    return memory.x[:6].copy()


def _solutions(w: Floats, v: Floats, lower: Floats, upper: Floats) -> Iterator[Floats]:
    """All f in its bounds with v + w f = 0, or f at a bound and v against it: every case tried."""
    for choice in itertools.product((-1, 0, 1), repeat=v.size):
        case = np.array(choice)
        f = np.where(case < 0, lower, np.where(case > 0, upper, 0.0))
        stopped = np.flatnonzero(case == 0)
        if stopped.size:
            f[stopped] = np.linalg.solve(w[np.ix_(stopped, stopped)], -(v + w @ f)[stopped])
        end = v + w @ f
        if np.all((lower <= f) & (f <= upper)) and np.all((case * end)[case != 0] <= 0.0):
            yield f


def _only(solutions: Iterator[Floats]) -> Floats:
    (f, *others) = solutions
    assert all(np.allclose(f, other, rtol=1e-6) for other in others)
    return f


def _turning(
    start: Floats, w: Floats, v: Floats, f: Floats, levels: Floats, went: Floats, places: Floats
) -> tuple[Floats, Floats]:
    """Bounds of the mean force, of masses that turn after a share of the substep too.

    The share: where a cubic of time in position is flat, that begins and ends at the places and
    speeds of the masses under the friction before, less what is forgotten of it by the end. went:
    how far they go under f; places: the response of that to a held force.
    """
    before = -np.sign(start) * levels
    end = v + w @ f + np.diag(w) * (before - f)
    went = went + np.diag(places) * (before - f)
    share = np.zeros(start.size)
    for i in np.flatnonzero(end * start < 0.0):
        cubic = CubicHermiteSpline([0.0, 1e-3], [0.0, went[i]], [start[i], end[i]])
        (flat,) = cubic.derivative().roots(extrapolate=False)
        s = flat / 1e-3
        forgotten = 12.0 * (places[i, i] / (1e-3 * w[i, i]) - 0.5)
        share[i] = s - 0.5 * forgotten * s * (1.0 - s)
    return share * before - (1.0 - share) * levels, share * before + (1.0 - share) * levels


@pytest.mark.parametrize("masses", [(0, 1), (0, 2), (0, 1, 2)])
def test_friction_solves_the_complementarity_problem(masses: tuple[int, ...]) -> None:
    """1000 random states each, held against trying all cases; 1e-9 of the velocities.

    Some masses start at rest, under loads that lock them or not. Mutation: MAX_SWEEPS = 3, or the
    sweeps without the velocities of the other masses (`j != i` dropped): 1e-3 and more.
    """
    rng = np.random.default_rng(len(masses))
    stopped = turned = 0
    for _ in range(20):
        device = _chain_of_three(rng)
        levels = 10.0 ** rng.uniform(-3, -1, len(masses))
        frictions = (
            make_physics("coulomb_friction", f"m{i + 1}", level=f)
            for i, f in zip(masses, levels, strict=True)
        )
        eq = equations(device.with_physics(*frictions))
        plant = device.plant()
        dry = np.array(masses)
        holds = {
            mask: hold(locked(plant, tuple(dry[np.array(mask)].tolist())), 1e-3)
            for mask in itertools.product((False, True), repeat=dry.size)
        }
        for _ in range(50):
            b = holds[(False,) * dry.size][1]
            x = np.concatenate([rng.normal(size=3) * 1e-4, np.zeros(3)])
            x[3:] = rng.normal(size=3) * (np.abs(b[3:, 1:][:, dry]) @ levels)
            x[3:] *= rng.random(3) < 0.7
            external = rng.normal(size=3) * 0.03
            load = -plant.matrices.stiffness @ x[:3] - plant.matrices.damping @ x[3:] + external
            at_rest = (x[3 + dry] == 0.0) & (np.abs(load[dry]) <= levels)
            a, b = holds[tuple(at_rest.tolist())]
            free = a @ x + b[:, 1:] @ external
            moving, bounds = dry[~at_rest], levels[~at_rest]
            w = b[3:, 1:][np.ix_(moving, moving)]
            f = _only(_solutions(w, free[3 + moving], -bounds, bounds))
            response = b[:3, 1:][np.ix_(moving, moving)]
            went = free[moving] + response @ f - x[moving]
            lower, upper = _turning(x[3 + moving], w, free[3 + moving], f, bounds, went, response)
            turned += np.count_nonzero(upper - lower < 1.99 * bounds)
            f = _only(_solutions(w, free[3 + moving], lower, upper))
            expected = free + b[:, 1 + moving] @ f
            inside = (f - lower > 1e-3 * bounds) & (upper - f > 1e-3 * bounds)
            stopped += np.count_nonzero(inside)
            found = _after_a_substep(eq, x, external)
            scale = np.abs(x[3:]).max() + np.abs(free[3:]).max()
            np.testing.assert_allclose(found[3:], expected[3:], rtol=0.0, atol=1e-9 * scale)
            assert np.array_equal(found[dry[at_rest]], x[dry[at_rest]])
            assert not found[3 + dry[at_rest]].any()
            assert not found[3 + moving[inside]].any()
    assert stopped > 200
    assert turned > 200


def _exact(level: float, loads: Floats) -> Floats:
    """Positions of one mass at every tick: v' = (F - level sign v - c v) / m, from turn to turn."""
    q = v = 0.0
    rate, found = VISCOUS / MASS, np.zeros(loads.size)
    for k, load in enumerate(loads):
        left, found[k] = 1e-3, q
        while left > 0.0:
            if v == 0.0 and abs(load) <= level:
                break
            side = np.sign(v) if v != 0.0 else np.sign(load)
            steady = (load - level * side) / VISCOUS
            turns = np.log1p(-v / steady) / rate if v * steady < 0.0 else np.inf
            dt = min(left, turns)
            fallen = -np.expm1(-rate * dt)
            q += steady * dt + (v - steady) * fallen / rate
            v = 0.0 if turns <= left else v + (steady - v) * fallen
            left -= dt
    return found


def test_a_turn_inside_a_substep_is_third_order() -> None:
    """Errors of each tick's way fall eightfold with each halving.

    Mutations: no `turn`: twofold; masses that turned not put where they are (`placed`), a
    line for the parabola (`bend` zero), nothing forgotten by the end of a substep: fourfold.
    """
    level = 2e-3
    loads = np.repeat(np.random.default_rng(3).normal(size=400) * 6e-3, 5)
    device = one_mass(VISCOUS).with_physics(make_physics("coulomb_friction", "m1", level=level))
    truth = _exact(level, loads)
    errors: list[float] = []
    for substeps in (2, 4, 8, 16):
        run = simulate(
            device, none(), duration=2.0, substeps=substeps, disturbance=loads, bound=1e9
        )
        errors.append(float(np.linalg.norm(np.diff(run.trace["position_m1"] - truth))))
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert np.all((ratios > 6.5) & (ratios < 9.5)), (errors, ratios)


def test_stribeck_slides_steadily_where_drive_is_viscosity_and_friction() -> None:
    """1e-9 of v. Mutation: exp(-v/v_s) instead of the square: 1e-2."""
    values = {"level": 2e-3, "static_level": 4e-3, "velocity": 0.5}
    device = one_mass(VISCOUS).with_physics(make_physics("stribeck_friction", "m1", **values))

    def surplus(v: float, force: float) -> float:
        return force - VISCOUS * v - 2e-3 - 2e-3 * np.exp(-((v / 0.5) ** 2))

    for force in (4.5e-3, 6e-3, 1e-2):
        v = brentq(surplus, 0.55, 10.0, args=(force,), xtol=1e-14)
        run = simulate(
            device, none(), duration=12.0, start=Start(0.0, 1.0), substeps=2, bound=1e9,
            disturbance=np.full(12000, force),
        )  # fmt: skip
        assert run.trace["velocity_m1"][-1] == pytest.approx(v, rel=1e-9)


def test_stribeck_breaks_away_at_its_static_level() -> None:
    """Exactly: a load up to it moves nothing, more does. Mutation: sliding bounds of `level`."""
    values = {"level": 2e-3, "static_level": 4e-3, "velocity": 0.05}
    device = one_mass(VISCOUS).with_physics(make_physics("stribeck_friction", "m1", **values))
    ramp = np.linspace(0.0, 5e-3, 501)
    run = simulate(device, none(), duration=0.501, disturbance=ramp)
    moved = run.trace["position_m1"][1:] != 0.0
    assert np.array_equal(moved, ramp[:-1] > 4e-3)


def test_rising_friction_creeps_at_the_speed_whose_friction_is_the_load() -> None:
    """1e-9 of v, from below and from above, between the levels and beyond both.

    Mutation: exp(-(v/v_s)^2): 0.3. Mutation: level and static level exchanged: it does not hold.
    """
    values = {"level": 4e-3, "static_level": 1e-3, "velocity": 0.2}
    device = one_mass(VISCOUS).with_physics(make_physics("rising_friction", "m1", **values))

    def surplus(v: float, force: float) -> float:
        return force - VISCOUS * v - 4e-3 + 3e-3 * np.exp(-v / 0.2)

    for force in (1.5e-3, 3e-3, 8e-3):
        v = brentq(surplus, 0.0, 10.0, args=(force,), xtol=1e-14)
        for begun in (0.0, 1.5):
            run = simulate(
                device, none(), duration=12.0, start=Start(0.0, begun), substeps=2, bound=1e9,
                disturbance=np.full(12000, force),
            )  # fmt: skip
            assert run.trace["velocity_m1"][-1] == pytest.approx(v, rel=1e-9)


def test_rising_friction_holds_up_to_its_static_level() -> None:
    """Exactly: a load up to it moves nothing, more does. Mutation: sticking bounds of `level`."""
    values = {"level": 4e-3, "static_level": 2e-3, "velocity": 0.05}
    device = one_mass(VISCOUS).with_physics(make_physics("rising_friction", "m1", **values))
    ramp = np.linspace(0.0, 5e-3, 501)
    run = simulate(device, none(), duration=0.501, disturbance=ramp)
    moved = run.trace["position_m1"][1:] != 0.0
    assert np.array_equal(moved, ramp[:-1] > 2e-3)


def test_a_mass_that_sticks_by_its_static_level_does_not_move_at_all() -> None:
    """m2 swings against a stuck m1, loads between level and static level: not one bit changes.

    Mutation: the sticking bounds those of `level`: m1 is stopped every substep and creeps.
    """
    values = {"level": 1e-4, "static_level": 0.1, "velocity": 0.1}
    device = phantom().with_physics(make_physics("stribeck_friction", "m1", **values))
    start = Start([0.0, 2e-4, 2e-4])
    run = simulate(device, none(), duration=0.1, start=start, substeps=4)
    assert np.ptp(run.trace["position_m2"]) > 1e-4
    assert not run.trace["position_m1"].any()


def test_stick_slip_slips_by_twice_the_excess_over_the_spring() -> None:
    """A spring drawn at speed V, without damping: the classical slip, 2 (f_s - f_c) / k for V -> 0.

    From u' + V = 0 with u = -a cos wt - (V/w) sin wt, a = (f_s - f_c) / k, the slip lasts until
    tan(w t / 2) = -a w / V. 0.5 %: the drive goes in steps, the curve has a width. Mutation: level
    and static level exchanged: no stick-slip at all.
    """
    spring, drop, drive = 5.0, 2e-3, 1e-3
    a, w = drop / spring, np.sqrt(spring / MASS)
    t = 2.0 * (np.pi - np.arctan(a * w / drive)) / w
    expected = drive * t + a * (1.0 - np.cos(w * t)) - drive / w * np.sin(w * t)
    assert expected == pytest.approx(2.0 * a, rel=0.1)
    values = {"level": 4e-3, "static_level": 6e-3, "velocity": 1e-4}
    device = one_mass(0.0, spring).with_physics(make_physics("stribeck_friction", "m1", **values))
    ramp = np.linspace(0.0, spring * drive * 4.0, 4000, endpoint=False)
    run = simulate(device, none(), duration=4.0, disturbance=ramp, substeps=50)
    q = run.trace["position_m1"]
    resting = np.flatnonzero(run.trace["at_rest"] == 1.0)
    levels = q[resting[np.flatnonzero(np.diff(resting) > 1)]]
    slips = np.diff(levels)
    assert slips.size >= 3
    np.testing.assert_allclose(slips, expected, rtol=5e-3)


def test_stribeck_decay_is_that_of_an_integrator_with_events() -> None:
    """Free decay on a spring to its last stop, 1e-4 of the start. Mutation: g with |v|, not v^2."""
    spring, start = 2.0, 0.02
    values = {"level": 2e-3, "static_level": 3.5e-3, "velocity": 0.2}
    device = one_mass(VISCOUS, spring).with_physics(
        make_physics("stribeck_friction", "m1", **values)
    )
    run = simulate(device, none(), duration=1.5, start=Start(start), substeps=100)

    def slope(_: float, x: Floats, side: float) -> list[float]:
        g = 2e-3 + 1.5e-3 * np.exp(-((x[1] / 0.2) ** 2))
        return [x[1], (-spring * x[0] - VISCOUS * x[1] - side * g) / MASS]

    def stops(_: float, x: Floats, side: float) -> float:
        return x[1] * side

    stops.terminal, stops.direction = True, -1  # pyright: ignore[reportFunctionMemberAccess]
    event: Any = stops
    q, t, turns = start, 0.0, []
    while abs(spring * q) > 3.5e-3:
        side = -np.sign(q)
        part = solve_ivp(
            slope, (t, 2.0), [q, side * 1e-12], args=(side,), events=event, rtol=1e-10, atol=1e-13
        )
        q, t = float(part.y[0, -1]), float(part.t[-1])
        turns.append(q)
    assert len(turns) >= 3
    velocity = run.trace["velocity_m1"]
    assert velocity[-1] == 0.0
    assert run.trace["position_m1"][-1] == pytest.approx(q, abs=1e-4 * start)


def test_directional_friction_has_two_terminal_velocities_and_a_lopsided_band() -> None:
    """(|F| - level) / (b + viscous), 1e-9. Mutation: plus and minus exchanged."""
    values = {"level_plus": 2e-3, "level_minus": 5e-3, "viscous_plus": 3e-3, "viscous_minus": 1e-3}
    device = one_mass(VISCOUS).with_physics(make_physics("directional_friction", "m1", **values))
    for force, v in ((8e-3, 6e-3 / 5e-3), (-8e-3, -3e-3 / 3e-3)):
        run = simulate(device, none(), duration=10.0, disturbance=np.full(10000, force), bound=1e9)
        assert run.trace["velocity_m1"][-1] == pytest.approx(v, rel=1e-9)
    for force, moves in ((2e-3, False), (2.001e-3, True), (-5e-3, False), (-5.001e-3, True)):
        run = simulate(device, none(), duration=0.1, disturbance=np.full(100, force))
        assert bool(run.trace["position_m1"][-1]) == moves


def test_directional_friction_coasts_to_a_stop_by_its_own_law() -> None:
    """v = (v_0 + f/b) exp(-b t / m) - f/b, 1e-6. Mutation: viscosity of the other direction."""
    values = {"level_plus": 2e-3, "level_minus": 5e-3, "viscous_plus": 3e-3, "viscous_minus": 9e-3}
    device = one_mass().with_physics(make_physics("directional_friction", "m1", **values))
    for v0, level, viscous in ((1.0, 2e-3, 3e-3), (-1.0, 5e-3, 9e-3)):
        run = simulate(device, none(), duration=0.5, start=Start(0.0, v0), substeps=20)
        speed = (1.0 + level / viscous) * np.exp(-viscous * run.trace.t / MASS) - level / viscous
        expected = np.copysign(np.maximum(speed, 0.0), v0)
        np.testing.assert_allclose(run.trace["velocity_m1"], expected, rtol=0.0, atol=1e-6)
        assert run.trace["velocity_m1"][-1] == 0.0


def test_directional_friction_contains_coulomb_and_a_constant_force() -> None:
    """Bounds f_c +- d are Coulomb's f_c and a constant -d, also when it sticks."""
    values = {"level_plus": 5e-3, "level_minus": 1e-3, "viscous_plus": 0.0, "viscous_minus": 0.0}
    one = phantom().with_physics(make_physics("directional_friction", "m1", **values))
    two = phantom().with_physics(
        make_physics("coulomb_friction", "m1", level=3e-3),
        make_physics("constant_force", "m1", level=-2e-3),
    )
    push = 0.01 * np.sin(np.arange(400) * 0.05)
    runs = [simulate(d, none(), duration=0.4, disturbance=push, substeps=5) for d in (one, two)]
    assert np.count_nonzero(runs[0].trace["at_rest"].astype(int) & 1) > 20
    np.testing.assert_allclose(
        runs[0].trace["position_m1"], runs[1].trace["position_m1"], rtol=0.0, atol=1e-14
    )


def test_friction_of_any_viscosity_stops_and_never_throws_back() -> None:
    """b h / m = 100. Mutation: `slide` takes the bound whatever it does to the velocity."""
    values = {"level_plus": 0.0, "level_minus": 0.0, "viscous_plus": 100.0, "viscous_minus": 100.0}
    device = one_mass().with_physics(make_physics("directional_friction", "m1", **values))
    run = simulate(device, none(), duration=0.02, start=Start(0.0, 1.0))
    assert np.all(run.trace["velocity_m1"] >= 0.0)
    assert run.trace["velocity_m1"][-1] == 0.0


def test_predictions_put_a_mass_where_a_turn_leaves_it() -> None:
    """A mass is predicted eight times as well with half as long substeps, and not four times.

    Held against the exact way of each tick. Mutations that break it: `placed` left out of the
    prediction: fourfold; a line for the parabola (`bend` zero) in a viscous fluid: fourfold.
    """
    level, ticks = 2e-3, 1500
    loads = np.repeat(np.random.default_rng(3).normal(size=ticks // 5) * 6e-3, 5)
    device = one_mass(VISCOUS).with_physics(make_physics("coulomb_friction", "m1", level=level))
    truth = _exact(level, loads)
    e = Experiment(1e-3, loads, np.zeros((ticks, 1)), (Output("position", 0),))
    errors: list[float] = []
    for substeps in (1, 2, 4, 8):
        ready = prepared(device, Fineness(substeps, substeps))
        went = -innovations(device, e, np.zeros((2, 1)), ready=ready)[:, 0]
        errors.append(float(np.linalg.norm(np.diff(went - truth))))
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert np.all(ratios > 6.0), (errors, ratios)
