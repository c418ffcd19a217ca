"""A recording TOML for a file that nobody described: complete, with what was assumed in sentences.

`guess.draft` leaves open what a file does not tell, for a person to fill in. This one is for going
on at once: it takes SI where no unit is given, a thousand samples a second where there is no time,
and for a scale that cannot be known one, so that forces are counted in the command's own unit. It
says so, asks where somebody can answer, and names what the numbers themselves make doubtful: a step
of 0.09 in an angle is 360 degrees in 4000, and no encoder counts such a part of a radian.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import tomli_w

from zwidth.logs.guess import (
    WORDS,
    Seen,
    clock_lines,
    look,
    time_signal,
    unit_spelled,
    words_of,
)
from zwidth.logs.source import RecordingError, Signal, Source
from zwidth.logs.steps import step_seen
from zwidth.logs.units import SI, TURN, Unit, find_unit

Ask = Callable[[str, Sequence[str], str], str]
"""Asks a question with answers to choose from (none: any text) and one that is taken for Enter."""

ROTARY_WORDS = ("angle", "theta", "phi", "joint", "encoder", "enc", "torque", "tau", "omega", "rpm")
LINEAR_WORDS = ("x", "displacement", "stroke", "carriage", "force", "cart", "slide")
GOALS = ("ref", "reference", "desired", "des", "goal", "target", "setpoint", "sp", "error", "err")
FAR_SIDE = ("load", "link", "tip", "arm", "cart2", "end", "hand", "far", "m2", "2")
NEAR_SIDE = ("motor", "mot", "rotor", "drive", "m1", "1")
PERIOD_S = 0.001
FEWEST = 10  # samples in a column, below which nothing is guessed from them
TURNS, METRES = 5.0, 3.0  # of travel, beyond which radians and metres are doubted
LEAST_LINES, MOST_LINES = 100.0, 1e7  # of an encoder, a turn
WHOLE = 2e-3  # of a line, by which the lines of a turn may miss a whole number
NOBODY = "none"


@dataclass(frozen=True)
class Channel:
    """A signal as a channel: name, spelled unit (None: none is known), what the TOML says of it."""

    signal: str
    unit: str | None
    scale: float | None = None
    note: str = ""


@dataclass
class Assumed:
    """The text of a TOML, what it takes the file for (role, sentence), and what is doubtful."""

    text: str = ""
    roles: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    doubts: list[str] = field(default_factory=list[str])


def assumed(source: Source, file: str, ask: Ask | None = None) -> Assumed:
    """Return what to take the signals of a file for; file: its path as the TOML is to give it.

    ask: where somebody can answer. Raises RecordingError where nothing in it seems to move.
    """
    return _Reader(source, file, ask).read()


class _Reader:
    def __init__(self, source: Source, file: str, ask: Ask | None) -> None:
        self.source, self.file, self.ask = source, file, ask
        self.seen = {one.name: one for one in look(source)}
        self.found = Assumed()

    def read(self) -> Assumed:
        self._are_some()
        time = self._time()
        command = self._command()
        outputs = self._outputs(command)
        rotary = self._rotary([*outputs.values(), *([command] if command else [])])
        told = {
            key: self._channel(name, key.split("_")[0], rotary) for key, name in outputs.items()
        }
        driven = self._channel(command, "command", rotary) if command else None
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
        """Raise RecordingError where so few samples show nothing of what a column is."""
        most = max((int(one.known.sum()) for one in self.source.signals.values()), default=0)
        if most < FEWEST:
            raise RecordingError(
                f"{self.source.path.name} holds {most} sample{'s' * (most != 1)}, too few to see"
                " what its columns are: some seconds of motion are needed; see whether the file was"
                " written to its end"
            )

    # --- time

    def _time(self) -> list[str]:
        roles, doubts = self.found.roles, self.found.doubts
        stamped = any(signal.stamps for signal in self.source.signals.values())
        time = None if stamped else time_signal(self.source)
        if stamped:
            roles.append(("time", "the clock of the messages"))
            names = [n for n, one in self.seen.items() if one.seems in (*SI, "velocity")]
            return clock_lines(self.source, names)
        if time is None:
            given = self._asked("sampling period in seconds", [], f"{PERIOD_S:g}")
            period = _positive(given) or PERIOD_S
            roles.append(("time", f"no column of it; samples every {period:g} s"))
            if self.ask is None:
                doubts.append(
                    f"no column seems to be time, so {1.0 / period:g} samples a second are assumed:"
                    " masses, dampers and times are as wrong as that is; correct period_s"
                )
            return [f"period_s = {period!r} # no column seems to be time"]
        spelled = unit_spelled(time)
        unit = find_unit(spelled) if spelled else None
        if unit is None or unit.si != "s":
            spelled = self._time_unit(time)
            unit = find_unit(spelled)
        assert unit is not None
        steps = np.diff(time.floats()[time.known])
        period = float(np.median(steps[steps > 0.0])) * unit.factor
        roles.append(("time", f"{time.name} [{spelled}], {1.0 / period:.6g} samples a second"))
        named = [] if unit.factor == 1.0 else [_line("time_unit", str(spelled))]
        return [_line("time", time.name), *named]

    def _time_unit(self, time: Signal) -> str:
        """Return the unit of stamps that have none: by what period it would give."""
        steps = np.diff(time.floats()[time.known])
        step = float(np.median(steps[steps > 0.0]))
        likely = next(u for u, least in (("ns", 1e5), ("us", 200.0), ("ms", 0.5), ("s", 0.0))
                      if step >= least)  # fmt: skip
        if likely != "s":
            likely = self._asked(f"unit of the time {time.name!r}, steps of {step:g}",
                                 ("s", "ms", "us", "ns"), likely)  # fmt: skip
            self.found.doubts.append(
                f"{time.name} has steps of {step:g} and no unit: taken as {likely}; correct"
                " time_unit if it is another, or say period_s if it only counts"
            )
        return likely

    # --- what drives, what moves

    def _named(self, quantity: str) -> list[str]:
        return [
            name
            for name, one in self.seen.items()
            if self._seems(one) == quantity and not _is_goal(name)
        ]

    def _seems(self, one: Seen) -> str:
        """Return the quantity, by the name where its unit cannot be meant: theta_m is no length."""
        signal = self.source.signals[one.name]
        unit = _unit(signal)
        if one.seems in SI and unit is None and unit_spelled(signal):
            words = words_of(one.name)
            return next((q for q in SI if any(w in WORDS.get(q, ()) for w in words)), one.seems)
        return one.seems

    def _command(self) -> str | None:
        known = self._named("command")
        if len(known) > 1:
            drives = ("cmd", "command", "u", "torque", "tau", "force", "vir")
            known.sort(key=lambda n: not any(w in drives for w in words_of(n)))
            chosen = self._asked("which column drives the device", known, known[0])
            if self.ask is None:
                self.found.doubts.append(
                    f"{_words(known)} may each be the command: {chosen} is taken for it"
                )
            return chosen
        if known:
            return known[0]
        moving = {*self._named("position"), *self._named("velocity")}
        goals = [name for name, one in self.seen.items() if _is_goal(name) and one.seems in SI]
        rest = [name for name in self._open() if name not in moving and name not in goals]
        if len(rest) == 1 and moving and self.ask is None:
            self.found.doubts.append(f"{rest[0]} is taken for the command: no other column is left")
            return rest[0]
        if not rest:
            self.found.doubts.append(
                "no column seems to be a command: taken as a motion that nothing drives"
            )
            return None
        default = rest[0] if moving and len(rest) == 1 else NOBODY
        chosen = self._asked("which column drives the device", [*rest, NOBODY], default)
        if chosen == NOBODY and self.ask is None:
            self.found.doubts.append(
                f"none of {_words(rest)} says that it is the command: taken as a motion that"
                " nothing drives; name the command as [input] if one drives"
            )
        return None if chosen == NOBODY else chosen

    def _open(self) -> list[str]:
        return [n for n, one in self.seen.items() if one.seems == ""]

    def _outputs(self, command: str | None) -> dict[str, str]:
        for quantity in ("position", "velocity"):
            if known := [name for name in self._named(quantity) if name != command]:
                return self._placed(quantity, known)
        rest = [name for name in self._open() if name != command and not _is_goal(name)]
        if not rest:
            raise RecordingError(
                f"{self.source.path.name} has no column that seems to be a position or a velocity;"
                f" say which is which in a recording TOML ('zwidth convert {self.source.path}"
                " FILE.toml' drafts one)"
            )
        chosen = self._asked("which column is the position", rest, rest[0])
        if len(rest) > 1 and self.ask is None:
            raise RecordingError(
                f"{self.source.path.name} does not say which of {_words(rest)} is the position; say"
                f" it in a recording TOML; 'zwidth convert {self.source.path} FILE.toml' drafts one"
            )
        self.found.doubts.append(f"{chosen} is taken for the position: nothing says what it is")
        return {"position_m1": chosen}

    def _placed(self, quantity: str, known: list[str]) -> dict[str, str]:
        """Return the channels of several signals of a quantity: the motor's side and the load's."""
        near = next((n for n in known if any(w in NEAR_SIDE for w in words_of(n))), None)
        far = [n for n in known if n != near and any(w in FAR_SIDE for w in words_of(n))]
        if len(known) > 1 and far and len(far) < len(known):
            first = near or next(n for n in known if n not in far)
            found = {f"{quantity}_m1": first, f"{quantity}_m2": far[0]}
            self.found.doubts.append(
                f"{first} is taken for the side that is driven, {far[0]} for the other, m2"
            )
            return found
        if len(known) > 1:
            chosen = self._asked(f"which column is the {quantity} of the driven side", known,
                                 known[0])  # fmt: skip
            if self.ask is None:
                self.found.doubts.append(
                    f"{_words(known)} may each be the {quantity}: {chosen} is taken; add another as"
                    " an [[output]] at m2 if it is of a second mass"
                )
            return {f"{quantity}_m1": chosen}
        return {f"{quantity}_m1": known[0]}

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
        words = [word for name in names for word in words_of(name)]
        turns, slides = (any(w in those for w in words) for those in (ROTARY_WORDS, LINEAR_WORDS))
        if turns != slides:
            return turns
        chosen = self._asked("does the device turn or slide", ("turns", "slides"), "turns")
        if self.ask is None:
            self.found.doubts.append(
                "no unit and no name says whether the device turns or slides: it is taken to turn"
                " (rad, N m); say rotary = false and correct the units if it slides"
            )
        return chosen == "turns"

    def _channel(self, name: str, quantity: str, rotary: bool) -> Channel:
        signal = self.source.signals[name]
        own = SI[quantity][0 if rotary else 1]
        spelled, unit = unit_spelled(signal), _unit(signal)
        if unit is None:
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
        role = "command" if quantity == "command" else quantity
        shown = spelled if unit is not None else own
        self.found.roles.append((role, f"{name} [{shown}]"))
        return channel

    def _say_assumed(self, signal: Signal, quantity: str, own: str) -> None:
        self.found.doubts.append(f"{signal.name} has no unit: {own} is assumed{_hint(signal, own)}")

    def _say_doubts(self, signal: Signal, spelled: str, unit: Unit) -> None:
        hint = _hint(signal, spelled) if unit.factor == 1.0 else ""
        if not hint and spelled in ("deg", "degrees", "°") and (radians := _lines_of(signal, TURN)):
            hint = f" (its step is a turn in {radians} if it is in radians: radians?)"
        if hint:
            self.found.doubts.append(f"{signal.name} is read in {spelled}{hint}")

    def _asked(self, question: str, answers: Sequence[str], default: str) -> str:
        return default if self.ask is None else self.ask(question, answers, default)


def _unscaled(name: str, quantity: str, unit: Unit, own: str) -> str:
    """Say what follows from a scale that is not known."""
    if quantity == "command":
        return (
            f"{name} is in {unit.si}, and how much {own} that is is not known: 1 {own} per"
            f" {unit.si} is taken, so masses, springs, dampers and friction are counted in"
            f" {unit.si}; give scale where the motor's constant is known"
        )
    return f"{name} is in {unit.si}: each is taken as 1 {own}; give counts_per_rev or scale"


def _unit(signal: Signal) -> Unit | None:
    """Return the unit, None for one that contradicts the words of the name ("theta_m")."""
    spelled = unit_spelled(signal)
    unit = find_unit(spelled) if spelled else None
    if unit is None or signal.unit:
        return unit
    words = words_of(signal.name)
    if unit.si == "m" and any(
        word in (*ROTARY_WORDS, "vel", "velocity", "speed") for word in words
    ):
        return None
    return unit


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

    A step that a printer left, 0.001 or 1e-6, tells nothing.
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


def _is_goal(name: str) -> bool:
    return any(word in GOALS for word in words_of(name))


def _words(names: Sequence[str]) -> str:
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
    if channel.scale is not None:
        lines.append(f"scale = {channel.scale!r}{note}")
    elif note:
        lines[0] += note
    return lines


def _printable(text: str) -> str:
    return re.sub(r"[^\x20-\x7e]", "?", text)


def _line(key: str, value: str) -> str:
    return tomli_w.dumps({key: value}).strip()
