"""What no slope leads to: steps, waves and lost commands, and what sways or repeats."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binomtest

from tests.diagnosis_examples import ENCODER_NOISE, FORCE_NOISE, OUTPUTS, phantom, record
from zwidth.controllers.excitation import noise, random_steps
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.knowing_events import knowing_events
from zwidth.diagnosis.answer.stands import knowing_losses
from zwidth.diagnosis.fitting.fit import Fitted, Problem
from zwidth.diagnosis.forces.leftover import leftover
from zwidth.diagnosis.forces.spatial import Pull, step_peaks
from zwidth.diagnosis.intake.gate import encoder_step_seen
from zwidth.diagnosis.intake.rectified import as_known, unfolded
from zwidth.diagnosis.intake.take_in import Taken
from zwidth.diagnosis.learning.events import set_apart
from zwidth.diagnosis.mishaps import silent
from zwidth.diagnosis.model.parameters import Model, delivered
from zwidth.diagnosis.noise.predictor import Observer, whitened
from zwidth.diagnosis.noise.settle import refit
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.seeking.lattice import (
    chances_seen,
    command_step,
    dropped_samples,
    encoder_step,
    mean_error,
)
from zwidth.diagnosis.seeking.waves import wave_starts
from zwidth.diagnosis.selection import search as searching
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.hypothesis import judged, settled
from zwidth.diagnosis.selection.moves import stepped
from zwidth.diagnosis.selection.search import Moves, Search
from zwidth.diagnosis.selection.searched import Searched
from zwidth.sim.chain import make_chain
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate

SECONDS = 4.0
STEP = 5e-3


def driven(force: np.ndarray | None = None, colour: float = 0.0) -> Experiment:
    """The clean PHANToM under white torque, and a force at m1 that nobody knows of."""
    random = np.random.default_rng(11)
    command = noise(duration=SECONDS, seed=11)
    push = FORCE_NOISE * random.standard_normal(command.size)
    run = simulate(
        phantom(), recorded(command), duration=SECONDS,
        disturbance=push if force is None else push + force,
    )  # fmt: skip
    white = ENCODER_NOISE * random.standard_normal(command.size)
    for k in range(1, white.size):
        white[k] += colour * white[k - 1]
    position = run.trace["position_m1"] + white
    return Experiment(0.001, command, position[:, None], OUTPUTS)


@lru_cache
def clean() -> tuple[Problem, Fitted]:
    return refit(phantom(), [driven()])


def of(effect: str, at: str, **values: float) -> tuple[Problem, Fitted]:
    truth = phantom().with_physics(make_physics(effect, at, **values))
    return refit(phantom(), [record(truth, SECONDS, seed=12)])


def test_a_clean_recording_has_no_steps_no_losses_and_nothing_left():
    """Mutation that breaks it: the odds of a lost command left out."""
    problem, fitted = clean()
    for trial in (
        command_step(problem, fitted),
        encoder_step(problem, fitted, problem.experiments),
        dropped_samples(problem, fitted, problem.experiments),
    ):
        assert trial is None or trial.gained < 30.0 + trial.price
    assert not leftover(problem, fitted).significant


def test_steps_of_the_command_are_found_by_what_they_repeat():
    """Mutation that breaks it: the sign of the saw turned."""
    problem, fitted = of("command_step", "command", step=5e-3)
    trial = command_step(problem, fitted)
    assert trial is not None
    assert trial.gained > 30.0 + trial.price
    step = next(p for p in trial.fitted.model.effects).values["step"]
    assert step == pytest.approx(5e-3, rel=1e-3)


def test_a_step_is_sought_again_beside_what_was_found_after_it():
    """A step 4 % off stands for the right one. Mutation: a step that is known is not sought."""
    problem, fitted = of("command_step", "command", step=STEP)
    wrong = fitted.model.with_effect(make_physics("command_step", "command", step=1.04 * STEP), {})
    paid = (("command_step@command", 7.0),)
    there = settled(judged(problem.experiments, wrong, fitted.x, prices=paid))
    (step,) = (proposal := next(stepped(there, QUICK))).model.effects
    assert step.values["step"] == pytest.approx(STEP, rel=1e-3)
    ((label, price),) = proposal.prices  # paid once
    assert label == "command_step@command"
    assert price > 7.0


@pytest.mark.parametrize("seed", [0, 5])
def test_a_step_is_found_among_levels_that_it_hardly_rounds(seed: int):
    """Most of a command has six levels, which a saw changes by less than its mean.

    Mutation: the amplitude held at one, at which the right step explains less than nothing.
    """
    random = np.random.default_rng(seed)
    levels = random.choice(random.normal(0.0, 30.0, 6), 3000)
    over = np.concatenate([levels, random.normal(0.0, 20.0, 300)])
    saw = 4.0 * np.round(over / 4.0) - over
    pull = Pull(random.standard_normal(over.size) - saw, random.standard_normal((4, over.size)))
    found, _ = step_peaks([pull], [over], 0.1, -1.0)
    assert any(p.period == pytest.approx(4.0, rel=0.01) for p in found)


@pytest.mark.parametrize(("hold", "found"), [(0.1, True), (0.15, True), (0.4, False)])
def test_steps_of_a_command_that_is_held_are_sought_where_its_levels_tell(
    hold: float, found: bool
) -> None:
    """40 and 27 levels, and 10, of which some of 3500 steps would explain anything.

    Mutations that break it: never below 50 levels; whatever they are.
    """
    command = 0.05 * random_steps(1.0, hold, SECONDS, 0.001, 3)
    truth = phantom().with_physics(make_physics("command_step", "command", step=5e-3))
    random = np.random.default_rng(14)
    push = FORCE_NOISE * random.standard_normal(command.size)
    run = simulate(truth, recorded(command), duration=SECONDS, disturbance=push)
    position = run.trace["position_m1"] + ENCODER_NOISE * random.standard_normal(command.size)
    problem, fitted = refit(phantom(), [Experiment(0.001, command, position[:, None], OUTPUTS)])
    trial = command_step(problem, fitted)
    assert (trial is not None) == found
    if trial is not None:
        assert trial.gained > 30.0 + trial.price
        step = next(p for p in trial.fitted.model.effects).values["step"]
        assert step == pytest.approx(5e-3, rel=0.02)


def test_steps_of_the_sensor_are_found_under_noise():
    """Mutation that breaks it: the error added to the recording instead of taken off."""
    clean_one = driven()
    random = np.random.default_rng(13)
    y = 4e-4 * np.round(clean_one.measured / 4e-4)
    noisy = replace(clean_one, measured=y + 1e-5 * random.standard_normal(y.shape))
    problem, fitted = refit(phantom(), [noisy])
    trial = encoder_step(problem, fitted, problem.experiments)
    assert trial is not None
    assert trial.gained > 30.0 + trial.price
    step = next(p for p in trial.fitted.model.effects).values["step"]
    assert step == pytest.approx(4e-4, rel=1e-3)


def test_the_mean_error_of_a_step_is_the_blurred_saw():
    """The series against the definition, and against a mean over drawn positions.

    Mutation that breaks it: (-1)^n left out.
    """
    x = np.linspace(-2.3, 2.3, 501)
    assert mean_error(x, 1.0, 0.0) == pytest.approx(np.round(x) - x)
    drawn = x + 0.2 * np.random.default_rng(1).standard_normal((20000, 1))
    mean = (np.round(drawn) - drawn).mean(axis=0)
    assert mean_error(x, 1.0, 0.2) == pytest.approx(mean, abs=0.02)


def test_lost_commands_are_found_one_by_one():
    """Mutations that break it: the echo of a lost command not taken off; one tick late."""
    command = noise(duration=SECONDS, seed=14)
    lost = np.zeros(command.size, dtype=np.bool_)
    large = 150 + np.flatnonzero(np.abs(np.diff(command))[150:] > 0.3) + 1  # the others hide
    lost[large[[3, 30, 60, 90]]] = True
    lost[large[30] + 1] = True  # two in a row
    arrived = delivered(command, lost)
    assert arrived[large[30] + 1] == command[large[30] - 1]
    run = simulate(phantom(), recorded(arrived), duration=SECONDS)
    random = np.random.default_rng(15)
    y = run.trace["position_m1"] + ENCODER_NOISE * random.standard_normal(command.size)
    problem, fitted = refit(phantom(), [Experiment(0.001, command, y[:, None], OUTPUTS)])
    trial = dropped_samples(problem, fitted, problem.experiments)
    assert trial is not None
    marked = trial.problem.experiments[0].dropped
    assert marked is not None
    assert set(np.flatnonzero(marked)) == set(np.flatnonzero(lost))


def losing(*which: int) -> tuple[Experiment, NDArray[np.bool_], Searched]:
    """A recording, which of its commands were lost, and what is found in its first part.

    which: of the changes of the command by more than 0.3.
    """
    command = noise(duration=SECONDS, seed=14)
    large = 150 + np.flatnonzero(np.abs(np.diff(command))[150:] > 0.3) + 1
    lost = np.zeros(command.size, dtype=np.bool_)
    lost[large[list(which)]] = True
    run = simulate(phantom(), recorded(delivered(command, lost)), duration=SECONDS)
    random = np.random.default_rng(15)
    y = run.trace["position_m1"] + ENCODER_NOISE * random.standard_normal(command.size)
    whole = Experiment(0.001, command, y[:, None], OUTPUTS)
    first, _ = whole.split()
    problem, fitted = refit(phantom(), [first])
    trial = dropped_samples(problem, fitted, problem.experiments)
    assert trial is not None
    h = settled(judged(trial.problem.experiments, trial.fitted.model, trial.fitted.x))
    tried = Search(h, h, QUICK, silent)
    return whole, lost, Searched(trial.problem, fitted, trial.fitted, tried, problem.observer)


def test_commands_lost_in_what_was_held_out_are_found_there():
    """The rest of a recording, followed from its first part on, and begun anew.

    Mutation that breaks it: the first part before the response to one tick of force.
    """
    whole, lost, found = losing(3, 30, 60, -30, -3)
    first, rest = whole.split()
    for judged_by in (rest, replace(rest, before=None)):
        (known,) = knowing_losses(found, [judged_by])
        assert known.dropped is not None
        assert set(np.flatnonzero(known.dropped)) == set(np.flatnonzero(lost[first.ticks :]))
    unaware = replace(found, final=found.refit)
    assert knowing_losses(unaware, [rest])[0] is rest


def test_a_command_that_the_answer_calls_lost_is_no_hit():
    """Mutation that breaks it: events sought in recordings that know of no losses."""
    whole, _, found = losing(30)
    first, rest = whole.split()
    taken = Taken(phantom(), (whole,), (first,), (rest,), (), 1.0, True, ())
    there, same, events = knowing_events(taken, found, silent)
    assert events == ()
    assert there is taken
    assert same is found


def test_lost_commands_are_not_set_apart_one_by_one():
    """Mutation that breaks it: what is sought tick by tick is asked last."""
    whole, _, _ = losing(30)
    model = Model(phantom())
    plain = settled(judged([whole], model, np.zeros(len(model.parameters))))
    found = Search(plain, plain, QUICK, silent, Moves(apart=set_apart), recorded=whole.ticks)
    assert searching._set_apart(found, plain, [])
    assert found.best.labels == {"dropped_samples@clock"}
    assert found.apart == 0


def test_the_rate_of_losses_is_that_of_those_that_can_be_seen():
    """A command that stands most of the time hides most losses, and every fifth change is lost.

    Mutation that breaks it: the number of ticks in the place of the odds to be seen.
    """
    random = np.random.default_rng(16)
    command = np.repeat(random.choice([-0.5, 0.0, 0.5], 400), 10)
    lost = random.random(command.size) < 0.2
    run = simulate(phantom(), recorded(delivered(command, lost)), duration=SECONDS)
    y = run.trace["position_m1"] + ENCODER_NOISE * random.standard_normal(command.size)
    problem, fitted = refit(phantom(), [Experiment(0.001, command, y[:, None], OUTPUTS)])
    trial = dropped_samples(problem, fitted, problem.experiments)
    assert trial is not None
    rate = trial.fitted.model.effects[-1].values["rate"]
    marked = trial.problem.experiments[0].dropped
    assert marked is not None
    assert marked.mean() < 0.03
    seen = chances_seen(trial.problem, trial.fitted, rate)
    low, high = binomtest(int(marked.sum()), round(seen)).proportion_ci(method="exact")
    assert low < 0.2 < high
    assert rate == pytest.approx(marked.sum() / seen, rel=0.05)


def test_noise_that_is_larger_where_motion_is_fast_is_not_left_over():
    """Readings at uneven times err by speed times jitter: no line, but loud where motion is.

    Mutation that breaks it: the envelope of drawn noise left out.
    """
    random = np.random.default_rng(17)
    command = noise(duration=SECONDS, seed=17)
    loud = np.arange(command.size) // 200 % 10 == 3
    command = np.where(loud, 8.0, 0.3) * command
    push = FORCE_NOISE * random.standard_normal(command.size)
    run = simulate(phantom(), recorded(command), duration=SECONDS, disturbance=push)
    white = ENCODER_NOISE * np.where(loud, 5.0, 1.0) * random.standard_normal(command.size)
    y = run.trace["position_m1"] + white
    problem, fitted = refit(phantom(), [Experiment(0.001, command, y[:, None], OUTPUTS)])
    found = leftover(problem, fitted)
    assert found.gained < 0.8 * found.chance


def test_a_ripple_is_started_at_the_period_that_the_residual_shows():
    """Mutation that breaks it: the spectrum over time instead of position."""
    problem, fitted = of("force_ripple", "m1", amplitude=3e-3, period=0.04, phase=1.0)
    starts = wave_starts(problem, fitted)
    found = [s.physics.values["period"] for s in starts if s.physics.effect.name == "force_ripple"]
    assert min(abs(p / 0.04 - 1.0) for p in found) < 0.05


def test_a_hum_and_a_stiffness_that_sways_are_left_over():
    """Mutations that break it: only one kind of q; time taken for position."""
    t = 0.001 * np.arange(round(1000 * SECONDS))
    hum = leftover(*refit(phantom(), [driven(1e-3 * np.sin(2.0 * np.pi * 77.0 * t))]))
    assert hum.significant
    assert (hum.follows, hum.over) == ("1", "time")
    assert 1.0 / hum.period == pytest.approx(77.0, rel=0.01)
    free = driven()
    speed = np.gradient(np.convolve(free.measured[:, 0], np.full(9, 1.0 / 9.0), "same"), 0.001)
    force = -1e-2 * speed * np.cos(2.0 * np.pi * 3.0 * t)
    sway = leftover(*refit(phantom(), [driven(force)]))
    assert sway.significant
    assert sway.follows in ("velocity", "rate of deflection")  # the chain moves as one at 3 Hz
    assert 1.0 / sway.period == pytest.approx(3.0, rel=0.1)
    assert "proportional to the" in sway.sentence(rotary=True)


def test_coloured_noise_is_whitened_and_its_power_kept():
    """Whitened innovations have no correlation left. Mutation: the filter's sign turned."""
    problem, fitted = refit(phantom(), [driven(colour=0.8)])
    assert problem.observer.whitening is not None
    white = fitted.white
    r = np.array([float(white[k:] @ white[: white.size - k]) for k in (1, 2, 3)])
    assert np.abs(r).max() / float(white @ white) < 4.0 / np.sqrt(white.size)
    plain = Observer(problem.observer.gain, np.ones(1), 1.0)
    drawn = np.random.default_rng(3).standard_normal((5000, 1))
    same = whitened(plain, [drawn])
    assert same.deviation[0] == pytest.approx(1.0, rel=0.05)


def test_a_lattice_of_many_levels_is_seen():
    """Mutation that breaks it: levels that hardly repeat taken for continuous ones."""
    random = np.random.default_rng(5)
    walk = np.cumsum(random.standard_normal(6000)) * 3e-4
    assert encoder_step_seen(1e-6 * np.round(walk / 1e-6)) == pytest.approx(1e-6, rel=1e-6)
    assert encoder_step_seen(walk) is None


def test_a_model_takes_lost_commands_off_the_recording():
    """Mutation that breaks it: the effect also simulated, with losses of its own."""
    e = replace(driven(), dropped=np.arange(4000) == 7)
    physics = make_physics("dropped_samples", "clock", rate=0.01)
    model = Model(phantom()).with_effect(physics, {})
    x = np.zeros(model.linear_count)
    assert model.seen(e, x).command[7] == e.command[6]
    assert not model.acting(x).physics
    assert model.build(x).physics[0].effect.name == "dropped_samples"


def test_the_absolute_value_of_a_speed_is_folded_out() -> None:
    """Two masses on a belt at 50 Hz under random steps, their own device file and one 30 % off.

    A device file that knows the sensor has it folded out too. Mutations that break it: positions
    alone looked at; the signs that continue the motion left as they are (16 of 36 crossings wrong).
    """
    random = np.random.default_rng(8)
    command = np.repeat(random.choice([-1.0, 1.0], 60), 8)
    belt = make_chain(
        np.array([0.5, 0.5]), np.array([0.2, 0.2]), 0.0, np.array([103.0]), np.array([0.5])
    )
    device = phantom().without_physics().with_chain(belt).with_interface(period=0.02, delay=0.0)
    run = simulate(device, recorded(command), duration=0.02 * command.size)
    v = run.trace["velocity_m2"] + 0.02 * random.standard_normal(command.size)
    e = Experiment(0.02, command, np.abs(v)[:, None], (Output("velocity", 1),))
    file = make_chain(
        np.array([0.65, 0.4]), np.array([0.2, 0.2]), 0.0, np.array([103.0]), np.array([0.5])
    )
    for known in (device, device.with_chain(file)):
        folded = unfolded(known, e)
        assert folded is not None
        assert folded.experiment.measured[:, 0] == pytest.approx(v, abs=0.15)
    has = device.with_physics(make_physics("rectified_sensor", "sensor"))
    assert as_known(has, e).measured[:, 0] == pytest.approx(v, abs=0.15)
    assert unfolded(device, replace(e, measured=v[:, None])) is None


def test_absolute_values_are_folded_out():
    """A motion that crosses zero, its readings rectified; the plain motion stays as it is.

    Mutation that breaks it: the sign continued by the last sample alone.
    """
    t = 0.001 * np.arange(3000)
    command = 0.1 * np.sin(2.0 * np.pi * 1.5 * t + 0.4) + 0.05 * np.sin(2.0 * np.pi * 7.0 * t)
    command -= 0.04
    run = simulate(phantom(), recorded(command), duration=3.0)
    x = run.trace["position_m1"] - run.trace["position_m1"].mean()
    y = x + 1e-5 * np.random.default_rng(2).standard_normal(x.size)
    plain = Experiment(0.001, command, y[:, None], OUTPUTS)
    folded = unfolded(phantom(), replace(plain, measured=np.abs(y)[:, None]))
    assert folded is not None
    assert folded.experiment.measured[:, 0] == pytest.approx(y, abs=1e-4)
    assert unfolded(phantom(), plain) is None
