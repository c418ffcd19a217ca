"""The numbers computed before a run begins, stored exactly for its replay.

Matrix exponentials, eigenvalues, library functions and random streams differ in their last bits, or
altogether, between processors and library versions; the tick itself does not. So these numbers go
into the log, and a replay uses them in place of its own. The numbers of the device must agree with
the device in the log; a drawn or sampled signal (disturbance, controller) may differ, which is
reported.
"""

from dataclasses import replace
from io import BytesIO
from typing import Any, TypeVar
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from zwidth.scenarios.controller_kinds import takes_array
from zwidth.sim.equations import EffectTable
from zwidth.sim.run import Setup

Floats = NDArray[np.float64]
Numbers = TypeVar("Numbers", bound=tuple[Any, ...])

START = ("x", "scalars", "internal")  # parts of the memory that are not zero at t = 0
SIGNALS = {"external": "disturbance", "parameters": "controller's signal"}
# Relative to the largest entry of an array. Processors differ by about 1e-13, more if modes are
# close; another device differs by more in at least one array.
AGREE = 1e-8
READ_BEFORE = (4, 7)  # numbers of scalars up to version 0.2, and before forces over time


class NotTheSame(ValueError):
    """The numbers stored in a log disagree with its device; the message is one sentence."""


def computed_bytes(setup: Setup) -> bytes:
    """Return every real number that a run starts from as an .npz file."""
    file = BytesIO()
    np.savez_compressed(file, **_numbers(setup))  # pyright: ignore[reportArgumentType]
    return file.getvalue()


def with_computed(setup: Setup, data: bytes) -> tuple[Setup, list[str]]:
    """Return the setup with the numbers stored by `computed_bytes`, and notes on differences.

    Raises NotTheSame if they disagree with the setup's device and start.
    """
    kept, own, notes = _read(data), _numbers(setup), list[str]()
    _fill(kept, own)
    for name, array in own.items():
        _check_shape(name, array, kept.get(name))
        if _agree(array, kept[name]):
            continue
        if name not in SIGNALS:
            raise NotTheSame(
                f"{name} in the log differs from what its device and start give; the log was"
                " changed, or"
                " written by a version of zwidth that computes it differently"
            )
        notes.append(
            f"the {SIGNALS[name]} in the log is not what its scenario gives here; the logged one"
            " was replayed"
        )
    law = replace(setup.controller, parameters=kept.get("parameters", setup.controller.parameters))
    changed = replace(
        setup,
        controller=law,
        eq=_replaced(setup.eq, kept),
        memory=_replaced(setup.memory, {name: kept[f"start_{name}"] for name in START}),
        external=kept["external"],
    )
    return changed, notes


def array_bytes(values: Floats) -> bytes:
    """Return an array as an .npy file."""
    file = BytesIO()
    np.save(file, values, allow_pickle=False)
    return file.getvalue()


def _numbers(setup: Setup) -> dict[str, Floats]:
    found: dict[str, Floats] = {}
    for field, value in setup.eq._asdict().items():
        if isinstance(value, EffectTable):
            found[field] = value.parameters
        elif isinstance(value, float | np.ndarray) and np.asarray(value).dtype.kind == "f":
            found[field] = np.asarray(value)
    found |= {f"start_{name}": getattr(setup.memory, name) for name in START}
    found["external"] = setup.external
    if not takes_array(setup.controller.kind):
        found["parameters"] = setup.controller.parameters
    return found


def _replaced(numbers: Numbers, kept: dict[str, Floats]) -> Numbers:
    """Return a NamedTuple of the kernel with the kept numbers in it."""
    fields: dict[str, Any] = numbers._asdict()  # pyright: ignore[reportAttributeAccessIssue]
    for field, own in fields.items():
        if field in kept:
            match own:
                case EffectTable():
                    fields[field] = own._replace(parameters=kept[field])
                case float():
                    fields[field] = float(kept[field])
                case _:
                    fields[field] = kept[field].copy()
    return type(numbers)(**fields)


def _read(data: bytes) -> dict[str, Floats]:
    try:
        with np.load(BytesIO(data), allow_pickle=False) as file:
            return {name: np.asarray(file[name], order="C") for name in file.files}
    except (ValueError, TypeError, AttributeError, OSError, EOFError, BadZipFile) as error:
        raise NotTheSame(f"the computed numbers in the log cannot be read: {error}") from None


def _fill(kept: dict[str, Floats], own: dict[str, Floats]) -> None:
    """Add what logs of earlier versions lack: numbers that a run with one rate does not read."""
    for name in ("filter", "force_row", "force_gain"):
        kept.setdefault(name, own[name])
    scalars = kept.get("start_scalars")
    if scalars is not None and scalars.ndim == 1 and scalars.size in READ_BEFORE:
        kept["start_scalars"] = np.append(scalars, own["start_scalars"][scalars.size :])


def _check_shape(name: str, own: Floats, kept: Floats | None) -> None:
    if kept is None or kept.shape != own.shape or kept.dtype != own.dtype:
        raise NotTheSame(f"the log has no {name} of the shape that its device and scenario need")


def _agree(own: Floats, kept: Floats) -> bool:
    scale = float(np.abs(own[np.isfinite(own)]).max(initial=0.0))
    return bool(np.allclose(kept, own, rtol=0.0, atol=AGREE * scale))
