"""The loop that follows a log: immediate checks, quick fits, and searches when data have doubled.

Three processes run side by side. This one reads the log four times a second and reports at once; at
most once a second it checks the last samples for faults, including signs and units. A second
process runs one quick fit (`quick`) after the other. A third one searches (`searched`) all data so
far: when their amount has doubled since the last search, when a quick fit contradicts the last
result, or when no more data come. All searches together take about as long as two searches of the
whole log, however long it is.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from zwidth.diagnosis.recording.experiment import SHORTEST
from zwidth.logs.recording_file import Description
from zwidth.sim.device import Device
from zwidth.watch.growing import Growing
from zwidth.watch.quick import Order, Quick, quick
from zwidth.watch.searched import Searched, first_device, searched
from zwidth.watch.state import Gate, Read, at_once, gate, read
from zwidth.watch.updates import GATE, NOTE, Update, of_quick, of_search
from zwidth.watch.worker import Works

LOOK, READ_EVERY, GATE_EVERY = 0.05, 0.25, 1.0  # s between looks at the file, readings, gates
FIT_EVERY = 2.0  # least s between quick fits, so that the search has a core
BUSY = 1.0  # wait between readings, over the duration of a reading
GATE_BUSY = 4.0  # the same for the gate, so that it does not delay readings
ENOUGH = 2 * SHORTEST  # least samples for a fitted device and a search
GROWN, DOUBTED = 2.0, 1.2  # factors on the samples of the last search that start the next one
RESTS = 2.0  # s without new data, after which all data are searched
QUICKLY, MOST, LEAST = 4.0, 12_000, 2_000  # s that a quick fit may work; samples of it
EFFORT = "quick"  # of searches during the log; the final one has the requested effort

Tell = Callable[[Update], None]


@dataclass(frozen=True)
class Asked:
    """The log that is followed, its device, and what else to report.

    description: of a recording TOML, None for a log that describes itself; device: None to fit one.
    damping: of the wall; walls: whether to compute one, None: if the device may render it. idle:
    seconds without new data after which it ends, None for never.
    """

    growing: Growing
    description: Description | None
    name: str
    device: Device | None
    damping: float
    walls: bool | None
    idle: float | None


def follow(
    asked: Asked,
    tell: Tell,
    workers: tuple[Works, Works],
    halted: Callable[[], bool] = lambda: False,
) -> Read:
    """Follow a log until its source ends, report its state, and return its final content.

    workers: for fits and for searches. halted: whether Ctrl-C was pressed, since an interrupt
    raised in a callback of a library is lost there. Raises LogError, OSError and KeyboardInterrupt.
    """
    watch = _Watch(asked, tell, *workers)
    while not watch.over():
        if halted():
            raise KeyboardInterrupt
        watch.look()
        time.sleep(LOOK)
    return watch.found


class _Watch:
    """What is known of a log while it is followed."""

    def __init__(self, asked: Asked, tell: Tell, fits: Works, searches: Works) -> None:
        self.asked, self.tell, self.fits, self.searches = asked, tell, fits, searches
        self.log = asked.growing
        self.device = asked.device
        self.found = Read(wanting="nothing has come yet")
        self.seen, self.odd, self.greeted, self.fitted = Gate({}), "", False, 0
        self.last: Searched | None = None
        self.fitting: Searched | None = None  # the search whose structure the present fit uses
        self.quick: Quick | None = None
        self.window = MOST
        self.begun_at = 0  # samples of the last started search
        self.new_at = self.read_at = self.gated_at = time.monotonic()
        self.took = self.gate_took = 0.0
        self.fitted_at = -FIT_EVERY
        self.unread = self.ungated = True

    def over(self) -> bool:
        """Whether the source has ended, or nothing came for as long as was said."""
        still = time.monotonic() - self.new_at
        idle = self.asked.idle is not None and still >= self.asked.idle
        return (self.log.ended or idle) and not self.unread and not self.ungated

    def look(self) -> None:
        """Take what is new, and what is finished, and begin what is due."""
        if self.log.poll():
            self.new_at, self.unread = time.monotonic(), True
        now = time.monotonic()
        due = self.read_at + max(READ_EVERY, BUSY * self.took)
        if self.unread and (self.log.ended or now >= due):
            self._read()
        gate_due = self.gated_at + max(GATE_EVERY, GATE_BUSY * self.gate_took)
        if self.ungated and not self.unread and (self.log.ended or now >= gate_due):
            self._gate()
        self._take()
        if self.found.samples >= ENOUGH:
            self._begin()

    def _read(self) -> None:
        """Read the log, and tell at once what that shows."""
        self.read_at, self.unread, self.ungated = time.monotonic(), False, True
        self.found = read(self.log.spool, self.asked.description)
        first = at_once(self.found)
        self._tell_of(first, first.problem or self.odd)
        self.took = time.monotonic() - self.read_at

    def _gate(self) -> None:
        """Look at the last samples, and tell what is odd about them."""
        self.gated_at, self.ungated = time.monotonic(), False
        seen = gate(self.found, self.device, self.asked.name)
        self.odd = "" if at_once(self.found).problem else seen.problem
        self._tell_of(seen, seen.problem)
        self.gate_took = time.monotonic() - self.gated_at
        if not self.seen.problem and not self.seen.faults and self.device and not self.greeted:
            self.greeted = True
            self._say(GATE, "no fault is seen in the recording", {"faults": [], "problem": ""})

    def _tell_of(self, seen: Gate, now: str) -> None:
        """Tell of faults that are new, and of a problem that is another one than before."""
        fresh = [said for kind, said in seen.faults.items() if kind not in self.seen.faults]
        problem = now if now != self.seen.problem else ""
        self.seen = Gate({**self.seen.faults, **seen.faults}, now)
        for said in [*fresh, *([problem] if problem else [])]:
            self._say(GATE, said, {"faults": list(self.seen.faults.values()), "problem": problem})

    def _say(self, kind: str, sentence: str, values: dict[str, Any] | None = None) -> None:
        self.tell(Update(kind, self.found.seconds, self.found.samples, sentence, values or {}))

    def _take(self) -> None:
        """Take what fits and searches have found."""
        now = self.found.seconds, self.found.samples
        try:
            if (answer := self.searches.take()) is not None:
                if isinstance(answer, Searched):
                    self.last, self.device = answer, answer.device
                    self.begun_at = max(self.begun_at, answer.samples)
                    self.quick, self.fitted = None, 0  # its result is fitted to the last samples
                    self.fitted_at = -FIT_EVERY
                    self.tell(of_search(answer, EFFORT, *now))
                else:
                    self.device, said = answer
                    for sentence in said:
                        self._say(NOTE, sentence)
        except (ValueError, RuntimeError) as error:
            self._say(NOTE, f"the search failed: {error}")
        try:
            fit = self.fits.take()
        except (ValueError, RuntimeError) as error:
            self._say(NOTE, f"the quick fit failed: {error}")
            return
        if isinstance(fit, Quick) and self.fitting is self.last:  # else a new search has ended
            self.quick = fit
            pace = fit.samples * QUICKLY / max(fit.took, 1e-3)
            self.window = int(min(MOST, max(LEAST, pace)))
            self.tell(of_quick(fit, self.last, *now))

    def _begin(self) -> None:
        """Begin a fit and a search where they are due."""
        log, asked, samples = self.log, self.asked, self.found.samples
        source = log.spool, asked.description, asked.name
        if not self.searches.busy and self.device is None and self.begun_at == 0:
            self.begun_at = 1
            self.searches.give(first_device, *source)
        elif not self.searches.busy and self._due(samples):
            self.begun_at = samples
            self.searches.give(searched, *source, asked.device, EFFORT)
        if self.fits.busy or self.device is None or samples == self.fitted or self.seen.problem:
            return
        if (now := time.monotonic()) < self.fitted_at + FIT_EVERY:
            return
        self.fitted_at = now
        self.fitted, self.fitting = samples, self.last
        x = None if self.quick is None or self.last is None else self.quick.x
        order = Order(
            *source, self.device, self.last, x, self.window, asked.damping, asked.walls
        )  # fmt: skip
        self.fits.give(quick, order)

    def _due(self, samples: int) -> bool:
        if samples == self.begun_at or self.seen.problem:
            return False
        doubted = self.quick is not None and not self.quick.stands
        rests = time.monotonic() - self.new_at >= RESTS
        grown = samples >= GROWN * self.begun_at
        return grown or rests or (doubted and samples >= DOUBTED * self.begun_at)
