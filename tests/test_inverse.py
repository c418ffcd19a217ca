"""The inverse model: the force that a recorded motion needs, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.inverse import acts, as_read, band_of, lacks, low_passed, motion
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.drive_force import Pushed
from zwidth.diagnosis.recording.experiment import Covariate, Experiment, Output
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate

PERIOD, SECONDS, BAND = 0.001, 4.0, 40.0
EDGE = 100  # ticks
TWO = Device(
    "carts", "", False, make_chain([0.8, 0.4], [3.0, 2.0], 0.0, [500.0], [0.5]),
    Interface(period=PERIOD, delay=0.0),
)  # fmt: skip
ONE = Device("cart", "", False, make_chain([0.8], [3.0], 0.0, [], []), TWO.interface)


def ran(device: Device, quantity: str = "position") -> Experiment:
    """Two sines of force on a device, read without noise."""
    t = PERIOD * np.arange(round(SECONDS / PERIOD))
    command = 5.0 * np.sin(2.0 * np.pi * 1.3 * t) + 3.0 * np.sin(2.0 * np.pi * 4.1 * t + 1.0)
    run = simulate(device, recorded(command), duration=SECONDS, substeps=20)
    outputs = tuple(Output(quantity, i) for i in range(device.chain.masses.size))
    measured = np.column_stack([run.trace[o.name] for o in outputs])
    return Experiment(PERIOD, command, measured, outputs, "r", float(measured[:, 0].std()))


def missing(known: Device, e: Experiment) -> np.ndarray:
    model = Model(known)
    x = np.zeros(len(model.parameters))
    return lacks(model, x, e, BAND)[EDGE:-EDGE]


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("device", [ONE, TWO])
@pytest.mark.parametrize("quantity", ["position", "velocity"])
def test_a_device_lacks_nothing_for_its_own_motion(device: Device, quantity: str) -> None:
    """5.8 N commanded. Mutations: a reading's tick compared with the one before; m1 / T for G."""
    assert rms(missing(device, ran(device, quantity))) < 2e-3


def test_what_was_split_is_joined_again() -> None:
    """All that has a value at each sample. Mutation: any one of the fields left out of `joined`."""
    e, rng = ran(ONE), np.random.default_rng(0)
    n = e.ticks
    beside = {name: rng.standard_normal(n) for name in ("sensor_error", "base", "strengths")}
    e = replace(
        e, **beside, dropped=rng.random(n) > 0.9, force=rng.standard_normal((n, 1)),
        pushes=rng.standard_normal((n, 1)), pushed=Pushed(rng.standard_normal(n), 10.0),
        covariates=(Covariate("temperature", "degC", rng.standard_normal(n)),), begins=2.0,
    )  # fmt: skip
    first, rest = e.split()
    again = rest.joined()
    assert 0 < first.ticks < n
    assert again.begins == 2.0
    assert again.before is None
    for name in ("command", "measured", "dropped", "force", "pushes", *beside):
        assert np.array_equal(getattr(again, name), getattr(e, name)), name
    assert again.pushed is not None
    assert e.pushed is not None
    assert np.array_equal(again.pushed.at_zero, e.pushed.at_zero)
    assert np.array_equal(again.covariates[0].values, e.covariates[0].values)


def test_what_a_mass_lacks_is_the_force_on_it() -> None:
    """Half again of m1 and twice the damper of m2: -0.4 a_1 and -2 v_2.

    Mutation: the recorded velocity taken from the simulated one.
    """
    truth = TWO.with_chain(make_chain([1.2, 0.4], [3.0, 4.0], 0.0, [500.0], [0.5]))
    e = ran(truth)
    x, v = motion(e, 2, 2.0 * BAND)
    middle = 0.5 * (v[1:] + v[:-1])
    expected = -np.column_stack([0.4 * np.diff(v[:, 0]) / PERIOD, 2.0 * middle[:, 1]])
    expected = expected[EDGE : 1 - EDGE]
    off = missing(TWO, e) - expected
    assert rms(off[:, 0]) < 2e-3 * rms(expected[:, 0])
    assert rms(off[:, 1]) < 5e-3 * rms(expected[:, 1])
    assert x.shape == v.shape


def test_friction_is_lacking_as_it_was_and_not_where_it_is_known() -> None:
    """Coulomb friction of 1 N against the velocity; its jumps lie beyond the band.

    Mutation: internal states and sign begun anew each tick (friction known leaves its own size).
    """
    rubs = make_physics("coulomb_friction", "m1", level=1.0)
    truth = ONE.with_physics(rubs)
    e = ran(truth)
    found = missing(ONE, e)[:, 0]
    turning = np.abs(motion(e, 1, 2.0 * BAND)[1][EDGE:-EDGE, 0]) < 0.1
    assert np.abs(np.abs(found[~turning]) - 1.0).max() < 0.15
    assert rms(missing(truth, e)) < 0.1


def test_the_band_ends_where_noise_would_be_a_force() -> None:
    """Noise of one percent at the end of the band. Mutation: fourth differences over 20 for 70."""
    e = ran(ONE)
    noise = 1e-6 * np.random.default_rng(0).standard_normal(e.measured.shape)
    band = band_of(ONE, replace(e, measured=e.measured + noise))
    assert band is not None
    loud = 1e-6 * np.random.default_rng(1).standard_normal(e.measured.shape)
    heard = replace(e, measured=e.measured + loud)
    model = Model(ONE)
    x = np.zeros(len(model.parameters))
    force = lacks(model, x, heard, band)[EDGE:-EDGE]
    assert rms(force) == pytest.approx(0.01 * rms(e.command), rel=0.3)


def test_no_force_is_told_where_motion_or_command_is_missing() -> None:
    """Mutation: any output taken for that of its mass."""
    e = ran(TWO)
    assert band_of(TWO, e) is not None
    assert band_of(TWO, replace(e, measured=e.measured[:, :1], outputs=e.outputs[:1])) is None
    assert band_of(TWO, replace(e, command=np.zeros(e.ticks))) is None
    assert band_of(TWO, replace(e, folded=True)) is None
    noisy = e.measured + 0.1 * np.random.default_rng(0).standard_normal(e.measured.shape)
    assert band_of(TWO, replace(e, measured=noisy)) is None


def test_the_force_that_acts_is_the_command_as_the_drive_lets_it_arrive() -> None:
    """Late by two ticks and cut at 2 N; friction has no part in it.

    Mutation: the command as recorded.
    """
    e = ran(ONE)
    rubs = make_physics("coulomb_friction", "m1", level=1.0)
    cut = make_physics("saturation", "command", limit=2.0)
    model = Model(ONE.with_interface(delay=2 * PERIOD).with_physics(cut, rubs))
    x = np.zeros(len(model.parameters))
    expected = low_passed(np.clip(np.roll(e.command, 2), -2.0, 2.0), BAND, PERIOD)
    np.testing.assert_allclose(acts(model, x, e, BAND)[EDGE:-EDGE], expected[EDGE:-EDGE], atol=1e-3)


def test_a_motion_that_was_filtered_asks_for_a_force_that_is_filtered_alike() -> None:
    """L (F q) = F (L q). Mutation: the force that acts left as it is (12 % and more)."""
    t = 1e-3 * np.arange(3000)
    force = np.sin(2.0 * np.pi * 5.0 * t)
    e = Experiment(1e-3, force, np.zeros((3000, 1)), (Output("velocity", 0),))
    device = Device("m", "", True, make_chain([1e-3], [1e-3]), Interface(period=1e-3))
    for name, values in (
        ("sensor_lag", {"time_constant": 0.01}),
        ("sensor_filter", {"time_constant": 0.01, "damping": 0.7}),
    ):
        s = 1j * 2.0 * np.pi * 5.0 * 0.01
        gain = 1.0 / (1.0 + s) if name == "sensor_lag" else 1.0 / (1.0 + 1.4 * s + s * s)
        filtered = as_read(device.with_physics(make_physics(name, "sensor", **values)), e, force)
        expected = (gain * np.exp(2j * np.pi * 5.0 * t)).imag
        assert np.abs(filtered - expected)[500:].max() < 1e-3
        there = device.with_physics(make_physics(name, "velocity", **values))
        np.testing.assert_array_equal(as_read(there, e, force), filtered)
