"""The meaning of a column's name: its quantity, commanded or measured, and its joint.

The words are in `vocabulary.toml`, with their sources. A name is split at capitals, digits and
signs; a unit at its end does not count as a word, nor do letters before a capital that denote a
type, as in `fActPosition` of a PLC. The last word that names a quantity decides, and words before
it say whether it is commanded or measured: "present current" is a measured current, "current
position" a measured position.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

Role = Literal["goal", "command", "measured", "error", ""]
DRIVES = ("torque", "current", "voltage", "duty", "input")
"""Quantities that drive a device, those closest to its force first; "input" names none of them."""
MOTIONS = ("position", "velocity", "acceleration")
TYPES = re.compile(r"^(?:lr|dw|f|r|l|g)(?=[A-Z][a-z])")  # prefixes of IEC 61131: fActPos, lrTorque
DOTS = {"dot": 1, "ddot": 2}
PARAMETER = re.compile(r"\b[rp]\d{2,5}(?:\[\d+\])?:?\s+(?=[A-Za-z])")
"""A parameter's number before its name, as in SINAMICS: "r63 Speed actual value"."""
OUTPUTS = ("output", "outputs", "out")  # output of a system, or of its controller
SIDES = frozenset(("motor", "load", "link", "d"))
NUMBERED = ("id", "no", "nr")  # before a number: which device, "ID:001 Present Position"
FIRST_OF_SCRIPTS = "\u3040"  # of Japanese, Chinese and Korean, which have no blanks between words
SHORTEST = 3  # least letters of a word within a compound
CLOSE = frozenset(
    ("joint", "joints", "axis", "motor", "m", "servo", "data", "value", "field", "ch")
)


@dataclass(frozen=True)
class Naming:
    """The meaning of a name.

    quantity: a table of the vocabulary's `[quantity]`, "" for none. weak: it is indicated by a
    single letter only. joint: the other words and numbers, by which one joint differs from another.
    """

    words: tuple[str, ...]
    quantity: str
    role: Role
    weak: bool
    joint: tuple[str, ...]

    @property
    def drives(self) -> bool:
        """Whether a signal of this kind can be the command of a device."""
        return self.quantity in DRIVES and self.role != "error"

    @property
    def moves(self) -> bool:
        """Whether it is a measured motion."""
        return self.quantity in MOTIONS and self.role in ("measured", "")


@cache
def vocabulary() -> dict[str, Any]:
    """Return the vocabulary as it stands in its file."""
    return tomllib.loads(Path(__file__).with_name("vocabulary.toml").read_text(encoding="utf-8"))


@cache
def _known() -> dict[str, tuple[str, bool]]:
    """Return word -> quantity and whether it is a letter."""
    tables = vocabulary()["quantity"]
    letters = {w: (name, True) for name, table in tables.items() for w in table["letters"]}
    return letters | {w: (name, False) for name, table in tables.items() for w in table["words"]}


@cache
def side_words(side: Literal["near", "far"]) -> frozenset[str]:
    """Return the words for the driven side of a device, or for the other side."""
    return frozenset(vocabulary()["side"][side])


@cache
def kind_words(kind: Literal["rotary", "linear"]) -> frozenset[str]:
    """Return the words for what turns, or for what slides."""
    return frozenset(vocabulary()["kind"][kind])


def words_of(name: str) -> list[str]:
    """Return the words of a name, the last first: "jointPos_deg" -> deg, pos, joint."""
    return re.findall(r"[^\W_]+", _spaced(name).lower())[::-1]


def _spaced(name: str) -> str:
    name = PARAMETER.sub("", name)
    parts = [TYPES.sub("", part) for part in re.split(r"[./\s]+", name)]
    spaced = re.sub("([a-z0-9])([A-Z])", r"\1 \2", " ".join(parts))
    return re.sub("([A-Z])([A-Z][a-z]{2})", r"\1 \2", spaced)


def read_name(core: str) -> Naming:
    """Return the meaning of a name without the unit at its end."""
    words = list(_words(core))
    if set(_plain_words(core)) & set(vocabulary()["pilot"]["words"]):
        return Naming(tuple(words), "other", "", False, ())
    at, quantity, weak = _quantity(words)
    last = list(_words(re.split("[./]", core)[-1]))
    if not quantity and 0 < len(last) < len(words) and words[-len(last) :] == last:
        within, told, _ = _quantity(last)  # "arm1.q[0]": the part before names the joint
        if told in MOTIONS and not (last[within] in OUTPUTS and _commands(words)):
            at, quantity, weak = len(words) - len(last) + within, told, True
    role = _role(words, at, quantity)
    if quantity == "" and role == "command":
        quantity, weak = "input", True
    joint = tuple(w for i, w in enumerate(words) if i != at and not _said(w) and w not in CLOSE)
    return Naming(tuple(words), quantity, role, weak, joint)


def _plain_words(core: str) -> list[str]:
    return re.findall(r"[^\W\d_]+", core.lower())


def together(names: Sequence[str]) -> dict[str, Naming]:
    """Return the meaning of names that have another meaning together than alone; {} for none."""
    own = {name.lower().strip(): name for name in names}
    for known in vocabulary()["together"]:
        if all(name in own for name in known.values()):
            told = {
                "goal": Naming((known["goal"],), "", "goal", False, ()),
                "measured": Naming((known["measured"],), "position", "measured", False, ()),
                "command": Naming((known["command"],), "input", "command", False, ()),
            }
            return {own[name]: told[role] for role, name in known.items()}
    return (
        _of_motor(own) | _of_phases(own) | _of_controller(own) | _of_sides(own) | _of_desired(own)
    )


PHASES = (("ia", "ib", "ic"), ("iu", "iv", "iw"), ("i_a", "i_b", "i_c"), ("i_u", "i_v", "i_w"))


def _of_phases(own: Mapping[str, str]) -> dict[str, Naming]:
    """Return a motor's phase currents in groups of two or three; one alone is not a command.

    One alone may be that of an armature.
    """
    found: dict[str, Naming] = {}
    for phases in PHASES:
        named = [k for k in own if any(re.fullmatch(rf"{p}(_[munkμ]?a)?", k) for p in phases)]
        if len(named) > 1:
            found |= {own[k]: Naming((k,), "other", "measured", False, ()) for k in named}
    return found


def _of_controller(own: Mapping[str, str]) -> dict[str, Naming]:
    """Return the output of a loop: "out" beside the goal and the measurement of a motion.

    Beside an input, or alone, "out" is what was measured of a system.
    """
    read = {name: read_name(name) for name in own}
    motions = [one for one in read.values() if one.quantity in MOTIONS and not one.weak]
    roles = {one.role for one in motions}
    bare = {one.role for one in read.values() if one.quantity == ""}  # "sp", "pv", "out"
    if not bare >= {"goal", "measured"} and ("goal" not in roles or roles <= {"goal", "error"}):
        return {}
    return {
        own[name]: Naming(one.words, "input", "command", False, ())
        for name, one in read.items()
        if one.weak and [w for w in one.words if not w.isdigit()][:1] in ([o] for o in OUTPUTS)
    }


DESIRED = re.compile(r"(?P<of>d?q|tau_j)_d(?P<joint>\W?\d+\W?)")


def _of_desired(own: Mapping[str, str]) -> dict[str, Naming]:
    """Return libfranka's goals, "q_d[2]" beside "q[2]" and "dq[2]"; alone it may be a speed."""
    quantities = {"q": "position", "dq": "velocity", "tau_j": "torque"}
    found: dict[str, Naming] = {}
    for name in own:
        said = DESIRED.fullmatch(name)
        if said and all(f"{one}{said['joint']}" in own for one in ("q", "dq")):
            joint = re.sub(r"\W", "", said["joint"])
            found[own[name]] = Naming(
                (said["of"], "d", joint), quantities[said["of"]], "goal", False, (joint,)
            )
    return found


def _of_sides(own: Mapping[str, str]) -> dict[str, Naming]:
    """Return the left and the right of pairs, "posL" and "posR": r alone is a reference."""
    apart = {name: tuple(re.findall(r"[^\W_]+", _spaced(name).lower())) for name in own.values()}
    whole = {"l": "left", "r": "right"}
    told: dict[str, Naming] = {}
    for name, words in apart.items():
        at = next((i for i, word in enumerate(words) if word in whole), None)
        if at is None or len(words) < 2:
            continue
        other = "r" if words[at] == "l" else "l"
        if (*words[:at], other, *words[at + 1 :]) in apart.values():
            told[name] = read_name(" ".join((*words[:at], whole[words[at]], *words[at + 1 :])))
    return told


MOTOR = re.compile(r"(?P<letter>[pvt])(?P<end>(?:_[a-z]+|\d*))")
ENDS: dict[str, Role] = {
    "": "", "_out": "measured", "_fb": "measured", "_meas": "measured", "_act": "measured",
    "_m": "measured", "_des": "goal", "_ref": "goal", "_set": "goal", "_cmd": "goal",
    "_in": "goal", "_ff": "command",
}  # fmt: skip


def _of_motor(own: Mapping[str, str]) -> dict[str, Naming]:
    """Return p, v and t of actuators under MIT's protocol (Mini Cheetah, AK, CyberGear).

    A single letter may also be a pressure or a power: p is a position if there is a v with the same
    ending, commanded or measured, and t with an ending is a torque then.
    """
    found = {name: matched for name in own if (matched := MOTOR.fullmatch(name))}
    ends = {m["end"] for m in found.values()}
    pairs = {e for e in ends if f"p{e}" in own and f"v{e}" in own and (e in ENDS or e.isdigit())}
    if not pairs - {""}:
        return {}
    told: dict[str, Naming] = {}
    for name, matched in found.items():
        letter, end = matched["letter"], matched["end"]
        role = ENDS.get(end) or "measured"
        joint = (end,) if end.isdigit() else ()
        if letter == "t" and end and (end in ENDS or end in pairs):
            drive = "measured" if role == "measured" else "command"
            told[own[name]] = Naming((letter,), "torque", drive, False, joint)
        elif letter != "t" and end in pairs:
            quantity = "position" if letter == "p" else "velocity"
            told[own[name]] = Naming((letter,), quantity, role, False, joint)
    return told


def tool_of(names: Sequence[str]) -> dict[str, Any]:
    """Return the table of the tool that these names identify, {} for none."""
    lower = [name.lower() for name in names]
    words = {word for name in names for word in words_of(name)}

    def told(sign: str) -> bool:
        return sign in words or (len(sign) > SHORTEST and any(sign in name for name in lower))

    return next((t for t in vocabulary()["tool"] if any(map(told, t["signs"]))), {})


def tool_units(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return the units that an identified tool uses: name -> (unit, tool)."""
    tool = tool_of(names)
    found: dict[str, tuple[str, str]] = {}
    for name in names if tool else ():
        unit = tool.get("names", {}).get(_last(name)) or tool.get(read_name(name).quantity)
        if unit:
            found[name] = unit, tool["name"]
    return found


def only_measured(names: Sequence[str]) -> list[str]:
    """Return the names under which a tool writes measured values, not commands."""
    return [name for name in names if _last(name) in tool_of(names).get("measured", ())]


def _last(name: str) -> str:
    return re.sub(r"\W*\d*\W*$", "", re.split(r"[./]", name.lower())[-1])


def told_by(said: Naming, quantity: str) -> Naming:
    """Return a naming with the quantity of its unit; a commanded motion is a goal."""
    role = said.role
    if quantity in MOTIONS and (role == "command" or (role == "" and said.quantity == "input")):
        role = "goal"
    return replace(said, quantity=quantity, role=role, weak=False)


def _words(core: str) -> Iterator[str]:
    """Yield the words of a name in order; a short one or a compound as the words it stands for."""
    axes = re.sub(r"\b([iuv])[ _]+([qdm])(?![a-z])", r"\1\2", _spaced(core).lower())
    axes = _script().sub(r" \g<0> ", axes.replace("feed back", "feedback"))
    for word in re.findall(r"[^\W\d_]+|\d+", axes):
        yield from (vocabulary()["alias"].get(word) or _lettered(word) or _apart(word) or (word,))


@cache
def _script() -> re.Pattern[str]:
    """Return what finds the known words of scripts that set no blanks between words, long first."""
    own = sorted((w for w in _spoken_words() if w[0] >= FIRST_OF_SCRIPTS), key=len, reverse=True)
    return re.compile("|".join(map(re.escape, own)))


def _lettered(word: str) -> list[str]:
    """Return the letter and the role that a word is made of ("qref", "xactual"), [] for none."""
    letter, role = word[:1], word[1:]
    spoken = _known().get(letter, ("", False))
    is_one = spoken[1] and spoken[0] not in ("time", "counter") and word not in _known()
    return [letter, role] if is_one and len(role) >= SHORTEST and is_role(role) else []


def _apart(word: str) -> list[str]:
    """Return the known words that a compound is made of ("targetposition"), [] for none."""
    if len(word) < 2 * SHORTEST or word in _all_words():
        return []
    for end in range(len(word) - SHORTEST, SHORTEST - 1, -1):
        first, rest = word[:end], word[end:]
        if first in _all_words():
            if rest in _all_words():
                return [first, rest]
            if further := _apart(rest):
                return [first, *further]
    return []


@cache
def _all_words() -> frozenset[str]:
    return frozenset(word for word in _spoken_words() if len(word) >= SHORTEST)


def _spoken_words() -> list[str]:
    roles = (word for own in vocabulary()["role"].values() for word in own)
    sides = (word for own in vocabulary()["side"].values() for word in own)
    return [*_known(), *roles, *sides]


def _quantity(words: Sequence[str]) -> tuple[int, str, bool]:
    """Return which word names the quantity (-1 for none), and whether it is a letter."""
    known = _known()
    found = [
        (i, *known[w])
        for i, w in enumerate(words)
        if w in known and not (w in NUMBERED and words[i + 1 : i + 2] and words[i + 1].isdigit())
    ]
    if other := next((one for one in found if one[1] == "other"), None):
        return other
    spoken = [one for one in found if not one[2]]
    lesser = [i for i, q, _ in spoken if q in ("input", "counter") or words[i] in side_words("far")]
    if len(found) > len(lesser):  # "count", or a measuring place, says little beside other words
        spoken = [one for one in spoken if one[0] not in lesser]
    if spoken:
        at, quantity, weak = spoken[-1]
    else:
        own = {w for w in words if not w.isdigit() and (w in known or not is_role(w))}
        if letters := {words[i] for i, _, letter in found if letter and not is_role(words[i])}:
            own -= {w for w in own if is_role(w)}  # "state.q": "state" only says what q belongs to
            found = [one for one in found if words[one[0]] in letters]
        beside = {*CLOSE, *DOTS, *SIDES}
        alone = [one for one in found if one[2] and own <= {words[one[0]], *beside}]
        if not alone:
            return -1, "", False
        at, quantity, weak = alone[-1]
        if words[at] in OUTPUTS and _commands(words):
            return -1, "", False  # the output of a controller
    if quantity == "position":
        quantity = MOTIONS[min(sum(DOTS.get(w, 0) for w in words), 2)]
    if quantity in ("current", "voltage") and "d" in words[:at]:
        return at, "other", False  # along the field: no torque
    return at, quantity, weak


def _commands(words: Sequence[str]) -> bool:
    return any(word in vocabulary()["role"]["command"] for word in words)


def is_role(word: str) -> bool:
    """Whether a word means that something is commanded, or measured."""
    return any(word in own for own in vocabulary()["role"].values())


def _said(word: str) -> bool:
    return is_role(word) or word in _known() or word in DOTS


def _role(words: Sequence[str], at: int, quantity: str) -> Role:
    roles = vocabulary()["role"]
    others = [w for i, w in enumerate(words) if i != at]
    if any(w in roles["error"] for w in others):
        return "error"
    if any(w in roles["goal"] for w in others) or _desired(words, at, quantity):
        return "goal"
    asked = any(w in roles["command"] for w in others)
    if quantity in MOTIONS and (asked or "input" in others):
        return "goal"
    only = vocabulary()["quantity"].get(quantity, {}).get("measured", ())
    if (at >= 0 and words[at] in only) or any(w in roles["measured"] for w in others):
        return "measured"
    return "command" if asked else ""


def _desired(words: Sequence[str], at: int, quantity: str) -> bool:
    """Whether a name is like q_d or tau_J_d[3] of libfranka, with d for desired.

    q_d[2] may also be a speed, which the numbers show.
    """
    spoken = [word for word in words if not word.isdigit()]
    told = (*MOTIONS, "torque") if spoken == list(words) else ("torque",)
    return spoken[-1:] == ["d"] and words[at] != "d" and quantity in told
