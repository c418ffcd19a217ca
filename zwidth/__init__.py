"""Say why a recording of a machine differs from its simulation, and how stiff a wall it renders.

    import zwidth

    answer = zwidth.diagnose("recording.csv")        # fits a device; or with one that you know
    answer.device                                    # with what the recording shows to be missing
    device = zwidth.load_device("phantom_1_0")       # or your own device file
    zwidth.boundary(device)                          # how stiff a wall it can render
    zwidth.simulate(device, zwidth.wall(2.0, 0.01))  # one run: K = 2 N m/rad, B = 0.01 N m s/rad

Why does a recording differ?
    diagnose          what physics is missing, where, how much, with 95 % intervals
    diagnose_fleet    many recordings of like devices: what is shared, what changed, which are odd
    diagnose_joints   each joint of a machine with several, such as a robot
    check             whether answer.device still describes a later recording; what changed
    identify          a device from a recording of its command and position
    plan, excitation  what a recording would show before it is made; the command to record
How stiff a wall?
    boundary          stable stiffness over damping, by theory and by simulation
    critical_stiffness, corner    the linear theory alone: at one damping, at the top
    make_map, save_map            what a run does over two quantities: rests, oscillates, grows
    sweep             the setting, such as the velocity filter's, with the largest Z-width
    relay             critical stiffness and frequency as a relay experiment reads them
    find_boundaries   boundaries of several devices over dampings that you choose; Trial(law=Law())
                      says which law the walls follow, Trial(perception=
                      Perception()) sets from which size on an oscillation is felt
What happens in a run?
    simulate          a device under wall, texture, region, guarded (by a passivity controller),
                      recorded, none or user_controller, or a Scenario
    load_scenario, logged_run, replay    an experiment from a file, its log, the log run again
    read_recording, load_log, write_log  recordings and logs as Trace; a data Frame, a dict of
                      arrays or an array is a recording, too
Which device?
    load_device, save_device, shipped_devices    device files; every function takes a path or name
    Device, Chain, Interface, ModalModel         a device in Python; make_physics adds an effect,
    make_chain, make_physics, nearest_passive    as in device.with_physics(make_physics(...))
Where does long work run?
    executor          on threads, in processes, on a cluster

Every result (Boundary, Run, Trace, Log, Diagnosis, Check, JointAnswers, Fleet, Identified,
RelayReadings, Plan, FateMap, Sweep, ReplayResult, Scenario, Device) has to_xarray(), to_pandas()
and plot(), and shows as a table in a notebook. Quantities are SI; a rotary device counts in N m and
rad, any other in N and m.
help(zwidth.diagnose) and so on say what each takes, returns and raises; docs/python.md shows more.
"""

# Each name is imported when it is first used, so that `import zwidth` and `zwidth --help` do not
# wait for numpy and numba. There is no __all__: with it help(zwidth) would print every class in
# full, 2 000 lines of methods; without it, only the overview above.

from importlib import import_module as _import_module
from pathlib import Path as _Path
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

_package = _Path(__file__).parent
if not (_package / "sim").is_dir():  # a clone without symbolic links, as on Windows
    __path__.append(str(_package.parent))  # the folders are beside this package

from zwidth.shown import shown_by as _shown_by  # noqa: E402

if _TYPE_CHECKING:
    from zwidth.api.boundary import boundary as boundary
    from zwidth.api.check import check as check
    from zwidth.api.diagnose import diagnose as diagnose
    from zwidth.api.diagnose_fleet import diagnose_fleet as diagnose_fleet
    from zwidth.api.diagnose_joints import diagnose_joints as diagnose_joints
    from zwidth.api.find_boundaries import find_boundaries as find_boundaries
    from zwidth.api.identify import identify as identify
    from zwidth.api.make_map import make_map as make_map
    from zwidth.api.plan import excitation as excitation
    from zwidth.api.plan import plan as plan
    from zwidth.api.relay import relay as relay
    from zwidth.api.replay import replay as replay
    from zwidth.api.simulate import simulate as simulate
    from zwidth.api.sweep import sweep as sweep
    from zwidth.checking import Check as Check
    from zwidth.controllers.guarded import guarded as guarded
    from zwidth.controllers.none import none as none
    from zwidth.controllers.recorded import recorded as recorded
    from zwidth.controllers.region import region as region
    from zwidth.controllers.texture import texture as texture
    from zwidth.controllers.wall import wall as wall
    from zwidth.diagnosis.answer.joints import JointAnswers as JointAnswers
    from zwidth.diagnosis.answer.result import Diagnosis as Diagnosis
    from zwidth.diagnosis.answer.result import Estimate as Estimate
    from zwidth.diagnosis.answer.result import Finding as Finding
    from zwidth.diagnosis.answer.result import NotDiagnosed as NotDiagnosed
    from zwidth.diagnosis.answer.result import Rival as Rival
    from zwidth.diagnosis.answer.result import Verdict as Verdict
    from zwidth.fleet.listing import Listed as Listed
    from zwidth.fleet.result import Fleet as Fleet
    from zwidth.identification.cycles import RelayCondition as RelayCondition
    from zwidth.identification.cycles import RelayReadings as RelayReadings
    from zwidth.identification.identified import Identified as Identified
    from zwidth.identification.relay import RelayTest as RelayTest
    from zwidth.jobs.choose import executor as executor
    from zwidth.jobs.executor import Executor as Executor
    from zwidth.logs.annotations import Annotation as Annotation
    from zwidth.logs.events import Event as Event
    from zwidth.logs.in_memory import Frame as Frame
    from zwidth.logs.mcap_reader import Log as Log
    from zwidth.logs.mcap_writer import write_log as write_log
    from zwidth.logs.recording import load_log as load_log
    from zwidth.logs.recording import read_recording as read_recording
    from zwidth.planning.plan import Plan as Plan
    from zwidth.scenarios.comparison import Difference as Difference
    from zwidth.scenarios.disturbance import Disturbance as Disturbance
    from zwidth.scenarios.logged_run import LoggedRun as LoggedRun
    from zwidth.scenarios.logged_run import logged_run as logged_run
    from zwidth.scenarios.replay import ReplayResult as ReplayResult
    from zwidth.scenarios.scenario import Scenario as Scenario
    from zwidth.scenarios.scenario_file import load_scenario as load_scenario
    from zwidth.sim.chain import Chain as Chain
    from zwidth.sim.chain import make_chain as make_chain
    from zwidth.sim.controller import Controller as Controller
    from zwidth.sim.controller import user_controller as user_controller
    from zwidth.sim.device import Device as Device
    from zwidth.sim.device_file import load_device as load_device
    from zwidth.sim.device_file import save_device as save_device
    from zwidth.sim.device_file import shipped_devices as shipped_devices
    from zwidth.sim.fate import Fate as Fate
    from zwidth.sim.interface import Interface as Interface
    from zwidth.sim.law import Law as Law
    from zwidth.sim.modal import ModalModel as ModalModel
    from zwidth.sim.modal import Mode as Mode
    from zwidth.sim.passive import PassiveFit as PassiveFit
    from zwidth.sim.passive import nearest_passive as nearest_passive
    from zwidth.sim.perception import Perception as Perception
    from zwidth.sim.physics import make_physics as make_physics
    from zwidth.sim.physics.effect import Physics as Physics
    from zwidth.sim.run import Outcome as Outcome
    from zwidth.sim.run import Run as Run
    from zwidth.sim.run import Start as Start
    from zwidth.sim.trace import Trace as Trace
    from zwidth.sim.uncertainty import Uncertainty as Uncertainty
    from zwidth.stability.bisection import Bracket as Bracket
    from zwidth.stability.bisection import Search as Search
    from zwidth.stability.boundary import Boundary as Boundary
    from zwidth.stability.boundary import BoundaryPoint as BoundaryPoint
    from zwidth.stability.fate_map import FateMap as FateMap
    from zwidth.stability.fate_map import save_map as save_map
    from zwidth.stability.fates import Fates as Fates
    from zwidth.stability.judging import Trial as Trial
    from zwidth.stability.linear import corner as corner
    from zwidth.stability.linear import critical_stiffness as critical_stiffness
    from zwidth.stability.plane import Axis as Axis
    from zwidth.stability.plane import Plane as Plane
    from zwidth.stability.sweep import Step as Step
    from zwidth.stability.sweep import Sweep as Sweep
    from zwidth.stability.types import Corner as Corner
    from zwidth.stability.types import LinearPoint as LinearPoint

# name -> its module; the same list as above, for the running program.
HOMES = {
    "Annotation": "zwidth.logs.annotations",
    "Axis": "zwidth.stability.plane",
    "Boundary": "zwidth.stability.boundary",
    "BoundaryPoint": "zwidth.stability.boundary",
    "Bracket": "zwidth.stability.bisection",
    "Chain": "zwidth.sim.chain",
    "Check": "zwidth.checking",
    "Controller": "zwidth.sim.controller",
    "Corner": "zwidth.stability.types",
    "Device": "zwidth.sim.device",
    "Diagnosis": "zwidth.diagnosis.answer.result",
    "Difference": "zwidth.scenarios.comparison",
    "Disturbance": "zwidth.scenarios.disturbance",
    "Estimate": "zwidth.diagnosis.answer.result",
    "Event": "zwidth.logs.events",
    "Executor": "zwidth.jobs.executor",
    "Fate": "zwidth.sim.fate",
    "FateMap": "zwidth.stability.fate_map",
    "Fates": "zwidth.stability.fates",
    "Frame": "zwidth.logs.in_memory",
    "Finding": "zwidth.diagnosis.answer.result",
    "Fleet": "zwidth.fleet.result",
    "Identified": "zwidth.identification.identified",
    "Interface": "zwidth.sim.interface",
    "JointAnswers": "zwidth.diagnosis.answer.joints",
    "Law": "zwidth.sim.law",
    "LinearPoint": "zwidth.stability.types",
    "Listed": "zwidth.fleet.listing",
    "Log": "zwidth.logs.mcap_reader",
    "LoggedRun": "zwidth.scenarios.logged_run",
    "ModalModel": "zwidth.sim.modal",
    "Mode": "zwidth.sim.modal",
    "NotDiagnosed": "zwidth.diagnosis.answer.result",
    "Outcome": "zwidth.sim.run",
    "PassiveFit": "zwidth.sim.passive",
    "Perception": "zwidth.sim.perception",
    "Physics": "zwidth.sim.physics.effect",
    "Plan": "zwidth.planning.plan",
    "Plane": "zwidth.stability.plane",
    "RelayCondition": "zwidth.identification.cycles",
    "RelayReadings": "zwidth.identification.cycles",
    "RelayTest": "zwidth.identification.relay",
    "ReplayResult": "zwidth.scenarios.replay",
    "Rival": "zwidth.diagnosis.answer.result",
    "Run": "zwidth.sim.run",
    "Scenario": "zwidth.scenarios.scenario",
    "Search": "zwidth.stability.bisection",
    "Start": "zwidth.sim.run",
    "Step": "zwidth.stability.sweep",
    "Sweep": "zwidth.stability.sweep",
    "Trace": "zwidth.sim.trace",
    "Trial": "zwidth.stability.judging",
    "Uncertainty": "zwidth.sim.uncertainty",
    "Verdict": "zwidth.diagnosis.answer.result",
    "boundary": "zwidth.api.boundary",
    "check": "zwidth.api.check",
    "corner": "zwidth.stability.linear",
    "critical_stiffness": "zwidth.stability.linear",
    "diagnose": "zwidth.api.diagnose",
    "diagnose_fleet": "zwidth.api.diagnose_fleet",
    "diagnose_joints": "zwidth.api.diagnose_joints",
    "excitation": "zwidth.api.plan",
    "executor": "zwidth.jobs.choose",
    "find_boundaries": "zwidth.api.find_boundaries",
    "guarded": "zwidth.controllers.guarded",
    "identify": "zwidth.api.identify",
    "load_device": "zwidth.sim.device_file",
    "load_log": "zwidth.logs.recording",
    "load_scenario": "zwidth.scenarios.scenario_file",
    "logged_run": "zwidth.scenarios.logged_run",
    "make_chain": "zwidth.sim.chain",
    "make_map": "zwidth.api.make_map",
    "make_physics": "zwidth.sim.physics",
    "nearest_passive": "zwidth.sim.passive",
    "none": "zwidth.controllers.none",
    "plan": "zwidth.api.plan",
    "read_recording": "zwidth.logs.recording",
    "recorded": "zwidth.controllers.recorded",
    "region": "zwidth.controllers.region",
    "relay": "zwidth.api.relay",
    "replay": "zwidth.api.replay",
    "save_device": "zwidth.sim.device_file",
    "save_map": "zwidth.stability.fate_map",
    "shipped_devices": "zwidth.sim.device_file",
    "simulate": "zwidth.api.simulate",
    "sweep": "zwidth.api.sweep",
    "texture": "zwidth.controllers.texture",
    "user_controller": "zwidth.sim.controller",
    "wall": "zwidth.controllers.wall",
    "write_log": "zwidth.logs.mcap_writer",
}

_shown_by("zwidth.views")


def __getattr__(name: str) -> _Any:
    if name not in HOMES:
        raise AttributeError(f"module 'zwidth' has no attribute {name!r}")
    value = getattr(_import_module(HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(["__doc__", "__file__", "__name__", "__path__", *HOMES])
