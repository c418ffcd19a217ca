"""A device as TOML text: read, checked, written back to the bit.

    schema, name, source, rotary; [modal] with [[modal.mode]], or [chain]; [interface]; [drive];
    [uncertainty]; [band] with [[band.output]]; [posterior]; [[physics]]

Keys contain their unit if it depends on the kind of device: m_kgm2, b_nms_per_rad for a rotary one,
m_kg, b_ns_per_m for a linear one. [drive] has the data sheet of motor and amplifier (`sim.drive`);
a device stores the values computed from it, and is written with these. [uncertainty] states how
well the other values are known, as shares of them. [band] and [posterior] come from a diagnosis:
the errors of the device's free runs, and the joint uncertainty of its parameters.
"""

import hashlib
import os
import tomllib
from collections.abc import Generator, Iterable, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from zwidth.files.protection import reading, writing_as
from zwidth.files.whole import write_text
from zwidth.sim.band import Band, OutputBand
from zwidth.sim.chain import Chain, make_chain
from zwidth.sim.device import Device, DeviceError, home, place_label, warnings_of
from zwidth.sim.device_keys import DEVICE_KEYS
from zwidth.sim.drive import KINDS, NEEDED, POSSIBLE, Drive
from zwidth.sim.interface import Interface
from zwidth.sim.keys import Key, commented
from zwidth.sim.modal import ModalModel, Mode, to_chain
from zwidth.sim.nearest import nearest
from zwidth.sim.physics import EFFECTS, unknown_effect
from zwidth.sim.physics.effect import Parameter, Physics
from zwidth.sim.physics.free_force import grid_of, grid_values, is_grid, state_unit
from zwidth.sim.physics.free_law import is_table, points_of, table_values
from zwidth.sim.physics.free_product import free_product
from zwidth.sim.physics.two_tables import TABLES, is_two_tables, two_tables_of, two_tables_values
from zwidth.sim.posterior import Posterior
from zwidth.sim.table import Table, TableError
from zwidth.sim.uncertainty import UNCERTAINTY_FIELDS, Uncertainty

SCHEMA = 1
OVER_SAID = "states that it depends on"
SHIPPED = Path(__file__).parent / "devices"

TOP_KEYS = (
    "schema", "name", "source", "rotary", "modal", "chain", "interface", "drive", "uncertainty",
    "band", "posterior", "physics",
)  # fmt: skip
CHAIN_KEYS = ("masses", "ground_dampers", "ground_spring", "link_springs", "link_dampers")
MODAL_KEYS = {True: ("m_kgm2", "b_nms_per_rad"), False: ("m_kg", "b_ns_per_m")}
MODE_KEYS = ("omega_rad_s", "c_rad_s", "v_rad_s", "d_rad_s")
BAND_KEYS = {
    "window_s": "window", "windows": "windows", "observer_ratio": "ratio", "corrected": "corrected",
    "simulator": "simulator",
}  # fmt: skip
POSTERIOR_KEYS = ("names", "sd", "correlation")
BAND_OUTPUT_KEYS = ("name", "error", "noise", "motion", "scatter")
INTERFACE_KEYS = {
    "period_s": "period",
    "delay_s": "delay",
    "encoder_step": "encoder_step",
    "command_step": "command_step",
    "command_limit": "command_limit",
    "velocity_cutoff_hz": "velocity_cutoff_hz",
    "encoder_rounding": "encoder_rounding",
    "command_gain": "command_gain",
    "position_origin": "position_origin",
    "command_hold": "command_hold",
    "velocity_order": "velocity_order",
    "velocity_ticks": "velocity_ticks",
    "position_ticks": "position_ticks",
    "force_sensor": "force_sensor",
    "force_gain": "force_gain",
    "velocity_estimator": "velocity_estimator",
    "velocity_window": "velocity_window",
    "velocity_band": "velocity_band",
    "velocity_noise": "velocity_noise",
    "velocity_acceleration": "velocity_acceleration",
    "velocity_step": "velocity_step",
}
NEUTRAL, USUAL = Interface(), Uncertainty()
INTERFACE_TEXTS = ("encoder_rounding", "command_hold", "force_sensor", "velocity_estimator")
# Written only if not default: a device without them has the text, and the hash, of zwidth 0.1.
WHERE_NEEDED = (
    "command_gain", "position_origin", "command_hold", "velocity_order", "velocity_ticks",
    "position_ticks", "force_sensor", "force_gain", "velocity_estimator", "velocity_window",
    "velocity_band", "velocity_noise", "velocity_acceleration", "velocity_step",
)  # fmt: skip


SIZES = {
    "masses": (1e-18, 1e12, "kg m2 | kg"),
    "ground_dampers": (0.0, 1e12, "N m s/rad | N s/m"),
    "ground_spring": (0.0, 1e15, "N m/rad | N/m"),
    "link_springs": (1e-18, 1e15, "N m/rad | N/m"),
    "link_dampers": (0.0, 1e12, "N m s/rad | N s/m"),
}
"""The range of each number of a device that can be simulated."""
PERIODS, GAINS = (1e-7, 1e3), (1e-12, 1e12)  # s; 10 MHz is faster than any force loop


def shipped_devices() -> list[str]:
    """Return the names of the devices that come with the package."""
    return sorted(file.stem for file in SHIPPED.glob("*.toml"))


def remarks_on(device: Device) -> list[str]:
    """Return the warnings that a command prints about a device, one per line (`warnings_of`).

    There are none about the mechanism of a shipped device, which `zwidth devices NAME` explains.
    """
    remarks = warnings_of(device)
    known = (load_device(name).chain for name in shipped_devices()) if remarks else ()
    return [] if any(_same(device.chain, chain) for chain in known) else remarks


def _same(one: Chain, other: Chain) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one, other, strict=True))


def load_device(name_or_path: str | os.PathLike[str]) -> Device:
    """Return a shipped device by name ("phantom_1_0"), or else the device of a TOML file.

    Raises DeviceError with one sentence: no such file, not TOML (with the line), an unknown key
    (with the nearest known one), a wrong type, a value that is not allowed, a size that cannot be
    simulated.
    """
    shipped = isinstance(name_or_path, str) and name_or_path in shipped_devices()
    path = SHIPPED / f"{name_or_path}.toml" if shipped else Path(name_or_path)
    try:
        text = reading(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        hint = nearest(path.stem, shipped_devices())
        raise DeviceError(
            f"{str(name_or_path)!r} is neither a file nor a shipped device; {hint}"
        ) from None
    except IsADirectoryError:
        raise DeviceError(f"{str(path)!r} is a folder; give a device file in it") from None
    except (OSError, UnicodeDecodeError) as error:
        raise DeviceError(f"{str(path)!r} cannot be read as text: {error}") from None
    return _sized(device_from_text(text, str(name_or_path)), str(name_or_path))


def _sized(device: Device, where: str) -> Device:
    """Return the device, if its numbers have a size that can be simulated.

    Raises DeviceError for other sizes, which are errors of a unit or an exponent: a kernel would
    overflow, or a run take years. For a modal device, that of the equivalent chain.
    """
    for field, (least, most, unit) in SIZES.items():
        for value in np.atleast_1d(getattr(device.chain, field)).tolist():
            if not least <= abs(value) <= most:
                raise DeviceError(
                    f"{where}: chain.{field} contains {value:g}; the allowed range is {least:g} to"
                    f" {most:g} [{unit}], so check the unit and the exponent"
                )
    for key, value, (least, most), unit in (
        ("period_s", device.interface.period, PERIODS, " [s]"),
        ("command_gain", device.interface.command_gain, GAINS, ""),
    ):
        if not least <= value <= most:
            raise DeviceError(
                f"{where}: interface.{key} is {value:g}; it must be from {least:g} to"
                f" {most:g}{unit}"
            )
    return device


def save_device(device: Device, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write the device file with comments; folders are created. A failure leaves no partial file.

    An existing file is replaced only if this function wrote it and it was not edited since, or with
    overwrite. Otherwise raises Protected. Raises DeviceError if it cannot be written.
    """
    try:
        with writing_as("save_device", overwrite):
            write_text(Path(path), commented_text(device))
    except OSError as error:
        raise DeviceError(f"{str(path)!r} cannot be written: {error.strerror}") from None


def model_hash(device: Device) -> str:
    """Return the SHA-256 of the device's text: equal for devices that are equal to the bit."""
    return hashlib.sha256(device_to_text(device).encode()).hexdigest()


def device_to_text(device: Device) -> str:
    """Return the device file, whose numbers read back exactly.

    It has every key of the interface, and those of the uncertainty that differ from the default.
    """
    head: dict[str, object] = {
        "schema": SCHEMA,
        "name": device.name,
        "source": device.source,
        "rotary": device.rotary,
    }
    sections = [tomli_w.dumps(head)]
    if device.modal is not None:
        body = (device.modal.inertia, device.modal.damping)
        sections.append(_section("[modal]", MODAL_KEYS[device.rotary], body))
        sections += [_section("[[modal.mode]]", MODE_KEYS, mode) for mode in device.modal.modes]
    else:
        values = (np.asarray(value).tolist() for value in device.chain)
        sections.append(_section("[chain]", CHAIN_KEYS, values))
    interface = {
        key: getattr(device.interface, field)
        for key, field in INTERFACE_KEYS.items()
        if key not in WHERE_NEEDED or getattr(device.interface, field) != getattr(NEUTRAL, field)
    }
    sections.append(_section("[interface]", interface.keys(), interface.values()))
    uncertain = {
        key: getattr(device.uncertainty, key)
        for key in UNCERTAINTY_FIELDS
        if getattr(device.uncertainty, key) != getattr(USUAL, key)
    }
    if uncertain:
        sections.append(_section("[uncertainty]", uncertain.keys(), uncertain.values()))
    if device.band is not None:
        band = device.band
        values = {key: getattr(band, field) for key, field in BAND_KEYS.items()}
        values["corrected"] = list(band.corrected)
        if not band.simulator:
            del values["simulator"]
        sections.append(_section("[band]", values, values.values()))
        for output in band.outputs:
            own = (getattr(output, key) for key in BAND_OUTPUT_KEYS)
            sections.append(_section("[[band.output]]", BAND_OUTPUT_KEYS, own))
    if device.posterior is not None:
        told = device.posterior
        rows = [list(row) for row in told.correlation]
        values = list(told.names), list(told.sd), rows
        sections.append(_section("[posterior]", POSTERIOR_KEYS, values))
    for physics in device.physics:
        entry: dict[str, object] = {"effect": physics.effect.name, "at": physics.at}
        entry |= _numbers(physics)
        sections.append(_section("[[physics]]", entry.keys(), entry.values()))
    return "\n".join(sections)


def commented_text(device: Device) -> str:
    """Return the device file with a comment after every key: its unit and meaning."""
    comments = {(key.table, key.name): key.comment(device.rotary) for key in DEVICE_KEYS}
    head, *entries = device_to_text(device).split("[[physics]]\n")
    texts = [commented(head, comments)]
    for physics, entry in zip(device.physics, entries, strict=True):
        own = {("", p.name): _meaning(p, device.rotary) for p in physics.effect.parameters}
        if is_grid(physics.effect.parameters):
            own |= _grid_comments(physics, device.rotary)
        if is_two_tables(physics.effect.parameters):
            own |= _tables_comments(physics, device.rotary)
        own[("", "effect")] = physics.effect.summary
        texts.append(commented(entry, own))
    return "[[physics]]\n".join(texts)


def _grid_comments(physics: Physics, rotary: bool) -> dict[tuple[str, str], str]:
    """The meaning of the keys of a force over one or two states."""
    grid, force = grid_of(physics.values), "N m" if rotary else "N"
    axes = zip(("rows", "columns"), grid.over, strict=False)
    found = {("", key): f"[{state_unit(over, rotary)}] {over} of each" for key, over in axes}
    said = f"[{force}] force at each row" + (" and column" if len(grid.over) > 1 else "")
    return found | {("", "over"): OVER_SAID, ("", "table"): said}


def _tables_comments(physics: Physics, rotary: bool) -> dict[tuple[str, str], str]:
    """The meaning of the keys of a law of two tables, by its states."""
    over = two_tables_of(physics.values).over
    shift = f"[{state_unit(over[0], rotary)}] what is added to the {over[0]}"
    does = "what it is taken times" if physics.effect is free_product else shift
    made = (f"[{'N m' if rotary else 'N'}] force", does)
    return {("", "over"): OVER_SAID} | {
        ("", key): f"rows of [{state_unit(state, rotary)}] {state}, {makes}"
        for key, state, makes in zip(TABLES, over, made, strict=True)
    }


def template_text(masses: int) -> str:
    """Return a device file with this many masses to start from: all keys explained, most disabled.

    Raises ValueError for a number of masses that no chain has.
    """
    chain = make_chain([1e-3] * masses, [1e-3] * masses, 0.0, [10.0] * (masses - 1),
                       [1e-2] * (masses - 1))  # fmt: skip
    written = commented_text(Device("my device", "data sheets", True, chain)).split("\n")
    own = {(key.table, key.name) for key in DEVICE_KEYS}
    table, known = "", set[tuple[str, str]]()
    for line in written:
        table = line.strip("[]") if line.startswith("[") else table
        known.add((table, line.split(" = ")[0]))
    lines = ["\n".join(written).rstrip("\n")]
    lines += [_off(key) for key in DEVICE_KEYS if key.table == "interface" and (key.table, key.name)
              in own - known]  # fmt: skip
    for header in ("drive", "uncertainty"):
        lines += ["", f"# [{header}]"] + [_off(key) for key in DEVICE_KEYS if key.table == header]
    lines += ["", "# [[physics]]  # 'zwidth effects' lists them, with their parameters"]
    lines += ['# effect = "coulomb_friction"', '# at = "m1"', "# level = 0.01  # [N m]"]
    return "\n".join(lines) + "\n"


def _off(key: Key) -> str:
    value = key.default if key.default and key.default != "motor_constant" else key.example or "..."
    return f"# {key.name} = {value}  # {key.comment(True)}"


def _meaning(parameter: Parameter, rotary: bool) -> str:
    unit = parameter.unit_for(rotary)
    return f"[{unit}] {parameter.meaning}" if unit else parameter.meaning


def device_from_text(text: str, where: str = "device") -> Device:
    """Return the device of a device file's text; `where` begins every error message.

    Raises DeviceError with one sentence, see `load_device`.
    """
    try:
        values = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise DeviceError(f"{where}: this is not TOML: {error}") from None
    try:
        if other := other_kind(values, "device"):
            raise TableError(other)
        return _device(Table(values).only(TOP_KEYS))
    except ValueError as error:
        raise DeviceError(f"{where}: {error}") from None


KINDS_OF_FILES = {
    "device": (("chain", "modal"), "a device file, which 'zwidth devices' describes"),
    "scenario": (("controller", "duration_s"), "a scenario, which 'zwidth simulate' runs"),
    "recording": (
        ("input", "output"),
        "a recording's description, which 'zwidth diagnose' reads",
    ),
}


def other_kind(values: Mapping[str, object], wanted: str) -> str:
    """Return what a TOML file is, judged by its keys, and what to do if it is the wrong kind."""
    if any(key in values for key in KINDS_OF_FILES[wanted][0]):
        return ""
    found = (said for keys, said in KINDS_OF_FILES.values() if any(k in values for k in keys))
    said = next(found, "")
    article = "a recording's description" if wanted == "recording" else f"a {wanted} file"
    return f"this is {said}, and {article} is needed here" if said else ""


def _device(top: Table) -> Device:
    if "schema" in top and top.number("schema") != SCHEMA:
        raise TableError(f"schema is {top.number('schema'):g}; this version reads {SCHEMA}")
    if ("modal" in top) == ("chain" in top):
        given = "both [modal] and [chain] are" if "modal" in top else "there is no mechanism"
        raise TableError(f"{given} in the file; give either [modal] or [chain]")
    rotary = top.boolean("rotary")
    modal = _modal(top.table("modal"), rotary) if "modal" in top else None
    entries = [read_physics(table) for table in top.tables("physics")]
    labels = [place_label(physics) for physics in entries]
    for i, label in enumerate(labels):
        if label in labels[:i]:
            raise TableError(f"physics[{i}] repeats {label}; give each effect once per place")
    device = Device(
        top.text("name"),
        top.text("source", ""),
        rotary,
        _chain(top.table("chain")) if modal is None else to_chain(modal),
        _interface(top.table("interface")),
        tuple(physics for physics in entries if home(physics) is None),
        modal,
        _uncertainty(top.table("uncertainty")),
        _band(top.table("band")) if "band" in top else None,
        _posterior(top.table("posterior")) if "posterior" in top else None,
    ).with_physics(*(physics for physics in entries if home(physics) is not None))
    return _drive(top.table("drive")).on(device) if "drive" in top else device


def _modal(table: Table, rotary: bool) -> ModalModel:
    inertia, damping = MODAL_KEYS[rotary]
    table.only((inertia, damping, "mode"))
    modes = [mode.only(MODE_KEYS) for mode in table.tables("mode")]
    keys = {
        "inertia": inertia,
        "damping": damping,
        **dict(zip(Mode._fields, MODE_KEYS, strict=True)),
    }
    with _as_in_the_file(keys):
        return ModalModel(
            table.number(inertia),
            table.number(damping),
            tuple(Mode(*(mode.number(key) for key in MODE_KEYS)) for mode in modes),
        )


def _chain(table: Table) -> Chain:
    table.only(CHAIN_KEYS)
    with _as_in_the_file({}, "chain."):
        return make_chain(
            table.numbers("masses"),
            table.numbers("ground_dampers"),
            table.number("ground_spring", 0.0),
            table.numbers("link_springs", []),
            table.numbers("link_dampers", []),
        )


def _interface(table: Table) -> Interface:
    table.only(INTERFACE_KEYS)
    values: dict[str, object] = {
        field: table.text(key) if key in INTERFACE_TEXTS else table.number(key)
        for key, field in INTERFACE_KEYS.items()
        if key in table
    }
    for field, value in values.items():
        if type(getattr(NEUTRAL, field)) is int and isinstance(value, float) and value % 1.0 == 0.0:
            values[field] = int(value)
    with _as_in_the_file({field: key for key, field in INTERFACE_KEYS.items()}):
        return Interface(**values)  # pyright: ignore[reportArgumentType]


def _drive(table: Table) -> Drive:
    kind = table.text("kind")
    if kind not in KINDS:
        raise TableError(f"drive.kind is {kind!r}; {nearest(kind, KINDS)}")
    keys = (*NEEDED[kind], *POSSIBLE[kind])
    table.only(("kind", *keys))
    read = {key: key for key in keys if key in table or key in NEEDED[kind]}
    given: dict[str, Any] = {
        key: table.text(key) if key == "when_off" else table.number(key) for key in read
    }
    return Drive(kind, **given)


def _uncertainty(table: Table) -> Uncertainty:
    table.only(UNCERTAINTY_FIELDS)
    given = {key: table.number(key) for key in UNCERTAINTY_FIELDS if key in table}
    return Uncertainty(**given)


def _band(table: Table) -> Band:
    table.only((*BAND_KEYS, "output"))
    outputs = tuple(
        OutputBand(own.text("name"), *(own.number(key) for key in BAND_OUTPUT_KEYS[1:]))
        for own in (each.only(BAND_OUTPUT_KEYS) for each in table.tables("output"))
    )
    windows = table.number("windows")
    return Band(
        table.number("window_s"), int(windows) if windows % 1.0 == 0.0 else windows,  # pyright: ignore[reportArgumentType]
        table.number("observer_ratio"), outputs,
        tuple(table.texts("corrected")) if "corrected" in table else (),
        table.text("simulator") if "simulator" in table else "",
    )  # fmt: skip


def _posterior(table: Table) -> Posterior:
    table.only(POSTERIOR_KEYS)
    names = tuple(table.texts("names"))
    rows = table.rows("correlation", len(names))
    return Posterior(names, tuple(table.numbers("sd")), tuple(map(tuple, rows)))


def read_physics(table: Table) -> Physics:
    """Return the effect that a [[physics]] table of a device file describes; raises TableError."""
    name = table.text("effect")
    if name not in EFFECTS:
        raise TableError(f"{table.path}.effect is {name!r}; {unknown_effect(name)}")
    parameters = [parameter.name for parameter in EFFECTS[name].parameters]
    if is_table(EFFECTS[name].parameters):
        return _free_law(table)
    if is_grid(EFFECTS[name].parameters):
        return _free_force(table)
    if is_two_tables(EFFECTS[name].parameters):
        return _two_tables(table)
    table.only(("effect", "at", *parameters))
    with _as_in_the_file({}, f"{table.path}: "):
        values = {key: table.number(key) for key in parameters}
        return Physics(EFFECTS[name], table.text("at"), values)


def _free_law(table: Table) -> Physics:
    """A law that is given as a table of points."""
    table.only(("effect", "at", "odd", "period", "table"))
    odd = table.boolean("odd") if "odd" in table else False
    period = table.number("period") if "period" in table else 0.0
    rows = table.rows("table", 2)
    with _as_in_the_file({}, f"{table.path}: "):
        values = table_values([(s, f) for s, f in rows], odd, period)
        return Physics(EFFECTS[table.text("effect")], table.text("at"), values)


def _free_force(table: Table) -> Physics:
    """A force over one or two states, given as a table of rows and columns."""
    table.only(("effect", "at", "over", "rows", "columns", "table"))
    over, rows = table.texts("over"), table.numbers("rows")
    columns = table.numbers("columns") if "columns" in table or len(over) == 2 else []
    forces = _forces(table, len(columns) if len(over) > 1 else 1)
    with _as_in_the_file({}, f"{table.path}: "):
        values = grid_values(over, rows, columns, forces)
        return Physics(EFFECTS[table.text("effect")], table.text("at"), values)


def _two_tables(table: Table) -> Physics:
    """A law of two tables, one over either of two states."""
    table.only(("effect", "at", "over", *TABLES))
    over, (first, second) = table.texts("over"), (table.rows(key, 2) for key in TABLES)
    with _as_in_the_file({}, f"{table.path}: "):
        values = two_tables_values(over, first, second)
        return Physics(EFFECTS[table.text("effect")], table.text("at"), values)


def _forces(table: Table, width: int) -> list[list[float]]:
    """The rows of a table; of a force over one state its numbers alone are rows as well."""
    given = table.values.get("table")
    plain = width == 1 and isinstance(given, list) and not any(isinstance(g, list) for g in given)  # pyright: ignore[reportUnknownVariableType]
    if plain:
        return [[force] for force in table.numbers("table")]
    return table.rows("table", width)


def _numbers(physics: Physics) -> dict[str, object]:
    """The values of an effect as a file has them: a law of no formula as its table."""
    if is_grid(physics.effect.parameters):
        return _grid(physics.values)
    if is_two_tables(physics.effect.parameters):
        over, *tables = two_tables_of(physics.values)
        rows_of = ([list(point) for point in table] for table in tables)
        return {"over": list(over), **dict(zip(TABLES, rows_of, strict=True))}
    if not is_table(physics.effect.parameters):
        return dict(physics.values)
    rows = [list(point) for point in points_of(physics.values)]
    repeats = {"period": physics.values["period"]} if physics.values["period"] > 0.0 else {}
    return {"odd": physics.values["odd"] > 0.5, **repeats, "table": rows}


def _grid(values: Mapping[str, float]) -> dict[str, object]:
    """A force over one or two states as a file has it."""
    grid = grid_of(values)
    axes: dict[str, object] = {"over": list(grid.over), "rows": list(grid.rows)}
    if len(grid.over) == 1:
        return axes | {"table": [force for (force,) in grid.table]}
    return axes | {"columns": list(grid.columns), "table": [list(row) for row in grid.table]}


@contextmanager
def _as_in_the_file(keys: Mapping[str, str], before: str = "") -> Generator[None, None, None]:
    """Let error messages about values name the keys of the file, and their place."""
    try:
        yield
    except TableError:
        raise
    except ValueError as error:
        sentence = str(error)
        for field, key in keys.items():
            sentence = sentence.replace(f".{field} is", f".{key} is")
        raise TableError(before + sentence) from None


def _section(header: str, keys: Iterable[str], values: Iterable[Any]) -> str:
    exact = (value if isinstance(value, str | list | bool) else float(value) for value in values)
    return f"{header}\n{tomli_w.dumps(dict(zip(keys, exact, strict=True)))}"
