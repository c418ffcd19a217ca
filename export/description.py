"""`modelDescription.xml` of an FMU: its variables with units, and how it may be stepped."""

import math
import re
import uuid
from collections.abc import Sequence
from typing import NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from zwidth.export.settable import Number

TOKEN = "{00000000-0000-0000-0000-000000000000}"  # in the source, until the token is computed
SPACE = uuid.UUID("7f3f0a5e-0d0c-5b8e-9a54-0c1d6a3c7f10")
SI = {"N": {"kg": 1, "m": 1, "s": -2}, "m": {"m": 1}, "kg": {"kg": 1}, "s": {"s": 1},
      "rad": {"rad": 1}}  # fmt: skip


class Variables(NamedTuple):
    """What an FMU shows, in the order of its value references; units of force and position."""

    force: str
    length: str
    states: Sequence[Number]
    constants: Sequence[Number]
    settings: Sequence[Number]


def description(
    title: str, name: str, about: str, period: float, variables: Variables, source: str
) -> tuple[str, str]:
    """Return the XML, and the instantiation token, which an importer must give back.

    period [s]: of the device; source: the C source, from which, with this description, the token is
    computed.
    """
    root = _model(title, name, about, period, variables, TOKEN)
    token = "{" + str(uuid.uuid5(SPACE, source + _text(root))) + "}"
    return _text(_model(title, name, about, period, variables, token)), token


def build_description(name: str) -> str:
    """Return `buildDescription.xml`: the one source, C99."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    files = SubElement(SubElement(root, "BuildConfiguration", modelIdentifier=name),
                       "SourceFileSet", language="C99")  # fmt: skip
    SubElement(files, "SourceFile", name=f"{name}.c")
    return _text(root)


def base_units(unit: str) -> dict[str, int]:
    """Return the exponents of a unit's SI base units: "N m s2/rad2" is kg m2 rad-2, "1/s" s-1.

    Raises KeyError for a unit with other parts than N, m, kg, s and rad.
    """
    over, _, under = unit.partition("/")
    found: dict[str, int] = {}
    for words, sign in ((over, 1), (under, -1)):
        for word in (w for w in words.split() if w != "1"):
            symbol, power = re.fullmatch(r"([A-Za-z]+)(\d*)", word).groups()  # pyright: ignore[reportOptionalMemberAccess]
            for base, exponent in SI[symbol].items():
                found[base] = found.get(base, 0) + sign * exponent * int(power or 1)
    return {base: exponent for base, exponent in found.items() if exponent}


def _model(
    title: str, name: str, about: str, period: float, variables: Variables, token: str
) -> Element:
    root = Element(
        "fmiModelDescription", fmiVersion="3.0", modelName=title, instantiationToken=token,
        description=about, generationTool="zwidth", variableNamingConvention="structured",
    )  # fmt: skip
    SubElement(
        root, "CoSimulation", modelIdentifier=name, fixedInternalStepSize=repr(period),
        canHandleVariableCommunicationStepSize="true", canGetAndSetFMUState="true",
        canSerializeFMUState="true",
    )  # fmt: skip
    force, length, states, constants, settings = variables
    numbers = [*states, *constants, *settings]
    used = dict.fromkeys(u for u in ("s", force, length, *(n.unit for n in numbers)) if u)
    definitions = SubElement(root, "UnitDefinitions")
    for unit in used:
        exponents = {base: str(power) for base, power in base_units(unit).items()}
        SubElement(SubElement(definitions, "Unit", name=unit), "BaseUnit", exponents)
    SubElement(root, "DefaultExperiment", startTime="0", stepSize=repr(period))
    listed = SubElement(root, "ModelVariables")
    outputs = _variables(listed, variables)
    structure = SubElement(root, "ModelStructure")
    for kind in ("Output", "InitialUnknown"):
        for reference in outputs:
            SubElement(structure, kind, valueReference=reference)
    return root


def _variables(listed: Element, variables: Variables) -> list[str]:
    """Add all variables; return the value references of the outputs."""
    force, length, states, constants, settings = variables
    outputs: list[str] = []

    def add(name: str, unit: str, meaning: str, **more: str) -> None:
        reference = str(len(listed))
        said = {"name": name, "valueReference": reference, "unit": unit, "description": meaning}
        SubElement(listed, "Float64", {k: v for k, v in (said | more).items() if v})
        if more["causality"] == "output":
            outputs.append(reference)

    add("time", "s", "", causality="independent", variability="continuous")
    add("command", force, "held over the steps that follow", causality="input",
        variability="discrete", start="0")  # fmt: skip
    add("measured", length, "what the encoder reads", causality="output", variability="discrete",
        initial="calculated")  # fmt: skip
    add("drive", force, "what the amplifier was last told, before the delay", causality="output",
        variability="discrete", initial="calculated")  # fmt: skip
    for one in states:
        add(one.name, one.unit, "", causality="output", variability="continuous",
            initial="calculated")  # fmt: skip
    for one in constants:
        add(one.name, one.unit, one.meaning, causality="local", variability="constant",
            initial="exact", start=_double(one.value))  # fmt: skip
    for one in settings:
        bounds = {"min": one.lower, "max": one.upper}
        add(one.name, one.unit, one.meaning, causality="parameter", variability="tunable",
            initial="exact", start=_double(one.value),
            **{k: _double(v) for k, v in bounds.items() if math.isfinite(v)})  # fmt: skip
    return outputs


def _double(value: float) -> str:
    """Return a number as XML Schema writes it."""
    if math.isinf(value):
        return "INF" if value > 0.0 else "-INF"
    return repr(value)


def _text(root: Element) -> str:
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, "unicode") + "\n"
