"""Sensors of two masses that do not count from where the link between them is at rest."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from zwidth.controllers.excitation import noise
from zwidth.controllers.recorded import recorded
from zwidth.diagnosis.answer.findings import linear
from zwidth.diagnosis.intake.take_in import take_in
from zwidth.diagnosis.model.own_values import first_x, varying
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.diagnosis.selection.hypothesis import Hypothesis, judged, settled
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.run import Start, simulate

Floats = NDArray[np.float64]
T, STEP = 0.004, 1e-5
CARTS = Device(
    "carts", "", False, make_chain([0.8, 0.5], [2.0, 1.0], 0.0, [300.0], [0.5]),
    Interface(period=T, encoder_step=STEP),
)  # fmt: skip
BOTH = (Output("position", 0), Output("position", 1))
SPEEDS = (Output("velocity", 0), Output("velocity", 1))


def run(seed: int, zero: float, stretched: float = 0.0) -> Experiment:
    """Two carts; the second encoder reads more by `zero`, and the link begins stretched."""
    command = 4.0 * noise(duration=6.0, to_hz=8.0, period=T, seed=seed)
    start = Start((0.0, stretched), (0.0, 0.0))
    there = simulate(CARTS, recorded(command), duration=6.0, substeps=10, start=start).trace
    q = np.column_stack([there["position_m1"], there["position_m2"] + zero])
    q = q + STEP * np.random.default_rng(seed).standard_normal(q.shape)
    return Experiment(T, command, q, BOTH, f"run{seed}", float(q[:, 0].std()))


def fitted(device: Device, es: list[Experiment]) -> Hypothesis:
    model = Model(device, varying=varying(device, es))
    return settled(judged(es, model, first_x(model, es)))


def opened(zeros: float) -> Device:
    return replace(CARTS, uncertainty=replace(CARTS.uncertainty, zeros=zeros))


def test_each_recording_has_the_zero_that_its_second_encoder_was_switched_on_at() -> None:
    """Mutations: one zero in all recordings; taken off the first mass; off velocities, too."""
    es = [run(1, 3e-3), run(2, -2e-3)]
    es = [replace(e, swing=es[0].swing) for e in es]
    h = fitted(opened(0.01), es)
    told = linear(opened(0.01), h.fitted, es)
    assert told["zero_m2"][1].value == pytest.approx(3e-3, abs=2e-5)
    assert told["zero_m2 in run2"][1].value == pytest.approx(-2e-3, abs=2e-5)
    assert told["zero_m2"][1].unit == "m"
    assert told["k12"][1].value == pytest.approx(300.0, rel=0.01)
    # As known they are, the link would have to be stretched for ever.
    assert fitted(CARTS, es).cost.misfit > h.cost.misfit + 1000.0


def test_a_device_reads_the_same_alone_and_among_many() -> None:
    """Mutation: zeros in one of the two alone."""
    e = run(3, 1e-3)
    model = Model(opened(0.01))
    place = [p.name for p in model.parameters].index("zero_m2")
    xs = np.zeros((3, len(model.parameters)))
    xs[:, place] = 0.1, -0.2, 0.3
    zeros = model.reads_each(xs)[3]
    for x, own in zip(xs, zeros, strict=True):
        assert model.reads(x).zeros == tuple(own) == (0.0, model.parameters[place].scale * x[place])
        assert model.reads(x).offsets(e) == pytest.approx([0.0, own[1]])
    moved = model.seen(e, xs[0]).measured - e.measured
    assert np.ptp(moved) == pytest.approx(1e-3)


def test_velocities_that_were_counted_leave_the_zeros_open() -> None:
    """From a link that is stretched where they begin. Mutation: a device that is taken as it is."""
    e = run(4, 0.0, stretched=4e-3)
    counted = STEP * np.round(e.measured / STEP)
    speeds = np.diff(counted, axis=0, prepend=counted[:1]) / T
    rates = replace(e, measured=speeds, outputs=SPEEDS)
    taken = take_in(CARTS, [rates], None)
    assert taken.fit_on[0].outputs == BOTH
    assert 1e-4 < taken.device.uncertainty.zeros < 1e-2
    h = fitted(taken.device, list(taken.fit_on))
    told = linear(taken.device, h.fitted, taken.fit_on)
    assert told["zero_m2"][1].value == pytest.approx(-4e-3, abs=2e-4)
    assert take_in(CARTS, [e], None).device == CARTS  # positions count from where they say
