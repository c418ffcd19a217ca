"""`zwidth boundary` answers how stiff a wall may be."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zwidth.cli import run
from zwidth.figures.boundary import Corner, boundary_figure
from zwidth.results import BoundaryResult, Critical, DelayBoundary, Point
from zwidth.sim.device_file import load_device
from zwidth.stability.boundary import find_boundaries
from zwidth.stability.branches import RIGID
from zwidth.stability.linear import corner, last_stable_damping
from zwidth.stability.top import endings

ASKED = "boundary phantom_1_0 --delay-ms 2 --damping 0 0.08 0.09 0.12 --limit-s 4 --tolerance 0.01"


def test_how_stiff_first_and_point_by_point_on_request(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """K_max, its B, the last stable B and the jump; a B without a stable K is a dash, not 0.

    The paper's device with 2 ms jumps from 28 to 171 Hz at the top of its boundary. Breaks where
    the answer has to be read off the table, what is unstable however soft has a K, or theory's
    frequency stands under a heading that does not say "by theory".
    """
    monkeypatch.chdir(tmp_path)
    assert run([*ASKED.split(), "--json", "b.json"]) == 0
    said = capsys.readouterr().out
    (heads,) = (line for line in said.splitlines() if line.startswith("delay"))
    (row,) = (line for line in said.splitlines() if line.startswith(" 2 ms"))
    assert row.index("jumps from 27.8 to 171 Hz") == heads.index("frequency by theory")
    assert "K linear" not in said
    (found,) = json.loads(Path("b.json").read_text())["boundaries"]
    device = load_device("phantom_1_0").with_interface(delay=2e-3)
    top, end = corner(device), last_stable_damping(device)
    assert top is not None
    stiffest = found["stiffest"]
    assert stiffest["damping"] == 0.08
    assert stiffest["stiffness"] == found["points"][1]["simulated"]["stable"]
    assert stiffest["last_stable_damping"] == 0.09
    assert stiffest["linear_stiffness"] == pytest.approx(top.stiffness)
    assert stiffest["linear_last_stable_damping"] == end
    assert run([*ASKED.split(), "--table"]) == 0
    rows = capsys.readouterr().out.splitlines()
    (last,) = (row.split() for row in rows if row.split()[:1] == ["0.12"])
    assert last[1:6] == ["-"] * 5


def test_the_corner_of_passive_walls_is_enlarged() -> None:
    """Two of 41 dampings have a passive wall: an inset shows them, filled, over their own range.

    Breaks where they are ticks that no one sees.
    """
    points = [Point(0.05 * i, Critical(2.0 + 8.0 * i, 9.0), None) for i in range(3)]
    result = BoundaryResult("device", [DelayBoundary(0.002, points)])
    damping = np.linspace(0.0, 0.012, 9)
    corner = Corner(damping, np.maximum(2.0 - 400.0 * damping, 0.0), 2.5 + 80.0 * damping)
    stiffness = boundary_figure(result, corners=[corner]).axes[0]
    (inset,) = stiffness.child_axes
    assert inset.get_xlim() == (0.0, 0.012)
    assert 2.0 < inset.get_ylim()[1] < 4.0
    assert len(inset.collections) == 1
    none = corner._replace(passive=np.zeros(9))
    assert not boundary_figure(result, corners=[none]).axes[0].child_axes


def test_it_answers_first_in_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Known: a late hold and damper by T/2 + t_d and T + t_d; friction adds, an encoder little.

    Mutations: `damper_lag_deg` without the difference's half sample; `without` from other starts.
    """
    device = tmp_path / "slider.toml"
    device.write_text(
        'schema = 1\nname = "slider"\nsource = "-"\nrotary = false\n'
        "[chain]\nmasses = [0.02]\nground_dampers = [0.1]\n"
        "[interface]\nperiod_s = 0.001\nencoder_step = 2e-6\n"
        '[[physics]]\neffect = "coulomb_friction"\nat = "m1"\nlevel = 0.02\n'
    )
    arguments = ["boundary", str(device), "--damping", "2", "6", "--out", str(tmp_path / "out")]
    assert run([*arguments, "--json", str(tmp_path / "found.json")]) == 0
    (line, *_) = [line for line in capsys.readouterr().out.splitlines() if line]
    (found,) = json.loads((tmp_path / "found.json").read_text())["boundaries"]
    top = found["stiffest"]
    assert line == top["sentence"]
    k = f"{1e-3 * top['stiffness']:.4g} N/mm"
    assert line.startswith(f"Walls are stable up to {k}, at B = 6 N s/m (the largest tried)")
    assert "an oscillation of the rigid body at 119 Hz begins" in line
    assert "friction raises K by" in line
    assert "the encoder's step changes K by less than 0.2 %" in line
    (end,) = top["endings"]
    assert end["spring_lag_deg"] == pytest.approx(0.18 * end["frequency_hz"])
    assert end["damper_lag_deg"] == pytest.approx(0.36 * end["frequency_hz"])
    assert top["without"]["friction"] < top["stiffness"]
    assert set(top["without"]) == {"friction", "encoder_step"}


def test_it_says_in_which_oscillation_the_simulation_ends(tmp_path: Path) -> None:
    """Where friction holds a wall far beyond theory, and where there is no theory.

    Mutation: `_same` always true (the frequency of the linear boundary, 17.4 Hz, in the first).
    """

    def answer(*arguments: str) -> dict[str, Any]:
        found = tmp_path / "found.json"
        given = ["boundary", *arguments, "--out", str(tmp_path / "out"), "--json", str(found)]
        assert run([*given, "--force"]) == 0
        return json.loads(found.read_text())["boundaries"][0]["stiffest"]

    held = answer("gaming_wheel", "--damping", "0.8")
    f = held["frequency_hz"]
    assert f < 0.6 * held["endings"][0]["frequency_hz"]
    assert (
        f"wall oscillates at {f:.3g} Hz (linear theory predicts an oscillation of the rigid body at"
        " 17.4 Hz). At this frequency, sampling and delay make the spring" in held["sentence"]
    )
    lags = 360.0 * f * 3.5e-3, 360.0 * f * 4e-3  # T/2 + t_d, T + t_d
    late = f"lag by {lags[0]:.0f}\u00b0 and the damping force by {lags[1]:.0f}\u00b0"
    assert late in held["sentence"]

    windows = answer("gaming_wheel", "--damping", "0.8", "--estimator", "foaw")
    f = windows["frequency_hz"]
    assert (
        f"wall oscillates at {f:.3g} Hz. At this frequency, sampling and delay make the spring"
        in windows["sentence"]
    )
    assert "the damping force" not in windows["sentence"]
    assert "encoder_step" not in windows["without"]

    device = tmp_path / "two.toml"
    device.write_text(
        'schema = 1\nname = "two rates"\nsource = "-"\nrotary = false\n'
        "[chain]\nmasses = [0.02]\nground_dampers = [0.1]\n"
        "[interface]\nperiod_s = 0.0005\nposition_ticks = 4\nvelocity_ticks = 2\n"
    )
    rates = answer(str(device), "--damping", "24")
    late = 360.0 * rates["frequency_hz"] * 1e-3
    assert f"by {late:.0f}\u00b0 and the damping force by {late:.0f}\u00b0" in rates["sentence"]


def test_the_two_oscillations_of_the_answer_are_those_of_the_corner() -> None:
    """At 8 ms they meet there: frequencies within 0.5 %. Mutation: `CLOSE` as large as `BESIDE`."""
    device = load_device("phantom_1_0").with_interface(delay=0.008)
    top = corner(device)
    assert top is not None
    (found,) = find_boundaries([device], [np.array([0.05, top.damping])])
    low, high = endings(found)
    assert low.frequency_hz == pytest.approx(top.frequency_below_hz, rel=5e-3)
    assert high.frequency_hz == pytest.approx(top.frequency_above_hz, rel=5e-3)
    assert (low.mode, high.mode) == (RIGID, "mode 2")


def test_what_is_felt_is_a_second_boundary(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A damper answers each step of the encoder with a pulse of B D / T: felt from 10 mN on.

    Steps of 0.1 um make 0.2 mN of it at B = 2, and of 4 um 8 mN, to which the spring adds.
    Mutation: `felt` left out of the walls that end a boundary in `_Hunt.judged`.
    """
    found: list[list[float]] = []
    for step in ("1e-7", "4e-6"):
        device = tmp_path / f"slider_{step}.toml"
        device.write_text(
            'schema = 1\nname = "slider"\nsource = "-"\nrotary = false\n'
            "[chain]\nmasses = [0.02]\nground_dampers = [0.1]\n"
            f"[interface]\nperiod_s = 0.001\nencoder_step = {step}\n"
        )
        arguments = ["boundary", str(device), "--damping", "2", "--out", str(tmp_path / step)]
        assert run([*arguments, "--felt", "--json", str(tmp_path / "found.json")]) == 0
        (boundary,) = json.loads((tmp_path / "found.json").read_text())["boundaries"]
        (point,) = boundary["points"]
        assert "A hand feels no dither up to" in boundary["stiffest"]["sentence"]
        assert "felt_reason" not in point
        found.append([point["felt"]["stable"], point["simulated"]["stable"]])
    (fine, of_fine), (coarse, of_coarse) = found
    assert fine > 0.95 * of_fine
    assert coarse < 0.5 * of_coarse
    assert run([*arguments, "--felt-force", "0.02"]) == 2
    assert "have no use without --felt" in capsys.readouterr().err
