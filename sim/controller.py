"""A control law as one compiled function, the same type for ours and for a user's.

    command = step(k, t, y, v, p, m)

k tick, t time [s], y measured position, v estimated velocity, p parameters, m memory (both arrays;
the law may write m, which starts at zero). m[0] is logged as ``contact``. The function reaches the
kernel as a first-class value of one fixed signature, so the kernel is compiled once for all laws.
"""

import hashlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

from zwidth.shown import Valued
from zwidth.sim.jit import OPTIONS

Floats = NDArray[np.float64]
Step = Callable[[int, float, float, float, Floats, Floats], float]

_ARRAY = types.Array(types.float64, 1, "C")
SIGNATURE = types.float64(types.int64, types.float64, types.float64, types.float64, _ARRAY, _ARRAY)


def compile_step(step: Step) -> Any:
    """Compile a control law; raises ValueError with numba's reason if it cannot be compiled."""
    if numba.config.DISABLE_JIT:  # pyright: ignore[reportAttributeAccessIssue]
        return step
    source = getattr(step, "py_func", step)
    try:
        try:
            return numba.cfunc(SIGNATURE, error_model=OPTIONS["error_model"], cache=True)(source)
        except RuntimeError:  # numba cannot cache a function without a file (a shell, exec)
            return numba.cfunc(SIGNATURE, error_model=OPTIONS["error_model"])(source)
    except Exception as error:  # numba's errors have no common type
        raise ValueError(
            f"controller {getattr(source, '__name__', source)!r} does not compile as"
            f" float64 step(k, t, y, v, p, m): {_reason(error)}"
        ) from error


def _reason(error: Exception) -> str:
    """Return the line of numba's report that gives the reason."""
    lines = (line.strip() for line in str(error).splitlines())
    said = (line for line in lines if line and not line.startswith("Failed in"))
    return next(said, type(error).__name__).removesuffix(", defined at None")


@dataclass(frozen=True)
class Controller(Valued):
    """A named law with its parameters.

    kind: the name of the law in scenarios ("wall", "recorded", "none", or a user's). step: compiled
    with `compile_step`. parameters: the values that `step` reads. memory: how many values it keeps
    from tick to tick (at least 1). facts: the parameters in words, for the log.
    """

    kind: str
    step: Any
    parameters: Floats
    memory: int = 1
    facts: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        if self.memory < 1:
            raise ValueError(f"controller.memory is {self.memory}; it must be at least 1")
        if not np.all(np.isfinite(self.parameters)):
            raise ValueError(
                f"controller {self.kind!r} has a parameter that is not finite; give finite numbers"
                " only"
            )


def user_controller(step: Step, parameters: Floats | None = None, memory: int = 1) -> Controller:
    """Make a controller of a user's own function; its name and source hash go into the log.

    parameters (any,): passed to the law as p. memory: number of values of m. Raises ValueError if
    the law is no function or does not compile, or if the parameters are not one row.
    """
    source = getattr(step, "py_func", step)
    if not inspect.isfunction(source):
        raise ValueError(f"controller is {step!r}; it must be a function step(k, t, y, v, p, m)")
    values = np.zeros(0) if parameters is None else np.ascontiguousarray(parameters, np.float64)
    if values.ndim != 1:
        raise ValueError(
            f"controller.parameters has shape {values.shape}; it must be one row of numbers"
        )
    try:
        text = inspect.getsource(source)
    except OSError:  # a function without a file
        text = f"{source.__code__.co_code!r} {source.__code__.co_consts!r}"
    facts = {
        "function": f"{source.__module__}:{source.__qualname__}",
        "source_sha256": hashlib.sha256(text.encode()).hexdigest(),
    }
    return Controller("user", compile_step(step), values, memory, MappingProxyType(facts))
