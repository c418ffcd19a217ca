"""A formula that was learned, kept as an effect of the user's own (`sim/physics/own.py`)."""

import re
from collections.abc import Mapping

from tomli_w import dumps

from zwidth.diagnosis.learning.formulas import FORMS, LAWS

STATES = {"free_spring": "q", "free_damper": "v", "free_amplifier": "u", "free_sensor": "q"}
ENTERS = {"free_amplifier": "command", "free_sensor": "sensor"}
OVER = {"free_spring": "position", "free_damper": "velocity", "free_amplifier": "command",
        "free_sensor": "position"}  # fmt: skip
WIDER = 100.0  # times what was found, between which it is sought


def effect_text(name: str, effect: str, form: str, numbers: Mapping[str, float], said: str) -> str:
    """Return the file of an effect `name`, of a law of no name and the formula it looks like.

    effect: the law's ("free_damper"); form, numbers: of the formula; said: where it is from.
    Raises ValueError for a form that there is not.
    """
    if form not in LAWS:
        raise ValueError(f"form is {form!r}; allowed is {', '.join(LAWS)}")
    own = next(f for f in FORMS if f.name == form)
    law, powers = LAWS[form]
    state = STATES[effect]
    parameters: dict[str, dict[str, object]] = {}
    for key, power in zip(own.factors, powers, strict=True):
        most = WIDER * abs(numbers[key]) or 1.0
        rotary, linear = (_unit(effect, power, r) for r in (True, False))
        parameters[key] = {
            "unit": rotary, "linear_unit": linear, "lower": -most, "upper": most,
            "meaning": f"found as {numbers[key]:.4g}",
        }  # fmt: skip
    for key in own.shape:
        value = numbers[key]
        least, most = sorted((value / WIDER, WIDER * value))
        if key == "m":  # a place, which may be on either side
            least, most = -WIDER * abs(value) - 1e-9, WIDER * abs(value) + 1e-9
        rotary, linear = ("", "") if key == "p" else (_state(effect, r) for r in (True, False))
        parameters[key] = {
            "unit": rotary, "linear_unit": linear, "lower": least, "upper": most, "start": value,
            "meaning": f"found as {value:.4g}",
        }  # fmt: skip
    table = {
        "name": name,
        "summary": f"{form} of the {OVER[effect]}",
        "enters": ENTERS.get(effect, "force"),
        "formula": re.sub(r"\bs\b", state, law),
        "reference": said,
        "parameters": parameters,
    }
    return (
        f"# An effect of one's own: docs/own_effects.md says what may stand here.\n{dumps(table)}"
    )


def _state(effect: str, rotary: bool) -> str:
    """Unit of the state."""
    if effect == "free_amplifier":
        return "N m" if rotary else "N"
    length = "rad" if rotary else "m"
    return f"{length}/s" if effect == "free_damper" else length


def _unit(effect: str, power: int, rotary: bool) -> str:
    """Unit of a law over a power of its state."""
    length = "rad" if rotary else "m"
    force = "N m" if rotary else "N"
    made = length if effect == "free_sensor" else force
    if power == 0:
        return made
    n = "" if abs(power) == 1 else str(abs(power))
    if effect == "free_amplifier":
        return "" if power == 1 else f"{made}/({force}){power}" if power > 0 else f"({force})2"
    if effect == "free_damper":
        return f"{made} s{n}/{length}{n}" if power > 0 else f"{made} {length}/s"
    return f"{made}/{length}{n}" if power > 0 else f"{made} {length}"
