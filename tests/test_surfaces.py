"""A law of no name over two states: learned as a product of two, or as a grid, and said so."""

from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from learning_examples import DEVICE, Law, nothing, recording, without_names
from numpy.typing import NDArray

from zwidth.diagnosis.answer.held_out import held_out
from zwidth.diagnosis.answer.laws import LearnedSurface
from zwidth.diagnosis.answer.learned import Asked, learned_over_two
from zwidth.diagnosis.learning.surface_forms import Field, filled, form_of, grid, product, told
from zwidth.diagnosis.mishaps import silent
from zwidth.diagnosis.selection.searched import as_found
from zwidth.figures.learned_surface import law_figure
from zwidth.sim.physics.free_force import counts_at

pytestmark = pytest.mark.truth
Floats = NDArray[np.float64]


def rubs_here(q: float, v: float) -> float:
    """A saturation of the velocity, where a bump of the position says."""
    return -2.4 * float(np.exp(-0.5 * ((q - 0.02) / 0.06) ** 2)) * float(np.tanh(3.0 * v))


def leans(q: float, v: float) -> float:
    """A sine of the position whose place moves with the velocity: no product."""
    return 1.5 * float(np.sin(9.0 * q + 2.0 * np.tanh(2.0 * v)))


@cache
def surface_of(law: Law) -> LearnedSurface | None:
    quick = without_names(law)
    judge = [recording(law).split()[1]]
    found = as_found(DEVICE, quick)
    free = held_out(DEVICE, found, judge)[1]
    assert learned_over_two(Asked(DEVICE, found, judge, silent), free, None) is None  # nobody asked
    search = replace(quick, effort=replace(quick.effort, surfaces=True))
    found = as_found(DEVICE, search)
    return learned_over_two(
        Asked(DEVICE, found, judge, silent), held_out(DEVICE, found, judge)[1], None
    )


def errs(law: Law, found: LearnedSurface) -> float:
    """By how much a surface errs along the samples over the law, both without a plane."""
    seen = found.curve.seen
    truth = np.array([law(q, v) for q, v in seen.tolist()])
    flat = np.column_stack([np.ones(truth.size), seen])
    off = [x - flat @ np.linalg.lstsq(flat, x, rcond=None)[0]
           for x in (found.curve.at(*seen.T) - truth, truth)]  # fmt: skip
    return float(np.std(off[0]) / np.std(off[1]))


def test_a_product_of_two_laws_is_learned_with_the_formula_of_each() -> None:
    """Mutations that break it: no product; its points are not chosen; a plane is not taken off."""
    found = surface_of(rubs_here)
    assert found is not None
    assert found.curve.physics.effect.name == "free_product"
    assert (found.curve.physics.at, found.curve.states) == ("m1", ("position", "velocity"))
    assert errs(rubs_here, found) < 0.03
    assert found.law.after < 0.05 * found.names.after
    (bump, *_), (turns, *_) = found.forms
    assert (bump.form.name, turns.form.name) == ("bump", "saturation")
    assert bump.numbers["m"] == pytest.approx(0.02, abs=0.002)
    assert abs(bump.numbers["w"]) == pytest.approx(0.06, rel=0.05)
    assert turns.numbers["w"] == pytest.approx(1.0 / 3.0, rel=0.05)
    assert abs(bump.numbers["a"] * turns.numbers["a"]) == pytest.approx(2.4, rel=0.05)
    assert "a bump of position times a saturation of velocity" in found.headline(1)
    assert "never generates energy" in found.energy


def test_the_band_of_a_product_holds_it() -> None:
    """Mutations that break it: the band of either table alone; nothing for what points are few."""
    found = surface_of(rubs_here)
    assert found is not None
    seen = found.curve.seen
    truth = np.array([rubs_here(q, v) for q, v in seen.tolist()])
    flat = np.column_stack([np.ones(truth.size), seen])
    off = found.curve.at(*seen.T) - truth
    off -= flat @ np.linalg.lstsq(flat, off, rcond=None)[0]
    half = found.curve.half(*seen.T) + 0.001 * np.abs(truth).max()
    assert np.mean(np.abs(off) < half) > 0.9


def test_a_law_that_another_state_shifts_is_learned_with_the_formula_of_each() -> None:
    """Mutations that break it: no shift; one along straight lines alone; positions from anywhere.

    The bands hold it where it was.
    """
    found = surface_of(leans)
    assert found is not None
    assert found.curve.physics.effect.name == "free_shift"
    assert found.curve.states == ("position", "velocity")
    assert errs(leans, found) < 0.03
    assert found.law.after < 0.02 * found.names.after
    (sine, *_), (turns, *_) = found.forms
    assert (sine.form.name, turns.form.name) == ("sine from rest", "saturation")
    assert sine.numbers["w"] == pytest.approx(1.0 / 9.0, rel=0.05)
    assert sine.numbers["a"] == pytest.approx(1.5, rel=0.05)
    assert turns.numbers["a"] == pytest.approx(2.0 / 9.0, rel=0.05)
    assert turns.numbers["w"] == pytest.approx(0.5, rel=0.05)
    said = "a sine from rest of position shifted by a saturation of velocity"
    assert said in found.headline(1)
    assert found.as_json()["formulas"][0]["form"] == "shift"


def test_nothing_is_learned_where_nothing_is_missing() -> None:
    assert surface_of(nothing) is None


@pytest.mark.parametrize("law", [rubs_here, leans])
def test_its_picture_has_titles_and_units(law: Law) -> None:
    found = surface_of(law)
    assert found is not None
    figure = law_figure(found, rotary=False)
    texts = {axes.get_xlabel() for axes in figure.axes} | {a.get_ylabel() for a in figure.axes}
    assert {"position [mm]", "velocity [m/s]", "law [N]"} <= texts
    assert figure.axes[0].get_title(loc="left") == "Unnamed law of position and velocity at m1"


def test_what_a_grid_does_not_see_is_laid_smoothly() -> None:
    """Of a plane of which a corner is not known that corner goes on evenly.

    Mutation that breaks it: unknown forces left as they are.
    """
    forces = np.add.outer(np.arange(4.0), np.arange(4.0))
    known = np.ones((4, 4), dtype=bool)
    known[1, 1] = known[2, 2] = False
    laid = filled(np.where(known, forces, 99.0), known)
    np.testing.assert_allclose(laid, forces, atol=1e-12)  # inside, a plane is its neighbours' mean
    assert np.array_equal(filled(forces, known)[known], forces[known])


def test_only_points_that_enough_samples_are_nearest_to_are_told() -> None:
    axis = np.array([0.0, 1.0, 2.0])
    near = partial(np.tile, reps=(12, 1))
    seen = np.concatenate([near(np.array([[0.1, 1.9]])), np.array([[2.0, 0.0]] * 3)])
    expected = np.zeros((3, 3), dtype=bool)
    expected[0, 2] = True
    assert np.array_equal(told(seen, axis, axis), expected)


def field_of(rows: Floats, columns: Floats, floats: bool) -> Field:
    """Where every point of a grid but its last corner was visited often."""
    every = np.array([(a, b) for a in rows for b in columns][:-1])
    return Field("m1", ("velocity", "command"), np.repeat(every, 12, axis=0), 1.0, floats)


@pytest.mark.parametrize("floats", [False, True])
@pytest.mark.parametrize("times", [False, True])
def test_a_law_of_fewer_points_has_the_numbers_that_are_said_of_it(
    times: bool, floats: bool
) -> None:
    """Numbers z = c + B y of the law of y, at what is free, are what that law gives there.

    Mutations that break it: the largest share at the end of a fit taken for the one that was held;
    a force that is held laid smoothly; what a grid does not see left as it was.
    """
    random = np.random.default_rng(5)
    rows, columns = np.sort(random.uniform(-1.0, 1.0, 6)), np.sort(random.uniform(-2.0, 2.0, 5))
    field = field_of(rows, columns, floats)
    if times:
        law = product(
            field, rows, random.normal(size=6), columns, np.array([0.2, 1.0, 0.5, 3.0, 0.1])
        )
        free = [name for name in form_of(law).names if name != "second_2"]  # held, and outgrown
    else:
        law = grid(field, rows, columns, random.normal(size=(6, 5)))
        free = list(form_of(law).scales(field))
        assert len(free) == 29 - int(floats)
    form = form_of(law)
    kept = form.kept(field, free)
    first = np.unique([0, 2, 3, 5, max(kept[0], 0)])
    second = np.unique([0, 2, 4, max(kept[1], 0)])
    few = form.fewer(field, free, first, second)
    y = random.normal(size=few.basis.shape[1])
    if times:
        other = form_of(few.law(y))
        told_by = few.offset + few.basis @ y
        np.testing.assert_allclose(other.at(rows, np.full(6, columns[1])), told_by[:6], atol=1e-12)
        share = other.at(np.full(5, rows[0]), columns) / other.at(rows[:1], columns[1:2])
        np.testing.assert_allclose(np.delete(share, 1), told_by[6:], atol=1e-12)
    else:
        a, b = np.meshgrid(rows, columns, indexing="ij")
        cells = np.isin(np.array(form.names), free)
        given = form_of(few.law(y)).at(a, b).ravel()
        np.testing.assert_allclose(given[cells], few.offset + few.basis @ y, atol=1e-12)
        if floats:
            assert given.reshape(6, 5)[kept] == pytest.approx(
                law.values[form.names[kept[0] * 5 + kept[1]]]
            )


def test_points_of_an_axis_count_one_together() -> None:
    counts = counts_at(np.array([-1.0, 0.2, 3.0]), np.linspace(-2.0, 4.0, 31))
    np.testing.assert_allclose(counts.sum(axis=-1), 1.0, atol=1e-12)
