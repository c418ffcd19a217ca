"""The boards' adapters: the packages' own splits and metrics, on a bench that is simulated."""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zwidth

pytest.importorskip("nonlinear_benchmarks", reason="pip install 'zwidth[boards]'")
pytest.importorskip("identibench", reason="pip install 'zwidth[boards]'")

from nonlinear_benchmarks.utilities import Input_output_data

import benchmarks.official.__main__ as official
from benchmarks.official.boards import BOARDS, Board, placed
from benchmarks.official.by_identibench import model_of, scores
from zwidth.sim.device_file import save_device

RECORDINGS = Path(__file__).parents[2] / "shared" / "recordings"
WINDOW, VOLT = 20, 2.0  # samples; N


@dataclass(frozen=True)
class Bench(Board):
    """A board of a cart with friction that is simulated."""

    def load(self, folder: Path) -> tuple[Any, tuple[Any, ...]]:
        return data(0), (data(7, WINDOW),)


@cache
def cart() -> zwidth.Device:
    chain = zwidth.make_chain([0.5], [0.8])
    return zwidth.Device("cart", "a test", False, chain, zwidth.Interface(period=0.002, delay=0.0))


@cache
def data(seed: int, window: int | None = None) -> Any:
    command = zwidth.excitation(cart(), seconds=4.0, level=4.0, travel=0.05, seed=seed)
    bench = cart().with_physics(zwidth.make_physics("coulomb_friction", "m1", level=0.3))
    trace = zwidth.simulate(bench, zwidth.recorded(command)).trace
    noise = 1e-5 * np.random.default_rng(seed).standard_normal(command.size)
    return Input_output_data(
        trace["command"] / VOLT, trace["encoder"] + noise, 0.002,
        state_initialization_window_length=window,
    )  # fmt: skip


def test_a_board_is_trained_judged_and_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Mutations that break it: the command's scale left out, or the window counted."""
    save_device(cart(), tmp_path / "cart.toml")
    bench = Bench("bench", "A bench", "-", tmp_path / "cart.toml", VOLT, ("mm", 1e3),
                  {"test": "none"}, "-")  # fmt: skip
    seen: list[Any] = []
    monkeypatch.setattr(official, "scores", lambda *given: seen.append(given) or {"test": 1.0})
    result = official.result_of(bench, tmp_path)
    assert result.errors["test"] < 0.03 * 1e3 * data(7, WINDOW).y.std()
    assert "coulomb_friction@m1" in result.physics
    assert result.floor is not None
    assert 0.0 < result.floor[0] < result.errors["test"]
    said = official.table([result])
    assert f"**{result.errors['test']:.3g} mm**" in said
    assert "Drift floor of A bench" in said
    model = model_of(bench, seen[0][1])
    test = data(7, WINDOW)
    found = model(test.u[:, None], test.y[:WINDOW, None], {})
    off = 1e3 * np.sqrt(np.mean((found[WINDOW:, 0] - test.y[WINDOW:]) ** 2))
    assert off == pytest.approx(result.errors["test"])


def test_the_loaders_find_the_files_that_are_there(tmp_path: Path):
    if not RECORDINGS.is_dir():
        pytest.skip("no folder of recordings beside the repository")
    folder = placed(RECORDINGS, tmp_path)
    train, (test,) = BOARDS["emps"].load(folder)
    assert (len(train), len(test), test.state_initialization_window_length) == (24841, 24841, 20)
    train, tests = BOARDS["silverbox"].load(folder)
    assert [len(train), *map(len, tests)] == [65062, 21688, 40475, 32000]
    assert all(t.state_initialization_window_length == 50 for t in tests)


def test_identibench_refuses_an_answer_of_other_data(tmp_path: Path):
    """So that nobody's test is scored with a model that saw it."""
    if not RECORDINGS.is_dir():
        pytest.skip("no folder of recordings beside the repository")
    board, folder = BOARDS["emps"], placed(RECORDINGS, tmp_path)
    train, _ = board.load(folder)
    other = replace_output(train)
    with pytest.raises(ValueError, match="on other data than this answer's"):
        scores(board, None, other, folder)  # pyright: ignore[reportArgumentType]


def replace_output(train: Any) -> Any:
    return Input_output_data(train.u, 1.1 * train.y, train.sampling_time)
