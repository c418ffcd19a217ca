"""Truths of the predictor: its gain, its innovations, what a refit absorbs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from tests.diagnosis_examples import OUTPUTS, phantom, record
from zwidth.diagnosis.fitting.uncertainty import inflation
from zwidth.diagnosis.intake.gate import examine
from zwidth.diagnosis.intake.hold import smooth, was_smooth
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import likeliest
from zwidth.diagnosis.noise.predictor import (
    SETTLING,
    Observer,
    innovations,
    observer_for,
    whitened,
)
from zwidth.diagnosis.noise.settle import refit
from zwidth.diagnosis.recording.experiment import (
    Experiment,
    ExperimentError,
    Output,
    experiment,
    stretches,
)
from zwidth.diagnosis.seeking.candidates import candidates
from zwidth.diagnosis.seeking.screen import Complement
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.trace import Trace

T = 0.001
UNITS = {"command": "N", "position_m1": "m", "position_m3": "m", "contact": ""}


def free_mass(rotary: bool = True) -> Device:
    return Device("mass", "", rotary, make_chain([0.5], [0.0]), Interface(period=T))


@pytest.mark.parametrize("ratio", [1e-4, 1.0])
def test_gain_of_a_free_mass_is_the_tracking_index_formula(ratio: float):
    """Kalata's closed form of the alpha-beta filter: with a force held over a tick of acceleration
    noise s_a and noise s_y, lambda = s_a T^2 / s_y, beta^2 = lambda^2 (1 - alpha). Ours corrects
    before it predicts, so x += alpha e, v += (beta / T) e.

    Mutation that breaks it: process noise through b[:, 0] scaled by T (gain a thousandth).
    """
    e = Experiment(T, np.zeros(300), np.zeros((300, 1)), OUTPUTS)
    gain = observer_for(free_mass(), e, ratio)
    index = np.sqrt(ratio)
    r = (4.0 + index - np.sqrt(8.0 * index + index**2)) / 4.0
    alpha = 1.0 - r**2
    beta = 2.0 * (2.0 - alpha) - 4.0 * np.sqrt(1.0 - alpha)
    assert gain[0, 0] == pytest.approx(alpha, rel=1e-4)
    assert gain[1, 0] * T == pytest.approx(beta, rel=1e-4)


def test_innovations_of_the_true_device_are_white():
    """With friction in the device too. Mutation that breaks it: friction left out of the device."""
    truth = phantom().with_physics(make_physics("coulomb_friction", "m1", level=2e-3))
    e = record(truth, 4.0, seed=3)
    observer = likeliest([e], Model(truth), np.zeros(Model(truth).linear_count)).observer
    white = observer.weigh(innovations(truth, e, observer.gain))[SETTLING:].ravel()
    n = white.size
    correlation = [float(white[k:] @ white[:-k]) / n for k in range(1, 20)]
    assert np.max(np.abs(correlation)) < 4.5 / np.sqrt(n)
    wrong = observer.weigh(innovations(phantom(), e, observer.gain))[SETTLING:].ravel()
    assert np.std(wrong) > 1.05


def test_what_the_refit_spans_is_projected_away():
    """A shift of any linear parameter leaves nothing; Coulomb friction leaves something.

    Mutation that breaks it: the projector keeps the first column only.
    """
    e = record(phantom(), 3.0, seed=4)
    problem, fitted = refit(phantom(), [e])
    off = Complement(fitted.jacobian)
    for column in fitted.jacobian.T:
        assert np.linalg.norm(off(column)) < 1e-6 * np.linalg.norm(column)
    model = fitted.model.with_effect(make_physics("coulomb_friction", "m1", level=1e-3), {})
    moved = problem.weighted(model, fitted.x) - fitted.white
    whole = np.concatenate([moved, np.zeros(fitted.residual.size - moved.size)])
    left = np.linalg.norm(off(whole)) / np.linalg.norm(whole)
    assert 0.02 < left < 0.9  # physics.md: a refit absorbs 55 to 98 % of Coulomb friction
    absorbed = fitted.jacobian @ off.absorbing(whole)
    np.testing.assert_allclose(off(whole), whole + absorbed, atol=1e-6 * np.abs(whole).max())


def test_filters_whiten_colour_and_leave_a_line():
    """Noise of colour 0.7 that an observer filtered; then the same with a strong line.

    Mutations that break it: an order of 8 or a memory of 4 (colour is left); no memory's end (the
    line goes).
    """
    random, n = np.random.default_rng(5), 20000
    coloured = lfilter([1.0, -1.6, 0.68], [1.0, -0.7], random.standard_normal(n))
    line = 2.0 * np.sin(0.2 * np.arange(n))
    plain = Observer(np.zeros((2, 1)), np.ones(1), 1.0)
    filtered = whitened(plain, [coloured[:, None]])
    white = filtered.weigh(coloured[:, None])[SETTLING:, 0]
    m = white.size
    found = [float(white[k:] @ white[: m - k]) / m for k in range(1, 41)]
    assert np.abs(found).max() < 4.0 / np.sqrt(m)
    beside = whitened(plain, [(coloured + line)[:, None]])
    left = beside.weigh(line[:, None])[SETTLING:, 0]
    assert 10.0 < np.linalg.norm(left) < 60.0


def test_no_gravity_pendulum_on_a_linear_device():
    """Mutation that breaks it: candidates that ignore rotary_only."""
    e = record(phantom(), 1.0)
    labels = {s.label for s in candidates(free_mass(rotary=False), [e])}
    assert "gravity_pendulum@m1" not in labels
    assert "coulomb_friction@m1" in labels
    assert "gravity_pendulum@m1" in {s.label for s in candidates(free_mass(), [e])}


def test_a_white_residual_is_not_inflated_and_a_coloured_one_is():
    """Mutation that breaks it: the spectrum's mean in place of its maximum."""
    white = np.random.default_rng(1).standard_normal(20_000)
    coloured = np.convolve(white, np.ones(4) / 2.0, "same")
    assert inflation(white) < 1.15
    assert inflation(coloured) == pytest.approx(4.0, rel=0.25)


def test_smooth_command_is_told_from_a_held_one():
    """A mass under u(t) = sin(w t), sampled; its motion in closed form.

    Mutation that breaks it: exp(-i pi f T), which delays instead.
    """
    device = Device("m", "", True, make_chain([1.0], [2.0], 400.0), Interface(period=0.01))
    t = 0.01 * np.arange(4000)
    u, y = np.zeros(t.size), np.zeros(t.size)
    random = np.random.default_rng(5)
    for hertz in np.arange(0.5, 20.0, 0.5):
        w, phase = 2.0 * np.pi * hertz, random.uniform(0.0, 6.28)
        wave: NDArray[np.complex128] = np.exp(1j * (w * t + phase))
        u += np.real(wave)
        y += np.real(wave / (400.0 - w**2 + 2j * w))
    y += 1e-6 * random.standard_normal(t.size)
    e = Experiment(0.01, u, y[:, None], OUTPUTS)
    factor = was_smooth(device, e)
    assert factor is not None
    assert factor > 2.0
    assert was_smooth(device, smooth(e)) is None


def test_recordings_that_cannot_be_diagnosed_say_why():
    """Mutations that break it: no check of the period; none of the unit."""
    t = T * np.arange(500)
    wave = np.sin(40.0 * t)
    good = {"command": wave, "position_m1": wave**2}
    gap = np.where(t > 0.3, np.nan, t)
    cases: dict[str, tuple[Any, dict[str, Any]]] = {
        "constant at 2": (t, good | {"position_m1": 0.0 * t + 2.0}),
        "not finite": (t, good | {"position_m1": gap}),
        "at least 200": (t[:3], {k: v[:3] for k, v in good.items()}),
        "period is 0.002": (2.0 * t, good),
        "no position or velocity": (t, {"command": wave, "contact": wave}),
    }
    for words, (times, channels) in cases.items():
        with pytest.raises(ExperimentError, match=words):
            experiment(trace(times, channels), free_mass(rotary=False))
    with pytest.raises(ExperimentError, match="'m', but the device is rotary"):
        experiment(trace(t, good), free_mass())
    seen = experiment(trace(t, good), free_mass(rotary=False))
    assert seen.outputs == (Output("position", 0),)


def test_a_recording_is_cut_where_its_clock_jumps():
    """Samples lost, and a clock set back; not stamps that bunch up, nor ones that are rounded.

    Mutations that break it: no cut; every long interval cut; a short stretch kept.
    """
    t = T * np.arange(2000)
    wave = np.sin(40.0 * t)
    device = free_mass(rotary=False)

    def cut(times: Any, kept: Any = slice(None)) -> list[Experiment]:
        channels = {"command": wave[kept], "position_m1": wave[kept] ** 2}
        return stretches(trace(times[kept], channels), device, "r")

    lost = np.delete(np.arange(2000), [*range(600, 615), *range(1500, 1511)])
    parts = cut(t, lost)
    assert [e.ticks for e in parts] == [600, 885, 489]
    assert [e.begins for e in parts] == pytest.approx([0.0, 0.615, 1.511])
    assert "jumps 2 times, first by 0.016 s after 0.599 s" in parts[0].notes[0]
    assert parts[1].notes == ()  # said once
    np.testing.assert_array_equal(parts[1].command, wave[615:1500])
    back = cut(np.where(t < 0.1, t, t - 1.0))
    assert [e.ticks for e in back] == [1900]
    assert "100 samples" in back[0].notes[0]
    assert "-0.999 s" in back[0].notes[0]
    bunched = t.copy()
    bunched[700] += 0.9 * T  # late, and the next one in time
    for even in (bunched, np.round(t, 3), t):
        whole = cut(even)
        assert [e.ticks for e in whole] == [2000]
        assert whole[0].notes == ()
    gone = np.concatenate([np.arange(k, k + 11) for k in range(80, 2000, 100)])
    with pytest.raises(ExperimentError, match="jumps 20 times"):
        cut(t, np.delete(np.arange(2000), gone))
    with pytest.raises(ExperimentError, match="jumps"):
        cut(t + np.floor(np.arange(2000) / 150))


def test_what_a_log_lacks_and_a_device_has_not_is_said():
    """Mutations that break it: a log without noise; a channel left out in silence."""
    t = T * np.arange(500)
    wave = np.sin(40.0 * t)
    channels = {"command": wave, "position_m1": wave**2, "position_m3": wave**2}
    known = trace(t, channels)
    device = free_mass(rotary=False)
    seen = experiment(known, device, "r")
    assert seen.outputs == (Output("position", 0),)
    assert "position_m3" in seen.notes[0]
    log = experiment(replace(known, origin="simulated"), device, "r")
    noise = log.measured[:, 0] - wave**2
    assert np.std(noise) == pytest.approx(1e-5 * log.swing, rel=0.1)
    assert "no measurement noise" in log.notes[0]
    said = [f.sentence for f in examine(device, [log])]
    assert log.notes[0] in said


def trace(t: Any, channels: dict[str, Any]) -> Trace:
    return Trace(t, channels, {name: UNITS[name] for name in channels}, "recorded")
