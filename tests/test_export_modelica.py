"""A device as Modelica: continuous in time, the limit that our own steps converge to."""

import json
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from physics_examples import EVERYWHERE, EXAMPLES
from test_export_c import COMMANDS, with_effect

from zwidth import cli
from zwidth.controllers.recorded import recorded
from zwidth.export import cost
from zwidth.export.model import Floats, free_run, loss
from zwidth.export.modelica import modelica
from zwidth.export.modelica_run import run_modelica, translator
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.physics import EFFECTS, LIBRARY, make_physics
from zwidth.sim.run import simulate

needs_translator = pytest.mark.skipif(
    not translator(), reason="there is no OpenModelica and no rumoca"
)
HELD = [(name, place) for name, place in EVERYWHERE if name != "dropped_samples"]
LINEAR = [name for name in LIBRARY if EFFECTS[name].hook not in ("force", "friction")]


def run(device: Device, commands: Floats = COMMANDS) -> Floats:
    made = modelica(device, "dev")
    assert made.lost == ()
    return run_modelica(made.text(), "dev", commands, device.interface.period)


def finely(device: Device, substeps: int) -> Floats:
    """Return our own run in smaller steps than an export takes."""
    duration = COMMANDS.size * device.interface.period
    done = simulate(device, recorded(COMMANDS), duration=duration, substeps=substeps, seed=3)
    return done.trace["encoder"]


@needs_translator
@pytest.mark.parametrize(("name", "place"), HELD)
def test_every_effect_moves_alike(name: str, place: str):
    """Within 1 % of what the effect does, and to 1e-9 where no force acts inside a step.

    Mutations: the ripple over the deflection of its link; the bristle's rate of the other sign;
    what a servo's limit takes of the other sign.
    """
    device = with_effect(name, place)
    ours = finely(device, 32)  # steps of an export are too coarse for what a tiny effect does
    without = replace(device, physics=device.physics[1:])
    does = loss(ours, free_run(without, COMMANDS)) if device.physics else 1.0
    assert loss(ours, run(device)) < (1e-9 if name in LINEAR else max(0.01 * does, 1e-9))


@needs_translator
@pytest.mark.parametrize(
    ("name", "place"),
    [("coulomb_friction", "m2"), ("load_friction", "m1"), ("cubic_stiffness", "ground"),
     ("directional_friction", "m2"), ("backlash", "link12")],
)  # fmt: skip
def test_our_steps_converge_to_it(name: str, place: str):
    """Sixteen times finer, a hundredth of the difference at most: what is left is ours.

    Mutations: friction at rest released at the level of motion; the pin of the play let go.
    """
    device = with_effect(name, place)
    theirs = run(device)
    coarse, fine = loss(finely(device, 4), theirs), loss(finely(device, 64), theirs)
    assert fine < max(0.01 * coarse, 1e-6)


@needs_translator
def test_the_interface_is_held():
    """Feedback of the force, steps, gain, limit, delay of 1.65 periods, origin, floor.

    But for one reading at rest, where 0 and -1e-20 are a count apart.

    Mutations: the gain after the limit; a delay of one period more; floor as nearest.
    """
    device = load_device("phantom_1_0").with_interface(
        period=0.002, delay=0.0033, encoder_step=1e-5, encoder_rounding="floor",
        command_step=1e-3, command_limit=0.12, command_gain=1.3, position_origin=0.01,
        force_sensor="link12", force_gain=0.2,
    )  # fmt: skip
    assert loss(free_run(device, COMMANDS), run(device)) < 1e-5


@needs_translator
def test_a_whole_servo():
    """Its loop, integral and limits, both rates, and a filtered reading of another origin.

    Each takes part, a hundredth of the motion or more, but for the faster one of the two rates.

    Mutations: the integral not in what the limits ask; it not clamped; of the two rates the faster
    one; the filter begun at 0 in place of the origin's; the falling limit rising in either way.
    """
    chosen = [
        make_physics("position_servo", "m1", **EXAMPLES["position_servo"]),
        make_physics("servo_limit", "m1", limit=0.02),
        make_physics("servo_integral", "m1", rate=20.0, limit=2e-3),
        make_physics("falling_limit", "m1", limit=0.025, slope=0.05),
        make_physics("goal_rate_limit", "command", rate=0.4),
        make_physics("rate_limit", "command", rate=1.4),
        make_physics("sensor_filter", "sensor", time_constant=2e-3, damping=0.7),
    ]
    plain = load_device("phantom_1_0").with_interface(position_origin=0.01)
    device = plain.with_physics(*chosen)
    theirs = run(device)
    assert loss(finely(device, 64), theirs) < 1e-5
    for left_out in chosen[1:]:
        without = plain.with_physics(*(p for p in chosen if p is not left_out))
        takes_part = loss(finely(without, 64), theirs) > 0.01
        assert takes_part == (left_out.effect.name != "rate_limit")


@needs_translator
def test_what_is_without_limit_or_time_is_not_there():
    """Mutation: the servo's infinite limit read by the friction of its load."""
    chosen = [
        make_physics("position_servo", "m1", **EXAMPLES["position_servo"]),
        make_physics("load_friction", "m1", ratio=0.1),
        make_physics("servo_integral", "m1", rate=20.0, limit=np.inf),
    ]
    nothing = [
        make_physics("servo_limit", "m1", limit=np.inf),
        make_physics("falling_limit", "m1", limit=np.inf, slope=0.1),
        make_physics("goal_rate_limit", "command", rate=np.inf),
        make_physics("rate_limit", "command", rate=np.inf),
        make_physics("sensor_lag", "sensor", time_constant=0.0),
    ]
    device = load_device("phantom_1_0").with_physics(*chosen)
    theirs = run(device)
    assert loss(finely(device, 64), theirs) < 1e-3
    np.testing.assert_allclose(run(device.with_physics(*nothing)), theirs, atol=1e-12)


@needs_translator
def test_friction_holds_a_mass_exactly():
    """At rest nothing creeps, and each of three masses sticks and slips for itself.

    Mutation: of the two levels of Stribeck's law the one in motion at rest too.
    """
    chosen = [make_physics("coulomb_friction", f"m{i}", level=2e-3 * i) for i in (1, 2, 3)]
    chosen.append(make_physics("stribeck_friction", "m1", level=1e-3, static_level=3e-3,
                               velocity=0.1))  # fmt: skip
    device = load_device("phantom_1_0").with_physics(*chosen)
    theirs = run(device)
    assert loss(finely(device, 64), theirs) < 1e-3
    assert np.all(run(device, np.full(50, 4.9e-3)) == 0.0)


@needs_translator
def test_a_linear_device_of_one_mass():
    """Against the closed form of a damped mass under one held command."""
    device = Device("rail", "-", False, make_chain([2.0], [3.0]))
    t = np.arange(200) * device.interface.period
    tau = 2.0 / 3.0
    closed = 0.5 / 3.0 * (t - tau * (1.0 - np.exp(-t / tau)))
    np.testing.assert_allclose(run(device, np.full(200, 0.5)), closed, atol=1e-9)


STAND_IN = """#!{python}
import csv, re, sys
from pathlib import Path
import rumoca
script = Path(sys.argv[1]).read_text()
stop, ticks = re.search(r"stopTime=([^,]+), numberOfIntervals=([0-9]+)", script).groups()
config = rumoca.SimConfig(solver="rk-like", rtol=1e-9, atol=1e-11)
model = rumoca.Session().loads(Path("run.mo").read_text(), model="Run")
found = model.simulate((0.0, float(stop)), dt=float(stop) / int(ticks), config=config)
with open("run_res.csv", "w", newline="") as stream:
    rows = csv.writer(stream, quoting=csv.QUOTE_NONNUMERIC)
    rows.writerow(["time", "device.measured"])
    rows.writerows(zip(found.time, found["device.measured"]))
"""


@pytest.mark.skipif(find_spec("rumoca") is None, reason="rumoca is not installed")
def test_openmodelica_is_asked_where_it_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """By a stand-in that takes its script and writes its table: OpenModelica itself was not there.

    Mutation: the column of the times.
    """
    (tmp_path / "omc").write_text(STAND_IN.format(python=sys.executable))
    (tmp_path / "omc").chmod(0o755)
    device = with_effect("coulomb_friction", "m1")
    text = modelica(device, "dev").text()
    monkeypatch.setattr("shutil.which", lambda _: None)
    assert translator() == "rumoca"
    plain = run_modelica(text, "dev", COMMANDS, 1e-3)
    monkeypatch.undo()
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    assert translator() == "OpenModelica"
    np.testing.assert_allclose(run_modelica(text, "dev", COMMANDS, 1e-3), plain, atol=1e-12)
    with pytest.raises(ValueError, match="OpenModelica refuses the exported model"):
        run_modelica("model x", "dev", COMMANDS, 1e-3)


def test_what_is_not_held_is_said():
    device = with_effect("dropped_samples", "clock").with_interface(command_hold="smooth")
    made = modelica(device, "dev")
    assert len(made.lost) == 2
    assert "dropped_samples@clock is not held" in made.lost[0]
    assert "command_hold" in made.lost[1]
    assert all(sentence in made.text() for sentence in made.lost)


def test_without_a_translator_the_cost_is_said_to_be_unknown(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setattr(cost, "translator", lambda: "")
    out, said = tmp_path / "x.mo", tmp_path / "x.json"
    line = ["export", "ethz_haptic_paddle", "--to", "modelica", "-o", str(out), "--json", str(said)]
    assert cli.run(line) == 0
    result = json.loads(said.read_text())
    assert result["error_over_motion"] is None
    assert "neither OpenModelica nor rumoca is here" in result["cost"]
    assert result["cost"] in out.read_text()


def test_parameters_have_units():
    text = modelica(with_effect("quadratic_drag", "m1"), "dev").text()
    assert 'parameter Real quadratic_drag_m1_coefficient(unit="N.m.s2/rad2") =' in text
    assert 'parameter Real mass_m1(unit="kg.m2") =' in text
    assert 'input Real command(unit="N.m");' in text


@needs_translator
def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out, said = tmp_path / "paddle.mo", tmp_path / "x.json"
    line = ["export", "ethz_haptic_paddle", "--to", "modelica", "-o", str(out), "--json", str(said)]
    assert cli.run(line) == 0
    assert "modelica holds all of" in capsys.readouterr().out
    result = json.loads(said.read_text())
    assert result["error_over_motion"] < 1e-3
    assert result["cost"] in out.read_text()
    assert "model paddle" in out.read_text()
