"""Write docs/reference from what the code declares: device file, recording file, effects.

    python docs/make_reference.py [--pictures]

The text of every page is checked by the tests (tests/test_reference.py); pictures are drawn only
where they are asked for (`zwidth/figures/effect.py`).
"""

import json
import sys
from collections.abc import Iterable
from pathlib import Path

from zwidth.commands.effects import LETTERS, formula, law, places, units
from zwidth.figures.effect import SHOWN, effect_figure
from zwidth.files.protection import writing_as
from zwidth.files.whole import write_text, write_with
from zwidth.logs.recording_keys import RECORDING_KEYS
from zwidth.sim.device_keys import DEVICE_KEYS
from zwidth.sim.keys import Key
from zwidth.sim.physics import EFFECTS
from zwidth.sim.physics.effect import Effect
from zwidth.sim.physics.free_force import MOST, SIZE, STATES, VALUE, grid_of, is_grid, state_unit
from zwidth.sim.physics.free_law import AT, FORCE, KNOTS, is_table, points_of
from zwidth.sim.physics.two_tables import LAW_FIRST, POINTS, is_two_tables, two_tables_of

FOLDER = Path(__file__).parent / "reference"
OF_SECOND = {  # of the second table of a law of two: its unit, and what it does
    "free_product": ("a number", "factor of the force"),
    "free_shift": ("unit of the first state", "what is added to the first state"),
}
MADE = "<!-- made by docs/make_reference.py -->\n"


def pages() -> dict[str, str]:
    """Return the text of every page by its path in docs/reference."""
    found = {
        "device_file.md": _keys_page(
            "The device file, key by key",
            "What a simulation or a diagnosis knows about a device. `zwidth devices --template 2`"
            " prints one with two masses to start from. How drives are described, and what differs"
            " in one run: [the device file](../device_file.md). An unknown key is an error that"
            " names the nearest known one.",
            DEVICE_KEYS,
        )
        + "\nThe parameters of an effect are further keys of its table:"
        " [effects](effects/README.md).\n",
        "recording_file.md": _keys_page(
            "The recording TOML, key by key",
            "Says what each column of a file is, and in which unit. `zwidth diagnose FILE`"
            " writes one for a file that has none; `zwidth convert FILE FILE.toml` drafts one. What"
            " formats are read, gaps, clocks and known changes: [recordings](../recordings.md).",
            RECORDING_KEYS,
        ),
        "effects/README.md": _index(),
    }
    return found | {f"effects/{e.name}.md": _effect_page(e) for e in EFFECTS.values()}


def _keys_page(title: str, about: str, keys: Iterable[Key]) -> str:
    tables: dict[str, list[Key]] = {}
    for key in keys:
        tables.setdefault(key.table, []).append(key)
    parts = [f"{MADE}# {title}\n\n{about}\n"]
    for table, own in tables.items():
        parts.append(f"\n## {_header(table)}\n\n| key | unit | default | what it is | example |")
        parts[-1] += "\n|---|---|---|---|---|\n"
        parts[-1] += "".join(_row(key) for key in own)
    return "".join(parts)


def _header(table: str) -> str:
    if not table:
        return "At the top"
    return (
        f"[[{table}]]"
        if table
        in (
            "modal.mode",
            "physics",
            "output",
            "known_force",
            "joint",
            "covariate",
            "device.physics",
        )
        else f"[{table}]"
    )


def _row(key: Key) -> str:
    default = _code(key.default) if key.default else "required"
    example = _code(key.example) if key.example else ""
    cells = (f"`{key.name}`", _cell(key.units), default, _cell(key.meaning), example)
    return f"| {' | '.join(cells)} |\n"


def _code(text: str) -> str:
    return text if " " in text and not text.startswith(('"', "[")) else f"`{text}`"


def _cell(text: str) -> str:
    return text.replace(" | ", " or ")


def _index() -> str:
    lines = [
        f"{MADE}# Effects\n",
        "Physics that a device may have besides its masses, springs and dampers. `zwidth effects`"
        " prints this list; `zwidth effects NAME` describes one of them. What the last three"
        " columns mean: [effects in a diagnosis](../../effects.md).\n",
        "| effect | at | what it is | prior | contains | sought |",
        "|---|---|---|---|---|---|",
        *(_index_row(e) for e in EFFECTS.values()),
    ]
    return "\n".join(lines) + "\n"


def _index_row(effect: Effect) -> str:
    prior = f"{effect.prior:g}"
    if effect.elsewhere is not None:
        prior += f", elsewhere {effect.elsewhere:g}"
    name = f"[{effect.name}]({effect.name}.md)"
    cells = (name, places(effect), effect.summary, prior, ", ".join(effect.contains), effect.sought)
    return f"| {' | '.join(cells)} |"


def _effect_page(effect: Effect) -> str:
    shown = SHOWN[effect.name]
    table = is_table(effect.parameters)
    values = ", ".join(
        f"{name} {value:g} {effect.parameter(name).unit}".rstrip()
        for name, value in shown.values.items()
    )
    if table:
        values = f"a table of {len(points_of(shown.values))} points"
    grid = grid_of(shown.values) if is_grid(effect.parameters) else None
    if grid is not None:
        first, second = (f"{len(points)} {states}" for points, states in (
            (grid.rows, "rows"), (grid.columns, "columns")))  # fmt: skip
        values = f"a table of {first} and {second}"
    product = two_tables_of(shown.values) if is_two_tables(effect.parameters) else None
    if product is not None:
        values = f"tables of {len(product.first)} and {len(product.second)} points"
    parts = [
        f"{MADE}# {effect.name}\n\n{_sentence(effect.summary)}\n",
        f"![{effect.name}]({effect.name}.png)\n",
        f"*At {shown.at}: {values or 'no parameters'}. Left: the law. Right: motion with and"
        " without it, and the difference.*\n",
        _law(effect),
        "## Parameters\n",
    ]
    if table:
        state, made = (_cell(units(effect, name)) for name in (AT[0], FORCE[0]))
        parts.append(
            "| key | unit | what it is |\n|---|---|---|\n"
            f"| `table` | rows of [{state}], [{made}] | 2 to {KNOTS} points, the states rising |\n"
            "| `odd` | true or false | whether f(-s) = -f(s); the table is then over the absolute"
            " value and begins at [0, 0] |\n"
            f"| `period` | {state} | period of a periodic law; the table covers one period;"
            " omitted for other laws |\n"
        )
    elif grid is not None:
        parts.append(
            "| key | unit | what it is |\n|---|---|---|\n"
            f"| `over` | one or two of {_states()} | its states; in a link these are the"
            " deflection and its rate |\n"
            f"| `rows` | unit of the first state | values of it, rising: 2 to {SIZE}, or to {MOST}"
            " if it is the only one |\n"
            f"| `columns` | unit of the second state | values of it, rising: 1 to {SIZE}; omitted"
            " if there is none |\n"
            f"| `table` | {_cell(units(effect, VALUE[0]))} | the force: for each row a list with"
            " one number per column; without a second state, one number per row |\n"
        )
    elif product is not None:
        second, does = OF_SECOND[effect.name]
        parts.append(
            "| key | unit | what it is |\n|---|---|---|\n"
            f"| `over` | two of {_states()} | its states; in a link these are the deflection"
            " and its rate |\n"
            "| `first` | rows of [unit of the first state],"
            f" [{_cell(units(effect, LAW_FIRST[0]))}] | the force: 2 to {POINTS} points, the"
            " states rising |\n"
            f"| `second` | rows of [unit of the second state], [{second}] | {does}: 2 to {POINTS}"
            " points, the states rising |\n"
        )
    elif effect.parameters:
        rows = "\n".join(
            f"| `{p.name}` | {p.symbol} | {_cell(units(effect, p.name))} | {p.meaning} |"
            f" {p.lower:g} to {p.upper:g} | {_neutral(p.neutral)} |"
            for p in effect.parameters
        )
        head = "| parameter | symbol | unit | what it is | allowed | does nothing at |"
        parts.append(f"{head}\n|---|---|---|---|---|---|\n{rows}\n")
    else:
        parts.append("None.\n")
    parts.append(f"**Where**: {places(effect)}.\n")
    if effect.mistaken_for:
        alike = ", ".join(f"[{name}]({name}.md)" for name in effect.mistaken_for)
        parts.append(f"**Mistaken for**: {alike}, where a recording is short, weak or one-sided.\n")
    parts.append(f"**Source**: {effect.reference}.\n" if effect.reference != "-" else "")
    entry = [f'effect = "{effect.name}"', f'at = "{shown.at}"']
    if table:
        rows = [list(point) for point in points_of(shown.values)]
        entry += [f"odd = {str(shown.values['odd'] > 0.5).lower()}", f"table = {rows}"]
    elif grid is not None:
        entry += [
            f"over = {json.dumps(grid.over)}", f"rows = {list(grid.rows)}",
            f"columns = {list(grid.columns)}", f"table = {[list(row) for row in grid.table]}",
        ]  # fmt: skip
    elif product is not None:
        entry += [f"over = {json.dumps(product.over)}"]
        entry += [
            f"{key} = {[list(point) for point in table]}"
            for key, table in (("first", product.first), ("second", product.second))
        ]
    else:
        entry += [f"{name} = {value!r}" for name, value in shown.values.items()]
    parts.append("```toml\n[[physics]]\n" + "\n".join(entry) + "\n```\n")
    return "\n".join(part for part in parts if part)


def _states() -> str:
    """The states of a force without a formula, with their units."""
    both = ((state, *(state_unit(state, turns) for turns in (True, False))) for state in STATES)
    return ", ".join(f'"{s}" [{_cell(" or ".join(dict.fromkeys((a, b))))}]' for s, a, b in both)


def _law(effect: Effect) -> str:
    """The formula, and what the file of the effect says of it, how it is simulated with it."""
    if not effect.formula:
        return f"## Law\n\n{law(effect)}\n"
    return (
        f"## Law\n\n```text\n{formula(effect)}\n```\n\n{_sentence(LETTERS)}\n\n"
        f"## In detail\n\n{law(effect)}\n"
    )


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


def _neutral(value: float | None) -> str:
    return "" if value is None else f"{value:g}"


def main(arguments: list[str]) -> None:
    """Write the pages, and the pictures where they are asked for."""
    with writing_as("make_reference", overwrite=True):
        for name, text in pages().items():
            write_text(FOLDER / name, text)
        if "--pictures" in arguments:
            for effect in EFFECTS.values():
                figure = effect_figure(effect)
                path = FOLDER / "effects" / f"{effect.name}.png"
                write_with(path, lambda f, figure=figure: figure.savefig(f, format="png", dpi=100))


if __name__ == "__main__":
    main(sys.argv[1:])
