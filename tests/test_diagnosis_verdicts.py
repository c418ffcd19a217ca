"""Recordings with a known cause: what the diagnosis says of them."""

import html
import json
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from tests.diagnosis_examples import (
    ENCODER_NOISE,
    FORCE_NOISE,
    OUTPUTS,
    phantom,
    record,
    shifted,
)
from zwidth.controllers.excitation import chirp, noise
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.adequacy import Adequacy, Ahead
from zwidth.diagnosis.answer.held_out import held_out
from zwidth.diagnosis.answer.result import (
    UNKNOWN_FIT,
    Diagnosis,
    Finding,
    HeldOut,
    Verdict,
)
from zwidth.diagnosis.answer.stands import (
    named_only_whole,
    on_first_part,
    second_look,
    standing,
)
from zwidth.diagnosis.answer.verdict import Facts, Left
from zwidth.diagnosis.answer.words import why
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.intake.gate import encoder_step_seen, examine
from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.mishaps import silent
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import Experiment, Output, experiment
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.diagnosis.selection.search import Search
from zwidth.diagnosis.selection.searched import Searched, as_found
from zwidth.diagnosis_report import Commands, save_report
from zwidth.exam.filming import Camera, Scene, film
from zwidth.exam.playing import Playing
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device, known
from zwidth.sim.device_file import device_from_text, device_to_text
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics, richer_at
from zwidth.sim.place import label_of
from zwidth.sim.run import simulate

BRIEF = replace(QUICK, effects=2, near=2, far=1, rivals=1)  # the point is not how much is tried


def missing(effect: str, at: str, seed: int, **values: float) -> Diagnosis:
    truth = phantom().with_physics(make_physics(effect, at, **values))
    return diagnose(shifted(phantom()), [record(truth, 4.0, seed=seed)], effort=BRIEF)


def test_nothing_is_missing_from_a_clean_recording():
    """Mutation that breaks it: a threshold of 3 instead of 22."""
    found = diagnose(phantom(), [record(phantom(), 4.0, seed=1)], effort=BRIEF)
    assert found.verdict is Verdict.NOTHING_MISSING, found.sentence
    assert not found.findings
    # Cramer-Rao: 5 sigma in 20 s at 1.8e-4 N m; here two sigma in 2.8 s
    assert found.upper_bounds["coulomb_friction@m1"]["level"] < 1e-3
    assert found.one_step.after == pytest.approx(found.one_step.noise_floor, rel=0.1)


@pytest.mark.parametrize(
    ("effect", "at", "key", "value"),
    [
        ("coulomb_friction", "m1", "level", 4e-3),
        pytest.param("saturation", "command", "limit", 0.25, marks=pytest.mark.truth),
        pytest.param("cubic_stiffness", "link12", "coefficient", 1e6, marks=pytest.mark.truth),
    ],
)
def test_the_effect_is_named_with_its_parameter(
    effect: str, at: str, key: str, value: float, tmp_path: Path
):
    """Seen inside three standard errors, as one interval in twenty misses its truth.

    Mutations that break it: starts of the effect left out; the sign of the innovation turned.
    """
    found = missing(effect, at, 2, **{key: value})
    assert [(f.effect, f.at) for f in found.findings] == [(effect, at)]
    estimate = found.findings[0].parameters[key]
    assert (
        abs(estimate.value - value) < 1.5 * 0.5 * (estimate.upper - estimate.lower) + 0.01 * value
    )
    assert found.one_step.after < found.one_step.refit
    _richer_laws_were_fitted(found)
    if effect == "coulomb_friction":
        assert found.verdict is Verdict.IDENTIFIED
    saved = device_from_text(device_to_text(found.device))
    assert saved == found.device
    as_json = json.loads(json.dumps(found.as_json()))
    assert as_json["findings"][0]["parameters"][key]["ci95"] == [estimate.lower, estimate.upper]
    assert sum(s["share"] for s in as_json["where"]["time"]) == pytest.approx(1.0)
    page = save_report(
        found, ["r"], Commands("zwidth diagnose r", "zwidth explore d"), tmp_path / "r.html"
    ).read_text()
    assert found.headline in html.unescape(page).replace("\u00a0", " ")
    pictures = page.count('<img src="data:image/svg+xml;base64,')
    unknown = found.verdict is Verdict.UNKNOWN_PHYSICS  # which shows where the refit fails
    assert pictures == 2 + unknown + ("friction" in effect)  # and its curve


def _richer_laws_were_fitted(found: Diagnosis) -> None:
    """What contains the effect at its place was fitted in it, and stands with a measured figure.

    Or it was refused: where its fit ended against physics, or in a parameter of which the recording
    says nothing.
    """
    (finding,) = found.findings
    best = found.searched.tried.best
    (own,) = best.model.effects
    every = richer_at(own.effect.name, own.place, rotary=True)
    richer = {label_of(e.name, at) for e, at in every if not known(e, at, best.model.nominal)}
    behind = {f"{r.effect}@{r.at}": r.separation_sigma for r in finding.rivals}
    assert behind
    assert 0.0 not in behind.values()
    for label in richer - behind.keys():
        fitted = found.searched.tried.tried.get(frozenset((label,)))
        assert fitted is None or fitted.cost.freedom == np.inf, label
    if own.effect.name == "coulomb_friction":
        assert {"directional_friction@m1", "stribeck_friction@m1"} & behind.keys()


@pytest.mark.truth
def test_a_wrong_unit_is_a_fault_and_the_diagnosis_goes_on():
    """Mutation that breaks it: explained > 0.99."""
    found = diagnose(phantom(), [record(phantom(), 3.0, seed=5, gain=1.0 / 35.0)], effort=BRIEF)
    assert found.verdict is Verdict.RECORDING_FAULT
    assert found.faults[0].kind == "command_scale"
    assert found.faults[0].value == pytest.approx(35.0, rel=0.1)
    assert not found.findings


@pytest.mark.truth
@pytest.mark.parametrize(("limit", "scale"), [(0.12, 1.0), (np.inf, 1.0 / 3.0)])
def test_a_saturated_amplifier_is_no_wrong_unit(limit: float, scale: float):
    """Both seem driven by a third of their command.

    Mutation that breaks it: no friction among the forces beside the scale.
    """
    truth = phantom()
    if np.isfinite(limit):
        truth = truth.with_physics(make_physics("saturation", "command", limit=limit))
    e = record(truth, 3.0, seed=5, gain=1.0 / scale)
    wrong = [f.kind for f in examine(phantom(), [e]) if f.wrong]
    assert wrong == ([] if np.isfinite(limit) else ["command_scale"])
    if np.isfinite(limit):
        found = diagnose(phantom(), [e], effort=BRIEF)
        assert [(f.effect, f.at) for f in found.findings] == [("saturation", "command")]
        estimate = found.findings[0].parameters["limit"]
        assert estimate.lower < limit < estimate.upper


def test_a_spring_that_the_device_file_does_not_know_is_no_wrong_unit():
    """A stiff spring to ground holds the device as if half of its command arrived.

    At one frequency below its own nothing else could be told; what moves fast tells the scale.
    Mutation that breaks it: no spring among the forces beside the scale.
    """
    device = phantom()
    device = device.with_chain(device.chain._replace(ground_spring=1.0))
    slow = 0.1 * np.sin(2.0 * np.pi * 2.0 * 0.001 * np.arange(3000))
    fast = noise(duration=3.0, seed=3)
    for command, stiffness, scale, faults in (
        (slow, 1.0, 1.0, []),
        (fast, 1.0, 1.0, []),
        (fast, 0.0, 0.3, ["command_scale"]),
    ):
        held = make_physics("ground_spring", "m1", stiffness=stiffness)
        run = simulate(device.with_physics(held), recorded(command), duration=3.0)
        e = Experiment(0.001, command / scale, run.trace["position_m1"][:, None], OUTPUTS)
        assert [f.kind for f in examine(device, [e]) if f.wrong] == faults


def test_the_sign_is_told_by_energy():
    """Mutation that breaks it: velocity of the wrong sign."""
    for gain, kinds in ((-1.0, ["command_sign"]), (1.0, [])):
        faults = examine(phantom(), [record(phantom(), 2.0, seed=6, gain=gain)])
        assert [f.kind for f in faults if f.wrong] == kinds


def test_a_step_is_told_with_its_unit():
    """Mutation that breaks it: velocities in rad."""
    e = record(phantom(), 1.0, seed=6)
    coarse = 1e-3 * np.round(
        np.column_stack([e.measured, 1e3 * np.gradient(e.measured[:, 0])]) / 1e-3
    )
    both = replace(e, measured=coarse, outputs=(Output("position", 0), Output("velocity", 0)))
    steps = [f for f in examine(phantom(), [both]) if f.kind.endswith("_step")]
    assert [f.kind for f in steps] == ["encoder_step", "velocity_step"]
    assert [f.sentence.split("steps of ")[1] for f in steps] == ["1 mrad", "1 mrad/s"]


def test_encoder_steps_are_seen():
    """Mutation that breaks it: the mean of all gaps as the step."""
    random = np.random.default_rng(7)
    wave = np.sin(np.linspace(0.0, 30.0, 5000)) + 0.01 * random.standard_normal(5000)
    assert encoder_step_seen(0.02 * np.round(wave / 0.02)) == pytest.approx(0.02, rel=1e-9)
    assert encoder_step_seen(wave) is None
    visited = 0.02 * random.choice([0.0, 1.0, 2.0, 5.0, 9.0], 500)  # a fast motion skips steps
    assert encoder_step_seen(visited) == pytest.approx(0.02, rel=1e-9)


@pytest.mark.truth
def test_an_augmented_device_has_nothing_missing():
    """The loop closes: what was found explains the recording."""
    truth: Device = phantom().with_physics(make_physics("coulomb_friction", "m1", level=4e-3))
    twice = replace(QUICK, effects=2, rounds=2)  # the longer horizon is looked at, too
    found = diagnose(truth, [record(truth, 3.0, seed=8)], effort=twice)
    assert found.verdict is Verdict.NOTHING_MISSING, found.sentence


@pytest.mark.truth
def test_what_shows_in_the_held_out_data_alone_is_named_and_said():
    """An amplifier that meets its limit in the last seconds only.

    Mutation that breaks it: no second look, after which a force without a name is left.
    """
    weak = np.where(np.arange(4000) < 2900, 0.25, 1.0)
    truth = phantom().with_physics(make_physics("saturation", "command", limit=0.25))
    random = np.random.default_rng(3)
    command = weak * noise(duration=4.0, seed=3)
    force = FORCE_NOISE * random.standard_normal(command.size)
    run = simulate(truth, recorded(command), duration=4.0, disturbance=force)
    position = run.trace["position_m1"] + ENCODER_NOISE * random.standard_normal(command.size)
    e = Experiment(0.001, command, position[:, None], OUTPUTS)
    assert np.abs(command[:2800]).max() < 0.25
    found = diagnose(phantom(), [e], effort=BRIEF)
    assert [(f.effect, f.at) for f in found.findings] == [("saturation", "command")]
    assert found.findings[0].parameters["limit"].value == pytest.approx(0.25, rel=0.02)
    assert [f.kind for f in found.faults] == ["held_out_used"]
    assert (
        "saturation at command could be found only by fitting the held-out data too"
        in found.faults[0].sentence
    )
    assert found.one_step.after < found.one_step.refit
    first = on_first_part(found.searched)
    assert [part.ticks for part in first.problem.experiments] == [2800]
    by, _ = held_out(phantom(), first, [e.split()[1]])
    assert found.one_step.after == pytest.approx(by.after, rel=1e-6)


def test_a_chirp_whose_end_shows_a_resonance_is_no_unknown_physics() -> None:
    """The first 70 % reach 11 Hz, so that nearly any resonance above explains them.

    The intervals hold the truth, which the fit of the first part misses by a third. Mutation: a
    second look that asks for new effects only, after which the verdict is `unknown_physics`.
    """
    face = Interface(period=4e-3, delay=6e-3, encoder_step=2.5e-3)
    chain = make_chain([7.5e-5, 7.4e-5], [1.7e-5, 3.4e-5], 0.0141, [0.309], [1e-7])
    truth = Device("rig", "", True, chain, face)
    wrong = make_chain([1.3e-4, 2e-5], [2.9e-5, 2.3e-5], 0.0142, [0.115], [7e-8])
    file = replace(truth, chain=wrong)
    camera = Camera(("position_m1",), np.inf, 4e-4, 1.4e-6)
    played = Playing("chirp", chirp(1.2e-3, 0.3, 16.0, 6.0, 4e-3))
    made = film(Scene(truth, played, camera, 2))
    found = diagnose(file, [experiment(made.trace, file)], effort=QUICK)
    assert found.verdict is Verdict.LINEAR_PARAMETERS, found.sentence
    assert [f.kind for f in found.faults] == ["encoder_step", "held_out_used"]
    assert "give a second recording with --validate" in found.faults[1].sentence
    for name, value in (("m1", 7.5e-5), ("m2", 7.4e-5), ("k12", 0.309)):
        estimate = found.linear_refit[name][1]
        assert estimate.lower < value < estimate.upper
        assert estimate.upper - estimate.lower < 0.1 * value


def test_free_runs_that_fail_later_than_what_was_fitted_ask_for_a_second_look() -> None:
    """Mutation that breaks it: whatever held on what was fitted."""
    model = Model(phantom())
    h = settled(judged([record(phantom(), 1.0)], model, np.zeros(model.linear_count)))
    found = as_found(phantom(), Search(h, h, QUICK, silent))
    nothing = Left(0.0, "")
    sound, fails = (
        Adequacy((Ahead(0.05, error, 1.0, 2.0, 0.1, 0.5),), 0.0, 0.0, False, 40)
        for error in (1.0, 3.0)
    )
    held = replace(found, held=True)
    assert named_only_whole(held, nothing, None, fails)
    assert not named_only_whole(held, nothing, None, sound)
    assert not named_only_whole(held, nothing, None, None)
    assert not named_only_whole(found, nothing, None, fails)


def test_no_name_is_promised_beside_disturbances_that_do_a_fifth_of_the_motion() -> None:
    """What a law of time and speed left on a rig, taken for a slow force by the noise model.

    Mutation that breaks it: the noise floor not taken off.
    """
    named = (Finding("extra_mode", "m1", {}, 39.0, ()),)
    sound = Adequacy((Ahead(0.5, 1.0, 1.0, 2.0, 0.1, 0.5),), 0.5, 5.0, True, 40)

    def of(free: HeldOut) -> Facts:
        return Facts(named, {}, Left(0.0, ""), None, sound, free)

    far = of(HeldOut(0.32, 0.43, 0.19, 0.007))
    assert far.verdict is Verdict.UNKNOWN_PHYSICS
    assert "only together with large random forces" in why(far)
    assert of(HeldOut(0.32, 0.43, 0.19, 0.18)).verdict is Verdict.IDENTIFIED
    stood = of(HeldOut(0.32, 0.43, 0.767, 0.757))  # a mass that stood
    assert stood.verdict is Verdict.IDENTIFIED
    assert of(HeldOut(0.32, 0.43, 0.02, 0.007)).verdict is Verdict.IDENTIFIED
    assert of(UNKNOWN_FIT).verdict is Verdict.IDENTIFIED
    unjudged = replace(of(UNKNOWN_FIT), sound=None)
    assert unjudged.verdict is Verdict.UNDECIDED  # whatever was found, nothing has judged it
    assert "there is too little held-out data" in why(unjudged)


@pytest.mark.parametrize("at_once", [True, False])
def test_an_interrupted_second_look_is_said(at_once: bool, monkeypatch: pytest.MonkeyPatch):
    """What was found before stays, and is not passed off as all that could be found.

    Mutation that breaks it: the first search's own word for it.
    """
    model = Model(phantom())
    h = settled(judged([record(phantom(), 1.0)], model, np.zeros(model.linear_count)))
    search = Search(h, h, QUICK, silent)
    search.keep(h)
    found = as_found(phantom(), search)

    def interrupted(*_: object) -> Searched:
        if at_once:
            raise KeyboardInterrupt
        return replace(found, tried=replace(search, interrupted=True))

    left = Left(100.0, "a force", True)
    assert not found.interrupted
    monkeypatch.setattr("zwidth.diagnosis.answer.stands.searched_through", interrupted)
    kept, same, note = second_look(found, left, [], silent)
    assert kept.interrupted
    assert kept.final is found.final
    assert (same, note) == (left, None)


def test_nothing_missing_is_no_promise_where_free_runs_err() -> None:
    """A rig of five masses had free runs that erred 42 % of the motion, and nothing believed.

    Mutation: `wander` asked of findings alone.
    """
    far, near = (
        Facts((), {}, Left(0.0, ""), free=HeldOut(0.6, after, after, 0.04))
        for after in (0.42, 0.05)
    )
    assert far.verdict is Verdict.UNDECIDED
    assert "42 % of the motion" in why(far)
    assert near.verdict is Verdict.NOTHING_MISSING


def test_where_held_out_data_refuse_what_is_believed_most_the_next_is_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """And nothing that has all of what was refused and more; what costs less stays a rival.

    Mutation: supersets of the refused are asked as well.
    """
    device = phantom()
    taken = [record(device.with_physics(make_physics("coulomb_friction", "m1", level=0.02)), 2.0)]
    plain = settled(judged(taken, Model(device), np.zeros(Model(device).linear_count)))
    search = Search(plain, plain, QUICK, silent)
    coulomb, bristles, drag = (
        make_physics("coulomb_friction", "m1", level=0.02),
        make_physics("presliding_friction", "m1", level=0.02, stiffness=100.0),
        make_physics("quadratic_drag", "m1", coefficient=1e-3),
    )
    for i, laws in enumerate(((coulomb,), (bristles,), (coulomb, drag))):
        model = Model(device)
        for law in laws:
            model = model.with_effect(law, dict(law.values))
        h = search.keep(settled(judged(taken, model, np.zeros(len(model.parameters)))))
        search.best = h if i == 0 else search.best
    found = as_found(device, search)
    assert search.best.labels == {"coulomb_friction@m1"}

    def stands(_: object, by: Searched, __: object) -> Adequacy:
        better = -5.0 if by.final.model.label == "coulomb_friction@m1" else 5.0
        return Adequacy((Ahead(0.5, 1.0, 1.0, 2.0, 0.1, 0.5),), 0.5, better, True, 40)

    monkeypatch.setattr("zwidth.diagnosis.answer.stands.held_adequacy", stands)
    other, sound = standing(device, cast("Taken", None), found, silent)
    assert other.final.model.label == "presliding_friction@m1"
    assert sound is not None
    assert sound.useful
