"""Truths of planning: excitations keep what a device bears, plans agree with limits."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from page_checks import chromium, faults_of_figure

from zwidth.cli import run
from zwidth.figures.plan import limits_in_words, plan_figure
from zwidth.planning.excitations import (
    LIBRARY,
    Scale,
    excitation,
    save_scenario,
    scale_for,
    travelled,
)
from zwidth.planning.limits import SHOWN, sigma
from zwidth.planning.plan import ALIKE, Plan, Visible, better_excitations, nearest_of, plan
from zwidth.planning.reference import Reference
from zwidth.planning.rehearsal import Noise, rehearse
from zwidth.scenarios.scenario_file import load_scenario
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_to_text
from zwidth.sim.interface import Interface
from zwidth.sim.physics import EFFECTS, make_physics

MASS = Device("mass", "", True, make_chain([1e-3], [5e-3]), Interface(period=0.001))
SEEN = Noise(1e-3, 1e-5)
SCALE = Scale(0.5, 0.5)


@pytest.mark.parametrize("name", LIBRARY)
def test_excitations_keep_level_and_travel(name: str):
    """And reach one of them, save the small one. Mutation that breaks it: only the level is kept
    (the slow triangle goes 160 rad).
    """
    command = excitation(name, MASS, 4.0, SCALE, seed=1)
    assert command.shape == (4000,)
    if name != "standard_session":  # its parts are each within; one after the other they may add
        assert travelled(MASS, command) <= SCALE.travel * (1.0 + 1e-9)
    peak = float(np.abs(command).max())
    assert peak <= SCALE.level * (1.0 + 1e-9)
    strongest = max(peak / SCALE.level, travelled(MASS, command) / SCALE.travel)
    assert strongest > (0.09 if name == "small_multisine" else 0.8)
    assert np.array_equal(command, excitation(name, MASS, 4.0, SCALE, seed=1))


def test_a_device_with_friction_is_driven_past_it():
    """Mutation that breaks it: travel by the device without its physics."""
    rubbing = MASS.with_physics(make_physics("coulomb_friction", "m1", level=0.05))
    command = excitation("slow_triangle", rubbing, 4.0, SCALE)
    assert np.abs(command).max() > 0.05
    assert 0.9 * SCALE.travel < travelled(rubbing, command) <= SCALE.travel


def test_scale_comes_from_limit_or_recording():
    """Mutation that breaks it: the level of a recording beyond the device's limit."""
    assert scale_for(MASS.with_interface(command_limit=0.2)).level == pytest.approx(0.18)
    recorded = rehearse(MASS, excitation("white_noise", MASS, 2.0, SCALE), SEEN)
    found = scale_for(MASS.with_interface(command_limit=0.2), [recorded])
    assert found.level == pytest.approx(0.18)
    assert found.travel == pytest.approx(0.75 * float(np.ptp(recorded.measured)))
    free = scale_for(MASS)
    assert free.travel == 1.0
    assert travelled(MASS, excitation("white_noise", MASS, 10.0, free)) == pytest.approx(1.0)
    with pytest.raises(ValueError, match=r"level is 0; it must be finite and > 0"):
        Scale(0.0, 1.0)
    with pytest.raises(ValueError, match=r"no excitation 'chrip'; did you mean 'chirp'"):
        excitation("chrip", MASS, 2.0, SCALE)


def test_the_scenario_plays_the_excitation(tmp_path: Path):
    """Mutation that breaks it: the array named with its folder."""
    command = excitation("random_steps", MASS, 1.0, SCALE, seed=2)
    path = save_scenario(MASS, command, tmp_path / "deep" / "steps.toml")
    scenario = load_scenario(path)
    assert np.array_equal(scenario.controller.parameters, command)
    assert scenario.device == MASS
    assert scenario.ticks == command.size


@cache
def planned() -> tuple[Plan, Reference]:
    command = excitation("white_noise", MASS, 4.0, SCALE, seed=3)
    return plan(MASS, rehearse(MASS, command, SEEN, name="white_noise"), SEEN)


def test_a_plan_has_every_effect_at_five_sigma():
    """Mutation that breaks it: an effect left out."""
    found, reference = planned()
    labels = {v.label for v in found.visible}
    assert {s.label for s in reference.starts} | {"dropped_samples@clock"} == labels
    for visible in found.visible:
        if visible.physics is not None and not visible.label.startswith("dropped"):
            assert sigma(reference, visible.physics) == pytest.approx(SHOWN, rel=0.05)
    one = next(v for v in found.visible if v.label == "force_ripple@m1")
    assert set(one.shape) == {"period", "phase"}


def test_distances_of_a_plan():
    """From nothing an effect at three times its limit stands at 15 sigma if it is linear; a delay
    that shows beside the clock's skew is samples long, and told from a lag; no distance
    exceeds that from nothing, where the rival is not itself one of those that a refit would absorb.

    Mutation that breaks it: effects compared at their limit.
    """
    found, _ = planned()
    place = {label: i for i, label in enumerate(found.labels)}
    alone = found.distances[place["constant_force@m1"], place["constant_force@m1"]]
    assert alone == pytest.approx(ALIKE * SHOWN, rel=0.05)
    refitted = [label.split("@")[0] not in ("loop_delay", "constant_force", "ground_spring")
                for label in found.labels]  # fmt: skip
    whole = np.diag(found.distances)[:, None]
    assert np.all(found.distances[:, refitted] <= whole * (1.0 + 1e-6))
    pairs = {frozenset((p.effect, p.rival)) for p in found.confusable}
    assert frozenset(("directional_friction@m1", "rising_friction@m1")) in pairs
    assert frozenset(("actuator_lag@command", "loop_delay@clock")) not in pairs


def test_an_excitation_that_does_better_does_so_on_its_own_recording():
    """Mutation that breaks it: an excitation named that does not reach five sigma either."""
    found, _ = planned()
    better = better_excitations(MASS, found, SEEN, SCALE)
    assert len(better.confusable) == len(found.confusable)
    for pair in better.confusable:
        assert (pair.better is None) == (pair.better_sigma is None)
        if pair.better_sigma is not None:
            assert pair.better in LIBRARY
            assert pair.better != "white_noise"
            assert pair.better_sigma >= SHOWN


def test_nearest_of_spans_the_phases_of_a_wave():
    """A wave of any phase is a sum of two; a friction of negative level is none.

    Mutation that breaks it: every signature on its own.
    """
    t = np.linspace(0.0, 20.0, 2000)
    wave = np.cos(t + 0.7)
    both = [np.cos(t), np.sin(t)]
    assert nearest_of(wave, both, "force_ripple@m1") < 1e-6 * np.linalg.norm(wave)
    assert nearest_of(wave, both, "coulomb_friction@m1") > 0.3 * np.linalg.norm(wave)
    assert nearest_of(wave, [-wave], "coulomb_friction@m1") == pytest.approx(np.linalg.norm(wave))


def test_the_command_writes_picture_scenario_and_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    """Mutation that breaks it: an encoder's noise taken as its whole step."""
    device = tmp_path / "mass.toml"
    device.write_text(device_to_text(MASS.with_interface(encoder_step=2e-5)), encoding="utf-8")
    out, result = tmp_path / "out", tmp_path / "plan.json"
    line = ["plan", "--device", str(device), "--seconds", "2", "--excitation", "chirp"]
    assert run([*line, "--out", str(out), "--json", str(result)]) == 0
    said = capsys.readouterr().out
    assert "Smallest visible magnitude (5 sigma)" in said
    values = json.loads(result.read_text(encoding="utf-8"))
    (one,) = values["plans"]
    assert one["excitation"] == "chirp"
    assert one["limits"]["coulomb_friction@m1"]["unit"] == "N m"
    assert values["noise"]["measurement"] == pytest.approx(2e-5 / 12.0**0.5)
    for path in values["files"]:
        assert Path(path).stat().st_size > 0
    again = ["plan", "--device", str(device), "--seconds", "2", "--excitation"]
    assert run([*again, str(out / "chirp.toml"), "--out", str(out / "again")]) == 0


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--seconds", "2"], "has no encoder_step, so its noise is not known; give --noise"),
        (["--noise", "1e-5", "--excitation", "chrip"], "did you mean 'chirp'"),
        (["--noise", "1e-5", "--excitation", "gone.toml"], "there is no file 'gone.toml'"),
        (["--noise", "1e-5", "--seconds", "0.01"], "it must be from 0.2 to 120 s"),
        (["--noise", "3", "--seconds", "2"], "give less than a tenth of the travel"),
    ],
)
def test_bad_input_is_one_sentence(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
):
    """Mutation that breaks it: no check of the length."""
    assert run(["plan", "--device", "phantom_1_0", *arguments]) == 2
    error = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error:")]
    assert len(error) == 1
    assert sentence in error[0]


def test_the_picture_draws_the_number_that_it_prints():
    """A friction of 0.11 mN m where the command is 0.22 N m is drawn, and written, at 0.05 %.

    Breaks where the value stands alone at an axis of shares.
    """
    physics = make_physics("coulomb_friction", "m1", level=1.1e-4)
    seen = Visible("coulomb_friction@m1", physics, 1.1e-4, "level", "N m", 0.22)
    assert limits_in_words([seen]) == "110 \u00b5N m"
    smaller = replace(seen, label="coulomb_friction@m2", magnitude=6e-5)
    assert limits_in_words([seen, smaller]) == "60 to 110 \u00b5N m"
    labels = (seen.label, "dead_band@command")
    shown = Plan("noise", 4.0, (seen,), labels, np.full((2, 2), 9.0), ())
    axes = plan_figure(shown, "device").axes[0]
    (dot,) = (line for line in axes.get_lines() if line.get_marker() == "o")
    assert float(np.asarray(dot.get_xdata())[0]) == pytest.approx(0.05)
    assert axes.get_xaxis().get_major_formatter()(0.05) == "0.05 %"


def test_no_text_of_the_picture_lies_on_another():
    """Over nine decades of shares. Mutation: a tick at each decade, "0.0001 %" on "0.001 %"."""
    physics = make_physics("coulomb_friction", "m1", level=1.1e-4)
    places = [f"{effect.name}@{at}" for effect in EFFECTS.values() for at in effect.places][:40]
    sizes = np.geomspace(1e-8, 0.1, len(places)).tolist()
    seen = tuple(Visible(label, physics, 0.22 * share, "level", "N m", 0.22)
                 for label, share in zip(places, sizes, strict=True))  # fmt: skip
    shown = Plan("noise", 4.0, seen, tuple(places), np.full((len(places), len(places)), 3.0), ())
    with chromium() as browser:
        assert faults_of_figure(browser.new_page(), plan_figure(shown, "device")) == []
