"""Boundaries over hands: quantiles against a closed form, by theory and in the time domain."""

import json
from pathlib import Path

import numpy as np
import pytest
from engine_examples import one_mass, phantom

import zwidth
from zwidth.cli import run
from zwidth.stability.bisection import find_brackets
from zwidth.stability.hand import (
    DAMPING,
    LEVELS,
    draw_hands,
    hand_quantiles,
    with_hand,
)
from zwidth.stability.judging import Trial
from zwidth.stability.linear import critical_stiffness

T = 1e-3


def test_quantiles_of_a_rigid_device_are_those_of_the_hands_damping() -> None:
    """K_CR = 2 (b + b_h)/T whatever mass and spring of the hand, b_h of known quantiles: 5 %.

    Mutations: draws even in the property, not its logarithm (8 % at 5 %); spring and damper
    exchanged.
    """
    device, b = one_mass(0.5, 1.0, delay=0.0), 1.0
    low, high = DAMPING
    truth = [2.0 * (b + low * (high / low) ** level) / T for level in LEVELS]
    found = hand_quantiles(device, [0.0], 1.0, 400)[0]
    assert found == pytest.approx(truth, rel=0.05)


def test_the_time_domain_has_the_same_spread() -> None:
    """Brackets of a dozen drawn hands close on their theory, 0.2 %; a seed has its hands."""
    hands = draw_hands(12, 3)
    assert hands == draw_hands(12, 3)
    devices = [with_hand(phantom(), hand, 0.05) for hand in hands]
    brackets = find_brackets(devices, [np.array([0.02])] * 12, Trial())
    for device, (bracket,) in zip(devices, brackets, strict=True):
        limit = critical_stiffness(device, 0.02).stiffness
        assert limit is not None
        assert bracket.stable == pytest.approx(limit, rel=2e-3)


def test_the_command_says_what_shares_of_hands_bear(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    line = "boundary phantom_1_0 --damping 0.02 0.06 --limit-s 4 --tolerance 0.01 --hands 20"
    assert run([*line.split(), "--lever", "0.05", "--json", "b.json", "--table"]) == 0
    assert "by 95, 50, 5 % of hands" in capsys.readouterr().out
    for point in json.loads(Path("b.json").read_text())["boundaries"][0]["points"]:
        assert point["hands"]["low"] < point["hands"]["median"] < point["hands"]["high"]
        assert "hand" not in point
    assert run(line.split()) == 2
    assert "needs --lever" in capsys.readouterr().err


def test_commands_take_the_law_of_the_walls(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """boundary and map with a passivity controller render stiffer walls than without."""
    monkeypatch.chdir(tmp_path)
    line = (
        "boundary phantom_1_0 --delay-ms 0 --damping 0 --limit-s 4 --tolerance 0.02 --json b.json"
    )
    found: list[float] = []
    for law in ("wall", "guarded"):
        assert run([*line.split(), "--law", law]) == 0
        result = json.loads(Path("b.json").read_text())
        found.append(result["boundaries"][0]["points"][0]["simulated"]["stable"])
    assert "passivity controller up to 0.03477" in result["law"]
    assert found[1] > 5.0 * found[0]
    small = "map phantom_1_0 --delay-ms 0 --coarse 5 --levels 0 --seconds 1"
    small += " --y-range 1 100 --x-range 0 0.03"
    shares: list[float] = []
    for law in ("wall", "guarded"):
        assert run([*small.split(), "--law", law, "--json", "m.json", "--out", law]) == 0
        shares.append(json.loads(Path("m.json").read_text())["fates"]["rests"]["share"])
    assert shares[1] > shares[0] + 0.2
    capsys.readouterr()
    for more, said in (
        ("--law texture", "--law texture needs --wavelength"),
        ("--wavelength 0.01", "--wavelength has no use with --law wall"),
        ("--law texture --wavelength 0.01 --share 1.5", "law.share is 1.5"),
    ):
        assert run([*line.split(), *more.split()]) == 2
        assert said in capsys.readouterr().err


def test_a_map_over_the_cutoff_has_its_theory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Off the boundary all runs do what the linear loop at their cut-off says.

    Mutation: one loop for all cut-offs in `linear_radius`.
    """
    plane = zwidth.Plane(
        phantom(), zwidth.Axis("cutoff", 20.0, 400.0, "log"), zwidth.Axis("K", 1.0, 40.0),
        damping=0.06, trial=Trial(limit_s=8.0),
    )  # fmt: skip
    found = zwidth.make_map(plane, 5, 0)
    clear = np.abs(found.linear) > 2e-4
    assert clear.sum() > 20
    assert np.unique(found.linear[:, 0] < 0.0).size == 2 or np.unique(found.linear < 0.0).size == 2
    assert np.array_equal((found.fates.fate == 0)[clear], (found.linear < 0.0)[clear])
