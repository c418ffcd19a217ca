"""Many devices along one recording: each as if it were alone, and what of it is kept."""

from dataclasses import replace

import numpy as np
import pytest
from engine_examples import coulomb, phantom
from lane_examples import varied
from physics_examples import EVERYWHERE, example
from population_examples import OUTPUTS, TICKS, gain, own_innovations, recorded, start

from zwidth.controllers.recorded import recorded as played
from zwidth.jobs.parallel import in_parallel
from zwidth.sim.device import Device
from zwidth.sim.equations import equations
from zwidth.sim.lane_type import WIDTH
from zwidth.sim.population import Population, Readings, Recorded
from zwidth.sim.predict import Gains, alone, copied, freely
from zwidth.sim.run import Start, simulate, start_memory


@pytest.mark.parametrize(("name", "place"), EVERYWHERE)
def test_every_member_is_predicted_as_if_it_were_alone(name: str, place: str) -> None:
    """Mutations: the fine substeps for all lanes where one turns; one lane's locked set for all."""
    devices = varied(phantom(), example(name, place), 5)
    population = Population(devices, 2, 4)
    q = start(population)
    memories = population.start(q, np.zeros_like(q))
    found = population.follow(recorded(), memories, Readings(gain(devices)), keep=True)
    for i, device in enumerate(devices):
        alone_found = own_innovations(device, 2, 4, q[i], gain(devices))
        assert np.array_equal(found.innovations[i], alone_found, equal_nan=True)


def delayed() -> list[Device]:
    """More members than a group has, with delays on both sides of a whole tick, and friction."""
    devices = varied(phantom(), coulomb(4e-3), WIDTH + 3)
    spread = np.linspace(1.6e-3, 2.6e-3, len(devices))
    return [d.with_interface(delay=float(t)) for d, t in zip(devices, spread, strict=True)]


def test_members_of_any_delay_and_their_threads_change_nothing() -> None:
    """Mutation: groups by effects alone."""
    devices = delayed()
    population = Population(devices, 1, 4)
    q = start(population)
    memories = population.start(q, np.zeros_like(q))
    readings = Readings(gain(devices))
    one = population.follow(recorded(), memories, readings, keep=True)
    four = population.follow(
        recorded(), memories, readings, keep=True, run_all=lambda tasks: in_parallel(tasks, 4)
    )
    assert np.array_equal(one.innovations, four.innovations, equal_nan=True)
    for i in (0, 7, len(devices) - 1):
        alone_found = own_innovations(devices[i], 1, 4, q[i], gain(devices))
        assert np.array_equal(one.innovations[i], alone_found, equal_nan=True)


def test_readings_are_what_they_say() -> None:
    """Gain of the command, origin and jitter: as the recording changed beforehand, to the bit."""
    devices = varied(phantom(), None, 3)
    population = Population(devices, 1, 1)
    q = start(population)
    memories = population.start(q, np.zeros_like(q))
    r = replace(recorded(), arriving=np.random.default_rng(8).normal(size=TICKS))
    gains, shift = np.array([0.9, 1.0, 1.2]), np.array([[1e-4, 0.0], [0.0, 0.0], [2e-4, 1e-3]])
    jitters = np.array([[0.0, 1e-3], [0.0, 0.0], [2e-5, 0.0]])
    readings = Readings(gain(devices), gains, shift, jitters)
    found = population.follow(r, memories, readings, keep=True).innovations
    assert r.arriving is not None
    for i in range(3):
        y = r.measured - shift[i] - jitters[i] * r.arriving[:, None]
        changed = Recorded(gains[i] * r.command, y, OUTPUTS)
        own = population.follow(changed, memories, Readings(gain(devices)), keep=True)
        assert np.array_equal(found[i], own.innovations[i], equal_nan=True)


def test_costs_are_those_of_the_innovations_whitened() -> None:
    """1e-10 against filters of scipy. Mutations: a tap too few; the skipped ticks counted."""
    from scipy.signal import lfilter

    devices = varied(phantom(), coulomb(4e-3), 4)
    population = Population(devices, 1, 4)
    q = start(population)
    memories = population.start(q, np.zeros_like(q))
    filters = np.random.default_rng(6).normal(size=(2, 2, 5))
    found = population.follow(
        recorded(), memories, Readings(gain(devices)), filters, skipped=100, keep=True
    )
    for i in range(4):
        e = np.nan_to_num(found.innovations[i], nan=0.0)
        white = np.column_stack(
            [sum(lfilter(filters[a, b], [1.0], e[:, b]) for b in range(2)) for a in range(2)]
        )[100:]
        np.testing.assert_allclose(found.moments[i], white.T @ white, rtol=1e-10)
    n = TICKS - 100
    expected = [n * np.linalg.slogdet(m / n)[1] for m in found.moments]
    np.testing.assert_allclose(found.costs(), expected, rtol=1e-12)


def test_a_recording_may_be_taken_in_parts() -> None:
    """The memories at the end go on, to the bit."""
    devices = varied(phantom(), coulomb(4e-3), 3)
    population = Population(devices, 1, 4)
    q = start(population)
    memories = population.start(q, np.zeros_like(q))
    readings, r = Readings(gain(devices)), recorded()
    whole = population.follow(r, memories, readings, keep=True)
    cut = 333
    first = replace(r, command=r.command[:cut], measured=r.measured[:cut])
    second = replace(r, command=r.command[cut:], measured=r.measured[cut:])
    one = population.follow(first, memories, readings, keep=True)
    two = population.follow(second, one.memories, readings, keep=True)
    joined = np.concatenate([one.innovations, two.innovations], axis=1)
    assert np.array_equal(joined, whole.innovations, equal_nan=True)


def test_free_runs_are_simulations() -> None:
    """In two windows, against `simulate` of each member, to the bit. Mutation: a gain of 1e-9."""
    devices = varied(phantom(), coulomb(4e-3), 3)
    population = Population(devices, 4, 4)
    q = start(population)
    command = recorded().command
    first, between = population.simulate(
        command[:333], OUTPUTS, population.start(q, np.zeros_like(q))
    )
    second, _ = population.simulate(command[333:], OUTPUTS, between)
    found = np.concatenate([first, second], axis=1)
    for i, device in enumerate(devices):
        run = simulate(
            device, played(command), duration=TICKS * 1e-3, start=Start(q[i].tolist()), substeps=4
        )
        motions = [run.trace["position_m1"], run.trace["velocity_m2"]]
        assert np.array_equal(found[i], np.column_stack(motions))


def test_a_member_that_overflows_costs_itself_alone() -> None:
    """Mutation: a dead lane's innovations left as they are."""
    devices = varied(phantom(), coulomb(4e-3), 5)
    wild = devices[2].chain
    devices[2] = devices[2].with_chain(wild._replace(ground_dampers=wild.ground_dampers - 50.0))
    population = Population(devices, 1, 4)
    q = start(population)
    memories = population.start(q, np.zeros_like(q))
    found = population.follow(recorded(), memories, Readings(gain(devices)), keep=True)
    finite = np.isfinite(found.costs())
    assert finite.tolist() == [True, True, False, True, True]
    assert np.isinf(found.innovations[2, -1]).all()
    others = Population(devices[3:], 1, 4)
    own = others.follow(recorded(), memories[3:], Readings(gain(devices)), keep=True)
    assert np.array_equal(own.innovations, found.innovations[3:], equal_nan=True)


def test_a_member_with_too_few_substeps_costs_itself_alone() -> None:
    """Mutation: `Member.complaint` not asked."""
    devices = varied(phantom(), coulomb(4e-3), 3)
    stiff = devices[1].chain
    devices[1] = devices[1].with_chain(stiff._replace(link_springs=40.0 * stiff.link_springs))
    population = Population(devices, 1, 1)
    q = start(population)
    found = population.follow(
        recorded(), population.start(q, np.zeros_like(q)), Readings(gain(devices))
    )
    assert np.isfinite(found.costs()).tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("devices", "message"),
    [
        ([], "a population of no devices"),
        ([phantom(), phantom().with_physics(coulomb(1e-3))], "differ in masses, effects or places"),
    ],
)
def test_what_is_no_population_is_refused(devices: list[Device], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Population(devices, 1, 1)


def test_observers_of_the_wrong_shape_are_refused() -> None:
    population = Population([phantom()], 1, 1)
    q = np.zeros((1, 3))
    with pytest.raises(ValueError, match=r"\(6, 2\) or \(members, 6, 2\) is needed"):
        population.follow(recorded(), population.start(q, q), Readings(np.zeros((5, 2))))


@pytest.mark.parametrize("gains", ["steady", "changing"])
def test_free_runs_of_one_call_are_those_of_many(gains: str) -> None:
    """To the bit, with a drive that is off for a while, and a gain that changes.

    Mutations: a run that goes on from the one before; rows kept from the first run's on; a gain
    counted from the run's own first tick.
    """
    device, r = varied(phantom(), coulomb(4e-3), 1)[0], recorded()
    eq, fine = equations(device, 4), equations(device, 16)
    observer: np.ndarray | Gains = gain([device])
    if gains == "changing":
        columns = 2 * (np.arange(TICKS) // 100 % 2)
        observer = Gains(np.hstack(2 * [observer, 0.5 * observer]), columns)  # as many at play
    strengths, none = np.ones(TICKS), np.zeros((0, eq.dof))
    strengths[300:340] = 0.0
    runs = np.array([[0, 50], [100, 50], [100, 300], [350, 350]])
    start_at = Start([1e-3, 0.0, 0.0])
    found = freely(
        eq, fine, (OUTPUTS, OUTPUTS), r.command, (r.measured, r.measured), observer, none,
        start_memory(eq, start_at), runs, strengths,
    )  # fmt: skip
    blind, memory, here, row = np.zeros((eq.states, 2)), start_memory(eq, start_at), 0, 0
    for first, ticks in runs.tolist():
        for kind, m, part in (
            (observer, memory, slice(here, first)),
            (blind, None, slice(first, first + ticks)),
        ):
            own = copied(memory) if m is None else m
            seen = alone(eq, fine, OUTPUTS, r.command[part], r.measured[part], kind, none, own,
                         strengths[part])  # fmt: skip
        assert np.array_equal(found[row : row + ticks], seen, equal_nan=True)
        here, row = first, row + ticks
    assert row == found.shape[0]
