"""Observers of a population at once: each what its member would have, also where a solver fails."""

import numpy as np
import pytest
from engine_examples import one_mass, phantom
from fitting_examples import drive, play, recording
from lane_examples import varied
from numpy.typing import NDArray

from zwidth.diagnosis.fitting.many import Many
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.noise.predictor import FINAL, innovations
from zwidth.diagnosis.noise.steady import links_with_play, steady, steady_gains, with_apart
from zwidth.diagnosis.recording.experiment import Experiment, Output
from zwidth.sim.physics import make_physics

Floats = NDArray[np.float64]
LAG = make_physics("actuator_lag", "command", time_constant=4e-4)
POSITION, FAR_SPEED = Output("position", 0), Output("velocity", 2)


def seen(*outputs: Output) -> Experiment:
    return Experiment(1e-3, np.zeros(10), np.zeros((10, len(outputs))), outputs)


@pytest.mark.parametrize("ratio", [1e-4, 1e-1, 1e3])
@pytest.mark.parametrize("outputs", [(POSITION,), (POSITION, FAR_SPEED)])
def test_doubling_gives_every_member_its_gain(outputs: tuple[Output, ...], ratio: float) -> None:
    """1e-9 of each column's largest. Mutations: `g` left as it was; one doubling fewer (1e-3)."""
    devices = varied(phantom().with_physics(LAG), None, 5)
    found = steady_gains(devices, seen(*outputs), ratio)
    for gain, device in zip(found, devices, strict=True):
        own = steady(device, seen(*outputs), ratio).gain
        assert np.all(np.abs(gain - own) <= 1e-9 * np.abs(own).max(axis=0))


def test_every_member_may_have_a_ratio_of_its_own() -> None:
    """Mutation: the first member's for all."""
    ratios = np.geomspace(1e-4, 1e4, 5)
    found = steady_gains([phantom()] * 5, seen(POSITION), ratios)
    for gain, ratio in zip(found, ratios.tolist(), strict=True):
        alone = steady_gains([phantom()], seen(POSITION), ratio)[0]
        assert np.allclose(gain, alone, rtol=1e-9, atol=0.0)


def test_a_population_of_velocities_alone_has_gains() -> None:
    """Where the device stands never shows; each member's gain is then found by itself."""
    devices = varied(one_mass(1e-3, 2e-3), None, 3)
    only = seen(Output("velocity", 0))
    expected = [steady(device, only, 1e-2).gain for device in devices]
    assert np.array_equal(steady_gains(devices, only, 1e-2), expected)


def test_a_gain_is_a_fixed_point_where_the_solver_of_one_matrix_fails() -> None:
    """At a ratio of 1e-7, where scipy refuses several of these: finite, and smooth in the ratio.

    Mutation: states in the device's units in `_doubled`.
    """
    devices = varied(phantom(), None, 8)
    found = steady_gains(devices, seen(POSITION), 1e-7)
    assert np.all(np.isfinite(found))
    close = steady_gains(devices, seen(POSITION), 1.0001e-7)
    assert np.all(np.abs(close - found) <= 1e-3 * np.abs(found).max(axis=1, keepdims=True))


THREE = (POSITION, Output("position", 1))


@pytest.mark.parametrize(
    ("links", "outputs", "unseen"),
    [
        ((0,), (POSITION,), (1, 2)),
        ((1,), (POSITION,), (2,)),
        ((0,), THREE, ()),
        ((1,), THREE, (2,)),
        ((0, 1), (POSITION,), (1, 2)),
        ((0, 1), THREE, (2,)),
        ((0,), (FAR_SPEED,), (0,)),
    ],
)
def test_what_lies_behind_a_cut_link_unseen_is_left_alone(
    links: tuple[int, ...], outputs: tuple[Output, ...], unseen: tuple[int, ...]
) -> None:
    """Positions and speeds of its masses; the rest keeps its gain, and in contact all do.

    Mutations: the first link for each; what has an output left alone.
    """
    device, o = phantom().without_physics(), len(outputs)
    n = device.chain.masses.size
    gain = steady(device, seen(*outputs), 1e-2).gain
    both = with_apart(device, links, seen(*outputs), gain)
    apart = both[:, o:]
    assert np.array_equal(both[:, :o], gain)
    left = [i + k * n for i in unseen for k in (0, 1)]
    assert not apart[left].any()
    kept = [i for i in range(2 * n) if i not in left]
    assert np.array_equal(apart[kept], gain[kept])


def test_a_device_with_play_has_both_gains() -> None:
    """Of one and of a family; without play one. Mutation: `steady` as in contact alone."""
    device = phantom().without_physics()
    loose = device.with_physics(make_physics("backlash", "link12", gap=0.01))
    assert links_with_play(device) == ()
    assert links_with_play(loose) == (0,)
    gain = steady(device, seen(POSITION), 1e-2).gain
    found = steady(loose, seen(POSITION), 1e-2).gain
    assert np.array_equal(found, with_apart(device, (0,), seen(POSITION), gain))


@pytest.mark.parametrize("gap", [1e-3, 10.0])
def test_the_second_gain_acts_while_a_pin_is_off_its_sides(gap: float) -> None:
    """Both gains the same are one; of a gap that is never crossed only the second counts.

    By one device and in lanes, to the bit. Mutations: the first gain throughout; the second one
    also in contact; the other side's pin taken for free.
    """
    device = drive().with_physics(play(gap))
    made = recording(drive().with_physics(play(1e-3)), 400, 3)
    contact = steady(drive(), made, 1e-2).gain
    other = 0.5 * contact

    def of(gain: Floats) -> Floats:
        found = innovations(device, made, gain)
        model = Model(device)
        lanes = Many(model, [np.zeros(len(model.parameters))] * 3, FINAL).innovations(made, gain)
        assert np.array_equal(lanes, np.broadcast_to(found, lanes.shape))
        return found

    one, both = of(contact), of(np.hstack([contact, other]))
    assert np.array_equal(of(np.hstack([contact, contact])), one)
    if gap > 1.0:
        assert np.array_equal(both, of(other))
        assert not np.array_equal(both, one)
    else:
        assert np.std(both - of(other)) / np.std(one) > 1e-3
        assert np.std(both - one) / np.std(one) > 1e-3
