"""Truths of what follows a diagnosis: the next experiment, the boundary, the log."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import zwidth.planning.next_experiment as choosing
from tests.diagnosis_examples import phantom
from zwidth.diagnosis.answer.friction_curve import missing_force
from zwidth.diagnosis.fitting.descend import fit
from zwidth.diagnosis.fitting.fit import Problem
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import SETTLING
from zwidth.diagnosis.noise.steady import steady
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis_log import diagnosis_trace
from zwidth.figures.augmented_boundary import augmented_boundary_figure
from zwidth.logs.mcap_reader import read_log
from zwidth.logs.mcap_writer import write_log
from zwidth.planning.excitations import Scale, excitation
from zwidth.planning.next_experiment import next_experiment
from zwidth.planning.rehearsal import Noise, known_observer, noise_of, rehearse
from zwidth.scenarios.scenario_file import load_scenario
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.plant import hold
from zwidth.stability.augmented_boundary import augmented_boundary, critical

MASS = Device("mass", "", True, make_chain([1e-3], [5e-3]), Interface(period=0.001, delay=0.002))
SEEN = Noise(1e-3, 1e-5)


@cache
def recorded() -> Experiment:
    command = excitation("small_multisine", MASS, 6.0, Scale(1.0, 2.0), seed=1)
    return rehearse(MASS, command, SEEN, seed=2)


def test_an_observer_gives_its_noise_back():
    """Mutation that breaks it: the ratio's root left out."""
    for device in (MASS, phantom()):
        found = noise_of(device, recorded(), known_observer(device, recorded(), SEEN))
        assert found.process == pytest.approx(SEEN.process, rel=1e-6)
        assert found.measurement == pytest.approx(SEEN.measurement, rel=1e-6)


@pytest.mark.parametrize("ratio", [1e-4, 1.0, 1e4])
def test_where_a_free_device_stands_is_followed_from_its_velocity(ratio: float):
    """The steady gain is that of Kalman's recursion, although what is not known of where it stands
    grows for ever in it.

    Mutations: the gain of where it stands zero; X without the part that P brings.
    """
    device = phantom()
    e = replace(recorded(), outputs=(Output("velocity", 0),))
    found = steady(device, e, ratio)
    plant = device.plant()
    a, b = hold(plant, e.period)
    c = np.zeros((1, plant.size))
    c[0, plant.dof] = 1.0
    source = b[:, 1] * float(plant.matrices.mass.trace()) / e.period**2
    process = ratio * np.outer(source, source)
    p, gain = np.zeros((plant.size, plant.size)), np.zeros((plant.size, 1))
    for _ in range(10000):
        p = a @ p @ a.T + process
        gain = p @ c.T / (c @ p @ c.T + e.period**-2)
        rest = np.eye(plant.size) - gain @ c
        p = rest @ p @ rest.T + gain @ gain.T * e.period**-2
    assert found.gain == pytest.approx(gain, rel=1e-3, abs=1e-7 * float(np.abs(gain).max()))


def test_the_next_experiment_separates_best_and_plays(tmp_path: Path):
    """Its file has a command no larger than the recording's. A triangle, which has no power where a
    lag differs from a delay, comes last between these.

    Mutation that breaks it: the least separating excitation chosen.
    """
    observer = known_observer(MASS, recorded(), SEEN)
    friction = make_physics("coulomb_friction", "m1", level=3e-3)
    band = make_physics("dead_band", "command", width=5e-3)
    out = tmp_path / "next" / "one.toml"
    found = next_experiment(MASS, friction, band, [recorded()], observer, out)
    assert found is not None
    assert found.separates == ("coulomb_friction@m1", "dead_band@command")
    assert found.separation_sigma == max(found.sigmas.values()) > 5.0
    scenario = load_scenario(out)
    peak = float(np.abs(recorded().command).max())
    assert np.abs(scenario.controller.parameters).max() <= peak * (1.0 + 1e-9)
    assert found.as_json()["scenario"] == str(out)
    lag = make_physics("actuator_lag", "command", time_constant=5e-4)
    delay = make_physics("loop_delay", "clock", delay=5e-4)
    other = next_experiment(MASS, lag, delay, [recorded()], observer, tmp_path / "two.toml")
    assert other is not None
    assert list(other.sigmas)[-1] == "slow_triangle"


def test_what_is_not_computed_to_the_end_changes_no_choice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Mutations: an excitation skipped where its limit is above the best; `enough` a sigma more."""
    lag = make_physics("actuator_lag", "command", time_constant=5e-4)
    delay = make_physics("loop_delay", "clock", delay=5e-4)
    asked = MASS, lag, delay, [recorded()], known_observer(MASS, recorded(), SEEN)
    found = next_experiment(*asked, tmp_path / "all.toml")
    assert found is not None
    monkeypatch.setattr(choosing, "TELLING", 0.0)
    exact: dict[str, float] = {}
    for name in found.sigmas:
        monkeypatch.setattr(choosing, "LIBRARY", (name,))
        alone = next_experiment(*asked, tmp_path / "one.toml")
        exact[name] = 0.0 if alone is None else alone.separation_sigma
    assert found.separation_sigma == exact[found.excitation] == max(exact.values())
    assert all(found.sigmas[name] >= sigma for name, sigma in exact.items())


def test_what_nothing_separates_has_no_next_experiment(tmp_path: Path):
    """A rigid pair of masses has one spring to ground. Mutation that breaks it: no least sigma."""
    stiff = make_chain([5e-4, 3e-4, 2e-4], [5e-3, 0.0, 0.0], 0.0, [1e6, 1e6], [1.0, 1.0])
    device = Device("stiff", "", True, stiff, Interface(period=0.001))
    one, other = (make_physics("ground_spring", at, stiffness=0.01) for at in ("m1", "m3"))
    e = rehearse(device, excitation("small_multisine", device, 6.0, Scale(1.0, 2.0)), SEEN)
    observer = known_observer(device, e, SEEN)
    out = tmp_path / "none.toml"
    assert next_experiment(device, one, other, [e], observer, out) is None
    assert not out.exists()


def test_the_boundary_of_a_device_with_nothing_found_is_its_own():
    """And the formula of a mass: K < (b + B) / (T / 2 + t_d) to first order.

    Mutation that breaks it: the sentence's `SAME` at zero.
    """
    found = augmented_boundary(MASS, MASS, dampings=[0.0, 0.002])
    assert found is not None
    assert found.nominal == found.augmented
    for bracket in found.nominal:
        k = critical(bracket)
        assert k == pytest.approx((5e-3 + bracket.damping) / 2.5e-3, rel=0.03)
    assert "K_CR at B = 0 stays at 2" in found.sentence


def test_friction_found_raises_the_boundary():
    """Coulomb friction stabilises small motion: V* = 4 fc / (pi (K tau - b)) with the speed of a
    displacement A released, A sqrt(K / m), between the two ends of K.

    Mutation that breaks it: the augmented device without its physics.
    """
    level = 2e-4
    rubbing = MASS.with_physics(make_physics("coulomb_friction", "m1", level=level))
    found = augmented_boundary(MASS, rubbing, "coulomb_friction at m1", dampings=[0.0])
    assert found is not None
    k = critical(found.augmented[0])
    assert k is not None
    speed = found.start * np.sqrt(k / 1e-3)
    assert speed == pytest.approx(4.0 * level / (np.pi * (k * 2.5e-3 - 5e-3)), rel=0.15)
    assert "K_CR at B = 0 rises from 2" in found.sentence
    axes = augmented_boundary_figure(found).axes[0]
    assert "N m/rad" in axes.get_ylabel()
    assert len(axes.get_lines()) == 3


def test_friction_beside_a_fast_mode_gets_its_substeps():
    """Mutation that breaks it: four substeps for all."""
    chain = make_chain([1e-3, 1e-5], [5e-3, 0.0], 0.0, [2e3], [1e-2])
    fast = Device("fast", "", True, chain, MASS.interface)
    rubbing = fast.with_physics(make_physics("coulomb_friction", "m2", level=1e-4))
    found = augmented_boundary(fast, rubbing, dampings=[0.0])
    assert found is not None
    assert found.augmented[0].stable is not None


def test_no_boundary_without_a_stable_wall():
    """Mutation that breaks it: no check of the last damping."""
    slow = MASS.with_interface(delay=0.1).with_chain(make_chain([1e-3], [-0.05]))
    assert augmented_boundary(slow, slow) is None


def test_missing_force_is_the_force_that_is_missing():
    """A ripple along the way: the estimate follows a sin(2 pi q / period + phase) to a few percent
    in size, except for what a refit took. Mutation that breaks it: its sign.
    """
    values = {"amplitude": 5e-3, "period": 0.1, "phase": 0.4}
    ripple = make_physics("force_ripple", "m1", **values)
    truth = phantom().with_physics(ripple)
    command = excitation("small_multisine", phantom(), 6.0, Scale(1.5, 1.0))
    e = rehearse(truth, command, Noise(2e-3, 1e-5))
    problem = Problem([e], known_observer(phantom(), e, Noise(2e-3, 1e-5)))
    known = fit(problem, Model(phantom()), rounds=1)  # no refit: all of it is missing
    force = missing_force(problem, known, e, "m1")
    q = e.measured[:, 0]
    wave = values["amplitude"] * np.sin(2.0 * np.pi * q / values["period"] + values["phase"])
    assert np.corrcoef(force, wave)[0, 1] > 0.95
    assert np.std(force) == pytest.approx(np.std(wave), rel=0.3)
    final = fit(problem, Model(phantom(), (ripple,), ({},)))
    assert np.std(missing_force(problem, final, e, "m1")) < 0.2 * np.std(wave)


def test_the_log_of_a_diagnosis_reads_back_on_the_recording_s_time(tmp_path: Path):
    """measured = predicted + residual; free runs begin where the observer has settled.

    Mutation that breaks it: a free run shifted by one window.
    """
    e = recorded()
    problem = Problem([e], known_observer(MASS, e, SEEN))
    fitted = fit(problem, Model(MASS))
    trace = diagnosis_trace(problem, fitted, fitted, e, place="sensor", start_s=2.5)
    path = tmp_path / "diagnosis.mcap"
    write_log(path, trace, epoch_ns=10**9)
    back = read_log(path).tick
    assert back.t[0] == 2.5
    assert np.array_equal(back.t, trace.t)
    y = back["position_m1"]
    assert np.array_equal(y, e.measured[:, 0])
    assert np.allclose(
        back["refit_position_m1"][SETTLING:] + back["refit_residual_position_m1"][SETTLING:],
        y[SETTLING:],
    )
    free = back["found_free_position_m1"]
    first = int(np.flatnonzero(np.isfinite(free))[0])
    assert first == 500  # the first window of half a second after the observer has settled
    # At its first tick a free run still has the observer's state, and errs by the noise only.
    assert abs(free[first] - y[first]) < 6.0 * float(problem.observer.deviation[0])
    assert np.std((free - y)[first:]) < 0.2 * np.std(y)
    assert back.units["missing_force_m1"] == "N m"


def test_the_log_of_a_diagnosis_holds_every_output():
    """A velocity beside the position: measured, predicted, free and left, in its own unit.

    Mutation that breaks it: the first output alone.
    """
    e = recorded()
    speed = np.gradient(e.measured[:, 0], e.period)
    both = replace(
        e,
        measured=np.column_stack([e.measured[:, 0], speed]),
        outputs=(*e.outputs, Output("velocity", 0)),
    )
    problem = Problem([both], known_observer(MASS, both, SEEN))
    fitted = fit(problem, Model(MASS))
    trace = diagnosis_trace(problem, fitted, fitted, both)
    for word in ("", "refit_", "found_", "refit_free_", "found_free_", "refit_residual_"):
        assert trace.units[f"{word}position_m1"] == "rad"
        assert trace.units[f"{word}velocity_m1"] == "rad/s"
    assert np.array_equal(trace["velocity_m1"], speed)
    left = (trace["velocity_m1"] - trace["found_velocity_m1"])[SETTLING:]
    assert np.allclose(left, trace["found_residual_velocity_m1"][SETTLING:])
