"""A formula that was learned, kept as an effect of the user's own (`sim/physics/own.py`)."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from tomli_w import dumps

from zwidth.diagnosis.laws.forms import TABLES
from zwidth.diagnosis.laws.formula import FORMS, Form
from zwidth.diagnosis.laws.steady import HOOKS, STATES

Parameters = dict[str, dict[str, Any]]
FORM = {form.name: form for form in FORMS}
OF_STATE = {"position": "free_spring", "velocity": "free_damper", "command": "free_amplifier"}
SECOND = "_2"  # after the names of the second formula of a law of two


def effect_text(name: str, effect: str, form: str, numbers: Mapping[str, float], said: str) -> str:
    """Return the file of an effect `name`, of a law of no name and the formula it looks like.

    effect: the law's ("free_damper"); form, numbers: of the formula; said: where it is from.
    Raises ValueError for a form that there is not.
    """
    makes = "length" if effect == "free_sensor" else "force"
    formula, parameters = _part(effect, form, numbers, makes)
    summary = f"{form} of the {TABLES[effect]}"
    return _text(name, summary, HOOKS.get(effect, "force"), formula, said, parameters)


def law_of_two_text(
    name: str,
    states: Sequence[str],
    forms: Sequence[tuple[str, Mapping[str, float]]],
    said: str,
    shifts: bool = False,
) -> str:
    """Return the file of an effect that is one formula over a state times one over another.

    states: two of position, velocity and command; forms: form and numbers of each, the first of
    which makes the force. shifts: the second is added to the first one's state instead. Raises
    ValueError for a form that there is not.
    """
    first, second = (OF_STATE[state] for state in states)
    law, parameters = _part(first, *forms[0], "force")
    other, own = _part(second, *forms[1], _state(first) if shifts else "")
    for key in own:
        other = re.sub(rf"\b{key}\b", f"{key}{SECOND}", other)
    if shifts:  # within another formula none of them is a strength
        numbers = forms[1][1]
        own = {key: {"start": numbers[key], **value} for key, value in own.items()}
    parameters |= {f"{key}{SECOND}": value for key, value in own.items()}
    each = [f"{form} of the {state}" for (form, _), state in zip(forms, states, strict=True)]
    if not shifts:
        formula = f"({law}) * ({other})"
        return _text(name, " times ".join(each), "force", formula, said, parameters)
    moved = STATES[first]
    formula = re.sub(rf"\b{moved}\b", f"({moved} + ({other}))", f"({law})")
    return _text(name, " shifted by a ".join(each), "force", formula, said, parameters)


def _text(
    name: str, summary: str, enters: str, formula: str, said: str, parameters: Parameters
) -> str:
    table = {
        "name": name, "summary": summary, "enters": enters, "formula": formula, "reference": said,
        "parameters": parameters,
    }  # fmt: skip
    return (
        f"# An effect of one's own: docs/own_effects.md says what may stand here.\n{dumps(table)}"
    )


def _part(
    effect: str, form: str, numbers: Mapping[str, float], makes: str, wider: float = 100.0
) -> tuple[str, Parameters]:
    """A formula over the state of a law, and its parameters, sought between so many times more.

    makes: "force", "length", or another quantity of `_state`.
    """
    if form not in FORM:
        raise ValueError(f"form is {form!r}; allowed is {', '.join(FORM)}")
    own: Form = FORM[form]
    parameters: Parameters = {}
    for key, power in own.powers.items():
        most = wider * abs(numbers[key]) or 1.0
        rotary, linear = (_per(makes, _state(effect), power, r) for r in (True, False))
        parameters[key] = _parameter(rotary, linear, -most, most, numbers[key])
    for key in own.shape:
        value = numbers[key]
        least, most = sorted((value / wider, wider * value))
        if key == "m":  # a place, which may be on either side
            least, most = -wider * abs(value) - 1e-9, wider * abs(value) + 1e-9
        rotary, linear = ("", "") if key == "p" else (_unit(_state(effect), r) for r in (1, 0))
        parameters[key] = _parameter(rotary, linear, least, most, value) | {"start": value}
    return re.sub(r"\bs\b", STATES[effect], own.law), parameters


def _parameter(rotary: str, linear: str, least: float, most: float, value: float) -> dict[str, Any]:
    return {
        "unit": rotary, "linear_unit": linear, "lower": least, "upper": most,
        "meaning": f"found as {value:.4g}",
    }  # fmt: skip


def _state(effect: str) -> str:
    """What a law's state is."""
    return {"free_amplifier": "force", "free_damper": "speed"}.get(effect, "length")


def _unit(quantity: str, rotary: bool | int) -> str:
    length = "rad" if rotary else "m"
    return {"force": "N m" if rotary else "N", "length": length, "speed": f"{length}/s"}.get(
        quantity, ""
    )


def _per(makes: str, state: str, power: int, rotary: bool) -> str:
    """Unit of what makes a quantity of a power of a state."""
    made, length, force = (_unit(q, rotary) for q in (makes, "length", "force"))
    n = "" if abs(power) == 1 else str(abs(power))
    if power == 0:
        return made
    if state == "force":
        if made == "":
            return f"1/({force}){n}" if power > 0 else f"({force}){n}"
        return "" if power == 1 else f"{made}/({force}){power}" if power > 0 else f"({force})2"
    if state == "speed":
        own = made or "1"
        return f"{made} s{n}/{length}{n}".strip() if power > 0 else f"{own} {length}/s".strip()
    return f"{made or '1'}/{length}{n}" if power > 0 else f"{made} {length}".strip()
