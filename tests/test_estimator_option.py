"""--estimator: what it makes of a device, and every command that takes it."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engine_examples import phantom
from estimator_examples import SET

from zwidth.cli import run
from zwidth.estimator_option import with_estimator
from zwidth.explore.bench import Bench
from zwidth.explore.look import look
from zwidth.explore.view import View
from zwidth.explore.words import legend, of_the_wall
from zwidth.figures.boundary import boundary_figure
from zwidth.figures.map import legend as map_legend
from zwidth.logs.mcap_reader import read_log
from zwidth.results import BoundaryResult, DelayBoundary, point_of
from zwidth.scenarios.replay import replay
from zwidth.sim.device_file import save_device
from zwidth.stability.bisection import Trial
from zwidth.stability.boundary import find_boundaries
from zwidth.stability.fate_map import make_map
from zwidth.stability.linear import stand_in
from zwidth.stability.plane import Axis, Plane
from zwidth.views.device import said_of_estimator

DEVICE = phantom().with_interface(encoder_step=2e-5, command_limit=0.3, velocity_cutoff_hz=80.0)
MASS = float(DEVICE.chain.masses.sum())


@pytest.fixture
def file(tmp_path: Path) -> str:
    save_device(DEVICE, tmp_path / "device.toml")
    return str(tmp_path / "device.toml")


@pytest.mark.parametrize(
    ("asked", "settings"),
    [
        ("foaw", {"window": 16, "band": 2e-5}),
        ("foaw_end:window=8,band=1e-4", {"window": 8, "band": 1e-4}),
        ("levant", {"acceleration": 0.3 / MASS}),
        ("kalman", {"noise": 2e-5 / math.sqrt(12.0), "acceleration": 0.3 / MASS}),
        ("kalman:noise=1e-4", {"noise": 1e-4, "acceleration": 0.3 / MASS}),
        ("kalman_acceleration:acceleration=7", {"noise": 2e-5 / 12**0.5, "acceleration": 7.0}),
        ("difference", {}),
    ],
)
def test_what_is_left_out_follows_from_the_device(asked: str, settings: dict[str, float]) -> None:
    """Mutation: the variance of rounding for its deviation; the force for the acceleration."""
    face = with_estimator(DEVICE, asked).interface
    assert face.velocity_estimator == asked.partition(":")[0]
    for name in ("window", "band", "noise", "acceleration"):
        assert getattr(face, f"velocity_{name}") == pytest.approx(settings.get(name, 0.0))
    assert with_estimator(DEVICE, None) is DEVICE


def test_another_estimator_leaves_nothing_of_the_one_before() -> None:
    """Mutation: `DIFFERENCE_ALONE` left out (the interface refuses what it does not take)."""
    device = phantom().with_interface(**SET["kalman"])
    assert with_estimator(device, "foaw").interface.velocity_noise == 0.0
    assert with_estimator(device, "difference").interface.velocity_estimator == "difference"


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("foav", "did you mean 'foaw'"),
        ("foaw:noise=1", "has no 'noise'; it takes window, band"),
        ("difference:window=3", "has no 'window'; it takes no settings"),
        ("foaw:window=3.5", "window is '3.5'; give a whole number"),
        ("kalman:noise=few", "noise is 'few'; give a number"),
        ("kalman_acceleration", "needs acceleration"),
        ("foaw:window=65", "a whole number from 2 to 64"),
    ],
)
def test_what_cannot_be_is_one_sentence(
    asked: str, said: str, file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["boundary", file, "--estimator", asked, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.strip().splitlines()) == 1


def test_without_an_encoder_or_a_limit_it_asks_for_numbers() -> None:
    for asked, key in (("foaw", "band"), ("kalman", "noise"), ("levant", "acceleration")):
        with pytest.raises(ValueError, match=f"needs {key}.*give {asked}:{key}=X"):
            with_estimator(phantom(), asked)


def result(arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Any:
    assert run([*arguments, "--out", str(tmp_path / "out"), "--json", "-"]) == 0
    return json.loads(capsys.readouterr().out)


def test_boundary_has_no_theory_of_foaw(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Null in its place, and a boundary in the time domain; of a Kalman both.

    Mutation: the theory of the stand-in in the table.
    """
    walls = ["--damping", "0", "0.02", "--tolerance", "0.01", "--limit-s", "8"]
    for asked, theory in (("foaw", False), ("kalman", True)):
        found = result(
            ["boundary", file, "--estimator", asked, *walls, "--force"], tmp_path, capsys
        )
        (boundary,) = found["boundaries"]
        assert (boundary["stiffest"]["linear_stiffness"] is not None) == theory
        for point in boundary["points"]:
            assert (point["linear"] is not None) == theory
            assert point["simulated"]["stable"] > 0.0


def test_default_dampings_are_those_of_the_difference(tmp_path: Path) -> None:
    from zwidth.stability.boundary import default_dampings

    foaw = with_estimator(DEVICE, "foaw")
    assert np.array_equal(default_dampings(foaw), default_dampings(DEVICE))
    assert stand_in(foaw).interface == DEVICE.interface
    kalman = with_estimator(DEVICE, "kalman")
    assert stand_in(kalman) is kalman


def test_map_draws_no_theory_of_levant(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small = ["--seconds", "0.3", "--coarse", "4", "--levels", "1"]
    found = result(["map", file, "--estimator", "levant", *small], tmp_path, capsys)
    assert found["stable_but_not_resting"] is None
    assert found["describing_function"] is None
    assert found["runs"] > 0
    assert (tmp_path / "out" / "map.png").stat().st_size > 5000


@pytest.mark.parametrize(("estimator", "lines"), [("foaw", 0), ("kalman", 1)])
def test_pictures_name_a_linear_boundary_where_there_is_one(estimator: str, lines: int) -> None:
    """Of a map and of a boundary. Mutation: the entry put in for all devices."""
    device = with_estimator(DEVICE, estimator)
    trial = Trial(seconds=0.3, limit_s=0.6, window_s=0.03)
    plane = Plane(device, Axis("B", 0.0, 0.02), Axis("K", 1.0, 5.0), trial=trial)
    legend = map_legend([make_map(plane, 3, 0)])
    assert sum(h.get_label() == "linear boundary" for h in legend) == lines
    found = find_boundaries([device], [np.array([0.0, 0.02])], Trial(limit_s=8.0))[0]
    points = [point_of(p) for p in found.points]
    result = BoundaryResult("x", [DelayBoundary(0.002, points)], True)
    texts = [t.get_text() for t in boundary_figure(result).legends[0].get_texts()]
    assert texts.count("linear theory") == lines


def test_sweep_has_areas_of_foaw(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Mutation: theory of zeros in place of none."""
    few = ["--values", "40", "80", "--rounds", "0", "--dampings", "3", "--limit-s", "8"]
    found = result(["sweep", file, "--estimator", "foaw", *few], tmp_path, capsys)
    assert found["best_by_theory"] is None
    assert all(step["linear_area"] is None and step["area"] > 0.0 for step in found["steps"])
    text = (tmp_path / "out" / "best.toml").read_text()
    assert 'velocity_estimator = "foaw"' in text


def test_relay_reads_a_wall_with_foaw(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = ["--damping", "0", "--delay-ms", "2", "--starts", "2"]
    foaw = result(["relay", file, "--estimator", "foaw", *few], tmp_path, capsys)
    (plain,) = result(["relay", file, *few, "--force"], tmp_path, capsys)["conditions"]
    assert foaw["conditions"][0]["stiffness"] == plain["stiffness"]  # at B = 0 no velocity enters


def test_simulate_logs_the_estimator_and_replays(
    file: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Mutation: the device of the scenario file in the log."""
    scenario = tmp_path / "run.toml"
    scenario.write_text(
        'schema = 1\nduration_s = 0.5\n[device]\npath = "device.toml"\n'
        '[controller]\nkind = "wall"\n'
        "stiffness = 6.0\ndamping = 0.02\n[start]\nposition = 0.01\n"
    )
    result(["simulate", str(scenario), "--estimator", "kalman"], tmp_path, capsys)
    log = tmp_path / "out" / "run.mcap"
    assert replay(log).identical
    own = read_log(log).tick["velocity_estimate"]
    result(["simulate", str(scenario), "--force"], tmp_path, capsys)
    assert not np.array_equal(own, read_log(log).tick["velocity_estimate"])


def test_the_page_says_that_there_is_no_theory() -> None:
    """Axes are around the boundary of the stand-in; no line is drawn. Mutation: its line drawn."""
    bench = Bench([with_estimator(DEVICE, "foaw"), DEVICE])
    view = bench.fitted(View())
    plain = replace(view, device=1)
    assert bench.line(view).without == "foaw"
    assert np.isnan(bench.line(view).stiffness).all()
    assert bench.fitted(plain).stiffness_range == view.stiffness_range
    wall = replace(view, stiffness=2.0, damping=0.01)
    assert "linear boundary" in legend("1 N", False, True)
    assert "linear boundary" not in legend("1 N", False, False)
    said = of_the_wall(look(bench, wall), bench.plane(wall), bench.line(wall))
    assert "there is no linear theory for foaw" in said
    assert "linear theory takes" not in of_the_wall(
        look(bench, replace(wall, device=1)), bench.plane(plain), bench.line(plain)
    )


def test_a_device_is_shown_with_it() -> None:
    device = with_estimator(DEVICE, "kalman:noise=1e-5,acceleration=9")
    (said,) = said_of_estimator(device.interface, True)
    assert said == "velocity by kalman (noise 1e-05 rad, acceleration 9 rad/s2)"
    assert said_of_estimator(DEVICE.interface, True) == []
