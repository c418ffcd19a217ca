"""The Z-width over a setting: areas against a closed form, the best found, the command."""

import json
from pathlib import Path

import numpy as np
import pytest
from engine_examples import Floats, coulomb, one_mass, phantom

import zwidth
from zwidth.cli import run
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.stability.decomposition import curve
from zwidth.stability.sweep import sweep

CUTOFFS = [30.0, 89.0, 300.0]


def closed_form(device: Device, dampings: Floats) -> float:
    """The area below the lowest wall that sustains an oscillation, at each B (`decomposition`)."""
    f = np.linspace(0.05, 499.9, 40_000)
    found = curve(device, f)
    heights: list[float] = []
    for b in dampings:
        crosses = np.flatnonzero(np.diff(np.sign(found.damping - b)))
        at = found.stiffness[crosses]
        heights.append(float(at[at > 0.0].min(initial=np.inf)))
    low = np.array(heights)
    return float(np.trapezoid(np.where(np.isfinite(low), low, 0.0), dampings))


def test_areas_are_those_of_the_closed_form_and_have_their_maximum_inside() -> None:
    """1 % of the D-decomposition, simulated and by theory, at dampings with a stable wall.

    Mutations: the filter left out of `velocity_response`; areas over the index of the damping.
    """
    found = sweep(
        phantom().with_interface(velocity_order=2), "cutoff", CUTOFFS, rounds=0, dampings=12
    )
    assert found.best_by_theory is not None
    assert found.best.value == found.best_by_theory.value == 89.0
    assert found.without is not None
    assert found.best.area > 5.0 * found.without.area
    for step in found.steps:
        stable = step.linear > 0.0
        inside = step.dampings[stable]
        truth = closed_form(step.device, inside)
        assert np.trapezoid(step.linear[stable], inside) == pytest.approx(truth, rel=0.01)
        assert step.area == pytest.approx(step.linear_area, rel=0.01)


def test_refinement_halves_the_way_to_the_neighbours() -> None:
    """Two more values a round, the best kept. Mutation: `_beside` beside the first value."""
    coarse = sweep(phantom(), "cutoff", [20.0, 80.0, 320.0], rounds=0, dampings=5)
    fine = sweep(phantom(), "cutoff", [20.0, 80.0, 320.0], rounds=1, dampings=5)
    own = {s.value for s in coarse.steps}
    place = [s.value for s in coarse.steps].index(coarse.best.value)
    neighbours = [s.value for s in coarse.steps][max(place - 1, 0) : place + 2]
    more = {s.value for s in fine.steps} - own
    assert more
    assert all(min(neighbours) < value < max(neighbours) for value in more)
    assert fine.best.area >= coarse.best.area


def test_the_stiffest_wall_scales_as_a_hold_that_shortens() -> None:
    """K_max (B = 0) = 2 b / T over the period, 5 %, simulated (Colgate and Schenkel's line)."""
    device = one_mass(1e-2, 5e-3, delay=0.0)
    found = sweep(device, "period", [1e-4, 2e-4, 5e-4], dampings=3)
    for step in found.steps:
        assert step.simulated[0] == pytest.approx(2.0 * 5e-3 / step.value, rel=0.05)


def test_steps_and_friction_are_in_the_areas() -> None:
    """Friction holds walls that theory does not. Mutation: theory in place of `find_brackets`."""
    device = phantom().with_physics(coulomb(2e-3))
    found = zwidth.sweep(device, "delay", [2e-3], dampings=3, rounds=0)
    assert found.best.area > 1.1 * found.best.linear_area


def test_the_command_writes_the_best_device(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    line = "sweep phantom_1_0 --order 2 --values 30 89 --dampings 4 --rounds 0 --out o"
    assert run([*line.split(), "--json", "s.json"]) == 0
    assert "widest at cutoff 89 Hz" in capsys.readouterr().out
    found = json.loads(Path("s.json").read_text())
    assert found["best"] == 89.0
    assert [step["value"] for step in found["steps"]] == [30.0, 89.0, None]
    best = load_device("o/best.toml").interface
    assert (best.velocity_cutoff_hz, best.velocity_order) == (89.0, 2)
    assert run([*["sweep", "phantom_1_0", "--over", "delay", "--delay-ms", "3"]]) == 2
    assert "--delay-ms has no use while delay is swept" in capsys.readouterr().err
    with pytest.raises(ValueError, match="setting is 'cutof'"):
        sweep(phantom(), "cutof")  # pyright: ignore[reportArgumentType]
