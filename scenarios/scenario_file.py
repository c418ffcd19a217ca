"""A scenario as TOML text: read, checked, written back to the bit (docs/scenarios.md).

Keys: schema, duration_s, seed, substeps, energy, fine, bound; tables: [device] (name, path or
text), [interface], [[physics]], [controller], [start], [disturbance].
"""

import os
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, cast

import tomli_w

from zwidth.files.protection import reading
from zwidth.scenarios.controller_kinds import Files, controller_entry, read_controller, whole
from zwidth.scenarios.disturbance import KEYS, Disturbance
from zwidth.scenarios.scenario import Scenario
from zwidth.sim.controller import Step
from zwidth.sim.device import Device
from zwidth.sim.device_file import (
    INTERFACE_KEYS,
    INTERFACE_TEXTS,
    device_from_text,
    device_to_text,
    load_device,
    other_kind,
    read_physics,
    shipped_devices,
)
from zwidth.sim.nearest import nearest
from zwidth.sim.physics import effect_named
from zwidth.sim.physics.effect import Physics
from zwidth.sim.physics.points import of_points
from zwidth.sim.run import Start
from zwidth.sim.table import Table, TableError

SCHEMA = 1
TEXTS = ("kind", "at")
TOP_KEYS = (
    "schema", "duration_s", "seed", "substeps", "energy", "fine", "bound",
    "device", "interface", "physics", "controller", "start", "disturbance",
)  # fmt: skip


class ScenarioError(ValueError):
    """An invalid scenario file; the message is one sentence."""


def load_scenario(path: str | os.PathLike[str], step: Step | None = None) -> Scenario:
    """Return the scenario of a TOML file. step: the user's own control law, for kind = "user".

    Files that it names are searched for beside it. Raises ScenarioError with one sentence: no such
    file, not TOML (with the line), an unknown key or kind (with the nearest known one), a wrong
    type, a value that is not allowed.
    """
    path = Path(path)
    return scenario_from_text(
        _text(path.name, _beside(path)), str(path), files=_beside(path), step=step
    )


def scenario_from_text(
    text: str, where: str = "scenario", *, files: Files | None = None, step: Step | None = None
) -> Scenario:
    """Return the scenario of a text; `where` begins every error message; see `load_scenario`.

    files: returns the bytes of a file that the scenario names, and raises ValueError if there is
    none; by default it reads from the working folder.
    """
    try:
        values = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise ScenarioError(f"{where}: this is not TOML: {error}") from None
    if other := other_kind(values, "scenario"):
        raise ScenarioError(f"{where}: {other}")
    try:
        return _scenario(values, files or _beside(Path(where)), step)
    except ValueError as error:
        raise ScenarioError(f"{where}: {error}") from None


def scenario_to_text(
    scenario: Scenario, *, device: str | None = None, array: str | None = None
) -> str:
    """Return the scenario file: all keys, with numbers that read back exactly.

    device: name of a device file, written in place of the device's text. array: name of an .npy
    file, written in place of the numbers of a recorded command.
    """
    head: dict[str, object] = {
        "schema": SCHEMA,
        "duration_s": float(scenario.duration),
        "seed": scenario.seed,
        "substeps": scenario.substeps,
        "energy": scenario.energy,
        "fine": scenario.fine,
        "bound": float(scenario.bound),
        "device": {"text": device_to_text(scenario.device)} if device is None else {"path": device},
        "controller": controller_entry(scenario.controller, array),
        "start": asdict(scenario.start),
    }
    if scenario.disturbances:
        head["disturbance"] = [_entry(disturbance) for disturbance in scenario.disturbances]
    return tomli_w.dumps(head, multiline_strings=True)


def _entry(disturbance: Disturbance) -> dict[str, object]:
    values = asdict(disturbance)
    return {
        key: values[key] if key in TEXTS else float(values[key]) for key in KEYS[disturbance.kind]
    }


def _scenario(values: Mapping[str, Any], files: Files, step: Step | None) -> Scenario:
    top = Table(values).only(TOP_KEYS)
    if "schema" in top and top.number("schema") != SCHEMA:
        raise TableError(f"schema is {top.number('schema'):g}; this version reads {SCHEMA}")
    energy = top.text("energy", "ledger")
    return Scenario(
        device=_device(top, files),
        controller=read_controller(top.table("controller"), files, step),
        duration=_named("duration_s", top.number("duration_s")),
        start=_start(top.table("start")),
        disturbances=_disturbances(top, values.get("disturbance")),
        seed=whole(top, "seed", 0),
        substeps=whole(top, "substeps", 0),
        energy=cast("Any", energy),
        fine=top.boolean("fine", False),
        bound=top.number("bound", 1e6),
    )


def _named(key: str, value: float) -> float:
    if not 0.0 < value < float("inf"):
        raise TableError(f"{key} is {value:g}; it must be a finite time above 0 s")
    return value


def _device(top: Table, files: Files) -> Device:
    table = top.table("device").only(("name", "path", "text"))
    if len(table.keys()) != 1:
        raise TableError(
            "[device] needs exactly one key: name (of a shipped device), path (of a device file) or"
            " text (of a device file)"
        )
    if "name" in table:
        name = table.text("name")
        if name not in shipped_devices():
            raise TableError(
                f"device.name is {name!r}, which is not a shipped device;"
                f" {nearest(name, shipped_devices())} (for a device file, use device.path)"
            )
        device = load_device(name)
    elif "path" in table:
        device = device_from_text(_text(table.text("path"), files), table.text("path"))
    else:
        device = device_from_text(table.text("text"), "device.text")
    device = _with_interface(device, top.table("interface"))
    return device.with_physics(*(_physics(entry) for entry in top.tables("physics")))


def _with_interface(device: Device, table: Table) -> Device:
    table.only(INTERFACE_KEYS)
    changes = {
        field: table.text(key) if key in INTERFACE_TEXTS else table.number(key)
        for key, field in INTERFACE_KEYS.items()
        if key in table
    }
    try:
        return device.with_interface(**changes)
    except ValueError as error:
        sentence = str(error)
        for key, field in INTERFACE_KEYS.items():
            sentence = sentence.replace(f"interface.{field} is", f"interface.{key} is")
        raise TableError(sentence) from None


def _physics(table: Table) -> Physics:
    effect = effect_named(table.text("effect"))
    if of_points(effect.parameters):
        return read_physics(table)
    parameters = [parameter.name for parameter in effect.parameters]
    table.only(("effect", "at", *parameters))
    return Physics(effect, table.text("at"), {key: table.number(key) for key in parameters})


def _start(table: Table) -> Start:
    table.only(("position", "velocity"))
    return Start(*(_one_or_each(table, key) for key in ("position", "velocity")))


def _one_or_each(table: Table, key: str) -> float | Sequence[float]:
    try:
        return table.number(key, 0.0)
    except TableError:
        pass
    try:
        return table.numbers(key)
    except TableError as error:
        raise TableError(f"{error}, or one number for all masses") from None


def _disturbances(top: Table, given: object) -> tuple[Disturbance, ...]:
    """One [disturbance], or several as [[disturbance]]."""
    single = isinstance(given, dict)
    tables = [top.table("disturbance")] if single else top.tables("disturbance")
    return tuple(_disturbance(table) for table in tables)


def _disturbance(table: Table) -> Disturbance:
    kind = table.text("kind")
    if kind not in KEYS:
        raise TableError(f"{table.path}.kind is {kind!r}; {nearest(kind, KEYS)}")
    table.only(KEYS[kind])
    numbers = {key: table.number(key) for key in KEYS[kind] if key in table and key not in TEXTS}
    numbers["amplitude"] = table.number("amplitude")
    return Disturbance(kind=kind, at=table.text("at", "m1"), **numbers)


def _beside(path: Path) -> Files:
    def read(name: str) -> bytes:
        file = path.parent / name
        try:
            return reading(file).read_bytes()
        except FileNotFoundError:
            what = "check the name"
            if str(file) in shipped_devices():
                what = "that is a device, and a scenario file is needed here"
            raise ScenarioError(f"there is no file {str(file)!r}; {what}") from None
        except IsADirectoryError:
            raise ScenarioError(f"{str(file)!r} is a folder; give a file in it") from None
        except OSError as error:
            raise ScenarioError(f"{str(file)!r} cannot be read: {error.strerror}") from None

    return read


def _text(name: str, files: Files) -> str:
    try:
        return files(name).decode()
    except UnicodeDecodeError:
        raise ScenarioError(f"{name!r} is not UTF-8 text; give a TOML file") from None
