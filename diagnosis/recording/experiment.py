"""A recording as the diagnosis sees it: one command in, one or more measured motions out."""

import itertools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from zwidth.diagnosis.recording.drive_force import FORCE, Pushed, drive_stiffness
from zwidth.diagnosis.recording.from_outside import KNOWN_FORCES, OUTSIDE, base_of, pushes_of
from zwidth.diagnosis.recording.link_force import told_by_links
from zwidth.diagnosis.recording.own import own_of
from zwidth.diagnosis.recording.strength import strengths_of
from zwidth.logs.drive_state import ENABLE, SUPPLY
from zwidth.logs.recording_file import COVARIATE
from zwidth.logs.stale import renewed, repeated
from zwidth.logs.stretches import bridged, jumps, without_gaps
from zwidth.logs.timing import examine
from zwidth.logs.uneven import evened
from zwidth.logs.wrapped import unwrapped
from zwidth.shown import Valued
from zwidth.sim.changes import Changes, changes_of
from zwidth.sim.device import Device
from zwidth.sim.predict import GROUND, Outputs
from zwidth.sim.trace import Trace

Floats = NDArray[np.float64]
OUTPUT = re.compile(r"(position|velocity)_(?:m([1-5])|link([1-4])([2-5]))$")
SHORTEST = 200
RETURNS = 1  # gap lengths after a gap until an observer has found the state again
BLOCKS = 50  # of a recording, in which pauses are sought
PAUSE = 5  # least blocks of a pause
STILL, QUIET = 0.01, 0.3  # rms of motion and of command in a pause, over that of the recording
STEADY = 0.05  # the same for the command's means over blocks; a ramp exceeds it
LATE = 0.25  # of the period: largest mean lengthening of the intervals of a late loop
SAMPLED = ("command", "measured", "sensor_error", "dropped", "force", "base", "pushes",
           "strengths", "bridged", "uncounted", "motions")  # fmt: skip
WAITS = 0.1  # of its swing: least motion in the first samples of a recording
SIMULATED = 1e-5  # noise over the swing that is added to a log without any


class Placed(Protocol):
    """A device with indices of its states and of the mass readings (`sim/reading.py`)."""

    @property
    def dof(self) -> int:
        """Index of the first velocity among the states."""
        ...

    @property
    def reads(self) -> NDArray[np.int64]:
        """Indices of the position and velocity read at each mass, (2, n)."""
        ...


class ExperimentError(ValueError):
    """A recording that cannot be diagnosed; the sentence gives advice."""


class StandsStill(ExperimentError):
    """A recording in which an output never changes."""


@dataclass(frozen=True)
class Output(Valued):
    """A measured channel: quantity ("position" or "velocity") of a mass, counted from 0.

    less: the mass relative to which a deflection of a link is measured; None for the ground. truly:
    whether it is the true state and not a sensor's reading. late [s]: time of reading after
    commands act, negative if before; ignored in comparisons.
    """

    quantity: str
    mass: int
    less: int | None = None
    truly: bool = False
    late: float = field(default=0.0, compare=False)

    @property
    def name(self) -> str:
        """Channel name in a trace."""
        return f"{self.quantity}_{self.at}"

    @property
    def at(self) -> str:
        """The place: a mass, or the link of a deflection."""
        first = self.mass + 1
        return f"m{first}" if self.less is None else f"link{first}{self.less + 1}"

    @property
    def tells_position(self) -> bool:
        """Whether the channel shows the device's position, not only its speed or a deflection."""
        return self.quantity == "position" and self.less is None


@dataclass(frozen=True)
class Covariate(Valued):
    """A recorded quantity, besides the motion, on which parameters may depend: values (ticks,)."""

    name: str
    unit: str
    values: Floats


@dataclass(frozen=True)
class Experiment(Valued):
    """command (ticks,) and measured (ticks, o) in SI, every period [s]; outputs: the o channels.

    swing: rms of the first output about its mean, in the whole recording. sensor_error (ticks,):
    the error that steps add to the first output; dropped (ticks,): commands that were not
    delivered; both count only if a model has that effect. force (ticks, n): a trial force of
    unknown cause on the masses. begins [s]: time since the start of the recording; notes: sentences
    for the answer. before: the earlier part, if this is the rest of a recording; an observer
    follows it first, since it determines states that later samples may not (a position, if only
    velocity is measured; the side of a play). changes: known differences of the device. pushed: the
    drive, if its force gives the first output. differenced: the filter coefficient of positions
    that were velocities. folded: whether a rectifying sensor was unfolded. shares: the share of
    each change of a parameter (`Model.varying`), zero if not listed. base (ticks,): acceleration of
    the base, held for a tick, if recorded; pushes (ticks, n): likewise forces on the masses.
    covariates: other recorded quantities (a temperature) on which parameters may depend. strengths
    (ticks,): recorded factor of the drive's force (0 if off, else supply over nominal voltage);
    None for 1. own: names of parameters with their own value, each with a word that is the same in
    recordings that share the value. bridged (ticks,): where nothing was measured and `measured` is
    interpolated; None for nowhere. uncounted (ticks,): samples that do not judge: bridged ones, and
    those that the observer needs after each gap to find the state again. motions (ticks, n, n): how
    a small difference in a device's n states propagates over each tick, along the motion that its
    observer found last; None if not known.
    """

    period: float
    command: Floats
    measured: Floats
    outputs: tuple[Output, ...]
    name: str = "recording"
    swing: float = 1.0
    sensor_error: Floats | None = None
    dropped: NDArray[np.bool_] | None = None
    force: Floats | None = None
    begins: float = 0.0
    notes: tuple[str, ...] = ()
    before: "Experiment | None" = None
    changes: Changes | None = None
    pushed: "Pushed | None" = None
    differenced: Mapping["Output", float] = field(default_factory=dict["Output", float])
    folded: bool = False
    shares: tuple[tuple[str, float], ...] = ()
    base: Floats | None = None
    covariates: tuple[Covariate, ...] = ()
    pushes: Floats | None = None
    strengths: Floats | None = None
    own: tuple[tuple[str, str], ...] = ()
    bridged: NDArray[np.bool_] | None = None
    uncounted: NDArray[np.bool_] | None = None
    motions: Floats | None = None

    @property
    def readings(self) -> Floats:
        """The readings that correct an observer (ticks, o); NaN where nothing was measured."""
        if self.bridged is None:
            return self.measured
        return np.where(self.bridged[:, None], np.nan, self.measured)

    @property
    def lost(self) -> NDArray[np.bool_] | None:
        """Which samples were not measured (all ticks,), those of `before` first; None for none."""
        return self._with_before(lambda e: e.bridged)

    @property
    def all_motions(self) -> Floats | None:
        """The motions (all ticks, n, n), those of `before` first; None if not known."""
        return self._with_before(lambda e: e.motions)

    def _with_before(self, of: Callable[["Experiment"], NDArray[Any] | None]) -> Any:
        parts, part = list["Experiment"](), self
        while part is not None:
            parts.insert(0, part)
            part = part.before
        each = [of(e) for e in parts]
        known = next((a for a in each if a is not None), None)
        if known is None:
            return None
        filled = [
            np.zeros((e.ticks, *known.shape[1:]), known.dtype) if a is None else a
            for a, e in zip(each, parts, strict=True)
        ]
        return np.concatenate(filled)

    @property
    def known(self) -> NDArray[np.bool_]:
        """Which samples (ticks,) count."""
        if self.uncounted is None:
            return np.ones(self.ticks, dtype=np.bool_)
        return ~self.uncounted

    @property
    def own_names(self) -> list[str]:
        """Names of own values of this recording (`model.own_values`), with origin and zeros."""
        own = [f"{target} in {word}" for target, word in self.own]
        further = [o.mass + 1 for o in self.outputs if o.tells_position and o.mass > 0]
        zeros = [f"zero_m{mass} in {self.name}" for mass in dict.fromkeys(further)]
        return [*own, f"origin in {self.name}", *zeros]

    @property
    def switched_off(self) -> bool:
        """Whether the drive is off in a part of the recording."""
        return self.strengths is not None and bool(np.any(self.strengths == 0.0))

    def strengths_in(self, part: slice) -> Floats | None:
        """Return the strengths of some samples."""
        return None if self.strengths is None else self.strengths[part]

    def on(self, device: Device) -> Device:
        """Return a device with the known differences of this recording."""
        return device if self.changes is None else self.changes.of(device)

    @property
    def ticks(self) -> int:
        """Number of samples."""
        return self.command.size

    def places(self, of: Placed) -> Outputs:
        """Return the indices of the outputs in a state, as read or as they are."""

        def place(o: Output, mass: int) -> int:
            row = int(o.quantity == "velocity")
            return row * of.dof + (mass if o.truly else int(of.reads[row, mass]))

        state = [place(o, o.mass) for o in self.outputs]
        less = [GROUND if o.less is None else place(o, o.less) for o in self.outputs]
        sensed = [o.tells_position and o.mass == 0 and not o.truly for o in self.outputs]
        return Outputs(
            np.array(state, dtype=np.int64), np.array(sensed), np.array(less, dtype=np.int64),
            np.array([o.late for o in self.outputs], dtype=np.float64),
        )  # fmt: skip

    def external(self, dof: int, force: Floats | None = None) -> Floats:
        """Return the forces besides the command on `dof` masses, in the kernel's form.

        force: in place of the recording's own `force`; recorded forces act in addition. Returns
        (ticks, dof), or (ticks, dof + 1) if the base moves, and (0, dof) for no force.
        """
        own_force = self.force if force is None else force
        acting = [f for f in (own_force, self.pushes) if f is not None]
        if not acting and self.base is None:
            return np.zeros((0, dof))
        wide = np.zeros((self.ticks, dof))
        for own in acting:
            wide[:, : own.shape[1]] += own
        return wide if self.base is None else np.column_stack([wide, self.base])

    def pushed_by(self, force: Floats) -> "Experiment":
        """Return the recording with one more force (ticks, k), on its first k masses."""
        own = np.zeros((self.ticks, 0)) if self.force is None else self.force
        wide = np.zeros((self.ticks, max(own.shape[1], force.shape[1])))
        wide[:, : own.shape[1]] += own
        wide[:, : force.shape[1]] += force
        return replace(self, force=wide)

    def unmoved(self) -> "Experiment":
        """Return the recording without forces besides its command."""
        return replace(self, force=None, base=None, pushes=None)

    def part(self, start: int, stop: int) -> "Experiment":
        """Return the samples start <= k < stop."""
        cut, first = slice(start, stop), start == 0
        return replace(
            self,
            begins=self.begins + start * self.period,
            before=self.before if first else None,
            pushed=None if self.pushed is None else self.pushed.part(cut),
            covariates=tuple(replace(c, values=c.values[cut]) for c in self.covariates),
            **{name: values[cut] for name, values in self._sampled().items()},
        )

    def joined(self) -> "Experiment":
        """Return the recording joined with the part before it: the inverse of `split`."""
        first = self.before
        if first is None:
            return self
        pushed = self.pushed
        if pushed is not None and first.pushed is not None:
            zero = np.concatenate([first.pushed.at_zero, pushed.at_zero])
            pushed = replace(pushed, at_zero=zero)
        pairs = zip(first.covariates, self.covariates, strict=True)
        own, earlier = self._sampled(), first._sampled()
        joined = {
            name: np.concatenate([earlier[name], own[name]]) for name in earlier if name in own
        }
        return replace(
            self,
            pushed=pushed,
            covariates=tuple(
                replace(a, values=np.concatenate([a.values, b.values])) for a, b in pairs
            ),
            begins=first.begins,
            before=first.before,
            **{**dict.fromkeys(SAMPLED), **joined},
        )

    def _sampled(self) -> dict[str, Any]:
        """The fields with values at every sample, (ticks, ...), by name."""
        every = {name: getattr(self, name) for name in SAMPLED}
        return {name: values for name, values in every.items() if values is not None}

    def pauses(self) -> NDArray[np.bool_]:
        """Return which samples (ticks,) belong to a pause: no command and no motion.

        Both are still, relative to the whole recording, for at least a tenth of it. A device that
        sticks under a changing command is not a pause, and is informative.
        """
        found = np.zeros(self.ticks, dtype=np.bool_)
        ends = np.linspace(0, self.ticks, BLOCKS + 1).round().astype(np.int64)
        blocks = [slice(a, b) for a, b in itertools.pairwise(ends.tolist()) if b > a]
        moves, asks = self.measured.std(axis=0), self.command.std()
        still = [bool(np.all(self.measured[b].std(axis=0) <= STILL * moves)) for b in blocks]
        for lies, run in itertools.groupby(zip(still, blocks, strict=True), lambda pair: pair[0]):
            each = [block for _, block in run]
            whole = slice(each[0].start, each[-1].stop)
            steady = np.std([self.command[block].mean() for block in each]) <= STEADY * asks
            quiet = steady and self.command[whole].std() <= QUIET * asks
            rests = np.all(self.measured[whole].std(axis=0) <= STILL * moves)
            if lies and len(each) >= PAUSE and quiet and rests:
                found[whole] = True
        return found

    def split(self, share: float = 0.7) -> "tuple[Experiment, Experiment]":
        """Return the first share of the motion, without pauses, for the fit, and the rest."""
        happens = np.cumsum(~self.pauses())
        cut = int(np.searchsorted(happens, round(share * int(happens[-1])))) + 1
        first = self.part(0, cut)
        return first, replace(self.part(cut, self.ticks), before=first)


def beginnings(experiments: Sequence[Experiment], ticks: int) -> list[Experiment]:
    """Return the first samples of recordings, equally many of each, at most `ticks` in total.

    If a recording stands still at first, they start a quarter of their number before it moves,
    since any friction predicts rest without an error.
    """
    share = max(1, ticks // len(experiments))
    return [_first_motion(e, min(share, e.ticks)) for e in experiments]


def _first_motion(e: Experiment, ticks: int) -> Experiment:
    y, least = e.measured[:, 0], WAITS * e.swing
    first = 0
    if np.std(y[:ticks]) < least:
        moves = int(np.argmax(np.abs(y - y[0]) >= least))
        first = min(max(0, moves - ticks // 4), e.ticks - ticks)
    return e.part(first, first + ticks)


def experiment(trace: Trace, device: Device, name: str = "recording") -> Experiment:
    """Return the recording of a trace.

    Without a command, or with a constant one, the motion is a free decay, which a note states.
    Raises ExperimentError, with advice, if there is no position or velocity of a mass of the
    device, too few samples, a constant or non-finite channel, a period that differs by more than
    one percent, or the unit of a linear motion for a rotary device or vice versa; DeviceError if
    the recording states impossible changes of the device.
    """
    period, masses = device.interface.period, device.chain.masses.size
    trace = _as_read(trace)
    said = cast("Mapping[str, object]", trace.facts.get("device_changes", {}))
    changes = changes_of(said, device)
    trace, pushed = _told_by_force(trace, device, changes)
    trace, cells = told_by_links(trace, device, name)
    found, beyond = _outputs(trace, device)
    one = "one mass" if masses == 1 else f"{masses} masses"
    if not found:
        raise ExperimentError(
            f"the device has {one}, but the recording has no position or velocity of a mass; name"
            f" the outputs in the recording's TOML (its channels are {', '.join(trace.channels)})"
        )
    if found[0].less is not None:
        raise ExperimentError(
            f"{found[0].name} is the deflection of a link; a diagnosis also needs the position or"
            " velocity of a mass: add one as [[output]] to the recording's TOML"
        )
    kind, unit = ("rotary", "rad") if device.rotary else ("linear", "m")
    for o in found:
        if trace.units[o.name].split("/")[0] not in (unit, ""):
            raise ExperimentError(
                f"channel {o.name!r} is in {trace.units[o.name]!r}, but the device is {kind}, with"
                f" motion in {unit!r}; correct the unit in the recording's TOML, or 'rotary' in the"
                " device file"
            )
    if len(trace) < SHORTEST:
        raise ExperimentError(
            f"the recording has {len(trace)} samples; at least {SHORTEST} are needed (10 s of"
            " motion are plenty)"
        )
    own = examine(trace.t).period  # as in the checks of the clock
    if not math.isclose(own, period, rel_tol=0.01):
        raise ExperimentError(
            f"the recording's period is {own:g} s, the device's {period:g} s; set period_s in the"
            " device's [interface] to the recording's, or resample the recording"
        )
    measured = np.column_stack([trace[o.name] for o in found])
    _refuse([(o.name, trace[o.name]) for o in found])
    command, free = _driving(trace, name)
    if changes is not None:
        command = changes.command_gain * command
    swing = float(np.std(measured[:, 0]))
    notes = free
    if trace.origin == "simulated":  # else only the kernel's substeps would be noise
        random = np.random.default_rng(0)
        measured = measured + SIMULATED * swing * random.standard_normal(measured.shape)
        notes += (
            f"{name} is a log of a simulation, which has no measurement noise:"
            f" {SIMULATED * swing:.2g} {unit} rms of noise are added",
        )
    elif beyond:
        notes += (f"{name} has {', '.join(beyond)}, which is left out: the device has {one}",)
    base, moves = base_of(trace, own, name)
    _refuse_forces(trace, device, name)
    pushes, hands = pushes_of(trace, masses, name)
    strengths, off = strengths_of(trace, device, name)
    notes += (*cells, *moves, *hands, *off)
    free_here = cast("Mapping[str, str]", trace.facts.get("free", {}))
    return Experiment(
        own, command, measured, tuple(found), name, swing, notes=notes, changes=changes,
        pushed=pushed, base=base, pushes=pushes, covariates=_covariates(trace),
        strengths=strengths, own=own_of(free_here, device),
    )  # fmt: skip


def _as_read(trace: Trace) -> Trace:
    """Return the trace; in a log of a simulation with filtered readings, m1 is as read."""
    read = "position_filtered_m1"
    if trace.origin != "simulated" or read not in trace.channels:
        return trace
    while (again := read.replace("filtered", "filtered_filtered", 1)) in trace.channels:
        read = again
    return trace.with_channels({**trace.channels, "position_m1": trace[read]})


def _covariates(trace: Trace) -> tuple[Covariate, ...]:
    """The quantities on which parameters may depend; missing samples are interpolated linearly."""
    found: list[Covariate] = []
    for channel in (c for c in trace.channels if c.startswith(f"{COVARIATE}_")):
        values = trace[channel]
        known = np.isfinite(values)
        if not known.any():
            raise ExperimentError(
                f"channel {channel!r} has no finite value; take its [[covariate]] out of the"
                " recording's TOML"
            )
        whole = np.interp(np.arange(values.size), np.flatnonzero(known), values[known])
        name = channel.removeprefix(f"{COVARIATE}_")
        found.append(Covariate(name, trace.units[channel], whole))
    return tuple(found)


def _told_by_force(
    trace: Trace, device: Device, changes: Changes | None
) -> tuple[Trace, Pushed | None]:
    """Return a trace with the position from a recorded drive force first, and the drive."""
    if FORCE not in trace.channels or "command" not in trace.channels:
        return trace, None
    if "position_m1" in trace.channels:
        return trace, None
    stiffness = drive_stiffness(device, changes)
    if stiffness == 0.0:
        raise ExperimentError(
            f"the recording has the force of the drive, {FORCE}; the position can be computed from"
            " it only for a drive with stiffness and without damping: describe such a drive in the"
            ' device file ([drive] kind = "position"), or name another output'
        )
    counts = 1.0 if changes is None else changes.command_gain
    pushed = Pushed(counts * device.interface.command_gain * trace["command"], stiffness)
    length = "rad" if device.rotary else "m"
    channels = {"position_m1": pushed.position(trace[FORCE])} | dict(trace.channels)
    units = {**trace.units, "position_m1": length}
    told = Trace(trace.t, channels, units, trace.origin, trace.facts)
    return told, pushed


def _driving(trace: Trace, name: str) -> tuple[Floats, tuple[str, ...]]:
    """Return the command (ticks,), zero if none was recorded, and a note."""
    if "command" not in trace.channels:
        free = not any(c in trace.channels for c in OUTSIDE)
        drives = "nothing drives" if free else "no command drives"
        said = f"{name} has no command: it is taken as a motion that {drives}"
        return np.zeros(len(trace)), (f"{said}; give the input in its TOML if something did",)
    _refuse_unknown("command", trace["command"])
    command = np.ascontiguousarray(trace["command"])
    if np.ptp(command) > 0.0:
        return command, ()
    at = f"the command of {name} is constant at {command[0]:g}"
    return command, (f"{at}: what moves is taken as a free motion",)


def _outputs(trace: Trace, device: Device) -> tuple[list[Output], list[str]]:
    """Return the motions that a device has, and the names of motions of masses that it lacks."""
    masses = device.chain.masses.size
    found: list[Output] = []
    beyond: list[str] = []
    for channel in trace.channels:
        match = OUTPUT.match(channel)
        if match is None:
            continue
        ends = [int(end) for end in match.groups()[1:] if end]
        if max(ends) > masses:
            beyond.append(channel)
        else:
            found.append(Output(match[1], ends[0] - 1, ends[1] - 1 if ends[1:] else None))
    found.sort(key=lambda o: o.less is not None)  # motions of masses before deflections
    if trace.origin == "simulated":  # a log has every state; only the encoder's reading is used
        found = [o for o in found if o.name == "position_m1"]
    return found, beyond


def stretches(trace: Trace, device: Device, name: str = "recording") -> list[Experiment]:
    """Return a recording as the stretches between its gaps, usually one.

    Short gaps are bridged (`Experiment.bridged`). Longer gaps and jumps of the clock would look
    like physics in one recording. A sample at which the command or an output is not finite counts
    as lost. Raises ExperimentError like `experiment`, and if no stretch is long enough.
    """
    used = [o.name for o in _outputs(trace, device)[0]]
    used += [c for c in trace.channels if c.startswith("force_")]
    used += [c for c in ("command", ENABLE, SUPPLY, *OUTSIDE) if c in trace.channels]
    kept, lacking = without_gaps(trace, sorted(used), name)
    kept, odd = _as_it_moved(kept, device.interface.period, used, name)
    kept, filled, over = bridged(kept, trace, used, device.interface.period)
    lacking = f"{lacking}; {over}" if lacking and over else lacking
    odd += [f"{name}: {over}"] if over and not lacking else []
    try:
        whole = experiment(kept, device, name)
    except ExperimentError as error:
        if not lacking:
            raise
        raise type(error)(f"{lacking}; without them {error}") from None
    if lacking:
        first = float(kept.t[0] - trace.t[0])
        whole = replace(whole, begins=first, notes=(*whole.notes, lacking))
    whole = replace(whole, notes=(*whole.notes, *odd))
    if filled.any():
        whole = replace(whole, bridged=filled, uncounted=uncounted(filled))
    cuts = jumps(kept.t, whole.period)
    if cuts.size == 0:
        return [whole]
    ends = [0, *(int(j) for j in cuts), whole.ticks]
    pairs = [(a, b) for a, b in itertools.pairwise(ends) if b - a >= SHORTEST]
    first = int(cuts[0])
    far = float(kept.t[first] - kept.t[first - 1])
    count = "once" if cuts.size == 1 else f"{cuts.size} times"
    over = ", also over samples that lack," if lacking else ""
    after = f"first by {far:.4g} s after {kept.t[first - 1]:g} s"
    parts = [replace(whole.part(a, b), begins=float(kept.t[a] - trace.t[0])) for a, b in pairs]
    still = np.ptp(whole.command) == 0.0  # then parts need not have one
    parts = [p for p in parts if np.all(np.ptp(p.measured, axis=0))]
    parts = [p for p in parts if still or np.ptp(p.command)]
    if not parts:
        raise ExperimentError(
            f"the clock of {name} jumps{over} {count}, {after}, and nowhere between two jumps are"
            f" there {SHORTEST} samples in motion; record without gaps, or write resample = true"
            " into"
            " the recording's TOML"
        )
    left = whole.ticks - sum(p.ticks for p in parts)
    short = f"; {left} samples of short or still ones are left out" if left else ""
    one = "one stretch" if len(parts) == 1 else f"{len(parts)} stretches"
    note = (
        f"the clock of {name} jumps{over} {count}, {after}: it is taken as {one} without jumps"
        f"{short}"
    )
    rest = [replace(part, notes=()) for part in parts[1:]]  # mentioned once
    return [replace(parts[0], notes=(*whole.notes, note)), *rest]


def uncounted(bridged: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which samples (ticks,) do not count: gaps, and `RETURNS` times as many after each.

    An observer predicts over a gap without correction, and its first errors after it are larger. On
    two masses with a mode of 34 Hz at 500 Hz, under an unknown force as large as the command, with
    10 of every 60 samples lost, the counted samples have the same deviation as without gaps, to 1.3
    %, and all parameters are as close to the truth, relative to their errors. If the samples after
    gaps counted too, the deviation would be 1.55 times as large, and a mass wrong by 5 of its
    errors. (`noise.gaps` gives the gains after a gap; with the steady gain a damper was wrong by 5
    in any case.)
    """
    found = bridged.copy()
    edges = np.flatnonzero(np.diff(bridged.astype(np.int8), prepend=0, append=0))
    for first, after in edges.reshape(-1, 2).tolist():
        found[after : after + RETURNS * (after - first)] = True
    return found


def _as_it_moved(
    trace: Trace, period: float, used: Sequence[str], name: str
) -> tuple[Trace, list[str]]:
    """A trace with faults of its sensors and its clock corrected, and notes on them.

    Raises ExperimentError if a sensor is read more slowly than the log is written.
    """
    if trace.origin != "recorded":
        return trace, []
    moves = [c for c in used if c not in ("command", ENABLE, SUPPLY, *OUTSIDE)]
    positions = [c for c in moves if c.startswith("position_m")]
    for channel in moves:
        if (times := repeated(trace[channel])) > 1:
            slow = times * float(np.median(np.diff(trace.t)))
            raise ExperimentError(
                f"channel {channel!r} repeats every reading {times} times: it was read every"
                f" {slow:g} s; write resample = {slow:g} into the recording's TOML and period_s ="
                f" {slow:g} into the device's [interface]"
            )
    trace, wrapped = unwrapped(trace, positions, name)
    trace, stale = renewed(trace, positions, name)
    uneven = ""
    if math.isclose(float(np.ptp(trace.t)), period * (len(trace) - 1), rel_tol=LATE):
        before, carried = trace, [c for c in used if c in OUTSIDE]
        trace, uneven = evened(trace, period, [*moves, *carried], name)
        lost = [c for c in before.channels if c not in trace.channels and c.startswith(COVARIATE)]
        slow = {c: np.interp(trace.t, before.t, before[c]) for c in lost}
        trace = trace.with_channels({**trace.channels, **slow}, trace.t)
    return trace, [said for said in (wrapped, stale, uneven) if said]


def _refuse_unknown(name: str, values: Floats) -> None:
    bad = int(np.count_nonzero(~np.isfinite(values)))
    if bad:
        raise ExperimentError(
            f"channel {name!r} has {bad} values that are not finite; cut them out with [use]"
        )


def _refuse_forces(trace: Trace, device: Device, name: str) -> None:
    """Refuse known forces on masses that a device lacks, or in another unit."""
    masses, unit = device.chain.masses.size, "N m" if device.rotary else "N"
    for place, channel in enumerate(KNOWN_FORCES):
        if channel not in trace.channels:
            continue
        if place >= masses:
            raise ExperimentError(
                f"{name} has {channel}, but the device has {masses}"
                f" mass{'' if masses == 1 else 'es'}; give one of these"
            )
        if trace.units[channel] not in (unit, ""):
            raise ExperimentError(
                f"channel {channel!r} is in {trace.units[channel]!r}, but the device is driven in"
                f" {unit!r}; correct the unit in the recording's TOML"
            )
        _refuse_unknown(channel, trace[channel])


def _refuse(channels: Sequence[tuple[str, Floats]]) -> None:
    for name, values in channels:
        _refuse_unknown(name, values)
        if np.ptp(values) == 0.0:
            raise StandsStill(
                f"channel {name!r} is constant at {values[0] + 0.0:g}; record while the device"
                " moves"
            )
