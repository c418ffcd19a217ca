"""Joint draws of a device's uncertain numbers, for training with domain randomisation.

Each draw is a complete device, exported to the format; the result lists the fields that differ
between draws, with their values. The logarithms of masses, springs, gain and limit are drawn, as in
the fit; all other numbers are drawn from a normal distribution, and only physical values are kept.
"""

import csv
import io
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from zwidth.export.model import Exported
from zwidth.sim.device import Device
from zwidth.sim.named import numbers_of_device, with_numbers
from zwidth.sim.nearest import nearest
from zwidth.sim.posterior import Posterior

Floats = NDArray[np.float64]
SCHEMA = 1
FORMATS = ("mjcf", "urdf", "sdf", "isaaclab", "newton", "bam")
SUFFIXES = (".json", ".npz", ".csv")
# "stiffness=2.0," of Python, "float newton:kp = 2.0" and "float3 x = (1.0, 2.0, 3.0)" of USD
ASSIGNED = re.compile(r"^ *(?:\w+ )?([\w:]+) ?= ?\(?([-+.\de, ]+?)\)?,?$", re.MULTILINE)
TRIES = 1000  # per draw, until the values are physical
SOLVER = ("timestep", "solreffriction")  # fields of the simulator, not of the device


class Draws(NamedTuple):
    """Devices (count), their numbers (count, p) by name, and whether they scatter together."""

    devices: Sequence[Device]
    names: Sequence[str]
    units: Sequence[str]
    values: Floats
    joint: bool


def draws_of(device: Device, count: int, seed: int) -> Draws:
    """Return devices drawn from the posterior of one or, without it, from its [uncertainty].

    Raises ValueError if the posterior names something that the device lacks, if nothing in it is
    uncertain, or if hardly any draw is physical.
    """
    told = device.posterior or _shares(device)
    bare = replace(device, posterior=None, band=None)
    known = numbers_of_device(bare)
    for name in told.names:
        if name not in known:
            raise ValueError(f"posterior.names has {name!r}; {nearest(name, list(known))}")
    own = [known[name] for name in told.names]
    value, sd = np.array([n.value for n in own]), np.array(told.sd)
    factor = np.array([n.factor for n in own])
    if np.any(factor & (value <= 0.0)):
        name = told.names[int(np.flatnonzero(factor & (value <= 0.0))[0])]
        raise ValueError(
            f"{name} is {known[name].value:g}; a posterior scales it by a factor, so it must be > 0"
        )
    size, turn = np.linalg.eigh(np.array(told.correlation))
    root = turn * np.sqrt(np.maximum(size, 0.0))
    random = np.random.default_rng(seed)
    lower, upper = np.array([n.lower for n in own]), np.array([n.upper for n in own])
    devices: list[Device] = []
    drawn: list[Floats] = []
    for _ in range(TRIES * count):
        z = root @ random.standard_normal(size.size)
        share = np.where(factor, sd / np.where(factor, value, 1.0), 0.0)
        x = np.where(factor, value * np.exp(share * z), value + sd * z)
        if np.any(x < lower) or np.any(x > upper):
            continue
        try:
            devices.append(with_numbers(bare, dict(zip(told.names, x.tolist(), strict=True))))
        except ValueError:  # values that no device may have together
            continue
        drawn.append(x)
        if len(devices) == count:
            units = [n.unit for n in own]
            return Draws(devices, told.names, units, np.array(drawn), device.posterior is not None)
    raise ValueError(
        f"only {len(devices)} of {TRIES * count} draws are possible devices, and {count} were asked"
        " for; the posterior is too wide: diagnose more recordings, or remove its widest numbers"
    )


def _shares(device: Device) -> Posterior:
    """Return the standard deviations from [uncertainty], each number independent."""
    known = device.uncertainty
    shares = {"m": known.masses, "k": known.springs, "b": known.dampers}
    numbers = numbers_of_device(device)
    sd = {
        name: (known.command_scale if name == "interface.command_gain" else shares[name[0]])
        * abs(number.value)
        for name, number in numbers.items()
        if name == "interface.command_gain" or not ("@" in name or "." in name)
    }  # fmt: skip
    sd = {name: value for name, value in sd.items() if value > 0.0}
    rows = tuple(tuple(float(i == j) for j in range(len(sd))) for i in range(len(sd)))
    return Posterior(tuple(sd), tuple(sd.values()), rows)


def independent_sentence(device: Device) -> str:
    """A sentence that draws are independent, and on their source."""
    known = device.uncertainty
    return (
        f"{device.name} has no [posterior] (a diagnosis writes one into the improved device,"
        " NAME.augmented.toml), so parameters are drawn independently of each other, with the"
        f" relative standard deviations in [uncertainty] (masses {known.masses:.0%}, springs"
        f" {known.springs:.0%}, dampers {known.dampers:.0%}, gain {known.command_scale:.0%}), and"
        " effects are not varied"
    )


def as_json(
    device: Device, draws: Draws, export: Callable[[Device], Exported], to: str, seed: int
) -> dict[str, Any]:
    """Return the JSON: numbers of the device and fields of the format, each with all its draws.

    export: converts a device to the format.
    """
    here = fields_of(export(replace(device, posterior=None, band=None)).body)
    every = [fields_of(export(one).body) for one in draws.devices]
    fields = {key: [one.get(key) for one in every] for key in here}
    known = numbers_of_device(device)
    return {
        "schema": SCHEMA, "device": device.name, "to": to, "seed": seed,
        "draws": len(draws.devices), "joint": draws.joint,
        "parameters": {
            name: {"unit": unit, "value": known[name].value, "draws": column.tolist()}
            for name, unit, column in zip(draws.names, draws.units, draws.values.T, strict=True)
        },
        "fields": {
            key: {"value": here[key], "draws": told}
            for key, told in fields.items()
            if any(value != here[key] for value in told) and not _of_solver(key)
        },
    }  # fmt: skip


def _of_solver(key: str) -> bool:
    return key.rpartition("/")[2] in SOLVER


def fields_of(body: str) -> dict[str, float | list[float]]:
    """Return the numbers of a model's text by name: "joint/m1/damping" of XML, "stiffness"."""
    if body.startswith("{"):
        told = json.loads(body)
        return {key: value for key, value in told.items() if isinstance(value, float)}
    if not body.startswith("<"):
        every = {key: [float(x) for x in text.split(",")] for key, text in ASSIGNED.findall(body)}
        return {key: row[0] if len(row) == 1 else row for key, row in every.items()}
    found: dict[str, float | list[float]] = {}

    def walk(element: Element, above: str) -> None:
        name = element.get("name")
        path = f"{element.tag}/{name}" if name else f"{above}/{element.tag}".lstrip("/")
        for key, text in [*element.attrib.items(), ("", element.text or "")]:
            try:
                numbers = [float(word) for word in text.split()]
            except ValueError:
                continue
            if numbers:
                found[f"{path}/{key}".rstrip("/")] = numbers[0] if len(numbers) == 1 else numbers
        for child in element:
            walk(child, path)

    walk(ElementTree.fromstring(body), "")
    return found


def columns_of(told: Mapping[str, Any]) -> dict[str, Floats]:
    """Return draws as arrays by name, each (draws,) or (draws, k), of parameters and of fields."""
    every = {**told["parameters"], **told["fields"]}
    return {name: np.array(one["draws"], dtype=np.float64) for name, one in every.items()}


def as_npz(told: Mapping[str, Any]) -> bytes:
    """Return draws as an NPZ file: `columns_of`, without pickles."""
    made = io.BytesIO()
    np.savez(made, allow_pickle=False, **columns_of(told))
    return made.getvalue()


def as_csv(told: Mapping[str, Any]) -> str:
    """Return draws as CSV, one per row; the k-th number of a field is called NAME[k]."""
    columns: dict[str, list[float]] = {}
    for name, values in columns_of(told).items():
        if values.ndim == 1:
            columns[name] = values.tolist()
        else:
            columns |= {f"{name}[{k}]": part.tolist() for k, part in enumerate(values.T)}
    made = io.StringIO()
    writer = csv.writer(made, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return made.getvalue()
