"""Places that only a chain of four or five masses has, and links that ripple: everywhere alike."""

from dataclasses import replace

import numpy as np
import pytest
from diagnosis_examples import record
from physics_examples import EVERYWHERE, EXAMPLES, FARTHER, entry_of, example, five, phantom
from test_lanes import RUNS, assert_equal_runs, varied
from test_population import gain, own_innovations, recorded, start

from zwidth.controllers.excitation import noise
from zwidth.controllers.recorded import recorded as played
from zwidth.diagnosis.noise.settle import refit
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.residual.remainder import response
from zwidth.diagnosis.seeking.candidates import candidates
from zwidth.diagnosis.seeking.places import open_places
from zwidth.diagnosis.seeking.waves import wave_starts
from zwidth.exam.machines import draw_machine
from zwidth.exam.odds import SHARES, choose, clash, sized
from zwidth.planning.limits import SHOWN, limit, sigma
from zwidth.planning.reference import reference
from zwidth.planning.rehearsal import Noise
from zwidth.scenarios.concealed.devices import draw_device
from zwidth.scenarios.concealed.integrator import integrate
from zwidth.scenarios.concealed.shapes import Motion, places
from zwidth.scenarios.concealed.truth import truth_of
from zwidth.sim.chain import make_chain
from zwidth.sim.device import MASSES_IN_ALL, Device, has_room, place_label
from zwidth.sim.device_file import device_from_text, device_to_text
from zwidth.sim.interface import Interface
from zwidth.sim.physics import EFFECTS, make_physics
from zwidth.sim.place import LINKS, MASSES
from zwidth.sim.population import Population, Readings
from zwidth.sim.run import simulate

T, STEPS = 1e-3, 160
MOTION = Motion(0.1, 0.3, 2.0, 0.2, 0.8, 0.5, (3e-4, 6e-4, 5e-4, 4e-4))


@pytest.mark.parametrize(("name", "place"), FARTHER)
def test_lanes_equal_the_scalar_kernel(name: str, place: str) -> None:
    """To the bit. Mutation: `origin` of the first member's table for all."""
    devices = varied(five(), example(name, place), RUNS)
    assert_equal_runs(devices, 2, range(0, RUNS, 5))


@pytest.mark.parametrize(("name", "place"), FARTHER)
def test_every_member_is_predicted_as_if_it_were_alone(name: str, place: str) -> None:
    """To the bit. Mutation: one lane's locked set for all."""
    devices = varied(five(), example(name, place), 3)
    population = Population(devices, 2, 4)
    q = start(population)
    memories = population.start(q, np.zeros_like(q))
    found = population.follow(recorded(), memories, Readings(gain(devices)), keep=True)
    for i, device in enumerate(devices):
        alone_found = own_innovations(device, 2, 4, q[i], gain(devices))
        assert np.array_equal(found.innovations[i], alone_found, equal_nan=True)


@pytest.mark.parametrize(("name", "place"), FARTHER)
def test_every_effect_goes_through_a_device_file(name: str, place: str) -> None:
    device = five().with_physics(example(name, place))
    assert device_from_text(device_to_text(device)) == device
    entry = entry_of(name, place)
    text = "\n".join([device_to_text(five()), "[[physics]]", *entry])
    assert device_from_text(text) == device
    with pytest.raises(ValueError, match=rf"{name}@{place} has no place in a chain of 3 mass"):
        phantom().with_physics(example(name, place))


@pytest.mark.parametrize(
    ("name", "place"), [(n, at) for n, at in FARTHER if EFFECTS[n].sought != "learned"]
)
def test_every_effect_is_that_of_the_other_integrator(name: str, place: str) -> None:
    """On all masses, 1 % of what the effect does there (3 % in free play).

    Mutations: the viscous part of m1 for every mass; a ripple felt by one end of its link.
    """
    u = noise(0.1, 2.0, 100.0, duration=0.4, seed=3)
    still, lost = np.zeros(u.size), np.zeros(u.size, dtype=np.bool_)
    device = five().with_physics(example(name, place))
    truth = truth_of(device, STEPS)
    masses = truth.masses.size
    states = np.zeros((u.size, 2 * masses))
    integrate(truth, T, STEPS, u, np.zeros(2), still, lost, still, still, states)

    def moved(one: Device) -> np.ndarray:
        run = simulate(one, played(u), duration=0.4, substeps=50)
        return np.array([run.trace[f"velocity_m{i + 1}"] for i in range(5)]).T

    theirs = moved(device)
    effect = float(np.linalg.norm(theirs - moved(five())))
    ours = states[:, masses : masses + 5]
    assert effect > 0.0
    assert np.linalg.norm(ours - theirs) < (0.03 if name == "backlash" else 0.01) * effect


def test_the_exam_draws_every_effect_at_every_place() -> None:
    """Mutation: a place left out of an effect's declaration, or an effect without odds."""
    device, random = five(), np.random.default_rng(5)
    possible = {(n, at) for n, at in places(device) if EFFECTS[n].odds}
    assert {at for n, at in possible if n == "force_ripple"} == {*MASSES, *LINKS}
    without = {
        "encoder_step",
        "rectified_sensor",
        "position_servo",
        "servo_limit",
        "servo_dead_zone",
        "servo_integral",
        "goal_rate_limit",
        "falling_limit",
        "open_winding",
        "rate_limit",
        "free_spring",
        "free_damper",
        "free_amplifier",
        "free_sensor",
        "free_force",
        "free_product",
        "free_shift",
    }
    assert {n for n, e in EFFECTS.items() if not e.odds} == without
    drawn = [choose(random, device, []) for _ in range(4000)]
    assert set(drawn) == possible
    for name, at in possible:
        for share in SHARES:
            physics = sized(random, name, at, device, MOTION, share)
            assert physics is not None
            assert (physics.effect.name, physics.at) == (name, at)
            truth = truth_of(device.with_physics(physics), 20)
            assert truth.masses.size >= 5
    shares = np.mean([draw[0] == "backlash" for draw in drawn if draw is not None])
    whole = sum(e.odds for e in EFFECTS.values())
    assert shares == pytest.approx(EFFECTS["backlash"].odds / whole, abs=0.02)


def test_what_is_one_and_the_same_thing_is_not_drawn_twice() -> None:
    """Mutations: families compared without their place; `excludes` one way only."""
    for one, other in (
        (("coulomb_friction", "m4"), ("directional_friction", "m4")),
        (("gravity_pendulum", "m2"), ("constant_force", "m2")),
        (("ground_spring", "m5"), ("gravity_pendulum", "m5")),
        (("hysteresis", "ground"), ("presliding_friction", "m1")),
        (("actuator_lag", "command"), ("loop_delay", "clock")),
        (("force_ripple", "link34"), ("force_ripple", "link34")),
    ):
        assert clash(one, other)
        assert clash(other, one)
    for one, other in (
        (("coulomb_friction", "m4"), ("directional_friction", "m3")),
        (("gravity_pendulum", "m2"), ("constant_force", "m1")),
        (("force_ripple", "link34"), ("force_ripple", "m3")),
        (("force_ripple", "link34"), ("backlash", "link34")),
    ):
        assert not clash(one, other)
    random, taken = np.random.default_rng(2), [("extra_mode", f"m{i}") for i in range(1, 6)]
    drawn = {choose(random, five(), taken) for _ in range(500)}
    assert not {d for d in drawn if d is not None and d[0] == "extra_mode"}
    assert len(drawn) > 20


def test_machines_have_one_to_five_masses() -> None:
    random = np.random.default_rng(4)
    for draw in (lambda: draw_machine(random).device, lambda: draw_device(random)):
        assert {draw().chain.masses.size for _ in range(300)} == {1, 2, 3, 4, 5}


def test_a_recording_says_of_every_place_from_when_it_would_show() -> None:
    """Candidates at every place a device of four masses has; at five sigma what a limit says.

    For a tenth of a second the drive is off: what a winding does then shows nowhere else.

    Mutations: candidates of the first three masses alone; a further mass where there is no room.
    """
    chain = make_chain(
        [5e-4, 4e-4, 3e-4, 4e-4], [4e-3] * 4, 0.0, [60.0, 40.0, 50.0], [4e-3] * 3
    )  # fmt: skip
    device = Device("four masses", "", True, chain, Interface(delay=0.001))
    u = noise(0.2, 0.7, 100.0, duration=2.0, seed=8)
    u[1000:1100] = 0.0
    run = simulate(device, played(u), duration=2.0)
    white = 1e-6 * np.random.default_rng(1).standard_normal(u.size)
    outputs = (Output("position", 0),)
    seen = Experiment(0.001, u, (run.trace["position_m1"] + white)[:, None], outputs)
    seen = replace(seen, strengths=np.where(u == 0.0, 0.0, 1.0))
    known = reference(device, [seen], Noise(1e-4, 1e-6))
    labels = {s.label for s in known.starts}
    assert labels == {
        f"{name}@{at}" for name, at in places(device) if not EFFECTS[name].in_recording
    }
    for name, at in (
        ("force_ripple", "link34"), ("gravity_pendulum", "m4"), ("constant_force", "m3"),
        ("directional_friction", "m2"), ("ground_spring", "m2"), ("extra_mode", "m4"),
        ("open_winding", "m1"), ("rate_limit", "command"), ("falling_limit", "m1"),
    ):  # fmt: skip
        of = [s for s in known.starts if s.label == f"{name}@{at}"]
        found = limit(known, of[len(of) // 2].physics)
        assert found is not None
        assert sigma(known, found) == pytest.approx(SHOWN, rel=0.05)
    extras = [make_physics("extra_mode", f"m{i}", **EXAMPLES["extra_mode"]) for i in range(1, 6)]
    full = five().with_physics(*extras)
    assert full.plant().dof == MASSES_IN_ALL
    assert not has_room(EFFECTS["extra_mode"], MASSES_IN_ALL)
    assert "extra_mode" not in {s.physics.effect.name for s in candidates(full, [seen])}
    assert "extra_mode" not in {effect.name for effect, _ in open_places(full)}


def test_a_ripple_in_a_link_is_started_at_its_period_and_its_place() -> None:
    """Of all masses and links the link gains most. Mutation: the pull of m1 for that of a link."""
    chain = make_chain([5e-4, 8e-4], [4e-3, 4e-3], 0.0, [40.0], [4e-3])
    device = Device("gear", "", True, chain, Interface(delay=0.001))
    ripple = make_physics("force_ripple", "link12", amplitude=0.02, period=0.05, phase=1.0)
    u = noise(0.2, 0.7, 60.0, duration=4.0, seed=8)
    run = simulate(device.with_physics(ripple), played(u), duration=4.0, substeps=10)
    white = 1e-6 * np.random.default_rng(1).standard_normal(u.size)
    outputs = (Output("position", 0),)
    seen = Experiment(0.001, u, (run.trace["position_m1"] + white)[:, None], outputs)
    problem, fitted = refit(device, [seen])
    starts = wave_starts(problem, fitted)
    own = [s for s in starts if s.physics.effect is EFFECTS["force_ripple"]]
    at_link = [s.physics.values["period"] for s in own if s.physics.at == "link12"]
    assert min(abs(p / 0.05 - 1.0) for p in at_link) < 0.05
    weaker = make_physics("force_ripple", "link12", amplitude=0.01, period=0.05, phase=1.0)
    again = wave_starts(*refit(device.with_physics(weaker), [seen]))
    assert {place_label(s.physics) for s in again} >= {"force_ripple@m1"}
    assert "force_ripple@link12" not in {place_label(s.physics) for s in again}


def test_a_pull_in_a_link_is_one_on_each_of_its_masses() -> None:
    """1e-9 of it. Mutation: the first mass alone."""
    problem, fitted = refit(phantom(), [record(phantom(), 1.0)])
    link = response(problem, fitted, "link23")
    ends = response(problem, fitted, "m2") - response(problem, fitted, "m3")
    assert np.abs(link).max() > 0.1 * np.abs(response(problem, fitted, "m3")).max()
    np.testing.assert_allclose(link, ends, rtol=0.0, atol=1e-9 * np.abs(link).max())


def test_farther_places_are_those_of_four_and_five_masses() -> None:
    assert len({*EVERYWHERE, *FARTHER}) == sum(len(e.places) for e in EFFECTS.values())
    assert {at for _, at in FARTHER} == {"m4", "m5", "link34", "link45"}
