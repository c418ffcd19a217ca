"""A command that is written down later than it acts is brought back, and said."""

from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis_examples import phantom, record, shifted
from zwidth.controllers.excitation import noise
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.result import Verdict
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.intake.late import Shift, in_time, shifted_by
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate


def late(e: Experiment, samples: int) -> Experiment:
    """A recording whose command is written down so many samples later."""
    held = np.full(samples, e.command[0])
    return replace(e, command=np.concatenate([held, e.command[:-samples]]))


@pytest.mark.parametrize("samples", [1, 4, 30])
def test_a_command_that_comes_late_is_told_to_the_sample(samples: int) -> None:
    """By a device file a few percent off. Mutation: the scale of the command held at one."""
    e = record(phantom(), 4.0)
    assert shifted_by(shifted(phantom()), late(e, samples)) == samples


@pytest.mark.parametrize("delay", [0.0, 0.002, 0.02])
def test_a_delay_is_physics_and_no_fault(delay: float) -> None:
    e = record(phantom().with_interface(delay=delay), 4.0)
    assert shifted_by(phantom(), e) <= 0


@pytest.mark.parametrize(
    ("effect", "values", "hertz"),
    [
        ("quadratic_drag", {"coefficient": 0.02}, (0.7, 1.3)),
        ("quadratic_drag", {"coefficient": 0.02}, (2.0, 3.7)),
        ("ground_spring", {"stiffness": 2.0}, (5.0,)),
        ("gravity_pendulum", {"level": 0.5, "angle": 0.0}, (2.0, 3.7)),
    ],
)
def test_slow_sines_beside_physics_are_no_later_than_they_are(
    effect: str, values: dict[str, float], hertz: tuple[float, ...]
) -> None:
    """Their phase is ahead of what the device file foretells.

    Mutations: no forces beside (100, 42, 87 samples); no pendulum among them (2).
    """
    t = 0.001 * np.arange(8000)
    command = 0.1 * np.sum([np.sin(2.0 * np.pi * f * t + f) for f in hertz], axis=0)
    device = phantom().with_physics(make_physics(effect, "m1", **values))
    run = simulate(device, recorded(command), duration=8.0, substeps=10)
    noisy = run.trace["position_m1"] + 1e-4 * np.random.default_rng(0).standard_normal(t.size)
    e = Experiment(0.001, command, noisy[:, None], (Output("position", 0),))
    assert shifted_by(phantom(), e) == 0


def test_a_feedback_tells_nothing_of_the_future() -> None:
    """u = r - K y of a reading with noise: what is commanded knows what will be read."""
    random = np.random.default_rng(1)
    e = record(phantom(), 4.0, seed=3)
    jitter = 1e-4 * random.standard_normal(e.measured.shape)
    held = np.concatenate([jitter[1:, 0], [0.0]])  # the next reading's noise, fed back
    fed = replace(e, measured=e.measured + jitter, command=e.command - 3000.0 * held)
    assert shifted_by(phantom(), fed) == 0


def test_what_comes_later_than_the_device_file_says_is_a_fact() -> None:
    """A delay of 8 samples, or a command stamped too early: nothing tells, and nothing is changed.

    Mutation: commands asked at later times only.
    """
    e = record(phantom().with_interface(delay=0.008), 4.0)
    same, (fact,) = in_time(shifted(phantom()), e)
    assert same is e
    assert (fact.kind, fact.wrong, fact.value) == ("command_early", False, 8.0)
    assert "8 samples (8 ms) later than in the device file" in fact.sentence


@pytest.mark.parametrize("by", [0, 8, -8])
def test_steps_that_hardly_show_one_step_ahead_are_told_by_the_scatter_of_blocks(by: int) -> None:
    """A motor that turns one way under steps of a tenth of its torque, friction taking half of it.

    The errors are a few percent smaller by the right time. Mutations: only what is 1.5 times
    better counts; no device that is off beside it (12 samples with nothing sown).
    """
    random = np.random.default_rng(4)
    command = 0.055 + 0.005 * np.repeat(np.sign(random.standard_normal(40)), 400)
    chain = make_chain([1.0e-4], [1.2e-4], 0.0, [], [])
    interface = Interface(period=0.001, delay=0.0)
    rubs = make_physics("coulomb_friction", "m1", level=0.033)
    truth = Device("motor", "", True, chain, interface, (rubs,))
    run = simulate(truth, recorded(command), duration=command.size * 0.001)
    read = run.trace["position_m1"] + 2e-4 * random.standard_normal(command.size)
    moved = np.roll(command, by)
    moved[:8], moved[-8:] = command[0], command[-1]
    e = Experiment(0.001, moved, read[:, None], (Output("position", 0),))
    catalogue = truth.without_physics("coulomb_friction").with_chain(
        make_chain([1.2e-4], [7.0e-5], 0.0, [], [])
    )
    assert abs(shifted_by(catalogue, e) - by) <= (1 if by else 0)


@pytest.mark.truth
def test_what_was_shifted_is_explained_as_if_it_had_not_been() -> None:
    e = late(record(phantom(), 4.0), 6)
    early, (fault,) = in_time(phantom(), e)
    assert fault.wrong
    assert fault.kind == "command_late"
    assert "6 samples (6 ms) later" in fault.sentence
    assert early.ticks == e.ticks - 6
    np.testing.assert_array_equal(early.command, noise(duration=4.0, seed=0)[: e.ticks - 6])
    found = diagnose(phantom(), [e], effort=QUICK)
    assert found.verdict is Verdict.RECORDING_FAULT
    assert not found.findings
    assert "logged 6 samples" in found.headline


def test_a_single_sample_needs_errors_that_are_clearly_smaller() -> None:
    """What a device file gets wrong draws the command by a sample, and blocks agree about it.

    On a cart under steps two observers say 1 and 2 samples at 5 and 7 sigma where errors are 0.4
    and 0.7 % smaller. Mutation: the scatter of blocks asked by the farther of the two.
    """
    far, near = Shift(2, 127.8, 1.004, 5.3), Shift(1, 218.5, 1.007, 7.5)
    assert not any(shift.sure(100, single=True) for shift in (far, near))
    assert far.sure(100, single=False)
    assert Shift(1, 218.5, 1.6, 7.5).sure(100, single=True)


def test_a_delay_of_the_device_file_may_be_wrong_without_a_fault(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Two samples earlier are half a sample before the motion begins, with a delay of 1.5.

    Errors are 0.3 % smaller, at 9.6 sigma of blocks (friction, read coarsely; the exam of
    20281221). Mutation: the delay is not counted.
    """
    e = record(phantom(), 2.0)
    delayed = phantom().with_interface(delay=1.5 * e.period)
    for better, device, by in ((1.003, delayed, 0), (1.003, phantom(), 2), (1.6, delayed, 2)):
        shift = Shift(2, 300.0, better, 9.6)
        monkeypatch.setattr("zwidth.diagnosis.intake.late._under", lambda *_, s=shift: s)
        assert shifted_by(device, e) == by
