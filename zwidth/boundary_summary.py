"""The summary of a boundary: how stiff a wall may be at each delay."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict

from msgspec import UNSET
from msgspec.structs import replace

from zwidth.console import Column, Console
from zwidth.results import BoundaryResult, DelayBoundary, Ending, Point, Stiffest
from zwidth.sim.readable import plain
from zwidth.stability.bisection import Search
from zwidth.stability.boundary import Boundary
from zwidth.stability.branches import AMPLIFIER, DELAY, FILTER, RIGID
from zwidth.stability.judging import Trial
from zwidth.stability.linear import corner, has_theory, last_stable_damping
from zwidth.stability.top import Ending as Seen
from zwidth.stability.top import endings, lags, without_parts

NONE = "-"
CAUSES = (DELAY, FILTER, AMPLIFIER)  # modes that are not motions of the device
CHANGES = 2e-3  # of K: smaller contributions of a part count as none
IN_N_PER_MM = 1000.0
PART_NAMES = {
    "friction": "friction",
    "play": "play",
    "encoder_step": "the encoder's step",
    "velocity_step": "the step of the velocity",
    "command_step": "the command's step",
    "command_limit": "the command's limit",
}
SAME = 0.1  # of a frequency: tolerance for the same oscillation in theory and simulation
JUMPS = 1.2  # ratio of the frequencies on both sides of the top that counts as a jump


def stiffest(boundary: Boundary) -> Stiffest:
    """Return the top and the end of a boundary, by theory and by simulation."""
    stable = [p for p in boundary.points if p.simulated.stable is not None]
    theory = has_theory(boundary.device)
    best, top = boundary.top, corner(boundary.device) if theory else None
    return Stiffest(
        None if best is None else best.simulated.stable,
        None if best is None else float(best.damping),
        max((float(p.damping) for p in stable), default=None),
        top and float(top.stiffness),
        top and float(top.damping),
        top and float(top.frequency_below_hz),
        top and float(top.frequency_above_hz),
        last_stable_damping(boundary.device) if theory else None,
    )


def answered(
    boundary: Boundary, points: Sequence[Point], trial: Trial, search: Search, rotary: bool
) -> Stiffest:
    """Return the top with the answer in words, and the parts that contribute to it."""
    found = stiffest(boundary)
    seen = endings(boundary)
    without = without_parts(boundary, trial, search)
    last = " (the largest tried)" if found.damping == boundary.points[-1].damping else ""
    because = _because(seen, boundary)
    sentence = f"{_up_to(found, last, rotary)}{because}{_parts(found, without, rotary)}"
    sentence += _unfelt(points, rotary)
    return replace(
        found,
        sentence=sentence,
        endings=[Ending(**asdict(one)) for one in seen],
        frequency_hz=_frequency(boundary) or UNSET,
        without=without,
    )


def _up_to(found: Stiffest, last: str, rotary: bool) -> str:
    if found.stiffness is None or found.damping is None:
        return "No wall is stable at any of these dampings."
    damping = _damping(found.damping, rotary)
    return f"Walls are stable up to {_stiffness(found.stiffness, rotary)}, at B = {damping}{last}."


def _unfelt(points: Sequence[Point], rotary: bool) -> str:
    """The stiffest wall without any felt oscillation, if that was requested."""
    asked = [point for point in points if point.felt is not UNSET]
    known = [(point.felt.stable, point.damping) for point in asked if point.felt]
    if not asked:
        return ""
    if not known:
        return " A hand feels dither at every wall that was tried."
    stiffness, damping = max(known)
    where = f"{_stiffness(stiffness, rotary)} at B = {_damping(damping, rotary)}"
    return f" A hand feels no dither up to {where}."


def _because(seen: Sequence[Seen], boundary: Boundary) -> str:
    """The oscillation that begins at the top, and why."""
    frequency = _frequency(boundary)
    if frequency is not None and not any(_same(one, frequency) for one in seen):
        expected = " and ".join(_oscillation(one) for one in seen)
        instead = f" (linear theory predicts {expected})" if seen else ""
        late = _late(*lags(boundary.device.interface, frequency))
        return f" A stiffer wall oscillates at {frequency:.3g} Hz{instead}. {late}."
    if not seen:
        return ""
    last = seen[-1]
    more = "".join(f"; with more damping, {_begins(one)}" for one in seen[1:])
    return (
        f" At a stiffer wall, {_begins(seen[0])}{more}."
        f" {_late(last.spring_lag_deg, last.damper_lag_deg)}."
    )


def _frequency(boundary: Boundary) -> float | None:
    """Frequency [Hz] of the oscillation that begins above the top, in the time domain."""
    return None if boundary.top is None else boundary.top.simulated.frequency


def _same(one: Seen, frequency: float) -> bool:
    return abs(frequency - one.frequency_hz) <= SAME * one.frequency_hz


def _late(spring_deg: float, damper_deg: float | None) -> str:
    """The phase lags of the wall's forces at the last frequency, and the effect on its damper."""
    spring = f"make the spring force lag by {spring_deg:.0f}\u00b0"
    if damper_deg is None:
        return f"At this frequency, sampling and delay {spring}"
    turned = 90.0 < damper_deg % 360.0 < 270.0
    drives = ", so the damper drives the oscillation" if turned else ""
    forces = f"{spring} and the damping force by {damper_deg:.0f}\u00b0{drives}"
    return f"At this frequency, sampling and delay {forces}"


def _oscillation(one: Seen) -> str:
    """An oscillation by its cause and frequency: "an oscillation of the rigid body at 119 Hz"."""
    return _begins(one).replace(" begins", "")


def _begins(one: Seen) -> str:
    at = f"at {one.frequency_hz:.3g} Hz begins"
    if one.mode in CAUSES:
        return f"an oscillation {at}, caused by the {one.mode}"
    the = "the " if one.mode == RIGID else ""
    return f"an oscillation of {the}{one.mode} {at}"


def _parts(found: Stiffest, without: Mapping[str, float | None], rotary: bool) -> str:
    """By how much each part of the device raises or lowers K at the top's B."""
    if found.stiffness is None or not without:
        return ""
    said: list[str] = []
    for part, stiffness in without.items():
        change = found.stiffness - (stiffness or 0.0)
        amount = f"{_stiffness(abs(change), rotary)}"
        if abs(change) <= CHANGES * found.stiffness:
            said.append(f"{PART_NAMES[part]} changes K by less than {100.0 * CHANGES:g} %")
        else:
            does = "raises" if change > 0.0 else "lowers"
            said.append(f"{PART_NAMES[part]} {does} K by {amount}")
    return f" At this B, {'; '.join(said)}."


def _stiffness(value: float, rotary: bool) -> str:
    """In N/mm from 1000 N/m upwards, as is usual."""
    if rotary or value < IN_N_PER_MM:
        return f"{plain(value)} {'N m/rad' if rotary else 'N/m'}"
    return f"{plain(1e-3 * value)} N/mm"


def _damping(value: float, rotary: bool) -> str:
    return f"{plain(value)} {'N m s/rad' if rotary else 'N s/m'}"


def say_stiffest(console: Console, result: BoundaryResult) -> None:
    """Print a row per delay: K_max, its B, and the last B with a stable K; then the top by theory.

    The top by theory may be at another B, and so at another frequency, than in the sentence.
    """
    force, length = ("N m", "rad") if result.rotary else ("N", "m")
    unit = f"{force}/{length}"
    asked = [b for b in result.boundaries if b.stiffest is not UNSET]
    for b in asked:
        assert b.stiffest is not UNSET
        if b.stiffest.sentence is not UNSET:
            delay = f"Delay {1e3 * b.delay_s:g} ms: " if len(asked) > 1 else ""
            console.say(f"{delay}{b.stiffest.sentence}")
    extras = [name for name, of in EXTRAS.items() if any(of(b) for b in asked)]
    columns = [
        Column("delay"), Column(f"K_max [{unit}]"), Column("at B"), Column("last stable B"),
        Column("K_max by theory"), Column("at B by theory"), Column("frequency by theory", False),
        Column("last stable B by theory"),
        *(Column(name) for name in extras),
    ]  # fmt: skip
    rows = [[*_row(b), *(EXTRAS[name](b) or NONE for name in extras)] for b in asked]
    law = "" if result.law is UNSET else f", {result.law}"
    console.table(
        f"\n{result.device}{law}: how stiff a wall may be, B in {force} s/{length}", columns, rows
    )


def _row(b: DelayBoundary) -> list[str]:
    assert b.stiffest is not UNSET
    s = b.stiffest
    return [
        f"{1e3 * b.delay_s:g} ms",
        _said(s.stiffness),
        _said(s.damping),
        _last(b),
        _said(s.linear_stiffness),
        _said(s.linear_damping),
        _jump(s),
        _said(s.linear_last_stable_damping),
    ]


def _last(b: DelayBoundary) -> str:
    """The last B with a stable wall, and whether a larger one was tried at all."""
    assert b.stiffest is not UNSET
    last = b.stiffest.last_stable_damping
    tried = max((p.damping for p in b.points), default=None)
    return f"{_said(last)} (last tried)" if last is not None and last == tried else _said(last)


def _jump(s: Stiffest) -> str:
    """The oscillations on either side of the damping at which two branches meet."""
    below, above = s.frequency_below_hz, s.frequency_above_hz
    if below is None or above is None:
        return NONE
    if max(below, above) < JUMPS * min(below, above):
        return f"{below:.3g} Hz, no jump"
    return f"jumps from {below:.3g} to {above:.3g} Hz"


def _said(value: float | None) -> str:
    """A damping in the unit of the command line."""
    return NONE if value is None else plain(value)


def _top(b: DelayBoundary) -> Point | None:
    """The point of the stiffest wall."""
    stable = [p for p in b.points if p.simulated is not None]
    return max(stable, key=lambda p: p.simulated.stable if p.simulated else 0.0, default=None)


def _passive(b: DelayBoundary) -> str:
    walls = [(p.passive.stiffness, p.damping) for p in b.points if p.passive]
    if not walls:
        return ""
    stiffness, damping = max(walls)
    return f"{plain(stiffness)} at {plain(damping)}"


def _hand(b: DelayBoundary) -> str:
    top = _top(b)
    if top is None or top.hand is UNSET:
        return ""
    return f"{top.hand.low:.4g} to {top.hand.high:.4g}"


def _hands(b: DelayBoundary) -> str:
    known = [p.hands for p in b.points if p.hands is not UNSET]
    if not known:
        return ""
    best = max(known, key=lambda s: s.low)
    return f"{best.low:.4g}, {best.median:.4g}, {best.high:.4g}"


def _spread(b: DelayBoundary) -> str:
    top = _top(b)
    if top is None or top.confidence95 is UNSET:
        return ""
    return f"{top.confidence95.low:.4g} to {top.confidence95.high:.4g}"


EXTRAS = {
    "stiffest passive wall": _passive,
    "held by a hand": _hand,
    "by 95, 50, 5 % of hands": _hands,
    "95 % of K_max": _spread,
}
