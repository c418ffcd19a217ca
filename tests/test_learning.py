"""A law of no name is learned as a curve, beside and in the place of names."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from learning_examples import DEVICE, Floats, Law, T, nothing, recording, without_names

from zwidth.diagnosis.answer.learned import Asked, learned
from zwidth.diagnosis.answer.result import HeldOut
from zwidth.diagnosis.learning.curves import Learned, learn
from zwidth.diagnosis.learning.energy import makes_energy
from zwidth.diagnosis.learning.formulas import formulas
from zwidth.diagnosis.learning.tables import law_at
from zwidth.diagnosis.mishaps import silent
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.selection.searched import as_found
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface

pytestmark = pytest.mark.truth


def cube(_: float, v: float) -> float:
    return -0.5 * v**3


def well(q: float, _: float) -> float:
    return 3.0 * float(np.exp(-0.5 * ((q - 0.02) / 0.06) ** 2))


def weaves(_: float, v: float) -> float:
    return float(np.sin(7.0 * v))


def errs(q: Floats) -> Floats:
    return 0.02 * np.exp(-0.5 * ((q - 0.02) / 0.06) ** 2)


@cache
def curve_of(law: Law) -> Learned | None:
    return learn(without_names(law), silent)


def test_the_cube_of_a_velocity_is_learned_and_called_so() -> None:
    """Mutations that break it: no odd laws; the law not in the place where it gains most."""
    curve = curve_of(cube)
    assert curve is not None
    assert (curve.physics.effect.name, curve.physics.at, curve.odd) == ("free_damper", "m1", True)
    truth = np.array([cube(0.0, v) for v in curve.states])
    straight = curve.states  # the damper's, which nothing tells from the law's own
    bent = curve.forces - truth
    bent = bent - straight * (straight @ bent) / (straight @ straight)
    assert np.abs(bent).max() < 0.02 * np.abs(truth).max()
    assert np.all((curve.lower <= truth) & (truth <= curve.upper))
    (like, *_) = formulas(curve.states, curve.forces, curve.covariance, curve.odd)
    assert like.form.name in ("cube", "power", "line and cube")
    grid = np.linspace(-2.0, 2.0, 9)
    np.testing.assert_allclose(law_at(curve.physics, -grid), -law_at(curve.physics, grid))


def test_a_law_of_position_is_learned_where_it_is() -> None:
    curve = curve_of(well)
    assert curve is not None
    assert (curve.physics.effect.name, curve.physics.at) == ("free_spring", "m1")
    (like, *_) = formulas(curve.states, curve.forces, curve.covariance, curve.odd)
    assert like.form.name == "bump"  # beside an offset, which is another origin of the spring
    assert like.numbers["a"] == pytest.approx(3.0, rel=0.05)
    assert abs(like.numbers["w"]) == pytest.approx(0.06, rel=0.05)


def test_a_law_that_swings_several_times_over_its_state_is_learned() -> None:
    """Four periods over the velocities that were seen.

    Mutation that breaks it: no sine among the forms of odd laws.
    """
    curve = curve_of(weaves)
    assert curve is not None
    assert (curve.physics.effect.name, curve.physics.at) == ("free_damper", "m1")
    (like, *_) = formulas(curve.states, curve.forces, curve.covariance, curve.odd)
    assert like.form.name in ("sine", "sine from rest")
    assert like.numbers["w"] == pytest.approx(1.0 / 7.0, rel=0.02)
    assert like.numbers["a"] == pytest.approx(1.0, rel=0.1)


def test_what_a_reading_errs_by_is_learned() -> None:
    """Mutation that breaks it: no law over what a sensor reads."""
    e = recording(nothing, 7)
    e = replace(e, measured=e.measured + errs(e.measured))
    model = Model(DEVICE)
    plain = settled(judged([e.split()[0]], model, np.zeros(len(model.parameters))))
    curve = learn(Search(plain, plain, QUICK, silent), silent)
    assert curve is not None
    assert (curve.physics.effect.name, curve.physics.at) == ("free_sensor", "sensor")
    assert "through the drive" in makes_energy(curve, False)
    low, high = np.quantile(e.measured, (0.02, 0.98)).tolist()
    q = np.linspace(low, high, 60)
    off = law_at(curve.physics, q) - errs(q)
    columns = np.column_stack([np.ones_like(q), q])  # an origin and a scale, which nothing tells
    off -= columns @ np.linalg.lstsq(columns, off, rcond=None)[0]
    assert np.abs(off).max() < 0.1 * errs(q).max()


def test_nothing_is_learned_where_nothing_is_missing() -> None:
    """Mutation that breaks it: points at no cost."""
    assert curve_of(nothing) is None


@pytest.mark.parametrize(("names", "worth"), [(0.5, True), (1e-9, False)])
def test_a_law_is_kept_where_held_out_data_agree(names: float, worth: bool) -> None:
    found = as_found(DEVICE, without_names(cube))
    held = [recording(cube).split()[1]]
    free = HeldOut(1.0, 1.0, names, 1e-5)
    law = learned(Asked(DEVICE, found, held, silent), free)
    assert (law is not None) is worth
    if law is None:
        return
    assert law.law.after < 0.01
    first = law.headline(1)
    assert first.startswith("a force outside the library of effects acts at the motor: it reaches")
    assert " and depends on velocity, and looks like a" in first
    assert law.worth.endswith("with the learned law, 50 % without")
    assert law.worth not in first
    assert "a force at m1 that depends on velocity, and looks like -0." in law.sentence
    said = law.as_json()
    assert said["formula"].endswith("v^3") or "|v|^" in said["formula"]
    assert len(said["points"]) == law.curve.states.size


def test_a_command_that_counts_for_more_is_no_law() -> None:
    """Half as much again of every command is a scale, whatever the device file says of masses.

    Mutation that breaks it: no straight line in the place of what was learned.
    """
    e = recording(nothing, 5)
    less = replace(e, command=e.command / 1.5)
    stiff = Device("mass", "", False, make_chain([0.5], [0.8], 30.0), Interface(period=T))
    known = replace(stiff, uncertainty=replace(stiff.uncertainty, masses=1e-3, springs=1e-3,
                                               dampers=1e-3))  # fmt: skip
    model = Model(known)
    plain = settled(judged([less], model, np.zeros(len(model.parameters))))
    said: list[str] = []
    assert learn(Search(plain, plain, QUICK, silent), said.append) is None
    assert any("straight line" in s for s in said)
