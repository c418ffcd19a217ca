"""A device as C: the compiled file has the bits of the simulation, for every effect."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from c_examples import COMMANDS, FIRST, assert_same_bits, needs_compiler, with_effect
from physics_examples import EXAMPLES

from zwidth import cli
from zwidth.export.c_source import c_source, identifier
from zwidth.export.compiled import compiler, run_c
from zwidth.export.model import command_for, free_run, loss
from zwidth.sim.device_file import load_device
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.effect import Physics


@needs_compiler
@pytest.mark.parametrize(("name", "place"), FIRST)
def test_every_effect_has_the_bits_of_the_simulation(name: str, place: str):
    """Mutations: a bound of friction at rest for one in motion; sums in another order."""
    device = with_effect(name, place)
    made = c_source(device, "dev", seed=3)
    assert made.lost == ()
    assert_same_bits(device, made)
    if name not in ("saturation", "servo_limit", "loop_delay", "open_winding"):
        assert not np.array_equal(
            free_run(device, COMMANDS, seed=3), free_run(load_device("phantom_1_0"), COMMANDS)
        )


@needs_compiler
def test_effects_together_with_several_masses_in_friction():
    """Mutation: one propagator for all sets of locked masses."""
    chosen: list[Physics] = [
        make_physics("coulomb_friction", f"m{i}", level=2e-3) for i in (1, 2, 3)
    ]
    chosen += [
        make_physics(name, place, **EXAMPLES[name])
        for name, place in (
            ("stribeck_friction", "m1"), ("backlash", "link12"), ("actuator_lag", "command"),
            ("dropped_samples", "clock"), ("encoder_step", "sensor"), ("loop_delay", "clock"),
            ("gravity_pendulum", "m1"), ("saturation", "command"),
        )
    ]  # fmt: skip
    device = load_device("phantom_1_0").with_physics(*chosen)
    assert_same_bits(device, c_source(device, "dev", seed=3))


@needs_compiler
def test_the_interface_is_held():
    """Mutations: the gain after the limit; the origin left out of the start; floor as nearest."""
    device = load_device("phantom_1_0").with_interface(
        period=0.002, delay=0.0033, encoder_step=1e-5, encoder_rounding="floor",
        command_step=1e-3, command_limit=0.12, command_gain=1.3, position_origin=0.01,
        force_sensor="link12", force_gain=0.2,
    )  # fmt: skip
    assert_same_bits(device, c_source(device, "dev", seed=3))


@needs_compiler
def test_what_a_held_command_loses_is_said_and_measured():
    """A command that is smooth between samples cannot be, where the next is not yet known."""
    device = load_device("ethz_haptic_paddle").with_interface(command_hold="smooth")
    made = c_source(device, "dev")
    assert len(made.lost) == 1
    assert "command_hold" in made.lost[0]
    assert made.lost[0] in made.text()
    commands = command_for(device)
    assert 1e-6 < loss(free_run(device, commands), run_c(made.text(), "dev", commands)) < 0.5


@needs_compiler
def test_the_file_compiles_as_a_part_of_others(tmp_path: Path):
    """Alone, with every warning an error, and optimised: nothing but what is exported is seen."""
    found = compiler()
    assert found is not None
    (tmp_path / "m.c").write_text(c_source(with_effect("hysteresis", "ground"), "dev").text())
    flags = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-ffp-contract=off"]
    subprocess.run([found, *flags, "-c", "m.c", "-o", "m.o"], cwd=tmp_path, check=True)
    if nm := shutil.which("nm"):
        said = subprocess.run([nm, "-g", "--defined-only", "m.o"], cwd=tmp_path, check=True,
                              capture_output=True, text=True)  # fmt: skip
        names = {line.split()[-1].lstrip("_") for line in said.stdout.splitlines()}
        assert names == {"dev_reset", "dev_read", "dev_step"}


def test_names_that_c_allows():
    assert identifier("My rig, axis 1") == "my_rig_axis_1"
    assert identifier("2nd") == "d_2nd"
    assert identifier("++") == "device"


@needs_compiler
def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out, result = tmp_path / "paddle.c", tmp_path / "x.json"
    line = ["export", "ethz_haptic_paddle", "--to", "c", "-o", str(out), "--json", str(result)]
    assert cli.run(line) == 0
    assert "The C code contains everything of" in capsys.readouterr().out
    said = json.loads(result.read_text())
    assert said["lost"] == []
    assert said["error_over_motion"] == 0.0
    text = out.read_text()
    assert said["cost"] in text
    assert "double paddle_step(paddle_state *s, double command)" in text
