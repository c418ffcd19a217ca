"""`zwidth boundary`: the stiffest stable wall by theory, by simulation and by measurement."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec
import numpy as np

from zwidth.boundary_extras import Asked, extra_cells, extra_headings, with_extras
from zwidth.boundary_summary import answered, say_stiffest
from zwidth.console import Column, Console, progress
from zwidth.controllers.of_law import controller_of
from zwidth.covariance import load_covariance
from zwidth.estimator_option import estimator_option, say_without_theory, with_estimator
from zwidth.figures.style import picture_files
from zwidth.law_options import law_of, law_options, said_of
from zwidth.options import (
    ManyNumbers,
    Quantities,
    Quantity,
    device_argument,
    force_option,
    json_option,
    out_option,
)
from zwidth.results import (
    UNSET,
    BoundaryResult,
    DelayBoundary,
    Measured,
    Point,
    as_json,
    bracketed,
    point_of,
)
from zwidth.scenarios.logged_run import logged_run
from zwidth.scenarios.scenario import Scenario, usual_substeps
from zwidth.scenarios.table_2 import DEVICE, MeasuredPoint, measured_at
from zwidth.sim.device import Device
from zwidth.sim.device_file import load_device, remarks_on
from zwidth.sim.fate import FEW
from zwidth.sim.perception import FORCE, Perception
from zwidth.sim.run import Start
from zwidth.stability.bisection import Bracket, Search, find_brackets
from zwidth.stability.boundary import Boundary, BoundaryPoint, default_dampings, find_boundaries
from zwidth.stability.judging import STARTS, Trial
from zwidth.stability.linear import boundary as linear_boundary
from zwidth.stability.passivity import passive_boundary, stiffest_passive

if TYPE_CHECKING:
    from zwidth.figures.boundary import Corner

LOGGED_S = 4.0
FELT_FROM = 0.01  # of the stiffest wall: softer walls are not tested
FELT_TOLERANCE = 1e-2  # of K: feeling depends on the phase of a cycle relative to the steps
SAME_DAMPING = 1e-9
SHORT_START = 2.0  # times the dither of steps, so that the decay of the start is visible
ABSURD = 1e4  # times the damping that stops all masses within a period
CORNER_POINTS = 33
NONE = "-"  # no stable K
SIDES = ("stable", "unstable")  # of a boundary's top, one log each


@click.command("boundary", cls=ManyNumbers)
@device_argument("name")
@click.option("--delay-ms", cls=Quantities, type=Quantity("ms"), metavar="MS ...",
              help="Loop delays, one boundary each. Default: the device's own delay.")  # fmt: skip
@click.option("--damping", cls=Quantities, type=Quantity("N m s/rad | N s/m"), rising=True,
              metavar="B ...", help="Virtual dampings in rising order. Default: 41 values from 0"
              " to 1.2 times the largest B with a stable wall. Added to these are 0.999 times that"
              " B, the B of the stiffest wall (with --criterion passivity also of the stiffest"
              " passive wall), and each B at which the paper measured this device.")  # fmt: skip
@click.option("--start", cls=Quantities, type=Quantity("rad | m", above=True), metavar="A ...",
              help="Start amplitudes; a wall counts as stable if it is stable from each of them."
              " Default: 0.001; for a device that is not linear also 0.0001.")  # fmt: skip
@click.option("--tolerance", type=Quantity("of K", above=True), default=5e-4, show_default=True,
              help="Relative accuracy of each K.")  # fmt: skip
@click.option("--substeps", type=click.IntRange(1, 1000), default=None,
              help="Integration steps per sample. Default: 1 if that is exact, else"
              " 10.")  # fmt: skip
@click.option("--limit-s", type=Quantity("s", above=True), default=64.0, show_default=True,
              help="Longest simulated time of one run.")  # fmt: skip
@click.option("--criterion", type=click.Choice(["stability", "passivity"]), default="stability",
              show_default=True, help="passivity: also show the stiffest passive wall at"
              " each B (criterion of Colgate and Schenkel, extended by the delay).")  # fmt: skip
@click.option("--felt", is_flag=True, help="Also find the K above which a hand feels dither: an"
              " oscillation sustained only by the steps of the encoder and the command. The search"
              " begins at 1 % of the largest stable K.")  # fmt: skip
@click.option("--felt-force", type=Quantity("N m | N", above=True), default=FORCE,
              show_default=True, help="Smallest force of dither that a hand feels.")  # fmt: skip
@click.option("--felt-position", type=Quantity("rad | m", above=True),
              help="Smallest amplitude that a hand feels. Default: the threshold of vibration on"
              " the skin; for a rotary device, only with --lever.")  # fmt: skip
@click.option("--hand", is_flag=True, help="Also show the range of K_CR, the largest stable K, if"
              " a finger holds the last mass. Fingers differ in mass, damping and"
              " stiffness.")  # fmt: skip
@click.option("--lever", type=Quantity("m", above=True),
              help="Distance of the hand from the axis of a rotary device.")  # fmt: skip
@click.option("--hands", type=click.IntRange(10, 100_000), default=None, metavar="N",
              help="Also draw N fingers at random from the range ascribed to Hajian and Howe, and"
              " show the 5, 50 and 95 % quantiles of K_CR.")  # fmt: skip
@click.option("--covariance", "covariance_file", metavar="FILE",
              type=click.Path(exists=True, dir_okay=False, path_type=Path),
              help="Covariance file of 'zwidth identify': also show the 95 % band of"
              " K_CR.")  # fmt: skip
@estimator_option
@law_options
@click.option("--table", "in_full", is_flag=True, help="Also print the boundary at every damping.")
@out_option("runs/boundary")
@force_option
@json_option
def command(name: str, out: Path, json_file: str | None, **options: Any) -> None:
    """Find the stability boundary of a device under a sampled virtual wall.

    DEVICE is a shipped device or a device file. Says how stiff a wall may be at each delay, draws
    the boundaries, and logs two runs of each: just below and just above its highest stiffness.
    """
    console = Console(json_file)
    device = load_device(name)
    for warning in remarks_on(device):
        console.warn(warning)
    device = with_estimator(device, options["estimator"])
    _refuse_absurd(device, options["damping"])
    say_without_theory(console, device)
    delays = [1e-3 * ms for ms in options["delay_ms"]] or [device.interface.delay]
    _refuse_idle_felt(options)
    held = options["hand"] or options["hands"] is not None
    asked = Asked(
        options["criterion"] == "passivity",
        _lever(device, held, None if options["felt"] and not held else options["lever"]),
        None if options["covariance_file"] is None else load_covariance(options["covariance_file"]),
        options["hands"] or 0,
        options["hand"],
    )
    law = law_of([device.with_interface(delay=delay) for delay in delays], options)
    logs = (_log_file(out, delay, side) for delay in delays for side in SIDES)
    console.will_write(*picture_files(out / "boundary"), *logs)
    starts = options["start"] or STARTS
    trial = Trial(
        start=max(starts),
        others=starts,
        limit_s=max(options["limit_s"], 4.0),
        substeps=options["substeps"]
        or max(usual_substeps(device.with_interface(delay=d)) for d in delays),
        law=law,
        perception=Perception(options["felt_force"], options["felt_position"], options["lever"]),
    )
    _say_short_start(console, device, trial)
    search = Search(tolerance=options["tolerance"])
    measured = device.name == load_device(DEVICE).name
    variants = [device.with_interface(delay=d) for d in delays]
    plans = [_plan(v, options["damping"], measured, asked.passive) for v in variants]
    with_extras(plans[0][0], [Point(0.0, None, None)], asked)  # errors come before the long work
    found: list[Boundary] = []
    try:
        total = sum(grid.size for _, grid in plans)
        with progress("finding the largest stable K", total) as advance:
            for variant, grid in plans:
                counted = _Counted(grid.size, partial(advance, now=_ms(variant)))
                found += find_boundaries([variant], [grid], trial, search, counted)
    finally:  # after Ctrl-C too, finished results are kept
        if found:
            judged = trial, search, bool(options["felt"])
            _write(console, device, found, judged, out, measured, asked, options["in_full"])


def _refuse_idle_felt(options: dict[str, Any]) -> None:
    """Raise ValueError for thresholds of what is not asked for."""
    if not options["felt"] and (options["felt_position"] or options["felt_force"] != FORCE):
        raise ValueError("--felt-force and --felt-position have no use without --felt; add it")


def _with_felt(
    boundary: Boundary, points: list[Point], judged: tuple[Trial, Search, bool]
) -> list[Point]:
    """Return the points with where an oscillation begins to be felt, where that is asked for.

    From `FELT_FROM` of the stiffest wall on: at the edge of a step the softest walls chatter, too.
    """
    trial, search, felt = judged
    top = boundary.top
    if not felt or top is None or top.simulated.stable is None:
        return points
    coarser = replace(
        search,
        felt=True,
        tolerance=max(search.tolerance, FELT_TOLERANCE),
        lowest=FELT_FROM * top.simulated.stable,
    )
    dampings = np.array([point.damping for point in points])
    (found,) = find_brackets([boundary.device], [dampings], trial, coarser)
    pairs = zip(points, found, strict=True)
    return [
        msgspec.structs.replace(
            point, felt=bracketed(bracket), felt_reason=_why_all_felt(bracket) or UNSET
        )
        for point, bracket in pairs
    ]


def _why_all_felt(bracket: Bracket) -> str:
    """Why no wall was tried of which nothing is felt; empty where there is one."""
    if bracket.stable is not None or bracket.undecided is not None or bracket.unstable is None:
        return bracket.reason
    return f"felt already at the softest wall tried, K = {bracket.unstable:.3g}"


def _refuse_absurd(device: Device, dampings: Sequence[float]) -> None:
    """Raise ValueError for a damping that no sampled device comes near, nor any arithmetic."""
    most = ABSURD * float(np.sum(device.chain.masses)) / device.interface.period
    unit = "N m s/rad" if device.rotary else "N s/m"
    for damping in dampings:
        if damping > most:
            raise ValueError(
                f"--damping is {damping:g}; it must be at most {most:.3g} {unit}, which is"
                f" {ABSURD:g} times what stops all masses within one period"
            )


def _say_short_start(console: Console, device: Device, trial: Trial) -> None:
    """Warn where the start is within what an encoder's steps alone can hold."""
    least = SHORT_START * FEW * device.interface.encoder_step
    if abs(trial.start) < least:
        steps = abs(trial.start) / device.interface.encoder_step
        console.warn(
            f"--start is {steps:.3g} encoder steps; rounding alone can sustain an oscillation of"
            f" {FEW:.0f} steps. A wall that is stable from this start may be unstable from a larger"
            f" one: give --start {least:.2g} or more"
        )


def _lever(device: Device, hand: bool, lever: float | None) -> float | None:
    """Where a hand holds the device, None for no hand."""
    if lever is not None and not hand:
        raise ValueError(
            "--lever is the distance at which a hand holds the device; add --hand or --hands"
        )
    if hand and device.rotary and lever is None:
        raise ValueError(
            "--hand or --hands on a rotary device needs --lever, the hand's distance from the axis"
            " [m]"
        )
    return (lever or 1.0) if hand else None


class _Counted:
    """Turn a share of a total into steps of a progress bar."""

    def __init__(self, total: int, advance: Any) -> None:
        self.total, self.advance, self.done = total, advance, 0

    def __call__(self, share: float) -> None:
        now = round(share * self.total)
        if now > self.done:
            self.advance(now - self.done)
            self.done = now


def _plan(
    device: Device, given: Sequence[float], measured: bool, passive: bool
) -> tuple[Device, Any]:
    if given:
        return device, np.array(given, dtype=np.float64)
    places = [p.place for p in measured_at(device.interface.delay)] if measured else []
    if passive and (top := stiffest_passive(device)) is not None:
        places.append(top.damping)
    return device, np.unique(np.concatenate([default_dampings(device), places]))


def _write(
    console: Console,
    device: Device,
    found: list[Boundary],
    judged: tuple[Trial, Search, bool],
    out: Path,
    measured: bool,
    asked: Asked,
    in_full: bool,
) -> None:
    trial, search, _ = judged
    plain = [_with_felt(b, _points(b, measured), judged) for b in found]
    points = [with_extras(b.device, own, asked) for b, own in zip(found, plain, strict=True)]
    result = BoundaryResult(
        device.name,
        [
            DelayBoundary(
                b.device.interface.delay, own, answered(b, own, trial, search, device.rotary)
            )
            for b, own in zip(found, points, strict=True)
        ],
        device.rotary,
        said_of(trial.law, device.rotary) or UNSET,
    )
    say_stiffest(console, result)
    for boundary, values in zip(found, result.boundaries, strict=True):
        if in_full:
            _table(console, boundary, values, asked)
    console.result(as_json(result))
    from zwidth.figures.boundary import boundary_figure  # after the work
    from zwidth.figures.style import save_figure

    corners = [_corner(b.device) for b in found] if asked.passive else []
    figure = boundary_figure(result, "measured (Table II)", corners)
    for path in save_figure(figure, out / "boundary"):
        console.say(f"wrote {path}")
    for boundary in found:
        for path in _log_top(boundary, trial, out):
            console.say(f"wrote {path}")


def _corner(device: Device) -> "Corner":
    """The corner of passive walls, twice as wide as where the last one is passive."""
    from zwidth.figures.boundary import Corner

    # A passive wall has at most the damping sum b_i, and less at a higher frequency.
    limit = max(float(device.chain.ground_dampers.sum()), 0.0)
    grid = np.linspace(0.0, 2.0 * limit, CORNER_POINTS) if limit else np.zeros(1)
    walls = [p.stiffness or 0.0 for p in passive_boundary(device, grid.tolist())]
    theory = [p.stiffness or 0.0 for p in linear_boundary(device, grid.tolist())]
    return Corner(grid, np.array(walls), np.array(theory))


def _points(boundary: Boundary, measured: bool) -> list[Point]:
    rows = measured_at(boundary.device.interface.delay) if measured else []
    return [_point(p, _measured(rows, p.damping)) for p in boundary.points]


def _measured(rows: Sequence[MeasuredPoint], damping: float) -> MeasuredPoint | None:
    return next((row for row in rows if abs(row.place - damping) < SAME_DAMPING), None)


def _point(point: BoundaryPoint, row: MeasuredPoint | None) -> Point:
    if row is None:
        return point_of(point)
    printed = UNSET if row.damping_meant is None else row.damping
    return point_of(point, Measured(row.stiffness, row.frequency, printed))


def _table(console: Console, boundary: Boundary, values: DelayBoundary, asked: Asked) -> None:
    force, length = ("N m", "rad") if boundary.device.rotary else ("N", "m")
    stiffness = f"[{force}/{length}]"
    felt = any(point.felt is not UNSET for point in values.points)
    columns = [
        Column(f"B [{force} s/{length}]"),
        Column(f"K linear {stiffness}"),
        Column("f [Hz]"),
        Column("K stable"),
        Column("K unstable"),
        Column("f [Hz]"),
        Column("K measured"),
        Column("f [Hz]"),
        *([Column("K unfelt")] if felt else []),
        *(Column(heading) for heading in extra_headings(asked)),
        Column("note", False),
    ]
    rows = [_row(p, b.simulated) for p, b in zip(values.points, boundary.points, strict=True)]
    title = f"\n{boundary.device.name}, delay {_ms(boundary.device)}"
    console.table(title, columns, rows)


def _row(point: Point, bracket: Bracket) -> list[str]:
    linear = point.linear
    cells = [f"{point.damping:.5g}"]
    cells += [f"{linear.stiffness:.5g}", f"{linear.frequency_hz:.2f}"] if linear else [NONE, NONE]
    if bracket.stable is None:  # if even the softest wall is unstable, there is no boundary
        cells += [NONE] * 3
    else:
        seen = (_number(bracket.stable), _number(bracket.unstable), _frequency(bracket.frequency))
        cells += seen
    note = _note(bracket)
    if point.felt_reason is not UNSET and bracket.stable is not None:
        note = ", ".join(filter(None, (note, point.felt_reason)))
    if point.measured is UNSET:
        return [*cells, "", "", *_felt(point), *extra_cells(point), note]
    measured = point.measured
    if measured.damping_printed is not UNSET:
        note = f"printed as B = {measured.damping_printed:g}"
    cells += [f"{measured.stiffness:.4g}", f"{measured.frequency_hz:.2f}"]
    return [*cells, *_felt(point), *extra_cells(point), note]


def _felt(point: Point) -> list[str]:
    """A cell with the largest K of which nothing is felt, where that was asked for."""
    if point.felt is UNSET:
        return []
    return [NONE if point.felt is None else _number(point.felt.stable)]


def _note(bracket: Bracket) -> str:
    if bracket.stable is None:
        return bracket.reason
    if bracket.undecided is not None:
        low, high = bracket.undecided
        return f"undecided from {low:.5g} to {high:.5g}"
    notes: list[str] = []
    if bracket.unstable_verdict is not None and bracket.unstable_verdict.value == "limit_cycle":
        notes.append(f"limit cycle of {bracket.unstable_amplitude:.3g}")
    if bracket.grows_from:
        notes.append(f"only from a start of {' or '.join(f'{a:g}' for a in bracket.grows_from)}")
    return ", ".join(notes)


def _number(value: float | None) -> str:
    return NONE if value is None else f"{value:.5g}"


def _frequency(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"


def _ms(device: Device) -> str:
    return f"{1e3 * device.interface.delay:g} ms"


def _log_file(out: Path, delay: float, side: str) -> Path:
    return out / f"top_{1e3 * delay:g}ms_{side}.mcap"


def _log_top(boundary: Boundary, trial: Trial, out: Path) -> list[Path]:
    """Log the runs on either side of the highest point of the boundary."""
    top = boundary.top
    if top is None or top.simulated.stable is None:
        return []
    bracket = top.simulated
    ends = [(bracket.stable, bracket.stable_verdict), (bracket.unstable, bracket.unstable_verdict)]
    written: list[Path] = []
    for side, (stiffness, verdict) in zip(SIDES, ends, strict=True):
        if stiffness is None:
            continue
        scenario = Scenario(
            boundary.device,
            controller_of(trial.law, stiffness, bracket.damping),
            max(LOGGED_S, trial.seconds),
            Start(trial.start),
            substeps=trial.substeps,
        )
        path = _log_file(out, boundary.device.interface.delay, side)
        path.parent.mkdir(parents=True, exist_ok=True)
        known = {} if verdict is None else {"verdict": verdict.value}
        logged_run(scenario, path, metadata=known)
        written.append(path)
    return written
