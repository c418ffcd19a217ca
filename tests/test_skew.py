"""The skew of the clock: readings that are taken a little after commands act, or before."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from zwidth.controllers.excitation import noise
from zwidth.diagnosis.answer.findings import linear
from zwidth.diagnosis.answer.result import Verdict
from zwidth.diagnosis.diagnose import diagnose
from zwidth.diagnosis.fitting.many import Many
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import SEARCHING, innovations, prepared
from zwidth.diagnosis.noise.steady import read_of
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.predict import alone
from zwidth.sim.reading import Places
from zwidth.sim.run import Start, start_memory

Floats = NDArray[np.float64]
T = 1e-3
ONE = Device("motor", "", True, make_chain([1e-3], [1e-2], 0.0, [], []), Interface(period=T))
TWO = Device(
    "arm", "", True, make_chain([2e-3, 1e-3], [1e-3, 1e-3], 0.0, [30.0], [5e-3]),
    Interface(period=T),
)  # fmt: skip


def read_late(
    device: Device,
    late: float,
    outputs: tuple[Output, ...],
    seconds: float = 2.0,
    noisy: float = 0.0,
) -> Experiment:
    """Return what is read `late` after each command acts, or before: by the matrix exponential."""
    command = 0.05 * noise(duration=seconds, to_hz=60.0, period=T, seed=5)
    plant = device.plant()
    n, size = plant.dof, plant.size
    whole = np.zeros((size + 1, size + 1))
    whole[:size, :size] = plant.a
    whole[n, size] = 1.0 / device.chain.masses[0]
    step, later = expm(whole * T), expm(whole * late if late >= 0.0 else whole * (T + late))
    x = np.zeros((command.size + 1, size))
    for k, u in enumerate(command):
        x[k + 1] = (step @ np.append(x[k], u))[:size]
    rows = (later @ np.column_stack([x[:-1], command]).T).T[:, :size]
    if late < 0.0:  # read in the tick before
        rows = np.vstack([np.zeros(size), rows[:-1]])
    places = [o.mass + n * (o.quantity == "velocity") for o in outputs]
    measured = rows[:, places]
    measured = measured + noisy * np.random.default_rng(1).standard_normal(measured.shape)
    return Experiment(T, command, measured, outputs, "made", float(np.std(measured[:, 0])))


def at(device: Device, late: float) -> tuple[Model, Floats]:
    model = Model(device)
    x = np.zeros(len(model.parameters))
    (i,) = (i for i, p in enumerate(model.parameters) if p.kind == "skew")
    x[i] = late / model.parameters[i].scale
    return model, x


POSITION, SPEED = Output("position", 0), Output("velocity", 0)


@pytest.mark.parametrize(
    ("device", "outputs"),
    [(ONE, (POSITION,)), (ONE, (SPEED,)), (TWO, (POSITION, Output("position", 1)))],
)
@pytest.mark.parametrize("late", [2e-4, -2e-4])
def test_a_model_reads_as_late_as_the_recording(
    device: Device, outputs: tuple[Output, ...], late: float
) -> None:
    """Freely, against the matrix exponential; what is left shrinks as its square.

    Mutations: the sign; no acceleration; no part of the command that acts already.
    """

    def left(late: float, of: float) -> float:
        e = read_late(device, late, outputs)
        model, x = at(device, of)
        seen, eq = model.seen(e, x), prepared(device, SEARCHING).coarse
        blind, none = np.zeros((eq.states, len(outputs))), np.zeros((0, eq.dof))
        begun = start_memory(eq, Start(0.0, 0.0))
        errors = alone(
            eq, eq, seen.places(eq), seen.command, seen.measured, blind, none, begun
        )  # fmt: skip
        return float(np.sqrt(np.mean(errors[2:, 0] ** 2)))

    taken, ignored = left(late, late), left(late, 0.0)
    assert taken < 0.02 * ignored
    order = 0.35 if outputs[0].quantity == "position" else 0.7  # a speed: skew times period
    assert left(0.5 * late, 0.5 * late) < order * taken


def test_in_lanes_it_is_that_of_a_device_alone() -> None:
    """Bit for bit. Mutation: lates of the members left out."""
    e = read_late(TWO, 3e-4, (POSITION, Output("position", 1)), seconds=0.3)
    model, x = at(TWO, 3e-4)
    other = at(TWO, -1e-4)[1]
    gain = np.full((TWO.plant().size, 2), 0.05)
    found = Many(model, [x, other], SEARCHING).innovations(e, gain)
    for own, here in zip(found, (x, other), strict=True):
        single = innovations(
            model.acting(here), model.seen(e, here), gain, ready=prepared(TWO, SEARCHING)
        )
        assert np.array_equal(own, single)


@pytest.mark.parametrize("delay", [0.0, 3e-3])
@pytest.mark.parametrize("output", [POSITION, SPEED])
def test_the_rest_of_a_recording_is_read_as_in_the_whole(output: Output, delay: float) -> None:
    """A command that lasts over the cut changes nothing there, also where the first part is gone.

    Mutations that break it: the change of the first command from 0, which was a kick in the first
    reading of each part (a damper whose motion is prescribed had it 200 times its noise); the delay
    line filled with zeros.
    """
    device = replace(ONE, interface=replace(ONE.interface, delay=delay))
    e = read_late(ONE, 4e-4, (output,), seconds=0.3)
    e = replace(e, command=e.command + 1.0)
    model, x = at(device, 4e-4)
    whole = model.seen(e, x).measured
    first, rest = e.split(0.5)
    late = model.seen(rest, x).measured
    assert np.array_equal(late, whole[first.ticks :])
    alone_there = model.seen(replace(rest, before=None), x).measured
    fresh = 1 + round(delay / T)  # what arrived before is not known
    assert np.array_equal(alone_there[fresh:], late[fresh:])
    assert alone_there[:fresh] == pytest.approx(rest.measured[:fresh], abs=1e-12)
    unread = model.seen(e, np.zeros(x.size)).measured
    assert np.abs(whole - unread).max() > 0.0


def test_an_observer_knows_how_late_it_reads() -> None:
    """A position and some speed, also against the other end of a link. Mutation: no speed."""
    outputs = (Output("position", 0), Output("position", 1, 0), Output("velocity", 0))
    late = tuple(replace(o, late=2e-4) for o in outputs)
    e = replace(read_late(TWO, 0.0, (POSITION,), seconds=0.1), outputs=late)
    c = read_of(e, Places(2, np.tile(np.arange(2), (2, 1))), 4)
    assert c.tolist() == [[1.0, 0.0, 2e-4, 0.0], [-1.0, 1.0, -2e-4, 2e-4], [0.0, 0.0, 1.0, 0.0]]


def fitted(e: Experiment, device: Device = ONE) -> Hypothesis:
    model = Model(device)
    return settled(judged([e], model, np.zeros(len(model.parameters))))


@pytest.mark.parametrize("late", [2.5e-5, -2.5e-5, 5e-4, -5e-4])
def test_a_fit_finds_it_and_the_device_is_not_bent(late: float) -> None:
    """Up to half a sample, either way. Mutation: no such number."""
    e = read_late(ONE, late, (POSITION,), noisy=2e-5)
    told = linear(ONE, fitted(e).fitted, [e])
    assert told["skew"][1].lower - 3e-6 < late < told["skew"][1].upper + 3e-6
    assert told["m1"][1].value == pytest.approx(1e-3, rel=1e-3)


@pytest.mark.parametrize("late", [pytest.param(2.5e-5, marks=pytest.mark.truth), -4e-4])
def test_what_is_read_late_misses_nothing(late: float) -> None:
    """It was "a resonance at 0.0483 Hz, identified". Mutation: no such number."""
    e = read_late(ONE, late, (POSITION,), seconds=4.0)
    step = 1e-4
    e = replace(e, measured=step * np.round(e.measured / step))
    found = diagnose(replace(ONE, interface=replace(ONE.interface, encoder_step=step)), [e])
    assert found.verdict is Verdict.NOTHING_MISSING
    assert found.linear_refit["skew"][1].value == pytest.approx(late, abs=1e-5)
    delay = found.device.interface.delay
    assert delay == (pytest.approx(-late, abs=1e-5) if late < 0.0 else 0.0)
