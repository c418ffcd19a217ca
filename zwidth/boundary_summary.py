"""How stiff a wall may be, for each delay, before the boundary is told point by point."""

from msgspec import UNSET

from zwidth.console import Column, Console
from zwidth.results import BoundaryResult, DelayBoundary, Point, Stiffest
from zwidth.sim.readable import plain
from zwidth.stability.boundary import Boundary
from zwidth.stability.linear import corner, has_theory, last_stable_damping

NONE = "-"
JUMPS = 1.2  # ratio of the frequencies on either side of the top, from which it is a jump


def stiffest(boundary: Boundary) -> Stiffest:
    """Return the top and the end of a boundary, by both ways."""
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


def say_stiffest(console: Console, result: BoundaryResult) -> None:
    """Print a row a delay: K_max, its B, the last B with a stable K, the jump of the frequency."""
    force, length = ("N m", "rad") if result.rotary else ("N", "m")
    unit = f"{force}/{length}"
    asked = [b for b in result.boundaries if b.stiffest is not UNSET]
    extras = [name for name, of in EXTRAS.items() if any(of(b) for b in asked)]
    columns = [
        Column("delay"), Column(f"K_max [{unit}]"), Column("at B"),
        Column("by linear theory: K_max"), Column("at B"), Column("last stable B"),
        Column("by theory"), Column("frequency at the top", False),
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
        _said(s.linear_stiffness),
        _said(s.linear_damping),
        _last(b),
        _said(s.linear_last_stable_damping),
        _jump(s),
    ]


def _last(b: DelayBoundary) -> str:
    """The last B with a stable wall, and whether a larger one was tried at all."""
    assert b.stiffest is not UNSET
    last = b.stiffest.last_stable_damping
    tried = max((p.damping for p in b.points), default=None)
    return f"{_said(last)} (last tried)" if last is not None and last == tried else _said(last)


def _jump(s: Stiffest) -> str:
    """Where two branches meet, on which side of it which oscillation begins."""
    below, above = s.frequency_below_hz, s.frequency_above_hz
    if below is None or above is None:
        return NONE
    if max(below, above) < JUMPS * min(below, above):
        return f"{below:.3g} Hz, no jump"
    return f"jumps from {below:.3g} to {above:.3g} Hz"


def _said(value: float | None) -> str:
    """In the unit in which it is typed."""
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
