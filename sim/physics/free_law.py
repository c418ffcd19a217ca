"""A law without a formula: a table of states and values, with a smooth curve through it.

In each interval of the table, of width h and slope d, with t = clip((s - s_j) / h, 0, 1),

    f(s) = f_1 + sum over j of  d h t^2 (3 - 2 t) + h (m_j t (1 - t)^2 - m_(j+1) t^2 (1 - t)),

cubic, with a tangent m at each point that is the parabola's through it and its neighbours. Each
term is zero before its own interval and d h after it, so the sum is the curve, of lanes each in an
interval of its own, and a term is worked out only where a lane is inside. s is a position, a
velocity, a deflection, a command; beyond the table the law stays at its ends. odd: the table is of
|s|, and f(-s) = -f(s); it then begins at (0, 0), where its tangent is its first slope. periodic, of
period P: s is taken less whole periods, the table is of one of them (its last point before its
first a period on), and one interval more closes the turn, with tangents that are the same at both
of its ends.

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
slope x h / m (or h^2 / m) is well below one. Unlike a damper, a table may generate energy, which
the ledger then shows.
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
        *numbered(AT, "s", state, "state of point"),
        *numbered(FORCE, "f", makes, "law at point", magnitude=True),
        Parameter("period", "P", state, 0.0, 1e9, None, meaning="of a law that repeats; 0: none"),
    )


def numbered(
    names: Sequence[str], symbol: str, unit: str, meaning: str, magnitude: bool = False
) -> list[Parameter]:
    """Return the parameters of a row of numbers: states, or (magnitude) values."""
    return [
        Parameter(
            name, f"{symbol}_{j + 1}", unit, -1e9, 1e9, 0.0 if magnitude else None,
            role="magnitude" if magnitude else "shape", meaning=f"{meaning} {j + 1}",
        )
        for j, name in enumerate(names)
    ]  # fmt: skip


def table_values(
    points: Sequence[tuple[float, float]], odd: bool = False, period: float = 0.0
) -> dict[str, float]:
    """Return the parameters of a law through points (state, force) with rising states.

    period: of a periodic law, whose points cover one period; 0 if it is not periodic. Raises
    ValueError for fewer than two points, more than `KNOTS`, or states that do not rise; for an odd
    law, if the table does not begin at (0, 0); for a periodic law, if points are a period or more
    apart.
    """
    check_points("table", points, KNOTS)
    states = [s for s, _ in points]
    if odd and tuple(points[0]) != (0.0, 0.0):
        raise ValueError(
            f"table of an odd law begins at {list(points[0])}; it must begin at [0, 0], where an"
            " odd law is zero"
        )
    if period < 0.0 or (period > 0.0 and not states[-1] - states[0] < period):
        raise ValueError(
            f"period is {period:g} and table goes from {states[0]:g} to {states[-1]:g}; the points"
            " of a periodic law must cover less than one period, since the law starts again at the"
            " first"
        )
    if period > 0.0 and odd:
        raise ValueError(f"period is {period:g} and odd is true; only one of them is allowed")
    return (
        {"odd": float(odd)}
        | row_values(AT, states)
        | row_values(FORCE, [f for _, f in points])
        | {"period": float(period)}
    )


def check_points(name: str, points: Sequence[tuple[float, float]], most: int) -> None:
    """Raise ValueError unless a table has 2 to `most` points (state, law) with rising states."""
    if not 2 <= len(points) <= most:
        raise ValueError(f"{name} has {len(points)} points; it must have from 2 to {most}")
    check_rising(name, "state", [s for s, _ in points], "row to row")


def check_rising(name: str, what: str, states: Sequence[float], along: str) -> None:
    """Raise ValueError unless states rise; what, along: words for the states and their order."""
    for before, after in itertools.pairwise(states):
        if not after > before:
            raise ValueError(
                f"{name} has the {what} {after:g} after {before:g}; states must rise from {along}"
            )


def row_values(names: Sequence[str], numbers: Sequence[float]) -> dict[str, float]:
    """Return the parameters of a row by name; the last number is repeated for unused names."""
    padded = [*numbers, *[numbers[-1]] * (len(names) - len(numbers))]
    return dict(zip(names, map(float, padded), strict=True))


def rising(values: Mapping[str, float], names: Sequence[str]) -> list[int]:
    """Return the indices of the points that a row has, without repetitions of the last state."""
    found = [0]
    for j, name in enumerate(names):
        if values[name] > values[names[found[-1]]]:
            found.append(j)
    return found


def points_of(
    values: Mapping[str, float], at: Sequence[str] = AT, laws: Sequence[str] = FORCE
) -> list[tuple[float, float]]:
    """Return the points of a law, in the order of their states.

    at, laws: the names of its states and of its values.
    """
    return [(values[at[j]], values[laws[j]]) for j in rising(values, at)]


def is_table(parameters: Sequence[Parameter]) -> bool:
    """Whether an effect is a law given as a table over one state."""
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
    slope_close = per(p[FIRST_FORCE] - p[LAST_FORCE], close)
    total = curve_through(x, p, 1, FIRST_FORCE, KNOTS - 1, odd, close, slope_close)
    beyond = x - p[LAST_AT]
    if any_lane((beyond > 0.0) & (beyond < close)):
        left, right = _closing(p, close, slope_close)
        total += _bend(beyond, close, slope_close, left, right)
    return select(odd & (s < 0.0), -total, total)


@part
def curve_through(x, p, at, laws, count, odd, close, slope_close):
    """The curve at x through points, states from p[at] on and laws from p[laws] on.

    count: of its intervals. close, slope_close: width and slope of the interval that closes the
    turn of a periodic law, 0 for none.
    """
    total = p[laws] + 0.0 * x
    for j in range(count):
        width, beyond = width_of(p, at, count, j), x - p[at + j]
        there = width > 0.0
        if any_lane(there & (beyond > 0.0)):
            if any_lane((beyond > 0.0) & (beyond < width)):
                slope = slope_of(p, at, laws, count, j)
                before, slope_before = close, slope_close
                if j > 0:
                    before = width_of(p, at, count, j - 1)
                    slope_before = slope_of(p, at, laws, count, j - 1)
                after = width_of(p, at, count, j + 1)
                slope_after = slope_of(p, at, laws, count, j + 1)
                ends = (close > 0.0) & there & (after <= 0.0)
                next_width = select(ends, close, after)
                next_slope = select(ends, slope_close, slope_after)
                first = select(odd, slope, _at_end(width, slope, after, slope_after))
                left = select(before > 0.0, _inside(before, slope_before, width, slope), first)
                last = _at_end(width, slope, before, slope_before)
                right = _inside(width, slope, next_width, next_slope)
                right = select(next_width > 0.0, right, last)
                total += _bend(beyond, width, slope, left, right)
            total = select(there & (beyond >= width), p[laws + j + 1], total)
    return total


@part
def _closing(p, close, slope_close):
    """The tangents at both ends of the interval that closes the turn of a periodic law."""
    width = width_of(p, 1, KNOTS - 1, 0)
    first = _inside(close, slope_close, width, slope_of(p, 1, KNOTS + 1, KNOTS - 1, 0))
    rise = p[KNOTS + 2] - p[KNOTS + 1]
    for j in range(1, KNOTS - 1):
        own = width_of(p, 1, KNOTS - 1, j)
        rise = select(own > 0.0, p[KNOTS + 2 + j] - p[KNOTS + 1 + j], rise)
        width = select(own > 0.0, own, width)
    return _inside(width, per(rise, width), close, slope_close), first


@part
def _bend(x, width, slope, left, right):
    """An interval's part of the curve at x from its beginning: zero before, all of it after."""
    t = least(greatest(x / select(width > 0.0, width, 1.0), 0.0), 1.0)
    rest = 1.0 - t
    return width * (slope * t * t * (3.0 - 2.0 * t) + left * t * rest * rest - right * t * t * rest)


@part
def width_of(p, at, count, j):
    """Width of an interval of a table, of count of them; nothing beyond the last.

    Its states begin at p[at].
    """
    if j == count:
        return 0.0 * p[at]
    width = p[at + j + 1] - p[at + j]
    return select(width > 0.0, width, 0.0)


@part
def slope_of(p, at, laws, count, j):
    """Slope of an interval of a table, as `width_of`; its values begin at p[laws]."""
    if j == count:
        return 0.0 * p[at]
    return per(p[laws + j + 1] - p[laws + j], p[at + j + 1] - p[at + j])


@part
def per(x, width):
    """Return x over a width, zero if the width is zero."""
    there = width > 0.0
    return select(there, x / select(there, width, 1.0), 0.0)


@part
def _inside(before, slope_before, after, slope_after):
    """The parabola's through a point and its neighbours, at that point."""
    both = before + after
    wide = select(both > 0.0, both, 1.0)
    return (after * slope_before + before * slope_after) / wide


@part
def _at_end(width, slope, beside, slope_beside):
    """The parabola's through an end and the two points next to it, at that end."""
    both = width + beside
    wide = select(both > 0.0, both, 1.0)
    return select(beside > 0.0, slope + width * (slope - slope_beside) / wide, slope)
