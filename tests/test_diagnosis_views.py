"""What the likelihood, the whitening and the searches for shapes rest on, each against a truth."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from tests.diagnosis_examples import ENCODER_NOISE, FORCE_NOISE, OUTPUTS, phantom, record
from zwidth.controllers.excitation import noise
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.fitting.descend import fit
from zwidth.diagnosis.forces.spatial import response
from zwidth.diagnosis.forces.unknown import instead, unknown
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.family import blind
from zwidth.diagnosis.noise.predictor import SETTLING, Observer, innovations, whitened
from zwidth.diagnosis.noise.settle import prepared_for, refit, settle
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.seeking.candidates import Start, candidates
from zwidth.diagnosis.seeking.modes import mode_starts
from zwidth.diagnosis.seeking.screen import Screened, turned_starts
from zwidth.diagnosis.seeking.sizes import sizes_of
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.physics.sizes import QUARTER
from zwidth.sim.place import place_at
from zwidth.sim.run import simulate

Floats = NDArray[np.float64]
T = 0.001
# A stable autoregression of two outputs, and the covariance of what drives it.
A = np.array([[0.6, 0.2], [-0.3, 0.4]])
SIGMA = np.array([[4.0, 1.5], [1.5, 1.0]])


def autoregression(n: int, seed: int) -> tuple[Floats, Floats]:
    """e_t = A e_(t-1) + w_t, and w."""
    w = np.random.default_rng(seed).multivariate_normal(np.zeros(2), SIGMA, n)
    e = np.zeros((n, 2))
    for t in range(1, n):
        e[t] = A @ e[t - 1] + w[t]
    return e, w


def test_two_outputs_are_whitened_together():
    """W_0 = L^-1 and W_1 = -L^-1 A, L L' the covariance of what drives them.

    Mutations that break it: blocks of the normal equations transposed; outputs one by one.
    """
    e, _ = autoregression(200_000, 1)
    found = whitened(Observer(np.zeros((2, 2)), np.ones(2), 1.0), [e])
    assert found.whitening is not None
    first = np.linalg.inv(np.linalg.cholesky(SIGMA))
    assert found.whitening[:, :, 0] == pytest.approx(first, abs=0.02)
    assert found.whitening[:, :, 1] == pytest.approx(-first @ A, abs=0.02)
    assert found.deviation == pytest.approx(np.sqrt(np.diag(SIGMA)), rel=0.01)
    white = found.weigh(e)[SETTLING:]
    n = white.shape[0]
    for lag in (0, 1, 2, 9):
        product = white[lag:].T @ white[: n - lag] / n
        assert product == pytest.approx(np.eye(2) if lag == 0 else np.zeros((2, 2)), abs=0.02)


def test_the_cost_is_minus_twice_the_log_likelihood():
    """Of w under its own covariance, up to n o (1 + ln 2 pi), whatever `weigh` scales by.

    Mutation that breaks it: the determinant of the filters left out, or with the other sign.
    """
    e, w = autoregression(5000, 2)
    filters = np.zeros((2, 2, 2))
    filters[:, :, 0], filters[:, :, 1] = np.eye(2), -A
    spread = w[1:].T @ w[1:] / (w.shape[0] - 1)
    exact = -2.0 * float(np.sum(multivariate_normal(np.zeros(2), spread).logpdf(w[1:])))
    exact -= (w.shape[0] - 1) * 2.0 * (1.0 + np.log(2.0 * np.pi))
    for scale in (1.0, 7.0, 0.01):
        observer = Observer(np.zeros((2, 2)), np.ones(2), 1.0, scale * filters)
        assert observer.cost(observer.weigh(e)[1:].ravel()) == pytest.approx(exact, rel=1e-9)
    plain = Observer(np.zeros((2, 2)), np.array([3.0, 5.0]), 1.0)
    assert plain.cost(plain.weigh(w)[1:].ravel()) == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("place", ["command", "sensor", "m1", "m3"])
def test_the_response_is_what_a_unit_changes(place: str):
    """Innovations of a linear device are linear in everything that enters.

    Mutation that breaks it: LEAD = 0, where the observer begins with the unit.
    """
    e = record(phantom(), 1.0, seed=3)
    problem, fitted = refit(phantom(), [e])
    device, seen = fitted.model.acting(fitted.x), problem.experiments[0]
    at, force = 400, np.zeros((seen.ticks, 3))
    other = replace(seen, command=seen.command.copy(), measured=seen.measured.copy())
    unit = 1e-3
    if place == "command":
        other.command[at] += unit
    elif place == "sensor":
        other.measured[at, 0] += unit
    else:
        force[at, int(place[1]) - 1] = unit
    gain = problem.observer.gain
    change = innovations(device, other, gain, force) - innovations(device, seen, gain)
    expected = problem.observer.weigh(change)[at:] / unit
    answer = response(problem, fitted, place)[: expected.shape[0]]
    size = float(np.abs(expected).max())
    assert answer == pytest.approx(expected[: answer.shape[0]], abs=1e-6 * size)


def test_commands_that_arrive_early_or_late_move_the_velocity_read_then():
    """Each command arrives j before or after the reading, as often one as the other; a free mass.

    Early, the new command has already acted for j when the velocity is read; late, it has not.
    Mutation that breaks it: the whole j in place of its half.
    """
    mass, j, n = 0.5, 3e-5, 200_000
    device = Device("mass", "", False, make_chain([mass], [0.0]), Interface(period=T))
    random = np.random.default_rng(4)
    command = random.standard_normal(n)
    early = random.random(n) < 0.5
    change = np.diff(command, prepend=0.0)
    held = np.concatenate([[0.0], np.cumsum(command[:-1]) * T / mass])
    read = held + np.where(early, j * change / mass, 0.0)
    e = Experiment(T, command, read[:, None], (Output("velocity", 0),))
    model = Model(device)
    places = [p.kind for p in model.parameters]
    x = np.zeros(len(places))
    x[places.index("jitter")] = j / model.parameters[places.index("jitter")].scale
    left = model.seen(e, x).measured[:, 0] - held
    error = j / mass / np.sqrt(n)
    assert abs(left @ change) / float(change @ change) < 4.0 * error
    assert read @ change - held @ change > 100.0 * error * float(change @ change)


def test_a_phase_between_two_quarter_turns_is_solved():
    """a sin(p + phase) from the signatures of phases 0 and pi/2.

    Mutation that breaks it: the arc tangent of the other quotient.
    """
    wave = np.linspace(0.0, 40.0, 3000)
    amplitude, phase = 2.5, 2.2
    base = -amplitude * np.sin(wave + phase)

    def at(angle: float) -> Screened:
        values = {"amplitude": 0.1, "period": 1.0, "phase": angle}
        start = Start(make_physics("encoder_eccentricity", "sensor", **values), dict(values))
        return Screened(start, 0.0, 0.1 * np.sin(wave + angle), np.zeros(0))

    (start,) = turned_starts([at(0.0), at(QUARTER)], base)
    assert start.physics.values["amplitude"] == pytest.approx(amplitude, rel=1e-9)
    assert start.physics.values["phase"] == pytest.approx(phase, rel=1e-9)
    assert start.physics.values["period"] == 1.0
    assert not turned_starts([at(0.0), at(QUARTER)], base, 2.0 * float(base @ base))


def test_a_further_mass_is_sought_where_it_rings():
    """Its own frequency, on the mass it hangs on, within a tenth.

    Mutation that breaks it: frequencies from the middle of the band only.
    """
    mass, hertz = 1e-5, 70.0
    stiffness = mass * (2.0 * np.pi * hertz) ** 2
    physics = make_physics(
        "extra_mode", "m1", mass=mass, stiffness=stiffness,
        damping=0.1 * np.sqrt(stiffness * mass),
    )  # fmt: skip
    truth = phantom().with_physics(physics)
    problem, fitted = refit(phantom(), [record(truth, 4.0, seed=5)])
    starts = [s for s in mode_starts(problem, fitted) if s.physics.at == "m1"]
    found = [np.sqrt(s.physics.values["stiffness"] / s.physics.values["mass"]) for s in starts]
    assert min(abs(w / (2.0 * np.pi * hertz) - 1.0) for w in found) < 0.1


def test_a_force_of_free_shape_is_seen_where_there_is_one():
    """Friction that the model lacks follows the velocity of m1; a clean recording shows nothing.

    Mutation that breaks it: the shapes that gain least judged first.
    """
    truth = phantom().with_physics(make_physics("coulomb_friction", "m1", level=6e-3))
    found: list[float] = []
    for device in (truth, phantom()):
        experiments = [record(device, 4.0, seed=7)]
        _, fitted = refit(phantom(), experiments)
        likeliest = unknown(experiments, fitted)
        assert likeliest is not None
        found.append(likeliest.gained - 1.5 * likeliest.unknowns)
        if device is truth:
            assert likeliest.place == "m1"
            assert "velocity" in likeliest.follows
    assert found[0] > 300.0
    assert found[1] < 30.0


def test_what_hums_is_no_mode_and_what_rings_is_no_hum():
    """Each in the place of a mode that was fitted to it, by likelihood.

    Mutation that breaks it: the strongest line built with its sine twice.
    """
    seconds = 6.0
    hum = 8e-3 * np.cos(2.0 * np.pi * 31.0 * np.arange(round(seconds / T)) * T)
    mode = make_physics("extra_mode", "m1", mass=2e-5, stiffness=0.76, damping=1e-5)
    scales = {"mass": 1e-5, "stiffness": 0.4, "damping": 1e-4}
    ringing = record(phantom().with_physics(mode), seconds, seed=9)
    for e, hums in ((record(phantom(), seconds, seed=9, force=hum), True), (ringing, False)):
        problem, without = refit(phantom(), [e])
        start = np.concatenate([without.x, np.zeros(3)])
        final = fit(problem, Model(phantom(), (mode,), (scales,)), start, rounds=30)
        other = instead(problem, final, without, problem.experiments, "extra_mode at m1")
        assert (other is not None) is hums
        if other is not None:
            assert (other.follows, other.unknowns) == ("repeats with time", 3)
            assert "likelier than extra_mode at m1 by" in other.sentence


def test_deflections_are_those_that_the_recording_had():
    """A light end takes a small part of the force.

    Mutation that breaks it: the force over the spring.
    """
    chain = make_chain([2e-3, 1e-4], [1e-3, 1e-6], 0.0, [1.0], [1e-5])
    device = Device("rings", "", True, chain, Interface(period=T))
    e = record(device, 4.0, seed=4)
    run = simulate(device, recorded(e.command), duration=4.0)
    x = run.trace["position_m1"] - run.trace["position_m2"]
    size = sizes_of(device, [e])
    assert size.reach(place_at("link12")) == pytest.approx(float(np.std(x)), rel=0.1)
    assert size.reach(place_at("link12")) < 0.2 * size.force / 1.0
    assert size.reach(place_at("ground")) == size.position


def test_a_slower_observer_is_not_whitened():
    """Whitened, every observer of the same model sees the same.

    Mutation that breaks it: `whitened` for a ratio that was asked for.
    """
    e = record(phantom(), 2.0, seed=8)
    model = Model(phantom())
    x = np.zeros(model.linear_count)
    own = prepared_for([e], model, x)
    slow = prepared_for([e], model, x, blind(1e-2 * own.observer.ratio))
    assert own.observer.whitening is not None
    assert slow.observer.whitening is None
    left = slow.residual(model, x)
    assert float(left @ left) / left.size == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize(("travel", "turns"), [(1.0, False), (15.0, True)])
def test_less_than_two_waves_are_no_eccentricity(travel: float, turns: bool):
    """A turn of the disk is sought where two of them were seen, along a line never.

    Mutation that breaks it: a turn sought on every disk.
    """
    e = record(phantom(), 1.0)
    e = replace(e, measured=e.measured * travel / np.ptp(e.measured))
    for rotary in (False, True):
        device = Device("m", "", rotary, make_chain([0.5], [0.0]), Interface(period=T))
        periods = [
            s.physics.values["period"]
            for s in candidates(device, [replace(e, outputs=OUTPUTS)])
            if s.physics.effect.name == "encoder_eccentricity"
        ]
        assert max(periods) < travel / 1.8 + 1e-9
        assert (2.0 * np.pi in periods) is (rotary and turns)


def swung(share: float, period: float, seconds: float = 6.0) -> Experiment:
    """A mass m(x) = m (1 + share cos(2 pi x / period)): d(m v)/dt = u - b v + m' v^2 / 2.

    By Runge and Kutta with 20 steps per tick.
    """
    mass, damper = 2e-4, 1e-3
    random = np.random.default_rng(31)
    u = noise(duration=seconds, seed=31) + FORCE_NOISE * random.standard_normal(round(seconds / T))
    wave = 2.0 * np.pi / period

    def slope(x: float, v: float, force: float) -> tuple[float, float]:
        m = mass * (1.0 + share * np.cos(wave * x))
        rises = -mass * share * wave * np.sin(wave * x)
        return v, (force - damper * v - 0.5 * rises * v * v) / m

    x, v, h = 0.0, 0.0, T / 20.0
    positions = np.zeros(u.size)
    for k, force in enumerate(u):
        positions[k] = x
        for _ in range(20):
            a, b = slope(x, v, force)
            c, d = slope(x + 0.5 * h * a, v + 0.5 * h * b, force)
            e, f = slope(x + 0.5 * h * c, v + 0.5 * h * d, force)
            g, i = slope(x + h * e, v + h * f, force)
            x, v = x + h / 6.0 * (a + 2 * c + 2 * e + g), v + h / 6.0 * (b + 2 * d + 2 * f + i)
    y = positions + ENCODER_NOISE * random.standard_normal(u.size)
    return Experiment(T, noise(duration=seconds, seed=31), y[:, None], OUTPUTS)


def test_an_inertia_that_swings_is_no_eccentric_encoder():
    """And an eccentric encoder is no inertia that swings, though the two are near.

    What an eccentric encoder reports moves like an inertia that swings with it; only command and
    damper swing too.

    Mutation that breaks it: the inertia's force without the square of the speed.
    """
    device = Device("mass", "", True, make_chain([2e-4], [1e-3]), Interface(period=T))
    span = float(np.ptp(swung(0.0, 1.0).measured))
    period = 0.1 * span
    values = {"amplitude": 1e-3 * span, "period": period, "phase": 0.7}
    eccentric = make_physics("encoder_eccentricity", "sensor", **values)
    scales = {"amplitude": 1e-3 * span, "period": 0.02 * period, "phase": 0.5}
    for e, swings in (
        (swung(0.02, period), True),
        (record(device.with_physics(eccentric), 6.0, seed=31), False),
    ):
        problem, linear = refit(device, [e])
        model = Model(device, (eccentric,), (scales,))
        problem, final = settle(problem.experiments, model, np.append(linear.x, np.zeros(3)))
        without = fit(problem, *final.model.less(final.x, 0))
        other = instead(problem, final, without, problem.experiments, "encoder_eccentricity")
        assert (other is not None) is swings
        assert other is None or "inertia" in other.sentence
