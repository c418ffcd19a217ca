"""A law of no formula: a table of a state and what it makes of it, with a smooth curve through it.

In each interval of the table, of width h and slope d, with t = clip((s - s_j) / h, 0, 1),

    f(s) = f_1 + sum over j of  d h t^2 (3 - 2 t) + h (m_j t (1 - t)^2 - m_(j+1) t^2 (1 - t)),

cubic, with a tangent m at each point that is the parabola's through it and its neighbours. Each
term is nothing before its own interval and d h after it, so the sum is the curve, without a search
for the interval, and of lanes each has its own. s is a position, a velocity, a deflection, a
command; beyond the table the law stays at its ends. odd: the table is of |s|, and f(-s) = -f(s); it
then begins at (0, 0), where its tangent is its first slope. periodic, of period P: s is taken less
whole periods, the table is of one of them (its last point before its first a period on), and one
interval more closes the turn, with tangents that are the same at both of its ends.

It is what the diagnosis learns where no name explains a recording (`diagnosis/learning`), and what
a user writes who has measured a curve:

    [[physics]]
    effect = "free_damper"
    at = "m1"
    odd = true
    table = [[0.0, 0.0], [0.5, -0.012], [2.0, -0.019]]

or, of what repeats (a detent of a motor, a ball screw, a tooth),

    effect = "free_spring"
    at = "m1"
    period = 0.0628
    table = [[0.0, 1e-3], [0.02, -2e-3], [0.05, 5e-4]]

Limits: `KNOTS` points; the curve may swing between points that are far apart. A law that is steep
against the substep is a stiff spring or damper, of second order in the substep only as long as
slope x h / m (or h^2 / m) is well below one. A table may make energy, as no damper does, which the
ledger then shows.
"""

import itertools
from collections.abc import Mapping, Sequence

from zwidth.sim.jit import part
from zwidth.sim.lane_type import any_lane, floor, greatest, least, select
from zwidth.sim.physics.effect import Parameter

KNOTS = 32
AT = tuple(f"at_{j + 1}" for j in range(KNOTS))
FORCE = tuple(f"force_{j + 1}" for j in range(KNOTS))
LAST_AT, FIRST_FORCE, LAST_FORCE, PERIOD = KNOTS, KNOTS + 1, 2 * KNOTS, 2 * KNOTS + 1


def table_parameters(state: str, makes: str) -> tuple[Parameter, ...]:
    """Return the parameters of a law: units of the state and of what the law makes of it."""
    return (
        Parameter(
            "odd", "odd", "", 0.0, 1.0, None, meaning="whether f(-s) = -f(s): a table of |s|"
        ),
        *(
            Parameter(name, f"s_{j + 1}", state, -1e9, 1e9, None, meaning=f"state of point {j + 1}")
            for j, name in enumerate(AT)
        ),
        *(
            Parameter(
                name,
                f"f_{j + 1}",
                makes,
                -1e9,
                1e9,
                0.0,
                role="magnitude",
                meaning=f"law at point {j + 1}",
            )
            for j, name in enumerate(FORCE)
        ),
        Parameter("period", "P", state, 0.0, 1e9, None, meaning="of a law that repeats; 0: none"),
    )


def table_values(
    points: Sequence[tuple[float, float]], odd: bool = False, period: float = 0.0
) -> dict[str, float]:
    """Return the parameters of a law through points (state, force), whose states rise.

    period: of a law that repeats, of which the points are one turn; 0 for none. Raises ValueError
    for fewer than two points, more than `KNOTS`, states that do not rise, of an odd law a table
    that does not begin at (0, 0), and of one that repeats points a period or more apart.
    """
    if not 2 <= len(points) <= KNOTS:
        raise ValueError(f"table has {len(points)} points; allowed is 2 to {KNOTS}")
    states = [s for s, _ in points]
    for before, after in itertools.pairwise(states):
        if not after > before:
            raise ValueError(
                f"table has the state {after:g} after {before:g}; states must rise from row to row"
            )
    if odd and tuple(points[0]) != (0.0, 0.0):
        raise ValueError(
            f"table of an odd law begins at {list(points[0])}; it must begin at [0, 0], where an"
            " odd law is nothing"
        )
    if period < 0.0 or (period > 0.0 and not states[-1] - states[0] < period):
        raise ValueError(
            f"period is {period:g} and table goes from {states[0]:g} to {states[-1]:g}; a law that"
            " repeats has points of less than one period, and the first follows the last"
        )
    if period > 0.0 and odd:
        raise ValueError(f"period is {period:g} and odd is true; a law that repeats gives its turn")
    padded = [*points, *[points[-1]] * (KNOTS - len(points))]
    return (
        {"odd": float(odd)}
        | dict(zip(AT, (float(s) for s, _ in padded), strict=True))
        | dict(zip(FORCE, (float(f) for _, f in padded), strict=True))
        | {"period": float(period)}
    )


def points_of(values: Mapping[str, float]) -> list[tuple[float, float]]:
    """Return the points of a law, in the order of their states."""
    found = [(values[AT[0]], values[FORCE[0]])]
    for s, f in zip(AT[1:], FORCE[1:], strict=True):
        if values[s] > found[-1][0]:
            found.append((values[s], values[f]))
    return found


def is_table(parameters: Sequence[Parameter]) -> bool:
    """Whether an effect is a law of this kind."""
    return any(p.name == AT[0] for p in parameters)


@part
def table_law(s, p):
    """The law at state s."""
    odd, period = p[0] > 0.5, p[PERIOD]
    cyclic = period > 0.0
    turn = select(cyclic, period, 1.0)
    x = select(odd, abs(s), s)
    x = select(cyclic, x - turn * floor((x - p[1]) / turn), x)
    # From the last point to the first one of the next turn; of nothing where none follows.
    close = select(cyclic, p[1] + period - p[LAST_AT], 0.0)
    slope_close = (p[FIRST_FORCE] - p[LAST_FORCE]) / select(cyclic, close, 1.0)
    total = p[FIRST_FORCE] + 0.0 * x
    before, slope_before = close, slope_close
    width, slope = _interval(p, 1)
    first_width, first_slope, last_width, last_slope = width, slope, width, slope
    for j in range(1, KNOTS):
        after, slope_after = _interval(p, j + 1)
        ends = cyclic & (width > 0.0) & (after <= 0.0)
        next_width, next_slope = select(ends, close, after), select(ends, slope_close, slope_after)
        first = select(odd, slope, tangent_at_end(width, slope, after, slope_after))
        left = select(before > 0.0, tangent_inside(before, slope_before, width, slope), first)
        last = tangent_at_end(width, slope, before, slope_before)
        right = select(next_width > 0.0, tangent_inside(width, slope, next_width, next_slope), last)
        total += _bend(x - p[j], width, slope, left, right)
        last_width = select(width > 0.0, width, last_width)
        last_slope = select(width > 0.0, slope, last_slope)
        before, slope_before, width, slope = width, slope, after, slope_after
    if any_lane(cyclic):
        left = tangent_inside(last_width, last_slope, close, slope_close)
        right = tangent_inside(close, slope_close, first_width, first_slope)
        total += _bend(x - p[LAST_AT], close, slope_close, left, right)
    return select(odd & (s < 0.0), -total, total)


@part
def _bend(x, width, slope, left, right):
    """An interval's part of the curve at x from its beginning: nothing before, all of it after."""
    t = least(greatest(x / select(width > 0.0, width, 1.0), 0.0), 1.0)
    rest = 1.0 - t
    return width * (slope * t * t * (3.0 - 2.0 * t) + left * t * rest * rest - right * t * t * rest)


@part
def _interval(p, j):
    """Width and slope of the interval from point j on; nothing beyond the last."""
    if j == KNOTS:
        return 0.0 * p[1], 0.0 * p[1]
    width = p[j + 1] - p[j]
    there = width > 0.0
    rise = p[KNOTS + 1 + j] - p[KNOTS + j]
    return select(there, width, 0.0), select(there, rise / select(there, width, 1.0), 0.0)


@part
def tangent_inside(before, slope_before, after, slope_after):
    """The parabola's through a point and its neighbours, at that point."""
    both = before + after
    wide = select(both > 0.0, both, 1.0)
    return (after * slope_before + before * slope_after) / wide


@part
def tangent_at_end(width, slope, beside, slope_beside):
    """The parabola's through an end and the two points next to it, at that end."""
    both = width + beside
    wide = select(both > 0.0, both, 1.0)
    return select(beside > 0.0, slope + width * (slope - slope_beside) / wide, slope)
