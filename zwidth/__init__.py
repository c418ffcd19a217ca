"""How stiff a virtual wall a haptic device can render, by theory and in the time domain.

The names below are the public ones; each is imported when it is first used, so that
``import zwidth`` and ``zwidth --help`` do not wait for numpy and numba.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from controllers.none import none as none
    from controllers.recorded import recorded as recorded
    from controllers.wall import wall as wall
    from sim.chain import Chain as Chain
    from sim.chain import make_chain as make_chain
    from sim.controller import Controller as Controller
    from sim.device import Device as Device
    from sim.device_file import load_device as load_device
    from sim.device_file import save_device as save_device
    from sim.device_file import shipped_devices as shipped_devices
    from sim.interface import Interface as Interface
    from sim.modal import ModalModel as ModalModel
    from sim.modal import Mode as Mode
    from sim.passive import nearest_passive as nearest_passive
    from sim.run import Run as Run
    from sim.run import Start as Start
    from sim.run import simulate as simulate
    from sim.trace import Trace as Trace
    from stability.boundary import Boundary as Boundary
    from stability.boundary import find_boundaries as find_boundaries
    from stability.linear import boundary as boundary
    from stability.linear import corner as corner
    from stability.linear import critical_stiffness as critical_stiffness

# name -> the module that it comes from; the same list as above, for the running program.
HOMES = {
    "Boundary": "stability.boundary",
    "Chain": "sim.chain",
    "Controller": "sim.controller",
    "Device": "sim.device",
    "Interface": "sim.interface",
    "ModalModel": "sim.modal",
    "Mode": "sim.modal",
    "Run": "sim.run",
    "Start": "sim.run",
    "Trace": "sim.trace",
    "boundary": "stability.linear",
    "corner": "stability.linear",
    "critical_stiffness": "stability.linear",
    "find_boundaries": "stability.boundary",
    "load_device": "sim.device_file",
    "make_chain": "sim.chain",
    "nearest_passive": "sim.passive",
    "none": "controllers.none",
    "recorded": "controllers.recorded",
    "save_device": "sim.device_file",
    "shipped_devices": "sim.device_file",
    "simulate": "sim.run",
    "wall": "controllers.wall",
}

__all__ = list(HOMES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name not in HOMES:
        raise AttributeError(f"module 'zwidth' has no attribute {name!r}")
    value = getattr(import_module(HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *HOMES])
