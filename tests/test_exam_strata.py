"""Machines as laboratories record them, and rigs that MuJoCo moved."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zwidth.diagnosis.recording.experiment import experiment
from zwidth.exam.by_mujoco import BY_MUJOCO, EFFECTS, film_by_mujoco, whole
from zwidth.exam.conceal import conceal, orders
from zwidth.exam.filming import Camera, Scene, film
from zwidth.exam.laboratory import (
    SKEW,
    STAMPS,
    Habits,
    between,
    draw_habits,
    logged,
    rested,
    stamped,
)
from zwidth.exam.machines import Machine
from zwidth.exam.mark import mark
from zwidth.exam.playing import Playing
from zwidth.exam.strata import LABORATORY, MUJOCO, STRATA
from zwidth.exam.tally import tally
from zwidth.exam.visible import standing
from zwidth.exam_page import goals, page
from zwidth.export.mujoco_run import engine
from zwidth.jobs.executor import Local
from zwidth.logs.recording import read_recording
from zwidth.planning.rehearsal import Noise
from zwidth.scenarios.concealed.handout import description_file
from zwidth.scenarios.concealed.rig import RunAway
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics

needs_mujoco = pytest.mark.skipif(engine() is None, reason="MuJoCo is not installed")
T, TICKS = 2e-3, 1000
AS_IT_IS = Habits(0.0, 0.0, "counted", 0.0, 0.0, "as it is", 0.0, 0.0)


def machine(link_damper: float = 2e-3) -> Machine:
    chain = make_chain([2e-3, 1e-3], [8e-3, 2e-3], 0.0, [4.0], [link_damper])
    return Machine(Device("rig", "", True, chain, Interface(period=T)), 1.0)


def scene(outputs: tuple[str, ...] = ("position_m1", "position_m2"), **more: Any) -> Scene:
    """A swing that begins softly, without noise."""
    t = np.arange(TICKS) * T
    wanted = 0.03 * np.sin(2.0 * np.pi * 0.8 * t) * np.minimum(1.0, t) + 0.01 * np.sin(21.0 * t)
    camera = Camera(outputs, np.inf, 0.0, 0.0)
    made = Scene(machine().device, Playing("sines", wanted), camera, 3)
    return replace(made, **more)


def test_the_motion_between_ticks_is_that_of_the_recording() -> None:
    made = film(scene())
    fine = between(made)
    n = made.states.shape[1] // 2
    np.testing.assert_allclose(fine[:: made.run.steps, :n], made.states[:, :n], rtol=0, atol=1e-14)


@pytest.mark.parametrize("skew", [-0.5, 0.0, 0.25, 0.5])
def test_a_skewed_reading_is_the_position_at_its_own_time(skew: float) -> None:
    """Mutation: without the skew the error is a hundred times the bound."""
    made = film(scene())
    random = np.random.default_rng(0)
    trace = logged(scene(), made, replace(AS_IT_IS, skew=skew), random)
    steps = made.run.steps
    at = np.clip(np.arange(TICKS) * steps + round(skew * steps), 0, None)
    true = between(made)
    for mass in (0, 1):
        error = trace[f"position_m{mass + 1}"] - true[at, mass]
        assert np.abs(error).max() < 1e-9
    if skew:
        assert np.abs(trace["position_m1"] - made.states[:, 0]).max() > 1e-4


def test_a_reading_with_jitter_is_off_by_the_speed_times_the_jitter() -> None:
    made = film(scene())
    trace = logged(scene(), made, replace(AS_IT_IS, jitter=0.1), np.random.default_rng(0))
    off = trace["position_m1"] - made.states[:, 0]
    expected = 0.1 * T / np.sqrt(3.0) * np.sqrt(np.mean(made.states[:, 2] ** 2))
    assert np.sqrt(np.mean(off**2)) == pytest.approx(expected, rel=0.1)


def test_what_begins_in_motion_or_after_a_rest() -> None:
    rest = replace(AS_IT_IS, beginning="after a rest", rest_s=0.5)
    late = rested(scene(), rest)
    assert late.playing.wanted.size == TICKS + 250
    trace = logged(late, film(late), rest, np.random.default_rng(0))
    assert not trace["command"][:250].any()
    assert not trace["position_m1"][:250].any()
    cut = replace(AS_IT_IS, beginning="in motion", cut=0.1)
    made = film(scene())
    trace = logged(scene(), made, cut, np.random.default_rng(0))
    np.testing.assert_array_equal(trace["command"], made.run.commands[100:])


def test_stamps() -> None:
    random = np.random.default_rng(1)
    of = {kind: stamped(1000, replace(AS_IT_IS, stamps=kind, resolution=0.3), random)
          for kind in STAMPS}  # fmt: skip
    np.testing.assert_allclose(np.diff(of["exact"]), 1.0)
    steps = of["rounded"] / 0.3
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    assert set(np.diff(of["coarse"])) == {0.0, 2.0}
    late = np.diff(of["late"])
    assert late.min() > 0.0
    assert 0.05 < np.std(late) < 0.3


def test_habits_are_as_stated() -> None:
    drawn = [draw_habits(np.random.default_rng(seed), 0.37) for seed in range(400)]
    assert max(abs(h.skew) for h in drawn) <= SKEW
    assert {h.decimal for h in drawn} == {0.0, 1e-3}
    assert {h.stamps for h in drawn} == set(STAMPS)
    made = film(scene())
    trace = logged(scene(), made, replace(AS_IT_IS, decimal=1e-3), np.random.default_rng(0))
    thousandths = trace["command"] / 1e-3
    np.testing.assert_allclose(thousandths, np.rint(thousandths), atol=1e-9)
    assert np.abs(trace["command"] - made.run.commands).max() < 5.1e-4


def test_a_laboratory_s_files_are_read_with_their_stamps(tmp_path: Path) -> None:
    conceal(tmp_path, orders(tmp_path, {LABORATORY: 4}, 1, 3.0), Local())
    texts = [description_file(tmp_path, f"r000{i}").read_text() for i in range(1, 5)]
    assert any('time = "time"' in text for text in texts)
    assert any("period_s" in text for text in texts)
    for i, text in enumerate(texts):
        assert ('time = "time"' in text) != ("period_s" in text)
        trace = read_recording(description_file(tmp_path, f"r000{i + 1}"))
        assert "time" not in trace.channels
        assert "command" in trace.channels


SMALL = {
    "coulomb_friction": ("m1", {"level": 5e-3}),
    "stribeck_friction": ("m2", {"level": 2e-3, "static_level": 3e-3, "velocity": 0.2}),
    "presliding_friction": ("m1", {"level": 4e-3, "stiffness": 0.5}),
    "quadratic_drag": ("m1", {"coefficient": 2e-3}),
    "constant_force": ("m1", {"level": 2e-3}),
    "gravity_pendulum": ("m1", {"level": 8e-3, "angle": 0.3}),
    "force_ripple": ("m1", {"amplitude": 5e-3, "period": 0.6, "phase": 0.4}),
    "backlash": ("link12", {"gap": 0.02}),
    "cubic_stiffness": ("link12", {"coefficient": 8e3}),
    "ground_spring": ("m1", {"stiffness": 2e-2}),
    "extra_mode": ("m2", {"mass": 3e-4, "stiffness": 2.0, "damping": 1e-3}),
    "actuator_lag": ("command", {"time_constant": 4e-3}),
    "saturation": ("command", {"limit": 0.02}),
    "loop_delay": ("clock", {"delay": 3e-3}),
}  # fmt: skip


@needs_mujoco
@pytest.mark.parametrize("name", EFFECTS)
def test_mujoco_moves_a_rig_as_the_exam_s_integrator_does(name: str) -> None:
    """Two engines that share no line agree to a two-hundredth of what the effect does.

    MuJoCo holds the state of a lag, and looks a delay up, over a step of 0.1 ms.
    """
    bound = 2e-2 if name in ("actuator_lag", "loop_delay") else 5e-3
    at, values = SMALL[name]
    bare = machine(0.0 if name == "backlash" else 2e-3).device
    device = bare.with_physics(make_physics(name, at, **values))
    assert whole(device)
    theirs, ours = film_by_mujoco(scene(device=device)), film(scene(device=device))
    without = film(scene(device=bare))
    for output in ("position_m1", "position_m2"):
        effect = np.std(ours.trace[output] - without.trace[output])
        assert np.std(theirs.trace[output] - ours.trace[output]) < bound * effect


@needs_mujoco
def test_a_rig_of_mujoco_is_controlled_disturbed_and_counted_as_others_are() -> None:
    """Same noise, same counts: the two recordings differ in few counts."""
    step = 2e-3
    playing = Playing("held_sines", scene().playing.wanted, (0.05, 4e-3, 0.6))
    camera = Camera(("position_m1", "velocity_m2"), 40.0, 3e-4, 2e-4)
    device = machine().device.with_interface(encoder_step=step)
    held = scene(device=device, playing=playing, camera=camera)
    theirs, ours = film_by_mujoco(held), film(held)
    off = np.abs(theirs.trace["position_m1"] - ours.trace["position_m1"])
    assert off.max() <= 1.01 * step
    assert np.mean(off > 0.0) < 0.01
    assert np.std(theirs.trace["command"] - ours.trace["command"]) < 0.02 * np.std(
        ours.trace["command"]
    )


def test_what_mujoco_lacks_is_not_drawn() -> None:
    bare = machine().device
    assert whole(bare)
    assert not whole(bare.with_physics(make_physics("dead_band", "command", width=1e-3)))
    # A tendon's damper acts inside the gap.
    assert not whole(bare.with_physics(make_physics("backlash", "link12", gap=0.02)))
    drawn = [BY_MUJOCO.machine(np.random.default_rng(seed)).device.chain for seed in range(60)]
    dampers = [chain.link_dampers for chain in drawn if chain.link_dampers.size]
    assert 0.2 < np.mean([not d.any() for d in dampers]) < 0.8


@needs_mujoco
def test_a_rig_that_diverges_is_refused_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    wild = Playing("held_sines", scene().playing.wanted, (5e4, 0.0, 1.0))
    with pytest.raises(RunAway, match="diverges"):
        film_by_mujoco(scene(playing=wild))
    assert not list(tmp_path.iterdir())


def test_without_mujoco_its_class_is_refused_in_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zwidth.exam.conceal.engine", lambda: None)
    with pytest.raises(ValueError, match="mujoco needs MuJoCo, which is not installed"):
        orders(tmp_path, {MUJOCO: 1}, 1)
    assert orders(tmp_path, {LABORATORY: 1}, 1)


def test_both_classes_have_rows_of_their_own() -> None:
    claim = {"effect": "force_ripple", "at": "m1", "parameters": {}, "rivals": []}
    friction = {"effect": "coulomb_friction", "at": "m1", "values": {}, "magnitude": 1.0,
                "share": 0.1, "sigma": 50.0}  # fmt: skip

    def answered(verdict: str, *findings: dict[str, Any]) -> dict[str, Any]:
        said = {"verdict": verdict, "findings": list(findings), "linear_refit": {}}
        return {"diagnosis": said, "seconds": 1.0, "core_seconds": 1.0, "samples": 1000}

    def key(name: str, stratum: str, *hidden: dict[str, Any]) -> dict[str, Any]:
        return {"recording": name, "stratum": stratum, "hidden": list(hidden), "outside": None}

    marks = [
        mark(key("r1", LABORATORY), answered("nothing_missing"), {}),
        mark(key("r2", LABORATORY), answered("identified", claim), {}),
        mark(key("r3", MUJOCO, friction), answered("identified", claim), {}),
    ]
    found = tally(marks, {})
    assert found["laboratory"]["false_claims"]["right"] == 1
    assert found["laboratory"]["claimed"] == ["force_ripple@m1"]
    assert found["mujoco"]["identified_and_wrong"]["right"] == 1
    assert found["rigs"]["recordings"] == found["none"]["recordings"] == 0
    asked = [row[0] for row in goals(found)]
    assert any("laboratories" in row for row in asked)
    assert any("MuJoCo" in row for row in asked)
    whole_page = {**found, "marks": [{"kind": m.kind} for m in marks]}
    pictures = {"magnitude": "x.png", "confusion": "x.png", "reliability": "x.png"}
    facts = {"command": "zwidth exam", "seed": 1, "length": "8 s"}
    text = page(whole_page, facts, pictures)
    assert "# At the limit" not in text
    for title in ("# Rigs that MuJoCo moved", "# Recorded as laboratories do"):
        assert title in text
    assert {STRATA[LABORATORY].kind, STRATA[MUJOCO].kind} == {LABORATORY, MUJOCO}


def test_what_a_refit_absorbs_is_not_visible() -> None:
    """A mass on a stiff spring is part of m2. Mutation: a refit below four times what is asked."""
    bare = machine().device
    stiff = make_physics("extra_mode", "m2", mass=3e-4, stiffness=60.0, damping=1e-2)
    camera = Camera(("position_m1",), np.inf, 1e-5, 1e-5)
    made = film(scene(device=bare.with_physics(stiff), camera=camera))
    (sigma,) = standing(bare, [stiff], [experiment(made.trace, bare)], Noise(1e-5, 1e-5), asked=1.0)
    assert sigma < 3.0
