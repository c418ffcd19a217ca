"""Three recordings of real devices, read through their TOMLs, against what is published of them."""

from pathlib import Path

import numpy as np
import pytest

from zwidth.logs.recording import read_recording
from zwidth.logs.steps import step_seen
from zwidth.sim.trace import Trace

TOMLS = Path(__file__).parent / "recordings"
SHARED = Path(__file__).parents[1].parent / "shared" / "recordings"


def recording(name: str) -> Trace:
    if not (SHARED / name).is_dir():
        pytest.skip(
            f"the recording {name} is not ours to distribute, and is not beside the project"
        )
    return read_recording(TOMLS / f"{name}.toml", SHARED / name)


def timing(trace: Trace) -> dict[str, float]:
    (found,) = trace.facts["timing"].values()  # pyright: ignore[reportAttributeAccessIssue]
    return found


def test_emps() -> None:
    """Mutation that breaks it: scale 35 N/V (force up to 151.4 N)."""
    trace = recording("emps")
    assert len(trace) == 24_841
    assert timing(trace)["period_s"] == pytest.approx(0.001, rel=1e-6)
    assert dict(trace.units) == {"command": "N", "position_m1": "m"}
    assert step_seen(trace["position_m1"]) == pytest.approx(5e-8, rel=1e-9)
    assert np.abs(trace["command"]).max() == pytest.approx(4.32566 * 35.150652, rel=1e-5)
    assert np.abs(trace["command"]).max() < 10.0 * 35.150652  # the limit of the amplifier
    assert np.ptp(trace["position_m1"]) == pytest.approx(0.2464, abs=1e-4)
    assert trace.facts["warnings"] == []


def test_emps_obeys_its_published_model() -> None:
    """Force against M a + Fv v + Fc sign(v) + offset where it moves; 4.04 % is published, with
    better filters. Mutations that break it: a wrong sign, or a scale off by 15 %.
    """
    trace = recording("emps")
    h, q = 0.001, trace["position_m1"]
    n = 20  # a difference over 2 n samples, far below the motion's own time scale
    v = (q[2 * n :] - q[: -2 * n]) / (2 * n * h)
    a = (q[2 * n :] - 2.0 * q[n:-n] + q[: -2 * n]) / (n * h) ** 2
    force = trace["command"][n:-n]
    model = 95.1089 * a + 203.5034 * v + 20.3935 * np.sign(v) - 3.1648
    moving = np.abs(v) > 0.01
    error = np.linalg.norm((force - model)[moving]) / np.linalg.norm(force[moving])
    assert error < 0.12


def test_silverbox() -> None:
    """It resonates where the linear fit does, at 68.3 Hz. Mutation: 1 / 500 s as the period."""
    trace = recording("silverbox")
    assert len(trace) == 90_422
    assert 1.0 / timing(trace)["period_s"] == pytest.approx(610.35, abs=0.005)
    from scipy.signal import csd, welch

    rate = 1.0 / timing(trace)["period_s"]
    u, y = trace["command"], trace["position_m1"]
    frequency, cross = csd(u, y, rate, nperseg=4096)
    response = np.abs(cross / welch(u, rate, nperseg=4096)[1])
    band = (frequency > 20.0) & (frequency < 150.0)
    peak = frequency[band][np.argmax(response[band])]
    # The spring hardens, so at the multisine's amplitude the peak lies a little above 68.3 Hz.
    assert 66.0 < peak < 73.0


def test_ethz_haptic_paddle() -> None:
    """Mutation that breaks it: 2.5 V not taken off (an offset of 1.0 N m)."""
    trace = recording("ethz_haptic_paddle")
    assert timing(trace)["period_s"] == pytest.approx(0.005, rel=1e-9)
    assert trace.t[-1] == pytest.approx(74.13)
    assert dict(trace.units) == {"command": "N m", "position_m1": "rad"}
    assert np.abs(trace["command"]).max() == pytest.approx(0.04 * 0.427 * 0.938, rel=1e-3)
    assert abs(trace["command"].mean()) < 1e-4
    spectrum = np.abs(np.fft.rfft(trace["command"]))
    frequency = np.fft.rfftfreq(len(trace), 0.005)
    assert frequency[np.argmax(spectrum)] == pytest.approx(0.5, abs=0.01)


def test_the_paddle_sticks_at_first_and_moves_later() -> None:
    """Up to 0.008 N m it stays within 0.05 deg, from 0.010 on it swings 40 times as far or more.

    Mutation that breaks it: columns exchanged, which gives motion in proportion to torque.
    """
    trace = recording("ethz_haptic_paddle")
    whole = len(trace) // 400 * 400  # two seconds, one period of the sinusoid
    torque = np.abs(trace["command"][:whole]).reshape(-1, 400).max(axis=1)
    motion = np.degrees(np.ptp(trace["position_m1"][:whole].reshape(-1, 400), axis=1))
    at_rest, moving = motion[torque < 0.0085], motion[torque > 0.010]
    assert at_rest.max() < 0.05
    assert moving.min() > 40.0 * at_rest.max()
