"""A device turned into the arrays that the kernel reads: propagators, effect tables, ledger forms.

One tick has two segments, because a delay of d T + r changes the held command inside the tick:
segment 0 is [kT, kT + r) under the command of tick k - d - 1, segment 1 is [kT + r, (k + 1) T)
under that of tick k - d. Each segment is cut into equal substeps with a propagator of its own, and
where there is dry friction or play, with one propagator for every set of masses that may be locked
and every set of links that may carry nothing.

With w = [x; held command; f_1..f_n], a substep is x' = P w. An energy entry integral of
(a.w)(b.w) dt over the substep is the quadratic form w' S w with S from Van Loan (IEEE T. Automatic
Control 23, 1978): exp([[-W', a b'], [0, W]] h) holds S, with W the generator of w.
"""

import itertools
from collections.abc import Iterable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from zwidth.sim.chain import Chain, Chains
from zwidth.sim.device import MASSLESS, Device
from zwidth.sim.exponential import SPACES, held_motion_alone
from zwidth.sim.force_sensor import force_row
from zwidth.sim.interface import Interface
from zwidth.sim.physics.backlash import backlash
from zwidth.sim.physics.effect import Physics
from zwidth.sim.place import GROUND
from zwidth.sim.plant import Link, Plant, behind, hold, locked, opened

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
REMEMBERED = 512  # propagators
SPARED = 0.01  # of a substep, that a device may become faster
LANES = 8  # width of a block of rows in a propagator: one vector register of doubles
BACKLASH = backlash.code
HOOKS = ("force", "friction", "sensor", "command", "clock")  # those that have a table


class EffectTable(NamedTuple):
    """Effects of one hook: code, first and second mass (-1: ground), origin, parameters (rows).

    A force acts on the first mass, and with the opposite sign on the second. Its law uses the first
    mass's distance from the origin: the second mass, or the ground (`Effect.over_first`).
    """

    codes: Ints
    first: Ints
    second: Ints
    origin: Ints
    parameters: Floats


class Equations(NamedTuple):
    """Everything the kernel knows of a device; arrays and numbers only.

    propagators (2 segments, sets, row blocks, columns, 8), a set's number being that of the links
    with play that carry nothing (bits, in the order of `gaps`) plus 2^gaps times that of the locked
    masses; quadratics (2, sets, entries, columns, columns), no entries without a ledger; gaps:
    which forces are play; reaction (n, columns): the force on a
    mass as a row on w; springs (m, 2) places and spring_stiffness (m,) for the stored energy.
    looped: whether a loop on the position is among the linear part; command_rate: what a command
    changes by in a tick at most.
    estimator: code of the velocity's (`sim/estimators`), window and estimating (m,) its numbers;
    rate of velocity estimates; filter (3,): the second-order one's other weights, else (0,);
    force_row (2 n,): the measured force as a row on the state, (0,) without a sensor. read: place
    whose position the encoder reads; reads, followers: of all readings (`sim/reading.py`), behind
    (k,) how late each follower is [s].
    """

    dof: int
    states: int
    columns: int
    lagging: bool
    substeps: Ints
    durations: Floats
    propagators: Floats
    quadratics: Floats
    reaction: Floats
    masses: Floats
    springs: Ints
    spring_stiffness: Floats
    forces: EffectTable
    gaps: Ints
    frictions: EffectTable
    bounds_vary: bool
    sensors: EffectTable
    amplifiers: EffectTable
    clocks: EffectTable
    whole_delay: int
    period: float
    estimator: int
    window: int
    estimating: Floats
    rate: float
    smoothing: float
    filter: Floats
    second_order: bool
    velocity_ticks: int
    position_ticks: int
    force_row: Floats
    force_gain: float
    encoder_step: float
    encoder_floor: bool
    velocity_step: float
    command_step: float
    command_gain: float
    command_limit: float
    command_rate: float
    looped: bool
    position_origin: float
    read: int
    reads: Ints
    followers: Ints
    behind: Floats


def equations(device: Device, substeps: int = 1, ledger: bool = False, seed: int = 0) -> Equations:
    """Prepare a device for the kernel with at least `substeps` substeps per tick.

    seed: of what happens at random (0 to 2^64 - 1). With only linear physics one substep is exact.
    Raises ValueError for substeps < 1, too few of them for dry friction, or a seed out of range.
    """
    bare, plant = frame(device, substeps, seed)
    moves = mechanism(
        Linear(plant),
        tuple(np.unique(bare.frictions.first)),
        _links_with_play(bare.forces, bare.gaps),
        bare.period,
        tuple(bare.substeps),
        tuple(bare.durations),
        ledger,
    )
    return bare._replace(
        propagators=moves.propagators.copy(),
        quadratics=moves.quadratics.copy(),
        springs=moves.springs.copy(),
        spring_stiffness=moves.spring_stiffness.copy(),
    )


def frame(device: Device, substeps: int, seed: int = 0) -> tuple[Equations, Plant]:
    """Return what needs no propagators of a device's equations, and its plant.

    Raises ValueError for substeps < 1 or a seed out of range.
    """
    if substeps < 1:
        raise ValueError(f"substeps is {substeps}; at least 1 substep per tick is needed")
    if not 0 <= seed < 2**64:
        raise ValueError(f"seed is {seed}; it must be from 0 to 2^64 - 1")
    plant = device.plant()
    interface = device.interface
    whole, _ = interface.delay_ticks
    found = device.reading()
    counts, durations = segments(interface.delay_ticks[1], interface.period, substeps)
    values = [p.vector() for p in device.physics]
    table = {hook: effect_table(hook, device.physics, values, device.chain, seed) for hook in HOOKS}
    bare = Equations(
        dof=plant.dof,
        states=plant.size,
        columns=plant.size + 1 + plant.dof,
        lagging=plant.lag > 0.0,
        substeps=counts,
        durations=durations,
        propagators=np.zeros((2, 0, 0, 0, 0)),
        quadratics=np.zeros((2, 0, 0, 0, 0)),
        reaction=reaction(plant),
        masses=np.diag(plant.matrices.mass).copy(),
        springs=np.zeros((0, 2), dtype=np.int64),
        spring_stiffness=np.zeros(0),
        forces=table["force"],
        gaps=np.flatnonzero(table["force"].codes == BACKLASH),
        frictions=table["friction"],
        bounds_vary=any(p.effect.varies_with_speed for p in device.physics),
        sensors=table["sensor"],
        amplifiers=table["command"],
        clocks=table["clock"],
        whole_delay=whole,
        period=interface.period,
        estimator=interface.estimator.code,
        window=int(interface.velocity_window),
        estimating=np.array(interface.estimator.numbers(interface.estimator_settings)),
        rate=1.0 / interface.velocity_period,
        smoothing=interface.velocity_smoothing,
        filter=np.array(interface.velocity_filter[1:] if interface.second_order else ()),
        second_order=interface.second_order,
        velocity_ticks=int(interface.velocity_ticks),
        position_ticks=int(interface.position_ticks),
        force_row=force_row(device.chain, interface, plant.dof),
        force_gain=interface.force_gain,
        encoder_step=interface.encoder_step,
        encoder_floor=interface.encoder_rounding == "floor",
        velocity_step=interface.velocity_step,
        command_step=interface.command_step,
        command_gain=interface.command_gain,
        command_limit=interface.command_limit,
        command_rate=float(command_rate(device.physics, values, interface.period, 1)[0]),
        looped=any(p.effect.name == "position_servo" for p in device.physics),
        position_origin=interface.position_origin,
        read=int(found.reads[0, 0]),
        reads=found.reads,
        followers=found.followers,
        behind=behind(plant, found.followers),
    )
    return bare, plant


def enough_substeps(device: Device, wanted: int = 1) -> int:
    """Return how many substeps per tick a device takes: `wanted`, or more where it needs more.

    Only dry friction needs more (`enough_of`).
    """
    dry = dry_masses(device.physics)
    return enough_of(device.plant(), dry, device.interface, wanted) if dry else wanted


def dry_masses(physics: Iterable[Physics]) -> tuple[int, ...]:
    """Return the masses (index) that have dry friction."""
    return tuple({p.place.index for p in physics if p.effect.hook == "friction"})


def enough_of(plant: Plant, dry: Sequence[int], interface: Interface, wanted: int = 1) -> int:
    """Return how many substeps per tick a plant takes with dry friction at some masses.

    A force held over a substep h must not result in a velocity of the opposite sign (`_too_long`);
    omega h < pi for the fastest mode is sufficient. `SPARED` of it is left as a margin, so that a
    slightly faster device, of which a fit computes slopes, needs as many substeps.
    """
    spared = interface.period * (1.0 + SPARED)
    if sure(plant, spared):
        return wanted
    needed = _sure_substeps(plant, spared)
    if needed <= wanted:
        return wanted
    counts, durations = segments(interface.delay_ticks[1], interface.period, wanted)
    lengths = [h for count, h in zip(counts, durations, strict=True) if count > 0]
    near = [share * h for h in lengths for share in (1.0, 1.0 + SPARED)]
    return needed if any(_too_long(plant, dry, h) for h in near) else wanted


def segments(remainder: float | Floats, period: float, substeps: int) -> tuple[Ints, Floats]:
    """Return the substeps of both segments of a tick, and how long [s] those of each are.

    remainder (...) [s]: of the delay, beyond whole ticks; what is returned has the shape (..., 2).
    """
    lengths = np.stack([remainder, period - remainder], axis=-1)
    counts = np.ceil(substeps * lengths / period - 1e-9).astype(np.int64)
    return counts, np.divide(lengths, counts, out=np.zeros(lengths.shape), where=counts > 0)


class Mechanism(NamedTuple):
    """What `Equations` has of the linear plant and the lengths of its substeps."""

    propagators: Floats
    quadratics: Floats
    springs: Ints
    spring_stiffness: Floats


class Linear:
    """A plant that is equal to another of the same numbers."""

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.key = b"".join(
            [plant.a.tobytes(), plant.b.tobytes(), *(m.tobytes() for m in plant.matrices)]
        )

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Linear)
            and self.key == other.key
            and self.plant.dof == other.plant.dof
        )

    def __hash__(self) -> int:
        return hash(self.key)


@lru_cache(maxsize=REMEMBERED)
def mechanism(
    linear: Linear,
    dry: tuple[int, ...],
    play: tuple[Link, ...],
    period: float,
    counts: tuple[int, ...],
    durations: tuple[float, ...],
    ledger: bool,
) -> Mechanism:
    """Return what the arrays of `Equations` have of the plant.

    A search that changes effects needs the same mechanism again and again.
    """
    plant = linear.plant
    sets = locked_sets(1 + max(dry)) if dry else [()]
    if dry and (complaint := too_few_substeps(plant, dry, period, counts, durations)):
        raise ValueError(complaint)
    stiffness = plant.matrices.stiffness
    springs = [
        (i, j) for i, j in itertools.combinations(range(plant.dof), 2) if stiffness[i, j] != 0.0
    ]
    grounded = stiffness.sum(axis=1)
    grounds = [i for i in range(plant.dof) if abs(grounded[i]) > 1e-14 * stiffness[i, i]]
    open_sets = [[play[g] for g in one] for one in locked_sets(len(play))]
    each = [locked(opened(plant, links), s) for s in sets for links in open_sets]
    held = [each] * len(durations)
    return Mechanism(
        np.stack(
            [[propagator(one, h) for one in row] for row, h in zip(held, durations, strict=True)]
        ),
        np.stack(
            [
                [ledger_forms(plant, one, h, ledger) for one in row]
                for row, h in zip(held, durations, strict=True)
            ]
        ),
        np.array([*springs, *((i, -1) for i in grounds)], dtype=np.int64).reshape(-1, 2),
        np.array([*(-stiffness[i, j] for i, j in springs), *(grounded[i] for i in grounds)]),
    )


def _links_with_play(forces: EffectTable, gaps: Ints) -> tuple[Link, ...]:
    """Return masses, spring and damper of each link with play."""
    return tuple(
        (int(forces.first[e]), int(forces.second[e]), *forces.parameters[e, 1:3].tolist())
        for e in gaps
    )


def locked_sets(masses: int) -> list[tuple[int, ...]]:
    """Return the sets of locked masses among the first ones, in the order of their bit masks."""
    return [tuple(i for i in range(masses) if mask >> i & 1) for mask in range(2**masses)]


def too_few_substeps(
    plant: Plant,
    dry: Sequence[int],
    period: float,
    counts: Sequence[int],
    durations: Sequence[float],
) -> str | None:
    """Say that substeps are so long that a held force may act in the opposite direction."""
    if not any(_too_long(plant, dry, h) for c, h in zip(counts, durations, strict=True) if c > 0):
        return None
    return (
        f"substeps is {max(1, round(period / max(durations)))}; dry friction on a device whose"
        f" fastest mode has {_fastest(plant) / (2.0 * np.pi):.4g} Hz needs at least"
        f" {_sure_substeps(plant, period)} substeps per tick"
    )


def _too_long(plant: Plant, dry: Sequence[int], h: float) -> bool:
    """Whether a force held for h [s] at masses with dry friction may come out as its contrary.

    A mode answers a force held for h with a velocity of the sign of sin(omega h) / omega: for
    omega h < pi all of W (`sim/kernel.py`, slide) is positive definite, with masses locked too,
    since locking separates frequencies but does not raise the highest. No omega^2 is above the
    largest row sum of |M^-1 K| (Gershgorin), which spares most devices the closer look.
    """
    if sure(plant, h):
        return False
    at = np.array(dry)
    _, b = hold(plant, h)
    w = b[np.ix_(plant.dof + at, 1 + at)]
    return bool(np.linalg.eigvalsh(0.5 * (w + w.T))[0] <= 0.0)


def sure(plant: Plant, h: float | Floats) -> Any:
    """Return whether no mode is so fast that omega h may be pi, for h [s]; of many, each (...).

    No mode's omega^2 exceeds the largest row sum of |M^-1 K|.
    """
    n = plant.dof
    return np.abs(plant.a[..., n : 2 * n, :n]).sum(axis=-1).max(axis=-1) * h**2 < np.pi**2


def _sure_substeps(plant: Plant, period: float) -> int:
    """Return the least substeps of a period [s] for which omega h < pi for every mode."""
    return int(period * _fastest(plant) / np.pi) + 1


def _fastest(plant: Plant) -> float:
    """Return the angular frequency [rad/s] of the fastest mode."""
    return float(np.abs(np.linalg.eigvals(plant.a).imag).max())


def propagator(plant: Plant, duration: float) -> Floats:
    """Return P in blocks of eight rows, shape (blocks, columns, 8), zero-padded."""
    return _propagator(plant.a.tobytes(), plant.b.tobytes(), plant.size, plant.dof, duration)


@lru_cache(maxsize=REMEMBERED)
def _propagator(a: bytes, b: bytes, size: int, dof: int, duration: float) -> Floats:
    """A fit that changes a friction level asks for the same propagators again and again."""
    blocks = -(-size // LANES)
    packed = np.zeros((blocks * LANES, size + 1 + dof))
    if duration > 0.0:
        held_motion_alone(
            np.frombuffer(a).reshape(size, size), np.frombuffer(b).reshape(size, -1), duration,
            dof, np.zeros(size), np.zeros((SPACES, size, size)), packed,
        )  # fmt: skip
    else:
        packed[:size, :size] = np.eye(size)
    found = np.ascontiguousarray(packed.reshape(blocks, LANES, -1).transpose(0, 2, 1))
    found.setflags(write=False)
    return found


def ledger_names(device: Device, plant: Plant) -> list[str]:
    """Return the energy entries in the order of the kernel's totals."""
    dampers = [name for name, _, _ in _dampers(plant)]
    effects = [f"{p.effect.name}_{p.at}" for h in ("force", "friction") for p in _of(device, h)]
    return ["motor", "wall", "disturbance", "actuator_lag", *dampers, *effects]


def _of(device: Device, hook: str) -> list[Physics]:
    return [p for p in device.physics if p.effect.hook == hook]


def _dampers(plant: Plant, now: Plant | None = None) -> list[tuple[str, float, Floats]]:
    """Name, coefficient and row on x of the velocity across each damper, from the matrix C.

    now: the plant while some links carry nothing, whose coefficients count.
    """
    n, c = plant.dof, plant.matrices.damping
    acting = c if now is None else now.matrices.damping
    found: list[tuple[str, float, Floats]] = []
    for i in range(n):
        if plant.matrices.mass[i, i] <= 2.0 * MASSLESS * plant.matrices.mass[0, 0]:
            continue
        row = np.zeros(plant.size)
        row[n + i] = 1.0
        found.append((f"b{i + 1}", float(acting[i].sum()), row))
    for i, j in itertools.combinations(range(n), 2):
        if c[i, j] != 0.0:
            row = np.zeros(plant.size)
            row[n + i], row[n + j] = 1.0, -1.0
            found.append((f"b{i + 1}{j + 1}", float(-acting[i, j]), row))
    return found


def ledger_forms(whole: Plant, plant: Plant, duration: float, wanted: bool) -> Floats:
    """Return the forms S of motor, amplifier's lag, each damper: (entries, columns, columns).

    Of the whole plant, as it moves while some masses or links do not count.
    """
    size = plant.size + 1 + plant.dof
    if not wanted or duration == 0.0:
        entries = 2 + len(_dampers(whole)) if wanted else 0
        return np.zeros((entries, size, size))
    generator = np.zeros((size, size))
    generator[: plant.size] = np.hstack([plant.a, plant.b])
    velocity, applied, held = np.zeros((3, size))
    velocity[plant.dof] = 1.0
    held[plant.size] = 1.0
    applied[plant.size - 1 if plant.lag > 0.0 else plant.size] = 1.0
    pairs = [(applied, velocity), (held - applied, velocity)]
    for _, coefficient, row in _dampers(whole, plant):
        full = np.concatenate([row, np.zeros(size - plant.size)])
        pairs.append((coefficient * full, full))
    return np.stack([_van_loan(generator, a, b, duration) for a, b in pairs])


def _van_loan(generator: Floats, a: Floats, b: Floats, duration: float) -> Floats:
    size = generator.shape[0]
    block = np.zeros((2 * size, 2 * size))
    block[:size, :size] = -generator.T
    block[:size, size:] = 0.5 * (np.outer(a, b) + np.outer(b, a))
    block[size:, size:] = generator
    full = expm(block * duration)
    form = full[size:, size:].T @ full[:size, size:]
    return 0.5 * (form + form.T)


def reaction(plant: Plant) -> Floats:
    """Return rows on w (..., n, columns) whose value is the force on each mass, friction aside."""
    n, size = plant.dof, plant.size
    rows = np.zeros((*plant.a.shape[:-2], n, size + 1 + n))
    rows[..., :n], rows[..., n : 2 * n] = -plant.matrices.stiffness, -plant.matrices.damping
    rows[..., 0, size - 1 if plant.lag > 0.0 else size] = 1.0
    rows[..., size + 1 :] = np.eye(n)
    return rows


def effect_table(
    hook: str,
    physics: Sequence[Physics],
    values: Sequence[Floats],
    chain: Chain | Chains,
    seed: int,
) -> EffectTable:
    """Return the table of the effects of one hook, with parameters (..., effects, numbers).

    values (..., parameters) of every effect in `physics`, in the order of its declaration; chain:
    whose links effects read.
    """
    mine = [(p, own) for p, own in zip(physics, values, strict=True) if p.effect.hook == hook]
    if not mine:
        nothing = np.zeros(0, dtype=np.int64)
        lead = chain.masses.shape[:-1]
        return EffectTable(nothing, nothing, nothing, nothing, np.zeros((*lead, 0, 1)))
    entries = [p for p, _ in mine]
    places = [p.place.ends for p in entries]
    loop = _servo(physics, values, chain)
    rows = [_row(p, own, chain, loop, seed) for p, own in mine]
    width = max(row.shape[-1] for row in rows) or 1
    parameters = np.zeros((*rows[0].shape[:-1], len(rows), width))
    for i, row in enumerate(rows):
        parameters[..., i, : row.shape[-1]] = row
    return EffectTable(
        np.array([p.effect.code for p in entries], dtype=np.int64),
        np.array([i for i, _ in places], dtype=np.int64),
        np.array([j for _, j in places], dtype=np.int64),
        np.array([GROUND if p.effect.over_first else p.place.ends[1] for p in entries], np.int64),
        parameters,
    )


def _row(
    physics: Physics, values: Floats, chain: Chain | Chains, loop: Floats, seed: int
) -> Floats:
    """Return an effect's own numbers, then what it reads of its link, of the servo or of the run.

    The run's seed comes as its two 32-bit words.
    """
    found = [values]
    for name in physics.effect.borrows:
        if name == "seed":
            words = np.array([float(seed & 0xFFFFFFFF), float(seed >> 32)])
            found.append(np.broadcast_to(words, (*values.shape[:-1], 2)))
        elif name == "servo":
            found.append(loop)
        else:
            links = chain.link_springs if name == "link_spring" else chain.link_dampers
            first = physics.place.index
            found.append(links[..., first : first + 1])
    return np.concatenate(found, axis=-1)


def _servo(physics: Sequence[Physics], values: Sequence[Floats], chain: Chain | Chains) -> Floats:
    """Return stiffness, damping, back-EMF, limit and what of the back-EMF goes when it is off.

    Of the servo, (..., 5); without one there is no limit.
    """
    loop = np.zeros((*chain.masses.shape[:-1], 5))
    loop[..., 3] = np.inf
    for p, own in zip(physics, values, strict=True):
        if p.effect.name == "position_servo":
            loop[..., :3] = own
        elif p.effect.name == "servo_limit":
            loop[..., 3] = own[..., 0]
        elif p.effect.name == "open_winding":
            loop[..., 4] = own[..., 0]
    return loop


def command_rate(
    physics: Sequence[Physics], values: Sequence[Floats], period: float, count: int
) -> Floats:
    """Return by how much a command may change in a tick (count,), as a force; inf for any.

    values (parameters,), or (count, parameters), of every effect. A goal counts by the stiffness.
    """
    found = np.full(count, np.inf)
    for p, own in zip(physics, values, strict=True):
        if p.effect.name == "rate_limit":
            found = np.minimum(found, period * own[..., 0])
        elif p.effect.name == "goal_rate_limit":
            loops = [
                v[..., 0]
                for q, v in zip(physics, values, strict=True)
                if q.effect.name == "position_servo"
            ]
            if loops:
                found = np.minimum(found, period * own[..., 0] * loops[0])
    return found
