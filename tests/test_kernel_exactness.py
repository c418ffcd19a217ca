"""Truth 7, linear part: a tick is exact, and happens in the order it says.

The reference knows nothing of the kernel's two segments: it keeps a list of the moments at which
commands take effect and goes from one to the next by a matrix exponential of its own.
"""

from typing import Any

import numpy as np
import pytest
from engine_examples import Floats, one_mass, phantom, scaled_error, states
from scipy.linalg import expm

from zwidth.controllers.recorded import recorded
from zwidth.controllers.wall import wall
from zwidth.sim.chain import make_chain
from zwidth.sim.device import Device
from zwidth.sim.interface import Interface
from zwidth.sim.physics import make_physics
from zwidth.sim.run import Start, simulate

CHAIN_OF_FOUR = make_chain(
    [2e-4, 3e-4, 4e-4, 1e-4], [1e-2, 0.0, 2e-3, 1e-3], 1.5, [80.0, 150.0, 40.0], [1e-2, 0.0, 2e-2]
)

CHAIN_OF_FIVE = make_chain(
    [2e-4, 3e-4, 4e-4, 1e-4, 2e-4], [1e-2, 0.0, 2e-3, 1e-3, 5e-4], 0.0, [80.0, 150.0, 40.0, 90.0],
    [1e-2, 0.0, 2e-2, 5e-3],
)  # fmt: skip


def lagging(time_constant: float) -> Device:
    return phantom().with_physics(
        make_physics("actuator_lag", "command", time_constant=time_constant)
    )


DEVICES = {
    "one mass": one_mass(1.2e-3, 6e-3),
    "three masses": phantom(),
    "three masses, lag": lagging(4e-4),
    "four masses, ground spring": Device("four", "-", True, CHAIN_OF_FOUR, Interface()),
    "five masses": Device("five", "-", True, CHAIN_OF_FIVE, Interface()),
}


def continuous(device: Device) -> tuple[Floats, Floats]:
    """x' = A x + B [command, forces], written down from the chain's definition."""
    m, b, k0, k, c = device.chain
    n = m.size
    lags = [p.values["time_constant"] for p in device.physics]
    a, inputs = np.zeros((2 * n + len(lags),) * 2), np.zeros((2 * n + len(lags), 1 + n))
    for i in range(n):
        a[i, n + i] = 1.0
        a[n + i, n + i] -= b[i] / m[i]
        inputs[n + i, 1 + i] = 1.0 / m[i]
        for j, link in ((i - 1, i - 1), (i + 1, i)):
            if 0 <= j < n:
                a[n + i, i] -= k[link] / m[i]
                a[n + i, j] += k[link] / m[i]
                a[n + i, n + i] -= c[link] / m[i]
                a[n + i, n + j] += c[link] / m[i]
    a[n, 0] -= k0 / m[0]
    if lags:
        a[n, 2 * n], a[2 * n, 2 * n], inputs[2 * n, 0] = 1.0 / m[0], -1.0 / lags[0], 1.0 / lags[0]
    else:
        inputs[n, 0] = 1.0 / m[0]
    return a, inputs


def reference(
    device: Device, stiffness: float, damping: float, ticks: int, x: Floats, forces: Floats
) -> tuple[Floats, Floats]:
    """States and velocity estimates at every kT under a two-sided wall, from event to event."""
    a, inputs = continuous(device)
    face, n = device.interface, device.chain.masses.size
    smoothing = 1.0 - np.exp(-2.0 * np.pi * face.velocity_cutoff_hz * face.period)
    moments, values, held = [np.inf], [0.0], 0.0
    y_before, v = x[0] - face.period * x[n], x[n]
    rows, estimates = [], []
    for k in range(ticks):
        t, end = k * face.period, (k + 1) * face.period
        v = (1.0 - smoothing) * v + smoothing * (x[0] - y_before) / face.period
        y_before = x[0]
        rows.append(x.copy())
        estimates.append(v)
        moments.insert(-1, t + face.delay)
        values.insert(-1, -(stiffness * x[0] + damping * v))
        while t < end - 1e-9 * face.period:
            while moments[0] <= t + 1e-9 * face.period:
                held = values.pop(0)
                moments.pop(0)
            stop = min(moments[0], end)
            u = np.concatenate([[held], forces[k]])
            whole = np.block([[a, (inputs @ u)[:, None]], [np.zeros((1, a.shape[0] + 1))]])
            x = (expm(whole * (stop - t)) @ np.append(x, 1.0))[:-1]
            t = stop
    return np.array(rows), np.array(estimates)


@pytest.mark.parametrize("delay", [0.0, 0.00037, 0.002, 0.0023, 0.00799])
@pytest.mark.parametrize("name", DEVICES)
def test_one_substep_a_tick_is_exact(name: str, delay: float) -> None:
    """1e-12 of each state's largest value over 100 ticks, with forces on every mass.

    Mutations: segment 0 held at the command of tick k - d (1e-2); `remainder` of `delay_ticks`
    dropped (1e-2); lengths of the two segments exchanged (1e-2).
    """
    device = DEVICES[name].with_interface(delay=delay)
    n = device.chain.masses.size
    rng = np.random.default_rng(1)
    forces = 0.01 * rng.normal(size=(100, n))
    start = Start(list(1e-3 * rng.normal(size=n)), list(0.1 * rng.normal(size=n)))
    run = simulate(device, wall(3.0, 0.01), duration=0.1, start=start, disturbance=forces)
    x = np.zeros(device.plant().size)
    x[:n], x[n : 2 * n] = start.position, start.velocity
    truth, estimates = reference(device, 3.0, 0.01, 100, x, forces)
    assert scaled_error(states(run, n), truth[:, : 2 * n]) < 1e-12
    found = run.trace["velocity_estimate"]
    assert np.abs(found - estimates).max() < 1e-12 * np.abs(estimates).max()


def test_the_velocity_filter_is_the_first_order_one() -> None:
    """1e-12. Mutation: `velocity_smoothing` without the 2 pi (1e-1)."""
    device = phantom().with_interface(velocity_cutoff_hz=60.0)
    run = simulate(device, wall(5.0, 0.02), duration=0.2, start=Start(1e-3, 0.05))
    x = np.concatenate([np.full(3, 1e-3), np.full(3, 0.05)])
    truth, estimates = reference(device, 5.0, 0.02, 200, x, np.zeros((200, 3)))
    assert scaled_error(states(run, 3), truth) < 1e-12
    found = run.trace["velocity_estimate"]
    assert np.abs(found - estimates).max() < 1e-12 * np.abs(estimates).max()


@pytest.mark.parametrize("delay", [0.002, 0.0023])
def test_substeps_change_nothing_where_all_is_linear(delay: float) -> None:
    """1e-12. Mutation: `counts` of substeps without its duration divided accordingly."""
    device = phantom().with_interface(delay=delay)
    one, many = (
        simulate(device, wall(12.0, 0.03), duration=0.5, start=Start(1e-3), substeps=n)
        for n in (1, 7)
    )
    assert scaled_error(states(many, 3), states(one, 3)) < 1e-12


@pytest.mark.parametrize("substeps", [1, 2, 3, 5, 7, 12])
@pytest.mark.parametrize("share", [0.0, 0.001, 0.25, 0.37, 0.5, 0.999])
def test_no_substep_is_longer_than_asked_for(substeps: int, share: float) -> None:
    """Mutation: `counts` rounded to nearest instead of up."""
    device = phantom().with_interface(delay=(2.0 + share) * 1e-3)
    run = simulate(device, wall(1.0, 0.0), duration=0.003, substeps=substeps, fine=True)
    assert run.fine is not None
    times = np.concatenate([[0.0], run.fine.t])
    assert np.diff(times).max() <= 1e-3 / substeps * (1.0 + 1e-9)
    assert times[-1] == pytest.approx(0.003, rel=1e-12)


def test_the_fine_trace_ends_each_tick_where_the_next_begins() -> None:
    device = phantom().with_interface(delay=0.0023)
    run = simulate(
        device, wall(12.0, 0.03), duration=0.05, start=Start(1e-3), substeps=4, fine=True
    )
    assert run.fine is not None
    per_tick = len(run.fine) // len(run.trace)
    for name in ("position_m1", "velocity_m3"):
        after = run.fine[name][per_tick - 1 :: per_tick]
        assert np.array_equal(after[:-1], run.trace[name][1:])


def test_the_tick_happens_in_its_order() -> None:
    """Encoder, estimate, wall, converter, delay: each channel from the one before, to the bit."""
    step, bit, limit = 2e-5, 4e-4, 0.01
    device = phantom().with_interface(
        delay=0.003, encoder_step=step, command_step=bit, command_limit=limit
    )
    run = simulate(device, wall(9.0, 0.01, -1e-4, one_sided=True), duration=0.3, start=Start(2e-3))
    trace = run.trace
    counted = np.round(trace["position_m1"] / step)  # no position is a tie
    assert np.allclose(trace["encoder"], step * counted, rtol=1e-15, atol=0.0)
    y = np.concatenate([trace["encoder"][:1], trace["encoder"]])
    assert np.allclose(trace["velocity_estimate"], np.diff(y) / 1e-3, rtol=1e-9, atol=1e-12)
    depth = trace["encoder"] + 1e-4
    push = 9.0 * depth + 0.01 * trace["velocity_estimate"]
    wanted = np.where(depth > 0.0, -np.maximum(push, 0.0), 0.0)
    converted = np.clip(bit * np.round(wanted / bit), -limit, limit)
    assert np.allclose(trace["command"], converted, rtol=1e-9, atol=1e-15)
    assert np.array_equal(trace["contact"], (depth > 0.0).astype(float))
    assert np.array_equal(trace["applied"][3:], trace["command"][:-3])
    assert not trace["applied"][:3].any()
    assert np.any(trace["command"] == -limit)
    assert np.any(trace["contact"] == 0.0)


@pytest.mark.parametrize(
    ("rounding", "position", "reading"),
    [
        ("nearest", 0.49, 0.0),
        ("nearest", 0.5, 1.0),
        ("nearest", -0.5, -1.0),
        ("nearest", 1.5, 2.0),
        ("nearest", 2.5, 3.0),
        ("floor", 0.99, 0.0),
        ("floor", -0.01, -1.0),
        ("floor", 2.0, 2.0),
    ],
)
def test_the_encoder_rounds_as_it_says(rounding: str, position: float, reading: float) -> None:
    """Ties go away from zero: with a step of 2^-10 the ties are exact."""
    step = 2.0**-10
    device = one_mass(1e-3, 0.0, encoder_step=step, encoder_rounding=rounding)
    run = simulate(device, wall(0.0, 0.0), duration=0.001, start=Start(position * step))
    assert run.trace["encoder"][0] == reading * step


def test_a_command_that_is_recorded_comes_back() -> None:
    """Replaying a run's commands open-loop gives the run to the bit; after their end, zero."""
    device = phantom().with_interface(delay=0.0027)
    closed = simulate(device, wall(12.0, 0.03), duration=0.3, start=Start(1e-3))
    opened = simulate(device, recorded(closed.trace["command"]), duration=0.4, start=Start(1e-3))
    for name in ("position_m1", "velocity_m2", "command", "applied"):
        assert np.array_equal(opened.trace[name][:300], closed.trace[name])
    assert not opened.trace["command"][300:].any()


def test_blocks_are_the_run() -> None:
    """A run taken piece by piece, as a log is written, equals the run in one piece to the bit."""
    from zwidth.sim.run import prepare

    device = phantom().with_interface(delay=0.0027, encoder_step=1e-6)
    arguments: dict[str, Any] = {"duration": 0.3, "start": Start(1e-3), "substeps": 3, "fine": True}
    whole = simulate(device, wall(12.0, 0.03), ledger=True, **arguments)
    pieces = list(prepare(device, wall(12.0, 0.03), ledger=True, **arguments).blocks(70))
    assert [len(trace) for trace, _, _ in pieces] == [70, 70, 70, 70, 20]
    for name in whole.trace.channels:
        joined = np.concatenate([trace[name] for trace, _, _ in pieces])
        assert np.array_equal(joined, whole.trace[name])
    assert np.array_equal(np.concatenate([trace.t for trace, _, _ in pieces]), whole.trace.t)


def test_a_run_is_run_once() -> None:
    """Blocks asked for again would go on from the end, under times that begin anew: an error.

    Mutation: the check of `counters` left out.
    """
    from zwidth.sim.run import prepare

    setup = prepare(phantom(), wall(12.0, 0.03), duration=0.1, start=Start(1e-3))
    next(iter(setup.blocks(50)))
    with pytest.raises(ValueError, match="has already begun; prepare it again"):
        list(setup.blocks(50))
