"""One open page: a view, its computations and its display."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from time import perf_counter
from typing import Any

from bokeh.document import Document

from zwidth.explore import words
from zwidth.explore.background import Newest
from zwidth.explore.bench import SECONDS, Bench
from zwidth.explore.drawn import Drawn
from zwidth.explore.dropped import read_dropped
from zwidth.explore.look import Look, columns, look
from zwidth.explore.page import Page, beside
from zwidth.explore.run_figures import BESIDE, LOOKS, RECORDED, RUN
from zwidth.explore.view import OF_THE_PLANE, OF_THE_RUN, Span, View, differ
from zwidth.sim.trace import Trace
from zwidth.stability.plane import Plane
from zwidth.stability.sketch import sketch

PATIENCE_S = 0.12  # [s] after which an unfinished picture is shown


class Session:
    """A page of one browser tab, which shares nothing with other tabs."""

    def __init__(self, document: Document, bench: Bench, view: View, complaints: list[str]) -> None:
        self.document, self.bench, self.view = document, bench, view
        self.recording = bench.recording
        self.drawn: Drawn | None = None
        self.request = 0  # number of the newest request for a plane
        self.run_waits = False
        self.planes, self.runs = (Newest(self._failed) for _ in range(2))
        try:
            view = self._with_axes(view)
            bench.plane(view)
        except ValueError as error:  # each part of the link is allowed, but not the combination
            view, complaints = self._with_axes(View()), [*complaints, f"{error}; link left out"]
        self.page = Page(bench, view, self)
        document.on_session_destroyed(lambda _: self.close())
        self.page.complain("; ".join(complaints))
        self._show(View(), self._chosen_at_first(view))

    def close(self) -> None:
        """Abandon all work: the tab was closed."""
        self.planes.close()
        self.runs.close()

    def change(self, **changes: Any) -> None:
        """Change the view as the user wants, and show the result."""
        before, view = self.view, replace(self.view, **changes)
        try:
            view = self._with_axes(view)
            self.bench.plane(view)
        except ValueError as error:
            self.page.complain(str(error))
            self.page.show_view(before)
            return
        if view != before:
            self.page.complain("")
            self._show(before, view)

    def refit(self) -> None:
        """Fit the axes to the boundary."""
        self.change(damping_range=None, stiffness_range=None)

    def choose(self, damping: float, stiffness: float) -> None:
        """Run the wall at a point."""
        if damping >= 0.0 and stiffness > 0.0:
            self.change(damping=_short(damping), stiffness=_short(stiffness))
        else:
            self.page.complain("a wall has K above 0 and B of 0 or more; click there")

    def refuse(self, sentence: str) -> None:
        """Say why an entry is refused, and show the present value."""
        self.page.complain(sentence)
        self.page.show_view(self.view)

    def zoom(self, dampings: Span, stiffnesses: Span) -> None:
        """Compute the part of the plane that the user zoomed to."""
        spans = [(_short(max(low, 0.0)), _short(high)) for low, high in (dampings, stiffnesses)]
        if all(low < high for low, high in spans):
            self.change(damping_range=spans[0], stiffness_range=spans[1])

    def zoom_time(self, span: Span | None) -> None:
        """Show a part of the run."""
        if span is not None:
            span = _short(max(span[0], 0.0)), _short(min(span[1], SECONDS))
            if span[1] <= span[0]:
                return
        self.change(time_range=None if span == (0.0, SECONDS) else span)

    def take(self, names: list[str], contents: list[str]) -> None:
        """Draw a recording with the run."""
        try:
            self.recording, said = read_dropped(names, contents)
        except (ValueError, OSError) as error:
            self.page.complain(str(error))
            return
        assumed = [line for line in said if line.startswith("assumed")]
        self.page.complain("; ".join(assumed))
        self.page.say_recording(names, self.recording, [s for s in said if s not in assumed])
        self._show_recording()
        self._ask_for_run()

    def _with_axes(self, view: View) -> View:
        known = view.damping_range is not None and view.stiffness_range is not None
        moved = (view.device, view.delay) != (self.view.device, self.view.delay)
        return self.bench.fitted(view) if not known or (moved and not self._fits(view)) else view

    def _fits(self, view: View) -> bool:
        return self.bench.still_fits(view)

    def _chosen_at_first(self, view: View) -> View:
        """Return the view with a wall halfway to the boundary where none was chosen."""
        if view.stiffness is not None and view.damping is not None:
            return view
        assert view.damping_range is not None
        damping = float(f"{0.3 * view.damping_range[1]:.2g}")
        critical = self.bench.line(view).at(damping)
        stiffness = 0.6 * critical[0] if critical else 0.5 * (view.stiffness_range or (0, 1))[1]
        return replace(view, damping=damping, stiffness=float(f"{stiffness:.2g}"))

    def _show(self, before: View, view: View) -> None:
        self.view = view
        self.page.show_view(view)
        self.run_waits = self.run_waits or differ(before, view, OF_THE_RUN)
        if self.drawn is None or differ(before, view, OF_THE_PLANE):
            self.request += 1
            self.planes.ask(partial(self._compute_plane, self.request, self.bench.plane(view)))
        elif before.layer != view.layer:
            self._show_plane(self.drawn)
        if self.run_waits and not differ(before, view, OF_THE_PLANE):
            self._ask_for_run()
        elif before.time_range != view.time_range:
            self.page.runs.show_span(view.time_range)
        if before.recording_from != view.recording_from or before == View():
            self._show_recording()

    def _compute_plane(self, request: int, plane: Plane) -> Iterator[None]:
        began = perf_counter()
        due = began + PATIENCE_S
        for latest in sketch(plane):
            now = perf_counter()
            if latest.finished or now > due:
                due = now + max(PATIENCE_S, now - began)  # ever less often: each costs time
                filled, seconds = latest.filled(), now - began
                drawn = Drawn(request, filled, latest.middle, latest.finished, seconds)
                self._later(partial(self._show_plane, drawn))
            yield

    def _compute_run(self, view: View) -> Iterator[None]:
        found = look(self.bench, view)
        yield
        alone = len(self.bench.devices) == 1
        other = None if alone else look(self.bench, beside(view))
        self._later(partial(self._show_run, found, other))

    def _show_plane(self, drawn: Drawn) -> None:
        if drawn.request != self.request or drawn.older_than(self.drawn):
            return
        self.drawn = drawn
        self.page.plane.show_map(drawn.result, self.view.layer)
        said = words.of_the_plane(drawn.result, drawn.middle, drawn.finished, drawn.seconds)
        self.page.say_progress(said)
        if self.run_waits:  # until the first picture, for which the user waits
            self._ask_for_run()

    def _ask_for_run(self) -> None:
        self.run_waits = False
        self.runs.ask(partial(self._compute_run, self.view))

    def _show_run(self, found: Look, other: Look | None) -> None:
        if differ(found.view, self.view, OF_THE_RUN):
            return
        drawn = None if other is None else columns(other.trace)
        self.page.runs.show({RUN: columns(found.trace), BESIDE: drawn}, self.view.time_range)
        line, plane = self.bench.line(self.view), self.bench.plane(self.view)
        self.page.say_wall(words.of_the_wall(found, plane, line))
        self.page.say_runs(words.of_the_runs(LOOKS, self._names()))
        assert self.view.damping is not None
        critical, interface = line.at(self.view.damping), plane.device.interface
        ultimate = None if critical is None else critical[1]
        self.page.runs.show_theory(ultimate, interface.command_limit, 0.5 / interface.period)

    def _names(self) -> dict[str, str]:
        """Return whose runs lie on each other."""
        names = {RUN: self.bench.names[self.view.device]}
        if len(self.bench.devices) > 1:
            names[BESIDE] = self.bench.names[beside(self.view).device]
        if self.recording is None:
            return names
        return names | {RECORDED: words.of_the_recording(self.page.runs.beyond)}

    def _show_recording(self) -> None:
        trace: Trace | None = self.recording
        drawn = None if trace is None else columns(trace, self.view.recording_from, SECONDS)
        self.page.runs.show({RECORDED: drawn}, self.view.time_range)

    def _later(self, show: Any) -> None:
        """Show something from another thread; a page that has gone has nothing to show it on."""
        with suppress(RuntimeError):
            self.document.add_next_tick_callback(show)

    def _failed(self, error: Exception) -> None:
        kind = "" if isinstance(error, ValueError) else f"internal error, {type(error).__name__}: "
        self._later(partial(self.page.complain, f"{kind}{error}"))


def _short(value: float) -> float:
    return float(f"{value:.4g}")
