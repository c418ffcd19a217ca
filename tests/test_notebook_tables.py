"""Every type of what the public functions take and return shows as a table in a notebook."""

import ast
import enum
import inspect
import typing
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zwidth
from tests.test_python_api import Tags
from zwidth.diagnosis.fitting.fit import Fitted
from zwidth.diagnosis.model.parameters import Model
from zwidth.diagnosis.selection.hypothesis import Hypothesis
from zwidth.diagnosis.selection.searched import Searched
from zwidth.identification.cycles import Cycle
from zwidth.identification.relay import RelayResult
from zwidth.planning.plan import Confusable, Visible
from zwidth.shown import Shown
from zwidth.sim.band import Band, OutputBand
from zwidth.sim.estimators.estimator import Estimator, Settings
from zwidth.sim.kernel import Memory
from zwidth.sim.posterior import Posterior

# What a search and a run keep to be continued: numbers of the engine, not of an answer.
INSIDE = (Searched, Hypothesis, Fitted, Model, Estimator, Settings, Memory)
HOSTILE = "<b>&"
HOSTILES = [HOSTILE] * 20  # more than a named tuple has fields


def public() -> set[type]:
    """The types of zwidth in the hints of public functions, and in the fields of these types."""
    found: set[type] = set()
    for name in zwidth.HOMES:
        value = getattr(zwidth, name)
        if inspect.isclass(value):
            _walk(value, found)
        else:
            for hint in _hints(value).values():
                _walk(hint, found)
    return found


def _walk(hint: Any, found: set[type]) -> None:
    if typing.get_origin(hint) is Callable:
        return
    for part in (typing.get_origin(hint), *typing.get_args(hint)):
        for one in part if isinstance(part, list) else [part]:
            if one is not None:
                _walk(one, found)
    if not inspect.isclass(hint) or not hint.__module__.startswith("zwidth") or hint in found:
        return
    plain = issubclass(hint, enum.Enum | BaseException) or getattr(hint, "_is_protocol", False)
    if plain or hint in INSIDE:
        return
    found.add(hint)
    for name, own in _hints(hint).items():
        if not name.startswith("_"):
            _walk(own, found)
    for name, member in inspect.getmembers(hint):
        if not name.startswith("_") and isinstance(member, property | cached_property):
            get = member.fget if isinstance(member, property) else member.func
            _walk(_hints(get).get("return"), found)


def _hints(value: Any) -> dict[str, Any]:
    names: dict[str, Any] = {}
    for one in reversed(value.__mro__) if inspect.isclass(value) else [value]:
        if one.__module__.startswith("zwidth"):
            names |= _only_checked(one.__module__)
    return typing.get_type_hints(value, localns=names)


@cache
def _only_checked(module: str) -> dict[str, Any]:
    """What a module imports only for the type checker."""
    file = inspect.getsourcefile(__import__(module, fromlist=["_"]))
    assert file is not None
    tree = ast.parse(Path(file).read_text(encoding="utf-8"))
    names: dict[str, Any] = {}
    for node in tree.body:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            exec(compile(ast.Module(node.body, []), module, "exec"), names)
    return names


PUBLIC = sorted(public(), key=lambda value: f"{value.__module__}.{value.__name__}")


def test_the_walk_reaches_what_results_are_made_of():
    """Mutation: hints of fields or of properties left out of the walk."""
    names = {value.__name__ for value in PUBLIC}
    assert names >= {
        "Adequacy", "Band", "Changed", "Cycle", "Fit", "Member", "NextLevel", "Posterior",
        "RelayResult", "Spread", "Structure", "Visible", "WholeRun",
    }  # fmt: skip


@pytest.mark.parametrize("value", PUBLIC, ids=lambda value: value.__name__)
def test_every_public_type_has_a_table(value: type):
    """Mutation: `Valued` or `fields_html` left out of any of them."""
    assert callable(getattr(value, "_repr_html_", None))


VALUES = [v for v in PUBLIC if not issubclass(v, Shown) and not inspect.isabstract(v)]


@pytest.mark.parametrize("value", VALUES, ids=lambda value: value.__name__)
def test_what_a_field_holds_is_escaped(value: type):
    """Mutation: a cell that goes into the page as it is."""
    kind: Any = value
    made = tuple.__new__(kind, HOSTILES) if issubclass(value, tuple) else object.__new__(kind)
    for one in fields(value) if is_dataclass(value) else ():
        object.__setattr__(made, one.name, HOSTILE)
    text = made._repr_html_()
    assert f"<p><b>{type(made).__name__}</b></p>" in text
    assert "<td" in text
    assert HOSTILE not in text
    assert "&lt;b&gt;&amp;" in text


def examples() -> Iterator[Any]:
    device = zwidth.load_device("ethz_haptic_paddle")
    yield from (device.chain, device.interface, device.uncertainty)
    yield zwidth.make_physics("coulomb_friction", "m1", level=0.02)
    yield zwidth.make_physics("coulomb_friction", "m1", level=0.02).effect
    mode = zwidth.Mode(300.0, 1.0, 200.0, 1.0)
    yield from (mode, zwidth.ModalModel(1e-3, 1e-3, (mode,)))
    axis = zwidth.Axis("K", 1.0, 2.0)
    yield from (axis, zwidth.Plane(device, zwidth.Axis("B", 0.0, 0.1), axis))
    yield from (zwidth.Trial(), zwidth.Search(), zwidth.Law(), zwidth.Perception())
    yield from (zwidth.Start([1e-3, 0.0]), zwidth.RelayTest(), zwidth.Disturbance("constant", 1.0))
    yield from (zwidth.wall(1.0, 0.01), zwidth.none(), zwidth.recorded(np.arange(9.0)))
    yield zwidth.Annotation(0.0, 1.0, "info", "mark_1", "a hand", {"effect": "touch"})
    cycle, reference = Cycle(1.0, 9.0, 1e-3, 0.5), RelayResult("oscillates", 1.0, 9.0, 1e-3, 0.0)
    yield from (cycle, reference)
    yield zwidth.RelayCondition(0.001, 0.01, reference, (cycle,), 0.5, 0.0)
    yield Visible("backlash@link12", None, None, "gap", "rad", 0.1)
    yield Confusable("backlash@link12", "cubic_stiffness@link12", 2.0)
    output = OutputBand("position_m1", 1e-3, 1e-5, 0.1, 0.2)
    yield from (output, Band(0.2, 9, 1.0, (output,)))
    yield Posterior(("masses",), (0.1,), ((1.0,),))


@pytest.mark.parametrize("value", [*examples()], ids=lambda value: type(value).__name__)
def test_a_value_is_a_table_in_words(value: Any):
    """Mutations: arrays or functions as Python prints them; an effect with all its sources."""
    text = value._repr_html_()
    tags = Tags()
    tags.feed(text)
    tags.close()
    assert tags.open == []
    for python in ("array(", " object at 0x", "function", "mappingproxy", "Physics(", "@link"):
        assert python not in text


def test_physics_is_named_as_people_write_it():
    """Mutation: an effect whole, with its law's functions, in the cell of a device's part."""
    rub = zwidth.make_physics("coulomb_friction", "m1", level=0.02)
    html = Visible("coulomb_friction@m1", rub, 0.02, "level", "N m", 0.1)._repr_html_()
    assert "Coulomb friction at m1 (level: 0.02)" in html
