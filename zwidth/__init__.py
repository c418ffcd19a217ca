"""How stiff a virtual wall a haptic device can render, by theory and in the time domain.

The names below are the public ones; each is imported when it is first used, so that
``import zwidth`` and ``zwidth --help`` do not wait for numpy and numba.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from zwidth.controllers.none import none as none
    from zwidth.controllers.recorded import recorded as recorded
    from zwidth.controllers.wall import wall as wall
    from zwidth.jobs.choose import executor as executor
    from zwidth.jobs.executor import Executor as Executor
    from zwidth.logs.mcap_reader import Log as Log
    from zwidth.logs.mcap_writer import write_log as write_log
    from zwidth.logs.recording import load_log as load_log
    from zwidth.logs.recording import read_recording as read_recording
    from zwidth.scenarios.logged_run import LoggedRun as LoggedRun
    from zwidth.scenarios.logged_run import logged_run as logged_run
    from zwidth.scenarios.replay import ReplayResult as ReplayResult
    from zwidth.scenarios.replay import replay as replay
    from zwidth.scenarios.scenario import Scenario as Scenario
    from zwidth.scenarios.scenario_file import load_scenario as load_scenario
    from zwidth.sim.chain import Chain as Chain
    from zwidth.sim.chain import make_chain as make_chain
    from zwidth.sim.controller import Controller as Controller
    from zwidth.sim.device import Device as Device
    from zwidth.sim.device_file import load_device as load_device
    from zwidth.sim.device_file import save_device as save_device
    from zwidth.sim.device_file import shipped_devices as shipped_devices
    from zwidth.sim.interface import Interface as Interface
    from zwidth.sim.modal import ModalModel as ModalModel
    from zwidth.sim.modal import Mode as Mode
    from zwidth.sim.passive import nearest_passive as nearest_passive
    from zwidth.sim.run import Run as Run
    from zwidth.sim.run import Start as Start
    from zwidth.sim.run import simulate as simulate
    from zwidth.sim.trace import Trace as Trace
    from zwidth.sim.uncertainty import Uncertainty as Uncertainty
    from zwidth.stability.bisection import Trial as Trial
    from zwidth.stability.boundary import Boundary as Boundary
    from zwidth.stability.boundary import find_boundaries as find_boundaries
    from zwidth.stability.fate_map import FateMap as FateMap
    from zwidth.stability.fate_map import make_map as make_map
    from zwidth.stability.fate_map import save_map as save_map
    from zwidth.stability.fates import Fate as Fate
    from zwidth.stability.fates import Fates as Fates
    from zwidth.stability.linear import boundary as boundary
    from zwidth.stability.linear import corner as corner
    from zwidth.stability.linear import critical_stiffness as critical_stiffness
    from zwidth.stability.plane import Axis as Axis
    from zwidth.stability.plane import Plane as Plane

# name -> the module that it comes from; the same list as above, for the running program.
HOMES = {
    "Axis": "zwidth.stability.plane",
    "Boundary": "zwidth.stability.boundary",
    "Chain": "zwidth.sim.chain",
    "Controller": "zwidth.sim.controller",
    "Device": "zwidth.sim.device",
    "Executor": "zwidth.jobs.executor",
    "Fate": "zwidth.stability.fates",
    "FateMap": "zwidth.stability.fate_map",
    "Fates": "zwidth.stability.fates",
    "Interface": "zwidth.sim.interface",
    "Log": "zwidth.logs.mcap_reader",
    "LoggedRun": "zwidth.scenarios.logged_run",
    "ModalModel": "zwidth.sim.modal",
    "Mode": "zwidth.sim.modal",
    "Plane": "zwidth.stability.plane",
    "ReplayResult": "zwidth.scenarios.replay",
    "Run": "zwidth.sim.run",
    "Scenario": "zwidth.scenarios.scenario",
    "Start": "zwidth.sim.run",
    "Trace": "zwidth.sim.trace",
    "Trial": "zwidth.stability.bisection",
    "Uncertainty": "zwidth.sim.uncertainty",
    "boundary": "zwidth.stability.linear",
    "corner": "zwidth.stability.linear",
    "critical_stiffness": "zwidth.stability.linear",
    "executor": "zwidth.jobs.choose",
    "find_boundaries": "zwidth.stability.boundary",
    "load_device": "zwidth.sim.device_file",
    "load_log": "zwidth.logs.recording",
    "load_scenario": "zwidth.scenarios.scenario_file",
    "logged_run": "zwidth.scenarios.logged_run",
    "make_chain": "zwidth.sim.chain",
    "make_map": "zwidth.stability.fate_map",
    "nearest_passive": "zwidth.sim.passive",
    "none": "zwidth.controllers.none",
    "read_recording": "zwidth.logs.recording",
    "recorded": "zwidth.controllers.recorded",
    "replay": "zwidth.scenarios.replay",
    "save_device": "zwidth.sim.device_file",
    "save_map": "zwidth.stability.fate_map",
    "shipped_devices": "zwidth.sim.device_file",
    "simulate": "zwidth.sim.run",
    "wall": "zwidth.controllers.wall",
    "write_log": "zwidth.logs.mcap_writer",
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
