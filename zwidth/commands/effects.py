"""`zwidth effects`: the physics that a device may have besides its masses, springs and dampers."""

import inspect
import json
import re
from collections.abc import Mapping
from importlib import import_module
from itertools import groupby
from pathlib import Path
from shutil import get_terminal_size
from textwrap import fill, indent
from typing import Any

import click

from zwidth.console import Column, Console, json_number
from zwidth.diagnosis.learning.own_effect import effect_text, law_of_two_text
from zwidth.figures.style import picture_files
from zwidth.files.protection import reading
from zwidth.files.whole import write_text
from zwidth.options import force_option, json_option
from zwidth.sim.own_files import FOLDER
from zwidth.sim.physics import EFFECTS, LIBRARY, unknown_effect
from zwidth.sim.physics.effect import Effect
from zwidth.sim.physics.own import IDENTIFIER, OWN

NUMBERED = 5  # parameters with a common name and a number; more share one row
SOURCE = re.compile(r" \(`sim/\w+\.py`\)")
LETTERS = (
    "in it, q is the position (of a link: its deflection), v the velocity, u the command and f"
    " the force on the mass or link"
)


@click.command("effects")
@click.argument("name", metavar="[NAME]", required=False)
@click.option(
    "--learned", metavar="FILE", type=click.Path(path_type=Path),
    help="Result of 'zwidth diagnose --json FILE': save the law that it learned as your own effect"
    " NAME, in effects/NAME.toml.",
)  # fmt: skip
@click.option(
    "--out", "--picture", "picture", metavar="FILE", type=click.Path(path_type=Path),
    help="Draw the effect NAME, and a motion with and without it, as FILE.png and FILE.svg.",
)  # fmt: skip
@force_option
@json_option
def command(
    name: str | None, learned: Path | None, picture: Path | None, json_file: str | None
) -> None:
    """List the effects that zwidth knows, or describe one.

    An effect is physics that a device may have besides its masses, springs and dampers: friction,
    play, a limit. A device file states them as [[physics]]; a diagnosis searches for them.
    """
    console = Console(json_file)
    if learned is not None:
        _keep(console, name, learned)
        return
    if picture is not None and name is None:
        raise click.UsageError("--out needs the NAME of the effect to draw")
    named = picture is not None and picture.suffix in (".png", ".svg")
    stem = picture.with_suffix("") if picture is not None and named else picture
    console.will_write(*(picture_files(stem) if stem else ()))
    if name is None:
        columns = [Column("effect", False), Column("at", False), Column("what it is", False)]
        rows = [[e.name, places(e), e.summary] for e in EFFECTS.values()]
        console.table(f"{len(rows)} effects; 'zwidth effects NAME' describes one", columns, rows)
        console.result({"effects": [described(e) for e in EFFECTS.values()]})
        return
    if name not in EFFECTS:
        raise ValueError(f"there is no effect {name!r}; {unknown_effect(name)}")
    effect = EFFECTS[name]
    wrapped = _narrow if console.stream.isatty() else str
    console.say(f"{effect.name}: {effect.summary}\n")
    if effect.formula:
        console.say(f"{wrapped(indent(formula(effect), '    '))}\n\n{LETTERS}\n")
    joined = re.sub(r"(?<=\S)\n(?=\S)", " ", law(effect))  # it is wrapped again for the terminal
    console.say(f"{wrapped(joined)}\n")
    if effect.parameters:
        columns = [Column("parameter", False), Column("unit", False), Column("from")]
        columns += [Column("to"), Column("what it is", False)]
        console.table("", columns, _listed(effect))
    console.say(f"\nat: {places(effect)}")
    if effect.mistaken_for:
        console.say(f"mistaken for: {', '.join(effect.mistaken_for)}")
    console.say(f"source: {effect.reference}")
    if stem is not None:
        _draw(console, effect, stem)
    console.result(described(effect))


def _draw(console: Console, effect: Effect, stem: Path) -> None:
    from zwidth.figures.effect import effect_figure
    from zwidth.figures.style import save_figure

    for path in save_figure(effect_figure(effect), stem):
        console.say(f"wrote {path}")


def _keep(console: Console, name: str | None, file: Path) -> None:
    """Write what was learned as an effect of one's own."""
    if name is None:
        raise click.UsageError("--learned needs NAME, the name of the new effect")
    if name in LIBRARY or not IDENTIFIER.match(name):
        raise ValueError(
            f"NAME is {name!r}; it must consist of lowercase letters, digits and _, and not be the"
            " name of an effect of the library"
        )
    try:
        result = json.loads(reading(file).read_text(encoding="utf-8"))
        found = result["learned"]
    except (ValueError, KeyError, TypeError):
        raise ValueError(f"{file} is not a result of 'zwidth diagnose --json FILE'") from None
    if not found:
        raise ValueError(f"{file} has no learned law: every finding in it has a name")
    if not found["formulas"]:
        raise ValueError(
            f"{file} has a learned law without a formula near it; use the table in the improved"
            f" device ({found['effect']})"
        )
    said = f"learned from {result['recordings'][0] if result.get('recordings') else file.name}"
    try:
        text = _effect_of(name, found, said)
    except (KeyError, TypeError):  # numbers or states that are missing
        raise ValueError(f"{file} is not a result of 'zwidth diagnose --json FILE'") from None
    path = Path(FOLDER) / f"{name}.toml"
    console.will_write(path)
    path.parent.mkdir(exist_ok=True)
    console.say(f"wrote {write_text(path, text)}")
    console.say(
        f"commands in this folder now search for {found['formula']} as {name}; the first one"
        " compiles it"
    )
    if found.get("formula_of") == "together":
        names = " and ".join(found["together"]["names"])
        console.say(f"its formula includes {names}, which were fitted together with the curve")
    console.result({"file": str(path), "effect": name, "formula": found["formula"]})


def _effect_of(name: str, learned: Mapping[str, Any], said: str) -> str:
    """The file of an effect with the most likely formula of a learned law."""
    best = learned["formulas"][0]
    if "factors" not in best:
        return effect_text(name, learned["effect"], best["form"], best["numbers"], said)
    parts = best["factors"]
    if len(parts) != 2:
        raise KeyError("factors")
    forms = [(part["form"], part["numbers"]) for part in parts]
    states = [part["state"] for part in parts]
    return law_of_two_text(name, states, forms, said, shifts=best["form"] == "shift")


def _listed(effect: Effect) -> list[list[str]]:
    """A row for each parameter, one for all the points of a table: "row_1 to row_32"."""
    found: list[list[str]] = []
    for _, each in groupby(effect.parameters, lambda p: p.name.rstrip("0123456789_")):
        alike = list(each)
        runs = [alike] if len(alike) > NUMBERED else [[p] for p in alike]
        for run in runs:
            first, last = run[0], run[-1]
            many = first is not last
            named = f"{first.name} to {last.name}" if many else first.name
            said = f"{first.meaning} to {last.meaning}" if many else first.meaning
            found.append([named, units(effect, first.name), f"{first.lower:g}",
                          f"{first.upper:g}", said])  # fmt: skip
    return found


def formula(effect: Effect) -> str:
    """Return the law of an effect, a line for each part; "" if its file states none."""
    return effect.formula.replace(",  ", ",\n")


def law(effect: Effect) -> str:
    """Return the description in the file of an effect: its law, and its limits."""
    if effect.name in OWN:
        own = OWN[effect.name]
        return f"{own.formula}\n\nAn effect of your own, declared in {own.file}."
    written = import_module(f"zwidth.sim.physics.{effect.name}").__doc__ or ""
    return _for_users(inspect.cleandoc(written))


def _for_users(text: str) -> str:
    """Leave out the names of files in brackets."""
    kept: list[str] = []
    for paragraph in text.split("\n\n"):
        said = paragraph if paragraph.startswith(" ") else SOURCE.sub("", paragraph)
        kept.append(said if said == paragraph else fill(said, 100, break_on_hyphens=False))
    return "\n\n".join(kept)


def _narrow(text: str) -> str:
    """Wrap the indented lines of a text that are wider than the terminal, indented further."""
    width = get_terminal_size().columns
    lines: list[str] = []
    for line in text.split("\n"):
        lead = " " * (len(line) - len(line.lstrip()))
        if lead and len(line) > width:
            further = f"{lead}    "
            line = fill(line.strip(), width, initial_indent=lead, subsequent_indent=further)
        lines.append(line)
    return "\n".join(lines)


def places(effect: Effect) -> str:
    """Return where an effect can act, in words."""
    masses = [p for p in effect.places if p.startswith("m") and p[1:].isdigit()]
    links = [p for p in effect.places if p.startswith("link")]
    found = ["any mass"] if len(masses) > 1 else masses
    found += ["any link"] if len(links) > 1 else links
    return ", ".join([*found, *(p for p in effect.places if p not in (*masses, *links))])


def units(effect: Effect, name: str) -> str:
    """Return a parameter's unit on a rotary and on a linear device, "N m | N"."""
    parameter = effect.parameter(name)
    own = parameter.unit_for(True)
    other = own if effect.rotary_only else parameter.unit_for(False)
    return own if own == other else f"{own} | {other}"


def described(effect: Effect) -> dict[str, Any]:
    """Return an effect in its JSON form."""
    return {
        "effect": effect.name,
        "summary": effect.summary,
        "at": list(effect.places),
        "formula": effect.formula,
        "law": law(effect),
        "parameters": [
            {
                "name": p.name,
                "symbol": p.symbol,
                "unit": {"rotary": p.unit_for(True), "linear": p.unit_for(False)},
                "lower": json_number(p.lower),
                "upper": json_number(p.upper),
                "neutral": None if p.neutral is None else json_number(p.neutral),
                "meaning": p.meaning,
            }
            for p in effect.parameters
        ],
        "mistaken_for": list(effect.mistaken_for),
        "source": effect.reference,
    }
