"""Controllers by name: a `[controller]` table to a controller and back.

A new kind is one line in KINDS. The factory's signature determines the keys of the table and their
types; the controller's `facts` contain the values, and its `parameters` are the array, if any.
"""

import inspect
from collections.abc import Callable, Mapping
from io import BytesIO, StringIO
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from zwidth.controllers.guarded import guarded
from zwidth.controllers.none import none
from zwidth.controllers.recorded import recorded
from zwidth.controllers.region import region
from zwidth.controllers.relay import relay
from zwidth.controllers.texture import texture
from zwidth.controllers.wall import wall
from zwidth.sim.controller import Controller, Step, user_controller
from zwidth.sim.nearest import nearest
from zwidth.sim.table import Table, TableError

Floats = NDArray[np.float64]
Files = Callable[[str], bytes]  # the content of a file that a scenario names

KINDS: Mapping[str, Callable[..., Controller]] = MappingProxyType(
    {
        "wall": wall,
        "none": none,
        "recorded": recorded,
        "relay": relay,
        "texture": texture,
        "region": region,
        "guarded": guarded,
    }
)
SCALARS = (float, int, bool, str)
USER = "user"
USER_KEYS = ("kind", "function", "parameters", "memory")


def read_controller(table: Table, files: Files, step: Step | None = None) -> Controller:
    """Return the controller of a table. step: the user's own function, for kind = "user".

    Code is never loaded because a file names it: the caller supplies the function.

    Raises ValueError with one sentence: an unknown kind or key (with the nearest known one), a
    value that is missing or not allowed, a function that is missing or not wanted.
    """
    kind = table.text("kind")
    if kind == USER:
        return _read_user(table, step)
    if kind not in KINDS:
        raise TableError(f"{table.path}.kind is {kind!r}; {nearest(kind, [*KINDS, USER])}")
    if step is not None:
        raise TableError(
            f"{table.path}.kind is {kind!r}, which is built in; leave your function out"
        )
    factory = KINDS[kind]
    arguments = inspect.signature(factory, eval_str=True).parameters
    table.only(("kind", *arguments))
    return factory(
        **{
            name: _value(table, name, argument.annotation, files)
            for name, argument in arguments.items()
            if name in table or argument.default is inspect.Parameter.empty
        }
    )


def controller_entry(controller: Controller, array: str | None = None) -> dict[str, object]:
    """Return the `[controller]` table of a controller; array: a file to name in place of numbers.

    Raises ValueError for a kind that no scenario can name.
    """
    if controller.kind == USER:
        return {
            "kind": USER,
            "function": controller.facts["function"],
            "parameters": controller.parameters.tolist(),
            "memory": controller.memory,
        }
    if controller.kind not in KINDS:
        raise ValueError(
            f"controller.kind is {controller.kind!r}; in a scenario it must be one of"
            f" {', '.join([*KINDS, USER])}"
        )
    numbers = controller.parameters.tolist() if array is None else array
    arguments = inspect.signature(KINDS[controller.kind]).parameters
    return {"kind": controller.kind} | {n: controller.facts.get(n, numbers) for n in arguments}


def takes_array(kind: str) -> bool:
    """Whether a kind is given by an array, which is then all of its parameters."""
    if kind not in KINDS:
        return False
    arguments = inspect.signature(KINDS[kind], eval_str=True).parameters
    return any(a.annotation not in SCALARS for a in arguments.values())


def _read_user(table: Table, step: Step | None) -> Controller:
    table.only(USER_KEYS)
    function = table.text("function")
    if step is None:
        raise TableError(
            f"{table.path}.kind is 'user', a function of your own; supply it with --controller"
            f" {function}"
        )
    return user_controller(
        step, np.array(table.numbers("parameters", [])), whole(table, "memory", 1)
    )


def whole(table: Table, key: str, default: int) -> int:
    """Return a whole number; raises TableError for any other."""
    value = table.number(key, float(default))
    if not value.is_integer():
        place = f"{table.path}.{key}" if table.path else key
        raise TableError(f"{place} is {value:g}; it must be a whole number")
    return int(value)


def _value(table: Table, key: str, kind: object, files: Files) -> object:
    if kind is float:
        return table.number(key)
    if kind is bool:
        return table.boolean(key)
    if kind is int:
        return whole(table, key, 0)
    if kind is str:
        return table.text(key)
    return _array(table, key, files)


def _array(table: Table, key: str, files: Files) -> Floats:
    """Numbers in place, or a text that names a file of them: .npy, else one number per line."""
    try:
        name = table.text(key)
    except TableError:
        return np.array(table.numbers(key))
    data = files(name)
    try:
        if name.endswith(".npy"):
            return np.asarray(np.load(BytesIO(data), allow_pickle=False), dtype=np.float64)
        return np.loadtxt(StringIO(data.decode()), dtype=np.float64, ndmin=1)
    except (ValueError, EOFError) as error:
        raise TableError(
            f"{table.path}.{key} is {name!r}, which is neither .npy nor text with one number per"
            f" line: {error}"
        ) from None
