"""The comparison with peers, in what needs none of them: one error, one split, one table."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks import peers
from benchmarks.command import between_marks
from benchmarks.peer.method import state_before
from benchmarks.peer.page import figure, not_computed, table
from benchmarks.peer.rows import Row, keep, keep_run, kept, kept_run, row_of
from benchmarks.peer.sets import KINDS, Error, Floats, Part, inner, judged
from zwidth.figures.style import MEASURED as COLOUR

ROOT = Path(__file__).parents[1]
T = np.linspace(0.0, 3.99, 400)
MEASURED = np.column_stack([np.sin(T), 3.0 + 2.0 * np.cos(T)])


def row(method: str, error: Error, **other: str) -> Row:
    given = {"set": "two_mass_cart", "peer": "zwidth", "found": "friction"}
    return row_of(error, method=method, units=("m/s", "m/s"), seconds=12.34, **{**given, **other})


def test_the_error_is_the_rms_over_the_motion_about_its_mean():
    """Mutation that breaks it: the rms of what was measured for the motion, or one for all."""
    off = MEASURED + np.array([0.1, -0.2])
    error = judged(MEASURED, off)
    assert error.rms == pytest.approx((0.1, 0.2))
    assert error.share == pytest.approx((0.1 / MEASURED[:, 0].std(), 0.2 / MEASURED[:, 1].std()))
    assert not error.diverges


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30, 100.0])
def test_a_run_that_leaves_the_motion_diverges_in_its_output_alone(value: float):
    """Mutation that breaks it: nan compared as if it were small."""
    off = MEASURED.copy()
    off[300:, 1] = value
    error = judged(MEASURED, off)
    assert error.diverges
    assert error.rms == (0.0, np.inf)
    assert error.share == (0.0, np.inf)


def test_nobody_may_leave_samples_out():
    with pytest.raises(ValueError, match="every held-out sample"):
        judged(MEASURED, MEASURED[:-1])


def test_settings_are_chosen_inside_the_fitted_part():
    part = Part(T, MEASURED)
    first, rest = inner(part)
    assert (first.ticks, rest.ticks) == (280, 120)
    assert np.array_equal(np.r_[first.command, rest.command], T)
    assert np.array_equal(np.vstack([first.measured, rest.measured]), MEASURED)


def test_the_state_before_the_cut_is_that_of_the_motion():
    """An oscillator that begins at 0.3 and -0.7, guessed at rest."""

    def simulated(state: Floats) -> Floats:
        return (state[0] * np.cos(T) + state[1] * np.sin(T))[:, None]

    truth = np.array([0.3, -0.7])
    found = state_before(simulated, simulated(truth), np.zeros(2), np.ones(2))
    assert found == pytest.approx(truth, abs=1e-6)


def test_a_model_that_overflows_keeps_its_guess():
    def simulated(state: Floats) -> Floats:
        return np.full((T.size, 1), np.nan)

    guess = np.array([0.1, 0.2])
    assert np.array_equal(state_before(simulated, MEASURED[:, :1], guess, np.ones(2)), guess)


def test_the_table_has_every_row_and_says_what_diverges():
    rows = [
        row("PySINDy", Error((0.01, np.inf), (0.125, np.inf)), peer="pysindy"),
        row("zwidth diagnose", Error((0.0123, 0.02), (0.1, 0.2))),
    ]
    known = {("two_mass_cart", r.method): "the masses" for r in rows}
    lines = table(rows, peers.ORDER, known).splitlines()
    assert len({line.count("|") for line in lines}) == 1
    kind = KINDS["two_mass_cart"]
    assert lines[2] == (
        f"| {kind.title} | zwidth diagnose | 12.3 mm/s, 20 mm/s | 10 %, 20 % | 12 | the masses |"
        f" {kind.published} |"
    )
    assert lines[3] == "|  | PySINDy | 10 mm/s, diverges | 12.5 %, - | 12 | the masses |  |"


def test_what_has_no_row_is_said():
    rows = [row("zwidth diagnose", Error((0.0123, 0.02), (0.1, 0.2)))]
    known = {("two_mass_cart", "zwidth diagnose"): "", ("two_mass_cart", "PySINDy"): ""}
    assert not_computed(rows, known) == "Not computed yet: Two carts on a spring: PySINDy.\n\n"
    del known["two_mass_cart", "PySINDy"]
    assert not_computed(rows, known) == ""


def test_rows_and_runs_are_kept_and_replaced_by_set_and_peer(tmp_path: Path):
    """Mutation that breaks it: rows replaced by their set alone."""
    keep(tmp_path, [row("zwidth diagnose", Error((1.0,), (1.0,)))])
    keep(tmp_path, [row("PySINDy", Error((np.inf,), (np.inf,)), peer="pysindy")])
    keep(tmp_path, [row("zwidth diagnose", Error((2.0,), (2.0,)))])
    found = {r.method: r.rms for r in kept(tmp_path)}
    assert found == {"zwidth diagnose": (2.0,), "PySINDy": (None,)}
    json.loads((tmp_path / "rows.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    keep_run(tmp_path, "emps.PySINDy, told", MEASURED)
    assert np.array_equal(kept_run(tmp_path, "emps.PySINDy, told"), MEASURED)


def test_a_file_of_no_rows_is_refused(tmp_path: Path):
    (tmp_path / "rows.json").write_text('[{"set": 1}]', encoding="utf-8")
    with pytest.raises(ValueError, match="remove it and compute again"):
        kept(tmp_path)


def test_a_page_keeps_its_text_around_the_table():
    page = "before\n<!-- made by x.py -->\nold\n<!-- until here -->\nafter\n"
    assert between_marks(page, "new\n", "x.py") == page.replace("old", "new")
    with pytest.raises(ValueError, match="the page lacks"):
        between_marks("a page\n", "new\n", "x.py")


def test_the_picture_draws_runs_and_names_those_that_diverge():
    """Mutations: the legend on the curves; what was measured in a colour of its own."""
    rows = [
        row("zwidth diagnose", Error((0.0, 0.1), (0.0, 0.1))),
        row("PySINDy", Error((np.inf, np.inf), (np.inf, np.inf)), peer="pysindy"),
    ]
    runs = {("two_mass_cart", r.method): MEASURED + 0.1 for r in rows}
    made = figure(rows, peers.ORDER, {"two_mass_cart": MEASURED}, runs, {"two_mass_cart": 0.01})
    motion = made.subfigs[0].axes[0]
    assert motion.get_ylabel().endswith("[mm/s]")
    labels = [line.get_label() for line in motion.get_lines()]
    assert labels == ["measured", "zwidth diagnose", "PySINDy: diverges"]
    assert motion.get_lines()[0].get_color() == COLOUR
    made.canvas.draw()
    (legend,) = made.subfigs[0].legends
    assert motion.get_legend() is None  # it would lie on the curves
    assert not legend.get_window_extent().overlaps(motion.get_window_extent())


def test_peers_that_are_missing_are_named_with_what_to_install(monkeypatch: pytest.MonkeyPatch):
    lacking = peers.Peer(peers.PEERS["pysindy"].forms, (("no_such_module_here", "SINDy"),))
    monkeypatch.setitem(peers.PEERS, "pysindy", lacking)
    with pytest.raises(peers.Missing, match=r"PySINDy cannot .* pip install 'zwidth\[peers\]'"):
        peers.refuse_missing(["zwidth", "pysindy"])


def test_the_command_refuses_a_folder_without_recordings(tmp_path: Path):
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.peers", str(tmp_path / "none"), "--only", "emps",
         "--only-peer", "zwidth"],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert "none" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize("name", KINDS)
def test_every_method_says_what_had_to_be_known(name: str):
    said = [peers.KNOWN[name, form.method] for peer in peers.PEERS.values()
            for form in peer.forms if name in form.known]  # fmt: skip
    assert len(said) >= 4
    assert all(said)
    assert {method for _, method in peers.KNOWN} == set(peers.ORDER)


@pytest.mark.parametrize("name", KINDS)
def test_every_set_has_its_files(name: str):
    kind = KINDS[name]
    wanted = ["device", kind.fit, *([kind.judge] if kind.judge else [])]
    assert all((kind.folder / f"{stem}.toml").is_file() for stem in wanted)
