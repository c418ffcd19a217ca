"""Scenarios: what a file may say, what it says back, and which forces it means."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from physics_examples import entry_of, example

from zwidth.cli import run
from zwidth.controllers.none import none
from zwidth.controllers.recorded import recorded
from zwidth.controllers.relay import relay
from zwidth.controllers.wall import wall
from zwidth.logs.mcap_reader import read_log
from zwidth.scenarios.disturbance import Disturbance
from zwidth.scenarios.logged_run import logged_run
from zwidth.scenarios.run_verdict import run_verdict
from zwidth.scenarios.scenario import Scenario
from zwidth.scenarios.scenario_file import (
    ScenarioError,
    load_scenario,
    scenario_from_text,
    scenario_to_text,
)
from zwidth.sim.chain import make_chain
from zwidth.sim.controller import user_controller
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_to_text, load_device
from zwidth.sim.fate import Fate
from zwidth.sim.growth import Verdict
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Start, simulate

PHANTOM = load_device("phantom_1_0")
MASS = Device("a mass", "", False, make_chain([0.5], [0.0]), Interface(period=0.001))
MINIMAL = """
duration_s = 0.5
[device]
name = "phantom_1_0"
[controller]
kind = "wall"
stiffness = 10
damping = 0.05
"""


def push(k, t, y, v, p, m):  # pyright: ignore
    m[1] += 1.0
    return -p[0] * y


finite = st.floats(allow_nan=False, allow_infinity=False)
times = st.floats(0.0, 0.3)
disturbances = st.one_of(
    st.builds(Disturbance, st.just("constant"), finite, st.sampled_from(["m1", "m3"]), times),
    st.builds(Disturbance, st.just("pulse"), finite, st.just("m2"), times, st.floats(0.4, 9.0)),
    st.builds(Disturbance, st.just("noise"), finite, st.just("m1"), times, st.just(math.inf)),
    st.builds(
        Disturbance, st.just("sine"), finite, st.just("m1"), times,
        frequency_hz=st.floats(1e-3, 499.0), phase_rad=finite,
    ),
)  # fmt: skip
laws = st.one_of(
    st.builds(wall, finite, finite, finite, st.booleans()),
    st.builds(relay, st.floats(1e-300, 1e300), finite),
    st.just(none()),
    st.lists(finite, max_size=4).map(lambda values: recorded(np.array(values))),
    st.lists(finite, max_size=3).map(lambda p: user_controller(push, np.array(p), 2)),
)
starts = st.one_of(finite, st.tuples(finite, finite, finite))


@settings(max_examples=60)
@given(
    law=laws,
    start=st.builds(Start, starts, starts),
    disturbed=st.lists(disturbances, max_size=3).map(tuple),
    seed=st.integers(0, 2**53),
    substeps=st.integers(0, 50),
    energy=st.sampled_from(["none", "stored", "ledger"]),
    fine=st.booleans(),
    delay=st.floats(0.0, 0.02),
)
def test_text_gives_back_every_bit(law, start, disturbed, seed, substeps, energy, fine, delay):  # pyright: ignore
    """Mutation: write floats with `.15g`; or leave `phase_rad` out of the keys of a sine."""
    scenario = Scenario(
        PHANTOM.with_interface(delay=delay), law, 0.35, start, disturbed, seed, substeps, energy,
        fine,
    )  # fmt: skip
    text = scenario_to_text(scenario)
    step = push if law.kind == "user" else None
    again = scenario_from_text(text, step=step)
    assert again == scenario
    assert scenario_to_text(again) == text


def test_defaults():
    scenario = scenario_from_text(MINIMAL)
    assert scenario == Scenario(PHANTOM, wall(10.0, 0.05), 0.5)
    assert (scenario.seed, scenario.substeps, scenario.energy, scenario.fine) == (
        0, 1, "ledger", False,
    )  # fmt: skip


def test_the_example_of_the_documentation_is_a_scenario():
    text = (Path(__file__).parents[1] / "docs" / "scenarios.md").read_text(encoding="utf-8")
    scenario = scenario_from_text(text.split("```toml\n")[1].split("```")[0])
    assert scenario.disturbances == (Disturbance("pulse", 0.2, "m1", 0.5, 0.52),)
    assert scenario.controller.facts["one_sided"] is True


def test_interface_and_physics_change_the_device():
    text = MINIMAL + (
        "[interface]\ndelay_s = 0.0025\nencoder_rounding = 'floor'\n"
        "[[physics]]\neffect = 'coulomb_friction'\nat = 'm1'\nlevel = 0.01\n"
        "[[physics]]\neffect = 'loop_delay'\nat = 'clock'\ndelay = 0.001\n"
    )
    scenario = scenario_from_text(text)
    assert scenario.device.interface.delay == 0.0035
    assert scenario.device.interface.encoder_rounding == "floor"
    assert scenario.device.physics == (make_physics("coulomb_friction", "m1", level=0.01),)
    assert scenario.substeps == 10  # friction is first order in the substep


@pytest.mark.parametrize("name", ["free_damper", "free_force", "free_product"])
def test_a_law_of_no_formula_is_written_as_in_a_device_file(name: str):
    """Mutation: its points asked for by the names of its parameters."""
    text = "\n".join([MINIMAL, "[[physics]]", *entry_of(name, "m1")])
    assert scenario_from_text(text).device.physics == (example(name),)


def test_files_are_sought_beside_the_scenario(tmp_path: Path):
    (tmp_path / "mine.toml").write_text(device_to_text(MASS))
    np.save(tmp_path / "u.npy", np.array([1.0, -2.0]))
    (tmp_path / "u.txt").write_text("# two ticks\n1.0\n-2.0\n")
    for file in ("u.npy", "u.txt"):
        (tmp_path / "s.toml").write_text(
            f'duration_s = 1\n[device]\npath = "mine.toml"\n[controller]\nkind = "recorded"\n'
            f'commands = "{file}"\n'
        )
        scenario = load_scenario(tmp_path / "s.toml")
        assert scenario == Scenario(MASS, recorded(np.array([1.0, -2.0])), 1.0)


def test_a_log_holds_a_folder_that_runs_again(tmp_path: Path):
    """Attachments saved as files are the same scenario, a recorded command included."""
    commands = np.random.default_rng(5).normal(size=40) * 0.1
    scenario = Scenario(PHANTOM, recorded(commands), 0.05)
    logged_run(scenario, tmp_path / "a.mcap")
    for name, data in read_log(tmp_path / "a.mcap").attachments.items():
        (tmp_path / name).write_bytes(data)
    assert load_scenario(tmp_path / "scenario.toml") == scenario


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("duration_s = 0.5", "", "duration_s is missing; add it"),
        ("duration_s = 0.5", "duration = 0.5", "unknown key 'duration'; did you mean 'duration_s'"),
        ("duration_s = 0.5", "duration_s = -2", "duration_s is -2; it must be a finite time above"),
        ("duration_s = 0.5", "duration_s = nan", "duration_s is nan; it must be a finite time"),
        ("duration_s = 0.5", "duration_s = inf", "duration_s is inf; it must be a finite time"),
        ("duration_s = 0.5", "duration_s = '1'", "duration_s is '1'; it must be a number"),
        ("duration_s = 0.5", "duration_s = 1\nseed = -1", "seed is -1; it must be a whole number"),
        ("duration_s = 0.5", "duration_s = 1\nseed = 0.5", "seed is 0.5; it must be a whole"),
        ("duration_s = 0.5", "duration_s = 1\nsubsteps = -1", "substeps is -1; it must be 1 or"),
        ("duration_s = 0.5", "duration_s = 1\nenergy = 'leger'", "energy is 'leger'; did you mean"),
        ("duration_s = 0.5", "duration_s = 1\nbound = nan", "bound is nan; it must be above 0"),
        ("duration_s = 0.5", "schema = 2\nduration_s = 1", "schema is 2; this version reads 1"),
        ("duration_s", "duration_s = 1 x", "this is not TOML"),
        ("phantom_1_0", "phantom", "device.name is 'phantom', which is not a shipped device"),
        ('name = "phantom_1_0"', "", "[device] needs exactly one key"),
        ('name = "phantom_1_0"', "path = 'no.toml'", "there is no file 'no.toml'; check the name"),
        ('name = "phantom_1_0"', "text = 'a = 1'", "device.text: unknown key 'a'; "),
        ('"wall"', '"wal"', "controller.kind is 'wal'; did you mean 'wall'?"),
        ('"wall"', '"user"', "unknown key 'controller.stiffness'; "),
        ("stiffness", "stifness", "unknown key 'controller.stifness'; did you mean 'stiffness'?"),
        ("stiffness = 10", "", "controller.stiffness is missing; add it"),
        ("stiffness = 10", "stiffness = nan", "controller.stiffness is nan; only finite numbers"),
        ("stiffness = 10", "stiffness = 1\none_sided = 1", "controller.one_sided is 1; it must be"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(old: str, new: str, sentence: str):
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(MINIMAL.replace(old, new, 1), "s.toml")
    assert str(caught.value).startswith(f"s.toml: {sentence}")


@pytest.mark.parametrize(
    ("added", "sentence"),
    [
        ("[interface]\ndelay_s = -1", "interface.delay_s is -1.0; it must be >= 0"),
        ("[interface]\ndelay = 1", "unknown key 'interface.delay'; did you mean 'delay_s'?"),
        ("[[physics]]\neffect = 'coulomb'", "there is no effect 'coulomb'; did you mean 'coulomb_"),
        ("[start]\nposition = 'x'", "start.position is 'x'; it must be a list of numbers, or one"),
        (
            "[start]\nposition = [1.0]",
            "start.position has 1 values; give one, or one for each of 3",
        ),
        ("[start]\nvelocity = nan", "start.velocity is nan; only finite numbers are allowed"),
        ("[start]\nspeed = 1", "unknown key 'start.speed'; "),
        ("[disturbance]\nkind = 'sin'", "disturbance.kind is 'sin'; did you mean 'sine'?"),
        ("[disturbance]\nkind = 'noise'", "disturbance.amplitude is missing; add it"),
        (
            "[[disturbance]]\nkind = 'noise'\namplitude = 1\nfrequency_hz = 2",
            "unknown key 'disturbance[0].frequency_hz'; ",
        ),
        (
            "[disturbance]\nkind = 'pulse'\namplitude = 1",
            "disturbance.to_s is inf; it must be finite for a pulse",
        ),
        (
            "[disturbance]\nkind = 'noise'\namplitude = 1\nfrom_s = 2\nto_s = 1",
            "disturbance.to_s is 1.0; it must be a time after from_s",
        ),
        (
            "[disturbance]\nkind = 'noise'\namplitude = 1\nfrom_s = 0.5",
            "disturbance.from_s is 0.5; it must be less than the run's duration",
        ),
        (
            "[disturbance]\nkind = 'noise'\namplitude = 1\nat = 'm4'",
            "disturbance.at is 'm4'; it must be m1 or m2 or m3",
        ),
        (
            "[disturbance]\nkind = 'sine'\namplitude = 1\nfrequency_hz = 500",
            "disturbance.frequency_hz is 500.0; it must be less than 500, half the sampling rate",
        ),
        (
            "[disturbance]\nkind = 'sine'\namplitude = inf\nfrequency_hz = 5",
            "disturbance.amplitude is inf; it must be a finite number",
        ),
    ],
)
def test_bad_tables_are_one_sentence(added: str, sentence: str):
    with pytest.raises(ScenarioError) as caught:
        scenario_from_text(f"{MINIMAL}\n{added}\n", "s.toml")
    assert str(caught.value).startswith(f"s.toml: {sentence}")


def test_files_that_are_none_are_one_sentence(tmp_path: Path):
    with pytest.raises(ScenarioError, match=r"there is no file '.*no\.toml'; check the name"):
        load_scenario(tmp_path / "no.toml")
    with pytest.raises(ScenarioError, match=r"is a folder; give a file in it"):
        load_scenario(tmp_path)
    (tmp_path / "s.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ScenarioError, match=r"'s\.toml' is not UTF-8 text; give a TOML file"):
        load_scenario(tmp_path / "s.toml")


def test_your_own_law_is_supplied_never_loaded_by_name():
    text = scenario_to_text(Scenario(MASS, user_controller(push, np.ones(1), 2), 1.0))
    with pytest.raises(ScenarioError, match=r"a function of your own; supply it with --controller"):
        scenario_from_text(text)
    with pytest.raises(ScenarioError, match="is built in; leave your function out"):
        scenario_from_text(MINIMAL, step=push)


def forces(*disturbances: Disturbance, seed: int = 0, duration: float = 1.0) -> np.ndarray:
    total = Scenario(PHANTOM, none(), duration, Start(), disturbances, seed).forces()
    assert total is not None
    return total


def test_a_constant_force_acts_from_tick_to_tick():
    """In ticks k with from_s <= kT < to_s. Mutation: floor in `_first_tick` (0.0295 s)."""
    f = forces(Disturbance("constant", 2.0, "m2", 0.0295, 0.07))
    assert np.flatnonzero(f[:, 1]).tolist() == list(range(30, 70))
    assert set(f[:, 1]) == {0.0, 2.0}
    assert not f[:, [0, 2]].any()


def test_a_pulse_has_the_impulse_of_half_a_sine():
    """2 A D / pi, to (pi T / D)^2 / 24 = 1.03e-3. Mutation: value at the tick's start (n = 20)."""
    f = forces(Disturbance("pulse", 3.0, "m1", 0.1, 0.1633))[:, 0]
    g = forces(Disturbance("pulse", 3.0, "m1", 0.1, 0.12))[:, 0]
    assert f.sum() * 1e-3 == pytest.approx(2.0 * 3.0 * 0.0633 / math.pi, rel=2e-3)
    assert g.sum() * 1e-3 == pytest.approx(2.0 * 3.0 * 0.02 / math.pi, rel=1.1e-3)
    assert g[100:120] == pytest.approx(g[119:99:-1], rel=1e-12)


def test_a_sine_lags_by_nothing():
    """Projected on sine and cosine of its own phase. Mutation: value at the tick's start: 0.157."""
    f = forces(Disturbance("sine", 1.5, "m1", 0.0, 1.0, 50.0, 0.3))[:, 0]
    middle = 2.0 * math.pi * 50.0 * (np.arange(1000) + 0.5) * 1e-3 + 0.3
    assert 2.0 * np.mean(f * np.sin(middle)) == pytest.approx(1.5, rel=1e-12)
    assert abs(np.mean(f * np.cos(middle))) < 1e-12


def test_noise_is_of_its_seed_and_place():
    """Mutation: seed without the place: two forces of one scenario would be the same."""
    one = Disturbance("noise", 0.2, "m1")
    two = replace(one, at="m2")
    f = forces(one, two, duration=20.0)
    assert f[:, 0].std() == pytest.approx(0.2, rel=0.02)
    assert abs(np.corrcoef(f[:, 0], f[:, 1])[0, 1]) < 0.03
    assert np.array_equal(f, forces(one, two, duration=20.0))
    assert not np.array_equal(f, forces(one, two, seed=1, duration=20.0))


def test_a_force_moves_a_free_mass_as_newton_says():
    """v = F t / m, q = F t^2 / (2 m), exact for held forces. Mutation: force on the tick after."""
    scenario = Scenario(MASS, none(), 1.0, Start(), (Disturbance("constant", 2.0, "m1", 0.1, 0.3),))
    run = scenario.prepare()
    (trace, _, _), *_ = run.blocks(1000)
    assert trace["velocity_m1"][300:] == pytest.approx(2.0 * 0.2 / 0.5, rel=1e-12)
    assert trace["position_m1"][300] == pytest.approx(2.0 * 0.2**2 / (2.0 * 0.5), rel=1e-12)


@pytest.mark.parametrize(
    ("stiffness", "verdict"), [(20.0, Verdict.DECAYS), (26.0, Verdict.GROWS), (80.0, Verdict.GROWS)]
)
def test_verdict_on_both_sides_of_the_boundary(stiffness: float, verdict: Verdict):
    """K_CR is 22.996 at B = 0.05 and 2 ms. Mutation: measures of the first windows only."""
    scenario = Scenario(PHANTOM, wall(stiffness, 0.05), 4.0, Start(1e-3))
    run = simulate(PHANTOM, wall(stiffness, 0.05), duration=4.0, start=Start(1e-3))
    found = run_verdict(scenario, run.trace, run.outcome)
    assert found is not None
    assert found.verdict is verdict
    assert found.fate is (Fate.RESTS if verdict is Verdict.DECAYS else Fate.GROWS)


def test_no_verdict_while_something_drives():
    for law, disturbance in (
        (recorded(np.ones(9)), ()),
        (wall(1.0, 0.0), (Disturbance("sine", 1.0, "m1", frequency_hz=3.0),)),
    ):
        scenario = Scenario(PHANTOM, law, 1.0, Start(1e-3), disturbance)
        run = simulate(PHANTOM, law, duration=1.0, start=Start(1e-3))
        assert run_verdict(scenario, run.trace, run.outcome) is None
    pushed = Scenario(PHANTOM, none(), 1.0, Start(), (Disturbance("constant", 0.1, from_s=0.2),))
    assert pushed.free_from == 0.2


@pytest.mark.parametrize(
    ("options", "fate"),
    [
        ([], "dithers"),
        (["--felt-force", "1e-4"], "felt"),
        (["--felt-position", "1e-6"], "felt"),
        (["--lever", "10"], "felt"),  # a hand so far out moves by micrometres
    ],
)
def test_what_is_felt_of_a_run_is_an_option(options: list[str], fate: str, tmp_path: Path):
    """By force, by motion, or by the threshold of vibration at a lever.

    Mutation: `Perception()` in `run_verdict`.
    """
    path = tmp_path / "wall.toml"
    path.write_text(
        "schema = 1\nduration_s = 8.0\n[device]\nname = 'phantom_1_0'\n[interface]\n"
        "encoder_step = 1e-5\n[controller]\nkind = 'wall'\nstiffness = 10.0\ndamping = 0.04\n"
        "[start]\nposition = 1e-3\n"
    )
    out = tmp_path / "out"
    assert run(["simulate", str(path), *options, "--out", str(out), "--json",
                        str(tmp_path / "found.json")]) == 0  # fmt: skip
    assert json.loads((tmp_path / "found.json").read_text())["fate"] == fate
    about = read_log(out / "wall.mcap").metadata
    assert float(about["felt_force"]) == (1e-4 if "--felt-force" in options else 0.01)
    text = path.read_text().replace(
        "'wall'\nstiffness = 10.0\ndamping = 0.04", "'relay'\nforce = 1.0"
    )
    path.write_text(text)
    refused = run(["simulate", str(path), *options, "--out", str(tmp_path / "relay")])
    assert refused == (2 if options else 0)


def test_events_are_the_changes_of_state(tmp_path: Path):
    """Contact, limit and sticking, each at the first tick that shows it."""
    device = PHANTOM.with_interface(command_limit=0.05).with_physics(
        make_physics("coulomb_friction", "m1", level=0.01)
    )
    scenario = Scenario(device, wall(20.0, 0.02, 0.0, True), 1.5, Start(-0.005, 0.6))
    logged = logged_run(scenario, tmp_path / "a.mcap")
    assert read_log(tmp_path / "a.mcap").events == logged.events
    trace = logged.run.trace
    states = {
        ("contact_made", "contact_broken"): trace["contact"] != 0.0,
        ("limit_reached", "limit_left"): np.abs(trace["command"]) >= 0.05,
        ("stuck", "slipping"): trace["at_rest"].astype(int) % 2 == 1,
    }
    for kinds, state in states.items():
        ticks = np.flatnonzero(np.diff(state.astype(int))) + 1
        found = [e for e in logged.events if e.kind in kinds]
        assert ticks.size > 0
        assert [e.t for e in found] == trace.t[ticks].tolist()
        assert [e.kind for e in found] == [kinds[0] if state[k] else kinds[1] for k in ticks]


def test_an_escape_is_an_event(tmp_path: Path):
    scenario = Scenario(PHANTOM, wall(60.0, 0.0), 9.0, Start(1e-3), bound=1.0)
    logged = logged_run(scenario, tmp_path / "a.mcap", metadata={"verdict": "known"})
    (event,) = logged.events
    assert (event.kind, event.place) == ("escaped", "m1")
    about = read_log(tmp_path / "a.mcap").metadata
    assert about["outcome"] == "escaped"
    assert about["verdict"] == "known"
    assert (about["K"], about["B"], about["delay_s"]) == ("60.0", "0.0", "0.002")
