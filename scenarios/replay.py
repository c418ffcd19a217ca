"""Replay a log: from the file alone, simulate the run again and compare it bit for bit."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from os import PathLike

from zwidth.logs.mcap_reader import Log, read_log
from zwidth.logs.schema import SUBSTEP, TICK
from zwidth.scenarios.comparison import Comparison, Difference
from zwidth.scenarios.exact import with_computed
from zwidth.scenarios.logged_run import COMPUTED, SCENARIO, run_blocks, zwidth_version
from zwidth.scenarios.scenario import Scenario
from zwidth.scenarios.scenario_file import scenario_from_text
from zwidth.shown import Shown
from zwidth.sim.controller import Step
from zwidth.sim.physics.own import OWN
from zwidth.sim.run import Setup
from zwidth.sim.trace import Trace


class ReplayError(ValueError):
    """A log that cannot be replayed; the message is one sentence."""


@dataclass(frozen=True, repr=False)
class ReplayResult(Shown):
    """Whether a log and its replay are equal bit for bit.

    ticks: number in the log, all of which were compared up to the first difference (None if they
    are identical). notes: a sentence for each limit of the comparison (a log cut short, another
    source of the user's controller, another version). trace: the logged trace.
    """

    identical: bool
    ticks: int
    first_difference: Difference | None
    notes: tuple[str, ...] = ()
    trace: Trace | None = field(default=None, compare=False)


def replay(
    path: str | PathLike[str],
    controller: Step | None = None,
    progress: Callable[[float], object] | None = None,
) -> ReplayResult:
    """Rebuild a run from its log alone, simulate it again, compare every channel bit for bit.

    controller: the user's own control law, if the run had one. progress: called with the share
    done, first when the log is read. A log that ends early is compared as far as it goes. NaN
    equals NaN, whatever its payload.

    Raises LogError for a file that is not a log, ScenarioError, NotTheSame or ReplayError for a log
    whose run cannot be rebuilt: a recording, attachments missing or changed, a controller not
    supplied.
    """
    log = read_log(path)
    if len(log.tick) == 0:
        raise ReplayError(f"{log.path} holds no sample; there is nothing to compare")
    tell = progress or _silent
    tell(0.0)
    scenario = _scenario(log, controller)
    try:
        setup, notes = with_computed(scenario.prepare(), _attachment(log, COMPUTED))
    except ValueError as error:
        raise ReplayError(f"{log.path}: {error}") from None
    notes = [*log.warnings, *_doubts(log, scenario), *notes]
    found = _first_difference(log, scenario, setup, tell)
    return ReplayResult(found is None, len(log.tick), found, tuple(notes), log.tick)


def _silent(_: float) -> None:
    pass


def _attachment(log: Log, name: str) -> bytes:
    try:
        return log.attachments[name]
    except KeyError:
        lost = "; it is lost with the damaged part" if log.warnings else ""
        raise ReplayError(
            f"{log.path} has no attachment {name!r}{lost}: only a log that zwidth simulated can be"
            " replayed, not a recording"
        ) from None


def _scenario(log: Log, controller: Step | None) -> Scenario:
    try:
        text = _attachment(log, SCENARIO).decode()
    except UnicodeDecodeError:
        raise ReplayError(f"{log.path}: its {SCENARIO} is not text; the log was changed") from None
    return scenario_from_text(
        text, f"{log.path}, {SCENARIO}", files=lambda name: _attachment(log, name), step=controller
    )


def _doubts(log: Log, scenario: Scenario) -> Iterator[str]:
    written, own = log.metadata.get("version", "unknown"), zwidth_version()
    if written != own:
        yield f"the log was written by zwidth {written} and replayed by {own}"
    source = log.metadata.get("controller_source_sha256")
    if source is not None and source != scenario.controller.facts.get("source_sha256"):
        function = log.metadata.get("controller_function", "the controller")
        yield (
            f"the source of {scenario.controller.facts.get('function')} is not the one that ran"
            f" as {function} when the log was written"
        )
    for name, own in OWN.items():
        source = log.metadata.get(f"effect_{name}")
        if source is not None and source != own.source:
            yield f"{own.file} is not the effect {name} with which the log was written"


def _first_difference(
    log: Log, scenario: Scenario, setup: Setup, tell: Callable[[float], object]
) -> Difference | None:
    whole, period, fine = not log.warnings, setup.eq.period, log.substep
    ticks = Comparison(TICK, log.tick, period, 1, whole)
    substeps = None
    if scenario.fine and fine is not None:
        substeps = Comparison(SUBSTEP, fine, period, int(setup.eq.substeps.sum()), whole)
    comparisons = [c for c in (ticks, substeps) if c is not None]
    done = 0
    for block in run_blocks(scenario, setup):
        _check_channels(log, set(block.tick.channels) - set(log.tick.channels), TICK)
        found = [ticks.block(block.tick)]
        if substeps is not None and fine is not None and block.fine is not None:
            _check_channels(log, set(block.fine.channels) - set(fine.channels), SUBSTEP)
            found.append(substeps.block(block.fine))
        first = min((d for d in found if d is not None), key=lambda d: d.tick, default=None)
        if first is not None or (not whole and all(c.exhausted for c in comparisons)):
            return first
        done += len(block.tick)
        tell(min(1.0, done / len(log.tick)))
    left = [c.rest() for c in comparisons]
    return next((d for d in left if d is not None), None)


def _check_channels(log: Log, lost: set[str], topic: str) -> None:
    if lost:
        raise ReplayError(
            f"{log.path}: {topic} has no {', '.join(sorted(lost))}, which its scenario records;"
            " the log was changed"
        )
