"""Estimators of velocity: by their definitions, by closed forms, in linear theory and in files."""

import math
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from engine_examples import Floats, one_mass, phantom
from estimator_examples import SET, STEP, by_foaw, by_kalman, by_levant, kalman_gain
from lane_examples import RUNS, assert_equal_runs
from scipy.signal import lfilter

from zwidth.controllers.wall import wall
from zwidth.scenarios.logged_run import logged_run
from zwidth.scenarios.replay import replay
from zwidth.scenarios.scenario import Scenario
from zwidth.sim.device import Device
from zwidth.sim.device_file import device_from_text, device_to_text
from zwidth.sim.estimators import ESTIMATORS, Settings
from zwidth.sim.estimators.kalman import kalman
from zwidth.sim.estimators.kalman_acceleration import kalman_acceleration
from zwidth.sim.group import member
from zwidth.sim.interface import Interface
from zwidth.sim.loop import open_loop
from zwidth.sim.run import Run, Start, simulate
from zwidth.stability.bisection import Search, find_brackets
from zwidth.stability.branches import critical_mode, damping_locus
from zwidth.stability.decomposition import curve
from zwidth.stability.judging import Trial
from zwidth.stability.linear import boundary, critical_stiffness, last_stable_damping
from zwidth.stability.passivity import passive_boundary
from zwidth.stability.periodic import periodic_boundary, periodic_loop
from zwidth.stability.velocity import velocity_response

T = 1e-3
SPEED = 0.0471  # rad/s, of no whole counts per period
NOT_LINEAR = ("foaw", "foaw_end", "levant")
LINEAR = ("kalman", "kalman_acceleration")
NO_FILTER = {"velocity_cutoff_hz": math.inf, "velocity_order": 1}


def alone(name: str, **others: float) -> Device:
    """The PHANToM with an estimator and no low-pass behind it."""
    return phantom().with_interface(**SET[name] | NO_FILTER | others)


def moving(name: str, **others: float) -> Run:
    return simulate(alone(name, **others), wall(12.0, 0.02), duration=0.4, start=Start(3e-3, SPEED))


def level(speed: float, acceleration: float, name: str, **face: float) -> tuple[Run, Floats]:
    """A mass that nothing touches but a constant force, from a speed on; and its velocity."""
    device = one_mass(1.0, 0.0).with_interface(**SET[name] | NO_FILTER | {"delay": 0.0} | face)
    ticks = 400
    forces = np.full((ticks, 1), acceleration)
    run = simulate(
        device, wall(0.0, 0.0), duration=ticks * device.interface.period,
        start=Start(0.0, speed), disturbance=forces,
    )  # fmt: skip
    return run, run.trace["velocity_m1"]


@pytest.mark.parametrize("name", ["foaw", "foaw_end"])
@pytest.mark.parametrize("ticks", [1, 3])
def test_foaw_is_its_definition(name: str, ticks: int) -> None:
    """Counts as fractions, every line against every reading: 1e-9 of the largest velocity.

    Mutations: the window one reading shorter; the last reading's band left out; ties outside.
    """
    device = alone(name, velocity_ticks=ticks)
    face = device.interface
    run = moving(name, velocity_ticks=ticks)
    counts = [round(y / STEP) for y in run.trace["encoder"][::ticks].tolist()]
    window = int(face.velocity_window)
    back = [round((3e-3 - SPEED * n * ticks * T) / STEP) for n in range(window, 0, -1)]
    band = Fraction(face.velocity_band / STEP).limit_denominator(100)
    truth = by_foaw(back + counts, window, band, name == "foaw")
    found = run.trace["velocity_estimate"][::ticks]
    expected = np.array([float(b) for b in truth]) * STEP / (ticks * T)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()
    assert len({round(b, 12) for b in expected}) > 20  # windows of all lengths were at work


def test_levant_is_its_definition() -> None:
    """1e-9. Mutations: sqrt(L) times 1.1; z0 moved by the z1 of after; sign(0) = 1."""
    run = moving("levant")
    truth = by_levant(run.trace["encoder"], 30.0, T, SPEED)
    found = run.trace["velocity_estimate"]
    assert np.abs(found - truth).max() < 1e-9 * np.abs(truth).max()


@pytest.mark.parametrize("name", LINEAR)
@pytest.mark.parametrize("ticks", [1, 4])
def test_kalman_is_prediction_and_correction(name: str, ticks: int) -> None:
    """By the Riccati equation of scipy, 1e-7. Mutations: beta for gamma; half a missing."""
    face = alone(name, velocity_ticks=ticks).interface
    run = moving(name, velocity_ticks=ticks)
    y, h = run.trace["encoder"][::ticks], ticks * T
    order = 2 if name == "kalman" else 3
    gain = kalman_gain(h, order, face.velocity_noise, face.velocity_acceleration)
    before = STEP * round((3e-3 - SPEED * h) / STEP)
    truth = by_kalman(y, gain, h, [before, SPEED, 0.0][:order])
    found = run.trace["velocity_estimate"][::ticks]
    assert np.abs(found - truth).max() < 1e-7 * np.abs(truth).max()


@pytest.mark.parametrize("index", [1e-8, 1e-4, 0.01, 1.0, 40.0])
def test_kalman_gains_are_those_of_the_riccati_equation(index: float) -> None:
    """1e-5, what scipy has. Mutations: alpha = 1 - s; gamma = beta^2 / alpha (Kalata's other)."""
    settings = Settings(T, 0, 0.0, 1e-5, index * 1e-5 / T**2)
    for estimator, order in ((kalman, 2), (kalman_acceleration, 3)):
        gain = kalman_gain(T, order, settings.noise, settings.acceleration)
        scaled = gain * T ** np.arange(order)
        assert estimator.numbers(settings) == pytest.approx(scaled.tolist(), rel=1e-5)


@pytest.mark.parametrize("name", SET)
def test_a_constant_velocity_is_estimated_exactly(name: str) -> None:
    """Without an encoder, from the first reading on, 1e-9. Mutation: `begin` with read(0) for 1."""
    run, truth = level(0.3, 0.0, name, encoder_step=0.0)
    assert np.abs(run.trace["velocity_estimate"] - truth).max() < 1e-9


def test_an_encoder_costs_foaw_a_step_over_its_window() -> None:
    """D / (N h) in place of D / h, and no more. Mutation: a band of half a step (twice as much)."""
    for name in ("foaw", "foaw_end"):
        run, truth = level(0.2137, 0.0, name, velocity_band=STEP)
        window = SET[name]["velocity_window"]
        error = np.abs(run.trace["velocity_estimate"] - truth)[window:]
        assert error.max() <= STEP / (window * T)
        assert error.max() > 0.2 * STEP / (window * T)
    plain = STEP / T
    assert np.abs(np.diff(run.trace["encoder"]) / T - 0.2137).max() > 0.5 * plain


@pytest.mark.parametrize("acceleration", [-2.0, 7.0])
def test_kalman_lags_an_acceleration_as_its_gains_say(acceleration: float) -> None:
    """(alpha/beta - 1/2) h a in the steady state, and none with the acceleration in the model."""
    run, truth = level(0.0, acceleration, "kalman", encoder_step=0.0)
    alpha, beta = kalman.numbers(Settings(T, 0, 0.0, 6e-6, 12.0))
    lag = (truth - run.trace["velocity_estimate"])[-20:]
    assert lag == pytest.approx(acceleration * T * (alpha / beta - 0.5), rel=1e-6)
    run, truth = level(0.0, acceleration, "kalman_acceleration", encoder_step=0.0)
    assert np.abs(truth - run.trace["velocity_estimate"])[-20:].max() < 1e-6 * abs(acceleration) * T


def test_levant_errs_by_its_bound_times_the_period() -> None:
    """A constant acceleration below L: within 3 L h once it follows, and in proportion to h.

    Mutation: h left out of `by_sign` (it never follows).
    """
    errors: list[float] = []
    for period in (1e-3, 2.5e-4):
        run, truth = level(0.0, 20.0, "levant", encoder_step=0.0, period=period)
        errors.append(float(np.abs(truth - run.trace["velocity_estimate"])[-100:].max()))
    assert errors[0] < 3.0 * 30.0 * 1e-3
    assert errors[1] / errors[0] == pytest.approx(0.25, rel=0.1)


def test_levant_falls_behind_beyond_its_bound() -> None:
    """An acceleration of 100 against 1.1 L = 33: it loses 67 a second. Mutation: L for 1.1 L."""
    run, truth = level(0.0, 100.0, "levant", encoder_step=0.0)
    lost = (truth - run.trace["velocity_estimate"])[-1]
    assert lost == pytest.approx((100.0 - 33.0) * 0.4, rel=0.02)


@pytest.mark.parametrize("name", SET)
def test_the_low_pass_stands_behind_the_estimator(name: str) -> None:
    """scipy's filter of the bare estimate, 1e-12 at one wall. Mutation: the filter left out."""
    bare, smooth = (
        simulate(alone(name, velocity_cutoff_hz=c), wall(0.0, 0.0), duration=0.3, start=start)
        for c, start in ((math.inf, Start(0.0, 0.05)), (70.0, Start(0.0, 0.05)))
    )
    a = alone(name, velocity_cutoff_hz=70.0).interface.velocity_smoothing
    v = bare.trace["velocity_estimate"]
    truth = lfilter([a], [1.0, a - 1.0], v, zi=[0.05 * (1.0 - a)])[0]
    assert np.abs(smooth.trace["velocity_estimate"] - truth).max() < 1e-12


@pytest.mark.parametrize("name", SET)
def test_lanes_with_numbers_of_their_own_equal_each_alone(name: str) -> None:
    """To the bit, memory included. Mutations: one band for all lanes; a lane's window left open."""
    rng = np.random.default_rng(5)
    devices: list[Device] = []
    for _ in range(RUNS):
        device = phantom().with_interface(**SET[name])
        changed = {
            key: value * rng.uniform(0.6, 1.6)
            for key, value in SET[name].items()
            if key in ("velocity_band", "velocity_noise", "velocity_acceleration")
        }
        devices.append(device.with_interface(**changed))
    assert_equal_runs(devices, 1, range(RUNS))


@pytest.mark.parametrize("name", SET)
def test_a_log_replays_to_the_bit(name: str, tmp_path: Path) -> None:
    """Mutation: the memory of the estimator not written with the start."""
    device = phantom().with_interface(**SET[name])
    path = tmp_path / "run.mcap"
    logged_run(Scenario(device, wall(9.0, 0.02), 0.3, Start(2e-3, 0.1)), path)
    assert replay(path).identical


@pytest.mark.parametrize("name", SET)
def test_a_device_file_holds_it(name: str) -> None:
    """Round trip; a device without it has the text that it had."""
    device = phantom().with_interface(**SET[name])
    assert device_from_text(device_to_text(device)).interface == device.interface
    assert "velocity_estimator" not in device_to_text(phantom())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"velocity_estimator": "kalmann"}, "did you mean 'kalman'"),
        (
            {"velocity_noise": 0.0},
            "velocity_noise is 0.0; with velocity_estimator 'kalman' it must be",
        ),
        ({"velocity_acceleration": math.inf}, "velocity_acceleration is inf"),
        (
            {"velocity_window": 8},
            "velocity_window is 8; with velocity_estimator 'kalman' it must be",
        ),
        ({"velocity_estimator": "foaw", "velocity_window": 2.5}, "a whole number from 2 to 64"),
        ({"velocity_estimator": "difference"}, "velocity_noise is 6e-06"),
    ],
)
def test_what_it_is_not_set_to_is_said(change: dict[str, float], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        replace(Interface(**SET["kalman"]), **change)  # pyright: ignore[reportArgumentType]


def exact(name: str, **others: float) -> Device:
    """A device that is linear but for nothing: no encoder."""
    return phantom().with_interface(**SET[name] | {"encoder_step": 0.0} | others)


@pytest.mark.parametrize("name", LINEAR)
@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_loop_is_the_run(name: str, order: int) -> None:
    """The one-tick matrix against the kernel over 300 ticks, 1e-9.

    Mutations: the last estimate in the command; `rest` of zeros; the filter's slope of y alone.
    """
    cutoff = {"velocity_cutoff_hz": 60.0 if order else math.inf, "velocity_order": max(order, 1)}
    device = exact(name, **cutoff)
    run = simulate(device, wall(9.0, 0.03), duration=0.3, start=Start(1e-3))
    loop = open_loop(device)
    state, closed = 1e-3 * loop.shift, loop.closed(9.0, 0.03)
    found: list[float] = []
    for _ in range(300):
        found.append(float(loop.reading @ state))
        state = closed @ state
    truth = run.trace["position_m1"]
    assert np.abs(np.array(found) - truth).max() < 1e-9 * np.abs(truth).max()


@pytest.mark.parametrize("name", ["difference", *LINEAR])
def test_the_response_is_that_of_the_equations(name: str) -> None:
    """h v / y by the matrices and by the closed form, 1e-9, and a slope of 1 at z = 1."""
    settings = Settings(T, 0, 0.0, 6e-6, 12.0)
    estimator = ESTIMATORS[name]
    assert estimator.linear is not None
    assert estimator.response is not None
    keep, take, out, through, rest = estimator.linear(settings)
    z = np.exp(1j * np.linspace(0.05, np.pi, 40))
    whole = [out @ np.linalg.solve(one * np.eye(rest.size) - keep, take) + through for one in z]
    closed = estimator.response(settings, z) * (1.0 - 1.0 / z)
    assert np.abs(np.array(whole) - closed).max() < 1e-9
    assert keep @ rest + take == pytest.approx(rest)
    assert out @ rest + through == pytest.approx(0.0, abs=1e-12)
    assert estimator.response(settings, np.ones(1, np.complex128)) == pytest.approx(1.0)


@pytest.mark.parametrize("name", LINEAR)
def test_a_cycle_of_one_tick_is_the_loop(name: str) -> None:
    """1e-9 in modulus; all at n ticks of T / n, K_CR is that at T. Mutation: `take` left out."""
    device = exact(name, delay=0.002)
    one = np.sort(np.abs(np.linalg.eigvals(open_loop(device).closed(4.0, 0.02))))
    other = np.sort(np.abs(np.linalg.eigvals(periodic_loop(device).closed(4.0, 0.02))))
    assert other[-one.size :] == pytest.approx(one, abs=1e-9)
    slow = device.with_interface(period=T / 4, velocity_ticks=4, position_ticks=4)
    (found,) = periodic_boundary(slow, [0.02])
    assert found.stiffness == pytest.approx(critical_stiffness(device, 0.02).stiffness, rel=1e-9)


@pytest.mark.parametrize("name", LINEAR)
def test_theory_agrees_with_itself(name: str) -> None:
    """The closed form at each ultimate frequency gives K_CR and B, 1e-7; modes have names."""
    device = exact(name, delay=0.002)
    last = last_stable_damping(device)
    assert last is not None
    for point in boundary(device, [0.2 * last, 0.5 * last, 0.9 * last]):
        assert point.stiffness is not None
        assert point.frequency_hz is not None
        found = curve(device, point.frequency_hz)
        assert float(found.damping) == pytest.approx(point.damping, rel=1e-7)
        assert float(found.stiffness) == pytest.approx(point.stiffness, rel=1e-7)
    assert critical_mode(device, boundary(device, [0.2 * last])[0]) is not None
    names = damping_locus(device, [0.0, 0.01]).names
    assert names.count("velocity filter") == len(names) - 6 - names.count("delay") > 1


@pytest.mark.parametrize("name", LINEAR)
def test_brackets_close_on_the_theory(name: str) -> None:
    """0.2 % at three dampings. Mutation: the period of the estimator left at one tick."""
    device = exact(name, delay=0.001)
    last = last_stable_damping(device)
    assert last is not None
    dampings = np.array([0.0, 0.3, 0.8]) * last
    for point, bracket in zip(
        boundary(device, dampings.tolist()), find_brackets([device], [dampings])[0], strict=True
    ):
        assert point.stiffness is not None
        assert bracket.stable is not None
        assert bracket.unstable is not None
        assert bracket.stable < point.stiffness * 1.002
        assert bracket.unstable > point.stiffness * 0.998


@pytest.mark.parametrize("name", LINEAR)
def test_the_passive_wall_knows_the_estimator(name: str) -> None:
    """Colgate and Schenkel's b = max of T/2 Re((1 - e^-jwT) H) / (1 - cos wT), by the matrices.

    1e-6. Mutation: the response of the estimator left out of `filter_response`.
    """
    device = exact(name, delay=0.0)
    face, damping = device.interface, 0.004
    own = passive_boundary(device, [damping])[0].stiffness
    assert own is not None
    linear = face.estimator.linear
    assert linear is not None
    keep, take, out, through, rest = linear(face.estimator_settings)
    angle = np.linspace(0.01, np.pi, 20001)
    z = np.exp(1j * angle)
    held = np.linalg.solve(
        z[:, None, None] * np.eye(rest.size) - keep, take[None, :, None].astype(np.complex128)
    )
    bare = (held[:, :, 0] @ out + through) / T
    smooth = 1.0
    if math.isfinite(face.velocity_cutoff_hz):
        a, b, c, d = face.velocity_filter
        turn = np.array([[1.0 - a, b], [-c, d]])  # of v, r
        entry = np.array([a, c], np.complex128)[None, :, None]
        smooth = z * np.linalg.solve(z[:, None, None] * np.eye(2) - turn, entry)[:, 0, 0]
    law = own + damping * smooth * bare
    needed = 0.5 * T / (1.0 - np.cos(angle)) * ((1.0 - 1.0 / z) * law).real
    assert needed.max() == pytest.approx(float(device.chain.ground_dampers.sum()), rel=1e-6)


@pytest.mark.parametrize("name", NOT_LINEAR)
def test_linear_theory_refuses_what_is_not_linear(name: str) -> None:
    device = exact(name)
    assert not device.interface.linear
    for refuse in (
        open_loop,
        periodic_loop,
        lambda d: passive_boundary(d, [0.0]),
        lambda d: velocity_response(d.interface, np.ones(1, np.complex128)),
    ):
        with pytest.raises(ValueError, match=f"velocity_estimator is '{name}'"):
            refuse(device)


@pytest.mark.parametrize("name", NOT_LINEAR)
def test_foaw_and_levant_have_boundaries_in_the_time_domain(name: str) -> None:
    """At B = 0 that of the difference by theory, since no velocity enters, 1 %."""
    device = phantom().with_interface(**SET[name])
    plain = critical_stiffness(phantom().with_interface(delay=0.0013), 0.0).stiffness
    assert plain is not None
    (bracket,) = find_brackets(
        [device], [np.zeros(1)], Trial(start=0.05, limit_s=32.0), Search(tolerance=0.005)
    )[0]
    assert bracket.stable is not None
    assert bracket.stable == pytest.approx(plain, rel=0.01)


def test_two_estimators_make_no_ensemble() -> None:
    """Mutation: `Member.kind` without the estimator (the second would have that of the first)."""
    devices = [phantom().with_interface(**SET[name] | NO_FILTER) for name in ("levant", "kalman")]
    assert len({member(device, 1).kind for device in devices}) == 2


@pytest.mark.parametrize("cutoff", [math.inf, 60.0])
def test_a_register_rounds_what_the_law_is_given_and_not_the_filter(cutoff: float) -> None:
    """1e-12. Mutations: the filter goes on from the rounded value; the law gets the other."""
    step = 0.02
    device = phantom().with_interface(encoder_step=STEP, velocity_cutoff_hz=cutoff)
    ways = [device.with_interface(velocity_step=own) for own in (0.0, step)]
    start = Start(0.0, 0.3)
    exact, rounded = (simulate(d, wall(0.0, 0.0), duration=0.3, start=start) for d in ways)
    v, told = exact.trace["velocity_estimate"], rounded.trace["velocity_estimate"]
    assert np.abs(told - step * np.round(v / step)).max() < 1e-12
    assert len(set(told.tolist())) > 3
    run = simulate(ways[1], wall(5.0, 0.03), duration=0.3, start=start)
    push = 5.0 * run.trace["encoder"] + 0.03 * run.trace["velocity_estimate"]
    assert np.abs(run.trace["command"] + push).max() < 1e-12
    assert not ways[1].interface.linear
