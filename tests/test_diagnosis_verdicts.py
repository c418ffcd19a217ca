"""Recordings with a known cause: what the diagnosis says of them."""

import json
from pathlib import Path

import numpy as np
import pytest

from diagnosis.diagnose import diagnose
from diagnosis.gate import encoder_step_seen, examine
from diagnosis.result import Diagnosis, Verdict
from sim.device import Device
from sim.device_file import device_from_text, device_to_text
from sim.physics import make_physics
from tests.diagnosis_examples import phantom, record, shifted
from zwidth.diagnosis_report import Commands, save_report


def missing(effect: str, at: str, seed: int, **values: float) -> Diagnosis:
    truth = phantom().with_physics(make_physics(effect, at, **values))
    return diagnose(shifted(phantom()), [record(truth, 4.0, seed=seed)])


def test_nothing_is_missing_from_a_clean_recording():
    """Mutation that breaks it: a threshold of 3 instead of 22."""
    found = diagnose(phantom(), [record(phantom(), 4.0, seed=1)])
    assert found.verdict is Verdict.NOTHING_MISSING, found.sentence
    assert not found.findings
    # Cramer-Rao: 5 sigma in 20 s at 1.8e-4 N m; here two sigma in 2.8 s
    assert found.upper_bounds["coulomb_friction@m1"]["level"] < 1e-3
    assert found.one_step.after == pytest.approx(found.one_step.noise_floor, rel=0.1)


@pytest.mark.parametrize(
    ("effect", "at", "key", "value"),
    [
        ("coulomb_friction", "m1", "level", 4e-3),
        ("saturation", "command", "limit", 0.25),
        ("cubic_stiffness", "link12", "coefficient", 1e6),
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
    nested = {f"{r.effect}@{r.at}" for r in found.findings[0].rivals if r.separation_sigma == 0.0}
    if effect == "coulomb_friction":  # what contains it explains no less, tried or not
        assert {"directional_friction@m1", "stribeck_friction@m1", "hysteresis@ground"} <= nested
        assert found.verdict is Verdict.IDENTIFIED
    saved = device_from_text(device_to_text(found.device))
    assert saved == found.device
    as_json = json.loads(json.dumps(found.as_json()))
    assert as_json["findings"][0]["parameters"][key]["ci95"] == [estimate.lower, estimate.upper]
    assert sum(s["share"] for s in as_json["where"]["time"]) == pytest.approx(1.0)
    page = save_report(
        found, ["r"], Commands("zwidth diagnose r", "zwidth explore d"), tmp_path / "r.html"
    ).read_text()
    assert found.sentence in page
    assert page.count("data:image/svg+xml;base64,") == 2


def test_a_wrong_unit_is_a_fault_and_the_diagnosis_goes_on():
    """Mutation that breaks it: explained > 0.99."""
    found = diagnose(phantom(), [record(phantom(), 3.0, seed=5, gain=1.0 / 35.0)])
    assert found.verdict is Verdict.RECORDING_FAULT
    assert found.faults[0].kind == "command_scale"
    assert found.faults[0].value == pytest.approx(35.0, rel=0.1)
    assert not found.findings


@pytest.mark.parametrize(("limit", "scale"), [(0.12, 1.0), (np.inf, 1.0 / 3.0)])
def test_a_saturated_amplifier_is_no_wrong_unit(limit: float, scale: float):
    """Both seem driven by a third of their command.

    Mutation that breaks it: `_weakened` returns infinity.
    """
    truth = phantom()
    if np.isfinite(limit):
        truth = truth.with_physics(make_physics("saturation", "command", limit=limit))
    e = record(truth, 3.0, seed=5, gain=1.0 / scale)
    wrong = [f.kind for f in examine(phantom(), [e]) if f.wrong]
    assert wrong == ([] if np.isfinite(limit) else ["command_scale"])
    if np.isfinite(limit):
        found = diagnose(phantom(), [e])
        assert [(f.effect, f.at) for f in found.findings] == [("saturation", "command")]
        estimate = found.findings[0].parameters["limit"]
        assert estimate.lower < limit < estimate.upper


def test_the_sign_is_told_by_energy():
    """Mutation that breaks it: velocity of the wrong sign."""
    for gain, kinds in ((-1.0, ["command_sign"]), (1.0, [])):
        faults = examine(phantom(), [record(phantom(), 2.0, seed=6, gain=gain)])
        assert [f.kind for f in faults if f.wrong] == kinds


def test_encoder_steps_are_seen():
    """Mutation that breaks it: the mean of all gaps as the step."""
    random = np.random.default_rng(7)
    wave = np.sin(np.linspace(0.0, 30.0, 5000)) + 0.01 * random.standard_normal(5000)
    assert encoder_step_seen(0.02 * np.round(wave / 0.02)) == pytest.approx(0.02, rel=1e-9)
    assert encoder_step_seen(wave) is None
    visited = 0.02 * random.choice([0.0, 1.0, 2.0, 5.0, 9.0], 500)  # a fast motion skips steps
    assert encoder_step_seen(visited) == pytest.approx(0.02, rel=1e-9)


def test_an_augmented_device_has_nothing_missing():
    """The loop closes: what was found explains the recording."""
    truth: Device = phantom().with_physics(make_physics("coulomb_friction", "m1", level=4e-3))
    assert diagnose(truth, [record(truth, 3.0, seed=8)]).verdict is Verdict.NOTHING_MISSING
