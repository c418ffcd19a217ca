"""Run a scenario into a log from which it can be replayed bit for bit."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from itertools import takewhile
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from zwidth.files.protection import writing_as
from zwidth.logs.events import Event
from zwidth.logs.mcap_writer import LogWriter
from zwidth.logs.schema import SUBSTEP
from zwidth.scenarios.controller_kinds import takes_array
from zwidth.scenarios.disturbance import BASE
from zwidth.scenarios.exact import array_bytes, computed_bytes
from zwidth.scenarios.run_events import EventFinder, ending
from zwidth.scenarios.run_verdict import run_verdict
from zwidth.scenarios.scenario import Scenario
from zwidth.scenarios.scenario_file import scenario_to_text
from zwidth.shown import Shown
from zwidth.sim.device_file import device_to_text, model_hash
from zwidth.sim.perception import Perception
from zwidth.sim.physics.own import OWN
from zwidth.sim.run import BLOCK_TICKS, Outcome, Run, Setup
from zwidth.sim.trace import Trace

# Attachments. The first three, saved as files in one folder, are a scenario that can be run.
SCENARIO, DEVICE, COMMANDS = "scenario.toml", "device.toml", "commands.npy"
COMPUTED = "computed.npz"


class Block(NamedTuple):
    """A block of a run: samples per tick and, if requested, per substep, and the outcome so far."""

    tick: Trace
    fine: Trace | None
    outcome: Outcome


@dataclass(frozen=True, repr=False)
class LoggedRun(Shown):
    """A finished run and its log: the file, its events and its metadata."""

    run: Run
    path: Path
    events: tuple[Event, ...]
    metadata: Mapping[str, str]


def logged_run(
    scenario: Scenario,
    path: str | PathLike[str],
    *,
    metadata: Mapping[str, str] | None = None,
    perception: Perception = Perception(),
    epoch_ns: int | None = None,
    on_block: Callable[[int], object] | None = None,
    overwrite: bool = False,
) -> LoggedRun:
    """Run a scenario and write its log to `path` while it runs.

    metadata: further facts from the caller (a "verdict"); they replace those found here.
    perception: thresholds from which dither is felt. epoch_ns: log time of t = 0 [ns since 1970],
    by default now. on_block is called with the number of ticks after every block. Substeps go into
    the log only, Run.fine is None.

    Until the run is done the log is called NAME.partial.mcap, and keeps that name if the run is
    interrupted or killed: every finished block of 1000 ticks can be read and replayed from it.

    A file at `path` is replaced if this function wrote it and nobody has edited it since, or with
    overwrite. Otherwise raises Protected. Raises ValueError with a sentence, LogError if the log
    cannot be written.
    """
    setup = scenario.prepare()
    given = dict(metadata or {})
    units, finder = channel_units(scenario, setup), EventFinder(scenario.device)
    done, events = list[Block](), list[Event]()
    with (
        writing_as("logged_run", overwrite),
        LogWriter(
            path,
            units,
            substep_channels=_state_units(units) if scenario.fine else None,
            metadata=_description(scenario) | given,
            attachments=_attachments(scenario, setup),
            epoch_ns=epoch_ns,
            facts={"device": scenario.device.name},
        ) as log,
    ):
        for block in run_blocks(scenario, setup):
            log.append(block.tick.t, block.tick.channels)
            if block.fine is not None:
                log.append(block.fine.t, block.fine.channels, SUBSTEP)
            found = finder.block(block.tick)
            log.events(found)
            events += found
            done.append(block._replace(fine=None))
            if on_block is not None:
                on_block(len(block.tick))
        trace, outcome = _joined([block.tick for block in done]), done[-1].outcome
        found = ending(outcome, trace)
        log.events(found)
        about = _description(scenario) | _conclusion(scenario, trace, outcome, perception) | given
        log.note(about)
    totals = dict(zip(setup.ledger_names, setup.memory.totals.tolist(), strict=True))
    run = Run(trace, outcome, setup.memory, totals)
    return LoggedRun(run, Path(path), (*events, *found), about)


def run_blocks(scenario: Scenario, setup: Setup) -> Iterator[Block]:
    """Run block by block; yield each with the engine's records and the disturbances."""
    units, first = channel_units(scenario, setup), 0
    for tick, fine, outcome in setup.blocks(BLOCK_TICKS):
        forces = {
            name: setup.external[first : first + len(tick), column if name != BASE else -1]
            for name, column in _disturbed(scenario).items()
        }
        joined = Trace(tick.t, {**tick.channels, **forces}, units, tick.origin, tick.facts)
        yield Block(joined, fine, outcome)
        first += len(tick)


def channel_units(scenario: Scenario, setup: Setup) -> dict[str, str]:
    """Return name -> unit of every channel of `/tick`, in order."""
    force = "N m" if scenario.device.rotary else "N"
    moves = "rad/s2" if scenario.device.rotary else "m/s2"
    disturbed = {name: moves if name == BASE else force for name in _disturbed(scenario)}
    return setup.channel_units | disturbed


def _state_units(units: Mapping[str, str]) -> dict[str, str]:
    """Units of the states, which stand before everything measured."""
    return {name: units[name] for name in takewhile(lambda name: name != "encoder", units)}


def _disturbed(scenario: Scenario) -> dict[str, int]:
    """Channel -> mass, for every mass on which a disturbance acts; of the base its acceleration."""
    places = sorted({d.mass(scenario.masses) for d in scenario.disturbances})
    return {f"disturbance_m{i + 1}" if i < scenario.masses else BASE: i for i in places}


def _joined(pieces: list[Trace]) -> Trace:
    first = pieces[0]
    channels = {name: np.concatenate([p[name] for p in pieces]) for name in first.channels}
    return first.with_channels(channels, np.concatenate([p.t for p in pieces]))


def _attachments(scenario: Scenario, setup: Setup) -> dict[str, bytes]:
    array = COMMANDS if takes_array(scenario.controller.kind) else None
    files = {
        SCENARIO: scenario_to_text(scenario, device=DEVICE, array=array).encode(),
        DEVICE: device_to_text(scenario.device).encode(),
        COMPUTED: computed_bytes(setup),
    }
    return files if array is None else files | {array: array_bytes(scenario.controller.parameters)}


def _description(scenario: Scenario) -> dict[str, str]:
    """Metadata known before the run, as text."""
    law, interface = scenario.controller, scenario.device.interface
    known = {
        "version": zwidth_version(),
        "seed": str(scenario.seed),
        "model_hash": model_hash(scenario.device),
        "period_s": repr(interface.period),
        "delay_s": repr(interface.delay),
        "ticks": str(scenario.ticks),
        "controller": law.kind,
    }
    for letter, fact in (("K", "stiffness"), ("B", "damping")):
        if fact in law.facts:
            known[letter] = repr(law.facts[fact])
    for fact in ("function", "source_sha256"):
        if fact in law.facts:
            known[f"controller_{fact}"] = str(law.facts[fact])
    own = {f"effect_{p.effect.name}": OWN[p.effect.name].source for p in scenario.device.physics
           if p.effect.name in OWN}  # fmt: skip
    return known | own


def _conclusion(
    scenario: Scenario, trace: Trace, outcome: Outcome, perception: Perception
) -> dict[str, str]:
    """Metadata known after the run."""
    found = run_verdict(scenario, trace, outcome, perception)
    judged = {} if found is None else {"verdict": found.verdict.value}
    if found is not None and found.fate is not None:
        judged["fate"] = found.fate.word
        given = asdict(perception).items()
        judged |= {f"felt_{name}": repr(value) for name, value in given if value is not None}
    return {"outcome": outcome.name.lower(), "ticks_done": str(len(trace))} | judged


def zwidth_version() -> str:
    """Return the installed version."""
    try:
        return version("zwidth")
    except PackageNotFoundError:
        return "unknown"
