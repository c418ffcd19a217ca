"""Known differences of a device from run to run: a payload, a spring, a limit, a gain."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis_examples import phantom
from zwidth.controllers.excitation import noise
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.held_out import held_out
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.settle import refit
from zwidth.diagnosis.recording.experiment import Experiment, Output, experiment
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.logs.recording import read_recording
from zwidth.logs.source import RecordingError
from zwidth.sim.chain import make_chain
from zwidth.sim.changes import changes_of
from zwidth.sim.device import Device, DeviceError
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate

CART = Device(
    "cart", "", False, make_chain([0.8, 0.5], [3.0, 2.0], 300.0, [900.0], [0.5]),
    Interface(period=0.002),
)  # fmt: skip
LEVEL = 0.12
PAYLOAD: dict[str, object] = {"masses": [0.8, 1.2]}


def driven(device: Device, changes: Mapping[str, object], seed: int) -> Experiment:
    """A recording of a device as it was in the run; the file's device is `CART`."""
    known = changes_of(changes, CART)
    there = device if known is None else known.of(device)
    command = 4.0 * noise(duration=4.0, to_hz=60.0, period=0.002, seed=seed)
    run = simulate(there, recorded(command), duration=4.0, substeps=20 if there.physics else 1)
    random = np.random.default_rng(seed)
    q = run.trace["position_m1"]
    y = q + 2e-3 * q.std() * random.standard_normal(q.size)
    return Experiment(
        0.002, command, y[:, None], (Output("position", 0),), f"run{seed}", float(y.std()),
        changes=known,
    )  # fmt: skip


def test_a_run_is_of_the_device_that_its_own_file_would_describe() -> None:
    device = CART.with_physics(make_physics("constant_force", "m1", level=0.5))
    said = PAYLOAD | {
        "ground_spring": 250.0,
        "delay_s": 0.004,
        "command_limit": 6.0,
        "command_gain": 2.0,
        "physics": [{"effect": "constant_force", "at": "m1", "level": 0.8}],
    }
    changes = changes_of(said, device)
    assert changes is not None
    own = changes.of(device)
    np.testing.assert_allclose(own.chain.masses, [0.8, 1.2], rtol=1e-15)
    assert own.chain.ground_spring == 250.0
    assert own.interface == Interface(period=0.002, delay=0.004, command_limit=6.0)
    assert changes.command_gain == 2.0
    assert own.physics[0].values == {"level": pytest.approx(0.8)}


def test_the_difference_is_put_on_what_a_fit_makes_of_the_device() -> None:
    changes = changes_of(PAYLOAD, CART)
    assert changes is not None
    fitted = CART.with_chain(CART.chain._replace(masses=np.array([0.7, 0.6])))
    np.testing.assert_allclose(changes.of(fitted).chain.masses, [0.7, 1.3])
    light = changes_of({"masses": [0.8, 0.1]}, CART)
    assert light is not None
    gone = CART.with_chain(CART.chain._replace(masses=np.array([0.7, 0.2])))
    np.testing.assert_allclose(light.of(gone).chain.masses, [0.7, 0.001])


def test_members_change_as_each_of_them_does() -> None:
    model = Model(CART).with_effect(make_physics("constant_force", "m1", level=0.5), {"level": 0.1})
    xs = np.random.default_rng(0).standard_normal((4, len(model.parameters)))
    changes = changes_of(PAYLOAD | {"ground_spring": 100.0, "command_limit": 5.0}, CART)
    assert changes is not None
    members = changes.of_members(model.members(xs))
    for i, x in enumerate(xs):
        assert members.device(i) == changes.of(model.acting(x))


def test_one_fit_to_runs_with_and_without_a_payload_finds_the_masses_of_both() -> None:
    truth = CART.with_chain(CART.chain._replace(masses=np.array([0.72, 0.56])))
    es = [driven(truth, {}, 1), driven(truth, PAYLOAD, 2)]
    _, fitted = refit(CART, es)
    np.testing.assert_allclose(fitted.model.build(fitted.x).chain.masses, [0.72, 0.56], rtol=2e-3)
    _, blind = refit(CART, [replace(e, changes=None) for e in es])
    assert abs(blind.model.build(blind.x).chain.masses[1] / 0.56 - 1.0) > 0.1


def test_slopes_and_values_are_of_the_same_device() -> None:
    es = [driven(CART, {}, 1), driven(CART, PAYLOAD, 2)]
    problem, fitted = refit(CART, es)
    there = Problem(problem.experiments, problem.observer)
    one = there.weighted(fitted.model, fitted.x)
    (again,) = there.weighted_each(fitted.model, [fitted.x])
    np.testing.assert_allclose(again, one, atol=1e-9)


@pytest.mark.truth
def test_friction_is_found_over_runs_of_different_loads() -> None:
    truth = CART.with_physics(make_physics("coulomb_friction", "m2", level=LEVEL))
    es = [driven(truth, {}, 1), driven(truth, PAYLOAD, 2)]
    found = diagnose(CART, es, effort=QUICK)
    assert [(f.effect, f.at) for f in found.findings] == [("coulomb_friction", "m2")]
    level = found.findings[0].parameters["level"]
    assert level.lower <= LEVEL <= level.upper
    one_step, free = held_out(CART, found.searched, [e.split()[1] for e in es])
    assert free.after < 0.2 * free.refit
    assert one_step.after < 1.05 * one_step.noise_floor


TOML = """
file = "run.csv"
rotary = false
period_s = 0.002
[input]
signal = "u"
[[output]]
signal = "y"
quantity = "position"
at = "m1"
[device]
masses = [0.8, 1.2]
command_gain = 2.0
"""


def written(folder: Path, toml: str) -> Path:
    t = np.arange(400)
    rows = np.column_stack([np.sin(0.1 * t), np.cos(0.1 * t)])
    np.savetxt(folder / "run.csv", rows, delimiter=",", header="u,y", comments="")
    (folder / "run.toml").write_text(toml)
    return folder / "run.toml"


def test_a_recording_says_what_was_different_of_its_device(tmp_path: Path) -> None:
    trace = read_recording(written(tmp_path, TOML))
    taken = experiment(trace, CART)
    assert taken.changes is not None
    np.testing.assert_allclose(taken.on(CART).chain.masses, [0.8, 1.2])
    np.testing.assert_allclose(taken.command, 2.0 * trace["command"])
    first, rest = taken.split()
    assert first.changes is rest.changes is taken.changes


@pytest.mark.parametrize(
    ("toml", "device", "says"),
    [
        ("masses = [0.8]", CART, "device.masses of the recording has 1 entries; the device has 2"),
        ("masses = [0.8, -1.0]", CART, r"\[device\] of the recording: masses contains -1"),
        ("command_limit = 0.0", CART, "interface.command_limit is 0.0; it must be > 0"),
        ("masses = [1.0]", phantom(), "describes modes"),
        (
            '[[device.physics]]\neffect = "gravity_pendulum"\nat = "m1"\nlevel = 1.0',
            CART,
            "gravity_pendulum@m1, which the device file does not have",
        ),
    ],
)
def test_what_cannot_be_so_is_said(tmp_path: Path, toml: str, device: Device, says: str) -> None:
    path = written(tmp_path, TOML.split("masses =")[0] + toml + "\n")
    trace = read_recording(path)
    there = device.with_interface(period=0.002)
    if device.rotary:
        trace = replace(trace, units=dict.fromkeys(trace.units, ""))
    with pytest.raises(DeviceError, match=says):
        experiment(trace, there)


def test_an_unknown_key_is_named_with_the_nearest_known_one(tmp_path: Path) -> None:
    path = written(tmp_path, TOML.replace("command_gain", "comand_gain"))
    with pytest.raises(RecordingError, match=r"device.comand_gain.*command_gain"):
        read_recording(path)


def test_what_a_run_adds_to_an_effect_that_is_to_be_found_is_put_on_whatever_is_found() -> None:
    """Fails where a label that the file does not have is refused, or the factor is left out."""
    more = {"effect": "force_ripple", "at": "m1", "more": {"amplitude": 0.9}}
    times = {"effect": "coulomb_friction", "at": "m2", "times": {"level": 2.0}}
    changes = changes_of({"physics": [more, times]}, CART)
    assert changes is not None
    found = CART.with_physics(
        make_physics("force_ripple", "m1", amplitude=0.8, period=0.02, phase=0.1)
    ).with_physics(make_physics("coulomb_friction", "m2", level=0.3))
    there = {p.effect.name: dict(p.values) for p in changes.of(found).physics}
    assert there["force_ripple"] == {"amplitude": pytest.approx(1.7), "period": 0.02, "phase": 0.1}
    assert there["coulomb_friction"] == {"level": pytest.approx(0.6)}
    assert changes.of(CART).physics == CART.physics
    model = Model(CART).with_effect(found.physics[0], {"amplitude": 0.1})
    xs = np.random.default_rng(0).standard_normal((3, len(model.parameters)))
    members = changes.of_members(model.members(xs))
    for i, x in enumerate(xs):
        assert members.device(i) == changes.of(model.acting(x))


@pytest.mark.parametrize(
    ("own", "says"),
    [
        ({"at": "m1", "more": {"levle": 1.0}}, "levle.*did you mean 'level'"),
        ({"at": "m1", "times": {"level": 0.0}}, "level of the recording is 0; it must be a number"),
        (
            {"at": "m1", "times": {"level": 2.0}, "more": {"level": 2.0}},
            "in both `times` and `more`",
        ),
        ({"at": "command", "more": {"level": 1.0}}, "gravity_pendulum@command, which is unknown"),
    ],
)
def test_what_cannot_be_more_of_an_effect_is_said(own: Mapping[str, object], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        changes_of({"physics": [{"effect": "gravity_pendulum", **own}]}, CART)
