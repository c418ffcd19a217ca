"""A device as an FMU 3.0: valid, to the bit the simulation, its parameters set from outside."""

import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from c_examples import COMMANDS, FIRST, with_effect

from zwidth import cli
from zwidth.export import fmu as module
from zwidth.export.c_source import c_source, settable_source
from zwidth.export.compiled import compiler, run_c
from zwidth.export.description import base_units
from zwidth.export.fmu import Fmu, fmi, fmu, run_fmu
from zwidth.export.model import free_run
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device
from zwidth.sim.physics import LIBRARY, make_physics

needs_compiler = pytest.mark.skipif(compiler() is None, reason="there is no C compiler (cc, gcc)")
needs_fmpy = pytest.mark.skipif(fmi() is None, reason="fmpy is not installed")


def rig(level: float = 2e-3, limit: float = 0.12, gain: float = 1.3) -> Device:
    """Return the PHANToM with effects of four hooks, three masses in the chain."""
    return (
        load_device("phantom_1_0")
        .with_physics(
            make_physics("coulomb_friction", "m1", level=level),
            make_physics("backlash", "link12", gap=1e-4),
            make_physics("actuator_lag", "command", time_constant=2e-3),
            make_physics("extra_mode", "m2", mass=1e-5, stiffness=3.0, damping=1e-4),
        )
        .with_interface(command_limit=limit, command_gain=gain, encoder_step=1e-6, delay=0.0015)
    )


@pytest.fixture(scope="module")
def made() -> Fmu:
    """Return the FMU of the rig."""
    return fmu(rig(), "dev")


@needs_compiler
@pytest.mark.parametrize(("name", "place"), FIRST)
def test_numbers_that_may_be_set_change_no_bit(name: str, place: str):
    """Every effect, its parameters in the state. Mutation: parameters of the next effect."""
    device = with_effect(name, place)
    text, _ = settable_source(device, "dev", seed=3)
    np.testing.assert_array_equal(run_c(text, "dev", COMMANDS), free_run(device, COMMANDS, seed=3))


@needs_fmpy
@needs_compiler
def test_it_has_the_bits_of_the_simulation(made: Fmu):
    """Driven by fmpy. Mutation: the reading taken before the step and not after it."""
    np.testing.assert_array_equal(run_fmu(made.content(), COMMANDS), free_run(rig(), COMMANDS))


@needs_fmpy
@needs_compiler
def test_parameters_are_set_as_another_device_has_them(made: Fmu):
    """To the bit that device. Mutation: two parameters in each other's place."""
    other = rig(level=5e-3, limit=0.1, gain=1.7)
    settings = {"coulomb_friction_m1.level": 5e-3, "interface.command_limit": 0.1,
                "interface.command_gain": 1.7}  # fmt: skip
    theirs = run_fmu(made.content(), COMMANDS, settings)
    np.testing.assert_array_equal(theirs, free_run(other, COMMANDS))
    assert not np.array_equal(theirs, free_run(rig(), COMMANDS))


@needs_fmpy
@needs_compiler
def test_it_is_valid_and_its_variables_have_units(made: Fmu, tmp_path: Path):
    """By fmpy: schema, structure, units, names. Mutation: outputs left out of the structure."""
    fmpy, validation = pytest.importorskip("fmpy"), pytest.importorskip("fmpy.validation")
    path = tmp_path / "dev.fmu"
    path.write_bytes(made.content("a cost"))
    assert validation.validate_fmu(str(path)) == []
    told = fmpy.read_model_description(str(path))
    units = {v.name: (v.causality, v.unit) for v in told.modelVariables}
    assert units["command"] == ("input", "N m")
    assert units["measured"] == ("output", "rad")
    assert units["velocity_m4"] == ("output", "rad/s")
    assert units["coulomb_friction_m1.level"] == ("parameter", "N m")
    assert units["chain.spring_link12"] == ("local", "N m/rad")
    assert units["extra_mode_m2.mass"] == ("local", "kg m2")
    assert "a cost" in zipfile.ZipFile(path).read("documentation/index.html").decode()


@needs_fmpy
@needs_compiler
def test_fmpy_simulates_it_as_any_other(made: Fmu, tmp_path: Path):
    """`simulate_fmu` with its own stepping. Mutation: a step of several ticks takes one."""
    fmpy = pytest.importorskip("fmpy")
    path = tmp_path / "dev.fmu"
    path.write_bytes(made.content())
    found = fmpy.simulate_fmu(
        str(path), stop_time=0.05, step_size=0.005, output_interval=0.005,
        start_values={"command": 0.05}, output=["measured", "position_m3"],
    )  # fmt: skip
    held = np.full(51, 0.05)
    np.testing.assert_array_equal(found["measured"], free_run(rig(), held)[::5])


@needs_fmpy
@needs_compiler
def test_a_state_is_kept_and_taken_up_again(made: Fmu, tmp_path: Path):
    """Through bytes too. Mutation: the delay line left out of what is kept."""
    fmpy, fmi3 = pytest.importorskip("fmpy"), pytest.importorskip("fmpy.fmi3")
    path = tmp_path / "dev.fmu"
    path.write_bytes(made.content())
    folder = fmpy.extract(str(path), str(tmp_path / "unzipped"))
    told = fmpy.read_model_description(folder)
    slave = fmi3.FMU3Slave(guid=told.guid, unzipDirectory=folder, instanceName="one",
                           modelIdentifier="dev")  # fmt: skip
    slave.instantiate()
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    slave.setFloat64([1], [0.1])
    slave.doStep(0.0, 0.01)
    kept = slave.getFMUState()
    content = slave.serializeFMUState(kept)
    slave.doStep(0.01, 0.01)
    once = slave.getFloat64([2, 4])
    slave.setFMUState(slave.deserializeFMUState(content))
    slave.doStep(0.01, 0.01)
    assert list(slave.getFloat64([2, 4])) == list(once)
    with pytest.raises(Exception, match="fmi3DoStep"):
        slave.doStep(0.02, 0.0015)
    with pytest.raises(Exception, match="fmi3SetFloat64"):
        slave.setFloat64([2], [0.0])
    slave.freeFMUState(kept)
    slave.freeInstance()


@needs_fmpy
def test_without_a_compiler_there_are_sources(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """And one sentence that says so."""
    monkeypatch.setattr(module, "compiler", lambda: None)
    out, said = tmp_path / "x.fmu", tmp_path / "x.json"
    line = ["export", "ethz_haptic_paddle", "--to", "fmu", "-o", str(out), "--json", str(said)]
    assert cli.run(line) == 0
    assert "there is no C compiler" in json.loads(said.read_text())["cost"]
    names = zipfile.ZipFile(out).namelist()
    assert "sources/x.c" in names
    assert not [n for n in names if n.startswith("binaries")]
    monkeypatch.setattr(module, "fmi", lambda: None)
    assert cli.run([*line, "--force"]) == 2


@needs_fmpy
def test_the_same_device_gives_the_same_sources():
    """No clock and no chance in them; another device has another token."""
    one, same, other = fmu(rig(), "dev"), fmu(rig(), "dev"), fmu(rig(3e-3), "dev")
    assert one.description == same.description
    assert one.body == same.body
    token = one.description.split('instantiationToken="')[1].split('"')[0]
    assert token in one.body
    assert token not in other.body


@needs_fmpy
@needs_compiler
def test_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    out, said = tmp_path / "paddle.fmu", tmp_path / "x.json"
    line = ["export", "ethz_haptic_paddle", "--to", "fmu", "-o", str(out), "--json", str(said)]
    assert cli.run(line) == 0
    assert "The FMU file contains everything of" in capsys.readouterr().out
    result = json.loads(said.read_text())
    assert result["error_over_motion"] == 0.0
    archive = zipfile.ZipFile(io.BytesIO(out.read_bytes()))
    assert archive.testzip() is None
    assert result["cost"] in archive.read("documentation/index.html").decode()


def test_units_are_made_of_base_units():
    assert base_units("N m s2/rad2") == {"kg": 1, "m": 2, "rad": -2}
    assert base_units("N/m3") == {"kg": 1, "m": -2, "s": -2}
    assert base_units("rad/s") == {"rad": 1, "s": -1}
    for effect in LIBRARY.values():
        for q in effect.parameters:
            for rotary in (True, False):
                base_units(q.unit_for(rotary))


def test_c_alone_has_no_settings():
    assert "double p[" not in c_source(rig(), "dev").body
