"""The steady-state observer of a linear device: its gain and the covariance of innovations.

The noise model has two variances, of a force at m1 that is held for a tick and of the measurement,
of which only the ratio matters for the gain K = P c' (c P c' + R)^-1. P is the covariance of the
state before each sample, from the discrete algebraic Riccati equation

    P = A (P - K c P) A' + Q.

If no spring ties a device to ground and only velocities are measured, there is no such P, since the
uncertainty of the position grows forever. But the motion does not depend on the position, nor does
the gain. With the position q1 separated from z = (the other positions minus q1, velocities,
actuator),

    z' = F z + noise,    q1' = q1 + g z + noise,    the output a function of z alone:

the Riccati equation in z gives its gain L, and the covariance X of q1 with z, which does converge,

    X = (X + g P) (I - L c)' F' + Q_1z,

is linear; the gain of q1 is X c' (c P c' + R)^-1. (A force held for a tick moves a mass by T / 2
for each unit of velocity; this part of an innovation corrects q1.)

The gains of a population come from a doubling algorithm, for all members at once: with A_0 = A',
G_0 = c' R^-1 c, H_0 = Q and W = (1 + G H)^-1,

    A <- A W A,    G <- G + A W G A',    H <- H + A' H W A    (A, G, H on the right from before)

performs 2^k ticks of the recursion in k steps, and H becomes P (Chu, Fan, Lin & Wang, Int. J.
Control 77(8), 2004).

While a link with play carries no force, the mass behind it moves on its own, and an error of m1's
reading contains no information about it. If that mass were corrected as in contact, each such error
would move it, and parameters and spurious effects would be fitted to the result. On two masses with
only the motor measured, 8 s at 1 kHz, the truth then cost 1640 more in -2 ln, and a fit of its
structure 240 less than the truth instead of 75. So a device with play has two gains, (states, 2 o):
one in contact and one for links without contact (`sim.predict`), which does not correct the parts
behind the links that have no output. Parts with an output keep their gain: with separate noise
models, two masses that are both measured were most likely with a gap that they never cross. If one
of several links with play is free, all count as free. That the uncertainty of a part grows while it
moves on its own is neglected here: with it, gains change along a recording (`noise.gaps`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are
from scipy.sparse.csgraph import connected_components

from zwidth.diagnosis.recording.experiment import Experiment
from zwidth.sim.device import Device, plant_of
from zwidth.sim.exponential import SPACES, held_motion_each
from zwidth.sim.physics.backlash import backlash
from zwidth.sim.plant import Plant, hold
from zwidth.sim.predict import GROUND
from zwidth.sim.reading import Places

Floats = NDArray[np.float64]
FLOOR = 1e-18  # variance added to every state per tick, in units of the measurement's
DOUBLINGS = 60  # 2^60 ticks: a P that has not settled by then never does
SETTLED = 1e-12  # relative change of P at which it has settled
UNSEEN = 1e-6  # per tick: apparent growth of an unobserved position
UNTIED = 1e-14  # of a mass's stiffness, below which stiffness to ground is rounding


class NoObserver(ArithmeticError):
    """No observer exists for a model, or the model runs away with one: a result, not a mistake.

    A search leaves such a model out. It is not a ValueError, which programming errors often raise.
    """


class Steady(NamedTuple):
    """Gain (states, o), and deviations (o,) of innovations over that of a measured position.

    With play the gain is (states, 2 o): in contact, and while the link carries no force.
    """

    gain: Floats
    scatter: Floats


class Spread(NamedTuple):
    """The covariance of an observer's state, and the matrices behind it.

    P (states, states) before a sample, motion A over a tick, c (o, states), process noise Q and
    measurement noise R; for several observers all but R have members as first axis.
    """

    p: Floats
    motion: Floats
    c: Floats
    process: Floats
    noise: Floats

    def gain(self) -> Floats:
        """Return P c' (c P c' + R)^-1, (..., states, o)."""
        seen = self.c @ self.p
        with np.errstate(all="ignore"):
            return seen.swapaxes(-1, -2) @ np.linalg.inv(seen @ self.c.T + self.noise)


def steady(device: Device, experiment: Experiment, ratio: float) -> Steady:
    """Return the steady observer for a ratio of process to measurement variance.

    The process noise is in units of the force that moves the whole mass by one noise unit within a
    tick, which makes the ratio independent of the device's units. Raises NoObserver if none is
    possible.
    """
    found, _ = _in_contact(device, experiment, ratio)
    if links := links_with_play(device):
        return found._replace(gain=with_apart(device, links, experiment, found.gain))
    return found


def _in_contact(device: Device, experiment: Experiment, ratio: float) -> tuple[Steady, Spread]:
    plant = device.plant()
    a, b = hold(plant, experiment.period)
    c = read_of(experiment, Places(plant.dof, device.reading().reads), plant.size)
    process = process_of(plant, b, experiment.period, ratio)
    noise = np.diag(noise_scale(experiment) ** 2)
    if not all(np.all(np.isfinite(m)) for m in (a, process, noise)):
        raise NoObserver("the device's equations have NaN or infinite coefficients")
    if _stands_unseen(plant, experiment):
        return _of_motion(plant, a, c, process, noise)
    solution = _riccati(a, c, process, noise)
    innovation = c @ solution @ c.T + noise
    gain = np.linalg.solve(innovation, c @ solution).T
    found = Steady(np.asarray(gain, dtype=np.float64), np.sqrt(np.diag(innovation)))
    return found, Spread(solution, a, c, process, noise)


def steady_gains(
    devices: Sequence[Device], experiment: Experiment, ratio: Floats | float
) -> Floats:
    """Return the gains (members, states, o) of devices with the same number of states.

    For the same noise as `steady`; ratio: (members,), or one for all. NaN for a member without an
    observer.
    """
    ratios = np.broadcast_to(ratio, len(devices)).astype(np.float64)
    if any(_stands_unseen(device.plant(), experiment) for device in devices):
        each = zip(devices, ratios.tolist(), strict=True)
        return np.stack([_gain_or_nothing(d, experiment, r) for d, r in each])
    return _spreads(devices, experiment, ratios).gain()


def spread(device: Device, experiment: Experiment, ratio: float) -> Spread:
    """Return the covariance of the state in `steady_gains` of a device.

    If the position of the device is not observed, P is for a known position of m1, on which no gain
    depends. Raises NoObserver if none is possible.
    """
    if _stands_unseen(device.plant(), experiment):
        return _in_contact(device, experiment, ratio)[1]
    p, motion, c, process, noise = _spreads([device], experiment, np.array([ratio]))
    if not np.all(np.isfinite(p)):
        raise NoObserver("no steady observer: the equation of its covariance does not converge")
    return Spread(p[0], motion[0], c, process[0], noise)


def _spreads(devices: Sequence[Device], experiment: Experiment, ratios: Floats) -> Spread:
    plants = [device.plant() for device in devices]
    size, dof = plants[0].size, plants[0].dof
    b = np.stack([p.b for p in plants])
    motion = np.zeros((len(plants), size, size + b.shape[2]))
    held_motion_each(
        np.stack([p.a for p in plants]), b, experiment.period, dof, np.zeros(size),
        np.zeros((SPACES, size, size)), motion,
    )  # fmt: skip
    c = read_of(experiment, Places(dof, devices[0].reading().reads), size)
    scale = np.array([float(p.matrices.mass.trace()) for p in plants]) / experiment.period**2
    source = motion[:, :, size + 1] * scale[:, None]
    process = ratios[:, None, None] * source[:, :, None] * source[:, None, :] + FLOOR * np.eye(size)
    noise = np.diag(noise_scale(experiment) ** 2)
    own = motion[:, :, :size]
    return Spread(_doubled(own, c, process, noise), own, c, process, noise)


def process_of(plant: Plant, held: Floats, period: float, *ratios: float) -> Floats:
    """Return the process noise Q of forces on m1, m2, ...; held: of `hold`, over the period [s]."""
    found = FLOOR * np.eye(plant.size)
    for i, ratio in enumerate(ratios):
        source = held[:, 1 + i] * float(plant.matrices.mass.trace()) / period**2
        found += ratio * np.outer(source, source)
    return found


def links_with_play(device: Device) -> tuple[int, ...]:
    """Return the links (index) of a device that have play."""
    return tuple(p.place.index for p in device.physics if p.effect is backlash)


def with_apart(
    device: Device, links: Sequence[int], experiment: Experiment, gains: Floats
) -> Floats:
    """Return gains (..., states, o) with those for links without contact, (..., states, 2 o)."""
    plant = parted_plant(device, links)
    c = read_of(experiment, Places(plant.dof, device.reading().reads), plant.size)
    read = (c != 0.0).astype(np.int64)
    count, part = connected_components((plant.a != 0.0) + read.T @ read, directed=False)
    unseen = [k for k in range(count) if not c[:, np.isin(part, [k])].any()]
    free = np.where(np.isin(part, unseen)[:, None], 0.0, gains)
    return np.concatenate([gains, free], axis=-1)


def parted_plant(device: Device, links: Sequence[int]) -> Plant:
    """Return the linear equations of a device of which links carry nothing."""
    chain = device.chain
    springs, dampers = chain.link_springs.copy(), chain.link_dampers.copy()
    springs[list(links)] = dampers[list(links)] = 0.0
    apart = chain._replace(link_springs=springs, link_dampers=dampers)
    return plant_of(apart, [(p, p.values) for p in device.physics])


def _gain_or_nothing(device: Device, experiment: Experiment, ratio: float) -> Floats:
    try:
        return steady(device, experiment, ratio).gain
    except NoObserver:
        return np.full((device.plant().size, len(experiment.outputs)), np.nan)


def _doubled(motion: Floats, c: Floats, process: Floats, noise: Floats) -> Floats:
    """Return P (members, n, n), NaN if it does not converge.

    States are scaled by their uncertainty, so that the inverted matrix is near 1 in any units.
    """
    unit = np.sqrt(np.diagonal(process, axis1=1, axis2=2)).max(axis=0)
    a = (motion * unit / unit[:, None]).swapaxes(1, 2)
    g = np.broadcast_to((c.T @ np.linalg.inv(noise) @ c) * np.outer(unit, unit), a.shape)
    h = process / np.outer(unit, unit)
    eye = np.eye(a.shape[1])
    settled = np.zeros(a.shape[0], dtype=bool)
    with np.errstate(all="ignore"):
        for _ in range(DOUBLINGS):
            sound = np.isfinite(h).all(axis=(1, 2)) & np.isfinite(a).all(axis=(1, 2))
            safe = np.where(sound[:, None, None], eye + g @ h, eye)
            w = np.linalg.inv(safe)
            added = a.swapaxes(1, 2) @ h @ w @ a
            g = g + a @ w @ g @ a.swapaxes(1, 2)
            a = a @ w @ a
            h = h + added
            change = np.abs(added).max(axis=(1, 2)) / np.abs(h).max(axis=(1, 2))
            settled = change < SETTLED
            if np.all(settled | ~sound):
                break
    h = np.where(settled[:, None, None], h, np.nan)
    return h * np.outer(unit, unit)


def _riccati(a: Floats, c: Floats, process: Floats, noise: Floats) -> Floats:
    """Solve for P; raises NoObserver if the solver fails."""
    try:
        return np.asarray(solve_discrete_are(a.T, c.T, process, noise), dtype=np.float64)
    except ValueError as error:  # LinAlgError is one
        raise NoObserver(f"no steady observer: {error}") from error


def noise_scale(experiment: Experiment) -> Floats:
    """Return the relative noise of the outputs: velocities are noisier than positions by 1/T."""
    return np.array(
        [1.0 if o.quantity == "position" else 1.0 / experiment.period for o in experiment.outputs]
    )


def read_of(experiment: Experiment, of: Places, size: int) -> Floats:
    """Return c (o, size) of the outputs; a late position depends on its speed too.

    Without this an observer would correct too much, or diverge with a large gain.
    """
    places, rows = experiment.places(of), np.arange(len(experiment.outputs))
    c = np.zeros((rows.size, size))
    still = places.state < of.dof
    c[rows, places.state] = 1.0
    c[rows[still], places.state[still] + of.dof] = places.late[still]
    linked = places.less != GROUND
    c[rows[linked], places.less[linked]] = -1.0
    still &= linked
    c[rows[still], places.less[still] + of.dof] = -places.late[still]
    return c


def settles(device: Device, experiment: Experiment, gain: Floats) -> bool:
    """Whether an observer forgets its start: (1 - L c) A shrinks, except unobserved positions."""
    plant = device.plant()
    a, _ = hold(plant, experiment.period)
    c = read_of(experiment, Places(plant.dof, device.reading().reads), plant.size)
    closed = (np.eye(plant.size) - gain[:, : c.shape[0]] @ c) @ a
    if not np.all(np.isfinite(closed)):
        return False
    return bool(np.abs(np.linalg.eigvals(closed)).max() < 1.0 + UNSEEN)


def _stands_unseen(plant: Plant, experiment: Experiment) -> bool:
    """Whether neither an output nor a spring to ground shows the position of the device."""
    stiffness = plant.matrices.stiffness
    ties = np.abs(stiffness.sum(axis=1))
    free = bool(np.all(ties <= UNTIED * np.abs(np.diag(stiffness))))
    return free and not any(o.tells_position for o in experiment.outputs)


def _of_motion(
    plant: Plant, a: Floats, c: Floats, process: Floats, noise: Floats
) -> tuple[Steady, Spread]:
    """The observer of a device whose position is not observed (module docstring)."""
    others = np.eye(plant.size)[1:]
    others[: plant.dof - 1, 0] = -1.0  # z = others x
    back = np.zeros((plant.size, plant.size - 1))
    back[1:] = np.eye(plant.size - 1)  # x = back z where q1 is zero
    f, g, seen = others @ a @ back, (a @ back)[0], c @ back
    moved = others @ process
    p = _riccati(f, seen, moved @ others.T, noise)
    innovation = seen @ p @ seen.T + noise
    gain = np.linalg.solve(innovation, seen @ p).T
    closed = (np.eye(p.shape[0]) - gain @ seen).T @ f.T
    known = g @ p @ closed + moved[:, 0]
    x = np.linalg.solve((np.eye(p.shape[0]) - closed).T, known)
    whole = back @ gain
    whole[: plant.dof] += np.linalg.solve(innovation, seen @ x)  # all positions are relative to m1
    beside = np.outer(np.arange(plant.size) < plant.dof, back @ x)
    known_as = Spread(back @ p @ back.T + beside + beside.T, a, c, process, noise)
    return Steady(whole, np.sqrt(np.diag(innovation))), known_as
