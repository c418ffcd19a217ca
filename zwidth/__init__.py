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
    from logs.mcap_reader import Log as Log
    from logs.mcap_writer import write_log as write_log
    from logs.recording import load_log as load_log
    from logs.recording import read_recording as read_recording
    from scenarios.logged_run import LoggedRun as LoggedRun
    from scenarios.logged_run import logged_run as logged_run
    from scenarios.replay import ReplayResult as ReplayResult
    from scenarios.replay import replay as replay
    from scenarios.scenario import Scenario as Scenario
    from scenarios.scenario_file import load_scenario as load_scenario
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
    from stability.bisection import Trial as Trial
    from stability.boundary import Boundary as Boundary
    from stability.boundary import find_boundaries as find_boundaries
    from stability.executor import Executor as Executor
    from stability.executor import executor as executor
    from stability.fate_map import FateMap as FateMap
    from stability.fate_map import make_map as make_map
    from stability.fate_map import save_map as save_map
    from stability.fates import Fate as Fate
    from stability.fates import Fates as Fates
    from stability.linear import boundary as boundary
    from stability.linear import corner as corner
    from stability.linear import critical_stiffness as critical_stiffness
    from stability.plane import Axis as Axis
    from stability.plane import Plane as Plane

# name -> the module that it comes from; the same list as above, for the running program.
HOMES = {
    "Axis": "stability.plane",
    "Boundary": "stability.boundary",
    "Chain": "sim.chain",
    "Controller": "sim.controller",
    "Device": "sim.device",
    "Executor": "stability.executor",
    "Fate": "stability.fates",
    "FateMap": "stability.fate_map",
    "Fates": "stability.fates",
    "Interface": "sim.interface",
    "Log": "logs.mcap_reader",
    "LoggedRun": "scenarios.logged_run",
    "ModalModel": "sim.modal",
    "Mode": "sim.modal",
    "Plane": "stability.plane",
    "ReplayResult": "scenarios.replay",
    "Run": "sim.run",
    "Scenario": "scenarios.scenario",
    "Start": "sim.run",
    "Trace": "sim.trace",
    "Trial": "stability.bisection",
    "boundary": "stability.linear",
    "corner": "stability.linear",
    "critical_stiffness": "stability.linear",
    "executor": "stability.executor",
    "find_boundaries": "stability.boundary",
    "load_device": "sim.device_file",
    "load_log": "logs.recording",
    "load_scenario": "scenarios.scenario_file",
    "logged_run": "scenarios.logged_run",
    "make_chain": "sim.chain",
    "make_map": "stability.fate_map",
    "nearest_passive": "sim.passive",
    "none": "controllers.none",
    "read_recording": "logs.recording",
    "recorded": "controllers.recorded",
    "replay": "scenarios.replay",
    "save_device": "sim.device_file",
    "save_map": "stability.fate_map",
    "shipped_devices": "sim.device_file",
    "simulate": "sim.run",
    "wall": "controllers.wall",
    "write_log": "logs.mcap_writer",
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
