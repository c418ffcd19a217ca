"""What every effect says of itself to a search: starts, sweep, bounds, priors, what it contains."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from physics_examples import EVERYWHERE, example, phantom

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.seeking.magnitude import magnitude, strengthened
from zwidth.diagnosis.seeking.places import open_places
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import EFFECTS, RICHER_FORMS, contains, make_physics, richer_at
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.sizes import QUARTER, SMALLEST, Sizes
from zwidth.sim.place import LINKS, MASSES, Place, label_of, of_label, place_at
from zwidth.sim.run import simulate

SIZES = Sizes(
    rotary=True, period=1e-3, force=0.1, peak=0.3, speed=2.0, position=0.2, span=0.8,
    masses=(2e-4, 9e-4, 7e-5), speeds=(2.0, 1.9, 1.8), positions=(0.2, 0.2, 0.19),
    spans=(0.8, 0.8, 0.7), fastest=(9.0, 8.0, 7.0), springs=(217.0, 14.5), stretches=(3e-4, 6e-4),
    rates_beside=True, switched=True,
)  # fmt: skip
SOUGHT = [n for n, effect in EFFECTS.items() if effect.sought not in ("given", "learned")]
SOUGHT_BY_VALUES = [
    (n, at) for n, at in EVERYWHERE if n in SOUGHT and EFFECTS[n].sought != "folding"
]


def test_places_are_read_as_they_are_written():
    """Mutation: a link's second mass left out of `masses_needed`."""
    assert [str(place_at(at)) for at in (*MASSES, *LINKS)] == [*MASSES, *LINKS]
    assert place_at("link23") == Place("link", 1)
    assert [place_at(at).ends for at in ("m3", "link23", "ground", "command")] == [
        (2, -1), (1, 2), (0, -1), (0, -1),
    ]  # fmt: skip
    assert [place_at(at).masses_needed for at in ("m3", "link23", "ground", "clock")] == [
        3,
        3,
        1,
        1,
    ]
    assert place_at("ground").acts_on == place_at("m1")
    assert of_label(label_of("backlash", Place("link"))) == ("backlash", Place("link"))
    for wrong in ("m0", "link13", "link", "engine"):
        with pytest.raises(ValueError, match=f"at is '{wrong}'; it must be a mass"):
            place_at(wrong)


@pytest.mark.parametrize(("name", "at"), SOUGHT_BY_VALUES)
def test_starts_and_sweep_are_what_a_device_may_have(name: str, at: str):
    """Within what physics allows of this recording, and of scales that are no zero.

    Mutations: a sweep of play up to twice the travel; a scale left out.
    """
    effect, place = EFFECTS[name], place_at(at)
    bounds = effect.within(SIZES, place)
    assert bounds.keys() == {p.name for p in effect.parameters}
    for values, scales in (*effect.starts(SIZES, place), *effect.sweep(SIZES, place)):
        Physics(effect, at, values)
        assert all(bounds[k][0] <= v <= bounds[k][1] for k, v in values.items())
        assert all(scale > 0.0 for scale in scales.values())
        assert scales.keys() <= values.keys()
        assert not effect.forbidden(values)


@pytest.mark.parametrize(("name", "at"), SOUGHT_BY_VALUES)
def test_a_sweep_goes_from_hardly_anything_to_the_most(name: str, at: str):
    """By equal ratios, over two decades at least.

    Mutations: `up_to` in equal steps; rates compared with the largest command.
    """
    effect, place = EFFECTS[name], place_at(at)
    swept = [Physics(effect, at, values) for values, _ in effect.sweep(SIZES, place)]
    strengths = sorted({round(magnitude(p, SIZES.peak) or 0.0, 12) for p in swept})
    assert 6 <= len(strengths) <= 30
    assert strengths[0] <= 2.0 * SMALLEST * strengths[-1]
    assert all(more < 12.0 * less for less, more in pairwise(strengths))


@pytest.mark.parametrize("name", SOUGHT)
def test_an_effect_says_how_likely_and_how_strong_it_is(name: str):
    effect = EFFECTS[name]
    for at in effect.places:
        assert 0.0 < effect.prior_at(place_at(at)) < 0.5
    assert effect.prior >= effect.prior_at(place_at(effect.places[-1]))
    assert (effect.strength is None) is (not effect.parameters)
    assert set(effect.contains) < EFFECTS.keys()
    if effect.strength is not None:
        assert effect.natural(SIZES, place_at(effect.places[0])) > 0.0


@pytest.mark.parametrize(("name", "at"), EVERYWHERE)
def test_twice_as_strong_is_twice_as_strong(name: str, at: str):
    """Mutation: a gain's ratio counted from zero."""
    physics = example(name, at)
    twice = strengthened(physics, 2.0, 0.03)
    if physics.effect.strength is None:
        assert twice is None
        return
    assert twice is not None
    once = magnitude(physics, 0.03)
    assert once is not None
    assert magnitude(twice, 0.03) == pytest.approx(2.0 * once, rel=1e-12)


@pytest.mark.parametrize("name", [n for n, e in EFFECTS.items() if e.turning])
def test_what_turns_is_started_a_quarter_turn_apart(name: str):
    """Between two such starts lies every phase. Mutation: one phase alone."""
    effect = EFFECTS[name]
    (turning,) = effect.turning
    there = [at for at in map(place_at, effect.places) if at.masses_needed <= len(SIZES.masses)]
    for at in there:
        phases = {values[turning] for values, _ in effect.starts(SIZES, at)}
        assert phases == {0.0, QUARTER}


@pytest.mark.parametrize("name", [n for n, e in EFFECTS.items() if e.sought == "waves"])
def test_a_wave_says_its_period(name: str):
    assert {"period", "phase"} < {p.name for p in EFFECTS[name].parameters}


CASES = {  # richer effect, its values -> simpler one, its values
    "stribeck_friction": (
        {"level": 2e-3, "static_level": 2e-3, "velocity": 0.05},
        "coulomb_friction", {"level": 2e-3},
    ),
    "rising_friction": (
        {"level": 2e-3, "static_level": 2e-3, "velocity": 0.05},
        "coulomb_friction", {"level": 2e-3},
    ),
    "presliding_friction": (
        {"level": 2e-3, "stiffness": 2e3}, "coulomb_friction", {"level": 2e-3},
    ),
    "directional_friction": (
        {"level_plus": 2e-3, "level_minus": 2e-3, "viscous_plus": 0.0, "viscous_minus": 0.0},
        "coulomb_friction", {"level": 2e-3},
    ),
    "gravity_pendulum": (
        {"level": 1e-3, "angle": -QUARTER}, "constant_force", {"level": 1e-3},
    ),
    "force_ripple": (
        {"amplitude": 1e-3, "period": 2.0 * np.pi, "phase": 0.3 + np.pi},
        "gravity_pendulum", {"level": 1e-3, "angle": 0.3},
    ),
    "hysteresis": (
        {"stiffness": 0.5, "level": 1e4, "shape": 1.5}, "ground_spring", {"stiffness": 0.5},
    ),
    "extra_mode": (
        {"mass": 1e5, "stiffness": 0.5, "damping": 0.0}, "ground_spring", {"stiffness": 0.5},
    ),
    "sensor_filter": (
        {"time_constant": 0.01 / np.sqrt(12.0), "damping": np.sqrt(0.75)},
        "moving_average", {"window": 0.01},
    ),
    "falling_limit": ({"limit": 0.02, "slope": 0.0}, "saturation", {"limit": 0.02}),
}  # fmt: skip


@pytest.mark.parametrize("name", [n for n, e in EFFECTS.items() if e.contains])
def test_a_richer_effect_is_at_some_values_the_simpler_one(name: str):
    """Within 3 % of what the simpler one does. Mutation: `contains` of a drag, for hysteresis.

    A weight whose lever lies level is a constant force while the device hardly turns; a wave as
    long as a turn is a weight, half a turn on; a spring that yields nowhere, and a mass too heavy
    to move, are a spring to ground.
    """
    richer, simple, values = CASES[name]
    device = phantom()
    u = 0.02 * np.random.default_rng(1).standard_normal(400)
    at = EFFECTS[name].places[0]
    there = at if EFFECTS[name].follows else "command" if simple == "saturation" else "m1"
    assert contains(name, place_at(at), simple, place_at(there))

    def moved(*physics: Physics) -> np.ndarray:
        run = simulate(device.with_physics(*physics), recorded(u), duration=0.4, substeps=20)
        return run.trace["encoder" if EFFECTS[name].follows else "velocity_m1"]

    without, own = moved(), moved(make_physics(simple, there, **values))
    found = moved(Physics(EFFECTS[name], at, richer))
    assert np.linalg.norm(found - own) < 0.03 * np.linalg.norm(own - without)


def test_what_contains_an_effect_acts_where_it_does():
    """Mutations: a place compared as it is written; a pendulum on a device without an angle."""
    found = richer_at("ground_spring", place_at("m1"), rotary=True)
    assert {(e.name, str(at)) for e, at in found} == {
        ("gravity_pendulum", "m1"), ("hysteresis", "ground"), ("extra_mode", "m1"),
    }  # fmt: skip
    assert "gravity_pendulum" not in {
        e.name for e, _ in richer_at("ground_spring", place_at("m1"), rotary=False)
    }
    assert not contains("hysteresis", place_at("ground"), "coulomb_friction", place_at("m2"))
    assert not contains("hum", place_at("m1"), "coulomb_friction", place_at("m1"))
    assert RICHER_FORMS["backlash"] == ()


def test_physics_sets_bounds_by_what_was_recorded():
    """Mutations: any of the bounds taken out of its effect's file."""
    asked = {
        "dead_band@command": ("width", 0.6), "saturation@command": ("limit", 0.3),
        "backlash@link12": ("gap", 0.8), "stribeck_friction@m2": ("velocity", 8.0),
        "force_ripple@m1": ("period", 0.8 / 1.5), "loop_delay@clock": ("delay", 0.05),
        "coulomb_friction@m1": ("level", 0.3), "hysteresis@ground": ("shape", 10.0),
    }  # fmt: skip
    for label, (name, most) in asked.items():
        effect, place = of_label(label)
        assert EFFECTS[effect].within(SIZES, place)[name][1] == pytest.approx(most)
    assert EFFECTS["coulomb_friction"].within(SIZES, place_at("m3"))["level"][1] == 1e6


def test_a_fit_stays_within_them():
    """Also a start beyond a bound may be fitted. Mutation: bounds not handed to the model."""
    effect = EFFECTS["backlash"]
    for gap, most in ((0.1, 0.8), (1.0, 1.0)):
        physics = make_physics("backlash", "link12", gap=gap)
        bounds = effect.within(SIZES, physics.place)
        model = Model(phantom()).with_effect(physics, {"gap": 0.1}, bounds)
        gone = model.with_effect(example("dead_band"), {"width": 1e-3}).without_effect(1)
        for one in (model, gone):
            parameter = one.parameters[-1]
            assert gap + 0.1 * parameter.upper == pytest.approx(most)
            assert gap + 0.1 * parameter.lower == pytest.approx(0.0)
            assert parameter.ends == ("upper",)


@pytest.mark.parametrize("name", SOUGHT)
def test_a_drawn_effect_is_one_that_a_device_may_have(name: str):
    random = np.random.default_rng(3)
    effect = EFFECTS[name]
    for at in (p for p in effect.places if place_at(p).masses_needed <= len(SIZES.masses)):
        physics = Physics(effect, at, effect.drawn(random, SIZES, place_at(at)))
        assert not effect.forbidden(dict(physics.values))
        assert not math.isnan(sum(physics.values.values()))


def test_a_drawn_limit_that_falls_with_speed_falls():
    """Without a slope it is a saturation, and no diagnosis could name it."""
    drawn = EFFECTS["falling_limit"].drawn(np.random.default_rng(3), SIZES, place_at("m1"))
    assert 0.25 <= drawn["slope"] * SIZES.fastest[0] / drawn["limit"] <= 0.67


def test_links_are_held_by_their_springs():
    assert SIZES.held(Place("link", 1)) == 14.5 * 6e-4
    assert SIZES.held(Place("ground")) == SIZES.force
    assert replace(SIZES, masses=(1.0, 2.0)).mass == 3.0


def test_a_constant_force_is_sought_where_a_spring_to_ground_bends() -> None:
    """Beside a straight spring it is the origin of the position. Mutation: known of both alike."""
    straight = Device(
        "oscillator", "a test", False, make_chain([0.5], [0.8], ground_spring=200.0),
        Interface(period=1e-3, delay=0.0),
    )  # fmt: skip
    bent = straight.with_physics(make_physics("cubic_stiffness", "ground", coefficient=1e4))

    def sought(device: Device) -> set[str]:
        return {f"{effect.name}@{place}" for effect, place in open_places(device)}

    assert "constant_force@m1" not in sought(straight)
    assert "constant_force@m1" in sought(bent)
    assert "ground_spring@m1" not in sought(bent)
