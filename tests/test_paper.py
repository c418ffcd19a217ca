"""The report of the paper: whole, self-contained, its commands real, its numbers the known ones."""

import ast
import re
import shlex
from dataclasses import replace
from html.parser import HTMLParser
from importlib import import_module
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.figure import Figure

from zwidth.boundary_extras import Asked, extra_cells, extra_headings, with_extras
from zwidth.commands.paper import command
from zwidth.covariance import Covariance, load_covariance, save_covariance
from zwidth.paper.appendix import ROUNDED, appendix
from zwidth.paper.content import Picture, Section, Table
from zwidth.paper.report import draw, save_pictures, save_report, symbols
from zwidth.paper.sections import SECTIONS
from zwidth.results import UNSET, Point
from zwidth.scenarios.paddle import paddle_boundary
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.modal import ModalModel
from zwidth.stability.hand import HANDS, MIDDLE, Hand, hand_band, with_hand
from zwidth.stability.linear import boundary, corner, critical_stiffness
from zwidth.stability.sensitivity import corner_sensitivities, parameter_names, scaled
from zwidth.stability.uncertainty import stiffness_band

PHANTOM = load_device("phantom_1_0")
NAMES = parameter_names(PHANTOM.modal or ModalModel(1.0, 1.0))
ROOT = Path(__file__).parents[1]


class Addresses(HTMLParser):
    """Gather what a page would fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value or "" for name, value in attrs if name in ("src", "href", "data")]


def example() -> Section:
    figure = Figure()
    figure.subplots().plot([0.0, 1.0], [0.0, 1.0])
    return Section(
        "A <title>",
        ("Words & more.", Picture("line", figure, "A line.", "zwidth devices"),
         Table("A table.", ["name", "value"], [["K", "1"]], "zwidth devices")),
    )  # fmt: skip


def test_the_report_holds_everything_and_fetches_nothing(tmp_path: Path):
    """Mutation: link the picture by its file name instead of its data."""
    drawn = draw("one", example(), 0.1)
    assert {p.name for p in save_pictures(drawn, tmp_path)} == {"line.png", "line.svg"}
    page = save_report([drawn], ["Another"], tmp_path / "report.html").read_text(encoding="utf-8")
    seen = Addresses()
    seen.feed(page)
    assert seen.found
    assert all(a.startswith(("data:image/svg+xml;base64,", "#")) for a in seen.found)
    assert "A &lt;title&gt;" in page
    assert "Words &amp; more." in page
    assert "Not in this report: Another." in page


def test_the_same_numbers_give_the_same_bytes():
    first, second = (draw("one", example(), 0.1).parts[1][1].files for _ in range(2))
    assert first["png"] == second["png"]
    assert first["svg"].count(b"<dc:date>") == 0
    plt.close("all")


def test_one_section_as_a_command(tmp_path: Path):
    done = CliRunner().invoke(command, ["--section", "fig_10", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert {p.name for p in tmp_path.glob("[!.]*")} == {"report.html", "fig_10.png", "fig_10.svg"}
    misprints = re.findall(r"misprint, read as ([\d.]+)", page)
    assert misprints == ["0.08", "0.1"]


def test_every_section_is_a_file_of_that_name():
    for key, title in SECTIONS.items():
        module = import_module(f"zwidth.paper.{key}")
        assert callable(module.section)
        assert title in ast.unparse(ast.parse(Path(module.__file__ or "").read_text("utf-8")))


def test_symbols_are_set_as_mathematics_and_nothing_else_is():
    assert symbols("K_CR < B_t, fig_10, omega_2") == (
        "<i>K</i><sub>CR</sub> &lt; <i>B</i><sub>t</sub>, fig_10, <i>ω</i><sub>2</sub>"
    )


def literals(key: str) -> list[str]:
    """All literal `zwidth ...` commands in a section's source."""
    source = (ROOT / "zwidth" / "paper" / f"{key}.py").read_text(encoding="utf-8")
    texts = [n.value for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Constant)]
    return [t for t in texts if isinstance(t, str) and t.startswith("zwidth ")]


@pytest.mark.parametrize("key", SECTIONS)
def test_every_command_that_the_report_shows_is_one(key: str):
    """Mutation: show `--delays-ms`."""
    for line in literals(key):
        name, *arguments = shlex.split(line)[1:]
        try:
            found = import_module(f"zwidth.commands.{name}").command
        except ModuleNotFoundError:
            pytest.skip(f"the command {name} is not there yet")
        if "FILE" not in arguments and arguments[-1:] != ["--lever"]:
            found.make_context(name, arguments)


@pytest.mark.parametrize(
    ("delay", "last", "top", "damping"),
    [(0.002, 0.099, 36.559, 0.085), (0.008, 0.105, 8.882, 0.102)],
)
def test_their_program_is_the_boundary_of_their_rounded_model(
    delay: float, last: float, top: float, damping: float
):
    """Closed form on the circle and eigenvalues agree to 1e-7. Mutation: take any root as least."""
    printed = appendix(delay, last)
    rounded = PHANTOM.with_interface(delay=delay).with_modal(ROUNDED)
    ours = boundary(rounded, printed.damping)
    np.testing.assert_allclose(printed.stiffness, [p.stiffness or np.nan for p in ours], rtol=1e-7)
    np.testing.assert_allclose(
        printed.frequency_hz, [p.frequency_hz or np.nan for p in ours], rtol=1e-7
    )
    best = int(np.argmax(printed.stiffness))
    assert printed.damping[best] == pytest.approx(damping)
    assert printed.stiffness[best] == pytest.approx(top, rel=1e-4)


def test_sensitivities_obey_the_scaling_laws():
    """With m and b both times a, so are B_t and K_max: the sensitivities sum to 1, to the step's
    error of 1e-5. Mutation: leave out the factor 2.
    """
    rows = {row.parameter: row for row in corner_sensitivities(PHANTOM)}
    assert list(rows) == NAMES
    assert rows["m"].damping + rows["b"].damping == pytest.approx(1.0, abs=1e-4)
    assert rows["m"].stiffness + rows["b"].stiffness == pytest.approx(1.0, abs=1e-4)


def test_a_sensitivity_predicts_a_change():
    """Second order: half a per cent of omega_2 moves B_t as said within 3 %. Mutation: sign."""
    rows = {row.parameter: row for row in corner_sensitivities(PHANTOM)}
    assert PHANTOM.modal is not None
    moved = corner(PHANTOM.with_modal(scaled(PHANTOM.modal, "v_2", 1.005)))
    start = corner(PHANTOM)
    assert moved is not None
    assert start is not None
    change = (moved.damping / start.damping - 1.0) / 0.005
    assert change == pytest.approx(rows["v_2"].damping, rel=0.03)


def test_a_weightless_hand_changes_nothing():
    held = with_hand(PHANTOM, Hand(0.0, 0.0, 0.0), 0.1)
    assert critical_stiffness(held, 0.03).stiffness == pytest.approx(
        critical_stiffness(PHANTOM, 0.03).stiffness, rel=1e-9
    )


def test_a_hand_acts_by_its_lever_squared():
    """Mutation: multiply by the lever."""
    once = with_hand(PHANTOM, Hand(0.004, 4.0, 400.0), 0.1)
    twice = with_hand(PHANTOM, Hand(0.001, 1.0, 100.0), 0.2)
    for a, b in zip(once.chain, twice.chain, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12)
    assert once.chain.masses[-1] - PHANTOM.chain.masses[-1] == pytest.approx(4e-5)


@pytest.mark.parametrize("masses", [1, 2, 4, 5])
def test_a_hand_holds_the_last_mass_of_any_chain(masses: int):
    """Mutation: the spring of the hand at m1."""
    links = [20.0] * (masses - 1)
    chain = make_chain([1e-3] * masses, [1e-3] * masses, 0.0, links, [1e-2] * (masses - 1))
    held = with_hand(Device("chain", "", True, chain), Hand(0.1, 1.0, 100.0), 0.1)
    last = held.plant().matrices
    assert last.mass[-1, -1] == pytest.approx(2e-3)
    assert last.stiffness.sum() == pytest.approx(1.0)
    assert last.stiffness[-1].sum() == pytest.approx(1.0)


def test_the_band_holds_every_hand_in_it():
    (band,) = hand_band(PHANTOM, [0.02], 0.14)
    assert len(HANDS) == 9
    inside = critical_stiffness(with_hand(PHANTOM, MIDDLE, 0.14), 0.02).stiffness
    assert inside is not None
    assert band.low < inside < band.high


@pytest.mark.parametrize(("lever", "mass", "word"), [(0.0, 1.0, "lever"), (0.1, -1.0, "hand.mass")])
def test_a_hand_that_cannot_be(lever: float, mass: float, word: str):
    with pytest.raises(ValueError, match=word):
        with_hand(PHANTOM, Hand(mass, 1.0, 1.0), lever)


def test_without_uncertainty_the_band_is_the_boundary():
    (band,) = stiffness_band(PHANTOM, NAMES, np.zeros((10, 10)), [0.05], 3)
    expected = critical_stiffness(PHANTOM, 0.05).stiffness
    assert band == pytest.approx((expected, expected), rel=1e-9)


def test_the_band_of_an_uncertain_damping_is_the_normal_one():
    """At B = 0, K_CR is near b/(T/2 + t_d): with ln b uncertain by s the band is K exp(+-1.96 s),
    within the error of 400 draws, 12 % of its width. Mutation: the covariance as if its own root.
    """
    covariance = np.zeros((10, 10))
    covariance[1, 1] = 0.02**2
    (band,) = stiffness_band(PHANTOM, NAMES, covariance, [0.0], 400)
    width = 0.5 * np.log(band.high / band.low)
    assert width == pytest.approx(1.96 * 0.02, rel=0.12)


def test_a_covariance_of_another_model_is_refused():
    with pytest.raises(ValueError, match="give the device file that was written with it"):
        stiffness_band(PHANTOM, NAMES[:6], np.zeros((6, 6)), [0.0])
    with pytest.raises(ValueError, match="no modal form"):
        stiffness_band(PHANTOM.rigid(), NAMES, np.zeros((10, 10)), [0.0])


def test_a_covariance_is_read_as_it_was_written(tmp_path: Path):
    values = np.diag(np.linspace(1e-9, 1e-3, 10))
    path = save_covariance(tmp_path / "covariance.json", NAMES, values)
    again = load_covariance(path)
    assert again.names == tuple(NAMES)
    np.testing.assert_array_equal(again.values, values)


@pytest.mark.parametrize(
    "text", ["", "{}", '{"schema": 2, "names": [], "covariance": []}',
             '{"schema": 1, "names": ["m"], "covariance": [[1, 2]]}', "[1"]
)  # fmt: skip
def test_a_file_that_is_no_covariance_is_refused_in_a_sentence(tmp_path: Path, text: str):
    path = tmp_path / "covariance.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match="covariance"):
        load_covariance(path)


def test_what_stands_beside_a_boundary_is_there_when_asked_for():
    points = [Point(0.0, None, None), Point(0.05, None, None)]
    assert with_extras(PHANTOM, points, Asked()) == points
    asked = Asked(True, 0.14, Covariance(tuple(NAMES), np.zeros((10, 10))))
    first, second = with_extras(PHANTOM, points, asked)
    assert first.passive is not UNSET
    assert first.passive is not None
    assert first.passive.stiffness == pytest.approx(0.00584 / 0.0025, rel=1e-6)  # b/(T/2 + t_d)
    assert second.passive is None
    assert len(extra_headings(asked)) == len(extra_cells(first)) == 3


def test_the_paddle_is_its_builders_numbers():
    device = load_device("ethz_haptic_paddle")
    assert device.chain.masses.tolist() == [7.0e-4]
    assert [p.damping for p in paddle_boundary()] == sorted(p.damping for p in paddle_boundary())
    assert paddle_boundary()[0].stiffness == 4.0
    assert replace(device, name="x") != device
