"""Columns that were described for one another are named, and outputs put back."""

from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis_examples import phantom, record, shifted
from zwidth.controllers.excitation import noise
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.intake.swapped import EXCHANGED, in_place, one_tone
from zwidth.diagnosis.intake.take_in import readings
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.run import simulate

CARTS = Device(
    "carts", "", False, make_chain([0.8, 0.4], [3.0, 2.0], 0.0, [500.0], [0.5]),
    Interface(period=0.002),
)  # fmt: skip


def both(device: Device = CARTS, noise_of: float = 1e-3) -> Experiment:
    command = noise(duration=4.0, to_hz=60.0, period=0.002, seed=1)
    run = simulate(device, recorded(command), duration=4.0)
    q = np.column_stack([run.trace["position_m1"], run.trace["position_m2"]])
    q += noise_of * q.std() * np.random.default_rng(0).standard_normal(q.shape)
    outputs = (Output("position", 0), Output("position", 1))
    return Experiment(0.002, command, q, outputs, "r", float(q[:, 0].std()))


def exchanged(e: Experiment) -> Experiment:
    return replace(e, measured=np.ascontiguousarray(e.measured[:, ::-1]))


def for_the_command(e: Experiment) -> Experiment:
    """The command in the place of the first output, and the other way round."""
    return replace(e, command=e.measured[:, 0].copy(), measured=e.command[:, None].copy())


def test_two_outputs_are_put_back_where_they_belong() -> None:
    """Mutation: BETTER below one (sound ones are exchanged)."""
    masses = CARTS.chain._replace(masses=np.array([1.0, 0.3]))
    for device in (CARTS, CARTS.with_chain(masses)):
        for made in (both(), both(noise_of=1e-2)):
            there, (fault,) = in_place(device, exchanged(made))
            assert fault.kind == "outputs_exchanged"
            assert fault.wrong
            np.testing.assert_array_equal(there.measured, made.measured)
            same, faults = in_place(device, made)
            assert not faults
            assert same.measured is not None
            np.testing.assert_array_equal(same.measured, made.measured)


def test_a_command_in_the_place_of_a_motion_is_named() -> None:
    """Mutation: the other way round alone is asked (a quiet recording explains nothing)."""
    e = record(phantom(), 4.0)
    _, (fault,) = in_place(shifted(phantom()), for_the_command(e))
    assert fault.kind == EXCHANGED
    assert not in_place(shifted(phantom()), e)[1]
    deaf = replace(e, command=np.random.default_rng(2).standard_normal(e.ticks))
    assert not in_place(phantom(), deaf)[1]


@pytest.mark.parametrize("o", [0, 1])
def test_a_command_in_the_place_of_either_motion_is_no_exchange_of_the_two(o: int) -> None:
    """Of two carts' velocities m1's was exchanged with m2's. Mutation: outputs are asked first."""
    e = both()
    measured = e.measured.copy()
    command, measured[:, o] = measured[:, o].copy(), e.command
    _, (fault,) = in_place(CARTS, replace(e, command=command, measured=measured))
    assert fault.kind == EXCHANGED
    assert f"position_m{o + 1} jumps" in fault.sentence


def test_what_was_exchanged_is_said_and_nothing_else_suspected() -> None:
    e = record(phantom(), 3.0)
    (taken,) = readings(phantom(), [for_the_command(e)], None)
    wrong = [f for f in taken.faults if f.wrong]
    assert [f.kind for f in wrong] == [EXCHANGED]
    assert wrong[0].sentence.startswith("the command of recording moves like a mass")


def test_outputs_in_another_unit_are_not_exchanged() -> None:
    """In inches the first fits the other's place better by its size, and not by its shape.

    Two carts on springs by a device file that is off by up to a half. Mutation: sizes alone decide.
    """
    told = CARTS.with_chain(make_chain([0.755, 0.755], [5.0, 5.0], 706.0, [302.0], [1.0]))
    true = CARTS.with_chain(make_chain([0.85, 0.4], [2.2, 0.93], 829.0, [338.0], [0.03]))
    period = 0.005
    told, true = (d.with_interface(period=period) for d in (told, true))
    command = 1.5 * np.repeat(np.random.default_rng(1).standard_normal(60), 20)
    run = simulate(true, recorded(command), duration=6.0)
    q = np.column_stack([run.trace["position_m1"], run.trace["position_m2"]])
    q = 1.8e-5 * np.round(q / 1.8e-5)
    outputs = (Output("position", 0), Output("position", 1))
    for factor in (1.0, 1.0 / 0.0254, 1e3, 1e-3):
        measured = q * np.array([factor, 1.0])
        e = Experiment(period, command, measured, outputs, "r", float(measured[:, 0].std()))
        assert not in_place(told, e)[1]


def test_a_slow_motion_in_the_place_of_a_command_is_named_though_it_is_nearly_one_line() -> None:
    """Half a second of a rack drive. Mutation: nothing is asked where the command is one line."""
    device = CARTS.with_chain(make_chain([20.0], [50.0], 0.0, [], []))
    command = 20.0 * np.repeat([1.0, -1.0, 0.3, 0.0], [120, 100, 60, 120])
    run = simulate(device, recorded(command), duration=0.8)
    q = run.trace["position_m1"]
    q = q + 1e-3 * q.std() * np.random.default_rng(0).standard_normal(q.size)
    e = Experiment(0.002, command, q[:, None], (Output("position", 0),), "r", float(q.std()))
    assert one_tone(q)
    assert not in_place(device, e)[1]
    assert [f.kind for f in in_place(device, for_the_command(e))[1]] == [EXCHANGED]
    off = replace(for_the_command(e), strengths=np.where(np.arange(400) < 395, 1.0, 0.0))
    assert not in_place(device, off)[1]  # it did not act


@pytest.mark.parametrize("hz", [2.0, 5.0, 10.0])
@pytest.mark.parametrize("noise_of", [1e-3, 1e-2, 0.2])
def test_a_free_mass_that_drifts_under_a_sine_is_sound(hz: float, noise_of: float) -> None:
    """Its motion is no tone. Mutation: asked where the motion is not one, whatever the command."""
    device = CARTS.with_chain(make_chain([1.0], [2.0], 0.0, [], []))
    command = np.sin(2.0 * np.pi * hz * 0.002 * np.arange(2000))
    run = simulate(device, recorded(command), duration=4.0)
    q = run.trace["position_m1"]
    q = q + noise_of * q.std() * np.random.default_rng(1).standard_normal(q.size)
    e = Experiment(0.002, command, q[:, None], (Output("position", 0),), "r", float(q.std()))
    assert not in_place(device, e)[1]


def test_a_command_of_one_tone_does_not_tell_which_is_which() -> None:
    """Mutation: asked of any command; of a slow sine the velocity, rough by its encoder, drives."""
    t = 1e-3 * np.arange(8000)
    assert one_tone(2.5 * np.sin(2.0 * np.pi * 4.0 * t))
    assert not one_tone(np.sign(np.sin(2.0 * np.pi * 0.5 * t)))
    assert not one_tone(np.random.default_rng(0).standard_normal(t.size))
