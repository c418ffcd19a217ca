"""A learned formula, saved as a user's own effect (`sim/physics/own.py`)."""

import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial

from tomli_w import dumps

from zwidth.diagnosis.learning.formulas import FORMS, LAWS
from zwidth.diagnosis.learning.steady import HOOKS, STATES

OVER = {"free_spring": "position", "free_damper": "velocity", "free_amplifier": "command",
        "free_sensor": "position"}  # fmt: skip
WIDER = 100.0  # bounds of a parameter, relative to its fitted value


OF_STATE = {"position": "free_spring", "velocity": "free_damper", "command": "free_amplifier"}
SECOND = "_2"  # after the names of the second formula of a law of two


def effect_text(name: str, effect: str, form: str, numbers: Mapping[str, float], said: str) -> str:
    """Return the file of an effect `name`, from a learned law and its formula.

    effect: of the law ("free_damper"); form, numbers: of the formula; said: its origin, in words.
    Raises ValueError for an unknown form.
    """
    made = _length if effect == "free_sensor" else _force
    formula, parameters = _part(effect, form, numbers, made)
    enters = HOOKS.get(effect, "force")
    return _text(name, f"{form} of the {OVER[effect]}", enters, formula, said, parameters)


def law_of_two_text(
    name: str,
    states: Sequence[str],
    forms: Sequence[tuple[str, Mapping[str, float]]],
    said: str,
    shifts: bool = False,
) -> str:
    """Return the file of an effect that is a formula over one state times one over another.

    states: two of position, velocity and command; forms: form and numbers for each; the first gives
    the force. shifts: the second is added to the first state instead. Raises ValueError for an
    unknown form.
    """
    makes = partial(_state, OF_STATE[states[0]]) if shifts else _number
    formulas: list[str] = []
    parameters: dict[str, dict[str, object]] = {}
    for state, (form, numbers), made, after in zip(
        states, forms, (_force, makes), ("", SECOND), strict=True
    ):
        formula, own = _part(OF_STATE[state], form, numbers, made)
        for key in own:
            formula = re.sub(rf"\b{key}\b", f"{key}{after}", formula)
        if shifts and after:  # none of them is a strength inside another formula
            own = {key: {"start": numbers[key], **value} for key, value in own.items()}
        formulas.append(f"({formula})")
        parameters |= {f"{key}{after}": value for key, value in own.items()}
    each = [f"{form} of the {state}" for (form, _), state in zip(forms, states, strict=True)]
    if not shifts:
        formula = " * ".join(formulas)
        return _text(name, " times ".join(each), "force", formula, said, parameters)
    first = STATES[OF_STATE[states[0]]]
    formula = re.sub(rf"\b{first}\b", f"({first} + {formulas[1]})", formulas[0])
    return _text(name, " shifted by a ".join(each), "force", formula, said, parameters)


def _text(
    name: str,
    summary: str,
    enters: str,
    formula: str,
    said: str,
    parameters: Mapping[str, Mapping[str, object]],
) -> str:
    table = {
        "name": name, "summary": summary, "enters": enters, "formula": formula, "reference": said,
        "parameters": parameters,
    }  # fmt: skip
    return (
        f"# An effect of one's own: docs/own_effects.md says what may stand here.\n{dumps(table)}"
    )


def _part(
    effect: str, form: str, numbers: Mapping[str, float], made: Callable[[bool], str]
) -> tuple[str, dict[str, dict[str, object]]]:
    """A formula over the state of a law, and its parameters. made: the unit of its value."""
    if form not in LAWS:
        raise ValueError(f"form is {form!r}; it must be one of {', '.join(LAWS)}")
    own = next(f for f in FORMS if f.name == form)
    law, powers = LAWS[form]
    parameters: dict[str, dict[str, object]] = {}
    for key, power in zip(own.factors, powers, strict=True):
        most = WIDER * abs(numbers[key]) or 1.0
        rotary, linear = (_unit(effect, power, r, made(r)) for r in (True, False))
        parameters[key] = {
            "unit": rotary, "linear_unit": linear, "lower": -most, "upper": most,
            "meaning": f"found as {numbers[key]:.4g}",
        }  # fmt: skip
    for key in own.shape:
        value = numbers[key]
        least, most = sorted((value / WIDER, WIDER * value))
        if key == "m":  # a position, which may have either sign
            least, most = -WIDER * abs(value) - 1e-9, WIDER * abs(value) + 1e-9
        rotary, linear = ("", "") if key == "p" else (_state(effect, r) for r in (True, False))
        parameters[key] = {
            "unit": rotary, "linear_unit": linear, "lower": least, "upper": most, "start": value,
            "meaning": f"found as {value:.4g}",
        }  # fmt: skip
    return re.sub(r"\bs\b", STATES[effect], law), parameters


def _length(rotary: bool) -> str:
    return "rad" if rotary else "m"


def _force(rotary: bool) -> str:
    return "N m" if rotary else "N"


def _number(_: bool) -> str:
    return ""


def _state(effect: str, rotary: bool) -> str:
    """Unit of the state."""
    if effect == "free_amplifier":
        return _force(rotary)
    return f"{_length(rotary)}/s" if effect == "free_damper" else _length(rotary)


def _unit(effect: str, power: int, rotary: bool, made: str) -> str:
    """Unit of a factor that gives `made` times a power of a law's state."""
    length, force = _length(rotary), _force(rotary)
    if power == 0:
        return made
    n = "" if abs(power) == 1 else str(abs(power))
    if effect == "free_amplifier":
        if made == "":
            return f"1/({force}){n}" if power > 0 else f"({force}){n}"
        return "" if power == 1 else f"{made}/({force}){power}" if power > 0 else f"({force})2"
    if effect == "free_damper":
        own = made or "1"
        return f"{made} s{n}/{length}{n}".strip() if power > 0 else f"{own} {length}/s".strip()
    return f"{made or '1'}/{length}{n}" if power > 0 else f"{made} {length}".strip()
