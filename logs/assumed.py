"""A complete recording TOML for a file without a description, and its assumptions in sentences.

`guess.draft` leaves unknown entries open for a person to fill in. This TOML is used at once: it
assumes SI if no unit is given, 1000 samples per second if there is no time, and a scale of one if
the scale is unknown, so that forces are in the command's own unit. It states these assumptions,
asks if somebody can answer, and reports doubtful numbers: a step of 0.09 in an angle is 360 degrees
/ 4000, and no encoder has such a step in radians.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import tomli_w

from zwidth.logs.guess import (
    clock_lines,
    look,
    naming,
    period_told,
    plain,
    row_count,
    seconds_of,
    since_1970,
    time_seen,
    unit_spelled,
)
from zwidth.logs.names import (
    Naming,
    kind_words,
    only_measured,
    together,
    tool_units,
    words_of,
)
from zwidth.logs.roles import (
    NOTHING_NEW,
    RATE,
    SCALED,
    differing,
    follows,
    of_joint,
    rank,
    sided,
    span,
    speed_of,
    supplies,
)
from zwidth.logs.source import RecordingError, Signal, Source
from zwidth.logs.steps import step_seen
from zwidth.logs.timing import examine
from zwidth.logs.units import ELECTRICAL, GOAL, SI, TURN, Unit, find_unit
from zwidth.sim.nearest import nearest

Ask = Callable[[str, Sequence[str], str], str]
"""Asks a question with possible answers (none: any text) and a default, which Enter chooses."""

GOAL_OF_LOOP, BARE_GOAL, MEASURED, BARE_COMMAND, GOAL_OF_SPEED = 5.0, 6.2, 6.5, 7.5, 8.0
"""Ranks after the direct commands (`roles.rank`): goals that are named, bare, and of a speed. A
measured torque or current comes after the goal of the loop that produces it."""
SPEED_GOAL = "is a speed to go to"  # part of a doubt that `zwidth/speed_loops.py` resolves
OF_AMPLIFIER = {"current": "A", "voltage": "V"}
MOTIONS = ("position", "velocity")
NO_COMMAND = ("other", "acceleration", "error")
PERIOD_S = 0.001
DAYS = ((36_526.0, 73_050.0), (730_486.0, 767_010.0))  # 2000 to 2100 in Excel, and in MATLAB
SHORTEST_S = 2e-5  # in days (1.7 s): smaller steps in that range show that days are counted
FEWEST = 10  # samples in a column, below which nothing is guessed from its values
TURNS, METRES = 5.0, 3.0  # travel beyond which radians and metres are doubtful
LEAST_LINES, MOST_LINES = 100.0, 1e7  # per turn of an encoder
WHOLE = 2e-3  # of a line: largest deviation of the lines per turn from a whole number
COUNTED = 64.0  # travel in whole numbers, above which a position without a unit is in counts
COUNTS = "counts"
USUAL_RATES = (
    1.0,
    1.2,
    1.25,
    1.5,
    2.0,
    2.4,
    2.5,
    3.0,
    4.0,
    5.0,
    6.0,
    8.0,
)  # Hz, times powers of 10
NEAR = 0.025  # largest deviation of a rate found by a speed from a usual one (rpm and rad: 4.5 %)
FINE, FINE_STEP = {"sample", "time", "fine"}, 4000.0  # Xsens: 10 kHz in MTi, 1 MHz in DOT
NOBODY = "none"


@dataclass(frozen=True)
class Channel:
    """A signal as a channel: name, unit as spelled (None: unknown), and its lines in the TOML.

    per: the key and the number of counts if a count is treated as one SI unit; goal and motion of a
    loop both state it, so that one number corrects both.
    """

    signal: str
    unit: str | None
    scale: float | None = None
    note: str = ""
    per: tuple[str, float] | None = None


@dataclass
class Assumed:
    """The text of a TOML, its interpretation of the file (role, sentence), and its doubts."""

    text: str = ""
    roles: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    doubts: list[str] = field(default_factory=list[str])


def assumed(
    source: Source,
    file: str,
    ask: Ask | None = None,
    joint: str | None = None,
    given: Mapping[str, str] | None = None,
) -> Assumed:
    """Return the assumed meaning of a file's signals; file: its path as written in the TOML.

    ask: asks a person, if somebody can answer. joint: the number or name of the joint to use, if a
    file has several. given: time, command, position or velocity -> the signal that the user chose
    for it. Raises RecordingError if nothing in it seems to move, or there is no such joint.
    """
    with np.errstate(all="ignore"):  # an overflow means no similarity
        return _Reader(source, file, ask, joint, given or {}).read()


@dataclass(frozen=True)
class Joints:
    """The joints of a file: moving ones by their name for `joint`, with signals; still ones."""

    moving: dict[str, str]
    still: tuple[str, ...]


def joints_of(source: Source) -> Joints:
    """Return the joints whose motion a file contains.

    Raises RecordingError if fewer than two move, as in a file of one device.
    """
    with np.errstate(all="ignore"):
        return _Reader(source, source.path.name, None, None, {}).joints()


class _Reader:
    def __init__(
        self,
        source: Source,
        file: str,
        ask: Ask | None,
        joint: str | None,
        given: Mapping[str, str],
    ) -> None:
        self.source, self.file, self.ask, self.joint = source, file, ask, joint
        for role, name in given.items():
            if name not in source.signals:
                raise RecordingError(
                    f"{role} is {name!r}, which is not a column of numbers;"
                    f" {nearest(name, source.signals)}"
                )
        sizes = {role: source.signals[name].values.size for role, name in given.items()}
        if len(set(sizes.values())) > 1:
            said = " and ".join(f"{role} {given[role]!r} has {n}" for role, n in sizes.items())
            raise RecordingError(f"{said} samples; they must have equally many")
        self.given = given
        self.told = {
            name: told
            for name, told in tool_units(list(source.signals)).items()
            if unit_spelled(source.signals[name]) is None
        }
        units = {n: replace(source.signals[n], unit=unit) for n, (unit, _) in self.told.items()}
        source = self.source = replace(source, signals={**source.signals, **units})
        self.seen = {one.name: one for one in look(source)}
        self.names = {name: naming(signal) for name, signal in source.signals.items()}
        for name in only_measured(list(source.signals)):
            self.names[name] = replace(self.names[name], role="measured")
        self.names |= together(list(source.signals))
        self.rows = row_count(source)
        self.found = Assumed()
        self.goal = False
        self.speed = False  # whether the command is the goal of a loop on the speed
        self.counted = False  # whether the position is in counts
        self.t = np.empty(0)
        self.clock: list[str] = []  # the line of a period found from a speed
        self.guessed: int | None = None  # index of the doubt that the period is a guess

    def read(self) -> Assumed:
        self._are_some()
        time = self._time()
        outputs = self._outputs()
        time = self.clock or time
        command = self._command(outputs)
        rotary = self._rotary([*outputs.values(), *([command] if command else [])])
        told = {
            key: self._channel(name, key.split("_")[0], rotary) for key, name in outputs.items()
        }
        if self.goal and command is not None:
            told = self._alike(command, told, rotary)
        motion = next(iter(told.values()))
        driven = self._driven(command, rotary, motion) if command else None
        time = [*time, *self._resampled([*outputs.values(), *([command] if command else [])])]
        lines = [
            "# What zwidth takes this file for. Correct what is wrong: an edited file is kept, and",
            "# is read in place of a new guess. Every key: docs/reference/recording_file.md",
            _line("file", self.file),
            *time,
            f"rotary = {'true' if rotary else 'false'} # {'N m and rad' if rotary else 'N and m'}",
        ]
        if driven is not None:
            lines += ["", "[input] # the command", *_lines(driven)]
        for key, channel in told.items():
            quantity, at = key.split("_")
            lines += ["", "[[output]]", *_lines(channel)]
            lines += [_line("quantity", quantity), _line("at", at)]
        self.found.text = "\n".join(lines) + "\n"
        self._say_rest({*outputs.values(), command or ""})
        return self.found

    def _are_some(self) -> None:
        """Raise RecordingError if there are too few samples to recognise the columns."""
        most = max((int(one.known.sum()) for one in self.source.signals.values()), default=0)
        if most < FEWEST and self.source.unreadable:
            name, reason = next(iter(self.source.unreadable.items()))
            raise RecordingError(
                f"{self.source.path.name} holds no row of {FEWEST} numbers or more:"
                f" {plain(name)} {plain(reason)}"
            )
        if most < FEWEST:
            raise RecordingError(
                f"{self.source.path.name} holds {most} sample{'s' * (most != 1)}, too few to see"
                " what its columns are: some seconds of motion are needed; check whether the file"
                " was written to its end"
            )

    # --- time

    def _time(self) -> list[str]:
        roles = self.found.roles
        if any(signal.stamps for signal in self.source.signals.values()):
            roles.append(("time", "the clock of the messages"))
            names = [n for n, one in self.seen.items() if one.seems in SI]
            return clock_lines(self.source, names)
        if "time" in self.given:
            time, refused = self.source.signals[self.given["time"]], []
        else:
            time, refused = time_seen(self.source)
        if time is None:
            return self._period(refused)
        unit = find_unit(unit_spelled(time) or "")
        spelled = unit_spelled(time)
        if unit is None or unit.si != "s":
            spelled = self._time_unit(time)
            unit = find_unit(spelled)
        assert unit is not None
        self.t = seconds_of(time, unit.factor)
        rate = examine(np.asarray(self.t[time.known], dtype=np.float64)).rate
        roles.append(("time", f"{time.name} [{spelled}], {rate:.6g} samples a second"))
        named = [] if unit.factor == 1.0 else [_line("time_unit", str(spelled))]
        return [_line("time", time.name), *named]

    def _period(self, refused: Sequence[str]) -> list[str]:
        """Return the line on the period of a file without a time, as stated or assumed."""
        roles, doubts = self.found.roles, self.found.doubts
        told = period_told(self.source)
        why = f" ({'; '.join(refused[:4])})" if refused else ""
        if told is not None:
            period, where = told
            roles.append(("time", f"samples every {period:.6g} s, by {where}"))
            if why:
                doubts.append(f"no column is used as time{why}: {where} gives the period")
        else:
            given = self._asked("sampling period in seconds", [], f"{PERIOD_S:g}")
            period, where = _positive(given) or PERIOD_S, "no column seems to be time"
            roles.append(("time", f"no column of it; samples every {period:g} s"))
            if self.ask is None:
                self.guessed = len(doubts)
                doubts.append(
                    f"no column seems to be time{why}, so {1.0 / period:g} samples a second are"
                    " assumed: masses, dampers and times are as wrong as that is; correct period_s"
                )
        self.t = period * np.arange(self.rows)
        return [f"period_s = {period!r} # {_printable(where)}"]

    def _time_unit(self, time: Signal) -> str:
        """Return the unit of stamps that have none: by the year, or by the period it gives."""
        values = time.floats()[time.known]
        if (unit := since_1970(float(values[0]))) is not None:
            return unit
        steps = np.diff(values)
        step = float(np.median(steps[steps > 0.0]))
        if step < SHORTEST_S and any(least < float(values[0]) < most for least, most in DAYS):
            self.found.doubts.append(
                f"{time.name} counts days, as Excel and MATLAB write a date: taken as days"
            )
            return "day"
        if {*words_of(time.name)} == FINE:
            return "100us" if step < FINE_STEP else "us"
        likely = next(u for u, least in (("ns", 1e5), ("us", 200.0), ("ms", 0.5), ("s", 0.0))
                      if step >= least)  # fmt: skip
        if likely != "s":
            likely = self._asked(f"unit of the time {time.name!r}, steps of {step:g}",
                                 ("s", "ms", "us", "ns"), likely)  # fmt: skip
            self.found.doubts.append(
                f"{time.name} has steps of {step:g} and no unit: taken as {likely}; correct"
                " time_unit if it is another, or give period_s if it only counts samples"
            )
        return likely

    def _resampled(self, names: Sequence[str]) -> list[str]:
        """Return the line that brings signals in rows of their own onto one axis, if they are."""
        known = {name: self.source.signals[name].known for name in names}
        if any(self.source.signals[name].stamps for name in names) or self.t.size == 0:
            return []
        first = known[names[0]]
        apart = [k for k in known.values() if (k & first).sum() < 0.1 * min(k.sum(), first.sum())]
        if not apart or first.sum() < FEWEST:
            return []
        t = np.asarray(self.t, dtype=np.float64)
        own = [examine(t[k & np.isfinite(t)]).period for k in known.values()]
        self.found.doubts.append(
            f"{_words(names)} are in rows of their own, as signals with clocks of their own are:"
            f" they are resampled to one axis of {own[0]:.6g} s"
        )
        return [f"resample = {float(f'{own[0]:.9g}')!r} # signals with clocks of their own"]

    # --- what moves, what drives

    def _motions(self, quantity: str, constant: bool = False) -> list[str]:
        """Return the signals that were measured of a quantity, those that say so first."""
        found = [
            name
            for name, said in self.names.items()
            if said.quantity == quantity
            and said.moves
            and (constant or self.seen[name].seems != "constant")
            and self._is_long(name)
        ]
        return sorted(found, key=lambda name: self.names[name].role != "measured")

    def _is_long(self, name: str) -> bool:
        """Whether it is a signal, and neither a setting of the run nor a time."""
        one = self.seen[name]
        if one.seems == "time" or name == self.given.get("time"):
            return False
        return one.samples == self.rows or bool(one.rate)

    def _open(self) -> list[str]:
        """Return the signals whose meaning is unknown."""
        return [n for n, one in self.seen.items() if one.seems == "" and self._is_long(n)]

    def _outputs(self) -> dict[str, str]:
        if named := {f"{q}_m1": self.given[q] for q in MOTIONS if q in self.given}:
            for key, name in named.items():
                self.names[name] = replace(self.names[name], quantity=key[:-3], role="measured")
            return named
        for quantity in ("position", "velocity"):
            known = self._motions(quantity)
            if known and self.joint:
                known = self._of_joint(known)
            if known:
                outputs = self._placed(quantity, known)
                if quantity == "position" and len(outputs) == 1:
                    outputs |= self._speed_beside(outputs["position_m1"])
                return outputs
        if len(self._signals()) == 1:
            raise RecordingError(
                f"{self.source.path.name} is one column, {self._signals()[0]}, and both a"
                " command and a motion are needed; if they are in files of their"
                " own, name each with file = in [input] and [[output]] of one recording TOML"
            )
        rest = [n for n in self._open() if self.names[n].role == "measured"]
        rest = rest or [n for n in self._open() if self.names[n].role == ""]
        if not rest:
            others = [n for n in self._signals() if self.seen[n].seems != "time"] or ["none"]
            raise RecordingError(
                f"{self.source.path.name} has no column that seems to be a position or a velocity,"
                f" only {_words(others[:8])}; name the channels in a recording TOML"
                f" ('zwidth convert {self.source.path} FILE.toml' drafts one)"
            )
        if (arrays := self._array(rest)) is not None:
            return arrays
        chosen = self._asked("which column is the position", rest, rest[0])
        if len(rest) > 1 and self.ask is None:
            unnamed = all(re.fullmatch(r"column\d+", name) for name in rest)
            if unnamed and self.source.kind.startswith("text table"):
                raise RecordingError(
                    f"{self.source.path.name} has no line that names its columns, so it is unknown"
                    f" which of {_words(rest)} is the position: write a line of names above the"
                    " numbers (time, position, torque ...), or name them in a recording TOML"
                )
            raise RecordingError(
                f"nothing in {self.source.path.name} shows which of {_words(rest)} is the position;"
                f" name it in a recording TOML; 'zwidth convert {self.source.path} FILE.toml'"
                " drafts one"
            )
        self.found.doubts.append(
            f"{chosen} is taken for the position, without any sign of what it is"
        )
        return {"position_m1": chosen}

    def _array(self, rest: Sequence[str]) -> dict[str, str] | None:
        """Return the joint that moves most of several whose names say only that they were measured.

        Each is a position if its goal is there and it follows it: "J1 Actual", "J1 Command".
        """
        joints = differing({name: self.names[name] for name in rest})
        asked = [n for n, one in self.names.items() if one.role in ("goal", "command")]
        if len(rest) < 2 or len(set(joints.values())) < len(rest):
            return None
        for name in rest:
            own = set(joints[name])
            if self.names[name].role != "measured" or not any(w.isdigit() for w in own):
                return None
            goals = [n for n in asked if own <= set(self.names[n].joint)]
            goal = next((n for n in goals if self._follows(n, name)), None)
            if goal is None:
                return None
            self.names[goal] = replace(self.names[goal], quantity="position", role="goal")
        for name in rest:
            self.names[name] = replace(self.names[name], quantity="position")
        return self._outputs()

    def _follows(self, goal: str, motion: str) -> bool:
        return self._is_long(goal) and follows(
            self.source.signals[goal], self.source.signals[motion]
        )

    def joints(self) -> Joints:
        """Return the joints, by the words in which their names differ."""
        self._are_some()
        self._time()
        if not any(map(self._motions, MOTIONS)):
            self._array([n for n in self._open() if self.names[n].role == "measured"])
        known = next(filter(None, map(self._motions, ("position", "velocity"))), list[str]())
        every = self._family(known[0]) if known else []
        if len(known) < 2:
            one = f"only {known[0]} moves in it" if known else "no position in it moves"
            raise RecordingError(
                f"{self.source.path.name} has fewer than two joints: {one}; leave --joint out"
            )
        words = differing({name: self.names[name] for name in every})
        labels = {name: "_".join(words[name]) for name in every}
        for name, label in labels.items():
            told = [n for n in every if label and of_joint(self.names[n], label)]
            labels[name] = label if told == [name] else name
        still = tuple(label for name, label in labels.items() if name not in known)
        return Joints({labels[name]: name for name in every if name in known}, still)

    def _signals(self) -> list[str]:
        return [n for n, one in self.seen.items() if one.samples == self.rows]

    def _of_joint(self, known: list[str]) -> list[str]:
        assert self.joint is not None
        found = [name for name in known if name == self.joint]
        found = found or [name for name in known if of_joint(self.names[name], self.joint)]
        if not found:
            raise RecordingError(
                f"{self.source.path.name} has no joint {self.joint!r} among {_words(known)}; give"
                " --joint one of these names, or its number"
            )
        return found

    def _placed(self, quantity: str, known: list[str]) -> dict[str, str]:
        """Return the channels of several signals of a quantity: a joint, or its two sides."""
        if len(known) == 1:
            return {f"{quantity}_m1": known[0]}
        arrays = self._family(known[0])
        joints = differing({name: self.names[name] for name in arrays})
        indexed = sum(any(w.isdigit() for w in key) for key in joints.values())
        driven = [n for n, said in self.names.items() if said.drives and said.joint]
        own = [re.sub(r"_m_(\d)$", r"_m\1", "_".join(self.names[n].words)) for n in known]
        masses = all(re.fullmatch(f"{quantity}_m[1-5]", one) for one in own)
        if masses and not driven and len(set(own)) == len(known):
            return dict(zip(own, known, strict=True))  # named like masses of one device
        if (sides := sided(known)) and not (indexed and (len(arrays) > 2 or driven)):
            self.found.doubts.append(
                f"{sides[0]} is taken for the side that is driven, {sides[1]} for the other, m2"
            )
            return {f"{quantity}_m1": sides[0], f"{quantity}_m2": sides[1]}
        apart = len({joints.get(name, ()) for name in known}) == len(known)
        each = all(
            joints.get(name) and any(set(joints[name]) <= set(self.names[d].joint) for d in driven)
            for name in known
        )  # each has its own drive, so they are joints, not two sides of one
        if apart and (indexed or len(known) > 2 or each):
            moved = {name: span(self.source.signals[name]) for name in known}
            first = max(known, key=lambda name: moved[name])
            chosen = self._asked("which joint is it about", known, first)
            if self.ask is None:
                self.found.doubts.append(
                    f"{_words(known[:8])} belong to several joints: {chosen} is taken, which moves"
                    " most; --joint takes another"
                )
            return {f"{quantity}_m1": chosen}
        chosen = self._asked(f"which column is the {quantity} of the driven side", known,
                             known[0])  # fmt: skip
        if self.ask is None:
            self.found.doubts.append(
                f"{_words(known)} may each be the {quantity}: {chosen} is taken; add another as an"
                " [[output]] at m2 if it belongs to a second mass"
            )
        return {f"{quantity}_m1": chosen}

    def _family(self, name: str) -> list[str]:
        """Return the signals of the same quantity and role, those that stand still among them."""
        own = self.names[name]
        return [
            n for n, one in self.names.items()
            if (one.quantity, one.role) == (own.quantity, own.role) and self._is_long(n)
        ]  # fmt: skip

    def _key(self, name: str) -> tuple[str, ...]:
        """Return by which words the joint of a signal differs from others of its family."""
        return differing({n: self.names[n] for n in self._family(name)})[name]

    def _with_joint_of(self, motion: str, known: list[str]) -> list[str]:
        """Return those that are of the joint of a motion, all where their names do not say."""
        own = set(self._key(motion))
        if not own:
            return known
        same = [n for n in known if own <= set(self.names[n].joint)]
        numbers = {word for word in own if word.isdigit()}
        if not same and numbers:  # other words may belong to the quantity: AIPos.A2, MACur.A2
            same = [n for n in known if numbers <= set(self.names[n].joint)]
        others = [n for n in known if not self._key(n)]
        return [n for n in known if n in same or n in others] if same or others else known

    def _speed_beside(self, position: str) -> dict[str, str]:
        """Return the speed that was measured beside a position, if it adds information."""
        signals, found = self.source.signals, dict[str, str]()
        for name in self._with_joint_of(position, self._motions("velocity")):
            seen = speed_of(signals[position], signals[name], self.t)
            if seen is None:
                continue
            if seen.correlation < RATE:
                self._no_speed(name, position)
                continue
            units = _unit(signals[name]), _unit(signals[position])
            factors = [1.0 if unit is None else unit.factor for unit in units]
            size = seen.size * factors[0] / factors[1]
            if self.guessed is not None and (period := _usual(PERIOD_S / size)):
                self._say_period(period, name, position)
                size = 1.0
            if abs(size - 1.0) > SCALED:
                self.found.doubts.append(
                    f"{name} is {size:.4g} times the slope of {position} in these units, so one of"
                    f" the two has another unit: {name} is left out; add it as an [[output]] with"
                    " its scale"
                )
            elif seen.news > NOTHING_NEW and not found:
                found = {"velocity_m1": name}
        return found

    def _say_period(self, period: float, speed: str, position: str) -> None:
        """Take the period at which a speed is the slope of a position, if none is stated."""
        assert self.guessed is not None
        where = f"{speed}, which is the slope of {position} at that rate"
        self.found.doubts[self.guessed] = (
            f"no column seems to be time: {1.0 / period:g} samples a second are taken, at which"
            f" {speed} is the slope of {position} in these units; correct period_s"
        )
        at = next(i for i, (role, _) in enumerate(self.found.roles) if role == "time")
        self.found.roles[at] = ("time", f"no column of it; samples every {period:g} s, by {speed}")
        self.t, self.guessed = period * np.arange(self.rows), None
        self.clock = [f"period_s = {period!r} # by {_printable(where)}"]

    def _no_speed(self, name: str, position: str) -> None:
        """If the values of a "speed" do not fit a speed, take the other meaning of its name."""
        signals, said = self.source.signals, self.names[name]
        if follows(signals[name], signals[position]):
            self.names[name] = replace(said, quantity="position", role="goal")
            other = "the goal of the position"
        elif said.weak and "v" in said.words:
            self.names[name] = replace(said, quantity="voltage")
            other = "a voltage"
        else:
            self.found.doubts.append(
                f"{name} is not the slope of {position}, as a velocity of it would be: left out"
            )
            return
        self.found.doubts.append(
            f"{name} may be a velocity or {other}: it is taken for {other}, since it is not the"
            f" slope of {position}"
        )

    def _command(self, outputs: Mapping[str, str]) -> str | None:
        motion = next(iter(outputs.values()))
        moves = self.names[motion].quantity or "position"
        ranked: dict[str, tuple[float, int]] = {}
        for name, said in self.names.items():
            if name in outputs.values() or not self._is_long(name):
                continue
            if self.seen[name].seems == "constant":
                continue
            place = self._place(name, said, motion, moves)
            if place is not None:
                ranked[name] = place
        if "command" in self.given:
            name = self.given["command"]
            self.goal = ranked.get(name, (0.0, 0))[0] in (GOAL_OF_LOOP, BARE_GOAL)
            return name
        known = self._with_joint_of(motion, sorted(ranked, key=lambda n: ranked[n]))
        if known:
            chosen = self._asked("which column drives the device", known, known[0])
            if self.ask is None and len(known) > 1:
                self.found.doubts.append(
                    f"{_words(known[:8])} may each be the command: {chosen} is taken for it"
                )
            goal = ranked[chosen][0] in (GOAL_OF_LOOP, BARE_GOAL)
            self.goal = goal and moves == "position"
            bare = self.names[chosen].weak and unit_spelled(self.source.signals[chosen]) is None
            self.speed = moves == "velocity" and bare and self._follows(chosen, motion)
            self.speed |= (goal and not self.goal) or ranked[chosen][0] == GOAL_OF_SPEED
            return chosen
        return self._unnamed_command(outputs)

    def _place(self, name: str, said: Naming, motion: str, moves: str) -> tuple[float, int] | None:
        """Return the rank of a signal among possible commands, best first; None if not one."""
        signals = self.source.signals
        if said.drives:
            if said.quantity == "voltage" and said.role == "" and supplies(signals[name]):
                return None
            near, order = rank(said)
            return (max(near, MEASURED) if said.role == "measured" else near), order
        if said.role == "goal" and said.quantity == moves:
            return GOAL_OF_LOOP, 0
        if said.role == "goal" and said.quantity == "":
            if follows(signals[name], signals[motion]):
                return BARE_GOAL, 0
            return (BARE_COMMAND, 0) if "action" in " ".join(said.words) else None
        if said.role == "goal" and said.quantity == "velocity":
            return GOAL_OF_SPEED, 0
        return None

    def _unnamed_command(self, outputs: Mapping[str, str]) -> str | None:
        used = {*outputs.values()}
        rest = [n for n in self._open() if n not in used and self.names[n].role in ("", "measured")]
        moving = all(self.names[n].moves for n in used)
        if len(rest) == 1 and moving and self.ask is None:
            self.found.doubts.append(f"{rest[0]} is taken for the command: no other column is left")
            return rest[0]
        if not rest:
            others = [n for n in self.names if n not in used and self.seen[n].seems in NO_COMMAND]
            none = f" ({_words(others[:8])} cannot be one)" if others else ""
            self.found.doubts.append(
                f"no column seems to be a command{none}: taken as a free motion; if something"
                " drives it, record its torque, current, voltage or goal, too"
            )
            return None
        default = rest[0] if moving and len(rest) == 1 else NOBODY
        chosen = self._asked("which column drives the device", [*rest, NOBODY], default)
        if chosen == NOBODY and self.ask is None:
            self.found.doubts.append(
                f"nothing shows that one of {_words(rest)} is the command: taken as a motion that"
                " nothing drives; if one of them drives it, give that one as [input]"
            )
        return None if chosen == NOBODY else chosen

    def _say_rest(self, used: set[str]) -> None:
        left = [n for n, one in self.seen.items() if n not in used and one.seems not in
                ("time", "constant")]  # fmt: skip
        if left:
            self.found.roles.append(("left out", ", ".join(left[:8])))

    # --- units

    def _rotary(self, names: Sequence[str]) -> bool:
        for name in names:
            unit = _unit(self.source.signals[name])
            if unit is not None and unit.si.split("/")[0] in ("rad", "N m", "m", "N"):
                return unit.si.split("/")[0] in ("rad", "N m")
        words = [w for name in names for w in (*words_of(name), *self.names[name].words)]
        turns, slides = (not kind_words(kind).isdisjoint(words) for kind in ("rotary", "linear"))
        if turns != slides:
            return turns
        chosen = self._asked("does the device turn or slide", ("turns", "slides"), "turns")
        if self.ask is None:
            self.found.doubts.append(
                "no unit and no name shows whether the device turns or slides: it is taken to turn"
                " (rad, N m); set rotary = false and correct the units if it slides"
            )
        return chosen == "turns"

    def _alike(self, command: str, told: Mapping[str, Channel], rotary: bool) -> dict[str, Channel]:
        """Return the channels; a position in counts may take the scale of its goal in counts."""
        key, motion = next(iter(told.items()))
        unit = _unit(self.source.signals[command])
        if not (motion.unit and _is_counts(motion.unit)) or (unit and unit.si != COUNTS):
            return dict(told)
        per = ("counts_per_rev", TURN) if rotary else ("counts_per_m", 1.0)
        note = f"not known, so each count is taken as 1 {GOAL[0 if rotary else 1]}"
        return {**told, key: replace(motion, scale=None, per=per, note=note)}

    def _driven(self, command: str, rotary: bool, motion: Channel) -> Channel:
        if self.speed:
            return self._speed_goal(command, rotary, motion)
        if not self.goal:
            return self._channel(command, "command", rotary)
        signal, own = self.source.signals[command], GOAL[0 if rotary else 1]
        unit, spelled = _unit(signal), unit_spelled(signal)
        if motion.per is not None:
            self.found.roles.append(("goal", f"{command} [counts], of a loop on the position"))
            if unit is None:
                self.found.doubts.append(
                    f"{command} has no unit: it is taken to be in the counts of {motion.signal}"
                )
            return replace(motion, signal=command, unit=spelled or COUNTS)
        if unit is None or unit.si != own:
            self.found.doubts.append(f"{command} has no unit: {own} is assumed, as of the position")
            spelled = own
        self.found.roles.append(("goal", f"{command} [{spelled}], of a loop on the position"))
        return Channel(command, spelled)

    def _speed_goal(self, name: str, rotary: bool, motion: Channel) -> Channel:
        """Return a command that is a speed to go to, in proportion to which a loop drives."""
        own, per = SI["command"][0 if rotary else 1], SI["velocity"][0 if rotary else 1]
        unit, spelled = _unit(self.source.signals[name]), unit_spelled(self.source.signals[name])
        if unit is None or unit.si not in (per, f"{COUNTS}/s"):
            moved = find_unit(motion.unit) if motion.unit else None
            spelled = motion.unit if moved is not None and moved.si == per else per
            self.found.doubts.append(f"{name} has no unit: {spelled} is assumed, as of the speed")
        self.found.doubts.append(
            f"{name} {SPEED_GOAL}: a loop in proportion to the error of the speed is taken, of 1"
            f" {own} per {per}, so masses and friction are counted in what it gives, and the damper"
            " holds its gain"
        )
        self.found.roles.append(("command", f"{name} [{spelled}], of a loop on the speed"))
        return Channel(name, spelled, 1.0, f"{own} per {per}: of the loop, not known")

    def _channel(self, name: str, quantity: str, rotary: bool) -> Channel:
        signal = self.source.signals[name]
        own = SI[quantity][0 if rotary else 1]
        spelled, unit = unit_spelled(signal), _unit(signal)
        electric = OF_AMPLIFIER.get(self.names[name].quantity)
        if unit is None and quantity == "position" and (whole := _whole(signal)):
            spelled, unit = COUNTS, find_unit(COUNTS)
            self.found.doubts.append(
                f"{name} has no unit and is whole numbers over {whole:g} of them: counts are taken;"
                " correct unit if they are degrees or micrometres"
            )
        if unit is None and quantity == "velocity" and self.counted and not signal.unit:
            spelled, unit = f"{COUNTS}/s", find_unit(f"{COUNTS}/s")  # the slope of the position
        self.counted |= quantity == "position" and unit is not None and unit.si == COUNTS
        if unit is None and quantity == "command" and electric and not signal.unit:
            what = f"{own} per {electric}: not known, so 1 is taken"
            spelled, channel = electric, Channel(name, electric, 1.0, what)
            unit = find_unit(electric)
            assert unit is not None
            self.found.doubts.append(
                f"{name} has no unit: {electric} is assumed; {_unscaled(name, quantity, unit, own)}"
            )
        elif unit is None:
            if signal.unit:
                self.found.doubts.append(
                    f"the unit {signal.unit!r} of {name} is not known here: 1 {own} is assumed for"
                    " each; give scale"
                )
                channel = Channel(name, None, 1.0, f"{own} per {signal.unit}: assumed")
            else:
                channel = Channel(name, None, None, f"no unit is given: {own} is assumed")
                self._say_assumed(signal, quantity, own)
        elif unit.si in SI[quantity] and unit.si == own:
            channel = Channel(name, spelled)
            self._say_doubts(signal, str(spelled), unit)
        else:
            channel = Channel(name, spelled, 1.0, f"{own} per {unit.si}: not known, so 1 is taken")
            self.found.doubts.append(_unscaled(name, quantity, unit, own))
        if name in self.told:
            self._say_tool(name)
        if spelled == ELECTRICAL:
            self.found.doubts.append(
                f"{name} counts turns of the field, as of a motor of one pole pair: of one with n"
                " give scale = 1 / n"
            )
        role = "command" if quantity == "command" else quantity
        shown = spelled if unit is not None else own
        self.found.roles.append((role, f"{name} [{shown}]"))
        return channel

    def _say_tool(self, name: str) -> None:
        unit, tool = self.told[name]
        self.found.doubts.append(f"{name} has no unit: {unit} is taken, as {tool} has it")

    def _say_assumed(self, signal: Signal, quantity: str, own: str) -> None:
        self.found.doubts.append(f"{signal.name} has no unit: {own} is assumed{_hint(signal, own)}")

    def _say_doubts(self, signal: Signal, spelled: str, unit: Unit) -> None:
        hint = _hint(signal, spelled) if unit.factor == 1.0 else ""
        if not hint and spelled in ("deg", "degrees", "°") and (radians := _lines_of(signal, TURN)):
            hint = f" (its step is a turn in {radians} if it is in radians: radians?)"
        if hint:
            self.found.doubts.append(f"{signal.name} is read in {spelled}{hint}")

    def _asked(self, question: str, answers: Sequence[str], default: str) -> str:
        # With one possible answer there is nothing to ask.
        return default if self.ask is None or len(answers) == 1 else (
            self.ask(question, answers, default))  # fmt: skip


def _unscaled(name: str, quantity: str, unit: Unit, own: str) -> str:
    """A sentence on the consequences of an unknown scale."""
    if quantity == "command":
        return (
            f"{name} is in {unit.si}, and how much {own} that is is not known: 1 {own} per"
            f" {unit.si} is taken, so masses, springs, dampers and friction are counted in"
            f" {unit.si}; give scale if the motor's constant is known"
        )
    return f"{name} is in {unit.si}: each is taken as 1 {own}; give counts_per_rev or scale"


def _unit(signal: Signal) -> Unit | None:
    """Return the unit, None for one that contradicts the words of the name ("theta_m")."""
    spelled = unit_spelled(signal)
    unit = find_unit(spelled) if spelled else None
    if unit is None or signal.unit:
        return unit
    words = words_of(signal.name)
    turns = kind_words("rotary") | {"vel", "velocity", "speed"}
    return None if unit.si == "m" and not turns.isdisjoint(words) else unit


def _usual(period: float) -> float:
    """Return the period [s] of a usual rate near a given period, 0 if there is none."""
    if not 1e-6 < period < 1e3:
        return 0.0
    decade = 10.0 ** math.floor(math.log10(1.0 / period) + NEAR)
    near = min((rate * decade for rate in USUAL_RATES), key=lambda r: abs(r * period - 1.0))
    return 1.0 / near if abs(near * period - 1.0) < NEAR else 0.0


def _is_counts(spelled: str) -> bool:
    unit = find_unit(spelled)
    return unit is not None and unit.si == COUNTS


def _whole(signal: Signal) -> float:
    """Return the travel of a position in whole numbers, 0 for others and where it is short."""
    values = signal.floats()[signal.known]
    if signal.unit or not values.size or not np.all(values == np.rint(values)):
        return 0.0
    travel = float(np.ptp(values))
    return travel if travel >= COUNTED else 0.0


def _hint(signal: Signal, own: str) -> str:
    """Return what the numbers themselves suggest in place of rad or m, in brackets, or nothing."""
    values = signal.floats()
    values = values[np.isfinite(values)]
    if not values.size or own not in ("rad", "m"):
        return ""
    travel = float(np.ptp(values))
    if np.all(values == np.rint(values)) and travel >= 8.0:
        return f" (whole numbers, over {travel:g} of them: counts of an encoder?)"
    if own == "rad":
        degrees = _lines_of(signal, 360.0)
        if degrees and not _lines_of(signal, TURN):
            return f" (its step is 360 over {degrees}: degrees?)"
        if travel > TURN * TURNS:
            return f" (it moves by {travel:.4g}, which is {travel / TURN:.3g} turns: degrees?)"
    elif travel > METRES:
        return f" (it moves by {travel:.4g} m: mm?)"
    return ""


def _lines_of(signal: Signal, turn: float) -> int | None:
    """Return how many of its steps make a turn, where they are a whole and round number of lines.

    A step from rounding in a printout, 0.001 or 1e-6, is no hint.
    """
    step = step_seen(signal.floats())
    if step is None or math.isclose(math.log10(step), round(math.log10(step)), abs_tol=1e-9):
        return None
    lines = turn / step
    whole = round(lines)
    round_number = whole % 100 == 0 or (whole & (whole - 1)) == 0
    if LEAST_LINES <= lines <= MOST_LINES and abs(lines - whole) < WHOLE and round_number:
        return whole
    return None


def _words(given: Sequence[str]) -> str:
    names = [plain(name) for name in given]
    return ", ".join(names[:-1]) + f" and {names[-1]}" if len(names) > 1 else names[0]


def _positive(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if 0.0 < value < math.inf else None


def _lines(channel: Channel) -> list[str]:
    note = f" # {_printable(channel.note)}" if channel.note else ""
    lines = [_line("signal", channel.signal)]
    if channel.unit is not None:
        lines.append(_line("unit", channel.unit))
    if channel.per is not None:
        lines.append(f"{channel.per[0]} = {channel.per[1]!r}{note}")
    elif channel.scale is not None:
        lines.append(f"scale = {channel.scale!r}{note}")
    elif note:
        lines[0] += note
    return lines


def _printable(text: str) -> str:
    return re.sub(r"[^\x20-\x7e]", "?", text)


def _line(key: str, value: str) -> str:
    return tomli_w.dumps({key: value}).strip()
