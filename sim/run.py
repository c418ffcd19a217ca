"""Simulate: a device under a controller, from a start, for a time."""

import enum
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from zwidth.shown import Shown, Valued
from zwidth.sim.controller import Controller
from zwidth.sim.device import Device
from zwidth.sim.equations import Equations, equations, ledger_names
from zwidth.sim.estimators import ESTIMATORS, Settings
from zwidth.sim.kernel import (
    DONE,
    ESCAPED,
    MAX_COLUMNS,
    NOT_FINITE,
    Memory,
    across,
    advance,
    read_position,
    scratch,
)
from zwidth.sim.physics.dispatch import first_internal
from zwidth.sim.smooth_command import held_for
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
BLOCK_TICKS = 1000
ESTIMATOR_OF = {e.code: e for e in ESTIMATORS.values()}


class Outcome(enum.Enum):
    """How a run ended; the value is the sentence."""

    COMPLETED = "the run completed"
    ESCAPED = "the position exceeded the bound and the run was stopped"
    NOT_FINITE = "the state overflowed and the run was stopped"


OUTCOMES = {DONE: Outcome.COMPLETED, ESCAPED: Outcome.ESCAPED, NOT_FINITE: Outcome.NOT_FINITE}


@dataclass(frozen=True)
class Start(Valued):
    """Initial positions and velocities of the masses; a single number is used for every mass.

    The encoder's earlier reading is computed as if the mass had arrived at this velocity.
    """

    position: float | Sequence[float] = 0.0
    velocity: float | Sequence[float] = 0.0

    def state(self, dof: int, places: int | None = None) -> Floats:
        """Return (32,) padded [q_1..q_n, v_1..v_n]; raises ValueError (field, length, value).

        places: index of the first velocity, if there are states besides those of the masses.
        """
        padded = np.zeros(MAX_COLUMNS)
        for offset, field in ((0, "position"), (dof if places is None else places, "velocity")):
            values = np.asarray(getattr(self, field), dtype=np.float64)
            if values.ndim > 1 or (values.ndim == 1 and values.size != dof):
                raise ValueError(
                    f"start.{field} has {values.size} values; give one, or one for each of {dof}"
                    " masses"
                )
            if not np.all(np.isfinite(values)):
                raise ValueError(f"start.{field} is {values}; only finite numbers are allowed")
            padded[offset : offset + dof] = values
        return padded


@dataclass(frozen=True, repr=False)
class Run(Shown):
    """A finished run: its trace, how it ended, the final state and the energy ledger [J].

    trace has one sample per tick, taken at t = kT before the chain moves. fine has one sample per
    substep (positions and velocities), if requested. ledger: work done by motor and disturbance,
    energy taken by each damper and effect. The balance is stored - stored at start = motor +
    disturbance - taken. Two entries are not part of the balance: `wall`, the work of the command at
    the sampled port (what a passivity observer sees), and `actuator_lag`, the work that the command
    would have done without the lag, minus that of the motor.
    """

    trace: Trace
    outcome: Outcome
    memory: Memory
    ledger: Mapping[str, float]
    fine: Trace | None = None


def let_follow(x: Floats, dof: int, followers: NDArray[np.int64], behind: Floats) -> None:
    """Set filtered readings of a state to their values after long motion at its speeds.

    In place. dof: number of positions; other arguments as in `Equations`.
    """
    for (place, source), late in zip(followers.tolist(), behind.tolist(), strict=True):
        x[dof + place] = x[dof + source]
        x[place] = x[source] - late * x[dof + source]


def start_memory(
    eq: Equations, start: Start, memory: int = 1, entries: int = 0, began: float = 0.0
) -> Memory:
    """Return the memory at tick 0: no command yet, and an encoder consistent with the start.

    memory: number of values that the controller stores; entries: number of entries of the ledger;
    began [s]: time from the beginning of the recording to the beginning of this part.
    """
    x = start.state(eq.dof - eq.followers.shape[0], eq.dof)
    let_follow(x, eq.dof, eq.followers, eq.behind)
    q, v = x[eq.read], x[eq.dof + eq.read]
    before = read_position(eq, q - eq.period * v)
    earlier = read_position(eq, q - v / eq.rate)
    settings = Settings(1.0 / eq.rate, eq.window, 0.0, 0.0, 0.0)
    estimates = ESTIMATOR_OF[eq.estimator].begin(
        settings, lambda k: read_position(eq, q - k * v / eq.rate), v
    )
    internal = [
        first_internal(code, across(x, 0, i, origin), p)
        for code, i, _, origin, p in zip(*eq.forces, strict=True)
    ]
    return Memory(
        x=x,
        line=np.zeros(eq.whole_delay + 2),
        controller=np.zeros(memory),
        internal=np.array(internal, dtype=np.float64),
        scalars=np.array([before, x[eq.dof], 0.0, 0.0, earlier, 0.0, before, began, *estimates]),
        counters=np.zeros(2, dtype=np.int64),
        totals=np.zeros(entries),
    )


@dataclass(frozen=True)
class Setup:
    """A run that is ready to start; `blocks` runs it piece by piece, for writing a log."""

    device: Device
    controller: Controller
    ticks: int
    eq: Equations
    memory: Memory
    external: Floats
    bound: float
    energy: bool
    fine: bool
    ledger_names: Sequence[str]

    def blocks(self, ticks: int = BLOCK_TICKS) -> Iterator[tuple[Trace, Trace | None, Outcome]]:
        """Yield (trace, fine trace or None, outcome so far) for every `ticks` ticks.

        This works only once, since the memory then is that of the end. Raises ValueError the second
        time.
        """
        if self.memory.counters[0] != 0:
            raise ValueError("this run has already begun; prepare it again to repeat it")
        for first in range(0, self.ticks, ticks):
            count = min(ticks, self.ticks - first)
            record = np.zeros((count, len(self.channel_units)))
            per_tick = int(self.eq.substeps.sum())
            fine = np.zeros((count * per_tick if self.fine else 0, self.eq.states))
            done, status = advance(
                self.eq, self.controller.step, self.controller.parameters, self.memory,
                scratch(self.eq), count, self.external[first : first + count], self.bound,
                record, fine, self.energy,
            )  # fmt: skip
            t = np.arange(first, first + done, dtype=np.float64) * self.eq.period
            yield (
                self._trace(t, record[:done], self.channel_units),
                self._fine_trace(t, fine[: done * per_tick]) if self.fine else None,
                OUTCOMES[status],
            )
            if status != DONE:
                return

    @property
    def channel_units(self) -> dict[str, str]:
        """Name -> unit of every recorded column, in order."""
        force, position = ("N m", "rad") if self.device.rotary else ("N", "m")
        names = self._state_units()
        names |= {"encoder": position, "velocity_estimate": f"{position}/s"}
        names |= {"command": force, "applied": force, "contact": "", "at_rest": ""}
        if self.energy:
            names["stored_energy"] = "J"
            names |= {f"work_{entry}": "J" for entry in self.ledger_names}
        return names

    def _state_units(self) -> dict[str, str]:
        force, position = ("N m", "rad") if self.device.rotary else ("N", "m")
        places = self._places()
        names = {f"position_{place}": position for place in places}
        names |= {f"velocity_{place}": f"{position}/s" for place in places}
        return names | ({"actuator_force": force} if self.eq.lagging else {})

    def _places(self) -> list[str]:
        """Masses, then readings that follow one: filtered_m1, twice_filtered_m1 and so on."""
        own = self.eq.dof - self.eq.followers.shape[0]
        names = [f"m{i + 1}" for i in range(own)]
        for _, source in self.eq.followers.tolist():
            name = f"filtered_{names[source]}"
            names.append(name + "_again" * names.count(name))
        return names

    def _trace(self, t: Floats, rows: Floats, units: dict[str, str]) -> Trace:
        columns = dict(zip(units, np.ascontiguousarray(rows.T), strict=True))
        for name in columns if self.eq.position_origin != 0.0 else ():
            if name.startswith("position_"):
                columns[name] = columns[name] + self.eq.position_origin
        return Trace(t, columns, units, "simulated", MappingProxyType({"device": self.device.name}))

    def _fine_trace(self, t: Floats, rows: Floats) -> Trace:
        steps = np.repeat(self.eq.durations, self.eq.substeps)
        within = np.cumsum(steps)
        times = (t[:, None] + within[None, :]).ravel()
        return self._trace(times, rows, self._state_units())


def prepare(
    device: Device,
    controller: Controller,
    *,
    duration: float,
    start: Start = Start(),
    disturbance: Floats | None = None,
    substeps: int = 1,
    seed: int = 0,
    bound: float = 1e6,
    energy: bool = False,
    ledger: bool = False,
    fine: bool = False,
) -> Setup:
    """Check and set up a run; see `simulate` for the arguments."""
    eq = equations(device, substeps, ledger, seed)
    ticks = duration_ticks(duration, eq.period)
    if not bound > 0.0:
        raise ValueError(f"bound is {bound}; the position at which a run is stopped must be > 0")
    external = _external(disturbance, ticks, eq.dof - eq.followers.shape[0], eq.dof)
    names = ledger_names(device, device.plant()) if ledger else []
    from_rest = Start((np.asarray(start.position) - eq.position_origin).tolist(), start.velocity)
    memory = start_memory(eq, from_rest, controller.memory, len(names))
    if device.interface.command_hold == "smooth" and controller.kind == "recorded":
        controller = replace(controller, parameters=held_for(controller.parameters))
    return Setup(
        device, controller, ticks, eq, memory, external, bound, energy or ledger, fine, names
    )


def simulate(
    device: Device,
    controller: Controller,
    *,
    duration: float,
    start: Start = Start(),
    disturbance: Floats | None = None,
    substeps: int = 1,
    seed: int = 0,
    bound: float = 1e6,
    energy: bool = False,
    ledger: bool = False,
    fine: bool = False,
) -> Run:
    """Run a device under a controller for `duration` seconds.

    disturbance: external forces [N m | N], shape (ticks,) on m1 or (ticks, n), each held for one
    tick; (ticks, n + 1) if followed by the acceleration of a moving base [rad/s2 | m/s2], relative
    to which positions are then counted. substeps: per tick; one is exact without continuous-time
    nonlinearity; raise it for friction and smooth forces. seed: of random events (lost samples).
    bound: the run stops when |position of m1| exceeds it. energy: record the stored energy; ledger:
    record also the work of motor, wall, each damper and effect. fine: keep the states after every
    substep.

    Raises ValueError with one sentence for a bad argument.
    """
    setup = prepare(
        device, controller, duration=duration, start=start, disturbance=disturbance,
        substeps=substeps, seed=seed, bound=bound, energy=energy, ledger=ledger, fine=fine,
    )  # fmt: skip
    (trace, fine_trace, outcome), *_ = setup.blocks(setup.ticks)
    totals = dict(zip(setup.ledger_names, setup.memory.totals.tolist(), strict=True))
    return Run(trace, outcome, setup.memory, totals, fine_trace)


def duration_ticks(duration: float, period: float) -> int:
    """Return the whole number of ticks in a duration [s]; raises ValueError if there is none."""
    if not 0.0 < duration < np.inf:
        raise ValueError(f"duration is {duration}; a finite time > 0 s is needed")
    return max(1, round(duration / period))


def _external(disturbance: Floats | None, ticks: int, dof: int, places: int) -> Floats:
    if disturbance is None:
        return np.zeros((0, places))
    values = np.asarray(disturbance, dtype=np.float64)
    if values.ndim == 1:
        values = np.column_stack([values, np.zeros((values.size, dof - 1))])
    if values.shape not in ((ticks, dof), (ticks, dof + 1)):
        raise ValueError(
            f"disturbance has shape {values.shape}; the run needs ({ticks},) or ({ticks}, {dof}),"
            f" or ({ticks}, {dof + 1}) if the base moves"
        )
    if not np.all(np.isfinite(values)):
        raise ValueError("disturbance contains a value that is not finite")
    followers = np.zeros((ticks, places - dof))
    return np.hstack([values[:, :dof], followers, values[:, dof:]])
