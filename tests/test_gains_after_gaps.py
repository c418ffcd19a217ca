"""An observer's gains over lost samples and after them, against Kalman's filter written out."""

from dataclasses import replace

import numpy as np
import pytest
from fitting_examples import drive, play, recording
from numpy.typing import NDArray

from zwidth.diagnosis.noise import gaps
from zwidth.diagnosis.noise.gaps import Returning, along, returning, schedule
from zwidth.diagnosis.noise.predictor import SETTLING, followed, innovations
from zwidth.diagnosis.noise.settle import refit
from zwidth.diagnosis.noise.steady import FLOOR, Spread, noise_scale, read_of, spread, steady
from zwidth.diagnosis.recording.experiment import Experiment, Output, uncounted
from zwidth.sim.device import Device
from zwidth.sim.plant import hold
from zwidth.sim.reading import Places

Floats = NDArray[np.float64]
Lost = NDArray[np.bool_]
RATIO = 1e-2
OUTPUTS = {
    "a position": (Output("position", 0),),
    "two positions": (Output("position", 0), Output("position", 1)),
    "a velocity": (Output("velocity", 0),),  # where the device stands never shows
    "a deflection": (Output("position", 0), Output("position", 0, 1)),
}


def lost_at(ticks: int, *gaps: tuple[int, int]) -> Lost:
    lost = np.zeros(ticks, dtype=np.bool_)
    for first, count in gaps:
        lost[first : first + count] = True
    return lost


def moved(outputs: tuple[Output, ...], ticks: int = 600) -> Experiment:
    """Return a recording of the drive, with outputs of numbers that are no motion of it."""
    random = np.random.default_rng(2)
    measured = np.cumsum(random.standard_normal((ticks, len(outputs))), axis=0)
    return Experiment(2e-3, random.standard_normal(ticks), measured, outputs)


def of_one(known: Spread) -> Spread:
    p, motion, c, process, noise = known
    return Spread(p[None], motion[None], c, process[None], noise)


def kalman(device: Device, e: Experiment, lost: Lost, p: Floats) -> tuple[Floats, Floats]:
    """Return gains (ticks, states, o) of Kalman's filter from P, and P at the end of it."""
    plant = device.plant()
    a, b = hold(plant, e.period)
    c = read_of(e, Places(plant.dof, device.reading().reads), plant.size)
    source = b[:, 1] * float(plant.matrices.mass.trace()) / e.period**2
    q = RATIO * np.outer(source, source) + FLOOR * np.eye(plant.size)
    r, gains = np.diag(noise_scale(e) ** 2), np.zeros((e.ticks, plant.size, c.shape[0]))
    for k, gone in enumerate(lost):
        gains[k] = np.linalg.solve(c @ p @ c.T + r, c @ p).T
        if not gone:
            left = np.eye(plant.size) - gains[k] @ c
            p = left @ p @ left.T + gains[k] @ r @ gains[k].T  # by Joseph: another way
        p = a @ p @ a.T + q
    return gains, p


@pytest.mark.parametrize("outputs", OUTPUTS.values(), ids=OUTPUTS)
def test_gains_are_those_of_kalmans_filter(outputs: tuple[Output, ...]) -> None:
    """Of single gaps, of gaps before the last one is forgotten, and of gaps at random.

    Mutations: a lost sample that corrects; P kept over a gap; the noise of one tick for the gap's;
    every P taken for the steady one.
    """
    device, e = drive(), moved(outputs)
    random = np.random.default_rng(1).random(e.ticks) < 0.3
    random[:10] = False
    for lost in (lost_at(e.ticks, (50, 10), (200, 1), (203, 3), (208, 10)), random):
        known = spread(device, e, RATIO)
        expected, _ = kalman(device, e, lost, known.p)
        which, found = schedule(of_one(known), lost)
        steady_gain = steady(device, e, RATIO).gain
        scale = np.abs(steady_gain).max(axis=1)[:, None] + 1e-12
        off = np.abs(found[which, 0] - expected) / scale
        assert off[~lost].max() < 2e-3
        assert (np.abs(expected - steady_gain) / scale)[~lost].max() > 0.1


@pytest.mark.parametrize("outputs", OUTPUTS.values(), ids=OUTPUTS)
def test_a_recording_with_gaps_is_followed_as_kalmans_filter_does(
    outputs: tuple[Output, ...],
) -> None:
    """One device, and in parts: what was recorded before is gone through first.

    Mutations: the gain of the tick before; ticks counted from the part's own first.
    """
    device, e = drive(), moved(outputs)
    lost = lost_at(e.ticks, (150, 10), (300, 1), (303, 3), (420, 7))
    e = replace(e, bridged=lost, uncounted=lost, start=None)
    gain = returning(device, [e], RATIO, steady(device, e, RATIO).gain)
    assert isinstance(gain, Returning)
    gains, _ = kalman(device, e, lost, gain.spread.p)
    plant = device.plant()
    a, b = hold(plant, e.period)
    c = gain.spread.c
    found = innovations(device, e, gain)
    x, expected = np.zeros(plant.size), np.zeros(found.shape)
    first = e.measured[0, 0] if outputs[0].quantity == "position" else 0.0
    slope = (np.arange(10) - 4.5) / 82.5
    speed = (
        float(slope @ e.measured[:10, 0]) / e.period
        if outputs[0].quantity == "position"
        else float(e.measured[:5, 0].mean())
    )
    x[: plant.dof], x[plant.dof :] = first, speed
    for k in range(e.ticks):
        expected[k] = e.measured[k] - c @ x
        if not lost[k]:
            x = x + gains[k] @ expected[k]
        x = a @ x + b[:, 0] * e.command[k]
    expected[lost] = 0.0
    size = np.std(expected, axis=0)
    np.testing.assert_allclose(found / size, expected / size, atol=2e-3)
    steadily = innovations(device, e, gain.steady)
    assert np.abs((steadily - expected) / size).max() > 0.1
    head, tail = e.part(0, 305), e.part(305, e.ticks)  # cut while the gap before is not forgotten
    rest = innovations(device, replace(tail, before=head), gain)
    np.testing.assert_allclose(rest, found[305:], atol=1e-9 * np.abs(found).max())


def test_what_moves_is_followed_over_gaps_too() -> None:
    """Positions and velocities as the observer predicts them, also where nothing was measured.

    Mutation: zeros where samples do not count.
    """
    device, e = drive(), moved(OUTPUTS["a position"])
    lost = lost_at(e.ticks, (150, 10))
    e = replace(e, bridged=lost, uncounted=uncounted(lost))
    gain = returning(device, [e], RATIO, steady(device, e, RATIO).gain)
    found = innovations(device, replace(e, uncounted=None), gain)[:, 0]
    states = followed(device, e, gain)
    known = ~lost
    np.testing.assert_allclose((e.measured[:, 0] - states[:, 0])[known], found[known], atol=1e-9)
    assert np.all(states[lost, 0] != 0.0)


def test_lanes_of_several_gains_are_as_one_by_one() -> None:
    """Mutation: the first member's schedule for all."""
    device, e = drive(), moved(OUTPUTS["a position"])
    lost = lost_at(e.ticks, (150, 10), (300, 2))
    e = replace(e, bridged=lost)
    each = [returning(device, [e], r, steady(device, e, r).gain) for r in (1e-6, 1e-2, 1e2)]
    wide, columns = along(each, lost)
    for gain, together in zip(each, wide, strict=True):
        (own,), alone = along([gain], lost)
        for k in np.flatnonzero(~lost).tolist():
            np.testing.assert_allclose(
                together[:, columns[k]], own[:, alone[k]], rtol=5e-3, atol=1e-6 * np.abs(own).max()
            )


def test_a_free_link_keeps_what_it_does_not_tell_after_a_gap_as_well() -> None:
    """Mutation: the second half of the gains as in contact."""
    loose, e = drive().with_physics(play(1e-3)), moved(OUTPUTS["a position"])
    lost = lost_at(e.ticks, (150, 10))
    gain = returning(loose.bare(), [replace(e, bridged=lost)], RATIO, steady(loose, e, RATIO).gain)
    ((wide,), columns) = along([gain], lost)
    half = wide.shape[1] // 2
    unseen = [1, 3]  # position and velocity of the mass behind the play
    assert np.all(wide[unseen, :half] != 0.0)
    assert not wide[unseen, half:].any()
    assert columns[150] == 0 < columns[160]


def test_gaps_that_are_alike_are_met_once() -> None:
    """Mutation: nothing taken for another."""
    device, e = drive(), moved(OUTPUTS["a position"], 20000)
    known = of_one(spread(device, e, RATIO))
    once, _ = schedule(known, lost_at(e.ticks, (50, 10)))
    often, _ = schedule(known, lost_at(e.ticks, *((k, 10) for k in range(50, e.ticks, 1000))))
    assert once[-1] == often[1049] == 0
    assert np.array_equal(np.unique(often), np.unique(once))


def test_more_patterns_than_are_kept_take_the_nearest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gaps, "MOST", 5)
    device, e = drive(), moved(OUTPUTS["a position"])
    lost = np.random.default_rng(1).random(e.ticks) < 0.3
    known = spread(device, e, RATIO)
    which, found = schedule(of_one(known), lost)
    assert found.shape[0] == 5
    assert which.max() == 4


@pytest.mark.parametrize(("length", "every"), [(10, 60), (3, 30)])
def test_gaps_under_a_force_as_large_as_the_command_bias_nothing(length: int, every: int) -> None:
    """The damper of the link, which was wrong by 5 of its errors after gaps of 10, by 2 after 3.

    Mutation: the steady gain throughout.
    """
    wrong = []
    for seed in range(1, 5):
        random = np.random.default_rng(100 + seed)
        e = recording(drive(), 6000, seed, push=0.1 * random.standard_normal(6000))
        lost = np.zeros(e.ticks, dtype=np.bool_)
        for k in range(SETTLING + 50, e.ticks - 20, every):
            lost[k : k + length] = True
        holes = replace(e, bridged=lost, uncounted=uncounted(lost))
        _, fitted = refit(drive(), [holes])
        j = fitted.jacobian[:, np.any(fitted.jacobian != 0.0, axis=0)]
        size = np.sqrt(np.sum(j**2, axis=0))
        spread_of = np.sqrt(np.diag(np.linalg.inv((j / size).T @ (j / size)))) / size
        names = [p.name for p in fitted.model.parameters]
        at = names.index("b12")
        used = np.flatnonzero(np.any(fitted.jacobian != 0.0, axis=0)).tolist()
        wrong.append(fitted.x[at] / spread_of[used.index(at)])
    assert abs(np.mean(wrong)) < 1.5
