"""What a picture of a diagnosis shows: of a long series, of no samples; in which colours."""

import re
from pathlib import Path

import numpy as np
import pytest

import zwidth
from zwidth.diagnosis.answer.friction_curve import FrictionCurve
from zwidth.diagnosis.learning.together import Together
from zwidth.figures.diagnosis import COLUMNS, envelope
from zwidth.figures.friction_curve import friction_curve_figure
from zwidth.sim.place import Place


@pytest.mark.parametrize("size", [2 * COLUMNS + 1, 10_000, 123_457])
def test_an_envelope_loses_no_swing(size: int) -> None:
    """A single sample that stands out is drawn, wherever it is, and time rises.

    Mutations that break it: every n-th sample; the highest value of a column alone.
    """
    t = np.arange(size, dtype=np.float64)
    random = np.random.default_rng(1)
    for k in (0, 1, size // 3, size - 1):
        values = random.normal(size=size)
        values[k] = -50.0
        at, drawn = envelope(t, values)
        assert at.size <= 2 * COLUMNS
        assert np.all(np.diff(at) >= 0.0)
        assert drawn.min() == -50.0
        assert drawn.max() == values.max()
        np.testing.assert_array_equal(drawn, values[at.astype(int)])


def test_a_short_series_stays_as_it_is() -> None:
    """And what is not finite hides nothing. Mutation: `argmin` of a column with a nan."""
    t = np.arange(2.0 * COLUMNS)
    assert envelope(t, t)[1] is t
    values = np.full(10 * COLUMNS, np.nan)
    values[5] = 3.0
    assert 3.0 in envelope(np.arange(values.size, dtype=np.float64), values)[1]


def test_colours_come_from_the_one_style_file() -> None:
    """Mutation: a picture with a blue of its own."""
    folder = Path(zwidth.__file__).parent
    files = [*(folder / "figures").glob("*.py"), *(folder / "paper").glob("*.py")]
    own = re.compile(r"[\"']#[0-9a-fA-F]{6}[\"']")
    wrong = [p.name for p in files if p.name != "style.py" and own.search(p.read_text("utf-8"))]
    assert wrong == []


def test_a_free_motion_has_no_samples_in_its_legend() -> None:
    """Mutation: an empty series is drawn, and named."""
    states = np.array([-1.0, -0.1, 0.1, 1.0])
    force = -np.sign(states)
    whole = Together(
        ("coulomb_friction",), states, force, force - 0.1, force + 0.1, 0.0025 * np.eye(4)
    )
    none = np.zeros(0)
    figure = friction_curve_figure(FrictionCurve(whole, Place("mass"), none, none), rotary=True)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert len(labels) == 1
    assert "Coulomb" in labels[0]


def test_samples_on_a_friction_curve_are_said_to_be_there() -> None:
    """Most of them at rest, to both sides. Mutation: the law interpolated through zero speed."""
    states = np.array([-1.0, -0.5, 0.5, 1.0])
    force = -0.1 * np.sign(states)
    whole = Together(
        ("coulomb_friction",), states, force, force - 0.01, force + 0.01, 0.0025 * np.eye(4)
    )
    v = np.concatenate([np.linspace(-1.0, 1.0, 100), np.tile([-0.01, 0.01], 400)])
    curve = FrictionCurve(whole, Place("mass"), v, -0.1 * np.sign(v))
    labels = [t.get_text() for t in friction_curve_figure(curve, True).legends[0].get_texts()]
    assert labels[0] == "torque needed at each sample (on the curve)"
