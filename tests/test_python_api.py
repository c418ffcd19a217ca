"""zwidth from Python: public names, defaults, and results that show themselves."""

import inspect
import os
import pydoc
import re
import typing
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sampled import SAMPLE, Sampled

import zwidth
import zwidth.views as views
from zwidth import JointAnswers
from zwidth.api.given import device_of, experiments_of, named_traces, trace_of
from zwidth.exam.fleets import make_fleet, nominal
from zwidth.fleet.kept import Kept
from zwidth.fleet.structure import known_structure
from zwidth.shown import Shown

API = "zwidth.api."
OVERVIEW = 150  # lines of help(zwidth)
LINES, COLUMNS = 12, 100  # of a result in a terminal
# One mass on a slow clock, so that nothing here takes long.
CART = """
schema = 1
name = "cart"
source = "a test"
rotary = false

[chain]
masses = [0.5]
ground_dampers = [0.8]
ground_spring = 0.0
link_springs = []
link_dampers = []

[interface]
period_s = 0.002
delay_s = 0.002
encoder_step = 1e-5
"""


@cache
def cart() -> zwidth.Device:
    chain = zwidth.make_chain([0.5], [0.8])
    face = zwidth.Interface(period=0.002, delay=0.002, encoder_step=1e-5)
    return zwidth.Device("cart", "a test", False, chain, face)


@cache
def recording() -> zwidth.Run:
    """What a bench with friction would record, that the device file does not know."""
    friction = zwidth.make_physics("coulomb_friction", "m1", level=0.3)
    command = zwidth.excitation(cart(), seconds=4.0, level=4.0, travel=0.05)
    noise = 0.02 * np.random.default_rng(0).standard_normal(command.size)
    rubbing = cart().with_physics(friction)
    return zwidth.simulate(rubbing, zwidth.recorded(command), disturbance=noise)


def fleet(folder: Path) -> zwidth.Fleet:
    """Six recordings of three joints, whose structure is known, so that none is searched for."""
    known = nominal().with_physics(zwidth.make_physics("coulomb_friction", "m1", level=0.04))
    if not (folder / "rig").exists():
        make_fleet(folder / "rig", 3, 2, 0, 1, 3.0)
        Kept(folder / "work", known, "quick").keep_structure(known_structure(known), 6)
    return zwidth.diagnose_fleet(folder / "rig", known, effort="quick", work=folder / "work")


@cache
def identified() -> zwidth.Identified:
    command = zwidth.excitation(cart(), "white_noise", seconds=20.0, level=4.0, travel=0.05)
    smooth = cart().with_interface(encoder_step=0.0)
    noise = 0.02 * np.random.default_rng(0).standard_normal(command.size)
    run = zwidth.simulate(smooth, zwidth.recorded(command), disturbance=noise)
    return zwidth.identify(run, delay=0.002, name="cart again")


@cache
def scenario() -> zwidth.Scenario:
    tap = zwidth.Disturbance("pulse", 0.5, from_s=0.1, to_s=0.12)
    return zwidth.Scenario(cart(), zwidth.wall(40.0, 1.0), 0.5, disturbances=(tap,))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("api")
    (folder / "cart.toml").write_text(CART)
    zwidth.logged_run(scenario(), folder / "run.mcap")
    return folder


@dataclass(frozen=True)
class Given:
    """What results are made of: a folder of these tests, and the answer to the shipped sample."""

    folder: Path
    request: pytest.FixtureRequest

    @property
    def sampled(self) -> Sampled:
        """The answer, which is computed where it is asked for only."""
        return self.request.getfixturevalue("sampled")


RESULTS: dict[str, Callable[[Given], Any]] = {
    "Device": lambda _: zwidth.load_device("phantom_1_0"),
    "Boundary": lambda _: zwidth.boundary(cart(), [0.0, 2.0, 40.0]),
    "FateMap": lambda _: zwidth.make_map(cart(), coarse=5, levels=0),
    "Run": lambda _: recording(),
    "Trace": lambda _: recording().trace,
    "Log": lambda of: zwidth.load_log(of.folder / "run.mcap"),
    "LoggedRun": lambda of: zwidth.logged_run(scenario(), of.folder / "again.mcap"),
    "ReplayResult": lambda of: zwidth.replay(of.folder / "run.mcap"),
    "Scenario": lambda _: scenario(),
    "Diagnosis": lambda of: of.sampled.found,
    "Check": lambda of: zwidth.check(of.sampled.found.device, SAMPLE),
    "JointAnswers": lambda of: JointAnswers({"0": of.sampled.found}, {"1": "it stands still"}),
    "Fleet": lambda of: fleet(of.folder),
    "Identified": lambda _: identified(),
    "Sweep": lambda _: zwidth.sweep(cart(), values=[20.0], dampings=3, rounds=0),
    "RelayReadings": lambda _: zwidth.relay(cart(), [0.0, 2.0], starts=2),
    "Plan": lambda _: zwidth.plan(cart(), "random_steps", seconds=1.0, level=4.0, travel=0.05),
}


@pytest.fixture(scope="module")
def results(folder: Path, request: pytest.FixtureRequest) -> dict[str, Any]:
    """Each result once, made when it is first asked for."""

    class Made(dict[str, Any]):
        def __missing__(self, name: str) -> Any:
            return self.setdefault(name, RESULTS[name](Given(folder, request)))

    return Made()


def functions() -> list[str]:
    return [name for name in zwidth.HOMES if inspect.isfunction(getattr(zwidth, name))]


def classes_in(hint: object) -> Iterator[type]:
    """Every class of ours in an annotation."""
    if isinstance(hint, type) and not typing.get_args(hint):
        if hint.__module__.startswith("zwidth."):
            yield hint
        return
    for part in typing.get_args(hint):
        if isinstance(part, list):
            for inner in part:
                yield from classes_in(inner)
        else:
            yield from classes_in(part)


@pytest.mark.parametrize("name", functions())
def test_types_that_a_public_function_takes_and_returns_are_public(name: str):
    """Mutation: `Search` left out of the public names."""
    hints = typing.get_type_hints(getattr(zwidth, name))
    hidden = {c.__name__ for hint in hints.values() for c in classes_in(hint)} - set(zwidth.HOMES)
    assert not hidden


@pytest.mark.parametrize("name", [n for n, m in zwidth.HOMES.items() if m.startswith(API)])
def test_a_question_from_python_says_what_each_argument_is(name: str):
    function = getattr(zwidth, name)
    text = inspect.getdoc(function) or ""
    assert [p for p in inspect.signature(function).parameters if p not in text] == []
    assert "Raises" in text


def test_help_is_an_overview():
    """Mutation: an `__all__`, by which pydoc prints every method of every class."""
    text = pydoc.plain(pydoc.render_doc(zwidth))
    assert len(text.splitlines()) < OVERVIEW
    for name in ("boundary", "simulate", "diagnose", "identify", "relay", "plan", "make_map"):
        assert f"    {name}" in text
    assert "__weakref__" not in text
    words = set(text.replace(",", " ").replace("(", " ").replace(".", " ").split())
    assert {n for n in functions() if n not in words} == set()


def test_a_device_is_taken_by_value_by_name_and_by_path(folder: Path):
    assert device_of("phantom_1_0") == zwidth.load_device("phantom_1_0")
    assert device_of(folder / "cart.toml") == device_of(str(folder / "cart.toml")) == cart()
    with pytest.raises(ValueError, match="neither a file nor a shipped device"):
        zwidth.boundary("phantom_2_0")
    with pytest.raises(TypeError, match="device is of type int"):
        zwidth.boundary(3)  # pyright: ignore[reportArgumentType]


def test_boundary_with_defaults_is_that_of_the_shipped_device():
    """Its top by simulation stands within a bracket's width of the corner by theory."""
    found = zwidth.boundary("phantom_1_0")
    top, corner = found.top, zwidth.corner(zwidth.load_device("phantom_1_0"))
    assert len(found.points) > 40
    assert top is not None
    assert corner is not None
    assert top.damping == pytest.approx(corner.damping, rel=1e-6)
    assert top.simulated.stable == pytest.approx(corner.stiffness, rel=1e-3)
    assert "Stiffest stable wall" in repr(found)


def test_simulate_with_defaults_moves_and_decays_below_the_boundary():
    run = zwidth.simulate("phantom_1_0", zwidth.wall(2.0, 0.01))
    position = run.trace["position_m1"]
    assert run.trace.t[-1] == pytest.approx(3.999)
    assert position[0] == 1e-3
    assert np.abs(position[-100:]).max() < 1e-6


def test_simulate_plays_a_recorded_command_from_rest_to_its_end():
    run = zwidth.simulate(cart(), zwidth.recorded(np.full(100, 1.0)))
    assert len(run.trace) == 100
    assert run.trace["position_m1"][0] == 0.0
    assert run.trace["position_m1"][-1] > 0.0


def test_simulate_takes_the_substeps_that_friction_needs():
    friction = zwidth.make_physics("coulomb_friction", "m1", level=0.3)
    device, law, far = cart().with_physics(friction), zwidth.wall(40.0, 0.0), zwidth.Start(0.02)
    runs = (zwidth.simulate(device, law, start=far, substeps=n) for n in (None, 10, 1))
    usual, ten, one = (run.trace["position_m1"] for run in runs)
    assert np.array_equal(usual, ten)
    assert not np.array_equal(usual, one)


def test_simulate_runs_a_scenario_as_its_log_has_it(folder: Path):
    run, log = zwidth.simulate(scenario()), zwidth.load_log(folder / "run.mcap")
    assert np.array_equal(run.trace["position_m1"], log.tick["position_m1"])
    with pytest.raises(ValueError, match="a scenario contains every setting of its run"):
        zwidth.simulate(scenario(), duration=1.0)


def test_make_map_of_a_device_lies_around_its_linear_boundary():
    found = zwidth.make_map("phantom_1_0", coarse=3, levels=0)
    assert (found.plane.x.quantity, found.plane.y.quantity) == ("B", "K")
    assert found.linear.min() < 0.0 < found.linear.max()


def test_a_recording_is_taken_as_path_trace_run_and_log(folder: Path):
    log = zwidth.load_log(folder / "run.mcap")
    known = log.tick["command"]
    for given in (folder / "run.mcap", str(folder / "run.mcap"), log, log.tick):
        assert np.array_equal(trace_of(given)["command"], known)
    assert trace_of(recording()) is recording().trace
    with pytest.raises(TypeError, match="recording is of type int"):
        trace_of(3)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="no recording is given"):
        named_traces([])
    named = named_traces([recording(), recording()])
    assert [e.name for e in experiments_of(named, cart())] == ["recording", "recording 2"]


def test_what_is_odd_about_a_recording_is_warned_of(folder: Path):
    lines = [f"{0.01 * k!r},{float(np.sin(k))!r},{k}" for k in range(50)]
    (folder / "odd.csv").write_text("\n".join(["t,u,y", *lines]))  # as if it were cut off
    (folder / "odd.toml").write_text(
        'schema = 1\nfile = "odd.csv"\ntime = "t"\n[input]\nsignal = "u"\nunit = "N"\n'
        '[[output]]\nsignal = "y"\nquantity = "position"\nat = "m1"\nunit = "m"\n'
    )
    with pytest.warns(UserWarning, match=r"^odd\.toml: the last line has no end"):
        trace_of(folder / "odd.toml")


def test_diagnose_takes_paths_and_finds_the_friction(folder: Path):
    """Mutation: a device of a path that is not read. 0.3 N is what the bench had."""
    zwidth.write_log(folder / "bench.mcap", recording().trace)
    found = zwidth.diagnose(folder / "bench.mcap", folder / "cart.toml", effort="quick")
    (friction,) = found.findings
    assert (friction.effect, friction.at) == ("coulomb_friction", "m1")
    # A regression on the true states and forces of this bench scatters by 0.00076 N (150 seeds).
    assert friction.parameters["level"].value == pytest.approx(0.3, abs=3.0 * 0.00076)
    known = device_of(folder / "cart.toml")
    (own,), (by_path,) = (
        experiments_of(named_traces(given), known) for given in (recording(), folder / "bench.mcap")
    )
    assert known == cart()
    np.testing.assert_array_equal(by_path.command, own.command)
    np.testing.assert_array_equal(by_path.measured, own.measured)
    with pytest.raises(ValueError, match="effort is 'quik'"):
        zwidth.diagnose(recording(), cart(), effort="quik")  # pyright: ignore[reportArgumentType]


def test_a_fleet_is_taken_as_folder_table_rows_and_list(folder: Path):
    """Mutation: rows without their dates or known values."""
    import pandas

    first = fleet(folder)
    frame = pandas.read_csv(folder / "rig" / "fleet.csv")
    frame["recording"] = [str(folder / "rig" / name) for name in frame["recording"]]
    listed = [m.listed for m in first.members]
    for given in (folder / "rig" / "fleet.csv", frame.to_dict("records"), listed):
        every = zwidth.api.diagnose_fleet._listed(given)  # type: ignore[attr-defined]
        assert [(m.path, m.device, m.date, m.known) for m in every] == [
            (m.path, m.device, m.date, m.known) for m in listed
        ]
    table = first.to_pandas()
    assert table["m1"].tolist() == [m.quick.values[0] for m in first.members]
    assert table.attrs["units"]["m1"] == "kg m2"
    assert np.all(table["m1 pooled"].to_numpy() > 0.0)
    assert len(first.plot("parameters").axes) == len(first.spreads)
    assert "6 recordings of 3 devices" in repr(first)


@pytest.mark.parametrize(
    ("given", "error", "said"),
    [
        ("nowhere", ValueError, "does not exist"),
        ([], ValueError, "no recording is given"),
        ([3], TypeError, "a folder, a table, or a list"),
        ([{"device": "a"}], ValueError, "has no file"),
    ],
)
def test_what_is_no_fleet_is_said(given: Any, error: type[Exception], said: str):
    with pytest.raises(error, match=said):
        zwidth.diagnose_fleet(given, cart())


def test_diagnose_takes_a_csv_and_fits_a_device(tmp_path: Path):
    """Mutation: what was assumed of a file kept back; the device asked for."""
    friction = zwidth.make_physics("coulomb_friction", "m1", level=0.3)
    bench = cart().with_interface(delay=0.0, encoder_step=0.0).with_physics(friction)
    command = zwidth.excitation(cart(), seconds=4.0, level=4.0, travel=0.05)
    trace = zwidth.simulate(bench, zwidth.recorded(command)).trace
    noise = 1e-6 * np.random.default_rng(0).standard_normal(trace.t.size)
    table = np.column_stack([trace.t, command, 1e3 * (trace["position_m1"] + noise)])
    file = tmp_path / "bench.csv"
    np.savetxt(file, table, "%.9g", ",", header="t,force,x_mm", comments="")
    with pytest.warns(UserWarning, match=r"bench\.csv: assumed: force has no unit: N is assumed"):
        found = zwidth.diagnose(file, effort="quick")
    assert [(f.effect, f.at) for f in found.findings] == [("coulomb_friction", "m1")]
    assert found.findings[0].parameters["level"].value == pytest.approx(0.3, rel=0.02)
    assert found.device.chain.masses == pytest.approx([0.5], rel=0.02)


def test_identify_gives_a_device_that_has_the_mass():
    found = identified()
    value, low, high = found.fit.intervals()["m"]
    assert found.device.name == "cart again"
    assert not found.device.rotary
    assert low < 0.5 < high
    assert value == pytest.approx(0.5, rel=0.02)


def test_plan_needs_a_noise_where_there_is_no_encoder():
    with pytest.raises(ValueError, match=r"give --noise \(noise= in Python\)"):
        zwidth.plan("phantom_1_0")


def test_all_results_are_shown():
    """Mutation: a result of a public name without a view."""
    shown = {n for n in zwidth.HOMES if isinstance(v := getattr(zwidth, n), type) and is_shown(v)}
    assert shown == set(RESULTS)


def test_the_page_of_python_names_every_result():
    """Mutation: a result that the page leaves out, or that there is not."""
    page = Path(__file__).parents[1] / "docs" / "python.md"
    if not page.is_file():
        pytest.skip("not a clone: the wheel has no documentation")
    listed = page.read_text(encoding="utf-8").partition("## Results")[2].partition("in common:")[0]
    assert sorted(re.findall(r"`(\w+)`", listed)) == sorted(RESULTS)


def is_shown(value: type) -> bool:
    return issubclass(value, Shown)


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_is_a_few_lines_in_a_terminal(results: dict[str, Any], name: str):
    text = repr(results[name])
    lines = text.splitlines()
    assert 1 <= len(lines) <= LINES
    assert max(map(len, lines)) <= COLUMNS
    assert "array(" not in text
    assert " object at 0x" not in text


class Tags(HTMLParser):
    """Checks that tags close in the order in which they opened."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.rows: list[int] = []

    def handle_starttag(self, tag: str, attrs: object) -> None:
        self.open.append(tag)
        if tag == "tr":
            self.rows.append(0)
        elif tag in ("td", "th"):
            self.rows[-1] += 1

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_is_a_table_in_a_notebook(results: dict[str, Any], name: str):
    parser = Tags()
    parser.feed(results[name]._repr_html_())
    parser.close()
    assert parser.open == []
    assert len(set(parser.rows)) <= 1
    assert len(parser.rows) > 1 or name == "ReplayResult"


@pytest.mark.parametrize("name", RESULTS)
def test_every_part_of_a_result_is_a_table(results: dict[str, Any], name: str):
    """Mutations: complex numbers in order of size; functions and arrays as Python prints them."""
    parts: dict[type, Any] = {}
    gather(results[name], parts)
    for part in parts.values():
        text = part._repr_html_()
        parser = Tags()
        parser.feed(text)
        parser.close()
        assert parser.open == []
        assert " object at 0x" not in text
        assert "array(" not in text


def gather(value: Any, parts: dict[type, Any]) -> None:
    """Collect one value of each type that a notebook may be asked to show."""
    if isinstance(value, Mapping):
        for one in list(value.values()):
            gather(one, parts)
    elif is_dataclass(value) and not isinstance(value, type):
        if type(value) in parts or not hasattr(value, "_repr_html_"):
            return
        parts[type(value)] = value
        for field in fields(value):
            gather(getattr(value, field.name), parts)
    elif isinstance(value, tuple | list):
        if hasattr(value, "_repr_html_"):
            parts[type(value)] = value
        for one in value:
            gather(one, parts)


def test_fields_are_rows_in_words():
    """Mutations: an interval as three numbers; a device whole; a name as it is."""
    level = zwidth.Estimate(0.02, 0.019, 0.021, "N m")
    rival = zwidth.Rival("<b>", "m1", 3.0)
    html = zwidth.Finding("coulomb_friction", "m1", {"level": level}, 51.0, (rival,))._repr_html_()
    rows = re.findall(r"<tr><td[^>]*>(.*?)</td><td[^>]*>(.*?)</td></tr>", html)
    found = dict(rows)
    assert found["parameters"] == "level: 20.0 mN m (19.0 to 21.0)"
    assert found["separation sigma"] == "51"
    assert found["rivals"] == "effect &lt;b&gt;, at m1, separation sigma 3"
    assert found["probability"] == "-"
    fit = zwidth.nearest_passive(zwidth.load_device("phantom_1_0").chain)
    assert "masses " in fit._repr_html_()
    corner = zwidth.corner(zwidth.load_device("phantom_1_0"))
    assert corner is not None
    assert "array(" not in corner._repr_html_()


def test_a_table_escapes_what_a_name_holds():
    """Mutation: a title or a cell that goes into the page as it is."""
    t = np.arange(3.0)
    text = views.html(zwidth.Trace(t, {"<b>": t}, {"<b>": "&"}, "recorded", {"device": "<i>"}))
    assert "<b>" not in text.replace("<p><b>", "")
    assert "&lt;b&gt;" in text
    assert "Trace, recorded, &lt;i&gt;: 3 samples" in text
    assert ">&amp;<" in text


@pytest.mark.parametrize("name", RESULTS)
def test_every_number_of_a_dataset_has_its_unit(results: dict[str, Any], name: str):
    found = results[name].to_xarray()
    numeric = {n: v for n, v in found.variables.items() if v.dtype.kind in "fc"}
    assert numeric
    described = {"linear", "rests_up_to", "grows_from"} if name == "FateMap" else set[str]()
    assert {n for n, v in numeric.items() if "units" not in v.attrs} <= described


@pytest.mark.parametrize("name", RESULTS)
def test_a_frame_has_a_row_for_every_point(results: dict[str, Any], name: str):
    found = results[name].to_xarray()
    first = next(iter(found.data_vars.values()))
    frame = results[name].to_pandas()
    assert len(frame) == first.size
    assert first.name in frame.columns
    units = {str(n): v.attrs["units"] for n, v in found.data_vars.items() if "units" in v.attrs}
    assert {n: u for n, u in frame.attrs["units"].items() if n in frame.columns} == {
        n: u for n, u in units.items() if n in frame.columns
    }


@pytest.mark.parametrize("library", ["pandas", "polars"])
@pytest.mark.parametrize("name", RESULTS)
def test_a_frame_has_its_axes_as_columns(results: dict[str, Any], name: str, library: str):
    """Mutation: the axes left in the index, which polars has not."""
    pytest.importorskip(library)
    table, found = results[name].to_pandas(), results[name].to_frame(library)
    assert type(found).__module__.split(".")[0] == library
    assert found.shape[0] == len(table)
    axes = [axis for axis in results[name].to_xarray().dims if axis in table.index.names]
    assert list(found.columns) == [*axes, *table.columns]


T_OF_TABLE = 1e-3 * np.arange(400)
TABLE = {"t": T_OF_TABLE, "u": np.sin(20.0 * T_OF_TABLE), "q": np.cos(20.0 * T_OF_TABLE)}


@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [
        ({"recordings": 5}, TypeError, "recordings is of type int"),
        ({"validate": 5}, TypeError, "validate is of type int"),
        ({"recordings": []}, ValueError, "recordings is empty"),
        ({"device": 5}, TypeError, "device is of type int"),
        ({"known_torque": "arm.xml"}, ValueError, "known_torque is 'arm.xml'; give the model"),
        ({"time": 3}, TypeError, "time is 3; give the name of a column"),
        ({"time": "x"}, ValueError, "time is 'x', which is not a column of numbers"),
        ({"command": "q", "position": "q"}, ValueError, "command and position are both 'q'"),
        (
            {"recordings": {**TABLE, "q": TABLE["q"][:-5]}, "command": "u", "position": "q"},
            ValueError,
            "command 'u' has 400 and position 'q' has 395 samples; they must have equally many",
        ),
    ],
)
def test_errors_name_the_argument(arguments: dict[str, Any], error: type[Exception], said: str):
    """Mutation: any of the checks left out, which numpy or Python then says in words of its own."""
    given: dict[str, Any] = {"recordings": TABLE, **arguments}
    if "known_torque" in arguments:
        given["device"] = cart()
        given["recordings"] = recording()
    with warnings.catch_warnings(action="ignore"), pytest.raises(error, match=re.escape(said)):
        zwidth.diagnose(given.pop("recordings"), **given)


def test_another_library_of_frames_is_refused():
    with pytest.raises(ValueError, match="library is 'arrow'; it must be pandas or polars"):
        recording().to_frame("arrow")  # pyright: ignore[reportArgumentType]
    assert type(recording().to_frame()).__module__.startswith("pandas")


def test_a_boundary_of_python_control_ends_where_the_linear_theory_says(results: dict[str, Any]):
    """The largest pole of the closed loop is on the circle at every point of the boundary.

    Mutations: the velocity without its filter; K and B exchanged.
    """
    control = pytest.importorskip("control")
    boundary = results["Boundary"]
    system = boundary.to_control()
    assert system.dt == boundary.device.interface.period
    assert (system.input_labels, system.output_labels) == (["force"], ["position", "velocity"])
    ends = [p for p in boundary.points if p.linear.stiffness]
    assert ends
    for point in ends:
        wall = np.array([[point.linear.stiffness, point.damping]])
        poles = control.feedback(system, wall).poles()
        assert np.abs(poles).max() == pytest.approx(1.0, abs=1e-6)


def test_numbers_come_through_as_they_are(results: dict[str, Any]):
    trace = recording().trace
    found = recording().to_xarray()
    assert np.array_equal(found["position_m1"], trace["position_m1"])
    assert found["command"].attrs["units"] == "N"
    assert found["time"].attrs["units"] == "s"
    boundary = results["Boundary"]
    stable = boundary.to_xarray()["stable"].to_numpy()
    expected = [p.simulated.stable for p in boundary.points]
    assert [None if np.isnan(v) else v for v in stable] == expected
    found = results["Diagnosis"]
    (rubs,) = (f for f in found.findings if f.effect == "stribeck_friction")
    level = found.to_xarray().sel(parameter="static_level")
    assert level["value"].item() == rubs.parameters["static_level"].value
    assert level["unit"].item() == "N m"
    fit = identified().to_xarray()
    assert np.array_equal(fit["measured"], identified().fit.response.value)
    assert fit["measured"].attrs["units"] == "m/(N)"
    plan = results["Plan"]
    assert np.array_equal(plan.to_xarray()["distance"], plan.distances)


@pytest.mark.parametrize("name", RESULTS)
def test_a_plot_has_axes_with_units(results: dict[str, Any], name: str):
    from matplotlib.figure import Figure

    figure = results[name].plot()
    assert isinstance(figure, Figure)
    labels = [a.get_xlabel() + a.get_ylabel() for a in figure.axes]
    assert any("[" in label and "]" in label for label in labels), labels
    figure.canvas.draw()


@pytest.mark.parametrize("picture", ["motion", "missing force", "residual", "force"])
def test_a_diagnosis_has_the_pictures_of_its_report(sampled: Sampled, picture: str):
    sampled.found.plot(picture).canvas.draw()


def test_a_picture_that_there_is_not_is_refused_with_those_that_there_are(sampled: Sampled):
    with pytest.raises(ValueError, match="'motion' or 'missing force' or 'residual' or 'force'"):
        sampled.found.plot("phase")


def test_a_replay_that_differs_shows_where(results: dict[str, Any]):
    from dataclasses import replace

    same = results["ReplayResult"]
    first = zwidth.Difference(7, 0.014, "/tick", "command", 1.0, 2.0)
    other = replace(same, identical=False, first_difference=first)
    assert repr(same) == "Replay: identical, 250 ticks, every channel bit for bit"
    assert "different" in repr(other)
    assert "0.014" in repr(other)
    title = other.plot().axes[0].get_title(loc="left")
    assert "command differs from t = 0.014 s on" in title


def test_a_missing_pandas_is_said_in_one_sentence(monkeypatch: pytest.MonkeyPatch):
    def gone(name: str) -> Any:
        if name == "pandas":
            raise ImportError(name)
        return SimpleNamespace()

    monkeypatch.setattr(views, "import_module", gone)
    with pytest.raises(ImportError, match=r"needs pandas, .* run: pip install pandas"):
        views.frame(recording())


@pytest.mark.truth
def test_the_page_of_python_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The blocks of docs/python.md, as a reader would type them; the first is ten lines or so."""
    text = (Path(__file__).parents[1] / "docs" / "python.md").read_text(encoding="utf-8")
    first, *others = (part.split("```")[0] for part in text.split("```python\n")[1:])
    assert len([line for line in first.splitlines() if line.strip()]) <= 12
    monkeypatch.chdir(tmp_path)
    fleet(tmp_path)
    (tmp_path / "rig").rename("recordings")
    (tmp_path / "work").rename("runs_fleet")
    known = nominal().with_physics(zwidth.make_physics("coulomb_friction", "m1", level=0.04))
    zwidth.save_device(known, "joint.toml")
    names: dict[str, Any] = {}
    for block in (first, *others):
        block = block.replace("processes=2", "").replace("runs/fleet", "runs_fleet")
        exec(block, names)
    assert names["answer"].findings[0].effect == "coulomb_friction"
    assert {"run.png", "improved.toml"} <= set(os.listdir(tmp_path))
    assert device_of("improved.toml").physics
