"""The paddle that is predicted: what is known of it, and what its prediction rests on."""

import importlib.util
import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from zwidth.stability.linear import critical_stiffness

DOCS = Path(__file__).parents[1] / "docs"
if not (DOCS / "paddle_prediction.py").is_file():
    pytest.skip("not a clone: the wheel has no documentation", allow_module_level=True)
PAGE = (DOCS / "haptics.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def paddle() -> Any:
    spec = importlib.util.spec_from_file_location("paddle", DOCS / "paddle_prediction.py")
    assert spec is not None
    assert spec.loader is not None
    module: ModuleType = importlib.util.module_from_spec(spec)
    sys.modules["paddle"] = module  # dataclasses look there
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def rigs(paddle: Any) -> list[Any]:
    """Four rigs that fit, of other draws than those of the page."""
    rng = np.random.default_rng(7)
    drawn = (paddle.drawn(rng).settled() for _ in range(200))
    return [one for one in drawn if paddle.fits(one)][:4]


def test_what_is_known_is_as_it_was_given(paddle: Any) -> None:
    """Ratio, counts, both gains in N m/rad, and the inertia that each gives."""
    assert 2.0 * math.pi / (4096 * 15) == pytest.approx(paddle.STEP)
    assert pytest.approx(60.2, abs=0.1) == paddle.KU
    assert pytest.approx(11.56, abs=0.01) == paddle.KU_HALL
    omega = 2.0 * math.pi / paddle.TU
    assert paddle.KU / omega**2 == pytest.approx(8.1e-4, rel=0.01)
    assert pytest.approx(15 * 0.0346 * 24.0 / 5.78) == paddle.LIMIT
    assert paddle.DAMPINGS.size == 13
    assert paddle.DAMPINGS[-1] == pytest.approx(0.024)


def test_the_position_loop_ends_where_linear_theory_says(paddle: Any, rigs: list[Any]) -> None:
    """With friction as a damper: K within 0.5 %, the period within 1 %.

    Mutations: the hold's T/2 left out (K falls by a quarter); sin for cos.
    """
    for one in rigs:
        rig, omega = one.rig, 2.0 * math.pi / one.period
        device = rig.device(one.damping + rig.rubbing / omega).without_physics(
            "directional_friction@m1"
        )
        device = device.with_interface(encoder_step=0.0, command_limit=math.inf)
        point = critical_stiffness(device, 0.0)
        assert point.stiffness == pytest.approx(rig.ultimate, rel=5e-3)
        assert point.frequency_hz == pytest.approx(1.0 / one.period, rel=0.01)


def test_simulated_walls_begin_at_the_ultimate_gain(paddle: Any, rigs: list[Any]) -> None:
    """Without a virtual damper, with friction, steps and limit: within 4 %, for all estimators.

    So the describing function of the friction holds here, and no estimator enters at B = 0.
    Mutation: the first harmonic of the friction without its 4 / pi.
    """
    for one in rigs:
        first = paddle.walls_of(one)[:, 0]
        assert first == pytest.approx(np.full(4, one.rig.ultimate), rel=0.04)
        assert len(set(first.tolist())) == 1


def test_dither_decides_nothing(paddle: Any, rigs: list[Any], monkeypatch: Any) -> None:
    """Walls are the same whether 5 or 32 counts are dither, within 3 % in nine of ten."""
    few = paddle.walls_of(rigs[0])
    monkeypatch.setattr(paddle, "REST", 32.0 * paddle.STEP)
    many = paddle.walls_of(rigs[0])
    assert np.mean(np.abs(many / few - 1.0) < 0.03) > 0.9


def test_friction_that_does_too_much_asks_for_a_wider_start(paddle: Any, rigs: list[Any]) -> None:
    """The damper is never below the motor's own. Mutation: `max` left out."""
    rig = replace(rigs[0].rig, start=1e-3)
    settled = rig.settled()
    assert settled.damping == paddle.VISCOUS
    assert settled.rig.start > 1e-3


def test_the_page_has_what_the_file_has(paddle: Any) -> None:
    """Every wall of the table, the order and the periods. Mutation: a table of another run."""
    kept = json.loads((DOCS / "haptics" / "paddle_prediction.json").read_text())
    assert kept["draws"] == len(kept["rigs"]) == 100
    for j, b in enumerate(paddle.DAMPINGS.tolist()):
        rows = [kept["stiffness_nm_per_rad"][name][j] for name in paddle.ESTIMATORS]
        cells = [f"{r['median']:.0f} ({r['p5']:.0f}\u2013{r['p95']:.0f})" for r in rows]
        assert f"| {b:.3f} | {' | '.join(cells)} |" in PAGE
    encoder, hall = (kept["ultimate_period_ms"][name] for name in ("encoder", "hall"))
    assert abs(encoder[0] / 23.0 - 1.0) < 0.15
    assert abs(hall[0] / 45.0 - 1.0) < 0.15
    assert f"{encoder[0]:.1f} ({encoder[1]:.1f}\u2013{encoder[2]:.1f})" in " ".join(PAGE.split())
    assert f"{hall[0]:.1f} ({hall[1]:.1f}\u2013{hall[2]:.1f})" in " ".join(PAGE.split())
