"""A sign or unit that is wrong is a hypothesis beside physics: proposed, searched, and priced."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tests.diagnosis_examples import OUTPUTS, phantom, record
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.intake import gate
from zwidth.diagnosis.intake.driven import driven
from zwidth.diagnosis.intake.gate import COMMAND, corrected, misread, suspicion
from zwidth.diagnosis.intake.rectified import unfolded
from zwidth.diagnosis.intake.take_in import Taken, judged_anew, likeliest, misread_price, readings
from zwidth.diagnosis.intake.units import nearest_unit, sentence, unit_of
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.steady import NoObserver
from zwidth.diagnosis.recording.experiment import Experiment, ExperimentError, Output
from zwidth.diagnosis.selection.effort import QUICK
from zwidth.diagnosis.selection.hypothesis import judged
from zwidth.diagnosis.selection.search import Search, search
from zwidth.sim.chain import Chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import simulate
from zwidth.sim.uncertainty import Uncertainty

DEGREES = 180.0 / math.pi
PERIOD = 0.002


def motor(encoder_step: float = 0.0) -> Device:
    """One mass with a damper, read at 500 Hz."""
    chain = Chain(np.array([1e-3]), np.array([5e-3]), 0.0, np.zeros(0), np.zeros(0))
    interface = Interface(period=PERIOD, delay=0.0, encoder_step=encoder_step)
    return Device("motor", "", True, chain, interface)


def driven_motor(ticks: int, seed: int = 1, truth: Device | None = None) -> Experiment:
    """Position and velocity of a motor under steps of torque, with noise of both."""
    random = np.random.default_rng(seed)
    command = np.repeat(0.05 * random.standard_normal(ticks // 5 + 1), 5)[:ticks]
    run = simulate(truth or motor(), recorded(command), duration=ticks * PERIOD)
    names = ("position_m1", "velocity_m1")
    noise = np.array([1e-4, 1e-2]) * random.standard_normal((ticks, 2))
    measured = np.column_stack([run.trace[name] for name in names]) + noise
    return Experiment(PERIOD, command, measured, (*OUTPUTS, Output("velocity", 0)))


def position_alone(e: Experiment) -> Experiment:
    return replace(e, measured=e.measured[:, :1].copy(), outputs=e.outputs[:1])


def factors(device: Device, e: Experiment) -> list[dict[tuple[str, ...], float]]:
    """What each way that is suspected multiplies which channels by."""
    return [{f.channels: f.value for f in way} for way in suspicion(device, e).ways]


@pytest.mark.parametrize("ticks", [300, 500, 3000])
@pytest.mark.parametrize("factor", [-1.0, DEGREES, 1.0 / DEGREES, 1000.0, 1e-3, 3.46, 1.0])
def test_command_is_suspected_also_of_few_ticks(ticks: int, factor: float):
    """Mutations that break it: 100 ticks left out whatever there are; the scale told once only;
    masses off under the command as it is (a thousand times too large, it is then not missed).
    """
    e = position_alone(driven_motor(ticks))
    found = factors(motor(), replace(e, command=e.command / factor))
    if factor == 1.0:
        assert found == []
    else:
        assert found[0][COMMAND] == pytest.approx(factor, rel=0.15)
        assert found[1][("position_m1",)] == pytest.approx(1.0 / factor, rel=0.15)


def test_a_scale_that_the_device_file_leaves_open_is_no_wrong_unit():
    """A guessed file of volts: three standard deviations of ln scale. Mutation: LEFT_OPEN = 0."""
    e = position_alone(driven_motor(1000))
    tenth = replace(e, command=0.1 * e.command)
    backwards = replace(e, command=-0.1 * e.command)
    guessed = replace(motor(), uncertainty=Uncertainty(command_scale=1.0))
    assert suspicion(motor(), tenth).ways
    assert not suspicion(guessed, tenth).ways
    assert factors(guessed, backwards)[0] == {COMMAND: -1.0}
    assert suspicion(guessed, replace(e, command=1e-4 * e.command)).ways


def test_masses_that_are_left_open_leave_the_scale_open_but_not_the_sign():
    """Of a device that was fitted to the recording the scale says nothing.

    Mutation: the uncertainty of the command's scale alone.
    """
    e = position_alone(driven_motor(1000))
    backwards = replace(e, command=-0.25 * e.command)
    fitted = replace(motor(), uncertainty=Uncertainty(masses=0.5))
    assert factors(fitted, backwards)[0] == {COMMAND: -1.0}
    assert factors(motor(), backwards)[0][COMMAND] == pytest.approx(-4.0, rel=0.15)
    assert not suspicion(fitted, replace(e, command=0.25 * e.command)).ways


def test_drag_and_friction_that_no_device_file_knows_are_no_wrong_unit():
    """The device moves a tenth as far as its file says.

    Mutation that breaks it: no forces beside the scale.
    """
    strong = motor().with_physics(
        make_physics("quadratic_drag", "m1", coefficient=2e-3),
        make_physics("coulomb_friction", "m1", level=0.02),
    )
    e = position_alone(driven_motor(1500, truth=strong))
    assert suspicion(motor(), e).ways == ()
    told = driven(motor(), e)
    assert told is not None
    assert told.gained < 40.0


@pytest.mark.parametrize("factor", [1.0, -1.0, DEGREES])
def test_a_velocity_that_goes_with_its_position_is_not_read_wrong_alone(
    factor: float, monkeypatch: pytest.MonkeyPatch
):
    """An eccentric encoder beside two frictions had the sign of a velocity taken for wrong.

    Mutations that break it: no look at the other sensor; a slope one way alone.
    """
    e = driven_motor(1000)
    seen = gate._seen

    def velocity_seems_off(device: Device, e: Experiment, o: int) -> gate._Seen:
        off = replace(seen(device, e, o), scale=1.0 / factor, off=True)
        return replace(off, scale=-1.0) if factor == 1.0 else off

    monkeypatch.setattr(
        gate, "_seen", lambda d, e, o: velocity_seems_off(d, e, o) if o else seen(d, e, o)
    )
    read = replace(e, measured=e.measured * np.array([1.0, factor]))
    noisy = replace(read, measured=read.measured * np.array([1e-3, 1.0]))
    assert (factors(motor(), read) == []) is (factor == 1.0)
    assert not gate._tell_the_same(noisy, 1, 0)


def test_noise_that_a_feedback_puts_into_the_command_takes_no_energy_out():
    """Coarse velocity under strong damping: command and velocity of one tick go against each other.

    Mutations that break it: the velocity of the same tick as the command; a scale that is told
    by the next sample alone.
    """
    random = np.random.default_rng(4)
    push = np.repeat(0.02 * random.standard_normal(801), 5)[:4000]
    coarse, x, v = 5e-3, 0.0, 0.0
    y, u = np.zeros(4000), np.zeros(4000)
    for k in range(4000):
        y[k] = coarse * round(x / coarse)
        speed = (y[k] - y[k - 1]) / PERIOD if k else 0.0
        u[k] = push[k] - 0.02 * speed
        before, v = v, v + PERIOD * (u[k] - 5e-3 * v) / 1e-3
        x += PERIOD * 0.5 * (before + v)
    speeds = np.diff(y, prepend=y[0]) / PERIOD
    assert np.corrcoef(u, speeds)[0, 1] < -0.1
    e = Experiment(PERIOD, u, speeds[:, None], (Output("velocity", 0),))
    assert suspicion(motor(coarse), e).ways == ()
    assert factors(motor(coarse), replace(e, command=-u))[0] == {COMMAND: -1.0}


def test_a_second_output_tells_which_channel_is_wrong():
    """Mutation that breaks it: the outputs asked together."""
    e = driven_motor(2000)
    degrees = corrected(e, [misread(e, ("position_m1",), DEGREES)])
    assert factors(motor(), degrees)[0] == {("position_m1",): pytest.approx(1.0 / DEGREES)}
    turned = corrected(e, [misread(e, ("velocity_m1",), -1.0)])
    assert factors(motor(), turned)[0] == {("velocity_m1",): -1.0}
    less = replace(e, command=e.command / DEGREES)
    assert factors(motor(), less)[0] == {COMMAND: pytest.approx(DEGREES)}


def test_steps_of_the_device_file_vouch_for_an_output():
    """Mutation that breaks it: steps not looked at."""
    step = 1e-3
    e = position_alone(driven_motor(2000))
    e = replace(e, measured=step * np.round(e.measured / step))
    assert factors(motor(step), replace(e, command=e.command / DEGREES)) == [
        {COMMAND: pytest.approx(DEGREES)}
    ]
    degrees = corrected(e, [misread(e, ("position_m1",), DEGREES)])
    assert factors(motor(step), degrees)[0] == {("position_m1",): pytest.approx(1.0 / DEGREES)}


def test_a_motion_to_one_side_is_not_folded_out():
    """Readings of a motion that goes one way, turned: a wrong sign, and no absolute values.

    Mutation that breaks it: BOTH = 0.
    """
    command = -0.02 + 0.005 * np.random.default_rng(5).standard_normal(1500)
    run = simulate(motor(), recorded(command), duration=1500 * PERIOD)
    y = np.abs(run.trace["position_m1"])
    e = Experiment(PERIOD, command, y[:, None], OUTPUTS)
    assert unfolded(motor(), e) is None
    assert factors(motor(), e)[0] == {COMMAND: -1.0}


def taken_of(e: Experiment, channels: tuple[str, ...], factor: float) -> Taken:
    fault = misread(e, channels, factor)
    whole = (corrected(e, [fault]),)
    return Taken(motor(), whole, whole, (), (fault,), 1.0, False, (), ((0, fault),))


@pytest.mark.parametrize("factor", [1e3, 1e-2])
def test_the_choice_does_not_depend_on_the_unit_that_an_output_is_written_in(factor: float):
    """A linear device says the same under a corrected output and under a corrected command.

    Mutations that break it: the sign of the Jacobian; its samples without `SETTLING`.
    """
    e = position_alone(driven_motor(1500))
    other = replace(e, measured=e.measured * factor)

    def cost(taken: Taken) -> float:
        model = Model(motor())
        h = judged(taken.fit_on, model, np.zeros(model.linear_count))
        return h.cost.misfit + misread_price(taken)

    output = cost(taken_of(other, ("position_m1",), 1.0 / factor))
    assert output == pytest.approx(cost(taken_of(other, COMMAND, factor)), abs=0.1)
    assert misread_price(taken_of(e, COMMAND, -1.0)) == pytest.approx(-2.0 * math.log(1e-2 / 0.99))


def test_the_rarity_of_a_fault():
    """Mutations that break it: a factor of no unit as likely as one; each recording priced anew."""
    e = position_alone(driven_motor(400))
    unit = misread_price(taken_of(e, COMMAND, DEGREES))
    assert misread_price(taken_of(e, COMMAND, 3.46)) > unit + 2.0 * math.log(99.0)
    one = taken_of(e, COMMAND, -1.0)
    fault = one.faults[0]
    both = replace(one, fit_on=(e, e), misread=((0, fault), (1, fault)))
    assert misread_price(both) == pytest.approx(misread_price(one))
    three = replace(one, fit_on=(e, e, e), misread=((0, fault), (1, fault)))
    assert misread_price(three) == pytest.approx(2.0 * misread_price(one))


def test_the_least_cost_is_kept_and_what_costs_as_much_is_said():
    """Mutations that break it: the price left out; a reading that no observer follows kept."""
    e = position_alone(driven_motor(400))
    plain = Taken(motor(), (e,), (e,), (), (), 1.0, False, ())
    command, output = taken_of(e, COMMAND, -1.0), taken_of(e, ("position_m1",), -1.0)

    def costs(*values: float) -> tuple[Taken, int]:
        every = [plain, command, output]

        def asked(taken: Taken) -> tuple[float, int]:
            place = next(i for i, one in enumerate(every) if one is taken)
            if math.isinf(values[place]):
                raise NoObserver("none")
            return values[place], place

        return likeliest(every, asked)

    assert costs(0.0, -9.0, -9.0)[1] == 0
    assert costs(0.0, -50.0, -20.0)[1] == 1
    assert "nothing tells" not in costs(0.0, -50.0, -20.0)[0].faults[0].sentence
    said = costs(0.0, -50.0, -49.0)[0].faults[0].sentence
    assert "or position_m1 may be wrong instead" in said
    assert costs(math.inf, math.inf, 0.0)[1] == 2
    with pytest.raises(NoObserver):
        costs(math.inf, math.inf, math.inf)


@pytest.mark.truth
def test_a_search_of_each_reading_decides():
    """A command that counts too little by no unit, and one that is sound but suspected.

    Mutation that breaks it: the first reading that is suspected kept.
    """

    def asked(taken: Taken) -> tuple[float, Search]:
        found = search(motor(), taken.fit_on, QUICK)
        return found.best.cost.total, found

    sound = position_alone(driven_motor(1000))
    e = replace(sound, command=sound.command / 5.0)
    every = readings(motor(), [e], None)
    assert [len(one.misread) for one in every] == [0, 1, 1]
    kept, _ = likeliest(every, asked)
    assert [(f.kind, f.channels) for f in kept.faults if f.wrong] == [("command_scale", COMMAND)]
    assert kept.faults[0].value == pytest.approx(5.0, rel=0.15)
    assert "times too small" in kept.faults[0].sentence
    assert len(readings(motor(), [sound], None)) == 1
    (whole,) = readings(motor(), [sound], None)
    wrong = taken_of(whole.fit_on[0], COMMAND, -1.0)
    assert likeliest([whole, wrong], asked)[0] is whole


@pytest.mark.parametrize(("factor", "kind"), [(DEGREES, "command_scale"), (-1.0, "command_sign")])
def test_a_unit_or_a_sign_that_no_physics_stands_for_needs_no_search(factor: float, kind: str):
    """Mutation that breaks it: what may be wrong as well left out with its reading."""
    sound = position_alone(driven_motor(1000))
    (taken,) = readings(motor(), [replace(sound, command=sound.command / factor)], None)
    (fault,) = (f for f in taken.faults if f.wrong)
    assert (fault.kind, fault.channels) == (kind, COMMAND)
    assert fault.value == pytest.approx(factor)
    assert "or position_m1 may be wrong instead" in fault.sentence
    assert ("is the motion in degrees or turns?" in fault.sentence) == (factor > 0.0)


def test_a_fault_belongs_to_its_recording():
    """Mutation that breaks it: the fault of one corrected in all."""
    first, second = (record(phantom(), 2.0, seed=s) for s in (5, 6))
    turned = replace(second, command=-second.command, name="turned")
    (taken,) = readings(phantom(), [first, turned], None)
    assert [f.recording for f in taken.faults if f.wrong] == ["turned"]
    assert np.array_equal(taken.whole[0].command, first.command)
    assert np.array_equal(taken.whole[1].command, second.command)


def test_recordings_to_judge_by_are_corrected_by_what_was_found():
    """Alone, once a device was found; with those to fit on where they share the fault.

    Mutations that break it: judged by the device file; never corrected.
    """
    fit, judge = (record(phantom(), 2.0, seed=s) for s in (5, 6))
    turned = replace(judge, command=-judge.command, name="turned")
    (whole,) = readings(phantom(), [fit], [turned])
    assert whole.doubted
    assert np.array_equal(whole.judge_by[0].command, turned.command)
    anew = judged_anew(whole, phantom())
    assert np.array_equal(anew.judge_by[0].command, judge.command)
    assert [f.recording for f in anew.faults if f.wrong] == ["turned"]
    (both,) = readings(phantom(), [replace(fit, command=-fit.command)], [turned])
    assert np.array_equal(both.judge_by[0].command, judge.command)


@pytest.mark.parametrize("judges", [False, True])
def test_recordings_with_other_outputs_are_refused(judges: bool):
    """Their columns would be mixed up. Mutation: only the recordings to fit are compared."""
    first = record(phantom(), 2.0, seed=5)
    twice = np.column_stack([first.measured, np.gradient(first.measured[:, 0], 1e-3)])
    more = (*OUTPUTS, Output("velocity", 0))
    second = replace(first, measured=twice, outputs=more, name="second")
    second.measured[:, 1] += np.random.default_rng(0).normal(size=first.ticks)  # of its own
    says = r"second has position_m1 and velocity_m1, but \w+ has position_m1; .* the same outputs"
    with pytest.raises(ExperimentError, match=says):
        readings(phantom(), [first] if judges else [first, second], [second] if judges else None)


def test_units_are_named():
    """Mutations that break it: within 30 %; degrees for a device that moves along a line."""
    assert unit_of(57.0) == unit_of(-1.0 / 57.0) == "degrees"
    assert unit_of(50.0) is None
    assert nearest_unit(-40.0, True) == pytest.approx(-DEGREES)
    assert nearest_unit(45.0, False) == pytest.approx(1.0 / 25.4e-3)
    assert nearest_unit(3.46, True) == 3.46
    assert "1000 times too large" in sentence("r", ("position_m1",), 1e-3)
    assert "mm or mN m" in sentence("r", ("position_m1",), 1e-3)


def test_a_command_that_often_reaches_its_largest_value_may_be_clipped():
    """A step that holds its last level is not. Mutation: one stretch is enough."""
    e = driven_motor(2000)
    clipped = replace(e, command=np.clip(e.command, -0.04, 0.04))
    step = np.where(np.arange(2000) < 1000, np.linspace(0.0, 0.05, 2000), 0.06)
    for command, told in ((clipped.command, True), (step, False), (e.command, False)):
        found = gate.oddities(motor(), replace(e, command=command))
        assert ("clipped_command" in [fault.kind for fault in found]) is told
