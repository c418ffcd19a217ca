"""`zwidth explore` without a browser: views and their addresses, what is computed and shown."""

import math
from dataclasses import replace
from pathlib import Path
from urllib.parse import parse_qs

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

pytest.importorskip("bokeh", reason="needs the extra zwidth[explore]")

from zwidth.cli import run
from zwidth.explore.bench import Bench, Line
from zwidth.explore.look import columns, fitting, look, reach, spectrum
from zwidth.explore.picture import picture
from zwidth.explore.plane_figure import bounded
from zwidth.explore.stops import decades, stops
from zwidth.explore.tooltips import sized
from zwidth.explore.view import LAYERS, View, read_query
from zwidth.explore.words import of_the_plane, of_the_recording
from zwidth.figures.map import COLOURS
from zwidth.scenarios.paddle import paddle_boundary
from zwidth.scenarios.scenario_file import scenario_from_text, scenario_to_text
from zwidth.sim.device_file import load_device, save_device
from zwidth.sim.fate import Fate
from zwidth.sim.readable import with_unit
from zwidth.stability import sketch as sketching
from zwidth.stability.fate_map import make_map
from zwidth.stability.fates import evaluate
from zwidth.stability.judging import Trial
from zwidth.stability.linear import critical_stiffness
from zwidth.stability.plane import Axis, Plane, with_friction
from zwidth.stability.sketch import Sketch, sketch

PHANTOM = load_device("phantom_1_0")
PADDLE = load_device("ethz_haptic_paddle")
positive = st.floats(1e-9, 1e9)
settings = st.none() | st.just(0.0) | positive
spans = st.none() | st.tuples(positive, positive).map(sorted).filter(lambda s: s[0] < s[1]).map(
    tuple
)


def parsed(query: str) -> dict[str, list[str]]:
    return parse_qs(query, keep_blank_values=True, strict_parsing=bool(query))


@given(
    st.builds(
        View,
        device=st.integers(0, 2),
        layer=st.sampled_from(LAYERS),
        delay=settings,
        encoder_step=settings,
        command_limit=st.none() | st.just(math.inf) | positive,
        friction=settings,
        start=positive,
        one_sided=st.booleans(),
        stiffness=st.none() | positive,
        damping=settings,
        damping_range=spans,
        stiffness_range=spans,
        time_range=spans,
        recording_from=positive,
    )
)
def test_an_address_holds_the_whole_view(view: View):
    """To the last bit; mutation: `repr` of numbers replaced by `:g`."""
    assert read_query(parsed(view.query()), devices=3) == (view, [])


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("K=abc", "K = 'abc', which is left out: it must be a number above 0"),
        ("K=-1", "it must be a number above 0"),
        ("B=nan", "it must be a number of 0 or more"),
        ("delay_s=inf", "it must be a number of 0 or more"),
        ("layer=<script>", "it must be one of fate, amplitude, frequency"),
        ("K_range=3,1", "two numbers of 0 or more, the smaller first"),
        ("K_range=1,2,3", "two numbers of 0 or more, the smaller first"),
        ("device=7", "asks for device 7; there are 1"),
        ("device=99999", "a whole number"),
        ("one_sided=yes", "0 or 1"),
        ("colour=red", "unknown part 'colour'"),
        ("K=", "K = ''"),
    ],
)
def test_what_is_wrong_in_an_address_is_named_and_left_out(query: str, said: str):
    view, complaints = read_query(parsed(query))
    assert view == View()
    assert len(complaints) == 1
    assert said in complaints[0]


@example(own=None, present=1.00001, nothing=None)
@given(own=st.none() | positive, present=positive, nothing=st.none() | st.just(0.0))
def test_a_slider_has_a_stop_at_every_value_it_may_have(
    own: float | None, present: float, nothing: float | None
):
    """Each label leads back to its value; mutation: labels rounded to four digits throughout."""
    found = stops(decades(-3, 1), "rad", own, present, nothing)
    assert list(found.values) == sorted(set(found.values))
    assert len(set(found.labels)) == len(found.labels)
    assert {v for v in (own, present, nothing) if v is not None} <= set(found.values)
    assert all(found.value(found.label(value)) == value for value in found.values)


def test_values_are_written_with_their_prefix():
    assert with_unit(2e-3, "N m") == "2 mN m"
    assert with_unit(999e-6, "s") == "999 \u00b5s"
    assert with_unit(1000.0, "N/m") == "1 kN/m"
    assert with_unit(0.0, "rad") == "0 rad"
    assert with_unit(math.inf, "N m") == "none"


def small_plane() -> Plane:
    trial = Trial(1e-3, 0.5, 1.0, 0.08)
    return Plane(PHANTOM.with_interface(encoder_step=1e-4), Axis("B", 0.0, 0.14),
                 Axis("K", 0.5, 50.0), trial=trial)  # fmt: skip


def test_a_sketch_ends_as_the_same_map_however_it_was_cut(monkeypatch: pytest.MonkeyPatch):
    """Mutation: the last picture not marked as finished."""
    *_, last = sketch(small_plane())
    monkeypatch.setattr(sketching, "MOST", 64)
    pieces = list[tuple[int, bool, bool]]()
    other: Sketch = last
    for other in sketch(small_plane()):
        pieces.append((other.runs, other.middle, other.finished))
    assert np.array_equal(last.fates.fate, other.fates.fate)
    assert np.array_equal(last.fates.amplitude, other.fates.amplitude, equal_nan=True)
    assert [p[0] for p in pieces] == sorted(p[0] for p in pieces)
    assert [p[1:] for p in pieces[-1:]] == [(True, True)]
    assert sum(p[2] for p in pieces) == 1


def test_a_sketch_is_what_the_runs_say():
    """Mutation: the middle lattice five points short."""
    plane = small_plane()
    middle = next(s for s in sketch(plane) if s.middle)
    drawn = middle.filled()
    rows = np.arange(0, 161, 4)
    assert drawn.run[np.ix_(rows, rows)].all()
    x, y = np.meshgrid(drawn.x[rows], drawn.y[rows])
    expected = evaluate(plane, x.ravel(), y.ravel()).fate.reshape(41, 41)
    assert np.array_equal(drawn.fates.fate[np.ix_(rows, rows)], expected)
    assert (drawn.fates.fate >= 0).all()


def test_pictures_have_the_colours_of_the_legend_and_a_scale_where_they_need_one():
    *_, last = sketch(small_plane())
    result = last.filled()
    image = picture(result, "fate").colours
    for fate in Fate:
        r, g, b = bytes.fromhex(COLOURS[fate][1:])
        there = result.fates.fate == fate
        assert set(image[there].tolist()) <= {r | g << 8 | b << 16 | 255 << 24}
    cycles = np.isin(result.fates.fate, [Fate.FELT, Fate.DITHERS, Fate.UNDECIDED])
    low, high = picture(result, "amplitude").scale or (0.0, 0.0)
    assert np.mean(result.fates.amplitude[cycles] < low) == pytest.approx(0.02, abs=1e-3)
    assert high == result.fates.amplitude[cycles].max()
    assert picture(result, "frequency").scale is not None


def test_colours_of_fates_differ_for_every_eye():
    """Vision without red, green or blue (Machado et al. 2009): CIELAB distance of 10 and more."""
    matrices = {
        "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
                   [-0.003882, -0.048116, 1.051998]],
        "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
                   [-0.011820, 0.042940, 0.968881]],
        "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602],
                   [0.004733, 0.691367, 0.303900]],
    }  # fmt: skip
    stored = np.array([list(bytes.fromhex(COLOURS[f][1:])) for f in Fate]) / 255.0
    linear = np.where(stored <= 0.04045, stored / 12.92, ((stored + 0.055) / 1.055) ** 2.4)
    to_xyz = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    )
    for name, matrix in matrices.items():
        seen = np.clip(linear @ np.array(matrix).T, 0.0, 1.0)
        xyz = seen @ to_xyz.T / to_xyz.sum(axis=1)
        f = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
        lab = np.column_stack(
            [116.0 * f[:, 1] - 16.0, 500.0 * (f[:, 0] - f[:, 1]), 200.0 * (f[:, 1] - f[:, 2])]
        )
        apart = np.linalg.norm(lab[:, None] - lab[None], axis=-1)
        assert apart[np.triu_indices(len(Fate), 1)].min() > 10.0, name


def test_the_line_is_the_linear_boundary_and_measured_points_belong_to_their_device():
    bench = Bench([PHANTOM])
    line = bench.line(View())
    for i in (0, 20, 50):
        assert line.stiffness[i] == critical_stiffness(PHANTOM, float(line.damping[i])).stiffness
    assert bench.line(View(friction=0.1, encoder_step=1e-3, command_limit=1.0)) is line
    assert bench.line(View(delay=4e-3)) is not line
    assert len(bench.measured(View())) == 26
    paddle = Bench([PADDLE])
    assert [p[:2] for p in paddle.measured(View())] == [tuple(p) for p in paddle_boundary()]
    other = Bench([replace(PHANTOM, name="mine")])
    assert other.measured(View()) == []
    fitted = bench.fitted(View())
    assert bench.still_fits(fitted)
    assert not bench.still_fits(replace(fitted, delay=8e-3, stiffness_range=(0.0, 500.0)))


def test_what_is_shown_is_the_run_of_the_scenario_that_is_saved():
    bench = Bench([PHANTOM])
    view = bench.fitted(View(stiffness=30.0, damping=0.05, friction=2e-3, encoder_step=1e-4))
    scenario = scenario_from_text(scenario_to_text(bench.scenario(view)))
    setup = scenario.prepare()
    (trace, _, _), *_ = setup.blocks(setup.ticks)
    shown = look(bench, view)
    assert all(np.array_equal(trace[n], shown.trace[n]) for n in trace.channels)
    point = evaluate(bench.plane(view), np.array([0.05]), np.array([30.0]))
    assert point.fate[0] == shown.fates.fate[0]


def test_a_sine_has_a_line_of_its_amplitude():
    """Within 1 % at a frequency on the grid; mutation: power taken for amplitude."""
    t = np.arange(4000) * 1e-3
    found = spectrum(columns(look_like(t, 3e-4 * np.sin(2.0 * np.pi * 50.0 * t) + 7.0)))
    peak = int(np.nanargmax(found["amplitude"]))
    assert found["frequency"][peak] == pytest.approx(50.0, rel=1e-9)
    assert found["amplitude"][peak] == pytest.approx(3e-4, rel=0.01)


def look_like(t: np.ndarray, position: np.ndarray):
    from zwidth.sim.trace import Trace

    return Trace(t, {"position_m1": position}, {"position_m1": "rad"}, "recorded")


def test_a_recording_that_leaves_the_picture_says_so():
    """An axis gives it three times the run. Mutation: `reach` of its largest value, not size."""
    run, far = np.array([0.1, -0.2]), np.array([0.0, -80.0])
    assert fitting(run, [far])[0] == pytest.approx(-0.6 - 0.05 * 0.7)
    assert reach(far) / reach(run) == pytest.approx(400.0)
    assert of_the_recording(400.0) == "recording (400 times larger)"
    assert of_the_recording(0.0) == "recording"


def test_an_augmented_device_differs_by_its_sliders():
    from zwidth.sim.physics import make_physics

    found = make_physics("coulomb_friction", "m1", level=3e-3)
    bench = Bench([PHANTOM, PHANTOM.with_physics(found)])
    assert bench.plane(bench.fitted(View())).setting("friction") == 0.0
    assert bench.plane(bench.fitted(View(device=1))).setting("friction") == 3e-3
    assert bench.plane(bench.fitted(View(device=1, friction=0.0))).setting("friction") == 0.0
    assert bench.names == [PHANTOM.name, "with Coulomb friction at m1"]
    twice = Bench([PHANTOM, PHANTOM, PHANTOM.with_interface(encoder_step=1.0), PHANTOM])
    assert twice.names[1:] == [
        "with other parameters", "with encoder step", "with other parameters (4)",
    ]  # fmt: skip


def test_errors_are_sentences(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    broken = tmp_path / "broken.toml"
    broken.write_text("name = ")
    assert run(["explore", str(broken), "--no-browser"]) == 2
    assert "broken.toml" in capsys.readouterr().err
    assert run(["explore", "phantom_1_0", "--compare", "nothing_like_it", "--no-browser"]) == 2
    capsys.readouterr()
    linear = tmp_path / "linear.toml"
    save_device(replace(PHANTOM, rotary=False, modal=None), linear)
    assert run(["explore", "phantom_1_0", "--compare", str(linear), "--no-browser"]) == 2
    assert "compare devices of one kind" in capsys.readouterr().err
    assert run(["explore", "phantom_1_0", "--address", "0.0.0.0", "--no-browser"]) == 2
    assert "is not a usable address; give the host name" in capsys.readouterr().err
    monkeypatch.setattr("zwidth.commands.explore.find_spec", lambda name: None)
    assert run(["explore", "phantom_1_0"]) == 2
    assert "pip install 'zwidth[explore]'" in capsys.readouterr().err


def test_no_amplitude_is_told_of_what_grows_without_bound():
    """Under a limit it is; breaks where the pointer says 2735845548713524300000000 rad."""
    free = make_map(small_plane(), 5, 0)
    grows = free.fates.fate == Fate.GROWS
    assert grows.any()
    assert np.isinf(bounded(free)[grows]).all()
    rest = free.fates.amplitude[~grows]
    assert np.array_equal(bounded(free)[~grows], rest, equal_nan=True)
    limited = replace(free, plane=replace(
        free.plane, device=free.plane.device.with_interface(command_limit=1.0)
    ))  # fmt: skip
    assert np.array_equal(bounded(limited), free.fates.amplitude, equal_nan=True)
    code = sized("rad").code
    assert "grows without bound" in code
    assert "%" not in code


def test_a_plane_that_friction_holds_still_says_so():
    """And what to move; breaks where all of it is white without a word."""
    plane = small_plane()
    stuck = replace(plane, device=with_friction(plane.device, 10.0))
    said = of_the_plane(make_map(stuck, 5, 0), False, True)
    assert ". Friction of 10 N m holds every wall here at rest, from a start of 1 mrad" in said
    assert "Friction" not in of_the_plane(make_map(plane, 5, 0), False, True)


def test_the_frequency_of_a_wall_is_that_of_its_boundary():
    """As `boundary` gives it, between two points of the line. Mutation: that of the nearest."""
    dampings, stiffest = np.array([0.0, 0.02, 0.04]), np.array([2.0, 6.0, 10.0])
    line = Line(dampings, stiffest, np.array([10.0, 11.0, 40.0]))
    assert line.at(0.005) == pytest.approx((3.0, 10.25))
    assert line.at(0.035) == pytest.approx((9.0, 40.0))  # two oscillations meet there
    assert line.at(0.05) is None
